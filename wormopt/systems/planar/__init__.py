"""Worms that move in the plane: chains whose links change length and whose joints bend."""

from wormopt.lazy import names_of

__getattr__, __dir__, __all__ = names_of(__name__, __file__)
