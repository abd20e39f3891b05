"""Options of `simulate` from the tables of scenes."""

from __future__ import annotations

from wormopt.simulation.options import Exact, Smooth, Tolerance, Treatment
from wormopt.study.numerics import ContactTable, SmoothContact, ToleranceTable


def treatment_of(contact: ContactTable) -> Treatment:
    """Treatment of contact given in a scene."""
    return Smooth(contact.v_reg) if isinstance(contact, SmoothContact) else Exact()


def tolerance_of(table: ToleranceTable) -> Tolerance:
    """Tolerance given in a scene."""
    return Tolerance(table.relative, table.absolute, table.max_steps, table.max_step)
