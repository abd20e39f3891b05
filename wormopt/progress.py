"""Reports of the progress of studies.

A study calls its `Report` with the present step and the fraction done (None if unknown). It does
not depend on who listens, or whether there is a terminal.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import monotonic

# Seconds to the first line without a terminal, and longest between two lines.
_FIRST_LINE, _RAREST_LINE = 10.0, 300.0

Report = Callable[[str, "float | None"], None]


def silent(text: str, fraction: float | None = None) -> None:
    """Report nothing."""


@contextmanager
def shown_on_stderr(quiet: bool = False) -> Iterator[Report]:
    """Yield a `Report` that shows progress on stderr during the context."""
    # A bar on a terminal; elsewhere a line now and then, the first after ten seconds, without
    # loading the drawing library.
    if quiet or not sys.stderr.isatty():
        yield silent if quiet else _lines()
        return

    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = TextColumn("{task.description}", markup=False), BarColumn(), TimeElapsedColumn()
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("starting", total=None)

        def report(text: str, fraction: float | None = None) -> None:
            if fraction is None:
                bar.update(task, description=text, total=None)
            else:
                bar.update(task, description=text, total=1.0, completed=fraction)

        yield report


def _lines() -> Report:
    """Write a line every ten seconds, less often in long runs."""
    start, due = monotonic(), _FIRST_LINE

    def report(text: str, fraction: float | None = None) -> None:
        nonlocal due
        spent = monotonic() - start
        if spent < due:
            return
        due = spent + min(max(spent / 2, _FIRST_LINE), _RAREST_LINE)
        share = "" if fraction is None else f", {fraction:.0%}"
        sys.stderr.write(f"{spent:.0f} s: {text}{share}\n")
        sys.stderr.flush()

    return report
