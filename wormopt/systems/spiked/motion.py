"""Results and checks common to all crawling motions of worms with spikes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from wormopt.result import Check
from wormopt.study import on_use
from wormopt.systems.shared.declared import COST_OF_TRANSPORT, gait_arrays
from wormopt.systems.shared.gravity import cost_of_transport

with on_use():
    import numpy as np

    from wormopt.systems.spiked.bimodal import BimodalMotion, integrate
    from wormopt.systems.spiked.crawl import Crawl

MOTION_SCALARS: dict[str, tuple[str, str]] = {
    "speed": ("speed", "mean speed"),
    "advance": ("length", "distance travelled per period"),
    "period": ("time", "period"),
    "resting_min": ("count", "smallest number of resting masses over time; 0 if the worm glides"),
    "lambda_min": (
        "force",
        "smallest *λ*, the spike load averaged over the masses (eq. 7 of Zimmermann et al. 2007)",
    ),
    "lambda_max": ("force", "largest *λ*"),
    "lambda_mean": ("force", "mean *λ* over the period, impulses included"),
    "spike_load_max": (
        "force",
        "largest load on a single spike under the sharing rule, without impulses",
    ),
    "actuator_force_max": ("force", "largest \\|*μ*<sub>j</sub>\\|; unknown if velocities jump"),
    "energy_per_distance": (
        "energy_per_distance",
        "energy spent by the actuators per distance, without recovery; unknown if velocities jump "
        "or the worm does not advance",
    ),
    **COST_OF_TRANSPORT,
    "mode_sequence": ("count", "resting masses of each phase in order; an empty list is a glide"),
    "glides": (
        "time",
        "start and end of each glide; a glide across the end of the period is split into two "
        "entries",
    ),
    "impulses": ("impulse", "time and size of each impulse on the spikes, summed over the masses"),
    "smallest_load": (
        "force",
        "smallest *Γ* at which kinematics alone determines the motion; unknown if there is none",
    ),
    "smallest_period": (
        "time",
        "smallest period at which kinematics alone determines the motion of this gait shape at "
        "the scene's load; unknown if there is none",
    ),
    "recheck_speed_error": ("speed", "difference in speed between the two routes"),
}
"""Scalars of the motion in every result with a gait."""

_LINK, _MASS = ("link", "time"), ("mass", "time")
MOTION_VARIABLES: dict[str, tuple[str, tuple[str, ...], str]] = {
    "time": ("time", ("time",), "time"),
    "length": ("length", _LINK, "link length"),
    "rate": ("speed", _LINK, "rate of the link length"),
    "acceleration": ("acceleration", _LINK, "acceleration of the link length"),
    "position": ("length", _MASS, "position of the mass"),
    "velocity": ("speed", _MASS, "velocity of the mass"),
    "reaction": ("force", _MASS, "load on the spike"),
    "reaction_mean": ("force", ("time",), "mean spike load lambda (eq. 7)"),
    "sigma": ("force", ("time",), "driving term sigma (eq. 7)"),
    "glide": ("speed", ("time",), "common velocity w (eq. 7)"),
    "actuator_force": ("force", _LINK, "actuator force"),
    "resting": ("count", _MASS, "1 where the mass rests"),
}
"""Signals over one period."""

DESIGN_SCALARS: dict[str, tuple[str, str]] = MOTION_SCALARS | {
    "period": ("time", "period of one cycle, after which the motion repeats"),
    "advance": ("length", "distance travelled per cycle"),
    "cycles": ("count", "smallest number of cycles that fills a period allowed by `gait.period`"),
    "mode_sequence": (
        "count",
        "resting masses in each phase of a cycle. The prescribed sequence is in the trust report "
        "under `solver.sequence`; more masses may rest than it prescribes",
    ),
    "load_range": (
        "force",
        "[smallest, largest], if `worm.load` is a range; loads, forces and energies are those at "
        "the largest load",
    ),
    "ceiling": ("speed", "upper bound on the mean speed from link rates and resting masses"),
    "discretisation_error": (
        "speed",
        "gain in the objective from the last halving of all arcs. For energy and effort: a "
        "first-order estimate of the gain from one more halving. Unknown for an interrupted design",
    ),
    "ticks": ("count", "with `gait.tick`: number of ticks per cycle"),
    "tick_loss": (
        "share",
        "with `gait.tick`: relative loss in the objective compared with a free period",
    ),
    "free_period": ("time", "with `gait.tick`: optimal period of a cycle without `gait.tick`"),
    "free_speed": ("speed", "with `gait.tick`: mean speed at `free_period`"),
    "length_step": ("length", "`gait.length_step`, if given"),
    "step_loss": (
        "share",
        "with `gait.length_step`: relative loss of speed if lengths move in straight lines "
        "between rounded ticks and a mass always rests; negative if rounding gains speed",
    ),
    "worst_violation": ("share", "largest violation of a limit, relative to the limit"),
    "rate_limit_from": (
        "1",
        "with `[motor]`: for each link the source of the smaller rate limit, `gait` or `motor`",
    ),
    "acceleration_limit_from": (
        "1",
        "with `[motor]`: for each link the source of the smaller acceleration limit",
    ),
    "motor_rate_share": (
        "share",
        "with `[motor]`: largest link rate as a share of the motor's limit",
    ),
    "motor_acceleration_share": (
        "share",
        "with `[motor]`: largest link acceleration as a share of the motor's limit",
    ),
    "length_limits": ("length", "[shortest, longest] of each link"),
    "rate_limit": (
        "speed",
        "if `gait.rate` or `[motor]` is given: limits on the contraction of every link, then on "
        "its extension",
    ),
    "acceleration_limit": ("acceleration", "limit on |*l*″|, for all links or for each"),
    "spike_load_limit": ("force", "`gait.spike_load`, if given"),
    "actuator_force_limit": ("force", "`gait.actuator_force`, if given"),
}
"""Scalars of every designed gait; those in the quantity of the objective are declared as speeds."""


# Tolerances between the routes: of rates, of loads (in forces), and of balances (in forces).
_SPEEDS, _LOADS, _BALANCES = 1e-9, 1e-7, 1e-9


def motion_scalars(motion: Crawl, units: str) -> dict[str, Any]:
    """Scalars of every gait result; extremes are over all time, not over samples.

    Energies are None if a velocity jumps or the worm does not advance. `units` are the scene's.
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


def cross_check(motion: Crawl) -> BimodalMotion:
    """Integrate eq. 7 for the same gait by an independent, event-located integrator."""
    drive = motion.drive
    return integrate(motion.gait, drive.mass.tolist(), drive.drag, drive.load)


def motion_facts(motion: Crawl, again: BimodalMotion) -> dict[str, Any]:
    """Residuals of a motion, and the results of the second route (`cross_check`).

    ``force_balance``: largest force behind the tail, near 0; ``impulse_balance``: mean lambda - k
    speed - Gamma; ``energy_balance``: (net work - dissipation) / (force scale × distance).
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
