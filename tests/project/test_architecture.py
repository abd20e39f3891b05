"""Imports point downward only, those inside functions and for type checkers included."""

import ast
import re
import sys
import tomllib
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import wormopt

PACKAGE = Path(wormopt.__file__).parent

# Groups of rooms, and the groups each may import from. Rooms of one group may import each other
# as long as no circle arises.
GROUPS = {
    "ground": "version errors files fingerprint kinds lazy netcdf progress shown",
    "base": "model numerics quantities tables labelled digest result",
    "engine": "simulation control ocp analysis magnetics fitting",
    "study": "study",
    "pictures": "pictures",
    "families": "families runner",
    "systems": "systems",
    "face": "exports reports cli __main__ __init__",
}
BELOW: dict[str, set[str]] = {
    "ground": set(),
    "base": {"ground"},
    "engine": {"ground", "base"},
    "study": {"ground", "base"},
    "pictures": {"ground", "base"},
    "families": {"ground", "base", "study", "pictures"},
    "systems": {"ground", "base", "engine", "study", "pictures", "families"},
    "face": {"ground", "base", "engine", "study", "systems", "pictures", "families"},
}
# Modules of a room that other rooms may import; rooms that are not named are open.
DOORS = {
    "simulation": """ensemble event_free functions initial_value moreau native.build options
        native.model_code routes simulate trajectory variation walls""",
    "ocp": "contact mesh motion nlp optimise problem stages switching transcription",
    "reports": "report",
    "exports": "export robot ros",
    "cli": "",
}
# Which systems a system may use; all may use what they share.
_USES = {
    "shared": "", "spiked": "", "chain": "spiked", "block": "chain", "swinging": "chain",
    "pair": "chain", "film": "spiked", "gears": "chain spiked", "coils": "film", "channel": "",
    "peristaltic": "", "planar": "", "recorded": "spiked",
}  # fmt: skip
USES = {name: {*used.split()} for name, used in _USES.items()}


def module_name(path: Path, root: Path) -> str:
    parts = path.relative_to(root.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@cache
def _imports(text: str) -> list[ast.Import | ast.ImportFrom]:
    """All imports of a file, of which the trees are not kept."""
    return [n for n in _statements(ast.parse(text)) if isinstance(n, (ast.Import, ast.ImportFrom))]


def _statements(node: ast.AST) -> Iterator[ast.AST]:
    """Statements within a node at any depth, without the expressions, which hold none."""
    for block in ("body", "orelse", "finalbody", "handlers", "cases"):
        inside = getattr(node, block, ())
        for one in inside if isinstance(inside, list) else ():
            yield one
            yield from _statements(one)


def imports_of(path: Path, modules: Iterable[str]) -> Iterator[str]:
    """Modules of the package that a file imports, wherever in it."""
    for node in _imports(path.read_text(encoding="utf-8")):
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
    found = [name for name, rooms in GROUPS.items() if room(module) in rooms.split()]
    assert found, f"{module} is in no group; say where its room belongs"
    return found[0]


def forbidden(
    graph: dict[str, set[str]], of: Callable[[str], str], allowed: dict[str, set[str]]
) -> list[str]:
    """Imports from a group, or a system, that the importer's may not use."""
    return [
        f"{importer} imports {imported}"
        for importer, targets in graph.items()
        for imported in targets
        if of(importer) and of(imported) not in {of(importer), ""} | allowed[of(importer)]
    ]


def upward(graph: dict[str, set[str]]) -> list[str]:
    return forbidden(graph, group, BELOW)


def circles(graph: dict[str, set[str]]) -> list[str]:
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return error.args[1]
    return []


def system(module: str) -> str:
    parts = module.split(".")
    return parts[2] if parts[1:2] == ["systems"] and len(parts) > 2 else ""


def sideways(graph: dict[str, set[str]]) -> list[str]:
    """Imports of a system from another that it may not use."""
    return forbidden(graph, system, {name: used | {"shared"} for name, used in USES.items()})


def undeclared(root: Path) -> list[str]:
    """Imports from within another system, past the names that its ``__init__`` declares."""
    found = []
    for path in root.rglob("*.py"):
        importer = module_name(path, root)
        for node in _imports(path.read_text(encoding="utf-8")):
            if not isinstance(node, ast.ImportFrom) or not system(node.module or ""):
                continue
            used = system(node.module or "")
            if system(importer) in {"", "shared", used} or used == "shared":
                continue
            stub = root / "systems" / used / "__init__.pyi"
            face = set(re.findall(r" as (\w+)$", stub.read_text("utf-8"), re.MULTILINE))
            if (node.module or "").count(".") > 2 or {a.name for a in node.names} - face:
                found.append(f"{importer} imports from {node.module}")
    return found


def past_the_door(graph: dict[str, set[str]]) -> list[str]:
    """Imports from within another room that names the modules others may import."""
    return [
        f"{importer} imports {imported}"
        for importer, targets in graph.items()
        for imported in targets
        if room(imported) in {*DOORS} - {room(importer)}
        and "." in (inner := imported.removeprefix(f"wormopt.{room(imported)}"))
        and inner[1:] not in DOORS[room(imported)].split()
    ]


def rooms(graph: dict[str, set[str]]) -> dict[str, set[str]]:
    merged: dict[str, set[str]] = {}
    for importer, targets in graph.items():
        merged.setdefault(room(importer), set()).update(map(room, targets))
    return {name: targets - {name} for name, targets in merged.items()}


def test_no_import_points_upward():
    assert upward(import_graph(PACKAGE)) == []


def test_systems_use_no_others_than_they_say():
    graph = import_graph(PACKAGE)
    assert sideways(graph) == []
    assert set(USES) == {system(module) for module in graph} - {""}
    TopologicalSorter(USES).prepare()
    used = {name: set[str]() for name in USES}
    for importer, targets in graph.items():
        if system(importer):
            used[system(importer)] |= {*map(system, targets)} - {"", "shared", system(importer)}
    assert used == USES


def test_systems_meet_each_other_at_the_door():
    assert undeclared(PACKAGE) == []


def test_a_way_past_the_door_would_be_seen(tmp_path: Path):
    root = made(tmp_path)
    stub = "from wormopt.systems.chain.model import worm as worm\n"
    (root / "systems/chain/__init__.pyi").write_text(stub)
    for text, seen in (
        ("from wormopt.systems.chain import worm", 0),
        ("from wormopt.systems.chain import other", 1),
        ("def f():\n    from wormopt.systems.chain.model import worm", 1),
    ):
        (root / "systems/block/run.py").write_text(text + "\n")
        assert len(undeclared(root)) == seen


def test_rooms_are_entered_by_their_doors():
    graph = import_graph(PACKAGE)
    assert past_the_door(graph) == []
    graph["wormopt.control.lqr"] |= {"wormopt.simulation.grip", "wormopt.ocp.nlp", "wormopt.cli"}
    assert past_the_door(graph) == ["wormopt.control.lqr imports wormopt.simulation.grip"]


def test_no_import_is_circular():
    graph = import_graph(PACKAGE)
    assert circles(graph) == []
    assert circles(rooms(graph)) == []


def others(root: Path) -> set[str]:
    """Packages that a package imports, without itself and the standard library."""
    found = set()
    for path in root.rglob("*.py"):
        for node in _imports(path.read_text(encoding="utf-8")):
            if isinstance(node, ast.Import):
                found |= {alias.name.partition(".")[0] for alias in node.names}
            else:
                found.add(str(node.module).partition(".")[0])
    return found - sys.stdlib_module_names - {root.name}


def test_the_wheel_holds_and_needs_nothing_of_the_tests():
    """No benchmark, no stress test, no other method and no other program."""
    about = tomllib.loads((PACKAGE.parent / "pyproject.toml").read_text(encoding="utf-8"))
    wheel = about["tool"]["hatch"]["build"]["targets"]["wheel"]
    assert (wheel["packages"], set(wheel["force-include"])) == (["wormopt"], {"problems"})
    extras = about["project"]["optional-dependencies"]
    needed = [
        *about["project"]["dependencies"],
        *extras["data"],
        *extras["sweep"],
        *extras["mujoco"],
        "dask",
    ]
    assert others(PACKAGE) <= {re.split("[>=]", line)[0] for line in needed}


def test_a_package_that_needs_a_test_is_found(tmp_path: Path):
    root = made(tmp_path)
    assert others(root) == set()
    text = "def f():\n    from tests.stress import matrix\n    import os, numba"
    (root / "cli.py").write_text(text)
    assert others(root) == {"tests", "numba"}


def test_the_groups_name_every_room():
    assert {group(module) for module in import_graph(PACKAGE)} <= set(GROUPS)


FILES = """__init__ cli errors model/__init__ model/model ocp/__init__ ocp/nlp control/__init__
    control/lqr study/__init__ study/types systems/__init__ systems/film/__init__ systems/film/run
    systems/chain/__init__ systems/chain/model systems/block/__init__ systems/block/run
    pictures/__init__"""


@pytest.mark.parametrize(
    ("importer", "statement"),
    [
        ("model/model.py", "import wormopt.cli"),
        ("model/model.py", "from wormopt import cli"),
        ("model/model.py", "import wormopt"),
        ("errors.py", "def f():\n    from wormopt.model import model"),
        ("model/model.py", "from wormopt.ocp.nlp import solve"),
        ("model/model.py", "from wormopt.study.types import Finite"),
        ("ocp/nlp.py", "from wormopt.study.types import Finite"),
        ("control/lqr.py", "from wormopt.systems.chain import model"),
        ("study/types.py", "from wormopt.systems.chain import model"),
        ("study/types.py", "from wormopt.ocp import nlp"),
        ("model/model.py", "if TYPE_CHECKING:\n    from wormopt.systems.film import run"),
    ],
)
def test_a_forbidden_import_is_found(tmp_path: Path, importer: str, statement: str):
    root = made(tmp_path)
    assert upward(import_graph(root)) == []
    (root / importer).write_text(statement)
    assert len(upward(import_graph(root))) == 1


def test_a_system_that_uses_another_without_saying_so_is_found(tmp_path: Path):
    root = made(tmp_path)
    (root / "systems/block/run.py").write_text("from wormopt.systems.chain.model import f")
    assert sideways(import_graph(root)) == []
    (root / "systems/chain/model.py").write_text("from wormopt.systems.block.run import f")
    assert len(sideways(import_graph(root))) == 1


def made(folder: Path) -> Path:
    root = folder / "wormopt"
    for name in FILES.split():
        path = root / f"{name}.py"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("")
    return root


def test_a_circle_is_found(tmp_path: Path):
    root = made(tmp_path)
    (root / "model" / "model.py").write_text("def f():\n    import wormopt.model.b")
    (root / "model" / "b.py").write_text("from wormopt.model import model")
    assert circles(import_graph(root))


def calls_upward(folder: Path) -> list[str]:
    """Calls of the driver's C files to a file that run.h names after them, or nowhere."""
    shared = (folder / "run.h").read_text(encoding="utf-8").partition("calls those before it")[2]
    sections = re.split(r"^/\* (\w+\.c)\b.*\*/$", shared, flags=re.MULTILINE)[1:]
    homes = {
        name: place
        for place, text in enumerate(sections[1::2])
        for name in re.findall(r"(\w+)\(", text)
    }
    found = [f"{path.name} is not named" for path in folder.glob("*.c")]
    for place, file in enumerate(sections[::2]):
        found.remove(f"{file} is not named")
        text = re.sub(
            r"/\*.*?\*/", "", (folder / file).read_text(encoding="utf-8"), flags=re.DOTALL
        )
        own = re.findall(r"^(?!static|#)[A-Za-z].*?(\w+)\([^;{]*\) \{$", text, flags=re.MULTILINE)
        found += [f"{file} defines {name} undeclared" for name in own if homes.get(name) != place]
        called = {name for name in re.findall(r"\b(\w+)\(", text) if homes.get(name, 0) > place}
        found += [f"{file} calls {name}" for name in sorted(called)]
    return found


def test_files_of_the_driver_call_those_before_them_only(tmp_path: Path):
    native = PACKAGE / "simulation/native"
    # part of the code of a model; another driver
    alone = [f"{name} is not named" for name in ("own_stages.c", "moreau.c")]
    interface = [f"defines wormopt_{name} undeclared" for name in ("advance", "start")]
    known = {*alone, *(f"driver.c {text}" for text in interface)}
    known.add("lanes.c defines wormopt_advance_lanes undeclared")
    assert set(calls_upward(native)) == known
    for path in (*native.glob("*.c"), native / "run.h"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    with (tmp_path / "doubts.c").open("a", encoding="utf-8") as file:
        file.write("static void f(Run *run) {\n    set_levels(run, 1);\n}\n")
    assert set(calls_upward(tmp_path)) == known | {"doubts.c calls set_levels"}
