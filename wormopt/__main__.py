"""``wormopt`` and ``python -m wormopt``."""

import gc
import sys

# Commands make few cycles of objects and end soon: to look for them as often as Python does by
# itself is a twentieth of a short run.
_OBJECTS_BETWEEN_LOOKS = 50_000


def start() -> int:
    """Run the command line of the process; also while it is loaded, Ctrl-C is no error."""
    gc.set_threshold(_OBJECTS_BETWEEN_LOOKS)
    try:
        from wormopt.cli import main

        return main()
    except KeyboardInterrupt:
        return 130


if __name__ == "__main__":
    sys.exit(start())
