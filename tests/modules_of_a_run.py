"""Count the modules of the package that a run goes through, from its scene to its Result.

python tests/modules_of_a_run.py design_fast_gait fig05_lambda_trackers
"""

import sys
import threading
from types import FrameType
from typing import Any

import wormopt as wo


def modules_of(name: str) -> list[str]:
    """Modules of which a function is called during the run of a packaged scene."""
    scene, seen = wo.load_scene(name), set[str]()

    def note(frame: FrameType, event: str, _: Any) -> None:
        module = frame.f_globals.get("__name__", "")
        if event == "call" and module.startswith("wormopt") and frame.f_code.co_name != "<module>":
            seen.add(module.removeprefix("wormopt."))

    sys.setprofile(note)
    threading.setprofile(note)
    try:
        wo.run(scene)
    finally:
        sys.setprofile(None)
        threading.setprofile(None)  # pyright: ignore[reportArgumentType]
    return sorted(seen)


if __name__ == "__main__":
    for each in sys.argv[1:]:
        found = modules_of(each)
        print(f"{each}: {len(found)} modules\n  {', '.join(found)}")
