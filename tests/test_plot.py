"""Pictures: written whole, labelled with units, honest about failure, legible for every n."""

import dataclasses
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.collections import LineCollection
from matplotlib.colors import same_color
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from PIL import Image

from wormopt.plotting import PICTURES, draw, figure
from wormopt.plotting.parts import LINKS, stretches
from wormopt.quantities import Scalar, Variable
from wormopt.result import Result
from wormopt.systems.channel.plots import rod

UNITS = {
    "time": "s",
    "length": "m",
    "rate": "m s-1",
    "position": "m",
    "reaction": "N",
    "reaction_mean": "N",
    "sigma": "N",
    "actuator_force": "N",
}


def shuffle(links: int, units: bool = True) -> Result:
    """A worm whose masses rest one after another, tail first, and which glides at the end."""
    masses, phases = links + 1, links + 2
    time = np.concatenate([np.linspace(p, p + 1, 9) for p in range(phases)]) / phases
    phase = np.repeat(np.arange(phases), 9)
    resting = np.array([phase == masses - 1 - i for i in range(masses)]).astype(int)
    rate = np.array([resting[j] - resting[j + 1] for j in range(links)])
    arrays = {
        "time": time,
        "resting": resting,
        "length": 1 + 0.2 * np.array([np.sin(2 * np.pi * time + j) for j in range(links)]),
        "rate": rate,
        "position": 0.6 * time - np.arange(masses)[:, None],
        "reaction": 9.0 * resting,
        "reaction_mean": 9.0 * resting.sum(axis=0) / masses,
        "sigma": 10 * np.cos(phase),
        "actuator_force": 4.0 * rate,
    }
    variables = tuple(
        Variable(name, UNITS.get(name, "1") if units else "1", dims_of(values, links), values)
        for name, values in arrays.items()
    )
    scalars = {
        "speed": Scalar(0.6, "m s-1"),
        "length_limits": Scalar([0.7, 1.3]),
        "rate_limit": Scalar([1.5] * links),
        "spike_load_limit": Scalar(12.0),
        "actuator_force_limit": Scalar(5.0),
    }
    return Result("shuffle", "gait", "Größe λ — 1 $", scalars=scalars, variables=variables)


def dims_of(values: np.ndarray, links: int) -> tuple[str, ...]:
    return ("time",) if values.ndim == 1 else ("link" if len(values) == links else "mass", "time")


def front() -> Result:
    columns = {"front_speed": [0.5, 0.3, 0.7], "front_value": [12.0, 9.0, 20.0]}
    variables = [Variable(name, "N", ("point",), np.array(v)) for name, v in columns.items()]
    variables.append(Variable("front_accepted", "1", ("point",), np.array([1, 1, 0])))
    scalars = {"front_objective": Scalar("peak_spike_load"), "ceiling": Scalar(1.0)}
    return Result("front", "gait-pareto", "", scalars=scalars, variables=tuple(variables))


def weighed(objective: str = "speed") -> Result:
    """A limit that helps when raised, one when lowered, one that counts for one side, idle ones."""
    elasticity = Variable("limit_elasticity", "1", ("limit",), np.array([0.8, -0.3, 0.1, 0.0, 0.0]))
    names = ["gait.rate", "worm.mass", "worm.load", "gait.period", "gait.sigma_margin"]
    known = {
        "objective": objective,
        "name": names,
        "value": [1.0, 2.0, 5.0, 1.0, 0.0],
        "unit": ["m s-1", "kg", "N", "s", "N"],
        "one_sided": [name == "worm.load" for name in names],
    }
    return Result("weighed", "gait-design", variables=(elasticity,), attributes={"limits": known})


def crawl(trackers: int = 1, links: int = 2, funnel: bool = False) -> Result:
    """A chain under trackers: mass 0 rests at first, tracker by tracker a little longer."""
    time, masses = np.linspace(0.0, 2.0, 41), links + 1
    wave = np.sin(2 * np.pi * time)
    each, per_link = np.arange(trackers)[:, None, None], np.arange(links)[:, None]
    length = 2 + 0.3 * wave + 0.1 * per_link + 0.01 * each
    position = time - 2.0 * np.arange(masses)[:, None] + 0.01 * each
    arrays = {
        "time": (("time",), time, "s"),
        "reference": (("link", "time"), length[0] + 0.1, "m"),
        "length": (("tracker", "link", "time"), length, "m"),
        "input": (("tracker", "link", "time"), 5 * length, "N"),
        "position": (("tracker", "mass", "time"), position, "m"),
        "error_norm": (("tracker", "time"), 0.3 * np.abs(wave) + 0 * each[..., 0], "m"),
        "tube": (("tracker", "time"), np.full((trackers, 41), 0.2), "m"),
        "gain": (("tracker", "time"), 1 + time + each[..., 0], "1"),
        "rest_start": (("rest",), np.zeros(trackers), "s"),
        "rest_end": (("rest",), 0.5 + 0.1 * np.arange(trackers), "s"),
        "rest_contact": (("rest",), np.zeros(trackers, dtype=int), "1"),
        "rest_tracker": (("rest",), np.arange(trackers), "1"),
    }
    if funnel:
        arrays["funnel"] = (("tracker", "time"), 0.3 + np.exp(-time) + 0 * each[..., 0], "m")
    variables = tuple(Variable(name, unit, dims, v) for name, (dims, v, unit) in arrays.items())
    names = [f"tracker no. {k}" for k in range(trackers)]
    scalars = {"distance": Scalar(2.0, "m"), "mean_speed": Scalar(1.0, "m s-1")}
    return Result("crawl", "track", scalars=scalars, variables=variables,
                  attributes={"trackers": names})  # fmt: skip


def herd(trackers: int = 1) -> Result:
    """An ensemble: every signal of `crawl` spread out."""
    single = crawl(trackers)
    kept = [v for v in single.variables if v.name in ("time", "reference", "tube")]
    shares = np.array([0.05, 0.25, 0.5, 0.75, 0.95])
    kept.append(Variable("quantile", "1", ("quantile",), shares))
    for name in ("length", "input", "position", "error_norm", "gain"):
        found = single[name]
        spread = 0.1 * (shares - 0.5).reshape(-1, *[1] * (found.values.ndim - 1))
        dims = ("tracker", "quantile", *found.dims[1:])
        kept.append(Variable(f"{name}_band", found.unit, dims, found.values[:, None] + spread))
    return dataclasses.replace(single, variables=tuple(kept))


def own(contacts: int = 1) -> Result:
    """A model of one's own with a contact that rests, or a chain."""
    time = np.linspace(0.0, 2.0, 41)
    variables = [
        Variable("time", "s", ("time",), time),
        Variable("height", "m", ("time",), np.cos(time)),
        Variable("bend_angle", "rad", ("bend_angle_entry", "time"), np.array([time, 2 * time])),
        Variable("rest_start", "s", ("rest",), np.array([0.0, 1.0])),
        Variable("rest_end", "s", ("rest",), np.array([0.5, 1.5])),
        Variable("rest_contact", "1", ("rest",), np.array([0, contacts - 1])),
    ]
    names = ["foot"] if contacts == 1 else [f"mass {i}" for i in range(contacts)]
    attributes = {"signals": ["height", "bend_angle"], "contacts": names}
    return Result("own", "simulate", variables=tuple(variables), attributes=attributes)


def compared() -> Result:
    """Two controllers of one reference, the second a plan that was not found."""
    time, names = np.linspace(0.0, 2.0, 41), ["tracker (13)", "optimal tube"]
    error = np.array([[0.1 + np.abs(np.sin(time)), np.full(41, np.nan)]])
    drawn = np.array([[np.linspace(1.0, 2.0, 5), np.full(5, np.nan)]])
    units = {"time_outside_tube": "s", "error_peak": "m", "input_rms": "N", "distance": "m"}
    variables = [
        Variable("time", "s", ("time",), time),
        Variable("error_norm", "m", ("reference", "rival", "time"), error),
        *(
            Variable(f"drawn_{name}", unit, ("reference", "rival", "member"), drawn)
            for name, unit in units.items()
        ),
    ]
    scalars = {name: Scalar([[1.5, None]], unit) for name, unit in units.items()}
    return Result(
        "rivals", "compare-tracking", scalars=scalars | {"tube_radius": Scalar(0.2, "m")},
        variables=tuple(variables), attributes={"rivals": names, "references": ["gait (15)"]},
    )  # fmt: skip


def relaxed() -> Result:
    """Relaxed contact that tends to the exact one with order 1."""
    width, arcs = 0.1 * 0.4 ** np.arange(4.0), np.array([30, 60, 120])
    variables = [
        Variable("width", "m s-1", ("width",), width),
        Variable("smoothed_error", "m s-1", ("width",), 0.1 * width),
        Variable("arcs", "1", ("arcs",), arcs),
        Variable("complementarity_error", "m s-1", ("arcs",), 0.05 / arcs),
    ]
    bars = {f"objective_{k}_error_bar": Scalar(1e-3) for k in ("smoothed", "complementarity")}
    return Result("relaxed", "optimal-crawl", scalars=bars, variables=tuple(variables))


def stretched() -> Result:
    """A bar that a field lengthens beyond small strains."""
    strain = np.linspace(0.0, 0.2, 41)
    variables = [
        Variable("strain", "1", ("strain",), strain),
        Variable("stress_with_field", "Pa", ("strain",), 1e4 * (strain - 0.15)),
        Variable("stress_without_field", "Pa", ("strain",), 2e4 * strain),
    ]
    scalars = {"field": Scalar(1e5, "A m-1"), "u0": Scalar(0.15), "small_strain": Scalar(0.1)}
    return Result("bar", "material", scalars=scalars, variables=tuple(variables))


def driven() -> Result:
    """A pair under a field that jumps; mass 2 rests for a while."""
    time = np.linspace(0.0, 4.0, 81)
    wave = np.cos(np.pi * time / 2)
    rows = {"field": 1 + np.sign(wave), "field_harmonic": 1 + wave}
    rows |= {"stretch": 1.3 * np.sin(time), "stretch_harmonic": 0.8 * np.sin(time)}
    variables = [Variable("instant", "s", ("instant",), time)]
    variables += [Variable(name, "1", ("instant",), row) for name, row in rows.items()]
    velocity = np.vstack([0.4 - wave, 0.4 + wave])
    variables.append(Variable("velocity", "m s-1", ("mass", "instant"), velocity))
    modes = [[-1, 1], [1, 1], [1, 0], [1, -1]]
    scalars = {"speed": Scalar(0.4, "m s-1"), "mode_sequence": Scalar(modes)}
    scalars |= {"phase_times": Scalar([0.0, 1.0, 2.0, 2.2, 4.0], "s")}
    return Result("pair", "pair-waveform", scalars=scalars, variables=tuple(variables))


def pulled() -> Result:
    """A pair from rest, and its averages; the second begins later."""
    time, late = np.linspace(0.0, 10.0, 101), np.linspace(8.0, 10.0, 41)
    steady = 0.3 * (1 - np.exp(-time))
    rows = {"velocity": steady + 0.01 * np.cos(9 * time), "velocity_period": steady}
    rows |= {"velocity_first": 1.02 * steady}
    rows |= {"velocity_second": np.where(time < 1, np.nan, steady)}
    variables = [
        Variable("time", "s", ("time",), time),
        Variable("late_time", "s", ("late",), late),
    ]
    variables += [Variable(name, "m s-1", ("time",), row) for name, row in rows.items()]
    variables.append(Variable("late_velocity", "m s-1", ("late",), 0.3 + 0.01 * np.cos(9 * late)))
    scalars = {"velocity_steady": Scalar(0.3), "velocity_stated": Scalar(0.35, "m s-1")}
    return Result("pull", "magnetic-pair", scalars=scalars, variables=tuple(variables))


def resonant() -> Result:
    """A branch that turns back at a detuning of 1.5, and exact motions beside its stable part."""
    arc = np.linspace(0.0, np.pi, 61)
    detuning, size = 1.5 * np.sin(arc), 1.1 + np.cos(arc)
    curve = {"detuning": detuning, "velocity": 0.7 * size, "amplitude": size}
    curve |= {"stable": (arc < np.pi / 2).astype(int), "branch": np.zeros(61, dtype=int)}
    variables = [Variable(f"curve_{name}", "1", ("curve",), row) for name, row in curve.items()]
    points = {"detuning": detuning[:20], "velocity_exact": 0.71 * size[:20]}
    variables += [Variable(name, "1", ("point",), row) for name, row in points.items()]
    scalars = {"delta_fold": Scalar([1.5]), "eps": Scalar(0.03)}
    return Result("fold", "resonance", scalars=scalars, variables=tuple(variables))


def pooled() -> Result:
    """A layer that a coil below lifts in the middle."""
    x, share = np.linspace(-0.02, 0.02, 41), np.linspace(0.0, 1.0, 9)
    surface = 0.01 + 0.002 * np.exp(-((x / 0.005) ** 2))
    map_x, map_z = np.linspace(-0.02, 0.02, 21), np.linspace(-0.01, 0.02, 16)
    distance = np.hypot(map_x, (map_z + 0.015)[:, None])
    inside = share[:, None] * surface
    rows = {
        "x": (("x",), x, "m"),
        "surface": (("x",), surface, "m"),
        "pressure": (("x",), 1e4 * surface, "Pa"),
        "inside_x": (("x",), x, "m"),
        "inside_z": (("share", "x"), inside, "m"),
        "inside_pressure": (("share", "x"), 1e4 * (surface - inside), "Pa"),
        "map_x": (("map_x",), map_x, "m"),
        "map_z": (("map_z",), map_z, "m"),
        "induction_x": (("map_z", "map_x"), map_x / distance**3 * 1e-9, "T"),
        "induction_z": (("map_z", "map_x"), 1e-9 / distance**2, "T"),
    }
    variables = tuple(Variable(name, unit, dims, v) for name, (dims, v, unit) in rows.items())
    scalars = {"pressure_without_field": Scalar(100.0, "Pa"), "pressure_max": Scalar(120.0, "Pa")}
    winding = [[-0.01, -0.008, 0.005, 0.004], [0.005, -0.008, 0.005, 0.004]]
    return Result("pool", "coil-pressure", scalars=scalars, variables=variables,
                  attributes={"winding": winding})  # fmt: skip


def skinned() -> Result:
    """Membranes that leak less and stretch less the thicker they are."""
    thickness = np.geomspace(5e-5, 1e-3, 31)
    rows = {"thickness": thickness, "loss": 2e-6 / thickness, "strain": 1e-5 / thickness}
    rows |= {"contact_pressure": 2e3 - 1e5 * thickness}
    rows |= {"within": (thickness > 2e-4).astype(int)}
    variables = tuple(Variable(f"front_{name}", "1", ("front",), v) for name, v in rows.items())
    scalars = {"thickness_best": Scalar(2e-4, "m"), "loss_share": Scalar(0.01)}
    scalars |= {"strain": Scalar(0.05), "contact_pressure": Scalar(1980.0, "Pa")}
    scalars |= {"loss_max": Scalar(0.01), "strain_max": Scalar(0.2), "limited_by": Scalar("loss")}
    return Result("skin", "membrane", scalars=scalars, variables=variables)


def squeezed(measured: bool = True) -> Result:
    """Two shapes of a segment in a channel, and what (32) makes of them."""
    share, frequency = np.linspace(0.0, 1.0, 41), np.linspace(5.0, 1000.0, 11)
    y = 2e-3 + 6e-3 * np.array([share, share**2 * (3 - 2 * share)])
    rows = {
        "share": (("share",), share),
        "x": (("shape", "share"), 1e-2 * np.array([share, share])),
        "y": (("shape", "share"), y),
        "theta": (("shape", "share"), np.array([0.5 + 0 * share, 3.6 * share * (1 - share)])),
        "distance_max": (("shape", "other"), 6e-4 * (1 - np.eye(2))),
        "exact": (("shape",), np.array([0, 1])),
        "frequency": (("frequency",), frequency),
        "velocity": (("shape", "frequency"), np.outer([1e-3, 1.2e-3], frequency)),
    }
    variables = tuple(Variable(name, "1", dims, values) for name, (dims, values) in rows.items())
    scalars = {"shapes": Scalar(["line", "point_contact"]), "exact_shapes": Scalar(["sleeve"])}
    scalars |= {"velocity_per_frequency": Scalar([1e-3, 1.2e-3], "m")}
    scalars |= {"arc_length": Scalar([11.7e-3, 12e-3], "m"), "channel": Scalar(10e-3, "m")}
    scalars |= {"body": Scalar(4e-3, "m"), "closest_shape": Scalar(["line"])}
    scalars |= {"closest_distance": Scalar([6e-4], "m")}
    scalars |= {f"measured{end}": Scalar([value] if measured else []) for end, value in
                (("", "seen"), ("_frequency", 50.0), ("_velocity", 0.0556))}  # fmt: skip
    limits = (50.0, 700.0) if measured else (None, None)
    scalars |= dict(zip(("valid_below", "stops_above"), map(Scalar, limits), strict=True))
    return Result("squeeze", "segment-shapes", scalars=scalars, variables=variables)


def stepped() -> Result:
    """One link that goes out and back in steps of 10 micrometres."""
    time, turn = np.linspace(0.0, 2.0, 41), np.linspace(0.9, 1.1, 21)
    length, close = (0.1 - 1e-3 * np.cos(np.pi * t) for t in (time, turn))
    rows = {
        "length": (("link", "time"), length[None], "m"),
        "commanded": (("link", "time"), np.round(length, 5)[None], "m"),
        "turn_rate": (("link", "time"), 3 * np.sin(np.pi * time)[None], "s-1"),
        "position": (("mass", "time"), np.vstack([0 * time, -length]), "m"),
        "position_ideal": (("mass", "time"), np.vstack([0 * time + 1e-4, 1e-4 - length]), "m"),
        "time": (("time",), time, "s"),
        "turn_time": (("turn_time",), turn, "s"),
        "turn_length": (("turn_time",), close, "m"),
        "turn_commanded": (("turn_time",), np.round(close, 5), "m"),
        "turn_link": (("turn",), np.array([1]), "1"),
    }
    variables = tuple(Variable(name, unit, dims, v) for name, (dims, v, unit) in rows.items())
    scalars = {"turn_rate_limit": Scalar(4.0, "s-1"), "speed": Scalar(0.01, "m s-1")}
    return Result("rods", "gait", scalars=scalars, variables=variables)


def swinging(found: bool = True) -> Result:
    """Two masses that swing against each other; without the exact motion if it was not found."""
    share, time = np.linspace(0.0, 1.0, 61), np.linspace(0.0, 5.0, 41)
    wave = np.cos(2 * np.pi * share)
    variables = [
        Variable("share", "1", ("share",), share),
        Variable("relative_velocity", "m s-1", ("mass", "share"), np.array([wave, -wave])),
        Variable("time", "s", ("time",), time),
        Variable("center_velocity_averaged", "m s-1", ("time",), 0.5 - 0.5 * np.exp(-time)),
    ]
    if found:
        variables += [
            Variable("center_velocity", "m s-1", ("time",), 0.51 - 0.5 * np.exp(-time)),
            Variable("event_share", "1", ("event",), np.array([0.17, 0.33, 0.67, 0.83])),
            Variable("event_contact", "1", ("event",), np.array([1, 0, 0, 1])),
        ]
    scalars = {
        "velocity_steady": Scalar(0.5, "m s-1"),
        "velocity_exact_mean": Scalar(0.51 if found else None, "m s-1"),
        "steady_velocities": Scalar([-0.2, 0.5], "m s-1"),
        "steady_stable": Scalar([0, 1]),
    }
    return Result("swing", "harmonic-masses", scalars=scalars, variables=tuple(variables))


def pumped() -> Result:
    """A film under a wave, in SI units, beside waves of two other amplitudes."""
    xi, delta = np.linspace(0.0, 2 * np.pi, 81), np.linspace(0.1, 0.9, 9)
    rows = {"height": 1 + 0.5 * np.cos(xi), "surface_velocity": 0.4 * np.cos(xi)}
    rows |= {"film_pressure": np.sin(xi), "field_squared": 1 - np.sin(xi)}
    variables = [Variable("xi", "rad", ("xi",), xi), Variable("field", "A m-1", ("xi",), 1e4 * xi)]
    variables += [Variable(name, "1", ("xi",), row) for name, row in rows.items()]
    variables += [
        Variable("curve_delta", "1", ("curve_delta",), delta),
        Variable("curve_mean_flow", "1", ("curve_delta",), delta**2),
        Variable("curve_square_wave", "1", ("curve_delta",), delta),
        Variable("field_delta", "1", ("field_delta",), np.array([0.2, 0.6])),
        Variable("field_curves", "1", ("field_delta", "xi"), np.outer([1, 4], 1 - np.sin(xi))),
    ]
    scalars = {"delta": Scalar(0.5), "mean_flow": Scalar(0.25), "d_max": Scalar(1.0)}
    return Result("film", "film-flow", scalars=scalars, variables=tuple(variables))


def carried(tracers: bool = True) -> Result:
    """Two floats, one held by the wave, and two points of the fluid."""
    time, xi = np.linspace(0.0, 60.0, 121), np.linspace(0.0, 2 * np.pi, 81)
    velocities = np.array([0.8 + 0.2 * np.cos(xi), 0.5 + 0.1 * np.cos(xi)])
    variables = [
        Variable("time", "1", ("time",), time),
        Variable("float_position", "1", ("body", "time"), np.outer([1.0, 0.5], time)),
        Variable("xi", "rad", ("xi",), xi),
        Variable("height", "1", ("xi",), 1 + 0.5 * np.cos(xi)),
        Variable("body_velocity", "1", ("body", "xi"), velocities),
    ]
    scalars = {"float_length": Scalar([0.0, 0.5]), "trapped": Scalar([True, False])}
    if tracers:
        places, heights = np.outer([0.2, 1.0], time), np.outer([0.3, 0.9], np.ones(len(time)))
        variables += [
            Variable("tracer_position", "1", ("tracer", "time"), places),
            Variable("tracer_height", "1", ("tracer", "time"), heights),
        ]
        scalars |= {"tracer_trapped": Scalar([False, True])}
        scalars |= {"tracer_drift_closed": Scalar([0.2, 1.0])}
    return Result("ride", "float", scalars=scalars, variables=tuple(variables))


def switched() -> Result:
    """A row of three coils of which one is on at a time."""
    place, phase = np.linspace(-0.01, 0.03, 41), np.linspace(0, 6.2, 32)
    field = 1e4 * np.exp(-(((place - 0.01 * np.arange(3)[:, None]) / 5e-3) ** 2))
    mean = 1e8 * (1 + np.cos(phase))
    variables = [
        Variable("place", "m", ("place",), place),
        Variable("time", "s", ("time",), np.array([0.01, 0.03, 0.05])),
        Variable("field", "A m-1", ("time", "place"), field),
        Variable("coil_place", "m", ("coil",), np.array([0.0, 0.01, 0.02])),
        *(Variable(f"square_{name}", "A2 m-2", ("phase",), share * mean)
          for name, share in (("low", 0.9), ("mean", 1.0), ("high", 1.1), ("target", 0.97))),
        Variable("phase", "rad", ("phase",), phase),
        Variable("current", "A", ("coil", "time"), 3000 * np.eye(3)),
    ]  # fmt: skip
    scalars = {"ripple": Scalar(0.1), "currents_limit": Scalar(3000.0, "A")}
    return Result("row", "coil-row", scalars=scalars, variables=tuple(variables))


def moved() -> Result:
    """A film that breaks on its way from flat, its spectra, branches, and a map of four films."""
    time, xi = np.linspace(0.0, 60.0, 41), np.linspace(0.0, 2 * np.pi, 64, endpoint=False)
    h = 1 + np.outer(np.tanh(time / 10), 0.5 * np.cos(xi))
    rates = np.array([0.2, -0.5, -1.0])
    variables = [
        Variable("time", "1", ("time",), time),
        Variable("xi", "rad", ("xi",), xi),
        Variable("thickness", "1", ("time", "xi"), h),
        Variable("thickness_end", "1", ("xi",), h[-1]),
        Variable("thickness_wave", "1", ("xi",), 1 + 0.5 * np.cos(xi)),
        Variable("field_pressure", "1", ("xi",), 1 - np.sin(xi)),
        Variable("growth_wave", "1", ("mode_wave",), rates),
        Variable("swing_wave", "1", ("mode_wave",), 0 * rates),
        Variable("branch_delta", "1", ("branch",), np.array([0.1, 0.5, 0.9])),
        Variable("branch_thickness_max", "1", ("branch",), np.array([1.1, 1.5, 1.9])),
        Variable("branch_growth", "1", ("branch",), np.array([-1.0, -0.5, 0.5])),
        Variable("branch_number", "1", ("branch",), np.zeros(3)),
        Variable("map_delta", "1", ("map_delta",), np.array([0.5, 0.9])),
        Variable("map_tension", "1", ("map_tension",), np.array([0.1, 1.0])),
        Variable("map_outcome", "1", ("map_delta", "map_tension"), np.array([[0, 1], [2, 3]])),
        Variable("map_growth", "1", ("map_delta", "map_tension"), np.array([[-1, 0.5], [-2, 1.5]])),
    ]
    scalars = {"outcome": Scalar("breaks"), "tension_number": Scalar(0.1)}
    scalars |= {"growth_rate_max": Scalar(0.2), "delta_fold": Scalar([0.7])}
    scalars |= {"broke_time": Scalar(60.0), "broke_xi": Scalar(3.1)}
    return Result("film", "film-forward", scalars=scalars, variables=tuple(variables))


def designed(swept: bool = True) -> Result:
    """The best wave of a film beside the cosine, and two other films."""
    xi = np.linspace(0.0, 2 * np.pi, 81)
    rows = {"height": 1 + 0.5 * np.sign(np.cos(xi)), "field_pressure": 1 + np.sign(np.sin(xi))}
    rows |= {"surface_velocity": 0.4 + 0.5 * np.sign(np.cos(xi))}
    variables = [
        Variable("xi", "rad", ("xi",), xi),
        Variable("xi_cosine", "rad", ("xi_cosine",), xi),
    ]
    variables += [Variable(name, "1", ("xi",), row) for name, row in rows.items()]
    variables += [
        Variable(f"{name}_cosine", "1", ("xi_cosine",), 1 + 0.5 * np.cos(xi)) for name in rows
    ]
    if swept:
        variables += [
            Variable("sweep_tension", "1", ("sweep_tension",), np.array([0.1, 0.01])),
            Variable("sweep_field", "1", ("sweep_field",), np.array([2.0])),
            *(Variable(f"sweep_{name}", "1", ("sweep_tension", "sweep_field"), values)
              for name, values in (("mean_flow", np.array([[0.4], [0.45]])),
                                   ("mean_flow_cosine", np.array([[0.3], [0.3]])))),
        ]  # fmt: skip
    scalars = {"thickness_limits": Scalar([0.5, 1.5]), "field_limit": Scalar(None)}
    scalars |= {"field_range": Scalar(2.0), "mean_flow": Scalar(0.4)}
    scalars |= {"mean_flow_supremum": Scalar(0.46), "crests": Scalar(1)}
    return Result("wave", "film-wave", scalars=scalars, variables=tuple(variables))


def proven(leaves: bool = True) -> Result:
    """A bound that falls to a speed, and boxes of durations that fill a triangle."""
    time, unit = np.array([0.5, 1.0, 4.0]), "m s-1"
    variables = [
        Variable("proof_time", "s", ("proof",), time),
        Variable("proof_bound", unit, ("proof",), np.array([1.0, 0.9, 0.83])),
        Variable("proof_value", unit, ("proof",), 0 * time + 0.82),
    ]
    scalars = {"gap_certified": Scalar(0.012), "certified_phases": Scalar(3)}
    if leaves:
        low = np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [0.9, 0.9, 0.0]])
        high = np.array([[0.5, 1.0, 1.0], [1.0, 1.0, 1.0], [1.0, 1.0, 1.0]])
        dims = ("leaf", "leaf_phase")
        variables += [
            Variable("leaf_shortest", "s", dims, low),
            Variable("leaf_longest", "s", dims, high),
            Variable("leaf_bound", unit, dims[:1], np.array([0.7, 0.83, 0.6])),
        ]
        scalars |= {"leaf_sequence": Scalar([[0], [1, 2], [0, 2]])}
        scalars |= {"leaf_period": Scalar([0.5, 1.0]), "leaf_durations": Scalar([0.3, 0.3, 0.4])}
    return Result("proof", "gait-design", scalars=scalars, variables=tuple(variables))


def crawled() -> Result:
    """A rod that lies on the lower wall, and coils on both sides."""
    time, frame = np.linspace(0.0, 1.0, 21), np.linspace(0.5, 1.0, 144)
    x = np.linspace(0.0, 0.05, 9) - 0.01 * frame[:, None]
    rows = {
        "time": (("time",), time, "s"),
        "centre": (("time",), 0.03 - 0.02 * time, "m"),
        **{f"work_{name}": (("time",), sign * 1e-3 * time, "J")
           for name, sign in (("load", 1), ("friction", -1), ("damping", -1), ("walls", 0))},
        "frame": (("frame",), frame, "s"),
        "rod_x": (("frame", "node"), x, "m"),
        "rod_y": (("frame", "node"), 0 * x - 3e-3, "m"),
        "rod_angle": (("frame", "node"), 0 * x, "rad"),
        "pressed_upper": (("frame", "node"), 0 * x, "N"),
        "pressed_lower": (("frame", "node"), 0 * x + 0.1, "N"),
        "first_coil": (("frame",), np.floor(20 * frame), "1"),
        "coils_on": (("frame",), 3 + 0 * frame, "1"),
    }  # fmt: skip
    variables = [Variable(name, unit, dims, v) for name, (dims, v, unit) in rows.items()]
    scalars = {"velocity_mean": Scalar(-0.02, "m s-1"), "energy_error": Scalar(1e-4)}
    known = {"channel": 10e-3, "body": 4e-3, "pitch": 10e-3, "every": 7}
    coil = {"coil": [2e-3, 9e-3, 20e-3, 1e-3]}
    return Result("rod", "rod-motion", scalars=scalars, variables=tuple(variables),
                  attributes=known | coil)  # fmt: skip


def answered(searched: bool = True) -> Result:
    """Velocities of a rod that rise, fall and turn over the frequency."""
    columns = {"rate": [5.0, 50.0, 500.0], "velocity": [-0.01, -0.09, 0.03], "error": [1e-3] * 3}
    variables = [Variable(f"curve_{k}", "1", ("curve",), np.array(v)) for k, v in columns.items()]
    scalars: dict[str, Any] = {"velocity_per_frequency_slow": -2e-3, "eigenfrequencies": [7.0]}
    scalars |= {"frequency_best": 50.0, "velocity_best": -0.09}
    if searched:
        variables += [
            Variable(f"refined_{k}", "1", ("refined",), np.array(v)) for k, v in columns.items()
        ]
        dims = ("parameter", "factor", "sensitive_rate")
        changed = -0.05 * np.arange(1.0, 9.0).reshape(2, 2, 2)
        variables += [
            Variable("sensitive_rate", "s-1", dims[2:], np.array([20.0, 100.0])),
            Variable("changed_velocity", "m s-1", dims, changed),
            Variable("changed_factor", "1", dims, np.broadcast_to([[0.5], [2.0]], (2, 2, 2))),
            Variable("unchanged_velocity", "m s-1", dims[2:], np.array([-0.1, -0.2])),
            Variable("unchanged_error", "m s-1", dims[2:], np.array([1e-2, 1e-2])),
        ]
        scalars |= {"pattern_rate": 60.0, "pattern_velocity": -0.1}
    marks = {"measured": [[100.0, 0.08, "seen"]], "parameters": ["density", "friction"]}
    return Result("answer", "rod-frequency", variables=tuple(variables), attributes=marks,
                  scalars={k: Scalar(v) for k, v in scalars.items()})  # fmt: skip


def sample(picture: str) -> Result:
    made = {"front": front, "limits": weighed, "trackers": crawl, "bands": herd, "signals": own}
    made |= {"comparison": compared, "draws": compared, "convergence": relaxed}
    made |= {"waveform": driven, "stress_strain": stretched}
    made |= {"velocity": pulled, "resonance": resonant}
    made |= {"coil_pressure": pooled, "membrane": skinned, "steps": stepped}
    made |= {"channel_velocity": squeezed, "segment_shapes": squeezed}
    made |= {"travelling_field": switched, "row_currents": switched}
    made |= {"reversals": swinging, "film": pumped, "ride": carried}
    made |= {"certificate": proven, "rod_motion": crawled, "rod_frequency": answered}
    made |= {"forward": moved, "basins": moved, "film_wave": designed}
    return made[picture]() if picture in made else shuffle(2)


def texts(drawn: Figure) -> str:
    titles = [axes.get_title(loc="left") for axes in drawn.axes]
    return " ".join([drawn.get_suptitle(), *titles]).replace("\n", " ")


@pytest.mark.parametrize("picture", sorted(PICTURES.keys() - {"animation"}))
def test_every_picture_is_written(picture: str, tmp_path: Path):
    path = tmp_path / f"{picture}.png"
    draw(sample(picture), picture, path)
    with Image.open(path) as image:
        assert min(image.size) > 500
        assert len(image.convert("RGB").getcolors(1_000_000) or []) > 20
    assert list(tmp_path.iterdir()) == [path]


def test_bars_of_limits_tell_which_way_helps():
    for objective, colours in (("speed", LINKS[::3]), ("peak_spike_load", LINKS[3::-3])):
        axes = figure(weighed(objective), "limits").axes[0]
        bars = [bar for bar in axes.patches if isinstance(bar, Rectangle)]
        assert [bar.get_width() for bar in bars] == [0.8, -0.3, 0.1]
        assert all(same_color(bars[k].get_facecolor(), colours[k]) for k in (0, 1))
        ticks = [text.get_text() for text in axes.get_yticklabels()]
        assert ticks[1:] == ["worm.mass = 2 kg", "worm.load = 5 N"]
        assert [text.get_text() for text in axes.texts] == ["+0.8", "-0.3", "+0.1 *"]
        notes = axes.get_title(loc="left")
        assert "influence: gait.period" in notes
        assert "0: gait.sigma_margin" in notes


@pytest.mark.parametrize("links", range(1, 9))
def test_pictures_for_every_number_of_links(links: int):
    for picture in ("gait", "motion", "spikes", "animation"):
        drawn = figure(shuffle(links), picture)
        drawn.draw_without_rendering()
        assert drawn.axes


@pytest.mark.parametrize("picture", PICTURES)
def test_axes_carry_symbols_and_units(picture: str):
    drawn = figure(sample(picture), picture)
    last = [axes for axes in drawn.axes if axes.get_label() != "<colorbar>"][-1]
    assert last.get_xlabel().endswith(")")
    assert "$" in last.get_xlabel()
    first = [axes for axes in drawn.axes if (at := axes.get_subplotspec()) and at.is_first_col()]
    labelled = [axes.get_ylabel() for axes in first if len(axes.get_yticks())]
    assert all(labelled)
    bare = figure(shuffle(2, units=False), "gait")
    assert bare.axes[0].get_ylabel() == "link length $l_j$"


def test_reversals_are_drawn_without_an_exact_motion_too():
    whole, lost = (figure(swinging(found), "reversals").axes for found in (True, False))
    assert len(whole[1].get_lines()) == len(lost[1].get_lines()) + 1
    dots = [line for line in whole[0].get_lines() if line.get_marker() == "o"]
    assert [float(np.ravel(dot.get_xdata())[0]) for dot in dots] == [0.17, 0.33, 0.67, 0.83]
    assert not [line for line in lost[0].get_lines() if line.get_marker() == "o"]
    legend = whole[1].get_legend()
    assert legend
    labels = [text.get_text() for text in legend.get_texts()]
    assert labels == ["exact", "averaged, order 1", "steady, not stable", "steady"]


def test_velocities_in_a_channel_show_what_was_measured_where_it_was():
    told, bare = (
        figure(squeezed(measured), "channel_velocity").axes[0] for measured in (True, False)
    )
    labels = told.get_legend_handles_labels()[1]
    assert labels[:3] == [
        "line: 1.000 mm a switch", "point_contact: 1.200 mm a switch", "seen: 55.6 mm/s"
    ]  # fmt: skip
    assert labels[3:] == [r"(32) not claimed: $n \geq$ 50", "stands still above 700, from the text"]
    (mark,) = (line for line in told.get_lines() if line.get_marker() == "o")
    assert np.ravel(mark.get_xydata()) == pytest.approx([50.0, 55.6])
    (shade,) = told.patches
    assert shade.get_window_extent().x0 == pytest.approx(told.transData.transform((50, 1))[0])
    assert len(bare.get_legend_handles_labels()[1]) == 2


def test_a_body_in_a_channel_is_drawn_as_thick_as_it_is():
    above, below = figure(squeezed(), "segment_shapes").axes
    outline = next(p for p in above.patches if p.get_label() == "body, point contact")
    corners = np.asarray(outline.get_path().vertices)
    assert corners[:, 1].min() == pytest.approx(0, abs=1e-12)
    assert corners[:, 1].max() == pytest.approx(10)
    assert [line.get_linestyle() for line in above.get_lines()] == ["--", "-"]
    assert len(below.get_lines()) == 1


def test_a_branch_is_dashed_where_it_is_not_stable_and_its_fold_marked():
    above = figure(resonant(), "resonance").axes[0]
    labels = {line.get_label(): line.get_linestyle() for line in above.get_lines()}
    assert labels["average"] == "-"
    assert labels["average, not stable"] == "--"
    assert [text.get_text() for text in above.texts] == ["fold 1.5"]


def test_a_ride_shows_velocities_where_there_are_no_tracers():
    with_tracers, without = (figure(carried(tracers), "ride").axes for tracers in (True, False))
    assert with_tracers[-1].get_ylabel() == "height $z$"
    assert without[-1].get_ylabel() == "velocity over the wave's"
    labels = with_tracers[0].get_legend_handles_labels()[1]
    assert labels == ["length 0, held", "length 0.5"]


def test_a_wave_is_drawn_without_other_films_too():
    whole, plain = (figure(designed(swept), "film_wave").axes for swept in (True, False))
    assert len(whole) == len(plain) + 1
    assert whole[-1].get_xlabel() == "surface tension ($W$)"
    assert plain[-1].get_xlabel() == whole[2].get_xlabel()


def test_fields_of_a_film_are_shown_over_their_mean():
    fields = next(a for a in figure(pumped(), "film").axes if a.get_ylabel().startswith("$H^2"))
    (one, other) = (np.asarray(line.get_ydata()) for line in fields.get_lines())
    assert one == pytest.approx(other)
    assert fields.get_legend_handles_labels()[1] == ["0.2: 1", "0.6: 4"]


def test_a_map_of_films_names_its_outcomes_and_marks_unstable_waves():
    drawn = figure(moved(), "basins")
    assert [text.get_text() for text in drawn.legends[0].get_texts()] == [
        "takes the wave", "another steady film", "still moves", "breaks"
    ]  # fmt: skip
    marked = {text.get_text(): text.get_color() for text in drawn.axes[0].texts}
    assert marked["+0.50"] == marked["+1.50"] != marked["-1.00"] == marked["-2.00"]


def test_a_course_marks_where_the_film_broke():
    course = figure(moved(), "forward").axes[0]
    (cross,) = (line for line in course.get_lines() if line.get_marker() == "x")
    assert np.ravel(cross.get_xydata()) == pytest.approx([3.1 / np.pi, 60 / (2 * np.pi)])


def test_units_are_raised():
    assert figure(shuffle(2), "gait").axes[1].get_ylabel() == r"rate $\dot l_j$ (m s$^{-1}$)"


def test_limits_are_thin_dashed_lines():
    lengths, rates, _ = figure(shuffle(2), "gait").axes
    for axes, limits in ((lengths, {0.7, 1.3}), (rates, {-1.5, 1.5})):
        dashed = [line for line in axes.get_lines() if line.get_linestyle() == "--"]
        assert {float(np.ravel(line.get_ydata())[0]) for line in dashed} == limits
    scalars = {
        "length_limits": Scalar([[0.7, 1.3], [0.6, 1.4]]),
        "rate_limit": Scalar([[1.0, 1.2], [2.0, 2.2]]),
    }
    apart = figure(dataclasses.replace(shuffle(2), scalars=scalars), "gait")
    for axes, limits in (
        (apart.axes[0], [0.7, 1.3, 0.6, 1.4]),
        (apart.axes[1], [-1, 2, -1.2, 2.2]),
    ):
        dashed = [line for line in axes.get_lines() if line.get_linestyle() == "--"]
        assert [float(np.ravel(line.get_ydata())[0]) for line in dashed] == limits
    without = figure(dataclasses.replace(shuffle(2), scalars={}), "gait")
    assert len(without.axes[0].get_lines()) == 2


def test_motion_shows_two_periods_and_the_masses_at_rest():
    (axes,) = figure(shuffle(2), "motion").axes
    heavy = [c for c in axes.collections if isinstance(c, LineCollection)]
    spans = [
        [np.asarray(path.vertices)[:, 1].tolist() for path in lines.get_paths()] for lines in heavy
    ]
    assert spans[:3] == [[[0.5, 0.75]], [[0.25, 0.5]], [[0.0, 0.25]]]
    assert spans[3:] == [[[1.5, 1.75]], [[1.25, 1.5]], [[1.0, 1.25]]]
    assert np.ravel(axes.get_lines()[3].get_xdata())[0] == pytest.approx(0.6)


@pytest.mark.parametrize("links", [1, 2, 8, 9, 30])
def test_pictures_of_chains_for_every_number_of_links(links: int):
    for picture in ("trackers", "motion"):
        drawn = figure(crawl(2, links, funnel=links == 2), picture)
        drawn.draw_without_rendering()
    shown = [text.get_text() for text in drawn.legends[0].get_texts()]
    assert shown[-1] == "rests"
    assert len(shown) == (links + 2 if links <= 8 else 3)


def test_trackers_stand_side_by_side_on_the_same_scales():
    drawn = figure(crawl(3, funnel=True), "trackers")
    axes = np.array(drawn.axes[:15]).reshape(5, 3)
    assert [a.get_title(loc="left") for a in axes[0]] == [f"tracker no. {k}" for k in range(3)]
    for row in axes:
        assert len({a.get_ylim() for a in row}) == 1
        assert row[0].get_ylabel()
    # the strip is lambda wide on either side of the reference
    strip = np.asarray(axes[0, 0].collections[0].get_paths()[0].vertices)
    reference = crawl()["reference"].values[0]
    assert strip[:, 1].min() == pytest.approx(reference.min() - 0.2)
    assert strip[:, 1].max() == pytest.approx(reference.max() + 0.2)


def test_motions_of_simulations_mark_each_tracker_s_own_rests():
    axes = figure(crawl(2), "motion").axes
    for column, end in enumerate((0.5, 0.6)):
        (heavy,) = [c for c in axes[column].collections if isinstance(c, LineCollection)]
        path = np.asarray(heavy.get_paths()[0].vertices)
        assert path[:, 1].tolist() == [0.0, pytest.approx(end)]


def test_bands_hold_the_median():
    drawn = figure(herd(), "bands")
    lines = drawn.axes[0].get_lines()
    medians = [np.asarray(line.get_ydata()) for line in lines if line.get_linestyle() == "-"]
    assert medians[0] == pytest.approx(crawl()["length"].values[0, 0])


@pytest.mark.parametrize("contacts", [1, 3, 12])
def test_signals_show_rests_as_shades_or_as_a_band(contacts: int):
    drawn = figure(own(contacts), "signals")
    drawn.draw_without_rendering()
    assert len(drawn.axes) == (2 if contacts == 1 else 3)
    assert drawn.axes[1].get_ylabel() == "bend\nangle (rad)"
    assert ("shaded: at rest" in texts(drawn)) == (contacts == 1)


def test_failed_results_are_marked():
    failed = dataclasses.replace(sample("gait"), status="failed", reason="spike_load is too low")
    for picture in ("gait", "motion", "spikes", "animation"):
        assert "failed: spike_load is too low" in texts(figure(failed, picture))
        assert "failed" not in texts(figure(shuffle(2), picture))


def test_a_front_shows_what_was_not_accepted_hollow():
    (axes,) = figure(front(), "front").axes
    good, bad, _ = axes.get_lines()
    assert np.asarray(good.get_xdata()).tolist() == [0.3, 0.5]
    assert np.asarray(bad.get_xdata()).tolist() == [0.7]
    assert bad.get_markerfacecolor() == "none"
    assert axes.get_ylabel() == r"largest load on a spike, max $\lambda_i$ (N)"


def test_missing_variables_are_named_and_leave_no_file(tmp_path: Path):
    result = Result("walk", "gait", variables=(Variable("time", "s", ("time",), np.arange(2.0)),))
    with pytest.raises(KeyError, match="resting, length, rate") as caught:
        draw(result, "gait", tmp_path / "gait.png")
    assert "'gait'" in caught.value.__notes__[0]
    with pytest.raises(ValueError, match="no picture 'portrait'; there are gait, motion"):
        draw(result, "portrait", tmp_path / "portrait.png")
    assert list(tmp_path.iterdir()) == []


def test_a_picture_that_cannot_be_written_leaves_the_old_one(tmp_path: Path):
    path = tmp_path / "front.unknown"
    path.write_text("old")
    with pytest.raises(ValueError, match="unknown"):
        draw(front(), "front", path)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_the_animation_moves(tmp_path: Path):
    path = tmp_path / "animation.gif"
    draw(shuffle(2), "animation", path)
    assert path.stat().st_size < 2_000_000
    with Image.open(path) as film:
        assert getattr(film, "n_frames", 1) > 40
        first = np.asarray(film.convert("RGB"))
        film.seek(20)
        assert (np.asarray(film.convert("RGB")) != first).any()
    assert list(tmp_path.iterdir()) == [path]


def test_letters_without_a_glyph_do_no_harm(tmp_path: Path):
    draw(dataclasses.replace(front(), title="蠕虫 λ"), "front", tmp_path / "front.png")
    assert (tmp_path / "front.png").stat().st_size > 1000


def test_no_pyplot_state():
    code = "import sys, wormopt.plotting; sys.exit('matplotlib.pyplot' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_stretches():
    time = np.array([0.0, 1.0, 1.0, 2.0, 3.0])
    holds = np.array([True, True, False, True, True])
    assert stretches(time, holds) == [(0.0, 1.0), (2.0, 3.0)]
    assert stretches(time, np.array([False, True, True, False, False])) == []


def test_coils_that_are_on_are_told_from_those_that_are_not():
    """Of the pattern of seven, three are on: dark rectangles in every lane."""
    drawn = figure(crawled(), "rod_motion").axes[0]
    dark = [p for p in drawn.patches if isinstance(p, Rectangle) and _is(p, "#D98C3F")]
    pale = [p for p in drawn.patches if isinstance(p, Rectangle) and _is(p, "#EADFCF")]
    assert dark
    assert 0.5 < len(pale) / len(dark) < 3


def _is(patch: Rectangle, colour: str) -> bool:
    return same_color(patch.get_facecolor(), colour)


def test_an_animation_of_a_rod_is_drawn_frame_by_frame():
    result = crawled()
    drawn = figure(result, "animation")
    before = drawn.axes[0].texts[0].get_text()
    rod.pose(drawn, result, 100)
    assert drawn.axes[0].texts[0].get_text() != before


def test_velocity_over_frequency_shows_marks_best_pattern_and_bars():
    drawn = figure(answered(), "rod_frequency")
    legend = drawn.axes[0].get_legend()
    assert legend is not None
    words = " ".join(text.get_text() for text in legend.get_texts())
    assert "seen" in words
    assert "best pattern" in words
    assert len(drawn.axes) == 3
    assert len(figure(answered(searched=False), "rod_frequency").axes) == 1


def test_boxes_of_durations_fill_what_the_period_allows_and_no_more():
    bound, boxes, _bar = figure(proven(), "certificate").axes
    assert len(figure(proven(leaves=False), "certificate").axes) == 1
    assert "gap certified 0.012" in bound.get_title(loc="left")
    parts = [path.vertices for path in boxes.collections[0].get_paths()]
    assert len(parts) == 2  # nothing is left of the box in which h_1 + h_2 > 1
    corners = np.concatenate([np.asarray(part) for part in parts]).sum(axis=1)
    assert corners.max() == pytest.approx(1.0)
    x, y = (np.concatenate([np.asarray(part)[:, k] for part in parts]) for k in (0, 1))
    assert min(x) == 0.0
    assert min(y) == 0.0
    areas = [_area(np.asarray(part)) for part in parts]
    # the triangle h_1 + h_2 <= 1 without that of h_1 + h_2 < 0.5 - h_3, which is empty
    assert sum(areas) == pytest.approx(0.5)


def _area(corners: np.ndarray) -> float:
    x, y = corners.T
    return 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))
