"""Benchmarks: their references by a second route, their helpers, a short cut of them."""

import json
import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.benchmarks import CASES, LADDERS, chain_length, ladder, run
from tests.benchmarks.__main__ import main
from tests.benchmarks.cases import GOAL, WORK_PRECISION, mag2_plant, track
from tests.benchmarks.chain_length import long_chain
from tests.benchmarks.ladder import Record, Step, Task, task_of, time_at
from tests.benchmarks.ocp import PEERS, even, measure_ocp
from tests.benchmarks.peers import (
    SOLVERS,
    hand_written,
    thirds,
    track_loops,
    track_rates,
    track_traced,
)
from tests.benchmarks.planar_tasks import TASKS
from tests.oracles.driven_chain import DrivenChain, Grip, linear_flow
from tests.oracles.integrators import Regularised, event_loop
from wormopt.model.gait import Gait
from wormopt.simulation.simulate import simulate

# docs/verification.md
MAG2_END = [68.6821179593, 69.1082146640, -0.1937052220, 0.7347495453]
MAG2_STICKS = [
    (0, 1.302637, 1.309360),
    (1, 2.795280, 3.270012),
    (0, 5.092701, 5.351588),
    (1, 7.344490, 7.451483),
    (0, 9.562752, 9.563212),
]
TRACK14_END = [
    *(13.7293026425339, 12.5129899383629, 11.2234323017047),
    *(1.5442046082437, 1.2147444914821, 0.6496895012235),
    17.0537482219161,
    *(-0.7848014274676, -0.7122939752036),
]


def mag2_chain() -> DrivenChain:
    """Benchmark MAG2 as a driven chain: its drive is a commanded length."""
    eps = 0.036
    drive = Gait(
        np.array([0.0, 1000.0]),
        np.array([[[-eps]]]),
        np.array([math.sqrt(2) + 0.5 * eps]),
        np.array([[-eps]]),
        np.zeros((1, 1)),
    )
    grips = [Grip(0.5 * eps, eps)] * 2
    return DrivenChain(np.ones(2), np.ones(1), np.zeros(1), drive, grips, position=np.zeros(2))


# -- references ----------------------------------------------------------------------------------


def test_the_closed_form_of_two_masses_is_that_of_theory():
    motion = linear_flow(mag2_chain(), 400.0, np.array([400.0]))
    kinds = Counter(happening.kind for happening in motion.happenings)
    assert (sum(kinds.values()), kinds["stick"]) == (369, 5)
    assert motion.end == pytest.approx(MAG2_END, abs=1e-10)
    assert motion.states[:, 0] == pytest.approx(motion.end, abs=1e-12)
    held = [h for h in motion.happenings if h.kind != "reversal"]
    for (mass, start, end), stick, release in zip(MAG2_STICKS, held[::2], held[1::2], strict=True):
        assert (stick.mass, stick.kind, release.kind) == (mass, "stick", "release")
        assert (stick.time, release.time) == pytest.approx((start, end), abs=1e-6)


def test_the_event_loop_finds_the_events_of_two_masses():
    motion = event_loop(mag2_plant(), 400.0, relative=1e-11, max_step=0.2)
    kinds = Counter(happening.kind for happening in motion.happenings)
    assert (sum(kinds.values()), kinds["stick"]) == (369, 5)
    assert motion.end == pytest.approx(MAG2_END, abs=2e-8)


@pytest.mark.compiled
@pytest.mark.parametrize(
    ("name", "span", "end", "error"),
    [("track14", 10.0, TRACK14_END, 1e-11), ("mag2", 400.0, MAG2_END, 2e-9)],
)
def test_hand_written_c_reproduces_references(
    name: str, span: float, end: np.ndarray, error: float
):
    state, steps, evaluations = hand_written(name, span, 1e-12)
    assert state == pytest.approx(end, abs=error)
    assert 11 * steps < evaluations < 20 * steps


@pytest.mark.parametrize("name", ["spiked_chain", "stick_chain"])
def test_references_of_chains_are_those_of_the_closed_form(name: str):
    case = WORK_PRECISION[name]
    assert case.plant is not None
    chain = getattr(case.build, "__self__")  # noqa: B009  the method of a driven chain
    motion = linear_flow(chain, case.span, np.array([case.span]), reach=0.7)
    assert motion.end == pytest.approx(case.reference, abs=1e-10)


@pytest.mark.parametrize("name", [n for n in WORK_PRECISION if not n.startswith("track")])
@pytest.mark.compiled
def test_wormopt_comes_to_the_goal(name: str):
    case = WORK_PRECISION[name]
    assert SOLVERS["wormopt"](case)(1e-13) == pytest.approx(case.reference, abs=GOAL)


def test_a_chain_is_the_same_in_numpy_and_in_closed_form():
    chain = DrivenChain(
        mass=np.array([1.0, 0.7, 1.4]),
        stiffness=np.array([20.0, 30.0]),
        damping=np.array([1.0, 2.0]),
        gait=Gait(np.array([0.0, 0.4, 1.0]), np.array([[[2.0, 0.5], [1.5, 0]], [[1, 0], [2, 0]]])),
        grips=[Grip(0.5, 1.0, 0.8, 2.0), Grip.spike(), Grip(0.2, 0.2)],
        drag=0.3,
    )
    times = np.linspace(0.1, 3.0, 30)
    closed = linear_flow(chain, 3.0, times)
    loop = event_loop(chain.plant(), 3.0, times, relative=1e-12, max_step=0.01)
    assert loop.states == pytest.approx(closed.states, abs=1e-10)
    assert Counter(h.kind for h in loop.happenings) == Counter(h.kind for h in closed.happenings)


def test_event_loops_that_cannot_go_on_say_so():
    with pytest.raises(RuntimeError, match="given up"):
        linear_flow(mag2_chain(), 400.0, np.array([400.0]), max_steps=5)
    with pytest.raises(RuntimeError, match="given up"):
        event_loop(mag2_plant(), 20.0, max_events=3)


@pytest.mark.parametrize("feedback", ["filter", "derivative"])
def test_right_hand_sides_written_by_hand_are_those_of_the_model(feedback):
    smoothed = Regularised(track(feedback), 1 / 40)
    dice = np.random.default_rng(1)
    for piece, (_, _, middle, wave) in zip(smoothed.pieces(2.0), thirds(2.0), strict=True):
        y, t = dice.normal(size=len(smoothed.start)), dice.uniform(piece.start, piece.end)
        expected = np.array(smoothed.function(t, y, piece.values)).ravel()
        traced = track_traced(feedback, list(y), t - piece.start, middle, wave, np)
        for found in (track_rates(feedback)(t, y), track_loops(feedback)(t, y), traced):
            assert np.array(found) == pytest.approx(expected, rel=1e-12, abs=1e-12)


# -- measuring -----------------------------------------------------------------------------------


def test_times_are_interpolated_on_the_front_alone():
    points = [
        {"error": 1e-6, "time_s": 0.1},
        {"error": 1e-5, "time_s": 0.2},  # slower and worse than the first: of no matter
        {"error": 1e-10, "time_s": 0.4},
    ]
    assert time_at(points, 1e-8) == pytest.approx(0.2)
    assert time_at(points, 1e-3) == pytest.approx(0.1)
    assert time_at(points, 1e-12) is None


def test_every_case_has_solvers_and_a_name_on_the_command_line():
    assert set(CASES) == {"chain_length", "ocp", "design", *LADDERS}
    assert {*WORK_PRECISION, *(f"planar_{stop}" for stop in TASKS)} < set(LADDERS)
    for case in WORK_PRECISION.values():
        assert set(case.solvers) <= set(SOLVERS)
        assert {name for target in case.targets for name in target.than} <= set(case.solvers)


def test_long_chains_share_their_compiled_form():
    motion = simulate(long_chain(3), 0.2)
    assert motion.end_time == pytest.approx(0.2)


@pytest.mark.compiled
def test_a_benchmark_is_well_formed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    short = replace(WORK_PRECISION["track14"], solvers=("wormopt", "hand-written C", "heyoka"))
    monkeypatch.setitem(WORK_PRECISION, "track14", short)
    arguments = ["track14", "--quick", "--json", "-o", str(tmp_path / "plots")]
    assert main(arguments) == 0
    found = json.loads(capsys.readouterr().out)
    case = found["cases"]["track14"]
    assert found["machine"]["numpy"] == np.__version__
    assert case["done"]
    solvers = {s["solver"]: s for s in case["solvers"]}
    assert set(solvers) == set(short.solvers)
    for name in ("wormopt", "hand-written C"):
        errors = [p["error"] for p in solvers[name]["points"]]
        assert min(errors) < GOAL < max(errors)
        assert not solvers[name]["failures"]
    assert {target["met"] for target in case["targets"]} <= {True, False, None}
    assert (tmp_path / "plots" / "track14.png").stat().st_size > 10_000
    assert "hand-written C" in run.table(case)


@pytest.mark.slow
def test_chain_lengths_are_told_with_their_slope(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(chain_length, "LENGTHS", (2, 50, 100))
    monkeypatch.chdir(tmp_path)
    assert main(["chain_length", "--quick"]) == 0
    told = capsys.readouterr().out
    assert "smooth: a step costs n^" in told
    assert (tmp_path / "results" / "benchmarks" / "chain_length.png").is_file()


def test_the_smooth_law_tends_to_the_exact_one():
    exact, smooth = (task := task_of("smoothing", quick=True)).ways
    assert task.error(exact.make()(0.0)) < 1e-6
    run, widths = smooth.make(), smooth.settings[2:]
    errors = [task.error(run(width)) for width in widths]
    assert errors == sorted(errors, reverse=True)
    assert 0.8 < np.polyfit(np.log(widths), np.log(errors), 1)[0] < 1.1


def test_averages_split_at_reversals_are_exact_and_sampled_ones_are_not():
    task = task_of("averaging", quick=True)
    errors = {
        way.name: task.error(way.make()(setting))
        for way, setting in zip(task.ways[:2], (16, 8192), strict=True)
    }
    assert errors["wormopt"] < 1e-13
    assert 1e-6 < errors["samples, CasADi"] < 1e-3


@pytest.mark.slow
def test_films_by_all_integrators_come_to_the_same_end():
    task = task_of("film", quick=True)
    errors = {}
    for way in task.ways:
        run = way.make()
        errors |= {(way.name, setting): task.error(run(setting)) for setting in way.settings[:2]}
    assert errors["wormopt", 1e-5] < errors["wormopt", 1e-4] < 1e-2
    assert errors["SciPy Radau", 1e-4] < 1e-5
    for method in ("BDF", "LSODA"):
        assert errors[f"SciPy {method}", 1e-4] < errors[f"SciPy {method}", 1e-3] < 1e-2
    assert "276 cells" in task.title


@pytest.mark.slow
def test_the_slide_is_the_same_program_for_all(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert main(["ocp", "--quick", "--json", "-o", str(tmp_path)]) == 0
    found = json.loads(capsys.readouterr().out)["cases"]["ocp"]
    told = {(t["grid"], t["solver"]): t for t in found["times"]}
    grids = list(dict.fromkeys(grid for grid, _ in told))
    for grid, most in zip(grids, (3e-3, 1e-7), strict=True):
        ours = told[grid, "wormopt"]
        assert abs(ours["error"]) < most
        assert {"nlp_hess_l", "nlp_jac_g"} <= set(ours["functions_s"])
        for peer in ("CasADi SX by hand", "CasADi Opti"):
            assert told[grid, peer]["error"] == pytest.approx(ours["error"], abs=1e-9)
            assert told[grid, peer]["build_s"] > 0
            assert told[grid, peer]["iterations"] > 0
    assert [target["grid"] for target in found["targets"]] == grids
    assert (tmp_path / "ocp.png").is_file()
    assert "solve at most 2 of" in run.table(found)


def test_peers_of_optimal_control_that_are_missing_or_fail_are_told(
    monkeypatch: pytest.MonkeyPatch,
):
    def absent(_):
        raise ImportError("no module", name="fancy")

    def failing(_):
        raise RuntimeError("will not\nat all")

    monkeypatch.setitem(PEERS, "absent", absent)
    monkeypatch.setitem(PEERS, "failing", failing)
    *_, known = measure_ocp([even(4)], 1, lambda *_: None, ("absent", "failing"))
    assert [t["missing"] for t in known] == ["not installed: fancy", "RuntimeError: will not"]
    assert all(t["solve_s"] is None for t in known)


def test_an_interrupted_benchmark_tells_what_it_knows(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    def stopped(task: Task, *_given: Any):
        yield [Record(task.ways[0], first=0.5, steps=[Step(1e-4, 1e-5, [0.1])])]
        raise KeyboardInterrupt

    monkeypatch.setattr(ladder, "measure", stopped)
    assert main(["mag2", "-o", str(tmp_path)]) == 130
    told = capsys.readouterr().out
    assert "unfinished" in told
    assert "wormopt" in told


def test_benchmarks_are_told_by_the_help_and_found_in_any_letter_case(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    asked = []

    def no_time(name: str, **_: Any) -> Iterator[dict[str, Any]]:
        asked.append(name)
        raise KeyboardInterrupt
        yield

    monkeypatch.setattr(run, "bench", no_time)
    assert main(["Track14", "-o", str(tmp_path), "--json"]) == 130
    assert asked == ["track14"]
    with pytest.raises(SystemExit):
        main(["--help"])
    said = capsys.readouterr().out
    assert all(name in said and what in said for name, what in CASES.items())
    assert "ours/theirs" in said


def test_an_unknown_benchmark_is_refused(capsys: pytest.CaptureFixture[str]):
    with pytest.raises(SystemExit, match="2"):
        main(["TRACK99"])
    said = capsys.readouterr().err
    assert "there is no TRACK99; write one of track13, track14" in said


def test_plots_need_a_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    (tmp_path / "taken").write_text("")
    assert main(["mag2", "-o", str(tmp_path / "taken")]) == 2
    assert "cannot be written" in capsys.readouterr().err
