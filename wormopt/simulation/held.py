"""Tasks with conditions held between the instants at which they change, and back.

Bounds of the functions of time over cells show where nothing changes; other cells are halved.
Samples alone would miss what a step misses.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import NamedTuple

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError, SolveError
from wormopt.model.model import Model, pack
from wormopt.model.schedule import Schedule
from wormopt.numerics.expressions import Enclosure, instructions_of
from wormopt.simulation.conditions import Lifted, Timed, lifted, may_have
from wormopt.simulation.functions import System
from wormopt.simulation.initial_value import InitialValueProblem, Outcome
from wormopt.simulation.options import Treatment
from wormopt.simulation.variation import Directions

# Number of initial cells, and largest number of cells.
_CELLS, _MOST_CELLS, _SAMPLE = 64, 50_000, 8
# Least cell as a share of the span; negligible share of a function's size.
_SHORTEST, _QUIET = 1e-12, 1e-13
_HALVINGS = 60
# Share of a guard's parts that is rounding; relative error by underflow; number of bounds found at
# once.
_NOISE, _ZERO, _MOST_NUMBERS = 4e-15, 1e-300, 5_000_000
# Largest number of changes.
_MOST_CHANGES = 20_000
# A cell is fine enough if the function's curvature on it is below this share of its size.
_BEND = 0.25
# Stretches that steps miss consist of cells shorter than an eighth of a step, some much finer, and
# are shorter than two steps.
_FINE, _SHORT, _MUCH = 1 / 8, 2.0, 1 / 8
_LEVELS = 14


@dataclass(frozen=True, eq=False)
class _Cells:
    """Cells of time and the other inputs of functions on them."""

    low: np.ndarray  # (m,)
    high: np.ndarray  # (m,)
    given: np.ndarray  # (inputs, m)

    def those(self, chosen: np.ndarray) -> _Cells:
        """A subset."""
        return _Cells(self.low[chosen], self.high[chosen], self.given[:, chosen])

    @property
    def halves(self) -> _Cells:
        middle = (self.low + self.high) / 2
        low, high = np.stack([self.low, middle], 1), np.stack([middle, self.high], 1)
        return _Cells(low.ravel(), high.ravel(), np.repeat(self.given, 2, axis=1))

    @property
    def middles(self) -> _Cells:
        middle = (self.low + self.high) / 2
        return _Cells(middle, middle, self.given)

    def largest(self, enclosure: Enclosure) -> np.ndarray:
        """Upper bounds (functions, m)."""
        low, high = np.vstack([self.low, self.given]), np.vstack([self.high, self.given])
        return enclosure(low, high)[1]

    def bounds(self, enclosure: Enclosure) -> tuple[np.ndarray, np.ndarray]:
        """Bounds of values and of rates, each (2, functions, m)."""
        low, high = np.vstack([self.low, self.given]), np.vstack([self.high, self.given])
        values, rates = np.split(np.array(enclosure(low, high)), 2, axis=1)
        return values, rates


@dataclass(frozen=True, eq=False)
class _Functions:
    """A model's functions of time, cached."""

    timed: Timed

    def _enclosure(self, of: ca.SX) -> Enclosure:
        inputs = self.timed.inputs
        rates = ca.jacobian(of, inputs[0])
        return Enclosure(ca.Function("f", [inputs], [ca.densify(ca.vertcat(of, rates))]))

    @cached_property
    def guards(self) -> Enclosure:
        return self._enclosure(self.timed.guards)

    @cached_property
    def sizes(self) -> Enclosure:
        timed = self.timed
        return Enclosure(ca.Function("sizes", [timed.inputs], [ca.densify(timed.sizes)]))

    @cached_property
    def courses(self) -> Enclosure:
        return self._enclosure(self.timed.courses)

    @cached_property
    def values(self) -> ca.Function:
        return ca.Function("values", [self.timed.inputs], [ca.densify(self.timed.values)])

    def at(self, t: np.ndarray, given: np.ndarray) -> np.ndarray:
        """Values of conditions at times (m,), (conditions, m)."""
        return np.array(self.values(np.vstack([t, given])))


@lru_cache(maxsize=64)
def _functions(timed: Timed) -> _Functions:
    return _Functions(timed)


def scheduled(
    timed: Timed,
    held: Schedule,
    span: tuple[float, float],
    fixed: np.ndarray,
    schedules: tuple[Schedule, ...],
    longest: float,
) -> tuple[Schedule, bool]:
    """The schedule `held` with the instants of a motion and the values of conditions in between.

    Also returns whether all that is narrow has been found. `fixed`: values of parameters and
    inputs; `schedules`: the model's own; `longest`: longest step.
    """
    used = _used(timed)
    # members of an ensemble that differ elsewhere have the same instants
    given = np.where(used.fixed, fixed, 0.0)
    pieces = schedules if used.pieces else ()
    inner, complete = _instants(timed, span, longest, tuple(given.tolist()), _Pieces.of(pieces))
    ends = np.concatenate([span[:1], inner, span[1:]])
    middle = (ends[:-1] + ends[1:]) / 2
    values = _functions(timed).at(middle, _given(timed, given, pieces, middle)).T
    return replace(held, start=span[0], breaks=ends - span[0], values=values), complete


class _Used(NamedTuple):
    """Dependence of functions of time on other quantities than time."""

    fixed: np.ndarray  # (parameters and inputs,)
    pieces: bool  # on schedules
    by_pieces: bool  # so do conditions


@lru_cache(maxsize=64)
def _used(timed: Timed) -> _Used:
    pieces = timed.inputs[1 + timed.n_fixed :]
    all_ = ca.vertcat(timed.values, timed.guards, timed.courses)
    used = np.array(ca.which_depends(all_, timed.inputs, 1, False), dtype=bool)
    by_pieces = bool(pieces.numel()) and ca.depends_on(timed.values, pieces)
    return _Used(used[1 : 1 + timed.n_fixed], bool(np.any(used[1 + timed.n_fixed :])), by_pieces)


@dataclass(frozen=True)
class _Pieces:
    """Schedules that are compared by their numbers."""

    schedules: tuple[Schedule, ...] = field(compare=False)
    numbers: tuple[object, ...]

    @classmethod
    def of(cls, schedules: tuple[Schedule, ...]) -> _Pieces:
        """Those of a task, which has its own copies."""
        numbers = [(s.breaks.tobytes(), s.values.tobytes(), s.periodic, s.start) for s in schedules]
        return cls(schedules, tuple(numbers))


@lru_cache(maxsize=256)
def _instants(
    timed: Timed,
    span: tuple[float, float],
    longest: float,
    fixed: tuple[float, ...],
    pieces: _Pieces,
) -> tuple[np.ndarray, bool]:
    """Instants within a span at which steps must end, ascending, and whether these are all."""
    functions, schedules = _functions(timed), pieces.schedules
    breaks = np.concatenate([[], *(each.breaks_between(*span) for each in schedules)])
    ends = np.unique(np.concatenate([np.linspace(*span, _CELLS + 1), breaks]))
    middle = (ends[:-1] + ends[1:]) / 2
    given = _given(timed, np.array(fixed), schedules, middle)
    cells, found, complete = _Cells(ends[:-1], ends[1:], given), np.zeros(0), True
    if timed.guards.numel():
        found = _changes(functions, cells, span)
    if timed.courses.numel():
        narrow, complete = _narrow(functions, cells, span, longest)
        found = np.append(found, narrow)
    if _used(timed).by_pieces:
        found = np.append(found, breaks)
    found, least = np.unique(found), 4 * np.spacing(max(map(abs, span)))
    found = found[(span[0] + least < found) & (found < span[1] - least)]
    return found[np.diff(found, prepend=-np.inf) > least], complete


def _given(
    timed: Timed, fixed: np.ndarray, schedules: tuple[Schedule, ...], t: np.ndarray
) -> np.ndarray:
    """Inputs of the functions of time other than time itself, at times (m,)."""
    rows = [np.repeat(fixed[:, None], len(t), axis=1)]
    for schedule in schedules:
        begin, piece = schedule.locate(t)
        rows += [begin[None], schedule.values[piece].T]
    rows.append(np.zeros((timed.inputs.numel() - 1 - sum(map(len, rows)), len(t))))
    return np.vstack(rows)


def _changes(functions: _Functions, cells: _Cells, span: tuple[float, float]) -> np.ndarray:
    """Instants at which conditions change, each the first number after the change."""
    timed = functions.timed
    levels, nested, scale = timed.levels[:, None], timed.nested[:, None], np.zeros(1)
    least = _shortest(span)
    found, ignored = list[_Cells](), np.zeros((1, 1), dtype=bool)
    while cells.low.size:
        bounds, (slowest, fastest) = cells.bounds(functions.guards)
        largest = np.abs(bounds).max(axis=0)
        scale = np.maximum(scale, np.where(np.isfinite(largest), largest, 0).max(1, keepdims=True))
        # a kink may be so small that it does not matter; a jump matters unless it is rounding
        size = np.where(timed.jumps[:, None], levels, scale)
        noise = np.where(timed.jumps[:, None], _NOISE, _QUIET)
        nothing = np.maximum(noise * np.maximum(size, cells.largest(functions.sizes)), _ZERO)
        same = _same(*bounds, levels, nothing)
        # functions of other conditions may jump, unless these do not change
        open_ = ~same & timed.jumps[:, None]
        smooth = ~nested | (open_.sum(axis=0) - open_ <= 0)
        middle, half = cells.middles.bounds(functions.guards)[0], (cells.high - cells.low) / 2
        reach = half * np.maximum(np.abs(slowest), np.abs(fastest))
        low = np.where(smooth, np.fmax(bounds[0], middle[0] - reach), bounds[0])
        high = np.where(smooth, np.fmin(bounds[1], middle[1] + reach), bounds[1])
        same = _same(low, high, levels, nothing) | ignored
        once = smooth & ((slowest > 0) | (fastest < 0)) & (~levels | (high - low < 1))
        quiet = np.all(same, axis=0)
        done = ~quiet & (np.all(same | once, axis=0) | (cells.high - cells.low <= least))
        found.append(cells.those(done))
        cells = cells.those(~quiet & ~done).halves
        many = cells.low.size + sum(c.low.size for c in found)
        if many > _MOST_CHANGES and not (np.all(timed.jumps) or np.any(ignored)):
            ignored = ~timed.jumps[:, None]  # kinks may be omitted
        elif many > (2 if np.any(ignored) else 1) * _MOST_CHANGES:
            raise SolveError(
                "conditions on time change more than "
                f"{_MOST_CHANGES} times between t = {span[0]:g} and {span[1]:g}",
                "shorten the time, or replace fast changes by their mean",
                None,
                "too_many_steps",
            )
    low = np.concatenate([c.low for c in found])
    high = np.concatenate([c.high for c in found])
    given = np.hstack([c.given for c in found])
    before, after = functions.at(low, given), functions.at(high, given)
    which, where = np.nonzero(before != after)
    low, high, given = low[where], high[where], given[:, where]
    before, row = before[which, where], np.arange(len(which))
    for _ in range(_HALVINGS if row.size else 0):  # to the last bit
        middle = low + (high - low) / 2
        still = functions.at(middle, given)[which, row] == before
        low, high = np.where(still, middle, low), np.where(still, high, middle)
    return high


def _shortest(span: tuple[float, float]) -> float:
    """Width of a cell that is not halved."""
    return max(_SHORTEST * (span[1] - span[0]), 4 * np.spacing(max(map(abs, span))))


def _same(low: np.ndarray, high: np.ndarray, levels: np.ndarray, nothing: np.ndarray) -> np.ndarray:
    """Whether decisions of guards are the same over a cell; those below `nothing` decide none."""
    whole = (np.floor(low) == np.floor(high)) & (np.ceil(low) == np.ceil(high))
    level = np.round(low)
    whole |= np.maximum(np.abs(low - level), np.abs(high - level)) <= nothing
    apart = (low > 0) | (high < 0) | (np.maximum(np.abs(low), np.abs(high)) <= nothing)
    return np.where(levels, whole, apart)


def _narrow(
    functions: _Functions, cells: _Cells, span: tuple[float, float], longest: float
) -> tuple[np.ndarray, bool]:
    """Ends of the cells in which a function of time is so narrow that steps might miss it.

    Also returns whether there was room for all.
    """
    # a function without quiet parts, such as a sine, is not narrow
    whole, least = span[1] - span[0], _shortest(span)
    most = min(_MOST_CELLS, _MOST_NUMBERS // functions.timed.courses.numel())
    done, size, rests, sample = list[_Cells](), None, np.zeros(1, dtype=bool), None
    while cells.low.size:
        (low, high), (slowest, fastest) = cells.bounds(functions.courses)
        largest = np.maximum(np.abs(low), np.abs(high))
        known = np.where(np.isfinite(largest), largest, 0.0).max(axis=1, keepdims=True)
        size = known if size is None else np.maximum(size, known)
        width = cells.high - cells.low
        quiet = high - low <= _QUIET * size
        smooth = width * (fastest - slowest) <= _BEND * size
        rests = rests | quiet.any(axis=1)
        fine = np.all(quiet | smooth, axis=0) | (width <= least)
        done.append(cells.those(fine))
        cells = cells.those(~fine).halves
        many = cells.low.size + sum(c.low.size for c in done)
        if many > 2 * most:
            break
        if sample is None and many > most:
            # a few of them show whether the function is narrow there
            sample = np.linspace(0, cells.low.size - 1, _SAMPLE).astype(int)
            cells = cells.those(sample)
    if sample is not None:
        return np.zeros(0), not rests.any()
    low = np.concatenate([c.low for c in done])
    order = np.argsort(low)
    low, high = low[order], np.concatenate([c.high for c in done])[order]
    return _isolated(low, high, min(longest, whole)), functions.timed.complete


def _isolated(low: np.ndarray, high: np.ndarray, longest: float) -> np.ndarray:
    """Ends of fine cells between coarse ones."""
    width, found = high - low, list[np.ndarray]()
    for level in range(_LEVELS):
        step = longest / 4.0**level
        if not np.any(width < _MUCH * _FINE * step):
            break
        edges = np.flatnonzero(np.diff(np.concatenate([[0], width < _FINE * step, [0]])))
        for begin, end in edges.reshape(-1, 2):
            short = high[end - 1] - low[begin] < _SHORT * step
            if short and width[begin:end].min() < _MUCH * _FINE * step:
                found.append(np.append(low[begin:end], high[end - 1]))
    return np.concatenate([np.zeros(0), *found])


_MISSED = (
    "functions of time have too many narrow pulses to examine; some may have been missed: shorten "
    "the time, or write a smaller max_step"
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
                f"the right-hand side of {model.name} jumps at times that depend on parameters; "
                'this route has no derivatives of them: write route = "native" or "python"'
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
        equations=None,
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
    return may_have(system.model, np.concatenate([instructions_of(each)[0] for each in functions]))


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
    by_schedules = any(np.any(values != 0) for values in along.schedules)
    if by_schedules:
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
