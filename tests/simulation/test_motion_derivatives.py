"""`simulate(sensitivities=...)`: closed forms, invariants, differences of other integrators."""

import math
from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np
import pytest
from derived import block, changes
from effort import examples
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from on_routes import shaken
from scipy.linalg import expm

from tests.benchmarks.cases import mag2, track
from tests.oracles.by_events import Followed, coulomb
from wormopt.control.lambda_tracker import Quadratic, lambda_tracker
from wormopt.control.loop import Reference, gait_reference
from wormopt.control.switching import switching_tracker
from wormopt.errors import SolveError
from wormopt.model.friction import Coulomb
from wormopt.model.model import Contact, Model, Signal, Switch
from wormopt.model.schedule import Schedule
from wormopt.simulation.automaton import integrate as in_python
from wormopt.simulation.ensemble import Scenario, simulate_ensemble
from wormopt.simulation.options import Smooth, Tolerance
from wormopt.simulation.simulate import simulate, task_of, trajectory_of
from wormopt.simulation.trajectory import Trajectory
from wormopt.systems.chain.build import chain
from wormopt.systems.spiked.construct import travelling_sine

SHARP = Tolerance(1e-13, 1e-14)

WAYS = ("forward", "backward")


def moved(model: Model, name: str, entry: int, by: float) -> dict[str, Any]:
    """Arguments of `simulate` with one number of the model moved."""
    found = next(s for s in (*model.x, *model.p, *model.u) if s.name == name)
    given = np.zeros(found.size) if found.value is None else np.array(found.value, dtype=float)
    values = np.broadcast_to(given, (found.size,)).copy()
    values[entry] += by
    return {"x0" if found in model.x else "p": {name: values}}


def differences(model: Model, span: float, label: str, h: float, **more: Any) -> np.ndarray:
    """Derivative of the end by Richardson's central differences of sharp motions."""
    name, _, entry = label.removesuffix("]").partition("[")
    ends = [
        simulate(model, span, tolerance=SHARP, **moved(model, name, int(entry or 0), k * h), **more)
        for k in (1, -1, 2, -2)
    ]
    assert len({len(motion.events) for motion in ends}) == 1
    one, two = ends[0].end - ends[1].end, ends[2].end - ends[3].end
    return (8 * one - two) / (12 * h)


# -- closed forms ----------------------------------------------------------------------------


def test_a_block_that_is_thrown_stops_as_energy_says(route: Any):
    motion = simulate(block(), 10.0, sensitivities=["velocity", "mass", "friction"], route=route)
    (v, m, f), (stop,) = (2.0, 3.0, 1.5), motion.events
    assert motion.directions == ("velocity", "mass", "friction")
    np.testing.assert_allclose(changes(stop), [m / f, v / f, -m * v / f**2], rtol=1e-12)
    way = [m * v / f, v**2 / (2 * f), -m * v**2 / (2 * f**2)]
    np.testing.assert_allclose(motion.end_derivative, [way, [0, 0, 0]], rtol=1e-12)
    assert motion.nonsmooth_events == ()


def test_a_growing_load_lets_go_when_stiction_says(route: Any):
    """At rest until load t = 3 = 2 F, then m v' = load t - F."""
    model, t = block(lambda t, load: load * t, speed=0.0), 14.0
    sensitivities = ["load", "friction", "mass"]
    sampled = simulate(model, t, sensitivities=sensitivities, route=route, times=[6.0, t])
    (release,) = sampled.events
    a, f, m = 0.25, 1.5, 3.0
    s = 2 * f / a
    np.testing.assert_allclose(changes(release), [-s / a, 2 / a, 0.0], rtol=1e-12, atol=1e-13)
    v = (a * (t**2 - s**2) / 2 - f * (t - s)) / m
    by_s = (f - a * s) / m  # what a later release takes from the velocity
    speed = [(t**2 - s**2) / (2 * m) - by_s * s / a, -(t - s) / m + by_s * 2 / a, -v / m]
    np.testing.assert_allclose(sampled.end_derivative[1], speed, rtol=1e-10)
    np.testing.assert_array_equal(sampled.derivative("velocity")[..., 0], 0.0)
    # at rest the ground's force is minus the load
    force = sampled.derivative("force")[0, :, 0]
    np.testing.assert_allclose(force, [-6.0, 0.0, 0.0], atol=1e-13)
    np.testing.assert_allclose(sampled.derivative("energy")[0, 0, -1], m * v * speed[0], rtol=1e-10)


def test_the_magneto_elastic_pair_by_matrix_exponentials_and_jumps_written_out():
    """Through all 369 events of MAG2: the flow in between is linear, given the events' times."""
    eps, nu = 0.036, math.sqrt(2.0) + 0.5 * 0.036
    motion = simulate(mag2(), 400.0, sensitivities=["position"])
    assert len(motion.events) == 369
    assert motion.nonsmooth_events == ()
    states = simulate(mag2(), 400.0, times=[e.time for e in motion.events])
    modes, at, s = motion.modes[0, 1:], 0.0, np.eye(4)[:, :2]
    for event, x in zip(motion.events, states.states.T, strict=True):
        i = int(event.name[-1])
        s = held(modes, event.time - at) @ s
        pull = x[0] - x[1] + eps * (1 + math.cos(nu * event.time))
        free = np.array([-pull, pull])[i]
        before = free + eps * (-0.5 if modes[i] > 0 else 1.0) if modes[i] else 0.0
        after = free + eps * (-0.5 if event.mode > 0 else 1.0) if event.mode else 0.0
        if modes[i]:  # the velocity passes 0
            dt = -s[2 + i] / before
        else:  # the force reaches its bound: without stiction nothing jumps
            drive = eps * nu * math.sin(nu * event.time)
            rate = np.array([x[2] - x[3] - drive, x[3] - x[2] + drive])[i]
            dt = -(s[i] - s[1 - i]) / rate
        np.testing.assert_allclose(changes(event), dt, rtol=1e-7, atol=1e-8)
        s[2 + i] += (before - after) * dt
        if event.mode == 0:
            s[2 + i] = 0.0
        modes, at = np.where(np.arange(2) == i, event.mode, modes), event.time
    s = held(modes, 400.0 - at) @ s
    np.testing.assert_allclose(motion.end_derivative, s, rtol=1e-8, atol=1e-8)


def held(modes: np.ndarray, time: float) -> np.ndarray:
    """Flow of the pair over a time, x1' = v1, v1' = -(x1 - x2) and so on; what rests stays."""
    a = np.zeros((4, 4))
    a[0, 2] = a[1, 3] = 1.0
    a[2, :2], a[3, :2] = [-1.0, 1.0], [1.0, -1.0]
    a[2:][modes == 0] = 0.0
    return expm(a * time)


@pytest.mark.parametrize("power", [2, 3])
def test_a_gain_that_grows_from_where_a_tube_is_left(power: int, route: Any):
    """x' = 1, k' = c max(x - r, 0)^n: until x = r all derivatives of k are 0, then none is."""
    x, k, r, c = (ca.SX.sym(name) for name in ("x", "k", "r", "c"))
    signals = [Signal("x", x, value=0.0), Signal("gain", k, value=0.0)]
    radius, growth = 0.108, 1e4
    numbers = [Signal("radius", r, value=radius), Signal("growth", c, value=growth)]
    model = Model("tube", signals, ca.vertcat(1, c * ca.fmax(x - r, 0) ** power), p=numbers)
    motion = simulate(model, 1.0, sensitivities=["radius", "growth"], route=route)
    left = 1 - radius
    expected = [-growth * left**power, left ** (power + 1) / (power + 1)]
    np.testing.assert_allclose(motion.end_derivative[1], expected, rtol=1e-9)
    assert motion.n_steps < 200


def test_what_is_0_in_theory_is_rounding_and_costs_no_steps(route: Any):
    """A link without ground moves as a whole under a uniform load: no spring is stretched."""
    worm = chain(
        1, mass=1.0, stiffness=10.0, damping=0.5, rest_length=1.0, load=0.3, position=[1.0, 0.0]
    )
    motion = simulate(worm, 10.0, sensitivities=["stiffness", "damping", "mass[0]"], route=route)
    np.testing.assert_allclose(motion.end_derivative[:, :2], 0.0, atol=1e-12)
    assert motion.n_steps < 300


# -- invariants ------------------------------------------------------------------------------


def throw(links: int = 2) -> Model:
    """A chain thrown apart: it slides, sticks and comes to rest; time itself does not push."""
    speeds = [1.5, -0.4, 0.7][: links + 1]
    places = [5.3, 2.4, 0.0][: links + 1]
    return chain(
        links, mass=1.0, stiffness=8.0, damping=0.3, rest_length=2.0, position=places,
        velocity=speeds, law=Coulomb(0.6, 1.1, 0.8, 1.3),
    )  # fmt: skip


def test_a_start_that_is_later_gives_the_same_motion_later(route: Any):
    """S f(x0) = f(x(t)) where nothing depends on time, and every event comes earlier by that."""
    model, t = throw(), np.linspace(0.0, 4.0, 41)
    plain = simulate(model, 4.0, times=t)
    system, s = plain.system, plain.modes_at(t)
    slope = np.array(system.rhs(t[None], plain.states, plain.p, s))
    n = len(plain.states) // 2
    later = {"later": {"position": slope[:n, 0], "velocity": slope[n:, 0]}}
    motion = simulate(model, 4.0, times=t, sensitivities=later, route=route)
    assert len(motion.events) > 6
    np.testing.assert_allclose(motion.state_derivatives[:, 0], slope, atol=1e-9)
    for event in motion.events:
        assert event.derivative == pytest.approx(-1.0, abs=1e-9)


def test_directions_add_up_and_the_motion_is_the_one_without_them():
    model = throw()
    units = simulate(model, 4.0, sensitivities=["friction_forward", "stiffness"])
    mixed = simulate(
        model,
        4.0,
        sensitivities={
            "tied": {"friction_forward": 1.0},
            "mixed": {"friction_forward": [0.0, -2.0, 0.0], "stiffness": [0.5, 0.0]},
        },
    )
    assert mixed.directions == ("tied", "mixed")
    d = units.end_derivative
    np.testing.assert_allclose(mixed.end_derivative[:, 0], d[:, :3].sum(axis=1), atol=1e-9)
    expected = -2 * d[:, 1] + 0.5 * d[:, 3]
    np.testing.assert_allclose(mixed.end_derivative[:, 1], expected, atol=1e-9)
    plain = simulate(model, 4.0)
    np.testing.assert_allclose(units.end, plain.end, atol=1e-11)
    assert [(e.name, e.kind) for e in units.events] == [(e.name, e.kind) for e in plain.events]
    assert plain.directions == plain.nonsmooth_events == ()
    assert plain.events[0].derivative is None


# -- differences -----------------------------------------------------------------------------


def sine_worm() -> tuple[Model, Reference]:
    """Worm and reference of the scene track_sine."""
    worm = chain(
        2, mass=1.0, stiffness=10.0, damping=5.0, rest_length=2.0,
        law=Coulomb(1.0, 10.0), position=[4.0, 2.0, 0.0],
    )  # fmt: skip
    wave = travelling_sine(2, 1.0, rest_length=2.0, amplitude=0.3, lag=1 / 3)
    return worm, gait_reference(wave, worm.t)


@pytest.mark.slow
@pytest.mark.parametrize("feedback", ["filter", "derivative"])
def test_trackers_with_switches_agree_with_differences(feedback: Any):
    """The trackers of the scene track_sine; crossings of the tube are events."""
    model = lambda_tracker(
        *sine_worm(), tube_radius=0.2, feedback=feedback, filter_start=0.0,
        adaptation=Quadratic(growth=1e4), watch=True,
    )  # fmt: skip
    labels = ["mass[0]", "friction_forward[1]", "stiffness[1]", "tube_radius", "gain_growth"]
    motion = simulate(model, 10.0, sensitivities=labels)
    assert {event.kind for event in motion.events} >= {"switch", "stick", "release"}
    for k, label in enumerate(labels):
        d = motion.end_derivative[:, k]
        by = differences(model, 10.0, label, 1.0 if label == "gain_growth" else 1e-5)
        assert np.abs(d - by).max() < 1e-6 * np.abs(d).max(), label


@pytest.mark.slow
def test_gains_that_jump_agree_with_differences():
    """Switches whose resets jump, at times that move."""
    model = switching_tracker(
        *sine_worm(), tube_radius=0.05, settling=0.6, overshoot=0.3, factor=2.0
    )
    labels = ["mass[0]", "friction_forward[1]", "stiffness[1]", "tube_radius", "velocity[0]"]
    motion = simulate(model, 5.0, sensitivities=labels)
    assert sum(event.kind == "switch" for event in motion.events) > 1
    for k, label in enumerate(labels[:4]):
        d = motion.end_derivative[:, k]
        by = differences(model, 5.0, label, 1e-3 if label == "stiffness[1]" else 2e-5)
        assert np.abs(d - by).max() < 1e-6 * np.abs(d).max(), label


@pytest.mark.parametrize(("jump", "told"), [(1.0, 1), (1.5, 0), (0.5, 0)])
def test_a_guard_that_lands_at_0_is_told(jump: float, told: int, route: Any):
    """At x = 1 y jumps by `jump` from -1; where y > 0, z jumps: a small change of y does it."""
    x, y, z, by = (ca.SX.sym(name) for name in ("x", "y", "z", "by"))
    model = Model(
        "landing",
        [Signal("x", x, value=0.0), Signal("y", y, value=-1.0), Signal("z", z, value=0.0)],
        ca.SX([1.0, 0.0, 0.0]),
        p=[Signal("by", by, value=jump)],
        switches=[
            Switch("first", x - 1, ca.vertcat(x, y + by, z)),
            Switch("again", x - 1, ca.vertcat(x, y, z)),
            Switch("second", y, ca.vertcat(x, y, z + 1)),
        ],
    )
    motion = simulate(model, 2.0, sensitivities=["by"], route=route)
    assert [(d.event.name, d.reason) for d in motion.nonsmooth_events] == [
        ("second", "edge")
    ] * told
    assert simulate(model, 2.0, sensitivities=["x"], route=route).nonsmooth_events == ()


@pytest.mark.parametrize(("pull", "told"), [(2.0, 1), (-2.0, 1), (1.0, 0)])
def test_a_start_held_by_stiction_alone_is_told(pull: float, told: int, route: Any):
    """Friction 1.5, stiction 3: under a pull of 2 the slightest push sets the mass going."""
    model = block(pull, speed=0.0)
    motion = simulate(model, 2.0, sensitivities=["velocity"], route=route)
    assert [d.reason for d in motion.nonsmooth_events] == ["edge"] * told
    assert motion.end.tolist() == [0.0, 0.0]
    assert simulate(model, 2.0, sensitivities=["load"], route=route).nonsmooth_events == ()
    pushed = simulate(model, 2.0, x0={"velocity": math.copysign(1e-8, pull)})
    assert (abs(pushed.end[1]) > 0.1) == bool(told)


def test_a_push_at_what_rests_on_a_sledge_is_shared_with_it(route: Any):
    """Masses 1 and 3, without a jump of velocity: momentum says how both move."""
    v, f = ca.SX.sym("v", 2), ca.SX.sym("f")
    ground = [Contact("block", v[0] - v[1], f, Coulomb(1.0, 1.0))]
    states = [Signal("velocity", v, value=[2.0, 2.0])]
    model = Model("sledge", states, ca.vertcat(f, -f / 3), contacts=ground)
    motion = simulate(model, 2.0, sensitivities=["velocity"], route=route)
    assert not motion.events
    np.testing.assert_allclose(motion.end_derivative, [[0.25, 0.75]] * 2, rtol=1e-12)


def test_a_root_at_0_has_no_derivative_and_says_so(route: Any):
    """y' = sqrt(x) while x falls to 0 and beyond: the slope is infinite there."""
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    ode = ca.vertcat(-1, ca.sqrt(ca.fmax(x, 1e-40)))
    model = Model("root", [Signal("x", x, value=1.0), Signal("y", y, value=0.0)], ode)
    with pytest.raises(SolveError) as refused:
        simulate(model, 3.0, sensitivities=["x"], route=route, tolerance=Tolerance(max_steps=20000))
    assert refused.value.code == "steep_derivatives"
    assert refused.value.partial.end_time == pytest.approx(1.0, abs=1e-6)


@pytest.mark.slow
@settings(max_examples=examples(12))
@given(st.integers(1, 3), st.integers(0, 2**32 - 1))
def test_random_chains_agree_with_differences_of_another_integrator(links: int, seed: int):
    rng = np.random.default_rng(seed)
    n, end = links + 1, 2.5
    low = {"mass": 0.5, "stiffness": 5.0, "damping": 0.3, "rest_length": 1.0, "drag": 0.0}
    size = {name: n if name in ("mass", "drag") else links for name in low}
    numbers: dict[str, Any] = {
        name: rng.uniform(low[name] + 0.1, 2 * low[name] + 0.5, size[name]) for name in low
    }
    grip = {"friction_forward": rng.uniform(0.5, 1.0, n), "friction_backward": rng.uniform(1, 3, n)}
    excess, phases = 1.3, rng.uniform(0, 2 * np.pi, links)
    x0 = {"position": np.arange(n)[::-1] * 1.5, "velocity": rng.uniform(-1, 1, n)}
    along = {name: rng.normal(size=len(v)) for name, v in (numbers | grip | x0).items()}

    def other(step: float) -> tuple[np.ndarray, int]:
        at = {k: v + step * along[k] for k, v in (numbers | grip | x0).items()}
        ground = [
            coulomb(f, b, excess)
            for f, b in zip(at["friction_forward"], at["friction_backward"], strict=True)
        ]
        run = Followed(
            {name: at[name] for name in numbers},
            ground,
            lambda t: (np.zeros(links), np.zeros(links)),
            lambda t, *_: (4 * np.sin(5 * t - phases), np.zeros(0)),
        )
        return run.run(np.concatenate([at["position"], at["velocity"]]), end), run.count

    law = Coulomb(1.0, 2.0, excess, 2 * excess)
    worm = chain(links, **numbers, law=[law] * n, position=x0["position"])
    worm = shaken(worm, 4 * ca.sin(5 * worm.t - ca.DM(phases)))

    def with_stiction(grip: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        more = {f"friction_stick_{w}": excess * grip[f"friction_{w}"] for w in WAYS}
        return {**grip, **more}

    values, tied = with_stiction(grip), with_stiction(along)
    motion = simulate(worm, end, x0=x0, p=values, sensitivities={"all": tied})
    assume(motion.nonsmooth_events == ())
    runs = [other(step) for step in (1e-4, -1e-4, 2e-4, -2e-4)]
    assume(len({count for _, count in runs}) == 1)
    near, far = (runs[0][0] - runs[1][0]) / 2e-4, (runs[2][0] - runs[3][0]) / 4e-4
    by = (4 * near - far) / 3
    # a rest of 1e-4 ends in a turn beside it: as many events, and no derivative by differences
    assume(np.abs(near - far).max() < 1e-3 * np.abs(by).max())
    assert np.abs(motion.end_derivative[:, 0] - by).max() < 1e-6 * np.abs(by).max()


@pytest.mark.compiled
def test_contacts_that_act_on_each_other_agree_with_differences():
    """Two runners joined by inertia: the force on one accelerates the other."""
    t, x, v = ca.SX.sym("t"), ca.SX.sym("x", 2), ca.SX.sym("v", 2)
    f, m = ca.SX.sym("f", 2), ca.SX.sym("m")
    inertia = ca.vertcat(ca.horzcat(2 + m, m), ca.horzcat(m, 1 + m))
    pull = 3 * ca.vertcat(ca.sin(2 * t), ca.cos(3 * t)) - 2 * x
    states = [Signal("position", x, value=0.0), Signal("velocity", v, value=[1.0, -0.5])]
    ode = ca.vertcat(v, ca.solve(inertia, f + pull))
    contacts = [Contact(f"runner {i}", v[i], f[i], Coulomb(0.7, 1.1, 0.9, 1.5)) for i in (0, 1)]
    model = Model("joined", states, ode, t=t, p=[Signal("shared", m, value=0.4)], contacts=contacts)
    labels = ["shared", "velocity[1]", "position[0]"]
    found = [
        simulate(model, 6.0, times=[0.0, 6.0], sensitivities=labels, route=r)
        for r in ("native", "python")
    ]
    assert found[0].system.coupled
    assert {e.kind for e in found[0].events} >= {"stick", "release"}
    assert_same(*found)
    for k, label in enumerate(labels):
        d = found[0].end_derivative[:, k]
        by = differences(model, 6.0, label, 1e-4)
        assert np.abs(d - by).max() < 1e-6 * np.abs(d).max(), label


# -- two routes ------------------------------------------------------------------------------


def assert_same(one: Trajectory, other: Trajectory) -> None:
    size = np.abs(one.end_derivative).max()
    assert np.abs(one.state_derivatives - other.state_derivatives).max() < 1e-10 * size
    assert np.abs(one.end_derivative - other.end_derivative).max() < 1e-10 * size
    assert [(d.event.name, d.reason) for d in one.nonsmooth_events] == [
        (d.event.name, d.reason) for d in other.nonsmooth_events
    ]
    for a, b in zip(one.events, other.events, strict=True):
        assert a.derivative == pytest.approx(b.derivative, rel=1e-7, abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("feedback", ["filter", "derivative"])
def test_compiled_and_python_agree(feedback: Any):
    model, t = track(feedback), np.linspace(0.0, 3.0, 31)
    labels = ["mass", "gain", "reference[1, 3]"]
    found = [
        simulate(model, 3.0, sensitivities=labels, times=t, dense=True, route=r)
        for r in ("native", "python")
    ]
    assert_same(*found)
    again = found[0].at(t).derivative("velocity")
    np.testing.assert_allclose(again, found[0].derivative("velocity"), atol=1e-11)
    first, *_ = model.schedules
    assert simulate(model, 3.0, sensitivities=["reference"]).directions[-1] == "reference[2, 6]"
    assert first.name == "reference"


@pytest.mark.slow
def test_implicit_integrators_agree_with_explicit_steps():
    model, t = track("filter"), np.linspace(0.0, 1.5, 6)
    options = {
        "contact": Smooth(), "sensitivities": ["mass", "gain", "reference[1, 3]"], "times": t,
    }  # fmt: skip
    motion = simulate(model, 1.5, **options)
    size = np.abs(motion.state_derivatives).max(axis=(0, 2), keepdims=True)
    looser = {**options, "tolerance": Tolerance(1e-9, 1e-10)}
    other = simulate(model, 1.5, route="cvodes", **looser)
    assert other.route == "cvodes"
    assert np.abs((other.state_derivatives - motion.state_derivatives) / size).max() < 1e-6
    told = {"x0": None, "p": None, "schedules": None, "dense": False, "times": t}
    less = {"tolerance": Tolerance(1e-8, 1e-9), "sensitivities": options["sensitivities"]}
    task = task_of(model, 1.5, Smooth(), **told, **less)
    stiff = trajectory_of(task, in_python(task, lambda *_: None, stiff=True))
    assert np.abs((stiff.state_derivatives - motion.state_derivatives) / size).max() < 1e-6


def test_algebraic_equations_have_derivatives_too():
    """x' = z with z^3 = -a x: x^(2/3) falls by 2/3 a^(1/3) t."""
    x, z, a = ca.SX.sym("x"), ca.SX.sym("z"), ca.SX.sym("a")
    model = Model(
        "root", [Signal("x", x, value=1.0)], z, z=[Signal("z", z, value=-1.0)],
        alg=z**3 + a * x, p=[Signal("a", a, value=1.0)],
    )  # fmt: skip
    motion = simulate(model, 0.5, sensitivities=["x", "a"])
    u = 1 - 1 / 3  # x = u^(3/2) with u = x0^(2/3) - 2/3 a^(1/3) t
    expected = [1.5 * u**0.5 * 2 / 3, -1.5 * u**0.5 * 2 / 9 * 0.5]
    np.testing.assert_allclose(motion.end_derivative[0], expected, rtol=1e-8)


def test_values_of_schedules_move_the_motion_while_they_hold(route: Any):
    """x' = c x s, c of pieces, s the time since its own began; a third is never reached."""
    x, c, begin = ca.SX.sym("x"), ca.SX.sym("c"), ca.SX.sym("begin")
    rate = Schedule("rate", c, begin, np.arange(4.0), np.array([[0.3], [-0.2], [9.0]]))
    t = ca.SX.sym("t")
    model = Model("grows", [Signal("x", x, value=2.0)], c * x * (t - begin), t=t, schedules=[rate])
    times = np.array([0.5, 1.0, 1.5])
    motion = simulate(model, 1.5, sensitivities=["rate"], times=times, route=route)
    assert motion.directions == ("rate[0, 0]", "rate[1, 0]", "rate[2, 0]")
    spent = np.array([[1.0, 4.0, 4.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]]) / 8
    states = 2 * np.exp([0.3, -0.2, 9.0] @ spent)
    np.testing.assert_allclose(motion.derivative("x")[0], states * spent, rtol=1e-11, atol=1e-13)


@pytest.mark.compiled
def test_a_terminal_switch_moves_the_end():
    """Decay until x = 1: the end is there whatever the start, its time log(x0) / rate."""
    x, rate = ca.SX.sym("x"), ca.SX.sym("rate")
    stop = Switch("low", 1 - x, x, terminal=True)
    model = Model(
        "decay", [Signal("x", x, value=3.0)], -rate * x,
        p=[Signal("rate", rate, value=2.0)], switches=[stop],
    )  # fmt: skip
    for route in ("native", "python"):
        motion = simulate(model, 9.0, sensitivities=["x", "rate"], route=route)
        np.testing.assert_allclose(motion.end_derivative, 0.0, atol=1e-11)
        expected = [1 / 6, -math.log(3) / 4]
        np.testing.assert_allclose(changes(motion.events[-1]), expected, rtol=1e-11)


def test_ensembles_have_the_derivatives_of_their_members():
    members = [Scenario(x0={"velocity": v}) for v in (1.0, 2.0)]
    times = np.linspace(0.0, 8.0, 5)
    herd = simulate_ensemble(block(), 8.0, members, times=times, sensitivities=["velocity"])
    ways = herd.derivative("position")
    assert ways.shape == (2, 1, 1, 5)
    np.testing.assert_allclose(ways[:, 0, 0, -1], [2.0, 4.0], rtol=1e-12)  # m v / F
