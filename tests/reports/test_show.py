"""`wormopt show`: numbers by group, limits, trust in three lines; refusals that help."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hints import Capture, Patch
from places import ROOT, SAVED

import wormopt as wo
from wormopt.cli import main
from wormopt.digest import groups, headline, trust
from wormopt.kinds import KINDS
from wormopt.quantities import Scalar, Variable
from wormopt.result import Check, Result


def made(**given: Any) -> Result:
    """A result of a kind that declares nothing."""
    return Result("walk", "mine", title="A walk", **given)


def rows(result: Result) -> dict[str, dict[str, tuple[str, ...]]]:
    """Groups of a result by heading: name, then value and remark."""
    shown = [part for part in groups(result) if part.rows]
    return {part.heading: {row[0]: tuple(row[1:]) for row in part.rows} for part in shown}


def numbers(**values: Any) -> dict[str, Scalar]:
    return {name: Scalar(value) for name, value in values.items()}


def test_what_was_asked_for_comes_first_and_effort_not_at_all():
    found = numbers(a=1, b=2, c=3, d=4, e=5, f=6, n_steps=7, recheck_error=0.0)
    shown = rows(made(scalars=found))
    assert [*shown[""]] == ["a", "b", "c", "d", "e"]
    assert [*shown["Other results"]] == ["f"]


def test_a_kind_says_what_comes_first():
    found = numbers(glides=[], lambda_min=1, speed=2, period=3)
    shown = rows(Result("walk", "gait", scalars=found))
    assert [*shown[""]] == ["speed", "period", "glides"]
    assert [*shown["Other results"]] == ["lambda_min"]
    assert headline(Result("walk", "gait", scalars=found)) == "speed 2, period 3, glides none"


def test_every_kind_names_scalars_that_it_declares():
    tables = [kind.load() for kind in KINDS.values()]
    assert sum(len(table.headline) > 0 for table in tables) >= 10
    for table in tables:
        assert set(table.headline) <= set(table.scalars), table


@pytest.mark.parametrize(("objective", "told"), [(2.0, False), (-2.0, False), (1.5, True)])
def test_an_objective_that_is_another_number_is_not_told_twice(objective: float, told: bool):
    found = numbers(time=2.0, objective=objective, input_rms=3.0)
    shown = rows(Result("block", "slide", scalars=found))
    assert ("objective" in {**shown[""], **shown.get("Other results", {})}) is told


def test_units_stand_behind_values_and_what_is_not_known_is_called_so():
    found = {"speed": Scalar(1 / 3, "m s-1"), "gap": Scalar(None, "m"), "way": Scalar([1, 2], "m")}
    assert rows(made(scalars=found))[""] == {
        "speed": ("0.333333 m s-1", ""),
        "gap": ("unknown", ""),
        "way": ("[1, 2] m", ""),
    }


def test_the_error_of_an_estimate_is_beside_it():
    found = numbers(force=2.0, force_error=0.25, force_interval=[1.5, 2.5], speed=1.0)
    shown = rows(made(scalars=found | numbers(speed_error=0.1)))[""]
    assert shown == {
        "force": ("2", "± 0.25"), "speed": ("1", ""), "speed_error": ("0.1", ""),
    }  # fmt: skip


def test_the_entries_of_lists_are_named():
    error = Variable("error", "1", ("rival", "time"), np.ones((2, 3)))
    result = made(variables=(error,), attributes={"rivals": ["LQR", "tracker"]})
    assert rows(result)[""] == {"rivals": ("[LQR, tracker]", "")}


def test_limits_are_sorted_by_what_they_are_worth():
    known = {"objective": "speed", "name": ["gait.length", "gait.rate", "worm.mass"],
             "value": [1.0, 2.0, 3.0], "unit": ["m", "m s-1", "kg"]}  # fmt: skip
    share = Variable("limit_elasticity", "1", ("limit",), np.array([0.0, 0.25, -0.5]))
    result = made(
        scalars=numbers(speed=1.0, rate_limit=2.0) | {"sensitivity.gait.rate": Scalar(0.125)},
        variables=(share,),
        attributes={"limits": known},
        trust={"violations": {"gait.rate": 0.0}},
    )
    shown = rows(result)
    heading = "Limits, and the effect of 1 % more of each on speed"
    assert list(shown[heading].items()) == [
        ("worm.mass", ("3 kg", "-0.5 %")),
        ("gait.rate", ("2 m s-1", "+0.25 %")),
        ("without effect", ("", "gait.length")),
    ]
    assert shown.keys() == {"", heading}


def test_limits_that_are_reached_are_told_from_those_with_room():
    excess = {"rate": 1e-16, "length": -0.2, "spikes": -1e-9, "force": 0.0, "words": "none"}
    assert rows(made(trust={"violations": excess | {"closed": 1e-17}}))["Limits"] == {
        "reached": ("rate, spikes, force", ""),
        "share to spare": ("length 0.2", ""),
    }


def test_a_limit_is_set_against_the_largest_value():
    found = numbers(turn_rate_max=3.0, turn_rate_limit=4.0, way_limits=[1, 2], spare_limit=1.0)
    assert rows(made(scalars=found))["Limits"] == {
        "turn_rate_limit": ("4", "turn_rate_max is 75 % of it"),
        "way_limits": ("[1, 2]", ""),
        "spare_limit": ("1", ""),
    }


def test_the_derivatives_of_a_design_are_told_in_per_cent():
    """1 % more rate gives the fast gait 0.789 % more speed: 0.651333307 / 0.825666653."""
    quick = ['search.effort="quick"', "search.sequence=[[0],[1],[2]]", "search.workers=1"]
    result = wo.run(wo.load_scene("design_fast_gait", quick))
    limits = next(part for part in groups(result) if part.heading.startswith("Limits"))
    assert ("gait.rate", "1", "+0.789 %") in limits.rows


def test_trust_is_told_in_lines():
    checks = [Check("defect", 2e-10, 1e-9), Check("bound", -9e-8, 1e-7), Check("count", 0, 0)]
    told = {
        "checks": {check.name: check.found() for check in checks},
        "recheck": [{"route": "cvodes", "error": 1e-9}, {"route": "idas", "error": -2e-9}],
        "warnings": ["one thing", "another"],
    }
    assert list(trust(made(trust=told))) == [
        "ok; the worst of 3 checks, bound, is -9e-08, 90 % of the 1e-07 accepted",
        "second route: cvodes, idas, differs by 2e-09",
        "2 warnings:",
        "- one thing",
        "- another",
    ]


@pytest.mark.parametrize(
    ("check", "told"),
    [
        (Check("c", 2.0, 1.0), "c (not passed), is 2, 200 % of the 1 accepted"),
        (Check("c", None, 1.0), "c (not passed), is unknown, where 1 is accepted"),
        (Check("c", 1.0, 0.0), "c (not passed), is 1, where 0 is accepted"),
        (Check("c", 0.9, 1.0, passed=False), "c (not passed), is 0.9, 90 % of the 1 accepted"),
        (Check("c", 0.0, 0.0), "fine, is 0.95, 95 % of the 1 accepted"),
    ],
)
def test_a_check_that_failed_is_the_worst(check: Check, told: str):
    checks = {"fine": Check("fine", 0.95, 1.0).found(), "c": check.found()}
    first = next(trust(made(trust={"checks": checks})))
    assert first == f"ok; the worst of 2 checks, {told}"


def test_a_failure_says_why_and_nothing_to_tell_is_told():
    failed = made().failed("it is wrong")
    assert list(trust(failed)) == ["failed: it is wrong", "no warnings"]
    rechecked = made(scalars=numbers(recheck_speed_error=1e-12), trust={"recheck": {"method": "m"}})
    assert list(trust(rechecked))[1] == "second route: m, speed differs by 1e-12"


@pytest.mark.parametrize("file", sorted(SAVED.glob("*.nc")), ids=lambda file: file.stem)
def test_results_of_all_kinds_are_shown(file: Path, capsys: Capture):
    assert main(["show", str(file)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == Result.load(file).title
    assert len(lines) < 60
    assert max(map(len, lines)) <= 150
    assert main(["show", str(file), "--all"]) == 0
    assert len(capsys.readouterr().out.splitlines()) > len(lines) / 2


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: Patch) -> Path:
    monkeypatch.chdir(tmp_path)
    there = tmp_path / "results" / "walk"
    there.mkdir(parents=True)
    made(scalars=numbers(speed=0.5), trust={"warnings": ["careful"]}).save(there)
    return there


def test_run_prints_what_show_prints(tmp_path: Path, capsys: Capture):
    out = tmp_path / "out"
    for flag in ([], ["--all"]):
        assert main(["run", "fast_gait", "--no-plots", "-o", str(out), "--quiet", *flag]) == 0
        *ran, saved = capsys.readouterr().out.splitlines()
        assert saved == f"Saved in {out}"
        for name in (out, out / "result.nc"):
            assert main(["show", str(name), *flag]) == 0
            assert capsys.readouterr().out.splitlines() == ran
        assert ("Checks:" in ran) is bool(flag)


def test_several_results_and_json(folder: Path, capsys: Capture):
    assert main(["show", "results/walk", "results/walk/result.nc"]) == 0
    expected = "A walk\n  speed  0.5\nTrust:\n  ok\n  1 warning: careful\n"
    assert capsys.readouterr().out == f"{expected}\n{expected}"
    assert main(["show", "--json", "results/walk", "results/walk"]) == 0
    one, again = capsys.readouterr().out.splitlines()
    assert json.loads(one) == json.loads(again) == Result.load(folder).summary()


def test_a_file_of_somebody_else_cannot_steer_the_terminal(tmp_path: Path, capsys: Capture):
    evil = "\x1b[31m\r\x07"
    warned, words = {"warnings": [evil], "recheck": {"route": evil}}, {f"a{evil}": Scalar(evil)}
    Result("walk", "mine", evil, scalars=words, trust=warned, reason=evil).save(tmp_path)
    assert main(["show", str(tmp_path)]) == 0
    assert capsys.readouterr().out.replace("\n", "").isprintable()


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("nowhere", "there is no such folder or file; name a folder of results"),
        ("walk", "there is no such folder or file; did you mean results/walk?"),
        (".", "holds no result.nc; name a folder that `wormopt run` wrote"),
        ("results/walk/summary.json", "is not a result of wormopt, or is damaged"),
    ],
)
def test_what_is_no_result_is_refused(folder: Path, capsys: Capture, name: str, told: str):
    assert main(["show", name, "results/walk"]) == 2
    out, err = capsys.readouterr()
    assert err.startswith(f"{name}: {told}")
    assert err.count("\n") == 1
    assert out.startswith("A walk")  # the others are shown


def test_a_damaged_file_is_refused_wherever_it_is_cut(folder: Path, capsys: Capture):
    file = folder / "result.nc"
    whole = file.read_bytes()
    for size in (0, 1, 4, 40, len(whole) // 3, len(whole) // 2, len(whole) - 8):
        file.write_bytes(whole[:size])
        assert main(["show", str(folder)]) == 2, size
        assert "is not a result of wormopt, or is damaged" in capsys.readouterr().err


def test_pages_show_what_is_printed(capsys: Capture, tmp_path: Path):
    """Lines of the designed gait and of the given one; the size of a rounding error excepted."""
    shown: list[str] = []
    ours = ("  speed  ", "Limits, and", "Trust:", "smallest_load")
    for page in ("README.md", "docs/quickstart.md"):
        text, before = (ROOT / page).read_text(encoding="utf-8"), len(shown)
        blocks = [block for block in text.split("```")[1::2] if block.startswith("\n")]
        own = [block for block in blocks if any(word in block for word in ours)]
        shown += [line for block in own for line in block.splitlines()]
        assert len(shown) > before + 15
    quick = ["--set", "search.sequence=[[0],[1],[2]]", "--set", "search.workers=1"]
    printed = []
    for scene, change in (("design_fast_gait", quick), ("fast_gait", [])):
        out = str(tmp_path / scene)
        assert main(["run", scene, "--no-plots", "--quiet", "-o", out, *change]) == 0
        printed += [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    for line in shown:
        if line and not re.search(r"^ *\.\.\.|^Saved in|checks, |differs by ", line):
            assert " ".join(line.split()) in printed
