"""Signals of simulated motions: samples, largest values, rests and events."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np

from wormopt.errors import SolveError
from wormopt.model.model import Model
from wormopt.progress import Report
from wormopt.simulation.initial_value import KINDS
from wormopt.simulation.options import Tolerance, Treatment
from wormopt.simulation.simulate import simulate
from wormopt.simulation.trajectory import Trajectory
from wormopt.systems.shared.declared import Declared

# Bytes for the polynomials of all steps, of all motions together.
_MEMORY = 5e8


def chain_expressions(model: Model) -> dict[str, ca.SX]:
    """Expressions of a chain's signals, by the names of `CHAIN_SIGNALS`."""
    found = {
        "position": model["position"],
        "velocity": model["velocity"],
        "input": model["input"],
        **{name: model[name] for name in ("length", "link_force", "energy", "center_velocity")},
    }
    return found | ({"contact_force": model.forces} if model.contacts else {})


def simulate_whole(
    model: Model,
    end: float,
    samples: int,
    contact: Treatment,
    tolerance: Tolerance,
    report: Report,
    *,
    motions: int = 1,
) -> Trajectory:
    """Simulate from time 0 at equidistant samples; keep the whole motion if it fits in memory.

    Without `dense` if it took too many steps. `motions` is the number kept at the same time. Raises
    SolveError as `simulate`.
    """
    times = np.linspace(0.0, end, samples)
    room = max(int(_MEMORY / (64 * model.n_x * motions)), 1)
    try:
        few = replace(tolerance, max_steps=min(tolerance.max_steps, room))
        return simulate(
            model, end, contact=contact, times=times, dense=True, tolerance=few, report=report
        )
    except ValueError:  # implicit integrators keep nothing; other errors are raised again below
        pass
    except SolveError as error:
        if error.code != "too_many_steps" or room >= tolerance.max_steps:
            raise
    return simulate(model, end, contact=contact, times=times, tolerance=tolerance, report=report)


def at_ends(motion: Trajectory) -> Trajectory:
    """Keep only the first and the last sample of a motion."""
    return replace(motion, time=motion.time[[0, -1]], states=motion.states[:, [0, -1]])


def sample(motion: Trajectory, expressions: Mapping[str, ca.SX]) -> dict[str, np.ndarray]:
    """Values (entries, m) of several column expressions at the m sample times of a motion."""
    sizes = [e.numel() for e in expressions.values()]
    rows = motion.observe(ca.vertcat(ca.SX(0, 1), *expressions.values()))
    parts = np.split(rows, np.cumsum(sizes)[:-1]) if sizes else []
    return dict(zip(expressions, parts, strict=True))


def rests(motion: Trajectory) -> list[tuple[int, float, float]]:
    """Intervals in which contacts rest: (index among all contacts of the model, start, end)."""
    places = {contact.name: k for k, contact in enumerate(motion.system.model.contacts)}
    return [(places[name], begin, end) for name, begin, end in motion.stick_intervals()]


def fitted(arrays: Mapping[str, Any], declared: Declared) -> dict[str, np.ndarray]:
    """Remove the last axis but one, of length 1, of signals without entries."""
    found = {name: np.asarray(values) for name, values in arrays.items()}
    return {
        name: array if array.ndim == len(declared[name][1]) else np.squeeze(array, -2)
        for name, array in found.items()
    }


def event_arrays(motions: Sequence[Trajectory], *, several: bool) -> dict[str, np.ndarray]:
    """Events and rests of motions, one per tracker, by the names of `TRACKER_EVENTS`.

    With `several`, each entry has the index of its motion. Empty if there are none.
    """
    names = [contact.name for contact in motions[0].system.model.contacts]
    events = [
        (e.time, KINDS.index(e.kind), -1 if e.kind == "switch" else names.index(e.name), e.mode, k)
        for k, motion in enumerate(motions)
        for e in motion.events
    ]
    rested = [(begin, end, i, k) for k, each in enumerate(motions) for i, begin, end in rests(each)]
    found: dict[str, np.ndarray] = {}
    for dim, columns, rows in (
        ("event", ("time", "kind", "contact", "mode", "tracker"), events),
        ("rest", ("start", "end", "contact", "tracker"), rested),
    ):
        if rows:
            values = map(np.array, zip(*rows, strict=True))
            found |= zip((f"{dim}_{column}" for column in columns), values, strict=True)
    return {k: v for k, v in found.items() if several or not k.endswith("_tracker")}
