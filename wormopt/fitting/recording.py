"""Measured signals of one motion, and its known values.

Neither package is imported: objects are recognised by their attributes.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError
from wormopt.model.model import Model
from wormopt.model.values import numbers
from wormopt.quantities import scale
from wormopt.tables import name_and_unit

_ENTRY = re.compile(r"(?P<name>.+?)(?:\[(?P<index>\d+)\]|_(?P<count>\d+))")


def instants(run: str, given: Any) -> np.ndarray:
    """Times in s: dates count from the first one, units of xarray are converted."""
    array = np.asarray(getattr(given, "values", given))
    if array.dtype.kind == "M":
        if not array.size or np.isnat(array).any():
            raise ArgumentError(f"{run}: a time is missing; remove its readings")
        return (array - array.flat[0]) / np.timedelta64(1, "s")
    found = numbers(f"{run}: time", given)
    return np.atleast_1d(found if array.dtype.kind == "m" else found * _factor(run, "time", given))


def signals(run: str, given: Any, time: Any) -> Mapping[str, Any]:
    """Readings by signal: columns of a pandas table, arrays of an xarray Dataset or a mapping.

    Columns ``position_0`` and ``position[1]`` of a table are entries of one signal.
    """
    if hasattr(given, "columns") and hasattr(given, "items"):
        return _of_table(run, given)
    if not isinstance(given, Mapping) or not given:
        raise ArgumentError(
            f'{run}: write readings by name, {{"position": [...]}}, not {type(given).__name__}'
        )
    along = getattr(time, "dims", ())
    return {name: _plain(run, str(name), each, along) for name, each in given.items()}


def _plain(run: str, name: str, given: Any, along: tuple[str, ...]) -> Any:
    dims = getattr(given, "dims", ())
    factor = _factor(run, name, given)
    if len(dims) == 2 and len(along) == 1 and dims[0] == along[0]:  # of xarray, time first
        given = given.transpose()
    return given if factor == 1.0 else factor * numbers(f"{run}: {name}", given)


def _of_table(run: str, table: Any) -> dict[str, Any]:
    """Readings by signal of the columns of a pandas table."""
    known = dict(getattr(table, "attrs", {})).get("units", {})
    columns: dict[str, np.ndarray] = {}
    for head, column in table.items():
        name, unit = name_and_unit(str(head))
        unit = unit or (known.get(str(head), "") if isinstance(known, Mapping) else "")
        columns[name] = _size(run, name, unit) * numbers(f"{run}: {name}", column)
    entries: dict[str, dict[int, str]] = {}
    for name in columns:
        found = _ENTRY.fullmatch(name)
        if found:
            entries.setdefault(found["name"], {})[int(found["index"] or found["count"])] = name
    joined = {
        name: rows
        for name, rows in entries.items()
        if sorted(rows) == [*range(len(rows))] and name not in columns
    }
    parts = {part for rows in joined.values() for part in rows.values()}
    return {
        **{name: column for name, column in columns.items() if name not in parts},
        **{
            name: np.array([columns[rows[k]] for k in sorted(rows)])
            for name, rows in joined.items()
        },
    }


def _factor(run: str, name: str, given: Any) -> float:
    """Factor that converts an array of xarray to SI units."""
    attributes = getattr(given, "attrs", None)
    unit = attributes.get("units", "") if isinstance(attributes, Mapping) else ""
    return _size(run, name, unit if isinstance(unit, str) else "")


def _size(run: str, name: str, unit: str) -> float:
    if not unit:
        return 1.0
    try:
        return float(scale(unit)[0])
    except ValueError as error:
        raise ArgumentError(
            f'{run}: units of {name}: "{unit}" {error}; write "mm", "m s-1" or the like, or "1"'
        ) from None


# Ratio of readings that causes a warning: a factor of 1000 is a wrong unit.
APART = 1000.0
# Fewest readings that show whether they are angles that jump by a turn.
_FEWEST_ANGLES, _MANY_ANGLES = 5, 30
# Ratio of a time step to the usual one from which it is a pause.
_LONG = 1.5


@dataclass(frozen=True, eq=False)
class Recording:
    """Signals measured along one motion.

    Parameters
    ----------
    time : array_like, shape (m,)
        Times, ascending; steps may differ. Dates are converted to seconds since the first.
    values : mapping of str to array_like, shape (size, m) or (m,), or a table
        Readings of states and outputs of the model by name; NaN marks a gap, or an entry without a
        sensor. Masked values are gaps. A pandas DataFrame with columns `position_0`, `position_1`
        and an xarray Dataset are accepted too; their units are converted to SI.
    noise : mapping of str to float, optional
        Standard deviation of the readings of a signal, where it is known.
    x0 : mapping of str to array_like, optional
        Start values of states that are known and differ from those of the model.
    p : mapping of str to array_like, optional
        Parameters and inputs of this run that differ from those of the model.
    schedules : mapping of str to ndarray, optional
        Values of schedules in this run that differ from those of the model.
    span : (float, float), optional
        First and last time of the motion; those of the readings if left out. It starts from ``x0``
        at the first.
    model : Model, optional
        Model of this run if it differs from the fitted one: the same worm, driven otherwise.
    name : str, optional
        Name of the run.
    unwrap : sequence of str, optional
        Signals that are angles in rad, recorded modulo 2π: turns are added so that no step is
        larger than half a turn.

    Raises
    ------
    ArgumentError
        If times do not ascend, a reading is infinite, there is none, or nothing moves.

    Examples
    --------
    >>> run = Recording([0.0, 0.1, 0.2], {"position": [0.0, np.nan, 0.3]}, name="coast")
    >>> run.count
    2
    """

    time: Any
    values: Any
    noise: Mapping[str, float] | None = None
    x0: Mapping[str, ArrayLike] | None = None
    p: Mapping[str, ArrayLike] | None = None
    schedules: Mapping[str, np.ndarray] | None = None
    span: tuple[float, float] | None = None
    model: Model | None = None
    name: str = "run"
    unwrap: Sequence[str] = ()

    def __post_init__(self) -> None:
        _check_times(self.name, self.times)
        object.__setattr__(self, "values", signals(self.name, self.values, self.time))
        if isinstance(self.unwrap, str) or not set(self.unwrap) <= set(self.values):
            what = f"unwrap must name recorded signals, a list of {', '.join(self.values)}"
            raise ArgumentError(f"{self.name}: {what}, not {self.unwrap!r}")
        first, last = self.ends
        if not (first < last and first <= self.times[0] and self.times[-1] <= last):
            raise ArgumentError(
                f"{self.name}: readings from {self.times[0]:g} to {self.times[-1]:g} are outside "
                f"the motion's span ({first:g}, {last:g})"
            )
        for name, sd in (self.noise or {}).items():
            if name not in self.values:
                raise ArgumentError(f"{self.name}: noise of {name}, but {name} has no readings")
            if not (np.ndim(numbers(f"noise of {name}", sd)) == 0 and 0 < sd < np.inf):
                raise ArgumentError(f"{self.name}: noise of {name} must be positive, not {sd!r}")
        rows = [row for rows in self.readings.values() for row in rows if np.isfinite(row).any()]
        if all(map(_still, rows)):
            raise ArgumentError(
                f"{self.name}: all signals are constant; check for a sensor that is off, or a "
                "column that repeats"
            )

    @cached_property
    def times(self) -> np.ndarray:
        """Times as an array (m,)."""
        return instants(self.name, self.time)

    @cached_property
    def readings(self) -> dict[str, np.ndarray]:
        """Readings as arrays (size, m)."""
        found = {
            str(n): _readings(self.name, n, v, len(self.times)) for n, v in self.values.items()
        }
        turned = {name: np.array([*map(unwrapped, found[name])]) for name in self.unwrap}
        return found | turned

    @property
    def ends(self) -> tuple[float, float]:
        """First and last time of the motion."""
        return self.span or (float(self.times[0]), float(self.times[-1]))

    @property
    def count(self) -> int:
        """Number of readings."""
        return sum(int(np.isfinite(rows).sum()) for rows in self.readings.values())

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """Likely errors in the recording."""
        found = []
        for name, rows in self.readings.items():
            still = [k for k, row in enumerate(rows) if _still(row)]
            if still:
                entries = ", ".join(f"{name}[{k}]" for k in still)
                found.append(f"{self.name}: {entries} is constant")
            for turn, words in ((2 * np.pi, "2π"), (360.0, "360")):
                wrapped = [k for k, row in enumerate(rows) if _is_wrapped(row, turn)]
                if wrapped:
                    entries = ", ".join(f"{name}[{k}]" for k in wrapped)
                    found.append(
                        f"{self.name}: {entries} jumps by about {words}, like an angle that is "
                        f"recorded modulo a turn; if it is an angle, write it in rad, and "
                        f'unwrap = ["{name}"]'
                    )
            if name in self.unwrap:
                for k, row in enumerate(rows):
                    found += [
                        f"{self.name}: {name}[{k}] {what}" for what in guesses(self.times, row)
                    ]
            sizes = np.array([np.nanmax(np.abs(row), initial=0.0) for row in rows])
            moving = sizes[sizes > 0]
            if moving.size and moving.max() > APART * moving.min():
                found.append(
                    f"{self.name}: entries of {name} differ {moving.max() / moving.min():.0f} "
                    "times in size; check their units"
                )
        return tuple(found)


def _check_times(name: str, times: np.ndarray) -> None:
    if times.ndim != 1 or len(times) < 2:
        raise ArgumentError(f"{name}: time must be a list of at least two instants")
    wrong = np.flatnonzero(~np.isfinite(times))
    if wrong.size:
        raise ArgumentError(f"{name}: time {wrong[0]} is {times[wrong[0]]}, not a number")
    back = np.flatnonzero(np.diff(times) <= 0)
    if back.size:
        k = int(back[0])
        how = "occurs twice" if times[k] == times[k + 1] else "goes backwards"
        raise ArgumentError(
            f"{name}: time {how}, {times[k]:g} and then {times[k + 1]:g} (readings {k} and {k + 1})"
        )


def _readings(run: str, name: object, given: object, count: int) -> np.ndarray:
    rows = np.atleast_2d(numbers(f"{run}: {name}", given))
    if rows.ndim != 2 or rows.shape[1] != count:
        raise ArgumentError(f"{run}: {name} has the shape {rows.shape}, not (size, {count})")
    if np.isinf(rows).any():
        row, at = np.argwhere(np.isinf(rows))[0]
        raise ArgumentError(f"{run}: {name}[{row}] is infinite in reading {at}")
    if np.isnan(rows).all():
        raise ArgumentError(f"{run}: {name} has no readings; leave it out")
    return rows


def unwrapped(row: np.ndarray) -> np.ndarray:
    """Angles (m,) in rad with whole turns added, so that no step is larger than half a turn."""
    there, found = np.isfinite(row), np.array(row, dtype=float)
    found[there] = np.unwrap(found[there])
    return found


def guesses(times: np.ndarray, row: np.ndarray) -> list[str]:
    """Warnings of an unwrapped angle (m,): pauses in which more than half a turn may have passed.

    The rate is the fastest among steps not longer than usual.
    """
    there = np.isfinite(row)
    t, steps = times[there], np.abs(np.diff(row[there]))
    pauses = np.diff(t)
    usual = pauses <= _LONG * np.median(pauses) if len(pauses) else np.zeros(0, dtype=bool)
    if np.all(usual):
        return []
    fastest = float(np.max(steps[usual] / pauses[usual]))
    open_ = np.flatnonzero(~usual & (fastest * pauses > np.pi))
    return [
        f"has no reading from t = {t[k]:g} to {t[k + 1]:g}, and at its largest rate it turns by "
        f"{fastest * pauses[k]:.2g} rad in this time: the number of turns is a guess; split the "
        "recording there in two"
        for k in open_.tolist()
    ]


def _is_wrapped(row: np.ndarray, turn: float) -> bool:
    """Whether readings within a turn jump by about a turn, and are smooth without these jumps."""
    there = row[np.isfinite(row)]
    if there.size < _FEWEST_ANGLES or np.ptp(there) > turn * (1 + 1e-9):
        return False
    steps, smooth = np.abs(np.diff(there)), np.abs(np.diff(np.unwrap(there, period=turn)))
    # random readings often change by nearly half a turn
    most = 0.375 if there.size >= _MANY_ANGLES else 0.25
    return bool(steps.max() > turn / 2 and smooth.max() < most * turn)


def _still(row: np.ndarray) -> bool:
    """Whether all readings are equal; a single one is not."""
    there = row[np.isfinite(row)]
    return there.size > 1 and bool(np.ptp(there) <= 4e-16 * np.abs(there).max())


def scatter(rows: np.ndarray) -> float:
    """Noise from deviations of readings from the line through their neighbours; never 0."""
    there = [row[np.isfinite(row)] for row in rows]
    second = np.concatenate([np.diff(row, 2) for row in there])
    sizes = np.concatenate(there)
    least = max(1e-5 * float(np.ptp(sizes)), 1e-12 * float(np.abs(sizes).max()), 1e-300)
    return max(float(np.median(np.abs(second))) / (0.6745 * 6**0.5) if second.size else 0.0, least)
