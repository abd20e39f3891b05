"""Phases of a stroke: which masses rest in each, and exactly where they end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import islice, pairwise

import numpy as np

from wormopt.numerics.roots import root
from wormopt.systems.planar.body.strokes import Stroke
from wormopt.systems.planar.crawling.velocity import Crawler, Motion

# So near a break, told by a root, both sides are looked at; how often brackets are divided, and
# into how many parts.
_BESIDE, _DIVISIONS, _PARTS = 1e-6, 40, 6
_POINT, _ASIDE = 1e-14, 1e-9
_LOOKS = 64  # at the stroke, for its size


@dataclass(frozen=True, eq=False)
class Phase:
    """A part of a stroke through which the same masses rest and slide, none turning back."""

    start: float
    end: float
    rest: np.ndarray  # (m,), whether a mass rests
    back: np.ndarray  # (m,), whether a mass slides back where it is resisted otherwise than ahead
    twist: np.ndarray  # (3,), somewhere in it


@dataclass(frozen=True, eq=False)
class Sample:
    """What moves how at a phase of the stroke."""

    tau: float
    rest: np.ndarray  # (m,)
    back: np.ndarray  # (m,)
    twist: np.ndarray  # (3,)

    def as_in(self, other: Sample | Phase) -> bool:
        """Whether the same masses rest and slide back."""
        return bool((self.rest == other.rest).all() and (self.back == other.back).all())


@dataclass(frozen=True, eq=False)
class Course:
    """A crawler that goes through a stroke."""

    crawler: Crawler
    stroke: Stroke

    @cached_property
    def sizes(self) -> np.ndarray:
        """What a twist and a power (4,) usually come to over the stroke, by the shape alone."""
        tau = (np.arange(_LOOKS) + 0.5) / _LOOKS
        bodies = self.crawler.bodies(*self.stroke.at(tau))
        length = float(bodies.sizes[:, 2].mean())
        way = max(float(bodies.speed.mean()), _POINT * length)
        return way * np.array([1.0, 1.0, 1 / length, self.crawler.force])

    def sample(self, tau: np.ndarray, near: Sequence[Sample | Phase] | None = None) -> list[Sample]:
        """Which masses rest and slide back at phases, by samples near each if there are."""
        return self.samples_of(tau, self.at(tau, near))

    def at(self, tau: np.ndarray, near: Sequence[Sample | Phase] | None = None) -> Motion:
        """Motion at phases, by the phase."""
        s, ds = self.stroke.at(tau)
        if near is None:
            return self.crawler.move(s, ds)
        rest, twist = (np.array([getattr(one, key) for one in near]) for key in ("rest", "twist"))
        return self.crawler.follow(s, ds, rest, twist)

    def samples_of(self, tau: np.ndarray, motion: Motion) -> list[Sample]:
        """Samples of motions at phases."""
        back = (ahead(motion) < 0) & self.crawler.ground.one_sided & ~motion.rest
        rows = zip(tau, motion.rest, back, motion.twist, strict=True)
        return [Sample(float(t), *row) for t, *row in rows]

    def hold(self, tau: float, rest: np.ndarray, near: Sample) -> Motion:
        """Motion in which some masses are held."""
        s, ds = self.stroke.at(tau)
        return self.crawler.hold(s, ds, rest, near.twist[None])

    def parting(self, tau: float, i: int, j: int) -> float:
        """Rate of half the square of the distance between two masses."""
        s, ds = self.stroke.at(tau)
        return self.crawler.parting(s[0], ds[0], i, j)


@dataclass(frozen=True, eq=False)
class Piece:
    """A smooth piece of a stroke, and what was seen of it."""

    start: float
    end: float
    seen: list[Sample]  # in order

    def joined(self, samples: list[Sample]) -> Piece:
        """With those samples added that lie in it."""
        own = [one for one in samples if self.start < one.tau < self.end]
        return replace(self, seen=sorted([*self.seen, *own], key=lambda one: one.tau))

    @property
    def phases(self) -> list[Phase]:
        """Phases, if samples close in on every break."""
        found: list[Phase] = []
        begin = self.start
        for left, right in pairwise(self.seen):
            if not left.as_in(right):
                found.append(Phase(begin, left.tau, left.rest, left.back, left.twist))
                begin = left.tau
        last = self.seen[-1]
        return [*found, Phase(begin, self.end, last.rest, last.back, last.twist)]


def closed(course: Course, seen: list[Sample]) -> list[Sample]:
    """Add samples until two enclose every break as closely as numbers can."""
    for _ in range(_DIVISIONS):
        gaps = [(a, b) for a, b in pairwise(seen) if not a.as_in(b) and b.tau - a.tau > _POINT]
        if not gaps:
            break
        breaks = [_break(course, a, b) for a, b in gaps]
        asked = [_asked(at, a, b) for at, (a, b) in zip(breaks, gaps, strict=True)]
        tau = np.concatenate(asked)
        near = [
            a if t - a.tau < b.tau - t else b
            for own, (a, b) in zip(asked, gaps, strict=True)
            for t in own
        ]
        looked = iter(course.sample(tau, near))
        for (a, b), at, own in zip(gaps, breaks, asked, strict=True):
            found = list(islice(looked, len(own)))
            if at is not None and found[0].as_in(a) and found[1].as_in(b):
                found = [replace(a, tau=at), replace(b, tau=float(np.nextafter(at, 1.0)))]
            seen += found
        seen = sorted(seen, key=lambda one: one.tau)
    return seen


def _asked(at: float | None, a: Sample, b: Sample) -> np.ndarray:
    """Phases close to both sides of a break; without one, that divide the gap."""
    if at is None:
        return a.tau + (b.tau - a.tau) * np.arange(1, _PARTS) / _PARTS
    aside = min(_BESIDE, (at - a.tau) / 2, (b.tau - at) / 2)
    return np.array([at - aside, at + aside])


def _break(course: Course, left: Sample, right: Sample) -> float | None:
    """Where a change must happen if it is the only one; None where no function tells."""
    function = _teller(course, left, right)
    if function is None:
        return None
    ends = function(left.tau), function(right.tau)
    if not np.isfinite(ends).all() or np.sign(ends[0]) * np.sign(ends[1]) >= 0:
        return None
    try:
        return root(function, left.tau, right.tau)
    except ValueError:  # somewhere between the sets of masses do not fit
        return None


def _teller(course: Course, left: Sample, right: Sample):
    """Function of the phase that changes its sign at the change from one sample to another."""
    stops, starts = right.rest & ~left.rest, left.rest & ~right.rest
    if stops.any() and starts.any():
        pairs = [(int(i), int(j)) for i in np.flatnonzero(starts) for j in np.flatnonzero(stops)]
        # Masses that a rigid link joins never part: their rate is rounding.
        i, j = max(pairs, key=lambda pair: abs(course.parting(left.tau, *pair)))
        return lambda tau: course.parting(tau, i, j)
    if stops.any() or starts.any():
        most = right if stops.any() else left
        return lambda tau: float(course.hold(tau, most.rest, most).hold[0]) - 1
    i = int(np.flatnonzero(left.back != right.back)[0])
    return lambda tau: float(ahead(course.hold(tau, left.rest, left))[0, i])


def ahead(motion: Motion) -> np.ndarray:
    """Velocities (G, m) along the headings, 0 counted as ahead: a neighbour at rest keeps it 0."""
    largest = np.abs(motion.velocities).max(axis=(1, 2))
    return motion.velocities[..., 0] + _ASIDE * largest[:, None]
