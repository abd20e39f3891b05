"""A worm whose coils are on or off: its arcs in closed form, and the best times to switch.

In a coil each segment relaxes to a length of its own, l' = (target - l) / tau. On an arc between
two switches all lengths are therefore exponentials, and so is their return after a period. On drag
the displacement is an integral, for which Gauss' rule on each arc is exact to round-off. A
`Ground`, drag or anchors in a tube, determines how lengths and rates move the worm. Collocation of
phases with free durations is a second route to the times.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError
from wormopt.model.modes import ModeSequence
from wormopt.ocp.contact import FixedModes
from wormopt.ocp.mesh import Mesh
from wormopt.ocp.motion import Guess
from wormopt.ocp.nlp import Bounds, Ipopt, NonlinearProgram
from wormopt.ocp.optimise import Optimum, optimise, refine
from wormopt.ocp.problem import Constraint, Ends, Problem
from wormopt.progress import Report, silent
from wormopt.systems.peristaltic.drag import centres
from wormopt.systems.peristaltic.switched import Limits, Objective, SwitchedWorm

_POINTS = 16
# Multiple of the longest time constant over which points are even in the remaining change.
_SLOWER = 2.0
_SOLVER = Ipopt(tolerance=1e-12, iterations=150, mu_init=1e-2)
_VIOLATED, _PENALTY = 1e-8, 100.0
# Share of the period below which an arc counts as empty.
_NOTHING = 1e-7

OFF, ON, ANCHORED = 0, 1, 2
"""States of a segment: coil off; coil on; coil on with rest on the wall."""


@dataclass(frozen=True, eq=False)
class Switched:
    """A periodic motion by arcs."""

    order: np.ndarray  # (arcs, N) states of the segments: OFF, ON or ANCHORED
    durations: np.ndarray  # (arcs,)
    start: np.ndarray  # (N,) lengths at the start of the first arc
    displacement: float  # per period
    worth: float  # value of the objective

    @property
    def period(self) -> float:
        """Duration of the period."""
        return float(self.durations.sum())

    @property
    def coils(self) -> np.ndarray:
        """Which coils are on, (arcs, N)."""
        return (self.order != OFF).astype(int)

    @property
    def lasting(self) -> tuple[np.ndarray, np.ndarray]:
        """States and durations of the arcs, joined where nothing is switched."""
        order: list[np.ndarray] = []
        durations: list[float] = []
        for state, d in zip(self.order, self.durations, strict=True):
            if d <= _NOTHING * self.period:
                continue
            if order and np.array_equal(order[-1], state):
                durations[-1] += d
            else:
                order.append(state)
                durations.append(float(d))
        return np.array(order), np.array(durations)


class SwitchingProgram:
    """Best durations of arcs for any order of switching, built once.

    Each coil goes on once and off once per period.
    """

    def __init__(self, worm: SwitchedWorm, arcs: int, objective: Objective) -> None:
        self._arcs, self._worm, self._objective = arcs, worm, objective
        n = worm.segments
        d, coils = ca.SX.sym("duration", arcs), ca.SX.sym("coil", n, arcs)
        rest = ca.SX.sym("anchored", n, arcs)
        start, shortest, displacement = _course(worm, d, coils, rest)
        period, on = ca.sum1(d), ca.mtimes(coils, d)
        worth = displacement / (period if objective.maximise else ca.sum1(on))
        times = ca.vertcat(period, on, period - on) / worm.time
        rows = ca.vertcat(times, on / period, displacement / period / worm.speed)
        if worm.ground.contact is not None:
            rows = ca.vertcat(
                rows, (shortest - worm.ground.contact) / (worm.length_off - worm.length_on)
            )
        given = [d, ca.veccat(coils, rest)]
        self._course = ca.Function("course", given, [start, displacement, worth, rows])
        w, p = ca.MX.sym("w", arcs), ca.MX.sym("p", 2 * n * arcs)
        _, _, best, bounded = self._course(w * worm.time, p)
        self._nlp = NonlinearProgram(w, p, -best / worm.speed, bounded)

    def at(self, order: np.ndarray, durations: np.ndarray) -> Switched:
        """Return the motion with an order (arcs, N) and durations (arcs,) of arcs."""
        start, displacement, worth, _ = self._course(self._filled(durations), self._given(order))
        return Switched(
            order, durations, np.asarray(start).ravel(), float(displacement), float(worth)
        )

    def allowed(self, order: np.ndarray, limits: Limits) -> np.ndarray:
        """Return which arcs of an order may last, (arcs,)."""
        few = (order != OFF).sum(axis=1) <= (limits.together or self._worm.segments)
        return few & self._worm.ground.holds((order == ANCHORED).astype(int))

    def best(self, order: np.ndarray, first: np.ndarray, limits: Limits) -> Switched | None:
        """Return the best durations of an order (arcs, N) from `first` (arcs,), or None.

        A duration may become 0: coils are then switched at the same time.
        """
        bounds = self._bounds(order, limits)
        w0 = np.minimum(self._filled(first / self._worm.time), bounds.ubw)
        if not (order[self.allowed(order, limits)] != OFF).any(axis=0).all():
            return None  # some coil would never be on
        solution = self._nlp.solve(w0, bounds, _SOLVER)
        if not solution.success or solution.violation > _VIOLATED:
            return None
        return self.at(order, solution.w[: len(order)] * self._worm.time)

    def promise(self, order: np.ndarray, durations: np.ndarray, limits: Limits) -> float:
        """Return the value of given durations, less their violations, over the usual speed."""
        bounds = self._bounds(order, limits)
        first = self._nlp.start(self._filled(durations / self._worm.time), bounds)
        return -first.objective - _PENALTY * first.violation

    def _bounds(self, order: np.ndarray, limits: Limits) -> Bounds:
        n, unit = self._worm.segments, self._worm.time
        least, most = np.array(limits.period) / unit
        slowest = self._objective.speed
        slowest = -np.inf if slowest is None else slowest / self._worm.speed
        lower = [[least], np.full(2 * n, limits.dwell / unit), np.zeros(n), [slowest]]
        upper = [np.full(2 * n + 1, most), np.full(n, limits.duty), [np.inf]]
        if self._worm.ground.contact is not None:
            lower.append(np.zeros(n))
            upper.append(np.where((order == ANCHORED).any(axis=0), 0.0, np.inf))
        return Bounds(
            np.zeros(self._arcs),
            self._filled(np.where(self.allowed(order, limits), most, 0.0)),
            np.concatenate(lower),
            np.concatenate(upper),
            self._given(order),
        )

    def _filled(self, values: np.ndarray) -> np.ndarray:
        """Return values padded with zeros for arcs that an order does not have."""
        return np.concatenate([values, np.zeros(self._arcs - len(values))])

    def _given(self, order: np.ndarray) -> np.ndarray:
        """Return the parameters of an order: coils on, segments anchored."""
        states = order[np.minimum(np.arange(self._arcs), len(order) - 1)].ravel()
        return np.concatenate([states != OFF, states == ANCHORED]).astype(float)


def _course(worm: SwitchedWorm, d: ca.SX, coils: ca.SX, rest: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Return lengths (N, 1) that return after all arcs, those at switch-off, displacement."""
    n, arcs = coils.shape
    nodes, weights = np.polynomial.legendre.leggauss(_POINTS)
    slow = _SLOWER * max(worm.time_on, worm.tau_off)
    target = worm.length_off + (worm.length_on - worm.length_off) * coils
    pace = (1 - rest) / (worm.tau_off + (worm.time_on - worm.tau_off) * coils)
    offset, whole = ca.SX.zeros(n), ca.SX.zeros(n)
    for i in range(arcs):
        left = -d[i] * pace[:, i]
        gone = -ca.expm1(left)
        offset = (1 - gone) * offset + gone * target[:, i]
        whole += left
    start = offset / -ca.expm1(whole)
    lengths, shortest, displacement = start, ca.SX.zeros(n), ca.SX(0)
    for i in range(arcs):
        shortest += coils[:, i - 1] * (1 - coils[:, i]) * lengths
        begin, apart = lengths, lengths - target[:, i]
        lengths = target[:, i] + apart * ca.exp(-d[i] * pace[:, i])
        if worm.ground.contact is not None:  # velocity depends on rates alone
            displacement += worm.ground.velocity(begin, lengths - begin, rest[:, i])
            continue
        span = -ca.expm1(-d[i] / slow)
        for s, weight in zip((nodes + 1) / 2, weights / 2, strict=True):
            left = 1 - s * span
            now = apart * left ** (slow * pace[:, i])
            moving = worm.ground.velocity(target[:, i] + now, -now * pace[:, i], rest[:, i])
            displacement += weight * span * slow / left * moving
    return start, shortest, displacement


@dataclass(frozen=True)
class Walk:
    """Motion of a worm in a tube by its coils alone."""

    displacement: float  # in the given time
    slip: float  # sum of relative displacements of anchored segments
    loose: float  # time without any anchor, in which the last anchor is kept


def walk(worm: SwitchedWorm, coils: np.ndarray, durations: np.ndarray, lengths: np.ndarray) -> Walk:
    """Simulate a worm from its lengths (N,) by coils (arcs, N); contacts are found on the way."""
    contact = worm.ground.contact
    if contact is None:
        raise ArgumentError("only a worm in a tube walks from anchor to anchor; give a Tube")
    displacement = slip = loose = 0.0
    places, held = centres(worm.segments), np.zeros(worm.segments, dtype=bool)
    for on, duration in zip(coils != OFF, durations, strict=True):
        target, tau = (
            np.where(on, worm.length_on, worm.length_off),
            np.where(on, worm.time_on, worm.tau_off),
        )
        left = float(duration)
        while left > 0:
            rest = on & (lengths <= contact)
            ratio = np.maximum((lengths - worm.length_on) / (contact - worm.length_on), 1.0)
            until = np.where(on & ~rest, worm.time_on * np.log(ratio), np.inf)
            step = min(left, float(until.min()))
            after = np.where(rest, lengths, target + (lengths - target) * np.exp(-step / tau))
            after[until <= step] = contact
            moved = places @ (after - lengths)
            loose += 0.0 if rest.any() else step
            held = rest if rest.any() else held
            if held.any():
                displacement -= float(moved[held].mean())
                slip += float(np.ptp(moved[held]))
            lengths, left = after, left - step
    return Walk(displacement, slip, loose)


# it begins at an optimum
_POLISHER = Ipopt(tolerance=1e-12, mu_init=1e-9, warm=True)
_ROUNDS = 4


def switching_problem(
    worm: SwitchedWorm, objective: Objective, limits: Limits, holding: np.ndarray
) -> Problem:
    """Return the problem: largest displacement per time, or per time that coils are on."""
    model = worm.model
    n, contact = worm.segments, worm.ground.contact
    ends = Ends.of(model, n + len(holding))
    displacement, on = ends.end[-1] - ends.start[-1], ends.integrals[:n]
    integrands = model["coil"]
    size = model.x[0].nominal
    bounds = [
        Constraint("start", ends.start[-1], 0.0, 0.0, size),
        Constraint("limits.duty", on / ends.duration, upper=limits.duty),
        Constraint("limits.dwell", on, limits.dwell, nominal=worm.time),
        Constraint("limits.dwell", ends.duration - on, limits.dwell, nominal=worm.time),
    ]
    if (slowest := objective.speed) is not None:
        bounds.append(
            Constraint("objective.speed", displacement / ends.duration, slowest, nominal=slowest)
        )
    if contact is not None:
        # the length is constant at the wall, so its mean there gives it in one equation
        above = (model["anchored"] * (model["length"] - contact))[holding.tolist()]
        integrands = ca.vertcat(integrands, above)
        area = size * worm.time
        bounds.append(Constraint("ground.contact", ends.integrals[n:], 0.0, 0.0, area))
    return Problem(
        model,
        ends,
        -displacement / (ends.duration if objective.maximise else ca.sum1(on)) / worm.speed,
        limits.period_range,
        periodic=["length"],
        integrands=integrands,
        boundary_constraints=bounds,
    )


def polish(
    worm: SwitchedWorm,
    objective: Objective,
    limits: Limits,
    found: Switched,
    mesh: Mesh,
    tolerance: float,
    report: Report = silent,
) -> Optimum:
    """Optimise the times of an order again, from those found; `mesh` is that of one phase."""
    order, durations = found.lasting
    given = _inputs(worm, order)
    active = tuple(tuple((2 * state - 1).tolist()) for state in given)
    phases = Mesh.even(len(order), mesh.total, mesh.collocation)
    best = optimise(
        switching_problem(worm, objective, limits, np.flatnonzero((order == ANCHORED).any(axis=0))),
        phases,
        FixedModes(ModeSequence(((),) * len(order)), active),
        guess_of(worm, order, durations, found.start),
        solver=_POLISHER,
        report=report,
    )
    return refine(best, tolerance, rounds=_ROUNDS, solver=_POLISHER, report=report)


def guess_of(
    worm: SwitchedWorm, order: np.ndarray, durations: np.ndarray, start: np.ndarray
) -> Guess:
    """Return the lengths of a switched motion over its arcs, without its displacement."""
    breaks = np.concatenate([[0.0], np.cumsum(durations)])
    targets = np.where(order != OFF, worm.length_on, worm.length_off)
    taus = np.where(order != OFF, worm.time_on, worm.tau_off)
    taus = np.where(order == ANCHORED, np.inf, taus)
    inputs = _inputs(worm, order)
    begins = [start]
    for target, tau, d in zip(targets, taus, durations, strict=True):
        begins.append(target + (begins[-1] - target) * np.exp(-d / tau))

    def arc_of(t: np.ndarray) -> np.ndarray:
        return np.clip(np.searchsorted(breaks, t, side="right") - 1, 0, len(durations) - 1)

    def states(t: np.ndarray) -> np.ndarray:
        k = arc_of(t)
        fade = np.exp(-(t - breaks[k])[:, None] / taus[k])
        lengths = targets[k] + (np.array(begins)[k] - targets[k]) * fade
        return np.vstack([lengths.T, 0 * t])

    return Guess(
        float(breaks[-1]), states, lambda t: inputs[arc_of(t)].T.astype(float), phases=durations
    )


def _inputs(worm: SwitchedWorm, order: np.ndarray) -> np.ndarray:
    """Return inputs of the Model, arc by arc: coils on, and anchored segments in a tube."""
    coils, anchored = (order != OFF).astype(int), (order == ANCHORED).astype(int)
    return coils if worm.ground.contact is None else np.hstack([coils, anchored])
