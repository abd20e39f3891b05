"""Scenes of kind ``channel-worm``: velocity over frequency by (32), for three assumed shapes."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from wormopt.progress import Report
from wormopt.quantities import Scalar, Variable, unit_of
from wormopt.result import Result
from wormopt.scene.scene import Scene
from wormopt.systems.channel.closed_forms import DIRECTION, SHAPES, ChannelWorm, Shape
from wormopt.systems.channel.curve import Curve, graph_curve
from wormopt.systems.channel.samples import Mark
from wormopt.systems.channel.scenes.channel import ChannelBodyTable, ChannelWormScene

_FREQUENCIES = 101
# Lengths of the formulas against those of centre lines as Chebyshev series.
_ACCEPTED = 1e-10
_ASSUMED = {
    "inertia": "the body follows the field at once: (32) has no inertia and holds for slow "
    "switching only",
    "shape": "centre lines (33), (34) and (35) are assumed, not computed from forces",
    "grip": "segments do not slip while the field passes",
}


def run(scene: Scene[ChannelWormScene], report: Report) -> Result:
    """Lengths, counts and velocities of segments.

    Status "failed" where a length is not found again from its centre line.
    """
    table, begin = scene.table, time.perf_counter()
    report("evaluating", None)
    worm, marks = body_of(table.worm), _marks(table)
    lengths = [worm.arc_length(shape) for shape in SHAPES]
    again = [assumed_curve(worm, shape).length for shape in SHAPES]
    error = float(np.max(np.abs(np.divide(again, lengths) - 1)))
    fault = ""
    if not error <= _ACCEPTED:
        fault = f"lengths are off by {error:.2g} from those of the centre lines"
    return Result(
        scene.name,
        table.kind,
        scene.title,
        status="failed" if fault else "ok",
        reason=fault,
        scalars=_scalars(worm, table, marks),
        variables=_lines(worm, table),
        trust={
            "recheck_error": error,
            "accepted": _ACCEPTED,
            "assumptions": dict(_ASSUMED),
            "warnings": list(_warnings(worm, table, marks)),
        },
        timings_s={"evaluate": time.perf_counter() - begin},
        scene_text=scene.text,
    )


def body_of(table: ChannelBodyTable) -> ChannelWorm:
    """Make the body of a scene from its checked table."""
    names = ("pitch", "channel", "body", "length", "youngs_modulus")
    return ChannelWorm(*(table.size(name) for name in names), rule=table.count)


def assumed_curve(worm: ChannelWorm, shape: Shape) -> Curve:
    """Centre line of an assumed shape ("sine", "beam" or "line") by its length, in m."""
    return graph_curve(lambda x: worm.center_line(shape, x), worm.pitch)


def warnings_of_count(name: str, worm: ChannelWorm, count: int, length: float) -> Iterator[str]:
    """Yield warnings where `count` segments k_s of `length` l_s, in m, do not fit the body."""
    if not count:
        yield (
            f"{name}: the body is too short to count one segment of {1e3 * length:.4g} mm; by (32) "
            "it does not move"
        )
    elif count * length > worm.length:
        yield (
            f"{name}: {count} segments of {1e3 * length:.4g} mm are longer than the body of "
            f'{1e3 * worm.length:.4g} mm; worm.count = "floor" counts whole ones'
        )


def _marks(table: ChannelWormScene) -> tuple[Mark, ...]:
    sample = table.worm.of_chapter
    given = tuple(Mark(m.frequency, m.velocity, m.text) for m in table.measured)
    return (sample.marks if sample else ()) + given


def _limits(table: ChannelWormScene) -> tuple[float | None, float | None]:
    """Frequencies below which (32) is claimed, and above which the body stands."""
    sample = table.worm.of_chapter
    if sample is None:
        return table.valid_below, table.stops_above
    return table.valid_below or sample.valid_below, table.stops_above or sample.stops_above


def _scalars(
    worm: ChannelWorm, table: ChannelWormScene, marks: tuple[Mark, ...]
) -> dict[str, Scalar]:
    per = [worm.velocity_per_frequency(shape) for shape in SHAPES]
    at = [[mark.frequency * each for each in per] for mark in marks]
    ratio = [[v / mark.velocity for v in row] for row, mark in zip(at, marks, strict=True)]
    valid_below, stops_above = _limits(table)
    found: dict[str, tuple[Any, str]] = {
        "shapes": (list(SHAPES), "count"),
        "arc_length": ([worm.arc_length(shape) for shape in SHAPES], "length"),
        "segments": ([worm.count(shape) for shape in SHAPES], "count"),
        "missing_length": ([worm.missing_length(shape) for shape in SHAPES], "length"),
        "velocity_per_frequency": (per, "length"),
        "direction": (DIRECTION, "count"),
        "rise": (worm.rise, "length"),
        "measured": ([mark.text for mark in marks], "count"),
        "measured_frequency": ([mark.frequency for mark in marks], "rate"),
        "measured_velocity": ([mark.velocity for mark in marks], "speed"),
        "velocity_at": (at, "speed"),
        "velocity_over_measured": (ratio, "share"),
        "valid_below": (valid_below, "rate"),
        "stops_above": (stops_above, "rate"),
    }
    return {name: Scalar(value, unit_of(kind, "SI")) for name, (value, kind) in found.items()}


def _lines(worm: ChannelWorm, table: ChannelWormScene) -> tuple[Variable, ...]:
    low, high = table.frequency
    frequency = np.linspace(low, high, _FREQUENCIES)
    per = [worm.velocity_per_frequency(shape) for shape in SHAPES]
    rate, speed = unit_of("rate", "SI"), unit_of("speed", "SI")
    return (
        Variable("frequency", rate, ("frequency",), frequency, "coil switches per second"),
        Variable(
            "velocity", speed, ("shape", "frequency"), np.outer(per, frequency),
            "against the travel of the field",
        ),
    )  # fmt: skip


def _warnings(worm: ChannelWorm, table: ChannelWormScene, marks: tuple[Mark, ...]) -> Iterator[str]:
    for shape in SHAPES:
        yield from warnings_of_count(shape, worm, worm.count(shape), worm.arc_length(shape))
    limit, _ = _limits(table)
    for mark in marks:
        if limit is not None and mark.frequency >= limit:
            yield (
                f"{mark.text}: at {mark.frequency:g} switches a second (32) is not claimed, only "
                f"below {limit:g}"
            )
