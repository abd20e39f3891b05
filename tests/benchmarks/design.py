"""Gait design against other ways to do it: seconds to come near the bound on the speed."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from statistics import median_high
from time import perf_counter
from typing import Any

import numpy as np

from tests.benchmarks.design_cases import G1, Case, Course, task_of
from tests.benchmarks.design_cases import draw as drawn
from tests.benchmarks.design_rivals import by_milp, by_multistart
from tests.benchmarks.run import OWN, Found, aligned, axes, colour, finite, save, seconds, why
from wormopt.progress import Report, silent
from wormopt.systems.spiked.certify.certified import certify
from wormopt.systems.spiked.design.optimize import designed
from wormopt.systems.spiked.gait_problem import Search

ACCURACIES = (0.1, 0.03, 0.01, 0.003)
"""Distances from the bound, as parts of it."""


_SEED = 1
_ABOVE = 1e-6  # beyond the ceiling by more, a speed is wrong
# Bounds are sharp enough at this gap, and may take so many times what a solver may. An accuracy is
# judged where the gap is below this part of it.
_GAP, _PROOF_TIME, _SHARP = 1e-3, 4.0, 0.5

Solver = Callable[[Case, float], Course]


@dataclass(frozen=True)
class Bound:
    """Upper bounds on the speed of gaits of a problem."""

    speed: float  # certified: no gait is faster
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


def measured(_name: str, quick: bool, report: Report) -> Iterator[Found]:
    """Measure all solvers on the problems posed."""
    for known in measure_design(posed(quick=quick), 4.0 if quick else 30.0, report):
        yield described(known)


def posed(*, quick: bool) -> list[Case]:
    """The benchmark problem, and seeded random ones; fewer of them if `quick`."""
    return [G1, *drawn(_SEED, 3 if quick else 12)]


def certified_bound(case: Case, seconds: float) -> Bound:
    """Bound on the speed of any gait, sharp where the time is enough for that.

    `seconds` covers the design and the proof.
    """
    found = designed(task_of(case), Search(time_limit=seconds), silent)
    proof = certify(found, _GAP, seconds)
    return Bound(proof.bound, max(proof.gap, 0.0), found.ceiling)


def by_design(case: Case, seconds: float) -> Course:
    """The designer of the package, in one process as its rivals; its coarse gaits count too."""
    begin, course = perf_counter(), Course()

    def better(speed: float) -> None:
        course.append((perf_counter() - begin, speed))

    settings = Search(time_limit=seconds, workers=1)
    found = designed(task_of(case), settings, silent, better=lambda trial: better(trial.value))
    better(found.speed)
    return course


SOLVERS: dict[str, Solver] = {
    OWN: by_design,
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
                attempt.failure = why(error)
            known.append(attempt)
            yield known


def bounds(known: Sequence[Attempt]) -> dict[str, float]:
    """By problem the certified bound, or the run's best speed if a wrong one is faster."""
    found: dict[str, float] = {}
    for attempt in known:
        best = max(attempt.best, attempt.bound.speed)
        found[attempt.problem] = max(best, found.get(attempt.problem, 0.0))
    return found


def described(known: Sequence[Attempt]) -> Found:
    """Lay out what was measured for JSON, times summed up by accuracy, then by solver."""
    most = bounds(known)
    attempts = [
        asdict(a)
        | {
            "bound": most[a.problem],
            "certified": a.bound.speed,
            "gap": finite(a.bound.gap),
            "ceiling": a.bound.ceiling,
            "best": a.best,
            "wrong": a.wrong,
        }
        for a in known
    ]
    reached, ratios = [], []
    for accuracy in ACCURACIES:
        told = [a for a in known if a.bound.gap <= _SHARP * accuracy]  # enough to tell
        medians: dict[str, float] = {}
        for solver in dict.fromkeys(a.solver for a in told):
            times = [a.time_to(accuracy, most[a.problem]) for a in told if a.solver == solver]
            medians[solver] = median_high(times)  # inf where most were not solved so well
            share = sum(map(math.isfinite, times)) / len(times)
            reached.append({"solver": solver, "accuracy": accuracy, "share": share,
                            "time_s": finite(medians[solver]), "problems": len(times)})  # fmt: skip
        own = medians.pop(OWN, math.inf)
        fastest = min(medians.values(), default=math.inf)
        ratio = own / fastest if math.isfinite(fastest) else math.inf
        ratios.append({"accuracy": accuracy, "ratio": finite(ratio)})
    return {"attempts": attempts, "reached": reached, "ratios": ratios}


# -- telling -------------------------------------------------------------------------------------


def ratios(found: Mapping[str, Any]) -> dict[str, float]:
    """Our time over that of the fastest other solver, by accuracies."""
    return {
        f"fastest other, within {entry['accuracy']:.1%}": entry["ratio"]
        for entry in found["ratios"]
        if entry["ratio"]
    }


def lines(found: Mapping[str, Any]) -> list[str]:
    """Times to come near the bound in a table, failures and wrong speeds."""
    solvers = list(dict.fromkeys(r["solver"] for r in found["reached"]))
    rows = [("within", "problems", *solvers, "ours/theirs")]
    for entry in found["ratios"]:
        told = [r for r in found["reached"] if r["accuracy"] == entry["accuracy"]]
        if not told:  # no bound is so sharp
            continue
        cells = [f"{seconds(r['time_s'], 'not reached')}, {r['share']:.0%}" for r in told]
        ratio = "" if entry["ratio"] is None else f"{entry['ratio']:.3g}"
        rows.append((f"{entry['accuracy']:.1%}", str(told[0]["problems"]), *cells, ratio))
    count = len({a["problem"] for a in found["attempts"]})
    text = [f"design: {count} problems, median time and share that came so near", *aligned(*rows)]
    text.append("  of the problems whose certified bound is sharp enough to tell")
    for a in found["attempts"]:
        if a["wrong"] or a["failure"]:
            fast = f"speed {a['best']:.9g} above the ceiling {a['ceiling']:.9g}"
            text.append(f"  {a['solver']} on {a['problem']}: {a['failure'] or fast}")
    return text


def draw(found: Mapping[str, Any], path: Path) -> None:
    """Draw the best gait's distance from the bound over time, to a PNG file.

    It shows all problems, and the median.
    """
    figure, left = axes("time (s)", "distance of the speed from its bound")
    attempts = found["attempts"]
    last = max((seconds for a in attempts for seconds, _ in a["course"]), default=1.0)
    times = np.geomspace(1e-2, max(last, 1.0), 400)
    for k, solver in enumerate(dict.fromkeys(a["solver"] for a in attempts)):
        gaps = np.array([_gaps(a, times) for a in attempts if a["solver"] == solver])
        left.plot(times, gaps.T, color=colour(k), linewidth=0.5, alpha=0.4)
        middle = np.quantile(gaps, 0.5, axis=0, method="higher")
        width = 2.6 if solver == OWN else 1.6
        left.plot(times, middle, color=colour(k), linewidth=width, label=solver)
    left.set_ylim(1e-5, 1.1)
    save(figure, path, "design: median over the problems, each of them thin")


def _gaps(attempt: Found, times: np.ndarray) -> np.ndarray:
    speeds = np.zeros_like(times)
    for since, speed in attempt["course"]:
        speeds[times >= since] = speed
    bound = attempt["bound"]
    return np.maximum(1 - speeds / bound, 1e-5) if bound > 0 else np.ones_like(times)
