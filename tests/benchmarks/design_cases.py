"""Seeded random design problems, such as users write, and the judge of their solutions.

The judge takes motions of piecewise linear velocities, in closed form; it shares no code with the
designer or with `crawl`.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from wormopt.systems.spiked.gait_problem import GaitProblem, Worm
from wormopt.systems.spiked.limits import Limits, Rates

Case = dict[str, Any]
"""``name``, and the tables ``worm`` and ``gait`` of a scene of kind gait-design."""

Course = list[tuple[float, float]]
"""Seconds since the start, and the best speed known by then."""

_REST = 1e-9  # velocities below are none, as parts of the largest

G1: Case = {
    "name": "g1",
    "worm": {"links": 2, "mass": 1.0, "drag": 0.0, "load": 5.0},
    "gait": {
        "period": 1.0,
        "resting": 1,
        "length": [0.7, 1.3],
        "rate": 1.0,
        "acceleration": 20.0,
    },
}
"""The benchmark whose optimum is known, 14 sqrt(1394)/125 - 839/250."""


@dataclass(frozen=True, eq=False)
class Arrays:
    """A design problem of n links as arrays."""

    mass: np.ndarray  # (n + 1,) head first
    drag: float  # of every mass
    load: float  # of every mass
    period: tuple[float, float]  # shortest and longest
    resting: int  # least number of resting masses
    length: np.ndarray  # (n, 2) shortest and longest of each link
    contraction: np.ndarray  # (n,) largest rates
    extension: np.ndarray  # (n,) largest rates
    acceleration: np.ndarray  # (n,) largest, of each link
    spike_load: float  # largest load of a spike; inf: no limit

    @classmethod
    def of(cls, case: Case) -> Arrays:
        """Read the tables of a case.

        Its length, rate and acceleration are given, its spike load is one number.
        """
        worm, gait = case["worm"], case["gait"]
        n, rate = worm["links"], gait["rate"]
        both = rate if isinstance(rate, dict) else {"contraction": rate, "extension": rate}
        shortest, longest = np.broadcast_to(gait["period"], 2).tolist()
        return cls(
            np.broadcast_to(np.asarray(worm["mass"], float), n + 1),
            worm.get("drag", 0.0),
            worm.get("load", 0.0),
            (shortest, longest),
            gait.get("resting", 1),
            np.broadcast_to(np.asarray(gait["length"], float), (n, 2)),
            np.broadcast_to(np.asarray(both["contraction"], float), n),
            np.broadcast_to(np.asarray(both["extension"], float), n),
            np.broadcast_to(np.asarray(gait["acceleration"], float), n),
            float(np.min(gait.get("spike_load", np.inf))),
        )

    @property
    def links(self) -> int:
        """Number of links n."""
        return len(self.length)

    @property
    def static_load(self) -> float:
        """Load of all masses."""
        return (self.links + 1) * self.load

    @property
    def fastest(self) -> np.ndarray:
        """Velocity that no mass exceeds while some other rests, shape (n + 1,)."""
        ahead = np.append(0.0, np.cumsum(self.extension))
        behind = np.append(0.0, np.cumsum(self.contraction))
        return np.maximum(ahead[-1] - ahead, behind)

    def resting_sets(self) -> list[tuple[int, ...]]:
        """Sets of masses that may be told to rest: larger ones only where they share a load."""
        more = 2 if np.isfinite(self.spike_load) else 1
        sizes = range(self.resting, min(self.resting + more, self.links + 1))
        return [s for size in sizes for s in combinations(range(self.links + 1), size)]


def draw(seed: int, count: int) -> list[Case]:
    """Draw random design problems.

    A seed gives the same problems always; a larger `count` begins with the same ones.
    """
    return [_drawn(f"s{seed}-{k:02}", np.random.default_rng([seed, k])) for k in range(count)]


def _drawn(name: str, rng: np.random.Generator) -> Case:
    n = int(rng.choice([2, 3, 4, 5], p=[0.4, 0.3, 0.2, 0.1]))
    alike = rng.random() < 0.7
    worm: dict[str, Any] = {
        "links": n,
        "mass": 1.0 if alike else _some(rng, 0.5, 2.0, n + 1),
        "drag": 0.0 if rng.random() < 0.6 else _one(rng, 0.05, 1.0),
        "load": _one(rng, 2.0, 10.0),
    }
    length, width = _length(rng, n)
    rate, quickest = _rate(rng, n)
    acceleration = _rounded(float(np.exp(rng.uniform(np.log(4.0), np.log(70.0)))))
    # out and back at the largest rate, with time to reach it
    stroke = 2 * (width / quickest + quickest / acceleration)
    gait: dict[str, Any] = {
        "period": _period(rng, stroke),
        "resting": 2 if rng.random() < 0.2 else 1,
        "length": length,
        "rate": rate,
        "acceleration": acceleration,
    }
    if rng.random() < 0.3:
        gait["spike_load"] = _rounded((n + 1) * worm["load"] * float(rng.uniform(1.1, 3.0)))
    return {"name": name, "worm": worm, "gait": gait}


def _length(rng: np.random.Generator, n: int) -> tuple[list[Any], float]:
    """Alike or per link, and the mean width of the ranges."""
    low = _one(rng, 0.5, 0.9)
    if rng.random() < 0.7:
        high = _rounded(low + float(rng.uniform(0.2, 0.7)))
        return [low, high], high - low
    highs = [_rounded(low + float(rng.uniform(0.2, 0.7))) for _ in range(n)]
    return [[low, high] for high in highs], float(np.mean(highs)) - low


def _rate(rng: np.random.Generator, n: int) -> tuple[Any, float]:
    """Alike, per link, or apart for both directions; and their mean."""
    form = rng.choice(["alike", "links", "both"], p=[0.6, 0.15, 0.25])
    if form == "alike":
        rate = _one(rng, 0.6, 1.8)
        return rate, rate
    one = _some(rng, 0.6, 1.8, n)
    if form == "links":
        return one, float(np.mean(one))
    other = _some(rng, 0.6, 1.8, n)
    return {"contraction": one, "extension": other}, float(np.mean(one + other))


def _period(rng: np.random.Generator, stroke: float) -> Any:
    """Fixed, from well below to several times a stroke, or a range about it."""
    if rng.random() < 0.7:
        return _rounded(stroke * float(np.exp(rng.uniform(np.log(0.4), np.log(5.0)))))
    shortest = stroke * float(rng.uniform(0.4, 1.0))
    return [_rounded(shortest), _rounded(shortest * float(rng.uniform(1.3, 2.8)))]


def _some(rng: np.random.Generator, low: float, high: float, count: int) -> list[float]:
    return [_one(rng, low, high) for _ in range(count)]


def _one(rng: np.random.Generator, low: float, high: float) -> float:
    return _rounded(float(rng.uniform(low, high)))


def _rounded(value: float) -> float:
    return float(f"{value:.3g}")


def task_of(case: Case) -> GaitProblem:
    """The problem as the designer takes it."""
    gait = dict(case["gait"])
    if isinstance(gait.get("rate"), dict):
        gait["rate"] = Rates(**gait["rate"])
    return GaitProblem(Worm(**case["worm"]), Limits(**gait))


# -- the judge -----------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Motion:
    """One cycle; velocities are linear within arcs, and periodic."""

    durations: np.ndarray  # (arcs,)
    velocities: np.ndarray  # (arcs, n + 1) of all masses where each arc begins
    lengths: np.ndarray  # (n,) of the links where the first arc begins

    @property
    def period(self) -> float:
        """Duration of the cycle."""
        return float(self.durations.sum())

    @property
    def speed(self) -> float:
        """Slowest mean speed of any mass; the same for all where lengths are periodic."""
        return float((self.durations @ self._means).min() / self.period)

    @property
    def _means(self) -> np.ndarray:
        return (self.velocities + np.roll(self.velocities, -1, axis=0)) / 2

    def excess(self, limits: Arrays) -> dict[str, float]:
        """Excess over every limit relative to its size, not positive where it holds.

        Extremes are those of the linear and quadratic functions on all arcs, not of samples.
        Vanishing arcs are judged by the change of velocities, not by a quotient.
        """
        h, start = self.durations[:, None], self.velocities
        end = np.roll(start, -1, axis=0)
        rate, later = -np.diff(start), -np.diff(end)
        fastest = float(limits.fastest.max())
        low, high = -limits.contraction, limits.extension
        reach = limits.acceleration * h
        still = (np.maximum(start, end) <= _REST * fastest).sum(axis=1)
        return {
            "period": self._off_period(limits),
            "velocity": float(-start.min()) / fastest,
            "resting": float(limits.resting - still[self.durations > 0].min()),
            "rate": float(np.maximum(low - rate, rate - high).max()) / fastest,
            "acceleration": float((np.abs(later - rate) - reach).max()) / fastest,
            **self._length_excess(rate, later, limits),
            **self._force_excess(start, end, still, limits),
        }

    def worst(self, limits: Arrays) -> float:
        """Largest excess over any limit, relative to its size."""
        return max(self.excess(limits).values())

    def _off_period(self, limits: Arrays) -> float:
        """How far whole numbers of cycles miss the allowed periods."""
        shortest, longest = limits.period
        counts = np.unique([max(1, round(p / self.period)) for p in limits.period])
        counts = np.arange(counts[0], counts[-1] + 1)
        totals = counts * self.period
        return float(np.maximum(shortest - totals, totals - longest).min()) / longest

    def _length_excess(
        self, rate: np.ndarray, later: np.ndarray, limits: Arrays
    ) -> dict[str, float]:
        h = self.durations[:, None]
        begin = self.lengths + np.vstack(
            [np.zeros(limits.links), np.cumsum(h * (rate + later) / 2, axis=0)]
        )
        # the quadratic turns within an arc whose rate changes its sign
        turns = rate * later < 0
        share = np.where(turns, rate / np.where(turns, rate - later, 1.0), 0.0)
        inner = begin[:-1] + h * share * rate / 2
        every = np.vstack([begin, inner])
        size = limits.length[:, 1]
        over = np.maximum(limits.length[:, 0] - every, every - size) / size
        closed = np.abs(begin[-1] - begin[0]) / size
        return {"length": float(over.max()), "closed": float(closed.max())}

    def _force_excess(
        self, start: np.ndarray, end: np.ndarray, still: np.ndarray, limits: Arrays
    ) -> dict[str, float]:
        """Momentum that the spikes give on each arc, were its force that of its start or end."""
        h = self.durations
        gained = (end - start) @ limits.mass + h * limits.static_load
        given = [gained + h * limits.drag * v.sum(axis=1) for v in (start, end)]
        size = float(limits.mass.sum() * limits.fastest.max())
        found = {"sigma": float(-np.min(given)) / size}
        if np.isfinite(limits.spike_load):
            most = limits.spike_load * still * h
            found["spike_load"] = float(np.max(np.array(given) - most)) / size
        return found
