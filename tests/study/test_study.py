# pyright: reportArgumentType=false, reportCallIssue=false, reportAttributeAccessIssue=false
# pyright: reportRedeclaration=false, reportOptionalMemberAccess=false
# pyright: reportIncompatibleMethodOverride=false
"""The base of studies, with small kinds: what is given, declared and refused, and scenes."""

from __future__ import annotations

import copy
import json
import multiprocessing
import pickle
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import MappingProxyType
from typing import Any

import hypothesis.strategies as st
import msgspec
import numpy as np
import pytest
from hints import Capture, Patch
from hypothesis import assume, given
from small_kinds import CALLS, Chain, Pull, Pulled, Soft, Spring, pull

import wormopt as wo
from wormopt.cli import main
from wormopt.errors import Fault, UnknownNameError, WormoptError
from wormopt.kinds import KINDS, Kind, studies_in
from wormopt.study import Given, Study, array, check, entry, parts, positive, scalar
from wormopt.study.given import RefusedError, plain
from wormopt.study.types import FOLDER

pytestmark = pytest.mark.usefixtures("fresh")


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
    assert "has a unit, but the scene has none" in refusal(lambda: pull(force="1 N"))["force"]
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
    wrong = {
        "spring": {"lenght": 1, "stiffness": -1, "length": 11}, "chain": {"links": 2.5},
        "more": [{"length": 1}, {"length": True}], "ground": {"law": "sofd"},
        "force": 5, "mode": "slw", "colour": "red",
    }  # fmt: skip
    assert refusal(lambda: Pull(**wrong)) == {
        "spring.lenght": "unknown key; did you mean length?",
        "spring.stiffness": "-1 is not allowed; write a finite number above 0",
        "spring.length": "11 is not allowed; write a number from 0 to 10",
        "chain.links": "2.5 is not allowed; write a whole number from 1 to 5",
        "more[1].length": "true is not allowed; write a number from 0 to 10",
        "ground.law": '"sofd" is not allowed; write "soft" or "hard"',
        "force": "5 is not allowed; write a number from -5 to below 5",
        "mode": '"slw" is not allowed; did you mean "slow"? Otherwise write "slow" or "fast"',
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
    assume(not any(0 < abs(x) < 1e-30 for x in (f, n)))
    made = pull(force=f, spring=Spring(length=n), chain={"links": links})
    assert made == pull(force=f, spring={"length": n}, chain=Chain(links=links))
    assert hash(made) == hash(copy.deepcopy(made))
    changes = {"force": f, "spring.length": n}, "chain.links=1", {"chain": {"links": links}}
    assert pull().vary(*changes) == made
    assert made.vary() == made
    assert made.vary(mode="fast") != made


def test_vary_is_refused_as_the_constructor_is():
    assert refusal(lambda: pull().vary({"spring.lenght": 1})).keys() == {"spring.lenght"}
    assert refusal(lambda: pull().vary("force")).keys() == {"--set"}
    assert refusal(lambda: pull().vary({"mode.x": 1})).keys() == {"mode.x"}
    with pytest.raises(WormoptError, match="an override must be a text"):
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
    with pytest.raises(TypeError, match="'weight' is not a quantity"):

        class _Key(Given):
            load: float = positive("weight", "load")

    with pytest.raises(TypeError, match="'weight' is not a quantity"):
        scalar("weight", "load")
    with pytest.raises(TypeError, match="needs a meaning"):
        scalar("mass", " ")
    with pytest.raises(TypeError, match="dimensions are words"):
        array("mass", "mass,time", "masses")


@pytest.mark.parametrize("words", ["{lenght}", "{spring.lenght}", "{force.x}", "{}", "{0}"])
def test_advice_about_what_is_not_there_is_refused(words: str):
    with pytest.raises(TypeError, match="is not a member or key"):

        class _Kind(Study):
            spring: Spring = entry("spring")
            force: float = positive("force", "force")

            @check(1, f"lower {words}")
            def found(self) -> float:
                return 1.0


@pytest.mark.parametrize("limit", ["tolerance", "spring.tolerance"])
def test_a_limit_that_is_not_there_is_refused(limit: str):
    with pytest.raises(TypeError, match=f"found names {limit}, which is not a member or key"):

        class _Limit(Study):
            spring: Spring = entry("spring")

            @check(limit, "lower it")
            def found(self) -> float:
                return 1.0

    with pytest.raises(TypeError, match="found names cargo, which is not a member or key"):

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
def toy(monkeypatch: Patch, tmp_path: Path) -> Path:
    """A scene of the kind, in a folder that is the current one."""
    monkeypatch.setitem(KINDS, "toy-pull", Kind("pull", "Pull", __name__))
    monkeypatch.chdir(tmp_path)
    text = 'schema = 1\nkind = "toy-pull"\nforce = 2\n[spring]\nlength = 1\n'
    (tmp_path / "mine.toml").write_text(text, encoding="utf-8")
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


def test_the_command_computes_some_results_only(toy: Path, capsys: Capture):
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
    ("only", "said"),
    [
        ("reech", "has no result 'reech'; did you mean 'reach'? It has 'energy'"),
        ("reach,", "has no result ''"),
        ("", "has no result ''"),
        ("depth", "there is no depth without ground"),
    ],
)
def test_the_command_refuses_other_names(toy: Path, capsys: Capture, only: str, said: str):
    assert main(["run", "mine.toml", "--only", only]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert said in err
    assert not [*toy.parent.glob("results/*")]
    assert not CALLS
