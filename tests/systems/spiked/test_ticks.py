"""Gaits for a controller: cycles of whole ticks, what they cost, and tables that repeat."""

import re
from functools import cache
from math import ceil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import wormopt as wo
from wormopt.cli import main
from wormopt.model.gait import Gait
from wormopt.progress import silent
from wormopt.systems.spiked.certify.certified import certify
from wormopt.systems.spiked.construct import gait_of_result
from wormopt.systems.spiked.crawl import crawl
from wormopt.systems.spiked.design.design import Design
from wormopt.systems.spiked.design.optimize import design, designed, ticked
from wormopt.systems.spiked.design.sensitivity import sensitivities
from wormopt.systems.spiked.gait_problem import Cost, GaitProblem, Objective, Search, Worm
from wormopt.systems.spiked.limits import Limits
from wormopt.systems.spiked.verify import in_steps, speed_of

WORM = Worm(links=1, load=5.0)
LONG = Limits(period=(0.3, 1.0), length=(0.6, 1.4), rate=1.0, acceleration=20.0)
SHORT = LONG.vary(length=(0.9, 1.1))  # whole strokes within the period
QUICK = Search(sequence=((0,), (1,)), effort="quick")


def fastest(period: float) -> float:
    """Two masses that rest in turn, strokes ample: theory, see `sensitivities`."""
    return 0.5 - 1 / (2 * period) * (1 / 20 + 1 / 10)


@cache
def free(limits: Limits) -> Design:
    return design(WORM, limits, search=QUICK)


@cache
def at(limits: Limits, thousandths: int) -> Design:
    limits_of_ticks = limits.vary(tick=thousandths / 1000)
    return ticked(GaitProblem(WORM, limits_of_ticks), QUICK, free(limits), silent)


def speed(limits: Limits, thousandths: int) -> float:
    found = at(limits, thousandths)
    assert max(found.violations.values()) < 1e-9
    ticks = round(found.period * 1000 / thousandths)
    assert found.gait.period == pytest.approx(ticks * thousandths / 1000, rel=1e-15)
    assert found.tick_loss == pytest.approx(1 - found.speed / free(limits).speed, abs=1e-12)
    return found.speed


@settings(max_examples=3)
@given(st.integers(20, 1000))
def test_one_link_is_as_fast_as_theory_says_for_the_longest_cycle_of_ticks(tick: int):
    longest = 1000 // tick * tick / 1000
    assert speed(LONG, tick) == pytest.approx(fastest(longest), abs=1e-9)


@settings(max_examples=3)
@given(st.integers(20, 100), st.integers(2, 5))
def test_whole_ticks_cost_little_and_finer_ones_no_more(fine: int, times: int):
    """A slower gait is one: the next longer cycle costs no more than its length."""
    best = free(SHORT)
    assert best.period == pytest.approx(0.2 * 2 + 1 / 20 + 1 / 10)  # two strokes, and turns
    speeds = speed(SHORT, fine), speed(SHORT, fine * times)
    assert best.speed * (1 + 1e-9) >= speeds[0] >= speeds[1] * (1 - 1e-9)
    for tick, found in zip((fine, fine * times), speeds, strict=True):
        longer = ceil(best.period * 1000 / tick) * tick / 1000
        assert found >= best.speed * best.period / longer * (1 - 1e-9)


def test_a_tick_that_the_best_cycle_is_whole_of_costs_nothing():
    found = at(SHORT, 50)  # 11 of them are 0.55
    assert found.gait.period == 0.55
    assert found.tick_loss == pytest.approx(0.0, abs=1e-12)


def test_of_several_cycles_a_period_each_lasts_whole_ticks():
    """A period of 1.1 may be one cycle of 11 ticks, or 11 of one; 0.55 is neither."""
    limits = SHORT.vary(period=1.1)
    assert free(limits).cycles == 2
    found = at(limits, 100)
    assert (found.period, found.cycles) == (1.1, 1)
    assert at(limits, 50).tick_loss == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(
    ("period", "tick", "counts"),
    [(1.0, 0.01, {0.52: (50, 100), 0.25: (25,), 0.3: (25, 50)}),
     ((1.0, 1.1), 0.01, {0.52: (52,), 0.536: (53, 54), 0.7: (55, 100), 5.0: (110,)}),
     ((0.1, 9.0), 0.07, {0.03: (1,), 0.14: (2,), 0.15: (2, 3)})],
)  # fmt: skip
def test_the_next_numbers_of_ticks(
    period: float | tuple[float, float], tick: float, counts: dict[float, tuple[int, ...]]
):
    limits = LONG.vary(period=period, tick=tick)
    assert {near: limits.ticks_of(near) for near in counts} == counts
    low, high = (round(end / tick, 6) for end in limits.period_range)
    for near, chosen in counts.items():  # against all that some number of cycles allows
        every = [
            k for k in range(1, int(high) + 1) if any(low <= n * k <= high for n in range(1, 1000))
        ]
        below = max((k for k in every if k <= near / tick + 1e-6), default=None)
        above = min((k for k in every if k >= near / tick - 1e-6), default=None)
        assert set(chosen) == {below, above} - {None}


@pytest.mark.parametrize(
    "cost", ["peak_spike_load", pytest.param("energy_per_distance", marks=pytest.mark.slow)]
)
def test_costs_are_solved_again_too(cost: Cost):
    task = GaitProblem(WORM, SHORT.vary(tick=0.2), Objective(cost, 0.2))
    found = designed(task, QUICK, silent)
    assert found.period == pytest.approx(0.2 * round(found.period / 0.2), rel=1e-15)
    assert found.speed >= 0.2 * (1 - 1e-9)
    assert max(found.violations.values()) < 1e-8
    assert found.tick_loss > -1e-6


def test_sensitivities_are_those_without_ticks():
    """Derivatives of the closed form at the longest period; moved by 1e-5."""
    found = {one.name: one.derivative for one in sensitivities(at(LONG, 300))}
    assert found["limits.period.longest"] == pytest.approx((1 / 20 + 1 / 10) / 2, rel=1e-4)
    assert found["limits.acceleration"] == pytest.approx(1 / (2 * 20**2), rel=1e-4)


def test_what_is_proven_of_every_gait_holds_for_whole_ticks():
    proof = certify(at(LONG, 300), gap=1e-3, time_limit=20.0)
    assert proof.bound >= fastest(1.0) * (1 - 1e-9)
    assert proof.gap == pytest.approx(proof.bound / fastest(0.9) - 1, abs=1e-9)
    assert proof.design.period == 0.9


SCENE = [
    "worm.links=1",
    "gait.period=[0.3,1.0]",
    "search.sequence=[[0],[1]]",
    'search.effort="quick"',
    "gait.tick=0.03",
]


def test_a_table_at_the_tick_repeats_exactly(tmp_path: Path):
    result = wo.run(wo.load_scene("design_fast_gait", SCENE))
    assert result.status == "ok"
    value = {name: result.scalars[name].value for name in result.scalars}
    assert (value["ticks"], value["period"]) == (33, 0.99)
    assert value["speed"] == pytest.approx(fastest(0.99), abs=1e-9)
    assert value["free_speed"] == pytest.approx(fastest(1.0), abs=1e-9)
    assert value["free_period"] == pytest.approx(1.0)
    assert value["tick_loss"] == pytest.approx(1 - fastest(0.99) / fastest(1.0), abs=1e-8)
    (file,) = wo.export(result, "csv", tmp_path / "a.csv", step=0.03, whole_steps=True)
    text = file.read_text("utf-8")
    assert "instead of" not in text  # the gait as it is
    rows = np.array([[float(x) for x in line.split(",")] for line in text.splitlines()[-34:]])
    assert np.array_equal(rows[0, 1:], rows[-1, 1:])
    assert rows[:, 0].tolist() == [k * 3 / 100 for k in range(34)]
    (file,) = wo.export(result, "ros", tmp_path / "a.yaml", step=0.03, cycles=2)
    places = [line for line in file.read_text("utf-8").splitlines() if "positions: [" in line]
    assert len(places) == 67
    assert places[:34] == places[33:]


@pytest.mark.parametrize(
    ("given", "message"),
    [(["gait.period=1.003", "gait.tick=0.01"],
      "gait.period: 1.003 is no whole number of ticks of gait.tick = 0.01; write 1 or 1.01"),
     (["gait.period=[1.0,1.005]", "gait.tick=0.3"],
      "gait.period: [1, 1.005] contains no whole number of ticks of gait.tick = 0.3; write 0.9 or"),
     (["gait.period=0.5", "gait.tick=0.6"], "0.5 is no whole number of ticks of gait.tick = 0.6; "
      "write 0.6, or another tick"),
     (["gait.tick=1e-9"], "gait.tick: 1e-09 is less than a millionth of gait.period = 1; write at "
      "least 1e-06"),
     (["gait.length_step=0.1"], "gait.length_step: is given without gait.tick; write gait.tick"),
     (["gait.tick=0.1", "gait.length_step=0.7"], "gait.length_step: no two multiples of 0.7 are "
      "within gait.length [0.7, 1.3]; write at most 0.3")],
)  # fmt: skip
def test_what_no_cycle_can_be_is_refused(
    given: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    asked = [part for item in given for part in ("--set", item)]
    assert main(["run", "design_fast_gait", *asked, "--output", str(tmp_path)]) == 2
    assert message in capsys.readouterr().err


@given(st.lists(st.floats(0.65, 1.35), min_size=1, max_size=5), st.integers(1, 300))
def test_lengths_are_the_nearest_multiples_within_their_range(lengths: list[float], step: int):
    """Against all multiples of the range, as decimals."""
    (found,) = in_steps(np.array([lengths]), step / 1000, [(0.65, 1.35)])
    within = [float(f"{k * step}e-3") for k in range(2000) if 650 <= k * step <= 1350]
    for length, rounded in zip(lengths, found.tolist(), strict=True):
        assert rounded in within
        assert abs(rounded - length) <= min(abs(one - length) for one in within) + 1e-15


@settings(max_examples=10)
@given(st.integers(0, 2**32 - 1), st.integers(1, 4), st.integers(2, 6))
def test_a_table_that_goes_straight_is_as_fast_as_the_gait_that_does(
    seed: int, links: int, ticks: int
):
    """The worm crawls with it under a load; it is so light that its jumps of rates do not glide."""
    corners = np.random.default_rng(seed).uniform(0.5, 1.5, (links, ticks))
    table = np.hstack([corners, corners[:, :1]])
    pieces = np.stack([corners, np.diff(table, axis=1) / 0.25], axis=-1)
    gait = Gait(0.25 * np.arange(ticks + 1), pieces.transpose(1, 0, 2))
    motion = crawl(gait, [1e-9] * (links + 1), 0.0, 5.0)
    assert speed_of(table, 0.25 * ticks) == pytest.approx(motion.speed, abs=1e-6)


def test_exported_lengths_are_multiples_of_a_step(tmp_path: Path):
    result = wo.run(wo.load_scene("design_fast_gait", [*SCENE, "gait.length_step=0.05"]))
    assert result.status == "ok"
    (file,) = wo.export(result, "csv", tmp_path / "a.csv", step=0.03, whole_steps=True)
    text = file.read_text("utf-8")
    rows = np.array([[float(x) for x in line.split(",")] for line in text.splitlines()[-34:]])
    assert "# lengths are multiples of 0.05; rates and accelerations are those before" in text
    assert set(rows[:, 1]) <= {float(f"{k * 5}e-2") for k in range(14, 27)}
    gait = gait_of_result(result)
    assert np.abs(rows[:, 1] - gait(rows[:, 0])[0]).max() <= 0.05 / 2 + 1e-12
    assert rows[0, 1] == rows[-1, 1]
    files: list[tuple[str, Any, list[str]]] = [
        ("b.csv", "csv", ["length"]), ("c.yaml", "ros", []),
    ]  # fmt: skip
    for name, kind, columns in files:
        (file,) = wo.export(result, kind, tmp_path / name, step=0.03, columns=columns)
        found = re.findall(r"(?:^[\d.]+,|positions: \[)([\d.]+)", file.read_text("utf-8"), re.M)
        assert [float(one) for one in found] == rows[:, 1].tolist()
    # rates of the table are whole multiples of 0.05 / 0.03, of which the first exceeds the limit
    speed = np.maximum(np.diff(rows[:, 1]), 0.0).sum() / 0.99
    lost = 1 - speed / result.scalars["speed"].value
    assert result.scalars["step_loss"].value == pytest.approx(lost, abs=1e-9)
    assert result.trust["rounded"]["gait.rate"] == pytest.approx(0.05 / 0.03 - 1, abs=1e-9)
    assert any("exceed gait.rate by 0.67 of it" in told for told in result.trust["warnings"])


@pytest.mark.slow
def test_the_fastest_gait_of_whole_ticks_is_a_gait_of_its_speed():
    """The cheapest gait without ticks has a cycle next to which whole ticks are too slow."""
    worm = Worm(links=3, mass=(1.57, 1.27, 1.9, 1.71), load=323.0)
    limits = Limits(
        period=(2.06, 3.68), length=(0.41, 0.53), rate=0.905, acceleration=170.0,
        spike_load=2480.0, tick=0.0736,
    )  # fmt: skip
    quick = Search(effort="quick", workers=1)
    fast = design(worm, limits, search=quick)
    found = design(worm, limits, "peak_spike_load", fast.speed, search=quick)
    assert found.speed >= fast.speed * (1 - 1e-9)


def test_python_has_the_table():
    limits = LONG.vary(tick=0.09, length_step=0.001)
    found = ticked(GaitProblem(WORM, limits), QUICK, free(LONG), silent)
    assert found.table.shape == (1, 12)
    assert np.abs(found.table - found.gait(0.09 * np.arange(12) + 1e-15)).max() <= 0.0005 + 1e-9
    assert abs(found.step_loss) < 0.2
    with pytest.raises(wo.ArgumentError, match=r"limits\.tick is not given"):
        _ = free(LONG).table
