"""All routes give the same motion: compiled steps, the same steps in Python, CVODES and IDAS."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from effort import examples
from hypothesis import given, settings
from hypothesis import strategies as st

from wormopt.control.lambda_tracker import lambda_tracker
from wormopt.control.reference import gait_reference
from wormopt.errors import SolveError
from wormopt.model.friction import Coulomb, Law, Spike, Stribeck, Viscous
from wormopt.model.model import Contact, Model, Signal, Switch
from wormopt.model.schedule import Schedule
from wormopt.simulation import routes
from wormopt.simulation.initial_value import InitialValueProblem, Outcome
from wormopt.simulation.native import build, kernel, model_code
from wormopt.simulation.native.build import CompilerError
from wormopt.simulation.options import Exact, Route, Smooth, Tolerance, Treatment
from wormopt.simulation.simulate import simulate
from wormopt.simulation.trajectory import Trajectory
from wormopt.systems.chain.build import chain
from wormopt.systems.spiked.construct import fast_gait

SHARP = Tolerance(1e-12, 1e-13)
DEFAULT = Tolerance()
STEPPING: list[Route] = ["native", "python"]
ALL: list[Route] = ["native", "python", "cvodes"]

# docs/verification.md, trackers: x, v, gain (and the filter) at t = 10
TRACK = {
    "filter": [
        *(13.7293026425339, 12.5129899383629, 11.2234323017047),
        *(1.5442046082437, 1.2147444914821, 0.6496895012235),
        *(17.0537482219161, -0.7848014274676, -0.7122939752036),
    ],
    "derivative": [
        *(13.9905483956915, 12.7643770141827, 11.4656131519066),
        *(1.5265682540374, 1.2068425686835, 0.6714590289857),
        17.4065002539140,
    ],
}
# docs/verification.md, pair
MAG2 = [68.6821179593, 69.1082146640, -0.1937052220, 0.7347495453]
MAG2_STICKS = [
    ("mass 0", 1.302637, 1.309360),
    ("mass 1", 2.795280, 3.270012),
    ("mass 0", 5.092701, 5.351588),
    ("mass 1", 7.344490, 7.451483),
    ("mass 0", 9.562752, 9.563212),
]


def tracked(feedback: str, rest: float = 0.0, **options: float | bool) -> Model:
    """The chapter's worm under a tracker; with rest = 2 it starts near its reference."""
    start = (0.0, 2.0, 4.0) if rest == 0 else (4.0, 2.0, 0.0)
    worm = chain(
        2, mass=1.0, stiffness=10.0, damping=5.0, rest_length=rest, law=Coulomb(1.0, 10.0),
        position=start,
    )  # fmt: skip
    reference = gait_reference(fast_gait(1.0, 2.0, 0.15), time=worm.t)
    return lambda_tracker(worm, reference, tube_radius=0.2, feedback=feedback, **options)  # type: ignore[arg-type]


def magnetic_pair() -> Model:
    """(16) with the numbers of MAG2."""
    t, x, v, f = (ca.SX.sym(name, n) for name, n in (("t", 1), ("x", 2), ("v", 2), ("f", 2)))
    eps = 0.036
    drive = eps * (1 + ca.cos((np.sqrt(2) + 0.5 * eps) * t))
    pull = x[1] - x[0]
    law = Coulomb(0.5 * eps, 1.0 * eps)
    return Model(
        "pair",
        x=[Signal("position", x, value=0.0), Signal("velocity", v, value=0.0)],
        ode=ca.vertcat(v, pull - drive + f[0], -pull + drive + f[1]),
        t=t,
        contacts=[Contact(f"mass {i}", v[i], f[i], law) for i in range(2)],
    )


def shaken(worm: Model, force: ca.SX) -> Model:
    """A chain under given actuator forces, expressions of time."""
    ode = ca.substitute(worm.ode, worm.u[0].symbol, force)
    return replace(worm, ode=ode, u=(), outputs=())


def sine_worm(law: Law | list[Law], size: float = 6.0) -> Model:
    worm = chain(2, mass=1.0, stiffness=10.0, damping=5.0, rest_length=2.0, law=law)
    return shaken(worm, size * ca.sin(2 * np.pi * worm.t / 3 - ca.DM([0.0, 2.0])))


def listed(motion: Trajectory) -> list[tuple[str, str, int]]:
    return [(event.name, event.kind, event.mode) for event in motion.events]


def event_times(motion: Trajectory) -> np.ndarray:
    return np.array([event.time for event in motion.events])


def attempted(
    model: Model, span: float | tuple[float, float], **options: Any
) -> tuple[Trajectory, str]:
    """A motion as far as it goes, and why it ends early if it does."""
    try:
        return simulate(model, span, **options), ""
    except SolveError as error:
        return error.partial, error.code


def assert_same(a: Trajectory, b: Trajectory, within: float) -> None:
    """Same events at the same times, same samples, same modes."""
    assert listed(a) == listed(b)
    assert event_times(a) == pytest.approx(event_times(b), abs=within)
    assert a.modes[:, 1:].tolist() == b.modes[:, 1:].tolist()
    if np.array_equal(a.time, b.time):  # else they are the ends of steps
        assert a.states == pytest.approx(b.states, abs=within)
    assert a.end == pytest.approx(b.end, abs=within)


def assert_lawful(motion: Trajectory) -> None:
    """At the samples no contact slides against its mode, and what rests is held by its law."""
    modes = motion.modes_at(motion.time)
    for contact, mode in zip(motion.system.contacts, modes, strict=True):
        velocity, force, low, high = motion.observe(
            ca.vertcat(contact.velocity, contact.force, *contact.law.stick_interval)
        )
        rests = mode == 0
        assert np.all(mode * velocity >= -1e-9)
        assert np.all(np.abs(velocity[rests]) < 1e-9)
        assert np.all((force[rests] >= low[rests] - 1e-8) & (force[rests] <= high[rests] + 1e-8))


@pytest.fixture
def no_compiler(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Hide the compiler and forget what it has made."""
    caches = (kernel.driver, model_code._library, kernel.compiled)
    monkeypatch.setattr(build, "compiler", lambda: None)
    for cache in caches:
        cache.cache_clear()
    yield
    for cache in caches:
        cache.cache_clear()


# -- benchmarks ------------------------------------------------------------------------------


@pytest.mark.parametrize("route", ALL)
@pytest.mark.parametrize("feedback", TRACK)
def test_tracked_worms_arrive_where_the_benchmark_says(feedback: str, route: Route):
    tolerance = SHARP if route != "cvodes" else DEFAULT
    motion = simulate(tracked(feedback), 10.0, contact=Smooth(), tolerance=tolerance, route=route)
    assert motion.route == route
    # at the looser tolerance rounding decides steps of CVODES, and their errors with them
    accepted = 1e-9 if route != "cvodes" else 1e-8
    assert motion.end == pytest.approx(TRACK[feedback], abs=accepted)


@pytest.mark.parametrize("route", STEPPING)
def test_the_magnetic_pair_has_the_events_of_the_benchmark(route: Route):
    motion = simulate(magnetic_pair(), 400.0, tolerance=SHARP, route=route)
    assert len(motion.events) == 369
    sticks = [event for event in motion.events if event.kind == "stick"]
    releases = [event for event in motion.events if event.kind == "release"]
    found = [(a.name, a.time, b.time) for a, b in zip(sticks, releases, strict=True)]
    for (name, start, end), (expected, *times) in zip(found, MAG2_STICKS, strict=True):
        assert name == expected
        assert [start, end] == pytest.approx(times, abs=6e-7)
    assert motion.end == pytest.approx(MAG2, abs=1e-9)


def test_both_stepping_routes_take_the_same_steps():
    a, b = (simulate(magnetic_pair(), 100.0, route=route, dense=True) for route in STEPPING)
    assert_same(a, b, within=1e-11)
    assert a.n_steps == b.n_steps
    assert a.n_rejected == b.n_rejected
    t = np.linspace(0, 100, 4001)
    assert a.at(t).states == pytest.approx(b.at(t).states, abs=1e-11)


# -- schedules, spikes, smooth layers --------------------------------------------------------


def saw(start: float = 0.1) -> Model:
    """x' = c + (t - begin) + d with a periodic c and a d of three pieces."""
    x, t = ca.SX.sym("x"), ca.SX.sym("t")
    c, c_begin, d, d_begin = (ca.SX.sym(name) for name in ("c", "c_begin", "d", "d_begin"))
    schedules = [
        Schedule(
            "c", c, c_begin, np.array([0.0, 0.3, 1.0]), np.array([[2.0], [-1.0]]), True, start
        ),
        Schedule("d", d, d_begin, np.array([0.0, 1.0, 4.0, 9.0]), np.array([[0.5], [1.5], [-0.5]])),
    ]
    ode = c + (t - c_begin) + d
    return Model("saw", x=[Signal("x", x, value=0.0)], ode=ode, t=t, schedules=schedules)


@pytest.mark.parametrize("route", ALL)
@pytest.mark.parametrize("start", [0.1, 0.0, -2.6])
def test_schedules_are_followed_to_the_instant(route: Route, start: float):
    t = np.array([0.0, 0.4, 0.4, 1.0, 1.0 + 0.1, 3.7, 9.9, 10.1])
    motion = simulate(saw(start), 10.1, times=t, route=route)
    fine = np.linspace(0, 10.1, 1_010_001)
    middle = (fine[1:] + fine[:-1]) / 2
    phase = (middle - start) % 1.0
    slope = np.where(phase < 0.3, 2.0 + phase, -1.0 + phase - 0.3)
    slope += np.select([middle < 1, middle < 4], [0.5, 1.5], -0.5)
    x = np.concatenate([[0.0], np.cumsum(slope) * 1e-5])
    assert motion.states[0] == pytest.approx(x[np.round(t * 1e5).astype(int)], abs=1e-8)


def test_other_values_of_a_schedule_need_no_other_model():
    other = {"d": np.array([[0.0], [3.0], [0.0]])}
    ends = [simulate(saw(), 10.1, schedules=other, route=route).end for route in ALL]
    assert ends[1] == pytest.approx(ends[0], abs=1e-11)
    assert ends[2] == pytest.approx(ends[0], abs=1e-8)


def test_spikes_hit_the_ground_alike():
    worm = chain(
        2, mass=[1, 2, 1], stiffness=10.0, damping=1.0, rest_length=2.0, law=Spike(),
        velocity=[-1.0, 0.5, 2.0],
    )  # fmt: skip
    model = shaken(worm, 3 * ca.sin(4 * worm.t + ca.DM([0.0, 1.0])))
    a, b = (simulate(model, 20.0, tolerance=SHARP, route=route) for route in STEPPING)
    assert {"stick", "release"} <= {event.kind for event in a.events}
    assert len(a.events) > 20
    assert_same(a, b, within=1e-10)


def test_contacts_that_act_on_each_other_decide_alike():
    """Two feet on one rigid rod, velocities v + w and v - w: to hold one changes the other."""
    v, w, f, t = ca.SX.sym("v"), ca.SX.sym("w"), ca.SX.sym("f", 2), ca.SX.sym("t")
    states = [Signal("v", v, value=0.0), Signal("w", w, value=0.5)]
    ode = ca.vertcat(f[0] + f[1] + 1.5 * ca.sin(2 * t), 3 * (f[0] - f[1]) + 2 * ca.cos(3.1 * t))
    feet = [Contact("left", v + w, f[0], Spike()), Contact("right", v - w, f[1], Coulomb(0.5, 1.0))]
    model = Model("rod", x=states, ode=ode, t=t, contacts=feet)
    t = np.linspace(0, 20, 2001)
    a, b = (simulate(model, 20.0, times=t, tolerance=SHARP, route=route) for route in STEPPING)
    assert len(a.events) >= 10
    assert_same(a, b, within=1e-11)
    assert_lawful(a)


@pytest.mark.parametrize("route", STEPPING)
def test_a_velocity_that_is_no_state_drifts_at_rest_without_harm(route: Route):
    """Velocities v (1.5 + cos x) stay zero at rest up to the errors of the steps only."""
    x, v, f, t = (ca.SX.sym(name) for name in ("x", "v", "f", "t"))
    y, w = ca.SX.sym("y"), ca.SX.sym("w")
    skew = 1.5 + ca.cos(x) + 0.5 * ca.sin(y)
    model = Model(
        "cam",
        x=[Signal(n, s, value=0.0) for n, s in (("x", x), ("v", v), ("y", y), ("w", w))],
        ode=ca.vertcat(v, skew * f + 3 * ca.sin(t), w, ca.cos(1.7 * t) - y - 0.4 * f),
        t=t,
        contacts=[Contact("tip", skew * v - 0.4 * w, f, Coulomb(0.4, 0.8))],
    )
    sharp = simulate(model, 30.0, tolerance=SHARP, route="python")
    assert {"stick", "release"} <= {event.kind for event in sharp.events}
    for relative in (1e-6, 1e-8, 1e-11):
        tolerance = Tolerance(relative, 0.1 * relative)
        assert_same(simulate(model, 30.0, tolerance=tolerance, route=route), sharp, 1e3 * relative)


@pytest.mark.parametrize("v_reg", [1e-2, 1e-3])
def test_steep_smooth_laws_are_resolved_alike(v_reg: float):
    model = sine_worm(Coulomb(1.0, 10.0))
    motions = [simulate(model, 10.0, contact=Smooth(v_reg), route=route) for route in ALL]
    assert motions[1].end == pytest.approx(motions[0].end, abs=1e-9)
    assert motions[2].end == pytest.approx(motions[0].end, abs=1e-8)


@pytest.mark.parametrize("v_reg", [1e-5, 1e-6, 1e-7])
@pytest.mark.parametrize("relative", [1e-4, 1e-7, 1e-11])
def test_cvodes_is_right_or_refuses(v_reg: float, relative: float):
    """The smooth motion differs from the exact one by some 10 v_reg."""
    model = sine_worm(Coulomb(1.0, 10.0))
    exact = simulate(model, 10.0, tolerance=SHARP, route="native")
    tolerance = Tolerance(relative, 0.1 * relative)
    motion, code = attempted(
        model, 10.0, contact=Smooth(v_reg), tolerance=tolerance, route="cvodes"
    )
    if code:
        assert code == "layer_not_resolved"
        assert v_reg < 1e-6
        assert motion.end_time < 10.0
    else:
        assert motion.end == pytest.approx(exact.end, abs=20 * v_reg)


# -- switches --------------------------------------------------------------------------------


def circle(guard: str) -> Model:
    """A point on a circle that counts how often a guard rises through 0."""
    t, y, count = ca.SX.sym("t"), ca.SX.sym("y", 2), ca.SX.sym("count")
    rises = {"sin t": ca.sin(t), "-cos t": -ca.cos(t), "y": y[0]}[guard]
    return Model(
        "circle",
        x=[Signal("y", y, value=(0.0, 1.0)), Signal("count", count, value=0.0)],
        ode=ca.vertcat(y[1], -y[0], 0),
        t=t,
        switches=[Switch("counts", rises, ca.vertcat(y, count + 1))],
    )


@pytest.mark.parametrize("route", STEPPING)
@pytest.mark.parametrize(("guard", "first"), [("sin t", 0.0), ("-cos t", np.pi / 2), ("y", 0.0)])
@pytest.mark.parametrize("relative", [1e-6, 1e-8, 1e-10, 1e-12])
def test_a_guard_that_goes_on_rising_fires_once_a_turn(
    route: Route, guard: str, first: float, relative: float
):
    tolerance = Tolerance(relative, 0.1 * relative)
    motion = simulate(circle(guard), 100.0, contact=Smooth(), tolerance=tolerance, route=route)
    times = first + 2 * np.pi * np.arange(16)
    assert event_times(motion) == pytest.approx(times, abs=1e3 * relative + 1e-12)
    assert motion.end[2] == 16


@pytest.mark.parametrize("route", STEPPING)
def test_a_level_crossed_up_and_down_is_seen_each_time(route: Route):
    y = ca.SX.sym("y", 2)
    crossings = [Switch("up", y[0] - 0.3, y), Switch("down", 0.3 - y[0], y)]
    states = [Signal("y", y, value=(0.0, 1.0))]
    model = Model("circle", x=states, ode=ca.vertcat(y[1], -y[0]), switches=crossings)
    motion = simulate(model, 100.0, tolerance=SHARP, route=route)
    turns = 2 * np.pi * np.arange(17)
    ups, downs = turns + np.arcsin(0.3), turns + np.pi - np.arcsin(0.3)
    for name, times in (("up", ups), ("down", downs)):
        found = [event.time for event in motion.events if event.name == name]
        assert found == pytest.approx(times[times < 100.0], abs=1e-10)


@pytest.mark.parametrize("route", STEPPING)
@pytest.mark.parametrize("period", [0.1 / 7, 0.3, 1 / 3, 0.7])
def test_a_switch_may_fire_where_a_schedule_breaks(route: Route, period: float):
    w, count, c, begin = (ca.SX.sym(name) for name in ("w", "count", "c", "begin"))
    model = Model(
        "clock",
        x=[Signal("w", w, value=0.0), Signal("count", count, value=0.0)],
        ode=ca.vertcat(c, 0),
        schedules=[Schedule("c", c, begin, np.array([0.0, period]), np.ones((1, 1)), True)],
        switches=[Switch("tick", w - period, ca.vertcat(0, count + 1))],
    )
    motion = simulate(model, 10.5 * period, route=route)
    assert event_times(motion) == pytest.approx(period * np.arange(1, 11), abs=1e-13)
    assert motion.end == pytest.approx([period / 2, 10.0], abs=1e-13)


@pytest.mark.parametrize("route", STEPPING)
def test_a_jump_of_the_state_fires_other_switches(route: Route):
    """At x = 1 it jumps to -1; y, which jumps to 3 then, is put back to 0 at once."""
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    model = Model(
        "jumps",
        x=[Signal("x", x, value=0.0), Signal("y", y, value=0.0)],
        ode=ca.SX([1, 0]),
        switches=[
            Switch("first", x - 1, ca.SX([-1, 3])),
            Switch("second", y - 2, ca.vertcat(x, 0)),
        ],
    )
    motion = simulate(model, 6.0, route=route)
    assert [event.name for event in motion.events] == ["first", "second"] * 3
    assert event_times(motion) == pytest.approx([1, 1, 3, 3, 5, 5], abs=1e-12)
    assert motion.end == pytest.approx([0.0, 0.0], abs=1e-12)


@pytest.mark.parametrize("route", STEPPING)
def test_a_guard_that_begins_at_zero_and_falls_does_not_fire(route: Route):
    x = ca.SX.sym("x")
    model = Model(
        "leaves",
        x=[Signal("x", x, value=1.0)],
        ode=ca.SX(-1),
        switches=[Switch("up", x - 1, x + 5)],
    )
    motion = simulate(model, 2.0, route=route)
    assert not motion.events
    assert motion.end == pytest.approx([-1.0], abs=1e-12)


@pytest.mark.parametrize("route", STEPPING)
@pytest.mark.parametrize("levels", [(1.0, 0.99), (0.99, 1.0), (1.0, 0.4), (0.5, 0.5)])
def test_events_close_to_each_other_keep_their_order(route: Route, levels: tuple[float, float]):
    """They lie within one step, whichever switch is written first."""
    x, a, b = ca.SX.sym("x"), ca.SX.sym("a"), ca.SX.sym("b")
    model = Model(
        "clock",
        x=[Signal("x", x, value=0.0), Signal("a", a, value=0.0), Signal("b", b, value=0.0)],
        ode=ca.SX([1, 0, 0]),
        switches=[
            Switch("a", x - levels[0], ca.vertcat(x, x, b)),
            Switch("b", x - levels[1], ca.vertcat(x, a, x)),
        ],
    )
    motion = simulate(model, 20.0, route=route, tolerance=Tolerance(max_step=np.inf))
    assert event_times(motion) == pytest.approx(sorted(levels), abs=1e-12)
    assert motion.end == pytest.approx([20.0, *levels], abs=1e-12)


@pytest.mark.parametrize("route", STEPPING)
def test_a_velocity_made_to_jump_is_an_impact(route: Route):
    """Thrown backward while it slides, a spike stops, and so it does when it has rested."""
    x, v, f, t = (ca.SX.sym(name) for name in ("x", "v", "f", "t"))
    model = Model(
        "thrown",
        x=[Signal("x", x, value=0.0), Signal("v", v, value=1.0)],
        ode=ca.vertcat(v, f),
        t=t,
        contacts=[Contact("spike", v, f, Spike())],
        switches=[Switch("throw", ca.sin(t - 1), ca.vertcat(x, -1))],
    )
    motion = simulate(model, 14.0, route=route)
    throw, impact = ("throw", "switch", 0), ("spike", "impact", 0)
    assert listed(motion) == [throw, impact, throw, impact, throw, impact]
    assert motion.end == pytest.approx([1.0, 0.0], abs=1e-12)


@pytest.mark.parametrize("route", STEPPING)
def test_a_spike_that_is_hit_and_pulled_on_has_its_impact(route: Route):
    """Thrown backward while a force pulls it forward, it stops and slides on at once."""
    x, v, f, t = (ca.SX.sym(name) for name in ("x", "v", "f", "t"))
    model = Model(
        "pulled",
        x=[Signal("x", x, value=0.0), Signal("v", v, value=0.0)],
        ode=ca.vertcat(v, (0.7 * f + 1) / 3),
        t=t,
        contacts=[Contact("spike", 0.7 * v, f, Spike())],
        switches=[Switch("throw", ca.sin(t), ca.vertcat(x, -0.5 * v))],
    )
    motion = simulate(model, 14.0, x0={"v": 1.0}, route=route)
    throws = 2 * np.pi * np.arange(3)
    assert listed(motion) == [("throw", "switch", 0), ("spike", "impact", 1)] * 3
    assert event_times(motion) == pytest.approx(np.repeat(throws, 2), abs=1e-11)
    assert motion.end[1] == pytest.approx((14.0 - throws[-1]) / 3, abs=1e-10)


@pytest.mark.parametrize("route", STEPPING)
def test_a_guard_left_above_zero_must_come_back_before_it_fires_again(route: Route):
    """It is thrown from 0 to 1, falls to 7/8 and rises for ever."""
    v, w, count = ca.SX.sym("v"), ca.SX.sym("w"), ca.SX.sym("count")
    values = {"v": -0.5, "w": 1.5, "count": 0.0}
    model = Model(
        "thrown",
        x=[Signal(str(s), s, value=values[str(s)]) for s in (v, w, count)],
        ode=ca.vertcat(w - 0.5, 1, 0),
        switches=[Switch("rises", v, ca.vertcat(1, 0, count + 1))],
    )
    motion = simulate(model, 10.0, route=route)
    time = np.sqrt(2) - 1
    assert event_times(motion) == pytest.approx([time], abs=1e-12)
    assert motion.end[2] == 1
    since = 10 - time
    assert motion.end[0] == pytest.approx(1 - since / 2 + since**2 / 2, abs=1e-9)


@pytest.mark.parametrize("route", STEPPING)
def test_a_guard_that_a_jump_lifts_and_leaves_above_zero_must_come_back_too(route: Route):
    """Lifted from -5 to 0.3, it is thrown to 1/2, falls to 3/8 and rises for ever."""
    v, w, count, t = (ca.SX.sym(name) for name in ("v", "w", "count", "t"))
    values = {"v": -5.0, "w": 0.5, "count": 0.0}
    model = Model(
        "lifted",
        x=[Signal(str(s), s, value=values[str(s)]) for s in (v, w, count)],
        ode=ca.vertcat(w - 0.5, 1, 0),
        t=t,
        switches=[
            Switch("lift", t - 0.5, ca.vertcat(0.3, w, count)),
            Switch("rises", v, ca.vertcat(0.5, 0, count + 1)),
        ],
    )
    motion = simulate(model, 4.0, route=route)
    assert [event.name for event in motion.events] == ["lift", "rises"]
    assert motion.end[2] == 1
    assert motion.end[0] == pytest.approx(0.5 - 3.5 / 2 + 3.5**2 / 2, abs=1e-9)


@pytest.mark.parametrize("route", STEPPING)
@pytest.mark.parametrize("level", [0.1, 0.3, 0.7, 1.1])
def test_a_motion_stopped_at_its_guard_does_not_fire_it_again(route: Route, level: float):
    """x'' = 1; at x = level the velocity is made zero, and x goes on rising from there."""
    x, v = ca.SX.sym("x"), ca.SX.sym("v")
    states = [Signal("x", x, value=0.0), Signal("v", v, value=0.2)]
    stop = Switch("stop", x - level, ca.vertcat(x, 0))
    model = Model("stopped", x=states, ode=ca.vertcat(v, 1), switches=[stop])
    motion = simulate(model, 5.0, route=route)
    time = np.sqrt(0.04 + 2 * level) - 0.2
    assert event_times(motion) == pytest.approx([time], abs=1e-12)
    assert motion.end[1] == pytest.approx(5 - time, abs=1e-11)


@pytest.mark.parametrize("route", STEPPING)
def test_what_is_stopped_just_below_its_guard_by_rounding_does_not_fire_it_again(route: Route):
    """x'' = 1 + cos(5 t); with derivatives the place of an event is not shifted to the last bit."""
    x, v, t, level = (ca.SX.sym(name) for name in ("x", "v", "t", "level"))
    model = Model(
        "stopped",
        [Signal("x", x, value=0.0), Signal("v", v, value=0.2)],
        ca.vertcat(v, 1 + ca.cos(5 * t)),
        t=t,
        p=[Signal("level", level, value=0.0)],
        switches=[Switch("stop", x - level, ca.vertcat(x, 0))],
    )
    for place in np.linspace(0.5, 1.1, 13):
        motion = simulate(model, 3.0, p={"level": place}, route=route, sensitivities=["level"])
        (time,) = event_times(motion)
        left = np.array([3 - time, (np.sin(15) - np.sin(5 * time)) / 5])
        assert motion.end[1] == pytest.approx(left.sum(), abs=1e-9)


# -- without a compiler ----------------------------------------------------------------------


@pytest.mark.usefixtures("no_compiler")
def test_without_a_compiler_the_same_steps_are_taken_in_python():
    smooth = simulate(tracked("derivative"), 10.0, contact=Smooth())
    assert smooth.route == "python"
    assert smooth.end == pytest.approx(TRACK["derivative"], abs=1e-9)
    exact = simulate(magnetic_pair(), 20.0, tolerance=SHARP)
    assert exact.route == "python"
    assert sum(event.kind == "stick" for event in exact.events) == 5
    watched = simulate(
        tracked("derivative", 2.0, watch=True, gain_start=3.0), 2.0, contact=Smooth()
    )
    assert watched.route == "python"
    assert {"leaves the tube", "enters the tube"} <= {event.name for event in watched.events}


def stiff_decay() -> Model:
    """x follows cos t within 1e-6."""
    x, t = ca.SX.sym("x"), ca.SX.sym("t")
    return Model("stiff", x=[Signal("x", x, value=1.0)], ode=1e6 * (ca.cos(t) - x), t=t)


@pytest.mark.parametrize("compiler", [True, False])
def test_stiff_motions_go_to_cvodes(compiler: bool, request: pytest.FixtureRequest):
    if not compiler:
        request.getfixturevalue("no_compiler")
    motion = simulate(stiff_decay(), 100.0)
    assert motion.route == "cvodes"
    assert motion.end[0] == pytest.approx(np.cos(100.0), abs=1e-6)


@pytest.mark.usefixtures("no_compiler")
def test_compiled_steps_are_refused_without_a_compiler():
    with pytest.raises(CompilerError, match="no C compiler"):
        simulate(magnetic_pair(), 1.0, route="native")


def test_a_worm_in_and_out_of_its_tube_moves_alike():
    model = tracked("derivative", 2.0, watch=True, gain_start=3.0)
    t = np.linspace(0, 6, 61)
    motion = simulate(model, 6.0, contact=Smooth(), times=t, tolerance=SHARP, route="python")
    assert len(motion.events) == 12
    plain = tracked("derivative", 2.0, gain_start=3.0)
    for route in ALL:
        other = simulate(plain, 6.0, contact=Smooth(), times=t, route=route)
        assert other.states == pytest.approx(motion.states, abs=1e-8)


# -- the whole motion ------------------------------------------------------------------------


@pytest.mark.parametrize("route", STEPPING)
@pytest.mark.parametrize("contact", [Exact(), Smooth()])
def test_the_kept_motion_holds_the_samples(route: Route, contact: Treatment):
    t = np.linspace(0, 10, 237)
    model = sine_worm(Coulomb(1.0, 10.0))
    motion = simulate(model, 10.0, contact=contact, times=t, dense=True, route=route)
    assert motion.at(t).states == pytest.approx(motion.states, abs=1e-13)
    assert motion.dense is not None
    assert motion.dense.time[[0, -1]].tolist() == [0.0, 10.0]
    assert np.all(np.diff(motion.dense.time) > 0)


# -- refusals --------------------------------------------------------------------------------


def refused(model: Model, span: float, route: Route, **options: object) -> SolveError:
    with pytest.raises(SolveError) as caught:
        simulate(model, span, route=route, **options)  # type: ignore[arg-type]
    error = caught.value
    assert error.suggestion
    motion = error.partial
    assert motion.route in (route, "idas")
    assert len(motion.time) == motion.states.shape[1]
    assert np.all(motion.time <= motion.end_time)
    return error


def scalar(rate: str) -> Model:
    x = ca.SX.sym("x")
    ode = {"x^2": x**2, "-1/sqrt x": -1 / ca.sqrt(x), "x": x}[rate]
    return Model(rate, x=[Signal("x", x, value=1.0)], ode=ode)


@pytest.mark.parametrize("route", ALL)
def test_growth_beyond_bounds_keeps_what_there_is(route: Route):
    t = np.linspace(0, 2, 201)
    error = refused(scalar("x^2"), 2.0, route, times=t)
    assert error.code in ("step_too_small", "not_finite", "solver_failed")
    assert (error.code == "solver_failed") == (route == "cvodes")
    motion = error.partial
    assert 0.95 < motion.end_time < 1 + 1e-9
    assert len(motion.time) > 90
    known = motion.time < 0.9
    assert motion.states[0, known] == pytest.approx(1 / (1 - motion.time[known]), rel=1e-6)


@pytest.mark.parametrize("route", ALL)
def test_what_is_no_number_is_refused(route: Route):
    assert refused(scalar("x"), 1.0, route, x0={"x": np.nan}).code == "not_finite"
    codes = ("not_finite", "step_too_small", "solver_failed")
    assert refused(scalar("-1/sqrt x"), 1.0, route).code in codes


@pytest.mark.parametrize("route", ALL)
def test_work_without_end_is_refused(route: Route):
    y = ca.SX.sym("y", 2)
    model = Model("circle", x=[Signal("y", y, value=1.0)], ode=ca.vertcat(y[1], -y[0]))
    error = refused(model, 1e6, route, tolerance=Tolerance(max_steps=500))
    assert error.code == "too_many_steps"
    assert error.partial.end_time < 1e3


@pytest.mark.parametrize("route", STEPPING)
@pytest.mark.parametrize("most", [60, 61, 62, 63])
def test_steps_that_are_too_inexact_count_as_work(route: Route, most: int):
    """Pulses of a width that the steps between them do not know."""
    x, t = ca.SX.sym("x"), ca.SX.sym("t")
    ode = 10 * ca.exp(-100 * ca.sin(t) ** 2) - x
    model = Model("pulses", x=[Signal("x", x, value=1.0)], ode=ode, t=t)
    error = refused(model, 1e5, route, tolerance=Tolerance(max_steps=most, max_step=np.inf))
    assert error.code == "too_many_steps"
    assert error.partial.n_rejected > 10
    assert error.partial.n_steps + error.partial.n_rejected == most


@pytest.mark.parametrize("route", STEPPING)
def test_no_polynomial_is_fitted_that_nobody_asks_for(route: Route):
    """Twelve evaluations for a step, three more for a sample within it, two at the start."""
    y = ca.SX.sym("y", 2)
    model = Model("circle", x=[Signal("y", y, value=(1.0, 0.0))], ode=ca.vertcat(y[1], -y[0]))
    for times in ([50.0], [25.0, 50.0]):
        motion = simulate(model, 50.0, times=times, route=route)
        assert motion.n_rejected == 0
        assert motion.n_evaluations == 12 * motion.n_steps + 2 + 3 * (len(times) - 1)


@pytest.mark.parametrize("route", STEPPING)
def test_a_guard_that_is_no_number_is_refused(route: Route):
    x, t = ca.SX.sym("x"), ca.SX.sym("t")
    guard = Switch("root", ca.sqrt(1 - t), x)
    model = Model("root", x=[Signal("x", x, value=1.0)], ode=-x, t=t, switches=[guard])
    error = refused(model, 2.0, route)
    assert error.code == "not_finite"
    assert error.partial.end_time <= 1.0


def bouncing_ball() -> Model:
    y, v = ca.SX.sym("y"), ca.SX.sym("v")
    bounce = Switch("bounce", -y, ca.vertcat(0, -0.8 * v))
    states = [Signal("height", y, value=1.0), Signal("velocity", v, value=0.0)]
    return Model("ball", x=states, ode=ca.vertcat(v, -2.0), switches=[bounce])


@pytest.mark.parametrize("route", STEPPING)
def test_infinitely_many_bounces_are_refused(route: Route):
    error = refused(bouncing_ball(), 10.0, route)
    assert error.code == "events_accumulate"
    motion = error.partial
    assert motion.end_time == pytest.approx(9.0, abs=1e-6)
    times = np.cumsum([1.0, *(2 * 0.8**k for k in range(1, 30))])
    assert event_times(motion)[:30] == pytest.approx(times, abs=1e-9)
    assert abs(motion.end[0]) < 1e-6


@pytest.mark.parametrize("route", STEPPING)
def test_events_that_hardly_let_time_pass_are_refused(route: Route):
    """A clock that ticks every 1e-12 s, for 1 s."""
    w = ca.SX.sym("w")
    tick = Switch("tick", w - 1e-12, ca.SX(0))
    model = Model("clock", x=[Signal("w", w, value=0.0)], ode=ca.SX(1), switches=[tick])
    error = refused(model, 1.0, route, tolerance=Tolerance(max_steps=1000))
    assert error.code == "events_accumulate"
    assert error.partial.end_time < 1e-9


@pytest.mark.parametrize("route", STEPPING)
@pytest.mark.parametrize(("share", "ticks"), [(0.99, 64), (1.01, 150)])
def test_as_many_events_are_allowed_as_functions_are_watched(
    route: Route, share: float, ticks: int
):
    """32, and 16 for each: the one after them may come 1e-10 of the span after the first."""
    w, n = ca.SX.sym("w"), ca.SX.sym("n")
    tick = share * 4e-10 / 64
    clock = Model(
        "clock",
        x=[Signal("w", w, value=0.0), Signal("n", n, value=0.0)],
        ode=ca.vertcat(ca.tanh(1e3 * (150 - n)), 0),
        switches=[
            Switch("tick", w - tick, ca.vertcat(0, n + 1)),
            Switch("never", -1 - n, ca.vertcat(w, n)),
        ],
    )
    motion, code = attempted(clock, (2.0, 6.0), route=route)
    assert len(motion.events) == ticks
    assert code == ("" if ticks == 150 else "events_accumulate")


@pytest.mark.parametrize("route", STEPPING)
@pytest.mark.parametrize(("hits", "code"), [(30, ""), (31, "events_accumulate")])
def test_at_one_instant_switches_may_fire_each_other_ten_times_each(
    route: Route, hits: int, code: str
):
    """Each of two throws the ball to the other, but for the last that has it."""
    t, a, b, n = (ca.SX.sym(name) for name in ("t", "a", "b", "n"))
    over = ca.if_else(n < hits - 1, 1, -1)
    table = Model(
        "table",
        x=[Signal(name, s, value=-1.0) for name, s in (("a", a), ("b", b))]
        + [Signal("n", n, value=0.0)],
        ode=ca.SX([-1, -1, 0]),
        t=t,
        switches=[
            Switch("serve", t - 0.5, ca.SX([1, -1, 0])),
            Switch("ping", a, ca.vertcat(-1, over, n + 1)),
            Switch("pong", b, ca.vertcat(over, -1, n + 1)),
        ],
    )
    motion, found = attempted(table, 1.0, route=route)
    assert found == code
    assert (motion.end[2], len(motion.events)) == (hits, hits + 1)


@pytest.mark.parametrize("route", STEPPING)
def test_a_guard_that_a_jump_has_lowered_fires_with_another_of_the_same_value(route: Route):
    """x = t goes back by 2 at 2 with one exact step to each event."""
    x, a, b = (ca.SX.sym(name) for name in ("x", "a", "b"))
    model = Model(
        "rounds",
        x=[Signal(name, s, value=0.0) for name, s in (("x", x), ("a", a), ("b", b))],
        ode=ca.SX([1, 0, 0]),
        switches=[
            Switch("a", x - 1, ca.vertcat(x, a + 1, b)),
            Switch("b", x - 1, ca.vertcat(x, a, b + 1)),
            Switch("back", x - 2, ca.vertcat(0, a, b)),
        ],
    )
    motion = simulate(model, 9.5, route=route, tolerance=Tolerance(max_step=np.inf))
    assert [event.name for event in motion.events] == 4 * ["a", "b", "back"] + ["a", "b"]
    assert motion.end == pytest.approx([1.5, 5.0, 5.0], abs=1e-12)


def test_progress_is_the_share_of_the_time_that_has_passed():
    said: list[float] = []
    y = ca.SX.sym("y", 2)
    model = Model("circle", x=[Signal("y", y, value=1.0)], ode=ca.vertcat(y[1], -y[0]))
    simulate(
        model, (4.0, 6.0), route="python", tolerance=Tolerance(max_step=1.25e-3),
        report=lambda text, share: said.append(share or 0.0),
    )  # fmt: skip
    assert said == pytest.approx([0, 500 / 1600, 1000 / 1600, 1500 / 1600], abs=1e-9)


@pytest.mark.parametrize("route", STEPPING)
def test_forces_left_open_are_refused(route: Route):
    """All but: of their matrix the determinant is 7e-11."""
    x, v, f = ca.SX.sym("x", 2), ca.SX.sym("v", 2), ca.SX.sym("f", 2)
    feet = [Contact(f"foot {i}", v[i], f[i], Coulomb(1.0, 1.0)) for i in range(2)]
    states = [Signal("x", x, value=0.0), Signal("v", v, value=1.0)]
    near = ca.DM([[1, 1 - 7e-11], [1 - 7e-11, 1]])
    cart = Model("cart", x=states, ode=ca.vertcat(v, near @ f), contacts=feet)
    error = refused(cart, 3.0, route)
    assert error.code == "no_contact_mode"
    assert error.partial.end_time == pytest.approx(0.5)


def relaxation() -> Model:
    """Van der Pol's oscillator, very stiff; counts how often x rises through 0."""
    x, count = ca.SX.sym("x", 2), ca.SX.sym("count")
    return Model(
        "relaxation",
        x=[Signal("x", x, value=(2.0, 0.0)), Signal("count", count, value=0.0)],
        ode=ca.vertcat(x[1], 1e3 * (1 - x[0] ** 2) * x[1] - x[0], 0),
        switches=[Switch("rises", x[0], ca.vertcat(x, count + 1))],
    )


@pytest.mark.parametrize("route", STEPPING)
def test_explicit_steps_give_up_where_they_would_crawl(route: Route):
    error = refused(relaxation(), 4e4, route)
    assert error.code == "stiff"
    assert 0 < error.partial.end_time < 1e3
    assert error.partial.end[0] == pytest.approx(2.0, abs=0.1)


@pytest.mark.usefixtures("no_compiler")
def test_stiff_motions_with_switches_take_implicit_steps():
    tolerance = Tolerance(1e-7, 1e-8)
    t = np.linspace(0, 1700, 35)
    motion = simulate(relaxation(), 1700.0, times=t, dense=True, tolerance=tolerance)
    assert motion.route == "python"
    (event,) = motion.events
    assert motion.n_steps < 2000
    assert motion.end[2] == 1
    assert motion.at(t).states == pytest.approx(motion.states, abs=1e-12)
    # found without events by another code
    smooth = replace(relaxation(), switches=())
    times = [event.time - 1e-7, event.time + 1e-7]
    before, after = simulate(smooth, 1700.0, times=times, route="cvodes").states[0]
    slope = (after - before) / 2e-7
    assert event.time - before / slope == pytest.approx(event.time, abs=1e-4)


@pytest.mark.slow
def test_where_implicit_steps_are_too_many_explicit_ones_go_on(monkeypatch: pytest.MonkeyPatch):
    """Steps in Python have a limit of their own: nobody waits for ten million of them."""
    tolerance = Tolerance(1e-7, 1e-8)
    few = simulate(relaxation(), 4000.0, tolerance=tolerance)
    monkeypatch.setattr(routes, "_STEPS_FOR_A_LOOK", 20)
    monkeypatch.setattr(routes, "_STEPS_IN_PYTHON", 20)
    many = simulate(relaxation(), 4000.0, tolerance=tolerance)
    assert (few.route, many.route) == ("python", "native")
    assert many.n_steps > 100 * few.n_steps
    assert many.end[2] == few.end[2] > 1
    assert many.events[0].time == pytest.approx(few.events[0].time, abs=1e-3)


@pytest.mark.parametrize(("end", "limits"), [(4e3, [30, 60]), (1e9, [30])])
def test_implicit_steps_end_early_where_they_get_nowhere(
    end: float, limits: list[int], monkeypatch: pytest.MonkeyPatch
):
    """A look at some of them tells whether the end is within reach of all."""
    asked, in_python = list[int](), routes._in_python

    def noted(task: InitialValueProblem, *given: Any, **options: Any) -> Outcome:
        if options:  # implicit ones
            asked.append(task.tolerance.max_steps)
        return in_python(task, *given, **options)

    monkeypatch.setattr(routes, "_in_python", noted)
    monkeypatch.setattr(routes, "_STEPS_FOR_A_LOOK", 30)
    monkeypatch.setattr(routes, "_STEPS_IN_PYTHON", 60)
    with pytest.raises(SolveError) as caught:
        simulate(relaxation(), end, tolerance=Tolerance(1e-7, 1e-8, max_steps=3000))
    assert (caught.value.code, asked) == ("too_many_steps", limits)


def test_what_passes_the_smooth_layer_unseen_is_refused():
    error = refused(
        sine_worm(Coulomb(1.0, 10.0)),
        10.0,
        "cvodes",
        contact=Smooth(1e-8),
        tolerance=Tolerance(1e-4, 1e-5),
    )
    assert error.code == "layer_not_resolved"
    assert error.partial.end_time < 10.0


# -- CVODES and IDAS -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("model", "options", "words"),
    [
        (magnetic_pair(), {}, "no exact contact"),
        (bouncing_ball(), {}, "no switches"),
        (scalar("x"), {"dense": True}, "do not keep the motion"),
    ],
)
def test_sundials_says_what_it_cannot(model: Model, options: dict, words: str):
    with pytest.raises(ValueError, match=words):
        simulate(model, 1.0, route="cvodes", **options)


def test_contacts_that_never_rest_need_no_smoothing():
    worm = chain(
        1, mass=1.0, stiffness=5.0, damping=0.0, rest_length=1.0, law=Viscous(0.5), velocity=1
    )
    a, b = (simulate(worm, 3.0, route=route) for route in ("native", "cvodes"))
    assert b.end == pytest.approx(a.end, abs=1e-9)


def test_algebraic_equations_are_solved_on_the_way():
    """x' = u - z with z^3 + z = x and a u that jumps, against the equation for z itself."""
    x, z, u, begin = (ca.SX.sym(name) for name in ("x", "z", "u", "begin"))
    jumps = Schedule("u", u, begin, np.array([0.0, 0.3, 1.0]), np.array([[1.0], [-1.0]]), True)
    states, algebraic = [Signal("x", x, nominal=2.0, value=1.0)], [Signal("z", z, value=0.1)]
    implicit = Model("x", x=states, z=algebraic, ode=u - z, alg=z**3 + z - x, schedules=[jumps])
    start = [Signal("z", z, value=0.6823278038280193)]
    explicit = Model("z", x=start, ode=(u - z) / (3 * z**2 + 1), schedules=[jumps])
    t = np.linspace(0, 5, 101)
    motion = simulate(implicit, 5.0, times=t)
    assert motion.route == "idas"
    z_exact = simulate(explicit, 5.0, times=t, tolerance=SHARP).states
    assert motion.states == pytest.approx(z_exact**3 + z_exact, abs=1e-9)


# -- random chains ---------------------------------------------------------------------------


def random_law(generator: np.random.Generator) -> Law:
    ahead, behind = generator.uniform(0.1, 2.0, 2)
    more, over = generator.uniform(1.1, 2.0, 2)
    laws = [
        Coulomb(ahead, behind),
        Coulomb(ahead, behind, more * ahead, over * behind),
        Stribeck(ahead, behind, more * ahead, over * behind, generator.uniform(0.1, 0.5)),
        Spike(),
        Viscous(ahead),
    ]
    return laws[generator.integers(len(laws))]


def random_chain(seed: int) -> Model:
    """A chain of one to three links that is shaken; every other one is pushed by turns too."""
    generator = np.random.default_rng(seed)
    links = int(generator.integers(1, 4))
    worm = chain(
        links,
        mass=generator.uniform(0.3, 2.0, links + 1),
        stiffness=generator.uniform(1.0, 30.0, links),
        damping=generator.uniform(0.0, 3.0, links),
        rest_length=2.0,
        law=[random_law(generator) for _ in range(links + 1)],
        velocity=generator.uniform(-1.0, 1.0, links + 1) * generator.integers(2),
    )
    size, rate, phase = (ca.DM(generator.uniform(0, top, links)) for top in (8.0, 5.0, 6.0))
    model = shaken(worm, size * ca.sin(rate * worm.t + phase))
    if seed % 2:
        c, begin = ca.SX.sym("c"), ca.SX.sym("begin")
        values = generator.uniform(-3.0, 3.0, (2, 1))
        pushes = Schedule("push", c, begin, np.array([0.0, 0.7, 1.5]), values, True)
        push = ca.vertcat(ca.SX.zeros(links + 1), c, ca.SX.zeros(links))
        model = replace(model, ode=model.ode + push, schedules=[pushes])
    return model


# Numbers are drawn from a seed: hypothesis likes round ones, with which forces touch their bounds
# without crossing them, and there times of events are ill-conditioned.
@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=examples(15))
def test_random_chains_move_alike(seed: int):
    model = random_chain(seed)
    t = np.linspace(0, 6, 601)
    a, b = (simulate(model, 6.0, times=t, tolerance=SHARP, route=route) for route in STEPPING)
    assert_same(a, b, within=1e-8)
    assert_lawful(b)
