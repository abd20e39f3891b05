"""The best course of the field of a magneto-elastic pair, stated as an optimal-control problem."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError
from wormopt.model.gait import Gait
from wormopt.model.model import Model
from wormopt.ocp.motion import Motion
from wormopt.ocp.problem import Bound, Ends, Problem, ramped

# Fields by chance have so many harmonics and, as polylines, so many corners.
_HARMONICS, _CORNERS = 3, 96


@dataclass(frozen=True)
class FieldLimits:
    """What a waveform must keep to."""

    field: tuple[float, float]  # least and largest G
    frequency: tuple[float, float]  # least and largest angular frequency; alike where given
    slope: float | None = None  # largest |G'|; None: the field may jump
    strain: float | None = None  # largest |x_2 - x_1|

    def __post_init__(self) -> None:
        if not self.field[0] < self.field[1]:
            raise ArgumentError(f"field must be a range [least, largest], not {self.field}")
        if not 0 < self.frequency[0] <= self.frequency[1]:
            raise ArgumentError(f"frequency must be a positive range, not {self.frequency}")
        for name in ("slope", "strain"):
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise ArgumentError(f"{name} must be positive, not {value!r}")

    @property
    def period(self) -> tuple[float, float]:
        """Shortest and longest period."""
        return 2 * math.pi / self.frequency[1], 2 * math.pi / self.frequency[0]


@dataclass(frozen=True)
class FieldAim:
    """What a waveform is to be good at.

    Least work without a speed raises ArgumentError: a pair at rest takes none.
    """

    # mean speed; None: least work of the field per distance
    maximise: Literal["speed"] | None = "speed"
    speed: float | None = None  # least mean speed

    def __post_init__(self) -> None:
        if self.maximise is None and not (self.speed or 0.0) > 0:
            raise ArgumentError("the cheapest motion is rest; give the least speed, above 0")


def waveform_problem(pair: Model, limits: FieldLimits, aim: FieldAim) -> Problem:
    """State the periodic motion of a pair under the best field, with mass 1 at 0 at the start.

    Velocities return, positions up to the advance. Net work of the field: friction's loss.
    The phase is free; with a slope the field is a state and its rate the input.
    """
    plant = _limited(pair, limits)
    ends = Ends.of(plant, 1)
    advance = ends.end[0] - ends.start[0]
    speed = advance / ends.duration
    at_ends = [Bound("start", ends.start[0], 0.0, 0.0, plant.x[0].nominal)]
    if aim.speed is not None:
        at_ends.append(Bound("aim.speed", speed, aim.speed, nominal=plant.x[1].nominal))
    along = []
    if limits.strain is not None:
        stretch, most = plant.output("stretch"), limits.strain
        along.append(Bound("limits.strain", stretch, -most, most, nominal=most))
    least = (aim.speed or 0.0) / 2  # keeps the quotient finite on the way
    work = ends.integrals[0] / (ends.duration * ca.fmax(speed, least))
    return Problem(
        model=plant,
        ends=ends,
        minimise=-speed if aim.maximise else work,
        duration=limits.period,
        periodic=[signal.name for signal in plant.x if signal.name != "position"],
        displaced=["position"],
        integrands=plant.output("power"),
        along=along,
        at_ends=at_ends,
    )


def _limited(pair: Model, limits: FieldLimits) -> Model:
    """Pair whose field keeps to its limits, its slope included."""
    if [signal.name for signal in pair.u] != ["field"]:
        raise ArgumentError(f"{pair.name} has no input field; build it with cosines=None")
    least, most = limits.field
    size = max(abs(least), abs(most))
    field = replace(pair.u[0], lower=least, upper=most, nominal=size, value=(least + most) / 2)
    plant = replace(pair, u=[field])
    return plant if limits.slope is None else ramped(plant, limits.slope)


def field_course(motion: Motion) -> Gait:
    """The field over one period as piecewise polynomials of time, one row, for `drive`.

    A field with a slope is its rate integrated exactly, piece after piece.
    """
    course = motion.input_course()
    if motion.program.problem.model.u[0].name == "field":
        return course
    rates = course.polynomial[:, 0, :]
    rising = rates / np.arange(1, rates.shape[1] + 1)
    spans = np.diff(course.breaks)
    gained = np.sum(rising * spans[:, None] ** np.arange(1, rates.shape[1] + 1), axis=1)
    first = float(motion.state("field", np.zeros(1))[0, 0])
    levels = first + np.concatenate([[0.0], np.cumsum(gained)[:-1]])
    return Gait(course.breaks, np.column_stack([levels, rising])[:, None, :])


def chance_field(
    limits: tuple[float, float], frequency: float, random: np.random.Generator
) -> Gait:
    """Random periodic field of some harmonics, clipped to its range: a polyline in one row.

    `limits`: least and largest G; `frequency`: angular.
    """
    low, high = limits
    t = np.linspace(0, 2 * math.pi / frequency, _CORNERS + 1)
    wave = sum(
        random.normal() * np.cos(k * frequency * t - random.uniform(0, 2 * math.pi))
        for k in range(1, _HARMONICS + 1)
    )
    level = np.clip((low + high) / 2 + (high - low) / 2 * wave, low, high)
    slopes = np.diff(level) / np.diff(t)
    return Gait(t, np.column_stack([level[:-1], slopes])[:, None, :])


def first_harmonic(field: Gait) -> tuple[float, float]:
    """Amplitude g_1 and phase phi of a waveform's first harmonic, g_1 cos(2 pi t / T - phi)."""
    s, weights = np.polynomial.legendre.leggauss(24)
    total, turn = 0.0 + 0.0j, 2 * np.pi / field.period
    for piece, (begin, end) in enumerate(zip(field.breaks[:-1], field.breaks[1:], strict=True)):
        at = (end - begin) * (s + 1) / 2
        wave = np.exp(1j * turn * (begin + at))
        total += np.sum(weights * field.on_piece(piece, at)[0] * wave) * (end - begin) / 2
    found = 2 * total / field.period
    return float(abs(found)), float(np.angle(found))
