"""Displacement of a float by another integrator: SciPy's Radau, from corner to corner."""

from __future__ import annotations

import casadi as ca
import numpy as np

from wormopt.systems.coils.design.pattern import Pattern
from wormopt.systems.coils.design.rides import Rides
from wormopt.systems.coils.film import coil_film

_TOLERANCE = 1e-5


def travel_by_radau(rides: Rides, pattern: Pattern) -> float:
    """Return the float's displacement in m, with the Model's equations in SI and time in s."""
    from scipy.integrate import solve_ivp  # needed by checks only
    from scipy.sparse import csc_array

    film = coil_film(
        rides.layer, rides.row, ground=rides.ground, top=rides.top, own_field=rides.own_field,
        cargo=rides.cargo,
    )  # fmt: skip
    x = ca.vertcat(*(one.symbol for one in film.x[:3]))
    scale = np.concatenate([np.full(one.size, one.nominal) for one in film.x[:3]])
    given = [x, film.u[0].symbol]
    ode = film.ode[: len(scale)]
    rate, slopes = (ca.Function("f", given, [part]) for part in (ode, ca.jacobian(ode, x)))
    state = np.zeros(len(scale))
    state[-2] = rides.start
    pieces = (part.T for part in pattern.pieces(rides.row.count, rides.time))
    for begin, slope, length in zip(*pieces, strict=True):

        def current(t: float, begin: np.ndarray = begin, slope: np.ndarray = slope) -> np.ndarray:
            return begin + slope * t

        found = solve_ivp(
            lambda t, x, now=current: np.array(rate(x, now(t))).ravel(), (0.0, length), state,
            method="Radau", rtol=_TOLERANCE, atol=_TOLERANCE * scale,
            jac=lambda t, x, now=current: csc_array(slopes(x, now(t)).sparse()),
        )  # fmt: skip
        if not found.success:
            return float("nan")
        state = found.y[:, -1]
    return float(state[-2] - rides.start)
