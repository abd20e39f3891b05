"""Kind "channel-worm": velocity of a body in a channel over the frequency of its coils."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

from wormopt.errors import Fault
from wormopt.study import (
    array,
    check,
    entry,
    facts,
    on_use,
    parts,
    positive,
    value,
    warnings,
)
from wormopt.study.types import Pair, wrong_order
from wormopt.systems.channel.samples import Mark
from wormopt.systems.channel.tables import BodyStudy

with on_use():
    import numpy as np

    from wormopt.systems.channel.closed_forms import (
        DIRECTION,
        SHAPES,
        warnings_of_count,
    )
    from wormopt.systems.channel.segments import assumed_curve

_FREQUENCIES = 101
# Accepted error of the formulas' lengths against centre lines as Chebyshev series.
_ACCEPTED = 1e-10
_ASSUMED = {
    "inertia": "the body follows the field immediately: eq. 32 of Zimmermann et al. has no inertia "
    "and holds for slow switching only",
    "shape": "centre lines (eqs 33-35 of Zimmermann et al.) are assumed, not computed from forces",
    "grip": "segments do not slip while the field passes",
}


@dataclass(frozen=True)
class Numbers:
    """Segments of the assumed shapes and their velocities."""

    shapes: list[str] = value("1", "`sine`, `beam`, `line`; lists below are in this order")
    arc_length: list[float] = value("length", "length *l*<sub>s</sub> of a segment")
    segments: list[int] = value("count", "*k*<sub>s</sub>")
    missing_length: list[float] = value(
        "length",
        "*k*<sub>s</sub>*l*<sub>s</sub> less the length of the body; above 0 there is a warning",
    )
    velocity_per_frequency: list[float] = value("length", "velocity over switches per second")
    direction: int = value("1", "−1: against the travel of the field; velocities are magnitudes")
    rise: float = value("length", "*d* − *d*<sub>w</sub>")
    marks_named: list[str] = value("1", "labels of the marks", name="measured")
    measured_frequency: list[float] = value("rate", "frequencies of the marks")
    measured_velocity: list[float] = value("speed", "velocities of the marks")
    velocity_at: list[list[float]] = value(
        "speed", "eq. 32 at the frequency of each mark, a list over the shapes"
    )
    velocity_over_measured: list[list[float]] = value(
        "share", "this velocity over the measured one"
    )
    valid: float | None = value(
        "rate", "`valid_below` of the scene or the sample", name="valid_below"
    )
    stops: float | None = value(
        "rate", "`stops_above` of the scene or the sample", name="stops_above"
    )


class ChannelVelocity(BodyStudy, kind="channel-worm"):
    """Compute the velocity of a magnetisable body in a channel over the coil frequency.

    A magnetisable body lies in a channel beside coils that are switched in turn. The scene computes
    the length of a segment, the number of segments, and the velocity over the frequency. The
    velocity is eq. 32 of Zimmermann et al. 2007 [[1]](../references.md); the
    three assumed shapes are eqs 33–35. Theory:
    [theory-channel.md](../theory-channel.md#1-closed-forms). Only `units = "SI"`. Marks and limits
    of a sample are from the text of that chapter. They are left out if a size is changed.

    The trust report has `recheck_error` of the lengths, against centre lines as Chebyshev series,
    `accepted`, `assumptions`, and `warnings`. Warnings report segments longer than the body, no
    segment at all, and marks outside the stated validity of eq. 32.
    """

    pictures: ClassVar = {"channel_velocity": "figures 19 and 20 of Zimmermann et al."}

    frequency: Pair = entry(
        "range of coil switches per second", quantity="rate", default=(5.0, 1000.0)
    )
    measured: tuple[Mark, ...] = entry("measured marks beside those of the sample", default=())
    valid_below: float | None = positive(
        "rate",
        "switches per second below which eq. 32 is valid; the sample's if left out",
        default=None,
    )
    stops_above: float | None = positive(
        "rate",
        "switches per second above which the body stood still; the sample's if left out",
        default=None,
    )

    def faults_of_keys(self) -> Iterator[Fault]:
        yield from super().faults_of_keys()
        yield from wrong_order("frequency", self.frequency, may_be_equal=False)

    @cached_property
    def marks(self) -> tuple[Mark, ...]:
        """Measured velocities of the sample and of the scene."""
        sample = self.worm.published
        return (sample.marks if sample else ()) + self.measured

    def _limit(self, name: str) -> float | None:
        """Return a frequency limit by its key, from the named body if the scene has none."""
        sample = self.worm.published
        return getattr(self, name) or (getattr(sample, name) if sample else None)

    @parts(Numbers)
    def numbers(self) -> Numbers:
        worm, marks = self.body, self.marks
        per = [worm.velocity_per_frequency(shape) for shape in SHAPES]
        at = [[mark.frequency * each for each in per] for mark in marks]
        ratio = [[v / mark.velocity for v in row] for row, mark in zip(at, marks, strict=True)]
        return Numbers(
            shapes=list(SHAPES),
            arc_length=[worm.arc_length(shape) for shape in SHAPES],
            segments=[worm.count(shape) for shape in SHAPES],
            missing_length=[worm.missing_length(shape) for shape in SHAPES],
            velocity_per_frequency=per,
            direction=DIRECTION,
            rise=worm.rise,
            marks_named=[mark.text for mark in marks],
            measured_frequency=[mark.frequency for mark in marks],
            measured_velocity=[mark.velocity for mark in marks],
            velocity_at=at,
            velocity_over_measured=ratio,
            valid=self._limit("valid_below"),
            stops=self._limit("stops_above"),
        )

    @array("rate", "frequency", "coil switches per second", name="frequency")
    def frequencies(self) -> np.ndarray:
        low, high = self.frequency
        return np.linspace(low, high, _FREQUENCIES)

    @array("speed", "shape frequency", "velocity against the travel of the field")
    def velocity(self) -> np.ndarray:
        return np.outer(self.numbers.velocity_per_frequency, self.frequencies)

    @check(
        _ACCEPTED,
        "lengths differ by {value:.2g} from those of the centre lines",
        name="lengths of centre lines",
    )
    def off_in_length(self) -> float:
        again = [assumed_curve(self.body, shape).length for shape in SHAPES]
        return float(np.max(np.abs(np.divide(again, self.numbers.arc_length) - 1)))

    @facts
    def assumed(self) -> dict[str, Any]:
        error = self.off_in_length
        return {"recheck_error": error, "accepted": _ACCEPTED, "assumptions": _ASSUMED}

    @warnings
    def of_validity(self) -> Iterator[str]:
        for shape in SHAPES:
            count, length = self.body.count(shape), self.body.arc_length(shape)
            yield from warnings_of_count(shape, self.body, count, length)
        limit = self.numbers.valid
        for mark in self.marks:
            if limit is not None and mark.frequency >= limit:
                yield (
                    f"{mark.text}: at {mark.frequency:g} switches per second eq. 32 of Zimmermann "
                    f"et al. is not valid, only below {limit:g}"
                )
