"""Structure of a relaxed motion: resting contacts and inputs at limits in each phase."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from wormopt.model.modes import ModeSequence
from wormopt.ocp.motion import Motion


@dataclass(frozen=True)
class Structure:
    """Phases of a motion: contact modes, and inputs at their limits."""

    modes: ModeSequence  # by phase; neighbours may differ in inputs only
    durations: np.ndarray  # (phases,)
    active: tuple[tuple[int, ...], ...]  # per phase and input: -1 lower limit, +1 upper, 0 else


def structure_of(motion: Motion, *, speed: float | None, least: int = 1) -> Structure:
    """Extract phases from a motion with smoothed or complementary contact on a fine mesh.

    A contact slower than `speed` rests; if None, only inputs make phases. Runs of fewer than
    `least` arcs are noise and join their longer neighbour.
    """
    modes = np.zeros((0, motion.mesh.total), dtype=int)
    if speed is not None:
        modes = _contact_modes(motion, speed)
    active = _active_inputs(motion)
    keys = [(tuple(m), tuple(a)) for m, a in zip(modes.T.tolist(), active.T.tolist(), strict=True)]
    runs = _merged(_joined((key, 1) for key in keys), least)
    edges = np.cumsum([0, *(length for _, length in runs)])
    durations = np.diff(motion.breaks[edges])
    return Structure(
        ModeSequence(tuple(key[0] for key, _ in runs)),
        durations,
        tuple(key[1] for key, _ in runs),
    )


def _contact_modes(motion: Motion, speed: float) -> np.ndarray:
    """Mode of every contact on every arc, shape (n_c, N)."""
    model, tau = motion.program.problem.model, motion.mesh.collocation.tau
    t = motion.breaks[:-1] + np.multiply.outer(tau, motion.arcs.duration)
    v = motion.observe(model.contact_velocities, t.ravel()).reshape(-1, *t.shape)
    rests = np.median(np.abs(v), axis=1) <= speed
    directions = np.where(v.mean(axis=1) >= 0, 1, -1)
    for i, contact in enumerate(model.contacts):
        if len(contact.law.directions) == 1:
            directions[i] = contact.law.directions[0]
    return np.where(rests, 0, directions)


def _active_inputs(motion: Motion) -> np.ndarray:
    """Active limit of every input on every arc, shape (n_u, N)."""
    rows = []
    middle = (motion.breaks[:-1] + motion.breaks[1:]) / 2
    values, at = motion.inputs(middle), 0
    for signal in motion.program.problem.model.u:
        for u in values[at : at + signal.size]:
            width = signal.upper - signal.lower
            near = 1e-3 * (width if np.isfinite(width) else np.ptp(u))
            rows.append((u >= signal.upper - near).astype(int) - (u <= signal.lower + near))
        at += signal.size
    return np.array(rows, dtype=int).reshape(len(rows), motion.mesh.total)


Run = tuple[tuple[tuple[int, ...], tuple[int, ...]], int]


def _joined(runs: Iterable[Run]) -> list[Run]:
    """Runs without neighbours of equal key."""
    joined: list[Run] = []
    for key, length in runs:
        if joined and joined[-1][0] == key:
            joined[-1] = (key, joined[-1][1] + length)
        else:
            joined.append((key, length))
    return joined


def _merged(runs: list[Run], least: int) -> list[Run]:
    """Give runs shorter than ``least`` to their longer neighbour, the shortest first."""
    while len(runs) > 1:
        k = min(range(len(runs)), key=lambda i: runs[i][1])
        if runs[k][1] >= least:
            break
        left = runs[k - 1][1] if k > 0 else -1
        right = runs[k + 1][1] if k + 1 < len(runs) else -1
        heir = k - 1 if left >= right else k + 1
        runs[heir] = (runs[heir][0], runs[heir][1] + runs[k][1])
        runs = _joined(runs[:k] + runs[k + 1 :])
    return runs
