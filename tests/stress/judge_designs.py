"""Gait designs at effort normal beside everything that may find a better gait of the same worm.

`python -m tests.stress.judge_designs 25 FILE` designs gaits for as many drawn problems and writes a
line of JSON for each; `python -m tests.stress.judge_designs FILE` summarises such lines. Rivals are
the effort thorough, and designs with the sequences of all of these prescribed. The numbers are read
from results, whose limits and speeds a second route has verified.
"""

import json
import sys
import time
from collections.abc import Iterator
from typing import Any

import numpy as np

import wormopt as wo
from tests.stress.judge_many import judged
from wormopt.errors import SolveError

COSTS = ("peak_spike_load", "peak_actuator_force", "energy_per_distance", "acceleration_effort")
_SEED = 47
_LIMIT = 300.0  # seconds of a search


def draw(number: int) -> dict[str, Any]:
    """Draw a problem of two to six links with limits of every kind; every other one is a cost."""
    rng = np.random.default_rng([_SEED, number])
    n = 2 + number % 5

    def some(low: float, high: float) -> Any:
        """One number for all links, or one for each."""
        drawn = np.round(rng.uniform(low, high, n), 3).tolist()
        return drawn if rng.random() < 0.5 else drawn[0]

    low = round(float(rng.uniform(0.5, 0.9)), 3)
    width, rate = some(0.2, 0.7), some(0.6, 1.8)
    stroke = 2 * float(np.mean(width)) / float(np.mean(rate))
    shortest = round(stroke * float(rng.uniform(0.5, 2.0)), 3)
    longest = round(shortest * float(np.exp(rng.uniform(0.0, np.log(100.0)))), 3)
    load = round(float(rng.uniform(1.0, 8.0)), 3)
    gait: dict[str, Any] = {
        "period": [shortest, longest] if rng.random() < 0.6 else shortest,
        "length": (
            [[low, round(low + w, 3)] for w in width]
            if isinstance(width, list)
            else [low, round(low + width, 3)]
        ),
        "rate": rate,
        "acceleration": some(5.0, 50.0),
        "resting": int(rng.integers(1, n + 1)) if rng.random() < 0.4 else 1,
    }
    if rng.random() < 0.3:
        gait["spike_load"] = round((n + 1) * load * float(rng.uniform(1.2, 3.0)), 3)
    if rng.random() < 0.3:
        gait["actuator_force"] = round((n + 1) * load * float(rng.uniform(1.2, 4.0)), 3)
    worm = {
        "links": n,
        "mass": np.round(rng.uniform(0.5, 2.0, n + 1), 3).tolist() if rng.random() < 0.4 else 1.0,
        "drag": round(float(rng.uniform(0.05, 5.0)), 3) if rng.random() < 0.4 else 0.0,
        "load": load,
    }
    aim = COSTS[number // 2 % len(COSTS)] if number % 2 else None
    return {"worm": worm, "gait": gait, "cost": aim}


def designed(drawn: dict[str, Any], effort: str, **search: Any) -> tuple[float, list[Any], float]:
    """Objective, to be large; sequences that came near it; and processor seconds.

    On a busy machine the time limit ends searches early: let nothing else run.
    """
    begun = time.process_time()
    tables = {
        "schema": 1, "kind": "gait-design", "worm": drawn["worm"], "gait": drawn["gait"],
        "objective": drawn["objective"],
        "search": {"effort": effort, "workers": 1, "time_limit": _LIMIT} | search,
    }  # fmt: skip
    try:
        result = wo.run(wo.load_scene(tables))
    except SolveError:
        return -np.inf, [], time.process_time() - begun
    if result.status != "ok":
        return -np.inf, [], time.process_time() - begun
    sign = -1.0 if "minimise" in drawn["objective"] else 1.0
    tried = [each["sequence"] for each in result.trust["search"].get("best", [])]
    return sign * result.scalars["objective"].value, tried, time.process_time() - begun


def judge(number: int) -> dict[str, Any]:
    """One problem: what effort normal loses to the best of its rivals, relative."""
    drawn = draw(number)
    drawn["objective"] = {"maximise": "speed"}
    fastest = designed(drawn, "quick")[0]
    if not np.isfinite(fastest):
        return {"number": number, "problem": drawn, "refused": True}
    if drawn["cost"]:
        drawn["objective"] = {"minimise": drawn["cost"], "speed": float(f"{0.6 * fastest:.3g}")}
    own, tried, spent = designed(drawn, "normal")
    best, more, thorough = designed(drawn, "thorough")
    rivals = {"thorough": best}
    prescribed = 0.0
    for sequence in _different([*tried, *more]):
        rivals[json.dumps(sequence)], _, each = designed(drawn, "normal", sequence=sequence)
        prescribed += each
    rival = max(rivals, key=lambda name: rivals[name])
    lost = (rivals[rival] - own) / abs(own) if np.isfinite(own) else float(np.isfinite(best))
    return {
        "number": number, "links": drawn["worm"]["links"], "objective": drawn["objective"],
        "own": own, "rival": rival, "best": rivals[rival], "lost": lost,
        "cpu": {"normal": spent, "thorough": thorough, "prescribed": prescribed},
        "problem": drawn,
    }  # fmt: skip


def _different(sequences: list[Any]) -> Iterator[Any]:
    seen = set[str]()
    for sequence in sequences:
        if json.dumps(sequence) not in seen:
            seen.add(json.dumps(sequence))
            yield sequence


def summary(lines: list[dict[str, Any]]) -> dict[str, Any]:
    """What lines of `judge` say together."""
    judged = [line for line in lines if "lost" in line]
    worst = max(judged, key=lambda line: line["lost"])
    return {
        "problems": len(judged),
        "without any gait": len(lines) - len(judged),
        "largest loss, relative": worst["lost"],
        "of problem": worst["number"],
        "to": worst["rival"],
        "losses above 0.1 %": [line["number"] for line in judged if line["lost"] > 1e-3],
        "processor seconds at effort normal, median and most": np.quantile(
            [line["cpu"]["normal"] for line in judged], [0.5, 1.0]
        ).round(1).tolist(),
        "processor hours": round(sum(sum(line["cpu"].values()) for line in judged) / 3600, 2),
    }  # fmt: skip


def main() -> None:
    """Judge, or summarise what was judged."""
    *asked, file = sys.argv[1:]
    judged(file, int(asked[0]) if asked else 0, judge, summary)


if __name__ == "__main__":
    main()
