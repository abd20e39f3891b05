"""`wormopt bench` and `wormopt stress`: their references, their judge, a quick cut of both."""

import json
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest

from wormopt import cli
from wormopt.bench import stress
from wormopt.bench.cells import cells
from wormopt.bench.event_loop import event_loop
from wormopt.bench.plants import mag2_plant
from wormopt.bench.stress import judge, summary

# theory.md, benchmark MAG2
MAG2_END = [68.6821179593, 69.1082146640, -0.1937052220, 0.7347495453]


def test_the_event_loop_finds_the_known_events_of_two_masses():
    motion = event_loop(mag2_plant(), 400.0, relative=1e-11, absolute=1e-12, max_step=0.2)
    kinds = Counter(happening.kind for happening in motion.happenings)
    assert sum(kinds.values()) == 369
    assert kinds["stick"] == 5
    assert motion.end == pytest.approx(MAG2_END, abs=2e-8)


def test_the_matrix_is_as_large_as_promised():
    matrix = cells()
    assert len(matrix) >= 450
    assert sum(cell.core for cell in matrix) == 200
    assert len({cell.name for cell in matrix}) == len(matrix)
    assert max(cell.worm.links for cell in matrix) == 100
    widths = {cell.v_reg for cell in matrix if cell.v_reg}
    assert min(widths) <= 1e-7
    assert max(widths) >= 0.1


def test_a_cut_of_the_stress_matrix_has_nothing_wrong():
    cut = [replace(cell, span=min(cell.span, 1.0)) for cell in cells(quick=True)[::8]]
    verdicts = [judge(cell) for cell in cut]
    assert [v for v in verdicts if v.verdict == "wrong"] == []
    assert all(v.verdict == "right" for v in verdicts if v.core)
    found = summary(verdicts)
    assert found["cells"] == len(cut) == sum(found[k] for k in ("right", "refused", "undecided"))


def test_the_judge_sees_a_wrong_motion(monkeypatch: pytest.MonkeyPatch):
    cell = replace(cells(quick=True)[0], span=1.0)
    simulate = stress.simulate

    def wrong(*given, **options):
        motion = simulate(*given, **options)
        return replace(motion, states=motion.states * (1 + 1e-5))

    monkeypatch.setattr(stress, "simulate", wrong)
    assert judge(cell).verdict == "wrong"


@pytest.mark.slow
def test_a_quick_benchmark_is_well_formed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["bench", "track14", "--quick", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert "track14" in json.dumps(found)
    assert list(tmp_path.rglob("*.png"))


def test_an_unknown_benchmark_is_refused(capsys: pytest.CaptureFixture[str]):
    assert cli.main(["bench", "TRACK99"]) == 2
    assert "track14" in capsys.readouterr().err
