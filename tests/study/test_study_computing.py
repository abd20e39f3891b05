# pyright: reportArgumentType=false, reportCallIssue=false, reportAttributeAccessIssue=false
# pyright: reportRedeclaration=false, reportOptionalMemberAccess=false
# pyright: reportIncompatibleMethodOverride=false
"""What studies compute and report, in full and in part, and what they keep of a failure."""

from __future__ import annotations

import signal
from collections import Counter
from contextlib import suppress
from typing import Any

import numpy as np
import pytest
from small_kinds import CALLS, FAIL, Pull, Soft, Spring, called, pull

from wormopt.errors import Interrupted, SolveError, UnknownNameError
from wormopt.quantities import Scalar
from wormopt.study import Study, positive, scalar, scalars, stage
from wormopt.study.members import AbsentError, NotComputedError

pytestmark = pytest.mark.usefixtures("fresh")

# -- computing -------------------------------------------------------------------------------------


def test_a_member_computes_nothing_that_it_does_not_need():
    study = pull()
    assert not CALLS
    assert study.energy == 0.02
    assert CALLS == {"motion": 1, "pulled": 1, "energy": 1}
    assert study.energy == study["energy"] == 2 * study.reach / 2
    assert CALLS["energy"] == 1
    assert isinstance(Pull.energy.meaning, str)


def test_results_hold_each_member_once_with_its_unit():
    study = pull(units="SI", spring=Spring(length=1))
    found = study.result()
    assert (found.status, found.reason) == ("ok", "")
    assert found.kind == found.scene == "toy-pull"
    assert {name: (one.value, one.unit) for name, one in found.scalars.items()} == {
        "energy": (0.02, "J"),
        "unknown": (None, "1"),
        "first": (0.0, "N"),
        "last": (2.0, "N"),
        "last.doubled": (4.0, "N"),
        "reach": (0.02, "m"),
    }
    assert {one.name: (one.dims, one.unit) for one in found.variables} == {
        "lengths": (("link",), "m"),
        "force": (("time",), "N"),
        "time": (("time",), "s"),
        "path": (("time",), "m"),
    }
    assert found.trust["law"] == "Hooke"
    assert [*found.trust["checks"]] == ["grid error", "overstretched", "sum of forces"]
    assert found.attributes == {"ends": [0.0, 0.02]}
    assert {"motion", "finer_motion"} == found.timings_s.keys()
    assert max(CALLS.values()) == 1
    again = study.result()
    assert again.summary() == found.summary()
    assert max(CALLS.values()) == 1


def test_what_is_absent_is_left_out_with_what_needs_it():
    assert pull(ground=None).result().scalars.keys().isdisjoint({"depth", "half_depth", "sag"})
    there = pull(ground=Soft(depth=0.5)).result()
    assert there.scalars["depth"].value == 0.5
    assert there.scalars["half_depth"].value == 0.25
    assert there.scalars["sag"].value is None
    with pytest.raises(AbsentError, match="there is no depth without ground"):
        pull()["depth"]
    with pytest.raises(AbsentError, match="there is no depth without ground"):
        pull().only("depth")


def test_checks_say_what_to_do_with_values_and_units():
    study = pull(units="SI", spring={"length": "1 mm"})
    found = study.result()
    assert found.status == "failed"
    assert found.reason == "0.02 m is longer than 0.001 m; lower 2 N"
    FAIL.clear()
    vars(study)["finer_motion"] = 2 * study.motion
    del vars(study)["grid_error"]
    assert "finer steps change 0.02 m by 2.0e-02 m, more than 1e-09 m" in study.result().reason


def test_warnings_of_what_a_theory_neglects_make_a_result_unchecked():
    found = pull(force=4, spring=Spring(length=2, stiffness=3)).result()
    assert found.status == "unchecked"
    assert any("1.33333 is a long way" in words for words in found.trust["warnings"])
    assert pull(mode="fast").result().trust["warnings"] == ["fast is not slow"]
    odd = pull(units="SI", spring=Spring(length=1, stiffness=1e20)).result()
    assert any("spring.stiffness" in words for words in odd.trust["warnings"])


def test_values_are_found_by_their_names_in_results():
    study = pull()
    assert study["reach"] == 0.02
    assert study["unknown"] is None
    assert study["last"] == 2.0
    assert study["last.doubled"] == 4.0
    assert study["force"].tolist() == (study.finer_motion * 100.0).tolist()
    assert study["lengths"].tolist() == [1.0, 1.0]
    for name in ("motion", "reech", "words", "grid_error", "of_links"):
        with pytest.raises(UnknownNameError, match=f"has no result '{name}'"):
            study[name]
    with pytest.raises(KeyError, match="did you mean 'reach'"):
        study["reech"]


def test_values_that_are_computed_together_are_attributes_too():
    study: Any = pull()
    assert study.last == 2.0
    fresh: Any = pull()
    before = CALLS.copy()
    for name, hint in (("reech", "; did you mean 'reach'"), ("shape", "")):
        with pytest.raises(AttributeError, match=f"has no '{name}'{hint}"):
            getattr(fresh, name)
    assert before == CALLS  # nothing is computed for a name that there is not


def test_an_error_of_a_member_is_not_taken_for_a_missing_name():
    class Broken(Pull, kind="toy-broken"):
        @scalar("length", "what fails")
        def fails(self) -> float:
            return self.force.no_such_thing

    with pytest.raises(AttributeError, match="no_such_thing"):
        _ = Broken(spring={"length": 1}, force=1).fails


def test_names_that_depend_on_the_study_are_found_in_the_groups_that_it_has():
    class Grouped(Study, kind="toy-grouped"):
        """A study of groups."""

        ground: float | None = positive("length", "depth", default=None)

        @scalars({}, when="ground")
        def of_ground(self) -> dict[str, Scalar]:
            return {"depth": Scalar(self.ground, "m")}

        @scalars({})
        def of_links(self) -> dict[str, Scalar]:
            return {"load": Scalar(1.0, "N")}

    assert Grouped()["load"] == 1.0
    assert Grouped(ground=2.0)["depth"] == 2.0
    with pytest.raises(UnknownNameError, match="has no result 'depth'"):
        Grouped()["depth"]
    with pytest.raises(UnknownNameError, match="; write 'of_ground', 'of_links' for names that de"):
        Grouped().only("load")


# -- some results only -----------------------------------------------------------------------------


def test_only_what_is_asked_for_is_computed():
    found = pull().only("reach")
    assert (found.status, found.reason) == ("unchecked", "only some results were computed")
    assert found.scalars.keys() == {"reach"}
    assert found.variables == ()
    assert found.trust["checks_left_out"] == ["grid error", "overstretched", "own"]
    assert CALLS == {"motion": 1, "pulled": 1}
    assert found.timings_s.keys() == {"motion"}


@pytest.mark.parametrize(
    ("asked", "scalars_", "variables_", "checked"),
    [
        (("reach", "path"), {"reach"}, {"path"}, set()),
        (("grid error",), set(), set(), {"grid error"}),
        (("grid_error", "overstretched"), set(), set(), {"grid error", "overstretched"}),
        (("own",), set(), set(), {"sum of forces"}),
        (("last",), {"last", "last.doubled"}, set(), set()),
        (("last.doubled",), {"last.doubled"}, set(), set()),
        (("forces",), {"first", "last", "last.doubled"}, set(), set()),
        (("force",), set(), {"force"}, set()),
        (("of_links", "unknown"), {"unknown"}, {"lengths"}, set()),
    ],
)
def test_only_takes_names_of_scalars_variables_and_checks(
    asked: tuple[str, ...], scalars_: set[str], variables_: set[str], checked: set[str]
):
    found = pull().only(*asked)
    assert found.scalars.keys() == scalars_
    assert {one.name for one in found.variables} == variables_
    assert found.trust["checks"].keys() == checked


@pytest.mark.parametrize("name", ["reech", "motion", "pulled", "far", "said", "", ".", "spring"])
def test_only_refuses_names_that_results_never_have(name: str):
    with pytest.raises(UnknownNameError, match="has no result") as refused:
        pull().only("reach", name)
    assert not CALLS
    assert "'grid_error'" in str(refused.value)
    assert "'forces'" not in str(refused.value)  # a name of the code, not of results


def test_only_fails_where_a_check_that_was_asked_for_fails():
    assert pull(spring={"length": 1e-3}).only("overstretched").status == "failed"


def test_only_never_asks_a_stage_whether_it_was_stopped():
    class Search(Pull, kind="toy-search"):
        @stage
        def search(self) -> str:
            called("search")
            return "time limit"

        @scalar("count", "where it ended")
        def end(self) -> int:
            return len(self.search)

        def stopped(self) -> str:
            return f"stopped by the {self.search}"

    study = Search(spring={"length": 1}, force=1)
    assert study.only("reach").status == "unchecked"
    assert not CALLS["search"]
    with pytest.raises(Interrupted) as caught:
        study.result()
    assert caught.value.partial.status == "failed"
    assert caught.value.partial.reason == "stopped by the time limit"
    assert caught.value.partial.scalars["end"].value == 10


def test_a_study_without_an_answer_keeps_all_that_it_computed():
    class Limit(Pull, kind="toy-limit"):
        @stage
        def largest(self) -> float:
            return 0.5

        @scalar("force", "largest force that holds")
        def holds(self) -> float:
            return self.largest

        def unsolved(self) -> SolveError | None:
            return SolveError("it slips", "write less", code="slips") if self.largest < 1 else None

    study = Limit(spring={"length": 1}, force=1)
    with pytest.raises(SolveError, match="it slips; write less") as caught:
        study.result()
    found = caught.value.partial
    assert (found.status, found.reason, caught.value.code) == ("failed", "it slips", "slips")
    assert found.scalars["holds"].value == 0.5
    assert found.checks
    fresh = Limit(spring={"length": 1}, force=1)
    assert fresh.only("reach").status == "unchecked"  # does not ask for the limit
    with pytest.raises(SolveError, match="it slips"):
        fresh.only("holds")


# -- failure and interruption ----------------------------------------------------------------------

STAGES = ("motion", "finer_motion")

MEMBERS = (*STAGES, "pulled", "energy", "forces", "of_links", "grid_error", "own")


@pytest.mark.parametrize("name", MEMBERS)
def test_what_fails_fails_again_in_the_same_way(name: str):
    study = pull()
    FAIL[name] = SolveError("it broke", "try another", code="broken")
    partials = []
    for _ in range(2):
        with pytest.raises(SolveError, match="it broke; try another") as caught:
            study.result()
        assert caught.value.code == "broken"
        partials.append(caught.value.partial)
    FAIL.clear()
    assert CALLS[name] == 1
    first, second = partials
    assert first.summary() == second.summary()
    assert (first.status, first.reason) == ("failed", "it broke; try another")
    assert "unknown" in first.scalars
    assert ("reach" in first.scalars) == (name not in ("motion", "pulled", "energy"))
    assert ("reach" not in first.scalars) or first.scalars["reach"].value == 0.02
    assert study.vary().result().status == "ok"


def test_what_a_failed_stage_hands_over_is_used_for_arrays_only():
    FAIL["motion"] = SolveError("it broke", partial=np.array([0.0, 1.0, 3.0]))
    with pytest.raises(SolveError) as caught:
        pull().result()
    found = caught.value.partial
    assert found["path"].values.tolist() == [0.0, 1.0, 3.0]
    assert {one.name for one in found.variables} == {"time", "path", "lengths"}
    assert found.scalars.keys() == {"unknown", "first", "last", "last.doubled"}
    assert found.attributes == {"ends": [0.0, 3.0]}
    assert found.trust["warnings"] == []


@pytest.mark.parametrize("partial", [3, "x", object(), np.array([]), np.array([np.nan] * 3)])
def test_a_partial_of_another_type_does_not_hide_the_failure(partial: Any):
    FAIL["motion"] = SolveError("it broke", partial=partial)
    with pytest.raises(SolveError, match="it broke") as caught:
        pull().result()
    assert caught.value.partial.scalars.keys() == {"unknown", "first", "last", "last.doubled"}


@pytest.mark.parametrize("name", MEMBERS)
@pytest.mark.parametrize("stop", [KeyboardInterrupt(), Interrupted(np.zeros(3))])
def test_what_is_interrupted_keeps_what_is_finished_and_goes_on(name: str, stop: BaseException):
    study = pull()
    FAIL[name] = stop
    with pytest.raises(Interrupted) as caught:
        study.result()
    found = caught.value.partial
    assert found.status == "failed"
    assert found.reason == f"interrupted during {name.replace('_', ' ')}"
    FAIL.clear()
    before = Counter(CALLS)
    whole_result = study.result()
    assert whole_result.status == "ok"
    assert all(CALLS[one] <= before[one] + 1 for one in CALLS)
    assert CALLS[name] == 2
    assert CALLS["motion"] == (2 if name == "motion" else 1)
    assert whole_result.scalars == pull().result().scalars


def test_an_interrupt_that_casadi_reports_as_an_error_keeps_what_is_finished():
    class Slow(Study, kind="toy-slow"):
        @stage
        def motion(self) -> float:
            return 2.0

        @stage
        def recheck(self) -> float:
            with suppress(KeyboardInterrupt):
                signal.raise_signal(signal.SIGINT)
            raise RuntimeError("rhs failed")  # what CasADi raises then

        @scalar("length", "way")
        def way(self) -> float:
            return self.motion

        @scalar("length", "error")
        def error(self) -> float:
            return self.recheck

    with pytest.raises(Interrupted) as caught:
        Slow().result()
    found = caught.value.partial
    assert found.reason == "interrupted during recheck"
    assert found.scalars["way"].value == 2.0


def test_an_interruption_that_leaves_nothing_is_one():
    class Empty(Study, kind="toy-empty"):
        @stage
        def motion(self) -> float:
            raise KeyboardInterrupt

        @scalar("length", "way")
        def way(self) -> float:
            return self.motion

    with pytest.raises(KeyboardInterrupt) as caught:
        Empty().result()
    assert type(caught.value) is KeyboardInterrupt


def test_a_partial_study_computes_no_stage():
    closed = pull()._closed(partials=False)
    with pytest.raises(NotComputedError, match="motion was not computed"):
        _ = closed.energy
    assert not CALLS["motion"]


def test_other_errors_are_defects_and_not_hidden():
    FAIL["energy"] = ValueError("a defect")
    with pytest.raises(ValueError, match="a defect"):
        pull().result()


class Outer(Study, kind="toy-outer"):
    """Pull twice."""

    @stage
    def inner(self) -> Pull:
        study = pull()
        study.part_of(self)
        study.result()
        return study

    @scalar("length", "reach of the inner one")
    def reach(self) -> float:
        return self.inner.reach

    @scalar("count", "one")
    def one(self) -> int:
        return 1


def test_a_study_within_a_study_shares_progress_and_times():
    heard: list[str] = []
    found = Outer().result(lambda text, _: heard.append(text))
    assert heard == ["inner", "motion", "finer motion"]
    assert found.timings_s.keys() == {"motion", "finer_motion", "inner"}
    FAIL["finer_motion"] = SolveError("it broke")
    with pytest.raises(SolveError, match="it broke") as caught:
        Outer().result()
    assert caught.value.partial.kind == "toy-outer"
    assert caught.value.partial.scalars.keys() == {"one"}
    FAIL["finer_motion"] = KeyboardInterrupt()
    with pytest.raises(Interrupted) as stopped:
        Outer().result()
    assert stopped.value.partial.reason == "interrupted during inner"


def test_only_the_run_that_asks_for_reports_gets_them():
    heard: list[str] = []
    study = pull()
    study.only("reach", report=lambda text, _: heard.append(text))
    study.result()
    assert heard == ["motion"]
