"""Stored points belong to the code that computes, not to how it is explained."""

import ast
from pathlib import Path

from hints import Patch

from wormopt import fingerprint as kept
from wormopt.fingerprint import code_key, fingerprint

ROD = "wormopt.systems.channel.rod_motion"
SOURCE = '''"""A module."""

LIMIT = 3
"""Of something."""


class Thing:
    """A thing."""

    def twice(self, x):
        """Double."""
        return 2 * x  # of course
'''


def test_comments_and_docstrings_do_not_count():
    less = SOURCE.replace("  # of course", "").replace('        """Double."""\n', "")
    assert fingerprint(less) == fingerprint(SOURCE)
    assert fingerprint(SOURCE.replace('"""', "'''")) == fingerprint(SOURCE)
    for old, new in (("2 * x", "x + x"), ("LIMIT = 3", "LIMIT = 4"), ("x)", "x=1)")):
        assert fingerprint(SOURCE.replace(old, new)) != fingerprint(SOURCE)


def test_what_computes_counts_and_what_shows_does_not():
    found = kept._imported(ROD, kept._files(kept._ROOT))
    assert {
        ROD,
        "wormopt.magnetics.winding",
        "wormopt.simulation.moreau",
        "wormopt.systems.channel.rod",
    } <= found.keys()
    for room in ("scenes", "plots", "spiked", "film"):
        assert not [name for name in found if room in name.split(".")]


def test_imports_are_found_wherever_they_are():
    source = """
import a1
class C:
    def f(self):
        try:
            import a2
        except ImportError:
            import a3
        else:
            import a4
        finally:
            import a5
        for _ in ():
            with open("x"):
                import a6
        match self:
            case 1:
                import a7
        if self: import a8
        elif not self: import a9
"""
    assert set(kept._imports(ast.parse(source))) == {f"a{k}" for k in range(1, 10)}


def test_keys_differ_by_code(tmp_path: Path, monkeypatch: Patch):
    root = tmp_path / "wormopt"
    root.mkdir()
    texts = {"maker": "from wormopt import helper", "helper": "A = 1  # one", "other": "B = 1"}

    def key(**changed: str) -> str:
        for name, text in (texts | changed).items():
            (root / f"{name}.py").write_text(text)
        code_key.cache_clear()
        kept._files.cache_clear()
        return code_key("wormopt.maker")

    monkeypatch.setattr(kept, "_ROOT", root)
    plain = key()
    assert key(helper='"""One."""\nA = 1', other="B = 2") == plain
    assert key(helper="A = 2") != plain
    assert key(maker="from wormopt import helper, other") != plain
    monkeypatch.setattr(kept, "_FORM", kept._FORM + 1)
    assert key() != plain
    code_key.cache_clear()
    kept._files.cache_clear()


def test_names_at_the_door_of_a_system_count_as_their_modules():
    found = kept._imported("wormopt.systems.coils.coil_inverse", kept._files(kept._ROOT))
    assert "wormopt.systems.film.courses" not in found  # by the name of its module
    assert "wormopt.systems.film.CarriedFilm" in found  # by the name that the stub declares
    assert "wormopt.simulation.simulate" in found  # what its module imports
