"""The kind of scene that docs/architecture.md adds is one: what stands on the page runs."""

import json
import re
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from places import DOCS

import wormopt.systems
from wormopt.cli import main
from wormopt.kinds import KINDS, studies_in
from wormopt.study.reference import page

PAGE = DOCS / "architecture.md"
SCENE = 'schema = 1\nkind = "throw"\nmass = 2.0\nspeed = 3.0\nfriction = 0.5\nwant = ["path"]\n'


@pytest.fixture
def throw(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A scene of the kind, whose file is that of the page."""
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    (block,) = [block for block in blocks if block.startswith("# wormopt/systems/throw/throw.py")]
    folder = tmp_path / "systems" / "throw"
    folder.mkdir(parents=True)
    (folder / "__init__.py").touch()
    (folder / "throw.py").write_text(block, encoding="utf-8")
    monkeypatch.setattr(
        wormopt.systems, "__path__", [*wormopt.systems.__path__, str(folder.parent)]
    )
    ((name, kind),) = studies_in(folder.parent)
    monkeypatch.setitem(KINDS, name, kind)
    yield write(tmp_path)
    for name in [name for name in sys.modules if name.startswith("wormopt.systems.throw")]:
        del sys.modules[name]


def write(folder: Path) -> Path:
    path = folder / "stone.toml"
    path.write_text(SCENE, encoding="utf-8")
    return path


def test_it_runs_and_is_checked_drawn_and_saved(throw: Path, capsys: pytest.CaptureFixture[str]):
    folder = throw.parent / "out"
    assert main(["check", str(throw)]) == 0
    assert main(["run", str(throw), "-o", str(folder), "--set", 'units="SI"', "--json"]) == 0
    told = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert told["scalars"]["distance"] == {
        "value": pytest.approx(2.0 * 9.0 / (2 * 0.5)),
        "unit": "m",
    }
    assert told["trust"]["checks"]["energy over force"]["passed"]
    assert {path.name for path in folder.iterdir()} == {"result.nc", "summary.json", "path.png"}


def test_its_keys_are_checked_and_described(throw: Path, capsys: pytest.CaptureFixture[str]):
    assert main(["run", str(throw), "--set", "speed=-1"]) == 2
    assert "speed: -1 is not allowed; write a finite number above 0" in capsys.readouterr().err
    assert "| `friction` | a finite number above 0 | force | required |" in page("throw")
