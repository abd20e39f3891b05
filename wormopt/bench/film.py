"""A film over switched coils: time against error, beside SciPy on the same semi-discretisation."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp
from scipy.sparse import csc_matrix

from wormopt.bench.run import (
    OWN,
    Found,
    aligned,
    axes,
    compared,
    curve,
    least,
    save,
    seconds,
    timed,
)
from wormopt.errors import SolveError
from wormopt.model.model import pack
from wormopt.progress import Report, silent
from wormopt.scene import load_scene
from wormopt.systems.coils.film import coil_film
from wormopt.systems.coils.runs.coil_film import Setup, setup_of

_SWITCHES, _FEW = 10, 3
_REFERENCE = 1e-10  # tolerance of SciPy's Radau, in depths times the width of a cell
_TOLERANCES: dict[str, tuple[float, ...]] = {
    OWN: (1e-4, 1e-5, 1e-6, 1e-7, 1e-8),
    "scipy Radau": (1e-3, 1e-4, 1e-5, 1e-6),
    "scipy BDF": (1e-3, 1e-4, 1e-5, 1e-6),
}

_GOAL = 1e-4  # error at which times are compared

End = Callable[[float], np.ndarray]


def measured(_name: str, quick: bool, report: Report) -> Iterator[Found]:
    """Follow the packaged film through its first switches, in all ways and to all tolerances.

    An own time has the making of the integrator in it, as users pay it; SciPy is given compiled
    equations and a compiled sparse Jacobian. `quick`: fewer switches, the looser tolerances.
    """
    switches = _FEW if quick else _SWITCHES
    setup = setup_of(load_scene("fig24_travelling_wave", [f"course.switches={switches}"]))
    rates, jacobian = _compiled(setup)
    ways: dict[str, End] = {OWN: partial(_own, setup)} | {
        name: partial(_scipy, setup, rates, jacobian, name.removeprefix("scipy "))
        for name in list(_TOLERANCES)[1:]
    }
    report("film: reference", 0.0)
    known = ways["scipy Radau"](_REFERENCE if not quick else 1e-8)
    tasks = [(name, each) for name in ways for each in _TOLERANCES[name][: 2 if quick else None]]
    rows: list[Found] = []
    for k, (name, tolerance) in enumerate(tasks):
        report(f"film: {name} {tolerance:g}", (k + 1) / (len(tasks) + 1))
        spent, end = timed(ways[name], tolerance)
        error = float(np.abs(end - known).max() / setup.layer.depth)
        rows.append({"method": name, "tolerance": tolerance, "error": error, "seconds": spent})
        yield {"cells": setup.layer.cells, "switches": switches, "runs": rows}


def _own(setup: Setup, tolerance: float) -> np.ndarray:
    return setup.follow(tolerance, silent)["thickness"][:, -1]


def _compiled(setup: Setup) -> tuple[ca.Function, ca.Function]:
    """Rates of the scaled state and their Jacobian, of (x, currents)."""
    film = coil_film(
        setup.layer, setup.row, ground=setup.ground, top=setup.top, own_field=setup.own_field
    )
    x, scale = ca.SX.sym("x", film.n_x), film.x[0].nominal
    ode = ca.substitute(film.ode, pack(film.x), scale * x) / scale
    inputs = [x, pack(film.u)]
    return (
        ca.Function("rates", inputs, [ode], {"cse": True}),
        ca.Function("jacobian", inputs, [ca.jacobian(ode, x)], {"cse": True}),
    )


def _scipy(
    setup: Setup, rates: ca.Function, jacobian: ca.Function, method: str, tolerance: float
) -> np.ndarray:
    """Thickness at the end, integrated from switch to switch."""
    course, layer = setup.course, setup.layer
    x, lasts = np.zeros(layer.cells - 1), float(course.breaks[1])
    pattern: Any = jacobian.sparsity_out(0)
    rows, columns = np.array(pattern.row()), np.array(pattern.colind())
    shape = (layer.cells - 1, layer.cells - 1)
    for k in range(round(setup.end / lasts)):
        u = course.on_piece(k % course.pieces, np.zeros(1))[:, 0]

        def slope(_t: float, y: np.ndarray, u: np.ndarray = u) -> np.ndarray:
            return np.asarray(rates(y, u)).ravel()

        def matrix(_t: float, y: np.ndarray, u: np.ndarray = u) -> csc_matrix:
            return csc_matrix((jacobian(y, u).nonzeros(), rows, columns), shape)

        given = {"method": method, "jac": matrix, "rtol": tolerance, "atol": tolerance}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)
            found = solve_ivp(slope, (0.0, lasts), x, **given)
        if not found.success:
            raise SolveError(found.message, "take another tolerance")
        x = found.y[:, -1]
    return layer.depth * (1 + np.diff(np.concatenate([[0.0], x, [0.0]])))


# -- telling ---------------------------------------------------------------------------------------


def ratios(found: Mapping[str, Any]) -> dict[str, float]:
    """Our fastest run over that of every other way, of those that are good enough."""
    good = (r for r in found["runs"] if r["error"] <= _GOAL)
    return compared(least((r["method"], r["seconds"]) for r in good))


def lines(found: Mapping[str, Any]) -> list[str]:
    """The runs in a table."""
    told = [f"film: {found['switches']} switches, {found['cells']} cells, error over the depth"]
    rows = [
        (r["method"], f"{r['tolerance']:.0e}", f"{r['error']:.1e}", seconds(r["seconds"]))
        for r in found["runs"]
    ]
    return told + aligned(("method", "tolerance", "error", "time"), *rows)


def draw(found: Mapping[str, Any], path: Path) -> None:
    """Draw time against error to a PNG file."""
    figure, left = axes("error of the thickness at the end, over the depth", "time (s)")
    for k, method in enumerate(dict.fromkeys(r["method"] for r in found["runs"])):
        own: Sequence[Any] = [r for r in found["runs"] if r["method"] == method]
        curve(left, k, own, "error", "seconds", label=method)
    save(figure, path)
