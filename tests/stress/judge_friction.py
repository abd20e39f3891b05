"""Worms on dry ground, from films to gaits: drawn, filmed, fitted, designed for, and played again.

`python -m tests.stress.judge_friction 20 FILE` judges as many drawn worms and writes a line of JSON
for each; `python -m tests.stress.judge_friction FILE` summarises such lines. Films and motions are
scipy's.
"""

import sys
import tempfile
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import wormopt as wo
from tests.oracles.by_gliding import Lengths, Played, Rubbing, play
from tests.oracles.by_recordings import Array, Course, Ground, chain, disturb, follow
from tests.stress.judge_many import judged
from wormopt.study.scene import scene_within
from wormopt.systems.spiked import Search

PIXEL, FRAME = 2e-4, 0.02
REST = 0.06
# Limits of the gait; the ground then gives way before the links are as fast as they may be.
GAIT = {
    "period": [0.5, 3.0], "length": [0.045, 0.075], "rate": 0.15, "acceleration": 8.0,
    "actuator_force": 3.0,
}  # fmt: skip


@dataclass(frozen=True)
class Drawn:
    """A worm, and whether it is pushed by known forces or let go."""

    links: int
    mass: Array
    stiffness: float
    damping: float
    forward: float
    backward: float
    drag: float
    pushed: bool  # masses and drag are then unknown, too

    @property
    def rubbing(self) -> Rubbing:
        """The worm for the oracle."""
        forward, backward = (np.full(self.links + 1, f) for f in (self.forward, self.backward))
        return Rubbing(self.mass, self.drag, forward, backward, 0 * forward)


def draw(seed: int) -> Drawn:
    """Draw a worm of one or two links."""
    rng = np.random.default_rng([63, seed])
    links = 1 + seed % 2
    forward = rng.uniform(0.15, 0.4)  # backward, more than what moves forward at the same time
    return Drawn(
        links, rng.uniform(0.15, 0.3, links + 1), rng.uniform(30.0, 60.0), rng.uniform(0.3, 0.8),
        forward, forward * rng.uniform(3.0, 6.0), rng.uniform(0.1, 0.5) * (seed % 4 > 1),
        seed % 4 > 1,
    )  # fmt: skip


def film(worm: Drawn, folder: Path, seed: int) -> dict[str, Any]:
    """Write what a tracking program says of a run; returns the scene of the fit."""
    rng, n = np.random.default_rng([64, seed]), worm.links
    each = np.ones(n)
    end = 10.0 if worm.pushed else 1.2
    times = FRAME * np.arange(round(end / FRAME) + 1)
    push = np.zeros((n, len(times)))
    if worm.pushed:
        turn = 2 * np.pi * times / rng.uniform(0.5, 0.8)
        push = np.round([rng.uniform(1.2, 2.0) * np.sin(turn - 1.3 * j) for j in range(n)], 4)
    slope = np.diff(push) / FRAME
    course = Course(times, np.stack([push[:, :-1].T, slope.T], axis=2), periodic=False)
    start = np.cumsum(np.append(0.0, -REST * each if worm.pushed else -0.15 * each))
    start -= start[-1]
    body = chain(
        worm.mass, worm.stiffness * each, worm.damping * each, REST,
        [Ground(worm.forward, worm.backward)] * (n + 1), course, drag=worm.drag,
    )  # fmt: skip
    seen = follow(body, times, start, np.zeros(n + 1))
    seen = disturb(seen, {"position": PIXEL}, seed, gaps=0.05)
    pixels = np.round(seen.values["position"] / PIXEL, 1)
    names = [f"spot {i}" for i in range(n + 1)] + [f"force {j}" for j in range(n)]
    rows = [
        ";".join([str(700 + k), *("" if np.isnan(v) else f"{v}" for v in (*column, *force))])
        for k, (column, force) in enumerate(zip(pixels.T, push.T, strict=True))
    ]
    text = "\n".join(["Tracker 6.1", ";".join(["frame", *names]), *rows])
    (folder / "film.csv").write_text(text + "\n")
    columns = {f"spot {i}": f"position[{i}]" for i in range(n + 1)}
    columns |= {f"force {j}": f"input[{j}]" for j in range(n)} if worm.pushed else {}
    unknown: list[dict[str, Any]] = [
        {"name": "forward", "targets": "friction_forward", "lower": 0.01, "upper": 5.0},
        {"name": "backward", "targets": "friction_backward", "lower": 0.01, "upper": 5.0},
        {"name": "stiffness", "targets": "stiffness", "lower": 5.0, "upper": 300.0},
        {"name": "damping", "targets": "damping", "lower": 0.05, "upper": 5.0},
    ]
    mass = worm.mass.tolist()
    if worm.pushed:
        mass = 0.2
        unknown += [{"name": "mass", "lower": 0.05, "upper": 1.0}]
        unknown += [{"name": "drag", "targets": "drag", "lower": 0.0, "upper": 3.0}]
    recording = {
        "file": "film.csv",
        "time": "frame",
        "columns": columns,
        "units": {"frame": f"{FRAME} s"} | {f"spot {i}": f"{PIXEL} m" for i in range(n + 1)},
        "start": {"position": start.tolist(), "velocity": 0.0},
    }
    friction = {"kind": "coulomb", "forward": 0.5, "backward": 0.5}
    chained = {
        "links": n, "mass": mass, "stiffness": 40.0, "damping": 1.0, "rest_length": REST,
        "drag": 0.2 if worm.pushed else 0.0, "friction": friction,
    }  # fmt: skip
    return {
        "kind": "fit",
        "model": {"kind": "simulate", "worm": chained},
        "recording": [recording],
        "unknown": unknown,
    }


def judge(seed: int, folder: Path, **changes: Any) -> dict[str, Any]:
    """One drawn worm: its gait by a film of it, played by the oracle with the true parameters."""
    worm, begun = draw(seed), time.process_time()
    tables = {
        "schema": 1, "kind": "friction-design", "units": "SI", "fit": film(worm, folder, seed),
        "gait": GAIT, "objective": {"maximise": "speed"}, "search": {"effort": "quick"},
    }  # fmt: skip
    result = wo.run(scene_within(folder, "judged", tables), changes)
    number = {name: one.value for name, one in result.scalars.items()}
    limits = wo.Limits(**GAIT)
    spring = worm.stiffness * 0.015 + worm.damping * 0.15
    known = limits.vary(
        spike_load=worm.forward + worm.backward, actuator_force=GAIT["actuator_force"] - spring
    )
    plant = wo.Worm(worm.links, tuple(worm.mass.tolist()), worm.drag, worm.forward)
    best = wo.design(plant, known, search=Search(effort="quick", workers=1))
    own = play(worm.rubbing, lengths_of(best.gait.breaks, best.gait.polynomial))
    mine = play(
        worm.rubbing, lengths_of(result["gait_breaks"].values, result["gait_polynomial"].values)
    )
    names = ("forward", "backward")
    true = {name: getattr(worm, name) for name in names}
    inside = {
        name: number[f"{name}_interval"][0] <= true[name] <= number[f"{name}_interval"][1]
        for name in names
    }
    open_above = number["backward_interval"][1] > 2 * number["backward"]
    return {
        "seed": seed, "links": worm.links, "pushed": worm.pushed, "status": result.status,
        "inside": inside, "open": open_above, "relative": number["forward_error"] / worm.forward,
        "widths": [w / worm.forward for w in number["load_width"]],
        "speed": mine.speed, "told": number["speed"], "best": own.speed, "best_told": best.speed,
        "excess": excess(worm, mine), "cpu": time.process_time() - begun,
    }  # fmt: skip


def lengths_of(breaks: Array, polynomial: Array) -> Lengths:
    """The gait as the oracle wants it."""
    return Lengths(np.asarray(breaks), np.asarray(polynomial))


def excess(worm: Drawn, motion: Played) -> dict[str, float]:
    """By how much a motion exceeds limits, relative to each; slips are in widths of friction."""
    u = (
        worm.stiffness * (motion.length - REST) + worm.damping * motion.rate - motion.link_force
    )  # fmt: skip
    low, high = GAIT["length"]
    return {
        "length": float(max(low - motion.length.min(), motion.length.max() - high) / high),
        "rate": float(np.abs(motion.rate).max() / GAIT["rate"] - 1),
        "acceleration": float(np.abs(motion.acceleration).max() / GAIT["acceleration"] - 1),
        "actuator_force": float(np.abs(u).max() / GAIT["actuator_force"] - 1),
        "slip": motion.slip,
        "unheld": motion.unheld,
    }


def summary(lines: list[dict[str, Any]]) -> dict[str, Any]:
    """What lines of `judge` say together."""
    shares = [line["speed"] / line["best"] for line in lines]
    kept = ("length", "rate", "acceleration", "actuator_force")
    return {
        "films": len(lines),
        "95 % intervals of friction that hold the truth": [
            sum(sum(line["inside"].values()) for line in lines), 2 * len(lines)
        ],
        "backward left open": sum(line["open"] for line in lines),
        "largest excess over a limit": max(
            line["excess"][name] for line in lines for name in kept
        ),
        "largest slip, in widths": max(line["excess"]["slip"] for line in lines),
        "speed over that with the true numbers: least, median, most": (
            np.quantile(shares, [0, 0.5, 1]).round(4).tolist()
        ),
        "processor seconds, median and most": np.quantile(
            [line["cpu"] for line in lines], [0.5, 1.0]
        ).round(1).tolist(),
    }  # fmt: skip


def main() -> None:
    """Judge, or summarise what was judged."""
    *asked, file = sys.argv[1:]
    with tempfile.TemporaryDirectory() as folder:
        judged(file, int(asked[0]) if asked else 0, partial(judge, folder=Path(folder)), summary)


if __name__ == "__main__":
    main()
