"""Directions in the parameters of a motion, one column of derivatives each."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError, UnknownNameError
from wormopt.model.schedule import Schedule
from wormopt.model.values import numbers
from wormopt.simulation.functions import System

Sensitivities = Sequence[str] | Mapping[str, Mapping[str, ArrayLike]]
"""Names of parameters, inputs, states and schedules, or a direction for each label."""

_FAR_BELOW = 0.01
_ENTRY = re.compile(r"(.*)\[\s*(\d+)\s*(?:,\s*(\d+)\s*)?\]")


@dataclass(frozen=True, eq=False)
class Directions:
    """k directions in the values of a motion: its start, its parameters and its schedules."""

    labels: tuple[str, ...]
    x0: np.ndarray  # (model.n_x, k)
    p: np.ndarray  # (n_p, k) of `System.parameters`; 0 for scheduled entries
    schedules: tuple[np.ndarray, ...]  # (pieces, size, k) of each

    @property
    def k(self) -> int:
        """How many there are."""
        return len(self.labels)

    def sizes(
        self,
        nominal_x: np.ndarray,
        p: np.ndarray,
        nominal_p: np.ndarray,
        schedules: Sequence[Schedule],
    ) -> np.ndarray:
        """Largest relative changes (k,) of each direction.

        Values far below their nominal size may matter, and are taken to have that size.
        """
        size_p = np.where(np.abs(p) < _FAR_BELOW * nominal_p, nominal_p, np.abs(p))
        found = [self.x0 / nominal_x[:, None], self.p / size_p[:, None]]
        for schedule, along in zip(schedules, self.schedules, strict=True):
            largest = np.abs(schedule.values).max(initial=0.0)
            found.append(along.reshape(-1, self.k) / (largest or 1.0))
        sizes = np.abs(np.concatenate(found)).max(axis=0)
        return np.where(sizes == 0, 1.0, sizes)

    def active(self, n_fixed: int) -> tuple[int, ...]:
        """Entries of p that change."""
        moved, at = np.any(self.p != 0, axis=1), n_fixed
        for values in self.schedules:
            end = at + 1 + values.shape[1]
            moved[at + 1 : end] = np.any(values != 0, axis=(0, 2))
            at = end
        return tuple(np.flatnonzero(moved).tolist())

    def scheduled(self, n_fixed: int, schedules: Sequence[Schedule], t: np.ndarray) -> np.ndarray:
        """Directions (n_p, k, m) of the parameters at the times `t` (m,)."""
        p, at = np.repeat(self.p[:, :, None], len(t), axis=2), n_fixed
        for schedule, values in zip(schedules, self.schedules, strict=True):
            end = at + 1 + values.shape[1]
            p[at + 1 : end] = np.moveaxis(values[schedule.locate(t)[1]], 0, 2)
            at = end
        return p


def directions(
    system: System, schedules: Sequence[Schedule], asked: Sensitivities | None
) -> Directions | None:
    """Requested directions; None if there are none.

    Raises ArgumentError if a direction is not of its signal's size, not a number, or has the
    label of another; UnknownNameError if the model has no such signal.
    """
    if isinstance(asked, str) or not isinstance(asked, Collection | None):
        asked = [asked]
    if asked is None or len(asked) == 0:
        return None
    space = _Space(system, schedules)
    if isinstance(asked, Mapping):
        columns = [(label, space.column(label, parts)) for label, parts in asked.items()]
    else:
        columns = [pair for name in asked for pair in space.units(name)]
    labels = tuple(label for label, _ in columns)
    twice = [label for label in dict.fromkeys(labels) if labels.count(label) > 1]
    if twice:
        raise ArgumentError(f"sensitivities ask for {', '.join(twice)} twice")
    return space.directions(labels, np.column_stack([column for _, column in columns]))


class _Space:
    """All values of a motion as one column: start, parameters and inputs, schedules' values."""

    def __init__(self, system: System, schedules: Sequence[Schedule]) -> None:
        model = system.model
        self._system, self._schedules = system, schedules
        shapes: dict[str, tuple[int, ...]] = {}
        for signal in (*model.x, *model.p, *model.u):
            shapes[signal.name] = (signal.size,)
        # a schedule with the name of a signal is not accessible
        self._named = [schedule.name not in shapes for schedule in schedules]
        for schedule in schedules:
            shapes.setdefault(schedule.name, schedule.values.shape)
        ends = np.cumsum([int(np.prod(shape)) for shape in shapes.values()], dtype=int).tolist()
        self._shapes = shapes
        self._begin = dict(zip(shapes, [0, *ends[:-1]], strict=True)) if shapes else {}
        self._size = ends[-1] if ends else 0

    def _shape(self, name: object) -> tuple[int, ...]:
        if not isinstance(name, str):
            raise ArgumentError(f"sensitivities must be names, not {name!r:.60}")
        if name not in self._shapes:
            kinds = "state, parameter, input or schedule"
            raise UnknownNameError(self._system.model.name, kinds, [name], list(self._shapes))
        return self._shapes[name]

    def units(self, name: object) -> Iterator[tuple[str, np.ndarray]]:
        """Label and column for each entry of a signal, or for the named one."""
        found = _ENTRY.fullmatch(name) if isinstance(name, str) else None
        whole = name if found is None or name in self._shapes else found[1]
        shape = self._shape(whole)
        entries = list(np.ndindex(*shape))
        if found is not None and whole != name:
            entries = [self._entry(str(name), shape, found)]
        for entry in entries:
            column = np.zeros(self._size)
            flat = int(np.ravel_multi_index(entry, shape))
            column[self._begin[str(whole)] + flat] = 1.0
            single = len(shape) == 1 and shape[0] == 1 and whole == name
            yield (str(whole) if single else f"{whole}[{', '.join(map(str, entry))}]"), column

    @staticmethod
    def _entry(name: str, shape: tuple[int, ...], found: re.Match[str]) -> tuple[int, ...]:
        entry = tuple(int(number) for number in found.groups()[1:] if number is not None)
        inside = len(entry) == len(shape)
        if not (inside and all(i < size for i, size in zip(entry, shape, strict=True))):
            size = " x ".join(map(str, shape))
            raise ArgumentError(f"there is no {name}: {found[1]} has {size} entries")
        return entry

    def column(self, label: object, parts: object) -> np.ndarray:
        """Column of one direction, given for each signal that it moves."""
        if not isinstance(label, str):
            raise ArgumentError(f"directions have names for labels, not {label!r:.60}")
        if not isinstance(parts, Mapping):
            raise ArgumentError(
                f"write direction {label} as {{name: entries}}, not {type(parts).__name__}"
            )
        column = np.zeros(self._size)
        for name, given in parts.items():
            shape, values = self._shape(name), numbers(f"direction {label} of {name}", given)
            if values.shape not in ((), shape):
                raise ArgumentError(
                    f"direction {label} of {name} must be one number or have the shape {shape}, "
                    f"not {values.shape}"
                )
            if not np.all(np.isfinite(values)):
                raise ArgumentError(f"direction {label} of {name} must be finite")
            begin = self._begin[name]
            column[begin : begin + int(np.prod(shape))] = np.broadcast_to(values, shape).ravel()
        return column

    def directions(self, labels: tuple[str, ...], columns: np.ndarray) -> Directions:
        """Split columns (numbers, k)."""
        model, n_x = self._system.model, self._system.model.n_x
        inner = sum(s.size for s in (*model.p, *model.u))
        p = np.zeros((self._system.symbols[2].numel(), len(labels)))
        p[:inner] = columns[n_x : n_x + inner]
        scheduled = []
        for schedule, named in zip(self._schedules, self._named, strict=True):
            shape, begin = schedule.values.shape, self._begin[schedule.name]
            rows = columns[begin : begin + schedule.values.size] if named else 0.0
            values = np.broadcast_to(rows, (schedule.values.size, len(labels)))
            scheduled.append(np.ascontiguousarray(values).reshape(*shape, len(labels)))
        return Directions(labels, columns[:n_x], p, tuple(scheduled))
