"""Reads gaits from files: tables and saved Results."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np

from wormopt.errors import ArgumentError, UnknownNameError
from wormopt.model.gait import Gait
from wormopt.result import Result
from wormopt.tables import SUFFIXES

_DIMS = {
    "breaks": ("gait_break",),
    "polynomial": ("gait_piece", "link", "gait_power"),
    "omega": ("gait_piece",),
    "cosine": ("gait_piece", "link"),
    "sine": ("gait_piece", "link"),
}


def gait_of_result(result: Result, point: int | None = None) -> Gait:
    """Read the gait of a Result, or of a point of a front; ArgumentError if there is none."""
    if point is not None:
        return _gait_of_point(result, point)
    if "gait_polynomial" not in result:
        raise ArgumentError(f"the result of scene {result.scene!r} contains no gait")
    return Gait(**{k: result[f"gait_{k}"].values for k in _DIMS if f"gait_{k}" in result})


def _gait_of_point(result: Result, point: int) -> Gait:
    if "front_gait_polynomial" not in result:
        raise ArgumentError(f"the result of scene {result.scene!r} contains no front; omit point")
    breaks, pieces = (result[f"front_gait_{name}"].values for name in ("breaks", "polynomial"))
    if point not in range(len(breaks)):
        where = f"the front of scene {result.scene!r}"
        raise UnknownNameError(where, "point", [point], map(str, range(len(breaks))))
    own = breaks[point][np.isfinite(breaks[point])]
    return Gait(own, pieces[point][: len(own) - 1])


def load_gait(
    path: str | Path,
    point: int | None = None,
    units: Literal["dimensionless", "SI"] | None = None,
) -> Gait:
    """Load a gait from a table (t, l_0, l_1, ...) or from a saved Result.

    Parameters
    ----------
    path : str or Path
        A text file (``.csv``, ``.txt``, ``.tsv``, ``.dat``), a ``result.nc``, or a result's folder.
    point : int, optional
        Point of a front (kind ``gait-pareto``), numbered from 0, the slowest. The default is its
        knee.
    units : {"dimensionless", "SI"}, optional
        Units of the returned gait: lengths in m and times in s, or no units. By default, a table
        is converted to SI, and a result keeps its units.

    Returns
    -------
    Gait
        Link lengths over one closed period.

    Raises
    ------
    OSError
        If the file cannot be read.
    ArgumentError
        If it contains no gait, has no such point, or has other units.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import wormopt as wo
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "gait.csv"
    ...     wo.fast_gait(1.0).to_csv(path)
    ...     gait = wo.load_gait(path, units="dimensionless")
    >>> gait.links, gait.period
    (2, 1.0)
    """
    path = Path(path)
    if path.suffix.lower() in SUFFIXES:
        if point is not None:
            raise ArgumentError("point is given, but a gait table contains one gait; omit point")
        return Gait.from_csv(path, units=units or "SI")
    result = Result.load(path)
    gait = gait_of_result(result, point)
    unit = result["gait_polynomial"].unit if "gait_polynomial" in result else "1"
    if units == "SI" and unit not in ("1", "m"):
        raise ArgumentError(f"the gait is in {unit}, not in m; name a result with link lengths")
    if units == "dimensionless" and unit != "1":
        what = f'the gait is in {unit}, but units are dimensionless; write units = "SI"'
        raise ArgumentError(f"{what}, or write a table without units")
    return gait
