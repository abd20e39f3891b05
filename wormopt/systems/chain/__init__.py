"""Chains of point masses with friction: simulation, trackers, optimal inputs, comparisons."""

from wormopt.lazy import names_of

__getattr__, __dir__, __all__ = names_of(__name__, __file__)
