"""Worms with spikes whose gait is prescribed: motion, design, certificates, stepping motors."""

from wormopt.lazy import names_of

__getattr__, __dir__, __all__ = names_of(__name__, __file__)
