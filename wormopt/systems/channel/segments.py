"""Shapes of a segment between two coils: assumed, and the elastica by two routes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any

import numpy as np

from wormopt.errors import SolveError
from wormopt.numerics.boundary_values import BoundarySolution, solve_boundary
from wormopt.numerics.chebyshev import resolve
from wormopt.result import Check
from wormopt.systems.channel.closed_forms import SHAPES, ChannelWorm, Shape
from wormopt.systems.channel.curve import Curve, distances, graph_curve
from wormopt.systems.channel.elastica import (
    SLEEVE_RISE,
    Free,
    elastica,
    exact_elastica,
    slender_guess,
)

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
    """Return the elastica, with polynomials up to `degree`.

    Raises SolveError if a sleeve leaves the walls ("no_contact"), or it is not resolved.
    """
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
