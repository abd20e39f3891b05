"""Chains of point masses under friction: trackers, optimal inputs, their comparison."""

from wormopt.lazy import names_of

__getattr__, __dir__, __all__ = names_of(__name__, __file__)
