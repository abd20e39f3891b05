"""Code common to studies of optimal control: replay, scalars, signals, trust, statistics."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import casadi as ca
import numpy as np

from wormopt.control.drive import drive
from wormopt.errors import SolveError
from wormopt.model.model import Model
from wormopt.model.values import by_name
from wormopt.ocp.contact import Complementarity, FixedModes, Regularised, SwitchDetection
from wormopt.ocp.mesh import interpolation
from wormopt.ocp.motion import Motion
from wormopt.ocp.optimise import Optimum
from wormopt.ocp.switching import resting_speeds, structure_of
from wormopt.progress import Report, silent
from wormopt.result import Check
from wormopt.simulation.options import Exact, Tolerance, Treatment
from wormopt.simulation.simulate import simulate
from wormopt.simulation.trajectory import Trajectory
from wormopt.systems.shared.declared import Declared
from wormopt.systems.shared.proof import CrossCheck
from wormopt.systems.shared.signals import fitted

ACCEPTED = 1e-7
"""Largest accepted difference between the ends of an exact optimum and of its simulation."""

# Tolerance of the simulation that checks an optimum.
_TIGHT = Tolerance(relative=1e-12, absolute=1e-13)
# States that differ by more than this part of their nominal size across a joint have jumped.
_JUMP = 1e-9
# A point is no optimum if its objective can still fall by more than this part of its size.
_GAIN = 1e-6
# A relaxed optimum better than the exact one by more than this share has other phases.
_MISREAD = 1e-2
# Samples of a motion: least number in all and on each arc, and distance from the ends of an arc.
_SAMPLES, _PER_ARC, _INSIDE = 400, 3, 1e-9
# Arcs and phases shorter than these shares of the motion are left out. An interior point with a
# tolerance of 1e-10 leaves a phase that should vanish with up to the square root of it.
_NOTHING, _SHORT = 1e-12, 1e-5


# -- simulation of the optimal inputs --------------------------------------------------------------


def replay(
    motion: Motion,
    contact: Treatment = Exact(),  # noqa: B008  frozen
    *,
    tolerance: Tolerance = _TIGHT,
    dense: bool = False,
    report: Report = silent,
) -> list[Trajectory]:
    """Simulate the model open loop with the optimal inputs, one trajectory between impulses each.

    Uses only the start and the jumps at impulses of the optimiser's states. `dense` keeps the
    whole motion. Raises SolveError if the simulation fails.
    """
    course = motion.input_course()
    plant = drive(_plant(motion), course) if course.links else _plant(motion)
    p = by_name(motion.program.problem.parameters, motion.p)
    found: list[Trajectory] = []
    state = np.zeros(plant.n_x)
    for begin, end, jump in _stretches(motion):
        found.append(
            simulate(
                plant,
                (begin, end),
                contact=contact,
                x0=by_name(plant.x, state + jump),
                p=p,
                tolerance=tolerance,
                dense=dense,
                report=lambda _, fraction: report("simulating the optimal inputs", fraction),
            )
        )
        state = found[-1].end
    return found


def cross_check(
    motion: Motion,
    contact: Treatment = Exact(),  # noqa: B008  frozen
    *,
    accepted: float = ACCEPTED,
    report: Report = silent,
) -> CrossCheck:
    """Compare the end of an optimal motion with that of its simulation.

    Differences, up to `accepted`, are relative to the larger of a state's magnitude and nominal
    size.
    """
    label = "simulation of the optimal inputs, contact " + type(contact).__name__.lower()
    try:
        end = replay(motion, contact, report=report)[-1].end
    except SolveError as error:
        return CrossCheck(label, None, accepted, "the model", error.reason)
    found = motion.states(np.array([motion.duration]))[:, 0]
    size = np.maximum(motion.program.arc.x_nominal, np.abs(end))
    return CrossCheck(label, float(np.max(np.abs(found - end) / size)), accepted, "the model")


def _plant(motion: Motion) -> Model:
    """Model with the design constants as parameters, set to their optimal values."""
    # Its states have no bounds; bounds are for optimisers and hold to round-off.
    problem = motion.program.problem
    values = by_name(problem.design, motion.arcs.design)
    chosen = [replace(s, value=values[s.name].tolist()) for s in problem.design]
    free = [replace(s, lower=-np.inf, upper=np.inf) for s in problem.model.x]
    return replace(problem.model, x=free, p=[*problem.parameters, *chosen])


def _stretches(motion: Motion) -> Iterator[tuple[float, float, np.ndarray]]:
    """Start and end of each stretch between impulses, and the jump of the states before it."""
    arcs, mesh = motion.arcs, motion.mesh
    nodes, values = mesh.collocation.nodes, arcs.states
    ends = np.einsum("k,rkn->rn", interpolation(nodes, np.ones(1))[0], values)
    jumps = arcs.start - np.column_stack([np.zeros(len(ends)), ends[:, :-1]])
    size = motion.program.arc.x_nominal[:, None]
    sudden = np.any(np.abs(jumps) > _JUMP * size, axis=0) & motion.program.problem.impulses
    first = [0, *(np.flatnonzero(sudden[1:]) + 1)]
    for k, after in zip(first, [*first[1:], mesh.total], strict=True):
        begin, end = float(motion.breaks[k]), float(motion.breaks[after])
        if end - begin > _NOTHING * motion.duration:
            yield begin, end, jumps[:, k]


# -- signals ---------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Sampled:
    """A sampled motion; the time where two arcs join appears twice, before and after."""

    time: np.ndarray  # (m,), ascending
    values: dict[str, np.ndarray]  # (entries, m) by name of the expression

    def arrays(self, declared: Declared) -> dict[str, np.ndarray]:
        """Samples by name, with their times as the coordinate ``instant``.

        It is not called ``time`` because that scalar is the duration of an optimal motion.
        """
        return {"instant": self.time, **fitted(self.values, declared)}


def sample_motion(motion: Motion, expressions: Mapping[str, ca.SX]) -> Sampled:
    """Sample expressions over a motion, without arcs of zero duration."""
    lasting = np.flatnonzero(motion.arcs.duration > _NOTHING * motion.duration)
    count = max(_PER_ARC, -(-_SAMPLES // len(lasting)) + 1)
    places = np.linspace(0, 1, count)
    places[-1] -= _INSIDE  # so that each time belongs to its own arc
    t = (motion.breaks[lasting, None] + motion.arcs.duration[lasting, None] * places).ravel()
    t[-1] = motion.duration
    values = motion.observe(ca.vertcat(ca.SX(0, 1), *map(ca.vec, expressions.values())), t)
    edges = np.cumsum([e.numel() for e in expressions.values()])[:-1]
    return Sampled(t, dict(zip(expressions, np.split(values, edges), strict=True)))


def modes_of(optimum: Optimum) -> tuple[list[list[int]], list[float]]:
    """Contact modes of each phase (0 at rest, ±1 sliding), and the times of the phase boundaries.

    Prescribed modes are kept, others are read from the motion; phases without duration are left
    out, and those that are alike beside one left out become one. There is one more time than
    phases.
    """
    motion, treatment = optimum.motion, optimum.treatment
    if isinstance(treatment, FixedModes):
        edges = motion.phase_breaks()
        none = ((),) * motion.mesh.phases
        modes = treatment.modes.phases if treatment.modes else none
        active = treatment.active or none
    else:
        least = 1 if isinstance(treatment, SwitchDetection) else 2
        structure = structure_of(motion, speed=resting_speeds(optimum)[0], least=least)
        edges = np.concatenate([[0.0], np.cumsum(structure.durations)])
        modes, active = structure.modes.phases, structure.active
    keys, kept, last = list(zip(modes, active, strict=True)), list[int](), 0
    for k in np.flatnonzero(np.diff(edges) > _SHORT * motion.duration):
        if not kept or k == last + 1 or keys[k] != keys[kept[-1]]:
            kept.append(int(k))
        last = k
    return [list(modes[k]) for k in kept], [0.0, *edges[kept[1:]].tolist(), motion.duration]


# -- numbers ---------------------------------------------------------------------------------------


def input_sizes(motion: Motion) -> tuple[float | None, float | None]:
    """Root mean square of u over time, and the largest |u_j|; None if inputs act by impulses."""
    if motion.program.problem.impulses:
        return None, None
    degree = motion.mesh.input_degree
    s, weights = np.polynomial.legendre.leggauss(degree + 1)  # exact for the squares
    u = np.einsum("sk,rkn->rsn", motion.mesh.inputs_at((s + 1) / 2), motion.arcs.inputs)
    square = np.einsum("s,rsn,n->", weights / 2, u**2, motion.arcs.duration)
    fine = motion.mesh.inputs_at(np.linspace(0, 1, 20 * degree + 2))
    lasting = motion.arcs.duration > _NOTHING * motion.duration
    largest = np.abs(np.einsum("sk,rkn->rsn", fine, motion.arcs.inputs[:, :, lasting]))
    return float(np.sqrt(square / motion.duration)), float(largest.max(initial=0.0))


def statistics(optimum: Optimum) -> dict[str, Any]:
    """Statistics of the nonlinear program: sizes, status, violation, iterations and seconds."""
    solution = optimum.solution
    return {
        "status": solution.status,
        "objective": solution.objective,
        "violation": solution.violation,
        "arcs": optimum.motion.mesh.total,
        "variables": len(optimum.bounds.lbw),
        "constraints": len(optimum.bounds.lbg),
        "solves": len(optimum.levels),
        "iterations": optimum.iterations,
        "build_s": optimum.build_s,
        "solve_s": optimum.solve_s,
        "functions_s": optimum.functions_s,
    }


# -- trust -----------------------------------------------------------------------------------------


def optimum_facts(stages: Mapping[str, Optimum], second: CrossCheck) -> dict[str, Any]:
    """Facts of the trust reports of all optimal motions.

    The last of `stages` is the result, `second` its simulation.
    """
    optimum = [*stages.values()][-1]
    return {
        "treatment": _treatment_in_words(optimum),
        "status": optimum.solution.status,
        "violation": optimum.solution.violation,
        "defect_max": float(optimum.defects.max()),
        "complementarity_max": optimum.complementarity,
        "first_order_gain": optimum.gain,
        "recheck": second.facts,
        "solves": {name: statistics(stage) for name, stage in stages.items()},
    }


def replay_check(second: CrossCheck) -> Check:
    """Check that an optimum and the simulation of its inputs end in the same state."""
    advice = (
        f"the optimal inputs cannot be simulated: {second.reason}"
        if second.error is None
        else f"a simulation with the optimal inputs ends in other states, by {second.error:.2g} of "
        f"the states' size, where {second.accepted:.2g} is accepted"
    )
    return Check("simulation of the inputs found", second.error, second.accepted, advice)


def _treatment_in_words(optimum: Optimum) -> str:
    treatment = optimum.treatment
    if isinstance(treatment, Regularised):
        return f"smooth, v_reg = {treatment.v_reg:.6g}"
    if isinstance(treatment, SwitchDetection):
        return (
            f"complementarity over arcs that end at switches, relaxed to {treatment.residual:.6g}"
        )
    if isinstance(treatment, Complementarity):
        return f"complementarity, relaxed to {treatment.residual:.6g}"
    return "exact: prescribed modes, switching times free"


def warnings_of_optimum(optimum: Optimum, tolerance: float) -> Iterator[str]:
    """Warn if an optimum misses its accuracy; `tolerance` is the requested defect."""
    worst, arcs = float(optimum.defects.max()), optimum.motion.mesh.total
    if worst > tolerance:
        yield (
            f"the mesh was refined to {arcs} arcs, but the defect is still {worst:.2g}, above the "
            f"requested {tolerance:.2g}"
        )
    size = max(abs(optimum.objective), 1e-300)
    if np.isnan(optimum.gain):
        yield (
            "it is unknown whether the optimum is optimal to first order: the linear program failed"
        )
    elif optimum.gain > _GAIN * size:
        yield (
            f"not optimal to first order: nearby the objective may fall by {optimum.gain:.2g}, "
            f"{optimum.gain / size:.1g} of its size"
        )
    if _has_stiction(optimum.motion):
        yield (
            "stiction is larger than sliding friction: in the optimal motion a contact may leave "
            "rest before its force reaches stiction; then the simulation ends in other states"
        )
    if optimum.solution.status == "Solved_To_Acceptable_Level":
        yield "the solver stopped before its tolerance, at an acceptable level (IPOPT's status)"


def _has_stiction(motion: Motion) -> bool:
    """Whether a contact holds more force at rest than it resists when it starts to slide."""
    arc = motion.program.arc
    p, design = arc.constants[3], arc.constants[2]
    for contact, ends in zip(
        motion.program.problem.model.contacts, arc.rests(motion.p), strict=True
    ):
        for d in contact.law.directions:
            slip = ca.SX(contact.law.slip_force(0.0, d)) / contact.nominal_force
            if ca.depends_on(slip, design):
                continue
            resists = abs(float(ca.Function("slip", [p], [slip])(motion.p)))
            if abs(ends[0 if d > 0 else 1]) > resists * (1 + 1e-9):
                return True
    return False


def warnings_of_reading(relaxed: Optimum, exact: Optimum) -> Iterator[str]:
    """Warn if the phases of a relaxed motion may have been misread.

    `exact` is the optimum with the phases read from `relaxed`.
    """
    lost = exact.objective - relaxed.objective
    share = lost / max(abs(exact.objective), abs(relaxed.objective), 1e-300)
    if share > _MISREAD:
        yield (
            f"the relaxed motion is better by {100 * share:.2g} %: its phases may have been "
            "misread; increase mesh.arcs to resolve them"
        )


def in_keys(
    error: SolveError,
    keys: Mapping[str, str] = MappingProxyType({}),
    advice: Mapping[str, str] = MappingProxyType({}),
    partial: Any = None,
) -> SolveError:
    """Restate an optimiser's failure in the keys of the scene.

    `keys` maps the optimiser's names to keys of the scene; `advice` by error code replaces the
    optimiser's own; `partial` is what was computed.
    """

    def in_scene(text: str) -> str:
        named = {word: key for word, key in keys.items() if key not in text}
        return re.sub(r"\w+", lambda m: f"{m[0]} ({named[m[0]]})" if m[0] in named else m[0], text)

    suggestion = advice.get(error.code) or in_scene(error.suggestion)
    return SolveError(in_scene(error.reason), suggestion, partial, error.code)
