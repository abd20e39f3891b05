"""Trackers as scenes describe them, made into closed loops."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from wormopt.control.funnel import Funnel, funnel_tracker
from wormopt.control.lambda_tracker import Adaptation, Decay, Exponent, Quadratic, lambda_tracker
from wormopt.control.loop import FeedForward
from wormopt.control.reference import follow
from wormopt.errors import SceneError
from wormopt.model.gait import Gait
from wormopt.model.model import Model
from wormopt.scene.scene import Scene
from wormopt.scene.types import per
from wormopt.systems.chain.runs.chains import Links, build_chain
from wormopt.systems.chain.scenes.track import (
    DecayLaw,
    DerivativeTracker,
    ExponentLaw,
    FilterTracker,
    FunnelTable,
    FunnelTracker,
    Tracker,
    TrackScene,
)


def build_loop(scene: Scene[TrackScene], index: int, gait: Gait, links: Links) -> Model:
    """Close the loop of the tracker `index` around links that shall follow a gait.

    Raises SceneError if the tracker cannot start there.
    """
    table = scene.table
    length = float(np.mean(np.abs(gait(gait.breaks[:-1])))) or 1.0
    plant = build_chain(table.worm, table.start, links, length, gait.period)
    reference = follow(gait, plant.t, shift=table.reference.shift % gait.period)
    tracker = table.trackers[index]
    shared: dict[str, Any] = {"feedforward": _feedforward(tracker, table)}
    try:
        if isinstance(tracker, FunnelTracker):
            return funnel_tracker(
                plant,
                reference,
                funnel=_funnel(tracker.funnel),
                rate_funnel=_funnel(tracker.rate_funnel),
                gain=tracker.gain,
                **shared,
            )
    except ValueError as error:
        message = f"{error}; write wider funnels, or another start"
        raise SceneError(scene.name, [(table.tracker_key(index), message)]) from None
    if isinstance(tracker, FilterTracker):
        shared["filter_start"] = tracker.filter_start
    return lambda_tracker(
        plant,
        reference,
        tube_radius=tracker.tube_radius,
        feedback="filter" if isinstance(tracker, FilterTracker) else "derivative",
        adaptation=_adaptation(tracker),
        gain_start=tracker.gain_start,
        **shared,
    )


def _funnel(table: FunnelTable) -> Funnel:
    return Funnel(table.start, table.end, table.time)


def _adaptation(tracker: FilterTracker | DerivativeTracker) -> Adaptation:
    law = tracker.adaptation
    if isinstance(law, ExponentLaw):
        return Exponent(law.exponent, tracker.growth)
    if isinstance(law, DecayLaw):
        return Decay(law.dwell, law.decay, tracker.growth)
    return Quadratic(tracker.growth)


def _feedforward(tracker: Tracker, table: TrackScene) -> FeedForward | None:
    believed = tracker.feedforward
    if believed is None:
        return None

    def number(name: str) -> tuple[float, ...]:
        value = getattr(believed, name)
        return per(getattr(table.worm, name) if value is None else value, table.worm.links)

    return FeedForward(number("stiffness"), number("rest_length"), number("damping"))


def tube_radius(tracker: Tracker) -> float:
    """Radius of the tube that a tracker is judged by."""
    if isinstance(tracker, FunnelTracker):
        return tracker.funnel.end if tracker.tube_radius is None else tracker.tube_radius
    return tracker.tube_radius


def labels(trackers: Sequence[Tracker]) -> list[str]:
    """Name of each tracker, no two alike."""
    found = [tracker.name or _default_name(tracker) for tracker in trackers]
    counts = Counter(found)
    return [
        f"{name}, no. {found[: k + 1].count(name)}" if counts[name] > 1 else name
        for k, name in enumerate(found)
    ]


def _default_name(tracker: Tracker) -> str:
    if isinstance(tracker, FunnelTracker):
        return "funnel controller"
    return "tracker (14)" if isinstance(tracker, FilterTracker) else "tracker (13)"
