"""How a study says how far it is.

A study is given a `Report` and calls it with what it is doing and the fraction done (None where
that is unknown). Who listens, and whether a terminal is there at all, is not its concern.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

Report = Callable[[str, "float | None"], None]


def silent(text: str, fraction: float | None = None) -> None:
    """Report nothing.

    Parameters
    ----------
    text : str
        What is being done.
    fraction : float, optional
        Share of the work done, 0 to 1; None where unknown.

    Examples
    --------
    >>> silent("searching sequences", 0.5)
    """


@contextmanager
def shown_on_terminal(quiet: bool = False) -> Iterator[Report]:
    """Give a `Report` that draws a progress bar on stderr while the context lasts.

    Parameters
    ----------
    quiet : bool
        Show nothing. Nothing is shown either where stderr is no terminal, and the drawing
        library is not even loaded then.

    Yields
    ------
    Report
        The function to hand to a study.

    Examples
    --------
    >>> with shown_on_terminal(quiet=True) as report:
    ...     report("polishing", None)
    """
    if quiet or not sys.stderr.isatty():
        yield silent
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
