"""Displacement of a body that crawls slowly on dry ground over a stroke."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError
from wormopt.model.planar_friction import PlanarLaw
from wormopt.systems.planar.body.shape import Shape
from wormopt.systems.planar.body.strokes import Stroke
from wormopt.systems.planar.body.travel import Travel
from wormopt.systems.planar.crawling.panels import Panel, joined, resolve
from wormopt.systems.planar.crawling.phases import Course, Phase, Piece, closed
from wormopt.systems.planar.crawling.velocity import Crawler

# Share of a sampling step at which samples begin, so that none is at an instant of symmetry.
_OFF = (np.sqrt(5) - 1) / 2
_FEWEST, _ROUNDS = 16, 8


@dataclass(frozen=True, eq=False)
class Crawl:
    """Result of `crawl`: one stroke of a slow body.

    Parameters
    ----------
    phases : tuple of Phase
        Parts of the stroke with the same resting masses.
    travel : Travel
        Pose over the stroke, from (0, 0, 0).
    work : float
        Work dissipated by the ground per stroke.
    work_error : float
        Estimated error of the work.
    course : Course
        The body and its stroke, which give the motion at further phases.

    Examples
    --------
    >>> import wormopt as wo
    >>> from wormopt.model.planar_friction import Elliptic
    >>> worm = wo.planar.chain_shape(2, lengths=(1.0, 1.0))
    >>> to_and_fro = wo.planar.Harmonics([0.7], cosine=[[0.5]], sine=[[0.0]])
    >>> found = wo.planar.crawl(worm, Elliptic(1.0, 1.0, 3.0), to_and_fro)
    >>> len(found.phases), round(found.work, 6)
    (2, 3.794466)
    """

    phases: tuple[Phase, ...]
    travel: Travel
    work: float
    work_error: float
    course: Course

    @property
    def displacement(self) -> np.ndarray:
        """x, y and angle (3,) after one stroke, in the frame at its start."""
        return self.travel.displacement

    @property
    def error(self) -> float:
        """Estimated error of the displacement, from its quadrature."""
        return self.travel.error

    @property
    def breaks(self) -> np.ndarray:
        """Phases of the stroke between which the same masses rest, including 0 and 1."""
        return np.array([0.0, *(phase.end for phase in self.phases)])

    @property
    def poses(self) -> np.ndarray:
        """Poses (len(breaks), 3) at the breaks."""
        return self.travel.poses[np.searchsorted(self.travel.ends, self.breaks)]


def crawl(
    shape: Shape,
    laws: PlanarLaw | Sequence[PlanarLaw],
    stroke: Stroke,
    *,
    load: ArrayLike = (0.0, 0.0, 0.0),
    samples: int = 128,
) -> Crawl:
    """Find the displacement of a body that moves so slowly that its inertia does not matter.

    At every instant the body moves with the velocity of least power: the sum of psi_i(v_i) over
    the masses, less the power of the load. This determines which masses rest, and when. Between
    these breaks the motion is analytic in the phase, and Gauss' rule integrates it.

    Theory: docs/theory-planar.md, section 3.

    Parameters
    ----------
    shape : Shape
        Points of the body by its shape variables.
    laws : Elliptic, or sequence of Elliptic
        Friction law of all masses, or of each.
    stroke : Stroke
        Shape variables over a phase from 0 to 1. The result does not depend on its duration.
    load : array_like, shape (3,), optional
        Force on the frame of the body, along its heading and to the left, and moment. The load
        turns with the body, as that of a trailing rope does. Weight on a slope does not turn, so
        motion on a slope differs.
    samples : int, optional
        Initial number of phases at which changes of rest are searched.

    Returns
    -------
    Crawl
        Displacement, work, their errors, and the phases with the same resting masses.

    Raises
    ------
    ArgumentError
        If dimensions differ, or a law has no principle of least power.
    SolveError
        If the ground cannot hold the load, or the motion is not unique.

    Examples
    --------
    >>> import wormopt as wo
    >>> from wormopt.model.planar_friction import Elliptic
    >>> worm = wo.planar.chain_shape(2, lengths=(1.0, 1.0))
    >>> to_and_fro = wo.planar.Polygon([[0.2], [1.2]])
    >>> found = wo.planar.crawl(worm, Elliptic(1.0, 1.0, 3.0), to_and_fro)
    >>> bool(abs(found.displacement).max() < 1e-9)
    True
    """
    crawler = Crawler.of(shape, laws, load)
    if stroke.n_s != len(shape.names):
        raise ArgumentError(
            f"the stroke has {stroke.n_s} variables, but the shape has {len(shape.names)}; "
            "give equal numbers"
        )
    course = Course(crawler, stroke)
    ends = course.breaks
    pieces = [
        Piece(a, b, course.sample(_instants(a, b, samples, len(ends))))
        for a, b in pairwise(ends.tolist())
    ]
    found, panels = _resolved(course, pieces)
    return Crawl(tuple(found), *joined(panels), course)


def _resolved(course: Course, pieces: list[Piece]) -> tuple[list[Phase], list[Panel]]:
    """Return phases of pieces and panels on them, refined until no new phase appears."""
    known: dict[tuple[float, float], list[Panel]] = {}
    found: list[Phase] = []
    for turn in range(_ROUNDS + 1):
        pieces = [replace(piece, seen=closed(course, piece.seen)) for piece in pieces]
        found = [phase for piece in pieces for phase in piece.phases]
        new = [phase for phase in found if (phase.start, phase.end) not in known]
        panels, missed = resolve(course, new, strict=turn < _ROUNDS)
        known |= {(p.start, p.end): own for p, own in zip(new, panels, strict=True) if own}
        if not missed:
            break
        pieces = [piece.joined(missed) for piece in pieces]
    return found, [panel for one in found for panel in known[one.start, one.end]]


def _instants(start: float, end: float, samples: int, breaks: int) -> np.ndarray:
    """Return the initial phases at which changes of rest are searched."""
    count = max(_FEWEST, samples // (breaks - 1))
    return start + (end - start) * (np.arange(count) + _OFF) / count
