"""Gaits in and out of files: CSV tables and saved Results."""

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
    """Read the gait out of a Result, or that of a point of a front; ArgumentError if none."""
    if point is not None:
        return _gait_of_point(result, point)
    if "gait_polynomial" not in result:
        raise ArgumentError(f"the result of scene {result.scene!r} holds no gait")
    return Gait(**{k: result[f"gait_{k}"].values for k in _DIMS if f"gait_{k}" in result})


def _gait_of_point(result: Result, point: int) -> Gait:
    if "front_gait_polynomial" not in result:
        raise ArgumentError(f"the result of scene {result.scene!r} holds no front; leave out point")
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
        Of a front (kind ``gait-pareto``) the point, from 0, the slowest; its knee if left out.
    units : {"dimensionless", "SI"}, optional
        What the gait is for: lengths in m and times in s, or numbers without units. By default
        units of a table are converted to SI, and those of a result are left as they are.

    Returns
    -------
    Gait

    Raises
    ------
    OSError
        If the file cannot be read.
    ArgumentError
        If it is neither a gait table nor a result with a gait, has no such point, or other units.

    Examples
    --------
    >>> import wormopt as wo
    >>> wo.fast_gait(1.0).to_csv("gait.csv", step=0.01)
    >>> gait = load_gait("gait.csv")
    >>> gait.period, gait.links, gait([0.0]).round(6).ravel()
    (1.0, 2, array([2., 2.]))
    """
    path = Path(path)
    if path.suffix.lower() in SUFFIXES:
        if point is not None:
            raise ArgumentError("a gait table holds one gait; leave out point")
        return Gait.from_csv(path, units=units or "SI")
    result = Result.load(path)
    gait = gait_of_result(result, point)
    unit = result["gait_polynomial"].unit if "gait_polynomial" in result else "1"
    if units == "SI" and unit not in ("1", "m"):
        raise ArgumentError(f"its gait is in {unit}, not in m; name a result with lengths of links")
    if units == "dimensionless" and unit != "1":
        what = f'its gait is in {unit}, in a scene without units; write units = "SI"'
        raise ArgumentError(f"{what}, or write a table without units")
    return gait
