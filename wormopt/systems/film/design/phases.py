"""From a wave on an even mesh to an exact one: phases at whose ends its field switches."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from wormopt.errors import SolveError
from wormopt.numerics.collocation import Collocation
from wormopt.ocp.contact import Smoothed
from wormopt.ocp.mesh import Mesh
from wormopt.ocp.motion import Motion
from wormopt.ocp.nlp import Ipopt
from wormopt.ocp.optimise import Optimum, optimise, refine
from wormopt.ocp.sequence import structure_of
from wormopt.progress import Report

WIDTH = 1.0
"""There is no contact; its treatment only tells which inputs are at their limits."""
# Local error at which the mesh shows where the field switches.
_SHOWN, _ROUNDS = 1e-6, 4
# State polynomials between switches, and arcs of a phase in which the field is at a limit.
_EXACT, _HALVES = Collocation(6), 2
# Phases may lose so much of the objective before others are read.
_LOST = 1e-5
# A field so near to a limit, as a share of its range, touches it; phases that may be missing begin
# with such a share of the wave.
_TOUCH, _BRIEF = 5e-3, 1e-3
_TIGHT = Ipopt(tolerance=1e-10, mu_init=1e-2)


def exact_phases(first: Optimum, tolerance: float, report: Report) -> dict[str, Optimum]:
    """Find phases between field switches, which end anywhere, with fine enough polynomials.

    Many arcs serve where phases fail: under a limited slope the field switches without end
    before the film rests at a thickness. Returns all solves by name, the best last.
    """
    near = replace(_TIGHT, warm=True, mu_init=1e-5)
    shown = refine(first, _SHOWN, rounds=_ROUNDS, solver=near)
    stages, best = {"first": first, "refined": shown}, None
    enough = shown.objective + _LOST * abs(shown.objective)
    steep = "field" in [signal.name for signal in first.motion.program.problem.model.x]
    for active, durations in () if steep else _readings(shown.motion):
        report(f"{len(durations)} phases", None)
        try:
            found = _between(shown.motion, active, durations)
            if best is None or found.objective < best.objective:
                best = refine(found, tolerance, solver=replace(near, mu_init=1e-6))
        except SolveError:
            continue
        if best.objective <= enough:
            return {**stages, "phases": _touching(best, tolerance)}
    report("finer arcs", None)
    return {**stages, "finer": refine(shown, tolerance, solver=near)}


def _touching(found: Optimum, tolerance: float) -> Optimum:
    """Let the field stay at limits that it reaches just where a phase ends, if that is better."""
    motion = found.motion
    assert isinstance(found.treatment, Smoothed)
    active, edges = found.treatment.active or (), motion.phase_breaks()
    phases: list[tuple[int, ...]] = []
    spans: list[float] = []
    for k, held in enumerate(active):
        span = edges[k + 1] - edges[k]
        inside = np.array([edges[k], edges[k + 1]]) + 1e-6 * span * np.array([1, -1])
        before, after = (_limit(motion, float(t)) if not any(held) else 0 for t in inside)
        beside = active[k - 1], active[(k + 1) % len(active)]
        short = _BRIEF * motion.duration
        if before and (before,) != beside[0]:
            phases.append((before,))
            spans.append(short)
        phases.append(held)
        spans.append(span)
        if after and (after,) != beside[1]:
            phases.append((after,))
            spans.append(short)
    if len(phases) == len(active):
        return found
    try:
        more = _between(motion, tuple(phases), np.array(spans))
        more = refine(more, tolerance, solver=replace(_TIGHT, mu_init=1e-6, warm=True))
    except SolveError:
        return found
    return more if more.objective < found.objective else found


def _limit(motion: Motion, t: float) -> int:
    """Which limit the input is at, at some time: -1, 1, or 0 for none."""
    (signal,) = motion.program.problem.model.u
    share = (motion.inputs(np.array([t]))[0, 0] - signal.lower) / (signal.upper - signal.lower)
    return int(share >= 1 - _TOUCH) - int(share <= _TOUCH)


def _readings(motion: Motion) -> Iterator[tuple[tuple[tuple[int, ...], ...], np.ndarray]]:
    """Phases by what is taken for noise."""
    seen = set()
    for least in (2, 3, 1):
        found = structure_of(motion, speed=None, least=least)
        if found.active not in seen:
            seen.add(found.active)
            yield found.active, found.durations


def _between(motion: Motion, active: tuple[tuple[int, ...], ...], durations: np.ndarray) -> Optimum:
    falls = motion.mesh.collocation.degree - motion.mesh.input_degree
    counts = tuple(_HALVES if any(each) else 1 for each in active)
    mesh = Mesh.even(len(counts), counts, _EXACT, _EXACT.degree - falls)
    return optimise(
        motion.program.problem,
        mesh,
        Smoothed(WIDTH, WIDTH, active=active),
        replace(motion.guess, phases=durations),
        solver=_TIGHT,
    )
