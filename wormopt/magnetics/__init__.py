"""Magnetic materials and what sets them in motion; like worms, it knows no solver."""

from wormopt.lazy import names_of

__getattr__, __dir__, __all__ = names_of(__name__, __file__)
