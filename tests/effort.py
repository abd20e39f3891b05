"""How many examples hypothesis tries: all with the slow tests, a third of them in fast runs."""

import os

FULL = "WORMOPT_ALL_EXAMPLES"  # set by conftest.py before a file of tests is read


def examples(full: int) -> int:
    return full if os.environ.get(FULL) else max(full // 3, 2)
