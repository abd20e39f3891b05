"""Numbers that users give, one for all or one for each, kept frozen and checked."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from numbers import Real
from typing import Any

from wormopt.errors import Fault

__all__ = ["Frozen", "Numbers", "faults_of_numbers", "per", "wrong_order"]

Numbers = float | Sequence[float]


def per(value: Numbers, count: int) -> tuple[float, ...]:
    """One number for each of `count` things, from one number or a list.

    Parameters
    ----------
    value : float or sequence of float
        A list is given back as it is, as a tuple.
    count : int
        How many are needed.

    Examples
    --------
    >>> per(2.0, 3)
    (2.0, 2.0, 2.0)
    """
    return tuple(value) if isinstance(value, Iterable) else (value,) * count


def _frozen(value: Any) -> Any:
    """Lists as tuples, at any depth, so that tasks can be compared and hashed."""
    if isinstance(value, Iterable) and not isinstance(value, str):
        return tuple(_frozen(item) for item in value)
    return value


class Frozen:
    """Base of what users write: whatever is given as a list or an array is kept as a tuple."""

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:  # pyright: ignore[reportAttributeAccessIssue]
            object.__setattr__(self, name, _frozen(getattr(self, name)))


def faults_of_numbers(
    key: str, value: Any, count: int, things: str, least: float | None = None
) -> Iterator[Fault]:
    """Yield a fault for what is no finite number above 0 or from least on, or no full list.

    Parameters
    ----------
    key : str
        Where it stands.
    value : float, tuple of float or None
        What was given; None is nothing wrong.
    count : int
        How many numbers a list must have.
    things : str
        What there is one number for each of.
    least : float, optional
        Smallest allowed; anything above 0 if left out.
    """
    if value is None:
        return
    if isinstance(value, tuple) and len(value) != count:
        entries = "1 entry" if len(value) == 1 else f"{len(value)} entries"
        yield (
            key,
            f"{entries} for {count} {things}; write one number for all {things}, "
            f"or a list of {count}",
        )
    for item in per(value, 1):
        known = isinstance(item, Real) and math.isfinite(item)
        if not known or not (item > 0 if least is None else item >= least):
            wanted = "above 0" if least is None else f"{least:g} or above"
            yield key, f"not {item!r}; write a finite number {wanted}"


def wrong_order(key: str, pair: tuple[float, ...], *, may_be_equal: bool = True) -> Iterator[Fault]:
    """Yield a fault for a range whose ends are the wrong way round.

    Parameters
    ----------
    key : str
        Where it stands.
    pair : tuple of float
        Smaller and larger end.
    may_be_equal : bool, optional
        Whether the range may be one number.
    """
    low, high = pair
    if low > high or (low == high and not may_be_equal):
        yield key, f"the range [{low:g}, {high:g}] is empty; write the smaller number first"
