"""All instructions of a CasADi function at once, faster than one by one."""

from __future__ import annotations

import re
from functools import lru_cache

import casadi as ca
import numpy as np

_DIGITS = b"0123456789"
_NUMBERS_ALONE = bytes(c if c in _DIGITS else ord(" ") for c in range(256))
_PLACE = re.compile(rb"([@\[]?)(\d+)")


@lru_cache(maxsize=4)
def read(function: ca.Function) -> tuple[np.ndarray, np.ndarray]:
    """Operations (n,) of a function of scalars, and where they write and read (n, 3).

    The latter are as in `Function.instruction_output` and then `Function.instruction_input`,
    followed by -1. Raises ValueError if the listing of the function is not understood.
    """
    listing = function.str(True).encode().partition(b"Algorithm:\n")[2]
    kinds = listing.translate(None, _DIGITS).splitlines()
    numbers = np.fromstring(listing.translate(_NUMBERS_ALONE), dtype=np.int64, sep=" ")
    known = dict[bytes, int]()
    kind = np.array([known.setdefault(k, len(known)) for k in kinds], dtype=np.int64)
    examples = [kinds.index(k) for k in known]
    lines = listing.split(b"\n", max(examples, default=0) + 1)
    tokens = [_PLACE.findall(lines[k]) for k in examples]
    counts = np.array([len(each) for each in tokens], dtype=np.int64)[kind]
    if counts.sum() != len(numbers):
        raise ValueError(f"the listing of {function.name()} is not understood")
    starts = np.cumsum(counts) - counts
    operations = np.array([function.instruction_id(k) for k in examples], dtype=np.int64)[kind]
    places = np.full((len(kinds), 3), -1)
    for i, (k, each) in enumerate(zip(examples, tokens, strict=True)):
        where = [j for j, (mark, _) in enumerate(each) if mark]
        right = [*function.instruction_output(k), *function.instruction_input(k)]
        if [int(each[j][1]) for j in where] != right:
            raise ValueError(f"{lines[k].decode()!r} is not understood")
        rows = np.flatnonzero(kind == i)
        places[rows, : len(where)] = numbers[starts[rows, None] + np.array(where, dtype=np.int64)]
    operations.flags.writeable = places.flags.writeable = False
    return operations, places
