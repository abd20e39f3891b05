"""Command lines of `tests.benchmarks` and `tests.stress`."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping


def parser(
    module: str, names: Mapping[str, str], text: str, columns: str, quick: str
) -> argparse.ArgumentParser:
    """Make the parser of a module that measures what `names` describes."""
    wide = max(map(len, names)) + 2
    found = argparse.ArgumentParser(
        prog=f"python -m {module}",
        description=text + "".join(f"\n  {name:{wide}}{what}" for name, what in names.items()),
        epilog=columns,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    found.add_argument(
        "names",
        metavar="NAME",
        nargs="*",
        type=_one_of(names),
        help="what to run, in any letter case (default: all)",
    )
    found.add_argument("--quick", action="store_true", help=quick)
    found.add_argument("--json", action="store_true", help="print one JSON object on stdout")
    found.add_argument("--quiet", action="store_true", help="show no progress")
    return found


def _one_of(names: Mapping[str, str]) -> Callable[[str], str]:
    def name(text: str) -> str:
        if text.lower() not in names:
            raise argparse.ArgumentTypeError(f"there is no {text}; write one of {', '.join(names)}")
        return text.lower()

    return name
