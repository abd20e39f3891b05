"""The smooth slide by wormopt and by others: each builds its program once and solves it often.

All take equal phases, states by Radau collocation and one value of the drive per arc, start from
the same guess and give IPOPT the same options.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from importlib import import_module
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np

from wormopt.model.friction import Coulomb
from wormopt.numerics.collocation import Collocation
from wormopt.ocp.contact import Smoothed
from wormopt.ocp.mesh import Mesh
from wormopt.ocp.motion import Guess, sample
from wormopt.ocp.nlp import Ipopt
from wormopt.ocp.optimise import optimise, refine
from wormopt.ocp.problem import Bound, Ends, Problem
from wormopt.ocp.transcription import Transcription
from wormopt.systems.block.block import block

EXACT = 1.2221708186
"""Shortest time by the law -(1.5 tanh(40 v) - 0.5)."""

_V_REG, _FORCE, _LATEST = 1 / 40, 3.0, 10.0
# First guess: how long, and a velocity that does not belong to its course.
_FIRST, _SPEED = 1.5, 0.6


@dataclass(frozen=True)
class Grid:
    """The discretisation that all toolkits share."""

    name: str
    shares: tuple[tuple[float, ...], ...]  # per phase of free duration, the part of each arc
    held: tuple[int, ...]  # per phase: +1 or -1 drive held at that limit, 0 free
    degree: int = 3  # of the state polynomials

    @property
    def mesh(self) -> Mesh:
        """The same for wormopt."""
        counts = tuple(map(len, self.shares))
        flat = tuple(share for phase in self.shares for share in phase)
        return Mesh(len(counts), counts, Collocation(self.degree, "radau"), shares=flat)

    @property
    def places(self) -> np.ndarray:
        """Where arcs begin in the first guess, and its end, as parts of it."""
        return np.append(0, np.cumsum(np.concatenate(self.shares))) / len(self.shares)


def even(arcs: int) -> Grid:
    """Equal arcs in one phase: the switch of the drive falls somewhere within an arc."""
    return Grid(f"{arcs} equal arcs", ((1 / arcs,) * arcs,), (0,))


def graded(tolerance: float) -> Grid:
    """Two phases, one to either side of the switch, refined until no arc errs by more.

    `tolerance`: local error of an arc.
    """
    law = Smoothed(_V_REG, _V_REG, active=((1,), (-1,)))
    mesh = Mesh.even(2, 10, Collocation(3, "radau"))
    found = refine(optimise(_problem(), mesh, law, _guess()), tolerance, rounds=8).motion.mesh
    edges, shares = np.cumsum([0, *found.counts]), found.shares or ()
    halves = tuple(shares[a:b] for a, b in pairwise(edges))
    return Grid(f"{found.total} graded arcs", halves, (1, -1))


@dataclass(frozen=True)
class Answer:
    """One solve."""

    time: float  # shortest time found
    iterations: int  # of the solver
    functions_s: dict[str, float] = field(default_factory=dict)  # s, in the program's functions


Solve = Callable[[], Answer]
"""Solves a program that is built, from the first guess."""


def _problem() -> Problem:
    model = block(Coulomb(1.0, 2.0), force=_FORCE)
    ends = Ends.of(model)
    at_ends = [
        Bound("start", ends.start, [0.0, 0.0], [0.0, 0.0]),
        Bound("end", ends.end, [1.0, 0.0], [1.0, 0.0]),
    ]
    return Problem(model, ends, ends.duration, (0.01, _LATEST), at_ends=at_ends)


def _guess() -> Guess:
    return Guess(_FIRST, lambda t: np.vstack([t / _FIRST, 0 * t + _SPEED]))


def _answer(stats: dict[str, Any], time: float) -> Answer:
    if not stats["success"]:
        raise RuntimeError(str(stats["return_status"]))
    functions = {
        key.removeprefix("t_wall_"): float(value)
        for key, value in stats.items()
        if key.startswith("t_wall_nlp_")
    }
    return Answer(time, int(stats["iter_count"]), functions)


def wormopt(grid: Grid) -> Solve:
    """Build the program by the general transcription of a Problem."""
    program = Transcription(_problem(), grid.mesh, Smoothed(_V_REG, _V_REG))
    bounds = program.bounds(_V_REG, active=[(held,) for held in grid.held])
    start = sample(program, _guess(), bounds)
    program.nlp.prepare(Ipopt())

    def solve() -> Answer:
        found = program.nlp.solve(start, bounds, Ipopt())
        if not found.success:
            raise RuntimeError(found.status)
        return Answer(found.objective, found.iterations, dict(found.functions_s))

    return solve


def _acceleration(v: Any, u: Any) -> Any:
    return u - (1.5 * ca.tanh(v / _V_REG) - 0.5)


def by_hand(grid: Grid) -> Solve:
    """Build it by a script in CasADi's scalar expressions, made for this problem alone."""
    d, phases = grid.degree, len(grid.shares)
    tau = ca.collocation_points(d, "radau")
    slopes = np.array(ca.collocation_coeff(tau)[0])
    durations, state = ca.SX.sym("T", phases), ca.SX.sym("x0", 2)
    w, w0 = [durations, state], [_FIRST / phases] * phases + [0.0, _SPEED]
    low, high, g = [0.0] * (phases + 2), [_LATEST] * phases + [0.0, 0.0], []
    places, arcs = grid.places, [(q, s) for q, phase in enumerate(grid.shares) for s in phase]
    for k, (phase, share) in enumerate(arcs):
        u, held = ca.SX.sym("u"), grid.held[phase]
        w, w0 = [*w, u], [*w0, 0.0]
        low, high = (
            [*low, _FORCE if held > 0 else -_FORCE],
            [*high, -_FORCE if held < 0 else _FORCE],
        )
        points = [state, *(ca.SX.sym(f"x{k}_{j}", 2) for j in range(d))]
        for j, point in enumerate(points[1:]):
            w = [*w, point]
            w0 = [*w0, places[k] + tau[j] * (places[k + 1] - places[k]), _SPEED]
            low, high = [*low, -np.inf, -np.inf], [*high, np.inf, np.inf]
            slope = sum(slopes[i, j] * points[i] for i in range(d + 1))
            rates = ca.vertcat(point[1], _acceleration(point[1], u))
            g.append(slope - durations[phase] * share * rates)
        state = points[-1]
    low[-2:], high[-2:] = [1.0, 0.0], [1.0, 0.0]
    nlp = {"x": ca.vertcat(*w), "f": ca.sum1(durations), "g": ca.vertcat(*g)}
    options = {k: v for k, v in Ipopt().as_casadi().items() if k != "expand"}
    solver = ca.nlpsol("solver", "ipopt", nlp, options)

    def solve() -> Answer:
        found = solver(x0=w0, lbx=low, ubx=high, lbg=0, ubg=0)
        return _answer(solver.stats(), float(found["f"]))

    return solve


def opti(grid: Grid) -> Solve:
    """Build it with CasADi's Opti."""
    d, phases = grid.degree, len(grid.shares)
    tau = np.array(ca.collocation_points(d, "radau"))
    slopes = ca.collocation_coeff(tau.tolist())[0]
    stack, places = ca.Opti(), grid.places
    durations, state = stack.variable(phases), stack.variable(2)
    stack.minimize(ca.sum1(durations))
    stack.subject_to(stack.bounded(0, durations, _LATEST))
    stack.set_initial(durations, _FIRST / phases)
    stack.subject_to(state == 0)
    stack.set_initial(state, [0.0, _SPEED])
    arcs = [(q, s) for q, phase in enumerate(grid.shares) for s in phase]
    for k, (phase, share) in enumerate(arcs):
        u, points, held = stack.variable(), stack.variable(2, d), grid.held[phase]
        limits = stack.bounded(-_FORCE, u, _FORCE) if held == 0 else u == held * _FORCE
        stack.subject_to(limits)
        rates = ca.vertcat(points[1, :], _acceleration(points[1, :], u))
        slope = ca.mtimes(ca.horzcat(state, points), slopes)
        stack.subject_to(ca.vec(slope - durations[phase] * share * rates) == 0)
        stack.set_initial(
            points,
            np.vstack([places[k] + tau * (places[k + 1] - places[k]), np.full(d, _SPEED)]),
        )
        state = points[:, d - 1]
    stack.subject_to(state == ca.DM([1, 0]))
    options = Ipopt().as_casadi()
    inner = {k.removeprefix("ipopt."): v for k, v in options.items() if k.startswith("ipopt.")}
    outer = {k: v for k, v in options.items() if not k.startswith("ipopt.")}
    stack.solver("ipopt", outer, inner)
    first = stack.value(stack.x, stack.initial())
    solver = stack.to_function("solver", [stack.x], [stack.f])

    def solve() -> Answer:
        found = float(solver(first))
        return _answer(_inner(solver.stats()), found)

    return solve


def _inner(stats: dict[str, Any]) -> dict[str, Any]:
    """Statistics of the solver within a function."""
    while "return_status" not in stats:
        stats = next(value for value in stats.values() if isinstance(value, dict))
    return stats


def rockit(grid: Grid) -> Solve:
    """Build it with rockit, on equal arcs only."""
    peer: Any = import_module("rockit")
    if len(grid.held) > 1:
        raise NotImplementedError("equal arcs only")
    ocp = peer.Ocp(T=peer.FreeTime(_FIRST))
    x, v, u = ocp.state(), ocp.state(), ocp.control(order=0)
    ocp.set_der(x, v)
    ocp.set_der(v, _acceleration(v, u))
    ocp.subject_to(u <= _FORCE)
    ocp.subject_to(u >= -_FORCE)
    for at, place in ((ocp.at_t0, 0), (ocp.at_tf, 1)):
        ocp.subject_to(at(x) == place)
        ocp.subject_to(at(v) == 0)
    ocp.set_initial(x, ocp.t / _FIRST)
    ocp.set_initial(v, _SPEED)
    ocp.add_objective(ocp.T)
    arcs = len(grid.shares[0])
    ocp.method(peer.DirectCollocation(N=arcs, M=1, degree=grid.degree, scheme="radau"))
    ocp.solver("ipopt", Ipopt().as_casadi())
    ocp._transcribe()  # noqa: SLF001  else the first solve does

    def solve() -> Answer:
        found = ocp.solve()
        return _answer(dict(found.stats), float(found.value(ocp.T)))

    return solve


def yapss(grid: Grid) -> Solve:
    """Build it with yapss, on equal arcs only; derivatives are found anew in every solve."""
    peer: Any = import_module("yapss")
    if len(grid.held) > 1:
        raise NotImplementedError("equal arcs only")
    arcs = len(grid.shares[0])
    ocp = peer.Problem(name="slide", nx=[2], nu=[1])

    def rates(arg: Any) -> None:
        x, u = arg.phase[0].state, arg.phase[0].control
        arg.phase[0].dynamics[:] = x[1], u[0] - (1.5 * peer.math.tanh(x[1] / _V_REG) - 0.5)

    def time(arg: Any) -> None:
        arg.objective = arg.phase[0].final_time

    ocp.functions.continuous, ocp.functions.objective = rates, time
    bounds, guess = ocp.bounds.phase[0], ocp.guess.phase[0]
    bounds.initial_time.lower = bounds.initial_time.upper = 0.0
    bounds.final_time.lower, bounds.final_time.upper = 0.01, _LATEST
    bounds.initial_state.lower[:] = bounds.initial_state.upper[:] = 0.0, 0.0
    bounds.final_state.lower[:] = bounds.final_state.upper[:] = 1.0, 0.0
    bounds.control.lower[:], bounds.control.upper[:] = [-_FORCE], [_FORCE]
    guess.time, guess.control = [0.0, _FIRST], [[0.0, 0.0]]
    guess.state = [[0.0, 1.0], [_SPEED, _SPEED]]
    ocp.mesh.phase[0].fraction = [1 / arcs] * arcs
    ocp.mesh.phase[0].collocation_points = [grid.degree] * arcs
    ocp.spectral_method, ocp.derivatives.method, ocp.derivatives.order = "lgr", "auto", "second"
    ocp.ipopt_options.print_level, ocp.ipopt_options.tol = 0, Ipopt().tolerance
    ocp.ipopt_options.sb = "yes"

    def solve() -> Answer:
        found = ocp.solve()
        return Answer(float(found.objective), 0)

    return solve


PEERS: dict[str, Callable[[Grid], Solve]] = {
    "wormopt": wormopt,
    "CasADi SX by hand": by_hand,
    "CasADi Opti": opti,
    "rockit": rockit,
    "yapss": yapss,
}
"""Builders by their names."""
