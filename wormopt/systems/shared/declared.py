"""Declarations of results that several kinds share: name, quantity, dimensions and meaning."""

from __future__ import annotations

from collections.abc import Mapping

from wormopt.study import on_use

with on_use():
    import numpy as np

    from wormopt.model.gait import Gait

Scalars = dict[str, tuple[str, str]]
"""Name: quantity, meaning."""
Variables = dict[str, tuple[str, tuple[str, ...], str]]
"""Name: quantity, dimensions, long name."""
Declared = Mapping[str, tuple[str, tuple[str, ...], str]]
"""Read-only form of `Variables`."""


def over(signals: Declared, *before: str, last: str = "time") -> Variables:
    """Add the dimensions `before` in front of those of signals, and `last` after them."""
    return {k: (quantity, (*before, *own, last), w) for k, (quantity, own, w) in signals.items()}


def gait_arrays(gait: Gait) -> dict[str, np.ndarray]:
    """Arrays of an exact gait, by the names of `GAIT`."""
    return {f"gait_{name}": values for name, values in gait.arrays().items()}


TIME: Variables = {"time": ("time", ("time",), "time")}
INSTANT: Variables = {"instant": ("time", ("instant",), "time")}

CHAIN_SIGNALS: Variables = {
    "position": ("length", ("mass",), "position of the mass"),
    "velocity": ("speed", ("mass",), "velocity of the mass"),
    "length": ("length", ("link",), "link length"),
    "input": ("force", ("link",), "force u of the actuator"),
    "link_force": ("force", ("link",), "force in the link, positive in tension"),
    "contact_force": ("force", ("mass",), "force of the ground on the mass"),
    "energy": ("energy", (), "kinetic and elastic energy"),
    "center_velocity": ("speed", (), "velocity of the centre of mass"),
}
"""Signals of a chain, without the dimension of time."""

LOOP_SIGNALS: Variables = CHAIN_SIGNALS | {
    "error_norm": ("length", (), "norm of the error e"),
    "tube": ("length", (), "radius of the tube around the reference"),
    "funnel": ("length", (), "width of the funnel around the reference"),
    "gain": ("count", (), "gain k"),
}
"""Signals of a chain that follows a reference."""

REFERENCE: Variables = {"reference": ("length", ("link", "time"), "reference of the link length")}

EVENTS: Variables = {
    "event_time": ("time", ("event",), "time of the event"),
    "event_kind": ("count", ("event",), "reversal, stick, release, impact, switch"),
    "event_contact": ("count", ("event",), "index of the contact, -1 for a switch"),
    "event_mode": ("count", ("event",), "direction of motion after the event"),
    "rest_start": ("time", ("rest",), "start of the rest"),
    "rest_end": ("time", ("rest",), "end of the rest"),
    "rest_contact": ("count", ("rest",), "index of the resting contact"),
}
"""Events, and rests of contacts."""

TRACKER_EVENTS: Variables = EVENTS | {
    "event_tracker": ("count", ("event",), "index of the tracker"),
    "rest_tracker": ("count", ("rest",), "index of the tracker"),
}

GAIT: Variables = {
    "gait_breaks": ("time", ("gait_break",), "times at which pieces of the gait begin"),
    "gait_polynomial": (
        "length",
        ("gait_piece", "link", "gait_power"),
        "coefficients of s^k, s the time since the piece began",
    ),
    "gait_omega": (
        "angular_frequency",
        ("gait_piece",),
        "angular frequency of the piece's harmonic",
    ),
    "gait_cosine": ("length", ("gait_piece", "link"), "amplitude of cos(omega s)"),
    "gait_sine": ("length", ("gait_piece", "link"), "amplitude of sin(omega s)"),
}
"""An exact gait."""

STEPS: Scalars = {
    "n_events": (
        "count",
        "number of events: reversals, sticks, releases, impacts of masses, crossings of the tube, "
        "switches of the controller",
    ),
    "n_steps": ("count", "steps of the integrator"),
    "recheck_error": (
        "share",
        "largest difference of any state at the end between the two routes, relative to the "
        "larger of the state's magnitude and its nominal size",
    ),
}
"""Scalars of every simulation."""

CHAIN: Scalars = {
    "x_end": ("length", "positions at the end, head first"),
    "v_end": ("speed", "velocities at the end"),
    "distance": ("length", "displacement of the centre of mass from start to end"),
    "mean_speed": ("speed", "`distance` divided by time"),
    "input_rms": (
        "force",
        "root mean square over time of the Euclidean norm \\|*u*\\| over the links, integrated "
        "with the motion",
    ),
    "input_peak": (
        "force",
        "largest \\|*u*<sub>j</sub>\\| over links and time, from the polynomials of all steps",
    ),
    **STEPS,
}
"""Scalars of every motion of a chain."""

TRACKED: Scalars = {
    "time_outside_tube": (
        "time",
        "total time with \\|*e*\\| > *λ*, between crossings located as events",
    ),
    "capture_time": (
        "time",
        "time of the last entry into the tube, after which \\|*e*\\| ≤ *λ* until the end; 0 if "
        "the error never leaves; unknown if it ends outside. A warning says if this is less than "
        "a period before the end, because the error may leave again",
    ),
}
"""Scalars of every chain that follows a reference."""

JUDGED: Scalars = {
    "capture_time": TRACKED["capture_time"],
    "time_outside_tube": ("time", "total time with \\|*e*\\| > *λ* after `tube.capture`"),
    "error_peak": ("length", "largest \\|*e*\\| after `tube.capture`"),
    "error_integral": ("length_squared_time", "∫\\|*e*\\|² d*t*"),
    "input_integral": ("effort", "∫\\|*u*\\|² d*t*"),
    **{name: CHAIN[name] for name in ("input_rms", "input_peak", "distance", "mean_speed")},
    "work": ("energy", "positive work of the actuators, without recovery"),
    "net_work": ("energy", "net work of the actuators, with recovery"),
    "energy_per_mass_distance": (
        "acceleration",
        "`work` divided by total mass and distance; unknown if the worm does not advance",
    ),
}
"""Scalars of a chain judged by a tube from its capture time on."""

COST_OF_TRANSPORT: Scalars = {
    "cost_of_transport": (
        "1",
        'energy divided by weight and distance, with `units = "SI"` only, because a dimensionless '
        "scene has no gravity. The weight uses standard gravity, listed in the trust report under "
        "`assumptions`. Unknown if the energy is unknown",
    ),
}
"""Additional scalars of scenes in SI units."""
