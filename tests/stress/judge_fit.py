"""Fits judged on recordings made by scipy alone: do intervals hold the truth, do searches end well?

`python -m tests.stress.judge_fit 200 FILE` fits as many drawn worms and writes a line of JSON for
each; `python -m tests.stress.judge_fit FILE` summarises such lines. With the word `design` in
front, worms with spikes get gaits that were designed on their fits.
"""

import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

import wormopt as wo
from tests.oracles.by_crawling import Crawler, FastGait, recorded
from tests.oracles.by_recordings import (
    Array,
    Course,
    Ground,
    Seen,
    chain,
    disturb,
    follow,
    smooth_waves,
    square,
)
from tests.stress.judge_many import judged
from wormopt.systems.spiked import Believed, Search, design_believed, driven_worm, on_plant

MASS, START = np.array([1.0, 0.8, 1.1]), np.array([3.0, 1.5, 0.0])
# Numbers that are sought: where the truth is drawn from, and the bounds of the search.
SOUGHT = {
    "stiffness[0]": (15.0, 40.0, 1.0, 400.0),
    "stiffness[1]": (15.0, 40.0, 1.0, 400.0),
    "damping[0]": (1.0, 4.0, 0.05, 40.0),
    "damping[1]": (1.0, 4.0, 0.05, 40.0),
    "rest_length[0]": (1.3, 1.7, 0.2, 9.0),
    "rest_length[1]": (1.3, 1.7, 0.2, 9.0),
    "forward": (0.4, 1.2, 0.04, 12.0),
    "backward": (2.0, 6.0, 0.2, 60.0),
}
TIED = {"forward": "friction_forward", "backward": "friction_backward"}


@dataclass(frozen=True)
class Draw:
    """A worm, how it was driven, and what was seen of it."""

    truth: dict[str, float]
    course: Course
    seen: Seen
    noise: float


def draw(seed: int, *, end: float = 10.0, rate: float = 100.0, noise: float = 0.0) -> Draw:
    """Three masses whose links are pushed at random amplitudes, period and phase."""
    rng = np.random.default_rng([2024, seed])
    truth = {name: float(rng.uniform(low, high)) for name, (low, high, *_) in SOUGHT.items()}
    period, phase = rng.uniform(0.8, 2.0), rng.uniform(0.0, 1.0, 2)
    amplitude = rng.uniform(6.0, 12.0, 2)
    if rng.random() < 0.5:
        course = smooth_waves(period, np.zeros(2), amplitude, phase)
    else:
        course = square(period, -amplitude, amplitude, np.round(phase, 2))
    noise = noise or float(10 ** rng.uniform(-2.5, -1.5))
    times = np.arange(round(end * rate) + 1) / rate
    c, d, rest = (
        np.array([truth[f"{name}[{k}]"] for k in (0, 1)])
        for name in ("stiffness", "damping", "rest_length")
    )
    worm = chain(MASS, c, d, rest, [Ground(truth["forward"], truth["backward"])] * 3, course)
    seen = follow(worm, times, START, np.zeros(3), exact=1e-10)
    return Draw(truth, course, disturb(seen, {"position": noise}, seed), noise)


def task_of(drawn: Draw, begin: Mapping[str, float], **more: Any) -> wo.FitTask:
    """The fit of all eight numbers, begun somewhere; noise is to be estimated."""
    worm = wo.chain(
        2, mass=MASS, stiffness=20.0, damping=2.0, rest_length=1.5, law=wo.Coulomb(1.0, 3.0),
        position=START,
    )  # fmt: skip
    model = wo.drive(worm, wo.Gait(drawn.course.breaks, drawn.course.coefficients), periodic=True)
    unknowns = [
        wo.Unknown(name, TIED.get(name), lower=low, upper=high, start=begin[name], log=True)
        for name, (*_, low, high) in SOUGHT.items()
    ]
    known = {"position": START, "velocity": np.zeros(3)}
    recording = wo.Recording(drawn.seen.time, dict(drawn.seen.values), x0=known)
    return wo.FitTask(model, [recording], unknowns, **more)


def wrong_start(drawn: Draw, factor: float, seed: int) -> dict[str, float]:
    """Truth times random factors up to the one given, up or down."""
    rng = np.random.default_rng([7, seed])
    reach = np.log(factor) * rng.uniform(-1, 1, len(drawn.truth))
    wrong = {name: v * float(np.exp(r)) for (name, v), r in zip(drawn.truth.items(), reach)}  # noqa: B905
    return {name: float(np.clip(v, *SOUGHT[name][2:])) for name, v in wrong.items()}


def judge(seed: int, factor: float = 5.0) -> dict[str, Any]:
    """One drawn worm: fitted from a wrong start, and from the truth for comparison."""
    drawn = draw(seed)
    true = np.log([drawn.truth[name] for name in SOUGHT])
    clock = time.perf_counter(), time.process_time()
    found = wo.fit(task_of(drawn, wrong_start(drawn, factor, seed)))
    spent = time.perf_counter() - clock[0], time.process_time() - clock[1]
    best = wo.fit(task_of(drawn, drawn.truth), seeds=1)
    return {
        "seed": seed,
        "events": len(drawn.seen.events),
        "noise": drawn.noise,
        "noise_found": found.noise["position"],
        "seconds": spent[0],
        "cpu": spent[1],
        "converged": found.converged,
        "reason": found.reason,
        "score": _scores(found, true).tolist(),
        "score_of_best": _scores(best, true).tolist(),
        "best_converged": best.converged,
        "apart": float(np.max(np.abs(found.theta - best.theta) / _errors(best))),
        "sum_of_squares": [_squares(fit, drawn) for fit in (found, best)],
    }


def _errors(fit: wo.Fit) -> Array:
    return np.sqrt(np.diag(fit.covariance))


def _scores(fit: wo.Fit, true: Array) -> Array:
    """By how many standard errors the truth is off."""
    return (true - fit.theta) / _errors(fit)


def _squares(fit: wo.Fit, drawn: Draw) -> float:
    """Mean square of the residuals over the true noise."""
    (run,) = fit.task.split(fit.residuals).values()
    return float(np.nanmean(run["position"] ** 2)) * (fit.noise["position"] / drawn.noise) ** 2


def told(lines: list[dict[str, Any]]) -> dict[str, Any]:
    """What lines of `judge` say together."""
    good = [line for line in lines if line["apart"] < 0.1]
    owned = [line for line in lines if line["apart"] >= 0.1 and not line["converged"]]
    lied = [line for line in lines if line["apart"] >= 0.1 and line["converged"]]
    score = np.abs([line["score"] for line in lines if line["converged"]])
    return {
        "draws": len(lines),
        "held by 95 % intervals": float(np.mean(score < 1.96)),
        "of each": dict(zip(SOUGHT, np.mean(score < 1.96, axis=0).round(3).tolist(), strict=True)),
        "the same begun at the truth": float(
            np.mean(np.abs([line["score_of_best"] for line in lines]) < 1.96)
        ),
        "ended at the best fit": len(good) / len(lines),
        "or said that they did not": (len(good) + len(owned)) / len(lines),
        "ended elsewhere unsaid": [line["seed"] for line in lied],
        "better than begun at the truth": [
            line["seed"] for line in lines
            if line["sum_of_squares"][0] < line["sum_of_squares"][1] * (1 - 1e-6)
        ],
        "seconds, median and most": np.quantile(
            [line["seconds"] for line in lines], [0.5, 1.0]
        ).round(2).tolist(),
        "processor seconds": np.quantile(
            [line["cpu"] for line in lines], [0.5, 1.0]
        ).round(2).tolist(),
        "noise found over true": np.quantile(
            [line["noise_found"] / line["noise"] for line in lines], [0.025, 0.5, 0.975]
        ).round(4).tolist(),
    }  # fmt: skip


# -- fit, design on the fit, trial on the worm as it is --------------------------------------------

LIMITS = wo.Limits(
    period=1.0, length=(0.7, 1.3), rate=1.0, acceleration=20.0, spike_load=27.0
)  # fmt: skip
CRAWL, GAUGES, CONFIDENCE = FastGait(2.0), 0.2, 0.9999
ORDER = Search(sequence=((0,), (2,), (1,)), workers=1)


def judge_design(seed: int) -> dict[str, Any]:
    """One drawn worm with spikes: its gait by what a crawl told, tried on the worm itself."""
    rng = np.random.default_rng([99, seed])
    mass, drag, load = rng.uniform(0.7, 1.4, 3), rng.uniform(0.0, 0.8), rng.uniform(4.5, 6.0)
    seen = recorded(Crawler(CRAWL, mass, drag, load), GAUGES, seed)
    clock = time.process_time()
    model = driven_worm(wo.fast_gait(CRAWL.period, CRAWL.rest_length), (1.0,) * 3, 0.3, 5.0)
    span = (0.0, float(seen.time[-1]))
    recording = wo.Recording(seen.time, dict(seen.values), span=span)
    found = wo.fit(wo.FitTask(model, [recording], [wo.Unknown(n) for n in _NAMES]))
    numbers = found.values
    freedom = found.task.count - len(numbers)
    mass_found = tuple(numbers[:3].tolist())
    drag_found, load_found = numbers[3:].tolist()
    believed = Believed.of_one_load(mass_found, drag_found, load_found, found.covariance, freedom)
    robust = design_believed(believed, LIMITS, confidence=CONFIDENCE, search=ORDER)
    spent = time.process_time() - clock
    plant = wo.Worm(2, tuple(mass.tolist()), drag, load)
    best = wo.design(plant, LIMITS, search=ORDER)
    motion, bold = on_plant(robust.design, plant), on_plant(robust.nominal, plant)
    return {
        "seed": seed,
        "converged": found.converged,
        "cpu": spent,
        "distance": believed.distance(np.array([*mass, drag, load, load, load])),
        "reach": robust.reach,
        "widths": robust.widths,
        "spike_load": float(motion.extremes("reaction")[1].max()),
        "spike_load_bold": float(bold.extremes("reaction")[1].max()),
        "glides": [len(motion.glides), len(bold.glides)],
        "speed": motion.speed,
        "best": best.speed,
    }


_NAMES = ("mass", "drag", "load")


def told_of_designs(lines: list[dict[str, Any]]) -> dict[str, Any]:
    """What lines of `judge_design` say together."""
    shares = [line["speed"] / line["best"] for line in lines]
    return {
        "draws": len(lines),
        "keep the spike limit": sum(line["spike_load"] <= 27.0 for line in lines),
        "never glide": sum(line["glides"][0] == 0 for line in lines),
        "largest spike load": max(line["spike_load"] for line in lines),
        "would break it by trusting the fit": sum(
            line["spike_load_bold"] > 27.0 or line["glides"][1] > 0 for line in lines
        ),
        "speed over that of the gait designed with the true numbers: least, median, most": (
            np.quantile(shares, [0, 0.5, 1]).round(4).tolist()
        ),
        "distance of the truth, most": max(line["distance"] for line in lines),
        "processor seconds, median": float(np.median([line["cpu"] for line in lines])),
    }


def main() -> None:
    """Judge, or tell of what was judged."""
    *asked, file = sys.argv[1:]
    count = sum(int(word) for word in asked if word.isdecimal())
    judged(file, count, *((judge_design, told_of_designs) if "design" in asked else (judge, told)))


if __name__ == "__main__":
    main()
