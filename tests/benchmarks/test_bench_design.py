"""Benchmark `design`: its problems are scenes, and its rivals give gaits."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.benchmarks import run
from tests.benchmarks.design import (
    Bound,
    bounds,
    by_design,
    certified_bound,
    described,
    measure_design,
    posed,
)
from tests.benchmarks.design import draw as draw_gaps
from tests.benchmarks.design_cases import G1, Arrays, Case, Motion, draw
from tests.benchmarks.design_rivals import Found, Grid, by_milp, by_multistart, solve_grid
from wormopt.model.gait import Gait
from wormopt.progress import silent
from wormopt.study import load_scene
from wormopt.systems.spiked.crawl import crawl

G1_OPTIMUM = 14 * math.sqrt(1394) / 125 - 839 / 250
ONE_LINK: Case = {
    "name": "one link",
    "worm": {"links": 1, "mass": 1.0, "drag": 0.0, "load": 5.0},
    "gait": G1["gait"],
}
KNOWN = [(G1, G1_OPTIMUM), (ONE_LINK, 0.425)]


# -- problems ------------------------------------------------------------------------------------


def scene_text(case: Case) -> str:
    """A case as the TOML scene a user would write."""
    lines = ["schema = 1", 'kind = "gait-design"', "", "[worm]"]
    lines += [f"{key} = {value}" for key, value in case["worm"].items()]
    lines += ["", "[gait]"]
    for key, value in case["gait"].items():
        if isinstance(value, dict):
            lines += [f"{key}.{part} = {numbers}" for part, numbers in value.items()]
        else:
            lines.append(f"{key} = {value}")
    return "\n".join([*lines, "", "[objective]", 'maximise = "speed"', "", "[search]", "seed = 1"])


def test_problems_of_a_seed_are_always_the_same():
    assert draw(5, 4) == draw(5, 9)[:4]
    assert draw(5, 4) != draw(6, 4)


def test_problems_are_scenes(tmp_path: Path):
    file = tmp_path / "drawn.toml"
    cases = draw(0, 60)
    for case in cases:
        file.write_text(scene_text(case), encoding="utf-8")
        given = load_scene(file).table.gait
        limits = Arrays.of(case)
        assert (given.resting, given.period_range) == (limits.resting, limits.period)
        assert np.array_equal(given.length_ranges(limits.links), limits.length)
        assert np.array_equal(
            given.rate_limits(limits.links), [limits.contraction, limits.extension]
        )
        assert limits.spike_load > limits.static_load
        numbers = np.hstack([np.ravel(v) for v in (limits.length, limits.mass, limits.period)])
        assert np.array_equal(numbers, [float(f"{v:.3g}") for v in numbers])
    kinds: dict[str, set[Any]] = {
        "links": {c["worm"]["links"] for c in cases},
        "resting": {c["gait"]["resting"] for c in cases},
        "rate": {type(c["gait"]["rate"]) for c in cases},
        "period": {type(c["gait"]["period"]) for c in cases},
        "spike_load": {"spike_load" in c["gait"] for c in cases},
    }
    assert kinds["links"] == {2, 3, 4, 5}
    assert kinds["resting"] == {1, 2}
    assert kinds["rate"] == {float, list, dict}
    assert all(len(kinds[key]) == 2 for key in ("period", "spike_load"))


# -- the judge -----------------------------------------------------------------------------------


def accordion() -> Motion:
    """One link that contracts and extends, by hand: rates up to 1, lengths from 0.7 to 1.15."""
    v = np.array([[0, 0], [0, 1], [0, 1], [0, 0], [1, 0], [1, 0]], float)
    return Motion(np.array([0.05, 0.4, 0.05, 0.05, 0.4, 0.05]), v, np.array([1.15]))


def test_the_judge_accepts_what_is_right():
    motion, limits = accordion(), Arrays.of(ONE_LINK)
    assert motion.speed == pytest.approx(0.45)
    # a mass of 1 slows down with 20, and both together are held back with 10 only
    assert motion.excess(limits).pop("sigma") == pytest.approx((20 - 10) * 0.05 / 2)
    rest = {key: value for key, value in motion.excess(limits).items() if key != "sigma"}
    assert max(rest.values()) < 1e-12


@pytest.mark.parametrize(
    ("key", "change"),
    [
        ("length", {"length": [0.75, 1.3]}),
        ("rate", {"rate": 0.9}),
        ("acceleration", {"acceleration": 15.0}),
        ("period", {"period": 1.4}),
        ("spike_load", {"spike_load": 25.0}),
    ],
)
def test_the_judge_finds_what_is_wrong(key: str, change: dict[str, Any]):
    case = {**ONE_LINK, "gait": ONE_LINK["gait"] | change}
    assert accordion().excess(Arrays.of(case))[key] > 1e-3


def test_the_judge_sees_motion_where_rest_is_due_and_the_turn_of_a_length():
    limits = Arrays.of(ONE_LINK)
    both = Motion(np.ones(2) / 2, np.array([[0.0, 0.0], [0.1, 0.1]]), np.ones(1))
    assert both.excess(limits)["resting"] == 1.0
    # at both ends 1.3, in between 1.3 + 0.1
    v = np.array([[0.4, 0.0], [0.0, 0.4], [0.0, 0.0], [0.0, 0.4], [0.4, 0.0], [0.0, 0.0]])
    turning = Motion(np.ones(6), v, np.array([1.3]))
    assert turning.excess(limits)["length"] == pytest.approx(0.1 / 1.3)


# -- rivals --------------------------------------------------------------------------------------


def gait_of(motion: Motion) -> Gait:
    """Link lengths of a motion, without arcs that are hardly there."""
    rate = -np.diff(motion.velocities)
    later = np.roll(rate, -1, axis=0)
    h = motion.durations[:, None]
    lengths = motion.lengths + np.vstack(
        [0 * rate[:1], np.cumsum(h * (rate + later) / 2, axis=0)[:-1]]
    )
    kept = motion.durations > 1e-6 * motion.period
    pieces = np.stack([lengths, rate, (later - rate) / (2 * h)], axis=2)[kept]
    return Gait(np.append(0.0, np.cumsum(motion.durations[kept])), pieces)


def confirm(motion: Motion, case: Case, tolerance: float) -> None:
    """What the worm does with these lengths, by `crawl`, which shares no code with the judge."""
    limits = Arrays.of(case)
    worm = crawl(gait_of(motion), limits.mass.tolist(), limits.drag, limits.load)
    assert worm.speed == pytest.approx(motion.speed, abs=tolerance)
    assert worm.extremes("sigma")[0] >= -1e-3
    lengths = worm.extremes("length")
    assert np.all(lengths[0] >= limits.length[:, 0] - tolerance)
    assert np.all(lengths[1] <= limits.length[:, 1] + tolerance)
    assert np.all(np.abs(worm.extremes("rate")) <= limits.extension + tolerance)
    assert np.all(np.abs(worm.extremes("acceleration")) <= limits.acceleration + 1e-3)


class Enough(Exception):
    """Stops a search that has no end of its own."""


def searched(case: Case, speed: float, phases: tuple[int, ...]) -> list[Found]:
    """Gaits of many starts up to the first that is so fast."""
    found: list[Found] = []

    def tell(better: Found) -> None:
        found.append(better)
        if better.speed > speed:
            raise Enough

    with pytest.raises(Enough):
        by_multistart(case, 60.0, 0, phases, tell)
    return found


@pytest.mark.slow
@pytest.mark.parametrize(("case", "optimum"), KNOWN)
def test_the_mixed_integer_program_gives_gaits(case: Case, optimum: float):
    found: list[Motion] = []
    limits = Arrays.of(case)
    coarse = solve_grid(limits, Grid(10, 1.0), 60.0, found.append)
    assert coarse is not None
    assert coarse.speed == max(motion.speed for motion in found) > 0.8 * optimum
    fine = solve_grid(limits, Grid(20, 1.0), 0.3, found.append, coarse)
    assert fine is not None
    assert coarse.speed - 1e-9 <= fine.speed <= optimum + 1e-9
    for motion in (coarse, fine):
        assert motion.worst(limits) < 1e-6
        confirm(motion, case, 1e-6)


def test_the_mixed_integer_program_tells_better_and_better_gaits():
    found: list[Motion] = []
    course = by_milp(ONE_LINK, 0.5, found.append)
    assert [speed for _, speed in course] == [motion.speed for motion in found]
    assert course == sorted(course)
    assert course[-1][1] <= 0.425 + 1e-9


@pytest.mark.slow
@pytest.mark.parametrize(("case", "optimum"), KNOWN)
def test_many_starts_give_gaits(case: Case, optimum: float):
    best = searched(case, 0.98 * optimum, (2, 3))[-1]
    assert best.speed <= optimum + 1e-8
    assert best.motion.period * best.start.cycles == pytest.approx(1.0)
    confirm(best.motion, case, 1e-5)


def test_the_best_of_many_starts_is_the_last_that_was_told():
    found: list[Found] = []
    by_multistart(ONE_LINK, 0.3, 0, (2,), found.append, 10)
    best = found[-1]
    assert best.start.word == ((0,), (1,))
    assert best.speed <= 0.425 + 1e-8


@pytest.mark.slow
@pytest.mark.parametrize(
    "gait", [{"spike_load": 27.0}, {"resting": 2}, {"period": [0.8, 1.2], "acceleration": 15.0}]
)
def test_rivals_keep_to_other_limits_too(gait: dict[str, Any]):
    case = {"name": "other", "worm": G1["worm"] | {"drag": 0.3}, "gait": G1["gait"] | gait}
    limits = Arrays.of(case)
    by_grid = solve_grid(limits, Grid(8, 1.0), 60.0, lambda motion: None)
    by_starts = searched(case, 0.1, (3,))[-1]
    assert by_grid is not None
    for motion in (by_grid, by_starts.motion):
        assert motion.speed > 0.1
        assert motion.worst(limits) < 1e-6


# -- measuring -----------------------------------------------------------------------------------


def fails(case: Case, seconds: float) -> list[tuple[float, float]]:
    raise RuntimeError("out of order")


def test_times_are_summed_up(tmp_path: Path):
    solvers = {
        "wormopt": lambda case, seconds: [(0.1, 0.999)],
        "slow": lambda case, seconds: [(1.0, 0.5), (4.0, 0.98)],
        "above": lambda case, seconds: [(0.5, 1.1)],
        "broken": fails,
    }
    problems = [G1, {**G1, "name": "long"}]
    proven = {"g1": Bound(1.2, 0.01, 1.2), "long": Bound(1.0, 0.001, 1.05)}
    *_, known = measure_design(problems, 1.0, silent, solvers, lambda c, s: proven[c["name"]])
    assert bounds(known) == {"g1": 1.2, "long": 1.1}
    found = described(known)
    rows = {(r["solver"], r["accuracy"]): r for r in found["reached"]}
    assert (rows["above", 0.1]["share"], rows["above", 0.1]["problems"]) == (1.0, 2)
    assert rows["slow", 0.1]["time_s"] is None
    assert (rows["above", 0.003]["share"], rows["above", 0.003]["problems"]) == (1.0, 1)
    assert [(a.solver, a.problem) for a in known if a.wrong] == [("above", "long")]
    text = run.table({"case": "design", **found, "done": True})
    assert "broken on g1: RuntimeError: out of order" in text
    assert "above on long: speed 1.1 above the ceiling 1.05" in text
    draw_gaps(found, tmp_path / "design.png")
    assert (tmp_path / "design.png").stat().st_size > 10_000


def test_our_designer_tells_better_and_better_gaits():
    course = by_design(ONE_LINK, 1.0)
    assert course == sorted(course)
    assert course[-1][1] == pytest.approx(0.425, abs=1e-8)


def test_the_benchmark_problem_is_among_those_posed():
    few, many = posed(quick=True), posed(quick=False)
    assert few[0] == G1
    assert few == many[: len(few)]


@pytest.mark.slow
def test_bounds_are_certified():
    bound = certified_bound(G1, 3.0)
    assert G1_OPTIMUM <= bound.speed <= 1.03 * G1_OPTIMUM
    assert bound.gap == pytest.approx(bound.speed / G1_OPTIMUM - 1, abs=1e-6)
    assert bound.ceiling == pytest.approx(1.0)
