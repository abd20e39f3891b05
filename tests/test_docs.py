"""Pages: links lead somewhere, modules that are named exist, the README's programs run."""

import re
from pathlib import Path

import pytest

import wormopt as wo

ROOT = Path(__file__).parents[1]
PAGES = sorted([*(ROOT / "docs").rglob("*.md"), ROOT / "README.md"])


def anchors(page: Path) -> set[str]:
    """Anchors of a page's headings, as GitHub makes them."""
    found = set()
    for heading in re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), re.MULTILINE):
        plain = re.sub(r"<[^>]+>|[`*]", "", heading.strip().lower())
        found.add(re.sub(r"[^\w\- ]", "", plain).replace(" ", "-"))
    return found


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path):
    text = page.read_text(encoding="utf-8")
    for target, anchor in re.findall(r"\]\(([^)#\s]*)(?:#([^)\s]*))?\)", text):
        if target.startswith("http"):
            continue
        file = (page.parent / target).resolve() if target else page
        assert file.exists(), target
        assert not anchor or file.suffix != ".md" or anchor in anchors(file), f"{target}#{anchor}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_modules_that_pages_name_exist(page: Path):
    text = page.read_text(encoding="utf-8")
    for name in re.findall(r"`((?:\w+/)+\w+\.py)`", text):
        there = [ROOT / name, ROOT / "wormopt" / name, ROOT / "wormopt" / "systems" / name]
        assert any(path.exists() for path in there), name


def test_the_problem_of_the_readme_is_solved(capsys: pytest.CaptureFixture[str]):
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    (program,) = [
        b for b in re.findall(r"```python\n(.*?)```", text, re.DOTALL) if "wo.Problem" in b
    ]
    exec(compile(program, "README.md", "exec"), {"__name__": "page", "wo": wo})
    assert float(capsys.readouterr().out.split()[0]) == pytest.approx(1.5**0.5, rel=1e-8)
