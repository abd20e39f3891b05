"""Values that users give, one for all or one for each, frozen and checked."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import fields, is_dataclass
from functools import cache
from numbers import Real
from typing import Any

from wormopt.errors import ArgumentError, Fault

Numbers = float | Sequence[float]


def per(value: Numbers, count: int) -> tuple[float, ...]:
    """One number for each of `count` things, from one number or a list, which is kept."""
    return tuple(value) if isinstance(value, Iterable) else (value,) * count


def fields_of(given: object) -> dict[str, Any]:
    """Fields of a dataclass, names and values; none of anything else."""
    return {name: getattr(given, name) for name in _names(type(given))}


@cache
def _names(kind: type) -> tuple[str, ...]:
    return tuple(field.name for field in fields(kind)) if is_dataclass(kind) else ()


def plain(value: Any) -> Any:
    """Convert NumPy scalars and arrays of no dimension to numbers; leave all else."""
    return value.item() if getattr(value, "ndim", None) == 0 else value


def make_plain(given: object, *names: str) -> None:
    """Convert NumPy scalars to numbers in these fields of a frozen dataclass."""
    for name in names:
        object.__setattr__(given, name, plain(getattr(given, name)))


def _frozen(value: Any) -> Any:
    """Convert lists to tuples, at any depth, and NumPy scalars to numbers, for hashing."""
    value = plain(value)
    if isinstance(value, Iterable) and not isinstance(value, str):
        return tuple(_frozen(item) for item in value)
    return value


class Frozen:
    """Base of classes that users construct: keeps lists and arrays as tuples."""

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:  # pyright: ignore[reportAttributeAccessIssue]
            object.__setattr__(self, name, _frozen(getattr(self, name)))


def is_number(value: Any, least: float, most: float = sys.float_info.max) -> bool:
    """Whether it is a number from `least` to `most`; NaN and booleans are not."""
    if isinstance(value, bool) or not isinstance(value, Real):
        return False
    return bool(least <= value <= most)  # pyright: ignore[reportOperatorIssue]


def check_number(
    name: str, value: object, *, above: float = -math.inf, least: float = -math.inf
) -> None:
    """Raise ArgumentError if the argument called `name` is no finite number above, or from, one."""
    if not (is_number(value, max(above, least, -sys.float_info.max)) and value != above):
        bound = f"above {above:g}" if above > -math.inf else f"at least {least:g}"
        wanted = "a finite number" if bound == "at least -inf" else f"finite and {bound}"
        raise ArgumentError(f"{name} must be {wanted}, not {value!r:.60}")


def whole(name: str, value: object, least: int) -> int:
    """Whole number from `least` on, which may be written 1e4; ArgumentError if it is none."""
    number = plain(value)
    if not is_number(number, least) or number != int(number):
        wanted = f"a whole number, {least} or above"
        raise ArgumentError(f"{name} must be {wanted}, not {value!r:.60}")
    return int(number)


def check_flag(name: str, value: object) -> None:
    """Raise ArgumentError if the argument called `name` is neither True nor False."""
    if not isinstance(plain(value), bool):
        raise ArgumentError(f"{name} must be True or False, not {value!r:.60}")


def check_name(what: str, name: object) -> None:
    """Raise ArgumentError if the name of something, "signal" say, is no text."""
    if not isinstance(name, str) or not name:
        raise ArgumentError(f"{what}: name must be a text, not {name!r:.60}")


def check_choice(name: str, value: object, choices: Sequence[str]) -> None:
    """Raise ArgumentError if the argument called `name` is none of the words to choose from."""
    if not isinstance(value, str) or value not in choices:
        known = ", ".join(map(repr, choices))
        raise ArgumentError(f"{name} must be one of {known}, not {value!r:.60}")


def names_in(what: str, given: str | Iterable[str]) -> list[str]:
    """Names from one or several, in order and without duplicates; else ArgumentError."""
    names = [given] if isinstance(given, str) else given
    if not isinstance(names, list | tuple) or not all(isinstance(name, str) for name in names):
        raise ArgumentError(f"{what} must be a name or a list of names, not {given!r:.60}")
    return list(dict.fromkeys(names))


def check_kind(name: str, value: object, kind: type) -> None:
    """Raise ArgumentError if the argument called `name` is not of this kind."""
    if not isinstance(value, kind):
        raise ArgumentError(f"{name} must be of type {kind.__name__}, not {value!r:.60}")


def check_kinds(name: str, values: object, kind: type) -> None:
    """Raise ArgumentError if the argument called `name` is no list of things of this kind."""
    if not isinstance(values, list | tuple) or not all(isinstance(one, kind) for one in values):
        raise ArgumentError(f"{name} must be a list of {kind.__name__}, not {values!r:.60}")


def wrong_order(key: str, pair: tuple[float, ...], *, may_be_equal: bool = True) -> Iterator[Fault]:
    """Yield a fault if a range is reversed, or a single point where `may_be_equal` is false."""
    low, high = pair
    if low > high or (low == high and not may_be_equal):
        yield key, f"the range [{low:g}, {high:g}] is empty; write the smaller number first"
