"""What the site of docs/ needs beyond MkDocs: formulas, notebooks as pages, files beside docs/."""

import base64
import html
import json
import os
import posixpath
import re
from pathlib import Path

from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.plugins import get_plugin_logger
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

LOG = get_plugin_logger("formulas")
ROOT = Path(__file__).parent
LINK = re.compile(r"\]\(([^)#\s:]+)((?:#[^)\s]*)?)\)")
FORMULA = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the packaged scenes, and a page for every notebook."""
    for scene in sorted((ROOT / "problems").glob("*.[tp]*")):  # my_worm.py too
        name = f"problems/{scene.name}"
        files.append(File.generated(config, name, abs_src_path=os.fspath(scene)))
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
    """Lead links out of docs/, and to notebooks, to where the site has them."""
    here = posixpath.dirname(page.file.src_uri)

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


def on_page_content(content: str, **_: object) -> str:
    """Write formulas as MathML, which browsers show by themselves."""

    def formula(found: re.Match[str]) -> str:
        source = html.unescape(found[2]).strip().replace(r"\arg", r"\operatorname{arg}")
        made = convert(source, display="block" if found[1] == "div" else "inline")
        made = re.sub(r">\\([{}])<", r">\1<", made)  # braces of \Big
        if unknown := re.findall(r">(\\\w*)", made):
            LOG.warning("no MathML for %s in %s", unknown, source)
        return made

    return FORMULA.sub(formula, content)
