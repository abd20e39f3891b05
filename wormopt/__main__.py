"""``wormopt`` and ``python -m wormopt``."""

import os
import sys

# Matrices are small, and parallel work uses processes: threads of linear algebra libraries would
# wait for each other, on a busy machine a hundred times as long as the work takes. Users may set
# more.
_THREADS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def one_thread() -> None:
    """Set the libraries to one thread, before they are loaded, unless the user chose a number."""
    for name in _THREADS:
        os.environ.setdefault(name, os.environ.get("OMP_NUM_THREADS", "1"))


def start() -> int:
    """Run the command line of the process; Ctrl-C is no error, even during imports."""
    one_thread()
    try:
        from wormopt.cli import main

        return main()
    except KeyboardInterrupt:
        return 130


if __name__ == "__main__":
    sys.exit(start())
