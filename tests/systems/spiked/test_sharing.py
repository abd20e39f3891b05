"""How resting spikes share their load where each carries only so much: rule, motion, design."""

from itertools import permutations
from typing import Any

import numpy as np
import pytest
from effort import examples
from g1_worm import G1_LIMITS, G1_WORM
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

from wormopt.systems.spiked.construct import block_wave
from wormopt.systems.spiked.crawl import crawl
from wormopt.systems.spiked.design.design import Design, objective_of, sharpened
from wormopt.systems.spiked.design.optimize import design
from wormopt.systems.spiked.gait_problem import (
    Cost,
    GaitProblem,
    Limits,
    Objective,
    Search,
    Worm,
)
from wormopt.systems.spiked.search.trial import Trier
from wormopt.systems.spiked.sharing import share_load

Split = tuple[np.ndarray, float, list[int], np.ndarray, np.ndarray]


@st.composite
def splits(draw: st.DrawFn) -> Split:
    """Random forces, total, resting masses, caps that suffice (some endless), and the split."""
    random = np.random.default_rng(draw(st.integers(0, 10**6)))
    links = draw(st.integers(1, 8))
    count = int(random.integers(2, links + 2))
    resting = sorted(random.choice(links + 1, count, replace=False).tolist())
    total = float(random.uniform(0.01, 20))
    unloaded = np.append(random.normal(0, 8, links), -total)
    most = random.uniform(0, 1, links + 1)
    most *= total * random.uniform(1, 3) / most[resting].sum()
    most[random.uniform(size=links + 1) < random.choice([0.1, 1.0], p=[0.8, 0.2])] = np.inf
    loads = share_load(np.array([total]), unloaded[:, None], resting, "least_actuation", most)
    return unloaded, total, resting, most, loads.ravel()


@settings(max_examples=examples(300))
@given(split=splits())
def test_no_shift_of_load_between_spikes_makes_actuation_less(split: Split):
    """Shifts from one spike to another span all feasible directions of a convex problem."""
    unloaded, total, resting, most, loads = split
    scale = total + np.abs(unloaded).max()
    assert loads.sum() == pytest.approx(total, rel=1e-12)
    assert loads.min() >= -1e-13 * scale
    assert np.all(loads <= most + 1e-13 * scale)
    assert np.delete(loads, resting) == pytest.approx(0.0, abs=0.0)
    force = (unloaded + np.cumsum(loads))[:-1]
    for giver, taker in permutations(resting, 2):
        if loads[giver] > 1e-12 * scale and loads[taker] < most[taker] - 1e-12 * scale:
            low, high = sorted((giver, taker))
            slope = force[low:high].sum() * (1.0 if taker == low else -1.0)
            assert slope >= -1e-11 * scale


@settings(max_examples=examples(100))
@given(split=splits())
def test_capped_split_is_the_bounded_least_squares_solution(split: Split):
    """Against a solver for boxes, the sum held by a heavily weighted row."""
    unloaded, total, resting, most, loads = split
    links = len(unloaded) - 1
    carried = np.array([[float(i < j) for i in resting] for j in range(1, links + 1)])
    rows = np.vstack([carried, np.full(len(resting), 1e5)])
    sought = np.append(-unloaded[:-1], 1e5 * total)
    caps = np.maximum(most[resting], 1e-9)
    best = lsq_linear(rows, sought, (0.0, caps), tol=1e-14, method="bvls")
    forces, others = (unloaded[:-1] + carried @ x for x in (loads[resting], best.x))
    assert forces @ forces == pytest.approx(others @ others, rel=1e-5, abs=1e-5)


def test_spikes_that_cannot_carry_it_all_are_overloaded_alike():
    total, unloaded = np.array([9.0, 5.0]), np.array([[-1.0, -1.0]] * 3)
    loads = share_load(total, unloaded, [0, 2], "least_actuation", [2.0, 9.0, 3.0])
    assert loads == pytest.approx(np.array([[4.0, 2.0], [0.0, 0.0], [5.0, 3.0]]))


def test_where_there_is_no_load_no_spike_carries_any():
    """Beside an instant with a load, which goes where it brings the force between down to 0.

    What rounding leaves of no load, below 0, is the last one's.
    """
    unloaded = np.array([[-1.0, -1.0, -1.0], [0.0, -3.0, 0.0]])
    loads = share_load(np.array([0.0, 4.0, -1e-15]), unloaded, [0, 1], "least_actuation")
    assert loads == pytest.approx(np.array([[0.0, 1.0, 0.0], [0.0, 3.0, -1e-15]]), abs=0.0)


def test_capped_loads_in_motion():
    """Caps are kept at all times, moves and sums stay, and more actuation is the price."""
    gait = block_wave(4, 3, 1.0, (0.9, 1.2), "quintic")
    free = crawl(gait, [1.0] * 5, 0.5, 30.0, "least_actuation")
    highest = free.extremes("reaction")[1].max()
    needed = 5 / 3 * free.extremes("reaction_mean")[1].max()
    cap = 0.7 * highest + 0.3 * needed
    held = crawl(gait, [1.0] * 5, 0.5, 30.0, "least_actuation", cap)
    assert needed < cap < highest
    assert held.extremes("reaction")[1].max() == pytest.approx(cap, rel=1e-9)
    assert held.advance == pytest.approx(free.advance, abs=1e-13)
    assert held.integral("reaction").sum() == pytest.approx(free.integral("reaction").sum())
    low, high = held.extremes("closure")
    assert max(-low[0], high[0]) < 1e-9 * cap
    assert held.net_work == pytest.approx(free.net_work, rel=1e-9)
    squares = [
        float((m.sample(2000)["actuator_force"] ** 2).sum(axis=0).mean()) for m in (free, held)
    ]
    assert squares[0] < squares[1]


@pytest.mark.slow
def test_design_may_leave_a_resting_spike_little_load():
    """Both spikes carry 27 at most, by any split: as fast as if only their sum were limited."""
    limits = G1_LIMITS.vary(resting=2, spike_load=27.0, sharing="least_actuation")
    found = design(G1_WORM, limits, search=Search(effort="quick"))
    assert found.speed == pytest.approx(0.275, abs=1e-9)
    assert max(found.violations.values()) < 1e-9
    assert found.motion.extremes("reaction")[1].max() <= 27.0 * (1 + 1e-12)


def actuated(objective: Cost | None = None, **changed: Any) -> Design:
    """Two of three masses rest at any time; least actuation shares the load."""
    limits = G1_LIMITS.vary(**{"resting": 2, "sharing": "least_actuation"} | changed)
    return design(G1_WORM, limits, objective or "speed", speed=0.2 if objective else None)


@pytest.mark.slow
@pytest.mark.parametrize("most", [(16.0, 16.0), (9.0, 20.0)])
def test_design_under_limited_actuators_keeps_to_the_rule(most: tuple[float, float]):
    """The crawl splits in closed form, the program by rows; the mirror image is as fast."""
    found = actuated(actuator_force=most)
    assert max(found.violations.values()) < 1e-9
    assert actuated(actuator_force=most[::-1]).speed == pytest.approx(found.speed, rel=1e-9)
    reached = np.abs(found.motion.extremes("actuator_force")).max(axis=0)
    assert np.max(reached / most) == pytest.approx(1.0, rel=1e-9)


@pytest.mark.slow
def test_limits_on_spikes_and_actuators_together():
    """Weaker spikes move load, and with it actuator forces, and cost speed."""
    found = [actuated(actuator_force=(9.0, 20.0), spike_load=most) for most in (9.0, 10.0, 12.0)]
    for design_, most in zip(found, (9.0, 10.0, 12.0), strict=True):
        assert max(design_.violations.values()) < 1e-9
        assert design_.motion.extremes("reaction")[1].max() == pytest.approx(most, rel=1e-9)
    speeds = [design_.speed for design_ in found]
    # without limits on actuators the first two could be 5/36 and 1/5
    assert speeds == sorted(speeds)
    assert 0.13 < speeds[0] < 5 / 36
    assert 0.19 < speeds[1] < 1 / 5


@pytest.mark.slow
@pytest.mark.parametrize(
    ("cost", "signal"), [("peak_spike_load", "reaction"), ("peak_actuator_force", "actuator_force")]
)
def test_peaks_minimised_are_those_of_the_rule(cost: Cost, signal: str):
    """What the program makes small is what the closed form finds."""
    found = actuated(cost)
    assert max(found.violations.values()) < 1e-9
    assert found.trial is not None
    peak = float(np.abs(found.motion.extremes(signal)).max())
    assert peak == pytest.approx(-found.trial.value, rel=1e-9)
    assert found.speed == pytest.approx(0.2, rel=1e-9)


def test_no_further_mass_rests_where_it_would_raise_the_peak():
    """In the program only two masses rest; a third at rest would take load, and the peak is 6.6."""
    worm = Worm(links=3, load=2.5, drag=1.1)
    limits = Limits(
        period=1.5, length=((0.6, 1.06), (0.6, 1.04), (0.6, 1.22)), rate=1.4, acceleration=10.6,
        resting=2,
    )  # fmt: skip
    task = GaitProblem(worm, limits, Objective.of("peak_actuator_force", 0.362))
    trier = Trier(task)
    free = trier.free(((0, 3), (2, 3), (1, 2)))
    trial = free and trier.fit(free)
    assert trial is not None
    sharp, _, keeps = sharpened(trier, trial, quickly=True)
    assert keeps
    motion = crawl(sharp.gait, worm.masses, worm.drag, worm.loads(2.5), limits.sharing)
    assert objective_of(motion, "peak_actuator_force") == pytest.approx(-sharp.value, rel=1e-6)


@pytest.mark.parametrize("speed", [0.371, 0.392])
def test_the_split_of_a_fast_gait_is_found(speed: float):
    """Durations of the least force with any split suit no split of least actuation."""
    worm = Worm(links=2, drag=37.0, load=6.41)
    limits = Limits(
        period=0.77, length=(0.603, 1.05), rate=1.57, acceleration=30.1, resting=2,
        sharing="least_actuation",
    )  # fmt: skip
    task = GaitProblem(worm, limits, Objective("peak_actuator_force", speed))
    found = Trier(task).near(((0, 1), (1, 2), (0, 2)), np.full(3, 0.77 / 3), 1)
    assert found is not None
    motion = crawl(found.gait, worm.masses, worm.drag, worm.loads(6.41), limits.sharing)
    assert motion.speed >= speed * (1 - 1e-8)
    assert objective_of(motion, "peak_actuator_force") == pytest.approx(found.cost, rel=1e-2)


@pytest.mark.slow
def test_a_gait_is_closed_where_exact_limits_cost_more_than_usual():
    """By the tolerance of the linear programs its value is 1e-7 too high."""
    limits = Limits(
        period=(0.5, 20.0), length=((0.6, 1.14), (0.6, 0.83)), rate=1.4, acceleration=26.7,
        resting=2,
    )  # fmt: skip
    found = design(
        Worm(links=2, load=2.5, drag=0.5), limits, "peak_actuator_force", speed=0.164,
        search=Search(effort="quick", sequence=((0, 2), (1, 2), (0, 1))),
    )  # fmt: skip
    assert max(found.violations.values()) < 1e-9
