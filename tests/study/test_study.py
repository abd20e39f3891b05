# pyright: reportArgumentType=false, reportCallIssue=false, reportAttributeAccessIssue=false
# pyright: reportRedeclaration=false, reportOptionalMemberAccess=false
# pyright: reportIncompatibleMethodOverride=false
"""The base of studies, with small kinds: what is given, computed, reported, kept and refused."""

from __future__ import annotations

import copy
import json
import multiprocessing
import pickle
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

import hypothesis.strategies as st
import msgspec
import numpy as np
import pytest
from hypothesis import given

import wormopt as wo
from wormopt.cli import main
from wormopt.errors import Fault, Interrupted, SolveError, UnknownNameError, WormoptError
from wormopt.kinds import KINDS, Kind, studies_in
from wormopt.quantities import Scalar
from wormopt.result import Check
from wormopt.study import (
    Given,
    Study,
    array,
    arrays,
    attributes,
    check,
    checks,
    entry,
    facts,
    number,
    parts,
    positive,
    scalar,
    scalars,
    signal,
    stage,
    value,
    warning,
    warnings,
    whole,
)
from wormopt.study.given import RefusedError, plain
from wormopt.study.members import AbsentError, NotComputedError
from wormopt.study.types import FOLDER

CALLS: Counter[str] = Counter()
"""How often each member was computed."""
FAIL: dict[str, BaseException] = {}
"""What members raise, by name."""


def called(name: str) -> None:
    CALLS[name] += 1
    if name in FAIL:
        raise FAIL[name]


@pytest.fixture(autouse=True)
def fresh() -> None:
    CALLS.clear()
    FAIL.clear()


# -- small kinds -----------------------------------------------------------------------------------


class Spring(Given):
    """A spring."""

    stiffness: float = positive("stiffness", "force per elongation", default=100.0)
    length: float = number("length", "length without load", least=0, most=10)
    label: str = entry("what it is called", default="")

    def faults_of_keys(self) -> Iterator[Fault]:
        if self.length > self.stiffness:
            yield "length", f"{self.length:g} is above the stiffness; write less"


class Soft(Given, tag_field="law", tag="soft"):
    """A soft ground."""

    depth: float = positive("length", "depth")


class Hard(Given, tag_field="law", tag="hard"):
    """A hard ground."""


class Chain(Given):
    """Links in a row."""

    links: int = whole(1, 5, "links", default=2)
    mass: float | tuple[float, ...] = positive("mass", "mass of a link", per="links", default=1.0)

    @property
    def counts(self) -> dict[str, int]:
        return {"links": self.links}


@dataclass(frozen=True)
class Pulled:
    """What a pull does."""

    time: np.ndarray = signal("time", "time", "time")
    path: np.ndarray = signal("length", "time", "path of the end")
    reach: float = value("length", "largest path", headline=True)
    sag: float | None = value("length", "sag of the ground", when="ground")
    private: int = 0


class Pull(Study, kind="toy-pull"):
    """Pull at a spring."""

    wanted = ("paths",)

    spring: Spring = entry("the spring")
    chain: Chain = entry("its links", default=Chain)
    more: tuple[Spring, ...] = entry("other springs", default=())
    ground: Soft | Hard | None = entry("below it", default=None)
    force: float = number("force", "force at the end", least=-5, below=5)
    mode: Literal["slow", "fast"] = entry("how it is pulled", default="slow")
    file: str = entry("a file", default="")

    def faults_of_keys(self) -> Iterator[Fault]:
        if self.file and not (self.folder / self.file).is_file():
            yield "file", "there is no such file"

    @stage
    def motion(self) -> np.ndarray:
        called("motion")
        return np.linspace(0.0, self.force / self.spring.stiffness, 3)

    @stage
    def finer_motion(self) -> np.ndarray:
        called("finer_motion")
        return self.motion * (1 + 1e-12)

    @parts(Pulled)
    def pulled(self) -> Pulled:
        called("pulled")
        return Pulled(np.arange(3.0), self.motion, float(self.motion[-1]), None)

    @scalar("energy", "energy of the spring")
    def energy(self) -> float:
        called("energy")
        return self.force * self.reach / 2

    @scalar("share", "a number that nobody knows")
    def unknown(self) -> None:
        return None

    @scalar("length", "depth of the ground", when="ground")
    def depth(self) -> float:
        return self.ground.depth

    @scalar("length", "half of it")
    def half_depth(self) -> float:
        return self.depth / 2

    @scalars({"first": ("force", "first force"), "last": ("force", "last force")})
    def forces(self) -> dict[str, Any]:
        called("forces")
        return {"first": 0.0, "last": self.force, "last.doubled": Scalar(2 * self.force, "N")}

    @arrays({"lengths": ("length", ("link",), "lengths of links")})
    def of_links(self) -> dict[str, Any]:
        called("of_links")
        return {"lengths": np.ones(self.chain.links)}

    @array("force", "time", "force over time", name="force")
    def force_over_time(self) -> np.ndarray:
        return self.finer_motion * self.spring.stiffness

    @check(1e-9, "finer steps change {reach} by {value:.1e}, more than {limit}", "length")
    def grid_error(self) -> float:
        called("grid_error")
        return abs(float(self.finer_motion[-1]) - self.reach)

    @check("spring.length", "{value} is longer than {spring.length}; lower {force}", "length")
    def overstretched(self) -> float:
        return self.reach

    @checks
    def own(self) -> Iterator[Check]:
        called("own")
        yield Check("sum of forces", 0.0, 1e-9, "something else pulls")

    @warning(0.5, "{value} is a long way for {spring.length}", "length", neglected=True)
    def far(self) -> float:
        return self.reach

    @warning(0.0, "a warning of nothing")
    def nothing(self) -> None:
        return None

    @warnings
    def words(self) -> Iterator[str]:
        if self.mode == "fast":
            yield "fast is not slow"

    @facts
    def said(self) -> dict[str, Any]:
        return {"law": "Hooke"}

    @attributes
    def drawn(self) -> dict[str, Any]:
        return {"ends": [float(self.motion[0]), float(self.motion[-1])]}


def pull(**changes: Any) -> Pull:
    return Pull(**{"spring": Spring(length=1.0), "force": 2.0, **changes})


def refusal(make: Callable[[], Any]) -> dict[str, str]:
    """What is said by key."""
    with pytest.raises(RefusedError) as caught:
        make()
    return dict(caught.value.faults)


# -- what is given ---------------------------------------------------------------------------------


def test_units_are_read_where_the_study_has_them():
    si = pull(units="SI", spring={"length": "60 mm", "stiffness": "1 N/cm"}, force="-500 mN")
    assert (si.spring.length, si.spring.stiffness, si.force) == (0.06, 100.0, -0.5)
    assert Spring(length="60 mm").length == 0.06
    assert si == pull(units="SI", spring=Spring(length="6 cm"), force=-0.5)
    assert "has a unit in a scene without" in refusal(lambda: pull(force="1 N"))["force"]
    assert "is not a length" in refusal(lambda: Spring(length="1 s"))["length"]
    made_so = (Spring(length="1 m"), {"length": "1 m"})
    for spring, key in zip(made_so, ("spring", "spring.length"), strict=True):
        assert refusal(lambda spring=spring: pull(spring=spring)).keys() == {key}
    listed = [Spring(length=1), Spring(length="1 m")]
    assert "made with units" in refusal(lambda: pull(more=listed))["more[1]"]
    nested = pull(units="SI", spring={"length": "1 m"})
    assert nested.has_units
    assert nested.vary(force=1).has_units
    assert not pull().has_units


def test_all_faults_are_found_at_once():
    faults = refusal(
        lambda: Pull(
            spring={"lenght": 1, "stiffness": -1, "length": 11},
            chain={"links": 2.5},
            more=[{"length": 1}, {"length": True}],
            ground={"law": "sofd"},
            force=5,
            mode="slw",
            colour="red",
        )
    )
    assert faults == {
        "spring.lenght": "unknown key; did you mean length?",
        "spring.stiffness": "-1 is not allowed; write a finite number above 0",
        "spring.length": "11 is not allowed; write a number from 0 to 10",
        "chain.links": "2.5 is not allowed; write a whole number from 1 to 5",
        "more[1].length": "true is not allowed; write a number from 0 to 10",
        "ground.law": '"sofd" is not allowed; write "soft" or "hard"',
        "force": "5 is not allowed; write a number from -5 to below 5",
        "mode": '"slw" is not allowed; did you mean "slow"? Else write "slow" or "fast"',
        "colour": "unknown key; allowed here: schema, kind, title, units, want, spring, chain, "
        "more, ground, force, mode, file",
    }
    assert refusal(lambda: Pull(force=1)) == {
        "spring": "missing; write a table with stiffness, length, label"
    }


def test_what_no_single_key_shows_is_refused_with_its_path():
    assert "above the stiffness" in refusal(lambda: Spring(length=2, stiffness=1))["length"]
    wrong = {"length": 2, "stiffness": 1}
    assert refusal(lambda: pull(spring=wrong)).keys() == {"spring.length"}
    assert refusal(lambda: pull(more=[wrong])).keys() == {"more[0].length"}
    assert refusal(lambda: pull(file="none.csv")) == {"file": "there is no such file"}


def test_lists_have_one_entry_for_each_link():
    assert Chain(links=3, mass=[1, 2, 3]).mass == (1.0, 2.0, 3.0)
    assert Chain(links=3, mass=np.ones(3)).mass == (1.0, 1.0, 1.0)
    said = "2 entries for 3 links; write one number for all links, or a list of 3"
    assert refusal(lambda: Chain(links=3, mass=[1, 2])) == {"mass": said}
    assert refusal(lambda: pull(chain={"links": 3, "mass": [1, 2]})) == {"chain.mass": said}
    assert refusal(lambda: Chain(mass=[1, -1])).keys() == {"mass[1]"}
    assert refusal(lambda: Chain(mass=[1, 1e-40])).keys() == {"mass[1]"}


EXTREME = [1e-31, 1e31, float("inf"), float("nan"), -float("inf"), 10**400, 5e-324]


@pytest.mark.parametrize("extreme", EXTREME)
def test_extreme_numbers_are_refused(extreme: float):
    assert refusal(lambda: Spring(length=1.0, stiffness=extreme)).keys() == {"stiffness"}
    assert refusal(lambda: pull(force=extreme)).keys() == {"force"}


HOSTILE = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5) | st.binary()
    | st.sampled_from([object(), {1}, range(3), np.float64(1), np.arange(2), Path("a"), 1j]),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner),
    max_leaves=5,
)  # fmt: skip


@given(st.dictionaries(st.sampled_from([*Pull.__struct_fields__, "x"]), HOSTILE))
def test_whatever_is_given_is_taken_or_refused_by_its_key(tables: dict[str, Any]):
    faults: list[Fault] = []
    try:
        made = pull(**tables)
    except RefusedError as error:
        faults += error.faults
        made = pull()
    assert all(key and words.strip() for key, words in faults)
    assert Pull(**plain(made)) == made
    assert json.loads(made.scene.text)["force"] == made.force


@given(st.floats(-5, 5, exclude_max=True), st.floats(0.0, 10), st.integers(1, 5))
def test_what_was_made_is_equal_by_its_fields_and_changes_by_vary(f: float, n: float, links: int):
    tiny = any(0 < abs(x) < 1e-30 for x in (f, n))
    if tiny:
        return
    made = pull(force=f, spring=Spring(length=n), chain={"links": links})
    assert made == pull(force=f, spring={"length": n}, chain=Chain(links=links))
    assert hash(made) == hash(copy.deepcopy(made))
    assert (
        pull().vary({"force": f, "spring.length": n}, "chain.links=1", {"chain": {"links": links}})
        == made
    )
    assert made.vary() == made
    assert made.vary(mode="fast") != made


def test_vary_is_refused_as_the_constructor_is():
    assert refusal(lambda: pull().vary({"spring.lenght": 1})).keys() == {"spring.lenght"}
    assert refusal(lambda: pull().vary("force")).keys() == {"--set"}
    assert refusal(lambda: pull().vary({"mode.x": 1})).keys() == {"mode.x"}
    with pytest.raises(WormoptError, match="an override is a text"):
        pull().vary([3])


def test_vary_keeps_the_place_and_computes_anew(tmp_path: Path):
    (tmp_path / "a.csv").touch()
    before = FOLDER.set(tmp_path)
    try:
        study = pull(file="a.csv")
    finally:
        FOLDER.reset(before)
    study.placed("mine", tmp_path)
    assert study.reach == 0.02
    varied = study.vary(force=4)
    assert (varied.name, varied.folder, varied.reach) == ("mine", tmp_path, 0.04)
    assert (study.reach, CALLS["motion"]) == (0.02, 2)
    assert pull().folder == Path()
    with pytest.raises(AttributeError):
        study.force = 3


def computed_elsewhere(study: Pull) -> tuple[float, str, bool, int]:
    return study.reach, study.name, "motion" in vars(study), CALLS["motion"]


def test_fields_alone_are_pickled_also_between_processes(tmp_path: Path):
    study = pull(force=1)
    study.placed("mine", tmp_path)
    assert study.result().status == "ok"
    sent = pickle.loads(pickle.dumps(study))
    assert sent == study
    assert (sent.name, sent.folder) == ("mine", tmp_path)
    assert "motion" not in vars(sent)
    assert copy.copy(study).reach == copy.deepcopy(study).reach == study.reach
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        assert pool.apply(computed_elsewhere, (study,)) == (0.01, "mine", True, 1)


# -- what classes may declare ----------------------------------------------------------------------


def test_an_unknown_quantity_is_refused_when_the_class_is_made():
    with pytest.raises(TypeError, match="'weight' is no quantity"):

        class _Key(Given):
            load: float = positive("weight", "load")

    with pytest.raises(TypeError, match="'weight' is no quantity"):
        scalar("weight", "load")
    with pytest.raises(TypeError, match="needs a meaning"):
        scalar("mass", " ")
    with pytest.raises(TypeError, match="dimensions are words"):
        array("mass", "mass,time", "masses")


@pytest.mark.parametrize("words", ["{lenght}", "{spring.lenght}", "{force.x}", "{}", "{0}"])
@pytest.mark.parametrize("decorator", [lambda w: check(1, w), lambda w: warning(1, w)])
def test_advice_about_what_is_not_there_is_refused(decorator: Callable[..., Any], words: str):
    with pytest.raises(TypeError, match="is no member or key"):

        class _Kind(Study):
            spring: Spring = entry("spring")
            force: float = positive("force", "force")

            @decorator(f"lower {words}")
            def found(self) -> float:
                return 1.0


@pytest.mark.parametrize("limit", ["tolerance", "spring.tolerance"])
def test_a_limit_that_is_not_there_is_refused(limit: str):
    with pytest.raises(TypeError, match=f"found names {limit}, which is no member or key"):

        class _Limit(Study):
            spring: Spring = entry("spring")

            @check(limit, "lower it")
            def found(self) -> float:
                return 1.0

    with pytest.raises(TypeError, match="found names cargo, which is no member or key"):

        class _When(Study):
            @scalar("mass", "mass", when="cargo")
            def found(self) -> float:
                return 1.0


def test_names_are_used_once():
    with pytest.raises(TypeError, match=r"_Member\.result is a name of Study"):

        class _Member(Study):
            @scalar("mass", "mass")
            def result(self) -> float:
                return 1.0

    with pytest.raises(TypeError, match=r"_Key\.folder is a name of Study"):

        class _Key(Study):
            folder: str = entry("folder")

    with pytest.raises(TypeError, match=r"_Field\.reach is a key and a member"):

        class _Field(Study):
            reach: float = positive("length", "reach")

            @parts(Pulled)
            def pulled(self) -> Any: ...

    with pytest.raises(TypeError, match=r"_Both\.force is a key and a member"):

        class _Both(Study):
            force: float = positive("force", "force")

            @scalar("force", "force")
            def force(self) -> float: ...  # noqa: F811

    with pytest.raises(TypeError, match=r"_Own\.time is a part of pulled too"):

        class _Own(Study):
            @property
            def time(self) -> Any: ...

            @parts(Pulled)
            def pulled(self) -> Any: ...

    with pytest.raises(TypeError, match=r"_Twice\.time is a part of two members"):

        class _Twice(Study):
            @parts(Pulled)
            def pulled(self) -> Any: ...

            @parts(Pulled)
            def pushed(self) -> Any: ...


def test_a_derived_kind_may_replace_members():
    class Twice(Pull, kind="toy-twice"):
        @scalar("length", "twice the reach", headline=True)
        def reach(self) -> float:
            return 2 * self.pulled.reach

    found = Twice(spring=Spring(length=1), force=2).result()
    assert found.scalars["reach"].value == 0.04
    assert found.kind == "toy-twice"
    assert pull().reach == 0.02


def test_scalars_and_variables_are_declared_for_pages_and_conclusions():
    assert Pull.scalars["reach"] == ("length", "largest path")
    assert Pull.scalars.keys() == {
        "reach", "sag", "energy", "unknown", "depth", "half_depth", "first", "last",
    }  # fmt: skip
    assert Pull.variables.keys() == {"time", "path", "lengths", "force"}
    assert Pull.headline == ("reach",)
    assert Pull.kind == "toy-pull" or Pull(spring={"length": 1}, force=1).kind == "toy-pull"


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
    assert (found.status, found.reason, found.kind, found.scene) == (
        "ok",
        "",
        "toy-pull",
        "toy-pull",
    )
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
    assert any("1.33333 is a long way for 2" in words for words in found.trust["warnings"])
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
    for name in ("motion", "reech", "far", "grid_error", "of_links"):
        with pytest.raises(UnknownNameError, match=f"has no result '{name}'"):
            study[name]
    with pytest.raises(KeyError, match="did you mean 'reach'"):
        study["reech"]


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
    with pytest.raises(UnknownNameError, match="has no result"):
        pull().only("reach", name)
    assert not CALLS


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
    assert (found.status, found.reason) == (
        "failed",
        f"interrupted during {name.replace('_', ' ')}",
    )
    FAIL.clear()
    before = Counter(CALLS)
    whole_result = study.result()
    assert whole_result.status == "ok"
    assert all(CALLS[one] <= before[one] + 1 for one in CALLS)
    assert CALLS[name] == 2
    assert CALLS["motion"] == (2 if name == "motion" else 1)
    assert whole_result.scalars == pull().result().scalars


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


# -- imports on use --------------------------------------------------------------------------------

LATER = """
from __future__ import annotations
import sys
from wormopt.study import on_use


with on_use():
    import colorsys as colours
    from netrc import netrc, NetrcParseError as Invalid
    from sched import scheduler
    from xml import dom
    from email.message import Message
    from email.mime.text import MIMEText as Text
    from no_such_module import nothing
    from html import no_such_name

import tomllib  # as always

HEAVY = {"colorsys", "netrc", "sched", "xml.dom", "email.message", "email.mime.text"}
assert not HEAVY & set(sys.modules), HEAVY & set(sys.modules)

def texts(x: Text) -> bool:
    return isinstance(x, Text)

assert not HEAVY & set(sys.modules)
THIRD = colours.ONE_THIRD  # at module level
assert THIRD * 3 == 1
assert colours is sys.modules["colorsys"]
assert scheduler().empty() and isinstance(scheduler(), scheduler)
assert type(scheduler).__name__ == "type"
assert "netrc" not in sys.modules
assert not issubclass(int, Invalid)
assert not texts(3) and texts(Text("a"))
assert "email.message" in sys.modules  # the other module needs it
assert dom.__name__ == "xml.dom"
failing = (lambda: nothing(), ModuleNotFoundError), (lambda: no_such_name.x, ImportError)
for wrong, error in failing:
    try:
        wrong()
    except error:
        pass
    else:
        raise AssertionError(error)
try:
    class Mine(Message): ...
except TypeError as error:
    assert "Message" in str(error), error
else:
    raise AssertionError
try:
    with on_use():
        import os.path
except ImportError as error:
    assert "from os import" in str(error)
else:
    raise AssertionError
import json.decoder  # the usual import is back
assert json.decoder.__name__ == "json.decoder"
del nothing, no_such_name
print("done")
"""


def test_imports_wait_until_their_names_are_used(tmp_path: Path):
    (tmp_path / "later.py").write_text(LATER, encoding="utf-8")
    code = [sys.executable, "-c", "import later"]
    done = subprocess.run(code, cwd=tmp_path, capture_output=True, text=True)
    assert done.stdout == "done\n", done.stderr


# -- as scenes -------------------------------------------------------------------------------------


def test_kinds_are_found_by_their_class_line(tmp_path: Path):
    folder = tmp_path / "toys"
    folder.mkdir()
    text = 'raise ImportError\nclass Toy(Study, kind="toy-a"):\n    """Compute a toy."""\n'
    (folder / "toy.py").write_text(text, encoding="utf-8")
    ((name, kind),) = studies_in(tmp_path)
    assert (name, kind.summary) == ("toy-a", "compute a toy")
    assert (kind.module, kind.name) == ("wormopt.systems.toys.toy", "Toy")


def test_a_study_is_a_scene_and_a_scene_gives_it_back():
    study = pull(chain={"links": 3, "mass": [1, 2, 3]}, ground=Soft(depth=1))
    raw = json.loads(study.scene.text)
    assert raw["ground"] == {"law": "soft", "depth": 1.0}
    assert Pull(**raw) == study
    assert study.scene.title == "toy-pull"
    assert Pull(**MappingProxyType(raw)) == study
    assert msgspec.structs.asdict(study)["force"] == 2.0


@pytest.fixture
def toy(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A scene of the kind, in a folder that is the current one."""
    monkeypatch.setitem(KINDS, "toy-pull", Kind("pull", "Pull", __name__))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.toml").write_text(
        'schema = 1\nkind = "toy-pull"\nforce = 2\n[spring]\nlength = 1\n', encoding="utf-8"
    )
    return tmp_path / "mine.toml"


def test_load_gives_the_study_of_a_scene(toy: Path):
    study = wo.load("mine.toml", "force=1", spring={"length": 2})
    assert isinstance(study, Pull)
    assert (study.name, study.force, study.spring.length) == ("mine", 1.0, 2.0)
    assert study.reach == 0.01
    assert not CALLS["energy"]
    assert wo.run(study).scalars["reach"].value == 0.01
    assert wo.run(study, "force=4").scalars["reach"].value == 0.04
    assert wo.load(toy).result().scene == "mine"
    with pytest.raises(wo.SceneError, match="force: 9 is not allowed"):
        wo.load(toy, {"force": 9})


@pytest.mark.parametrize("only", ["reach", ("reach",), ["reach"]])
def test_run_computes_some_results_only(toy: Path, only: Any):
    found = wo.run(toy, only=only)
    assert (found.status, found.scalars.keys()) == ("unchecked", {"reach"})
    assert CALLS == {"motion": 1, "pulled": 1}
    with pytest.raises(wo.ArgumentError, match="only must be a name or a list of names, not 3"):
        wo.run(pull().scene, only=3)  # type: ignore[arg-type]
    with pytest.raises(UnknownNameError, match="did you mean 'reach'"):
        wo.run(toy, only="reech")


def test_the_command_computes_some_results_only(toy: Path, capsys: pytest.CaptureFixture[str]):
    assert main(["run", "mine.toml", "--only", "reach, grid error", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["status"], found["scalars"].keys()) == ("unchecked", {"reach"})
    assert found["trust"]["checks"].keys() == {"grid error"}
    (folder,) = (toy.parent / "results").iterdir()
    assert folder.name == "mine,only=reach_grid_error"
    assert {path.name for path in folder.iterdir()} == {"result.nc", "summary.json"}
    assert wo.Result.load(folder).scalars["reach"].value == 0.02
    assert main(["run", "mine.toml", "--only", "overstretched", "--set", "spring.length=0.01"]) == 3
    assert "reach" not in capsys.readouterr().out


@pytest.mark.parametrize(
    ("scene", "only", "said"),
    [
        ("mine.toml", "reech", "has no result 'reech'; did you mean 'reach'? It has 'energy'"),
        ("mine.toml", "reach,", "has no result ''"),
        ("mine.toml", "", "has no result ''"),
        ("mine.toml", "depth", "there is no depth without ground"),
    ],
)
def test_the_command_refuses_other_names(
    toy: Path, capsys: pytest.CaptureFixture[str], scene: str, only: str, said: str
):
    assert main(["run", scene, "--only", only]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert said in err
    assert not [*toy.parent.glob("results/*")]
    assert not CALLS
