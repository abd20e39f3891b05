"""Derivatives of a motion by all its stiffnesses: adjoint, forward, differences, diffrax, CVODES.

The answer is known by complex differences, through SciPy's DOP853 at its finest tolerance.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp

from tests.benchmarks.ladder import Run, Task, Way
from tests.benchmarks.run import OWN
from wormopt.model.model import Model, Signal
from wormopt.simulation.gradient import gradient
from wormopt.simulation.options import Tolerance
from wormopt.simulation.simulate import simulate

_SPAN, _DAMPING = 5.0, 0.2
_TOLERANCES = (1e-4, 1e-6, 1e-8, 1e-10, 1e-12)
_COMPLEX = 1e-30  # step of complex differences

End = Callable[[np.ndarray, float], float]
"""Place of the head at the end, of stiffnesses and tolerance."""


def task(_name: str, quick: bool) -> Task:
    """Slope of the head's last place by each stiffness; the last mass is held by a spring too."""
    masses = 5 if quick else 20
    known = _exact(masses)
    few = _TOLERANCES[:4]
    ways = [
        Way(OWN, partial(_adjoint, masses), _TOLERANCES),
        Way(f"{OWN}, forward", partial(_forward, masses), _TOLERANCES),
        Way(f"{OWN}, differences", partial(_differences, _own_end, masses), few),
        Way("SciPy DOP853, differences", partial(_differences, _scipy_end, masses), few),
        Way("CasADi CVODES, adjoint", partial(_cvodes, masses), _TOLERANCES[:4]),
        Way("diffrax, through the steps", partial(_diffrax, "Recursive", masses), _TOLERANCES),
        Way("diffrax, backwards", partial(_diffrax, "Backsolve", masses), _TOLERANCES),
    ]
    return Task(
        f"slopes of a motion of {masses} masses by {masses} stiffnesses",
        "complex differences through SciPy DOP853 at 1e-13",
        "slopes, over the largest",
        "relative tolerance; differences are central, of step tolerance^(1/3)",
        1e-6,
        known,
        ways,
        float(np.abs(known).max()),
    )


def _stiffness(masses: int) -> np.ndarray:
    return np.linspace(1.0, 2.0, masses)


def _start(masses: int) -> np.ndarray:
    """The head is pushed."""
    return np.concatenate([np.zeros(masses), [1.0], np.zeros(masses - 1)])


def _rates(join: Callable[..., Any], k: Any, x: Any, v: Any) -> Any:
    """Springs that stiffen tie each mass to the next one, and the last to the ground."""
    stretch = x - join([x[1:], 0 * x[:1]])
    force = k * (stretch + stretch * stretch * stretch)
    return join([v, join([0 * x[:1], force[:-1]]) - force - _DAMPING * v])


def _exact(masses: int) -> np.ndarray:
    """Complex differences need no small step; their steps are those of the motion."""
    found = []
    for unit in np.eye(masses):
        k = _stiffness(masses) + 1j * _COMPLEX * unit
        head = _followed(k, _start(masses).astype(complex), 1e-13)
        found.append(head.imag / _COMPLEX)
    return np.array(found)


def _followed(k: np.ndarray, start: np.ndarray, tolerance: float) -> Any:
    """Last place of the head, by SciPy."""

    def rates(_: float, y: np.ndarray) -> np.ndarray:
        return np.asarray(_rates(np.concatenate, k, *np.split(y, 2)))

    found = solve_ivp(rates, (0.0, _SPAN), start, "DOP853", rtol=tolerance, atol=0.1 * tolerance)
    return found.y[0, -1]


def _model(masses: int) -> Model:
    x, v, k = (ca.SX.sym(name, masses) for name in "xvk")
    rest, push = np.split(_start(masses), 2)
    return Model(
        "chain",
        [Signal("place", x, value=rest.tolist()), Signal("rate", v, value=push.tolist())],
        _rates(lambda parts: ca.vertcat(*parts), k, x, v),
        p=[Signal("stiffness", k, value=_stiffness(masses).tolist())],
    )


def _asked(tolerance: float) -> Tolerance:
    return Tolerance(tolerance, 0.1 * tolerance)


def _adjoint(masses: int) -> Run:
    model, head = _model(masses), np.eye(1, masses)[0]

    def run(tolerance: float) -> np.ndarray:
        motion = simulate(model, _SPAN, tolerance=_asked(tolerance), dense=True)
        return gradient(motion, {"place": head}, tolerance=_asked(tolerance)).p["stiffness"]

    return run


def _forward(masses: int) -> Run:
    model = _model(masses)

    def run(tolerance: float) -> np.ndarray:
        motion = simulate(model, _SPAN, tolerance=_asked(tolerance), sensitivities=["stiffness"])
        return motion.derivative("place")[0, :, -1]

    return run


def _differences(end_of: Callable[[int], End], masses: int) -> Run:
    end, k = end_of(masses), _stiffness(masses)

    def run(tolerance: float) -> np.ndarray:
        steps = np.cbrt(tolerance) * np.eye(masses)
        return np.array(
            [(end(k + s, tolerance) - end(k - s, tolerance)) / (2 * s.max()) for s in steps]
        )

    return run


def _own_end(masses: int) -> End:
    model = _model(masses)

    def end(k: np.ndarray, tolerance: float) -> float:
        motion = simulate(model, _SPAN, p={"stiffness": k}, tolerance=_asked(tolerance))
        return float(motion.end[0])

    return end


def _scipy_end(masses: int) -> End:
    return lambda k, tolerance: float(_followed(k, _start(masses), tolerance))


def _cvodes(masses: int) -> Run:
    model = _model(masses)
    x, k = ca.vertcat(*(s.symbol for s in model.x)), model.p[0].symbol
    problem = {"x": x, "p": k, "ode": model.ode}

    def run(tolerance: float) -> np.ndarray:
        options = {"reltol": tolerance, "abstol": 0.1 * tolerance}
        solver = ca.integrator("chain", "cvodes", problem, 0.0, _SPAN, options)
        p = ca.MX.sym("p", masses)
        head = solver(x0=_start(masses), p=p)["xf"][0]
        return np.array(ca.Function("slope", [p], [ca.gradient(head, p)])(_stiffness(masses)))[:, 0]

    return run


def _diffrax(adjoint: str, masses: int) -> Run:
    import diffrax  # type: ignore[import-not-found]
    import jax  # type: ignore[import-not-found]
    import jax.numpy as jnp  # type: ignore[import-not-found]

    jax.config.update("jax_enable_x64", True)
    start = jnp.array(_start(masses))

    def rates(_: Any, y: Any, k: Any) -> Any:
        return _rates(jnp.concatenate, k, y[:masses], y[masses:])

    def end(k: Any, relative: Any) -> Any:
        control = diffrax.PIDController(rtol=relative, atol=0.1 * relative)
        way = (
            diffrax.RecursiveCheckpointAdjoint()
            if adjoint == "Recursive"
            else diffrax.BacksolveAdjoint(stepsize_controller=control)
        )
        problem = diffrax.ODETerm(rates), diffrax.Dopri8(), 0.0, _SPAN, None, start, k
        found = diffrax.diffeqsolve(
            *problem, stepsize_controller=control, adjoint=way, max_steps=16384
        )
        return found.ys[0, 0]

    slope = jax.jit(jax.grad(end))
    return lambda relative: np.asarray(slope(jnp.array(_stiffness(masses)), relative))
