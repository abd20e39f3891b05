"""Checks of arguments."""

from __future__ import annotations

from wormopt.errors import ArgumentError
from wormopt.fitting.estimate import Fit


def check_fit(found: object) -> None:
    """Raise ArgumentError for anything but the result of `fit`."""
    if not isinstance(found, Fit):
        raise ArgumentError(f"found must be a Fit, as fit returns it, not {type(found).__name__}")


def check_level(level: object) -> None:
    """Raise ArgumentError for a level not between 0 and 1."""
    if not (isinstance(level, int | float) and 0 < level < 1):
        raise ArgumentError(f"level must lie between 0 and 1, not {level!r}")
