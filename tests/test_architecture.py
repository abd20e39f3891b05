"""Imports point downward only, those inside functions and for type checkers included."""

import ast
from collections.abc import Iterable, Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import wormopt

PACKAGE = Path(wormopt.__file__).parent

# Groups of rooms, and the groups each may import from. Rooms of one group may import each other
# as long as no circle arises.
GROUPS = {
    "ground": {"version", "errors", "files", "kinds", "progress"},
    "base": {"core", "result"},
    "scenes": {"scenes"},
    "builders": {"worms", "magnetics", "tracking"},
    "solvers": {"optimal", "simulation", "linear", "averaging", "statics"},
    "gaits": {"gaits"},
    "studies": {"studies", "bench"},
    "face": {"plot", "output", "runner", "cli", "__main__", "__init__"},
}
# What works is called from Python alike: only studies and what lies above them know of scenes.
BELOW = {
    "ground": set(),
    "base": {"ground"},
    "scenes": {"ground", "base"},
    "builders": {"ground", "base"},
    "solvers": {"ground", "base"},
    "gaits": {"ground", "base", "builders", "solvers"},
    "studies": {"ground", "base", "scenes", "builders", "solvers", "gaits"},
    "face": {"ground", "base", "scenes", "builders", "solvers", "gaits", "studies"},
}


def module_name(path: Path, root: Path) -> str:
    parts = path.relative_to(root.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imports_of(path: Path, modules: Iterable[str]) -> Iterator[str]:
    """Modules of the package that a file imports, wherever in it."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in modules)
        elif isinstance(node, ast.ImportFrom):
            assert not node.level, f"{path}: relative import"
            source = node.module or ""
            for alias in node.names:
                whole = f"{source}.{alias.name}"
                if whole in modules or source in modules:
                    yield whole if whole in modules else source


def import_graph(root: Path) -> dict[str, set[str]]:
    files = {module_name(path, root): path for path in root.rglob("*.py")}
    return {name: set(imports_of(path, files)) - {name} for name, path in files.items()}


def room(module: str) -> str:
    parts = module.split(".")
    return parts[1] if len(parts) > 1 else "__init__"


def group(module: str) -> str:
    found = [name for name, rooms in GROUPS.items() if room(module) in rooms]
    assert found, f"{module} is in no group; say where its room belongs"
    return found[0]


def upward(graph: dict[str, set[str]]) -> list[str]:
    return [
        f"{importer} imports {imported}"
        for importer, targets in graph.items()
        for imported in targets
        if group(imported) != group(importer) and group(imported) not in BELOW[group(importer)]
    ]


def circles(graph: dict[str, set[str]]) -> list[str]:
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return error.args[1]
    return []


def rooms(graph: dict[str, set[str]]) -> dict[str, set[str]]:
    merged: dict[str, set[str]] = {}
    for importer, targets in graph.items():
        merged.setdefault(room(importer), set()).update(map(room, targets))
    return {name: targets - {name} for name, targets in merged.items()}


def test_no_import_points_upward():
    assert upward(import_graph(PACKAGE)) == []


def test_no_import_is_circular():
    graph = import_graph(PACKAGE)
    assert circles(graph) == []
    assert circles(rooms(graph)) == []


def test_the_groups_name_every_room():
    assert {group(module) for module in import_graph(PACKAGE)} <= set(GROUPS)


@pytest.mark.parametrize(
    ("importer", "statement"),
    [
        ("core/model.py", "import wormopt.cli"),
        ("core/model.py", "from wormopt import cli"),
        ("core/model.py", "import wormopt"),
        ("errors.py", "def f():\n    from wormopt.core import model"),
        ("worms/chain.py", "from wormopt.optimal.nlp import solve"),
        ("optimal/nlp.py", "from wormopt.worms import chain"),
        ("core/model.py", "from wormopt.scenes.worm import WormTable"),
        ("worms/chain.py", "from wormopt.scenes.worm import WormTable"),
        ("optimal/nlp.py", "from wormopt.scenes.worm import WormTable"),
        ("gaits/search.py", "from wormopt.scenes.worm import WormTable"),
        ("scenes/worm.py", "from wormopt.gaits import search"),
        (
            "core/model.py",
            "import typing\nif typing.TYPE_CHECKING:\n    from wormopt.studies import x",
        ),
    ],
)
def test_a_forbidden_import_is_found(tmp_path: Path, importer: str, statement: str):
    root = tmp_path / "wormopt"
    for name in ("__init__", "cli", "errors", "core/__init__", "core/model", "worms/__init__",
                 "worms/chain", "optimal/__init__", "optimal/nlp", "studies/__init__",
                 "scenes/__init__", "scenes/worm", "gaits/__init__", "gaits/search"):  # fmt: skip
        path = root / f"{name}.py"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("")
    assert upward(import_graph(root)) == []
    (root / importer).write_text(statement)
    assert len(upward(import_graph(root))) == 1


def test_a_circle_is_found(tmp_path: Path):
    root = tmp_path / "wormopt"
    (root / "core").mkdir(parents=True)
    (root / "core" / "a.py").write_text("def f():\n    import wormopt.core.b")
    (root / "core" / "b.py").write_text("from wormopt.core import a")
    (root / "core" / "__init__.py").write_text("")
    assert circles(import_graph(root))
