"""Types of scene values, and the bases of all scene tables.

Each type carries a description in plain words: it is what a message tells the user to write.
No number may be NaN or infinite, which the bounds of `_LARGEST` see to.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from math import isfinite
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, get_args, get_origin

from msgspec import NODEFAULT, Meta, Struct

from wormopt.errors import Fault
from wormopt.model.given import per as per

_LARGEST = sys.float_info.max
_SMALL = 1e-30


def _words(description: str) -> Meta:
    return Meta(description=description)


def says(quantity: str, meaning: str, usual: tuple[float, float] | None = None) -> Meta:
    """What a key means, in Markdown, and its quantity: a name of `wormopt.quantities`, or "".

    `usual` are the sizes in SI of which nobody is warned, where not those of the quantity.
    """
    return Meta(extra={"quantity": quantity, "meaning": meaning, "usual": usual})


def said_of(kind: Any) -> dict[str, Any]:
    """What `says` says, by the type of a key; empty where nothing is said."""
    if get_origin(kind) is not Annotated:
        return {}
    said = [meta.extra for meta in get_args(kind)[1:] if meta.extra]
    return said[-1] if said else {}


def meaning(kind: Any) -> tuple[str, str]:
    """Quantity and meaning of a key, by its type; "" where there is none."""
    said = said_of(kind)
    return said.get("quantity", ""), said.get("meaning", "")


def default_of(field: Any) -> Any:
    """Value of a key that is left out, NODEFAULT where it must not be."""
    made = field.default_factory
    return field.default if made is NODEFAULT else made()


Finite = Annotated[float, Meta(ge=-_LARGEST, le=_LARGEST), _words("a finite number")]
Positive = Annotated[float, Meta(gt=0, le=_LARGEST), _words("a finite number above 0")]
NonNegative = Annotated[float, Meta(ge=0, le=_LARGEST), _words("a finite number, 0 or above")]

# A list of two, not a tuple[Positive, Positive]: the reader crashes on a union of a bounded
# number with a tuple of fixed length.
Pair = Annotated[
    tuple[Positive, ...],
    Meta(min_length=2, max_length=2),
    _words("two finite numbers above 0, [smallest, largest]"),
]
NonNegativePair = Annotated[
    tuple[NonNegative, ...],
    Meta(min_length=2, max_length=2),
    _words("two finite numbers, 0 or above, [smallest, largest]"),
]
PositiveOrPair = Annotated[
    Positive | Pair, _words("a finite number above 0, or a range [smallest, largest]")
]
Loads = Annotated[
    NonNegative | Annotated[tuple[NonNegative, ...], Meta(min_length=2)],
    _words(
        "a finite number, 0 or above, a range [smallest, largest], or a list of three or more, one "
        "per mass"
    ),
]
PairPerLink = Annotated[
    tuple[Positive | Pair, ...],
    _words("[smallest, largest], both finite and above 0, or a list of such pairs, one per link"),
]
PerLink = Annotated[
    Positive | tuple[Positive, ...],
    _words("a finite number above 0, or a list of such numbers, one per link"),
]
PerMass = Annotated[
    Positive | tuple[Positive, ...],
    _words("a finite number above 0, or a list of such numbers, one per mass"),
]
NonNegativePerLink = Annotated[
    NonNegative | tuple[NonNegative, ...],
    _words("a finite number, 0 or above, or a list of such numbers, one per link"),
]
NonNegativePerMass = Annotated[
    NonNegative | tuple[NonNegative, ...],
    _words("a finite number, 0 or above, or a list of such numbers, one per mass"),
]
NonNegativePerJoint = Annotated[
    NonNegative | tuple[NonNegative, ...],
    _words("a finite number, 0 or above, or a list of such numbers, one per joint"),
]
FinitePerLink = Annotated[
    Finite | tuple[Finite, ...],
    _words("a finite number, or a list of such numbers, one per link"),
]
FinitePerMass = Annotated[
    Finite | tuple[Finite, ...],
    _words("a finite number, or a list of such numbers, one per mass"),
]
Seed = Annotated[int, Meta(ge=0, le=2**32 - 1, description="a whole number from 0 to 4294967295")]

# Control characters are refused: files and terminals mangle them.
Title = Annotated[str, Meta(pattern=r"^[^\x00-\x1f\x7f]*$"), _words("text in quotes, on one line")]


class Table(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Base of all tables of a scene: unchangeable data, unknown keys are errors."""

    @property
    def facts(self) -> dict[str, Any]:
        """What trust reports say of the table, beside what was found."""
        below = (getattr(self, name) for name in self.__struct_fields__)
        tables = [table for table in below if isinstance(table, Table)]
        return {key: fact for table in tables for key, fact in table.facts.items()}

    def file_warnings(self, folder: Path, units: str) -> Iterator[str]:
        """Yield what to know about the files that the table and those in it name."""
        for name in self.__struct_fields__:
            value = getattr(self, name)
            for table in value if isinstance(value, tuple) else (value,):
                if isinstance(table, Table):
                    yield from table.file_warnings(folder, units)


class SceneTable(Table, frozen=True, kw_only=True):
    """Keys that every scene shares, and the numbers that its results hold."""

    scalars: ClassVar[Mapping[str, tuple[str, str]]] = {}
    """Name: quantity, meaning."""
    variables: ClassVar[Mapping[str, tuple[str, tuple[str, ...], str]]] = {}
    """Name: quantity, dimensions, long name."""
    headline: ClassVar[tuple[str, ...]] = ()
    """Scalars that answer what was asked, told first; the first five declared if empty."""

    schema: Annotated[Literal[1], says("", "version of the scene form")]
    kind: Annotated[str, says("", "what the scene computes")]
    title: Annotated[Title, says("", "title of pictures and reports; its name if left out")] = ""
    units: Annotated[
        Literal["dimensionless", "SI"],
        says("", "names of the units in the results; nothing is converted"),
    ] = "dimensionless"
    want: Annotated[tuple[str, ...], says("", "pictures to draw, each once")] = ()

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows, once every key is right by itself.

        `folder` is where the scene lies; its file names are relative to this.
        """
        for word in sorted(set(self.want)):
            if self.want.count(word) > 1:
                yield "want", f'"{word}" stands there twice; write it once'


def extreme_numbers(value: object, key: str = "") -> Iterator[Fault]:
    """Yield a fault for each number so extreme that products of a few of them are no numbers.

    `value` is a table, a list or a value in one, at key path `key`, "" for a whole scene.
    """
    if isinstance(value, Struct):
        for name in value.__struct_fields__:
            yield from extreme_numbers(getattr(value, name), f"{key}.{name}" if key else name)
    elif isinstance(value, tuple):
        for index, item in enumerate(value):
            yield from extreme_numbers(item, f"{key}[{index}]")
    elif isinstance(value, Mapping):
        for name, item in value.items():
            yield from extreme_numbers(item, f"{key}.{name}")
    elif isinstance(value, float) and not (value == 0 or _SMALL <= abs(value) <= 1 / _SMALL):
        if not isfinite(value):
            yield key, f"{value} is not allowed; write a finite number"
            return
        size = "small" if abs(value) < 1 else "large"
        yield (
            key,
            f"{value:g} is too {size} to compute with; choose units in which it is nearer to 1",
        )


def wrong_count(
    key: str,
    value: object,
    count: int,
    things: Literal["links", "masses", "joints"],
    entry: Literal["number", "table"] = "number",
) -> Iterator[Fault]:
    """Yield a fault if a list does not hold one entry per link or per mass.

    A value that is no list is fine.
    """
    if isinstance(value, tuple) and len(value) != count:
        yield (
            key,
            (
                f"{_entries(len(value))} for {count} {things}; write one {entry} for all {things}, "
                f"or a list of {count}"
            ),
        )


def wrong_order(key: str, pair: tuple[float, ...], *, may_be_equal: bool) -> Iterator[Fault]:
    """Yield a fault if a range [smallest, largest] is reversed or empty.

    With `may_be_equal` a range of one point is fine.
    """
    smallest, largest = pair
    if smallest > largest or (smallest == largest and not may_be_equal):
        yield key, f"the range [{smallest:g}, {largest:g}] is empty; write the smaller number first"


def _entries(count: int) -> str:
    return "1 entry" if count == 1 else f"{count} entries"
