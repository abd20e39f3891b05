"""Nothing is loaded that is not needed. Each check runs in a process of its own."""

import json
import re
import subprocess
import sys
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

import wormopt as wo

HEAVY = {"casadi", "numpy", "scipy", "matplotlib", "rich", "pandas", "xarray", "control"}


def modules_after(*codes: str) -> list[set[str]]:
    """Top-level names in sys.modules after each of some lines of code, run one after another."""
    script = (
        "import contextlib, io, json, sys\n"
        f"for code in {codes!r}:\n"
        "    with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(SystemExit):\n"
        "        exec(code)\n"
        "    print(json.dumps(sorted({name.split('.')[0] for name in sys.modules})))\n"
    )
    command = [sys.executable, "-c", script]
    with TemporaryDirectory() as folder:
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True)
    return [set(json.loads(line)) for line in done.stdout.splitlines()]


CHECKED = (
    "design_fast_gait", "fig05_lambda_trackers", "own_model random_links", "fig12_stress_strain",
    "film_field fig27_float", "three_masses_harmonic", "film_forward", "prototype_steps",
    "linear_chain", "fit_chain", "film_wave_design", "coil_row_inverse", "fig20_capsule",
)  # fmt: skip
HELPED = ("", "run ", "export ", "plot ", "sweep ", "report ")
COMMANDS = {  # and their exit codes
    "list": 0, "export nothing": 2, "check no_such_scene": 2, "run no_such_scene": 2,
    **{f"{verb}--help": 0 for verb in HELPED}, **{f"check {scenes}": 0 for scenes in CHECKED},
}  # fmt: skip
LIGHT = [
    "import wormopt",
    "import wormopt as wo; wo.load_scene('pareto_speed_load')",
    "import wormopt as wo; wo.load_scene('prototype_steps', {'gait.rest_length': '0.1 m'})",
    *(
        f"from wormopt.cli import main; assert main({command.split()}) == {code}"
        for command, code in COMMANDS.items()
    ),
]


def test_reading_and_checking_load_no_numerics():
    loaded = zip(LIGHT, modules_after(*LIGHT), strict=True)
    assert {code: heavy for code, after in loaded if (heavy := after & HEAVY)} == {}


def test_every_public_name_is_where_it_is_looked_for():
    assert [name for name in wo.__all__ if getattr(wo, name) is None] == []


def test_the_module_docstring_lists_every_public_name_once():
    listed = wo.__doc__.split("documentation.\n")[1]  # pyright: ignore[reportOptionalMemberAccess]
    names = re.findall(r"\w+", "".join(re.findall(r"^    .*\n", listed, re.MULTILINE)))
    assert sorted(names) == wo.__all__


def test_no_public_name_is_hidden_by_a_module():
    """A function is not called as a module beside it, which would take its place once loaded."""
    package = Path(wo.__file__).parent
    for stub in package.rglob("__init__.pyi"):
        beside = {p.stem for p in stub.parent.glob("*.py")} | {
            p.parent.name for p in stub.parent.glob("*/__init__.py")
        }
        names = re.findall(r"^from (\S+) import (\w+) as", stub.read_text("utf-8"), re.MULTILINE)
        own = ".".join(("wormopt", *stub.parent.relative_to(package).parts))
        assert not {name for module, name in names if module != own} & beside, stub


def test_the_check_would_see_a_heavy_module_and_a_result_is_held_without_scipy():
    nothing, gait = modules_after("import wormopt; wormopt.Result('a', 'gait')", "wormopt.Gait")
    assert "scipy" not in nothing
    assert "numpy" in gait


ONE = ("search.sequence=[[0],[1],[2]]", 'search.effort="quick"')
# Scenes that one process runs in this order, without pictures, and what is changed of them.
RUNS = {
    "fig12_stress_strain": (),
    "fig15_film_flow": (),
    "fast_gait": (),
    "prototype_steps": (),
    "travelling_field": ("coils.count=8", "line.margin=1"),
    "design_fast_gait": ONE,
}


@cache
def loaded_by_runs(*commands: tuple[str, ...]) -> list[set[str]]:
    """Full names of the modules in sys.modules after each `wormopt run`, in one process."""
    script = (
        "import json, sys\n"
        "from wormopt.cli import main\n"
        f"for arguments in {commands!r}:\n"
        "    assert main(['run', '--json', *arguments]) == 0, arguments\n"
        "    print('loaded', json.dumps(sorted(sys.modules)), file=sys.stderr)\n"
    )
    command = [sys.executable, "-c", script]
    with TemporaryDirectory() as folder:
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True)
    lines = done.stderr.splitlines()
    return [set(json.loads(line[7:])) for line in lines if line.startswith("loaded ")]


def with_changes(name: str, changes: tuple[str, ...]) -> tuple[str, ...]:
    return (name, *(part for change in changes for part in ("--set", change)))


# A design of all orders that draws, after them.
DRAWN = ("design_fast_gait", ('search.effort="quick"', 'want=["motion"]'))


def loaded_by(name: str) -> set[str]:
    """Modules loaded after a run of RUNS, or "pictures" for DRAWN, and those before it."""
    runs = [(*with_changes(*run), "--no-plots") for run in RUNS.items()]
    loaded = loaded_by_runs(*runs, with_changes(*DRAWN))
    return dict(zip((*RUNS, "pictures"), loaded, strict=True))[name]


def within(room: str, loaded: set[str]) -> set[str]:
    """Loaded modules of a room of the package, which there must be."""
    assert find_spec(room)
    return {name for name in loaded if name.startswith(room)}


def among(names: set[str], loaded: set[str]) -> set[str]:
    """Those that were loaded, of modules that there must be but for those of an extra."""
    assert all(map(find_spec, names - {"dask", "distributed"}))
    return names & loaded


NO_SOLVER = "casadi scipy matplotlib"


@pytest.mark.parametrize(
    ("name", "unwanted", "rooms"),
    [
        ("fig12_stress_strain", NO_SOLVER, ""),
        ("fig15_film_flow", NO_SOLVER, ""),
        ("travelling_field", "casadi matplotlib", "wormopt.ocp"),
        ("prototype_steps", "casadi matplotlib", ""),
        ("fast_gait", f"{NO_SOLVER} rich wormopt.systems.spiked.search.search", "wormopt.ocp"),
        # programs of a design are linear, one by one
        ("design_fast_gait", "casadi wormopt.ocp.nlp", ""),
    ],
)
def test_a_scene_loads_no_more_than_it_needs(name: str, unwanted: str, rooms: str):
    loaded = loaded_by(name)
    assert not among({*unwanted.split()}, loaded)
    assert not any(within(room, loaded) for room in rooms.split())
    assert ("wormopt.systems.spiked.search.search" in loaded) is (name == "design_fast_gait")


def test_a_kinematic_scene_loads_no_compiled_simulation():
    loaded = loaded_by("fast_gait")
    unwanted = ("native", "simulate", "automaton", "sundials", "ensemble")
    assert not among({f"wormopt.simulation.{name}" for name in unwanted}, loaded)
    assert not within("wormopt.control", loaded)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["fig05_lambda_trackers", "stiction"])
def test_a_simulation_loads_no_scipy(name: str):
    (loaded,) = loaded_by_runs((*with_changes(name, ()), "--no-plots"))
    assert "wormopt.simulation.native.kernel" in loaded
    # the second route of exact contact is in Python
    assert ("wormopt.simulation.automaton" in loaded) is (name == "stiction")
    assert not among({"scipy", "matplotlib", "control"}, loaded)
    assert not within("wormopt.ocp", loaded)


def test_a_plain_run_loads_no_cluster_no_report_no_sweep():
    loaded = loaded_by("pictures")
    assert not among({"dask", "distributed", "filelock", "pandas", "xarray"}, loaded)
    for room in ("wormopt.families", "wormopt.reports", "wormopt.exports"):
        assert not within(room, loaded), room


def test_a_run_with_plots_leaves_pyplot_alone():
    loaded = loaded_by("pictures")
    assert "matplotlib" in loaded
    assert "matplotlib.pyplot" not in loaded
