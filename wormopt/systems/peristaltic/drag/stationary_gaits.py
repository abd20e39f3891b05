"""Euler-Lagrange equations of the best gait, as a second route to it.

In units of length L, period and c0: with the displacement's integrand A(l) u, the cost's u^T M(l)
u, multipliers mu of the cost and nu of the mean lengths, and p = 2 mu M u - A, the equations are l'
= u, p' = d(-A u + mu u^T M u + nu l)/dl. They conserve an energy, so one of the conditions of
periodicity is redundant; a number delta, which results as zero, replaces it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from wormopt.numerics.boundary_values import BoundaryProblem, solve_boundary
from wormopt.ocp.motion import Motion
from wormopt.systems.peristaltic.drag.large_gaits import DragAim

_DEGREE, _MOST = 32, 128
# Equal parts of the period by which multipliers are estimated.
_SAMPLES = 128


@dataclass(frozen=True)
class Stationary:
    """A gait that satisfies the Euler-Lagrange equations."""

    way: float  # displacement per period
    price: float  # mu: derivative of the displacement by the effort
    residual: float  # largest residual of the equations, in scaled units
    drift: float  # delta, which vanishes


class _Lagrangian:
    """Displacement and cost, in scaled lengths q and rates u, with their derivatives."""

    def __init__(self, aim: DragAim) -> None:
        model = aim.model
        self.q, self.u = model["length"], model["rate"]
        exponent = model["exponent"]
        self.way, self.cost = (
            ca.substitute(model[name], exponent, aim.exponent) for name in ("speed", aim.power)
        )
        self.means = self.q if aim.mean is not None else ca.SX(0, 1)

    @cached_property
    def A(self) -> ca.SX:
        """Slopes (n, 1) of the displacement by the rates."""
        return ca.gradient(self.way, self.u)

    @cached_property
    def M(self) -> ca.SX:
        """Metric (n, n) of the cost."""
        return ca.hessian(self.cost, self.u)[0] / 2


def stationary(motion: Motion, aim: DragAim) -> Stationary:
    """Solve the equations near a gait away from the limits of the lengths.

    Raises SolveError if there is no solution nearby.
    """
    scaled = aim.scaled
    found = _Lagrangian(scaled)
    lengths, rates = _samples(motion, aim, np.arange(_SAMPLES) / _SAMPLES)
    multipliers = _multipliers(found, lengths, rates)
    turned = int(np.argmax(np.abs(rates[:, 0])))
    problem = _equations(found, scaled, turned, lengths[turned, 0])
    tallied = ca.vertcat(found.means, found.cost, found.way)
    values = ca.Function("values", [found.q, found.u], [tallied, found.A, found.M @ found.u])

    def guess(s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        now, rate = _samples(motion, aim, s)
        tallies, A, Mu = (np.asarray(part) for part in values(now, rate))
        steps = np.diff(s, prepend=0.0) * (tallies + np.roll(tallies, 1, axis=1)) / 2
        p = 2 * multipliers[0] * Mu - A
        return np.vstack([now, p, np.cumsum(steps, axis=1)]), np.append(multipliers, 0.0)

    solution = solve_boundary(problem, guess, [[]], degree=_DEGREE, most=_MOST)
    end = solution.at(np.ones(1))[:, 0]
    return Stationary(
        float(end[-1]) * aim.length,
        float(solution.p[0]) * scaled.effort / aim.effort * aim.length,
        solution.residual,
        float(solution.p[-1]),
    )


def _samples(motion: Motion, aim: DragAim, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return scaled lengths and rates (n, m) of a motion at shares of its period."""
    t = s * aim.period
    return motion.state("length", t) / aim.length, motion.inputs(t) * aim.period / aim.length


def _multipliers(found: _Lagrangian, lengths: np.ndarray, rates: np.ndarray) -> np.ndarray:
    """Return price mu and multipliers nu that fit the equations best on equal parts."""
    symbols = [found.q, found.u]
    forces = (ca.gradient(found.way, found.q), ca.gradient(found.cost, found.q))
    parts = ca.Function("parts", symbols, [found.A, 2 * found.M @ found.u, *forces])
    A, Mu, by_way, by_cost = (np.asarray(part) for part in parts(lengths, rates))
    of_mu, right = (_slope(Mu) - by_cost).ravel(), (_slope(A) - by_way).ravel()
    of_nu = -np.kron(np.eye(len(A))[:, : found.means.numel()], np.ones((A.shape[1], 1)))
    return np.linalg.lstsq(np.column_stack([of_mu, of_nu]), right, rcond=None)[0]


def _slope(values: np.ndarray) -> np.ndarray:
    """Return derivatives (n, m) by the share of the period, from values on equal parts of it."""
    waves = 2j * np.pi * np.fft.rfftfreq(values.shape[1], 1 / values.shape[1])
    waves[-1] = 0.0
    return np.fft.irfft(waves * np.fft.rfft(values, axis=1), values.shape[1], axis=1)


def _equations(found: _Lagrangian, aim: DragAim, turned: int, begin: float) -> BoundaryProblem:
    """Return the boundary value problem; the length `turned` is `begin` at both ends."""
    n, means = found.q.numel(), found.means
    p, mu, delta = ca.SX.sym("p", n), ca.SX.sym("mu"), ca.SX.sym("delta")
    nu = ca.SX.sym("nu", means.numel())
    u = ca.solve(found.M, p + found.A) / (2 * mu)
    lagrangian = mu * found.cost - found.way + ca.dot(nu, means)
    rows = ca.vertcat(
        found.u,
        ca.gradient(lagrangian, found.q) + delta * found.u,
        means,
        found.cost,
        found.way,
    )
    tallies = means.numel() + 2
    start, end = (ca.SX.sym(name, 2 * n + tallies) for name in ("start", "end"))
    return BoundaryProblem(
        y=ca.vertcat(found.q, p, ca.SX.sym("tally", tallies)),
        p=ca.vertcat(mu, nu, delta),
        given=ca.SX(0, 1),
        ode=ca.substitute(rows, found.u, u),
        start=start,
        end=end,
        conditions=ca.vertcat(
            start[2 * n :],
            end[: 2 * n] - start[: 2 * n],
            start[turned] - begin,
            end[2 * n : -2] - (aim.mean or 0.0),
            end[-2] - aim.effort,
        ),
        names=tuple(f"y{k}" for k in range(2 * n + tallies)),
    )
