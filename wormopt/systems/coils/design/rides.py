"""Speed of a float under patterns of currents, for many patterns, and by a second integrator.

The Model of `film.py` over one piece of a pattern, its length and currents as parameters: one
integrator serves all pieces of all patterns.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from wormopt.errors import interruptible
from wormopt.systems.coils.cargo import Float
from wormopt.systems.coils.design.pattern import Pattern
from wormopt.systems.coils.film import FilmSetup

_STEPS = 1000
_RADAU = 1e-5


@dataclass(frozen=True)
class Rides(FilmSetup):
    """A float on a film over a row, for a given time from a flat film, under patterns."""

    cargo: Float
    time: float  # s
    tolerance: float = 1e-3

    def speed(self, pattern: Pattern) -> float:
        """Return the mean speed in m/s; minus infinity if the simulation fails or leaves `top`."""
        state, solver = np.zeros(self.layer.cells + 1), _solver(self)
        state[-2] = self.start / self.cargo.length
        for begin, slope, length in zip(
            *(part.T for part in pattern.pieces(self.row.count, self.time)), strict=True
        ):
            inputs = np.concatenate([[length], begin, slope * length])
            try:
                with interruptible():
                    state = np.array(solver(x0=state, p=inputs)["xf"]).ravel()
            except RuntimeError:
                return -np.inf
            # volumes are in units of that of a flat cell
            high = self.layer.depth * (1 + np.diff(state[:-2], prepend=0.0, append=0.0).max())
            if not np.all(np.isfinite(state)) or high > self.top:
                return -np.inf
        return float(state[-2] * self.cargo.length - self.start) / self.time


@lru_cache(maxsize=2)
def _solver(rides: Rides) -> ca.Function:
    """Return the integrator over a piece, from 0 to 1; states of nominal size 1."""
    film = rides.model()
    moved = film.x[:3]  # volume, position, velocity; further states are not needed
    states = ca.vertcat(*(one.symbol for one in moved))
    scale = np.concatenate([np.full(one.size, one.nominal) for one in moved])
    x, t, p = ca.SX.sym("x", len(scale)), ca.SX.sym("t"), ca.SX.sym("p", 2 * rides.row.count + 1)
    length, begin, growth = ca.vertsplit(p, [0, 1, rides.row.count + 1, p.numel()])
    (ode,) = ca.substitute(
        [film.ode[: len(scale)]], [states, film.u[0].symbol], [x * scale, begin + growth * t]
    )
    system = {"t": t, "x": x, "p": p, "ode": ca.cse(ode / scale * length)}
    options = {
        "reltol": rides.tolerance, "abstol": rides.tolerance, "max_num_steps": _STEPS,
        "min_step_size": 1e-12, "disable_internal_warnings": True, "show_eval_warnings": False,
    }  # fmt: skip
    return ca.integrator("ride", "cvodes", system, 0.0, 1.0, options)


def travel_by_radau(rides: Rides, pattern: Pattern) -> float:
    """Return the float's displacement in m by SciPy's Radau, from corner to corner.

    The Model's equations are in SI, with time in s.
    """
    from scipy.integrate import solve_ivp  # needed by checks only
    from scipy.sparse import csc_array

    film = rides.model()
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
            method="Radau", rtol=_RADAU, atol=_RADAU * scale,
            jac=lambda t, x, now=current: csc_array(slopes(x, now(t)).sparse()),
        )  # fmt: skip
        if not found.success:
            return float("nan")
        state = found.y[:, -1]
    return float(state[-2] - rides.start)
