"""Declarations of the results of every motion of a worm with spikes."""

from __future__ import annotations

from wormopt.systems.shared.declared import COST_OF_TRANSPORT

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
    "actuator_force_max": (
        "force",
        "largest \\|*μ*<sub>j</sub>\\|; unknown if velocities jump",
    ),
    "energy_per_distance": (
        "energy_per_distance",
        "energy spent by the actuators per distance, without recovery; unknown if velocities jump "
        "or the worm does not advance",
    ),
    **COST_OF_TRANSPORT,
    "mode_sequence": (
        "count",
        "resting masses of each phase in order; an empty list is a glide",
    ),
    "glides": (
        "time",
        "start and end of each glide; a glide across the end of the period is split into two "
        "entries",
    ),
    "impulses": (
        "impulse",
        "time and size of each impulse on the spikes, summed over the masses",
    ),
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
