"""The true shape of a membrane between rings of its own radius R, under pressure.

Lengths are over R. With S the unstressed distance from the middle to a ring, phi the angle of the
meridian to the axis and n the force on the rings over 2 pi R G h: tension w_1(lam_1, rho) along the
meridian,

    rho' = lam_1 sin phi,   zeta' = lam_1 cos phi,   w_1' = w_2 sin phi,
    w_1 phi' = w_2 cos phi - kappa rho lam_1,   w_1 cos phi - kappa rho² / 2 = n.

The last equation is the axial balance and holds everywhere; it is imposed in the middle. Either the
pressure is given, or the volume, which then determines the pressure. The membrane must be under
tension everywhere: it is thin, and would wrinkle. Source: docs/theory-peristaltic.md.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError, SolveError
from wormopt.numerics.boundary_values import BoundaryProblem, BoundarySolution, solve_boundary
from wormopt.systems.peristaltic.segment.rubber import curvatures, slopes

Given = Literal["pressure", "volume"]
# Start of the continuation of solutions: a short, strongly inflated membrane.
_START: dict[str, float] = {"pressure": 0.3, "volume": 1.147}
_SLENDER = 2.0
_DEGREE, _MOST, _POINTS = 32, 128, 101
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
    rings apart over 2 pi R G h. Raises ArgumentError if both or neither are given, or if the
    pressure leaves the wall without tension; SolveError if no equilibrium is found.
    """
    if (loading is None) == (volume is None):
        raise ArgumentError("give either loading or volume of a membrane, not both")
    if loading is not None and not pull + loading / 2 > 0:
        raise ArgumentError(
            f"a loading of {loading:g} leaves the wall without tension at a pull of {pull:g}; "
            f"write more than {-2 * pull:g}"
        )
    held, amount = ("pressure", loading) if volume is None else ("volume", volume)
    path = [[_START[held], 0.0, _SLENDER], [amount, pull, slenderness]]
    try:
        problem = balloon_problem(held, neo_hookean)
        found = solve_boundary(problem, _guess, path, degree=_DEGREE, most=_MOST)
    except SolveError as error:
        raise SolveError(
            f"no equilibrium of the membrane was found: {error.reason}",
            "write less pressure, below the limit of inflation, or more, as it may bend only at "
            "its rings or wrinkle",
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
