"""Makes problems/recordings by scipy's steps and events alone: no code of the package.

python -m tests.make_recordings makes them anew. What they are made with stands below, and in
`truth` of the tests: the scenes must find it again.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from tests.oracles.by_crawling import Crawler, FastGait, recorded
from tests.oracles.by_recordings import Course, Ground, Seen, chain, disturb, follow, pair

HERE = Path(__file__).parents[1] / "problems" / "recordings"

CHAIN = {
    "stiffness[0]": 62.0, "stiffness[1]": 47.0, "damping[0]": 1.3, "damping[1]": 0.8,
    "rest_length[0]": 0.0615, "rest_length[1]": 0.0580, "forward": 0.17, "backward": 0.55,
}  # fmt: skip
CHAIN_MASS, CHAIN_START, CHAIN_NOISE = (0.30, 0.25, 0.30), (0.12, 0.06, 0.0), 3e-4
PAIR = {"damping": 0.012, "forward": 0.5 * 0.036, "backward": 1.0 * 0.036}
PAIR_PUSH, PAIR_NOISE = 0.036, 0.01
CRAWL, CRAWL_NOISE = Crawler(FastGait(2.0), np.array([1.1, 0.9, 1.3]), 0.5, 5.3), 0.2
FILM_MASS, FILM_PIXEL, FILM_FRAME = (0.20, 0.15, 0.20), 2e-4, 0.02
FILM_GROUND, FILM_START = Ground(0.25, 1.0), (0.30, 0.15, 0.0)


def lines(time: np.ndarray, rows: np.ndarray) -> Course:
    """Course on straight lines between samples (n, m)."""
    slope = np.diff(rows) / np.diff(time)
    return Course(time, np.stack([rows[:, :-1].T, slope.T], axis=2), periodic=False)


def crawling(end: float, period: float, lag: float, seed: int) -> tuple[Seen, np.ndarray]:
    """A worm of three masses pushed by measured forces; positions in metres, forces in newton."""
    time = np.round(np.arange(0.0, end + 1e-9, 0.02), 9)
    turn = 2 * np.pi * time / period
    force = np.round([1.1 * np.sin(turn), 1.0 * np.sin(turn - lag)], 6)
    one = Ground(CHAIN["forward"], CHAIN["backward"])
    springs = [
        np.array([CHAIN[f"{name}[{k}]"] for k in range(2)])
        for name in ("stiffness", "damping", "rest_length")
    ]
    stiffness, damping, rest = springs
    worm = chain(np.array(CHAIN_MASS), stiffness, damping, rest, [one] * 3, lines(time, force))
    seen = follow(worm, time, np.array(CHAIN_START), np.zeros(3))
    return disturb(seen, {"position": CHAIN_NOISE}, seed, gaps=0.02), force


def filmed(seed: int) -> str:
    """What a tracking program writes of a worm of three masses that is let go with long links."""
    time = FILM_FRAME * np.arange(76)
    none = lines(time, np.zeros((2, len(time))))
    spring = np.full(2, 45.0), np.full(2, 0.5), 0.06
    worm = chain(FILM_MASS, *spring, [FILM_GROUND] * 3, none)
    seen = follow(worm, time, np.array(FILM_START), np.zeros(3))
    seen = disturb(seen, {"position": FILM_PIXEL}, seed, gaps=0.05)
    pixels = np.round(seen.values["position"] / FILM_PIXEL, 1)
    rows = [
        ";".join([str(700 + k), *("" if np.isnan(v) else f"{v:.1f}" for v in column)])
        for k, column in enumerate(pixels.T)
    ]
    return "\n".join(["Tracker 6.1", "frame;head;middle;tail", *rows]) + "\n"


def pulsating(end: float, seed: int) -> Seen:
    """The magneto-elastic pair (16), with a dashpot beside its spring."""
    one = Ground(PAIR["forward"], PAIR["backward"])
    body = pair(PAIR_PUSH, np.sqrt(2) + 0.5 * PAIR_PUSH, [one, one], damping=PAIR["damping"])
    time = np.round(np.arange(0.0, end + 1e-9, 0.25), 9)
    seen = follow(body, time, np.zeros(2), np.zeros(2))
    return disturb(seen, {"position": PAIR_NOISE}, seed)


def write(name: str, about: str, columns: Mapping[str, np.ndarray], form: str) -> None:
    """Write a table; NaN as an empty cell."""
    rows = np.stack([*columns.values()], axis=1)
    text = [f"# {about}", ",".join(columns)]
    text += [",".join("" if np.isnan(v) else format(v, form) for v in row) for row in rows]
    (HERE / name).write_text("\n".join(text) + "\n", encoding="utf-8")


def main() -> None:
    """Make all of them."""
    HERE.mkdir(exist_ok=True)
    about = "synthetic: equations (9), (10) by scipy's DOP853 with events, tests/make_recordings.py"
    for name, numbers in (("a", (8.0, 1.0, 2.0, 11)), ("b", (5.0, 0.7, 1.2, 12))):
        seen, force = crawling(*numbers)
        x = 1e3 * seen.values["position"]
        columns = {"time [s]": seen.time, **{f"x{k} [mm]": x[k] for k in range(3)}}
        columns |= {f"u{k} [N]": force[k] for k in range(2)}
        write(f"chain_{name}.csv", about, columns, ".7g")
    (HERE / "film.csv").write_text(filmed(21), encoding="utf-8")
    seen = pulsating(80.0, 3)
    about = "synthetic: equation (16) by scipy's DOP853 with events, tests/make_recordings.py"
    columns = {"time": seen.time, **{f"position[{k}]": seen.values["position"][k] for k in (0, 1)}}
    write("pair.csv", about, columns, ".6g")
    seen = recorded(CRAWL, CRAWL_NOISE, 5)
    about = "synthetic: (3), (7), (15) by scipy's DOP853 with events, tests/make_recordings.py"
    columns = {f"mu{k}": seen.values["actuator_force"][k] for k in (0, 1)}
    write("crawl.csv", about, {"time": seen.time, **columns}, ".6g")


if __name__ == "__main__":
    main()
