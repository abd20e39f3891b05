"""Beams in closed form: the bent cantilever, and the vibrations of thick beams."""

from __future__ import annotations

import math

from scipy.special import ellipe, ellipeinc, ellipk, ellipkinc

from wormopt.systems.channel.rod import Rod


def bent_cantilever(angle: float) -> tuple[float, float, float]:
    """Force, and place of the tip along and across, of an inextensible cantilever.

    Its length and stiffness are 1; the angle of the tip is the parameter. K. E. Bisshopp and D. C.
    Drucker, Quart. Appl. Math. 3 (1945) 272.
    """
    m = (1 + math.sin(angle)) / 2
    phi = math.asin(1 / math.sqrt(2 * m))
    force = (ellipk(m) - ellipkinc(phi, m)) ** 2
    across = 1 - 2 / math.sqrt(force) * (ellipe(m) - ellipeinc(phi, m))
    return float(force), math.sqrt(2 * math.sin(angle) / force), float(across)


def thick_beam(rod: Rod, half_waves: int) -> float:
    """Lower frequency (Hz) by Timoshenko of a beam with pinned ends, a root of its equation."""
    k = half_waves * math.pi / rod.length
    resist, rho = rod.stiffness(), rod.density
    mass, turning = rho * rod.area, rho * rod.second_moment
    a = mass * turning / resist.shearing
    b = mass + k**2 * (turning + mass * resist.bending / resist.shearing)
    c = resist.bending * k**4
    return math.sqrt(2 * c / (b + math.sqrt(b**2 - 4 * a * c))) / (2 * math.pi)
