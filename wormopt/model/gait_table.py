"""Tables of link lengths over a period, read from text files and interpolated."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Literal, NoReturn

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator, PPoly

from wormopt.errors import ArgumentError
from wormopt.quantities import scale
from wormopt.tables import TextTable, Wrong, read_table, unit_meant

_FEWEST_ROWS = 4
# Relative tolerance of the last row to the first, and of the last time to the cycle.
_CLOSED = 1e-9
# Instants closer than this, in periods, are one.
_AT_BREAK = 1e-13
_LARGEST = 1e30
# Share of a link's range by which a spline may leave the rows without a warning.
_FREE = 0.01
# Number of places between two rows at which a spline is compared with them.
_BETWEEN = np.linspace(0.0, 1.0, 18)[1:-1]
# Lines of a file that a message names.
_NAMED = 3
_OF_GAIT = re.compile(r"gait: (?P<signal>\w+), cycle (?P<cycle>\S+)(?: (?P<unit>\S.*))?")
_SKIPPED = ("rate", "acceleration")


def remark_of_gait(signal: str, cycle: float, unit: str) -> str:
    """Remark from which an exported table is read back: its gait's columns and cycle."""
    return f"gait: {signal}, cycle {cycle!r}{'' if unit == '1' else f' {unit}'}"


def signal_of(remark: str) -> str:
    """Signal of the gait's columns, "" if the remark is not of a gait."""
    found = _OF_GAIT.fullmatch(remark)
    return found["signal"] if found else ""


def read_gait(
    path: Path, units: Literal["dimensionless", "SI"]
) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    """Breaks and polynomials of a gait in a table, and warnings."""
    wrong: list[Wrong] = []
    table = read_table(path, wrong)
    if table is None:
        raise ArgumentError(f"{path.name}{wrong[0][1]}")
    time, columns, cycle = _roles(table)
    if not columns:
        there = ", ".join(table.values)
        raise ArgumentError(
            f"{path.name} has no column of lengths, only {there}; write a "
            f"header t,l_0,l_1,... and at least {_FEWEST_ROWS} rows"
        )
    # faults of other columns do not matter
    for column, what in wrong:
        if column in ("", time, *columns):
            raise ArgumentError(f"{path.name}{what}")
    for name in columns:
        if name in table.texts:
            raise ArgumentError(f"{path.name}: column {name} contains text; write numbers")
    try:
        factors = [_factor(time, "s", table, units)]
        factors += [_factor(name, "m", table, units) for name in columns]
        with np.errstate(over="ignore"):  # too large values are refused below
            values = [
                f * np.array(table.values[n])
                for f, n in zip(factors, [time, *columns], strict=True)
            ]
        end = None if cycle is None else _cycle(cycle[0]) * _size(cycle[1], "s", units)
        rows = _Rows(values[0], np.array(values[1:]), table.lines, tuple(columns), time)
        return rows.closed(end).joined()
    except ArgumentError as error:
        raise ArgumentError(f"{path.name}{error}") from None


# -- columns and units -----------------------------------------------------------------------------


def _roles(table: TextTable) -> tuple[str, list[str], tuple[str, str] | None]:
    """Column of times, columns of lengths, and cycle and unit if the file gives them."""
    names = list(table.values)
    time = next((name for name in names if name.lower() in ("t", "time")), names[0])
    remark = next((m for m in map(_OF_GAIT.fullmatch, table.remarks) if m), None)
    if remark is not None:
        own = [name for name in names if re.fullmatch(rf"{remark['signal']}_\d+", name)]
        return time, own, (remark["cycle"], remark["unit"] or "")
    own = [name for name in names if re.fullmatch(r"length(_\d+)?", name)]
    if not own or not time.startswith("time"):
        own = [name for name in names if name != time and not name.startswith(_SKIPPED)]
    return time, own, None


def _factor(name: str, wanted: str, table: TextTable, units: str) -> float:
    """Factor that converts a column to s or m."""
    unit = table.units.get(name, "")
    bare, meant = unit_meant(name)
    # without units a name may end like a unit, such as l_m of a middle link
    meant = "" if units != "SI" and name == f"{bare}_{meant}" else meant
    if not unit and meant and (units != "SI" or meant != wanted):
        written = f"{bare or 'l_0'} [{meant}]" if units == "SI" else bare or "l_0"
        raise ArgumentError(f': column {name}: "{meant}" seems to be its unit; write {written}')
    try:
        return _size(unit, wanted, units)
    except ArgumentError as error:
        raise ArgumentError(f" line {table.head}, column {name}: {error}") from None


def _cycle(text: str) -> float:
    try:
        found = float(text)
    except ValueError:
        found = math.nan
    if not found > 0 or math.isinf(found):
        raise ArgumentError(f': "{text}" in a remark is not a cycle; write a number above 0')
    return found


def _size(unit: str, wanted: str, units: str) -> float:
    if unit in ("", "1"):
        return 1.0
    if units != "SI":
        raise ArgumentError(f'the unit "{unit}" needs an SI scene; write units = "SI", or no unit')
    what = "time" if wanted == "s" else "length"
    example = '"s" or "ms"' if wanted == "s" else '"m" or "mm"'
    try:
        size, dimension = scale(unit)
    except ValueError as error:
        raise ArgumentError(f'"{unit}" {error}; write {example}') from None
    if dimension != {wanted: 1} or size <= 0:
        raise ArgumentError(f'"{unit}" is not a unit of {what}; write {example}')
    return float(size)


# -- rows ------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Rows:
    """Times (m,) and lengths (n, m), NaN for gaps, with their lines in the file."""

    t: np.ndarray
    lengths: np.ndarray
    lines: Sequence[int]
    names: tuple[str, ...]
    time: str

    def closed(self, cycle: float | None) -> _Rows:
        """Checked rows over one closed period; the last one repeats the first."""
        rows = self if cycle is None else self.within(cycle)
        if len(rows.t) < (_FEWEST_ROWS if cycle is None else _FEWEST_ROWS - 1):
            count = f"{len(rows.t)} row{'s' * (len(rows.t) != 1)}"
            raise ArgumentError(f" has {count} of numbers; write at least {_FEWEST_ROWS} rows")
        rows.check()
        return (rows if cycle is None else rows.up_to(cycle)).repeating()

    def within(self, cycle: float) -> _Rows:
        """Rows up to the end of a cycle; a file may go on after it."""
        kept = np.flatnonzero(~(self.t > cycle * (1 + _CLOSED)))
        lines = [self.lines[k] for k in kept.tolist()]
        return replace(self, t=self.t[kept], lengths=self.lengths[:, kept], lines=lines)

    def check(self) -> None:
        """Refuse times that do not ascend from 0, and lengths that are not positive."""
        t, lines = self.t, self.lines
        for k in range(len(t)):
            if not math.isfinite(t[k]):
                what = "the time is missing; write it, all times must be finite"
                raise ArgumentError(f" line {lines[k]}, column {self.time}: {what}")
            if t[0] != 0 or (k and t[k] < t[k - 1]):
                what = f"time {t[k]:g}; times must ascend from 0, write rows in order of time"
                raise ArgumentError(f" line {lines[k]}: {what}")
        values = np.vstack([t, self.lengths]).T
        sizes = np.abs(values)
        far = np.argwhere((sizes > _LARGEST) | ((sizes > 0) & (sizes < 1 / _LARGEST)))
        if far.size:
            what = f"is too small or too large; write {1 / _LARGEST:g} to {_LARGEST:g}"
            self._refuse(values, far[0], what)
        low = np.argwhere((values <= 0) & (np.arange(values.shape[1]) > 0))
        if low.size:
            self._refuse(values, low[0], "is not a length; write a positive number")

    def _refuse(self, values: np.ndarray, place: np.ndarray, what: str) -> NoReturn:
        row, column = place
        name = (self.time, *self.names)[column]
        raise ArgumentError(
            f" line {self.lines[row]}, column {name}: {values[row, column]:g} {what}"
        )

    def up_to(self, cycle: float) -> _Rows:
        """Rows up to the end of a cycle, at which the lengths of the first row return."""
        t, end = self.t, self.t[-1]
        if end >= cycle * (1 - _CLOSED):
            return replace(self, t=np.append(t[:-1], cycle))
        if cycle - end > 2 * np.diff(t).max():
            what = f"rows end at {end:g}, but the cycle at {cycle:g}; write rows up to its end"
            raise ArgumentError(f" line {self.lines[-1]}: {what}")
        lengths = np.hstack([self.lengths, self.lengths[:, :1]])
        return replace(
            self, t=np.append(t, cycle), lengths=lengths, lines=[*self.lines, self.lines[0]]
        )

    def repeating(self) -> _Rows:
        """Rows whose last repeats the first exactly; instants with two rows are breaks."""
        t, lengths, lines = self.t.copy(), self.lengths.copy(), self.lines
        for name, row in zip(self.names, lengths, strict=True):
            for k in (0, -1):
                if np.isnan(row[k]):
                    what = "the length is missing; write it in the first row and in the last"
                    raise ArgumentError(f" line {lines[k]}, column {name}: {what}")
        free = _CLOSED * np.nanmax(np.abs(lengths))
        apart = np.abs(lengths[:, -1] - lengths[:, 0])
        if apart.max() > free:
            link = int(apart.argmax())
            raise ArgumentError(
                f" line {lines[-1]}, column {self.names[link]}: {lengths[link, -1]:g}, where the "
                f"first row has {lengths[link, 0]:g}; write one closed period: the last row "
                "repeats the first"
            )
        lengths[:, -1] = lengths[:, 0]
        # in tables of pandas breaks may differ in the last digit
        near = np.flatnonzero(np.diff(t) < _AT_BREAK * t[-1])
        t[near] = t[near + 1]
        for k in near.tolist():
            before, after = lengths[:, k], lengths[:, k + 1]
            if np.any(np.abs(after - before) > free):
                raise ArgumentError(
                    f" line {lines[k + 1]}: time {t[k]:g} occurs twice with different lengths; "
                    "only rates may jump: write each time once"
                )
            lengths[:, k] = lengths[:, k + 1] = np.where(np.isnan(before), after, before)
        if np.any(np.diff(near) == 1):
            k = int(near[np.argmax(np.diff(near) == 1)])
            raise ArgumentError(f" line {lines[k]}: time {t[k]:g} occurs three times; keep two")
        return replace(self, t=t, lengths=lengths)

    def joined(self) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
        """Breaks, polynomials (pieces, n, 4), and warnings."""
        breaks = np.unique(self.t)
        found = np.empty((len(breaks) - 1, len(self.names), 4))
        warnings: list[str] = []
        for link, name in enumerate(self.names):
            there = np.isfinite(self.lengths[link])
            count = int(np.sum(~there))
            if there.sum() < _FEWEST_ROWS:
                raise ArgumentError(
                    f": column {name} has {there.sum()} numbers; write at least {_FEWEST_ROWS} rows"
                )
            if count:
                warnings.append(f"column {name}: {count} gaps are bridged by interpolation")
            found[:, link], more = self._link(link, there, breaks)
            warnings += more
        return breaks, found, tuple(warnings)

    def _link(
        self, link: int, there: np.ndarray, breaks: np.ndarray
    ) -> tuple[np.ndarray, list[str]]:
        t, lengths = self.t[there], self.lengths[link, there]
        lines, name = np.array(self.lines)[there], self.names[link]
        size = max(float(np.ptp(lengths)), _CLOSED * float(lengths.max()))
        ends = [0, *(np.flatnonzero(np.diff(t) == 0) + 1), len(t)]
        found, warnings = np.empty((len(breaks) - 1, 4)), list[str]()
        for first, last in pairwise(ends):
            if last - first < 2:  # a break at 0 or at the period
                continue
            part = slice(first, last)
            whole = last - first == len(t)
            spline = _spline(t[part], lengths[part], periodic=whole)
            excess = _excess(spline, lengths[part]) / size
            beyond = lines[part][:-1][excess > _FREE]
            at = ", ".join(map(str, beyond[:_NAMED])) + ", ..." * (len(beyond) > _NAMED)
            if excess.max() > _as_a_sine(last - first - 1) or _least(spline) <= 0:
                spline = _pchip(t[part], lengths[part], periodic=whole)
                warnings.append(
                    f"column {name} is steep (after line {at}): its lengths are interpolated by "
                    "PCHIP, whose accelerations jump at the rows; write more rows there"
                )
            elif beyond.size:
                warnings.append(
                    f"column {name}: the spline adds up to {100 * excess.max():.2g} % to the range "
                    f"of the table (after line {at}); write more rows there"
                )
            inside = (breaks[:-1] >= t[first]) & (breaks[:-1] < t[last - 1])
            for k in range(4):
                found[inside, k] = spline(breaks[:-1][inside], k) / math.factorial(k)
        return found, warnings


# -- interpolation ---------------------------------------------------------------------------------


def _spline(t: np.ndarray, lengths: np.ndarray, *, periodic: bool) -> PPoly:
    """Cubic spline; over a part between two breaks its ends are free (not-a-knot)."""
    return CubicSpline(t, lengths, bc_type="periodic" if periodic else "not-a-knot")


def _pchip(t: np.ndarray, lengths: np.ndarray, *, periodic: bool) -> PPoly:
    """Piecewise cubic that stays between the rows (Fritsch and Butland)."""
    if not periodic:
        return PchipInterpolator(t, lengths)
    # slopes depend on both neighbours
    before, after = t[-3:-1] - t[-1], t[1:3] + t[-1]
    return PchipInterpolator(
        np.concatenate([before, t, after]),
        np.concatenate([lengths[-3:-1], lengths, lengths[1:3]]),
    )


def _between(spline: PPoly, rows: int) -> np.ndarray:
    """Values (rows - 1, places) between the rows of a spline."""
    t = spline.x
    assert len(t) == rows
    return spline(t[:-1, None] + np.diff(t)[:, None] * _BETWEEN)


def _excess(spline: PPoly, lengths: np.ndarray) -> np.ndarray:
    """Excess of a spline over the lengths of its two adjacent rows, for each interval."""
    values = _between(spline, len(lengths))
    low, high = np.minimum(lengths[:-1], lengths[1:]), np.maximum(lengths[:-1], lengths[1:])
    return np.maximum(np.maximum(values.max(axis=1) - high, low - values.min(axis=1)), 0.0)


def _least(spline: PPoly) -> float:
    return float(_between(spline, len(spline.x)).min())


def _as_a_sine(rows: int) -> float:
    """Share of the range by which a spline of a smooth table may leave its rows."""
    # A sine with its extremes in the middle between rows leaves them by (1 − cos a)/(2 cos a) of
    # the range of the table, with a = π over the rows per period; steep tables by far more.
    angle = math.pi / max(rows, 3)
    return 1.5 * (1 - math.cos(angle)) / (2 * math.cos(angle)) + _FREE
