"""Seeded random design problems, such as users write, and the numbers that rivals take from one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from wormopt.systems.spiked.limits import Limits, Rates
from wormopt.systems.spiked.task import Task, Worm

__all__ = ["G1", "Arrays", "Case", "draw", "scene_text", "task_of"]

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
    """A design problem as arrays.

    Parameters
    ----------
    mass : ndarray, shape (n + 1,)
        Masses, head first.
    drag, load : float
        Of every mass.
    period : tuple of two floats
        Shortest and longest.
    resting : int
        At least so many masses rest.
    length : ndarray, shape (n, 2)
        Shortest and longest length of each link.
    contraction, extension, acceleration : ndarray, shape (n,)
        Largest rates and accelerations of each link.
    spike_load : float
        Largest load of a spike, infinite without a limit.
    """

    mass: np.ndarray
    drag: float
    load: float
    period: tuple[float, float]
    resting: int
    length: np.ndarray
    contraction: np.ndarray
    extension: np.ndarray
    acceleration: np.ndarray
    spike_load: float

    @classmethod
    def of(cls, case: Case) -> Arrays:
        """Read the tables of a case.

        Parameters
        ----------
        case : Case
            Its length, rate and acceleration are given, its spike load is one number.

        Returns
        -------
        Arrays

        Examples
        --------
        >>> Arrays.of(G1).extension
        array([1., 1.])
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
        """Sets of masses that may be told to rest: larger ones only where they share a load.

        Returns
        -------
        list of tuple of int
        """
        more = 2 if np.isfinite(self.spike_load) else 1
        sizes = range(self.resting, min(self.resting + more, self.links + 1))
        return [s for size in sizes for s in combinations(range(self.links + 1), size)]


def draw(seed: int, count: int) -> list[Case]:
    """Draw random design problems.

    Parameters
    ----------
    seed : int
        The same seed gives the same problems, and more of them the same first ones.
    count : int
        How many.

    Returns
    -------
    list of Case

    Examples
    --------
    >>> draw(3, 2) == draw(3, 5)[:2]
    True
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
    """The problem as the designer takes it.

    Parameters
    ----------
    case : dict
        The problem.

    Examples
    --------
    >>> task_of(G1).worm.links
    2
    """
    gait = dict(case["gait"])
    if isinstance(gait.get("rate"), dict):
        gait["rate"] = Rates(**gait["rate"])
    return Task(Worm(**case["worm"]), Limits(**gait))


def scene_text(case: Case, search: Sequence[str] = ()) -> str:
    """Write a case as the scene that a user would write.

    Parameters
    ----------
    case : Case
        The problem; its objective is speed.
    search : sequence of str, optional
        Lines of the table ``search``.

    Returns
    -------
    str
        TOML.

    Examples
    --------
    >>> print(scene_text(G1).splitlines()[4])
    links = 2
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
