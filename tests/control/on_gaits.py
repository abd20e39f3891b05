"""Worms that follow a gait, simulated loosely."""

from wormopt.control.loop import Reference, gait_reference
from wormopt.model.model import Model
from wormopt.simulation.options import Tolerance
from wormopt.systems.spiked.construct import fast_gait

LOOSE = Tolerance(relative=1e-9, absolute=1e-10)


def following(plant: Model) -> Reference:
    return gait_reference(fast_gait(1.0), plant.t)
