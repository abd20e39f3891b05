"""The site has a page for every kind of scene and every public name, and its code links to them.

Its gallery shows every packaged scene.
"""

import importlib.util
import inspect
import re
import sys
import tomllib
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from places import ROOT

import wormopt as wo
from wormopt.kinds import KINDS
from wormopt.study.scene import packaged_scenes

pytest.importorskip("mkdocs", reason="the extra docs is not installed")
pytest.importorskip("latex2mathml", reason="the extra docs is not installed")


@pytest.fixture(scope="module")
def hook() -> ModuleType:
    """The module of which MkDocs calls on_config and others."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "path", [*sys.path])  # it puts the checkout first
        spec = importlib.util.spec_from_file_location("site_hook", ROOT / ".mkdocs.py")
        assert spec
        assert spec.loader
        module = importlib.util.module_from_spec(spec)
        patch.setitem(sys.modules, "site_hook", module)
        spec.loader.exec_module(module)
        return module


def leaves(entries: Any) -> list[str]:
    """Pages of a navigation."""
    if isinstance(entries, str):
        return [entries]
    parts = entries.values() if isinstance(entries, dict) else entries
    return [page for part in parts for page in leaves(part)]


def test_every_public_name_has_a_page(hook: ModuleType):
    packages = [name for name in wo.__all__ if inspect.ismodule(getattr(wo, name))]
    names = {*wo.__all__, *(f"{p}.{name}" for p in packages for name in getattr(wo, p).__all__)}
    assert set(hook.NAMES) == names
    pages = leaves(list(hook.navigation_of_names()))
    assert sorted(pages) == sorted(["api/index.md", *(name.page for name in hook.PUBLIC)])
    # also where upper and lower case are the same
    assert len({page.lower() for page in pages}) == len(pages)
    overview = hook.page_of_all_names()
    for public in hook.PUBLIC:
        text = hook.page_of_name(public)
        assert f"title: wo.{public.name}\n" in text
        assert f"heading: wo.{public.name}," in text
        above, _, _ = public.name.rpartition(".")
        table = hook.page_of_name(hook.NAMES[above]) if above else overview
        assert f"| [`wo.{public.name}`]({Path(public.page).name}) | {public.summary[:3]}" in table


def test_every_kind_has_a_page(hook: ModuleType):
    pages = leaves(list(hook.navigation_of_kinds()))
    assert sorted(pages) == sorted(f"scenes/{kind}.md" for kind in KINDS)


def test_every_packaged_scene_is_in_the_gallery(hook: ModuleType):
    cards = hook.page_of_gallery().split("\n-   ")[1:]
    assert len(cards) == len(packaged_scenes())
    for scene in packaged_scenes():
        (card,) = [card for card in cards if f"(../problems/{scene}.toml)" in card]
        raw = tomllib.loads((ROOT / "problems" / f"{scene}.toml").read_text(encoding="utf-8"))
        assert card.startswith(f"![{raw['title']}](images/gallery/{scene}.webp)")
        sentence = card.split("\n\n")[2].strip()
        assert len(sentence) > 20, scene
        assert sentence[-1] in ".?", scene
        assert re.search(r" · \d+\u00a0(s|min) · \d+\u00a0MB$", card, re.MULTILINE)


def test_the_sentence_of_a_scene_ends_where_it_ends(hook: ModuleType):
    comment = (
        "#:schema ./x.json\n# As in a.toml (eq. 15 of Behn et al. 2007): all\n# of it. More.\n#\n"
    )
    assert hook.first_sentence(comment) == "As in `a.toml` (eq. 15 of Behn et al. 2007): all of it."
    assert hook.first_sentence("schema = 1\n# No.\n") == ""


def test_the_search_ranks_pages_that_exist(hook: ModuleType):
    folders = ("howto", "tutorials", "api", "scenes")
    for name in {name for pages in hook.BOOSTS for name in re.findall(r"[\w-]+", pages)}:
        assert name in (*folders, "gallery") or (ROOT / f"docs/{name}.md").exists(), name


@pytest.mark.parametrize(
    ("code", "page"),
    [
        ("wo.design", "api/design.md"),
        ("wo.Design", "api/Design-class.md"),
        ("wo.design(worm, limits)", "api/design.md"),
        ("wo.Result.save", "api/Result.md"),
        ("wo.film.CosineWave", "api/film.CosineWave.md"),
        ("wormopt help gait-design", "scenes/gait-design.md"),
        ("wo.nothing", ""),
    ],
)
def test_code_links_to_its_page(hook: ModuleType, code: str, page: str):
    found = re.fullmatch(hook.NAMED, f"<code>{code}</code>")
    assert found
    assert hook.page_named(found[2] or "", found[3] or "") == page


@pytest.mark.parametrize("text", ["<pre><code>wo.design</code></pre>", "<h2><code>wo.run</code>"])
def test_blocks_and_headings_get_no_links(hook: ModuleType, text: str):
    whole = text if "pre" in text else f"{text}</h2>"
    assert [found[2] for found in re.finditer(hook.NAMED, whole)] == [None]


def test_types_of_docstrings_are_read_as_words():
    griffe = pytest.importorskip("griffe")
    spec = importlib.util.spec_from_file_location("site_types", ROOT / ".mkdocs_types.py")
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    said = griffe.Function("f", docstring=griffe.Docstring(
        "Do.\n\nParameters\n----------\n"
        "x : array_like, shape (n,), optional\n    One of a, b or c.\n"
        "how : Exact, Smooth or str, optional\n    How.\n"
    ))  # fmt: skip
    module.Types().on_object(obj=said)
    text = said.docstring.value
    assert "x : array_like of shape (n,), optional\n    One of a, b or c.\n" in text
    assert "how : Exact or Smooth or str, optional\n" in text
