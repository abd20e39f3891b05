"""Magnetic fields of coils, magnetic materials, and fluids at rest in a field."""

from wormopt.lazy import names_of

__getattr__, __dir__, __all__ = names_of(__name__, __file__)
