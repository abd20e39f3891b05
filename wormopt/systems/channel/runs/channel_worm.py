"""Runs of kind ``channel-worm``: velocity over frequency, for three assumed shapes."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from wormopt.progress import Report
from wormopt.result import Check, Result, left_out
from wormopt.study.conclude import conclude
from wormopt.study.scene import Scene
from wormopt.systems.channel.closed_forms import DIRECTION, SHAPES, ChannelWorm
from wormopt.systems.channel.samples import Mark
from wormopt.systems.channel.scenes.channel import ChannelBodyTable, ChannelWormScene
from wormopt.systems.channel.segments import assumed_curve

_FREQUENCIES = 101
# Accepted error of the formulas' lengths against centre lines as Chebyshev series.
_ACCEPTED = 1e-10
_ASSUMED = {
    "inertia": "the body follows the field at once: eq. 32 of Zimmermann et al. has no inertia and "
    "holds for slow switching only",
    "shape": "centre lines (eqs 33-35 of Zimmermann et al.) are assumed, not computed from forces",
    "grip": "segments do not slip while the field passes",
}


def run(scene: Scene[ChannelWormScene], report: Report) -> Result:
    """Compute lengths, numbers and velocities of segments.

    Status "failed" if the centre line gives another length.
    """
    table, begin = scene.table, time.perf_counter()
    report("evaluating", None)
    worm, marks = body_of(table.worm), _marks(table)
    lengths = [worm.arc_length(shape) for shape in SHAPES]
    again = [assumed_curve(worm, shape).length for shape in SHAPES]
    error = float(np.max(np.abs(np.divide(again, lengths) - 1)))
    low, high = table.frequency
    frequency = np.linspace(low, high, _FREQUENCIES)
    per = [worm.velocity_per_frequency(shape) for shape in SHAPES]
    advice = f"lengths differ by {error:.2g} from those of the centre lines"
    return conclude(
        scene,
        _scalars(worm, table, marks),
        {"frequency": frequency, "velocity": np.outer(per, frequency)},
        checks=[Check("lengths of centre lines", error, _ACCEPTED, advice)],
        facts={"recheck_error": error, "accepted": _ACCEPTED, "assumptions": _ASSUMED},
        warnings=_warnings(worm, table, marks),
        timings={"evaluate": time.perf_counter() - begin},
    )


def body_of(table: ChannelBodyTable) -> ChannelWorm:
    """Return the body of a scene from its checked table."""
    names = ("pitch", "channel", "body", "length", "youngs_modulus")
    return ChannelWorm(*(table.size(name) for name in names), rule=table.count)


def warnings_of_count(name: str, worm: ChannelWorm, count: int, length: float) -> Iterator[str]:
    """Yield warnings if `count` segments k_s of `length` l_s, in m, do not fit the body."""
    if not count:
        yield (
            f"{name}: the body is shorter than one segment of {1e3 * length:.4g} mm; by eq. 32 of "
            "Zimmermann et al. it does not move"
        )
    elif count * length > worm.length:
        yield (
            f"{name}: {count} segments of {1e3 * length:.4g} mm exceed the body of "
            f'{1e3 * worm.length:.4g} mm; worm.count = "floor" counts whole segments only'
        )


def warnings_of_susceptibility(value: float, label: str = "") -> Iterator[str]:
    """Warn if the body changes the field; across a rod it does by 1 / (1 + χ / 2)."""
    if value > 1:
        yield left_out(
            value / 2,
            f"{label}a susceptibility of {value:g} changes the field in and near the body, but the "
            "pull is computed with the field without the body",
        )


def _marks(table: ChannelWormScene) -> tuple[Mark, ...]:
    sample = table.worm.of_chapter
    given = tuple(Mark(m.frequency, m.velocity, m.text) for m in table.measured)
    return (sample.marks if sample else ()) + given


def _limit(table: ChannelWormScene, name: str) -> float | None:
    """Return a frequency limit by its key, from the named body if the scene has none."""
    sample = table.worm.of_chapter
    return getattr(table, name) or (getattr(sample, name) if sample else None)


def _scalars(worm: ChannelWorm, table: ChannelWormScene, marks: tuple[Mark, ...]) -> dict[str, Any]:
    per = [worm.velocity_per_frequency(shape) for shape in SHAPES]
    at = [[mark.frequency * each for each in per] for mark in marks]
    ratio = [[v / mark.velocity for v in row] for row, mark in zip(at, marks, strict=True)]
    return {
        "shapes": list(SHAPES),
        "arc_length": [worm.arc_length(shape) for shape in SHAPES],
        "segments": [worm.count(shape) for shape in SHAPES],
        "missing_length": [worm.missing_length(shape) for shape in SHAPES],
        "velocity_per_frequency": per,
        "direction": DIRECTION,
        "rise": worm.rise,
        "measured": [mark.text for mark in marks],
        "measured_frequency": [mark.frequency for mark in marks],
        "measured_velocity": [mark.velocity for mark in marks],
        "velocity_at": at,
        "velocity_over_measured": ratio,
        "valid_below": _limit(table, "valid_below"),
        "stops_above": _limit(table, "stops_above"),
    }


def _warnings(worm: ChannelWorm, table: ChannelWormScene, marks: tuple[Mark, ...]) -> Iterator[str]:
    for shape in SHAPES:
        yield from warnings_of_count(shape, worm, worm.count(shape), worm.arc_length(shape))
    limit = _limit(table, "valid_below")
    for mark in marks:
        if limit is not None and mark.frequency >= limit:
            yield (
                f"{mark.text}: at {mark.frequency:g} switches per second eq. 32 of Zimmermann et "
                f"al. is not valid, only below {limit:g}"
            )
