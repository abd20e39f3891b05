"""Gears that are block waves, and the limits of their worm."""

import numpy as np

from wormopt.systems.gears.gear import Gear, Limits
from wormopt.systems.spiked.construct import Profile, block_wave

DRAG = 0.2
LIMITS = Limits(12.0, 20.0, 0.6, 2.5, (0.7, 1.3))


def wave(
    links: int,
    resting: int,
    period: float = 5.0,
    length: tuple[float, float] = (0.8, 1.2),
    profile: Profile = "trapezoid",
) -> Gear:
    gait = block_wave(links, resting, period, length, profile)
    return Gear(f"{resting} at rest", gait, np.ones(links + 1), DRAG)
