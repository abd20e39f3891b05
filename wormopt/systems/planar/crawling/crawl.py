"""Displacement of a body that crawls slowly on dry ground over a stroke, in phases of rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import islice, pairwise, takewhile

import numpy as np
from numpy.polynomial.legendre import legvander
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError
from wormopt.model.planar_friction import PlanarLaw
from wormopt.numerics.roots import root
from wormopt.systems.planar.crawling.velocity import Crawler, Motion
from wormopt.systems.planar.poses import Travel, gauss_nodes, to_series, travel_along
from wormopt.systems.planar.shape import Shape, Stroke

# Accuracy of breaks, and samples within a gap. Thinner phases are left out: as the velocity is
# continuous, they contribute at most their squared width to an integral.
_POINT, _PARTS, THIN = 1e-12, np.arange(1, 10) / 10, 1e-8
_ASIDE = 1e-9
_LEAST, _LOOKS = 1e-14, 64  # at the stroke, for its size
# Samples for reversals between two breaks, and distance from a break at which kinks are ignored.
_TURNS, _ASIDE_OF_BREAKS = 1024, 1e-7


@dataclass(frozen=True, eq=False)
class Phase:
    """A part of a stroke with the same resting and sliding masses and no reversal."""

    start: float
    end: float
    rest: np.ndarray  # (m,), whether a mass rests
    back: np.ndarray  # (m,), whether a mass slides backward with another resistance than forward
    twist: np.ndarray  # (3,), somewhere in the phase


@dataclass(frozen=True, eq=False)
class Sample:
    """Motion at a phase of the stroke."""

    tau: float
    rest: np.ndarray  # (m,)
    back: np.ndarray  # (m,)
    twist: np.ndarray  # (3,)

    def as_in(self, other: Sample | Phase) -> bool:
        """Return whether the same masses rest and slide backward."""
        return bool((self.rest == other.rest).all() and (self.back == other.back).all())


@dataclass(frozen=True, eq=False)
class Course:
    """A crawler with its stroke."""

    crawler: Crawler
    stroke: Stroke

    @cached_property
    def sizes(self) -> np.ndarray:
        """Usual sizes of twist and power (4,) over the stroke, from the shape alone."""
        tau = (np.arange(_LOOKS) + 0.5) / _LOOKS
        bodies = self.crawler.bodies(*self.stroke.at(tau))
        length = float(bodies.sizes[:, 2].mean())
        way = max(float(bodies.speed.mean()), _LEAST * length)
        return way * np.array([1.0, 1.0, 1 / length, self.crawler.force])

    @cached_property
    def breaks(self) -> np.ndarray:
        """Phases between which the motion can be smooth: breaks of the stroke, and reversals.

        The velocity is proportional to the rates of the shape, so it has a kink where all of them
        pass through 0 at once, for example where a single joint reverses.
        """
        found = [self.stroke.breaks]
        for a, b in pairwise(self.stroke.breaks):
            inner = a + (b - a) * (np.arange(_TURNS) + 0.5) / _TURNS
            tau = np.concatenate([[a + _ASIDE_OF_BREAKS], inner, [b - _ASIDE_OF_BREAKS]])
            rates = self.stroke.at(tau)[1]
            back = np.flatnonzero((rates[:-1] * rates[1:]).sum(axis=1) < 0)
            turns = np.array([self._turn(tau[k], tau[k + 1], rates[k]) for k in back])
            kept = (turns > a + _ASIDE_OF_BREAKS) & (turns < b - _ASIDE_OF_BREAKS)
            found.append(turns[kept])
        return np.sort(np.concatenate(found))

    def _turn(self, start: float, end: float, ahead: np.ndarray) -> float:
        """Return the phase at which the rates no longer go `ahead`, as they do at the start."""
        return root(lambda t: float(self.stroke.at([t])[1][0] @ ahead), start, end)

    def sample(self, tau: np.ndarray, near: Sequence[Sample | Phase] | None = None) -> list[Sample]:
        """Return which masses rest and slide backward at phases, from nearby samples if given."""
        return self.samples_of(tau, self.at(tau, near))

    def at(self, tau: np.ndarray, near: Sequence[Sample | Phase] | None = None) -> Motion:
        """Return the motion at phases, by the phase."""
        s, ds = self.stroke.at(tau)
        if near is None:
            return self.crawler.move(s, ds)
        rest, twist = (np.array([getattr(one, key) for one in near]) for key in ("rest", "twist"))
        return self.crawler.follow(s, ds, rest, twist)

    def samples_of(self, tau: np.ndarray, motion: Motion) -> list[Sample]:
        """Return samples of motions at phases."""
        back = (ahead(motion) < 0) & self.crawler.ground.one_sided & ~motion.rest
        rows = zip(tau, motion.rest, back, motion.twist, strict=True)
        return [Sample(float(t), *row) for t, *row in rows]


@dataclass(frozen=True, eq=False)
class Piece:
    """A smooth piece of a stroke, with its samples."""

    start: float
    end: float
    seen: list[Sample]  # in order

    def joined(self, samples: list[Sample]) -> Piece:
        """Return the piece with further samples that lie in it."""
        own = [one for one in samples if self.start < one.tau < self.end]
        return replace(self, seen=sorted([*self.seen, *own], key=lambda one: one.tau))

    @property
    def phases(self) -> list[Phase]:
        """Phases, if samples enclose every break."""
        changes = [k for k, (a, b) in enumerate(pairwise(self.seen)) if not a.as_in(b)]
        stays = [self.seen[k] for k in (*changes, -1)]
        begins = [self.start, *(self.seen[k].tau for k in changes), self.end]
        long = [k for k in range(len(stays)) if begins[k + 1] - begins[k] > THIN]
        starts = [self.start]
        for before, k in pairwise(long):
            while k - 1 > before and (stays[k - 1].rest == stays[k].rest).all():
                k -= 1
            starts.append(begins[k])
        ends = [*starts[1:], self.end]
        return [
            Phase(start, end, stays[k].rest, stays[k].back, stays[k].twist)
            for start, end, k in zip(starts, ends, long, strict=True)
        ]


def closed(course: Course, seen: list[Sample]) -> list[Sample]:
    """Add samples until two enclose every break to machine accuracy."""
    while gaps := [(a, b) for a, b in pairwise(seen) if _open(a, b)]:
        wanted = [a.tau + (b.tau - a.tau) * _PARTS for a, b in gaps]
        sides = zip(wanted, gaps, strict=True)
        near = [a if t - a.tau < b.tau - t else b for own, (a, b) in sides for t in own]
        looked = iter(course.sample(np.concatenate(wanted), near))
        for a, b in gaps:
            found = list(islice(looked, len(_PARTS)))
            seen += found if b.tau - a.tau > THIN else _thinned(found, a, b)
        seen = sorted(seen, key=lambda one: one.tau)
    return seen


def _thinned(found: list[Sample], a: Sample, b: Sample) -> list[Sample]:
    """Return samples of a gap too thin for a phase: up to the end of `a`, then `b`."""
    stays = list(takewhile(lambda one: (one.rest == a.rest).all(), found))
    rest = found[len(stays) :]
    begun = [replace(b, tau=rest[0].tau)] if rest else []
    return [*(replace(a, tau=one.tau) for one in stays), *begun]


def _open(a: Sample, b: Sample) -> bool:
    """Return whether a break between samples is not enclosed."""
    if (a.rest == b.rest).all():  # a reversal is a weaker break: forces do not jump
        return b.tau - a.tau > THIN / 10 and not a.as_in(b)
    return b.tau - a.tau > _POINT


def ahead(motion: Motion) -> np.ndarray:
    """Return velocities (G, m) along headings; 0 counts as forward, beside a resting mass."""
    largest = np.abs(motion.velocities).max(axis=(1, 2))
    return motion.velocities[..., 0] + _ASIDE * largest[:, None]


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


# -- motion at Gauss nodes of panels, refined until polynomials resolve it -------------------------

# Accepted error of a panel, relative to the path of the masses in the body over the stroke; and
# largest number of halvings.
_MISSED, _HALVINGS = 1e-12, 24
# A kink between the outermost nodes and the ends would be missed: polynomials are compared with the
# motion this close to the ends. A kink changes values by its distance from the end, and integrals
# by the square of it.
_END, _LEAPT = 1e-6, 1e-6
_WIDE = 1e2 * THIN  # nodes of narrower panels are so close to breaks that round-off decides rest


@dataclass(frozen=True, eq=False)
class Panel:
    """Twists and powers at the nodes of one panel."""

    start: float
    twist: np.ndarray  # (d, 3)
    power: np.ndarray  # (d,)
    missed: np.ndarray  # (4,), errors of the integrals of twist and power


def joined(panels: Sequence[Panel]) -> tuple[Travel, float, float]:
    """Return the pose over consecutive panels up to 1, work, and error of work."""
    ends = np.array([*(one.start for one in panels), 1.0])
    missed = np.sum([one.missed for one in panels], axis=0)
    course = travel_along(ends, np.array([one.twist for one in panels]), 0.0)
    # An error of the angle changes the direction of the remaining path.
    error = float(missed[:2].max() + missed[2] * max(1.0, np.abs(course.poses[:, :2]).max()))
    power = np.concatenate([one.power for one in panels])
    return replace(course, error=error), float(course.weights @ power), float(missed[3])


def resolve(
    course: Course, found: list[Phase], *, strict: bool
) -> tuple[list[list[Panel]], list[Sample]]:
    """Return panels of each phase, halved until polynomials resolve the motion.

    If a node shows other resting masses than its phase, the panel's samples are also returned, so
    that the phases can be found again; that phase has no panels. If not `strict`, resting masses
    are ignored: halving also resolves breaks, but more slowly.
    """
    seen: list[Sample] = []
    done: list[list[Panel]] = [[] for _ in found]
    wrong = np.zeros(len(found), bool)
    start, end = (np.array([getattr(one, key) for one in found]) for key in ("start", "end"))
    of = np.arange(len(found))
    for halving in range(_HALVINGS + 1):
        if not of.size:
            break
        tau = gauss_nodes(start, end)
        guess = [found[k] for k in of for _ in tau[0]]
        motion = course.at(tau.ravel(), guess)
        samples = course.samples_of(tau.ravel(), motion)
        twist, power = motion.twist.reshape(*tau.shape, 3), motion.power.reshape(tau.shape)
        missed = _missed(twist, power) * (end - start)[:, None]
        fine = np.all(missed <= _MISSED * course.sizes, axis=1)
        held = np.flatnonzero(fine & (end - start > _WIDE))
        fine[held] = _follows(
            course, start[held], end[held], [found[k] for k in of[held]], twist[held], power[held]
        )
        fine |= halving == _HALVINGS
        for j, k in enumerate(of):
            own = samples[j * tau.shape[1] : (j + 1) * tau.shape[1]]
            wide = strict and end[j] - start[j] > _WIDE
            if wide and not all(one.as_in(found[k]) for one in own):
                seen += own
                wrong[k] = True
            elif fine[j]:
                done[k].append(Panel(float(start[j]), twist[j], power[j], missed[j]))
        again = ~fine & ~wrong[of]
        middle = (start + end)[again] / 2
        start, end = np.append(start[again], middle), np.append(middle, end[again])
        of = np.tile(of[again], 2)
    for k in np.flatnonzero(wrong):
        done[k] = []
    return [sorted(panels, key=lambda one: one.start) for panels in done], seen


def _missed(twist: np.ndarray, power: np.ndarray) -> np.ndarray:
    """Return the last coefficients (K, 4) of the Legendre series of twists and powers."""
    values = np.concatenate([twist, power[..., None]], axis=2)
    last = np.einsum("kd,pdc->pkc", to_series()[-2:], values)
    return np.abs(last).max(axis=1)


def _follows(
    course: Course, start: np.ndarray, end: np.ndarray, within: list[Phase],
    twist: np.ndarray, power: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Return whether the polynomials of K panels agree with the motion near their ends."""
    if not within:
        return np.zeros(0, bool)
    tau = start[:, None] + (end - start)[:, None] * np.array([_END, 1 - _END])
    motion = course.at(tau.ravel(), [phase for phase in within for _ in tau[0]])
    there = np.column_stack([motion.twist, motion.power]).reshape(*tau.shape, 4)
    to_ends = legvander(np.array([2 * _END - 1, 1 - 2 * _END]), twist.shape[1] - 1) @ to_series()
    led = np.einsum("ed,kdc->kec", to_ends, np.concatenate([twist, power[..., None]], axis=2))
    return np.all(np.abs(led - there) <= _LEAPT * course.sizes, axis=(1, 2))
