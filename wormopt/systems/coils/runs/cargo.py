"""Scalars, checks and warnings of a float on a film over switched coils."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from wormopt.result import Check, left_out
from wormopt.simulation.trajectory import Trajectory
from wormopt.systems.coils.cargo import Float, rigid
from wormopt.systems.coils.layer import Layer
from wormopt.systems.coils.scenes.coil_film import CargoTable, CoilFilmScene, CoilFilmTable

ACCEPTED = {"float on half the cells": 0.1, "energy": 0.01, "momentum": 0.1}
"""Accepted errors over the float's length, the dissipation, and its largest force."""
_KEEPS_UP = 0.9  # share of a pitch moved per switch
_AFLOAT = 0.01  # share of the depth
_HEAVY = 0.5  # draught over depth from which a warning is given


def float_of(table: CargoTable, layer: Layer) -> Float:
    """Return the float of a scene, with its stiffness limited to that of a rigid float."""
    return Float(
        table.length,
        table.density * table.thickness * table.length,
        min(_stiffness(table), rigid(layer, table.length)),
        table.edge or 0.0,
    )


def _stiffness(table: CargoTable) -> float:
    return table.modulus * table.thickness**3 / 12


def scalars_of(layer: Layer, cargo: Float, motion: Trajectory, rough: Trajectory) -> dict[str, Any]:
    """Return scalars of a float's motion; `rough` is the motion on half the cells."""
    X, h = motion["position"][0], motion["thickness"]
    work, lost, energy = (motion[name][0] for name in ("field_work", "dissipated", "energy"))
    push, pressed, shear = (motion[name][0] for name in ("push", "pressed", "shear"))
    below = np.abs(layer.places[:, None] - X) <= max(cargo.length, 1.01 * layer.step) / 2
    # nothing moves yet at time 0
    forces = max(float(np.abs(push).max() + np.abs(shear).max()), 1e-300)
    gap = np.abs(energy - energy[0] - work + lost)
    return {
        "draught": cargo.mass / layer.fluid.density / cargo.length,
        "float_travel": float(X[-1] - X[0]),
        "float_speed": float((X[-1] - X[0]) / (motion.time[-1] - motion.time[0])),
        "float_bend": max(
            _bend(layer.places[on], z[on]) for z, on in zip(h.T, below.T, strict=True)
        ),
        "float_clearance": float(h[below].min()),
        "float_grid_error": float(abs(rough["position"][0, -1] - X[-1]) / 3),
        "energy_error": float(gap.max() / max(lost[-1], 1e-300)),
        "momentum_error": float(np.abs(push - pressed)[1:].max() / forces),
    }


def captured(table: CoilFilmScene, X: np.ndarray) -> float:
    """Return the share of switches, after the first pattern, over which the float keeps up."""
    ways = np.diff(X[:: table.course.samples])[table.switching.on :]
    return float(np.mean(ways >= _KEEPS_UP * table.coils.pitch)) if ways.size else 0.0


def _bend(x: np.ndarray, z: np.ndarray) -> float:
    if len(x) < 3:
        return 0.0
    return float(np.abs(z - np.polyval(np.polyfit(x - x[0], z, 1), x - x[0])).max())


def checks_of(scalars: dict[str, Any], cargo: Float, layer: Layer) -> Iterator[Check]:
    """Yield checks of a float's motion."""
    off = 3 * scalars["float_grid_error"] / cargo.length
    yield Check(
        "float on half the cells", off, ACCEPTED["float on half the cells"],
        f"half the cells change the float's end by {off:.2g} of its length; raise grid.cells",
    )  # fmt: skip
    yield Check(
        "energy", scalars["energy_error"], ACCEPTED["energy"],
        f"energy is not balanced; the error is {scalars['energy_error']:.2g} of the dissipation; "
        "lower grid.tolerance",
    )  # fmt: skip
    yield Check(
        "momentum", scalars["momentum_error"], ACCEPTED["momentum"],
        f"the forces on film and float differ by {scalars['momentum_error']:.2g}; "
        "raise grid.cells or cargo.edge",
    )  # fmt: skip
    clear = scalars["float_clearance"] / layer.depth
    yield Check(
        "afloat", _AFLOAT / max(clear, 1e-300), 1.0,
        f"{clear:.2g} of the film's depth is left below the float: it touches the ground; lower "
        "cargo.density or cargo.thickness, or raise film.depth",
    )  # fmt: skip


def warnings_of(
    table: CargoTable, film: CoilFilmTable, cargo: Float, scalars: dict[str, Any]
) -> Iterator[str]:
    """Yield assumptions about a float, and warnings near its limits."""
    yield (
        "the float spans the trough from side to side, its whole underside lies on the film, and "
        "its vertical inertia is neglected"
    )
    share = scalars["draught"] / film.depth
    if share > _HEAVY:
        yield left_out(share, f"the float presses the film down by {share:.2g} of its depth")
    if _stiffness(table) > cargo.stiffness:
        yield (
            "the float counts as rigid: a load as high as the film's depth would bend it by less "
            "than a hundredth of the depth, and it is computed with cargo.modulus = "
            f"{12 * cargo.stiffness / table.thickness**3:.2g} Pa"
        )
