"""Steps without events, against motions known in closed form and against located events."""

import math
from dataclasses import replace
from functools import cache
from typing import Any

import casadi as ca
import numpy as np
import pytest
from effort import examples
from hypothesis import given, settings
from hypothesis import strategies as st

import wormopt as wo
from wormopt.errors import ArgumentError
from wormopt.model.friction import Coulomb, Spike
from wormopt.model.model import Contact, Model, Signal, Switch
from wormopt.model.schedule import Schedule
from wormopt.progress import silent
from wormopt.simulation.event_free import Ending, _march, _task, ending
from wormopt.simulation.options import Tolerance
from wormopt.simulation.simulate import simulate
from wormopt.simulation.trajectory import Trajectory
from wormopt.systems.shared.proof import cross_check

SPIKE = Spike()


@cache
def driven(count: int = 1, law: Any = None) -> Model:
    """Masses on springs and dry ground, of friction mu, each pulled by a cosine.

    Everything is a parameter or a start: the model is compiled once.
    """
    x, v, rubbed = (ca.SX.sym(name, count) for name in ("x", "v", "rubbed"))
    values = {"mu": 0.4, "pull": 1.0, "spring": 0.0, "stiction": 1.0}
    p = [Signal(name, ca.SX.sym(name), value=value) for name, value in values.items()]
    mu, pull, spring, stiction = (s.symbol for s in p)
    t: ca.SX = ca.SX.sym("t")
    law = law or Coulomb(mu, 2 * mu, stiction * mu, 2 * stiction * mu)
    springs = ca.SX.zeros(count)
    for i in range(count - 1):
        tension = spring * (x[i + 1] - x[i])
        springs[i] += tension
        springs[i + 1] -= tension
    pulls = ca.vertcat(*(pull * ca.cos(t + i) for i in range(count)))
    states = [Signal("x", x, value=0.0), Signal("v", v, value=0.0)]
    ode = ca.vertcat(v, springs + pulls + rubbed)
    contacts = [Contact(f"ground_{i}", v[i], rubbed[i], law) for i in range(count)]
    return Model("driven", states, ode, t=t, p=p, contacts=contacts)


def ended(model: Model, end: float, accepted: float = 1e-8, **given: Any) -> tuple[Any, Ending]:
    motion = simulate(model, end, tolerance=Tolerance(1e-12, 1e-12), **given)
    return motion, ending(motion, motion.states[:, 0], accepted)


def apart(motion: Trajectory, found: Ending) -> float:
    return float(np.max(np.abs(motion.end - found.end) / np.maximum(1, np.abs(found.end))))


@given(st.floats(0.1, 3.0), st.floats(0.1, 2.0))
@settings(max_examples=examples(15))
def test_a_sliding_mass_stops_where_its_energy_is_spent(speed: float, mu: float):
    p = {"mu": mu, "pull": 0.0}
    motion = simulate(driven(), 1.3 * speed / mu, x0={"v": speed}, p=p)
    found = ending(motion, np.array([0.0, speed]), 1e-10)
    assert found.end == pytest.approx([speed**2 / (2 * mu), 0.0], abs=1e-9)


@pytest.mark.parametrize("stiction", [1.0, 1.7])
def test_events_leave_the_order_two(stiction: float):
    motion = simulate(driven(), 30.0, p={"stiction": stiction}, tolerance=Tolerance(1e-13, 1e-13))
    assert len(motion.events) > 8
    start = np.zeros(2)
    march = _march(_task(motion, start), 2)
    found = [march(start, 4 * fineness) for fineness in (1, 2, 4, 8, 16)]
    counts, errors = [n for _, n in found], [np.max(np.abs(x - motion.end)) for x, _ in found]
    slope = -np.polyfit(np.log(counts), np.log(errors), 1)[0]
    assert 1.7 < slope < 2.4
    assert errors[-1] < 1e-6


@given(st.floats(0.05, 0.9), st.floats(0.3, 3.0), st.floats(1.0, 2.5), st.floats(0, 2), st.data())
@settings(max_examples=examples(30))
def test_ends_of_located_events_are_found_again(
    mu: float, pull: float, stiction: float, spring: float, data: st.DataObject
):
    p = {"mu": mu, "pull": pull, "spring": spring, "stiction": stiction}
    motion, found = ended(driven(3), 12.0, x0={"v": data.draw(st.floats(-1, 1))}, p=p)
    assert found.doubt < 1e-5
    assert apart(motion, found) < max(5 * found.doubt, 1e-9)


@pytest.mark.parametrize("pieces", [50, 500])
def test_an_end_after_many_pieces_of_a_schedule_is_known_as_well_as_it_says(pieces: int):
    x, rate, begin = (ca.SX.sym(name) for name in ("x", "rate", "begin"))
    rates = np.random.default_rng(1).uniform(-1, 1, (pieces, 1))
    schedule = Schedule("rates", rate, begin, np.linspace(0, 10, pieces + 1), rates)
    model = Model("grown", x=[Signal("x", x, value=1.0)], ode=rate * x, schedules=[schedule])
    _, found = ended(model, 10.0)
    exact = math.exp(10 * rates.mean())
    assert abs(found.end[0] / exact - 1) < 2 * found.doubt + 1e-12
    assert found.doubt < 1e-5


@given(st.floats(0.2, 3.0))
@settings(max_examples=examples(15))
def test_spikes_never_slide_back_and_are_known_as_well(pull: float):
    motion, found = ended(driven(2, SPIKE), 15.0, p={"pull": pull, "spring": 1.0})
    assert found.end[2:].min() >= 0
    assert apart(motion, found) < max(5 * found.doubt, 1e-9)


def test_contacts_that_act_on_one_another_are_of_the_first_order_at_least():
    """Two skids on one light rod that turns: the force of each changes the velocity of both."""
    v, rubbed = ca.SX.sym("v", 2), ca.SX.sym("rubbed", 2)
    t: ca.SX = ca.SX.sym("t")
    inertia = ca.DM([[2.0, 0.6], [0.6, 1.0]])
    ode = ca.solve(ca.SX(inertia), ca.vertcat(ca.cos(t), 1.3 * ca.sin(2 * t)) + rubbed)
    skids = [Contact(f"skid_{i}", v[i], rubbed[i], Coulomb(0.3, 0.5)) for i in range(2)]
    model = Model("rod", x=[Signal("v", v, value=0.0)], ode=ode, t=t, contacts=skids)
    motion, found = ended(model, 12.0, 1e-6)
    assert len(motion.events) > 5
    assert apart(motion, found) < max(2 * found.doubt, 1e-9) < 1e-3


def test_long_steps_that_are_not_stable_are_halved_until_they_are():
    x: ca.SX = ca.SX.sym("x")
    model = Model("stiff", x=[Signal("x", x, value=1.0)], ode=-1e4 * (x - 1) - 1)
    motion = simulate(model, 20.0)
    found = ending(motion, np.array([1.0]), 1e-8)
    assert found.n_steps > 1e5
    assert found.end == pytest.approx([1 - 1e-4], abs=1e-8)


def test_a_limit_on_steps_leaves_the_doubt():
    motion = simulate(driven(), 20.0)
    found = ending(motion, np.zeros(2), 1e-14, most_steps=5000)
    assert found.n_steps <= 5000
    assert found.doubt > 1e-8
    assert apart(motion, found) < 5 * found.doubt


def test_a_motion_that_is_not_of_its_model_is_noticed():
    """Friction that differs by a hundred-thousandth."""
    motion = simulate(driven(), 20.0)
    check = cross_check(driven(), motion, Tolerance(), recheck="independent", report=silent)
    assert check
    assert check.error is not None
    assert check.error < check.accepted
    spoilt = replace(motion, p=np.array([0.4 * (1 + 1e-5), *motion.p[1:]]))
    check = cross_check(driven(), spoilt, Tolerance(), recheck="independent", report=silent)
    assert check
    assert check.error is not None
    assert check.error > 10 * check.accepted


def test_switches_are_passed_within_their_step():
    """A mass is thrown back by walls at -1 and 1, so that it follows a triangle wave."""
    x, v = ca.SX.sym("x"), ca.SX.sym("v")
    turn = Switch("wall", ca.fabs(x) - 1, ca.vertcat(x, -v))
    signals = [Signal("x", x, value=0.0), Signal("v", v, value=1.0)]
    model = Model("thrown", x=signals, ode=ca.vertcat(v, 0), switches=[turn])
    motion = simulate(model, 7.5)
    assert abs(motion.end[0]) == pytest.approx(0.5)
    found = ending(motion, np.array([0.0, 1.0]), 1e-10)
    assert found.end == pytest.approx([-0.5, 1.0], abs=1e-10)


def test_what_steps_without_events_do_not_know_is_refused():
    x: ca.SX = ca.SX.sym("x")
    end = Switch("end", x - 1, x, terminal=True)
    model = Model("ends", x=[Signal("x", x, value=0.0)], ode=ca.SX(1), switches=[end])
    motion = simulate(model, 0.5)
    with pytest.raises(
        ArgumentError, match=r"ends: .* do not support switches that end the motion"
    ):
        ending(motion, np.zeros(1), 1e-6)


@pytest.mark.parametrize(
    ("scene", "shorter"),
    [
        ("stiction", ["time.end=10"]),
        ("spiked_chain", ["time.end=2"]),
        *(
            pytest.param(*each, marks=pytest.mark.slow)
            for each in (
                ("three_masses_harmonic", ["time.periods=10"]),
                ("fig13_magnetic_pair", ["time.end=10", "averaging.nodes=8"]),
            )
        ),
    ],
)
def test_scenes_take_the_route_that_shares_the_model_only(scene: str, shorter: list[str]):
    result = wo.run(wo.load_scene(scene, ['tolerance.recheck="independent"', *shorter]))
    assert result.status == "ok"
    assert "steps without events" in str(dict(result.trust))
