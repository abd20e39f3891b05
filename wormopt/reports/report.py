"""The verb `report`: writes results to one HTML page."""

from __future__ import annotations

import base64
import hashlib
import platform
from collections.abc import Sequence
from datetime import UTC, datetime
from importlib.resources import files
from pathlib import Path
from string import Template

from wormopt.errors import ArgumentError, OutputError
from wormopt.files import write_files
from wormopt.kinds import KINDS
from wormopt.reports import numbers, sweep
from wormopt.reports.parts import escaped, sentence, value_text
from wormopt.reports.pictures import pictures
from wormopt.reports.source import Source, again_html, asked_html
from wormopt.reports.worm import motion_of
from wormopt.result import Result
from wormopt.version import VERSION

LARGEST = 5_000_000
"""Largest size of a page in bytes: many mail servers refuse more."""
_ROOM, _WORDS = 4_500_000.0, 120_000.0  # letters of all sections, and of the words of one


def compose(sources: Sequence[Source], title: str) -> str:
    """Make the page."""
    results = [source.result for source in sources]
    alone = len(sources) == 1
    title = title or (
        results[0].title or results[0].scene if alone else f"{len(results)} results side by side"
    )
    sections, room = "", _ROOM
    for done, source in enumerate(sources):
        left = len(sources) - done  # each gets at least its words, and an equal share of the rest
        part = _section(source, done, results, max(room - _WORDS * (left - 1), room / left))
        sections, room = sections + part, max(room - len(part), 0.0)
    before = "" if alone else _contents(sources)
    script, style = _own("page.js"), _own("page.css")
    return Template(_own("page.html")).substitute(
        policy=_policy(script),
        title=escaped(title),
        style=style,
        script=script,
        before=before,
        sections=sections,
        made=f"Made by wormopt {VERSION} on {datetime.now(UTC):%Y-%m-%d}, Python "
        f"{platform.python_version()}, {escaped(platform.system())} "
        f"({escaped(platform.machine())}). The page loads nothing from elsewhere.",
    )


def _own(name: str) -> str:
    return (files("wormopt.reports") / name).read_text("utf-8")


def _policy(script: str) -> str:
    """Content security policy: a browser loads only content of the page itself."""
    found = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    return (
        f"default-src 'none'; script-src 'sha256-{found}'; style-src 'unsafe-inline'; "
        "img-src data:; base-uri 'none'; form-action 'none'"
    )


def _contents(sources: Sequence[Source]) -> str:
    results = [source.result for source in sources]
    items = "".join(
        f'<li><a href="#r{k}">{escaped(r.title or r.scene)}</a> {numbers.told_apart(r, results)}'
        f"{'' if r.status == 'ok' else f' – {r.status}'}</li>"
        for k, r in enumerate(results)
    )
    return (
        '<nav aria-labelledby="contents"><h2 id="contents">Contents</h2>'
        f'<ol start="0">{items}</ol></nav>'
        '<section aria-labelledby="beside"><h2 id="beside">Side by side</h2>'
        f"{numbers.comparison_html(results)}</section>"
    )


def _section(source: Source, number: int, results: Sequence[Result], room: float) -> str:
    """One of several results, with its own heading, or the only one."""
    room -= min(_WORDS, room / 2)
    result, ident = source.result, f"r{number}"
    own, labelled, level = "", "title", 2
    if len(results) > 1:
        labelled, level = f"{ident}-title", 3
        name, apart = escaped(result.title or result.scene), numbers.told_apart(result, results)
        own = f'<h2 id="{labelled}">{number}. {name}</h2>' + (apart and f"<p>{apart}</p>")
    parts = [
        f'<section class="result" id="{ident}" aria-labelledby="{labelled}">{own}',
        f'<p class="asked">{escaped(_summary(result))}</p>',
        numbers.status_html(result),
    ]

    def part(heading: str, html: str) -> None:
        if html:
            parts.append(f'<h{level}>{heading}</h{level}><div class="part">{html}</div>')

    swept = result.kind == "sweep"
    if swept:
        part("The sweep", sweep.sweep_html(source, ident, room) + numbers.table_html(result))
    else:
        part("The answer", numbers.headline_html(result) + numbers.table_html(result))
    motion = motion_of(result, f"{ident}-motion", room)
    room -= len(motion)
    part("The motion", motion)
    part("What was asked", asked_html(result))
    part("Pictures", "".join(p.html() for p in pictures(result, ident, room)) if not swept else "")
    part("How far to trust it", numbers.trust_html(result))
    part("Where it comes from", _provenance(source))
    return "".join([*parts, "</section>"])


def _summary(result: Result) -> str:
    """Purpose of a scene of this kind; for a sweep, that of each point."""
    kind = (
        str(result.attributes.get("kind", result.kind)) if result.kind == "sweep" else result.kind
    )
    summary = sentence(KINDS[kind].summary) if kind in KINDS else ""
    swept = "A sweep. " if result.kind == "sweep" else ""
    return f"{swept}{summary} Kind of scene: {kind}.".strip()


def _provenance(source: Source) -> str:
    result = source.result
    known = {
        "scene": result.scene,
        "computed by": f"wormopt {source.version}".strip(),
        "file of": source.computed,
    }
    rows = [(name, value) for name, value in known.items() if value]
    rows += [
        (f"time to {name}" if name != "study" else "time in all", value_text(spent, "s", 3))
        for name, spent in result.timings_s.items()
    ]
    facts = "".join(f"<dt>{escaped(n)}</dt><dd>{escaped(value)}</dd>" for n, value in rows)
    return f'<dl class="facts">{facts}</dl>{again_html(result)}'


def report(
    results: Result | str | Path | Sequence[Result | str | Path],
    path: str | Path,
    *,
    title: str = "",
    force: bool = False,
) -> None:
    """Write results as one self-contained HTML page.

    The page contains the problem, the results, pictures, an animation of the worm, checks,
    warnings, and the scene to run again. It loads no other files, can be read without scripts and
    on paper, and has at most 5 MB. File names in it contain no folders of this machine.

    Parameters
    ----------
    results : Result, path, or sequence of these
        Results, folders of results or ``result.nc`` files. Several are compared side by side.
    path : path
        The file to write, which ends in ".html"; missing folders are created.
    title : str
        Title of the page; by default that of the one result.
    force : bool
        Whether an earlier report of wormopt with this name is replaced; other files never are.

    Raises
    ------
    ArgumentError
        If there is no result, or one cannot be read, or they are too many for a page.
    OutputError
        If the file has another ending, is there already, or cannot be written.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> import wormopt as wo
    >>> with TemporaryDirectory() as folder:
    ...     page = Path(folder) / "report.html"
    ...     wo.report(wo.run("fast_gait", {"want": []}), page)
    ...     "Fast gait (15) of a three-mass worm" in page.read_text("utf-8")
    True
    """
    from wormopt.reports.source import source_of

    given = [results] if isinstance(results, Result | str | Path) else list(results)
    if not given:
        raise ArgumentError("there is no result to report; give at least one")
    path = Path(path)
    if path.suffix.lower() != ".html" and not path.is_dir():
        raise OutputError(f"{path}: a report is an HTML page; write a name that ends in .html")
    page = compose([source_of(one) for one in given], title).encode("utf-8", errors="replace")
    if len(page) > LARGEST:
        raise ArgumentError(
            f"the page would have {len(page) / 1e6:.1f} MB, at most {LARGEST / 1e6:g} can be sent "
            "by mail; report fewer results on a page"
        )
    write_files({path: page}, force=force)
