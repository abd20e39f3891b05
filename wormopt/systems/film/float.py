"""Floats on the surface of a film with a travelling wave, and tracers in the fluid.

A float is thin and light: it does not change the film, bends with its surface, and moves with the
mean velocity of the surface below it, as viscous drag alone requires. A tracer is a point of the
fluid. This module has Models of both, and their mean velocities after a long time. Lengths along
the film are in units of 1/k, times in units of 1/omega (eq. 25 of Zimmermann et al. 2007).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError
from wormopt.model.model import TINY, Model, Output, Signal, Switch
from wormopt.model.values import numbers
from wormopt.numerics.roots import root
from wormopt.systems.film.cosine import CosineWave
from wormopt.systems.film.lubrication import (
    Expression,
    library_of,
    stream_function,
    surface_velocity,
    velocities,
)
from wormopt.systems.film.next_order import (
    Corrected,
    check_eps,
    flow_terms,
    surface_correction,
    within_reach,
)
from wormopt.systems.film.shapes import Wave, grid
from wormopt.systems.film.tables import CAPTURE_DELTA

# Sums over a period are refined until they agree to this share.
_AGREED, _LEAST, _MOST = 1e-14, 256, 1 << 20
_CORRECTED = 1e-9  # as `_AGREED`, for corrected velocities
_ROUND_OFF = 1e-15
_LARGEST_BELOW_1 = math.nextafter(1.0, 0.0)


@dataclass(frozen=True)
class Drift:
    """Mean motion in a wave after a long time."""

    velocity: float  # mean, over the wave's; 1 if captured
    # time to be overtaken by a wavelength, or to overtake one, in 1 / omega; infinite if captured
    turn: float
    rests: tuple[float, ...] = ()  # phases xi, 0 to 2 pi, at which it is held

    @property
    def captured(self) -> bool:
        """Whether the wave holds the float or tracer."""
        return math.isinf(self.turn)


def body_velocity(wave: Wave, xi: Expression, length: float = 0.0) -> Expression:
    """Mean surface velocity 3/2 (1 + C mean(1/h)) under a float, which is the float's velocity.

    `xi`: phase t - x of its middle; `length` 0: a small float.
    """
    if not length:
        return surface_velocity(wave.height(xi), wave.constant)
    return 1.5 * (1 + wave.constant * wave.inverse(xi, length))


def cosine_drift(delta: Expression) -> Expression:
    """Mean velocity 1 - 2 pi / T_L of a small float on a cosine wave, 1 at `CAPTURE_DELTA`.

    T_L = int d xi / (1 - u_s) = 4 pi (6 y / S - 1), y² = 1 - delta², S² = (4 - delta²)² -
    36 delta²; without cancellation: 3 delta² (28 - delta²) / (2 (4 y + S) (6 y - S)).
    """
    square, library = delta * delta, library_of(delta)
    y = library.sqrt(1 - square)
    S = library.sqrt((4 - square - 6 * delta) * (4 - square + 6 * delta))
    return 3 * square * (28 - square) / (2 * (4 * y + S) * (6 * y - S))


@lru_cache(maxsize=256)
def capture_delta(length: float = 0.0) -> float:
    """Least amplitude at which a cosine wave holds a float of a length below 2 pi.

    The float is fastest on a crest, and held at C mean(1/h) = -1/3; a small one at delta² + 6 delta
    = 4.
    """
    length = checked_lengths(length).item()
    if not length:
        return CAPTURE_DELTA
    return root(lambda delta: 1 - body_velocity(CosineWave(delta), 0.0, length), 0.5, 0.9)


def float_drift(wave: Wave, length: float = 0.0) -> Drift:
    """Mean drift of a float in a wave after a long time.

    Parameters
    ----------
    wave : CosineWave or FourierWave
        Shape of the surface.
    length : float, optional
        Length of the float in units of 1/k, below 2 pi; 0: a small float.

    Returns
    -------
    Drift
        ``velocity`` over the wave speed (1 if held), ``turn``, the time in 1/omega in which the
        wave overtakes it (or it the wave) by a wavelength, and ``rests``, the phases in rad at
        which it is held. In closed form for a small float on a cosine wave, otherwise by
        quadrature.

    Raises
    ------
    ArgumentError
        If the length is out of range, or the wave nearly holds the float, so quadrature does not
        converge.

    Examples
    --------
    >>> float_drift(CosineWave(0.5)).velocity == cosine_drift(0.5)
    True
    >>> held = float_drift(CosineWave(0.7))
    >>> held.velocity, [round(phase, 6) for phase in held.rests]
    (1.0, [5.04554])
    """
    length = checked_lengths(length).item()
    rests = _rests(wave, length)
    if rests:
        return Drift(1.0, math.inf, rests)
    if isinstance(wave, CosineWave) and not length:
        velocity = cosine_drift(wave.delta)
        if not velocity < 1:  # below the amplitude of capture by less than round-off
            return Drift(1.0, math.inf, (0.0,))
        return Drift(velocity, 2 * math.pi / (1 - velocity))
    turn = _turn(lambda xi: 1 / (1 - body_velocity(wave, xi, length)))
    return Drift(1 - 2 * math.pi / turn, abs(turn))  # below 0 if it overtakes the wave


def corrected_drift(wave: Wave, eps: float, length: float = 0.0) -> Corrected:
    """Drift of a float with the surface velocity corrected to the next order in eps².

    Parameters
    ----------
    wave : CosineWave or FourierWave
        Shape of the surface.
    eps : float
        Mean thickness times wave number, 0 or above.
    length : float, optional
        Length of the float in units of 1/k, below 2 pi; 0: a small float.

    Returns
    -------
    Corrected
        ``value``, the drift over the wave speed, 1 if the wave holds the float, and ``bar``, the
        larger change of the drift without the correction and with twice the correction. ``bar`` is
        None as in `corrected_flow`.

    Raises
    ------
    ArgumentError
        If eps or the length is not a number or out of range.

    Examples
    --------
    >>> found = corrected_drift(CosineWave(0.5), 0.4)
    >>> round(found.value, 5), round(found.bar, 5)  # in two dimensions 0.64561
    (0.64726, 0.02923)
    >>> corrected_drift(CosineWave(0.6), 0.5).value  # held; lubrication alone holds from 0.6056 on
    1.0
    """
    square, length = check_eps(eps) ** 2, checked_lengths(length).item()
    without, value, twice = (_drift_with(wave, k * square, length) for k in (0, 1, 2))
    bar = max(abs(without - value), abs(twice - value))
    return Corrected(value, bar if within_reach(wave, eps) else None)


def _drift_with(wave: Wave, square: float, length: float) -> float:
    """Drift with the correction of the surface velocity multiplied by `square`."""
    change = sum(flow_terms(wave))

    def velocity(xi: np.ndarray) -> np.ndarray:
        h, slope, bend = (wave.height(xi, order) for order in range(3))
        more = surface_correction(h, slope, bend, wave.constant, change)
        if length:  # mean over the float
            smooth = np.sinc(np.arange(len(xi) // 2 + 1) * length / (2 * np.pi))
            more = np.fft.irfft(smooth * np.fft.rfft(more), len(xi))
        return body_velocity(wave, xi, length) + square * more

    nodes = 4096 if isinstance(wave, CosineWave) else 4 * wave.nodes
    if np.max(velocity(grid(nodes))) >= 1:
        return 1.0
    try:
        return 1 - 2 * math.pi / _turn(lambda xi: 1 / (1 - velocity(xi)), _CORRECTED)
    except ArgumentError:  # nearly held
        return 1.0


def _rests(wave: Wave, length: float) -> tuple[float, ...]:
    """Phases at which a float is as fast as the wave, and faster behind them."""
    if isinstance(wave, CosineWave) and not length:
        if wave.delta <= CAPTURE_DELTA:
            return (0.0,) if wave.delta == CAPTURE_DELTA else ()
        return (2 * math.pi - math.acos(-(1 + 3 * wave.constant) / wave.delta),)
    nodes = 512 if isinstance(wave, CosineWave) else 4 * wave.nodes
    xi = np.append(grid(nodes), 2 * np.pi)

    def lag(at: Any) -> Any:
        return 1 - body_velocity(wave, at, length)

    values = lag(xi)
    falls = np.flatnonzero((values[:-1] > 0) & (values[1:] <= 0))
    return tuple(root(lag, xi[k], xi[k + 1]) for k in falls)


def tracer_drift(wave: Wave, height: float, position: float = 0.0) -> Drift:
    """Mean drift of a tracer in a wave, by quadrature along its streamline.

    In the frame of the wave, the streamline passes through the wavelength, or closes under a crest
    (captured). Captured tracers circulate and have no rests. Raises ArgumentError outside the film
    or if quadrature fails.
    """
    (z,) = _heights(wave, np.array([position]), np.array([height]))
    level = stream_function(z, wave.height(-position), wave.constant)

    def per_phase(xi: np.ndarray) -> np.ndarray:
        h, slope = wave.height(xi), wave.height(xi, 1)
        u, _ = velocities(_on_level(h, wave.constant, level), h, slope, wave.constant)
        return 1 / (1 - u)

    reached = _on_level(wave.height(grid(4 * _LEAST)), wave.constant, level)
    faster = z > _slower_below(np.array([wave.height(-position)]), wave.constant)[0]
    if faster or np.isnan(reached).any():
        return Drift(1.0, math.inf)
    turn = _turn(per_phase)
    return Drift(1 - 2 * math.pi / turn, abs(turn))  # below 0 if it overtakes the wave


def _slower_below(h: np.ndarray, constant: float) -> np.ndarray:
    """Height up to which the fluid is slower than the wave, at most the surface."""
    # u = F z (z / 2 - h) = 1
    flow = h + constant
    fast = 3 * flow > 2 * h
    room = np.where(fast, 1 - 2 * h / (3 * np.where(fast, flow, 1.0)), 0.0)
    return h * (1 - np.sqrt(room))


def _on_level(h: np.ndarray, constant: float, level: float) -> np.ndarray:
    """Least height at which the stream function reaches a level, NaN if there is none."""
    low, high = np.zeros_like(h), _slower_below(h, constant)
    reached = stream_function(high, h, constant) <= level + _ROUND_OFF
    for _ in range(60):
        middle = (low + high) / 2
        above = stream_function(middle, h, constant) > level
        low, high = np.where(above, middle, low), np.where(above, high, middle)
    return np.where(reached, (low + high) / 2, np.nan)


def _turn(per_phase: Callable[[np.ndarray], np.ndarray], agreed: float = _AGREED) -> float:
    """Integral over a period by sums that are refined until they agree to a share."""
    nodes, before = _LEAST, math.nan
    while nodes <= _MOST:
        value = 2 * math.pi * float(np.mean(per_phase(grid(nodes))))
        if abs(value - before) <= agreed * abs(value):
            return value
        nodes, before = 2 * nodes, value
    raise ArgumentError(
        "the wave nearly holds this body, so quadrature cannot find the time in which it overtakes "
        "it; use another amplitude"
    )


def floating(wave: Wave, *, length: ArrayLike = 0.0, position: ArrayLike = 0.0) -> Model:
    """Build the model of floats: x' = mean surface velocity under each float.

    Parameters
    ----------
    wave : CosineWave or FourierWave
        Shape of the surface.
    length : float or array_like, shape (n,), optional
        Lengths of the floats in units of 1/k, below 2 pi; 0: small floats.
    position : float or array_like, shape (n,), optional
        Initial positions of their middles in units of 1/k.

    Returns
    -------
    Model
        State ``position`` (n,); outputs ``phase`` t - x and ``velocity``. The switch "float i
        overtaken" marks the times at which a trough of the cosine wave, phase pi, passes float i.
        The parameter ``amplitude`` of a CosineWave can be changed without a new compilation.

    Raises
    ------
    ArgumentError
        If lengths or positions are not numbers, out of range, or of different counts.

    Examples
    --------
    >>> model = floating(CosineWave(0.5), length=[0.0, 1.0])
    >>> model.n_x, [switch.name for switch in model.switches]
    (2, ['float 0 overtaken', 'float 1 overtaken'])
    """
    lengths, places = _alike(checked_lengths(length), finite("position", position))
    symbolic, parameters = _lifted(wave)
    t, x = ca.SX.sym("t"), ca.SX.sym("x", len(places))
    xi = t - x
    velocity = ca.vertcat(
        *(body_velocity(symbolic, xi[i], float(each)) for i, each in enumerate(lengths))
    )
    return Model(
        "floats on a film",
        x=[Signal("position", x, "length", value=tuple(places))],
        ode=velocity,
        p=parameters,
        t=t,
        outputs=[Output("phase", xi, "angle"), Output("velocity", velocity, "speed")],
        switches=overtaken("float", xi, x),
    )


def tracers(wave: Wave, *, height: ArrayLike, position: ArrayLike = 0.0) -> Model:
    """Build the model of tracers in the fluid: x' = u, z' = w for each tracer.

    Parameters
    ----------
    wave : CosineWave or FourierWave
        Shape of the surface.
    height : float or array_like, shape (n,)
        Initial heights over the ground, over the mean thickness, from 0 to the surface.
    position : float or array_like, shape (n,), optional
        Initial positions in units of 1/k.

    Returns
    -------
    Model
        States ``position`` and ``height``, (n,) each; outputs ``phase``, ``depth`` below the
        surface and ``stream``, the stream function, which is constant. Switches and parameter as
        for `floating`.

    Raises
    ------
    ArgumentError
        If a height is outside the film, or as `floating`.

    Examples
    --------
    >>> model = tracers(CosineWave(0.5), height=[0.5, 1.5])
    >>> [signal.name for signal in model.x]
    ['position', 'height']
    """
    heights, places = _alike(finite("height", height), finite("position", position))
    heights = _heights(wave, places, heights)
    symbolic, parameters = _lifted(wave)
    count = len(places)
    t, x, z = ca.SX.sym("t"), ca.SX.sym("x", count), ca.SX.sym("z", count)
    xi, C = t - x, symbolic.constant
    h = symbolic.height(xi)
    u, w = velocities(z, h, symbolic.height(xi, 1), C)
    states = ca.vertcat(x, z)
    return Model(
        "tracers in a film",
        x=[
            Signal("position", x, "length", value=tuple(places)),
            Signal("height", z, "length", value=tuple(heights)),
        ],
        ode=ca.vertcat(u, w),
        p=parameters,
        t=t,
        outputs=[
            Output("phase", xi, "angle"),
            Output("depth", h - z, "length"),
            Output("stream", stream_function(z, h, C), "length"),
        ],
        switches=overtaken("tracer", xi, states),
    )


def overtaken(what: str, xi: ca.SX, states: ca.SX) -> list[Switch]:
    """Switches without effect at the times when a trough of the cosine wave passes."""
    return [Switch(f"{what} {i} overtaken", -ca.sin(xi[i]), states) for i in range(xi.numel())]


def _lifted(wave: Wave) -> tuple[Any, Sequence[Signal]]:
    """The wave with its amplitude as a symbol, if it has an amplitude."""
    if not isinstance(wave, CosineWave):
        return wave, ()
    delta = ca.SX.sym("delta")
    amplitude = Signal(
        "amplitude", delta, "share", lower=TINY, upper=_LARGEST_BELOW_1, value=wave.delta
    )
    return CosineWave(delta), (amplitude,)


def _alike(*given: np.ndarray) -> tuple[np.ndarray, ...]:
    count = max(each.size for each in given)
    if any(each.size not in (1, count) for each in given):
        raise ArgumentError(
            f"arrays have different counts; write one number for all, or {count} of each"
        )
    return tuple(np.broadcast_to(each, count) for each in given)


def finite(name: str, given: ArrayLike) -> np.ndarray:
    """Array (n,) of `given`; raises ArgumentError unless it is a list of finite numbers."""
    found = numbers(name, given).ravel()
    if not found.size or not np.all(np.isfinite(found)):
        raise ArgumentError(f"{name} must be a finite number or a list of them, not {given!r}")
    return found


def checked_lengths(given: ArrayLike) -> np.ndarray:
    """Float lengths (n,); raises ArgumentError if one is negative or not below a wavelength."""
    found = finite("length", given)
    if not np.all((found >= 0) & (found < 2 * np.pi)):
        raise ArgumentError(
            f"the length of a float must be from 0 to below a wavelength, 2 pi, not {given!r}"
        )
    return found


def _heights(wave: Wave, places: np.ndarray, heights: np.ndarray) -> np.ndarray:
    """Heights (n,) within the film at time 0, with round-off above the surface clipped."""
    surface = np.asarray(wave.height(-places))
    above = (heights < 0) | (heights > surface * (1 + 1e-15))
    if above.any():
        k = int(np.argmax(above))
        raise ArgumentError(
            f"height {heights[k]:.6g} is outside the film, which extends from 0 to "
            f"{surface[k]:.6g} at the position {places[k]:g}"
        )
    return np.minimum(heights, surface)
