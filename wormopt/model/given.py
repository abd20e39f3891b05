"""Numbers that users give, one for all or one for each, kept frozen and checked."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Sequence
from numbers import Integral, Real
from typing import Any

from wormopt.errors import ArgumentError, Fault

__all__ = [
    "Frozen",
    "Numbers",
    "check_kind",
    "faults_of_number",
    "faults_of_numbers",
    "faults_of_whole",
    "is_number",
    "is_whole",
    "per",
    "wrong_order",
]

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
    """Lists as tuples, at any depth, and scalars of numpy as numbers: tasks can be hashed."""
    if getattr(value, "ndim", None) == 0:
        return value.item()
    if isinstance(value, Iterable) and not isinstance(value, str):
        return tuple(_frozen(item) for item in value)
    return value


class Frozen:
    """Base of what users write: whatever is given as a list or an array is kept as a tuple."""

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:  # pyright: ignore[reportAttributeAccessIssue]
            object.__setattr__(self, name, _frozen(getattr(self, name)))


def is_number(value: Any, least: float, most: float = sys.float_info.max) -> bool:
    """Whether it is a number from `least` to `most`; neither NaN nor a truth value is one.

    Parameters
    ----------
    value : object
        What was given.
    least, most : float
        Smallest and largest allowed.
    """
    if isinstance(value, bool) or not isinstance(value, Real):
        return False
    return bool(least <= value <= most)  # pyright: ignore[reportOperatorIssue]


def is_whole(value: Any, least: int, most: int) -> bool:
    """Whether it is a whole number from `least` to `most`.

    Parameters
    ----------
    value : object
        What was given.
    least, most : int
        Smallest and largest allowed.
    """
    return isinstance(value, Integral) and is_number(value, least, most)


def faults_of_whole(key: str, value: Any, least: int, most: int) -> Iterator[Fault]:
    """Yield a fault for what is no whole number from `least` to `most`.

    Parameters
    ----------
    key : str
        Where it stands.
    value : object
        What was given.
    least, most : int
        Smallest and largest allowed.
    """
    if not is_whole(value, least, most):
        yield key, f"not {value!r}; write a whole number from {least} to {most}"


def faults_of_number(key: str, value: Any, least: float | None = None) -> Iterator[Fault]:
    """Yield a fault for what is no finite number above 0 or from least on.

    Parameters
    ----------
    key : str
        Where it stands.
    value : object
        What was given.
    least : float, optional
        Smallest allowed; anything above 0 if left out.
    """
    if not is_number(value, least or 0.0) or (least is None and value == 0):
        wanted = "above 0" if least is None else f"{least:g} or above"
        yield key, f"not {value!r}; write a finite number {wanted}"


def check_kind(name: str, value: object, kind: type) -> None:
    """Refuse an argument of another kind.

    Parameters
    ----------
    name : str
        Of the argument.
    value : object
        What was given.
    kind : type
        What it must be.

    Raises
    ------
    ArgumentError
        If it is not.

    Examples
    --------
    >>> check_kind("worm", 3, str)
    Traceback (most recent call last):
    wormopt.errors.ArgumentError: worm: not 3; give a str
    """
    if not isinstance(value, kind):
        raise ArgumentError(f"{name}: not {value!r:.60}; give a {kind.__name__}")


def faults_of_numbers(
    key: str, value: Any, count: int, things: str, least: float | None = None
) -> Iterator[Fault]:
    """Yield a fault for what is no finite number above 0 or from least on, or no full list.

    Parameters
    ----------
    key : str
        Where it stands.
    value : float or tuple of float
        What was given.
    count : int
        How many numbers a list must have.
    things : str
        What there is one number for each of.
    least : float, optional
        Smallest allowed; anything above 0 if left out.
    """
    items = value if isinstance(value, tuple) else (value,)
    if items is value and len(items) != count:
        entries = "1 entry" if len(items) == 1 else f"{len(items)} entries"
        yield (
            key,
            f"{entries} for {count} {things}; write one number for all {things}, "
            f"or a list of {count}",
        )
    for item in items:
        yield from faults_of_number(key, item, least)


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
