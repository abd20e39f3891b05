"""Which resting spikes are unloaded or full under least actuation, arc after arc of a gait."""

from __future__ import annotations

from math import comb

import numpy as np

from wormopt.numerics.bilinear import Point
from wormopt.systems.spiked.programs.program import GaitProgram
from wormopt.systems.spiked.programs.split import Pattern, split_matters
from wormopt.systems.spiked.search.sequences import Resting
from wormopt.systems.spiked.sharing import share_load

# Loads and sums of forces below this share of the forces at play count as zero.
_TIE = 1e-7


def simple_patterns(program: GaitProgram) -> list[tuple[Pattern | None, ...]]:
    """All resting spikes loaded at all times; or only the first of them, or only the last."""
    found = []
    for loaded in (slice(None), slice(0, 1), slice(-1, None)):
        patterns: list[Pattern | None] = []
        for resting, arcs in zip(program.sequence, program.arcs, strict=True):
            pattern = np.full(len(resting), -1)
            pattern[loaded] = 0
            shared = split_matters(program.task, resting)
            patterns += [tuple(pattern.tolist()) if shared else None] * int(arcs)
        found.append(tuple(patterns))
    return found


def patterns_of(
    program: GaitProgram, point: Point, *, other: bool = False
) -> tuple[Pattern | None, ...]:
    """Patterns of the least split at the middle of every arc; None where it does not matter.

    `other`: where two patterns hold, take the one that the program has not.
    """
    needed, olds = _needed(program, point), program.patterns or (None,) * program.total
    tie = _TIE * float(np.abs(needed).max())
    patterns: list[Pattern | None] = []
    for resting, arcs in zip(program.sequence, program.arcs, strict=True):
        if not split_matters(program.task, resting):
            patterns += [None] * int(arcs)
            continue
        at, full = slice(len(patterns), len(patterns) + int(arcs)), program.limits.spikes
        loads, sums = _least(needed[at], resting, full)
        full = full[list(resting)]
        for load, total, old in zip(loads, sums, olds[at], strict=True):
            if other and old is not None:
                patterns.append(_flipped(old, load, full, total, tie))
            else:
                patterns.append(_pattern(load, full, total, tie))
    return tuple(patterns)


def _least(needed: np.ndarray, resting: Resting, full: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Loads of the resting masses and P_b of `gaits.split`, shape (arcs, resting) each."""
    bare, total = -np.cumsum(needed, axis=1).T, needed.sum(axis=1)
    loads = share_load(total, bare, resting, "least_actuation", full)
    sums = np.cumsum(bare + np.cumsum(loads, axis=0), axis=0)
    sums = np.vstack([np.zeros(len(total)), sums[:-1]])
    return loads[list(resting)].T, sums[list(resting)].T


def _pattern(load: np.ndarray, full: np.ndarray, sums: np.ndarray, tie: float) -> Pattern:
    signs = np.where(load <= tie, -1, np.where(load >= full - tie, 1, 0))
    if not np.any(signs == 0):
        # The total is just what the full ones carry: the next to change counts as in between.
        is_full = signs == 1
        key = np.where(is_full, sums, np.inf) if is_full.any() else -sums
        signs[int(np.argmin(key))] = 0
    return tuple(signs.tolist())


def _flipped(
    old: Pattern, load: np.ndarray, full: np.ndarray, sums: np.ndarray, tie: float
) -> Pattern:
    """The other pattern of every mass for which two hold."""
    first = old.index(0)
    new = list(old)
    for b, sign in enumerate(old):
        if b == first or abs(sums[b] - sums[first]) > tie:
            continue
        if sign != 0:
            new[b] = 0
        elif load[b] <= tie:
            new[b] = -1
        elif load[b] >= full[b] - tie:
            new[b] = 1
    if 0 in new[first + 1 :]:
        new[first] = -1 if load[first] <= tie else int(load[first] >= full[first] - tie)
    return tuple(new)


def _needed(program: GaitProgram, point: Point) -> np.ndarray:
    """Force m a + k v + load that must act on each mass amid every arc, shape (arcs, n + 1)."""
    limits, degree = program.limits, program.degree
    h = point.x[program.h]
    v = np.where(program.v >= 0, point.x[program.v], 0.0)
    middle = _amid(degree) @ v
    change = degree * (_amid(degree - 1) @ np.diff(v, axis=1))
    slope = change / np.where(h > 1e-9 * h.sum(), h, np.inf)[:, None]
    load = float(np.mean(program.task.worm.load_range)) / limits.force
    return limits.mass * slope + limits.drag * middle + load


def _amid(degree: int) -> np.ndarray:
    """Bernstein polynomials at the middle of an arc."""
    return np.array([comb(degree, k) for k in range(degree + 1)]) / 2.0**degree
