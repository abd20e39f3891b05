"""Magnetic fields of coils, magnetic materials, and fluids at rest in a field.

Examples
--------
>>> import wormopt as wo
>>> rubber = wo.magnetics.MagnetoElastic(mu_r=1.1, lame_eta=5e3)
>>> rubber.youngs_modulus()
15000.0
"""

from wormopt.lazy import names_of

__getattr__, __dir__, __all__ = names_of(__name__, __file__)
