"""Worms of membrane segments that swell and thin in turn, from coil to gait."""

from wormopt.lazy import names_of

__getattr__, __dir__, __all__ = names_of(__name__, __file__)
