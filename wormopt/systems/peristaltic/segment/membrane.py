"""The true shape of a membrane between rings of its own radius R, under pressure: no guess in it.

Over R, with S the unstressed place from the middle to a ring, phi the angle of the meridian to the
axis and n the force on the rings over 2 pi R G h: tension w_1(lam_1, rho) along the meridian,

    rho' = lam_1 sin phi,   zeta' = lam_1 cos phi,   w_1' = w_2 sin phi,
    w_1 phi' = w_2 cos phi - kappa rho lam_1,   w_1 cos phi - kappa rho² / 2 = n.

The last is the balance along the axis and holds at every place; it is asked for in the middle. The
pressure is given, or the volume, and then the pressure is what holds it. The membrane must be under
tension throughout: it is thin, and would wrinkle. Source: docs/theory-peristaltic.md.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError, SolveError
from wormopt.model.boundary import BoundaryProblem
from wormopt.numerics.boundary_values import BoundarySolution, solve_boundary
from wormopt.systems.peristaltic.segment.rubber import curvatures, slopes

Given = Literal["pressure", "volume"]
# Solutions are followed from here, a short membrane well inflated.
_START: dict[str, float] = {"pressure": 0.3, "volume": 1.147}
_SLENDER = 2.0
_DEGREE, _MOST, _POINTS = 32, 128, 101
STATES = ("radius", "place", "stretch", "angle", "volume")


class Balloon(NamedTuple):
    """A membrane at rest between its rings; lengths over R, the volume over the unstressed one."""

    radius: np.ndarray  # (m,) from the middle to a ring
    place: np.ndarray  # (m,) along the axis, from the middle
    stretch: float  # of the whole, l / L
    volume: float
    loading: float  # kappa
    tension: float  # least along the meridian, over G h per unstressed length
    solution: BoundarySolution


def balloon_problem(held: Given, neo_hookean: float = 1.0) -> BoundaryProblem:
    """State the problem of half a membrane under a given pressure or round a given volume.

    States `STATES` over the share of the half; unknown is kappa; given are kappa or the volume,
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
    """Shape at rest of a membrane of length over radius `slenderness`.

    Give `loading`, kappa, or `volume`, over the unstressed one; `pull` is the force that pulls the
    rings apart over 2 pi R G h. Raises ArgumentError if both or neither are given, or the pressure
    leaves the wall no tension; SolveError where no rest is found.
    """
    if (loading is None) == (volume is None):
        raise ArgumentError("give either the loading or the volume of a membrane")
    if loading is not None and not pull + loading / 2 > 0:
        raise ArgumentError(
            f"a loading of {loading:g} leaves the wall no tension under a pull of {pull:g}; "
            f"write more than {-2 * pull:g}"
        )
    held, amount = ("pressure", loading) if volume is None else ("volume", volume)
    path = [[_START[held], 0.0, _SLENDER], [amount, pull, slenderness]]
    try:
        problem = balloon_problem(held, neo_hookean)
        found = solve_boundary(problem, _guess, path, degree=_DEGREE, most=_MOST)
    except SolveError as error:
        raise SolveError(
            f"no rest of the membrane was found: {error.reason}",
            "take less pressure, beyond whose limit it swells by itself, or more, without which "
            "it bends at its rings only, or wrinkles",
            code=error.code,
        ) from None
    radius, place, stretch, angle, filled = found.at(np.linspace(0.0, 1.0, _POINTS))
    tension, _ = slopes(stretch, radius, neo_hookean)
    if tension.min() <= 0 or np.abs(angle).max() >= np.pi:
        raise SolveError(
            "the membrane is not under tension throughout, or folds over its rings",
            "take more volume, or less force that pushes the rings together",
            code="wrinkled",
        )
    return Balloon(
        radius, place, float(2 * place[-1] / slenderness), float(filled[-1]), float(found.p[0]),
        float(tension.min()), found,
    )  # fmt: skip


def _guess(s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """States and kappa near those of the start: a parabola, evenly stretched."""
    kappa = _START["pressure"]
    radius, angle = 1 + kappa / 3 * (1 - s**2), -4 / 3 * kappa / _SLENDER * s
    even = np.full_like(s, 1 + kappa / 4)
    return np.array([radius, _SLENDER / 2 * s, even, angle, s]), np.array([kappa])
