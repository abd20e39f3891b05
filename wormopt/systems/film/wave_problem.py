"""The best wave of a film of magnetic fluid as an optimal-control problem over its phase.

The phase xi takes the role of time. Eq. 29 of Zimmermann et al. 2007 integrates to W h'' + B = m,
m' = -3 (h + C) / h³, with B = (mu - 1) H² / (8 pi). Thickness h, its slope and m are states, B is
the input, and C is a constant that is optimised along with the wave. This module also computes
bounds for all waves within limits of thickness and field: the supremum of the flow, and the best
cosine wave. The range of a field, from least to largest, does not depend on H0.

A wave with n equal crests corresponds to one with a single crest in a film with n³ times the
tension and n times the field: with h(xi) = g(n xi), the field of h is n times that of g. So only
single crests are optimised.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError
from wormopt.model.model import Model, Signal
from wormopt.model.values import numbers
from wormopt.numerics.roots import root
from wormopt.ocp.motion import Guess
from wormopt.ocp.problem import Constraint, Ends, Problem, ramped
from wormopt.systems.film.cosine import CosineWave
from wormopt.systems.film.lubrication import field_slope
from wormopt.systems.film.shapes import FourierWave, grid

Seek = Literal["mean_flow", "margin", "drift", "field"]
"""Quantity that is maximised, or minimised for the field."""

TURN = 2 * math.pi
"""Phase of a wavelength."""
# Initial factor on the field of a cosine wave, for a wave that must hold a float or have a given
# flow.
_AMPLE = 1.5
# The thickness of a low wave is scaled by this many amplitudes of a cosine wave close to it: in
# units of the mean, the errors allowed would be as large as the wave.
_TALL = 3.0
# Distance of an initial cosine wave from its limits.
_INSIDE = 0.98
_NODES = 4096
# Shares of the largest amplitude between which the cosine wave is searched for. Below the least,
# its field counts as proportional to the amplitude; the true field grows faster, so limits still
# hold.
_LEAST, _TOP = 1e-7, 1 - 1e-12


def check_thickness(thickness: tuple[float, float]) -> tuple[float, float]:
    """Return bounds (least, largest) of h; raises ArgumentError unless 0 < least < 1 < largest."""
    found = numbers("thickness", thickness).ravel()
    if found.size != 2 or not (0 < found[0] < 1 < found[1] < math.inf):
        raise ArgumentError(
            f"thickness must be [least, largest] with 0 < least < 1 < largest, not {thickness!r}: "
            "the mean thickness is 1"
        )
    return float(found[0]), float(found[1])


def largest_flow(thickness: tuple[float, float]) -> float:
    """Least upper bound of the mean flow 1 + C of all waves with a ≤ h ≤ b, at any field.

    A square wave is best: the lower convex envelope of h^-2 + c h^-3 is a chord. Its C is -(s b^-2
    + (1 - s) a^-2) / (s b^-3 + (1 - s) a^-3), where s = (1 - a) / (b - a) is the share of b.
    """
    a, b = check_thickness(thickness)
    thick = (1 - a) / (b - a)
    share = np.array([1 - thick, thick])
    h = np.array([a, b])
    return float(1 - (share @ h**-2) / (share @ h**-3))


def field_needs(delta: float, tension: float) -> tuple[float, float]:
    """Range and steepest slope of (mu - 1) H² / (8 pi) of a cosine wave."""
    wave, xi = CosineWave(delta), grid(_NODES)
    D = wave.field_function(xi, tension)
    h, third = wave.height(xi), wave.height(xi, 3)
    slope = field_slope(h, third, wave.constant, tension)
    return highest(D) + highest(-D), max(highest(slope), highest(-slope))


def fitting_cosine(
    tension: float, thickness: tuple[float, float], field: float, gradient: float = math.inf
) -> float:
    """Amplitude of the largest cosine wave within limits of thickness, field range and slope.

    Field and slope increase with the amplitude, so the root is unique; they are linear at small
    amplitudes.
    """
    a, b = check_thickness(thickness)
    if not (field > 0 and gradient > 0):
        raise ArgumentError(
            f"field and gradient must be above 0, not {field!r} and {gradient!r}: every wave needs "
            "both"
        )

    def excess(delta: float) -> float:
        needed, steep = field_needs(delta, tension)
        return max(needed / field, steep / gradient) - 1

    top = min(1 - a, b - 1) * _TOP
    if excess(top) <= 0:
        return top
    least = _LEAST * top
    over = excess(least)
    if over >= 0:
        return least / (1 + over)
    return root(excess, least, top, xtol=1e-10 * least)


def carrying_cosine(mean_flow: float) -> float:
    """Amplitude of the cosine wave with a mean flow from 0 to 1."""
    return math.sqrt(2 * mean_flow / (3 - mean_flow))


def highest(values: np.ndarray) -> float:
    """Maximum of a smooth periodic function, by a parabola through the three largest values."""
    k = int(np.argmax(values))
    left, middle, right = values[k - 1], values[k], values[(k + 1) % len(values)]
    bend = left - 2 * middle + right
    return float(middle - (right - left) ** 2 / (8 * bend) if bend < 0 else middle)


@dataclass(frozen=True)
class WaveLimits:
    """Limits of a wave.

    Parameters
    ----------
    tension : float
        Surface tension W, positive.
    thickness : tuple of float
        Least and largest thickness over the mean thickness 1.
    field : float, optional
        Upper limit of the range of (mu - 1) H² / (8 pi), in units of P. Without it the range is
        minimised.
    gradient : float, optional
        Upper limit of the slope of that field over the phase; without it the field may jump.

    Raises
    ------
    ArgumentError
        If a value is not positive, or the mean 1 is not between the thicknesses.

    Examples
    --------
    >>> WaveLimits(0.1, (0.5, 1.5), 4.0).single(2)
    WaveLimits(tension=0.8, thickness=(0.5, 1.5), field=8.0, gradient=None)
    """

    tension: float
    thickness: tuple[float, float]
    field: float | None = None
    gradient: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "thickness", check_thickness(self.thickness))
        for name in ("tension", "field", "gradient"):
            value = getattr(self, name)
            if value is None and name != "tension":
                continue
            found = numbers(name, value)
            if found.size != 1 or not 0 < found.item() < math.inf:
                raise ArgumentError(f"{name} must be a number above 0, not {value!r}")

    def single(self, crests: int) -> WaveLimits:
        """Limits of a single crest that are equivalent to these limits for several equal crests.

        Parameters
        ----------
        crests : int
            Crests in 2 pi.

        Returns
        -------
        WaveLimits
            Limits in the scales of the single crest.
        """
        field = None if self.field is None else crests * self.field
        return WaveLimits(self.tension * crests**3, self.thickness, field, self.gradient)

    def cosine(self) -> float:
        """Amplitude of the largest cosine wave within these limits, including that of the field."""
        assert self.field is not None
        gradient = math.inf if self.gradient is None else self.gradient
        return fitting_cosine(self.tension, self.thickness, self.field, gradient)


@dataclass(frozen=True)
class WaveAim:
    """Objective of a wave.

    Parameters
    ----------
    seek : {"mean_flow", "margin", "drift", "field"}
        "mean_flow": the largest mean flow. "margin": the largest thickness + 3 C at a crest, which
        is not negative where a small float is held. "drift": the largest drift of a free float.
        "field": the smallest range of the field.
    mean_flow : float, optional
        With "field": lower limit of the mean flow.
    capture : bool, optional
        With "field": whether the wave must hold a small float.
    margin : float, optional
        With "drift": a negative margin that no wave within the limits exceeds.

    Raises
    ------
    ArgumentError
        If a flow is not between 0 and 1, a margin is not negative, or a wave of the least field has
        no requirement.

    Examples
    --------
    >>> WaveAim("field", mean_flow=0.2)
    WaveAim(seek='field', mean_flow=0.2, capture=False, margin=None)
    """

    seek: Seek = "mean_flow"
    mean_flow: float | None = None
    capture: bool = False
    margin: float | None = None

    def __post_init__(self) -> None:
        if self.seek == "field" and self.mean_flow is None and not self.capture:
            raise ArgumentError("the least field makes no wave; write a mean_flow, or capture")
        if self.mean_flow is not None and not 0 < self.mean_flow < 1:
            raise ArgumentError(f"mean_flow must be above 0 and below 1, not {self.mean_flow!r}")
        if (self.seek == "drift") != (self.margin is not None and self.margin < 0):
            raise ArgumentError(
                'margin belongs to seek = "drift", and must be below 0; write margin with "drift" '
                "only"
            )

    @property
    def on_crest(self) -> bool:
        """Whether the objective refers to the crest, where the wave then starts."""
        return self.seek == "margin" or self.capture

    def out_of_reach(self, thickness: tuple[float, float]) -> str | None:
        """Message if no wave between two thicknesses meets the requirements, at any field.

        Parameters
        ----------
        thickness : tuple of float
            Least and largest thickness over the mean.

        Returns
        -------
        str or None
            The reason and what to change; None if no bound excludes the objective.

        Examples
        --------
        >>> WaveAim("field", mean_flow=0.3).out_of_reach((0.5, 1.5))
        >>> WaveAim("field", capture=True).out_of_reach((0.9, 1.1))[:37]
        'no wave between these thicknesses hol'
        """
        most = largest_flow(thickness)
        if self.mean_flow is not None and self.mean_flow >= most:
            return (
                f"no wave between these thicknesses has a mean flow above {most:.6g}, at "
                "any field; require less, or allow a larger or a smaller thickness"
            )
        if self.capture and most <= 1 - thickness[1] / 3:
            return (
                "no wave between these thicknesses holds a float, at any field: its flow "
                f"must be {1 - thickness[1] / 3:.6g} but is below {most:.6g}; allow a "
                "larger or a smaller thickness"
            )
        return None


def wave_problem(limits: WaveLimits, aim: WaveAim) -> Problem:
    """State the optimal-control problem of the wave over the phase, from 0 to 2 pi.

    It starts at an upward crossing of the mean, or at a crest. States: thickness, slope, pressure
    m; input ``field``, B over ``field_range``, 0 to 1. With a gradient limit, B is a state and its
    slope ``field_rate`` the input.
    """
    if (limits.field is None) != (aim.seek == "field"):
        raise ArgumentError(
            'limits need a field unless seek = "field", which minimises it; write field, or leave '
            "it out"
        )
    delta, size = nearby_cosine(limits, aim)
    flow = ca.SX.sym("mean_flow")
    strength = ca.SX.sym("field_range") if limits.field is None else ca.SX(limits.field)
    swing = min(1.0, _TALL * delta)
    model = _film(limits, flow, strength, size, swing)
    h, constant = model.x[0].symbol, flow - 1
    slower = -3 * constant - h
    drift = aim.seek == "drift"
    ends = Ends.of(model, 2 if drift else 1)
    sought = {
        "mean_flow": flow,
        "margin": ends.start[0] + 3 * constant,
        "drift": 1 - ends.duration / ends.integrals[1] if drift else 0,
        "field": -strength / size,
    }[aim.seek]
    design = [Signal("mean_flow", flow, nominal=CosineWave(delta).mean_flow, lower=0.0, upper=1.0)]
    along = []
    if limits.field is None:
        design.append(Signal("field_range", strength, nominal=size, lower=0.0))
        if limits.gradient is not None:
            room = strength - model.x[3].symbol
            along.append(Constraint("limits.field", room, 0.0, nominal=size))
    if aim.margin is not None:
        along.append(Constraint("margin", slower, -aim.margin / 2))
    return Problem(
        model=model,
        ends=ends,
        minimise=-sought,
        duration=(TURN, TURN),
        periodic=[signal.name for signal in model.x],
        integrands=ca.vertcat(h, 2 * h / slower) if drift else h,
        path_constraints=along,
        boundary_constraints=[*_at_ends(model, ends, aim, constant, swing)],
        design=design,
    )


def _film(limits: WaveLimits, flow: ca.SX, strength: ca.SX, size: float, swing: float) -> Model:
    """Eq. 29 over the phase, with the field as its input, or as a state if its slope is limited."""
    h, slope, m, field = (ca.SX.sym(name) for name in ("thickness", "slope", "pressure", "field"))
    least, most = limits.thickness
    steep = math.sqrt(size * min(most - least, swing) / limits.tension)
    states = [
        Signal("thickness", h, nominal=swing, lower=least, upper=most),
        Signal("slope", slope, nominal=steep),
        Signal("pressure", m, nominal=size),
    ]
    rising = limits.gradient is not None
    B = field if rising else strength * field
    most_field = 1.0 if not rising else limits.field or math.inf
    given = Signal("field", field, nominal=size if rising else 1.0, lower=0.0, upper=most_field)
    ode = ca.vertcat(slope, (m - B) / limits.tension, -3 * (h + flow - 1) / h**3)
    known = [Signal(s.name(), s, "1") for s in (flow, strength) if s.is_symbolic()]
    plain = Model("film under a wave", x=states, ode=ode, u=[given], p=known)
    return plain if limits.gradient is None else ramped(plain, limits.gradient)


def _at_ends(
    model: Model, ends: Ends, aim: WaveAim, constant: ca.SX, swing: float
) -> Iterator[Constraint]:
    # the flow, which an error of the volume adds to, is of the second order in the swing
    yield Constraint("volume", ends.integrals[0], TURN, TURN, TURN * swing**2)
    steep = model.x[1].nominal
    if aim.on_crest:
        yield Constraint("phase", ends.start[1], 0.0, 0.0, steep)
        yield Constraint("crest", ends.start[0], lower=1.0, nominal=swing)
    else:
        yield Constraint("phase", ends.start[0], 1.0, 1.0, swing)
        yield Constraint("front", ends.start[1], lower=0.0, nominal=steep)
    if aim.capture:
        yield Constraint("objective.capture", ends.start[0] + 3 * constant, lower=0.0)
    if aim.mean_flow is not None:
        flow, least = 1 + constant, aim.mean_flow
        yield Constraint("objective.mean_flow", flow, lower=least, nominal=least)


def nearby_cosine(limits: WaveLimits, aim: WaveAim) -> tuple[float, float]:
    """Amplitude of a cosine wave close to the objective, and a range of the field."""
    if limits.field is not None:
        return _INSIDE * limits.cosine(), limits.field
    a, b = limits.thickness
    flow = max(aim.mean_flow or 0.0, 1 - b / 3 if aim.capture else 0.0)
    delta = min(carrying_cosine(flow), _INSIDE * min(1 - a, b - 1))
    return delta, _AMPLE * field_needs(delta, limits.tension)[0]


def wave_guess(limits: WaveLimits, aim: WaveAim, second: int = 1) -> Guess:
    """First guess: the largest cosine wave within the limits, or one close to the requirements.

    `second`: harmonic of half the amplitude, for unequal crests; 1 for the cosine alone.
    """
    delta, size = nearby_cosine(limits, aim)
    harmonics = np.zeros(second)
    harmonics[0] += delta / 2
    harmonics[-1] += delta / 2
    wave, tension = FourierWave(harmonics.tolist()), limits.tension
    top = wave.peak(tension).value
    back = 0.0 if aim.on_crest else _rise(wave)

    def field(t: np.ndarray) -> np.ndarray:
        return top - np.asarray(wave.field_function(t + back, tension))

    def states(t: np.ndarray) -> np.ndarray:
        xi = t + back
        m = field(t) + tension * np.asarray(wave.height(xi, 2))
        rows = [wave.height(xi), wave.height(xi, 1), m]
        return np.vstack([*rows, field(t)] if limits.gradient is not None else rows)

    def rate(t: np.ndarray) -> np.ndarray:
        xi = t + back
        h, third = np.asarray(wave.height(xi)), np.asarray(wave.height(xi, 3))
        return np.asarray(field_slope(h, third, wave.constant, tension))[None]

    def share(t: np.ndarray) -> np.ndarray:
        return field(t)[None] / size

    return Guess(TURN, states, rate if limits.gradient is not None else share)


def _rise(wave: FourierWave) -> float:
    """Phase at which a wave with a crest at 0 crosses the mean before its crest."""
    xi = np.linspace(-TURN / 2, 0.0, 2049)
    below = np.flatnonzero(np.asarray(wave.height(xi)) <= 1)[-1]
    low, high = xi[below : below + 2].tolist()
    return root(lambda at: wave.height(at) - 1, low, high, xtol=1e-14)
