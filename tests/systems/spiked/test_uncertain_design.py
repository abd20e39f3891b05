"""Gaits on measured numbers: their worst case against scipy's crawler, and on drawn worms."""

import numpy as np
import pytest

import wormopt as wo
from tests.oracles.by_crawling import Crawler, FastGait
from tests.stress import judge_fit
from wormopt.errors import ArgumentError, SolveError
from wormopt.systems.spiked import Believed, Search, design_believed
from wormopt.systems.spiked.design.uncertain import needed_widths

LIMITS = wo.Limits(period=1.0, length=(0.7, 1.3), rate=1.0, acceleration=20.0, spike_load=27.0)
NUMBERS = np.array([1.1, 0.9, 1.3, 0.5, 5.3])
ORDER = Search(sequence=((0,), (2,), (1,)), workers=1)


def believed(spread: float, seed: int = 0) -> Believed:
    shape = np.random.default_rng(seed).normal(size=(5, 5))
    covariance = spread**2 * (shape @ shape.T + np.eye(5)) / 5
    return Believed.of_one_load(tuple(NUMBERS[:3]), NUMBERS[3], NUMBERS[4], covariance)


def forces_of(numbers: np.ndarray, times: np.ndarray, what: str) -> np.ndarray:
    """Forces (rows, m) of scipy's worm under gait (15) while none of it glides."""
    worm = Crawler(FastGait(2.0), numbers[:3], numbers[3], numbers[4])
    found = [worm.forces(t, 0.0, worm.gait.third(t)) for t in times]
    return (
        np.array([f for f, _ in found]).T
        if what == "actuators"
        else np.array([[s for _, s in found]])
    )


@pytest.mark.parametrize(
    ("what", "limit"), [("total", {"spike_load": 1e-3}), ("actuators", {"actuator_force": 1e-3})]
)
def test_the_range_of_loads_is_as_bad_as_the_worst_numbers(what: str, limit: dict):
    """Forces are linear in the numbers: their slopes by differences of another program's forces.

    The limit is so small that it is exceeded at all times, and all of them count.
    """
    known, reach = believed(0.02), 3.0
    gait = wo.fast_gait(2.0, 1.0)
    limits = wo.Limits(period=2.0, length=(0.7, 1.3), rate=1.0, acceleration=20.0, **limit)
    motion = wo.crawl(gait, known.mass, known.drag, NUMBERS[4])
    found = max(needed_widths(motion, known, reach, limits))

    times = (np.arange(150) + 0.5) / 75
    slopes = np.array([
        forces_of(NUMBERS + h, times, what) - forces_of(NUMBERS, times, what)
        for h in 0.01 * np.eye(5)
    ]) / 0.01  # fmt: skip
    off = reach * np.sqrt(np.einsum("pqm,pr,rqm->qm", slopes, known.covariance, slopes))
    worst = (off / np.abs(slopes[-1])).max()
    assert worst <= found <= 1.03 * worst


def test_numbers_within_reach_are_no_worse_than_the_range():
    """The most harmful numbers of the ellipsoid, instant by instant, against a load at its end."""
    known, reach = believed(0.02, seed=3), 4.0
    gait = wo.fast_gait(2.0, 1.0)
    limits = wo.Limits(
        period=2.0, length=(0.7, 1.3), rate=1.0, acceleration=20.0, spike_load=1e-3
    )  # fmt: skip
    motion = wo.crawl(gait, known.mass, known.drag, NUMBERS[4])
    _, width = needed_widths(motion, known, reach, limits)
    at_end = wo.crawl(gait, known.mass, known.drag, NUMBERS[4] + width)
    root = np.linalg.cholesky(known.covariance)
    ways = np.random.default_rng(1).normal(size=(12, 5))
    for way in ways / np.linalg.norm(ways, axis=1)[:, None]:
        other = NUMBERS + reach * root @ way
        assert known.distance(np.append(other, [other[4]] * 2)) == pytest.approx(reach)
        worse = wo.crawl(gait, tuple(other[:3]), other[3], other[4]).extremes("reaction")[1]
        assert np.all(worse <= at_end.extremes("reaction")[1] + 1e-9)


def test_limits_that_the_worst_numbers_keep_need_no_range():
    """Gait (15) loads a spike with at most 23.9 here, and with the worst numbers below 26."""
    known, gait = believed(0.02), wo.fast_gait(2.0, 1.0)
    motion = wo.crawl(gait, known.mass, known.drag, NUMBERS[4])
    limits = wo.Limits(period=2.0, length=(0.7, 1.3), rate=1.0, acceleration=20.0)
    assert needed_widths(motion, known, 3.0, limits.vary(spike_load=26.0)) == (0.0, 0.0)
    below, above = needed_widths(motion, known, 3.0, limits.vary(spike_load=24.0))
    assert below == 0.0 < above


def test_what_is_known_exactly_needs_no_range():
    known = Believed.of_one_load((1.0,) * 3, 0.0, 5.0, np.zeros((5, 5)))
    found = design_believed(known, LIMITS, search=ORDER)
    assert found.widths == (0.0, 0.0)
    assert found.design is found.nominal
    assert found.design.speed == pytest.approx(0.76666667, abs=1e-8)  # benchmark G1 at 27


@pytest.mark.parametrize(
    ("change", "error", "told"),
    [
        (
            {"covariance": np.diag([np.inf, 0, 0, 0, 0])},
            SolveError,
            r"mass\[0\] cannot be identified",
        ),
        ({"covariance": 100.0 * np.eye(5)}, SolveError, "pulled forward"),
        ({"covariance": np.eye(4)}, ArgumentError, "5 by 5"),
    ],
)
def test_what_is_not_known_well_enough_is_refused(change: dict, error: type, told: str):
    given = {"mass": (1.0,) * 3, "drag": 0.0, "load": 5.0} | change

    def attempt() -> None:
        design_believed(Believed.of_one_load(**given), LIMITS, search=ORDER)

    with pytest.raises(error, match=told):
        attempt()


@pytest.mark.slow
def test_designs_on_fits_keep_their_limit_on_the_worm_itself():
    """Six of the draws that `judge_fit.py design 12` makes."""
    lines = [judge_fit.judge_design(seed) for seed in range(6)]
    told = judge_fit.told_of_designs(lines)
    assert told["keep the spike limit"] == told["never glide"] == len(lines)
    assert told["would break it by trusting the fit"] > 0  # so that the range is what keeps it
    shares = [line["speed"] / line["best"] for line in lines]
    assert 0.98 < np.median(shares) < 1.0
