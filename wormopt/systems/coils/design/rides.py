"""How fast patterns of currents carry a float: the full film and float, made for many patterns.

The Model of `film.py` in steps of the pattern instead of seconds, with the rate as a number and the
currents of each piece as inputs: one integrator serves all patterns, CVODES beginning anew at each
corner.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from wormopt.errors import interruptible
from wormopt.magnetics.coils import CoilRow
from wormopt.systems.coils.cargo import Float
from wormopt.systems.coils.film import coil_film
from wormopt.systems.coils.layer import Layer
from wormopt.systems.coils.design.pattern import Pattern

_STEPS = 4000


@dataclass(frozen=True)
class Rides:
    """A float on a film over a row, along which patterns go `steps` steps from the flat film on."""

    layer: Layer
    row: CoilRow
    ground: float  # m
    top: float  # m
    own_field: bool
    cargo: Float
    start: float  # of the float, m
    steps: int
    per_step: int
    tolerance: float = 1e-3

    def speed(self, pattern: Pattern) -> float:
        """Mean speed in m/s; minus infinity where the film cannot be followed, or goes too high."""
        begin, growth = pattern.pieces(self.row.count, self.steps)
        inputs = np.vstack([begin, growth, np.arange(begin.shape[1])])
        try:
            with interruptible():
                found = _solver(self)(x0=self._scaled_start, p=pattern.rate, u=inputs)["xf"]
        except RuntimeError:
            return -np.inf
        states = np.array(found)
        volume = np.pad(states[:-2], ((1, 1), (0, 0)))
        # in units of the depth, as volume is in those of a cell's
        high = self.layer.depth * (1 + np.diff(volume, axis=0).max())
        if not np.all(np.isfinite(states)) or high > self.top:
            return -np.inf
        travel = states[-2, -1] * self.cargo.length - self.start
        return float(travel * pattern.rate / self.steps)

    @property
    def _scaled_start(self) -> np.ndarray:
        start = np.zeros(self.layer.cells + 1)
        start[-2] = self.start / self.cargo.length
        return start


@lru_cache(maxsize=2)
def _solver(rides: Rides) -> ca.Function:
    """Integrator over all corners; states of nominal size 1, time in values of the pattern."""
    film = coil_film(
        rides.layer, rides.row, ground=rides.ground, top=rides.top, own_field=rides.own_field,
        cargo=rides.cargo,
    )  # fmt: skip
    moved = film.x[:3]  # volume, position, velocity; what is counted besides is not needed
    states = ca.vertcat(*(one.symbol for one in moved))
    scale = np.concatenate([np.full(one.size, one.nominal) for one in moved])
    x, rate, t = ca.SX.sym("x", len(scale)), ca.SX.sym("rate"), ca.SX.sym("t")
    u = ca.SX.sym("u", 2 * rides.row.count + 1)
    begin, growth = u[: rides.row.count], u[rides.row.count : -1]
    ode = ca.substitute(
        [film.ode[: len(scale)]],
        [states, film.u[0].symbol],
        [x * scale, begin + growth * (t - u[-1])],
    )[0]
    system = {"t": t, "x": x, "p": rate, "u": u, "ode": ode / (scale * rate * rides.per_step)}
    options = {
        "reltol": rides.tolerance, "abstol": rides.tolerance, "max_num_steps": _STEPS,
        "disable_internal_warnings": True, "show_eval_warnings": False,
        "min_step_size": 1e-12,
    }  # fmt: skip
    grid = np.arange(1.0, rides.steps * rides.per_step + 1).tolist()
    return ca.integrator("ride", "cvodes", system, 0.0, grid, options)
