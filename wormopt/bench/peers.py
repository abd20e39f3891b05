"""The solvers that are compared, each as its users would call it.

`SOLVERS` maps a name to a function that takes a Case and gives a function from a tolerance to
positions and velocities at the end. What it needs to get there is paid in its first run. Relative
tolerance is what is asked for, absolute tolerance a tenth of it, for everyone alike.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cache, partial
from importlib.resources import files
from typing import Any

import numpy as np

from wormopt.bench.cases import Case
from wormopt.bench.event_loop import event_loop
from wormopt.bench.plants import thirds, track_loops, track_rates, track_start, track_traced
from wormopt.bench.smoothed import Smoothed
from wormopt.simulation.native.build import library
from wormopt.simulation.options import Smooth, Tolerance
from wormopt.simulation.simulate import simulate

Run = Callable[[float], np.ndarray]


def _wormopt(case: Case) -> Run:
    model, compared = case.build(), len(case.reference)

    def run(relative: float) -> np.ndarray:
        tolerance = Tolerance(relative, 0.1 * relative)
        motion = simulate(
            model, case.span, contact=case.contact, tolerance=tolerance, route="native"
        )
        return motion.end[:compared]

    return run


def hand_written(span: float, relative: float) -> tuple[np.ndarray, int, int]:
    """Benchmark TRACK14 by `track14.c`; returns the end state (9,), steps and evaluations.

    State: positions, velocities, gain, filter. The absolute tolerance is `relative` / 10.
    Raises RuntimeError if its step became too small.
    """
    state, counts = np.zeros(9), np.zeros(2, dtype=np.int64)
    steps = _track14().track14(
        span, relative, 0.1 * relative, state.ctypes.data, counts.ctypes.data
    )
    if steps < 0:
        raise RuntimeError("the step became too small")
    return state, int(steps), int(counts[1])


@cache
def _track14() -> ctypes.CDLL:
    text = (files("wormopt.bench") / "track14.c").read_text(encoding="utf-8")
    built = library("track14", [("track14.c", text)], "-O3")
    built.track14.restype = ctypes.c_longlong
    built.track14.argtypes = [*[ctypes.c_double] * 3, *[ctypes.c_void_p] * 2]
    return built


def _hand_written(case: Case) -> Run:
    return lambda relative: hand_written(case.span, relative)[0][:6]


def _in_thirds(case: Case, advance: Callable[[float, float, np.ndarray], np.ndarray]) -> np.ndarray:
    y = track_start(case.feedback or "filter")
    for start, end, _, _ in thirds(case.span):
        y = advance(start, end, y)
    return y[:6]


def _solve_ivp(
    rates: Callable[[float, np.ndarray], np.ndarray], method: str, case: Case, relative: float
) -> np.ndarray:
    from scipy.integrate import solve_ivp

    def advance(start: float, end: float, y: np.ndarray) -> np.ndarray:
        found = solve_ivp(rates, (start, end), y, method, rtol=relative, atol=0.1 * relative)
        if not found.success:
            raise RuntimeError(found.message)
        return found.y[:, -1]

    return _in_thirds(case, advance)


def _scipy(method: str, case: Case) -> Run:
    return partial(_solve_ivp, track_rates(case.feedback or "filter"), method, case)


def _numba(method: str, case: Case) -> Run:
    import numba  # type: ignore[import-not-found]

    rates = numba.njit(track_loops(case.feedback or "filter"))
    return partial(_solve_ivp, rates, method, case)


def _event_loop(method: str, case: Case) -> Run:
    assert case.plant is not None
    plant, compared = case.plant(), len(case.reference)

    def run(relative: float) -> np.ndarray:
        found = event_loop(
            plant,
            case.span,
            method=method,
            relative=relative,
            absolute=0.1 * relative,
            max_step=case.max_step,
        )
        return found.end[:compared]

    return run


def _casadi(plugin: str, options: dict[str, str], case: Case) -> Run:
    """Breaks are a time grid on which the scheduled numbers are piecewise constant controls."""
    import casadi as ca

    assert isinstance(case.contact, Smooth)
    smoothed, compared = Smoothed(case.build(), case.contact.v_reg), len(case.reference)
    pieces = list(smoothed.pieces(case.span))
    t, x, q, ode = smoothed.expressions
    grid, controls = [p.end for p in pieces], np.stack([p.values for p in pieces], axis=1)

    @cache
    def integrator(relative: float) -> ca.Function:
        chosen = {"reltol": relative, "abstol": 0.1 * relative, "max_num_steps": 10**7, **options}
        return ca.integrator("peer", plugin, {"t": t, "x": x, "u": q, "ode": ode}, 0, grid, chosen)

    def run(relative: float) -> np.ndarray:
        found = integrator(relative)(x0=smoothed.start, u=controls)
        return np.array(found["xf"])[:compared, -1]

    return run


def _diffrax(case: Case) -> Run:
    import diffrax  # type: ignore[import-not-found]
    import jax  # type: ignore[import-not-found]
    import jax.numpy as jnp  # type: ignore[import-not-found]

    jax.config.update("jax_enable_x64", True)
    feedback = case.feedback or "filter"
    pieces = thirds(1.0)
    middle, wave = (jnp.array([p[k] for p in pieces]) for k in (2, 3))

    def rates(t: Any, y: Any, _: Any) -> Any:
        third = jnp.floor(3 * (t % 1.0)).astype(int)
        s = t % 1.0 - third / 3
        return jnp.stack(track_traced(feedback, list(y), s, middle[third], wave[third], jnp))

    breaks = jnp.array([end for _, end, _, _ in thirds(case.span)][:-1])
    start = jnp.array(track_start(feedback))

    @jax.jit
    def solve(relative: Any) -> Any:
        control = diffrax.ClipStepSizeController(
            diffrax.PIDController(rtol=relative, atol=0.1 * relative), jump_ts=breaks
        )
        found = diffrax.diffeqsolve(
            diffrax.ODETerm(rates),
            diffrax.Dopri8(),
            0.0,
            case.span,
            None,
            start,
            stepsize_controller=control,
            saveat=diffrax.SaveAt(t1=True),
            max_steps=None,
        )
        return found.ys[0]

    return lambda relative: np.asarray(solve(relative))[:6]


def _sundae(case: Case) -> Run:
    from sksundae.cvode import CVODE  # type: ignore[import-not-found]

    hand = track_rates(case.feedback or "filter")

    def rates(t: float, y: np.ndarray, dy: np.ndarray) -> None:
        dy[:] = hand(t, y)

    def run(relative: float) -> np.ndarray:
        solver = CVODE(rates, rtol=relative, atol=0.1 * relative, max_num_steps=10**7)

        def advance(start: float, end: float, y: np.ndarray) -> np.ndarray:
            found = solver.solve(np.array([start, end]), y)
            if not found.success:
                raise RuntimeError(found.message)
            return found.y[-1]

        return _in_thirds(case, advance)

    return run


class _HeyokaFunctions:
    """heyoka's names for what `track_traced` calls."""

    def __init__(self, heyoka: Any) -> None:
        self.cos, self.sin, self.tanh = heyoka.cos, heyoka.sin, heyoka.tanh
        self.sqrt = heyoka.sqrt
        self.maximum = lambda value, _: heyoka.relu(value)


def _heyoka(case: Case) -> Run:
    import heyoka as hy  # type: ignore[import-not-found]

    feedback = case.feedback or "filter"
    start = track_start(feedback)
    names = [f"y{i}" for i in range(len(start))]
    y = list(hy.make_vars(*names))
    middle, wave = [hy.par[0], hy.par[1]], [hy.par[2], hy.par[3]]
    rates = track_traced(feedback, y, hy.time - hy.par[4], middle, wave, _HeyokaFunctions(hy))

    @cache
    def integrator(relative: float) -> Any:
        system = list(zip(y, rates, strict=True))
        return hy.taylor_adaptive(system, start, tol=relative, pars=np.zeros(5))

    def run(relative: float) -> np.ndarray:
        taylor = integrator(relative)
        taylor.time = 0.0
        taylor.state[:] = start
        for begin, end, mid, amplitude in thirds(case.span):
            taylor.pars[:] = [*mid, *amplitude, begin]
            outcome = taylor.propagate_until(end)[0]
            if outcome != hy.taylor_outcome.time_limit:
                raise RuntimeError(str(outcome))
        return taylor.state[:6].copy()

    return run


SOLVERS: dict[str, Callable[[Case], Run]] = {
    "wormopt": _wormopt,
    "hand-written C": _hand_written,
    "scipy LSODA": partial(_scipy, "LSODA"),
    "scipy Radau": partial(_scipy, "Radau"),
    "scipy DOP853": partial(_scipy, "DOP853"),
    "CasADi CVODES": partial(_casadi, "cvodes", {}),
    "CasADi CVODES (Adams)": partial(
        _casadi,
        "cvodes",
        {"linear_multistep_method": "adams", "nonlinear_solver_iteration": "functional"},
    ),
    "CasADi IDAS": partial(_casadi, "idas", {}),
    "scipy LSODA + numba": partial(_numba, "LSODA"),
    "scipy DOP853 + numba": partial(_numba, "DOP853"),
    "diffrax Dopri8": _diffrax,
    "scikit-sundae CVODE": _sundae,
    "heyoka": _heyoka,
    "event loop DOP853": partial(_event_loop, "DOP853"),
    "event loop LSODA": partial(_event_loop, "LSODA"),
    "event loop Radau": partial(_event_loop, "Radau"),
}
