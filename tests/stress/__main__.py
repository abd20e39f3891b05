"""``python -m tests.stress``: run groups of the stress matrix and print what became of them."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence

from tests.benchmarks.command import parser
from tests.stress import GROUPS
from wormopt.__main__ import one_thread
from wormopt.cli.common import DONE, INTERRUPTED, NOT_SOLVED
from wormopt.progress import shown_on_stderr

_TEXT = """\
Compute about 2,000 random cases with fixed seeds, many of them extreme, and compare each
answer with a method that shares no code with it. All cases take about seven minutes on
two idle processors; --quick runs a few of each group.

groups, and the method that each is compared with:"""
_COLUMNS = """\
columns of the table, by kind of case:
  right      as accurate as the floating-point precision allows
  refused    ended with an error that says what to change
  undecided  the other method fails, or no answer can be established
  wrong      any other answer; the exit code is 3 if there is one, if an ordinary case
             is not right, or if fewer than nine tenths are right"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line (by default of the process) and return the exit code."""
    one_thread()
    command = parser("tests.stress", GROUPS, _TEXT, _COLUMNS, "run only a few cases of each group")
    options = command.parse_args(arguments)
    from tests.stress.matrix import stress, summary, table

    verdicts, code = [], DONE
    groups = list(dict.fromkeys(options.names))
    try:
        with shown_on_stderr(options.quiet) as report:
            for verdict in stress(groups, quick=options.quick, report=report):
                verdicts.append(verdict)  # noqa: PERF402  one by one: it may be interrupted
    except KeyboardInterrupt:
        code = INTERRUPTED
    complete = code == DONE
    found = summary(verdicts, complete=complete)
    print(json.dumps(found) if options.json else table(verdicts, complete=complete))
    return NOT_SOLVED if complete and not found["passed"] else code


if __name__ == "__main__":
    sys.exit(main())
