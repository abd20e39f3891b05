"""Options of `simulate` from the tables of scenes."""

from __future__ import annotations

from wormopt.scene.numerics import ContactTable, SmoothContact, ToleranceTable
from wormopt.simulation.options import Exact, Smooth, Tolerance, Treatment


def treatment_of(contact: ContactTable) -> Treatment:
    """Treatment of contact given in a scene."""
    return Smooth(contact.v_reg) if isinstance(contact, SmoothContact) else Exact()


def tolerance_of(table: ToleranceTable) -> Tolerance:
    """Tolerance given in a scene."""
    return Tolerance(table.relative, table.absolute, table.max_steps, table.max_step)
