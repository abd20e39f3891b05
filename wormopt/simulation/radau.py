"""Implicit steps of order 5 in Python, for stiff motions with switches."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
from scipy.integrate import Radau

from wormopt.simulation.call import Call
from wormopt.simulation.initial_value import InitialValueProblem
from wormopt.simulation.steps import GivenUp, Step, floor_of_step, powers

# Scipy refuses smaller relative tolerances, with a warning.
_LEAST_RELATIVE = 100 * float(np.finfo(float).eps)
# Distance, in nominal sizes, that is negligible.
_NEARBY = 1e-10
# The dense output of Radau IIA is a cubic: these points determine its first four rows.
_POINTS = np.array([0.0, 1 / 3, 2 / 3, 1.0])
_ROWS = np.linalg.inv(powers(_POINTS)[:, :4])


class Stiff:
    """Steps of SciPy's Radau, for stiff motions; order 5, with the exact Jacobian.

    Call `restart` after rewriting the parameters `p` or the modes.
    """

    def __init__(self, task: InitialValueProblem, p: np.ndarray, modes: np.ndarray) -> None:
        self.h, self.n_rejected, self.n_evaluations = 0.0, 0, 0
        self._task, self._solver = task, None
        self._t, self._x = task.span[0], task.start
        self._rhs = Call(task.rhs, ("p", p), ("s", modes))
        self._jacobian = Call(_jacobian(task.smooth_rhs), ("p", p), ("s", modes))

    def _derivative(self, t: float, x: np.ndarray) -> np.ndarray:
        self.n_evaluations += 1
        dx = self._rhs(t, x)[0].copy()
        self._finite = bool(np.all(np.isfinite(dx)))
        return dx

    def _slopes(self, t: float, x: np.ndarray) -> np.ndarray:
        n_x, shape = len(self._task.x0), (len(x), len(x))
        matrix = self._jacobian(t, x)[0].reshape(shape).T.copy()
        if np.any(np.isnan(matrix)):  # 0/0, as that of v |v| at rest: use one nearby
            way = self._task.all_absolute / self._task.tolerance.absolute
            nearby = self._jacobian(t, x + _NEARBY * way)[0].reshape(shape).T
            matrix = np.where(np.isnan(matrix), nearby, matrix)
        if not np.all(np.isfinite(matrix[:n_x, :n_x])):
            raise GivenUp("not_finite")
        if not np.all(np.isfinite(matrix)):
            raise GivenUp("steep_derivatives")
        return matrix

    def _solver_from(self, t: float, x: np.ndarray, stop: float, h: float) -> Radau:
        options: dict[str, Any] = {
            "rtol": max(self._task.tolerance.relative, _LEAST_RELATIVE),
            "atol": self._task.all_absolute,
            "jac": self._slopes,
            "max_step": self._task.max_step,
            "first_step": min(h, stop - t) if h > 0 else None,
        }
        return Radau(self._derivative, t, x, stop, **options)

    def _advance(self, solver: Radau, stop: float) -> Step:
        t, x, dx = solver.t, solver.y, self._derivative(solver.t, solver.y)
        if solver.step():
            raise GivenUp("step_too_small" if self._finite else "not_finite")
        x_new, h = solver.y.copy(), solver.t - t
        output = solver.dense_output()

        def fit() -> np.ndarray:
            points = np.column_stack([x, *(output(t + c * h) for c in _POINTS[1:-1]), x_new])
            return np.vstack([_ROWS @ points.T, np.zeros((4, len(x)))])

        dx_new = self._derivative(solver.t, x_new)
        return Step(t, h, min(solver.t, stop), x, x_new, dx, dx_new, fit)

    def restart(self, t: float, x: np.ndarray) -> None:
        """Continue from another state, or with other parameters or modes."""
        self._t, self._x, self._solver = t, x, None
        if status := self._task.broken(x, self._derivative(t, x)):
            raise GivenUp(status)

    def attempt(self, stop: float) -> Step | None:
        """Try a step not beyond `stop`; never None, since scipy tries until it succeeds.

        Raises GivenUp if it would have to be too short.
        """
        if self._solver is None or self._solver.t_bound != stop:
            self._solver = self._solver_from(self._t, self._x, stop, self.h)
        return self._advance(self._solver, stop)

    def redo(self, step: Step, length: float) -> Step:
        """Keep only the first `length` of the step just attempted, which was too long.

        It may end earlier if it is less accurate than the whole.
        """
        stop = min(step.t + length, step.end)
        self._solver = None
        return self._advance(self._solver_from(step.t, step.x, stop, length), stop)

    def shorten(self, step: Step, factor: float) -> None:
        """Reject the step just attempted; the next is `factor` times as long.

        Raises GivenUp if that is too short.
        """
        self.n_rejected += 1
        self.h, self._solver = step.h * factor, None
        if self.h < floor_of_step(self._task, step.t):
            raise GivenUp("step_too_small")

    def accept(self, step: Step) -> None:
        """Continue from the end of the step just attempted."""
        self.h, self._t, self._x = step.h, step.end, step.x_new


@lru_cache(maxsize=64)
def _jacobian(rhs: ca.Function) -> ca.Function:
    jacobian = rhs.factory("jacobian", ["t", "x", "p", "s"], ["jac:rhs:x"])
    arguments = jacobian.mx_in()
    return ca.Function(
        "jacobian", arguments, [ca.densify(jacobian(*arguments))], ["t", "x", "p", "s"], ["jac"]
    )
