"""Gaits in and out of files: CSV tables and saved Results."""

from __future__ import annotations

from pathlib import Path

from wormopt.errors import ArgumentError
from wormopt.model.gait import Gait
from wormopt.result import Result

_DIMS = {
    "breaks": ("gait_break",),
    "polynomial": ("gait_piece", "link", "gait_power"),
    "omega": ("gait_piece",),
    "cosine": ("gait_piece", "link"),
    "sine": ("gait_piece", "link"),
}


def gait_of_result(result: Result) -> Gait:
    """Read the gait out of a Result; raises ArgumentError if it holds none."""
    if "gait_polynomial" not in result:
        raise ArgumentError(f"the result of scene {result.scene!r} holds no gait")
    return Gait(**{k: result[f"gait_{k}"].values for k in _DIMS if f"gait_{k}" in result})


def load_gait(path: str | Path) -> Gait:
    """Load a gait from a CSV table (t, l_1..l_n) or from a saved Result.

    Parameters
    ----------
    path : str or Path
        A ``.csv`` file, a ``result.nc``, or a result's folder.

    Returns
    -------
    Gait

    Raises
    ------
    OSError
        If the file cannot be read.
    ArgumentError
        If it is neither a gait table nor a result with a gait.
    """
    path = Path(path)
    if path.suffix.lower() == ".csv":
        return Gait.from_csv(path)
    return gait_of_result(Result.load(path))
