"""Motion along a stroke as polynomials on panels, and where it leads."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wormopt.systems.planar.body.se2 import rotate
from wormopt.systems.planar.crawling.phases import Course, Phase, Sample

_DEGREE = 15
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(_DEGREE + 1)
_TO_SERIES = np.linalg.inv(np.polynomial.legendre.legvander(_NODES, _DEGREE))
# Last coefficients of a resolved panel, as a share of the largest; and how often one is halved.
_RESOLVED, _HALVINGS = 1e-11, 12


def _integrals() -> np.ndarray:
    """Matrix of the integrals from -1 to each node, by values at the nodes."""
    legendre = np.polynomial.legendre
    rows = [legendre.legval(_NODES, legendre.legint(c, lbnd=-1)) for c in np.eye(_DEGREE + 1)]
    return np.array(rows).T @ _TO_SERIES


_INTEGRATE = _integrals()


@dataclass(frozen=True, eq=False)
class Panels:
    """Twists and powers at Gauss' nodes of p panels that follow each other."""

    ends: np.ndarray  # (p + 1,)
    twist: np.ndarray  # (p, q, 3)
    power: np.ndarray  # (p, q)

    @property
    def work(self) -> float:
        """Integral of the power."""
        return float(self.power @ _WEIGHTS @ np.diff(self.ends) / 2)

    @property
    def tau(self) -> np.ndarray:
        """Phases of the nodes (p, q)."""
        return nodes(self.ends[:-1], self.ends[1:])

    @property
    def angles(self) -> np.ndarray:
        """Angles at the nodes (p, q)."""
        half = np.diff(self.ends)[:, None] / 2
        inner = self.twist[..., 2] @ _INTEGRATE.T * half
        return self.all_poses[:-1, 2:] + inner

    @property
    def all_poses(self) -> np.ndarray:
        """Poses (p + 1, 3) at the ends of the panels."""
        half = np.diff(self.ends) / 2
        turns = np.concatenate([[0.0], np.cumsum(self.twist[..., 2] @ _WEIGHTS * half)])
        inner = self.twist[..., 2] @ _INTEGRATE.T * half[:, None]
        way = rotate(turns[:-1, None] + inner, self.twist[..., :2])
        moves = np.einsum("pqc,q,p->pc", way, _WEIGHTS, half)
        places = np.vstack([np.zeros((1, 2)), np.cumsum(moves, axis=0)])
        return np.column_stack([places, turns])

    def poses(self, ends: np.ndarray) -> np.ndarray:
        """Poses at some of the ends."""
        return self.all_poses[np.searchsorted(self.ends, ends)]


def nodes(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Phases (p, q) of Gauss' nodes between starts and ends (p,)."""
    return start[:, None] + (end - start)[:, None] * (_NODES + 1) / 2


def resolve(course: Course, found: list[Phase]) -> tuple[Panels, list[Sample]]:
    """Panels of phases, halved until polynomials follow the motion.

    Where a node shows that other masses rest than the phase has it, the samples of the panel are
    given beside, for the phases to be found anew.
    """
    missed: list[Sample] = []
    done: list[tuple[float, np.ndarray, np.ndarray]] = []
    open_ = [(phase.start, phase.end, phase) for phase in found]
    for halving in range(_HALVINGS + 1):
        if not open_:
            break
        start, end = (np.array([one[k] for one in open_]) for k in (0, 1))
        tau = nodes(start, end)
        guess = [Sample(0.0, p.rest, p.back, p.twist) for *_, p in open_ for _ in _NODES]
        motion = course.at(tau.ravel(), guess)
        samples = course.samples_of(tau.ravel(), motion)
        twist = motion.twist.reshape(*tau.shape, 3)
        power = motion.power.reshape(tau.shape)
        fine = _fine(twist, power) | (halving == _HALVINGS)
        again: list[tuple[float, float, Phase]] = []
        for k, (a, b, phase) in enumerate(open_):
            own = samples[k * len(_NODES) : (k + 1) * len(_NODES)]
            if not all(one.as_in(phase) for one in own):
                missed += own
            if fine[k]:
                done.append((a, twist[k], power[k]))
            else:
                middle = (a + b) / 2
                again += [(a, middle, phase), (middle, b, phase)]
        if missed:
            break
        open_ = again
    done.sort(key=lambda one: one[0])
    ends = np.array([one[0] for one in done] + [found[-1].end])
    return (
        Panels(ends, np.array([one[1] for one in done]), np.array([one[2] for one in done])),
        missed,
    )


def _fine(twist: np.ndarray, power: np.ndarray) -> np.ndarray:
    """Whether polynomials follow the motion on panels (p,)."""
    values = np.concatenate([twist, power[..., None]], axis=2)
    series = np.einsum("kq,pqc->pkc", _TO_SERIES, values)
    last = np.abs(series[:, -2:]).max(axis=1)
    return (last <= _RESOLVED * np.abs(values).max(axis=(0, 1))).all(axis=1)
