"""Kind "gait-pareto": the Pareto front of optimal gaits between speed and a cost."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ClassVar

from wormopt.errors import Fault, SolveError
from wormopt.progress import Report
from wormopt.quantities import Scalar, Variable
from wormopt.result import Check, Result
from wormopt.study import (
    Given,
    arrays,
    attributes,
    checks,
    entry,
    facts,
    on_use,
    parts,
    scalars,
    signal,
    stage,
    value,
    warnings,
    whole,
)
from wormopt.systems.shared.declared import GAIT
from wormopt.systems.spiked.gait_problem import COST_WORDS, Cost, DesignTable, Objective
from wormopt.systems.spiked.motion import DESIGN_SCALARS, MOTION_VARIABLES

with on_use():
    import numpy as np
    from msgspec import structs

    from wormopt.families.store import checkpoints, key_of
    from wormopt.systems.shared.sequences import Sequence_, canonical
    from wormopt.systems.spiked.design.design import Design, objective_of
    from wormopt.systems.spiked.design.optimize import designed
    from wormopt.systems.spiked.design_results import COST_SCALARS, of_design, with_keys
    from wormopt.systems.spiked.search.orders import is_mirror_symmetric
    from wormopt.systems.spiked.search.search import Known, Start

# A limit binds if its slack is smaller than this share of its size.
_BINDS = 1e-6
# Orders of a point that are tried first at the next one; its other variations are not tried there.
_KNOWN = 24
_NONE_COUNTS = "no point of the front was accepted"


class Pareto(Given):
    """The Pareto front to compute."""

    against: Cost = entry(f"the cost to trade against speed: {COST_WORDS}")
    points: int = whole(
        3,
        50,
        "number of designed gaits: the fastest, and the cheapest at equidistant lower speeds",
        default=9,
    )


@dataclass(frozen=True)
class Point:
    """One designed gait of the front."""

    result: Result
    cost: str  # the scalar that holds it

    @property
    def speed(self) -> float:
        """Mean speed."""
        return float(self.result.scalars["speed"].value)

    @property
    def sequence(self) -> Sequence_:
        """Resting masses, phase by phase."""
        return _order(self.result.trust["solver"]["sequence"])

    @property
    def known(self) -> Known:
        """What its search found, for that of the next point."""
        kept = self.result.attributes
        good = [(_order(order), *start) for order, *start in kept["good"]]
        return Known(
            tuple(Start(order, times and np.array(times), n) for order, times, n in good),
            frozenset(map(_order, kept["poor"])),
        )

    @property
    def value(self) -> float:
        """The cost."""
        return float(self.result.scalars[self.cost].value)


@dataclass(frozen=True)
class Points:
    """Designed gaits, slowest first."""

    found: list[Point]
    lost: list[str]  # why there is no gait at other speeds
    reason: str = ""  # why the search stopped early


@dataclass(frozen=True)
class Front:
    """The front. A point is on it if it is accepted and not dominated."""

    knee: Result
    beaten: int  # points that a faster gait dominates
    front_objective: str = value("1", "the cost, as given in `pareto.against`")
    front_points: int = value("count", "number of points on the front")
    front_knee: int = value("count", "index of the knee; points are numbered from 0, the slowest")
    front_jumps: int = value(
        "count", "neighbouring points on the front with different resting sequences"
    )
    front_speeds: list[float] = value("speed", "mean speed of each point")
    front_values: Scalar = value("force", "cost of each point, in its quantity")
    front_counted: list[bool] = value(
        "1", "whether each point is on the front: accepted and not dominated"
    )
    front_sequences: list[Sequence_] = value(
        "count", "resting masses of each point, phase by phase"
    )
    front_resting: list[int] = value("count", "smallest number of resting masses of each point")
    front_binding: list[str] = value("1", "limits of `[gait]` that bind at each point")
    speed_max: float = value("speed", "mean speed of the fastest gait")
    front_speed: np.ndarray = signal("speed", "point", "mean speed")
    front_value: Variable = signal("force", "point", "cost")
    front_accepted: np.ndarray = signal("1", "point", "1 if the point is on the front")
    front_order: np.ndarray = signal(
        "count", "point", "number that identifies the resting sequence"
    )
    front_gait_breaks: np.ndarray = signal(
        "time",
        "point front_gait_break",
        "times at which pieces of the point's gait begin, NaN after the last",
    )
    front_gait_polynomial: np.ndarray = signal(
        "length",
        "point front_gait_piece link front_gait_power",
        "coefficients of s^k, s the time since the piece began, NaN after the last piece",
    )


class GaitPareto(DesignTable, kind="gait-pareto"):
    """Compute the Pareto front of gaits between speed and a second objective.

    Kind [`gait-design`](gait-design.md) explains `[gait]`, `[search]`, `[motor]` and the trust
    report. Each point tries the best resting sequences of the previous point first, and does not
    try again the variations of sequences that were not among them. `search.time_limit` applies to
    each point.

    Refused: costs that are refused in `[objective]` of a design; `[search.certify]`.

    Points are numbered from 0, the slowest. The front is printed as a table, which is also in
    `table.md`. The table gives the cost of each point, its resting masses in order, the limits that
    bind, and the knee of the front. It also marks points whose resting sequence differs from that
    of the point before. There the front jumps, and the picture `front` draws no line.

    The gait of every point is saved. Load it with `load_gait(path, point=2)` in Python, or with
    `file = "result.nc"` and `point = 2` in a scene. Signals, the trust report and all scalars
    except those of the front belong to the gait at the knee. In the trust report, `dominated` is
    the number of points that a faster gait dominates. Its warnings include those of other points
    and list points for which no gait was found. The cost is also a scalar (`spike_load_max`,
    `actuator_force_max`, `energy_per_distance` or `acceleration_effort`), and `front_value` has its
    quantity. Timing: `front`.
    """

    refuses: ClassVar = {
        "search.certify": "a front has no certificate; remove the table and certify single gaits "
        'in scenes of kind = "gait-design"'
    }
    headline: ClassVar = (
        "front_objective",
        "front_points",
        "speed_max",
        "speed",
        "period",
        "mode_sequence",
    )
    pictures: ClassVar = {
        "front": "the front",
        "gait": "the gait at its knee",
        "motion": "the gait at its knee",
        "spikes": "the gait at its knee",
    }
    table_file: ClassVar = True

    pareto: Pareto = entry("the front")

    def faults_of_keys(self) -> Iterator[Fault]:
        yield from self.faults_of_design()
        yield from self.faults_of_cost("pareto.against", self.pareto.against)

    # -- the designs -------------------------------------------------------------------------------

    @stage
    def front(self) -> Points:
        """The fastest gait, then the cheapest one at each of several lower speeds."""
        # Each search tries the sequence of the next faster gait first. Designed points are kept
        # until the front is complete, so that an interrupted study continues.
        points, lost, total = list[Point](), list[str](), self.pareto.points
        try:
            points.append(self._point(total, None, None))
            # The fastest gait need not be the cheapest of its speed: the next is almost as fast.
            shares = [0.99, *(k / (total - 1) for k in range(total - 2, 0, -1))]
            for k, share in zip(range(total - 1, 0, -1), shares, strict=True):
                speed = share * points[0].speed
                known = points[-1].known
                if len(points) == 1:  # orders that are poor for speed may be good for the cost
                    known = replace(known, poor=frozenset())
                point = self._point(k, speed, known)
                if point.result.scalars:
                    points.append(point)
                else:
                    lost.append(f"no gait at speed {speed:.6g}: {point.result.reason}")
        except KeyboardInterrupt:
            if not points:
                raise
            reason = f"interrupted after {len(points)} of {total} points; run again to continue"
        else:
            reason = ""
            checkpoints().forget(map(self._key, range(1, total + 1)))
        return Points(sorted(points, key=lambda point: point.speed), lost, reason)

    def _key(self, index: int) -> str:
        return key_of(self, f"point {index}")

    def _point(self, index: int, speed: float | None, known: Known | None) -> Point:
        """Design one gait, or read it back from an earlier run of the same scene."""
        work = partial(self._designed, index, speed, known)
        found = checkpoints().result(self._key(index), work)
        return Point(found, COST_SCALARS[self.pareto.against])

    def _designed(self, index: int, speed: float | None, known: Known | None) -> Result:
        against, total = self.pareto.against, self.pareto.points

        def report(text: str, fraction: float | None) -> None:
            done = total - index
            self.report(
                f"{done} of {total} points done: {text}", (done + (fraction or 0.0)) / total
            )

        # a single short search is not worth starting processes, several are
        search = structs.replace(self.search, workers=self.search.workers or os.cpu_count())
        goal = Objective() if speed is None else Objective(against, speed)
        try:
            found = designed(self.task(goal), search, report, known)
        except SolveError as error:
            reason = with_keys(error, self)
            if speed is None:
                raise reason from None
            return Result(self.name, self.kind, status="failed", reason=str(reason))
        if found.ended == "interrupted":
            raise KeyboardInterrupt
        own, kept = of_design(self, found), found.survey.known(_KNOWN)
        good = [(o, None if times is None else times.tolist(), n) for o, times, n in kept.good]
        scalars = own.scalars | {COST_SCALARS[against]: objective_of(found.motion, against)}
        return self.concluded(
            {name: self.with_unit(name, value) for name, value in scalars.items()},
            [self.variable(name, values) for name, values in own.variables.items()],
            own.checks, own.warnings, own.facts,
            {"binding": _binding(found), "good": good, "poor": sorted(kept.poor)},
        )  # fmt: skip

    def stopped(self) -> str:
        """Why the front is not complete."""
        return self.front.reason

    # -- results -----------------------------------------------------------------------------------

    @parts(Front)
    def whole_front(self) -> Front:
        # a mirrored sequence counts as the same where a mirrored gait is as good
        mirror, masses = is_mirror_symmetric(self.task(Objective())), self.worm.links + 1
        points, against = self.front.found, self.pareto.against
        words = [canonical(p.sequence, masses, mirror=mirror) for p in points]
        numbers = {word: k for k, word in enumerate(dict.fromkeys(words))}
        orders = np.array([numbers[word] for word in words])
        unit = points[0].result.scalars[points[0].cost].unit
        ok = np.array([p.result.status == "ok" for p in points])
        speed, costs = np.array([p.speed for p in points]), np.array([p.value for p in points])
        # a faster gait of the same cost is better too
        rivals = [costs[k + 1 :][ok[k + 1 :]] for k in range(len(points))]
        beaten = np.array([np.any(r <= c * (1 + 1e-9)) for c, r in zip(costs, rivals, strict=True)])
        accepted = ok & ~beaten
        at = _knee(speed, costs, accepted)
        breaks, polynomial = _gaits([p.result for p in points])
        return Front(
            knee=points[at].result,
            beaten=int(np.sum(beaten)),
            front_objective=against,
            front_points=int(accepted.sum()),
            front_knee=at,
            front_jumps=int(np.count_nonzero(np.diff(orders[accepted]))),
            front_speeds=speed.tolist(),
            front_values=Scalar(costs.tolist(), unit),
            front_counted=accepted.tolist(),
            front_sequences=[p.sequence for p in points],
            front_resting=[p.result.scalars["resting_min"].value for p in points],
            front_binding=[p.result.attributes["binding"] for p in points],
            speed_max=float(speed.max()),
            front_speed=speed,
            front_value=Variable("front_value", unit, ("point",), costs, against.replace("_", " ")),
            front_accepted=accepted,
            front_order=orders,
            front_gait_breaks=breaks,
            front_gait_polynomial=polynomial,
        )

    @scalars(
        DESIGN_SCALARS
        | {
            "acceleration_effort": (
                "acceleration_squared",
                "acceleration effort, if it is the cost",
            )
        }
    )
    def numbers_of_knee(self) -> Mapping[str, Any]:
        return self.whole_front.knee.scalars

    @arrays(MOTION_VARIABLES | GAIT)
    def signals_of_knee(self) -> Mapping[str, Any]:
        return {variable.name: variable for variable in self.whole_front.knee.variables}

    @checks
    def verdicts(self) -> Iterator[Check]:
        front = self.whole_front
        yield from front.knee.checks
        points = len(front.front_counted)
        missing = points - front.front_points
        yield Check("points that are not accepted", missing, points - 1, _NONE_COUNTS)

    @facts
    def evidence(self) -> Mapping[str, Any]:
        front = self.whole_front
        return {**front.knee.trust, "dominated": front.beaten}

    @warnings
    def doubts(self) -> Iterator[str]:
        own = self.whole_front.knee.trust["warnings"]
        yield from own
        for k, point in enumerate(self.front.found):
            others = [text for text in point.result.trust["warnings"] if text not in own]
            yield from (f"point {k}: {text}" for text in others)
        yield from self.front.lost

    @attributes
    def printed(self) -> Mapping[str, Any]:
        return {"table": table_of(self.front.found, self.whole_front)}

    def result(self, report: Report | None = None) -> Result:
        """Compute all that the study reports; an interrupted front continues when run again."""
        found = super().result(report)
        return found if self.whole_front.front_points else found.failed(_NONE_COUNTS)


def _order(phases: Sequence[Sequence[int]]) -> Sequence_:
    return tuple(map(tuple, phases))


def _binding(found: Design) -> str:
    """List the limits that bind a gait, except those that every gait meets exactly."""
    exact = {"resting", "tick", "closed"}
    if np.size(found.task.limits.period) == 1:
        exact.add("period")
    binding = [
        key.rpartition(".")[2] for key, excess in found.violations.items() if excess > -_BINDS
    ]
    return ", ".join(key for key in binding if key not in exact)


def _gaits(results: list[Result]) -> tuple[np.ndarray, np.ndarray]:
    """Stack breaks and polynomials of all gaits, padded with NaN."""
    breaks = [result["gait_breaks"].values for result in results]
    pieces = [result["gait_polynomial"].values for result in results]
    most = np.max([piece.shape for piece in pieces], axis=0)
    all_breaks = np.full((len(results), most[0] + 1), np.nan)
    all_pieces = np.full((len(results), *most), np.nan)
    for k, (at, piece) in enumerate(zip(breaks, pieces, strict=True)):
        all_breaks[k, : len(at)] = at
        all_pieces[k, : len(piece)] = 0.0  # powers missing in this gait
        all_pieces[k, : len(piece), :, : piece.shape[2]] = piece
    return all_breaks, all_pieces


def table_of(points: list[Point], front: Front) -> str:
    """The front in Markdown, from the slowest point to the fastest."""
    of_units = (points[0].result.scalars[name].unit for name in ("speed", points[0].cost))
    units = [f" ({unit})" if unit != "1" else "" for unit in of_units]
    name = front.front_objective.replace("_", " ")
    head = ("point", f"speed{units[0]}", f"{name}{units[1]}", "resting masses, phase by phase",
            "cycles", "limits that bind", "")  # fmt: skip
    rows, before = [], None
    for k, point in enumerate(points):
        notes = ["knee"] * (k == front.front_knee)
        if not front.front_counted[k]:
            failed = point.result.status != "ok"
            notes.append("not accepted" if failed else "dominated by a faster gait")
        else:
            order = front.front_order[k]
            notes += ["new resting sequence"] * (before not in (None, order))
            before = order
        masses = ", ".join("+".join(map(str, resting)) for resting in point.sequence)
        numbers = (str(k), f"{point.speed:.6g}", f"{point.value:.6g}")
        cycles = str(point.result.scalars["cycles"].value)
        binding = point.result.attributes["binding"]
        rows.append((*numbers, masses, cycles, binding, "; ".join(notes)))
    widths = [max(3, *map(len, column)) for column in zip(head, *rows, strict=True)]
    lines = [head, tuple("-" * width for width in widths), *rows]
    return "".join(
        f"| {' | '.join(cell.ljust(w) for cell, w in zip(line, widths, strict=True))} |\n"
        for line in lines
    )


def _knee(speed: np.ndarray, value: np.ndarray, accepted: np.ndarray) -> int:
    """Index of the accepted point farthest below the line that joins the front's ends."""
    candidates = np.flatnonzero(accepted) if accepted.any() else np.arange(len(speed))
    if len(candidates) < 3:
        return int(candidates[-1])
    x, y = speed[candidates], value[candidates]
    x, y = (x - x[0]) / (np.ptp(x) or 1.0), (y - y[0]) / (np.ptp(y) or 1.0)
    return int(candidates[np.argmax(x * y[-1] - y)])
