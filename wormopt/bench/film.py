"""A film over switched coils: time against error, beside SciPy on the same semi-discretisation."""

from __future__ import annotations

import warnings
from functools import partial
from typing import Any

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp
from scipy.sparse import csc_matrix

from wormopt.bench.ladder import Run, Task, Way
from wormopt.bench.run import OWN
from wormopt.errors import SolveError
from wormopt.model.model import pack
from wormopt.progress import silent
from wormopt.study import load_scene
from wormopt.systems.coils.film import coil_film
from wormopt.systems.coils.runs.coil_film import Setup, setup_of

_SWITCHES, _FEW = 10, 3
_REFERENCE = 1e-10  # tolerance of SciPy's Radau, in depths times the width of a cell
_TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6)


def task(_name: str, quick: bool) -> Task:
    """Follow the packaged film through its first switches.

    An own time has the making of the integrator in it, as users pay it; SciPy is given compiled
    equations and a compiled Jacobian, sparse where the method takes one. `quick`: fewer switches.
    """
    switches = _FEW if quick else _SWITCHES
    setup = setup_of(load_scene("fig24_travelling_wave", [f"course.switches={switches}"]))
    known = _scipy(setup, "Radau")(1e-8 if quick else _REFERENCE)
    return Task(
        f"{switches} switches of the travelling wave, {setup.layer.cells} cells",
        "SciPy's Radau at its finest",
        "thickness at the end, over the depth",
        "relative tolerance",
        1e-4,
        known,
        [
            Way(OWN, partial(_own, setup), (1e-4, 1e-5, 1e-6, 1e-7, 1e-8)),
            *(
                Way(f"SciPy {method}", partial(_scipy, setup, method), _TOLERANCES)
                for method in ("Radau", "BDF", "LSODA")
            ),
        ],
        setup.layer.depth,
    )


def _own(setup: Setup) -> Run:
    return lambda tolerance: setup.follow(tolerance, silent)["thickness"][:, -1]


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


def _scipy(setup: Setup, method: str) -> Run:
    rates, jacobian = _compiled(setup)
    return partial(_followed, setup, rates, jacobian, method)


def _followed(
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

        def matrix(_t: float, y: np.ndarray, u: np.ndarray = u) -> Any:
            found = csc_matrix((jacobian(y, u).nonzeros(), rows, columns), shape)
            return found.toarray() if method == "LSODA" else found

        given = {"method": method, "jac": matrix, "rtol": tolerance, "atol": tolerance}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)
            found = solve_ivp(slope, (0.0, lasts), x, **given)
        if not found.success:
            raise SolveError(found.message, "take another tolerance")
        x = found.y[:, -1]
    return layer.depth * (1 + np.diff(np.concatenate([[0.0], x, [0.0]])))
