"""Pages of reports, and a reader that checks whether they are whole."""

import re
from collections import Counter
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import wormopt as wo

VOID = {"meta", "input", "br", "img", "hr", "link"}


class Whole(HTMLParser):
    """Reads a page strictly: what is opened is closed, in order."""

    def __init__(self, text: str) -> None:
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.ids: list[str] = []
        self.names: Counter[str] = Counter()
        self.attributes: set[str] = set()
        self.holders: set[str] = set()
        self.words: list[str] = []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.names[tag] += 1
        assert all(not name.startswith("on") for name, _ in attrs), attrs
        assert all(count == 1 for count in Counter(name for name, _ in attrs).values())
        self.attributes |= {name for name, _ in attrs}
        self.ids += [value or "" for name, value in attrs if name == "id"]
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.holders |= {*self.open[-1:]} if data.strip() else set()
        if not {"script", "style"} & {*self.open}:
            self.words.append(data)

    @property
    def text(self) -> str:
        return re.sub(r"[ \n]+", " ", " ".join(self.words))


def page_of(results: Any, folder: Path, **options: Any) -> str:
    path = folder / "page.html"
    wo.report(results, path, force=True, **options)
    return path.read_text("utf-8")
