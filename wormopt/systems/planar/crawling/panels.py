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


@dataclass(frozen=True, eq=False)
class Panel:
    """Twists and powers at the nodes of one panel."""

    start: float
    twist: np.ndarray  # (q, 3)
    power: np.ndarray  # (q,)


def joined(panels: list[Panel], end: float) -> Panels:
    """Panels that follow each other, to the last one's end."""
    ends = np.array([*(one.start for one in panels), end])
    twist, power = (np.array([getattr(one, key) for one in panels]) for key in ("twist", "power"))
    return Panels(ends, twist, power)


def resolve(course: Course, found: list[Phase]) -> tuple[list[list[Panel]], list[Sample]]:
    """Panels of each phase, halved until polynomials follow the motion.

    Where a node shows that other masses rest than the phase has it, the samples of the panel are
    given beside, for the phases to be found anew; that phase has no panels.
    """
    missed: list[Sample] = []
    done: list[list[Panel]] = [[] for _ in found]
    wrong = np.zeros(len(found), bool)
    open_ = [(phase.start, phase.end, k) for k, phase in enumerate(found)]
    for halving in range(_HALVINGS + 1):
        if not open_:
            break
        start, end = (np.array([one[j] for one in open_]) for j in (0, 1))
        tau = nodes(start, end)
        guess = [_middle(found[k]) for *_, k in open_ for _ in _NODES]
        motion = course.at(tau.ravel(), guess)
        samples = course.samples_of(tau.ravel(), motion)
        twist, power = motion.twist.reshape(*tau.shape, 3), motion.power.reshape(tau.shape)
        fine = _fine(twist, power) | (halving == _HALVINGS)
        again: list[tuple[float, float, int]] = []
        for j, (a, b, k) in enumerate(open_):
            own = samples[j * len(_NODES) : (j + 1) * len(_NODES)]
            if not all(one.as_in(found[k]) for one in own):
                missed += own
                wrong[k] = True
            elif fine[j]:
                done[k].append(Panel(a, twist[j], power[j]))
            else:
                again += [(a, (a + b) / 2, k), ((a + b) / 2, b, k)]
        open_ = again
    for k in np.flatnonzero(wrong):
        done[k] = []
    return [sorted(panels, key=lambda one: one.start) for panels in done], missed


def _middle(phase: Phase) -> Sample:
    return Sample((phase.start + phase.end) / 2, phase.rest, phase.back, phase.twist)


def _fine(twist: np.ndarray, power: np.ndarray) -> np.ndarray:
    """Whether polynomials follow the motion on panels (p,)."""
    values = np.concatenate([twist, power[..., None]], axis=2)
    series = np.einsum("kq,pqc->pkc", _TO_SERIES, values)
    last = np.abs(series[:, -2:]).max(axis=1)
    return (last <= _RESOLVED * np.abs(values).max(axis=(0, 1))).all(axis=1)
