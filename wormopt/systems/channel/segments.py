"""Shapes of a segment between two coils: assumed, and the exact elastica by two routes.

The inextensible elastica goes from one wall of the channel to the other. The angle theta of the
centre line to the channel is 0 at both walls. In between

    E I theta'' = -V cos theta + N sin theta,

where V is the force of a wall on the body, positive if it pushes, and N the tension along the
channel. An assumption closes the problem:

- ``point_contact``: the walls push across the channel only and the ends are free of force, N = 0.
- ``sleeve``: the length between the walls is free and has the least bending energy. The energy
  falls with length at the rate E I theta'(0)² / 2 + N, the Hamiltonian, which is then 0.
- ``length``: the length is given, and N is the force that holds it.

All quantities are scaled: lengths by the span L, forces by E I / L², energies by E I / L.

`exact_elastica` is a second route by elliptic integrals (scipy's, as functions of m = k²). Half a
segment, from the wall to the middle, where the curvature is 0 and the angle largest, is a part of a
pendulum's swing: with the modulus k and the amplitude phi,

    point_contact   1 - k² = sin²(delta / 2),   sin phi_0 = 1 / (k sqrt 2),   scale R = V,
    sleeve          k² = 1 / 2,   sin phi_0 = sqrt 2 sin(delta / 2),   R = sqrt(N² + V²),

where delta is a right angle less the largest angle. The derivation is in docs/theory-channel.md.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any, Literal, get_args

import casadi as ca
import numpy as np
from scipy.special import ellipe, ellipeinc, ellipj, ellipk, ellipkinc, ellipkm1

from wormopt.errors import ArgumentError, SolveError
from wormopt.numerics.boundary_values import BoundaryProblem, BoundarySolution, solve_boundary
from wormopt.numerics.chebyshev import resolve
from wormopt.numerics.roots import root
from wormopt.result import Check
from wormopt.systems.channel.closed_forms import SHAPES, ChannelWorm, Shape
from wormopt.systems.channel.rod import Curve, distances, graph_curve

Free = Literal["point_contact", "sleeve"]
Closing = Literal["point_contact", "sleeve", "length"]
CLOSINGS: tuple[Closing, ...] = get_args(Closing)
STATES = ("theta", "curvature", "x", "y", "energy")
SLEEVE_RISE = float(np.sqrt(2) / (2 * ellipe(0.5) - ellipk(0.5)))
"""Rise over span, 1.669, above which a segment of free length no longer presses on the walls."""
_LEAST_DELTA = 1e-15


def elastica(closing: Closing) -> BoundaryProblem:
    """Return the problem of one segment, closed by an assumption.

    States `STATES` over the share of the arc length; unknowns l_s, V and N; given is the rise, and
    with "length" also l_s. Raises ArgumentError if the assumption does not exist.
    """
    if closing not in CLOSINGS:
        raise ArgumentError(f"closing must be one of {', '.join(CLOSINGS)}, not {closing!r}")
    y, start, end = (ca.SX.sym(name, len(STATES)) for name in ("y", "start", "end"))
    p, given = ca.SX.sym("p", 3), ca.SX.sym("given", 1 + (closing == "length"))
    theta, curvature, _, _, _ = ca.vertsplit(y)
    length, reaction, tension = ca.vertsplit(p)
    bend = -reaction * ca.cos(theta) + tension * ca.sin(theta)
    ode = length * ca.vertcat(curvature, bend, ca.cos(theta), ca.sin(theta), curvature**2 / 2)
    closes = {
        "point_contact": tension,
        "sleeve": tension + start[1] ** 2 / 2,
        "length": length - given[-1],
    }
    zero = ca.vertcat(
        start[0], start[2], start[3], start[4], end[0], end[2] - 1, end[3] - given[0],
        closes[closing],
    )  # fmt: skip
    return BoundaryProblem(y, p, given, ode, start, end, zero, STATES)


def slender_guess(closing: Closing, rise: float, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the beam shape (eq. 34), the limit of the elastica for a small rise over span.

    Returns the states (5, m) at the shares `s` (m,) of the length, and the numbers l_s, V and N.
    """
    curvature = 6 * rise * (1 - 2 * s)
    energy = 3 * rise**2 * (1 - (1 - 2 * s) ** 3)
    y = [6 * rise * s * (1 - s), curvature, s, rise * s * s * (3 - 2 * s), energy]
    tension = -18 * rise**2 if closing == "sleeve" else 0.0
    return np.array(y), np.array([1 + 0.6 * rise**2, 12 * rise, tension])


@dataclass(frozen=True)
class ExactElastica:
    """One segment in closed form, scaled by its span and E I."""

    closing: Free
    delta: float  # right angle less the largest angle of the centre line

    @property
    def _m(self) -> tuple[float, float]:
        """Parameters k² and 1 - k²."""
        if self.closing == "sleeve":
            return 0.5, 0.5
        rest = float(np.sin(self.delta / 2)) ** 2
        return 1 - rest, rest

    @property
    def _start(self) -> float:
        """Amplitude at the wall."""
        rest = self._m[1]
        if self.closing == "sleeve":
            return float(np.arcsin(np.sqrt(2) * np.sin(self.delta / 2)))
        # cos² = 1 - 1 / (2 m), with the digits of 1 - m
        return float(np.arctan2(1.0, np.sqrt(1 - 2 * rest)))

    @property
    def _halves(self) -> tuple[float, float]:
        """Integrals of the first and second kind from the wall to the middle."""
        m, rest = self._m
        first = ellipkm1(rest) - ellipkinc(self._start, m)
        return float(first), float(ellipe(m) - ellipeinc(self._start, m))

    @property
    def _along_across(self) -> tuple[float, float]:
        """Half of span and rise, times the root of R."""
        first, second = self._halves
        if self.closing == "point_contact":
            return float(np.sqrt(2 * np.cos(self.delta))), first - 2 * second
        cos, sin = np.cos(self.delta), np.sin(self.delta)
        with_load, across = 2 * second - first, np.sqrt(2) * np.cos(self._start)
        return float(cos * with_load + sin * across), float(cos * across - sin * with_load)

    @property
    def _root(self) -> float:
        """Root of R, which makes the span 1."""
        return 2 * self._along_across[0]

    @property
    def rise(self) -> float:
        """Rise over span."""
        along, across = self._along_across
        return across / along

    @property
    def length(self) -> float:
        """l_s over the span."""
        return self._halves[0] / self._along_across[0]

    @property
    def reaction(self) -> float:
        """V, times L² / (E I)."""
        share = 1.0 if self.closing == "point_contact" else float(np.sin(self.delta))
        return share * self._root**2

    @property
    def tension(self) -> float:
        """N, times L² / (E I)."""
        if self.closing == "point_contact":
            return 0.0
        return -float(np.cos(self.delta)) * self._root**2

    @property
    def energy(self) -> float:
        """Bending energy, times L / (E I): the integral of half the squared curvature."""
        if self.closing == "point_contact":
            return self.reaction * (np.cos(self.delta) * self.length - self.rise)
        return -self.tension - self.reaction * self.rise

    @property
    def curvature(self) -> float:
        """Curvature at the walls, the largest, times the span."""
        if self.closing == "point_contact":
            return float(np.sqrt(2 * self.reaction * np.cos(self.delta)))
        return float(np.sqrt(-2 * self.tension))

    def points(self, share: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the centre line x, y and angle, (m,) each, by Jacobi functions of the share.

        x and y are over the span, the angle is in radians.
        """
        share = np.asarray(share, dtype=float)
        second_half = share > 0.5
        x, y, theta = self._half(np.where(second_half, 1 - share, share))
        whole = np.where(second_half, 1 - x, x), np.where(second_half, self.rise - y, y)
        return *whole, theta

    def _half(self, share: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        m, _ = self._m
        begin = ellipkinc(self._start, m)
        u = begin + self._root * self.length * share
        sn, cn, dn, amplitude = ellipj(u, m)
        first, second = u - begin, ellipeinc(amplitude, m) - ellipeinc(self._start, m)
        k, root = np.sqrt(m), self._root
        if self.closing == "point_contact":
            x = 2 * k * (np.cos(self._start) - cn) / root
            return x, (first - 2 * second) / root, 2 * np.arctan2(k * sn, dn) - np.pi / 2
        # along and across the force, which is inclined by delta
        along, across = 2 * second - first, 2 * k * (np.cos(self._start) - cn)
        cos, sin = np.cos(self.delta), np.sin(self.delta)
        angle = 2 * np.arctan2(k * sn, dn) - self.delta
        return (cos * along + sin * across) / root, (cos * across - sin * along) / root, angle


def exact_elastica(closing: Free, rise: float) -> ExactElastica:
    """Return the elastica of a given rise over the span.

    Raises ArgumentError if the rise is not above 0, above `SLEEVE_RISE` with a sleeve (walls would
    have to pull), or above about 15 with point contact (a right angle to machine accuracy).
    """
    most = SLEEVE_RISE if closing == "sleeve" else ExactElastica(closing, _LEAST_DELTA).rise
    if not 0 < rise <= most:
        raise ArgumentError(f"the rise with {closing} must be in (0, {most:.6g}], not {rise!r}")

    def excess(log_delta: float) -> float:
        return ExactElastica(closing, float(np.exp(log_delta))).rise - rise

    low, high = np.log(_LEAST_DELTA), np.log(np.pi / 2)
    if excess(low) <= 0:
        return ExactElastica(closing, 0.0)
    return ExactElastica(closing, float(np.exp(root(excess, low, high))))


ACCEPTED = 1e-10
"""Accepted difference of two routes to the elastica in length, force, energy and place."""
# The continuation of the elastica starts from the slender beam of this rise over the span.
_SLENDER = 0.2


@dataclass(frozen=True, eq=False)
class SegmentShape:
    """Results of one shape; lengths in m."""

    name: str
    exact: bool  # computed from forces
    curve: Curve  # centre line, from (0, body / 2)
    energy: float | None = None  # bending energy over E I, 1/m; None: not finite
    curvature: float | None = None  # largest, 1/m
    reaction: float | None = None  # wall force across the channel, over E I, 1/m²
    tension: float | None = None  # along the channel, over E I, 1/m²
    spans: bool = True  # from wall to wall; else it is no segment
    facts: dict[str, Any] = field(default_factory=dict)  # of its computation
    checks: tuple[Check, ...] = ()


def assumed_curve(worm: ChannelWorm, shape: Shape) -> Curve:
    """Return the centre line of an assumed shape ("sine", "beam" or "line") by its length, in m."""
    return graph_curve(lambda x: worm.center_line(shape, x), worm.pitch)


def assumed_shapes(worm: ChannelWorm) -> Iterator[SegmentShape]:
    """Yield the assumed shapes, eqs 33-35 of Zimmermann et al. 2007."""
    for shape in SHAPES:
        curve = assumed_curve(worm, shape)
        # a broken line has kinks, with infinite curvature and energy
        energy, curvature = (None, None) if shape == "line" else _bending(curve)
        yield SegmentShape(shape, False, curve, energy, curvature)


def _bending(curve: Curve) -> tuple[float, float]:
    """Return energy over E I, and largest curvature."""
    angle = resolve(lambda s: curve.points(s)[2:], 0.0, 1.0).derivative()
    squares = resolve(lambda s: angle(s) ** 2, 0.0, 1.0)
    energy = float(squares.integral()[0]) / (2 * curve.length)
    return energy, float(np.max(np.abs(angle.extremes()))) / curve.length


def elastic_shape(worm: ChannelWorm, closing: Free, degree: int) -> SegmentShape:
    """Return the elastica, with polynomials up to `degree`."""
    pitch, rise = worm.pitch, worm.rise / worm.pitch
    if closing == "sleeve" and rise > SLEEVE_RISE:
        raise SolveError(
            f"a segment of free length leaves the walls if it rises by more than "
            f"{SLEEVE_RISE:.5g} coil distances; this one rises by {rise:.5g}, and the walls would "
            "have to pull",
            'write exact = ["point_contact"], or a thicker body, or a narrower channel',
            code="no_contact",
        )
    slender = min(rise, _SLENDER)
    try:
        found = solve_boundary(
            elastica(closing), lambda s: slender_guess(closing, slender, s), [[slender], [rise]],
            most=degree,
        )  # fmt: skip
    except SolveError as error:
        raise SolveError(
            f"{closing}: {error.reason}", "write a larger degree, or a less steep segment",
            code=error.code,
        ) from None  # fmt: skip

    def points(share: np.ndarray) -> np.ndarray:
        theta, _, x, y, _ = found.at(share)
        return np.array([pitch * x, pitch * y + worm.body / 2, theta])

    length, reaction, tension = (float(number) for number in found.p)
    error = _recheck(found, closing, rise)
    off = max(error, found.residual, found.defect)
    advice = f"{closing}: differs by {off:.2g} from its equations or the elliptic integrals"
    return SegmentShape(
        closing, True, Curve(pitch * length, points),
        energy=float(found.at([1.0])[4, 0]) / pitch,
        curvature=float(np.abs(found.at(np.linspace(0, 1, 101))[1]).max()) / pitch,
        reaction=reaction / pitch**2,
        tension=tension / pitch**2,
        facts={
            "degree": found.degree, "residual": found.residual, "tail": found.tail,
            "defect": found.defect, "recheck_error": error,
        },
        checks=(Check(closing.replace("_", " "), off, ACCEPTED, advice),),
    )  # fmt: skip


def _recheck(found: BoundarySolution, closing: Free, rise: float) -> float:
    """Return the largest difference from the elliptic integrals, of values and of places."""
    exact = exact_elastica(closing, rise)
    states = found.at(share := np.linspace(0, 1, 51))
    size = abs(exact.reaction) + abs(exact.tension)
    errors = [
        abs(one - other) / scale
        for one, other, scale in (
            (found.p[0], exact.length, exact.length),
            (found.p[1], exact.reaction, size),
            (found.p[2], exact.tension, size),
            (states[4, -1], exact.energy, exact.energy),
            (states[1, 0], exact.curvature, exact.curvature),
        )
    ]
    return float(max(*errors, np.abs(states[2:4] - exact.points(share)[:2]).max()))


def distances_between(shapes: list[SegmentShape]) -> np.ndarray:
    """Return largest and root mean square distance of each from each, (m, m, 2), in m."""
    found = np.zeros((len(shapes), len(shapes), 2))
    for i, j in combinations(range(len(shapes)), 2):
        found[i, j] = found[j, i] = distances(shapes[i].curve, shapes[j].curve)
    return found
