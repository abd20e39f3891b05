"""All routes give the same motion: compiled steps, the same steps in Python, CVODES and IDAS."""

from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from effort import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from on_routes import (
    ALL,
    SHARP,
    STEPPING,
    attempted,
    bouncing_ball,
    event_times,
    listed,
    scalar,
    shaken,
    sine_worm,
)
from worms import TRACKED

from tests.benchmarks.cases import mag2
from wormopt.control.drive import drive
from wormopt.control.lambda_tracker import Feedback, lambda_tracker
from wormopt.control.loop import gait_reference
from wormopt.model.friction import Coulomb, Law, Spike, Stribeck, Viscous
from wormopt.model.gait import Gait
from wormopt.model.model import Contact, Model, Signal
from wormopt.model.schedule import Schedule
from wormopt.simulation import sundials
from wormopt.simulation.native.build import CompilerError
from wormopt.simulation.options import Exact, Route, Smooth, Tolerance, Treatment
from wormopt.simulation.simulate import simulate
from wormopt.simulation.trajectory import Trajectory
from wormopt.systems.chain.build import chain
from wormopt.systems.spiked.construct import fast_gait

DEFAULT = Tolerance()


# docs/verification.md, pair
MAG2 = [68.6821179593, 69.1082146640, -0.1937052220, 0.7347495453]

MAG2_STICKS = [
    ("mass 0", 1.302637, 1.309360),
    ("mass 1", 2.795280, 3.270012),
    ("mass 0", 5.092701, 5.351588),
    ("mass 1", 7.344490, 7.451483),
    ("mass 0", 9.562752, 9.563212),
]


def tracked(feedback: Feedback, rest: float = 0.0, **options: float | bool) -> Model:
    """The chapter's worm under a tracker; with rest = 2 it starts near its reference."""
    start = (0.0, 2.0, 4.0) if rest == 0 else (4.0, 2.0, 0.0)
    worm = chain(
        2, mass=1.0, stiffness=10.0, damping=5.0, rest_length=rest, law=Coulomb(1.0, 10.0),
        position=start,
    )  # fmt: skip
    reference = gait_reference(fast_gait(1.0, 2.0, 0.15), time=worm.t)
    return lambda_tracker(worm, reference, tube_radius=0.2, feedback=feedback, **options)  # type: ignore[arg-type]


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


# -- benchmarks ------------------------------------------------------------------------------


@pytest.mark.parametrize("route", ALL)
@pytest.mark.parametrize("feedback", TRACKED)
def test_tracked_worms_arrive_where_the_benchmark_says(feedback: Feedback, route: Route):
    tolerance = SHARP if route != "cvodes" else DEFAULT
    motion = simulate(tracked(feedback), 10.0, contact=Smooth(), tolerance=tolerance, route=route)
    assert motion.route == route
    # at the looser tolerance rounding decides steps of CVODES, and their errors with them
    accepted = 1e-9 if route != "cvodes" else 1e-8
    assert motion.end == pytest.approx(TRACKED[feedback], abs=accepted)


def test_the_magnetic_pair_has_the_events_of_the_benchmark(route: Route):
    motion = simulate(mag2(), 400.0, tolerance=SHARP, route=route)
    assert len(motion.events) == 369
    sticks = [event for event in motion.events if event.kind == "stick"]
    releases = [event for event in motion.events if event.kind == "release"]
    found = [(a.name, a.time, b.time) for a, b in zip(sticks, releases, strict=True)]
    for (name, start, end), (expected, *times) in zip(found, MAG2_STICKS, strict=True):
        assert name == expected
        assert [start, end] == pytest.approx(times, abs=6e-7)
    assert motion.end == pytest.approx(MAG2, abs=1e-9)


@pytest.mark.compiled
def test_both_stepping_routes_take_the_same_steps():
    a, b = (simulate(mag2(), 100.0, route=route, dense=True) for route in STEPPING)
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


@pytest.mark.compiled
def test_other_values_of_a_schedule_need_no_other_model():
    other = {"d": np.array([[0.0], [3.0], [0.0]])}
    ends = [simulate(saw(), 10.1, schedules=other, route=route).end for route in ALL]
    assert ends[1] == pytest.approx(ends[0], abs=1e-11)
    assert ends[2] == pytest.approx(ends[0], abs=1e-8)


@pytest.mark.compiled
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


def test_a_velocity_that_is_no_state_drifts_at_rest_without_harm(route: Route):
    """Velocities v (1.5 + cos x) stay zero at rest up to the errors of the steps only."""
    x, v, f, t = (ca.SX.sym(name) for name in ("x", "v", "f", "t"))
    y, w = ca.SX.sym("y"), ca.SX.sym("w")
    skew = 1.5 + ca.cos(x) + 0.5 * ca.sin(y)
    states = [Signal(n, s, value=0.0) for n, s in (("x", x), ("v", v), ("y", y), ("w", w))]
    ode = ca.vertcat(v, skew * f + 3 * ca.sin(t), w, ca.cos(1.7 * t) - y - 0.4 * f)
    contacts = [Contact("tip", skew * v - 0.4 * w, f, Coulomb(0.4, 0.8))]
    model = Model("cam", states, ode, t=t, contacts=contacts)
    sharp = simulate(model, 30.0, tolerance=SHARP, route="python")
    assert {"stick", "release"} <= {event.kind for event in sharp.events}
    for relative in (1e-6, 1e-8, 1e-11):
        tolerance = Tolerance(relative, 0.1 * relative)
        assert_same(simulate(model, 30.0, tolerance=tolerance, route=route), sharp, 1e3 * relative)


@pytest.mark.compiled
@pytest.mark.parametrize("v_reg", [1e-2, 1e-3])
def test_steep_smooth_laws_are_resolved_alike(v_reg: float):
    model = sine_worm(Coulomb(1.0, 10.0))
    motions = [simulate(model, 10.0, contact=Smooth(v_reg), route=route) for route in ALL]
    assert motions[1].end == pytest.approx(motions[0].end, abs=1e-9)
    assert motions[2].end == pytest.approx(motions[0].end, abs=1e-8)


@pytest.mark.compiled
@pytest.mark.parametrize("v_reg", [1e-5, 1e-6, 1e-7])
@pytest.mark.parametrize("relative", [1e-4, 1e-7, 1e-11])
def test_cvodes_is_right_or_refuses(v_reg: float, relative: float):
    """The smooth motion differs from the exact one by some 10 v_reg."""
    model = sine_worm(Coulomb(1.0, 10.0))
    exact = simulate(model, 10.0, tolerance=SHARP, route="native")
    tolerance = Tolerance(relative, 0.1 * relative)
    contact = Smooth(v_reg)
    motion, code = attempted(model, 10.0, contact=contact, tolerance=tolerance, route="cvodes")
    if code:
        assert code == "layer_not_resolved"
        assert v_reg < 1e-6
        assert motion.end_time < 10.0
    else:
        assert motion.end == pytest.approx(exact.end, abs=20 * v_reg)


# -- without a compiler ----------------------------------------------------------------------


@pytest.mark.usefixtures("no_compiler")
def test_without_a_compiler_the_same_steps_are_taken_in_python():
    exact = simulate(mag2(), 20.0, tolerance=SHARP)
    assert exact.route == "python"
    assert sum(event.kind == "stick" for event in exact.events) == 5


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
        simulate(mag2(), 1.0, route="native")


# -- the whole motion ------------------------------------------------------------------------


@pytest.mark.parametrize("contact", [Exact(), Smooth()])
def test_the_kept_motion_holds_the_samples(route: Route, contact: Treatment):
    t = np.linspace(0, 10, 237)
    model = sine_worm(Coulomb(1.0, 10.0))
    motion = simulate(model, 10.0, contact=contact, times=t, dense=True, route=route)
    assert motion.at(t).states == pytest.approx(motion.states, abs=1e-13)
    assert motion.dense is not None
    assert motion.dense.time[[0, -1]].tolist() == [0.0, 10.0]
    assert np.all(np.diff(motion.dense.time) > 0)


# -- CVODES and IDAS -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("model", "options", "words"),
    [
        (mag2(), {}, "do not support exact contact"),
        (bouncing_ball(), {}, "no switches"),
        (scalar("x"), {"dense": True}, "do not keep the motion"),
    ],
)
def test_sundials_says_what_it_cannot(model: Model, options: dict, words: str):
    with pytest.raises(ValueError, match=words):
        simulate(model, 1.0, route="cvodes", **options)


@pytest.mark.compiled
def test_contacts_that_never_rest_need_no_smoothing():
    law = Viscous(0.5)
    worm = chain(1, mass=1.0, stiffness=5.0, damping=0.0, rest_length=1.0, law=law, velocity=1)
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
@pytest.mark.compiled
@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=examples(15))
def test_random_chains_move_alike(seed: int):
    model = random_chain(seed)
    t = np.linspace(0, 6, 601)
    a, b = (simulate(model, 6.0, times=t, tolerance=SHARP, route=route) for route in STEPPING)
    assert_same(a, b, within=1e-8)
    assert_lawful(b)


def test_implicit_steps_that_fail_at_breaks_begin_again_there(monkeypatch: pytest.MonkeyPatch):
    """Not at halves of the time, each of which would fail again at the breaks within."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    plant = Model("lag", [Signal("x", x, value=0.0)], u - x, u=[Signal("u", u)])
    pushes = Gait(np.array([0.0, 0.3, 0.5, 2.0]), np.array([[[1.0]], [[3.0]], [[-1.0]]]))
    lag = drive(plant, pushes)
    known = simulate(lag, 2.0, times=[2.0], route="cvodes")["x"]
    advance, calls = sundials._advance, []

    def failing(run: Any, solver: Any, guess: Any, first: int, end: int) -> Any:
        pieces = np.unique(run.grid.scheduled[:, first:end], axis=1).shape[1]
        calls.append(pieces)
        if pieces > 1:
            raise RuntimeError
        return advance(run, solver, guess, first, end)

    monkeypatch.setattr(sundials, "_advance", failing)
    assert simulate(lag, 2.0, times=[2.0], route="cvodes")["x"] == pytest.approx(known, rel=1e-6)
    assert calls == [3, 1, 1, 1]
