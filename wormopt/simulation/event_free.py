"""The end of a motion without locating events: a check of the routes that locate them.

Steps of fixed length hold the laws of contact as sets, over each step as a whole (Moreau and
Jean): the force of a contact is what brings it to rest if its law can, else what it slides with.
Where that changes within a step, the mean force is that of a velocity, or of what holds it, along a
straight line. So events leave the order of the midpoint rule, two; only contacts that act on one
another are of the first order there. The number of steps is doubled and ends are extrapolated;
their changes say how far they are to be trusted.

It shares the Model with the routes of `simulate`, and nothing else: no modes, no guards, no rules
of what sticks, slips or lets go, no control of steps.

Sources: those of `wormopt.simulation.moreau`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError, interruptible
from wormopt.model.model import Contact, Model, pack
from wormopt.model.planar_friction import Elliptic, PlanarLaw
from wormopt.model.values import nominal_of
from wormopt.progress import Report, silent
from wormopt.simulation.held import hold
from wormopt.simulation.initial_value import InitialValueProblem
from wormopt.simulation.moreau import friction, largest
from wormopt.simulation.native.build import repeated
from wormopt.simulation.options import Tolerance
from wormopt.simulation.trajectory import Trajectory

# Steps per stride; the first number of strides is at least so large.
_STRIDE, _FIRST = 64, 32
# Speeds below this share of the change that a step could make are rounding.
_AT_REST = 1e-10
# Sweeps over coupled contacts; after each so many, they end if nothing changes.
_SWEEPS = (4, 8, 16, 32)
# Ends are extrapolated if their changes decrease as powers of two, within this factor; then this
# share of the last change is the uncertainty, since extrapolations may agree by chance.
_LIKE_TWO, _CHANCE = 0.3, 0.1


@dataclass(frozen=True, eq=False)
class Ending:
    """End of a motion, with its uncertainty."""

    end: np.ndarray  # (n_x,) extrapolated
    doubt: float  # about the largest error, over the states' size
    n_steps: int  # of the last, finest run


def ending(
    motion: Trajectory,
    x0: np.ndarray,
    accepted: float,
    most_steps: int = 4_000_000,
    report: Report = silent,
) -> Ending:
    """Integrate a motion again from `x0` (n_x,) to its end.

    Steps are halved until the doubt, a share of the size of each state, is `accepted`, or the
    finest run would have more than `most_steps`.
    """
    if motion.system.exact and motion.system.prescribed:
        raise ArgumentError(
            f"{motion.system.model.name}: steps without events do not support driven contacts"
        )
    task = _task(motion, x0)
    march = _march(task, len(x0))
    sizes, x0 = nominal_of(motion.system.model.x), task.x0[: task.system.model.n_x]
    (last, _), change, before, fineness = march(x0, 1), math.inf, None, 2
    while True:
        report("rechecking", None)
        found, count = march(x0, fineness)
        change, earlier = _distance(found, last, sizes), change
        best, doubt = found, 2 * max(change, _CHANCE * earlier)
        falls = earlier / change if 0 < change < math.inf else 0.0
        if falls > 0 and abs(math.log2(falls) - 2) < _LIKE_TWO:
            best = found + (found - last) / 3
            if before is not None:
                doubt = max(_distance(best, before, sizes), _CHANCE * change)
            before = best
        if doubt <= accepted or 2 * count > most_steps:
            return Ending(best, doubt, count)
        last, fineness = found, 2 * fineness


def _distance(a: np.ndarray, b: np.ndarray, sizes: np.ndarray) -> float:
    """Largest difference over the states' size; infinite if steps were too long to be stable."""
    if not np.all(np.isfinite([a, b])):
        return math.inf
    return float(np.max(np.abs(a - b) / np.maximum(sizes, np.abs(a))))


def _task(motion: Trajectory, x0: np.ndarray) -> InitialValueProblem:
    """The motion's task, with conditions held between the instants at which they change."""
    _refuse(motion.system.model)
    task = InitialValueProblem(
        system=motion.system,
        span=(float(motion.time[0]), motion.end_time),
        x0=np.append(x0, np.zeros(motion.system.n_pushes)),
        p=motion.p,
        schedules=motion.schedules,
        tolerance=Tolerance(),
        times=np.zeros(0),
    )
    held = hold(task, switches=True)
    return held.task if held else task


def _march(
    task: InitialValueProblem, n: int
) -> Callable[[np.ndarray, int], tuple[np.ndarray, int]]:
    """Function of the start and the fineness of steps: the first n states at the end, and steps."""
    model, (start, end) = task.system.model, task.span
    stride = _stride(model)
    fixed = task.p[: sum(s.size for s in (*model.p, *model.u))]
    breaks = [schedule.breaks_between(start, end) for schedule in task.schedules]
    ends = np.unique(np.concatenate([[start, end], *breaks]))
    ends = ends[np.diff(ends, prepend=-np.inf) > 1e-13 * max(abs(end), end - start)]

    def march(x0: np.ndarray, fineness: int) -> tuple[np.ndarray, int]:
        state, count = ca.DM(np.concatenate([x0, np.zeros(model.forces.numel()), [start]])), 0
        for a, b in pairwise(ends.tolist()):
            # each piece has twice the steps at twice the fineness, so that changes show the error
            strides = fineness * math.ceil(_FIRST / 2 * (b - a) / (end - start))
            begun = [schedule.locate(np.array([(a + b) / 2])) for schedule in task.schedules]
            scheduled = [
                np.append(begin[0], schedule.values[piece[0]])
                for schedule, (begin, piece) in zip(task.schedules, begun, strict=True)
            ]
            h = (b - a) / (strides * _STRIDE)
            given = ca.DM(np.concatenate([fixed, *scheduled, [h]]))
            with interruptible():
                for _ in range(strides):
                    state = stride(state, given)
            state[-1] = b
            count += strides * _STRIDE
        return np.array(state[:n]).ravel(), count

    return march


@lru_cache(maxsize=16)
def _stride(model: Model) -> ca.Function:
    """Many steps of one size: of state, contact forces and time; then all inputs, and h."""
    x, n_x, forces = pack(model.x), model.n_x, model.forces
    given = [pack(model.p), pack(model.u)]
    given += [ca.vertcat(s.begin, s.symbol) for s in model.schedules]
    h: ca.SX = ca.SX.sym("h")

    def at(expression: ca.SX, t: ca.SX, state: ca.SX, force: ca.SX) -> ca.SX:
        return ca.substitute([expression], [model.t, x, forces], [t, state, force])[0]

    none, t = ca.SX.zeros(forces.numel()), model.t
    velocity = ca.vertcat(ca.SX(0, 1), *(c.velocity for c in model.contacts))
    middle, half = x + h / 2 * model.ode, t + h / 2
    loose = x + h * at(model.ode, half, middle, none)
    pushes = at(ca.jacobian(model.ode, forces), half, middle, none)
    response = at(ca.jacobian(velocity, x), half, middle, none) @ pushes
    free = at(velocity, t + h, loose, none)
    speeds = velocity, at(velocity, half, middle, none), free
    rates = ca.jacobian(velocity, x) @ model.ode + ca.jacobian(velocity, t)
    state, given = ca.vertcat(x, forces, t), ca.vertcat(*given, h)

    def end(force: ca.SX) -> ca.SX:
        after = loose + h * pushes @ force
        for switch in model.switches:
            later = at(switch.guard, t + h, after, none)
            share = _ratio(switch.guard, switch.guard - later)  # of the step, to where it switches
            reset = at(switch.reset, t + share * h, x + share * (after - x), none)
            rest = (1 - share) * h * at(model.ode, t + share * h, reset, force)
            after = ca.if_else(ca.logic_and(switch.guard < 0, later >= 0), reset + rest, after)
        return ca.vertcat(after, force, t + h)

    read, tidy = [response, *speeds, rates], {"cse": True}
    if response.sparsity().nnz() == forces.numel():  # no contact acts on another one
        force = _sweep(model.contacts, none, forces, read, h)
        step = ca.Function("step", [state, given], [end(force)], tidy)
    else:
        prepare = ca.Function("prepare", [state, given], read, tidy)
        symbols = [ca.SX.sym("read", part.sparsity()) for part in read]
        force: ca.SX = ca.SX.sym("force", forces.numel())
        swept = _sweep(model.contacts, force, forces, symbols, h)
        sweep = ca.Function("sweep", [force, *symbols, state, given], [swept], tidy)
        finish = ca.Function("finish", [force, state, given], [end(force)], tidy)
        own = [ca.MX.sym("state", state.numel()), ca.MX.sym("given", given.numel())]
        begun = ca.MX.zeros(forces.numel())
        found = _settled(sweep)(begun, *prepare.call(own), *own)
        step = ca.Function("step", own, [finish(found, *own)])
    assert step.size1_out(0) == n_x + forces.numel() + 1
    return repeated(step, _STRIDE)


def _settled(sweep: ca.Function) -> ca.Function:
    """Forces after `_SWEEPS` sweeps, or after fewer if the next ones would change nothing."""
    symbols = sweep.mx_in()
    settled = same = ca.Function("same", symbols, [symbols[0]])
    for count in reversed(_SWEEPS):
        found = last = symbols[0]
        for _ in range(count):
            last, found = found, sweep(found, *symbols[1:])
        changes = ca.sum1(found != last) > 0
        further = ca.Function.if_else("further", settled, same)
        settled = ca.Function("settled", symbols, [further(changes, found, *symbols[1:])])
    return settled


def _sweep(
    contacts: Sequence[Contact], start: ca.SX, begin: ca.SX, read: Sequence[ca.SX], h: ca.SX
) -> ca.SX:
    """Mean forces over a step after one sweep over the contacts, from those of the sweep before."""
    # `begin`: mean forces over the step before. `read`: response of velocities to impulses;
    # velocities before the step, about its middle, and after it if there were no forces; their
    # rates by the forces of the step before.
    (response, before, middle, free, rates), force = read, ca.SX(start)
    first = 0
    for contact in contacts:
        rows = slice(first, first + contact.force.numel())
        own = largest(response[rows, rows])
        left = free[rows] + h * (response[rows, :] @ force - own * force[rows])
        hold = -left / (h * own)
        rest = (left - before[rows]) / (h * own)  # force needed to rest for the rest of the step
        force[rows] = _mean(contact.law, hold, -rest, begin[rows] - rates[rows] / own, middle[rows])
        first = rows.stop
    return force


def _mean(law: Any, hold: ca.SX, still: ca.SX, begin: ca.SX, middle: ca.SX) -> ca.SX:
    """Mean force of a law over a step that `hold` would end at rest, and `still` spend at rest."""
    # A sliding contact slides for the share of the step in which it comes to rest, or for all of
    # it; then it rests or slides as one at rest does. A resting contact holds until its force,
    # initially `begin`, reaches its limit.
    found = friction(law, hold, middle)
    if isinstance(law, PlanarLaw):
        return found
    moves = ca.fabs(hold - still) > _AT_REST * ca.fabs(still)
    for sign, limit in zip((1, -1), law.stick_interval, strict=True):
        if sign not in law.directions:
            continue
        slides = law.slip_force(middle, sign)
        share = _ratio(hold - still, slides - still)
        after = friction(law, still, ca.SX(0))
        stops = ca.if_else(sign * (hold - slides) > 0, share * slides + (1 - share) * after, slides)
        found = ca.if_else(ca.logic_and(moves, sign * (still - hold) > 0), stops, found)
        held = ca.if_else(sign * (begin - limit) > 0, _ratio(limit - begin, 2 * (still - begin)), 0)
        lets = held * (begin + limit) / 2 + (1 - held) * slides
        goes = ca.logic_and(ca.logic_not(moves), sign * (2 * still - begin - limit) < 0)
        found = ca.if_else(goes, lets, found)
    return found


def _ratio(part: ca.SX, whole: ca.SX) -> ca.SX:
    """Ratio that is a number in branches not taken, too."""
    return part / (whole + (whole == 0))


def _refuse(model: Model) -> None:
    """Refuse models that steps without events cannot follow."""
    laws = [contact.law for contact in model.contacts]
    why = (
        "walls" if any(c.gap is not None for c in model.contacts)
        else "delays" if model.delays
        else "algebraic variables" if model.z
        else "switches that end the motion" if any(s.terminal for s in model.switches)
        else "the law AnisotropicCoulomb"
        if any(isinstance(law, PlanarLaw) and not isinstance(law, Elliptic) for law in laws)
        else ""
    )  # fmt: skip
    if why:
        raise ArgumentError(f"{model.name}: steps without events do not support {why}")
