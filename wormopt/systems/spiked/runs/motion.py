"""What every gait study says of a crawling motion: scalars, signals, and its re-check."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from wormopt.quantities import Scalar, Variable, unit_of
from wormopt.systems.spiked.bimodal import BimodalMotion, integrate
from wormopt.systems.spiked.crawl import Crawl
from wormopt.systems.spiked.files import gait_variables

_SIGNALS = {
    "time": ("time", ("time",), "time"),
    "length": ("length", ("link", "time"), "link length"),
    "rate": ("speed", ("link", "time"), "rate of the link length"),
    "acceleration": ("acceleration", ("link", "time"), "acceleration of the link length"),
    "position": ("length", ("mass", "time"), "position of the mass"),
    "velocity": ("speed", ("mass", "time"), "velocity of the mass"),
    "reaction": ("force", ("mass", "time"), "load on the spike"),
    "reaction_mean": ("force", ("time",), "mean spike load lambda of (7)"),
    "sigma": ("force", ("time",), "driving term sigma of (7)"),
    "glide": ("speed", ("time",), "common velocity w of (7)"),
    "actuator_force": ("force", ("link", "time"), "actuator force"),
    "resting": ("count", ("mass", "time"), "1 where the mass rests"),
}


def motion_scalars(motion: Crawl, units: str) -> dict[str, Scalar]:
    """Scalars that every gait result carries; extremes are over all time, not over samples.

    Energies are None, unknown, where a velocity jumps or the worm does not advance.
    """

    def scalar(value: Any, quantity: str) -> Scalar:
        return Scalar(value, unit_of(quantity, units))

    low, high = motion.extremes("reaction_mean")
    period, advance = motion.gait.period, motion.advance
    # Forces and energy are finite and complete only where no velocity jumps.
    spent = motion.energy / advance if advance > 0 and not motion.corners else None
    mass = float(motion.drive.mass.sum())
    return {
        "speed": scalar(motion.speed, "speed"),
        "advance": scalar(advance, "length"),
        "period": scalar(period, "time"),
        "resting_min": scalar(motion.resting_min, "count"),
        "lambda_min": scalar(low[0], "force"),
        "lambda_max": scalar(high[0], "force"),
        "lambda_mean": scalar(_lambda_mean(motion), "force"),
        "spike_load_max": scalar(motion.extremes("reaction")[1].max(), "force"),
        "actuator_force_max": scalar(
            None
            if motion.corners
            else max(abs(v).max() for v in motion.extremes("actuator_force")),
            "force",
        ),
        "energy_per_distance": scalar(spent, "energy_per_distance"),
        "cost_of_transport": scalar(None if spent is None else spent / mass, "acceleration"),
        "mode_sequence": scalar(motion.resting_sequence, "count"),
        "glides": scalar(motion.glides, "time"),
        "impulses": scalar(motion.impulses, "impulse"),
        "smallest_load": scalar(motion.smallest_load, "force"),
        "smallest_period": scalar(motion.smallest_period, "time"),
    }


def _lambda_mean(motion: Crawl) -> float:
    """Mean of lambda over the period; impulses count with their share."""
    period, masses = motion.gait.period, len(motion.drive.mass)
    pushed = sum(size for _, size in motion.impulses) / masses
    return (float(motion.integral("reaction_mean")[0]) + pushed) / period


def motion_variables(motion: Crawl, units: str) -> list[Variable]:
    """Signals over one period and the gait itself; times at which a signal jumps stand twice."""
    sampled = motion.sample()
    signals = [
        Variable(
            name,
            unit_of(quantity, units),
            dims,
            sampled[name].reshape(-1) if len(dims) == 1 else sampled[name],
            long_name,
        )
        for name, (quantity, dims, long_name) in _SIGNALS.items()
    ]
    return [*signals, *gait_variables(motion.gait, units)]


def recheck(motion: Crawl) -> BimodalMotion:
    """Integrate (7) for the same gait by the second, event-located route.

    Raises SolveError where that route finds no periodic motion.
    """
    drive = motion.drive
    return integrate(motion.gait, drive.mass.tolist(), drive.drag, drive.load)


def motion_trust(motion: Crawl, again: BimodalMotion) -> Mapping[str, Any]:
    """Residuals of a motion, and what the second route (`recheck`) found.

    ``force_balance``: largest mu_{n+1}; ``impulse_balance``: mean lambda - k speed - Gamma;
    ``energy_balance``: (net work - dissipation) / (force scale × distance).
    """
    low, high = motion.extremes("closure")
    # drag acts on the mean velocity of the masses, which over a period is the speed
    balance = _lambda_mean(motion) - motion.drive.drag * motion.speed - motion.drive.load
    trust: dict[str, Any] = {
        "force_balance": max(abs(low[0]), abs(high[0])),
        "impulse_balance": abs(balance),
        "ruled_by_kinematics": not motion.glides and not motion.drops,
        "recheck": {
            "method": "event-located integration of (7)",
            "speed": again.speed,
            "lambda_min": again.lambda_min,
            "lambda_max": again.lambda_max,
            "resting_min": again.resting_min,
        },
    }
    if not motion.corners and motion.advance > 0:
        gap = motion.net_work - motion.dissipation
        trust["energy_balance"] = abs(gap) / (motion.force_scale * motion.advance)
    else:
        trust["energy_balance"] = None
    return trust


def disagreements(motion: Crawl, again: BimodalMotion) -> list[str]:
    """Say where the second route finds something else, and which balance does not close.

    Tolerances: speeds 1e-9 of the link rates, loads 1e-7 and balances 1e-9 of the forces.
    """
    rate, force = motion.drive.rate_scale, motion.force_scale
    low, high = motion.extremes("reaction_mean")
    closure = max(float(np.abs(v).max()) for v in motion.extremes("closure"))
    balance = abs(_lambda_mean(motion) - motion.drive.drag * motion.speed - motion.drive.load)
    checks = {
        "speed": abs(again.speed - motion.speed) / rate / 1e-9,
        "smallest load": abs(max(again.lambda_min, 0.0) - max(low[0], 0.0)) / force / 1e-7,
        "largest load": abs(again.lambda_max - high[0]) / force / 1e-7,
        "number of resting masses": 2.0 * (again.resting_min != motion.resting_min),
    }
    found = [f"the second route finds another {k}" for k, size in checks.items() if not size <= 1]
    if not max(closure, balance) <= 1e-9 * len(motion.drive.mass) * force:
        found.append("forces do not balance")
    return found
