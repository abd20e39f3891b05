"""The best course of the field of a magneto-elastic pair, stated as an optimal-control problem."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError
from wormopt.model.gait import Gait
from wormopt.model.model import Model, Signal
from wormopt.ocp.motion import Motion
from wormopt.ocp.problem import Bound, Ends, Problem

__all__ = [
    "FieldAim",
    "FieldLimits",
    "chance_field",
    "field_course",
    "first_harmonic",
    "ramped",
    "waveform_problem",
]

# Fields by chance have so many harmonics and, as polylines, so many corners.
_HARMONICS, _CORNERS = 3, 96


@dataclass(frozen=True)
class FieldLimits:
    """What a waveform must keep to.

    Parameters
    ----------
    field : tuple of float
        Least and largest G.
    frequency : tuple of float
        Least and largest angular frequency, positive; alike where it is given.
    slope : float, optional
        Largest |G'|; without it the field may jump.
    strain : float, optional
        Largest |x_2 - x_1|.

    Raises
    ------
    ArgumentError
        If a range is empty, or a number not positive that must be.
    """

    field: tuple[float, float]
    frequency: tuple[float, float]
    slope: float | None = None
    strain: float | None = None

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

    Parameters
    ----------
    maximise : {"speed"}, optional
        The mean speed. Without it the work of the field per distance is minimised.
    speed : float, optional
        Least mean speed.

    Raises
    ------
    ArgumentError
        If the least work is sought without a speed: a pair at rest takes none.
    """

    maximise: Literal["speed"] | None = "speed"
    speed: float | None = None

    def __post_init__(self) -> None:
        if self.maximise is None and not (self.speed or 0.0) > 0:
            raise ArgumentError("the cheapest motion is rest; give the least speed, above 0")


def waveform_problem(pair: Model, limits: FieldLimits, aim: FieldAim) -> Problem:
    """State the periodic motion of a pair under the best field.

    Velocities return after a period, positions up to the advance. The work of the field is that
    which the pair takes in, less what it gives back: over a period, what friction takes. When the
    period begins is left open.

    Parameters
    ----------
    pair : Model
        From `magnetic_pair`, with the field as its input.
    limits : FieldLimits
        What the waveform must keep to.
    aim : FieldAim
        What it is to be good at.

    Returns
    -------
    Problem
        Mass 1 starts at 0. With a slope, the field is a state and its rate the input.

    Raises
    ------
    ArgumentError
        If the field is no input of the pair.

    Examples
    --------
    >>> from wormopt.model.friction import Coulomb
    >>> from wormopt.systems.pair.magnetic_pair import magnetic_pair
    >>> law = Coulomb(0.005, 0.01)
    >>> pair = magnetic_pair(law=law, push=0.01, frequency=1.42, cosines=None)
    >>> limits = FieldLimits((0.0, 2.0), (1.42, 1.42), slope=3.0)
    >>> problem = waveform_problem(pair, limits, FieldAim())
    >>> [signal.name for signal in problem.model.x], problem.model.u[0].name
    (['position', 'velocity', 'field'], 'field_rate')
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


def ramped(plant: Model, slope: float) -> Model:
    """Make the only input of a plant a state, and its rate the input.

    Parameters
    ----------
    plant : Model
        With one scalar input, of which the bounds become those of the state.
    slope : float
        Largest size of the rate, positive.

    Returns
    -------
    Model
        The state comes last; the input has the same name and ``_rate`` behind it.

    Raises
    ------
    ArgumentError
        If the plant has another number of inputs.

    Examples
    --------
    >>> v, u = ca.SX.sym("v"), ca.SX.sym("u")
    >>> cart = Model("cart", x=[Signal("speed", v)], ode=u, u=[Signal("push", u, upper=1.0)])
    >>> slow = ramped(cart, 3.0)
    >>> [signal.name for signal in slow.x], slow.u[0].name, slow.u[0].upper
    (['speed', 'push'], 'push_rate', 3.0)
    """
    if sum(signal.size for signal in plant.u) != 1:
        raise ArgumentError(f"{plant.name} has not one scalar input")
    (level,) = plant.u
    rate = ca.SX.sym(f"{level.name}_rate")
    steep = Signal(f"{level.name}_rate", rate, nominal=slope, lower=-slope, upper=slope, value=0.0)
    return replace(plant, x=[*plant.x, level], ode=ca.vertcat(plant.ode, rate), u=[steep])


def field_course(motion: Motion) -> Gait:
    """Give the field over one period as piecewise polynomials of time.

    Parameters
    ----------
    motion : Motion
        Of a problem from `waveform_problem`.

    Returns
    -------
    Gait
        One row, by which `drive` moves the pair. A field with a slope is its rate integrated
        exactly, piece after piece.
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
    """Make a periodic field of some harmonics by chance, cut off where it leaves its range.

    Parameters
    ----------
    limits : (float, float)
        Least and largest G.
    frequency : float
        Angular frequency.
    random : Generator
        Where chance comes from.

    Returns
    -------
    Gait
        One row, a polyline over a period.

    Examples
    --------
    >>> field = chance_field((0.5, 2.0), 1.4, np.random.default_rng(1))
    >>> values = field(np.linspace(0, field.period, 50))
    >>> bool(values.min() >= 0.5 and values.max() <= 2.0)
    True
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
    """Amplitude and phase of the first harmonic of a waveform.

    Parameters
    ----------
    field : Gait
        One row.

    Returns
    -------
    amplitude, phase : float
        g_1 and phi: the field has the part g_1 cos(2 pi t / T - phi).

    Examples
    --------
    A field that is 2 for one half of the period and 0 for the other has 4 / pi:

    >>> square = Gait(np.array([0.0, 1.0, 2.0]), np.array([[[2.0]], [[0.0]]]))
    >>> amplitude, phase = first_harmonic(square)
    >>> round(amplitude * math.pi, 12), round(phase / math.pi, 12)
    (4.0, 0.5)
    """
    s, weights = np.polynomial.legendre.leggauss(24)
    total, turn = 0.0 + 0.0j, 2 * np.pi / field.period
    for piece, (begin, end) in enumerate(zip(field.breaks[:-1], field.breaks[1:], strict=True)):
        at = (end - begin) * (s + 1) / 2
        wave = np.exp(1j * turn * (begin + at))
        total += np.sum(weights * field.on_piece(piece, at)[0] * wave) * (end - begin) / 2
    found = 2 * total / field.period
    return float(abs(found)), float(np.angle(found))
