"""Common parts of exported files: names, remarks on their origin, instants with a fixed step."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from fractions import Fraction
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from wormopt.errors import ArgumentError, OutputError
from wormopt.files import MARK
from wormopt.model.gait import Gait
from wormopt.result import Result
from wormopt.shown import one_line
from wormopt.systems.spiked.construct import gait_of_result
from wormopt.systems.spiked.verify import in_steps
from wormopt.version import VERSION

# Negligible share of a step; fewest steps of a cycle; most instants of a table.
_NO_STEP, _FEWEST_STEPS, _MOST = Fraction(1, 10**6), 3, 1_000_000
_MADE_BY = f"{MARK}, version {VERSION}"


def optional(package: str, extra: str) -> ModuleType:
    """Import a package of an extra; ArgumentError that names both if it is missing."""
    try:
        return import_module(package)
    except ImportError as error:
        raise ArgumentError(
            f"{extra} needs {package}, which cannot be imported ({error}); install it with: "
            f"pip install 'wormopt[{extra}]'"
        ) from error


def remarks(result: Result) -> list[str]:
    """Lines of plain text about a result, and whether it failed or is unchecked."""
    titled = f": {result.title}" if result.title and result.title != result.scene else ""
    lines = [f"{result.scene}{titled} (kind {result.kind or 'unknown'})", _MADE_BY]
    if result.status == "failed":
        lines.append(f"DO NOT USE, the result failed: {result.reason}")
    if result.status == "unchecked":
        lines.append(f"UNCHECKED: {result.reason}")
    return [one_line(line) for line in lines]


def whole_steps(period: float, step: float) -> float:
    """Smallest multiple of a step that is no shorter than a period."""
    exact = Fraction(repr(float(step)))
    count = math.ceil(Fraction(repr(float(period))) / exact - _NO_STEP)
    if count < _FEWEST_STEPS:
        raise ArgumentError(
            f"a cycle of {period:g} has fewer than {_FEWEST_STEPS} steps of {step:g}; write a "
            f"step of at most {period / _FEWEST_STEPS:.6g}"
        )
    return float(count * exact)


@dataclass(frozen=True, eq=False)
class ExportedGait:
    """A gait for export, with remarks, units and steps of lengths."""

    gait: Gait
    remarks: tuple[str, ...] = (_MADE_BY,)
    time_unit: str = "s"
    length_unit: str = "m"
    length_step: float | None = None  # tables contain multiples of it, within
    ranges: Sequence[Sequence[float]] = ()

    @classmethod
    def of(cls, result: Result) -> ExportedGait:
        """The gait of a result; raises ArgumentError if there is none of links."""
        if "gait_polynomial" not in result or result["gait_polynomial"].dims[1] != "link":
            held = "gait, gait-design, gait-pareto, stepper, track, track-optimal or pair-waveform"
            raise ArgumentError(
                f"{result.scene}: a result of kind {result.kind} holds no gait, which C, Arduino "
                f"and ROS need; use kind {held}, or export to csv or mat"
            )
        rounded: dict[str, Any] = {}
        if "length_step" in result.scalars:
            step, ranges = (result.scalars[name].value for name in ("length_step", "length_limits"))
            rounded = {"length_step": step, "ranges": ranges}
        return cls(
            gait_of_result(result),
            tuple(remarks(result)),
            result["gait_breaks"].unit,
            result["gait_polynomial"].unit,
            **rounded,
        )

    def rounded(self, lengths: np.ndarray) -> np.ndarray:
        """Lengths (n, m) of a table, in whole steps if links have steps."""
        step = self.length_step
        return lengths if step is None else in_steps(lengths, step, self.ranges)

    @property
    def rounding(self) -> tuple[str, ...]:
        """Remark on the steps of lengths in a table."""
        if self.length_step is None:
            return ()
        step = f"{self.length_step!r} {self.length_unit}".removesuffix(" 1")
        return (f"lengths are multiples of {step}; rates and accelerations are those before that",)

    def in_whole_steps(self, step: float) -> ExportedGait:
        """Slow the gait to the next multiple of a step, so that limits still hold."""
        cycle = whole_steps(self.gait.period, step)
        if cycle == self.gait.period:
            return self
        unit = "" if self.time_unit == "1" else f" {self.time_unit}"
        before = f"{self.gait.period!r}{unit}"
        remark = f"cycle of {cycle!r}{unit}, a multiple of the step, instead of {before}"
        return replace(self, gait=self.gait.with_period(cycle), remarks=(*self.remarks, remark))

    @property
    def units(self) -> tuple[str, str, str, str]:
        """Units of time, length, rate and acceleration, "1" if the scene has none."""
        if self.time_unit == "1":
            return "1", "1", "1", "1"
        length, time = self.length_unit, self.time_unit
        return time, length, f"{length} {time}-1", f"{length} {time}-2"


def target(output: str | Path | None, name: str, suffixes: Sequence[str]) -> tuple[Path, str]:
    """Folder to write to, and the stem of the names of files.

    `name` is used if `output` is only a folder; `suffixes` are those of the requested formats.
    """
    if output is None:
        return Path(), _plain(name)
    path = Path(output)
    if path.is_dir() or not path.suffix:
        return path, _plain(name)
    if [path.suffix] != [*suffixes]:
        if len(suffixes) > 1:
            what = f"one file cannot hold {len(suffixes)} formats; name a folder"
            raise OutputError(f"{path}: {what}")
        raise OutputError(f"{path}: write a name that ends in {suffixes[0]}, or a folder with -o")
    return path.parent, path.stem


def identifier(name: str) -> str:
    """Name valid in C and FMI: ASCII letters, digits and _, a letter first."""
    found = re.sub(r"[\W_]+", "_", name, flags=re.ASCII).strip("_")
    return found if re.match("[A-Za-z]", found) else f"gait_{found}".rstrip("_")


def _plain(name: str) -> str:
    """Part of a file name, for any name of a result."""
    return re.sub(r"[^\w.-]+", "_", name).strip("._") or "result"


def multiples(step: float, first: float, last: float) -> list[Decimal]:
    """All k * step from `first` to `last`, both included but for round-off."""
    # The step is the shortest decimal that reads as it: three times 0.1 are 0.3.
    if not (isinstance(step, int | float) and math.isfinite(step) and step > 0):
        raise ArgumentError(f"the step must be positive, not {step!r}")
    slack = 1e-12 * max(abs(first), abs(last))
    low, high = math.ceil((first - slack) / step), math.floor((last + slack) / step)
    if high - low >= _MOST:
        raise ArgumentError(f"step = {step:g} gives more than {_MOST} points; write a larger one")
    if high < low:
        raise ArgumentError(f"no multiple of {step:g} is between {first:g} and {last:g}")
    exact = Decimal(repr(float(step)))
    return [k * exact for k in range(low, high + 1)]


def times(step: float, first: float, last: float) -> np.ndarray:
    """Instants of `multiples` as numbers."""
    return np.array([float(t) for t in multiples(step, first, last)])
