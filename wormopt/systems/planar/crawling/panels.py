"""Motion along a stroke at Gauss nodes of panels, refined until polynomials resolve it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.polynomial.legendre import legvander

from wormopt.systems.planar.body.travel import Travel, gauss, gauss_nodes, travel_along
from wormopt.systems.planar.crawling.phases import THIN, Course, Phase, Sample

# Accepted error of a panel, relative to the path of the masses in the body over the stroke; and
# largest number of halvings.
_MISSED, _HALVINGS = 1e-12, 24
# A kink between the outermost nodes and the ends would be missed: polynomials are compared with the
# motion this close to the ends. A kink changes values by its distance from the end, and integrals
# by the square of it.
_END, _LEAPT = 1e-6, 1e-6
_WIDE = 1e2 * THIN  # nodes of narrower panels are so close to breaks that round-off decides rest


@dataclass(frozen=True, eq=False)
class Panel:
    """Twists and powers at the nodes of one panel."""

    start: float
    twist: np.ndarray  # (d, 3)
    power: np.ndarray  # (d,)
    missed: np.ndarray  # (4,), errors of the integrals of twist and power


def joined(panels: Sequence[Panel]) -> tuple[Travel, float, float]:
    """Return the pose over consecutive panels up to 1, work, and error of work."""
    ends = np.array([*(one.start for one in panels), 1.0])
    missed = np.sum([one.missed for one in panels], axis=0)
    course = travel_along(ends, np.array([one.twist for one in panels]), 0.0)
    # An error of the angle changes the direction of the remaining path.
    error = float(missed[:2].max() + missed[2] * max(1.0, np.abs(course.poses[:, :2]).max()))
    power = np.concatenate([one.power for one in panels])
    return replace(course, error=error), float(course.weights @ power), float(missed[3])


def resolve(
    course: Course, found: list[Phase], *, strict: bool
) -> tuple[list[list[Panel]], list[Sample]]:
    """Return panels of each phase, halved until polynomials resolve the motion.

    If a node shows other resting masses than its phase, the panel's samples are also returned, so
    that the phases can be found again; that phase has no panels. If not `strict`, resting masses
    are ignored: halving also resolves breaks, but more slowly.
    """
    seen: list[Sample] = []
    done: list[list[Panel]] = [[] for _ in found]
    wrong = np.zeros(len(found), bool)
    start, end = (np.array([getattr(one, key) for one in found]) for key in ("start", "end"))
    of = np.arange(len(found))
    for halving in range(_HALVINGS + 1):
        if not of.size:
            break
        tau = gauss_nodes(start, end)
        guess = [found[k] for k in of for _ in tau[0]]
        motion = course.at(tau.ravel(), guess)
        samples = course.samples_of(tau.ravel(), motion)
        twist, power = motion.twist.reshape(*tau.shape, 3), motion.power.reshape(tau.shape)
        missed = _missed(twist, power) * (end - start)[:, None]
        fine = np.all(missed <= _MISSED * course.sizes, axis=1)
        held = np.flatnonzero(fine & (end - start > _WIDE))
        fine[held] = _follows(
            course, start[held], end[held], [found[k] for k in of[held]], twist[held], power[held]
        )
        fine |= halving == _HALVINGS
        for j, k in enumerate(of):
            own = samples[j * tau.shape[1] : (j + 1) * tau.shape[1]]
            wide = strict and end[j] - start[j] > _WIDE
            if wide and not all(one.as_in(found[k]) for one in own):
                seen += own
                wrong[k] = True
            elif fine[j]:
                done[k].append(Panel(float(start[j]), twist[j], power[j], missed[j]))
        again = ~fine & ~wrong[of]
        middle = (start + end)[again] / 2
        start, end = np.append(start[again], middle), np.append(middle, end[again])
        of = np.tile(of[again], 2)
    for k in np.flatnonzero(wrong):
        done[k] = []
    return [sorted(panels, key=lambda one: one.start) for panels in done], seen


def _missed(twist: np.ndarray, power: np.ndarray) -> np.ndarray:
    """Return the last coefficients (K, 4) of the Legendre series of twists and powers."""
    values = np.concatenate([twist, power[..., None]], axis=2)
    last = np.einsum("kd,pdc->pkc", _last_rows(), values)
    return np.abs(last).max(axis=1)


def _follows(
    course: Course, start: np.ndarray, end: np.ndarray, within: list[Phase],
    twist: np.ndarray, power: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Return whether the polynomials of K panels agree with the motion near their ends."""
    if not within:
        return np.zeros(0, bool)
    tau = start[:, None] + (end - start)[:, None] * np.array([_END, 1 - _END])
    motion = course.at(tau.ravel(), [phase for phase in within for _ in tau[0]])
    there = np.column_stack([motion.twist, motion.power]).reshape(*tau.shape, 4)
    led = np.einsum("ed,kdc->kec", _to_ends(), np.concatenate([twist, power[..., None]], axis=2))
    return np.all(np.abs(led - there) <= _LEAPT * course.sizes, axis=(1, 2))


@cache
def _to_ends() -> np.ndarray:
    """Return the matrix from values at the nodes to those near both ends, (2, d)."""
    tau = gauss().tau
    near = legvander(np.array([2 * _END - 1, 1 - 2 * _END]), len(tau) - 1)
    return near @ np.linalg.inv(legvander(2 * tau - 1, len(tau) - 1))


@cache
def _last_rows() -> np.ndarray:
    """Return the matrix from values at the nodes to the last two coefficients, (2, d)."""
    tau = gauss().tau
    return np.linalg.inv(legvander(2 * tau - 1, len(tau) - 1))[-2:]
