"""Readings of the trackers (13) and (14) of Zimmermann et al. 2007 where their data are open.

A Reading makes all choices; all readings with the same structure are members of one ensemble.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Literal

import casadi as ca
import numpy as np

from wormopt.control.lambda_tracker import Feedback, Quadratic, lambda_tracker
from wormopt.control.loop import Actuator, FeedForward, feed, gait_reference, input_of
from wormopt.model.friction import Coulomb
from wormopt.model.gait import Gait
from wormopt.model.model import Model, Signal
from wormopt.simulation.ensemble import Scenario
from wormopt.systems.chain.build import chain
from wormopt.systems.chain.tables import Criteria, Strips

Order = Literal["printed", "reversed"]
"""Link to which the first list of eq. 15 belongs."""
Signs = Literal["printed", "turned", "filter"]
"""Signs of tracker (14): as printed; u and e in theta' reversed; e in theta' alone reversed."""


@dataclass(frozen=True)
class Reading:
    """One interpretation of the example."""

    start: tuple[float, ...]  # positions, head first
    rest_length: float | None  # of all links; None: they follow the reference
    input: Actuator
    growth: float  # gamma
    period: float
    friction: tuple[float, float]  # F+, F-
    links: Order
    signs: Signs


def readings(**choices: Sequence) -> tuple[Reading, ...]:
    """Every combination, the last choice fastest; choices by the names of `Reading`."""
    return tuple(
        Reading(**dict(zip(choices, each, strict=True))) for each in product(*choices.values())
    )


@dataclass(frozen=True, eq=False)
class Example:
    """Parameters that all readings share."""

    gait: Gait
    mass: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray
    tube_radius: float
    gain_start: float
    filter_start: np.ndarray
    shift: float = 0.0  # the reference at t is the gait at t + shift

    @property
    def links(self) -> int:
        """Number of links."""
        return self.gait.links


@dataclass(frozen=True)
class Structure:
    """Choices of a reading that need another model; the others are parameters."""

    feedback: Feedback
    input: Actuator
    period: float
    unstable: bool  # the sign in theta' is turned alone


def structure_of(reading: Reading, feedback: Feedback) -> Structure:
    """Structure of a reading's loop; tracker (13) has no filter whose sign could be reversed."""
    turned = feedback == "filter" and reading.signs == "filter"
    return Structure(feedback, reading.input, reading.period, turned)


def build(example: Example, of: Structure) -> Model:
    """Closed loop of a structure, without the parameters of a reading."""
    gait = example.gait.with_period(of.period)
    plant = chain(
        example.links,
        mass=example.mass,
        stiffness=example.stiffness,
        damping=example.damping,
        rest_length=1.0,
        law=Coulomb(1.0, 1.0),
        length_nominal=float(np.mean(np.abs(gait(gait.breaks[:-1])))) or 1.0,
        time_nominal=gait.period,
    )
    if of.unstable:
        # theta' = -k^2 (theta + e) is the filter of -theta, so u has the opposite sign.
        plant = _reversed_input(plant)
    return lambda_tracker(
        plant,
        gait_reference(gait, plant.t, shift=example.shift % gait.period),
        tube_radius=example.tube_radius,
        feedback=of.feedback,
        adaptation=Quadratic(),
        gain_start=example.gain_start,
        filter_start=example.filter_start,
        actuator=of.input,
        feedforward=FeedForward(0.0, 0.0),
        any_sign=of.unstable,
    )


def _reversed_input(plant: Model) -> Model:
    own = input_of(plant, plant["input"].numel())
    command = replace(own, symbol=ca.SX.sym("command", own.size))
    return replace(feed(plant, [own], -command.symbol), u=[command])


def gait_of(example: Example, reading: Reading) -> Gait:
    """Reference gait of the links."""
    gait = example.gait.with_period(reading.period)
    return reversed_links(gait) if reading.links == "reversed" else gait


def scenario(example: Example, reading: Reading, of: Structure, loop: Model) -> Scenario:
    """Parameters of a reading for the loop of its structure."""
    follows = reading.rest_length is None
    ahead = example.stiffness if follows else np.zeros(example.links)
    forward, backward = reading.friction
    p = {
        "rest_length": 0.0 if follows else reading.rest_length,
        "feedforward_stiffness": -ahead if of.unstable else ahead,
        "gain_growth": reading.growth,
        "friction_forward": forward,
        "friction_backward": backward,
    }
    start = {"position": np.array(reading.start)}
    if of.feedback == "filter":
        start["filter"] = example.filter_start * (1.0 if reading.signs == "printed" else -1.0)
    # Values do not depend on the shift.
    own = gait_reference(gait_of(example, reading), loop.t).schedule
    assert own is not None
    return Scenario(x0=start, p=p, schedules={own.name: own.values})


def as_model(loop: Model, parameters: Scenario) -> Model:
    """The loop with the parameters of a reading."""

    def given(signals: Sequence[Signal], values: object) -> list[Signal]:
        known = dict(values or {})  # type: ignore[call-overload]
        return [
            replace(s, value=tuple(np.broadcast_to(known[s.name], s.size).tolist()))
            if s.name in known
            else s
            for s in signals
        ]

    courses = dict(parameters.schedules or {})
    return replace(
        loop,
        x=given(loop.x, parameters.x0),
        p=given(loop.p, parameters.p),
        schedules=[replace(s, values=courses.get(s.name, s.values)) for s in loop.schedules],
    )


def reversed_links(gait: Gait) -> Gait:
    """The gait with the order of its links reversed."""
    if gait.omega is None or gait.cosine is None or gait.sine is None:
        return Gait(gait.breaks, gait.polynomial[:, ::-1])
    parts = (gait.cosine[:, ::-1], gait.sine[:, ::-1])
    return Gait(gait.breaks, gait.polynomial[:, ::-1], gait.omega, *parts)


# -- sentences of the text -------------------------------------------------------------------------

SENTENCES = {
    "quick": "tracker (13) brings the outputs into their strips very quickly, before tracker (14)",
    "open": "tracker (14) does not capture the outputs by the end",
    "settled": "the gain of tracker (13) has converged",
    "growing": "the gain of tracker (14) still increases at the end",
    "closer": "tracker (13) works better: it keeps the outputs closer to the reference than (14)",
    "learning": "gains increase as long as outputs are outside their strips",
    "working": "both trackers work: states and gains stay bounded",
}
"""Statements of the text on figures 5 to 8, paraphrased, by short names."""


@dataclass(frozen=True, eq=False)
class Course:
    """Samples of one motion; NaN from the time at which it was given up."""

    time: np.ndarray  # (m,)
    error: np.ndarray  # (n, m)
    gain: np.ndarray  # (m,)

    def size(self, strips: Strips) -> np.ndarray:
        """Size of the error that is compared with the tube's radius, (m,)."""
        return np.max(abs(self.error), axis=0) if strips == "outputs" else self.norm

    @property
    def norm(self) -> np.ndarray:
        """Euclidean norm of the error, (m,)."""
        return np.linalg.norm(self.error, axis=0)

    def until(self, count: int) -> Course:
        """The first `count` samples."""
        return Course(self.time[:count], self.error[:, :count], self.gain[:count])

    def captured(self, radius: float, strips: Strips, window: float) -> float:
        """Time from which the error stays in the tube; NaN if it is outside within the window.

        The samples decide; linear interpolation between two samples gives the time.
        """
        size = self.size(strips)
        outside = np.flatnonzero(~(size <= radius))
        if not outside.size:
            return float(self.time[0])
        last = outside[-1]
        if last + 1 >= len(self.time) or self.time[last + 1] > self.time[-1] - window:
            return np.nan
        pair = slice(last + 1, last - 1 if last else None, -1)  # Sizes are in ascending order.
        return float(np.interp(radius, size[pair], self.time[pair]))

    def growth(self, window: float) -> float:
        """Relative growth of the gain within the window."""
        return float(self.gain[-1] / self.gain[self._since(window)] - 1)

    def peak(self, window: float) -> float:
        """Largest norm of the error within the window."""
        return float(np.max(self.norm[self._since(window) :]))

    def learns(self, radius: float) -> bool:
        """Whether the gain increases between any two samples at which an output is outside."""
        outside = self.size("outputs") > radius
        both = outside[1:] & outside[:-1]
        return bool(np.all(np.diff(self.gain)[both] > 0))

    def _since(self, window: float) -> int:
        return int(np.searchsorted(self.time, self.time[-1] - window * (1 + 1e-12)))


def supported(first: Course, second: Course, radius: float, by: Criteria) -> dict[str, bool]:
    """Sentences that the motions with trackers (13) and (14) support, at their last sample."""
    working = bool(np.isfinite(first.gain[-1]) and np.isfinite(second.gain[-1]))
    # The norm is the larger measure: capture by it, or no capture without it, holds for both.
    captured = first.captured(radius, "norm" if by.strips == "both" else by.strips, by.window)
    other = second.captured(radius, "outputs" if by.strips == "both" else by.strips, by.window)
    never = working and np.isnan(other)
    return {
        "quick": captured <= by.quick and (never or captured < other),
        "open": bool(never),
        "settled": first.growth(by.window) <= by.settled,
        "growing": second.growth(by.window) >= by.growing,
        "closer": first.peak(by.window) < second.peak(by.window),
        "learning": first.learns(radius) and second.learns(radius),
        "working": working,
    }


def ends(first: Course, second: Course, radius: float, by: Criteria, count: int) -> Iterator[float]:
    """Yield the last times of intervals, of `count` tried, for which every sentence holds."""
    least = np.searchsorted(first.time, 2 * by.window)
    for k in np.linspace(least, len(first.time) - 1, count).astype(int):
        parts = first.until(k + 1), second.until(k + 1)
        if all(supported(*parts, radius, by).values()):
            yield float(first.time[k])
