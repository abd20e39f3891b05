"""Gradients by the adjoint equation: against closed forms, differences, and each other."""

from dataclasses import replace
from typing import Any, Literal

import casadi as ca
import hypothesis.strategies as st
import numpy as np
import pytest
from effort import examples
from hypothesis import given, settings

import wormopt as wo
from tests.benchmarks.cases import mag2
from wormopt.errors import ArgumentError, UnknownNameError
from wormopt.model.friction import Coulomb, Spike, Stribeck
from wormopt.model.model import Contact, Model, Output, Signal, Switch
from wormopt.model.schedule import Schedule
from wormopt.simulation.gradient import gradient
from wormopt.simulation.options import Smooth, Tolerance
from wormopt.simulation.simulate import simulate

STEP = 1e-30  # of complex differences of closed forms, which are exact


def slopes(closed, values: dict[str, float]) -> dict[str, float]:
    """Derivatives of a closed form by each of its numbers."""
    return {
        name: closed(**{**values, name: value + 1j * STEP}).imag / STEP
        for name, value in values.items()
    }


def block(load: ca.SX | float = 0.0, t: ca.SX | None = None, **parameters: float) -> Model:
    """A block on rough ground with a load that pulls it."""
    x, v, f, m, ahead = (ca.SX.sym(name) for name in ("x", "v", "f", "mass", "friction"))
    more = [Signal(s.name(), s) for s in ca.symvar(ca.SX(load)) if t is None or s.name() != "t"]
    return Model(
        "block",
        [Signal("position", x, value=0.0), Signal("velocity", v, value=0.0)],
        ca.vertcat(v, (load + f) / m),
        p=[Signal("mass", m, value=2.0), Signal("friction", ahead, value=1.5), *more],
        contacts=[Contact("block", v, f, Coulomb(ahead, 4.0))],
        outputs=[Output("energy", m * v**2 / 2)],
        t=t if t is not None else ca.SX.sym("t"),
    )


# -- closed forms ----------------------------------------------------------------------------------


@settings(max_examples=examples(15))
@given(mass=st.floats(0.3, 3.0), friction=st.floats(0.3, 3.0), speed=st.floats(0.3, 3.0))
def test_a_block_that_stops_has_gone_as_far_as_its_energy_lasts(
    mass: float, friction: float, speed: float
):
    """m v^2 / (2 F), whatever comes after."""
    span = 2 * mass * speed / friction
    start, numbers = {"velocity": speed}, {"mass": mass, "friction": friction}
    found = gradient(simulate(BLOCK, span, x0=start, p=numbers, dense=True), {"position": [1.0]})
    far = mass * speed**2 / (2 * friction)
    assert found.x0["position"] == pytest.approx(1.0, abs=1e-12)
    assert found.x0["velocity"] == pytest.approx(2 * far / speed, rel=1e-10)
    assert found.p["mass"] == pytest.approx(far / mass, rel=1e-10)
    assert found.p["friction"] == pytest.approx(-far / friction, rel=1e-10)


BLOCK = block()


def test_a_load_that_grows_lets_the_block_go_when_it_holds_no_more():
    """It begins to slide at F / k, and has gone k (T - F/k)^3 / (6 m) at T."""
    t, k = ca.SX.sym("t"), ca.SX.sym("growth")
    numbers = {"mass": 2.0, "friction": 1.5, "growth": 0.8}
    motion = simulate(block(k * t, t), 4.0, p=numbers, dense=True)
    found = gradient(motion, {"position": [1.0]})
    known = slopes(
        lambda mass, friction, growth: growth * (4.0 - friction / growth) ** 3 / (6 * mass), numbers
    )
    for name, slope in known.items():
        assert found.p[name] == pytest.approx(slope, rel=1e-10)
    assert found.x0["velocity"] == pytest.approx(0.0, abs=1e-12)  # it would stop at once


def test_a_step_of_a_schedule_lets_go_what_far_more_held():
    """From rest at 1 it goes (u - F) (T - 1)^2 / (2 m); a bound that stands still never fires."""
    u, begin = ca.SX.sym("u"), ca.SX.sym("begin")
    push = Schedule("push", u, begin, np.arange(3.0), np.array([[0.0], [40.0]]))
    pulled = block(u)
    model = replace(pulled, p=pulled.p[:2], schedules=[push])
    numbers = {"friction": 30.0}
    found = gradient(simulate(model, 2.0, p=numbers, dense=True), {"position": [1.0]})
    assert found.schedules["push"].ravel() == pytest.approx([0.0, 0.25], abs=1e-12)
    assert found.p["friction"] == pytest.approx(-0.25, rel=1e-10)
    assert found.p["mass"] == pytest.approx(-10.0 / 8, rel=1e-10)


def bouncing() -> Model:
    x, v, g, e = (ca.SX.sym(name) for name in ("x", "v", "g", "e"))
    states = [Signal("height", x, value=1.0), Signal("rate", v, value=0.0)]
    numbers = [Signal("gravity", g, value=9.0), Signal("restitution", e, value=0.8)]
    switches = [Switch("bounce", -x, ca.vertcat(x, -e * v))]
    return Model("ball", states, ca.vertcat(v, -g), p=numbers, switches=switches)


def test_a_ball_that_bounces_twice():
    """A switch with a reset, at times that depend on all that is differentiated by."""

    def closed(height, rate, gravity, restitution, time=1.4):
        fall = (rate + (rate**2 + 2 * gravity * height) ** 0.5) / gravity
        first = restitution * (rate**2 + 2 * gravity * height) ** 0.5
        second, after = restitution * first, time - fall - 2 * first / gravity
        return second * after - gravity * after**2 / 2

    numbers = {"height": 1.0, "rate": 0.3, "gravity": 9.0, "restitution": 0.8}
    motion = simulate(bouncing(), 1.4, x0={"rate": 0.3}, dense=True)
    assert len(motion.events) == 2
    assert motion.end[0] == pytest.approx(closed(**numbers), abs=1e-11)
    found = gradient(motion, {"height": [1.0]})
    by = {**found.x0, **found.p}
    for name, slope in slopes(closed, numbers).items():
        assert by[name] == pytest.approx(slope, rel=1e-9), name


def scheduled(pieces: int) -> Model:
    """x'' = u, pushed piece by piece, from rest on ground that nothing but u moves."""
    x, v, u, begin, t = (ca.SX.sym(name) for name in ("x", "v", "u", "begin", "t"))
    values = np.linspace(1.0, 2.0, pieces)[:, None]
    push = Schedule("push", u, begin, np.linspace(0.0, 3.0, pieces + 1), values, periodic=True)
    states = [Signal("position", x, value=0.0), Signal("velocity", v, value=0.0)]
    ode = ca.vertcat(v, u * (1 + t - begin))
    return Model("pushed", states, ode, schedules=[push], outputs=[Output("power", u * v)], t=t)


def test_values_of_a_schedule_that_repeats_count_each_time():
    """A push u (1 + s) for a time h moves it by u (h (T - end) + h^2/2 (T - end + h/3) + h^2/2)."""
    pieces, span, h = 6, 6.0, 0.5
    motion = simulate(scheduled(pieces), span, times=[1.2, span], dense=True)
    found = gradient(motion, {"position": [[0.0, 1.0]], "power": [[0.0, 0.0]]})
    rest = span - h * (np.arange(2 * pieces) + 1)
    moved = h * (1 + h / 2) * rest + h**2 / 2 + h**3 / 6
    assert found.schedules["push"][:, 0] == pytest.approx(
        moved[:pieces] + moved[pieces:], rel=1e-11
    )


def test_an_output_counts_parameters_that_stand_in_it():
    """The power u v at t = 0.7, where u1 holds and v = u0 (h + h^2/2) + u1 (0.2 + 0.2^2/2)."""
    model = scheduled(6)
    motion = simulate(model, 1.0, times=[0.7, 1.0], dense=True)
    found = gradient(motion, {"power": [[1.0, 0.0]]})
    u = model.schedules[0].values[:, 0]
    first, second = 0.5 + 0.5**2 / 2, 0.2 + 0.2**2 / 2
    speed = u[0] * first + u[1] * second
    expected = [u[1] * first, speed + u[1] * second, 0.0, 0.0, 0.0, 0.0]
    assert found.schedules["push"][:, 0] == pytest.approx(expected, abs=1e-12)


# -- differences of tight simulations --------------------------------------------------------------

TIGHT = Tolerance(1e-13, 1e-14)
ROUGH = wo.Coulomb(1.0, 10.0)
WORM = wo.chain(
    2, mass=1.0, stiffness=10.0, damping=0.5, rest_length=2.0, law=ROUGH, position=[4.7, 2.0, 0.1]
)  # fmt: skip


def differences(number, signals, key: str, step: float = 1e-4) -> dict[str, np.ndarray]:
    """Of fourth order, by each entry of signals; `key` of what `simulate` takes."""
    found = {}
    for name, value in signals.items():
        columns = []
        for unit in np.eye(len(value)):
            at = [number(**{key: {name: value + s * step * unit}}) for s in (1, -1, 2, -2)]
            columns.append((8 * (at[0] - at[1]) - (at[2] - at[3])) / (12 * step))
        found[name] = np.array(columns)
    return found


def test_a_spike_that_is_thrown_back_stops_at_once():
    """A bounce reverses a spiked block, which then does not move: only its place counts."""
    x, v, f, wall = (ca.SX.sym(name) for name in ("x", "v", "f", "wall"))
    hit = Switch("hit", x - wall, ca.vertcat(x, -0.5 * v))
    states = [Signal("position", x, value=0.0), Signal("velocity", v, value=1.0)]
    numbers, contacts = [Signal("wall", wall, value=0.4)], [Contact("spike", v, f, Spike(0.1))]
    model = Model("spiked", states, ca.vertcat(v, f), p=numbers, contacts=contacts, switches=[hit])
    motion = simulate(model, 2.0, dense=True)
    assert [event.kind for event in motion.events] == ["switch", "impact"]
    found = gradient(motion, {"position": [1.0]})
    assert found.p["wall"] == pytest.approx(1.0, abs=1e-12)
    assert found.x0["velocity"] == pytest.approx(0.0, abs=1e-12)
    assert found.x0["position"] == pytest.approx(0.0, abs=1e-12)


# -- against sensitivities forward in time ---------------------------------------------------------


def assert_as_forward(
    model: Model, span: float | tuple[float, float], weights, asked: list[str], **how
) -> None:
    """Every derivative as the sum of weights times derivatives of the samples, to 1e-8.

    Without times these are start and end.
    """
    ends = span if isinstance(span, tuple) else (0.0, span)
    options: dict[str, Any] = {"times": ends} | how
    motion = simulate(model, span, sensitivities=asked, dense=True, **options)
    found = gradient(motion, weights)
    forward = np.zeros(len(motion.directions))
    for name, w in weights.items():
        forward += np.einsum(
            "im,ikm->k", np.reshape(w, motion[name].shape), motion.derivative(name)
        )
    by = {**found.x0, **found.p, **found.schedules}
    backward = np.concatenate([np.ravel(by[name]) for name in asked])
    size = np.abs(forward).max()
    assert size > 0.01
    assert backward == pytest.approx(forward, abs=1e-8 * size)


@settings(max_examples=examples(9))
@given(seed=st.integers(0, 2**32 - 1))
def test_chains_agree_with_sensitivities_forward_in_time(seed: int):
    random = np.random.default_rng(seed)
    start = np.array([4.0, 2.0, 0.0]) + random.uniform(-0.8, 0.8, 3)
    asked = ["position", "velocity", "mass", "stiffness", "load", "friction_forward", "input"]
    assert_as_forward(
        WORM,
        2.7,
        {"position": random.normal(size=(3, 12)), "energy": random.normal(size=(1, 12))},
        asked,
        x0={"position": start},
        p={"mass": random.uniform(0.5, 2.0, 3), "friction_forward": random.uniform(0.3, 1.0, 3)},
        times=np.linspace(0.0, 2.7, 12),
    )


@pytest.mark.slow
@pytest.mark.parametrize("feedback", ["derivative", "filter"])
def test_trackers_agree_with_sensitivities_forward_in_time(
    feedback: Literal["derivative", "filter"],
):
    """Contacts, a gain that grows, and a reference by a schedule, through some 28 events."""
    plant = wo.chain(2, mass=1.0, stiffness=10.0, damping=5.0, rest_length=2.0, law=ROUGH)
    reference = wo.gait_reference(wo.fast_gait(period=1.0), plant.t, shift=0.0)
    loop = wo.lambda_tracker(
        plant, reference, tube_radius=0.2, adaptation=wo.Quadratic(growth=1e2), feedback=feedback
    )
    weights = np.random.default_rng(1).normal(size=(3, 34))
    assert_as_forward(
        loop,
        3.3,
        {"position": weights},
        ["position", "gain", "mass", "friction_forward", "reference"],
        times=np.linspace(0.0, 3.3, 34),
    )


def two_masses(rates, contacts) -> Model:
    """Two coordinates that two periodic forces pull; friction and a spring are parameters."""
    x, v, f = (ca.SX.sym(name, 2) for name in "xvf")
    t, friction, spring = (ca.SX.sym(name) for name in ("t", "friction", "spring"))
    pull = ca.vertcat(3 * ca.cos(2 * t), 2 * ca.sin(3 * t)) - spring * x
    return Model(
        "two",
        [Signal("place", x, value=[0.0, 0.1]), Signal("rate", v, value=[0.5, -0.2])],
        ca.vertcat(v, rates(pull, v, f)),
        t=t,
        p=[Signal("friction", friction, value=1.0), Signal("spring", spring, value=0.4)],
        contacts=[Contact(str(k), *each) for k, each in enumerate(contacts(v, f, friction))],
    )


LEVER = np.linalg.inv([[2.0, 0.7], [0.7, 1.5]])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rates", "contacts"),
    [
        pytest.param(
            lambda pull, v, f: LEVER @ (pull + f),
            lambda v, f, F: [(v[0], f[0], Coulomb(F, 1.5)), (v[1], f[1], Coulomb(0.8, 1.2))],
            id="forces act on both",
        ),
        pytest.param(
            lambda pull, v, f: pull + ca.vertcat(f[0] - v[0] / 5, -f[0] - v[1] / 3),
            lambda v, f, F: [(v[0] - v[1], f[0], Coulomb(F, 1.5))],
            id="a velocity that is no state",
        ),
        pytest.param(
            lambda pull, v, f: pull + f,
            lambda v, f, F: [
                (v[0], f[0], Stribeck(F, 1.5, 1.3 * F, 1.9, 0.2)),
                (v[1], f[1], Stribeck(0.8, 1.2, 1.0, 1.5, 0.2)),
            ],
            id="forces that jump at release",
        ),
    ],
)
def test_kinds_of_contact_agree_with_sensitivities_forward_in_time(rates, contacts):
    model = two_masses(rates, contacts)
    asked = ["place", "rate", "friction", "spring"]
    assert_as_forward(model, 12.0, {"place": [[0.0, 1.0], [0.0, 2.0]]}, asked)


@pytest.mark.slow
def test_the_magnetic_pair_agrees_through_all_its_events():
    model = mag2()
    asked = [signal.name for signal in (*model.x, *model.p)]
    weights = {model.x[0].name: [[0.0, 1.0], [0.0, -1.0]]}
    assert_as_forward(model, 400.0, weights, asked)


@pytest.mark.slow
def test_samples_may_lie_at_events_and_on_one_another():
    start = {"position": [4.3, 2.1, -0.3]}
    events = np.array([event.time for event in simulate(WORM, (1.0, 4.0), x0=start).events])
    assert len(events) == 3
    beside = np.concatenate([events, events + 1e-15, events - 1e-13])
    times = np.sort(np.concatenate([beside, [1.0, 1.0, 4.0, 4.0], np.linspace(1.0, 4.0, 7)]))
    weights = np.random.default_rng(3).normal(size=(3, len(times)))
    asked = ["position", "mass", "stiffness", "friction_forward"]
    assert_as_forward(WORM, (1.0, 4.0), {"position": weights}, asked, x0=start, times=times)


def test_a_motion_that_ends_early_counts_the_samples_that_it_came_to():
    """x = 1 - g t^2 / 2 at 0, 0.3 and 0.4 s; it ends before 2 s."""
    ball = bouncing()
    ends = replace(ball.switches[0], terminal=True)
    motion = simulate(replace(ball, switches=[ends]), 3.0, times=[0.0, 0.3, 0.4, 2.0], dense=True)
    found = gradient(motion, {"height": np.ones((1, 3))})
    assert found.p["gravity"] == pytest.approx(-(0.3**2 + 0.4**2) / 2, rel=1e-11)


# -- by other routes -------------------------------------------------------------------------------


@pytest.mark.slow
def test_python_and_compiled_code_agree():
    motion = simulate(WORM, 2.0, dense=True)
    compiled, plain = (
        gradient(motion, {"position": [1.0, 2.0, 3.0]}, route=route) for route in ("auto", "python")
    )
    for one, other in ((compiled.p, plain.p), (compiled.x0, plain.x0)):
        for name, value in one.items():
            assert value == pytest.approx(other[name], abs=1e-10), name


def test_smooth_contact_tends_to_the_exact_one():
    start = {"velocity": 1.0}
    exact = gradient(simulate(BLOCK, 3.0, x0=start, dense=True), {"position": [1.0]})
    smooth = gradient(
        simulate(BLOCK, 3.0, x0=start, contact=Smooth(1e-3), dense=True), {"position": [1.0]}
    )
    assert smooth.p["mass"] == pytest.approx(exact.p["mass"], rel=5e-3)
    assert smooth.p["friction"] == pytest.approx(exact.p["friction"], rel=5e-3)
    assert smooth.p["mass"] != pytest.approx(exact.p["mass"], rel=1e-6)


def test_units_of_the_number_do_not_matter():
    motion = simulate(WORM, 2.0, dense=True)
    one, small = (gradient(motion, {"position": c * np.ones(3)}) for c in (1.0, 1e-9))
    for name, value in one.p.items():
        assert 1e9 * small.p[name] == pytest.approx(value, rel=1e-9, abs=1e-12), name


def test_nothing_depends_on_what_is_not_weighed():
    motion = simulate(WORM, 2.0, dense=True)
    found = gradient(motion, {"position": np.zeros(3)})
    assert not any(np.any(value) for value in (*found.x0.values(), *found.p.values()))


def test_what_is_in_doubt_forward_is_in_doubt_backward():
    """Ten pulls at what holds ten: a little more lets it go."""
    held, edge = (
        simulate(WORM, 0.1, x0={"position": [x, 2.0, 0.1]}, dense=True) for x in (4.7, 5.0)
    )
    weights = {"position": [1.0, 0.0, 0.0]}
    assert gradient(held, weights).nonsmooth_events == ()
    reasons = {doubt.reason for doubt in gradient(edge, weights).nonsmooth_events}
    assert "edge" in reasons


@pytest.mark.parametrize(
    ("weights", "message"),
    [
        ({"place": [1.0]}, "no state or output 'place'"),
        ({"position": [1.0, 2.0]}, r"\(3, 2\) or \(3,\), not \(2,\)"),
        ({"position": np.ones((3, 5))}, r"not \(3, 5\)"),
        ({"position": [np.nan, 0.0, 0.0]}, "must be finite"),
        ({"position": "far"}, "list of numbers"),
        ([1.0], "by name"),
    ],
)
def test_weights_that_do_not_fit_are_refused(weights, message: str):
    motion = simulate(WORM, 0.1, times=[0.0, 0.1], dense=True)
    with pytest.raises((ArgumentError, UnknownNameError), match=message):
        gradient(motion, weights)


def test_motions_that_cannot_be_followed_back_are_refused():
    with pytest.raises(ArgumentError, match="dense=True"):
        gradient(simulate(WORM, 0.1), {"position": [1.0, 0.0, 0.0]})
    with pytest.raises(ArgumentError, match="must be a Trajectory, not Model"):
        gradient(WORM, {"position": [1.0, 0.0, 0.0]})  # type: ignore[arg-type]
    motion = simulate(WORM, 0.1, dense=True)
    with pytest.raises(ArgumentError, match="route must be one of"):
        gradient(motion, {"position": [1.0, 0.0, 0.0]}, route="fast")  # type: ignore[arg-type]
