"""Coils, the fields and pressures they make, materials in them."""

from wormopt.lazy import names_of

__getattr__, __dir__, __all__ = names_of(__name__, __file__)
