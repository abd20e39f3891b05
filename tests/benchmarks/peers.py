"""The solvers that are compared, each as its users would call it.

`SOLVERS` maps a name to a function that takes a Case and gives a function from a tolerance to
positions and velocities at the end. What it needs to get there is paid in its first run. Relative
tolerance is what is asked for, absolute tolerance a tenth of it, for everyone alike.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from tests.benchmarks.cases import GOAL, MAG2_EPS, MAG2_NU, WORK_PRECISION, Case
from tests.benchmarks.ladder import Run, Task, Way
from tests.benchmarks.run import OWN
from tests.oracles.integrators import Regularised, by_casadi, event_loop
from wormopt.control.lambda_tracker import Feedback
from wormopt.simulation.native.build import library
from wormopt.simulation.options import Smooth, Tolerance
from wormopt.simulation.simulate import simulate

Hand = Callable[[float, np.ndarray], np.ndarray]

# Gait (15) with T = 1, l0 = 2, e = 0.15: on each third MIDDLE + WAVE cos(3 pi s).
_MIDDLE = 2.0 + 0.3 * np.array([[1, -1], [1, -2], [0, -1]])
_WAVE = 0.3 * np.array([[-1, 1], [1, 0], [0, -1]])
_OMEGA = 3 * math.pi


# -- TRACK13 and TRACK14 as one would write them by hand -----------------------------------------


def track_start(feedback: Feedback) -> np.ndarray:
    """Start of benchmarks TRACK13 (7,) and TRACK14 (9,), with tracker (13) or (14).

    Positions, velocities, gain and, for (14), the filter's state.
    """
    start = [0.0, 2.0, 4.0, 0.0, 0.0, 0.0, 1.0]
    return np.array([*start, 1.0, 1.0] if feedback == "filter" else start)


def track_rates(feedback: Feedback) -> Hand:
    """Benchmarks TRACK13 and TRACK14, trackers (13) and (14), in NumPy: (t, y) -> y'."""

    def rates(t: float, y: np.ndarray) -> np.ndarray:
        v, k = y[3:6], y[6]
        third = int(3 * (t % 1.0))
        angle = _OMEGA * (t % 1.0 - third / 3)
        length, rate = y[:2] - y[1:3], v[:2] - v[1:]
        e = length - (_MIDDLE[third] + _WAVE[third] * np.cos(angle))
        dk = max(math.sqrt(e @ e) - 0.2, 0.0) ** 2
        dy = np.empty_like(y)
        if feedback == "filter":
            fed = y[7:]
            dy[7:] = fed_rate = k * k * (e - fed)
        else:
            fed, fed_rate = e, rate + _OMEGA * _WAVE[third] * np.sin(angle)
        pull = 10.0 * length + 5.0 * rate + (k + dk) * fed + k * fed_rate
        dy[:3], dy[6] = v, dk
        dy[3:6] = 4.5 - 5.5 * np.tanh(40.0 * v)
        dy[3:5] -= pull
        dy[4:6] += pull
        return dy

    return rates


def track_loops(feedback: Feedback) -> Hand:
    """Benchmarks TRACK13 and TRACK14 number by number, as numba wants it: (t, y) -> y'."""
    filtered = feedback == "filter"
    middle, wave, omega = _MIDDLE, _WAVE, _OMEGA

    def rates(t: float, y: np.ndarray) -> np.ndarray:
        k = y[6]
        third = int(3 * (t % 1.0))
        angle = omega * (t % 1.0 - third / 3)
        c, s = math.cos(angle), math.sin(angle)
        e1 = y[0] - y[1] - (middle[third, 0] + wave[third, 0] * c)
        e2 = y[1] - y[2] - (middle[third, 1] + wave[third, 1] * c)
        dk = max(math.sqrt(e1 * e1 + e2 * e2) - 0.2, 0.0) ** 2
        dy = np.empty_like(y)
        if filtered:
            f1, f2 = y[7], y[8]
            d1, d2 = k * k * (e1 - f1), k * k * (e2 - f2)
            dy[7], dy[8] = d1, d2
        else:
            f1, f2 = e1, e2
            d1 = y[3] - y[4] + omega * wave[third, 0] * s
            d2 = y[4] - y[5] + omega * wave[third, 1] * s
        pull1 = 10.0 * (y[0] - y[1]) + 5.0 * (y[3] - y[4]) + (k + dk) * f1 + k * d1
        pull2 = 10.0 * (y[1] - y[2]) + 5.0 * (y[4] - y[5]) + (k + dk) * f2 + k * d2
        for i in range(3):
            dy[i] = y[3 + i]
            dy[3 + i] = 4.5 - 5.5 * math.tanh(40.0 * y[3 + i])
        dy[3] -= pull1
        dy[4] += pull1 - pull2
        dy[5] += pull2
        dy[6] = dk
        return dy

    return rates


def track_traced(
    feedback: Feedback, y: list[Any], s: Any, middle: Any, wave: Any, np: Any
) -> list[Any]:
    """Rates of TRACK13 and TRACK14 on one third of the period, for packages that trace code.

    `s`: time since the third began; its reference is middle + wave cos(3 pi s).
    `np` is the module whose cos, sin, tanh, sqrt and maximum are called.
    """
    k, c = y[6], np.cos(_OMEGA * s)
    e = [y[j] - y[j + 1] - (middle[j] + wave[j] * c) for j in range(2)]
    dk = np.maximum(np.sqrt(e[0] * e[0] + e[1] * e[1]) - 0.2, 0.0) ** 2
    if feedback == "filter":
        fed = y[7:]
        fed_rate = [k * k * (e[j] - fed[j]) for j in range(2)]
        more = fed_rate
    else:
        turn = _OMEGA * np.sin(_OMEGA * s)
        fed, fed_rate = e, [y[3 + j] - y[4 + j] + turn * wave[j] for j in range(2)]
        more = []
    pull = [
        10.0 * (y[j] - y[j + 1]) + 5.0 * (y[3 + j] - y[4 + j]) + (k + dk) * fed[j] + k * fed_rate[j]
        for j in range(2)
    ]
    grip = [4.5 - 5.5 * np.tanh(40.0 * y[3 + i]) for i in range(3)]
    net = [grip[0] - pull[0], grip[1] + pull[0] - pull[1], grip[2] + pull[1]]
    return [*y[3:6], *net, dk, *more]


def thirds(span: float) -> list[tuple[float, float, np.ndarray, np.ndarray]]:
    """Pieces of the reference of TRACK13 and TRACK14: first and last time, middle and wave.

    `span`: last time, a multiple of a third.
    """
    count = round(3 * span)
    return [(q / 3, (q + 1) / 3, _MIDDLE[q % 3], _WAVE[q % 3]) for q in range(count)]


# -- solvers -------------------------------------------------------------------------------------


def _wormopt(case: Case) -> Run:
    model, compared = case.build(), len(case.reference)

    def run(relative: float) -> np.ndarray:
        asked = Tolerance(relative, 0.1 * relative)
        motion = simulate(
            model, case.span, contact=case.contact, times=[], tolerance=asked, route="native"
        )
        return motion.end[:compared]

    return run


def hand_written(name: str, span: float, relative: float) -> tuple[np.ndarray, int, int]:
    """Benchmark TRACK14 or MAG2 by `track14.c` or `mag2.c`.

    Returns the end state, (9,) positions, velocities, gain, filter or (4,) positions, velocities;
    steps and evaluations. The absolute tolerance is `relative` / 10.
    Raises RuntimeError if its step became too small.
    """
    state, counts = np.zeros({"track14": 9, "mag2": 4}[name]), np.zeros(3, dtype=np.int64)
    addresses = state.ctypes.data, counts.ctypes.data
    steps = getattr(_by_hand(name), name)(span, relative, 0.1 * relative, *addresses)
    if steps < 0:
        raise RuntimeError("the step became too small")
    return state, int(steps), int(counts[1])


@cache
def _by_hand(name: str) -> ctypes.CDLL:
    folder, parts = Path(__file__).parent, (f"{name}.c", "dop853.h")
    texts = [(part, (folder / part).read_text(encoding="utf-8")) for part in parts]
    built = library(name, texts, "-O3")
    run = getattr(built, name)
    run.restype = ctypes.c_longlong
    run.argtypes = [*[ctypes.c_double] * 3, *[ctypes.c_void_p] * 2]
    return built


def _hand_written(case: Case) -> Run:
    compared = len(case.reference)
    return lambda relative: hand_written(case.name, case.span, relative)[0][:compared]


def _in_thirds(case: Case, advance: Callable[[float, float, np.ndarray], np.ndarray]) -> np.ndarray:
    y = track_start(case.feedback)
    for start, end, _, _ in thirds(case.span):
        y = advance(start, end, y)
    return y[:6]


def _scipy(
    hand: Callable[[Feedback], Hand], method: str, case: Case, *, compiled: bool = False
) -> Run:
    rates = hand(case.feedback)
    if compiled:
        import numba  # type: ignore[import-not-found]

        rates = numba.njit(rates)

    def run(relative: float) -> np.ndarray:
        def advance(start: float, end: float, y: np.ndarray) -> np.ndarray:
            found = solve_ivp(rates, (start, end), y, method, rtol=relative, atol=0.1 * relative)
            if not found.success:
                raise RuntimeError(found.message)
            return found.y[:, -1]

        return _in_thirds(case, advance)

    return run


def _event_loop(method: str, case: Case) -> Run:
    assert case.plant is not None
    follow = partial(event_loop, case.plant(), case.span, method=method, max_step=case.max_step)
    return lambda relative: follow(relative=relative).end[: len(case.reference)]


def _casadi(plugin: str, case: Case, **options: str) -> Run:
    assert isinstance(case.contact, Smooth)
    smoothed, times = Regularised(case.build(), case.contact.v_reg), np.array([case.span])

    @cache
    def integrator(relative: float) -> Callable[[np.ndarray], np.ndarray]:
        return by_casadi(smoothed, plugin, times, relative, max_num_steps=10**7, **options)

    return lambda relative: integrator(relative)(smoothed.start)[: len(case.reference), -1]


def _diffrax(case: Case) -> Run:
    import diffrax  # type: ignore[import-not-found]
    import jax  # type: ignore[import-not-found]
    import jax.numpy as jnp  # type: ignore[import-not-found]

    jax.config.update("jax_enable_x64", True)
    pieces = thirds(1.0)
    middle, wave = (jnp.array([p[k] for p in pieces]) for k in (2, 3))

    def rates(t: Any, y: Any, _: Any) -> Any:
        third = jnp.floor(3 * (t % 1.0)).astype(int)
        s = t % 1.0 - third / 3
        return jnp.stack(track_traced(case.feedback, list(y), s, middle[third], wave[third], jnp))

    breaks = jnp.array([end for _, end, _, _ in thirds(case.span)][:-1])
    start = jnp.array(track_start(case.feedback))

    @jax.jit
    def solve(relative: Any) -> Any:
        control = diffrax.ClipStepSizeController(
            diffrax.PIDController(rtol=relative, atol=0.1 * relative), jump_ts=breaks
        )
        problem = diffrax.ODETerm(rates), diffrax.Dopri8(), 0.0, case.span, None, start
        last = diffrax.SaveAt(t1=True)
        found = diffrax.diffeqsolve(
            *problem, stepsize_controller=control, saveat=last, max_steps=None
        )
        return found.ys[0]

    return lambda relative: np.asarray(solve(relative))[:6]


def _sundae(case: Case) -> Run:
    from sksundae.cvode import CVODE  # type: ignore[import-not-found]

    hand = track_rates(case.feedback)

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


def _heyoka(case: Case) -> Run:
    return _heyoka_track(case) if isinstance(case.contact, Smooth) else _heyoka_pair(case)


def _heyoka_track(case: Case) -> Run:
    import heyoka as hy  # type: ignore[import-not-found]

    start, par = track_start(case.feedback), hy.par
    y = list(hy.make_vars(*(f"y{i}" for i in range(len(start)))))
    functions = SimpleNamespace(
        cos=hy.cos, sin=hy.sin, tanh=hy.tanh, sqrt=hy.sqrt, maximum=lambda x, _: hy.relu(x)
    )
    s, middle, wave = hy.time - par[4], [par[0], par[1]], [par[2], par[3]]
    rates = track_traced(case.feedback, y, s, middle, wave, functions)

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


def _heyoka_pair(case: Case) -> Run:
    """Benchmark MAG2, its contacts decided at heyoka's terminal events."""
    import heyoka as hy  # type: ignore[import-not-found]

    back, ahead = MAG2_EPS, 0.5 * MAG2_EPS
    x0, x1, v0, v1 = y = hy.make_vars("x0", "x1", "v0", "v1")
    pull = x0 - x1 + MAG2_EPS * (1.0 + hy.cos(MAG2_NU * hy.time))
    slides, friction, load = [hy.par[0], hy.par[1]], [hy.par[2], hy.par[3]], [-1.0 * pull, pull]
    rates = [v0, v1, *(s * (f + u) for s, f, u in zip(slides, friction, load, strict=True))]
    # what is at rest is held while this is positive
    held = [(ahead - u) * (back + u) for u in load]
    zeros = [s * v + (1.0 - s) * h for s, v, h in zip(slides, (v0, v1), held, strict=True)]

    @cache
    def integrator(relative: float) -> Any:
        system = list(zip(y, rates, strict=True))
        events = [hy.t_event(zero) for zero in zeros]
        return hy.taylor_adaptive(system, np.zeros(4), tol=relative, t_events=events)

    def decide(taylor: Any, i: int, released: bool) -> None:
        state = taylor.state
        state[2 + i] = 0.0
        drive = state[0] - state[1] + MAG2_EPS * (1.0 + math.cos(MAG2_NU * taylor.time))
        push = drive if i else -drive
        forward = push > ahead or (released and ahead - push < back + push)
        slides = forward or push < -back or released
        taylor.pars[i] = float(slides)
        taylor.pars[2 + i] = -ahead if forward else back

    def run(relative: float) -> np.ndarray:
        taylor = integrator(relative)
        taylor.reset_cooldowns()
        taylor.time = 0.0
        taylor.state[:] = 0.0
        for i in range(2):
            decide(taylor, i, released=False)
        for _ in range(2000):
            outcome = taylor.propagate_until(case.span)[0]
            if outcome == hy.taylor_outcome.time_limit:
                return taylor.state.copy()
            which = -int(outcome) - 1
            if which not in (0, 1):
                raise RuntimeError(str(outcome))
            decide(taylor, which, released=taylor.pars[which] == 0.0)
        raise RuntimeError(f"2000 events by t = {taylor.time:.6g}")

    return run


_SCIPY = ("LSODA", "Radau", "DOP853")
_ADAMS = {"linear_multistep_method": "adams", "nonlinear_solver_iteration": "functional"}

SOLVERS: dict[str, Callable[[Case], Run]] = {
    OWN: _wormopt,
    "hand-written C": _hand_written,
    **{f"scipy {method}": partial(_scipy, track_rates, method) for method in _SCIPY},
    "CasADi CVODES": partial(_casadi, "cvodes"),
    "CasADi CVODES (Adams)": partial(_casadi, "cvodes", **_ADAMS),
    "CasADi IDAS": partial(_casadi, "idas"),
    "scipy LSODA + numba": partial(_scipy, track_loops, "LSODA", compiled=True),
    "scipy DOP853 + numba": partial(_scipy, track_loops, "DOP853", compiled=True),
    "diffrax Dopri8": _diffrax,
    "scikit-sundae CVODE": _sundae,
    "heyoka": _heyoka,
    **{f"event loop {method}": partial(_event_loop, method) for method in _SCIPY},
}


def task(name: str, quick: bool) -> Task:
    """Positions and velocities at the end of a case; `quick`: a tolerance a decade, not two."""
    case, share = WORK_PRECISION[name], 1 if quick else 2
    tolerances = tuple(10.0 ** -(k / share) for k in range(4 * share, 13 * share + 1))
    return Task(
        case.title,
        case.source,
        "positions and velocities",
        "relative tolerance",
        GOAL,
        case.reference,
        [Way(solver, partial(SOLVERS[solver], case), tolerances) for solver in case.solvers],
        far=1e5,
        targets=case.targets,
    )
