"""Exit codes, and how the command line speaks."""

import sys

DONE, BAD_INPUT, NOT_SOLVED, INTERRUPTED = 0, 2, 3, 130


def say(text: str) -> None:
    """Tell the user something that is no result."""
    print(text, file=sys.stderr)
