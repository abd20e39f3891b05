"""A film over switched coils: time against error, beside SciPy on the same semi-discretisation."""

from __future__ import annotations

import warnings
from functools import partial
from typing import Any

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp
from scipy.sparse import csc_matrix

from tests.benchmarks.ladder import Run, Task, Way
from tests.benchmarks.run import OWN
from wormopt.errors import SolveError
from wormopt.model.model import pack
from wormopt.study import load_scene
from wormopt.systems.coils.coil_film import CoilFilm

_SWITCHES, _FEW = 10, 3
_REFERENCE = 1e-10  # tolerance of SciPy's Radau, in depths times the width of a cell
_TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6)


def task(_name: str, quick: bool) -> Task:
    """Follow the packaged film through its first switches.

    An own time has the making of the integrator in it, as users pay it; SciPy is given compiled
    equations and a compiled Jacobian, sparse where the method takes one. `quick`: fewer switches.
    """
    switches = _FEW if quick else _SWITCHES
    film: CoilFilm = load_scene("fig24_travelling_wave", [f"time.switches={switches}"]).table
    known = _scipy(film, "Radau")(1e-8 if quick else _REFERENCE)
    return Task(
        f"{switches} switches of the travelling wave, {film.layer.cells} cells",
        "SciPy's Radau at its finest",
        "thickness at the end, over the depth",
        "relative tolerance",
        1e-4,
        known,
        [
            Way(OWN, partial(_own, film), (1e-4, 1e-5, 1e-6, 1e-7, 1e-8)),
            *(
                Way(f"SciPy {method}", partial(_scipy, film, method), _TOLERANCES)
                for method in ("Radau", "BDF", "LSODA")
            ),
        ],
        film.layer.depth,
    )


def _own(film: CoilFilm) -> Run:
    return lambda tolerance: film.follow(film.currents, film.layer, tolerance)["thickness"][:, -1]


def _compiled(film: CoilFilm) -> tuple[ca.Function, ca.Function]:
    """Rates of the scaled state and their Jacobian, of (x, terms of the field)."""
    model = film.setup(film.layer).model_by_terms()
    x, scale = ca.SX.sym("x", model.n_x), model.x[0].nominal
    ode = ca.substitute(model.ode, pack(model.x), scale * x) / scale
    inputs = [x, pack(model.u)]
    return (
        ca.Function("rates", inputs, [ode], {"cse": True}),
        ca.Function("jacobian", inputs, [ca.jacobian(ode, x)], {"cse": True}),
    )


def _scipy(film: CoilFilm, method: str) -> Run:
    rates, jacobian = _compiled(film)
    return partial(_followed, film, rates, jacobian, method)


def _followed(
    film: CoilFilm, rates: ca.Function, jacobian: ca.Function, method: str, tolerance: float
) -> np.ndarray:
    """Thickness at the end, integrated from switch to switch."""
    currents, layer = film.currents, film.layer
    x, lasts = np.zeros(layer.cells - 1), float(currents.breaks[1])
    pattern: Any = jacobian.sparsity_out(0)
    rows, columns = np.array(pattern.row()), np.array(pattern.colind())
    shape = (layer.cells - 1, layer.cells - 1)
    for k in range(film.time.switches):
        u = film.field.terms(currents.on_piece(k % currents.pieces, np.zeros(1))[:, 0])

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
