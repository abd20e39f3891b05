"""Phases of a stroke: which masses rest in each, and exact ends."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import islice, pairwise, takewhile

import numpy as np
from scipy.optimize import brentq

from wormopt.systems.planar.body.strokes import Stroke
from wormopt.systems.planar.crawling.velocity import Crawler, Motion

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
        return brentq(lambda t: float(self.stroke.at([t])[1][0] @ ahead), start, end, xtol=1e-15)

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
