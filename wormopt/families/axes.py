# pyright: strict, reportMissingTypeStubs=false, reportUnknownVariableType=false, reportUnknownArgumentType=false, reportUnknownMemberType=false
"""Points of a sweep: combinations of key values, or random ones."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from wormopt.study.swept import RANGE, Swept

Place = Mapping[str, Any]
"""Key -> value as in a scene."""
_JOINED: dict[str, Any] = {"grid": itertools.product, "zip": zip}


@dataclass(frozen=True)
class Plan:
    """Points of a sweep in the order of their dimensions, the last one fastest."""

    points: tuple[Place, ...]
    keys: tuple[str, ...]
    shape: tuple[int, ...]  # one number per key of a grid, else the number of points

    @property
    def is_grid(self) -> bool:
        """Whether every key has its own dimension."""
        return len(self.shape) == len(self.keys) and math.prod(self.shape) == len(self.points)

    @property
    def dims(self) -> tuple[str, ...]:
        """Names of the dimensions."""
        return tuple(map(dim_of, self.keys)) if self.is_grid else ("point",)


def dim_of(key: str) -> str:
    """Name of the dimension of a key's values."""
    name = re.sub(r"[^A-Za-z0-9]+", "_", key).strip("_")
    return name if name[:1].isalpha() else f"key_{name}"


def plan(table: Swept) -> Plan:
    """Points of a valid table."""
    axes = [] if table.drawn else [_values(values) for values in table.over.values()]
    rows = _drawn(table) if table.drawn else _JOINED[table.method](*axes)
    keys = tuple(table.over)
    places = tuple(dict(zip(keys, row, strict=True)) for row in rows)
    return Plan(places, keys, tuple(map(len, axes)) if table.method == "grid" else (len(places),))


def _values(values: str | Sequence[Any]) -> list[Any]:
    if not isinstance(values, str):
        return list(values)
    found = RANGE.fullmatch(values)
    assert found, values
    low, high, count = float(found["low"]), float(found["high"]), int(found["count"])
    spaced = np.geomspace if found["spacing"] else np.linspace
    return [_with_unit(float(value), found["unit"]) for value in spaced(low, high, count)]


def _with_unit(value: float, unit: str | None) -> Any:
    """Round to fifteen digits: 0.3, not 0.30000000000000004."""
    value = float(f"{value:.15g}")
    return f"{value!r} {unit.strip()}" if unit else value


def _drawn(table: Swept) -> list[list[Any]]:
    from scipy.stats import qmc

    ranges = [RANGE.fullmatch(str(values)) for values in table.over.values()]
    engine = qmc.LatinHypercube if table.method == "latin-hypercube" else qmc.Sobol
    count = table.points or 1
    sample = engine(len(ranges), rng=table.seed).random(count)
    columns = []
    for share, found in zip(sample.T, ranges, strict=True):
        assert found
        low, high = float(found["low"]), float(found["high"])
        ends = np.log([low, high]) if found["spacing"] else np.array([low, high])
        values = ends[0] + (ends[1] - ends[0]) * share
        values = np.exp(values) if found["spacing"] else values
        columns.append([_with_unit(float(value), found["unit"]) for value in values])
    return [list(row) for row in zip(*columns, strict=True)]
