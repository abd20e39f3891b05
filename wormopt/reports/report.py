"""The verb `report`: writes results to one page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from wormopt.errors import ArgumentError
from wormopt.files import write_files
from wormopt.result import Result


def report(
    results: Result | str | Path | Sequence[Result | str | Path],
    path: str | Path,
    *,
    title: str = "",
    force: bool = False,
) -> None:
    """Write results as one HTML page that can be read without anything else.

    The page holds what was asked and found, pictures, the worm moving, checks and warnings, and
    the scene to run again. It loads nothing from elsewhere, can be read without scripts and on
    paper, and has at most 5 MB. File names in it have no folders of this machine.

    Parameters
    ----------
    results : Result, path, or sequence of these
        Results, folders of results or ``result.nc`` files. Several are compared side by side.
    path : path
        The file to write; folders on the way are made.
    title : str
        Title of the page; by default that of the one result.
    force : bool
        Whether an earlier report of that name is replaced; never what others made.

    Raises
    ------
    ArgumentError
        If there is no result, or one cannot be read, or they are too many for a page.
    OutputError
        If the file is there already, or cannot be written.

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
    from wormopt.reports.page import LARGEST, compose
    from wormopt.reports.source import source_of

    given = [results] if isinstance(results, Result | str | Path) else list(results)
    if not given:
        raise ArgumentError("there is no result to report; give at least one")
    path = Path(path)
    page = compose([source_of(one) for one in given], title).encode("utf-8", errors="replace")
    if len(page) > LARGEST:
        raise ArgumentError(
            f"the page would have {len(page) / 1e6:.1f} MB, at most {LARGEST / 1e6:g} can be sent "
            "by mail; report fewer results on a page"
        )
    write_files({path: page}, force=force)
