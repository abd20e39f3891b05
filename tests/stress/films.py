"""Films of magnetic fluid: waves, their flow and field, what they carry, films under given fields.

Judged by quadrature over the eccentric anomaly, which takes the peaks out of cosine waves, by
Gauss' rule, by the order eps² of slow flow solved anew, by paths of the fluid, by derivatives of
Fourier series.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from itertools import pairwise

import casadi as ca
import numpy as np
from scipy.integrate import quad, solve_ivp

from tests.stress.carried import CARRIED
from tests.stress.means import least, refused, zero
from tests.stress.verdict import Case, Dice, Judged, Undecided, apart, many, spread
from wormopt.model.model import pack
from wormopt.systems.film.cosine import CosineWave
from wormopt.systems.film.float import CAPTURE_DELTA, float_drift, tracer_drift
from wormopt.systems.film.given_field import film_volume, thin_film
from wormopt.systems.film.next_order import corrected_flow, surface_correction
from wormopt.systems.film.shapes import FourierWave
from wormopt.systems.film.units import Fluid
from wormopt.systems.film.wave_problem import fitting_cosine, largest_flow

_TURN = 2 * math.pi
_GAUSS = np.polynomial.legendre.leggauss(20)


def cases(*, quick: bool) -> Iterable[Case]:
    """List the cases of films."""
    kinds = (
        ("waves of films", _cosine, 25),
        ("shapes of films", _fourier, 15),
        ("field of films", _peak, 15),
        ("next order of films", _next_order, 15),
        ("floats on films", _floats, 20),
        ("tracers in films", _tracers, 10),
        ("films in fields", _given_field, 15),
        ("scales of films", _scales, 5),
        ("limits of films", _limits, 10),
        *CARRIED,
        ("no films", _no_film, 5),
    )
    return many(kinds, quick=quick, span=0.1)


# -- cosine waves ----------------------------------------------------------------------------------


def _amplitude(dice: Dice) -> float:
    """Small, usual, or near 1, one as often as the other."""
    kind = dice.integers(3)
    if kind == 1:
        return float(dice.uniform(0.05, 0.95))
    return spread(dice, 1e-6, 0.1) if kind == 0 else 1 - spread(dice, 1e-7, 0.1)


def _tension(dice: Dice) -> float:
    return 0.0 if dice.random() < 0.3 else spread(dice, 1e-9, 1e3)


def _phase(delta: float, anomaly: float | np.ndarray) -> float | np.ndarray:
    """Phase of an eccentric anomaly, at which h = (1 - delta²) / (1 - delta cos E)."""
    wide = math.sqrt((1 + delta) / (1 - delta))
    return 2 * np.arctan(wide * np.tan(np.asarray(anomaly) / 2))


def _cosine_flow(delta: float) -> float:
    """1 + C = int (1 - h) h^-3 ... over int h^-3, free of cancellation and of peaks."""
    c = np.cos(_TURN * (np.arange(32) + 0.5) / 32)
    near = 1 - delta * c
    return float(-delta * np.sum(near * (c - delta)) / np.sum(near**2))


def _slope_by_anomaly(delta: float, anomaly: np.ndarray) -> np.ndarray:
    """Derivative of the pressure by the eccentric anomaly, 3 (h + C) h^-3 d xi / d E."""
    c = np.cos(anomaly)
    near, rest = 1 - delta * c, (1 - delta) * (1 + delta)
    above = delta * (c - delta) + _cosine_flow(delta) * near  # (h - 1 + 1 + C) times near
    return 3 * above * near * rest**-2.5


def _cosine_field(delta: float, tension: float, anomaly: float) -> float:
    """Field function at an eccentric anomaly; odd but for the surface's tension, so of mean 0."""
    nodes, weights = _GAUSS  # exact to rounding for a trigonometric polynomial of degree 2
    pressure = anomaly / 2 * weights @ _slope_by_anomaly(delta, anomaly / 2 * (1 + nodes))
    c = math.cos(anomaly)
    return float(pressure) - tension * delta * (c - delta) / (1 - delta * c)


def _rounding(delta: float) -> float:
    """What rounding of a phase does to a thickness near 1 - delta, and so to fields."""
    return 1e-11 + 2e-15 / (1 - delta)


def _cosine(dice: Dice) -> Judged:
    delta, tension = _amplitude(dice), _tension(dice)
    wave, flow = CosineWave(delta), _cosine_flow(delta)
    yield "mean flow", apart(wave.mean_flow, flow, 1e-12 + 1e-15 / delta)
    near = 1 - delta * np.cos(_TURN * (np.arange(32) + 0.5) / 32)
    constant = -(1 - delta) * (1 + delta) * np.mean(near) / np.mean(near**2)
    yield "constant", apart(wave.constant, constant, 1e-11)
    anomalies = dice.uniform(-3.1, 3.1, 3)
    known = [_cosine_field(delta, tension, E) for E in anomalies]
    found = [wave.field_function(float(_phase(delta, E)), tension) for E in anomalies]
    yield "field", apart(found, known, _rounding(delta))
    half = float(dice.uniform(0.05, 3.1))  # of a float on the crest
    narrow = math.sqrt((1 - delta) / (1 + delta))
    mean = 2 * math.atan(narrow * math.tan(half / 2)) / (narrow * (1 + delta) * half)
    yield "inverse", apart(wave.inverse(0.0, 2 * half), mean, 1e-10)


def _peak(dice: Dice) -> Judged:
    delta, tension = _amplitude(dice), _tension(dice)
    E = np.linspace(-math.pi, math.pi, 401)[1:-1]
    values = np.array([_cosine_field(delta, tension, e) for e in E])
    k = int(np.argmax(values))
    near = float(E[max(k - 1, 0)]), float(E[min(k + 1, len(E) - 1)])
    best = -least(lambda e: -_cosine_field(delta, tension, e), *near)[1]
    known = max(best, float(values[k]))
    peak = CosineWave(delta).peak(tension)
    yield "peak", apart(peak.value, known, 1e-9 + _rounding(delta))
    if delta < 0.97:
        yield "peak of the series", apart(FourierWave([delta]).peak(tension).value, known, 1e-9)


# -- any shape -------------------------------------------------------------------------------------


def _harmonics(dice: Dice, least: float) -> tuple[np.ndarray, np.ndarray]:
    """Cosines and sines of a wave whose least thickness is about `least`."""
    count = int(dice.integers(1, 7))
    a, b = dice.uniform(-1, 1, (2, count)) / np.arange(1, count + 1)
    depth = -_series(a, b, np.linspace(0, _TURN, 4001)).min()
    return (1 - least) * a / depth, (1 - least) * b / depth


def _series(a: np.ndarray, b: np.ndarray, xi: np.ndarray, order: int = 0) -> np.ndarray:
    k = np.arange(1, len(a) + 1)
    turned = np.exp(1j * np.multiply.outer(np.asarray(xi), k)) * (1j * k) ** order
    return np.real(turned @ (a - 1j * b))


def _panels(f: Callable[[np.ndarray], np.ndarray], low: float, high: float) -> float:
    """Gauss' rule on many panels."""
    edges = np.linspace(low, high, 301)
    half = np.diff(edges)[:, None] / 2
    at = edges[:-1, None] + half * (1 + _GAUSS[0])
    return float(np.sum(half * _GAUSS[1] * f(at)))


def _fourier(dice: Dice) -> Judged:
    a, b = _harmonics(dice, spread(dice, 0.02, 0.9))
    tension, wave = _tension(dice), FourierWave(a, b)

    def h(xi: np.ndarray) -> np.ndarray:
        return 1 + _series(a, b, xi)

    cubes = _panels(lambda x: h(x) ** -3, 0, _TURN)
    C = -_panels(lambda x: h(x) ** -2, 0, _TURN) / cubes
    yield "constant", apart(wave.constant, C, 1e-11)

    def slope(xi: np.ndarray) -> np.ndarray:
        return 3 * (h(xi) + C) / h(xi) ** 3

    begin = -_panels(lambda x: (_TURN - x) * slope(x), 0, _TURN) / _TURN  # so that the mean is 0
    places = dice.uniform(0, _TURN, 4)
    known = [begin + _panels(slope, 0, x) + tension * _series(a, b, x, 2) for x in places]
    size = _panels(lambda x: np.abs(slope(x)), 0, _TURN)
    yield "field", apart(wave.field_function(places, tension), known, 1e-10, size=size)
    wide = float(dice.uniform(0.1, 6.2))
    mean = _panels(lambda x: 1 / h(x), 1 - wide / 2, 1 + wide / 2) / wide
    yield "inverse", apart(wave.inverse(1.0, wide), mean, 1e-11)


# -- next order ------------------------------------------------------------------------------------


def _slow_flow(h: np.ndarray) -> tuple[float, np.ndarray]:
    """What eps² multiplies in C and in the surface's velocity, at equidistant phases.

    psi'''' = -2 (psi of lubrication)_xx'', no slip below, no shear above, the flow given, and a
    pressure on the ground that repeats.
    """

    def by_x(values: np.ndarray, order: int) -> np.ndarray:
        k = 1j * np.fft.rfftfreq(len(h), 1 / len(h))
        return np.fft.irfft(k**order * np.fft.rfft(values), len(h))

    C = -np.mean(h**-2) / np.mean(h**-3)
    F = -3 * (h + C) / h**3
    steep, bend, first = by_x(F, 2), by_x(F * h, 2), by_x(F, 1) * h**2 / 2 - by_x(F * h, 1) * h
    rise = -(steep * h**3 / 6 - bend * h**2 / 2)  # w_x on the surface
    shear = 4 * by_x(h, 1) * first - rise
    R = shear + 2 * (steep * h**3 / 6 - bend * h**2 / 2)
    T = 2 * (steep * h**5 / 120 - bend * h**4 / 24)
    change = float(-np.mean((T - R * h**2 / 2) / h**3) / np.mean(h**-3))
    a = -3 * (change + T - R * h**2 / 2) / h**3
    b = R - a * h
    surface = -2 * (steep * h**4 / 24 - bend * h**3 / 6) + a * h**2 / 2 + b * h
    return change, surface


def _next_order(dice: Dice) -> Judged:
    a, b = _harmonics(dice, spread(dice, 0.05, 0.95))
    cosine = dice.random() < 0.4
    if cosine:
        a, b = np.array([dice.uniform(0.01, 0.9)]), np.zeros(1)
    xi = _TURN * np.arange(2048) / 2048
    h = 1 + _series(a, b, xi)
    change, surface = _slow_flow(h)
    wave = CosineWave(float(a[0])) if cosine else FourierWave(a, b)
    eps = spread(dice, 0.1, 1.0)
    found = (corrected_flow(wave, eps).value - wave.mean_flow) / eps**2
    yield "correction of the flow", apart(found, change, 1e-8, size=1e-4)
    slope, bend = _series(a, b, xi, 1), _series(a, b, xi, 2)
    told = surface_correction(h, slope, bend, wave.constant, change)
    yield "correction of the surface", apart(told, surface, 1e-7)


# -- what is carried -------------------------------------------------------------------------------


def _floats(dice: Dice) -> Judged:
    held = dice.random()
    delta = float(dice.uniform(0.02, 0.95))
    if held < 0.3:  # nearly held, or held by little
        delta = CAPTURE_DELTA * (1 + float(dice.choice([-1, 1])) * spread(dice, 1e-6, 1e-2))
    length = 0.0 if held < 0.5 else float(dice.uniform(0.01, 6.0))
    C = _cosine_flow(delta) - 1
    nodes, weights = np.polynomial.legendre.leggauss(200)

    def lag(xi: float) -> float:
        h = 1 + delta * np.cos(xi + length / 2 * nodes)
        return float(1 - 1.5 * (1 + C * (weights / 2) @ (1 / h)))

    drift = float_drift(CosineWave(delta), length)
    slack = lag(0.0)  # on the crest it is fastest
    if abs(slack) < 1e-12:
        raise Undecided("all but held")
    if slack < 0:
        yield "held", 0.0 if drift.captured and drift.velocity == 1 else math.inf
        known = _TURN - zero(lag, 0.0, math.pi)
        yield "place", apart(drift.rests, [known], 1e-9)
        return
    width = math.sqrt(slack)
    points = [p for p in width * np.array([0.3, 1, 3, 10, 30]) if p < math.pi]
    edges = [0.0, *points, math.pi]
    turn = 2 * sum(
        quad(lambda x: 1 / lag(x), p, q, epsabs=0, epsrel=1e-11)[0] for p, q in pairwise(edges)
    )
    yield "turn", apart(drift.turn, turn, 1e-9 + 1e-14 / slack)
    yield "velocity", apart(drift.velocity, 1 - _TURN / turn, 1e-8, size=1e-3)


def _tracers(dice: Dice) -> Judged:
    delta = float(dice.uniform(0.05, 0.9))
    C, place = _cosine_flow(delta) - 1, float(dice.uniform(-3, 3))
    height = float(dice.uniform(0.02, 0.98)) * (1 + delta * math.cos(place))
    drift = tracer_drift(CosineWave(delta), height, place)

    def path(t: float, y: np.ndarray) -> list[float]:
        xi, z = t - y[0], y[1]
        h, slope = 1 + delta * math.cos(xi), -delta * math.sin(xi)
        F = -3 * (h + C) / h**3
        steep = 3 * slope * (2 * h + 3 * C) / h**4  # of F by xi
        # stream function F (z³/6 - h z²/2): u by z, w = d / d xi of it
        flow = steep * (z**3 / 6 - h * z**2 / 2) - F * slope * z**2 / 2
        return [F * (z**2 / 2 - h * z), flow]

    def overtaken(t: float, y: np.ndarray) -> float:
        return (t - y[0]) - (-place + _TURN)

    overtaken.terminal = True  # pyright: ignore
    asked = {"rtol": 1e-10, "atol": 1e-12, "method": "DOP853", "events": overtaken}
    far = solve_ivp(path, (0.0, 300.0), [place, height], **asked)
    if not far.t_events[0].size:
        yield "held", 0.0 if drift.captured or drift.turn > 300 else math.inf
        return
    yield "turn", apart(drift.turn, far.t_events[0][0], 1e-7)


# -- films under given fields ----------------------------------------------------------------------


def _given_field(dice: Dice) -> Judged:
    """What a film does at once, and that a prescribed wave rests in its own field."""
    a, b = _harmonics(dice, float(dice.uniform(0.2, 0.95)))
    tension, order = spread(dice, 1e-8, 1e2), int(dice.choice([8, 12, 14]))
    points = 32 * (len(a) + 1)
    xi = _TURN * np.arange(points) / points
    h, third = 1 + _series(a, b, xi), _series(a, b, xi, 3)
    C = -np.mean(h**-2) / np.mean(h**-3)
    field = -3 * (h + C) / h**3 - tension * third  # holds the wave
    share = 10 * (len(a) * _TURN / points) ** order + 1e-7
    for slope, what in ((field - field.mean(), "at rest"), (_some_slope(dice, xi), "in a field")):
        model = thin_film(slope, tension, order=order)
        call = ca.Function("rates", [pack(model.x)], [model.ode])
        found = np.array(call(film_volume(h, order=order))).ravel()
        flow = -(h**3) / 3 * (tension * third + slope) - h
        size = float(np.abs(h**3 * tension * third).max() + np.abs(h**3 * slope).max() + 1)
        yield what, apart(found, flow[1:] - flow[0], share, size=size)


def _some_slope(dice: Dice, xi: np.ndarray) -> np.ndarray:
    a, b = spread(dice, 1e-3, 1e2) * dice.uniform(-1, 1, (2, 3))
    return _series(a, b, xi, 1)


def _scales(dice: Dice) -> Judged:
    """Stresses in SI units, each told by another of the numbers."""
    mu_r, eta, rho = 1 + spread(dice, 1e-3, 10), spread(dice, 1e-4, 1.0), spread(dice, 100, 1e4)
    gamma, depth, wavelength = (
        spread(dice, 1e-4, 1),
        spread(dice, 1e-6, 1e-3),
        spread(dice, 0.01, 1),
    )
    omega = spread(dice, 1e-2, 1e4)
    oil, k = (
        Fluid(
            mu_r=mu_r, viscosity=eta, density=rho, surface_tension=gamma, depth=depth,
            wavelength=wavelength, frequency=omega,
        ),
        _TURN / wavelength,
    )  # fmt: skip
    shear = eta * (omega / k) / depth  # stress; the pressure drives it over a wavelength / 2 pi
    yield "pressure", apart(oil.pressure, shear / (depth * k), 1e-12)
    yield "tension", apart(oil.tension, gamma * depth * k**2 / (shear / (depth * k)), 1e-12)
    yield "Reynolds", apart(oil.reynolds, rho * (omega / k) ** 2 / shear, 1e-12)
    share = spread(dice, 1e-6, 1e3)
    H = math.sqrt(2 * share * oil.pressure / (4e-7 * math.pi * (mu_r - 1)))
    yield "field", apart(oil.field(share), H, 1e-9)


def _limits(dice: Dice) -> Judged:
    """No wave within bounds carries more than the bound; the largest cosine touches its limit."""
    a, b = _harmonics(dice, spread(dice, 0.05, 0.95))
    x = np.linspace(0, _TURN, 20001)
    h = 1 + _series(a, b, x)
    C = -_panels(lambda s: (1 + _series(a, b, s)) ** -2, 0, _TURN) / _panels(
        lambda s: (1 + _series(a, b, s)) ** -3, 0, _TURN
    )
    bound = largest_flow((float(h.min()), float(h.max())))
    yield "bound", max(1 + C - bound, 0.0) / 1e-6
    tension, most = spread(dice, 1e-6, 10), spread(dice, 1e-4, 1e3)
    delta = fitting_cosine(tension, (1e-3, 3.0), most)
    if delta > 0.99:
        return
    E = np.linspace(-math.pi, math.pi, 801)[1:-1]
    D = [_cosine_field(delta, tension, e) for e in E]
    yield "limit of the field", apart(max(D) - min(D), most, 2e-3)


def _no_film(dice: Dice) -> Judged:
    """Numbers that no film has."""
    beyond = 1 + spread(dice, 1e-9, 1e3)
    wave = CosineWave(0.5)
    yield "amplitude", refused(lambda: CosineWave(beyond), "delta", "below 1")
    yield "no amplitude", refused(lambda: CosineWave(-beyond), "delta", "above 0")
    yield "dry", refused(lambda: FourierWave([beyond]), "thickness", "smaller harmonics")
    yield "length", refused(lambda: float_drift(wave, _TURN * beyond), "length", "2 pi")
    yield "tracer", refused(lambda: tracer_drift(wave, 1.5 * beyond), "height", "1.5")
    yield "eps", refused(lambda: corrected_flow(wave, -beyond), "eps", "0 or above")
    slope = np.sin(_TURN * np.arange(64) / 64)
    yield "tension", refused(lambda: thin_film(slope, -beyond), "tension", "above 0")
    yield "field", refused(lambda: thin_film(slope + beyond, 1.0), "slope", "mean")
