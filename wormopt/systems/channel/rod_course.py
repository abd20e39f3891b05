"""Statistics and checks of a rod's motion in a channel.

Motions need not be regular. Batch means estimate the error of their mean velocities: means over
several whole repeats of the switching scatter about their common mean. Student's distribution
gives the confidence interval from this scatter.

Source: A. M. Law, Simulation Modeling and Analysis (2015), 9.5.3.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from wormopt.result import Check
from wormopt.study import on_use, value

with on_use():
    import casadi as ca
    import numpy as np
    from scipy.special import stdtrit

    from wormopt.model.model import Model, pack
    from wormopt.numerics.expressions import at_rows
    from wormopt.simulation.moreau import StepRecord

ASSUMED = {
    "plane": "the rod moves in one plane; gravity acts across it and is neglected, as is drag",
    "row": "the row of coils extends beyond both ends of the worm's path",
    "field": "the worm does not change the field; no iron; the pull acts on its centre line",
    "impact": "impacts on a wall are inelastic",
    "magnetisation": "linear in the field, without saturation and hysteresis",
}
_BATCHES, _CONFIDENCE = 8, 0.95
# Accepted error of the field's work by round-off and steps, depth in walls, and error of the field.
_ENERGY, _DEPTH, _FIELD = 0.01, 0.05, 0.05
# Velocities are compared relative to at least this share of the field's, and errors of the energy
# to at least the energy of the rod at this speed, because a rod may stand still. A velocity with a
# relative error above the second share is not compared.
_STILL, _KNOWN = 0.01, 0.5


@dataclass(frozen=True)
class Mean:
    """A mean velocity."""

    settled: bool  # both halves of the averaged time agree within errors
    velocity: float = value(
        "speed",
        "mean velocity after `time.settle`, positive with the field",
        name="velocity_mean",
    )
    error: float = value(
        "speed",
        "half the width of its 95 % interval, by means over batches of whole repeats",
        name="velocity_error",
    )

    @property
    def direction(self) -> int:
        """1 with the field, -1 against it, 0 if the interval contains both or is unknown."""
        return 0 if not abs(self.velocity) > self.error else int(math.copysign(1, self.velocity))


def mean_velocity(time: np.ndarray, centre: np.ndarray, cycle: float, settle: float) -> Mean:
    """Return the mean velocity over whole repeats, from `time` and `centre` (m,).

    Skips the initial share `settle` of the time; at least four repeats of duration `cycle` must be
    left.
    """
    repeats = math.floor((1 - settle) * time[-1] / cycle * (1 + 1e-9))
    batches = max(min(_BATCHES, repeats), 2)
    size = max(repeats // batches, 1) * cycle
    ends = time[-1] - size * np.arange(batches, -1, -1)
    parts = np.diff(np.interp(ends, time, centre)) / size
    halves = [_interval(part) for part in (parts[: batches // 2], parts[batches // 2 :])]
    return Mean(not differ(*halves[0], *halves[1]), *_interval(parts))


def _interval(parts: np.ndarray) -> tuple[float, float]:
    """Return the mean of batches, and half the width of its interval."""
    spread = float(np.std(parts, ddof=1)) if len(parts) > 1 else 0.0
    factor = float(stdtrit(max(len(parts) - 1, 1), (1 + _CONFIDENCE) / 2))
    return float(np.mean(parts)), factor * spread / math.sqrt(len(parts))


def differ(one: float, one_error: float, other: float, other_error: float) -> float:
    """Return the difference of two means beyond their errors, or 0."""
    return max(abs(one - other) - math.hypot(one_error, other_error), 0.0)


@dataclass(frozen=True)
class RodPoint(Mean):
    """Results of one motion; NaN if it failed or they are unknown."""

    rate: float = value("rate", "switches per second")
    arc_length: float = value(
        "length",
        "mean length of the rod from coil to coil of a block just before the coils change; "
        "unknown if it never lay over a block",
    )
    energy_error: float = value(
        "share",
        "largest error of the energy balance, over the work of the field (or the energy of the rod "
        "at a hundredth of the field's speed, if that is more)",
    )
    field_error: float = value(
        "share", "largest error of the series of *H*², over the largest *H*²"
    )
    penetration: float = math.nan  # largest depth in a wall, over the room of the centre line
    reason: str = ""  # why the motion failed; empty otherwise

    @classmethod
    def lost(cls, rate: float, reason: str) -> RodPoint:
        """Return the point of a motion that failed at `rate` switches per second."""
        names = ("velocity", "error", "arc_length", "energy_error", "field_error")
        return cls(settled=False, rate=rate, reason=reason, **dict.fromkeys(names, math.nan))


def checks_of_motion(point: RodPoint, what: str = "") -> Iterator[Check]:
    """Yield checks of a single motion; `what` names how it was computed."""
    named, before = (f" {what}", f"{what}: ") if what else ("", "")
    where = f"{before}at {point.rate:g} switches per second"
    if point.reason:
        yield Check(f"motion{named}", None, 0.0, f"{where} {point.reason}")
        return
    yield Check(
        f"energy balance{named}",
        point.energy_error,
        _ENERGY,
        f"{where} energy is not balanced, by {point.energy_error:.2g} of the field's work; "
        "write a shorter mesh.step",
    )
    yield Check(
        f"depth in walls{named}",
        point.penetration,
        _DEPTH,
        f"{where} walls are penetrated by {point.penetration:.2g} of the room; write a shorter "
        "mesh.step",
    )
    yield Check(
        f"series of the field{named}",
        point.field_error,
        _FIELD,
        f"{where} the series of H² differs by {point.field_error:.2g} of the largest; write a "
        "smaller mesh.field_tolerance or a narrower channel",
    )


def change_of(point: RodPoint, others: Iterable[RodPoint], field_speed: float) -> float | None:
    """Return the largest relative change of a mean velocity with other steps and meshes.

    Errors are not subtracted; None without `others`.
    """
    changes = [abs(other.velocity - point.velocity) for other in others]
    return max(changes) / _compared_with(point, field_speed) if changes else None


def _compared_with(point: RodPoint, field_speed: float) -> float:
    return max(abs(point.velocity), _STILL * field_speed)


def check_of_error(point: RodPoint, field_speed: float) -> Check:
    """Return the check that a mean velocity is known, over half of it or of `checks_of_change`."""
    advice = (
        f"at {point.rate:g} switches per second the error of the mean velocity is "
        f"{point.error:.2g} m/s, too large to know it; write a longer time.end"
    )
    limit = _KNOWN * _compared_with(point, field_speed)
    return Check("error of the mean velocity", point.error, limit, advice)


def checks_of_change(
    point: RodPoint, other: RodPoint, field_speed: float, accepted: float, what: str
) -> Iterator[Check]:
    """Yield checks that the mean velocity is independent of step or mesh; `what` names which.

    `accepted`: largest change beyond the errors, over the velocity, or over a hundredth of
    the field's.
    """
    size, where = _compared_with(point, field_speed), f"at {point.rate:g} switches per second"
    errors = math.hypot(point.error, other.error)
    known = Check(
        f"error of the mean velocity {what}",
        errors,
        _KNOWN * size,
        f"{where} the error of the mean velocity is {errors:.2g} m/s, too large to compare it "
        f"{what}; write a longer time.end",
    )
    yield known
    if known.passed:
        change = differ(point.velocity, point.error, other.velocity, other.error)
        yield Check(
            f"mean velocity {what}",
            change,
            accepted * size,
            f"{where} the mean velocity changes by {change:.2g} m/s {what}; write more "
            "mesh.elements, a shorter mesh.step or a longer time.end",
        )


def energy_error(
    model: Model, steps: StepRecord, numbers: dict[str, float], mass: float, field_speed: float
) -> float:
    """Return the largest difference of the energy from the work on the rod, over the field's.

    `mass`: of the rod, whose kinetic energy at a hundredth of `field_speed` is the least divisor.
    """
    p = np.array([numbers[signal.name] for signal in model.p])
    stored = model["strain_energy"] + model["kinetic_energy"]
    stored = ca.densify(ca.substitute(stored, pack(model.p), ca.DM(p)))
    energy = ca.Function("energy", [pack(model.x)], [stored])
    stored = at_rows(energy, steps.states.T)[0].ravel()
    done = sum(steps.work.values())
    scale = max(
        np.abs(np.diff(steps.work["load_power"])).sum(), mass / 2 * (_STILL * field_speed) ** 2
    )
    return float(np.abs(stored - stored[0] - done).max() / scale)


def lengths_between(
    x: np.ndarray, y: np.ndarray, first: np.ndarray, last: np.ndarray
) -> np.ndarray:
    """Return the lengths (m,) of polylines (n, m) between two positions along the row.

    From where each first passes `first` to where it last passes `last`; it must pass both.
    """
    pieces, many = np.hypot(np.diff(x, axis=0), np.diff(y, axis=0)), np.arange(x.shape[1])
    arc = np.vstack([np.zeros(len(many)), np.cumsum(pieces, axis=0)])

    def until(at: np.ndarray, piece: np.ndarray) -> np.ndarray:
        before, after = x[piece, many], x[piece + 1, many]
        share = np.clip((at - before) / (after - before), 0.0, 1.0)
        return arc[piece, many] + share * pieces[piece, many]

    one, other = ((x[:-1] - at) * (x[1:] - at) <= 0 for at in (first, last))
    i, j = np.argmax(one, axis=0), len(other) - 1 - np.argmax(other[::-1], axis=0)
    return np.abs(until(last, j) - until(first, i))
