"""Runs of one version of wormopt, as a process that is told by lines what to run.

``--against`` starts it for every version, with the folder that holds the package. The benchmarks
are those of this checkout.

A line in is JSON: {"case": NAME} makes a case ready, {"setting": NUMBER} runs it. A line out:
{"settings": [...], "goal": ...} or {"missing": WHY}; {"seconds": CPU TIME, "error": ...}.
"""

import json
import math
import sys
from time import process_time
from typing import Any


def ready(name: str, quick: bool) -> tuple[Any, Any, Any, float]:
    """Make a case ready: what runs it, what tells the error, the settings and the goal."""
    from tests.benchmarks.ladder import task_of
    from tests.benchmarks.run import OWN

    task = task_of(name, quick)
    way = next(way for way in task.ways if way.name == OWN)
    return way.make(), task.error, way.settings, task.goal


def main() -> None:
    """Serve until the input ends."""
    sys.path.insert(0, sys.argv[1])
    import wormopt  # noqa: F401  of that folder, and with it all of its modules

    del sys.path[0]
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
