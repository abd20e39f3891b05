"""Readings of figures 5 to 8: trackers that move rest lengths, all readings, what the text says."""

import csv
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from effort import examples
from hypothesis import example, given, settings
from hypothesis import strategies as st
from outcomes import refusals, value
from places import DOCS
from scipy.integrate import solve_ivp
from worms import TRACKED

import wormopt as wo
from tests.oracles.by_hand import fast_gait as gait_by_hand
from wormopt.control.lambda_tracker import Feedback
from wormopt.errors import ArgumentError
from wormopt.model.model import Model, Signal
from wormopt.result import Result
from wormopt.simulation.ensemble import simulate_ensemble
from wormopt.simulation.options import Smooth, Tolerance
from wormopt.simulation.simulate import simulate
from wormopt.study import load_scene
from wormopt.systems.chain.loops import draw_links
from wormopt.systems.chain.readings import (
    SENTENCES,
    Course,
    Example,
    Reading,
    build,
    ends,
    readings,
    reversed_links,
    scenario,
    structure_of,
    supported,
)
from wormopt.systems.chain.tables import Criteria
from wormopt.systems.spiked.construct import accordion, fast_gait

EXAMPLE = Example(
    fast_gait(1.0), np.ones(3), np.full(2, 10.0), np.full(2, 5.0), 0.2, 1.0, np.ones(2)
)
LETTER = Reading((0.0, 2.0, 4.0), 0.0, "force", 1.0, 1.0, (1.0, 10.0), "printed", "printed")
TRACKERS: tuple[Feedback, Feedback] = ("derivative", "filter")


def course(reading: Reading, feedback: Feedback, end: float = 10.0, samples: int = 1001) -> Any:
    of = structure_of(reading, feedback)
    loop = build(EXAMPLE, of)
    herd = simulate_ensemble(
        loop,
        end,
        [scenario(EXAMPLE, reading, of, loop)],
        contact=Smooth(1 / 40),
        times=np.linspace(0.0, end, samples),
        tolerance=Tolerance(1e-10, 1e-11),
    )
    assert herd.codes == ("",)
    return herd.motions[0]


# -- figures found elsewhere -----------------------------------------------------------------------

HEAD_FIRST = replace(LETTER, start=(4.0, 2.0, 0.0), rest_length=2.0)
# Reading: k(5), k(10), largest error in the last two units, for (13) and (14); an independent run.
FOUND = [
    (replace(HEAD_FIRST, input="rest_length"), (1.05, 1.10, 0.38), (1.30, 1.50, 0.63)),
    (
        replace(LETTER, rest_length=2.0, input="rest_length"),
        (3.909, 3.909, 0.14),
        (3.946, 3.946, 0.16),
    ),
    (HEAD_FIRST, (1.57, 2.08, 0.74), (1.65, 2.22, 0.80)),
]


@pytest.mark.parametrize(("reading", "first", "second"), FOUND)
def test_three_readings_are_as_an_independent_run_found_them(
    reading: Reading, first: tuple[float, ...], second: tuple[float, ...]
):
    for feedback, wanted in zip(TRACKERS, (first, second), strict=True):
        motion = course(reading, feedback)
        gain, error = motion["gain"][0], motion["error_norm"][0]
        assert gain[500] == pytest.approx(wanted[0], abs=0.0051)
        assert gain[-1] == pytest.approx(wanted[1], abs=0.0051)
        assert error[800:].max() == pytest.approx(wanted[2], abs=0.0051)


def test_to_the_letter_gains_are_those_of_the_benchmarks():
    """docs/verification.md, TRACK13 and TRACK14 at t = 10."""
    for feedback, known in TRACKED.items():
        assert course(LETTER, feedback)["gain"][0, -1] == pytest.approx(known[6], rel=1e-8)


# -- a reading written out by hand -----------------------------------------------------------------


def by_hand(reading: Reading, feedback: Feedback, end: float) -> np.ndarray:
    """x, v, k and theta at the end, with (10) to (15) typed in as each reading has them."""
    forward, backward = reading.friction
    outer = -1.0 if reading.signs == "turned" else 1.0  # of u
    inner = 1.0 if reading.signs == "printed" else -1.0  # of e in theta'

    def rhs(t: float, y: np.ndarray) -> np.ndarray:
        x, v, k, theta = y[:3], y[3:6], y[6], y[7:]
        wanted, speed = gait_by_hand(t, reading.period)
        if reading.links == "reversed":
            wanted, speed = wanted[::-1], speed[::-1]
        e, e_rate = x[:-1] - x[1:] - wanted, v[:-1] - v[1:] - speed
        k_rate = reading.growth * max(np.hypot(*e) - 0.2, 0.0) ** 2
        theta_rate = -(k**2) * theta + inner * k**2 * e
        if feedback == "derivative":
            u = -(k * e + k_rate * e + k * e_rate)
        else:
            u = -outer * (k * theta + k_rate * theta + k * theta_rate)
        if reading.input == "rest_length":
            # the spring's length without force is moved by u
            u, moved = np.zeros(2), u
        else:
            moved = np.zeros(2)
        moved = moved + (wanted if reading.rest_length is None else reading.rest_length)
        mu = 10 * (e + wanted - moved) + 5 * (e_rate + speed) - u
        net = np.array([-mu[0], mu[0] - mu[1], mu[1]])
        ground = -((forward + backward) / 2 * np.tanh(40 * v) + (forward - backward) / 2)
        return np.concatenate([v, net + ground, [k_rate], theta_rate])

    y, begin = np.concatenate([reading.start, np.zeros(3), [1.0], np.ones(2)]), 0.0
    breaks = np.arange(1, int(3 * end / reading.period) + 1) * reading.period / 3
    for stop in [*breaks[breaks < end - 1e-9], end]:
        # a break lies outside of both pieces by rounding: half a step of nothing
        found = solve_ivp(rhs, (begin + 1e-13, stop - 1e-13), y, "DOP853", rtol=1e-10, atol=1e-11)
        y, begin = found.y[:, -1], stop
    return y


ANY = st.builds(
    Reading,
    start=st.sampled_from([(0.0, 2.0, 4.0), (4.0, 2.0, 0.0), (4.0, 2.5, 0.0)]),
    rest_length=st.sampled_from([0.0, 2.0, 1.3, None]),
    input=st.sampled_from(["force", "rest_length"]),
    growth=st.sampled_from([1.0, 3.0]),
    period=st.sampled_from([1.0, 0.4]),
    friction=st.sampled_from([(1.0, 10.0), (10.0, 1.0), (2.0, 3.0)]),
    links=st.sampled_from(["printed", "reversed"]),
    signs=st.sampled_from(["printed", "turned", "filter"]),
)


@settings(max_examples=examples(15))
@given(reading=ANY, feedback=st.sampled_from(TRACKERS))
@example(replace(LETTER, input="rest_length", growth=3.0, signs="filter"), "filter")
def test_a_reading_moves_as_it_does_by_hand(reading: Reading, feedback: Feedback):
    """Signs, order of links, what u is: as equations typed in by hand have them."""
    end = 0.05  # signs that feed the error back to itself end one motion before t = 0.1
    motion = course(reading, feedback, end, 2)
    wanted = by_hand(reading, feedback, end)
    assert motion.end[:7] == pytest.approx(wanted[:7], rel=1e-7, abs=1e-7)
    if feedback == "filter":
        # our filter is of -theta where the sign of e is turned
        sign = 1.0 if reading.signs == "printed" else -1.0
        assert abs(motion["filter"][:, -1]) == pytest.approx(abs(wanted[7:]), rel=1e-6, abs=1e-7)
        assert sign * motion["filter"][:, 0] == pytest.approx([1.0, 1.0])


@settings(max_examples=examples(10))
@given(reading=ANY, feedback=st.sampled_from(TRACKERS))
def test_mirror_images_have_the_same_errors(reading: Reading, feedback: Feedback):
    """Seen in a mirror forward is back and the first link the last: x_i -> -x_(n-i)."""
    if reading.signs == "filter":  # grows beyond bounds before long
        reading = replace(reading, signs="printed")
    start = tuple(-x for x in reading.start[::-1])
    links = "reversed" if reading.links == "printed" else "printed"
    image = replace(reading, start=start, friction=reading.friction[::-1], links=links)
    one, other = (course(each, feedback, 0.3, 31) for each in (reading, image))
    assert one["error"] == pytest.approx(other["error"][::-1], rel=1e-6, abs=1e-7)
    assert one["gain"] == pytest.approx(other["gain"], rel=1e-7)


def test_readings_are_all_combinations_with_the_letter_first():
    found = readings(
        start=[(0.0, 2.0, 4.0), (4.0, 2.0, 0.0)], rest_length=[0.0, None], input=["force"],
        growth=[1.0], period=[1.0], friction=[(1.0, 10.0)], links=["printed"],
        signs=["printed", "turned", "filter"],
    )  # fmt: skip
    assert len(set(found)) == 12
    assert found[0] == LETTER
    assert [each.signs for each in found[:4]] == ["printed", "turned", "filter", "printed"]


def test_links_are_reversed_with_or_without_a_harmonic():
    times = np.linspace(0.0, 2.0, 41)
    for gait in (fast_gait(0.7), accordion(3, 1.1, (1.0, 2.0), "quintic")):
        assert reversed_links(gait)(times) == pytest.approx(gait(times)[::-1])


# -- actuators -------------------------------------------------------------------------------------


def test_actuators_that_are_not_known_or_have_no_spring_are_refused():
    plant = wo.chain(1, mass=1.0, stiffness=1.0, damping=1.0, rest_length=2.0)
    reference = wo.Reference(ca.SX([2.0]), ca.SX(1, 1), ca.SX(1, 1))
    with pytest.raises(ArgumentError, match="'force', 'rest_length', not 'length'"):
        wo.lambda_tracker(plant, reference, tube_radius=0.1, actuator="length")  # type: ignore[arg-type]
    x, v, u = (ca.SX.sym(name) for name in "xvu")
    states = [Signal("length", x, "length", value=1.0), Signal("rate", v, "speed", value=0.0)]
    bare = Model("a mass", states, ca.vertcat(v, u), [Signal("input", u, "force", value=0.0)])
    with pytest.raises(ArgumentError, match="a mass has 0; write actuator='force'"):
        wo.lambda_tracker(bare, reference, tube_radius=0.1, actuator="rest_length")


# -- what the text says ----------------------------------------------------------------------------

TIME = np.linspace(0.0, 10.0, 1001)
BY = Criteria(strips="outputs", quick=2.0, window=2.0, settled=1e-3, growing=1e-2)


def made(error: Callable[[np.ndarray], Any], gain: Callable[[np.ndarray], Any]) -> Course:
    errors = np.broadcast_to(error(TIME), (2, len(TIME)))
    return Course(TIME, errors, np.broadcast_to(gain(TIME), TIME.shape))


CALM = made(lambda t: np.where(t < 1.0, 1.0, 0.15), lambda t: 2 - np.exp(-8 * t))
ASTRAY = made(lambda t: 0.3 + 0 * t, lambda t: 1 + 0.1 * t)


def test_a_pair_as_the_text_describes_it_supports_every_sentence():
    assert all(supported(CALM, ASTRAY, 0.2, BY).values())
    assert list(supported(CALM, ASTRAY, 0.2, BY)) == list(SENTENCES)


@pytest.mark.parametrize(
    ("first", "second", "by", "missing"),
    [
        (CALM, ASTRAY, BY.vary(quick=0.5), {"quick"}),
        (CALM, ASTRAY, BY.vary(strips="norm"), {"quick"}),  # 0.15 sqrt 2 > 0.2
        (CALM, ASTRAY, BY.vary(strips="both"), {"quick"}),
        (CALM, ASTRAY, BY.vary(growing=0.2), {"growing"}),
        (replace(CALM, gain=ASTRAY.gain), ASTRAY, BY, {"settled"}),
        (CALM, replace(ASTRAY, error=0.6 * ASTRAY.error), BY, {"quick", "open"}),
        (replace(CALM, gain=0 * TIME + 3.0), ASTRAY, BY, {"learning"}),
        (ASTRAY, CALM, BY, {"quick", "open", "settled", "growing", "closer"}),
        (
            CALM,
            made(lambda t: np.where(t < 3, 0.3, np.nan), lambda t: np.where(t < 3, 1 + t, np.nan)),
            BY,
            {"quick", "open", "growing", "closer", "working"},
        ),
    ],
)  # fmt: skip
def test_each_sentence_can_be_missing(
    first: Course, second: Course, by: Criteria, missing: set[str]
):
    said = supported(first, second, 0.2, by)
    assert {name for name, holds in said.items() if not holds} == missing


def test_capture_is_the_last_entry_unless_within_the_window():
    """Errors of 0.3 that end at 4, and again from 7 to 7.5."""
    error = np.where((TIME < 4.0) | ((TIME > 7.0) & (TIME < 7.5)), 0.3, 0.1)
    one = Course(TIME, np.array([error, 0 * error]), 1 + TIME)
    assert one.captured(0.2, "outputs", 2.0) == pytest.approx(7.5, abs=0.011)
    assert np.isnan(one.captured(0.2, "outputs", 3.0))
    assert one.until(601).captured(0.2, "norm", 2.0) == pytest.approx(4.0, abs=0.011)
    assert one.growth(2.0) == pytest.approx(11 / 9 - 1)
    assert one.peak(2.0) == 0.1
    assert one.peak(2.8) == 0.3


def test_the_time_of_capture_is_found_between_samples():
    """0.4 exp(-t / 3) falls to 0.2 at 3 ln 2; its line over a step h is off by h^2 / 24 at most."""
    for count in (101, 1001):
        time = np.linspace(0.0, 10.0, count)
        error = 0.4 * np.exp(-time / 3)
        one = Course(time, np.array([error, -0.1 * error]), 1 + time)
        exact, off = 3 * np.log(2.0), (10 / (count - 1)) ** 2 / 23
        assert one.captured(0.2, "outputs", 2.0) == pytest.approx(exact, abs=off)
        exact += 1.5 * np.log(1.01)
        assert one.captured(0.2, "norm", 2.0) == pytest.approx(exact, abs=off)
    given_up = np.where(TIME < 4.0, 0.3, np.nan)
    assert np.isnan(Course(TIME, np.array([given_up]), TIME).captured(0.2, "norm", 2.0))


def test_ends_are_those_for_which_every_sentence_holds():
    """(14) is captured for good at 6: not seen before, and seen a window after it."""
    second = made(lambda t: np.where(t < 6.0, 0.3, 0.16), lambda t: 1 + 0.1 * np.fmin(t, 6.0))
    found = list(ends(CALM, second, 0.2, BY, 61))
    assert found[0] == pytest.approx(4.0)
    assert found[-1] < 8.0
    assert list(ends(CALM, CALM, 0.2, BY, 9)) == []


# -- scenes ----------------------------------------------------------------------------------------

SMALL = [
    "readings.start=[[0, 2, 4], [4, 2, 0]]",
    'readings.rest_length=[0, "reference"]',
    'readings.input=["force", "rest_length"]',
    "readings.growth=[1]",
    "readings.period=[1]",
    'readings.signs=["printed"]',
]


@pytest.fixture(scope="module")
def small() -> Result:
    return wo.run(load_scene("tracker_readings", [*SMALL, "tolerance.recheck=false"]))


def test_the_scene_finds_the_reading_that_supports_most(small: Result):
    assert small.status == "unchecked"
    assert value(small, "n_readings") == 32
    assert value(small, "most_supported") == 7
    assert value(small, "chosen_departures") == 3
    told = small.attributes["chosen_reading"]
    assert (tuple(told["start"]), told["rest_length"], told["input"]) == (
        (4.0, 2.0, 0.0), None, "rest_length",
    )  # fmt: skip
    checks = small.trust["checks"]
    assert checks["mirror images"]["value"] < 1e-6
    assert value(small, "chosen_gain") == pytest.approx(small["gain"].values[:, -1], rel=1e-7)


def test_files_of_the_scene_say_what_the_result_holds(small: Result, tmp_path: Path):
    small.save(tmp_path)
    with (tmp_path / "readings.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 32
    gains = [[float(row[f"gain_end_{k}"]) for row in rows] for k in (14, 13)]
    assert gains == small["gain_end"].values.tolist()
    said = [[int(row[name]) for name in SENTENCES] for row in rows]
    assert said == small["supported"].values.tolist()
    assert rows[0]["start"] == "0.0 2.0 4.0"
    assert {row["rest_length"] for row in rows} == {"0.0", "reference"}
    table = (tmp_path / "table.md").read_text(encoding="utf-8")
    assert all(f"**{name}**: {what}" in table for name, what in SENTENCES.items())
    lines = [line for line in table.splitlines() if line.startswith("| input | rest_length")]
    assert lines == [f"| input | rest_length | {' | '.join(_shares(small, 2, 1))} |"]


def _shares(result: Result, key: int, entry: int) -> list[str]:
    own = result["reading_choice"].values[:, key] == entry
    said = result["supported"].values[own]
    counts = [*said.sum(axis=0), said.all(axis=1).sum()]
    return [f"{int(count)} / {own.sum()}" for count in counts]


@pytest.mark.slow
def test_what_the_packaged_scene_finds_is_what_the_documentation_says():
    """Every reading that supports all: head in front, springs on the reference, (11)."""
    result = wo.run("tracker_readings")
    assert result.status == "ok"
    assert value(result, "n_readings") == 1440
    said, picks = result["supported"].values, result["reading_choice"].values
    whole = said.all(axis=1)
    assert whole.sum() == value(result, "n_supporting") == 24
    assert set(map(tuple, picks[whole][:, :3].tolist())) == {(1, 2, 1)}
    assert set(picks[whole][:, 4].tolist()) == {0, 1}  # periods 1 and 2
    assert value(result, "chosen_gain") == pytest.approx([1.30743, 1.00279], abs=1e-5)

    page = (DOCS / "readings.md").read_text(encoding="utf-8")
    rows = [[cell.strip() for cell in line.strip("|").split("|")]
            for line in page.splitlines() if re.match(r"\| \(", line)]  # fmt: skip
    assert len(rows) == 12
    for row in rows:
        said_of_row(result, row)


NAMED = {"quick": "quick", "not captured": "open", "converges": "settled", "still grows": "growing"}


def said_of_row(result: Result, row: list[str]) -> None:
    """A row of the documentation against the reading it tells of."""
    entries = [
        ["(0, 2, 4)", "(4, 2, 0)"].index(row[0]),
        ["none", "2", "reference"].index(row[1]),
        ["force", "rest length"].index(row[2]),
    ]
    picks = result["reading_choice"].values
    (k,) = np.flatnonzero((picks == [*entries, 0, 0, 0, 0, 0]).all(axis=1))
    found = {name: result[name].values[::-1, k] for name in  # (13) first
             ("gain_middle", "gain_end", "error_peak", "captured_outputs")}  # fmt: skip
    told = [re.split(r",\s*", cell) for cell in row[3:]]
    for tracker in range(2):
        pairs = zip(told[tracker], ("gain_middle", "gain_end"), strict=True)
        pairs = [*pairs, (told[2][tracker], "error_peak"), (told[3][tracker], "captured_outputs")]
        for text, name in pairs:
            number = found[name][tracker]
            if text == "never":
                assert np.isnan(number), (row, name)
            else:
                digits = len(text.partition(".")[2])
                assert float(text) == pytest.approx(number, abs=0.55 * 10**-digits), (row, name)
    missing = {NAMED[text] for text in told[4] if text != "none"}
    said = dict(zip(result.attributes["sentences"], result["supported"].values[k], strict=True))
    assert {name for name, holds in said.items() if not holds} == missing, row


@pytest.mark.slow
def test_the_scene_as_described_is_the_reading_that_is_found():
    result = wo.run("track_as_described")
    assert result.status == "ok"
    assert value(result, "k_end") == pytest.approx([1.30743, 1.00279], abs=1e-5)
    error = abs(result["length"].values - result["reference"].values).max(axis=1)
    after = result["time"].values > 0.59
    assert error[1, after].max() <= 0.2 < error[0, -200:].max()


test_scenes_that_make_no_sense_are_refused = refusals(
    "tracker_readings",
    f"""
    readings.period=[1, 1] | readings.period | repeats an entry
    readings.start=[[0, 2]] | readings.start[0] | 2 entries for 3 masses
    readings.friction=[[1, 10, 2]] | readings.friction[0] | [F+, F-]
    readings.growth={list(range(1, 300))} | readings | at most 20000
    sentences.window=5 | sentences.window | not below half of time.end = 10
    worm.mass=[1, 1] | worm.mass | 2 entries for 3 masses
    worm.links=3 | reference.gait.shape | 2 links
    tracker.filter_start=[1, 1, 1] | tracker.filter_start | 3 entries for 2 links
    """,
)


def test_a_scene_may_move_rest_lengths():
    """A tracker with input = "rest_length" is one of forces c times as strong."""
    changes = ["start.position=[4.5, 2.2, 0.0]"]
    tables = [f'{{feedback="{f}", tube_radius=0.2, input="rest_length"}}' for f in TRACKERS]
    forces = [table.replace("rest_length", "force") for table in tables]
    rest = [
        simulate(scene.table.loop(k, draw_links(scene.table.worm, 1.0)), 1e-9, times=[0.0])["input"]
        for given in (tables, forces)
        for scene in [load_scene("track_as_described", [*changes, f"tracker=[{','.join(given)}]"])]
        for k in range(2)
    ]
    assert np.array(rest[:2]) == pytest.approx(10.0 * np.array(rest[2:]), rel=1e-12)
    assert all(abs(force).max() > 0.1 for force in rest)
