"""``wormopt`` and ``python -m wormopt``."""

import os
import sys

# Matrices here are small, and work goes side by side in processes: threads of the libraries of
# linear algebra would wait for each other, on a busy machine for a hundred times as long as the
# work takes. Who wants them says so.
_THREADS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def one_thread() -> None:
    """Ask the libraries for one thread, unless the user has asked; before they are loaded."""
    for name in _THREADS:
        os.environ.setdefault(name, os.environ.get("OMP_NUM_THREADS", "1"))


def start() -> int:
    """Run the command line of the process; also while it is loaded, Ctrl-C is no error."""
    one_thread()
    try:
        from wormopt.cli import main

        return main()
    except KeyboardInterrupt:
        return 130


if __name__ == "__main__":
    sys.exit(start())
