"""Tasks with conditions held between the instants at which they change, and back."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError
from wormopt.model.model import Model, pack
from wormopt.numerics.instructions import read
from wormopt.simulation.conditions import Lifted, lifted, may_have
from wormopt.simulation.functions import System
from wormopt.simulation.initial_value import InitialValueProblem, Outcome
from wormopt.simulation.instants import scheduled
from wormopt.simulation.options import Treatment
from wormopt.simulation.sensitivity.directions import Directions

_MISSED = (
    "functions of time are narrow at more places than are looked at; pulses between steps may have "
    "been missed: shorten the time, or give a smaller max_step"
)


@dataclass(frozen=True, eq=False)
class Held:
    """A task with held conditions, and the original task."""

    task: InitialValueProblem
    asked: InitialValueProblem
    complete: bool  # whether all narrow functions have been found

    def outcome(self, found: Outcome) -> Outcome:
        """The results, in terms of the original task."""
        n_x, k = self.asked.system.model.n_x, self.asked.k
        first = len(self.task.x0)
        columns = [*range(n_x), *range(first, first + n_x * k)]
        places = np.arange(len(self.asked.start))
        kept = np.concatenate([places[:n_x], places[len(self.asked.x0) :]])

        def as_asked(x: np.ndarray) -> np.ndarray:
            full = np.zeros((*x.shape[:-1], len(self.asked.start)))
            full[..., kept] = x[..., columns]
            return full

        own = len(self.asked.system.happening)
        chatters = found.status == "events_accumulate" and found.events[-1:, 1] >= own
        return replace(
            found,
            status="slides_on_condition" if np.any(chatters) else found.status,
            x=as_asked(found.x),
            samples=as_asked(found.samples),
            kept=np.column_stack([found.kept[:, 0], as_asked(found.kept[:, 1:])])
            if len(found.kept)
            else np.zeros((0, 1 + len(self.asked.start))),
            dense=as_asked(found.dense) if len(found.dense) else found.dense,
            events=found.events[found.events[:, 1] < own],
            doubts=found.doubts[found.doubts[:, 1] < own],
            notes=() if self.complete else (_MISSED,),
        )


def hold(task: InitialValueProblem, *, switches: bool) -> Held | None:
    """Hold the conditions of a task; None if there are none, nor narrow functions.

    `switches`: whether its integrator knows switches.

    Raises
    ------
    ArgumentError
        If derivatives are asked for by what moves an instant, and there are no switches.
    SolveError
        If conditions change too often to be followed.
    """
    model = task.system.model
    if not _may_have(task.system):
        return None
    switches = switches and not model.alg.numel()
    found = lifted(model, switches, moving=False)
    if found is None:
        return None
    if task.directions is not None and _moves(found, task.directions):
        if not switches:
            raise ArgumentError(
                f"parameters move instants at which the right-hand side of {model.name} jumps, and "
                'this route has no derivatives of them; take route = "native" or "python"'
            )
        found = lifted(model, switches, moving=True)
        assert found is not None
    own, given = len(model.schedules), len(task.p[: task.system.n_fixed - 1])
    schedules = task.schedules[:own]
    new, complete = scheduled(
        found.timed,
        found.model.schedules[own],
        task.span,
        task.p[:given],
        schedules,
        task.max_step,
    )
    if found.model.ode is model.ode and new.pieces == 1:
        return None if complete else Held(task, task, complete)
    system = _system(found, task.system.treatment)
    start = _start(found, model, task, new.values[0])
    at = task.system.n_fixed + sum(1 + s.symbol.numel() for s in model.schedules)
    more = 1 + new.symbol.numel()
    n_x = model.n_x
    along = task.directions
    if along is not None:
        zeros = np.zeros((new.pieces, new.symbol.numel(), along.k))
        along = replace(
            along,
            x0=np.vstack([along.x0, np.zeros((found.held, along.k))]),
            p=np.insert(along.p, [at] * more, 0.0, axis=0),
            schedules=(*along.schedules[:own], zeros, *along.schedules[own:]),
        )
    ready = replace(
        task,
        system=system,
        x0=np.concatenate([task.x0[:n_x], start, np.zeros(system.n_pushes)]),
        p=np.insert(task.p, [at] * more, 0.0),
        schedules=(*schedules, new, *task.schedules[own:]),
        directions=along,
    )
    return Held(ready, task, complete)


@lru_cache(maxsize=64)
def _may_have(system: System) -> bool:
    """Whether there may be conditions, from instructions that are read for compilation anyway."""
    if system.model.alg.numel() or system.model.delays:
        return True
    functions = [system.rhs, *([system.probe] if system.exact else [])]
    functions += [system.guards] if system.model.switches else []
    if not all(function.is_a("SXFunction") for function in functions):
        return True
    return may_have(system.model, np.concatenate([read(each)[0] for each in functions]))


@lru_cache(maxsize=64)
def _system(found: Lifted, treatment: Treatment) -> System:
    return System(found.model, treatment)


def jumps_move(model: Model) -> bool:
    """Whether the right-hand side of a model jumps at instants that its parameters move."""
    found = lifted(model, not model.alg.numel(), moving=False)
    if found is None:
        return False
    others = found.timed.inputs[1:]
    return found.held > 0 or bool(others.numel() and ca.depends_on(found.timed.jumping, others))


def _moves(found: Lifted, along: Directions) -> bool:
    """Whether a direction moves an instant at which the right-hand side jumps."""
    moved = np.any(along.p != 0, axis=1)
    inputs = found.timed.inputs[1:]
    symbols = [inputs[int(k)] for k in np.flatnonzero(moved[: inputs.numel()])]
    scheduled = any(np.any(values != 0) for values in along.schedules)
    if scheduled:
        symbols = ca.vertsplit(inputs)
    return bool(symbols) and bool(ca.depends_on(found.timed.jumping, ca.vertcat(*symbols)))


def _start(found: Lifted, model: Model, task: InitialValueProblem, first: np.ndarray) -> np.ndarray:
    """Values of conditions of states at the start, if those of time have the values `first`."""
    if not found.held:
        return np.zeros(0)
    inputs = found.timed.inputs
    held = found.model.schedules[len(model.schedules)].symbol
    says = ca.Function("says", [inputs, pack(model.x), held], [found.start])
    p = task.system.scheduled(task.p, task.schedules, np.array([task.span[0]]))[:, 0]
    fixed, rest = np.split(p, [task.system.n_fixed])
    rest = rest[: inputs.numel() - len(fixed)]  # without v_reg, which time replaces
    given = np.concatenate([task.span[:1], fixed[:-1], rest])
    return np.array(says(given, task.x0[: model.n_x], first)).ravel()
