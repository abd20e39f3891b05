"""Coils, their fields and pressures, and materials in these fields."""

from wormopt.lazy import names_of

__getattr__, __dir__, __all__ = names_of(__name__, __file__)
