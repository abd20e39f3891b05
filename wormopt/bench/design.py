"""Gait design against other ways to do it: seconds to come near the bound on the speed."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from statistics import median_high
from typing import Any

from wormopt.bench.design_cases import G1, Case, draw, task_of
from wormopt.bench.design_milp import by_milp
from wormopt.bench.design_motion import Course
from wormopt.bench.design_multistart import by_multistart
from wormopt.progress import Report, silent
from wormopt.systems.spiked.task import Certify, Search

ACCURACIES = (0.1, 0.03, 0.01, 0.003)
"""Distances from the bound, as parts of it."""

OWN = "wormopt"
"""The solver whose times are compared with those of the others."""

_SEED = 1
_ABOVE = 1e-6  # beyond the ceiling by more, a speed is wrong
# Proofs speak of so many phases a cycle, and are sharp enough at this gap; they may take so many
# times what a solver may. An accuracy is judged where the gap is below this part of it.
_PHASES, _GAP, _PROOF_TIME, _SHARP = 4, 1e-3, 4.0, 0.5

Solver = Callable[[Case, float], Course]
Better = Callable[[float], None]


@dataclass(frozen=True)
class Bound:
    """Upper bounds on the speed of gaits of a problem."""

    speed: float  # certified for at most four phases a cycle, any number of cycles
    gap: float  # how far it may be above the best gait, relative
    ceiling: float  # no gait at all is faster


@dataclass
class Attempt:
    """What one solver did on one problem."""

    solver: str
    problem: str
    bound: Bound  # on the speed
    course: Course = field(default_factory=list)  # (seconds, best speed by then)
    failure: str = ""  # why there is no more

    @property
    def best(self) -> float:
        """Best speed, 0 without any gait."""
        return max((speed for _, speed in self.course), default=0.0)

    @property
    def wrong(self) -> bool:
        """Whether a speed is above what any gait can have."""
        return self.best > self.bound.ceiling * (1 + _ABOVE)

    def time_to(self, accuracy: float, bound: float) -> float:
        """Seconds until the gait is within `accuracy`, relative, of a bound; infinite if never.

        `bound`: certified, or the best known speed where that is faster.
        """
        near = [seconds for seconds, speed in self.course if speed >= (1 - accuracy) * bound]
        return min(near, default=math.inf)


@dataclass(frozen=True)
class Reached:
    """How one solver did on all problems for one accuracy."""

    solver: str
    accuracy: float  # distance from the bound
    seconds: float  # median; inf where most problems were not solved so well
    share: float  # of the problems that were solved so well
    problems: int  # number with a bound sharp enough to tell


def posed(*, quick: bool) -> list[Case]:
    """The benchmark problem, and seeded random ones; fewer of them if `quick`."""
    return [G1, *draw(_SEED, 3 if quick else 12)]


def certified_bound(case: Case, seconds: float) -> Bound:
    """Bound on the speed by branch and bound, sharp where the time is enough for that.

    `seconds` covers the design and the proof.
    """
    from wormopt.systems.spiked.certify.proof import certified
    from wormopt.systems.spiked.design.optimize import designed

    found = designed(task_of(case), Search(time_limit=seconds), silent)
    proof = certified(found, Certify(_PHASES, _GAP, seconds), silent)
    return Bound(proof.bound, max(proof.gap, 0.0), found.ceiling)


def ours(case: Case, seconds: float, design: Callable[[Case, float, Better], None]) -> Course:
    """Time our own designer; returns (seconds, best speed) pairs.

    `design`(case, seconds, better) calls better(speed) whenever it has a better gait.
    """
    begin, course = time.perf_counter(), Course()

    def better(speed: float) -> None:
        course.append((time.perf_counter() - begin, speed))

    design(case, seconds, better)
    return course


def _by_design(case: Case, seconds: float, better: Better) -> None:
    """The designer of the package, in one process as its rivals; its coarse gaits count too."""
    from wormopt.systems.spiked.design.optimize import designed

    settings = Search(time_limit=seconds, workers=1)
    found = designed(task_of(case), settings, silent, better=lambda trial: better(trial.value))
    better(found.speed)


SOLVERS: dict[str, Solver] = {
    OWN: lambda case, seconds: ours(case, seconds, _by_design),
    "HiGHS, equal steps": by_milp,
    "IPOPT, many starts": by_multistart,
}
"""Designers by their names."""


def measure_design(
    problems: Sequence[Case],
    seconds: float,
    report: Report,
    solvers: Mapping[str, Solver] = SOLVERS,
    prove: Callable[[Case, float], Bound] = certified_bound,
) -> Iterator[list[Attempt]]:
    """Prove a bound for every problem, and give every solver the same time on it, in turn.

    `seconds` is for each solver and problem. Yields all attempts so far.
    """
    known: list[Attempt] = []
    for k, case in enumerate(problems):
        report(f"design: a bound for {case['name']}", k / len(problems))
        bound = prove(case, _PROOF_TIME * seconds)
        for name, solve in solvers.items():
            attempt = Attempt(name, case["name"], bound)
            report(f"design: {name} on {case['name']}", len(known) / len(problems) / len(solvers))
            try:
                attempt.course = solve(case, seconds)
            except Exception as error:  # whatever a designer does wrong
                attempt.failure = f"{type(error).__name__}: {str(error).splitlines()[0]}"
            known.append(attempt)
            yield known


def bounds(known: Sequence[Attempt]) -> dict[str, float]:
    """By problem the certified bound, or the run's best speed if more phases made it faster."""
    found: dict[str, float] = {}
    for attempt in known:
        best = max(attempt.best, attempt.bound.speed)
        found[attempt.problem] = max(best, found.get(attempt.problem, 0.0))
    return found


def reached(known: Sequence[Attempt]) -> list[Reached]:
    """Sum up times over the problems whose bound is sharp enough for the accuracy.

    Sorted by accuracy, then by solver.
    """
    most, rows = bounds(known), []
    for accuracy in ACCURACIES:
        told = [a for a in known if a.bound.gap <= _SHARP * accuracy]
        for solver in dict.fromkeys(a.solver for a in told):
            times = [a.time_to(accuracy, most[a.problem]) for a in told if a.solver == solver]
            share = sum(map(math.isfinite, times)) / len(times)
            rows.append(Reached(solver, accuracy, median_high(times), share, len(times)))
    return rows


def described(known: Sequence[Attempt]) -> dict[str, Any]:
    """Lay out what was measured for JSON."""
    most, rows = bounds(known), reached(known)
    attempts = [
        asdict(a)
        | {
            "bound": most[a.problem],
            "certified": a.bound.speed,
            "gap": _finite(a.bound.gap),
            "ceiling": a.bound.ceiling,
            "best": a.best,
            "wrong": a.wrong,
        }
        for a in known
    ]
    summed = [
        {
            "solver": r.solver,
            "accuracy": r.accuracy,
            "time_s": _finite(r.seconds),
            "share": r.share,
            "problems": r.problems,
        }
        for r in rows
    ]
    ratios = [{"accuracy": a, "ratio": _finite(_ratio(rows, a))} for a in ACCURACIES]
    return {
        "case": "design",
        "attempts": attempts,
        "reached": summed,
        "ratios": ratios,
        "done": False,
    }


def _ratio(rows: Sequence[Reached], accuracy: float) -> float:
    """Median time of ours over that of the fastest of the others."""
    times = {r.solver: r.seconds for r in rows if r.accuracy == accuracy}
    own = times.pop(OWN, math.inf)
    fastest = min(times.values(), default=math.inf)
    return own / fastest if math.isfinite(fastest) else math.inf


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
