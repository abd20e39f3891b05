"""Single steps in Python: explicit of order 8 (DOP853), and implicit of order 5 (Radau IIA).

The explicit step is one CasADi function of all its stages: what Python does per step costs no
more than the stages themselves. Step control is the compiled driver's.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, Protocol

import casadi as ca
import numpy as np
from scipy.integrate import DOP853, Radau

from wormopt.simulation.functions import System
from wormopt.simulation.task import Task

__all__ = ["Call", "Explicit", "GivenUp", "Step", "Stepper", "Stiff", "floor_of_step", "powers"]

_EPSILON = float(np.finfo(float).eps)
# Explicit steps are given up where so many more would be needed for stability alone: some seconds.
_STIFF_STEPS = 50_000
# Scipy refuses smaller relative tolerances, with a warning.
_LEAST_RELATIVE = 100 * _EPSILON


class GivenUp(Exception):
    """A motion cannot be followed any further.

    Parameters
    ----------
    status : str
        Why, see `Outcome`.
    """

    def __init__(self, status: str) -> None:
        self.status = status
        super().__init__(status)


class Call:
    """A CasADi function called through its buffer, which costs a hundredth of an ordinary call.

    Parameters
    ----------
    function : casadi.Function
        With dense arguments and results.
    shared : sequence of (str, ndarray)
        Arguments that are not passed but read from these arrays, which the caller may rewrite.

    Examples
    --------
    >>> x, p = ca.SX.sym("x", 2), ca.SX.sym("p")
    >>> scale = np.ones(1)
    >>> call = Call(ca.Function("f", [x, p], [p * x], ["x", "p"], ["y"]), ("p", scale))
    >>> scale[:] = 3.0
    >>> call(np.array([1.0, 2.0]))[0]
    array([3., 6.])
    """

    def __init__(self, function: ca.Function, *shared: tuple[str, np.ndarray]) -> None:
        self._buffer, self._run = function.buffer()
        self._shared = arrays = dict(shared)  # kept alive: the buffer knows addresses only
        self._passed = []
        for i, name in enumerate(function.name_in()):
            array = arrays.get(name)
            if array is None:
                array = np.zeros(function.numel_in(i))
                self._passed.append(array)
            if array.size:
                self._buffer.set_arg(i, array.data)  # type: ignore[call-arg]
        self._results = [np.zeros(function.numel_out(i)) for i in range(function.n_out())]
        for i, result in enumerate(self._results):
            if result.size:
                self._buffer.set_res(i, result.data)  # type: ignore[call-arg]

    def __call__(self, *values: float | np.ndarray) -> list[np.ndarray]:
        """Evaluate; the results are overwritten by the next call, matrices flat by columns."""
        for place, value in zip(self._passed, values, strict=True):
            place[:] = value
        self._run()
        return self._results


def powers(s: float | np.ndarray) -> np.ndarray:
    """What the rows of a polynomial are multiplied by, see `Dense`.

    Parameters
    ----------
    s : float or ndarray, shape (m,)
        Fraction of the step.

    Returns
    -------
    ndarray, shape (8,) or (m, 8)

    Examples
    --------
    >>> powers(1.0)
    array([1., 1., 0., 0., 0., 0., 0., 0.])
    """
    r = 1 - s
    product = [np.ones_like(s)]
    for k in range(7):
        product.append(product[-1] * (r if k % 2 else s))
    return np.stack(product, axis=-1)


@dataclass(frozen=True, eq=False)
class Step:
    """An attempted step.

    Parameters
    ----------
    t, h, end : float
        Its start, length and end.
    x, x_new : ndarray, shape (n_x,)
        States there.
    dx, dx_new : ndarray, shape (n_x,)
        Their time derivatives.
    fit : callable
        Gives the rows of its polynomial.
    """

    t: float
    h: float
    end: float
    x: np.ndarray
    x_new: np.ndarray
    dx: np.ndarray
    dx_new: np.ndarray
    fit: Callable[[], np.ndarray]

    @cached_property
    def rows(self) -> np.ndarray:
        """Polynomial of the step, shape (8, n_x), see `Dense`."""
        return self.fit()

    def states(self, s: float | np.ndarray) -> np.ndarray:
        """States within the step.

        Parameters
        ----------
        s : float or ndarray, shape (m,)
            Fractions of it.

        Returns
        -------
        ndarray, shape (n_x,) or (m, n_x)
        """
        return powers(s) @ self.rows


def floor_of_step(task: Task, t: float) -> float:
    """Length below which a step is nothing but rounding.

    Parameters
    ----------
    task : Task
        What is integrated.
    t : float
        Time.

    Returns
    -------
    float
    """
    return 8 * _EPSILON * max(abs(t), 1e-3 * (task.span[1] - task.span[0]))


class Stepper(Protocol):
    """What takes steps.

    ``h`` is the length that the next one shall have, at most.
    """

    h: float
    n_rejected: int
    n_evaluations: int

    def restart(self, t: float, x: np.ndarray) -> None:
        """Go on from another state, or with other parameters or modes.

        Parameters
        ----------
        t : float
            Time.
        x : ndarray, shape (n_x,)
            State.
        """
        ...

    def attempt(self, stop: float) -> Step | None:
        """Try a step.

        Parameters
        ----------
        stop : float
            Time that it must not pass.

        Returns
        -------
        Step or None
            None if it was too inexact; the next will be shorter.

        Raises
        ------
        GivenUp
            If it would have to be too short.
        """
        ...

    def redo(self, step: Step, length: float) -> Step:
        """Take the beginning of a step that was too long.

        Parameters
        ----------
        step : Step
            Just attempted.
        length : float
            How far to go.

        Returns
        -------
        Step
            It may end earlier if this is less exact than the whole.
        """
        ...

    def shorten(self, step: Step, factor: float) -> None:
        """Reject a step.

        Parameters
        ----------
        step : Step
            Just attempted.
        factor : float
            Length of the next one, relative to it.

        Raises
        ------
        GivenUp
            If that is too short.
        """
        ...

    def accept(self, step: Step) -> None:
        """Go on from the end of a step.

        Parameters
        ----------
        step : Step
            Just attempted.

        Raises
        ------
        GivenUp
            If the motion is too stiff to go on.
        """
        ...


class Explicit:
    """Steps of DOP853: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, II.10.

    Parameters
    ----------
    task : Task
        What to integrate.
    p, modes : ndarray
        Parameters and modes; who rewrites them must call `restart`.
    """

    def __init__(self, task: Task, p: np.ndarray, modes: np.ndarray) -> None:
        self.h, self.n_rejected, self.n_evaluations = 0.0, 0, 0
        self._task, self._t, self._x = task, task.span[0], task.x0
        take, polynomial = _dop853(task.system)
        limits = ("absolute", task.absolute), ("relative", np.array([task.tolerance.relative]))
        self._rhs = Call(task.system.rhs, ("p", p), ("s", modes))
        self._take = Call(take, ("p", p), ("s", modes), *limits)
        self._polynomial = Call(polynomial, ("p", p), ("s", modes))
        self._next = 0.0
        self._watch = _StiffnessWatch()

    def _derivative(self, t: float, x: np.ndarray) -> np.ndarray:
        self.n_evaluations += 1
        return self._rhs(t, x)[0].copy()

    def restart(self, t: float, x: np.ndarray) -> None:
        """Go on from another state, or with other parameters or modes.

        Parameters
        ----------
        t : float
            Time.
        x : ndarray, shape (n_x,)
            State.
        """
        self._t, self._x, self._dx = t, x, self._derivative(t, x)
        if self.h == 0.0 and not (np.all(np.isfinite(x)) and np.all(np.isfinite(self._dx))):
            raise GivenUp("not_finite")

    def attempt(self, stop: float) -> Step | None:
        """Try a step.

        Parameters
        ----------
        stop : float
            Time that it must not pass.

        Returns
        -------
        Step or None
            None if it was too inexact; the next will be shorter.

        Raises
        ------
        GivenUp
            If it would have to be too short.
        """
        if self.h <= 0.0:
            self.h = self._first()
        left = stop - self._t
        last = 1.01 * self.h >= left
        h = left if last else self.h
        if h < floor_of_step(self._task, self._t) and not last:
            raise GivenUp("step_too_small")
        x_new, stages, self._last_stage, sums = self._stages(self._t, self._x, h, self._dx)
        error = _error(*sums, h, len(x_new))
        factor = 0.9 * error ** (-1 / 8) if error > 0 else 6.0
        if not error <= 1.0:
            bad = not np.isfinite(error)
            self._reject(h, 0.1 if bad else max(factor, 0.1), "not_finite" if bad else "")
            return None
        # a step that was cut short says nothing against the length that was wanted
        self._next = max(h * min(max(factor, 1 / 3), 6.0), self.h if h < self.h else 0.0)
        self._last_slope = stages[-len(x_new) :]
        return self._closed(h, stop if last else self._t + h, x_new, stages)

    def _stages(self, t: float, x: np.ndarray, h: float, dx: np.ndarray) -> list[np.ndarray]:
        self.n_evaluations += 11
        return [result.copy() for result in self._take(t, x, h, dx)]

    def _closed(self, h: float, end: float, x_new: np.ndarray, stages: np.ndarray) -> Step:
        t, x, dx = self._t, self._x, self._dx
        dx_new = self._derivative(t + h, x_new)

        def fit() -> np.ndarray:
            self.n_evaluations += 3
            rows = self._polynomial(t, x, h, x_new, stages, dx_new)[0]
            return rows.reshape(8, -1).copy()

        return Step(t, h, end, x, x_new, dx, dx_new, fit)

    def _reject(self, h: float, factor: float, status: str = "") -> None:
        self.n_rejected += 1
        self.h = h * factor
        if self.h < floor_of_step(self._task, self._t):
            raise GivenUp(status or "step_too_small")

    def shorten(self, step: Step, factor: float) -> None:
        """Reject a step.

        Parameters
        ----------
        step : Step
            Just attempted.
        factor : float
            Length of the next one, relative to it.

        Raises
        ------
        GivenUp
            If that is too short.
        """
        self._reject(step.h, factor)

    def redo(self, step: Step, length: float) -> Step:
        """Take the beginning of a step that was too long.

        Parameters
        ----------
        step : Step
            Just attempted.
        length : float
            How far to go.

        Returns
        -------
        Step
        """
        x_new, stages, _, _ = self._stages(step.t, step.x, length, step.dx)
        return self._closed(length, min(step.t + length, step.end), x_new, stages)

    def accept(self, step: Step) -> None:
        """Go on from the end of a step.

        Parameters
        ----------
        step : Step
            Just attempted.

        Raises
        ------
        GivenUp
            If the motion is too stiff to go on.
        """
        self.h = self._next
        self._t, self._x, self._dx = step.end, step.x_new, step.dx_new
        left = (self._task.span[1] - step.end) / step.h
        way = self._last_stage, self._last_slope
        if self._watch.sees(step, *way) and left > _STIFF_STEPS and not self._task.system.exact:
            raise GivenUp("stiff")

    def _first(self) -> float:
        """Length of the first step, from the size of x, x' and x'' (Hairer's hinit)."""
        t, x, dx, task = self._t, self._x, self._dx, self._task
        scale = task.absolute + task.tolerance.relative * np.abs(x)
        size, slope = np.sum((x / scale) ** 2), np.sum((dx / scale) ** 2)
        h = 1e-6 if size <= 1e-10 or slope <= 1e-10 else 0.01 * np.sqrt(size / slope)
        h = min(h, task.span[1] - t)
        change = (self._derivative(t + h, x + h * dx) - dx) / scale
        largest = max(np.sqrt(np.sum(change**2)) / h, np.sqrt(slope))
        wanted = max(1e-6, h * 1e-3) if largest <= 1e-15 else (0.01 / largest) ** (1 / 8)
        wanted = min(100 * h, wanted)
        return float(wanted if np.isfinite(wanted) and wanted > 0 else h)


def _error(five: float, three: float, h: float, n: int) -> float:
    """Error of a step against the tolerances; at most 1 is good, NaN where numbers are bad."""
    scale = five + 0.01 * three
    if not scale < np.inf:
        return np.nan
    return h * five / np.sqrt(n * scale) if scale > 0 else 0.0


class _StiffnessWatch:
    """Whether stability and not accuracy has held the last steps short (Hairer's test)."""

    def __init__(self) -> None:
        self._unseen, self._hints, self._denials = 0, 0, 0

    def sees(self, step: Step, last_stage: np.ndarray, last_slope: np.ndarray) -> bool:
        self._unseen += 1
        if self._unseen < 1000 and self._hints == 0:
            return False
        self._unseen = 0
        change = np.linalg.norm(step.dx_new - last_slope)
        way = np.linalg.norm(step.x_new - last_stage)
        if way > 0 and step.h * change / way > 6.1:
            self._denials = 0
            self._hints += 1
            return self._hints >= 15
        if self._hints:
            self._denials += 1
            if self._denials == 6:
                self._hints = self._denials = 0
        return False


@lru_cache(maxsize=64)
def _dop853(system: System) -> tuple[ca.Function, ca.Function]:
    """Functions that take a step and that fit its polynomial."""
    rhs = system.rhs
    t, x, p, s = rhs.mx_in()
    n, h, dx = x.numel(), ca.MX.sym("h"), ca.MX.sym("dx", x.numel())
    absolute, relative = ca.MX.sym("absolute", n), ca.MX.sym("relative")
    slopes, stage = [dx], x
    for row, node in zip(DOP853.A[1:], DOP853.C[1:], strict=True):
        stage = x + h * (ca.horzcat(*slopes) @ ca.DM(row[: len(slopes)]))
        slopes.append(rhs(t + node * h, stage, p, s))
    stages = ca.horzcat(*slopes)
    x_new = x + h * (stages @ ca.DM(DOP853.B))
    scale = absolute + relative * ca.fmax(ca.fabs(x), ca.fabs(x_new))
    five, three = (ca.sumsqr((stages @ ca.DM(E[:-1])) / scale) for E in (DOP853.E5, DOP853.E3))
    take = ca.Function(
        "take",
        [t, x, h, dx, p, s, absolute, relative],
        [x_new, stages, stage, ca.vertcat(five, three)],
        ["t", "x", "h", "dx", "p", "s", "absolute", "relative"],
        ["x_new", "stages", "stage", "sums"],
    )

    end, dx_new, known = ca.MX.sym("end", n), ca.MX.sym("dx_new", n), ca.MX.sym("stages", n, 12)
    slopes = [*ca.horzsplit(known), dx_new]
    for row, node in zip(DOP853.A_EXTRA, DOP853.C_EXTRA, strict=True):
        stage = x + h * (ca.horzcat(*slopes) @ ca.DM(row[: len(slopes)]))
        slopes.append(rhs(t + node * h, stage, p, s))
    way, first = end - x, slopes[0]
    low = [x, way, h * first - way, 2 * way - h * (dx_new + first)]
    rows = ca.horzcat(*low, h * (ca.horzcat(*slopes) @ ca.DM(DOP853.D).T))
    names = ["t", "x", "h", "end", "stages", "dx_new", "p", "s"]
    polynomial = ca.Function(
        "polynomial", [t, x, h, end, known, dx_new, p, s], [rows], names, ["rows"]
    )
    return take, polynomial


# The dense output of Radau IIA is a cubic: these points tell its first four rows.
_POINTS = np.array([0.0, 1 / 3, 2 / 3, 1.0])
_ROWS = np.linalg.inv(powers(_POINTS)[:, :4])


class Stiff:
    """Steps of scipy's Radau, for stiff motions; order 5, with the exact Jacobian.

    Parameters
    ----------
    task : Task
        What to integrate.
    p, modes : ndarray
        Parameters and modes; who rewrites them must call `restart`.
    """

    def __init__(self, task: Task, p: np.ndarray, modes: np.ndarray) -> None:
        self.h, self.n_rejected, self.n_evaluations = 0.0, 0, 0
        self._task, self._solver = task, None
        self._t, self._x = task.span[0], task.x0
        self._rhs = Call(task.system.rhs, ("p", p), ("s", modes))
        self._jacobian = Call(_jacobian(task.system), ("p", p), ("s", modes))

    def _derivative(self, t: float, x: np.ndarray) -> np.ndarray:
        self.n_evaluations += 1
        dx = self._rhs(t, x)[0].copy()
        self._finite = bool(np.all(np.isfinite(dx)))
        return dx

    def _slopes(self, t: float, x: np.ndarray) -> np.ndarray:
        matrix = self._jacobian(t, x)[0].reshape(len(x), len(x)).T.copy()
        if not np.all(np.isfinite(matrix)):
            raise GivenUp("not_finite")
        return matrix

    def _solver_from(self, t: float, x: np.ndarray, stop: float, h: float) -> Radau:
        options: dict[str, Any] = {
            "rtol": max(self._task.tolerance.relative, _LEAST_RELATIVE),
            "atol": self._task.absolute,
            "jac": self._slopes,
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
        """Go on from another state, or with other parameters or modes.

        Parameters
        ----------
        t : float
            Time.
        x : ndarray, shape (n_x,)
            State.
        """
        self._t, self._x, self._solver = t, x, None
        self._derivative(t, x)
        if not (self._finite and np.all(np.isfinite(x))):
            raise GivenUp("not_finite")

    def attempt(self, stop: float) -> Step | None:
        """Try a step.

        Parameters
        ----------
        stop : float
            Time that it must not pass.

        Returns
        -------
        Step or None
            Never None: scipy tries until it succeeds.

        Raises
        ------
        GivenUp
            If it would have to be too short.
        """
        if self._solver is None or self._solver.t_bound != stop:
            self._solver = self._solver_from(self._t, self._x, stop, self.h)
        return self._advance(self._solver, stop)

    def redo(self, step: Step, length: float) -> Step:
        """Take the beginning of a step that was too long.

        Parameters
        ----------
        step : Step
            Just attempted.
        length : float
            How far to go.

        Returns
        -------
        Step
            It may end earlier if this is less exact than the whole.
        """
        stop = min(step.t + length, step.end)
        self._solver = None
        return self._advance(self._solver_from(step.t, step.x, stop, length), stop)

    def shorten(self, step: Step, factor: float) -> None:
        """Reject a step.

        Parameters
        ----------
        step : Step
            Just attempted.
        factor : float
            Length of the next one, relative to it.

        Raises
        ------
        GivenUp
            If that is too short.
        """
        self.n_rejected += 1
        self.h, self._solver = step.h * factor, None
        if self.h < floor_of_step(self._task, step.t):
            raise GivenUp("step_too_small")

    def accept(self, step: Step) -> None:
        """Go on from the end of a step.

        Parameters
        ----------
        step : Step
            Just attempted.
        """
        self.h, self._t, self._x = step.h, step.end, step.x_new


@lru_cache(maxsize=64)
def _jacobian(system: System) -> ca.Function:
    """Dense Jacobian of the ode."""
    jacobian = system.rhs.factory("jacobian", ["t", "x", "p", "s"], ["jac:rhs:x"])
    arguments = jacobian.sx_in()
    return ca.Function(
        "jacobian", arguments, [ca.densify(jacobian(*arguments))], ["t", "x", "p", "s"], ["jac"]
    )
