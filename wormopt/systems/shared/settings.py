"""Options of `simulate` from the tables of scenes."""

from __future__ import annotations

from wormopt.simulation.options import Tolerance, Treatment
from wormopt.study.numerics import ContactTable, ToleranceTable


def treatment_of(contact: ContactTable) -> Treatment:
    """Treatment of contact given in a scene."""
    return contact.options


def tolerance_of(table: ToleranceTable) -> Tolerance:
    """Tolerance given in a scene."""
    return table.options
