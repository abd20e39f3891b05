"""Motions of the stress matrix over dry ground in the plane, judged as those of chains are."""

from tests.stress.motions import Motion
from tests.stress.planar_cells import planar_cells


def cases(*, quick: bool) -> list[Motion]:
    """Blocks and chains; `quick`: one or two of each group, for a shorter time."""
    return [Motion(cell) for cell in planar_cells(quick=quick)]
