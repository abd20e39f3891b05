"""Pages: links lead somewhere, modules that are named exist, the README's programs run.

The site has all pages; every packaged scene has a picture for the gallery.
"""

import ast
import json
import re
import runpy
from pathlib import Path

import pytest
from hints import Capture, Patch
from places import ROOT

import wormopt as wo
from tests.benchmarks import CASES
from tests.stress import GROUPS
from wormopt.cli import main, parser
from wormopt.kinds import KINDS
from wormopt.study.reference import page as page_of_kind

DOCS = ROOT / "docs"
PAGES = sorted([*DOCS.rglob("*.md"), *DOCS.rglob("*.ipynb"), ROOT / "README.md"])
# pages that the site makes, as they would be named below docs/
KIND_PAGES = {DOCS / "scenes" / f"{kind}.md": kind for kind in KINDS}
MADE = {*KIND_PAGES, DOCS / "gallery.md"}
SCENES = sorted((ROOT / "problems").glob("*.toml"))
MEASURED = {"benchmarks": CASES, "stress": GROUPS}
VERBS = set(re.findall(r"^    ([a-z]+)", parser().format_help(), re.MULTILINE))
GALLERY = runpy.run_path(str(ROOT / ".ci" / "gallery"))


def text_of(page: Path) -> str:
    """Markdown of a page or a notebook, or of one that the site makes."""
    if page in KIND_PAGES:
        return page_of_kind(KIND_PAGES[page])
    text = page.read_text(encoding="utf-8")
    if page.suffix != ".ipynb":
        return text
    cells = [cell for cell in json.loads(text)["cells"] if cell["cell_type"] == "markdown"]
    return "\n\n".join("".join(cell["source"]) for cell in cells)


def anchors(page: Path) -> set[str]:
    """Anchors of a page's headings, as GitHub makes them."""
    found = set()
    for heading in re.findall(r"^#+ (.*)$", text_of(page), re.MULTILINE):
        plain = re.sub(r"<[^>]+>|[`*]", "", heading.strip().lower())
        found.add(re.sub(r"[^\w\- ]", "", plain).replace(" ", "-"))
    return found


@pytest.mark.parametrize("page", [*PAGES, *KIND_PAGES], ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path):
    text = text_of(page)
    for target, anchor in re.findall(r"\]\(([^)#\s]*)(?:#([^)\s]*))?\)", text):
        if target.startswith("http"):
            continue
        file = (page.parent / target).resolve() if target else page
        assert file in MADE or file.exists(), target
        assert not anchor or file.suffix != ".md" or anchor in anchors(file), f"{target}#{anchor}"


def test_the_site_leads_to_every_page():
    named = set(re.findall(r"[\w/-]+\.md", (ROOT / ".mkdocs.yml").read_text(encoding="utf-8")))
    pages = [page.relative_to(DOCS) for page in PAGES if DOCS in page.parents]
    assert named == {page.with_suffix(".md").as_posix() for page in pages} | {"gallery.md"}


@pytest.mark.parametrize("scene", SCENES, ids=lambda scene: scene.stem)
def test_a_packaged_scene_has_a_picture(scene: Path):
    """Made anew by: .ci/gallery SCENE."""
    picture = (DOCS / "images" / "gallery" / f"{scene.stem}.webp").read_bytes()
    assert (picture[:4], picture[8:12]) == (b"RIFF", b"WEBP")
    assert len(picture) <= 150_000
    drawn = json.loads((DOCS / "images" / "gallery" / "drawn.json").read_text(encoding="utf-8"))
    assert drawn[scene.stem] == GALLERY["drawn_by"](scene.stem), "older than what draws it"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_modules_and_commands_that_pages_name_exist(page: Path):
    text = page.read_text(encoding="utf-8")
    for name in re.findall(r"`((?:\w+/)+\w+\.py)`", text):
        there = [ROOT / name, ROOT / "wormopt" / name, ROOT / "wormopt" / "systems" / name]
        assert any(path.exists() for path in there), name
    if page.name == "changelog.md":
        return
    for verb in re.findall(r"(?:`|bin/)wormopt ([a-z]\w*)", text):
        assert verb in VERBS | {"certificate"}, verb  # which is the name of a format
    for module, names in re.findall(r"python -m tests\.(benchmarks|stress)((?: [a-z]\w*)*)", text):
        assert set(names.split()) <= set(MEASURED[module]), names


def proofs() -> set[tuple[str, str]]:
    """Files and names of the tests that prove equations of our own expressions."""
    files = [*(ROOT / "tests/project").glob("test_equations_*.py")]
    files += [ROOT / "tests/systems/film/test_film_next_order.py"]
    return {
        (file.name, node.name)
        for file in files
        for node in ast.parse(file.read_text("utf-8")).body
        if isinstance(node, ast.FunctionDef) and node.name.startswith("test_")
    }


def test_every_equation_has_a_row_and_a_proof():
    text = (DOCS / "equations.md").read_text("utf-8")
    rows = [line for line in text.splitlines() if line.startswith("| ") and "`" in line]
    known, named = proofs(), set[tuple[str, str]]()
    for row in rows:
        found = re.findall(r"`(?:(test_\w+\.py)::)?(test_\w+)`", row)
        modules = re.findall(r"`((?:\w+/)*\w+\.py)`", row)
        assert found, row
        assert modules, row
        assert all((ROOT / "wormopt" / module).exists() for module in modules), row
        for file, name in found:
            here = {pair for pair in known if pair[1] == name and file in ("", pair[0])}
            assert len(here) == 1, name
            named |= here
    numbers = [int(n) for row in rows for n in re.findall(r"\((\d+)\)", row.split("|")[1])]
    assert sorted(numbers) == list(range(1, 37))
    about_ourselves = {"test_pack_is_the_order_of_symbols"}
    left_out = {pair for pair in known - named if pair[0] != "test_film_next_order.py"}
    assert {name for _, name in left_out} == about_ourselves


def test_the_readme_and_the_list_of_scenes_name_every_kind():
    for page in (ROOT / "README.md", DOCS / "scenes.md"):
        text = page.read_text(encoding="utf-8")
        assert [kind for kind in KINDS if f"`{kind}`" not in text] == []


def test_the_problem_of_the_readme_is_solved(capsys: Capture):
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    programs = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    (program,) = (program for program in programs if "wo.Problem" in program)
    exec(compile(program, "README.md", "exec"), {"__name__": "page", "wo": wo})
    assert float(capsys.readouterr().out.split()[0]) == pytest.approx(1.5**0.5, rel=1e-8)


@pytest.mark.parametrize(
    "words",
    [
        ["check", "design_fast_gait", "--set", "worm.lode=3"],
        ["check", "nosuch"],
        ["new", "gait_design"],
        ["check", "design_fast_gait", "--set", "worm.mass=[1, 2]"],
        ["check", "design_fast_gait", "--set", "gait.rate=100 mm/s"],
        ["check", "design_fast_gait", "--set", "worm.slope=10"],
        ["run", "design_fast_gait", "--set", "objective={minimise='peak_spike_load', speed=1.2}"],
    ],
)
def test_errors_are_quoted_as_they_are_printed(
    words: list[str], capsys: Capture, tmp_path: Path, monkeypatch: Patch
):
    monkeypatch.chdir(tmp_path)
    try:
        code = main(words)
    except SystemExit as ended:
        code = ended.code
    assert code in (2, 3)
    printed = capsys.readouterr().err.splitlines()
    assert printed[-1] in (DOCS / "faq.md").read_text(encoding="utf-8").splitlines()
