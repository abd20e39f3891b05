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
