"""The points of a sweep: positions, numbers, states, and saved results."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from wormopt.digest import BETTER
from wormopt.families.gathered import NUMBERED, STATUS, as_typed
from wormopt.files import POINTS
from wormopt.quantities import Variable
from wormopt.reports.source import Source
from wormopt.reports.words import name_text, number, unit_text, value_text
from wormopt.result import Result


@dataclass(frozen=True, eq=False)
class Axis:
    """A swept key, and its values as texts; also as numbers if they are."""

    key: str
    unit: str
    texts: tuple[str, ...]
    values: np.ndarray

    @property
    def name(self) -> str:
        """The key with its unit."""
        return f"{self.key} ({unit_text(self.unit)})" if self.unit != "1" else self.key

    def at(self, k: int) -> str:
        """Key and value."""
        return f"{self.key} = {self.texts[k]} {unit_text(self.unit)}".rstrip()


@dataclass(frozen=True, eq=False)
class Grid:
    """A sweep; its points are counted in C order, the last axis fastest.

    For scattered points, every axis has a value for each point.
    """

    axes: tuple[Axis, ...]
    lattice: bool
    numbers: tuple[Variable, ...]
    states: tuple[int, ...]
    reasons: tuple[str, ...]
    files: tuple[Path | None, ...]

    @property
    def shape(self) -> tuple[int, ...]:
        """Points along each axis."""
        return tuple(len(axis.texts) for axis in self.axes)

    def index(self, point: int) -> tuple[int, ...]:
        """Index of a point along each axis."""
        if not self.lattice:
            return (point,) * len(self.axes)
        return tuple(int(k) for k in np.unravel_index(point, self.shape))

    def place(self, point: int) -> str:
        """Describe the position of a point."""
        return ", ".join(a.at(k) for a, k in zip(self.axes, self.index(point), strict=True))

    def value(self, variable: Variable, point: int) -> float:
        """Number at a point."""
        return float(variable.values.ravel()[point])

    def good(self, variable: Variable, point: int) -> bool:
        """Whether a point has a valid number."""
        counts = self.states[point] in NUMBERED
        return counts and bool(np.isfinite(self.value(variable, point)))

    def span(self, variable: Variable) -> tuple[float, float, int | None]:
        """Least and largest valid number, and the best point if that is defined."""
        known = {k: self.value(variable, k) for k in range(len(self.states))
                 if self.good(variable, k)}  # fmt: skip
        if not known:
            return 0.0, 1.0, None
        low, high = min(known.values()), max(known.values())
        sense = BETTER.get(variable.name, 0)
        best = max(known, key=lambda k: sense * known[k]) if sense and low < high else None
        return low, high, best

    def says(self, variable: Variable, point: int, best: bool) -> str:
        """Describe a point by its position, and its number or the reason why it has none."""
        shown = number(self.value(variable, point), 4)
        if not self.good(variable, point):
            shown = STATUS[self.states[point]] if self.states[point] else "unknown"
        return f"{self.place(point)}: {shown}{', best' if best else ''}"

    def results(self, most: int) -> Iterator[tuple[int, Result]]:
        """Load saved results of at most this many points, spread evenly."""
        there = [k for k, file in enumerate(self.files) if file is not None]
        picked = there if len(there) <= most else [there[int(i * len(there) / most)]
                                                   for i in range(most)]  # fmt: skip
        for point in picked:
            file = self.files[point]
            try:
                yield point, Result.load(file)  # pyright: ignore[reportArgumentType]
            except (OSError, ValueError):
                continue


def grid_of(source: Source) -> Grid:
    """Read a result of kind sweep."""
    result = as_typed(source.result)
    given = result.attributes["axes"]
    axes = tuple(_axis(result, axis["key"], axis["dim"], axis.get("values")) for axis in given)
    names = {axis["dim"] for axis in given}
    dims = result["status"].dims
    numbers = [v for v in result.variables if v.dims == dims and v.name not in {"status", *names}]
    numbers.sort(key=lambda v: (v.name == "seconds", *_rank(v.name)))
    states = result["status"].values.ravel()
    count = len(states)
    reasons = result.attributes.get("reasons") or []
    points = result.attributes.get("points") or []
    files = [_file(source.folder, result.scene, name) for name in points]
    return Grid(
        axes,
        dims == tuple(axis["dim"] for axis in given),
        tuple(numbers),
        tuple(int(s) if 0 <= s < len(STATUS) else 1 for s in states),
        tuple(str(reasons[k] or "") if k < len(reasons) else "" for k in range(count)),
        tuple(files[k] if k < len(files) else None for k in range(count)),
    )


def _rank(name: str) -> tuple[int, int]:
    """Sort key: numbers of which one direction is better come first."""
    known = list(BETTER)
    return (0, known.index(name)) if name in BETTER else (1, 0)


def _axis(result: Result, key: str, dim: str, named: list[Any] | None) -> Axis:
    own = result[dim]
    texts = (value_text(value) for value in named or own.values.tolist())
    return Axis(key, own.unit, tuple(texts), own.values.astype(float))


def _file(folder: Path | None, scene: str, name: object) -> Path | None:
    """File of a point, only in the folder of the sweep or that of its scene."""
    if folder is None or not isinstance(name, str) or not name:
        return None
    folder = folder.resolve()
    usual = folder.parent / f"{Path(scene).name}-sweep"
    for place in (folder, folder / POINTS, usual / POINTS):
        file = (place / name).resolve()
        if file.is_relative_to(place) and file.is_file():
            return file
    return None


def words_of(variable: Variable) -> str:
    """Name of a number as words."""
    return name_text(variable.name)
