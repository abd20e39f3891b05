"""What a float on a film over switched coils did: numbers, checks and warnings of its own."""

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
"""Largest values, over the float's length, what is dissipated, and the largest force on it."""
_KEEPS_UP = 0.9  # of a pitch, in a switch
_AFLOAT = 0.01  # of the depth
_HEAVY = 0.5  # draught over depth from which on it is told


def float_of(table: CargoTable, layer: Layer) -> Float:
    """Make the float of a scene, no stiffer than what counts as rigid."""
    return Float(
        table.length,
        table.density * table.thickness * table.length,
        min(_stiffness(table), rigid(layer, table.length)),
        table.edge or 0.0,
    )


def _stiffness(table: CargoTable) -> float:
    return table.modulus * table.thickness**3 / 12


def scalars_of(layer: Layer, cargo: Float, motion: Trajectory, rough: Trajectory) -> dict[str, Any]:
    """Numbers of a float's motion; `rough` is that on half the cells."""
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
    """Share of the switches, after the first pattern, over which the float keeps up."""
    ways = np.diff(X[:: table.course.samples])[table.switching.on :]
    return float(np.mean(ways >= _KEEPS_UP * table.coils.pitch)) if ways.size else 0.0


def _bend(x: np.ndarray, z: np.ndarray) -> float:
    if len(x) < 3:
        return 0.0
    return float(np.abs(z - np.polyval(np.polyfit(x - x[0], z, 1), x - x[0])).max())


def checks_of(scalars: dict[str, Any], cargo: Float, layer: Layer) -> Iterator[Check]:
    """Checks of a float's motion."""
    off = 3 * scalars["float_grid_error"] / cargo.length
    yield Check(
        "float on half the cells", off, ACCEPTED["float on half the cells"],
        f"half the cells change where the float ends by {off:.2g} of its length; raise grid.cells",
    )  # fmt: skip
    yield Check(
        "energy", scalars["energy_error"], ACCEPTED["energy"],
        f"the balance of energy is open by {scalars['energy_error']:.2g} of what is dissipated; "
        "lower grid.tolerance",
    )  # fmt: skip
    yield Check(
        "momentum", scalars["momentum_error"], ACCEPTED["momentum"],
        f"the film bears {scalars['momentum_error']:.2g} less or more than it pushes the float; "
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
    """What is assumed of a float, and near its limits."""
    yield (
        "the float spans the trough from side to side, lies on the film with all of its underside, "
        "and its vertical inertia is left out"
    )
    share = scalars["draught"] / film.depth
    if share > _HEAVY:
        yield left_out(share, f"the float presses the film down by {share:.2g} of its depth")
    if _stiffness(table) > cargo.stiffness:
        yield (
            "the float counts as rigid: a heap as high as the film is deep would bend it by less "
            "than a hundredth of the depth, and it is computed as of cargo.modulus = "
            f"{12 * cargo.stiffness / table.thickness**3:.2g} Pa"
        )
