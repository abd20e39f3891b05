"""Optimal control: the smooth slide by wormopt, by scripts and by other toolkits.

Each builds its program once and solves it often. All take equal phases, states by Radau collocation
and one value of the drive per arc, start from the same guess and give IPOPT the same options.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Any

import casadi as ca
import numpy as np

from tests.benchmarks.run import OWN, Found, aligned, colour, compared, seconds, timed, why
from wormopt.model.friction import Coulomb
from wormopt.numerics.collocation import Collocation
from wormopt.ocp.contact import Regularised
from wormopt.ocp.mesh import Mesh
from wormopt.ocp.motion import Guess, sample
from wormopt.ocp.nlp import Ipopt
from wormopt.ocp.optimise import optimise, refine
from wormopt.ocp.problem import Constraint, Ends, Problem
from wormopt.ocp.transcription import Transcription
from wormopt.progress import Report
from wormopt.systems.block.block import block

THAN, MOST = "CasADi SX by hand", 2.0
"""Whose time to solve wormopt has to keep up with, and the largest ratio."""

_EXACT = 1.2221708186  # shortest time by the law -(1.5 tanh(40 v) - 0.5)
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
    def arcs(self) -> list[tuple[int, float, float, float]]:
        """Of every arc its phase, its share of that, and where the first guess begins and ends."""
        places = np.append(0, np.cumsum(np.concatenate(self.shares))) / len(self.shares)
        arcs = [(phase, share) for phase, shares in enumerate(self.shares) for share in shares]
        return [(*arc, *ends) for arc, ends in zip(arcs, pairwise(places), strict=True)]

    @property
    def only(self) -> int:
        """Number of arcs, for toolkits that know no others than equal ones in one phase."""
        if len(self.held) > 1:
            raise NotImplementedError("equal arcs only")
        return len(self.shares[0])


def even(arcs: int) -> Grid:
    """Equal arcs in one phase: the switch of the drive falls somewhere within an arc."""
    return Grid(f"{arcs} equal arcs", ((1 / arcs,) * arcs,), (0,))


def graded(tolerance: float) -> Grid:
    """Two phases, one to either side of the switch, refined until no arc errs by more.

    `tolerance`: local error of an arc.
    """
    law = Regularised(_V_REG, _V_REG, active=((1,), (-1,)))
    mesh = Mesh.even(2, 10, Collocation(3, "radau"))
    found = refine(optimise(_problem(), mesh, law, _guess()), tolerance, rounds=8).motion.mesh
    edges, shares = np.cumsum([0, *found.counts]), found.shares or ()
    halves = tuple(tuple(shares[a:b]) for a, b in pairwise(edges))
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
        Constraint("start", ends.start, [0.0, 0.0], [0.0, 0.0]),
        Constraint("end", ends.end, [1.0, 0.0], [1.0, 0.0]),
    ]
    return Problem(model, ends, ends.duration, (0.01, _LATEST), boundary_constraints=at_ends)


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
    counts, shares = tuple(map(len, grid.shares)), tuple(share for _, share, *_ in grid.arcs)
    mesh = Mesh(len(counts), counts, Collocation(grid.degree, "radau"), shares=shares)
    program = Transcription(_problem(), mesh, Regularised(_V_REG, _V_REG))
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
    for k, (phase, share, begin, end) in enumerate(grid.arcs):
        u, held = ca.SX.sym("u"), grid.held[phase]
        w, w0 = [*w, u], [*w0, 0.0]
        low.append(_FORCE if held > 0 else -_FORCE)
        high.append(-_FORCE if held < 0 else _FORCE)
        points = [state, *(ca.SX.sym(f"x{k}_{j}", 2) for j in range(d))]
        for j, point in enumerate(points[1:]):
            w = [*w, point]
            w0 = [*w0, begin + tau[j] * (end - begin), _SPEED]
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
    stack = ca.Opti()
    durations, state = stack.variable(phases), stack.variable(2)
    stack.minimize(ca.sum1(durations))
    stack.subject_to(stack.bounded(0, durations, _LATEST))
    stack.set_initial(durations, _FIRST / phases)
    stack.subject_to(state == 0)
    stack.set_initial(state, [0.0, _SPEED])
    for phase, share, begin, end in grid.arcs:
        u, points, held = stack.variable(), stack.variable(2, d), grid.held[phase]
        limits = stack.bounded(-_FORCE, u, _FORCE) if held == 0 else u == held * _FORCE
        stack.subject_to(limits)
        rates = ca.vertcat(points[1, :], _acceleration(points[1, :], u))
        slope = ca.mtimes(ca.horzcat(state, points), slopes)
        stack.subject_to(ca.vec(slope - durations[phase] * share * rates) == 0)
        guess = np.vstack([begin + tau * (end - begin), np.full(d, _SPEED)])
        stack.set_initial(points, guess)
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
        stats = solver.stats()
        while "return_status" not in stats:  # those of the solver within the function
            stats = next(value for value in stats.values() if isinstance(value, dict))
        return _answer(stats, found)

    return solve


def rockit(grid: Grid) -> Solve:
    """Build it with rockit, on equal arcs only."""
    peer: Any = import_module("rockit")
    arcs = grid.only
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
    ocp.method(peer.DirectCollocation(N=arcs, M=1, degree=grid.degree, scheme="radau"))
    ocp.solver("ipopt", Ipopt().as_casadi())
    ocp._transcribe()

    def solve() -> Answer:
        found = ocp.solve()
        return _answer(dict(found.stats), float(found.value(ocp.T)))

    return solve


def yapss(grid: Grid) -> Solve:
    """Build it with yapss, on equal arcs only; derivatives are found anew in every solve."""
    peer: Any = import_module("yapss")
    arcs = grid.only
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
    OWN: wormopt,
    THAN: by_hand,
    "CasADi Opti": opti,
    "rockit": rockit,
    "yapss": yapss,
}
"""Builders by their names."""


# -- measuring -----------------------------------------------------------------------------------


def measured(_name: str, quick: bool, report: Report) -> Iterator[Found]:
    """Measure on equal arcs, and on graded ones for a small error; coarser ones if `quick`."""
    grids = [even(20), graded(1e-7)] if quick else [even(40), graded(1e-9)]
    for rows in measure_ocp(grids, 5 if quick else 25, report):
        ratios = {grid.name: solve_ratio(rows, grid.name) for grid in grids}
        targets = [
            {"grid": grid, "than": THAN, "most": MOST, "ratio": ratio, "met": ratio <= MOST}
            for grid, ratio in ratios.items()
            if ratio is not None
        ]
        yield {"times": rows, "targets": targets}


def measure_ocp(
    grids: Sequence[Grid], rounds: int, report: Report, names: Sequence[str] = tuple(PEERS)
) -> Iterator[list[Found]]:
    """Build every program, then solve them in turn, so that a busy machine is fair to all.

    Yields all results so far; `rounds`: solves of each; `names`: solvers.
    """
    rows: list[Found] = []
    for k, grid in enumerate(grids):
        ready: list[tuple[Found, Solve, list[float]]] = []
        for name in names:
            report(f"ocp: {name} on {grid.name}", k / len(grids))
            times = {"build_s": None, "solve_s": None}  # median of solves after the first
            told = {"error": None, "iterations": 0, "functions_s": {}, "missing": ""}
            rows.append({"solver": name, "grid": grid.name, **times, **told})
            try:
                rows[-1]["build_s"], solve = timed(PEERS[name], grid)
                solve()  # the first one is not like the others
                ready.append((rows[-1], solve, []))
            except ImportError as error:
                rows[-1]["missing"] = f"not installed: {error.name}"
            except NotImplementedError as error:
                rows[-1]["missing"] = str(error)
            except Exception as error:  # whatever a peer does wrong
                rows[-1]["missing"] = why(error)
            yield rows
        for _ in range(rounds):
            for row, solve, spent in ready:
                time, answer = timed(solve)
                spent.append(time)
                row |= {"solve_s": median(spent), "error": answer.time - _EXACT}
                row |= {"iterations": answer.iterations, "functions_s": answer.functions_s}
        yield rows


def solve_ratio(rows: Sequence[Mapping[str, Any]], grid: str) -> float | None:
    """Time of a solve by wormopt over that by hand, where both are known."""
    times = {row["solver"]: row["solve_s"] for row in rows if row["grid"] == grid}
    ours, theirs = times.get(OWN), times.get(THAN)
    return ours / theirs if ours and theirs else None


# -- telling -------------------------------------------------------------------------------------


def ratios(found: Mapping[str, Any]) -> dict[str, float]:
    """Our time to solve over that of every other toolkit, by grids."""
    known: dict[str, float] = {}
    for grid in dict.fromkeys(t["grid"] for t in found["times"]):
        times = {t["solver"]: t["solve_s"] for t in found["times"] if t["grid"] == grid}
        known |= {f"{name}, {grid}": ratio for name, ratio in compared(times).items()}
    return known


def lines(found: Mapping[str, Any]) -> list[str]:
    """The times in a table, what is missing, and the targets."""
    rows = [
        (
            t["grid"],
            t["solver"],
            seconds(t["build_s"]),
            seconds(t["solve_s"]),
            str(t["iterations"] or ""),
            seconds(sum(t["functions_s"].values()) or None),
            f"{t['error']:.1e}",
        )
        for t in found["times"]
        if t["error"] is not None
    ]
    head = ("grid", "solver", "build", "solve", "iterations", "in functions", "error")
    told = ["ocp: the fastest slide, smooth law with v_reg = 1/40", *aligned(head, *rows)]
    for t in found["times"]:
        told += [f"  {t['solver']} on {t['grid']}: {t['missing']}"] if t["missing"] else []
    for target in found["targets"]:
        met = "met" if target["met"] else "missed"
        told.append(
            f"  target, {target['grid']}: solve at most {target['most']:g} of {target['than']}: "
            f"{target['ratio']:.3g}, {met}"
        )
    return told


def draw(found: Mapping[str, Any], path: Path) -> None:
    """Draw the times to build and to solve as bars to a PNG file."""
    from matplotlib.figure import Figure

    rows = [t for t in found["times"] if t["solve_s"] is not None]
    labels = [f"{t['solver']}\n{t['grid']}" for t in rows]
    colours = [colour(0 if t["solver"] == OWN else 1) for t in rows]
    figure = Figure(figsize=(8, 1.2 + 0.5 * len(rows)), layout="constrained")
    both = figure.subplots(1, 2, sharey=True)
    names = {"build_s": "time to build (s)", "solve_s": "median time to solve (s)"}
    for axes, (key, name) in zip(both, names.items(), strict=True):
        axes.barh(labels, [t[key] for t in rows], color=colours, height=0.6)
        axes.set_xlabel(name)
        axes.grid(visible=True, axis="x", color="#E6E6E6", linewidth=0.6)
        axes.set_axisbelow(True)
        axes.spines[["top", "right"]].set_visible(False)
    both[0].invert_yaxis()
    figure.savefig(path, dpi=130)
