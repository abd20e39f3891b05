"""Results and checks common to all crawling motions."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from wormopt.model.gait import Gait
from wormopt.result import Check
from wormopt.systems.shared.transport import cost_of_transport
from wormopt.systems.spiked.bimodal import BimodalMotion, integrate
from wormopt.systems.spiked.crawl import Crawl
from wormopt.systems.spiked.declared import MOTION_VARIABLES

# Tolerances between the routes: of rates, of loads (in forces), and of balances (in forces).
_SPEEDS, _LOADS, _BALANCES = 1e-9, 1e-7, 1e-9


def motion_scalars(motion: Crawl, units: str) -> dict[str, Any]:
    """Scalars of every gait result; extremes are over all time, not over samples.

    Energies are None, unknown, if a velocity jumps or the worm does not advance. `units` are
    the scene's.
    """
    low, high = motion.extremes("reaction_mean")
    # Forces and energy are finite and complete only where no velocity jumps.
    smooth, advance = not motion.corners, motion.advance
    spent = motion.energy / advance if advance > 0 and smooth else None
    forces = motion.extremes("actuator_force") if smooth else ()
    return {
        "speed": motion.speed,
        "advance": advance,
        "period": motion.gait.period,
        "resting_min": motion.resting_min,
        "lambda_min": low[0],
        "lambda_max": high[0],
        "lambda_mean": _lambda_mean(motion),
        "spike_load_max": motion.extremes("reaction")[1].max(),
        "actuator_force_max": max(abs(v).max() for v in forces) if smooth else None,
        "energy_per_distance": spent,
        **cost_of_transport(spent and spent / float(motion.drive.mass.sum()), units),
        "mode_sequence": motion.resting_sequence,
        "glides": motion.glides,
        "impulses": motion.impulses,
        "smallest_load": motion.smallest_load,
        "smallest_period": motion.smallest_period,
    }


def _lambda_mean(motion: Crawl) -> float:
    """Mean of lambda over the period, including impulses."""
    period, masses = motion.gait.period, len(motion.drive.mass)
    pushed = sum(size for _, size in motion.impulses) / masses
    return (float(motion.integral("reaction_mean")[0]) + pushed) / period


def _balances(motion: Crawl) -> tuple[float, float]:
    """Largest force behind the tail, and error of mean lambda - k speed - Gamma, as sizes."""
    closure = max(float(np.abs(v).max()) for v in motion.extremes("closure"))
    # the mean velocity of the masses, averaged over a period, is the speed
    return closure, abs(_lambda_mean(motion) - motion.drive.drag * motion.speed - motion.drive.load)


def motion_variables(motion: Crawl) -> dict[str, np.ndarray]:
    """Signals over one period and the gait; times at which a signal jumps appear twice."""
    sampled = motion.sample()
    signals = {
        name: sampled[name].reshape(-1) if len(dims) == 1 else sampled[name]
        for name, (_, dims, _) in MOTION_VARIABLES.items()
    }
    return signals | gait_arrays(motion.gait)


def gait_arrays(gait: Gait) -> dict[str, np.ndarray]:
    """Variables from which a gait is read back exactly."""
    return {f"gait_{name}": values for name, values in gait.arrays().items()}


def cross_check(motion: Crawl) -> BimodalMotion:
    """Integrate eq. 7 for the same gait by an independent, event-located integrator.

    Raises SolveError if it finds no periodic motion.
    """
    drive = motion.drive
    return integrate(motion.gait, drive.mass.tolist(), drive.drag, drive.load)


def motion_facts(motion: Crawl, again: BimodalMotion) -> dict[str, Any]:
    """Residuals of a motion, and the results of the second route (`cross_check`).

    ``force_balance``: largest force behind the tail, which should be 0; ``impulse_balance``:
    mean lambda - k speed - Gamma;
    ``energy_balance``: (net work - dissipation) / (force scale × distance).
    """
    closure, impulse = _balances(motion)
    energy = None
    if not motion.corners and motion.advance > 0:
        gap = motion.net_work - motion.dissipation
        energy = abs(gap) / (motion.force_scale * motion.advance)
    return {
        "force_balance": closure,
        "impulse_balance": impulse,
        "ruled_by_kinematics": not motion.glides and not motion.drops,
        "recheck": {
            "method": "event-located integration of eq. 7",
            "speed": again.speed,
            "lambda_min": again.lambda_min,
            "lambda_max": again.lambda_max,
            "resting_min": again.resting_min,
        },
        "energy_balance": energy,
    }


def agreement(motion: Crawl, again: BimodalMotion, under: str = "") -> Iterator[Check]:
    """Compare the motion with the second route, and check its balances.

    Speeds are compared as shares of the link rates, loads and balances as shares of the forces.
    `under` names the motion if there are several.
    """
    rate, force = motion.drive.rate_scale, motion.force_scale
    low, high = motion.extremes("reaction_mean")
    smallest = max(again.lambda_min, 0.0) - max(low[0], 0.0)
    found = {
        "speed": (abs(again.speed - motion.speed) / rate, _SPEEDS),
        "smallest load": (abs(smallest) / force, _LOADS),
        "largest load": (abs(again.lambda_max - high[0]) / force, _LOADS),
        "number of resting masses": (abs(again.resting_min - motion.resting_min), 0),
    }
    for name, (off, accepted) in found.items():
        advice = f"{under}the second route finds a different {name}"
        yield Check(f"{under}{name}, second route", float(off), accepted, advice)
    off = max(_balances(motion)) / (len(motion.drive.mass) * force)
    yield Check(f"{under}balance of forces", off, _BALANCES, f"{under}forces do not balance")
