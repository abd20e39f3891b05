"""Kind "optimal-crawl": the best periodic inputs of a chain that crawls on dry friction."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

from wormopt.errors import Fault, SceneError, SolveError
from wormopt.progress import Report
from wormopt.quantities import Scalar, unit_of, unit_ratio
from wormopt.result import Check, Result
from wormopt.study import (
    array,
    arrays,
    attributes,
    checks,
    facts,
    on_use,
    parts,
    scalar,
    scalars,
    signal,
    stage,
    value,
    warnings,
)
from wormopt.study.members import AbsentError
from wormopt.study.types import per
from wormopt.systems.chain.crawl_study import CrawlStudy
from wormopt.systems.shared.declared import CHAIN_SIGNALS, COST_OF_TRANSPORT, INSTANT, over
from wormopt.systems.shared.gravity import assumed, cost_of_transport
from wormopt.systems.spiked import why_unreadable

with on_use():
    import casadi as ca
    import numpy as np

    from wormopt.control.drive import drive
    from wormopt.ocp.motion import Motion
    from wormopt.ocp.optimise import Optimum
    from wormopt.simulation.simulate import simulate
    from wormopt.systems.chain.crawl_limits import Slope, bound_of, excess_of, slopes
    from wormopt.systems.chain.crawl_search import Earlier, Solved, converging, search
    from wormopt.systems.chain.dynamic import PERIODS
    from wormopt.systems.shared.optimum import ACCEPTED, modes_of, warnings_of_reading
    from wormopt.systems.shared.signals import chain_expressions

_SIGNALS = INSTANT | over(CHAIN_SIGNALS, last="instant")
_SHOWN = ("length", "velocity", "contact_force", "input")
# Accepted end error of the simulation where contact is relaxed: on arcs that end at switches, and
# on a grid.
_ACCEPTED_AT_SWITCHES, _ACCEPTED_ON_GRID = 5e-3, 2e-2
# A crawl slower than this share of the usual speed of its masses does not advance.
_RESTS = 1e-4
# Excess of a limit between points of the mesh, as a share of the limit, that is worth a warning.
_EXCEEDED = 1e-3
# Widths of the smoothed law that show its order of convergence.
_WIDTHS = 5


@dataclass(frozen=True)
class Convergence:
    """Convergence of relaxed contact to exact contact: narrower laws, and finer grids."""

    width: np.ndarray = signal("speed", "width", "width of the smoothed friction law")
    smoothed_error: np.ndarray = signal("speed", "width", "error with the smoothed friction law")
    arcs: np.ndarray = signal("count", "arcs", "arcs of the grid")
    complementarity_error: np.ndarray = signal(
        "speed", "arcs", "error with complementarity on the grid"
    )
    order_smoothed: float = value(
        "1", "order of convergence: slope of the errors over the smoothing width (convergence)"
    )
    order_complementarity: float = value(
        "1", "order of convergence: slope of the errors over the grid (convergence)"
    )
    objective_smoothed: float = value(
        "speed", "objective at the least smoothing width (convergence)"
    )
    objective_smoothed_error_bar: float = value(
        "speed", "estimated error of `objective_smoothed`, without the exact answer (convergence)"
    )
    objective_complementarity: float = value("speed", "objective on the finest grid (convergence)")
    objective_complementarity_error_bar: float = value(
        "speed",
        "estimated error of `objective_complementarity`, without the exact answer (convergence)",
    )
    same_modes: bool = value(
        "1", "whether both show the contact modes of the exact crawl (convergence)"
    )

    @property
    def doubts(self) -> Iterator[str]:
        """Warnings of error estimates that are too small."""
        for name in ("smoothed", "complementarity"):
            error = getattr(self, f"{name}_error")[-1]
            if abs(error) > getattr(self, f"objective_{name}_error_bar"):
                yield f"the estimated error with {name} contact does not cover the exact objective"


class OptimalCrawl(CrawlStudy, kind="optimal-crawl"):
    """Optimise the inputs of a chain that crawls on dry friction: fastest or cheapest.

    It finds the periodic inputs with which the chain crawls fastest, or at the least energy.
    Velocities repeat after a cycle; positions advance by the same amount. A period is a whole
    number of equal cycles; results describe one cycle, and `cycles` is their number in the shortest
    period. Contact is dry friction. A coarse solve with relaxed contact from every start finds good
    motions; in the best ones arcs end where contacts switch; a last solve prescribes the contact
    modes found and is exact. An exact simulation repeats the motion with the inputs found. See
    [optimal.md](../optimal.md).

    If the exact solve fails or loses more than 0.1 %, the motion with arcs that end at switches is
    the result, accurate to about a thousandth, and a warning says so.

    `[mesh]`: `arcs` is the number of arcs that end at switches; its `tolerance` is that of the
    exact solve. The arrays contain the instants at which arcs join twice.

    **Sensitivities.** The scalars `sensitivity.KEY` give the change of the maximised speed less
    effort, or of the minimised cost, per unit of each number of `[limits]` and of
    `objective.speed`, for the same order of rests; a key with one number per link has a list. They
    are multipliers of the last solve. A limit that does not bind has 0. With `limits.tick` there is
    none of the period. `limit_elasticity` is the relative sensitivity; the attribute `limits` holds
    the names.

    **Bound.** Over a cycle, springs and masses keep their energy, so actuators give what dashpots
    and the ground take. This bounds `objective` for every crawl within the limits of force, power,
    rate and acceleration; see [optimal.md](../optimal.md#bound-of-crawls).
    """

    pictures: ClassVar = {
        "signals": "signals over time",
        "convergence": "further solves with smoothed contact and on finer grids, and their "
        "convergence to the exact answer",
        "animation": ("the moving worm, as a GIF", "wormopt.pictures.worms:animation"),
    }
    wanted: ClassVar = ("convergence",)
    refuses: ClassVar = {
        "worm.random": "is not allowed, since an optimal crawl belongs to a known chain; write "
        "[robust] instead"
    }
    headline: ClassVar = (
        "speed",
        "speed_simulated",
        "cost_of_transport",
        "objective",
        "time",
        "input_peak",
        "mode_sequence",
    )
    keys_of_names: ClassVar = {
        "input": "limits.actuator_force",
        "inputs": "limits.actuator_force",
        "states": "limits.length",
        "duration": "limits.period",
        "arcs": "mesh.arcs",
    }
    advice_by_code: ClassVar = {
        "not_solved": "write search.starts = 5, another number of mesh.arcs, or wider "
        "limits.length, limits.actuator_force or limits.period",
    }

    def faults_of_keys(self) -> Iterator[Fault]:
        yield from self.worm.faults(1.0, self.units)
        yield from self.limits.faults_for(self.worm.links)
        if self.worm.friction is None:
            yield "worm.friction", "missing, and a chain cannot crawl without friction; add it"
        elif self.worm.resists_nothing:
            yield (
                "worm.friction",
                "resists no forward motion, so coasting at any speed is a crawl without cost; "
                "write friction forward, drag or load",
            )
        earlier = self.search.result
        if earlier is not None and (unreadable := why_unreadable(self.folder / earlier)):
            yield "search.result", f'"{earlier}" cannot be read from {self.folder}: {unreadable}'
        if self.robust is not None:
            yield from self._faults_of_robust()

    def _faults_of_robust(self) -> Iterator[Fault]:
        if self.objective.minimise:
            yield "objective.minimise", 'is not supported with [robust]; write maximise = "speed"'
        if self.search.result is not None:
            what = "belongs to a single chain; leave out [robust] or search.result"
            yield "search.result", what
        if self.worm.slope:
            yield (
                "worm.slope",
                "is not allowed, since masses drawn by [robust] would change the weights; write "
                "worm.load",
            )
        if "convergence" in self.want:
            yield "want", '"convergence" needs a single chain; leave out [robust] or "convergence"'

    # -- solving -----------------------------------------------------------------------------------

    @cached_property
    def earlier(self) -> Earlier | None:
        """The crawl of an earlier result, if one is given; SceneError if it has none that fits."""
        name = self.search.result
        if name is None:
            return None
        try:
            earlier = Result.load(self.folder / name)
            t = earlier["instant"].values
            states = np.vstack([earlier["position"].values, earlier["velocity"].values])
            inputs, forces = earlier["input"].values, earlier["contact_force"].values
        except (OSError, ValueError, KeyError) as error:
            why = "" if isinstance(error, KeyError) else f": {error}"  # which lists all names
            message = (
                f"{name} does not contain the crawl of a single worm{why}; write the result of a "
                'scene of kind "optimal-crawl" without [robust]'
            )
            raise SceneError(self.name, [("search.result", message)]) from None
        if len(inputs) != self.worm.links:
            message = f"{name} has {len(inputs)} links; write a result with {self.worm.links}"
            raise SceneError(self.name, [("search.result", message)])
        return Earlier(t, states, inputs, forces)

    @cached_property
    def found(self) -> tuple[dict[str, Solved], list[float]]:
        """Optima of all stages by name, and the coarse objectives of all starts."""
        return search(self, self.earlier, self.report)

    def solve(self) -> dict[str, Optimum]:
        """Solve with relaxed contact, then with arcs that end at switches, then with phases."""
        try:
            stages, _ = self.found
        except SolveError as error:
            if error.code != "not_solved":
                raise
            # the solver's messages on equations do not help the user
            what = (
                "no crawl was found within limits.period, limits.actuator_force and limits.length"
            )
            raise SolveError(what, error.suggestion, error.partial, error.code) from None
        optima = {name: one.optimum(self) for name, one in stages.items()}
        self._refuse_rest([*optima.values()][-1].motion)
        return optima

    def _refuse_rest(self, motion: Motion) -> None:
        """Raise SolveError if the best crawl stays where it is, or slides back."""
        start, end = motion.states(np.array([0.0, motion.duration])).T
        usual = motion.program.problem.model.x[1].nominal
        if end[0] - start[0] > _RESTS * usual * motion.duration:
            return
        raise SolveError(
            "no crawl within limits.period, limits.actuator_force and limits.length advances",
            "write a larger limits.actuator_force, or less friction forward, load or slope",
            motion,
            "at_rest",
        )

    @property
    def exact(self) -> bool:
        """Whether contact is exact: phases with free switching times."""
        return "phases" in self.optimisation.optima

    @property
    def accepted(self) -> float:
        if self.exact:
            return ACCEPTED
        return _ACCEPTED_AT_SWITCHES if self.single_chain else _ACCEPTED_ON_GRID

    @property
    def defect(self) -> float:
        return self.mesh.tolerance if self.exact else math.inf

    # -- speeds ------------------------------------------------------------------------------------

    @cached_property
    def ends(self) -> np.ndarray:
        """States at the start and at the end of the crawl."""
        return self.motion.states(np.array([0.0, self.motion.duration]))

    @cached_property
    def advances(self) -> np.ndarray:
        """Advance of each chain in a period."""
        heads = self.ends[:: 2 * (self.worm.links + 1)]
        return heads[:, 1] - heads[:, 0]

    @stage
    def simulated_speeds(self) -> list[float]:
        self.report("simulating the crawl", 0.95)
        period, masses = self.motion.duration, self.worm.links + 1
        driven = drive(self.plant, self.motion.input_course(), periodic=True)
        begin = {"position": self.ends[:masses, 0], "velocity": self.ends[masses : 2 * masses, 0]}
        span = (2 if self.single_chain else 4 * PERIODS) * period
        speeds: list[float] = []
        for draw in self.draws:
            run = simulate(driven, span, x0=begin, p=dict(draw), dense=True)
            assert run.dense is not None
            x = run.dense(np.array([span - period, span]))[0]
            speeds.append((x[1] - x[0]) / period)
        return speeds

    @scalar("length", "distance travelled in a period")
    def advance(self) -> float:
        return float(np.mean(self.advances))

    @scalar("speed", "mean speed")
    def speed(self) -> float:
        return self.advance / self.motion.duration

    @scalar(
        "speed",
        "mean speed of an exact simulation over two periods; with `[robust]` a list by chain, "
        "after many periods",
    )
    def speed_simulated(self) -> float | list[float]:
        return self.simulated_speeds[0] if self.single_chain else self.simulated_speeds

    @scalar(
        "acceleration",
        "positive work of the actuators over mass and distance; not with `[robust]`",
        when="single_chain",
    )
    def energy_per_mass_distance(self) -> float:
        mass = sum(per(self.worm.mass, self.worm.links + 1))
        return work_of(self.motion) / mass / self.advance

    @scalars(COST_OF_TRANSPORT, when="single_chain")
    def transport(self) -> dict[str, float | None]:
        return cost_of_transport(self.energy_per_mass_distance, self.units)

    @scalar(
        "speed",
        "minimised quantity; minus the speed when the speed is maximised; energy over mass "
        "and distance has the unit of an acceleration",
        name="objective",
    )
    def minimised(self) -> Scalar:
        return Scalar(self.optimum.objective, unit_of(self.objective.quantity, self.units))

    @property
    def cycles_in_period(self) -> int:
        """Number of equal cycles in the shortest period."""
        return self.limits.cycles_of(self.motion.duration)

    @scalar("count", "equal cycles in the period; all other results describe one cycle")
    def cycles(self) -> int:
        return self.cycles_in_period

    @stage
    def sensitivity(self) -> list[Slope]:
        return slopes(self, self.optimum, self.cycles_in_period)

    @scalars({}, when="single_chain")
    def derivatives(self) -> dict[str, Scalar]:
        values, quantities = dict[str, Any](), dict[str, str]()
        for limit in self.sensitivity:
            key = limit.name.partition("[")[0]
            quantities[key] = limit.quantity
            if "[" in limit.name:
                values.setdefault(key, []).append(limit.derivative)
            else:
                values[key] = limit.derivative
        return {
            f"sensitivity.{key}": Scalar(
                v, unit_ratio(self.objective.quantity, quantities[key], self.units)
            )
            for key, v in values.items()
        }

    @array("1", "limit", "relative sensitivity of the objective to the limit", when="single_chain")
    def limit_elasticity(self) -> np.ndarray:
        return np.array([limit.elasticity for limit in self.sensitivity])

    @cached_property
    def least(self) -> float | None:
        """Bound on the objective of every crawl; None if there is none."""
        return bound_of(self) if self.single_chain else None

    @property
    def is_bounded(self) -> bool:
        """Whether there is a bound on the objective of every crawl."""
        return self.least is not None

    @scalar(
        "speed",
        "bound on `objective` for every crawl within the limits: over a cycle the work of the "
        "actuators equals the losses in dashpots and ground",
        when="is_bounded",
    )
    def bound(self) -> Scalar | None:
        unit = unit_of(self.objective.quantity, self.units)
        return None if self.least is None else Scalar(self.least, unit)

    # -- signals and convergence -------------------------------------------------------------------

    def expressions(self) -> Mapping[str, ca.SX]:
        """Return the signals to sample: of several chains, their common inputs."""
        model = self.motion.program.problem.model
        return chain_expressions(model) if self.single_chain else {"input": model.u[0].symbol}

    @arrays(_SIGNALS)
    def signals(self) -> dict[str, np.ndarray]:
        return self.sampled

    @attributes
    def in_the_picture(self) -> dict[str, Any]:
        if not self.single_chain:
            return {"signals": [*_SHOWN]}
        limits = {
            "objective": self.objective.minimise or "speed",
            "name": [limit.name for limit in self.sensitivity],
            "value": [limit.value for limit in self.sensitivity],
            "unit": [unit_of(limit.quantity, self.units) for limit in self.sensitivity],
        }
        return {"signals": [*_SHOWN], "limits": limits}

    @property
    def convergence_wanted(self) -> bool:
        """Whether relaxed contact is followed to its limit."""
        return "convergence" in self.want

    @stage
    def relaxed_limit(self) -> Convergence | str:
        """Convergence of relaxed contact to exact contact, or why it is unknown."""
        what = "relaxed contact was not followed to its limit"
        if not self.exact:
            return f"{what}, so the motion does not show the phases"
        try:
            with np.errstate(all="ignore"):
                sharp = self.found[0]["switches"]
                return converge(self, sharp, self.optimum, self.report)
        except SolveError as error:
            return f"{what}: {error}"

    @parts(Convergence, when="convergence_wanted")
    def convergence(self) -> Convergence:
        if isinstance(self.relaxed_limit, str):
            raise AbsentError(self.relaxed_limit)
        return self.relaxed_limit

    # -- the trust report --------------------------------------------------------------------------

    @checks
    def confirmed(self) -> Iterator[Check]:
        speed, kept = self.speed, float(np.mean(self.simulated_speeds))
        advice = (
            f"the simulated speed after some periods is {kept:.6g}, not {speed:.6g}; write "
            "more mesh.arcs"
        )
        limit = self.accepted * max(abs(speed), abs(kept))
        yield Check("speed after some periods", kept - speed, limit, advice)
        if self.least is not None:
            under = (self.least - self.optimum.objective) / (abs(self.least) or 1.0)
            what = "the objective is below its bound, which is an error; please report this scene"
            yield Check("objective under its bound", max(0.0, under), 1e-9, what)
        if self.convergence_wanted and isinstance(self.relaxed_limit, str):
            yield Check("relaxed contact not followed", 1.0, 0.0, self.relaxed_limit)

    @warnings
    def doubts(self) -> Iterator[str]:
        for name, share in excess_of(self.motion).items():
            if share > _EXCEEDED:
                yield (
                    f"between points of the mesh {name} is exceeded by up to {share:.2%}; write "
                    f"more mesh.arcs, or a {name} smaller by as much"
                )
        if self.exact:
            yield from warnings_of_reading(self.optimisation.optima["switches"], self.optimum)
        elif self.single_chain:
            yield (
                "no exact motion with these switches was found: contact is a complementarity "
                "condition on arcs that end at switches, so the motion is accurate to about one "
                "part in a thousand; speed_simulated is the speed in the exact simulation"
            )
        else:
            yield (
                "several worms: contact is a complementarity condition on a grid, so the motion "
                "is accurate to about one part in a hundred; speed_simulated is the speed of each "
                "worm in the exact simulation"
            )
        if self.search.starts == 1:
            yield (
                "the result is a local optimum from a single start; write search.starts to try more"
            )
        if self.convergence_wanted and isinstance(self.relaxed_limit, Convergence):
            yield from self.relaxed_limit.doubts

    @facts
    def of_search(self) -> dict[str, Any]:
        found = {"starts": self.found[1]}
        return found | assumed(self.units) if self.single_chain else found


# -- motions ---------------------------------------------------------------------------------------


def work_of(motion: Motion) -> float:
    """Return the positive work of the actuators over a motion."""
    edges = motion.breaks
    s, weights = np.polynomial.legendre.leggauss(20)
    t = edges[:-1, None] + np.diff(edges)[:, None] * (s + 1) / 2
    power = motion.output("power", t.ravel()).reshape(-1, *t.shape)
    return float(np.sum(np.maximum(power, 0.0) * weights / 2 * np.diff(edges)[:, None]))


# -- convergence of relaxed contact ----------------------------------------------------------------


def converge(study: CrawlStudy, sharp: Solved, exact: Optimum, report: Report) -> Convergence:
    """Solve again with narrower laws and on finer grids, from the same local optimum."""
    smoothed, *on_grids = (one.optimum(study) for one in converging(study, sharp, report))
    best = exact.objective
    levels = smoothed.levels[-_WIDTHS:]
    width = np.array([level.level for level in levels])
    by_width = np.array([level.objective for level in levels])
    grids = np.array([one.motion.mesh.total for one in on_grids])
    by_grid = np.array([one.objective for one in on_grids])
    return Convergence(
        width=width,
        smoothed_error=by_width - best,
        arcs=grids,
        complementarity_error=by_grid - best,
        order_smoothed=_slope(width, by_width - best),
        order_complementarity=-_slope(grids, by_grid - best),
        objective_smoothed=float(by_width[-1]),
        objective_smoothed_error_bar=_last_step(by_width),
        objective_complementarity=float(by_grid[-1]),
        objective_complementarity_error_bar=_last_step(by_grid),
        same_modes=len({_cycle_of(one) for one in (exact, smoothed, on_grids[-1])}) == 1,
    )


def _slope(over: np.ndarray, errors: np.ndarray) -> float:
    return float(np.polyfit(np.log(over), np.log(np.abs(errors)), 1)[0])


def _last_step(values: np.ndarray) -> float:
    """Estimate the error of a sequence without the exact answer: twice its larger last step.

    A switch may lie well in one grid by chance, so two steps count.
    """
    return 2 * float(np.abs(np.diff(values[-3:])).max())


def _cycle_of(optimum: Optimum) -> tuple[tuple[int, ...], ...]:
    """Contact modes of a period without repetitions, independent of where it begins."""
    modes, _ = modes_of(optimum)
    cycle = [tuple(m) for k, m in enumerate(modes) if m != modes[k - 1]] or [tuple(modes[0])]
    return min(tuple(cycle[k:] + cycle[:k]) for k in range(len(cycle)))
