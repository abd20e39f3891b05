"""Integration by SUNDIALS through CasADi: CVODES, and IDAS where there are algebraic equations.

For stiff smooth motions, and for smooth ones without a compiler. Implicit steps may miss the steep
layer of a smooth contact law without an error estimate: velocities that should stay near zero
continue. Runs to different tolerances do so differently. With contacts, the motion is therefore
computed at least twice, and returned only if a run agrees with one to a tolerance a hundred
times looser.

Measured on a tracked and on a shaken chain of three masses, F- = 10 F+, 10 time units, v_reg from
1e-2 to 1e-7: errors against exact or explicit solutions were below 10 tolerances where the layer
was resolved, and 200 to 40000 tolerances otherwise.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import NamedTuple

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError, interruptible
from wormopt.model.schedule import Schedule
from wormopt.model.values import signal_values
from wormopt.progress import Report, silent
from wormopt.simulation.functions import System
from wormopt.simulation.initial_value import InitialValueProblem, Outcome
from wormopt.simulation.options import Smooth

# Runs agree if they differ by at most this many tolerances of the first.
_AGREE = 100.0
_LOOSEST = 1e-7
_STEP_DOWN = 100.0
_RUNS = 4
_LEAST_RELATIVE = 1e-14
# Share of the local error that Newton's iteration may leave. With a tenth, CVODES's own, films with
# floats lose 25 times as much energy.
_NEWTON = 0.01
# Share of a short piece of a schedule after which a step ends; not at zeros by symmetry.
_WITHIN = 0.38
# Number of times at which the state is always stored, for the comparison and for partial results.
# One integrator covers this many at a time.
_STATIONS = 64
_CHUNK = 200
# Equal parts between two of them, at whose ends the motion is stored if no times are named: steps
# do not end there.
_PARTS = 8


def integrate(task: InitialValueProblem, report: Report) -> Outcome:
    """Integrate a smooth task without switches by CVODES or IDAS, with the exact Jacobian.

    Returns the run to the smallest tolerance; status "layer_not_resolved" if runs disagree. Raises
    ArgumentError if contact is exact, there are switches, or polynomials are requested (`dense`).
    """
    _refuse(task)
    relative, grid = task.tolerance.relative, _Grid(task)
    if not task.system.contacts:
        return _run(task, grid, relative, report).outcome()
    runs: list[_Run] = []
    for k in range(_RUNS):
        exact = min(_STEP_DOWN * relative, _LOOSEST) / _STEP_DOWN**k
        run = _run(task, grid, max(exact, _LEAST_RELATIVE), report)
        if run.status in ("too_many_steps", "interrupted") or any(
            run.agrees(other) for other in runs
        ):
            return run.outcome()
        runs.append(run)
    ended = [run for run in runs if run.status == "done"]
    return ended[-1].outcome(ended[-2]) if len(ended) > 1 else runs[-1].outcome()


def _refuse(task: InitialValueProblem) -> None:
    model, treatment = task.system.model, task.system.treatment
    if task.system.contacts and not isinstance(treatment, Smooth):
        raise ArgumentError("CVODES and IDAS do not support exact contact; write Smooth(v_reg)")
    if model.switches:
        names = [switch.name for switch in model.switches]
        raise ArgumentError(f'CVODES and IDAS support no switches, {names}; write route = "python"')
    if task.dense:
        what = "CVODES and IDAS do not keep the motion"
        raise ArgumentError(f'{what}; write times or route = "python"')


class _Grid:
    """Times at which the state is stored, and values in between.

    They include all breaks of schedules: CasADi ends a step where an input changes. It does not
    restart CVODES there, and implicit formulas see only the ends of steps: a step from break to
    break would miss a pulse that vanishes at both. The last input therefore changes once within
    each short piece.
    """

    def __init__(self, task: InitialValueProblem) -> None:
        start, end = task.span
        pieces = [_pieces(schedule, start, end) for schedule in task.schedules]
        breaks = np.unique(np.concatenate([[start, end], *(p[0] for p in pieces)]))
        sizes = np.diff(breaks)
        within = (breaks[:-1] + _WITHIN * sizes)[sizes < 1.5 * task.max_step]
        within = within if pieces else within[:0]
        wanted = [task.times, np.linspace(start, end, _STATIONS + 1), breaks, within]
        times = np.unique(np.concatenate(wanted))
        gap = 1e-14 * max(abs(start), abs(end)) + 1e-13 * (end - start)
        times = times[np.concatenate([[True], np.diff(times) > gap])]
        times[-1] = end
        self.times = times
        self.samples = np.searchsorted(times, task.times - gap)
        middle = (times[:-1] + times[1:]) / 2
        rows = [np.zeros((0, len(middle)))]
        for own, values in pieces:
            rows.append(values[np.searchsorted(own, middle) - 1].T)
        self.scheduled = np.vstack(rows)
        if task.directions:
            along = task.directions.scheduled(task.system.n_fixed, task.schedules, middle)
            along = along[task.system.n_fixed :].swapaxes(0, 1).reshape(-1, len(middle))
            self.scheduled = np.vstack([self.scheduled, along])
        self.scheduled = np.vstack([self.scheduled, np.searchsorted(within, middle) % 2])

    def parts(self, first: int, end: int) -> list[tuple[int, int]]:
        """Parts between two times of the grid in which an integrator may succeed, or get farther.

        At a break its error test may fail for good, because its formulas use steps from before the
        break. Without breaks, parts that fail are cut into eighths until the time reached is known;
        halves would repeat the many small steps before it more often.
        """
        now = self.scheduled[:, first:end]
        at = first + 1 + np.flatnonzero(np.any(now[:, 1:] != now[:, :-1], axis=0))
        if not at.size:
            at = np.linspace(first, end, 9).astype(int)[1:-1]
        ends = sorted({first, *at.tolist(), end})
        return list(pairwise(ends))


def _pieces(schedule: Schedule, start: float, end: float) -> tuple[np.ndarray, np.ndarray]:
    """Times from ``start`` on at which pieces begin, and their values, with `begin` first."""
    times = np.append(start, schedule.breaks_between(start, end))
    begin, piece = schedule.locate(times)
    return times, np.column_stack([begin, schedule.values[piece]])


@dataclass(eq=False)
class _Run:
    """A motion to one tolerance."""

    task: InitialValueProblem
    grid: _Grid
    relative: float
    states: list[np.ndarray]
    status: str = "done"
    n_steps: int = 0
    n_rejected: int = 0
    n_evaluations: int = 0
    kept: list[np.ndarray] = field(default_factory=list)  # rows of time and state, if requested

    @cached_property
    def equations(self) -> _Equations:
        task, sizes = self.task, _sizes(self.task)
        if task.directions is None and task.equations is not None:
            return _Equations(task.equations)
        if task.directions is None:
            return _shared(task.system, tuple(sizes.tolist()))
        scale = ca.DM(sizes)
        return _as_call(_varied(task, _scaled(task.system, scale), scale))

    def agreed(self, other: _Run) -> int:
        """Number of points of time up to which two runs agree."""
        count = min(len(self.states), len(other.states))
        mine, its = np.array(self.states[:count]), np.array(other.states[:count])
        absolute = self.task.all_absolute * other.relative / self.task.tolerance.relative
        size = other.relative * np.abs(its).max(axis=0) + absolute
        apart = np.flatnonzero(np.any(np.abs(mine - its) > _AGREE * size, axis=1))
        return int(apart[0]) if len(apart) else count

    def agrees(self, other: _Run) -> bool:
        both_ended = self.status == other.status == "done"
        return both_ended and self.agreed(other) == len(self.states)

    def outcome(self, other: _Run | None = None) -> Outcome:
        """Results, up to where another run disagrees."""
        count = len(self.states) if other is None else self.agreed(other)
        reached = self.grid.samples[self.grid.samples < count]
        states = np.array(self.states[:count])
        return Outcome(
            status=self.status if other is None else "layer_not_resolved",
            route=_plugin(self.task),
            t=float(self.grid.times[count - 1]),
            x=states[-1],
            samples=states[reached],
            kept=self._kept(float(self.grid.times[count - 1])),
            n_steps=self.n_steps,
            n_rejected=self.n_rejected,
            n_evaluations=self.n_evaluations,
        )

    def _kept(self, until: float) -> np.ndarray:
        """Rows of time and state up to a time, no more than requested."""
        start = np.append(self.grid.times[0], self.states[0])
        rows = np.array([start, *(row for row in self.kept if row[0] <= until)])
        return rows[:: -(-len(rows) // self.task.keep)] if self.task.keep else rows[:0]


def _plugin(task: InitialValueProblem) -> str:
    return "idas" if task.system.model.alg.numel() else "cvodes"


def _run(task: InitialValueProblem, grid: _Grid, relative: float, report: Report) -> _Run:
    """Integrate the motion to a relative tolerance."""
    run = _Run(task, grid, relative, [task.start])
    if not np.all(np.isfinite(task.x0)):
        run.status = "not_finite"
        return run
    guess = signal_values(tuple(task.system.model.z), {}, "algebraic variable", fill=0.0)
    guess = np.append(guess, np.zeros(len(guess) * task.k))
    span, last = task.span[1] - task.span[0], len(grid.times) - 1
    todo = [(k, min(k + _CHUNK, last)) for k in range(0, last, _CHUNK)][::-1]
    while todo:
        first, end = todo.pop()
        try:
            report("simulating", (grid.times[first] - task.span[0]) / span)
            with interruptible():
                guess = _advance(run, _solver(run, first, end), guess, first, end)
        except KeyboardInterrupt:
            run.status = "interrupted"
            break
        except RuntimeError as failure:
            if end - first > 1:
                todo += grid.parts(first, end)[::-1]
                continue
            run.status = _why(task, relative)
            if "TOO_MUCH_WORK" in str(failure):
                run.n_steps += task.tolerance.max_steps
            break
        if run.n_steps >= task.tolerance.max_steps:
            break
    if run.n_steps >= task.tolerance.max_steps:
        run.status = "too_many_steps"
    return run


def _why(task: InitialValueProblem, relative: float) -> str:
    """Reason for failure: derivatives, if the integrator succeeds without them."""
    if task.directions is None:
        return "solver_failed"
    alone = replace(task, directions=None)
    done = _run(alone, _Grid(alone), relative, silent).status == "done"
    return "steep_derivatives" if done else "solver_failed"


def _solver(run: _Run, first: int, end: int) -> ca.Function:
    """Integrator from one time of the grid to another."""
    task, times = run.task, run.grid.times
    options = {
        "reltol": run.relative,
        "abstol": run.relative * task.tolerance.absolute / task.tolerance.relative,
        "max_num_steps": task.tolerance.max_steps,
        "max_step_size": task.max_step,
        "disable_internal_warnings": True,
        "show_eval_warnings": False,
    }
    if _plugin(task) == "cvodes":
        options["nonlin_conv_coeff"] = _NEWTON
        # otherwise it never returns where the motion ends
        options["min_step_size"] = 1e-15 * max(abs(times[0]), abs(times[-1]))
    outputs = _outputs(run, first, end).tolist()
    return ca.integrator("solver", _plugin(task), run.equations.dae, times[first], outputs, options)


def _outputs(run: _Run, first: int, end: int) -> np.ndarray:
    """Output times between two times of the grid, the last one included."""
    times = run.grid.times[first : end + 1]
    if not run.task.keep:
        return times[1:]
    parts = times[:-1, None] + np.diff(times)[:, None] * np.arange(1, _PARTS + 1) / _PARTS
    parts[:, -1] = times[1:]
    return parts.ravel()


def _advance(run: _Run, solver: ca.Function, guess: np.ndarray, first: int, end: int) -> np.ndarray:
    """Continue from one time of the grid to another; returns the algebraic variables there."""
    task, scale = run.task, _sizes(run.task)
    found = solver(
        x0=run.states[-1] / scale,
        z0=guess,
        p=task.p[: task.system.n_fixed],
        u=np.repeat(run.grid.scheduled[:, first:end], _PARTS if task.keep else 1, axis=1),
    )
    states = scale[:, None] * np.array(found["xf"])
    if not np.all(np.isfinite(states)):
        raise RuntimeError("the motion becomes infinite or NaN")
    if task.keep:
        run.kept.extend(np.column_stack([_outputs(run, first, end), states.T]))
        states = states[:, _PARTS - 1 :: _PARTS]
    run.states.extend(states.T)
    work = solver.stats()
    run.n_steps += work["nsteps"]
    run.n_rejected += work.get("netfails", 0) + work.get("nncfails", 0)
    run.n_evaluations += work.get("nfevals", work.get("nrevals", 0))
    return np.array(found["zf"])[:, -1]


def _sizes(task: InitialValueProblem) -> np.ndarray:
    """Nominal size of every state, and of its derivatives."""
    return task.all_absolute / task.tolerance.absolute


class _Equations(NamedTuple):
    """A system as one call, whose Jacobian is made once for all its integrators."""

    dae: dict[str, ca.MX] | ca.Function
    # CasADi takes it from a call, but keeps it only while somebody does
    jacobian: ca.Function | None = None


@lru_cache(maxsize=4)
def _shared(system: System, sizes: tuple[float, ...]) -> _Equations:
    return _as_call(_scaled(system, ca.DM(sizes)))


def _as_call(system: dict[str, ca.SX]) -> _Equations:
    names, found = ["t", "x", "z", "p", "u"], ["ode", "alg"]
    varied = {"jac_penalty": 0, "is_diff_in": [name in ("x", "z") for name in names]}
    stop = ca.SX.sym("stop")  # ends a step where it changes, see _Grid
    system = system | {"u": ca.vertcat(system["u"], stop)}
    inputs, outputs = [system[name] for name in names], [system[name] for name in found]
    call = ca.Function("dae", inputs, outputs, names, found, varied)
    symbols = {name: ca.MX.sym(name, *call.size_in(name)) for name in names}
    return _Equations(symbols | call(**symbols), call.jacobian())


def _scaled(system: System, scale: ca.DM) -> dict[str, ca.SX]:
    """The system in states of nominal size 1, since both codes have one absolute tolerance."""
    dae, n_fixed = system.dae, system.n_fixed
    x = ca.SX.sym("x", dae["x"].numel())
    states = scale[: x.numel()]
    ode, alg = ca.substitute([dae["ode"], dae["alg"]], [dae["x"]], [states * x])
    fixed, scheduled = ca.vertsplit(dae["p"], [0, n_fixed, dae["p"].numel()])
    return {
        "t": dae["t"],
        "x": x,
        "z": dae["z"],
        "p": fixed,
        "u": scheduled,
        "ode": ode / states,
        "alg": alg,
    }


def _varied(task: InitialValueProblem, system: dict[str, ca.SX], scale: ca.DM) -> dict[str, ca.SX]:
    """The system with its variational equations; directions of schedules are inputs too."""
    assert task.directions is not None
    k, n_x, n_z = task.k, system["x"].numel(), system["z"].numel()
    rows, along_z = ca.SX.sym("S", k, n_x), ca.SX.sym("Z", n_z, k)
    along_u = ca.SX.sym("along", system["u"].numel(), k)
    along_x = rows.T * ca.reshape(scale[n_x:], k, n_x).T / ca.repmat(scale[:n_x], 1, k)
    along_p = ca.DM(task.directions.p[: system["p"].numel()])
    inner = ca.vertcat(*(system[name] for name in ("x", "z", "p", "u")))
    change = ca.vertcat(along_x, along_z, along_p, along_u)
    ode = ca.jtimes(system["ode"], inner, change) * ca.repmat(scale[:n_x], 1, k)
    ode = ca.vec(ode.T) / scale[n_x:]
    alg = ca.vec(ca.jtimes(system["alg"], inner, change)) if n_z else ca.SX(0, 1)
    more = {"x": rows, "z": along_z, "u": along_u, "ode": ode, "alg": alg}
    return system | {n: ca.vertcat(system[n], ca.vec(part)) for n, part in more.items()}
