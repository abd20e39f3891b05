"""Every public thing says what it is, names all its parameters, and its examples run."""

import doctest
import importlib
import inspect
import os
import pkgutil
import re
from collections.abc import Iterator
from importlib.util import find_spec
from operator import attrgetter
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from hints import Patch
from places import TESTS

import wormopt

MODULES = ["wormopt", *(info.name for info in pkgutil.walk_packages(wormopt.__path__, "wormopt."))]
MODULES.remove("wormopt.__main__")
# "module" -> examples of what it keeps for itself, by room.
KEPT = {
    name: text
    for file in sorted((TESTS / "examples").glob("*.txt"))
    for name, text in re.findall(
        r"^# ((?:wormopt|tests)\S*)\n(.*?)(?=^# (?:wormopt|tests)|\Z)",
        file.read_text("utf-8"),
        re.MULTILINE | re.DOTALL,
    )
}


def public_things(module: ModuleType) -> Iterator[tuple[str, Any]]:
    """Functions and classes defined in a module, and the public methods of these classes."""
    for name, thing in vars(module).items():
        if name.startswith("_") or getattr(thing, "__module__", None) != module.__name__:
            continue
        if inspect.isfunction(thing):
            yield name, thing
        elif inspect.isclass(thing):
            yield name, thing
            yield from (
                (f"{name}.{key}", getattr(value, "__func__", value))
                for key, value in vars(thing).items()
                if not key.startswith("_") and inspect.isfunction(getattr(value, "__func__", value))
            )


def documented_names(thing: Any) -> set[str]:
    """Names that open an entry of a numpydoc list: "name : type", or "a, b : type"."""
    lines = re.findall(r"^(\w+(?:, \w+)*) :", inspect.getdoc(thing) or "", re.MULTILINE)
    return {name for line in lines for name in line.split(", ")}


def parameters(thing: Any) -> list[str]:
    try:
        names = inspect.signature(thing).parameters
    except ValueError:  # a class without a constructor of its own
        return []
    named = [n for n, p in names.items() if p.kind not in (p.VAR_POSITIONAL, p.VAR_KEYWORD)]
    return [name for name in named if name not in ("self", "cls") and not name.startswith("_")]


def undescribed(module: ModuleType) -> list[str]:
    """The module and its public things, without those that have a docstring."""
    # A method may do what its base says it does; a class is another thing than its base.
    told = {module.__name__: module.__doc__}
    for label, thing in public_things(module):
        own = thing.__doc__ if inspect.isclass(thing) else inspect.getdoc(thing)
        told[f"{module.__name__}.{label}"] = own
    return [name for name, text in told.items() if not text]


# All modules in one test, and all names in two: several hundred tests would take longer to be
# collected and reported than these checks take.
def test_everything_public_is_described():
    missing = []
    for name in MODULES:
        try:
            missing += undescribed(importlib.import_module(name))
        except ModuleNotFoundError as error:  # of what is not installed
            if str(error.name).startswith("wormopt"):
                raise
    assert missing == []


def test_what_is_not_described_would_be_seen():
    module = ModuleType("bare")
    told = type("Told", (), {"__doc__": "Yes.", "__module__": "bare", "method": lambda self: self})
    vars(module)["Told"] = told
    assert undescribed(module) == ["bare", "bare.Told.method"]


def test_a_docstring_has_each_section_once():
    """Two sections of one name are two texts that nobody joined."""
    twice = []
    for file in sorted(Path(wormopt.__path__[0]).rglob("*.py")):
        for text in re.findall(r'"""(.*?)"""', file.read_text("utf-8"), re.DOTALL):
            heads = re.findall(r"^ *([A-Z][a-z ]+)\n *-{4,}$", text, re.MULTILINE)
            twice += [(file.name, head) for head in {*heads} if heads.count(head) > 1]
    assert twice == []


SPACES = [name for name in wormopt.__all__ if inspect.ismodule(getattr(wormopt, name))]
PUBLIC = [
    *wormopt.__all__,
    *(f"{space}.{name}" for space in SPACES for name in getattr(wormopt, space).__all__),
]


def test_what_users_import_has_an_example():
    for name in PUBLIC:
        thing = attrgetter(name)(wormopt)
        text = inspect.cleandoc(thing.__doc__ or "")
        assert "\nExamples\n--------\n" in text, name
        assert "\n>>> " in text, name
        if inspect.isfunction(thing) and inspect.signature(thing).return_annotation != "None":
            assert "\nReturns\n-------\n" in text, name


def test_what_users_import_is_documented_in_full():
    for name in PUBLIC:
        thing = attrgetter(name)(wormopt)
        own = name.rpartition(".")[2]
        if not callable(thing) or (inspect.isclass(thing) and not takes_own_parameters(thing)):
            continue
        module = importlib.import_module(thing.__module__)
        for label, part in public_things(module):
            if label == own or label.startswith(f"{own}."):
                missing = set(parameters(part)) - documented_names(part)
                assert not missing, f"{name}: {label} does not document {sorted(missing)}"


def takes_own_parameters(thing: type) -> bool:
    return not issubclass(thing, BaseException) or "__init__" in vars(thing)


def has_examples(name: str) -> bool:
    found = find_spec(name)
    assert found
    return found.origin is not None and ">>> " in Path(found.origin).read_text("utf-8")


FLAGS = doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS


@pytest.fixture
def elsewhere(tmp_path: Path, monkeypatch: Patch) -> None:
    """Examples write into a folder that goes away."""
    monkeypatch.chdir(tmp_path)
    os.environ.setdefault("MPLBACKEND", "agg")


@pytest.mark.usefixtures("elsewhere")
@pytest.mark.parametrize("name", [name for name in MODULES if has_examples(name)])
def test_examples_run(name: str):
    module = importlib.import_module(name)
    assert doctest.testmod(module, optionflags=FLAGS).failed == 0


@pytest.mark.usefixtures("elsewhere")
@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=[pytest.mark.compiled] * n.endswith("native.build")) for n in KEPT],
)
def test_examples_of_internals_run(name: str):
    names = dict(vars(importlib.import_module(name)))
    examples = doctest.DocTestParser().get_doctest(KEPT[name], names, name, None, None)
    assert examples.examples
    assert doctest.DocTestRunner(optionflags=FLAGS).run(examples).failed == 0
