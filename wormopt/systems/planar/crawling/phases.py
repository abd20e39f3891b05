"""Phases of a stroke: which masses rest in each, and exactly where they end."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from wormopt.numerics.roots import root
from wormopt.systems.planar.body.strokes import Stroke
from wormopt.systems.planar.crawling.velocity import Crawler, Motion

# So near a break, told by a root, both sides are looked at; and how often brackets are divided.
_BESIDE, _DIVISIONS = 1e-6, 30


@dataclass(frozen=True, eq=False)
class Phase:
    """A part of a stroke through which the same masses rest and slide, none turning back."""

    start: float
    end: float
    rest: np.ndarray  # (m,), whether a mass rests
    back: np.ndarray  # (m,), whether a mass slides back where it is resisted otherwise than ahead


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

    def sample(self, tau: np.ndarray, near: list[Sample] | None = None) -> list[Sample]:
        """Which masses rest and slide back at phases, by samples near each if there are."""
        return self.samples_of(tau, self.at(tau, near))

    def at(self, tau: np.ndarray, near: list[Sample] | None = None) -> Motion:
        """Motion at phases, by the phase."""
        s, ds = self.stroke.at(tau)
        if near is None:
            return self.crawler.move(s, ds)
        rest, twist = (np.array([getattr(one, key) for one in near]) for key in ("rest", "twist"))
        return self.crawler.follow(s, ds, rest, twist)

    def samples_of(self, tau: np.ndarray, motion: Motion) -> list[Sample]:
        """Samples of motions at phases."""
        back = (motion.velocities[..., 0] < 0) & self.crawler.ground.one_sided & ~motion.rest
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


def phases_of(seen: list[Sample], start: float, end: float) -> list[Phase]:
    """Phases from samples on both sides of every break."""
    found: list[Phase] = []
    begin = start
    for left, right in pairwise(seen):
        if not left.as_in(right):
            at = (left.tau + right.tau) / 2
            found.append(Phase(begin, at, left.rest, left.back))
            begin = at
    return [*found, Phase(begin, end, seen[-1].rest, seen[-1].back)]


def closed(course: Course, seen: list[Sample]) -> list[Sample]:
    """Add samples until two enclose every break as closely as numbers can."""
    found = seen[:1]
    for right in seen[1:]:
        found += _between(course, found[-1], right, _DIVISIONS) + [right]
    return found


def _between(course: Course, left: Sample, right: Sample, deep: int) -> list[Sample]:
    """Samples that close in on the breaks between two."""
    if left.as_in(right) or right.tau - left.tau < 1e-14 or not deep:
        return []
    at = _break(course, left, right)
    if at is None:
        at = (left.tau + right.tau) / 2
        middle = course.sample(np.array([at]))
    else:
        aside = min(_BESIDE, (at - left.tau) / 2, (right.tau - at) / 2)
        beside = np.array([at - aside, at + aside])
        before, after = course.sample(beside, [left, right])
        if before.as_in(left) and after.as_in(right):
            pair = np.nextafter(at, [0.0, 1.0])
            return [
                Sample(float(t), one.rest, one.back, one.twist)
                for t, one in zip(pair, (left, right), strict=True)
            ]
        middle = [before, after]
    chain = [left, *middle, right]
    found: list[Sample] = []
    for a, b in pairwise(chain):
        found += _between(course, a, b, deep - 1) + [b]
    return found[:-1]


def _break(course: Course, left: Sample, right: Sample) -> float | None:
    """Where a change must happen if it is the only one; None where no function tells."""
    function = _teller(course, left, right)
    if function is None:
        return None
    ends = function(left.tau), function(right.tau)
    if not np.isfinite(ends).all() or np.sign(ends[0]) * np.sign(ends[1]) >= 0:
        return None
    return root(function, left.tau, right.tau)


def _teller(course: Course, left: Sample, right: Sample):
    """Function of the phase that changes its sign at the change from one sample to another."""
    stops, starts = right.rest & ~left.rest, left.rest & ~right.rest
    if stops.any() and starts.any():
        i, j = int(np.flatnonzero(starts)[0]), int(np.flatnonzero(stops)[0])
        return lambda tau: course.parting(tau, i, j)
    if stops.any() or starts.any():
        most = right if stops.any() else left
        return lambda tau: float(course.hold(tau, most.rest, most).hold[0]) - 1
    i = int(np.flatnonzero(left.back != right.back)[0])
    return lambda tau: float(course.hold(tau, left.rest, left).velocities[0, i, 0])
