"""What is measured of a chain that should follow a reference, whatever moves it."""

from __future__ import annotations

from typing import Any

import numpy as np

from wormopt.core.model import Model
from wormopt.scenes.track_optimal import TubeTable
from wormopt.simulation.trajectory import Trajectory
from wormopt.studies.watch import (
    chain_numbers,
    measure_power,
    measure_tracking,
    time_in_tube,
    time_outside,
    watch_tube,
)

__all__ = ["judged", "judged_numbers"]

# Times at which the largest error is sought where a motion was kept whole.
_INSTANTS = 20_001


def judged(model: Model, tube: TubeTable) -> Model:
    """Add to a chain what is measured along its motion.

    Parameters
    ----------
    model : Model
        With the output ``error``, controlled or driven.
    tube : TubeTable
        Tube around the reference.

    Returns
    -------
    Model
    """
    return watch_tube(measure_tracking(measure_power(model)), tube.radius)


def judged_numbers(motion: Trajectory, tube: TubeTable) -> dict[str, tuple[Any, str]]:
    """What is said of a motion in numbers.

    Parameters
    ----------
    motion : Trajectory
        Of a model of `judged`, from time 0.
    tube : TubeTable
        Tube around the reference.

    Returns
    -------
    dict of str to (value, quantity)
        By the names of the scalars in a Result. Work and cost of transport count the positive
        power of each actuator, nothing recovered; ``net_work`` counts what flows back too.
    """
    chain = chain_numbers(motion)
    _, captured = time_in_tube(motion)
    last = {
        name: float(motion.state(name)[0, -1])
        for name in ("error_square", "positive_work", "input_work", "input_square")
    }
    distance, mass = chain["distance"][0], _mass(motion)
    return {
        "capture_time": (captured, "time"),
        "time_outside_tube": (time_outside(motion, tube.capture), "time"),
        "error_peak": (_largest_error(motion, tube.capture), "length"),
        "error_integral": (last["error_square"], "length_squared_time"),
        "input_integral": (last["input_square"], "effort"),
        **{name: chain[name] for name in ("input_rms", "input_peak", "distance", "mean_speed")},
        "work": (last["positive_work"], "energy"),
        "net_work": (last["input_work"], "energy"),
        "cost_of_transport": (
            last["positive_work"] / (mass * distance) if distance > 0 else None,
            "acceleration",
        ),
        **{name: chain[name] for name in ("x_end", "v_end", "n_events", "n_steps")},
    }


def _mass(motion: Trajectory) -> float:
    total, at = np.nan, 0
    for signal in motion.system.model.p:
        if signal.name == "mass":
            total = float(np.sum(motion.p[at : at + signal.size]))
        at += signal.size
    return total


def _largest_error(motion: Trajectory, since: float) -> float:
    """Largest |e| from some time on."""
    whole = motion
    if motion.dense is not None:
        whole = motion.at(np.linspace(since, motion.end_time, _INSTANTS))
    after = whole.time >= since
    return float(np.max(whole.output("error_norm")[0, after], initial=0.0))
