"""The worm G1 of docs/verification.md, its limits, and the order of rest of its best gait."""

from math import sqrt

from wormopt.systems.spiked.gait_problem import Search, Worm
from wormopt.systems.spiked.limits import Limits

G1_WORM = Worm(links=2, load=5.0)
G1_LIMITS = Limits(period=1.0, length=(0.7, 1.3), rate=1.0, acceleration=20.0)
G1_ORDER = ((0,), (2,), (1,))
G1 = 14 * sqrt(1394) / 125 - 839 / 250
"""Largest speed, by theory."""

OWN = Search(sequence=G1_ORDER, effort="quick", workers=1)
