"""What the site of docs/ needs beyond MkDocs.

It makes the gallery and the pages of kinds of scene and of public names, shows notebooks as pages
and formulas as MathML, and leads links to files beside docs/.
"""

import base64
import html
import inspect
import json
import os
import posixpath
import re
import sys
import tomllib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.plugins import get_plugin_logger
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).parent
sys.path.insert(0, os.fspath(ROOT))  # the site of this checkout, whichever wormopt is installed

import wormopt  # noqa: E402
from wormopt.kinds import GROUPS as KINDS_BY_SYSTEM  # noqa: E402
from wormopt.kinds import KINDS  # noqa: E402
from wormopt.lazy import _american  # noqa: E402
from wormopt.study.reference import page as page_of_kind  # noqa: E402
from wormopt.study.scene import times_of_scenes  # noqa: E402

LOG = get_plugin_logger("wormopt")
LINK = re.compile(r"\]\(([^)#\s:]+)((?:#[^)\s]*)?)\)")
FORMULA = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)
# how much the search prefers pages, by name, to all others (1): guides come before evidence
BOOSTS = {
    "(howto|tutorials)/.*|quickstart|index": 2.0,
    "scenes|sweeps|results|pictures|export|report|python|certificates|simulation|fitting|linear|"
    "optimal|prototype|faq|api/.*": 1.5,
    "changelog|verification|benchmarks|errata|equations|readings|gallery": 0.5,
}
# what shall have no link, or code that begins with a public name or names the page of a kind
NAMED = re.compile(
    r"<(a|h[1-6]|pre)\b.*?</\1>|<code>(?:wo\.([\w.]+)|wormopt help ([\w-]+))[^<]*</code>", re.DOTALL
)


# -- public names ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Public:
    """A public name, as users write it after `wo.`, and the names in it if it is a package."""

    name: str
    thing: Any
    below: tuple["Public", ...] = ()

    @property
    def path(self) -> str:
        """Where it is defined."""
        thing = self.thing
        if inspect.ismodule(thing):
            return thing.__name__
        return f"{thing.__module__}.{thing.__qualname__}"

    @property
    def page(self) -> str:
        """Its page below docs/; `Fit` and `fit` would be one file on some systems."""
        lower = self.name.lower()
        return f"api/{self.name}{'-class' if self.name != lower and lower in NAMES else ''}.md"

    @property
    def summary(self) -> str:
        """First line of the docstring."""
        return (inspect.getdoc(self.thing) or "").partition("\n")[0]


def groups(package: ModuleType, before: str = "") -> dict[str, list[Public]]:
    """Public names of a package, by the lines "# Group: title" of its stub."""
    found: dict[str, list[Public]] = {}
    title = ""
    stub = Path(package.__file__ or "").with_suffix(".pyi")
    for line in stub.read_text(encoding="utf-8").splitlines():
        if line.startswith("# Group: "):
            title = line.removeprefix("# Group: ")
        elif named := re.fullmatch(r"from \S+ import \w+ as (\w+)", line):
            thing, name = getattr(package, named[1]), before + named[1]
            inside = groups(thing, f"{name}.").values() if inspect.ismodule(thing) else ()
            below = tuple(public for part in inside for public in part)
            found.setdefault(title, []).append(Public(name, thing, below))
    return found


GROUPS = groups(wormopt)
PUBLIC = [name for group in GROUPS.values() for top in group for name in (top, *top.below)]
NAMES = {public.name: public for public in PUBLIC}


def page_of_name(public: Public) -> str:
    """Page of a public name; mkdocstrings writes what its docstring says."""
    options = f"heading: wo.{public.name}, members: {'false' if public.below else 'null'}"
    parts = [
        f"---\ntitle: wo.{public.name}\n---",
        f"::: {public.path}\n    options: {{ {options} }}",
    ]
    if (other := _american(public.name)) != public.name:
        parts.append(f"The American spelling `wo.{other}` works too.")
    if public.below:
        parts += ["## Names", table_of_names(public.below)]
    return "\n\n".join(parts) + "\n"


def page_of_all_names() -> str:
    """Overview of the public names."""
    parts = [
        "# Python API",
        "These names are public after `import wormopt as wo`. Some examples on their pages leave "
        "out `wo.`; run `from wormopt import *` first. The examples are run as tests.",
    ]
    for title, group in GROUPS.items():
        parts += [f"## {title}", table_of_names(group)]
    return "\n\n".join(parts) + "\n"


def table_of_names(group: Iterable[Public]) -> str:
    """Table of names and the first lines of their docstrings, with links to their pages."""
    escaped = r"\|"
    rows = [
        f"| [`wo.{public.name}`]({posixpath.basename(public.page)}) "
        f"| {public.summary.replace('|', escaped)} |"
        for public in group
    ]
    return "\n".join(["| name | description |", "|---|---|", *rows])


# -- gallery ---------------------------------------------------------------------------------------


def page_of_gallery() -> str:
    """Overview of the packaged scenes, each with the picture that .ci/gallery drew."""
    cards: dict[str, list[str]] = {title: [] for title in KINDS_BY_SYSTEM}
    group_of = {kind: title for title, kinds in KINDS_BY_SYSTEM.items() for kind in kinds}
    for scene in sorted((ROOT / "problems").glob("*.toml")):
        text = scene.read_text(encoding="utf-8")
        raw = tomllib.loads(text)
        cards[group_of[raw["kind"]]].append(card_of_scene(scene.stem, raw, first_sentence(text)))
    parts = [
        "---\nhide: [navigation]\n---",
        "# Gallery",
        "All packaged scenes, with one picture each. `wormopt run NAME` computes a scene, in any "
        "folder. Times are approximate; memory is the peak of one process.",
    ]
    for title, group in cards.items():
        parts += [f"## {title}", '<div class="grid cards" markdown>', *group, "</div>"]
    return "\n\n".join(parts) + "\n"


def card_of_scene(name: str, raw: dict[str, Any], sentence: str) -> str:
    """A scene in the gallery."""
    title, kind, seconds = raw["title"], raw["kind"], times_of_scenes()[name]
    time = f"{seconds}\u00a0s" if seconds < 60 else f"{round(seconds / 60)}\u00a0min"
    return (
        f"-   ![{title}](images/gallery/{name}.webp)\n\n"
        f"    **{title}**\n\n"
        f"    {sentence}\n\n"
        f"    [`{name}`](../problems/{name}.toml) · [{kind}](scenes/{kind}.md)"
        f" · {time} · {MEMORY[name]}\u00a0MB"
    )


def first_sentence(scene: str) -> str:
    """First sentence of a scene's comment, with the names of files as code."""
    comment = re.match(r"(?:#:.*\n)?((?:# ?.*\S.*\n)+)", scene)
    words = " ".join(line.strip("# ") for line in comment[1].splitlines()) if comment else ""
    sentence = re.split(r"(?<=[.?])\s(?=[A-Z`\"])", words)[0]
    return re.sub(r"\b\w+\.(toml|py)\b", r"`\g<0>`", sentence)


MEMORY: dict[str, int] = json.loads((ROOT / "problems/memory.json").read_text(encoding="utf-8"))


# -- pages -----------------------------------------------------------------------------------------


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Put the made pages into the navigation, where .mkdocs.yml names their folders."""
    made = {"api/": list(navigation_of_names()), "scenes/": list(navigation_of_kinds())}
    config.nav = [
        {title: made.get(below, below) if isinstance(below, str) else below}
        for part in config.nav or []
        for title, below in part.items()
    ]
    return config


def navigation_of_names() -> Iterator[dict[str, Any]]:
    """Entries of the public names, by group."""
    yield {"Overview": "api/index.md"}

    def entry(public: Public) -> dict[str, Any]:
        last = public.name.rpartition(".")[2]
        inside = [{"Overview": public.page}, *map(entry, public.below)] if public.below else None
        return {last: inside or public.page}

    for title, group in GROUPS.items():
        yield {title: [entry(public) for public in group]}


def navigation_of_kinds() -> Iterator[dict[str, Any]]:
    """Entries of the kinds of scene, by system."""
    for title, kinds in KINDS_BY_SYSTEM.items():
        yield {title: [{kind: f"scenes/{kind}.md"} for kind in kinds]}


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add packaged scenes, the gallery, pages of kinds and public names, a page a notebook."""
    for scene in sorted((ROOT / "problems").glob("*.[tp]*")):  # my_worm.py too
        name = f"problems/{scene.name}"
        files.append(File.generated(config, name, abs_src_path=os.fspath(scene)))
    made = {f"scenes/{kind}.md": page_of_kind(kind) for kind in KINDS}
    made |= {"gallery.md": page_of_gallery(), "api/index.md": page_of_all_names()}
    made |= {public.page: page_of_name(public) for public in PUBLIC}
    for name, text in made.items():
        files.append(File.generated(config, name, content=text))
    for notebook in [file for file in files if file.src_uri.endswith(".ipynb")]:
        name = notebook.src_uri.removesuffix(".ipynb")
        text, pictures = page_of(json.loads(notebook.content_string), posixpath.basename(name))
        files.append(File.generated(config, f"{name}.md", content=text))
        for file, picture in pictures.items():
            place = posixpath.join(posixpath.dirname(name), file)
            files.append(File.generated(config, place, content=picture))
    return files


def page_of(notebook: dict, name: str) -> tuple[str, dict[str, bytes]]:
    """Markdown of a notebook, and the pictures on it by file name."""
    text: list[str] = []
    pictures: dict[str, bytes] = {}
    for cell in notebook["cells"]:
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            text.append(source)
            continue
        text.append(f"```python\n{source}\n```")
        for output in cell["outputs"]:
            data = output.get("data", {})
            if "image/png" in data:
                file = f"{name}_{len(pictures)}.png"
                pictures[file] = base64.b64decode(data["image/png"])
                text.append(f"![Output of the cell above]({file})")
            elif "text/html" in data:
                text.append(f'<div class="output">{"".join(data["text/html"])}</div>')
            else:
                shown = "".join(output.get("text", data.get("text/plain", ""))).rstrip()
                text.append(f"``` {{ .text .output }}\n{shown}\n```")
    text.insert(1, f'<a href="{name}.ipynb" download>This page as a notebook</a>')
    return "\n\n".join(text) + "\n", pictures


def on_page_markdown(markdown: str, page: Page, **_: object) -> str:
    """Lead links out of docs/, and to notebooks, to where the site has them; rank the page."""
    here = posixpath.dirname(page.file.src_uri)
    name = page.file.src_uri.removesuffix(".md")
    if boosts := [boost for pages, boost in BOOSTS.items() if re.fullmatch(pages, name)]:
        page.meta["search"] = {"boost": boosts[0]}

    def lead(link: re.Match[str]) -> str:
        target = posixpath.normpath(posixpath.join("docs", here, link[1]))
        if target == "README.md":
            target = "docs/index.md"
        elif target.startswith("problems/"):
            target = f"docs/{target}"
        elif target.endswith(".ipynb"):
            target = target.replace(".ipynb", ".md")
        else:
            return link[0]
        return f"]({posixpath.relpath(target, posixpath.join('docs', here))}{link[2]})"

    return LINK.sub(lead, markdown)


def on_page_content(content: str, page: Page, files: Files, **_: object) -> str:
    """Write formulas as MathML, which browsers show by themselves; link code to its reference."""

    def formula(found: re.Match[str]) -> str:
        source = html.unescape(found[2]).strip().replace(r"\arg", r"\operatorname{arg}")
        made = convert(source, display="block" if found[1] == "div" else "inline")
        made = re.sub(r">\\([{}])<", r">\1<", made)  # braces of \Big
        if unknown := re.findall(r">(\\\w*)", made):
            LOG.warning("no MathML for %s in %s", unknown, source)
        return made

    def link(found: re.Match[str]) -> str:
        target = files.get_file_from_path(page_named(found[2] or "", found[3] or ""))
        if not target or target == page.file:
            return found[0]
        return f'<a href="{target.url_relative_to(page.file)}">{found[0]}</a>'

    return NAMED.sub(link, FORMULA.sub(formula, content))


def page_named(name: str, kind: str) -> str:
    """Page of a kind, or of the public name with which another begins; "" where there is none."""
    if kind:
        return f"scenes/{kind}.md"
    while name and name not in NAMES:
        name = name.rpartition(".")[0]
    return NAMES[name].page if name else ""
