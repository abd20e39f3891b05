"""The same motion by other means, twice: as exact as can be, and with errors of known size put in.

Which other means depends on the cell: the closed form between events for chains that gaits command
(exact contact), solve_ivp with terminal events for trackers (exact contact), CVODES for smooth
contact. Where `simulate` has used an implicit integrator itself, and where references jump, it is
LSODA with an analytic Jacobian.
"""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np

from wormopt.bench.cells import Cell
from wormopt.bench.event_loop import Plant, event_loop
from wormopt.bench.linear_flow import linear_flow
from wormopt.bench.smoothed import Smoothed, called
from wormopt.model.model import Model

NAMES = ("closed form", "event loop", "CVODES", "LSODA")
_TIGHT, _LOOSE = 1e-13, 1e-11
_OFF = 1e-11  # size of the errors put in

Follow = Callable[[np.ndarray, float], np.ndarray]


def second_route(
    cell: Cell, model: Model, times: np.ndarray, *, implicit: bool
) -> tuple[str, np.ndarray, np.ndarray]:
    """Follow a cell's motion without `simulate`: name of the means, tight and loose (n_x, m).

    The loose motion starts off by 1e-11 of each state's size; steps that err do by 1e-11.
    `implicit`: the first route was, so this must not be. Raises whatever the means raise.
    """
    name, start, follow = _means(cell, model, times, implicit)
    dice = np.random.default_rng(0)
    off = _OFF * np.maximum(np.abs(start), 1.0) * dice.choice([-1.0, 1.0], len(start))
    if cell.v_reg is None:
        off[_velocities(cell)] = 0.0  # what rests shall go on resting
    return name, follow(start, _TIGHT), follow(start + off, _LOOSE)


def _velocities(cell: Cell) -> slice:
    masses = cell.worm.links + 1
    return slice(masses, 2 * masses)


def _means(
    cell: Cell, model: Model, times: np.ndarray, implicit: bool
) -> tuple[str, np.ndarray, Follow]:
    if cell.v_reg is None and cell.tracker is None:
        worm = cell.worm

        def flow(start: np.ndarray, tolerance: float) -> np.ndarray:
            reach = 1.0 if tolerance == _TIGHT else 0.7
            return linear_flow(worm, cell.span, times, start=start, reach=reach).states

        return "closed form", worm.start, flow
    if cell.v_reg is None:
        plant = _plant(cell, model)

        def loop(start: np.ndarray, tolerance: float) -> np.ndarray:
            return event_loop(
                plant,
                cell.span,
                times,
                start=start,
                relative=tolerance,
                absolute=0.1 * tolerance,
                max_step=0.005,
            ).states

        return "event loop", plant.start, loop
    smoothed = Smoothed(model, cell.v_reg)
    jumps = cell.group == "jumps"
    if implicit or jumps:  # CasADi goes on over jumps of controls without a new start
        return "LSODA", smoothed.start, lambda x, rtol: _lsoda(smoothed, times, x, rtol)
    return "CVODES", smoothed.start, lambda x, rtol: _cvodes(smoothed, times, x, rtol)


def _plant(cell: Cell, model: Model) -> Plant:
    """Closed loop of a tracker with the contact forces left open."""
    free = Smoothed(model, None)
    call, pieces = called(free.function), list(free.pieces(cell.span))
    starts = np.array([piece.start for piece in pieces])
    masses = cell.worm.links + 1

    def rates(t: float, y: np.ndarray, force: np.ndarray) -> np.ndarray:
        piece = pieces[max(int(starts.searchsorted(t, side="right")) - 1, 0)]
        return call(t, y, np.concatenate([piece.values, force]))

    velocity = np.arange(masses, 2 * masses)
    return Plant(rates, free.start, velocity, cell.worm.mass, cell.worm.grips, lambda _: starts[1:])


def _cvodes(
    smoothed: Smoothed, times: np.ndarray, start: np.ndarray, tolerance: float
) -> np.ndarray:
    t, x, q, ode = smoothed.expressions
    pieces = list(smoothed.pieces(float(times[-1])))
    grid = np.unique(np.concatenate([times, [piece.end for piece in pieces]]))
    grid = grid[grid > 0]
    ends = np.array([piece.end for piece in pieces])
    values = np.stack([p.values for p in pieces], axis=1)
    controls = values[:, np.searchsorted(ends, grid - 1e-13)]
    options = {"reltol": tolerance, "abstol": 0.1 * tolerance, "max_num_steps": 2_000_000}
    system = {"t": t, "x": x, "u": q, "ode": ode}
    integrator = ca.integrator("second", "cvodes", system, 0.0, grid, options)
    found = np.array(integrator(x0=start, u=controls)["xf"])
    return found[:, np.searchsorted(grid, times)]


def _lsoda(
    smoothed: Smoothed, times: np.ndarray, start: np.ndarray, tolerance: float
) -> np.ndarray:
    from scipy.integrate import solve_ivp

    rates, jacobian = called(smoothed.function), called(smoothed.jacobian)
    n, y = len(start), start
    found, sampled = np.empty((n, len(times))), 0
    for piece in smoothed.pieces(float(times[-1])):
        within = times[(times > piece.start) & (times <= piece.end)]
        done = solve_ivp(
            lambda t, x, q=piece.values: rates(t, x, q),
            (piece.start, piece.end),
            y,
            "LSODA",
            t_eval=np.unique(np.append(within, piece.end)),
            jac=lambda t, x, q=piece.values: jacobian(t, x, q).reshape(n, n, order="F"),
            rtol=tolerance,
            atol=0.1 * tolerance,
        )
        if not done.success:
            raise RuntimeError(done.message)
        found[:, sampled : sampled + len(within)] = done.y[:, : len(within)]
        sampled += len(within)
        y = done.y[:, -1]
    return found
