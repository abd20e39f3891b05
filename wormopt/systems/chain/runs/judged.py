"""What is measured of a chain that should follow a reference, whatever moves it."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from wormopt.model.model import Model
from wormopt.simulation.functions import System
from wormopt.simulation.trajectory import Trajectory
from wormopt.systems.chain.scenes.track_optimal import TubeTable
from wormopt.systems.shared.signals import inputs, largest
from wormopt.systems.shared.watch import (
    LEAVES,
    measure_power,
    measure_tracking,
    outside_between,
    watch_tube,
)

# Times at which the largest error is sought where a motion was kept whole.
_INSTANTS = 20_001


def judged(model: Model, tube: TubeTable) -> Model:
    """Add to a chain, driven or controlled, what is measured along its motion.

    It must have the output ``error``.
    """
    return watch_tube(measure_tracking(measure_power(model)), tube.radius)


def judged_numbers(motion: Trajectory, tube: TubeTable) -> dict[str, tuple[Any, str]]:
    """(Value, quantity) of each scalar of a `judged` motion, by its name in a Result.

    Work and cost of transport count the positive power of each actuator, ``net_work`` all of
    it. Peaks are of the samples where the motion, from time 0 on, was not kept whole.
    """
    seen = _seen(motion)
    end, outside = motion.end_time, bool(seen["outside"][0] > 0)
    last = {
        name: float(motion.state(name)[0, -1])
        for name in ("error_square", "positive_work", "input_work", "input_square")
    }
    distance = float(seen["center"][-1] - seen["center"][0])
    weight = float(seen["mass"][0]) * distance
    captured = None if seen["outside"][-1] > 0 else float(motion.state("tube_entered")[0, -1])
    return {
        "capture_time": (captured, "time"),
        "time_outside_tube": (outside_between(motion, outside, tube.capture), "time"),
        "error_peak": (_largest_error(motion, seen, tube.capture), "length"),
        "error_integral": (last["error_square"], "length_squared_time"),
        "input_integral": (last["input_square"], "effort"),
        "input_rms": (float(np.sqrt(last["input_square"] / end)), "force"),
        "input_peak": (_largest_input(motion, seen), "force"),
        "distance": (distance, "length"),
        "mean_speed": (distance / end, "speed"),
        "work": (last["positive_work"], "energy"),
        "net_work": (last["input_work"], "energy"),
        "cost_of_transport": (
            last["positive_work"] / weight if distance > 0 else None,
            "acceleration",
        ),
        "x_end": (motion.state("position")[:, -1], "length"),
        "v_end": (motion.state("velocity")[:, -1], "speed"),
        "n_events": (len(motion.events), "count"),
        "n_steps": (motion.n_steps, "count"),
    }


@lru_cache(maxsize=64)
def _observer(system: System) -> ca.Function:
    """Everything at once, made once for all motions of a model."""
    model = system.model
    guard = next(s.guard for s in model.switches if s.name == LEAVES)
    mass = next(s.symbol for s in model.p if s.name == "mass")
    u = inputs(model)
    rows = [model.output("center_of_mass"), model.output("error_norm"), guard, ca.sum1(mass)]
    return system.observe(ca.vertcat(*rows, ca.norm_inf(u)))


def _seen(motion: Trajectory) -> dict[str, np.ndarray]:
    p = motion.system.scheduled(motion.p, motion.schedules, motion.time)
    t = motion.time[None, :]
    rows = np.array(_observer(motion.system)(t, motion.states, p, motion.modes_at(motion.time)))
    return dict(zip(("center", "error_norm", "outside", "mass", "input"), rows, strict=True))


def _largest_error(motion: Trajectory, seen: dict[str, np.ndarray], since: float) -> float:
    """Largest |e| from some time on."""
    if motion.dense is not None:
        motion = motion.at(np.linspace(since, motion.end_time, _INSTANTS))
        return float(np.max(motion.output("error_norm")))
    return float(np.max(seen["error_norm"][motion.time >= since], initial=0.0))


def _largest_input(motion: Trajectory, seen: dict[str, np.ndarray]) -> float:
    if motion.dense is not None:
        return largest(motion, inputs(motion.system.model))
    return float(seen["input"].max())
