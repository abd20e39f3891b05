"""Every kind that is a study: a stage that fails or is interrupted leaves a result to read."""

from __future__ import annotations

import json
import pickle
import tomllib
from collections.abc import Callable
from typing import Any

import pytest

import wormopt as wo
from wormopt.cli import main
from wormopt.errors import SolveError
from wormopt.kinds import KINDS
from wormopt.study import Study, packaged_scenes
from wormopt.study.scene import times_of_scenes

QUICK = 2.0
"""Seconds of the quickest scene of a kind, above which tests of the kind are slow."""


def quickest() -> dict[str, tuple[float, str]]:
    """Seconds and name of the quickest packaged scene of each kind."""
    times, found = times_of_scenes(), dict[str, tuple[float, str]]()
    for name, path in packaged_scenes().items():
        kind = tomllib.loads(path.read_text(encoding="utf-8"))["kind"]
        here = (times.get(name, 0.0), name)
        found[kind] = min(here, found.get(kind, here))
    return found


SCENES = {kind: name for kind, (_, name) in quickest().items()}
SLOW = {kind for kind, (seconds, _) in quickest().items() if seconds > QUICK}


def marked(kind: str, *more: str, slow: bool = False) -> Any:
    """Parameters of a test of a kind."""
    marks = [pytest.mark.slow] if slow or kind in SLOW else []
    return pytest.param(kind, *more, marks=marks, id="-".join((kind, *more)))


def stages(kind: str) -> list[str]:
    members = KINDS[kind].load().members.values()
    return [member.name for member in members if member.role == "stage"]


KEPT: dict[tuple[str, str], list[tuple[Any, Any]]] = {}
"""Studies and what their stages gave, by kind and name: each is computed once."""
FAILING = {
    "fails": SolveError("it was made to fail", "nothing helps"),
    "hands over what is no part": SolveError("it was made to fail", partial=object()),
    "needs too much memory": MemoryError(),
    "is interrupted": KeyboardInterrupt(),
}


@pytest.fixture
def study(kind: str, monkeypatch: pytest.MonkeyPatch) -> type[Study]:
    """The class of a kind, whose stages are computed once in all tests."""
    table = KINDS[kind].load()
    for name in stages(kind):
        member = table.members[name]
        monkeypatch.setattr(member, "compute", once(kind, name, member.compute))
    return table


def once(kind: str, name: str, compute: Callable[[Any], Any]) -> Callable[[Any], Any]:
    def kept(study: Any) -> Any:
        known = KEPT.setdefault((kind, name), [])
        for other, value in known:  # a study may vary itself, for a check on a finer grid
            if other == study:
                return value
        known.append((study, compute(study)))
        return known[-1][1]

    return kept


def broken_stages() -> list[Any]:
    """Every stage of every kind, broken in one way; the ways take turns."""
    every = [(kind, stage) for kind in SCENES for stage in stages(kind)]
    ways = list(FAILING)
    return [
        marked(kind, stage, ways[k % 4], slow=k % 9 > 0) for k, (kind, stage) in enumerate(every)
    ]


@pytest.mark.parametrize(("kind", "stage", "how"), broken_stages())
def test_a_stage_that_does_not_end_leaves_a_result(
    study: type[Study],
    kind: str,
    stage: str,
    how: str,
    tmp_path: Any,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    reached: list[str] = []

    def broken(_: Any) -> None:
        reached.append(stage)
        raise FAILING[how]

    monkeypatch.setattr(study.members[stage], "compute", broken)
    code = main(["run", SCENES[kind], "--json", "--quiet", "-o", str(tmp_path / "out")])
    out, err = capsys.readouterr()
    assert "please report this" not in err  # what is said of pictures that fail
    if not reached:
        assert code in (0, 3)
        return
    assert len(reached) == 1
    if how == "is interrupted":
        assert code == 130
        if "nothing saved" in err:
            assert not (tmp_path / "out").exists()
            return
        reason = f"interrupted during {stage.replace('_', ' ')}"
    else:
        assert code == 3
        reason = "out of memory" if how == "needs too much memory" else "it was made to fail"
    found = json.loads(out)
    assert found["status"] == "failed"
    assert reason in found["reason"]
    saved = wo.Result.load(tmp_path / "out")
    assert (saved.status, saved.reason) == ("failed", found["reason"])
    assert saved.scalars.keys() == found["scalars"].keys()


@pytest.mark.parametrize("kind", [marked(kind) for kind in SCENES])
def test_what_results_say_is_found_by_name_and_alone(study: type[Study], kind: str):
    whole = wo.run(SCENES[kind])
    there = {*whole.scalars, *(one.name for one in whole.variables)}
    known = [name for name in whole.scalars if name in study.scalars]
    names = [name for name in study.headline if name in known] or known[:1]
    part = wo.run(SCENES[kind], only=names)
    assert part.status == "unchecked"
    assert {name: part.scalars[name] for name in names} == {
        name: whole.scalars[name] for name in names
    }
    made = wo.load(SCENES[kind])
    for name in there & {*study.scalars} - {"n_runs"}:  # no run is needed for what is kept
        assert json.dumps(wo.Scalar(made[name]).value) == json.dumps(whole.scalars[name].value)
    for name in there & {*study.variables}:
        assert (made[name] == whole[name].values).all() or made[name].dtype.kind == "f"


@pytest.mark.parametrize("kind", SCENES)
def test_studies_travel_between_processes(kind: str):
    made = wo.load(SCENES[kind])
    sent = pickle.loads(pickle.dumps(made))
    assert sent == made == made.vary()
    assert (sent.name, sent.folder) == (made.name, made.folder)
