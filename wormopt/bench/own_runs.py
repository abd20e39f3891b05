"""Runs of one version of wormopt, as a process that is told by lines what to run.

`wormopt bench --against` starts it for every version, with that version first on the path. It
takes nothing from this version but this file, and therefore asks what each version has.

A line in is JSON: {"case": NAME} makes a case ready, {"setting": NUMBER} runs it. A line out:
{"settings": [...], "goal": ...} or {"missing": WHY}; {"seconds": CPU TIME, "error": ...}.
"""

import json
import math
import sys
from importlib import import_module
from time import process_time
from typing import Any

import numpy as np

_TOLERANCES = (1e-6, 1e-8, 1e-10, 1e-12)


def ready(name: str, quick: bool) -> tuple[Any, Any, Any, float]:
    """Make a case ready: what runs it, what tells the error, the settings and the goal."""
    try:
        cases = import_module("wormopt.bench.cases")
        case = cases.WORK_PRECISION[name]
    except KeyError:
        pass
    else:
        run = import_module("wormopt.bench.peers").SOLVERS["wormopt"](case)
        return run, lambda end: np.abs(end - case.reference).max(), _TOLERANCES, cases.GOAL
    task = import_module("wormopt.bench.ladder").task_of(name, quick)
    way = next(way for way in task.ways if way.name == "wormopt")
    return way.make(), task.error, way.settings, task.goal


def main() -> None:
    """Serve until the input ends."""
    answers, sys.stdout = sys.stdout, sys.stderr  # what others print is no answer
    run: Any = None
    error: Any = None
    told: dict[str, Any]
    for line in sys.stdin:
        asked = json.loads(line)
        try:
            if "case" in asked:
                run, error, settings, goal = ready(asked["case"], asked["quick"])
                told = {"settings": list(settings), "goal": goal}
            else:
                begin = process_time()
                found = run(asked["setting"])
                told = {"seconds": process_time() - begin, "error": float(error(found))}
                if not math.isfinite(told["error"]):
                    told["error"] = None
        except Exception as failure:
            told = {"missing": f"{type(failure).__name__}: {str(failure).partition(chr(10))[0]}"}
        print(json.dumps(told), file=answers, flush=True)


if __name__ == "__main__":
    main()
