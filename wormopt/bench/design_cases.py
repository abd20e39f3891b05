"""Seeded random design problems, such as users write, and the numbers that rivals take from one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from wormopt.systems.spiked.limits import Limits, Rates
from wormopt.systems.spiked.task import Task, Worm

Case = dict[str, Any]
"""``name``, and the tables ``worm`` and ``gait`` of a scene of kind gait-design."""

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


def task_of(case: Case) -> Task:
    """The problem as the designer takes it."""
    gait = dict(case["gait"])
    if isinstance(gait.get("rate"), dict):
        gait["rate"] = Rates(**gait["rate"])
    return Task(Worm(**case["worm"]), Limits(**gait))


def scene_text(case: Case, search: Sequence[str] = ()) -> str:
    """Write a case, with speed as its objective, as the TOML scene a user would write.

    `search`: lines of the table of that name.
    """
    lines = ["schema = 1", 'kind = "gait-design"', "", "[worm]"]
    lines += [f"{key} = {value}" for key, value in case["worm"].items()]
    lines += ["", "[gait]"]
    for key, value in case["gait"].items():
        if isinstance(value, dict):
            lines += [f"{key}.{part} = {numbers}" for part, numbers in value.items()]
        else:
            lines.append(f"{key} = {value}")
    lines += ["", "[objective]", 'maximise = "speed"', "", "[search]", *search]
    return "\n".join(lines) + "\n"
