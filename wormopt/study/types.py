# pyright: strict
"""Types of scene values.

Each type has a description, which messages use to say what to write. No number may be
NaN or infinite; the bounds `_LARGEST` exclude them.
"""

from __future__ import annotations

import sys
from contextvars import ContextVar
from pathlib import Path
from typing import Annotated

from msgspec import Meta

from wormopt.model.given import per as per
from wormopt.model.given import wrong_order as wrong_order

FOLDER: ContextVar[Path] = ContextVar("folder")
"""Folder of the scene being read."""


_LARGEST = sys.float_info.max
_SMALL = 1e-30


def _words(description: str) -> Meta:
    return Meta(description=description)


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
FinitePerLink = Annotated[
    Finite | tuple[Finite, ...],
    _words("a finite number, or a list of such numbers, one per link"),
]
FinitePerMass = Annotated[
    Finite | tuple[Finite, ...],
    _words("a finite number, or a list of such numbers, one per mass"),
]
Seed = Annotated[int, Meta(ge=0, le=2**32 - 1, description="a whole number from 0 to 4294967295")]

# Control characters are refused: files and terminals corrupt them.
Title = Annotated[str, Meta(pattern=r"^[^\x00-\x1f\x7f]*$"), _words("text in quotes, on one line")]
