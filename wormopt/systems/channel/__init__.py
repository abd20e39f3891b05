"""Magnetisable worms in a channel: closed-form speeds, segment shapes, and elastic rods.

Examples
--------
>>> import wormopt as wo
>>> rod = wo.channel.Rod(length=48e-3, diameter=4e-3, youngs_modulus=5e4, density=1100.0)
>>> round(rod.stiffness().bending * 1e9, 3)
628.319
"""

from wormopt.lazy import names_of

__getattr__, __dir__, __all__ = names_of(__name__, __file__)
