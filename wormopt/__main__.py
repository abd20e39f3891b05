"""``wormopt`` and ``python -m wormopt``."""

import sys


def start() -> int:
    """Run the command line of the process; also while it is loaded, Ctrl-C is no error."""
    try:
        from wormopt.cli import main

        return main()
    except KeyboardInterrupt:
        return 130


if __name__ == "__main__":
    sys.exit(start())
