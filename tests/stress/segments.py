"""Peristaltic worms: segments in coils and tubes, membranes, gaits on drag and with anchors.

Judged by least energy found anew, derivatives by complex steps, and shooting.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Iterable

import numpy as np
from scipy.integrate import quad, solve_ivp
from scipy.optimize import fsolve

from tests.stress.means import least, refused, zero
from tests.stress.peristaltic_gaits import GAITS
from tests.stress.peristaltic_worms import WORMS
from tests.stress.verdict import Case, Dice, Judged, Undecided, apart, many, spread
from wormopt.magnetics.winding import Coil
from wormopt.systems.peristaltic.anchored_fastest import mode_bound
from wormopt.systems.peristaltic.drag_gaits import small_gaits
from wormopt.systems.peristaltic.membranes import (
    Fibres,
    balloon,
    barrel_swelling,
    inflated,
    limit_of_inflation,
    range_of_fill,
)
from wormopt.systems.peristaltic.segment import Segment, WoundSegment
from wormopt.systems.peristaltic.tables import Tube

_MU0 = 4e-7 * math.pi
_STEP = 1e-30


def cases(*, quick: bool) -> Iterable[Case]:
    """List the cases of peristaltic worms."""
    kinds = (
        ("segments at rest", _rest, 25),
        ("segments in tubes", _tube, 10),
        ("segments of fibres", _fibres, 10),
        ("inflated tubes", _inflated, 10),
        ("barrels", _barrel, 5),
        ("membranes at rest", _balloon, 10),
        ("segments in real coils", _wound, 8),
        *GAITS,
        *WORMS,
        ("no segments", _no_segment, 5),
    )
    return many(kinds, quick=quick, span=0.1)


# -- energies --------------------------------------------------------------------------------------


def _density(along: complex, around: complex, a: float) -> complex:
    """Energy of an incompressible membrane from its three principal stretches."""
    squares = [along**2, around**2, 1 / (along * around) ** 2]
    first = sum(squares) - 3
    second = sum(1 / s for s in squares) - 3
    return (a * first + (1 - a) * second) / 2


def _slope(energy: Callable[[complex], complex], at: float) -> float:
    """Derivative of an analytic function of a real number, without differences."""
    return (energy(at + 1j * _STEP * at).imag) / (_STEP * at)


def _drawn(dice: Dice) -> Segment:
    radius = spread(dice, 1e-4, 0.1)
    return Segment(
        radius * spread(dice, 0.1, 100.0), radius, radius * spread(dice, 1e-3, 0.2),
        spread(dice, 1e2, 1e9), float(dice.uniform(0.05, 1.0)),
        1.0 if dice.random() < 0.5 else float(dice.uniform(0.0, 1.0)),
    )  # fmt: skip


def _scale(s: Segment) -> float:
    """2 pi R L G h."""
    return 2 * math.pi * s.radius * s.length * s.shear_modulus * s.wall


def _sealed(s: Segment, pressure: float, load: float, lam: complex, share: float) -> complex:
    """Energy of a sealed segment in its coil, whose field is even within and nil outside."""
    elastic = _scale(s) * _density(lam, 1 / cmath.sqrt(lam), s.neo_hookean)
    inside = share / lam if lam.real >= share else 1.0
    volume = math.pi * s.radius**2 * s.length
    return elastic - pressure * volume * inside - load * s.length * lam


def _minima(energy: Callable[[complex], complex], low: float, high: float) -> list[float]:
    """Where an energy of a stretch has its least values, by the signs of its slope."""
    at = np.exp(np.linspace(math.log(low), math.log(high), 1500))
    slopes = np.array([_slope(energy, float(x)) for x in at])
    found = [low] if slopes[0] >= 0 else []
    turns = np.flatnonzero((slopes[:-1] < 0) & (slopes[1:] >= 0))
    found += [zero(lambda x: _slope(energy, x), at[k], at[k + 1]) for k in turns]
    return found


def _rest(dice: Dice) -> Judged:
    s = _drawn(dice)
    kappa = spread(dice, 1e-9, 3.0)
    pressure = kappa * s.shear_modulus * s.wall / s.radius
    load = float(dice.choice([-1, 0, 1])) * s.stiffness * spread(dice, 1e-9, 3.0)
    found = s.stretch_at(pressure, load)
    rests = _minima(lambda x: _sealed(s, pressure, load, x, s.coil_share), s.coil_share, 50.0)
    if not rests:
        raise Undecided("no energy is least")
    nearest = min(rests, key=lambda x: abs(x - found))
    yield "rest", apart(found, nearest, 1e-10)
    lam = spread(dice, 0.05, 20.0)
    pull = _slope(lambda x: _scale(s) * _density(x, 1 / cmath.sqrt(x), s.neo_hookean), lam)
    pull /= s.length
    yield "pull", apart(s.elastic_pull(lam), pull, 1e-11, size=s.stiffness * 1e-3)

    def left(share: float) -> float:
        return _slope(lambda x: _sealed(s, pressure, 0.0, x, share), share)

    deepest = zero(left, 1e-4, 1.0)
    yield "deepest", apart(s.deepest_stretch(pressure), deepest, 1e-9)


def _tube(dice: Dice) -> Judged:
    """Normal force as the derivative of the energy by the tube's radius."""
    s = _drawn(dice)
    tube = Tube(s.radius * (1 + spread(dice, 1e-6, 1.0)), 0.3)
    stretch = (s.radius / tube.radius) ** 2
    if abs(stretch - s.coil_share) < 1e-3:
        raise Undecided("the segment just leaves the even field")
    pressure = spread(dice, 1e-6, 10.0) * s.shear_modulus * s.wall / s.radius
    pull = float(dice.normal()) * s.stiffness

    def energy(radius: complex) -> complex:
        return _sealed(s, pressure, pull, (s.radius / radius) ** 2, s.coil_share)

    force = -_slope(energy, tube.radius)
    size = 2 * s.length / tube.radius * (abs(pull) + pressure * math.pi * s.radius**2) * 1e-3
    yield "stretch", apart(tube.stretch_at_contact(s), stretch, 1e-13)
    yield "normal force", apart(tube.normal_force(s, pressure, pull), force, 1e-10, size=size)


def _fibres(dice: Dice) -> Judged:
    s, start = _drawn(dice), float(dice.uniform(0.1, 1.45))
    wound = Fibres(s, start)
    pressure = spread(dice, 1e-6, 1.0) * s.shear_modulus * s.wall / s.radius
    load = float(dice.choice([-1, 0, 1])) * s.stiffness * spread(dice, 1e-6, 0.3)

    def energy(angle: complex) -> complex:
        lam, th = cmath.cos(angle) / math.cos(start), cmath.sin(angle) / math.sin(start)
        volume = math.pi * s.radius**2 * s.length * lam * th**2
        return (
            _scale(s) * _density(lam, th, s.neo_hookean) - pressure * volume - load * s.length * lam
        )

    found = wound.angle_at(pressure, load)
    rests = _minima(energy, 1e-4 * start, math.pi / 2 - 1e-4 * (math.pi / 2 - start))
    nearest = min(rests, key=lambda x: abs(x - found), default=math.nan)
    yield "angle", apart(found, nearest, 1e-8)
    fill = 1 - spread(dice, 1e-6, 0.999)
    cosines = np.roots([-1.0, 0.0, 1.0, -2 * fill / (3 * math.sqrt(3))])
    angles = np.sort(np.arccos([c.real for c in cosines if 0 < c.real < 1]))
    yield "range", apart(range_of_fill(fill), angles, 1e-7)


def _inflated(dice: Dice) -> Judged:
    a = 1.0 if dice.random() < 0.4 else float(dice.uniform(0.0, 1.0))

    def slopes(y: np.ndarray, kappa: float) -> list[float]:
        lam, th = float(y[0]), float(y[1])
        return [
            _slope(lambda x: _density(x, th, a) - kappa * th**2 * x / 2, lam),
            _slope(lambda x: _density(lam, x, a) - kappa * x**2 * lam / 2, th),
        ]

    kappa, y = spread(dice, 1e-6, 0.74), np.array([1.0, 1.0])
    for share in (0.25, 0.5, 0.75, 0.9, 1.0):
        y = np.array(fsolve(slopes, y, (share * kappa,), xtol=1e-13))
    if np.abs(slopes(y, kappa)).max() > 1e-10:
        raise Undecided("no rest found")
    found = inflated(kappa, a)
    yield "stretches", apart([found.stretch, found.hoop], y, 1e-6 if kappa > 0.7 else 1e-9)
    limit = limit_of_inflation(a)

    def loading(th: float) -> float:
        free = zero(lambda lam: slopes_at(lam, th), 0.05, 20.0)
        return _slope(lambda x: _density(free, x, a), th) / (th * free)

    def slopes_at(lam: float, th: float) -> float:
        """Ends are free: w_lam = kappa th² / 2 with the kappa of w_th = kappa th lam."""
        around = _slope(lambda x: _density(lam, x, a), th)
        return _slope(lambda x: _density(x, th, a), lam) - around * th / (2 * lam)

    hoops = np.linspace(1.001, 8.0, 400)
    values = np.array([loading(float(th)) for th in hoops])
    tops = np.flatnonzero((values[1:-1] > values[:-2]) & (values[1:-1] >= values[2:])) + 1
    if not tops.size:
        yield "no limit", 0.0 if limit is None else math.inf
        return
    near = float(hoops[tops[0] - 1]), float(hoops[tops[0] + 1])
    most = -least(lambda th: -loading(th), *near)[1]
    yield "limit", apart(limit.loading if limit else math.nan, most, 1e-9)


def _barrel(dice: Dice) -> Judged:
    """A barrel of the volume of the cylinder it was."""
    stretch = spread(dice, 0.1, 5.0)
    nodes, weights = np.polynomial.legendre.leggauss(8)
    radius = 1 + (barrel_swelling(stretch) - 1) * (1 - nodes**2)
    yield "volume", apart(stretch * (weights / 2) @ radius**2, 1.0, 1e-12)


def _balloon(dice: Dice) -> Judged:
    """A membrane at rest, shot from its middle to its ring with the balance of forces anew."""
    slender, kappa = spread(dice, 0.5, 5.0), spread(dice, 0.05, 0.5)
    pull, a = float(dice.uniform(0.0, 0.5)), float(dice.choice([1.0, 0.9, 0.7]))
    found = balloon(slender, loading=kappa, pull=pull, neo_hookean=a)

    def along(lam: float, rho: float) -> float:
        return _slope(lambda x: _density(x, rho, a), lam)

    def rates(_: float, y: np.ndarray) -> list[float]:
        rho, _, sine, _ = y  # sine of the angle of the meridian
        cosine = math.sqrt(max(1 - sine**2, 0.0))
        tension = (pull + kappa * rho**2 / 2) / cosine  # balance along the axis
        lam = zero(lambda x: along(x, rho) - tension, 0.05, 30.0)
        around = _slope(lambda x: _density(lam, x, a), rho)
        turn = (around * cosine - kappa * rho * lam) / tension
        return [lam * sine, lam * cosine, cosine * turn, 2 / slender * rho**2 * lam * cosine]

    begin = [found.radius[0], 0.0, 0.0, 0.0]
    far = solve_ivp(rates, (0, slender / 2), begin, rtol=1e-9, atol=1e-10, method="DOP853")
    end = far.y[:, -1]
    yield "ring", apart(end[0], 1.0, 1e-6)
    yield "length", apart(found.stretch * slender / 2, end[1], 1e-6)
    yield "volume", apart(found.volume, end[3], 1e-6)


def _wound(dice: Dice) -> Judged:
    s = _drawn(dice)
    inner = s.radius * spread(dice, 1.01, 3.0)
    coil = Coil(inner, inner * spread(dice, 1.1, 4.0), s.length * spread(dice, 0.2, 2.0))
    chi, half = spread(dice, 1e-3, 10.0), coil.length / 2

    def field(z: float) -> float:
        """On the axis, per ampere-turn."""

        def end(to: float) -> float:
            over = [math.log(r + math.hypot(r, to)) for r in (coil.outer, coil.inner)]
            return to * (over[0] - over[1])

        return (end(z + half) - end(z - half)) / (2 * coil.length * (coil.outer - coil.inner))

    unit = _MU0 * chi * field(0.0) ** 2 / 2  # pressure per squared ampere-turn
    turns = math.sqrt(spread(dice, 1e-4, 1.0) * s.shear_modulus * s.wall / (s.radius * unit))
    real = WoundSegment(s, coil, chi)
    yield "pressure", apart(real.pressure(0.3 * half, turns),
                            _MU0 * chi * (turns * field(0.3 * half)) ** 2 / 2, 1e-10)  # fmt: skip
    lam = real.stretch_at(turns)
    l_ = lam * s.length

    def p(z: float) -> float:
        return _MU0 * chi * (turns * field(z)) ** 2 / 2

    mean = 2 / l_ * quad(p, 0, l_ / 2, epsabs=0, epsrel=1e-11)[0]
    coil_pull = math.pi * s.radius**2 / lam * (mean - p(l_ / 2))
    elastic = _slope(lambda x: _scale(s) * _density(x, 1 / cmath.sqrt(x), s.neo_hookean), lam)
    yield "rest", apart(elastic / s.length, -coil_pull, 1e-7, size=s.stiffness * 1e-3)


def _no_segment(dice: Dice) -> Judged:
    """Segments that cannot be."""
    more = 1 + spread(dice, 1e-6, 1e2)
    s = Segment(20e-3, 5e-3, 0.3e-3, 20e3)
    yield "share", refused(lambda: Segment(1, 1, 1, 1, coil_share=more), "coil_share", "0 to 1")
    yield "wall", refused(lambda: Segment(1, 1, -more, 1), "wall", "above 0")
    yield "pressure", refused(lambda: s.stretch_at(-more), "pressure", "0 or above")
    yield "tube", refused(lambda: Tube(5e-3 / more, 0.3).stretch_at_contact(s), "radius", "below")
    yield "coil", refused(lambda: WoundSegment(s, Coil(5e-3 / more, 1.0, 1.0), 1.0), "inner")
    yield "fibres", refused(lambda: Fibres(s, math.pi / 2 * more), "angle", "between 0 and 90")
    yield "fill", refused(lambda: range_of_fill(more), "fill", "0 to 1")
    yield "limit", refused(lambda: inflated(0.75 * more), "limit of inflation", "0.749868")
    yield "anchors", refused(lambda: mode_bound(3, 4, (1, 1)), "write 1 to 3")
    yield "drag", refused(lambda: small_gaits(3, 0.0), "no gait has a net displacement")
