"""The verb `simulate`: exact motions, orders of convergence, events, ensembles."""

import math
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from effort import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.optimize import brentq
from simulated import actuated, crawler, oscillator, refused

from wormopt.model.friction import Coulomb, Law, Spike, Viscous
from wormopt.model.lift import lift
from wormopt.model.model import Contact, Model, Signal, Switch
from wormopt.simulation.ensemble import Scenario, simulate_ensemble
from wormopt.simulation.options import Exact, Route, Smooth, Tolerance
from wormopt.simulation.simulate import simulate
from wormopt.simulation.trajectory import Trajectory
from wormopt.systems.chain.build import chain

SHARP = Tolerance(1e-12, 1e-13)


def block(
    law: Law, force: ca.SX | float = 0.0, t: ca.SX | None = None, x0: float = 0.0, v0: float = 0.0
) -> Model:
    """A unit mass on the ground that a force pulls."""
    x, v, f = ca.SX.sym("x"), ca.SX.sym("v"), ca.SX.sym("f")
    states = [Signal("position", x, value=x0), Signal("velocity", v, value=v0)]
    (lifted,), numbers = lift([law])  # one compilation for all numbers
    ground, time = [Contact("block", v, f, lifted)], ca.SX.sym("t") if t is None else t
    return Model("block", states, ca.vertcat(v, f + force), p=numbers, t=time, contacts=ground)


def kinds(motion: Trajectory) -> list[str]:
    return [event.kind for event in motion.events]


# -- smooth motion ---------------------------------------------------------------------------


def test_free_chain_moves_as_its_matrix_exponential():
    worm = chain(3, mass=[1, 2, 3, 4], stiffness=[5, 6, 7], damping=0.3, rest_length=0.0, drag=0.1)
    x0, v0 = np.array([3.0, 1.0, 0.5, -1.0]), np.array([0.1, -0.2, 0.3, 0.0])
    motion = simulate(worm, 7.0, x0={"position": x0, "velocity": v0}, tolerance=SHARP)
    mass, c, d = np.diag([1, 2, 3, 4.0]), np.diag([5, 6, 7.0]), 0.3 * np.eye(3)
    links = np.array([[1, -1, 0, 0], [0, 1, -1, 0], [0, 0, 1, -1.0]])
    inverse = np.linalg.inv(mass)
    matrix = np.block(
        [
            [np.zeros((4, 4)), np.eye(4)],
            [-inverse @ links.T @ c @ links, -inverse @ (links.T @ d @ links + 0.1 * np.eye(4))],
        ]
    )
    assert motion.end == pytest.approx(expm(7.0 * matrix) @ np.concatenate([x0, v0]), abs=1e-10)


def test_steps_are_of_order_eight_and_the_polynomial_of_order_seven():
    ends, dense, steps = [], [], []
    t = np.linspace(0, 20, 2001)
    exact = np.vstack([np.cos(t), -np.sin(t)])
    for relative in (1e-5, 1e-7, 1e-9):
        tolerance = Tolerance(relative, relative, max_step=np.inf)
        motion = simulate(oscillator(), 20.0, times=t, tolerance=tolerance)
        steps.append(motion.n_steps)
        ends.append(np.abs(motion.states[:, -1] - exact[:, -1]).max())
        dense.append(np.abs(motion.states - exact).max())

    def order(errors: list[float]) -> float:
        return -np.log(errors[2] / errors[0]) / np.log(steps[2] / steps[0])

    assert 7.3 < order(ends) < 9.5
    assert 6.5 < order(dense) < 9.5
    assert ends[2] < 1e-8


# -- set-valued contact ----------------------------------------------------------------------


@given(forward=st.floats(0.1, 3.0), backward=st.floats(0.1, 3.0), speed=st.floats(-3.0, 3.0))
@settings(max_examples=examples(25))
def test_a_thrown_block_stops_where_its_energy_is_spent(
    forward: float, backward: float, speed: float
):
    resistance = forward if speed > 0 else backward
    time = abs(speed) / resistance
    motion = simulate(block(Coulomb(forward, backward), v0=speed), time + 1.0, tolerance=SHARP)
    way = speed * abs(speed) / (2 * resistance)
    assert motion.end == pytest.approx([way, 0.0], abs=1e-11)
    if time > 1e-6:
        assert kinds(motion) == ["stick"]
        assert motion.events[0].time == pytest.approx(time, abs=1e-11)


def test_a_spring_block_loses_two_friction_offsets_each_half_swing():
    # Coulomb's oscillator: half circles about +F/c = 0.2 backward and -0.2 forward, from 1.9 to
    # -1.5, 1.1, -0.7, 0.3, 0.1; there the spring pulls with less than the ground holds
    free = block(Coulomb(0.8, 0.8), x0=1.9)
    pull = ca.vertcat(0, -4 * free["position"])
    motion = simulate(replace(free, ode=free.ode + pull), 20.0)
    assert motion.end == pytest.approx([0.1, 0.0], abs=1e-9)
    assert kinds(motion) == ["reversal"] * 4 + ["stick"]
    half_swings = np.pi / 2 * np.arange(1, 6)
    assert [e.time for e in motion.events] == pytest.approx(half_swings, abs=1e-9)


@pytest.mark.parametrize("stiction", [1.7, 1.0])
def test_stiction_holds_longer_than_sliding_friction(stiction: float):
    t = ca.SX.sym("t")
    law = Coulomb(1.0, 1.0, stick_forward=stiction, stick_backward=stiction)
    motion = simulate(block(law, 0.5 * t, t), 5.0, tolerance=SHARP)
    (release,) = motion.events
    assert (release.kind, release.mode) == ("release", 1)
    assert release.time == pytest.approx(2 * stiction, abs=1e-11)
    # v' = t/2 - 1 from then on
    gained = (25 - 4 * stiction**2) / 4 - (5 - 2 * stiction)
    assert motion.end[1] == pytest.approx(gained, abs=1e-10 if stiction == 1 else 1e-11)


def test_a_balance_of_forces_on_the_edge_of_slipping_stays_at_rest():
    motion = simulate(block(Coulomb(1.0, 1.0), 1.0), 100.0)
    assert motion.end.tolist() == [0.0, 0.0]


def test_viscous_contacts_are_plain_forces_in_either_treatment():
    exact = simulate(block(Viscous(2.0), v0=1.0), 1.0, contact=Exact(), tolerance=SHARP)
    smooth = simulate(block(Viscous(2.0), v0=1.0), 1.0, contact=Smooth(), tolerance=SHARP)
    assert exact.events == ()
    assert exact.end[1] == pytest.approx(np.exp(-2.0), abs=1e-12)
    assert smooth.end == pytest.approx(exact.end, abs=1e-13)


def test_a_velocity_that_only_touches_zero_makes_no_event_and_one_that_dips_makes_two():
    t = ca.SX.sym("t")
    for depth, count in ((1e-9, 0), (-1e-9, 2)):
        # frictionless in effect: v = (t - 5)^2 + depth but for the reversal
        law = Coulomb(1e-15, 1e-15)
        motion = simulate(block(law, 2 * (t - 5), t, v0=25 + depth), 10.0, tolerance=SHARP)
        assert len(motion.events) == count
        if count:
            width = np.sqrt(-depth)
            assert [e.time for e in motion.events] == pytest.approx(
                [5 - width, 5 + width], abs=1e-7
            )


@pytest.mark.parametrize("relative", [1e-3, 1e-6, 1e-9, 1e-12])
def test_no_short_dip_is_passed_where_velocities_are_mostly_clear_of_zero(relative: float):
    # frictionless in effect: v = 0.99 + cos 3 t is below 0 for a twentieth of each of 20 periods
    t = ca.SX.sym("t")
    model = block(Coulomb(1e-15, 1e-15), -3 * ca.sin(3 * t), t, v0=1.99)
    motion = simulate(model, 40 * np.pi / 3, tolerance=Tolerance(relative, 0.1 * relative))
    half = np.arccos(0.99) * np.tile([-1, 1], 20)
    found = [e.time for e in motion.events]
    assert len(found) == 40
    middles = np.repeat((2 * np.arange(20) + 1) * np.pi, 2)
    assert found == pytest.approx((middles + half) / 3, abs=30 * relative + 1e-12)


@pytest.mark.compiled
def test_a_step_that_stays_clear_of_events_costs_no_more_than_its_stages():
    t = ca.SX.sym("t")
    model = block(Coulomb(0.1, 0.1), 0.2 + ca.cos(3 * t), t, v0=1.0)
    motion = simulate(model, 50.0, tolerance=SHARP, route="native")
    assert motion.events == ()
    tried = motion.n_steps + motion.n_rejected
    assert motion.n_steps > 100
    assert motion.n_evaluations <= 12 * tried + 2  # 15 a step with the polynomial


def test_a_worm_at_rest_notices_that_forces_change():
    # the force 0.02 t sin(t) exceeds 1 first near t = 51.6; only steps that see it find that
    t = ca.SX.sym("t")
    model = block(Coulomb(1.0, 1.0), 0.02 * t * ca.sin(t), t)
    expected = brentq(lambda time: 0.02 * time * np.sin(time) - 1, 51.0, 52.0)
    motion = simulate(model, 100.0)
    assert motion.events[0].time == pytest.approx(expected, abs=1e-9)
    fast = block(Coulomb(1.0, 1.0), 1.01 * ca.sin(60 * t), t)  # above 1 for 5e-3 at a time
    release = np.arcsin(1 / 1.01) / 60
    assert simulate(fast, 100.0).events[0].time == pytest.approx(release, abs=1e-9)


def test_impacts_of_contacts_that_act_on_each_other_are_refused(route: Route):
    x, v, f = ca.SX.sym("x", 2), ca.SX.sym("v", 2), ca.SX.sym("f", 2)
    laws = (Spike(), Coulomb(1.0, 1.0))
    contacts = [Contact(f"foot {i}", v[i], f[i], laws[i]) for i in range(2)]
    states = [Signal("x", x, value=0.0), Signal("v", v, value=(-1.0, 0.1))]
    inverse = ca.DM(np.linalg.inv([[2.0, 1.0], [1.0, 2.0]]))
    model = Model("pair", x=states, ode=ca.vertcat(v, inverse @ f), contacts=contacts)
    assert refused(model, 1.0, route=route).code == "no_contact_mode"


class AirDrag:
    """A law of a user's own: it never holds, but differs by direction."""

    directions = (1, -1)
    stick_interval = (0.0, 0.0)

    def slip_force(self, v: ca.SX, direction: int) -> ca.SX:
        return -direction * v * v

    def smooth(self, v: ca.SX, v_reg: float) -> ca.SX:
        return -v * ca.fabs(v)


@pytest.mark.parametrize("start", [1.0, -1.0])
def test_a_law_may_differ_by_direction_without_ever_holding(start: float):
    x, v, f = ca.SX.sym("x"), ca.SX.sym("v"), ca.SX.sym("f")
    states = [Signal("x", x, value=0.0), Signal("v", v, value=start)]
    air = [Contact("air", v, f, AirDrag())]  # type: ignore[arg-type]
    model = Model("fall", x=states, ode=ca.vertcat(v, f), contacts=air)
    assert simulate(model, 0.9).end[1] == pytest.approx(start / 1.9, abs=1e-10)


def test_instants_that_were_not_kept_are_refused():
    with pytest.raises(ValueError, match="times must be from 0 to 1"):
        simulate(oscillator(), 1.0, dense=True).at(np.array([2.0]))
    with pytest.raises(ValueError, match="dense=True"):
        simulate(oscillator(), 1.0).at(np.array([0.5]))


# -- switches --------------------------------------------------------------------------------


def test_a_switch_deep_inside_a_long_step_is_found():
    t, x = ca.SX.sym("t"), ca.SX.sym("x")
    guard = 1e-8 - (t - 1.2345) ** 2  # above 0 for 2e-4 only, while steps are as long as the run
    model = Model(
        "still", x=[Signal("count", x, value=0.0)], ode=ca.SX(1, 1), t=t,
        switches=[Switch("counts", guard, x + 1)],
    )  # fmt: skip
    motion = simulate(model, 10.0)
    assert [e.name for e in motion.events] == ["counts"]
    assert motion.events[0].time == pytest.approx(1.2345 - 1e-4, abs=1e-9)
    assert motion.end.tolist() == [1.0]


# -- physics ---------------------------------------------------------------------------------


def test_energy_put_in_is_stored_or_dissipated():
    worm = crawler()
    work, loss = ca.SX.sym("work"), ca.SX.sym("loss")
    v = worm.contact_velocities
    d = next(s.symbol for s in worm.p if s.name == "damping")
    rate = worm["rate"]
    rates = ca.vertcat(ca.sum1(worm["power"]), ca.dot(d, rate**2) - ca.dot(worm.forces, v))
    accounts = [Signal("work", work, value=0.0), Signal("loss", loss, value=0.0)]
    model = replace(worm, x=[*worm.x, *accounts], ode=ca.vertcat(worm.ode, rates))
    t = np.linspace(0, 30, 301)
    motion = simulate(model, 30.0, times=t, tolerance=SHARP)
    assert {"stick", "release"} <= set(kinds(motion))
    energy = motion["energy"][0]
    gap = energy - energy[0] - motion["work"][0] + motion["loss"][0]
    assert motion["loss"][0, -1] > 10.0
    assert np.abs(gap).max() < 1e-9


def test_the_smooth_law_tends_to_the_set_valued_one_with_order_one():
    worm = crawler()
    exact = simulate(worm, 15.0, tolerance=SHARP)
    assert kinds(exact).count("stick") >= 5
    widths = np.array([4e-3, 2e-3, 1e-3, 5e-4])
    errors = [
        np.abs(simulate(worm, 15.0, contact=Smooth(w)).end[:3] - exact.end[:3]).max()
        for w in widths
    ]
    slope = np.polyfit(np.log(widths), np.log(errors), 1)[0]
    assert 0.85 < slope < 1.15
    assert errors[-1] < 0.1  # creep: about 30 widths of way in 15 units of time


@pytest.mark.parametrize(
    ("masses", "forward", "backward"),
    [
        (2, 1.0, 10.0),
        pytest.param(3, 1.0, 10.0, marks=pytest.mark.slow),
        (4, 1.0, 2.2),
        (5, 1.0, 2.0),
    ],
)
def test_a_chain_stretched_slowly_advances_as_statics_says(
    masses: int, forward: float, backward: float
):
    # docs/theory-dynamics.md: elastic links lag by friction / stiffness, which is linear
    advances, stiffnesses, period, stroke = [], np.array([1e3, 2e3]), 100.0, 0.5
    for c in stiffnesses:
        worm = chain(
            masses - 1, mass=1.0, stiffness=c, damping=1.4 * np.sqrt(c), rest_length=2.0,
            law=Coulomb(forward, backward),
        )  # fmt: skip
        command = stroke * (1 - ca.cos(2 * np.pi * worm.t / period)) / 2
        model = actuated(worm, command * ca.DM.ones(masses - 1))
        motion = simulate(model, 3 * period, times=period * np.arange(4.0))
        advance = np.diff(motion["position"][0])
        assert advance[2] == pytest.approx(advance[1], abs=1e-6)
        advances.append(advance[2] / (stroke * (masses - 1)))
    rest = min(masses - 1, int(masses * backward / (forward + backward)))
    expected = (2 * rest - (masses - 1)) / (masses - 1)
    assert abs(advances[0] - expected) < 0.01
    assert 2 * advances[1] - advances[0] == pytest.approx(expected, abs=2e-4)


def test_harmonic_velocities_with_small_friction_drift_as_averaging_says():
    # docs/theory-dynamics.md: mean V solves sum arcsin(V/A_i) = N Phi;
    # the phasors of a triangle sum to zero
    sizes, forward, backward = np.array([1.0, 0.8, 0.6]), 0.5, 1.0
    turn = np.pi - np.arccos((1 + 0.8**2 - 0.6**2) / 1.6)
    last = np.angle(-1 - 0.8 * np.exp(1j * turn))
    tilt = np.pi / 2 * (backward - forward) / (backward + forward)
    expected = brentq(lambda V: np.arcsin(np.clip(V / sizes, -1, 1)).sum() - 3 * tilt, 0.0, 1.0)
    gaps = []
    for eps in (0.02, 0.01):
        t, x, v, f = ca.SX.sym("t"), ca.SX.sym("x"), ca.SX.sym("v"), ca.SX.sym("f", 3)
        own = [v + a * ca.cos(t + b) for a, b in zip(sizes, (0.0, turn, last), strict=True)]
        law = Coulomb(eps * forward, eps * backward)
        contacts = [Contact(f"mass {i}", own[i], f[i], law) for i in range(3)]
        states = [Signal("position", x, value=0.0), Signal("velocity", v, value=0.1)]
        model = Model("drift", x=states, ode=ca.vertcat(v, ca.sum1(f) / 3), t=t, contacts=contacts)
        settled, window = 2 * np.pi * round(5 / eps), 40 * np.pi
        motion = simulate(model, settled + window, times=[settled, settled + window])
        gaps.append(np.diff(motion["position"][0])[0] / window - expected)
    assert abs(gaps[0]) < 1e-3
    assert gaps[0] / gaps[1] == pytest.approx(2.0, abs=0.5)  # first order in eps


# -- ensembles -------------------------------------------------------------------------------


def test_an_ensemble_is_its_members_one_by_one():
    worm = crawler()
    members = [Scenario(p={"stiffness": c}) for c in (15.0, 20.0, 25.0)]
    t = np.linspace(0, 6, 7)
    together = simulate_ensemble(worm, 6.0, members, times=t)
    assert together.codes == ("", "", "")
    for k, member in enumerate(members):
        alone = simulate(worm, 6.0, p=member.p, times=t)
        assert together.states[k].tolist() == alone.states.tolist()
    assert together["length"].shape == (3, 2, 7)


def test_a_member_that_fails_is_marked_and_the_others_are_kept():
    x, a = ca.SX.sym("x"), ca.SX.sym("a")
    model = Model("blow-up", x=[Signal("x", x, value=1.0)], ode=a * x**2, p=[Signal("a", a)])
    members = [Scenario(p={"a": value}) for value in (0.0, 1.0, -1.0)]
    found = simulate_ensemble(model, 2.0, members, times=[0.0, 0.5, 2.0])
    assert found.codes[0] == found.codes[2] == ""
    assert found.codes[1] in ("step_too_small", "not_finite")
    assert np.isnan(found.states[:, 0, 2]).tolist() == [False, True, False]
    assert found.end[2, 0] == pytest.approx(1 / 3)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"contact": "smooth"}, r"contact must be Exact\(\) or Smooth"),
        ({"contact": Smooth}, r"contact must be Exact\(\) or Smooth"),
        ({"route": "pyhton"}, "route must be one of auto, native, python, radau, cvodes"),
        ({"tolerance": 1e-6}, r"tolerance must be Tolerance\("),
    ],
)
def test_what_is_not_of_its_kind_is_not_taken_for_something_else(options: dict, words: str):
    with pytest.raises((TypeError, ValueError), match=words):
        simulate(oscillator(), 1.0, **options)


@given(height=st.floats(0.1, 50.0), push=st.floats(-5.0, 5.0))
@settings(max_examples=examples(15))
def test_a_terminal_switch_ends_the_motion(route: Route, height: float, push: float):
    x, v = ca.SX.sym("x"), ca.SX.sym("v")
    states = [Signal("height", x, value=height), Signal("velocity", v, value=push)]
    ground = Switch("ground", -x, ca.vertcat(x, v), terminal=True)
    ball = Model("ball", x=states, ode=ca.vertcat(v, -9.80665), switches=[ground])
    fall = (push + math.sqrt(push**2 + 2 * 9.80665 * height)) / 9.80665
    motion = simulate(ball, 20.0, times=np.linspace(0.0, 20.0, 41), dense=True, route=route)
    if fall > 20.0:
        assert motion.end_time == 20.0
        return
    assert motion.end_time == pytest.approx(fall, rel=1e-9)
    assert motion.end[0] == pytest.approx(0.0, abs=1e-9)
    assert [(e.name, e.kind) for e in motion.events] == [("ground", "switch")]
    assert motion.time[-1] <= fall < motion.time[-1] + 0.5  # no samples beyond
    assert motion.dense is not None
    assert motion.dense.time[-1] == motion.end_time


@pytest.mark.compiled
def test_a_terminal_switch_that_has_fired_already_ends_the_motion_at_once():
    x = ca.SX.sym("x")
    late = Switch("late", x - 1, x, terminal=True)
    model = Model("line", x=[Signal("place", x, value=2.0)], ode=ca.SX(1), switches=[late])
    for route in ("native", "python"):
        motion = simulate(model, 3.0, route=route)
        # what is above 0 from the beginning has not risen through 0
        assert motion.end_time == 3.0
