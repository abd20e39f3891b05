"""Steps in Python: explicit ones of order 8, implicit ones of order 5 for stiff motions.

A step is one CasADi function of all its stages, which takes most of the time. Step control is that
of the compiled driver.
DOP853 takes the difference of its formula of order 5 as small where the error is small. If a step
ends in a steep layer, that difference changes its sign with the length of the step and is nearly
0 around some length, whatever the error. So it is bounded from below by that of a formula of
order 6, the sixth divided difference of the slopes at seven nodes, which vanishes elsewhere. In
smooth motion the latter is smaller.
"""

from __future__ import annotations

import re
from ast import literal_eval
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from importlib.resources import files
from typing import Any

import casadi as ca
import numpy as np

from wormopt.lazy import on_use
from wormopt.numerics.expressions import Call
from wormopt.simulation.initial_value import SLACK, InitialValueProblem

with on_use():  # slow to import, and few motions are stiff
    from scipy.integrate import Radau


class GivenUp(Exception):
    """A motion cannot be continued; for `status` see `Outcome`."""

    def __init__(self, status: str) -> None:
        self.status = status
        super().__init__(status)


@dataclass
class Kept:
    """Rows of time and state: every one, and once there are `most`, every 2nd, 4th, ..."""

    most: int
    rows: list[np.ndarray] = field(default_factory=list)
    _seen: int = 0
    _stride: int = 1

    def add(self, t: float, x: np.ndarray) -> None:
        """Keep or skip a row."""
        if self._seen % self._stride == 0:
            self.rows.append(np.append(t, x))
            if len(self.rows) == self.most:
                self.rows, self._stride = self.rows[::2], 2 * self._stride
        self._seen += 1


def powers(s: float | np.ndarray) -> np.ndarray:
    """Factors (8,) or (m, 8) of the rows of a polynomial, see `Dense`.

    `s` is the fraction of the step, a number or (m,).
    """
    r = 1 - s
    product = [np.ones_like(s)]
    for k in range(7):
        product.append(product[-1] * (r if k % 2 else s))
    return np.stack(product, axis=-1)


@dataclass(frozen=True, eq=False)
class Step:
    """An attempted step."""

    t: float  # start
    h: float  # length
    end: float
    x: np.ndarray  # (n_x,) state at `t`
    x_new: np.ndarray  # (n_x,) state at `end`
    dx: np.ndarray  # (n_x,) time derivative at `t`
    dx_new: np.ndarray  # (n_x,) time derivative at `end`
    fit: Callable[[], np.ndarray]  # returns the rows of its polynomial

    @cached_property
    def rows(self) -> np.ndarray:
        """Polynomial of the step, shape (8, n_x), see `Dense`."""
        return self.fit()

    def states(self, s: float | np.ndarray) -> np.ndarray:
        """States (n_x,) or (m, n_x) at fractions of the step, a number or (m,)."""
        return powers(s) @ self.rows


def floor_of_step(task: InitialValueProblem, t: float) -> float:
    """Length below which a step is rounding."""
    return 8 * float(np.finfo(float).eps) * max(abs(t), 1e-3 * (task.span[1] - task.span[0]))


# Steps are given up if stability alone would need this many more: some seconds.
_STIFF_STEPS = 50_000
_TINY = float(np.finfo(float).tiny)
# Stages of DOP853 whose slopes agree to order 6, and weight of their divided difference.
_NODES, _SHARE = [0, 5, 6, 7, 8, 9, 10], 1e-4


def _tableau() -> dict[str, Any]:
    """Coefficients of DOP853 as the compiled driver has them; tests compare them with SciPy's."""
    text = (files("wormopt.simulation.native") / "tableau.h").read_text("utf-8")
    tables = re.findall(r"double (\w+)\[.*? = ({.*?});", text, re.DOTALL)
    return {name: literal_eval(rows.translate({123: "[", 125: "]"})) for name, rows in tables}


DOP853 = _tableau()


def _six() -> np.ndarray:
    """Difference (12,) of a step to its embedded formula of order 6."""
    nodes, difference = np.array(DOP853["C"])[_NODES], np.zeros(len(DOP853["B"]))
    apart = nodes[:, None] - nodes + np.eye(len(nodes))
    difference[_NODES] = _SHARE / np.prod(apart, axis=1)
    return difference


EMBEDDED = _six(), np.array(DOP853["E5"]), np.array(DOP853["E3"])


class Explicit:
    """Steps of DOP853.

    Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, II.10.
    Call `restart` after rewriting the parameters `p` or the modes. `h` is the largest length of the
    next step. Steps that would have to be too short, and motions that are too stiff, raise GivenUp.
    """

    def __init__(self, task: InitialValueProblem, p: np.ndarray, modes: np.ndarray) -> None:
        self.h, self.n_rejected, self.n_evaluations = 0.0, 0, 0
        self._task, self._t, self._x = task, task.span[0], task.start
        take, polynomial = _dop853(task.rhs, len(task.x0))
        limits = ("absolute", task.absolute), ("relative", np.array([task.tolerance.relative]))
        self._rhs = Call(task.rhs, ("p", p), ("s", modes))
        self._take = Call(take, ("p", p), ("s", modes), *limits)
        self._polynomial = Call(polynomial, ("p", p), ("s", modes))
        self._next = 0.0
        self._watch = _StiffnessWatch()

    def _derivative(self, t: float, x: np.ndarray) -> np.ndarray:
        self.n_evaluations += 1
        return self._rhs(t, x)[0].copy()

    def restart(self, t: float, x: np.ndarray) -> None:
        """Continue from another state, or with other parameters or modes."""
        self._t, self._x, self._dx = t, x, self._derivative(t, x)
        if self.h == 0.0 and (status := self._task.broken(x, self._dx)):
            raise GivenUp(status)

    def attempt(self, stop: float) -> Step | None:
        """Try a step not beyond `stop`; None if too inexact, and the next will be shorter."""
        if self.h <= 0.0:
            self.h = self._first(stop)
        self.h = min(self.h, self._task.max_step)
        left = stop - self._t
        last = 1.01 * self.h >= left
        h = left if last else self.h
        if h < floor_of_step(self._task, self._t) and not last:
            raise GivenUp("step_too_small")
        x_new, stages, self._last_stage, sums = self._stages(self._t, self._x, h, self._dx)
        error = _norm(sums, h, len(self._task.x0))
        status = ""
        if self._task.k and error <= 1:
            other = self._columns_error(x_new, stages, h)
            if not other <= error:
                error, status = other, "steep_derivatives"
        factor = 0.9 * error ** (-1 / 8) if error > 0 else 6.0
        if not error <= 1.0:
            bad = not np.isfinite(error)
            status = status or ("not_finite" if bad else "")
            self._reject(h, 0.1 if bad else max(factor, 0.1), status)
            return None
        # a shortened step gives no evidence against the intended length
        self._next = max(h * min(max(factor, 1 / 3), 6.0), self.h if h < self.h else 0.0)
        self._last_slope = stages[-len(x_new) :]
        return self._closed(h, stop if last else self._t + h, x_new, stages)

    def _columns_error(self, x_new: np.ndarray, stages: np.ndarray, h: float) -> float:
        """Error of the step in S, that of the worst column."""
        task, n_x, k = self._task, len(self._task.x0), self._task.k
        x, end = (part[n_x:].reshape(-1, k) for part in (self._x, x_new))
        nominal = task.absolute[: len(x), None]
        own = np.maximum(np.abs(x), np.abs(end))
        own = own + 0.1 * nominal * np.maximum((own / nominal).max(axis=0), task.column_floor)
        slopes = stages.reshape(12, -1)[:, n_x:]
        scale = SLACK * task.tolerance.relative * own + _TINY
        sums = [np.sum(((e @ slopes).reshape(-1, k) / scale) ** 2, axis=0) for e in EMBEDDED]
        errors = np.array([_norm(column, h, len(x)) for column in np.array(sums).T])
        lost = ~np.isfinite(x).all(axis=0)  # after an event without derivative
        return float(np.where(lost, 0.0, errors).max())

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
        """Reject the step just attempted; the next is `factor` times as long."""
        self._reject(step.h, factor)

    def redo(self, step: Step, length: float) -> Step:
        """Keep only the first `length` of the step just attempted, which was too long."""
        x_new, stages, _, _ = self._stages(step.t, step.x, length, step.dx)
        return self._closed(length, min(step.t + length, step.end), x_new, stages)

    def accept(self, step: Step) -> None:
        """Continue from the end of the step just attempted."""
        self.h = self._next
        self._t, self._x, self._dx = step.end, step.x_new, step.dx_new
        left = (self._task.span[1] - step.end) / step.h
        n = len(self._task.x0)
        way = self._last_stage[:n], self._last_slope[:n]
        if self._watch.sees(step, *way) and left > _STIFF_STEPS and not self._task.system.exact:
            raise GivenUp("stiff")

    def _first(self, stop: float) -> float:
        """Length of the first step, from the size of x, x' and x'' (Hairer's hinit)."""
        t, x, dx, task = self._t, self._x, self._dx, self._task
        n = len(task.x0)
        scale = task.absolute + task.tolerance.relative * np.abs(x[:n])
        size, slope = np.sum((x[:n] / scale) ** 2), np.sum((dx[:n] / scale) ** 2)
        h = 1e-6 if size <= 1e-10 or slope <= 1e-10 else 0.01 * np.sqrt(size / slope)
        # a moving state near 0 gives no time scale
        left = task.span[1] - t
        h = min(max(h, 1e-9 * left), left)
        # beyond a break formulas of this piece are invalid, polynomials of a short one most of all
        probe = min(h, stop - t)
        change = (self._derivative(t + probe, x + probe * dx) - dx)[:n] / scale
        largest = max(np.sqrt(np.sum(change**2)) / probe, np.sqrt(slope))
        wanted = max(1e-6, h * 1e-3) if largest <= 1e-15 else (0.01 / largest) ** (1 / 8)
        wanted = min(100 * h, wanted)
        return float(wanted if np.isfinite(wanted) and wanted > 0 else h)


def _norm(sums: np.ndarray, h: float, n: int) -> float:
    """Error of a step against the tolerances; at most 1 is good, NaN where numbers are bad."""
    six, five, three = sums.tolist()
    five = max(five, six)
    scale = five + 0.01 * three
    if not scale < np.inf:
        return np.nan
    return h * five / np.sqrt(n * scale) if scale > 0 else 0.0


class _StiffnessWatch:
    """Whether stability and not accuracy has limited the last steps (Hairer's test)."""

    def __init__(self) -> None:
        self._unseen, self._hints, self._denials = 0, 0, 0

    def sees(self, step: Step, last_stage: np.ndarray, last_slope: np.ndarray) -> bool:
        self._unseen += 1
        if self._unseen < 1000 and self._hints == 0:
            return False
        self._unseen = 0
        change = np.linalg.norm(step.dx_new[: len(last_slope)] - last_slope)
        way = np.linalg.norm(step.x_new[: len(last_stage)] - last_stage)
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
def _dop853(rhs: ca.Function, n_x: int) -> tuple[ca.Function, ca.Function]:
    """Functions that take a step, with the error of n_x entries, and that fit its polynomial."""
    t, x, p, s = rhs.mx_in()
    n, h, dx = x.numel(), ca.MX.sym("h"), ca.MX.sym("dx", x.numel())
    absolute, relative = ca.MX.sym("absolute", n_x), ca.MX.sym("relative")
    slopes, stage = [dx], x
    for row, node in zip(DOP853["A"][1:12], DOP853["C"][1:12], strict=True):
        stage = x + h * (ca.horzcat(*slopes) @ ca.DM(row))
        slopes.append(rhs(t + node * h, stage, p, s))
    stages = ca.horzcat(*slopes)
    x_new = x + h * (stages @ ca.DM(DOP853["B"]))
    scale = absolute + relative * ca.fmax(ca.fabs(x), ca.fabs(x_new))[:n_x]
    sums = [ca.sumsqr((stages[:n_x, :] @ ca.DM(E)) / scale) for E in EMBEDDED]
    take = ca.Function(
        "take",
        [t, x, h, dx, p, s, absolute, relative],
        [x_new, stages, stage, ca.vertcat(*sums)],
        ["t", "x", "h", "dx", "p", "s", "absolute", "relative"],
        ["x_new", "stages", "stage", "sums"],
    )

    end, dx_new, known = ca.MX.sym("end", n), ca.MX.sym("dx_new", n), ca.MX.sym("stages", n, 12)
    slopes = [*ca.horzsplit(known), dx_new]
    for row, node in zip(DOP853["A"][13:], DOP853["C"][13:], strict=True):
        stage = x + h * (ca.horzcat(*slopes) @ ca.DM(row))
        slopes.append(rhs(t + node * h, stage, p, s))
    way, first = end - x, slopes[0]
    low = [x, way, h * first - way, 2 * way - h * (dx_new + first)]
    rows = ca.horzcat(*low, h * (ca.horzcat(*slopes) @ ca.DM(DOP853["D"]).T))
    names = ["t", "x", "h", "end", "stages", "dx_new", "p", "s"]
    polynomial = ca.Function(
        "polynomial", [t, x, h, end, known, dx_new, p, s], [rows], names, ["rows"]
    )
    return take, polynomial


# Scipy refuses smaller relative tolerances, with a warning.
_LEAST_RELATIVE = 100 * float(np.finfo(float).eps)
# Distance, in nominal sizes, that is negligible.
_NEARBY = 1e-10


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
            size = self._task.all_absolute / self._task.tolerance.absolute
            nearby = self._jacobian(t, x + _NEARBY * size)[0].reshape(shape).T
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
        output: Any = solver.dense_output()

        def fit() -> np.ndarray:
            # a cubic, by powers of the fraction
            _, square, cube = output.Q.T
            return np.vstack([x, x_new - x, -square - cube, -cube, np.zeros((4, len(x)))])

        dx_new = self._derivative(solver.t, x_new)
        return Step(t, h, min(solver.t, stop), x, x_new, dx, dx_new, fit)

    def restart(self, t: float, x: np.ndarray) -> None:
        """Continue from another state, or with other parameters or modes."""
        self._t, self._x, self._solver = t, x, None
        if status := self._task.broken(x, self._derivative(t, x)):
            raise GivenUp(status)

    def attempt(self, stop: float) -> Step | None:
        """Try a step not beyond `stop`; never None, since scipy tries until it succeeds."""
        if self._solver is None or self._solver.t_bound != stop:
            self._solver = self._solver_from(self._t, self._x, stop, self.h)
        return self._advance(self._solver, stop)

    def redo(self, step: Step, length: float) -> Step:
        """Keep only the first `length` of the step just attempted, which was too long."""
        # It may end earlier if it is less accurate than the whole.
        stop = min(step.t + length, step.end)
        self._solver = None
        return self._advance(self._solver_from(step.t, step.x, stop, length), stop)

    def shorten(self, step: Step, factor: float) -> None:
        """Reject the step just attempted; the next is `factor` times as long."""
        self.n_rejected += 1
        self.h, self._solver = step.h * factor, None
        if self.h < floor_of_step(self._task, step.t):
            raise GivenUp("step_too_small")

    def accept(self, step: Step) -> None:
        """Continue from the end of the step just attempted."""
        self.h, self._t, self._x = step.h, step.end, step.x_new


Stepper = Explicit | Stiff


@lru_cache(maxsize=64)
def _jacobian(rhs: ca.Function) -> ca.Function:
    jacobian = rhs.factory("jacobian", ["t", "x", "p", "s"], ["jac:rhs:x"])
    arguments = jacobian.mx_in()
    return ca.Function(
        "jacobian", arguments, [ca.densify(jacobian(*arguments))], ["t", "x", "p", "s"], ["jac"]
    )
