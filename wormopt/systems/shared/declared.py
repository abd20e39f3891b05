"""Numbers that results of several kinds hold: name, quantity, dimensions and meaning."""

from __future__ import annotations

from collections.abc import Mapping

Scalars = dict[str, tuple[str, str]]
"""Name: quantity, meaning."""
Variables = dict[str, tuple[str, tuple[str, ...], str]]
"""Name: quantity, dimensions, long name."""
Declared = Mapping[str, tuple[str, tuple[str, ...], str]]
"""The same, to be read only."""


def over(signals: Declared, *before: str, last: str = "time") -> Variables:
    """Put dimensions before the own ones of signals, and that of time after them."""
    return {k: (quantity, (*before, *own, last), w) for k, (quantity, own, w) in signals.items()}


TIME: Variables = {"time": ("time", ("time",), "time")}
INSTANT: Variables = {"instant": ("time", ("instant",), "time")}

CHAIN_SIGNALS: Variables = {
    "position": ("length", ("mass",), "position of the mass"),
    "velocity": ("speed", ("mass",), "velocity of the mass"),
    "length": ("length", ("link",), "link length"),
    "input": ("force", ("link",), "force u of the actuator"),
    "link_force": ("force", ("link",), "force in the link, positive where it pulls"),
    "contact_force": ("force", ("mass",), "force of the ground"),
    "energy": ("energy", (), "kinetic and elastic energy"),
    "center_velocity": ("speed", (), "velocity of the centre of mass"),
}
"""Signals of a chain, with the dimensions that are their own."""

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
    "event_contact": ("count", ("event",), "contact, -1 for a switch"),
    "event_mode": ("count", ("event",), "direction from then on"),
    "rest_start": ("time", ("rest",), "begin of the rest"),
    "rest_end": ("time", ("rest",), "end of the rest"),
    "rest_contact": ("count", ("rest",), "contact that rests"),
}
"""Events, and rests of contacts."""

TRACKER_EVENTS: Variables = EVENTS | {
    "event_tracker": ("count", ("event",), "tracker"),
    "rest_tracker": ("count", ("rest",), "tracker"),
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
"""A gait, exactly."""

STEPS: Scalars = {
    "n_events": (
        "count",
        "events located: reversals, sticks, releases, impacts of masses, crossings of the tube, "
        "switches of the controller",
    ),
    "n_steps": ("count", "steps of the integrator"),
    "recheck_error": (
        "share",
        "largest difference of any state at the end between both routes, each against the larger "
        "of its size and its usual size",
    ),
}
"""What every simulation tells of itself."""

CHAIN: Scalars = {
    "x_end": ("length", "positions at the end, a list head first"),
    "v_end": ("speed", "velocities at the end"),
    "distance": ("length", "way of the centre of mass from start to end"),
    "mean_speed": ("speed", "`distance` by time"),
    "input_rms": (
        "force",
        "root of the mean over time of \\|*u*\\|², Euclidean over the links, integrated with the "
        "motion",
    ),
    "input_peak": (
        "force",
        "largest \\|*u*<sub>j</sub>\\| over links and time, found on the polynomials of all steps",
    ),
    **STEPS,
}
"""What is told of every motion of a chain."""

TRACKED: Scalars = {
    "time_outside_tube": (
        "time",
        "how long \\|*e*\\| > *λ*, between crossings that are located as events",
    ),
    "capture_time": (
        "time",
        "last entry into the tube, from which on \\|*e*\\| ≤ *λ* to the end; 0 if the error never "
        "left; unknown if it ends outside. Where that is less than a period before the end, a "
        "warning says that the error may leave again",
    ),
}
"""What is told of every chain that follows a reference."""

JUDGED: Scalars = {
    "capture_time": TRACKED["capture_time"],
    "time_outside_tube": ("time", "how long \\|*e*\\| > *λ* after `tube.capture`"),
    "error_peak": ("length", "largest \\|*e*\\| after `tube.capture`"),
    "error_integral": ("length_squared_time", "∫\\|*e*\\|² d*t*"),
    "input_integral": ("effort", "∫\\|*u*\\|² d*t*"),
    **{name: CHAIN[name] for name in ("input_rms", "input_peak", "distance", "mean_speed")},
    "work": ("energy", "of the actuators: positive power of each, nothing recovered"),
    "net_work": ("energy", "of the actuators: what flows back too"),
    "energy_per_mass_distance": (
        "acceleration",
        "`work` by total mass and distance; unknown where the worm does not advance",
    ),
}
"""What is told of a chain judged by a tube from its time of capture on."""

OPTIMUM: Scalars = {
    "time": ("time", "how long it takes"),
    "objective": ("speed", "what was minimised; of a speed its negative"),
    "input_rms": (
        "force",
        "root of the mean of \\|*u*\\|²; unknown where inputs act by impulses",
    ),
    "input_peak": ("force", "largest \\|*u*<sub>j</sub>\\|; unknown where inputs act by impulses"),
    "defect_max": ("share", "largest local error of an arc, in nominal sizes of states"),
    "complementarity_max": (
        "share",
        "largest product of a part of a contact's velocity and the distance of its force from "
        "sliding",
    ),
    "recheck_error": (
        "share",
        "largest difference between its end and that of a simulation with the inputs found",
    ),
    "solve_iterations": ("count", "iterations of all solves"),
    "n_phases": (
        "count",
        "phases; one ends where a contact changes its mode, or an input reaches or leaves its "
        "limit",
    ),
    "mode_sequence": (
        "count",
        "per phase the modes of all contacts (0 rests, +1 and −1 slides)",
    ),
    "phase_times": ("time", "times at which phases begin, and the end"),
}
"""What is told of every optimal motion."""

COST_OF_TRANSPORT: Scalars = {
    "cost_of_transport": (
        "1",
        'energy by weight and distance, with `units = "SI"` only: a dimensionless scene has no '
        "gravity. The weight is that under standard gravity, which the trust report names among "
        "its `assumptions`; unknown where the energy is",
    ),
}
"""What scenes in SI units tell besides energies."""
