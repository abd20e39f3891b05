"""Membranes of a segment beyond the sealed cylinder: barrel, inflated, true shape, with fibres.

A sealed segment whose ends rings hold at its radius is a barrel; here with a parabolic meridian,
which is an assumption, and with the volume of the unstressed cylinder. In a tube it touches in the
middle only.

A cylinder under a given inner pressure with free closed ends is inflated: fluid may come in, from
other segments or a pump. With the energy w of `density`, the pressure kappa in G h / R and the hoop
stretch th, w - kappa th² lam / 2 is stationary: free ends satisfy w_lam = kappa th² / 2, the wall
w_th = kappa th lam. Without kappa this is quadratic in lam². kappa increases with th up to the
limit of inflation, where the determinant of the second derivatives vanishes; beyond it the tube is
unstable and keeps swelling.

The true shape of a membrane between rings of its own radius R has lengths over R. With S the
unstressed distance from the middle to a ring, phi the angle of the meridian to the axis and n the
force on the rings over 2 pi R G h: tension w_1(lam_1, rho) along the meridian,

    rho' = lam_1 sin phi,   zeta' = lam_1 cos phi,   w_1' = w_2 sin phi,
    w_1 phi' = w_2 cos phi - kappa rho lam_1,   w_1 cos phi - kappa rho² / 2 = n.

The last equation is the axial balance and holds everywhere; it is imposed in the middle. Either the
pressure is given, or the volume, which then determines the pressure. The membrane must be under
tension everywhere: it is thin, and would wrinkle.

A segment may be wound with inextensible fibres in both directions at one angle to its axis. At the
angle al the stretch is cos al / cos al0 and the hoop stretch sin al / sin al0, where al0 is the
angle of the unstressed segment: the angle determines length, radius and volume. The volume,
proportional to cos al sin² al, is largest at tan² al = 2, where pressure has no pull. A sealed
round segment is therefore locked. It moves only if it is filled to less than the largest volume,
and is then flattened. Angles are in rad. Source: docs/theory-peristaltic.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError, SolveError
from wormopt.numerics.boundary_values import BoundaryProblem, BoundarySolution, solve_boundary
from wormopt.numerics.roots import root
from wormopt.systems.peristaltic.segment import Segment, curvatures, density, slopes


def barrel_swelling(stretch: Any) -> Any:
    """Return the largest radius over that of the rings at a stretch lam.

    1 + (5/4)(sqrt(1 + 6 s / 5) - 1) with s = 1 / lam - 1: a growth of 3 s / 4 for small s, against
    s / 2 of a cylinder.
    """
    return 1 + 1.25 * ((1 + 1.2 * (1 / stretch - 1)) ** 0.5 - 1)


WIDEST = 8.0
"""Hoop stretch up to which a limit is searched; rubber tears before."""


class Inflated(NamedTuple):
    """A cylinder in equilibrium under a pressure."""

    loading: float  # kappa
    hoop: float  # over its unstressed radius
    stretch: float  # over its unstressed length


def free_stretch(hoop: Any, neo_hookean: Any = 1.0) -> Any:
    """Return the axial stretch with free ends, by the hoop stretch; closed form."""
    y, a, b = hoop**2, neo_hookean, 1 - neo_hookean
    square, linear, rest = a + b * y / 2, (a * y - b / y) / 2, a / (2 * y) + b
    return ((linear + (linear**2 + 4 * square * rest) ** 0.5) / (2 * square)) ** 0.5


def loading_at(hoop: Any, neo_hookean: Any = 1.0) -> Any:
    """Return the pressure over G h / R for a hoop stretch with free ends; closed form."""
    stretch = free_stretch(hoop, neo_hookean)
    return slopes(stretch, hoop, neo_hookean)[1] / (hoop * stretch)


def determinant(hoop: Any, neo_hookean: Any = 1.0) -> Any:
    """Return the determinant of second derivatives of energy less work, in equilibrium.

    It is positive if the equilibrium is stable at its pressure.
    """
    stretch, loading = free_stretch(hoop, neo_hookean), loading_at(hoop, neo_hookean)
    along, both, around = curvatures(stretch, hoop, neo_hookean)
    return along * (around - loading * stretch) - (both - loading * hoop) ** 2


def limit_of_inflation(neo_hookean: float = 1.0) -> Inflated | None:
    """Return the state of largest pressure, or None if it always rises with the hoop stretch."""
    hoops = np.linspace(1.0, WIDEST, 701)
    beyond = np.flatnonzero(determinant(hoops, neo_hookean) < 0)
    if not beyond.size:
        return None
    low, high = hoops[beyond[0] - 1 : beyond[0] + 1]
    return _at(root(lambda hoop: determinant(hoop, neo_hookean), low, high), neo_hookean)


def inflated(loading: float, neo_hookean: float = 1.0) -> Inflated:
    """Return the equilibrium at a pressure over G h / R on the branch from the unstressed state."""
    limit = limit_of_inflation(neo_hookean)
    widest, most = limit.hoop if limit else WIDEST, largest_loading(neo_hookean)
    if not 0 <= loading <= most:
        end = "the limit of inflation" if limit else f"a hoop stretch of {WIDEST:g}"
        raise ArgumentError(
            f"the pressure is {loading:.6g} G h / R; equilibria exist from 0 to {end}, "
            f"{most:.6g} G h / R"
        )
    rest = root(lambda hoop: loading_at(hoop, neo_hookean) - loading, 1.0, widest)
    return _at(rest, neo_hookean)


def largest_loading(neo_hookean: float = 1.0) -> float:
    """Return the largest pressure over G h / R: limit of inflation, or the value at `WIDEST`."""
    limit = limit_of_inflation(neo_hookean)
    return limit.loading if limit else float(loading_at(WIDEST, neo_hookean))


def _at(hoop: float, neo_hookean: float) -> Inflated:
    return Inflated(
        float(loading_at(hoop, neo_hookean)), hoop, float(free_stretch(hoop, neo_hookean))
    )


Given = Literal["pressure", "volume"]
# Start of the continuation of solutions: a short, strongly inflated membrane.
_START: dict[str, float] = {"pressure": 0.3, "volume": 1.147}
_SLENDER = 2.0
_DEGREE, _MOST, _POINTS = 32, 128, 101
# Largest share of the tension at the rings that may be rounding of stretches near 1.
_KNOWN = 1e-8
STATES = ("radius", "place", "stretch", "angle", "volume")


class Balloon(NamedTuple):
    """A membrane in equilibrium between its rings; lengths over R, volume over unstressed."""

    radius: np.ndarray  # (m,) from the middle to a ring
    place: np.ndarray  # (m,) along the axis, from the middle
    stretch: float  # of the whole, l / L
    volume: float
    loading: float  # kappa
    tension: float  # least along the meridian, over G h per unstressed length
    solution: BoundarySolution


def balloon_problem(held: Given, neo_hookean: float = 1.0) -> BoundaryProblem:
    """Return the problem of half a membrane with a given pressure or volume.

    States `STATES` over the share of the half; the unknown is kappa; given are kappa or the volume,
    the force n, and the length over the radius.
    """
    y, start, end = (ca.SX.sym(name, len(STATES)) for name in ("y", "start", "end"))
    loading, given = ca.SX.sym("kappa"), ca.SX.sym("given", 3)
    amount, pull, slenderness = ca.vertsplit(given)
    radius, _, stretch, angle, _ = ca.vertsplit(y)
    along, around = slopes(stretch, radius, neo_hookean)
    by_stretch, by_both, _ = curvatures(stretch, radius, neo_hookean)
    outward, forward = stretch * ca.sin(angle), stretch * ca.cos(angle)
    rates = ca.vertcat(
        outward,
        forward,
        (around * ca.sin(angle) - by_both * outward) / by_stretch,
        (around * ca.cos(angle) - loading * radius * stretch) / along,
        2 / slenderness * radius**2 * forward,
    )
    tension, _ = slopes(start[2], start[0], neo_hookean)
    conditions = ca.vertcat(
        start[1], start[3], start[4], end[0] - 1,
        tension - loading * start[0] ** 2 / 2 - pull,
        (loading if held == "pressure" else end[4]) - amount,
    )  # fmt: skip
    return BoundaryProblem(
        y, loading, given, slenderness / 2 * rates, start, end, conditions, STATES
    )


def balloon(
    slenderness: float,
    *,
    loading: float | None = None,
    volume: float | None = None,
    pull: float = 0.0,
    neo_hookean: float = 1.0,
) -> Balloon:
    """Return the equilibrium of a membrane of length over radius `slenderness`.

    Give `loading`, kappa, or `volume`, over the unstressed one; `pull` is the force that pulls the
    rings apart over 2 pi R G h.
    """
    if (loading is None) == (volume is None):
        raise ArgumentError("give either loading or volume of a membrane, not both")
    if loading is not None and not pull + loading / 2 > 0:
        raise ArgumentError(
            f"a loading of {loading:g} leaves the wall without tension at a pull of {pull:g}; "
            f"write more than {-2 * pull:g}"
        )
    if loading is not None and np.finfo(float).eps > _KNOWN * (pull + loading / 2):
        raise SolveError(
            "the tension of the wall is lost in rounding", "write more pressure", code="unresolved"
        )
    held, amount = ("pressure", loading) if volume is None else ("volume", volume)
    path = [[_START[held], 0.0, _SLENDER], [amount, pull, slenderness]]
    try:
        problem = balloon_problem(held, neo_hookean)
        found = solve_boundary(problem, _guess, path, degree=_DEGREE, most=_MOST)
    except SolveError as error:
        raise SolveError(
            f"no equilibrium of the membrane was found: {error.reason}",
            "write less pressure, below the limit of inflation; or more, if the membrane wrinkles "
            "or bends only at its rings",
            code=error.code,
        ) from None
    radius, place, stretch, angle, filled = found.at(np.linspace(0.0, 1.0, _POINTS))
    tension, _ = slopes(stretch, radius, neo_hookean)
    if tension.min() <= 0 or np.abs(angle).max() >= np.pi:
        raise SolveError(
            "the membrane is not under tension everywhere, or folds over its rings",
            "write more volume, or less force that pushes the rings together",
            code="wrinkled",
        )
    return Balloon(
        radius, place, float(2 * place[-1] / slenderness), float(filled[-1]), float(found.p[0]),
        float(tension.min()), found,
    )  # fmt: skip


def _guess(s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return states and kappa near those of the start: a parabola, uniformly stretched."""
    kappa = _START["pressure"]
    radius, angle = 1 + kappa / 3 * (1 - s**2), -4 / 3 * kappa / _SLENDER * s
    even = np.full_like(s, 1 + kappa / 4)
    return np.array([radius, _SLENDER / 2 * s, even, angle, s]), np.array([kappa])


NEUTRAL = math.atan(math.sqrt(2))
"""Angle of the largest volume, 54.7356 degrees."""


@dataclass(frozen=True)
class Fibres:
    """A membrane segment between fibres at an angle to the axis, in rad, when unstressed.

    Raises ArgumentError if the angle is not between 0 and a right angle.
    """

    segment: Segment
    angle: float

    def __post_init__(self) -> None:
        if not 0 < self.angle < math.pi / 2:
            raise ArgumentError(
                f"the angle of the fibres is {math.degrees(self.angle):g} degrees; it must be "
                "between 0 and 90"
            )

    def stretches(self, angle: Any) -> tuple[Any, Any]:
        """Return axial stretch and hoop stretch at an angle (rad, number or expression)."""
        return ca.cos(angle) / math.cos(self.angle), ca.sin(angle) / math.sin(self.angle)

    def energy(self, angle: Any) -> Any:
        """Return the elastic energy of the membrane, in J."""
        segment = self.segment
        w = density(*self.stretches(angle), segment.neo_hookean)
        return segment.length * segment.stiffness * w

    def volume(self, angle: Any) -> Any:
        """Return the volume of the round segment, in m³."""
        stretch, hoop = self.stretches(angle)
        return self.segment.volume * stretch * hoop**2

    def pull(self, angle: Any, pressure: Any) -> Any:
        """Return the pull of a pressure (Pa) on the ends, in N: -d(p V)/d length.

        p (b² / 4 pi n²)(3 cos² al - 1) for fibres of length b with n turns.
        """
        section = math.pi * (self.segment.radius / math.sin(self.angle)) ** 2
        return pressure * section * (3 * ca.cos(angle) ** 2 - 1)

    def elastic_pull(self, angle: Any) -> Any:
        """Return the pull of the membrane on the ends, in N: derivative of `energy` by length."""
        along, around = slopes(*self.stretches(angle), self.segment.neo_hookean)
        narrowing = 1 / (ca.tan(angle) * math.tan(self.angle))  # of the hoop, by the stretch
        return self.segment.stiffness * (along - around * narrowing)

    def angle_at(self, pressure: float, load: float = 0.0) -> float:
        """Return the equilibrium angle, in rad, under a pressure (Pa) and a load (N) on the ends.

        The segment shares its fluid; the membrane is bonded to the fibres.
        """

        def surplus(angle: float) -> float:
            return float(self.elastic_pull(angle) + self.pull(angle, pressure) - load)

        low, high = 1e-6 * self.angle, math.pi / 2 - 1e-6 * (math.pi / 2 - self.angle)
        if not surplus(high) <= 0 <= surplus(low):
            raise ArgumentError(
                f"{pressure:g} Pa turn fibres of {math.degrees(self.angle):g} degrees all along or "
                "around the segment; write a lower pressure, or an angle nearer to 45 degrees"
            )
        return root(surplus, low, high, xtol=1e-15 * self.angle)


def fill_at(angle: Any) -> Any:
    """Return the volume of a round segment over the largest, at a fibre angle in rad."""
    return 1.5 * math.sqrt(3) * ca.cos(angle) * ca.sin(angle) ** 2


def range_of_fill(fill: float) -> tuple[float, float]:
    """Return the range of angles of a sealed segment, in rad, at a volume over the largest.

    At 1 both are `NEUTRAL`: it is locked. Raises ArgumentError unless 0 < fill <= 1.
    """
    if not 0 < fill <= 1:
        raise ArgumentError(f"a fill of {fill:g} does not fit between the fibres; write 0 to 1")
    if fill == 1:
        return NEUTRAL, NEUTRAL

    def surplus(angle: float) -> float:
        return float(fill_at(angle)) - fill

    return root(surplus, 0.0, NEUTRAL), root(surplus, NEUTRAL, math.pi / 2)
