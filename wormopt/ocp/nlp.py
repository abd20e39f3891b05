"""The only caller of CasADi's nlpsol: solves, refines to the last digits, recomputes violations."""

from __future__ import annotations

import io
import sys
import time
from collections.abc import Hashable, Iterator, Mapping
from contextlib import contextmanager, redirect_stderr
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Protocol

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError
from wormopt.lazy import on_use
from wormopt.model.given import check_flag, check_number, make_plain, whole

with on_use():  # slow to import, and some programs take no linear steps
    from scipy import sparse
    from scipy.optimize import linprog
    from scipy.sparse.linalg import splu

# CasADi reports an interrupt as a failed solve with one of these statuses.
_STOPPED = ("User_Requested_Stop", "NonIpopt_Exception_Thrown")
_LATE = ("Maximum_CpuTime_Exceeded", "Maximum_WallTime_Exceeded")
# Programs of more instructions are not written out in scalars: that makes an iteration up to eight
# times as fast, but derivatives take seconds and half a gigabyte to make.
_SCALAR = 100_000


class Solver(Hashable, Protocol):
    """NLP solver of CasADi, and its options."""

    @property
    def name(self) -> str:
        """Name of CasADi's plugin."""
        ...

    def as_casadi(self) -> dict[str, Any]:
        """Options as CasADi's nlpsol takes them."""
        ...


@dataclass(frozen=True)
class Plugin:
    """Any other NLP solver that CasADi ships, by its name.

    Parameters
    ----------
    name : str
        "sqpmethod", "blocksqp", "fatrop", ...; what this installation has is up to CasADi.
    options : tuple of (str, object) pairs, optional
        Its options, as its documentation names them; where it takes a dictionary, again pairs.

    Examples
    --------
    >>> quiet = (("print_iter", False),)
    >>> sqp = Plugin("sqpmethod", (("qpsol", "qrqp"), ("qpsol_options", quiet)))
    >>> sqp.as_casadi()["qpsol_options"]
    {'print_iter': False}
    """

    name: str
    options: tuple[tuple[str, Any], ...] = ()

    def as_casadi(self) -> dict[str, Any]:
        """Options for nlpsol: the given ones, without output."""
        given = {k: dict(v) if isinstance(v, tuple) else v for k, v in self.options}
        return {"print_time": False, "error_on_fail": False, "expand": True, **given}


@dataclass(frozen=True)
class Ipopt:
    """Options of the interior-point solver.

    Parameters
    ----------
    tolerance : float, optional
        Overall tolerance of IPOPT on the scaled problem.
    iterations : int, optional
        Most iterations.
    mu_init : float, optional
        First barrier parameter; small for warm starts.
    warm : bool, optional
        Start at the given point, even close to a bound.
    seconds : float, optional
        Limit of processor time; by default none.
    rescale : bool, optional
        Let IPOPT scale constraints whose slopes are steep at the start; its tolerance then holds
        for the scaled ones.

    Raises
    ------
    ArgumentError
        If a number is out of its range.

    Examples
    --------
    >>> Ipopt(3)
    Traceback (most recent call last):
    wormopt.errors.ArgumentError: tolerance must be below 1, not 3; to limit steps, write iterations
    """

    tolerance: float = 1e-9
    iterations: int = 500
    mu_init: float = 0.1
    warm: bool = False
    seconds: float | None = None
    rescale: bool = True

    def __post_init__(self) -> None:
        make_plain(self, "tolerance", "iterations", "mu_init", "seconds")
        for name in ("tolerance", "mu_init"):
            check_number(name, getattr(self, name), above=0.0)
        if self.tolerance >= 1.0:
            raise ArgumentError(
                f"tolerance must be below 1, not {self.tolerance:g}; "
                "to limit steps, write iterations"
            )
        object.__setattr__(self, "iterations", whole("iterations", self.iterations, 1))
        if self.seconds is not None:
            check_number("seconds", self.seconds, above=0.0)
        for name in ("warm", "rescale"):
            check_flag(name, getattr(self, name))

    @property
    def name(self) -> str:
        """Name of CasADi's plugin."""
        return "ipopt"

    def as_casadi(self) -> dict[str, Any]:
        """Translate into the options of CasADi's nlpsol, IPOPT's own with prefix "ipopt."."""
        pushes = ("bound_push", "bound_frac", "slack_bound_push", "slack_bound_frac")
        start: dict[str, Any] = {f"ipopt.{p}": 1e-8 for p in pushes} if self.warm else {}
        if self.seconds is not None:
            start["ipopt.max_cpu_time"] = self.seconds
        if not self.rescale:
            start["ipopt.nlp_scaling_method"] = "none"
        return start | {
            "print_time": False,
            "error_on_fail": False,
            "show_eval_warnings": False,
            "ipopt.print_level": 0,
            "ipopt.sb": "yes",
            "ipopt.tol": self.tolerance,
            "ipopt.max_iter": self.iterations,
            "ipopt.mu_init": self.mu_init,
            # IPOPT would relax every bound by 1e-8 and report too good an optimum.
            "ipopt.bound_relax_factor": 0.0,
            "ipopt.honor_original_bounds": "yes",
        }


@dataclass(frozen=True)
class Bounds:
    """Bounds on variables and constraints, and the values of the program's parameters."""

    lbw: np.ndarray  # (n_w,) of the variables, infinite where there is none
    ubw: np.ndarray  # (n_w,) of the variables, infinite where there is none
    lbg: np.ndarray  # (n_g,) of the constraints; equal to ubg: an equality
    ubg: np.ndarray  # (n_g,) of the constraints
    p: np.ndarray  # (n_p,) parameters


@dataclass(frozen=True)
class Solution:
    """Result of a solver: point, objective, recomputed violation, and status."""

    w: np.ndarray  # (n_w,) clipped to its bounds
    objective: float
    violation: float  # largest of any bound, scaled; recomputed
    status: str  # the solver's return status, or "not solved"
    success: bool  # reported by the solver; check the violation too
    late: bool  # whether it exceeded its time
    iterations: int
    seconds: float  # wall-clock time
    # s in functions by their CasADi names, such as nlp_hess_l
    functions_s: Mapping[str, float] = field(default_factory=dict)
    build_s: float = 0.0  # s to make the solver; 0 if it is cached
    level: float = 0.0  # of a homotopy: width or relaxation; 0 for prescribed modes
    # (n_g,) of the constraints: below 0 at lower bounds, above 0 at upper ones
    multipliers: np.ndarray = field(default_factory=lambda: np.zeros(0))


class NonlinearProgram:
    """min f(w, p) subject to bounds on w and on g(w, p), built once and solved many times.

    `w`, `p` and `constraints` g are columns, `objective` f a scalar.
    """

    def __init__(
        self,
        w: ca.MX,
        p: ca.MX,
        objective: ca.MX,
        constraints: ca.MX,
    ) -> None:
        self._nlp: dict[str, Any] = {"x": w, "p": p, "f": objective, "g": constraints}
        self._evaluate = ca.Function("evaluate", [w, p], [objective, constraints])
        self._solvers: dict[Solver, ca.Function] = {}

    @cached_property
    def _shared(self) -> tuple[ca.Function, dict[str, Any]]:
        """Scalar functions of the program, and its derivatives as options of IPOPT."""
        # They take longer to make than a solver, and solvers differ in their options only.
        arguments = [self._nlp[key] for key in ("x", "p")], [self._nlp[key] for key in ("f", "g")]
        program = ca.Function("nlp", *arguments, ["x", "p"], ["f", "g"])
        scalar = program.expand()
        if scalar.n_instructions() <= _SCALAR:
            program = scalar
        seen = {"gamma": ["f", "g"]}
        weighted = ["x", "p", "lam:f", "lam:g"]
        return program, {
            "grad_f": program.factory("nlp_grad_f", ["x", "p"], ["f", "grad:f:x"]),
            "jac_g": program.factory("nlp_jac_g", ["x", "p"], ["g", "jac:g:x"]),
            "hess_lag": program.factory("nlp_hess_l", weighted, ["triu:hess:gamma:x:x"], seen),
        }

    @cached_property
    def _linearise(self) -> ca.Function:
        """Objective, its gradient, constraints, their Jacobian."""
        w, p, f, g = (self._nlp[key] for key in ("x", "p", "f", "g"))
        return ca.Function("linearise", [w, p], [f, ca.gradient(f, w), g, ca.jacobian(g, w)])

    def slopes(self, w: np.ndarray, bounds: Bounds, multipliers: np.ndarray) -> np.ndarray:
        """Gradient (n_w,) of the Lagrangian without the bounds of variables."""
        _, gradient, _, jacobian = self._linearise(w, bounds.p)
        return np.asarray(gradient).ravel() + jacobian.sparse().T @ multipliers

    def violation(self, w: np.ndarray, bounds: Bounds) -> float:
        """Largest absolute violation of any bound on w or g, recomputed from the expressions."""
        g = self.constraints(w, bounds)
        excess = (bounds.lbw - w, w - bounds.ubw, bounds.lbg - g, g - bounds.ubg)
        worst = max(float(np.max(e, initial=0.0)) for e in excess)
        return worst if np.all(np.isfinite(w)) and np.all(np.isfinite(g)) else np.inf

    def constraints(self, w: np.ndarray, bounds: Bounds) -> np.ndarray:
        """Values of g, (n_g,), with the parameters of `bounds`."""
        return np.asarray(self._evaluate(w, bounds.p)[1]).ravel()

    def prepare(self, options: Solver) -> None:
        """Make and cache a solver with all derivatives."""
        self._prepared(options)

    def _prepared(self, options: Solver) -> ca.Function:
        if options not in self._solvers:
            program, derivatives = self._nlp, {}
            if isinstance(options, Ipopt):
                program, derivatives = self._shared
            self._solvers[options] = _solver(program, options, derivatives)
        return self._solvers[options]

    def solve(self, w0: np.ndarray, bounds: Bounds, options: Solver) -> Solution:
        """Run a solver from `w0`; the violation is recomputed.

        Failures raise nothing; ArgumentError if CasADi lacks that solver, KeyboardInterrupt if the
        user stops it. Solvers are cached by their options.
        """
        begin = time.perf_counter()
        solver = self._prepared(options)
        start, used = time.perf_counter(), time.process_time()
        with _uncounted(bounds):
            answer = solver(
                x0=w0, p=bounds.p, lbx=bounds.lbw, ubx=bounds.ubw, lbg=bounds.lbg, ubg=bounds.ubg
            )
        stats = solver.stats()
        if stats["return_status"] in _STOPPED:
            raise KeyboardInterrupt
        # IPOPT counts the time of a restoration separately, and may report another reason
        most = options.seconds if isinstance(options, Ipopt) else None
        over = most is not None and time.process_time() - used > most
        late = stats["return_status"] in _LATE or (over and not stats["success"])
        w = np.clip(np.asarray(answer["x"]).ravel(), bounds.lbw, bounds.ubw)
        begun = stats["return_status"] != "Not_Enough_Degrees_Of_Freedom"  # else no count is set
        return Solution(
            w=w,
            objective=float(self._evaluate(w, bounds.p)[0]),
            violation=self.violation(w, bounds),
            status=str(stats["return_status"]),
            success=bool(stats["success"]),
            late=late,
            iterations=int(stats["iter_count"]) if begun else 0,
            seconds=time.perf_counter() - start,
            functions_s={
                key.removeprefix("t_wall_"): float(value)
                for key, value in stats.items()
                if key.startswith("t_wall_nlp_")
            },
            build_s=start - begin,
            multipliers=np.asarray(answer["lam_g"]).ravel(),
        )

    def linear_step(
        self, w: np.ndarray, bounds: Bounds, radius: np.ndarray
    ) -> tuple[np.ndarray, float] | None:
        """Best step of the program linearised at `w` within |step| <= radius (n_w,).

        Returns the new point and the predicted change of the objective, or None. Scaled by the
        radius (0 fixes, infinity frees), so HiGHS's tolerance 1e-10 is relative to it.
        """
        _, gradient, g, jacobian = self._linearise(w, bounds.p)
        finite = radius[np.isfinite(radius) & (radius > 0)]
        scale = float(finite.max()) if finite.size else 1.0
        lower, upper = np.maximum(-radius, bounds.lbw - w), np.minimum(radius, bounds.ubw - w)
        matrix = sparse.csr_matrix(jacobian.sparse())
        low = (bounds.lbg - np.asarray(g).ravel()) / scale
        high = (bounds.ubg - np.asarray(g).ravel()) / scale
        equal = bounds.lbg == bounds.ubg
        below, above = ~equal & np.isfinite(high), ~equal & np.isfinite(low)
        answer = linprog(
            np.asarray(gradient).ravel(),
            A_ub=sparse.vstack([matrix[below], -matrix[above]]),
            b_ub=np.concatenate([high[below], -low[above]]),
            A_eq=matrix[equal],
            b_eq=low[equal],
            bounds=np.column_stack([lower, upper]) / scale,
            method="highs",
            options={"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10},
        )
        if answer.x is None:
            return None
        return np.clip(w + scale * answer.x, bounds.lbw, bounds.ubw), scale * float(answer.fun)

    def start(self, w: np.ndarray, bounds: Bounds) -> Solution:
        """Evaluate a point as a Solution with status "not solved", for `finish` and `restore`."""
        objective = float(self._evaluate(w, bounds.p)[0])
        return Solution(w, objective, self.violation(w, bounds), "not solved", False, False, 0, 0.0)

    def finish(self, solution: Solution, bounds: Bounds, radius: float = 1e-3) -> Solution:
        """Take linear steps in shrinking boxes (SLP): exact active set, errors near round-off.

        Removes the barrier's bias; converges quadratically if the optimum is a vertex.
        Not worse in ``objective + 10 violation``. `radius`: first box, in scaled variables.
        """
        start = time.perf_counter()
        best = solution
        for _ in range(60):
            candidate, promised = self._step(best, bounds, radius)
            gain = -np.inf if candidate is None else _merit(best) - _merit(candidate)
            if candidate is not None and gain > 1e-14:
                best = candidate
            if promised > -1e-12 and best.violation < 1e-12:
                break
            if gain < 0.25 * abs(promised):
                radius /= 4
            if radius < 1e-8:
                break
        for small in (1e-5, 1e-7):  # the remaining violation is of second order in the box
            candidate, _ = self._step(best, bounds, small)
            if candidate is not None and candidate.violation <= best.violation:
                best = candidate
        if best.violation > 1e-12:
            best = self.restore(best, bounds)
        return replace(best, seconds=best.seconds + time.perf_counter() - start)

    def restore(self, solution: Solution, bounds: Bounds) -> Solution:
        """Remove the remaining violation of an interior point by the shortest Newton steps.

        At most three Gauss-Newton steps of least norm; unlike `finish` it keeps the active set. The
        violation does not increase; the objective may become slightly worse.
        """
        best = solution
        for _ in range(3):
            _, _, g, jacobian = self._linearise(best.w, bounds.p)
            g = np.asarray(g).ravel()
            low, high = g - bounds.lbg, g - bounds.ubg
            wrong = (bounds.lbg == bounds.ubg) | (low < 0) | (high > 0)
            residual = np.where(low < 0, low, np.maximum(high, 0.0))[wrong]
            matrix = sparse.csr_matrix(jacobian.sparse())[wrong]
            normal = matrix @ matrix.T + 1e-13 * sparse.eye(matrix.shape[0])
            step = -matrix.T @ splu(normal.tocsc()).solve(residual)
            w = np.clip(best.w + step, bounds.lbw, bounds.ubw)
            violation = self.violation(w, bounds)
            if violation >= best.violation:
                break
            objective = float(self._evaluate(w, bounds.p)[0])
            best = replace(best, w=w, objective=objective, violation=violation)
        return best

    def _step(
        self, solution: Solution, bounds: Bounds, radius: float
    ) -> tuple[Solution | None, float]:
        """Take a linear step; also its predicted gain, minus infinity if there is none."""
        step = self.linear_step(solution.w, bounds, np.full(solution.w.shape, radius))
        if step is None:
            return None, -np.inf
        objective = float(self._evaluate(step[0], bounds.p)[0])
        violation = self.violation(step[0], bounds)
        return replace(solution, w=step[0], objective=objective, violation=violation), step[1]


def _solver(
    nlp: dict[str, Any] | ca.Function, options: Solver, derivatives: dict[str, Any]
) -> ca.Function:
    if not ca.has_nlpsol(options.name):
        raise ArgumentError(f"this CasADi has no NLP solver {options.name!r}; use 'ipopt'")
    return ca.nlpsol("solver", options.name, nlp, options.as_casadi() | derivatives)


@contextmanager
def _uncounted(bounds: Bounds) -> Iterator[None]:
    """Suppress a warning of CasADi, which counts fixed variables as equations."""
    # IPOPT does not, and solves such programs. Other output on stderr is passed on.
    equations = np.sum(bounds.lbw == bounds.ubw) + np.sum(bounds.lbg == bounds.ubg)
    if equations <= len(bounds.lbw):
        yield
        return
    heard = io.StringIO()
    try:
        with redirect_stderr(heard):
            yield
    finally:
        lines = heard.getvalue().splitlines(keepends=True)
        sys.stderr.write("".join(line for line in lines if "NLP is overconstrained" not in line))


def _merit(solution: Solution) -> float:
    return solution.objective + 10 * solution.violation
