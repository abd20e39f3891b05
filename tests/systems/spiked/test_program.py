"""The bilinear program of one order of rest, and what designs of it keep, by independent routes."""

import pickle
from functools import cache
from typing import Any

import numpy as np
import pytest
from certified import one_link_speed, one_link_tasks
from effort import examples
from g1_worm import G1, G1_LIMITS, G1_ORDER, G1_WORM
from hypothesis import example, given, reject, settings
from hypothesis import strategies as st
from judged import check

from tests.benchmarks import design_cases, design_rivals
from wormopt.numerics.bilinear import Climb, Point
from wormopt.systems.shared.sequences import lasting
from wormopt.systems.spiked.design.optimize import design
from wormopt.systems.spiked.gait_problem import GaitProblem, Search, Worm
from wormopt.systems.spiked.limits import Limits, Rates
from wormopt.systems.spiked.programs.program import GaitProgram
from wormopt.systems.spiked.search.trial import Trial, Trier


def point(found: Point | None) -> Point:
    assert found is not None
    return found


def parts_of(case: design_cases.Case) -> tuple[Worm, Limits]:
    rate = case["gait"]["rate"]
    rate = Rates(**rate) if isinstance(rate, dict) else rate
    return Worm(**case["worm"]), Limits(**case["gait"] | {"rate": rate})


# -- closed forms ------------------------------------------------------------------------------


@settings(max_examples=examples(25), derandomize=True)
@given(one_link_tasks())
def test_one_link_is_designed_to_its_closed_form(task: Any):
    """Trapezoids by hand; as many strokes a period as are best for them."""
    worm, limits = task.worm, task.limits
    found = design(worm, limits, search=Search(sequence=((0,), (1,)), effort="quick"))

    def speed(cycles: int) -> float:
        return one_link_speed(worm, limits.vary(period=limits.period / cycles))

    assert found.speed == pytest.approx(max(map(speed, range(1, 30))), rel=1e-9)
    assert found.speed == pytest.approx(speed(found.cycles), rel=1e-9)
    assert max(found.violations.values()) <= 1e-9
    assert found.motion.extremes("sigma")[0][0] >= limits.sigma_margin - 1e-9 * worm.load


def test_the_speed_of_one_link_by_hand():
    """Rate 1, up in 1/20, down in 1/10 by the load 2 Gamma / m = 10: half a period less 3/40."""
    found = design(Worm(1, load=5.0), G1_LIMITS)
    assert found.speed == pytest.approx(0.5 - 3 / 40, abs=1e-14)
    assert sorted(found.durations) == pytest.approx([0.5, 0.5], abs=1e-12)
    # up and down without a plateau a stroke takes 0.15 v with v^2 = stroke / 0.075: five of 0.03
    # there and back in a period, and a small one in the time that is left
    short = design(Worm(1, load=5.0), G1_LIMITS.vary(length=(0.7, 0.73)))
    left = 1.0 - 10 * 0.15 * np.sqrt(0.03 / 0.075)
    assert len(short.sequence) * short.cycles == 12
    assert short.speed == pytest.approx(5 * 0.03 + 0.075 * (left / 0.3) ** 2, abs=1e-12)


def test_a_program_that_was_sent_is_laid_out_when_it_is_needed():
    program = GaitProgram(GaitProblem(G1_WORM, G1_LIMITS), G1_ORDER, (0.5, 1.0), 2)
    sent = pickle.loads(pickle.dumps(program))
    assert "rows" not in vars(sent)
    assert np.array_equal(sent.v, program.v)
    assert sent.rows.count == program.rows.count
    assert not hasattr(sent, "row")


def test_g1_is_the_optimum_of_its_program_to_rounding():
    found = design(G1_WORM, G1_LIMITS, search=Search(sequence=G1_ORDER, effort="quick"))
    assert found.speed == pytest.approx(G1, abs=1e-12)
    assert found.solver["violation"] <= 1e-12
    assert max(found.violations.values()) <= 1e-12
    check(found)


# -- arcs halved, vertices sharpened ---------------------------------------------------------------


def climbed(task: GaitProblem, sequence, arcs: int, degree: int) -> tuple[GaitProgram, Point]:
    longest = task.limits.period_range[1]
    program = GaitProgram(task, sequence, (0.2 * longest, longest), arcs, degree)
    start = program.start(np.full(len(sequence), longest / len(sequence)))
    if start is None:
        reject()
    return program, program.bilinear.climb(start, Climb(1e-4, 10))


orders = st.sampled_from([((0,), (2,)), G1_ORDER, ((0,), (1,), (2,)), ((0,), (1,), (0,), (2,))])


@settings(max_examples=examples(20), derandomize=True)
@example(0.203125, 5.0, 0.0, ((0,), (2,), (1,)), 4, 1)  # a length turns next to a joint of arcs
@given(
    st.floats(0.2, 2.0),
    st.floats(5.0, 40.0),
    st.sampled_from([0.0, 0.0, 0.7]),
    orders,
    st.integers(2, 5),
    st.integers(1, 2),
)
def test_halving_the_arcs_never_loses(room, acceleration, drag, sequence, arcs, degree):
    limits = G1_LIMITS.vary(length=(0.7, 0.7 + room), acceleration=acceleration)
    task = GaitProblem(G1_WORM.vary(drag=drag), limits)
    program, found = climbed(task, sequence, arcs, degree)
    for raised in (None, degree + 1):
        finer, start = program.finer(found, raised)
        assert finer.objective(point(start)) >= program.objective(found) * (1 - 1e-8)
        old = program.durations(found)
        brief = 1e-6 * old.sum()  # shorter phases are left out, or join another
        old = np.where(old > brief, old, 0.0)
        kept, durations = lasting(program.sequence, old.tolist())
        assert lasting(finer.sequence, finer.durations(point(start)).tolist()) == (
            kept,
            pytest.approx(durations, abs=brief),
        )
        assert finer.bilinear.violation(point(start).x) <= 1e-8
    trier = Trier(task)
    trial = Trial(program, found)
    assert trier.finer(trial).value >= trial.value


@settings(max_examples=examples(10), derandomize=True)
@given(st.floats(0.3, 1.0), st.floats(8.0, 40.0), orders)
def test_sharpening_ends_at_rounding_and_loses_nothing(room, acceleration, sequence):
    limits = G1_LIMITS.vary(length=(0.7, 0.7 + room), acceleration=acceleration)
    program, found = climbed(GaitProblem(G1_WORM, limits), sequence, 8, 1)
    best = program.bilinear.climb(found, Climb(1e-12, 60))
    sharp, multipliers = program.bilinear.sharpen(best)
    assert sharp.value >= best.value * (1 - 1e-7)
    assert program.bilinear.violation(sharp.x) <= 1e-12
    assert np.all(np.isfinite(multipliers))


# -- rivals and judges -------------------------------------------------------------------------


@cache
def small_cases() -> list[design_cases.Case]:
    """The first random problems of two links without drag."""
    cases = design_cases.draw(2, 40)
    return [c for c in cases if c["worm"]["links"] == 2 and not c["worm"]["drag"]][:3]


@pytest.mark.slow
@pytest.mark.parametrize("index", [0, 1, 2])
def test_an_independent_solver_agrees_on_random_problems(index: int):
    """IPOPT with arcs of its own, from random starts of the same order and number of cycles."""
    case = small_cases()[index]
    worm, limits = parts_of(case)
    found = design(worm, limits, search=Search(effort="quick", workers=1))
    check(found)
    judged = design_cases.Arrays.of(case)
    arcs = max(found.solver["arcs_per_phase"])
    program = design_rivals._Program(judged, len(found.sequence), arcs)
    start = design_rivals.Start(found.sequence, found.cycles)
    random = np.random.default_rng(0)
    motions = [program.solve(start, random) for _ in range(4)]
    kept = [m.speed for m in motions if m is not None and m.worst(judged) <= 1e-7]
    assert kept
    assert max(kept) <= found.speed * (1 + 1e-6)
    assert max(kept) >= found.speed * (1 - 1e-2)  # its arcs are few and its optima local


@pytest.mark.slow
@pytest.mark.parametrize("index", [0, 1])
def test_no_rival_of_any_order_is_faster_on_random_problems(index: int):
    case = small_cases()[index]
    found = design(*parts_of(case))
    *_, (_, speed) = design_rivals.by_multistart(case, 20.0, 0, (2, 3, 4, 5, 6), arcs=10)
    assert speed <= found.speed * (1 + 1e-6)


@pytest.mark.parametrize(
    "seed", [48, 59, *(pytest.param(k, marks=pytest.mark.slow) for k in (0, 7, 16, 18, 20, 39))]
)
def test_every_gait_keeps_its_limits(seed: int):
    """Random problems of two and three links by the judge, by integration and by `crawl`."""
    worm, limits = parts_of(design_cases.draw(seed, 1)[0])
    search = Search(sequence=((0,), (worm.links,)), effort="quick", workers=1)
    check(design(worm, limits, search=search))
