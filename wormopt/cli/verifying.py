"""``wormopt verify``: check the proof in a certificate, in exact arithmetic."""

from __future__ import annotations

import argparse
from typing import Any

from wormopt.cli.codes import DONE, NOT_SOLVED, say


def add(commands: Any) -> None:
    """Add the command to a parser's."""
    command = commands.add_parser(
        "verify",
        help="verify the certificate of a gait in exact arithmetic",
        description="Check every inequality of a certificate in rational arithmetic. A verified "
        "certificate proves that no gait within the limits it states is faster than its bound. "
        "Exit codes: 0 verified, 3 an inequality does not hold, 2 not a certificate.",
        allow_abbrev=False,
    )
    command.set_defaults(command=_verify)
    command.add_argument("file", metavar="FILE", help="certificate.json of a result")


def _verify(options: argparse.Namespace) -> int:
    from wormopt.systems.spiked.certify.certificate import verify

    found = verify(options.file)
    if not found.holds:
        say(f"{options.file}: not verified: {found.reason}")
        return NOT_SOLVED
    print(
        f"{options.file}: verified: no gait is faster than {found.bound} = "
        f"{float(found.bound):.9g} ({found.inequalities} inequalities hold)"
    )
    return DONE
