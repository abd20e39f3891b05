"""Directions along which is differentiated: columns by the names of signals, or as written."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError, UnknownNameError
from wormopt.model.values import check_names, numbers

Asked = Sequence[str] | Mapping[str, Mapping[str, ArrayLike]]
"""Names of signals or of single entries ("mass", "mass[0]"), or directions by labels:
{"both": {"mass": [1, 1]}}."""

_ENTRY = re.compile(r"(.+)\[(\d+)\]")


@dataclass(frozen=True, eq=False)
class Directions:
    """Labels (k) and columns (n, k) in the stacked signals."""

    labels: tuple[str, ...]
    columns: np.ndarray


def directions_of(signals: Sequence[Any], asked: Asked) -> Directions:
    """Directions in the column of these signals, in the order in which they are asked for.

    Raises ArgumentError or UnknownNameError for what is no direction in it.
    """
    sizes = {signal.name: signal.size for signal in signals}
    ends = np.cumsum([0, *sizes.values()]).tolist()
    begins = dict(zip(sizes, ends, strict=False))
    unit = np.eye(ends[-1])
    if isinstance(asked, Mapping):
        found = {label: _column(sizes, begins, label, parts) for label, parts in asked.items()}
        return Directions(tuple(found), np.array(list(found.values())).reshape(-1, ends[-1]).T)
    if isinstance(asked, str):
        raise ArgumentError(f"write directions as a list, [{asked!r}]")
    found = dict[str, np.ndarray]()
    for text in asked:
        match = _ENTRY.fullmatch(text) if text not in sizes else None
        name = match[1] if match else text
        if name not in sizes:
            raise UnknownNameError("the model", "parameter or input", [text], list(sizes))
        entries = [int(match[2])] if match else range(sizes[name])
        for i in entries:
            if i >= sizes[name]:
                raise ArgumentError(f"{name} has {sizes[name]} entries, none is {text}")
            label = name if sizes[name] == 1 else f"{name}[{i}]"
            found[label] = unit[begins[name] + i]
    return Directions(tuple(found), np.array(list(found.values())).reshape(-1, ends[-1]).T)


def _column(
    sizes: Mapping[str, int], begins: Mapping[str, int], label: str, parts: Mapping[str, ArrayLike]
) -> np.ndarray:
    check_names(parts, list(sizes), "parameter or input")
    column = np.zeros(sum(sizes.values()))
    for name, given in parts.items():
        values, size = numbers(f"direction {label} of {name}", given).ravel(), sizes[name]
        if values.size not in (1, size) or not np.all(np.isfinite(values)):
            raise ArgumentError(f"direction {label} of {name} must be {size} finite numbers")
        column[begins[name] : begins[name] + size] = values
    if not np.any(column):
        raise ArgumentError(f"direction {label} is nowhere other than 0")
    return column
