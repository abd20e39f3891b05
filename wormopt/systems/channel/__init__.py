"""Magnetisable worms in a channel: closed-form speeds, segment shapes, and elastic rods."""

from wormopt.lazy import names_of

__getattr__, __dir__, __all__ = names_of(__name__, __file__)
