"""A closed loop that was simulated: what is measured along it, its signals and numbers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import casadi as ca

from wormopt.model.model import Model
from wormopt.simulation.trajectory import Trajectory
from wormopt.systems.chain.runs.loops import tube_radius
from wormopt.systems.chain.scenes.track import FunnelTracker, Tracker
from wormopt.systems.shared.signals import (
    CHAIN_SIGNALS,
    Kind,
    at_ends,
    chain_expressions,
    largest,
    symbol,
)
from wormopt.systems.shared.watch import chain_numbers, measure_power, time_in_tube, watch_tube

LOOP_SIGNALS: dict[str, Kind] = CHAIN_SIGNALS | {
    "error_norm": ("length", (), "norm of the error e"),
    "tube": ("length", (), "radius of the tube around the reference"),
    "funnel": ("length", (), "width of the funnel around the reference"),
    "gain": ("count", (), "gain k"),
}
"""Signals of a tracker's motion; those of its chain too."""


@dataclass(frozen=True, eq=False)
class Tracked:
    """One tracker's motion."""

    label: str
    tracker: Tracker  # what the scene says
    loop: Model  # closed loop, without what is measured
    motion: Trajectory


def watched(loop: Model, tracker: Tracker) -> Model:
    """Add to a closed loop what is measured along its motion."""
    return watch_tube(measure_power(loop), tube_radius(tracker))


def loop_numbers(each: Tracked) -> dict[str, tuple[Any, str]]:
    """(Value, quantity) of each scalar of a tracker's motion, by its name in a Result."""
    motion = each.motion
    chain = chain_numbers(motion)
    outside, captured = time_in_tube(motion)
    filtered = any(signal.name == "filter" for signal in each.loop.x)
    gain = at_ends(motion).observe(_gain(each))[0, -1]
    return {
        "x_end": chain.pop("x_end"),
        "v_end": chain.pop("v_end"),
        "k_end": (gain, "count"),
        "filter_end": (motion.state("filter")[:, -1] if filtered else None, "length"),
        "distance": chain.pop("distance"),
        "mean_speed": chain.pop("mean_speed"),
        "time_outside_tube": (outside, "time"),
        "capture_time": (captured, "time"),
        **chain,
    }


def _gain(each: Tracked) -> ca.SX:
    """Factor of the error's rate in the input."""
    if isinstance(each.tracker, FunnelTracker):
        return symbol(each.loop, "gain") * each.loop.output("funnel_gain")[1]
    return symbol(each.loop, "gain")


def loop_expressions(each: Tracked) -> dict[str, ca.SX]:
    """Signals of a tracker's motion, by name."""
    return chain_expressions(each.motion.system.model) | {
        "error_norm": each.loop.output("error_norm"),
        "tube": ca.SX(tube_radius(each.tracker)),
        "gain": _gain(each),
    }


def faults_of_funnel(each: Tracked) -> Iterator[str]:
    """Say where an error left its funnel."""
    if not isinstance(each.tracker, FunnelTracker):
        return
    loop = each.loop
    for norm, width in (("error_norm", "funnel"), ("rate_error_norm", "rate_funnel")):
        if not largest(each.motion, loop.output(norm) / loop.output(width)) < 1:
            yield f"{norm} leaves its {width}, where the controller has no meaning"
