"""Build models of chains and trackers from scene tables."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from wormopt.control.funnel import Funnel, funnel_tracker
from wormopt.control.lambda_tracker import (
    Adaptation,
    Decay,
    Exponent,
    Feedback,
    Quadratic,
    lambda_tracker,
)
from wormopt.control.loop import FeedForward, Reference
from wormopt.control.switching import switching_tracker
from wormopt.errors import ArgumentError
from wormopt.model.friction import Coulomb, Law, Spike, Stribeck, Viscous
from wormopt.model.gait import Gait
from wormopt.model.model import Model
from wormopt.model.schedule import ParameterPath, ornstein_uhlenbeck, piecewise_constant
from wormopt.study.numerics import Start
from wormopt.study.types import per
from wormopt.systems.chain.build import chain
from wormopt.systems.chain.tables import (
    BacksteppingTracker,
    ChainTable,
    CoulombFriction,
    DecayLaw,
    DerivativeTracker,
    DifferenceTracker,
    ExponentLaw,
    FilterTracker,
    FixedDraw,
    Friction,
    FunnelTable,
    FunnelTracker,
    LambdaTracker,
    Process,
    SpikeFriction,
    Steps,
    StribeckFriction,
    SwitchingTracker,
    Tracker,
    ViscousFriction,
)

_RANDOM = ("stiffness", "damping", "rest_length")
_LAWS: dict[type[Friction], type[Coulomb | Stribeck | Viscous | Spike]] = {
    CoulombFriction: Coulomb,
    StribeckFriction: Stribeck,
    ViscousFriction: Viscous,
    SpikeFriction: Spike,
}
_FEEDBACKS: dict[type, Feedback] = {
    DerivativeTracker: "derivative",
    FilterTracker: "filter",
    DifferenceTracker: "difference",
    BacksteppingTracker: "backstepping",
}
_NAMES = {
    DerivativeTracker: "tracker (13)",
    FilterTracker: "tracker (14)",
    DifferenceTracker: "(13), delayed difference",
    BacksteppingTracker: "filtered input",
    SwitchingTracker: "switching gains",
}


@dataclass(frozen=True, eq=False)
class Links:
    """Drawn parameters of the links: one number per link, or a function of time."""

    stiffness: np.ndarray | ParameterPath
    damping: np.ndarray | ParameterPath
    rest_length: np.ndarray | ParameterPath

    @property
    def numbers(self) -> dict[str, np.ndarray]:
        """Parameters that are constant in time: parameters of the model."""
        found = {name: getattr(self, name) for name in _RANDOM}
        return {k: v for k, v in found.items() if not isinstance(v, ParameterPath)}

    @property
    def paths(self) -> dict[str, np.ndarray]:
        """Schedule values of the parameters that vary in time."""
        found = {name: getattr(self, name) for name in _RANDOM}
        return {k: v.values for k, v in found.items() if isinstance(v, ParameterPath)}


def draw_links(worm: ChainTable, horizon: float, member: int = 0) -> Links:
    """Draw the parameters of the links of one member of an ensemble, over the time `horizon`.

    A member does not depend on the number of members.
    """
    processes = worm.random.processes if worm.random else {}
    seed = worm.random.seed if worm.random else 0
    drawn = {}
    for index, name in enumerate(_RANDOM):
        mean = np.array(per(getattr(worm, name), worm.links))
        rng = np.random.default_rng([seed, member, index])  # Each parameter has its own generator,
        # so parameters do not shift each other.
        process = processes.get(name)
        drawn[name] = mean if process is None else _course(process, mean, horizon, rng)
    return Links(**drawn)


def _course(
    process: Process, mean: np.ndarray, horizon: float, rng: np.random.Generator
) -> np.ndarray | ParameterPath:
    if isinstance(process, FixedDraw):
        spread = np.broadcast_to(np.array(process.spread), mean.shape)
        return rng.uniform(mean - spread, mean + spread)
    if isinstance(process, Steps):
        return piecewise_constant(rng, mean, process.spread, process.interval, horizon)
    return ornstein_uhlenbeck(
        rng, mean, process.deviation, process.correlation_time, process.step, horizon
    )


def build_chain(
    worm: ChainTable, start: Start, links: Links, length_nominal: float, time_nominal: float
) -> Model:
    """Build the Model of a chain.

    `*_nominal` are the usual sizes of a link length and of a period. Without start positions, links
    have the rest length of the scene, even if the drawn rest length differs.
    """
    position = start.position
    if position is None:
        rest = np.array(per(worm.rest_length, worm.links))
        position = tuple(np.append(np.cumsum(rest[::-1])[::-1], 0.0).tolist())
    return chain(
        worm.links,
        mass=worm.mass,
        stiffness=links.stiffness,
        damping=links.damping,
        rest_length=links.rest_length,
        law=laws_of(worm) or None,
        drag=worm.drag,
        load=worm.pull,
        position=position,
        velocity=start.velocity,
        length_nominal=length_nominal,
        time_nominal=time_nominal,
    )


def chain_for(worm: ChainTable, start: Start, links: Links, gait: Gait) -> Model:
    """Build the Model of a chain, scaled by the gait that its links follow."""
    length = float(np.mean(np.abs(gait(gait.breaks[:-1])))) or 1.0
    return build_chain(worm, start, links, length, gait.period)


class Grounded(Protocol):
    """A table of masses on the ground."""

    @property
    def friction(self) -> Any:
        """A table for all masses, a table per mass, or None."""
        ...

    @property
    def ground(self) -> tuple[Friction, ...]:
        """Friction table of every mass."""
        ...


def laws_of(worm: Grounded) -> list[Law]:
    """Friction law of every mass; empty where nothing rubs."""
    one_each = isinstance(worm.friction, tuple)
    return [law_of(table, 0 if one_each else i) for i, table in enumerate(worm.ground)]


def law_of(table: Friction, mass: int = 0) -> Law:
    """Friction law of one mass, from a table with numbers or lists with one number per mass."""

    def number(value: float | tuple[float, ...]) -> float:
        return value[mass] if isinstance(value, tuple) else value

    numbers = {
        name: number(getattr(table, name))
        for name in table.__struct_fields__
        if getattr(table, name) is not None
    }
    return _LAWS[type(table)](**numbers)


# -- trackers ------------------------------------------------------------------------------------


def close_loop(
    plant: Model, reference: Reference, tracker: Tracker, worm: ChainTable | None
) -> Model:
    """Close the loop of a tracker; `worm` is None for plants of the user's own."""
    feedforward = _feedforward(tracker, worm)
    if isinstance(tracker, FunnelTracker):
        return funnel_tracker(
            plant,
            reference,
            funnel=_funnel(tracker.funnel),
            rate_funnel=_funnel(tracker.rate_funnel),
            law=tracker.law,
            gain=tracker.gain,
            actuator=tracker.input,
            feedforward=feedforward,
        )
    if isinstance(tracker, SwitchingTracker):
        return switching_tracker(
            plant,
            reference,
            tube_radius=tracker.tube_radius,
            settling=tracker.settling,
            overshoot=tracker.overshoot,
            gain_start=tracker.gain_start,
            factor=tracker.factor,
            filter_start=tracker.filter_start,
            actuator=tracker.input,
            feedforward=feedforward,
        )
    return lambda_tracker(
        plant,
        reference,
        tube_radius=tracker.tube_radius,
        feedback=_FEEDBACKS[type(tracker)],
        adaptation=_adaptation(tracker),
        gain_start=tracker.gain_start,
        filter_start=tracker.filter_start if isinstance(tracker, FilterTracker) else 1.0,
        lag=tracker.lag if isinstance(tracker, DifferenceTracker) else 1.0,
        actuator=tracker.input,
        feedforward=feedforward,
    )


def _funnel(table: FunnelTable) -> Funnel:
    return Funnel(table.start, table.end, table.time)


def _adaptation(tracker: LambdaTracker) -> Adaptation:
    law = tracker.adaptation
    if isinstance(law, ExponentLaw):
        return Exponent(law.exponent, tracker.growth)
    if isinstance(law, DecayLaw):
        return Decay(law.dwell, law.decay, tracker.growth)
    return Quadratic(tracker.growth)


def _feedforward(tracker: Tracker, worm: ChainTable | None) -> FeedForward | None:
    believed = tracker.feedforward
    if believed is None:
        return None

    def number(name: str) -> Any:
        value = getattr(believed, name)
        if worm is None:
            if value is None:
                what = f"feedforward has no {name}, which a plant of your own does not give"
                raise ArgumentError(f"{what}; write {name} = ... in that table")
            return value
        return per(getattr(worm, name) if value is None else value, worm.links)

    return FeedForward(number("stiffness"), number("rest_length"), number("damping"))


def tube_radius(tracker: Tracker) -> float:
    """Radius of the tube that judges a tracker."""
    if isinstance(tracker, FunnelTracker):
        return tracker.funnel.end if tracker.tube_radius is None else tracker.tube_radius
    return tracker.tube_radius


def labels(trackers: Sequence[Tracker]) -> list[str]:
    """Name of each tracker; no two names are equal."""
    found = [tracker.name or _default_name(tracker) for tracker in trackers]
    counts = Counter(found)
    return [
        f"{name}, no. {found[:k].count(name)}" if counts[name] > 1 else name
        for k, name in enumerate(found)
    ]


def _default_name(tracker: Tracker) -> str:
    if isinstance(tracker, FunnelTracker):
        return "funnel controller" if tracker.law == "recursive" else "funnel, two gains"
    return _NAMES[type(tracker)]
