"""Films of magnetic fluid: waves, what they carry, how they settle, the best wave."""

from wormopt.lazy import names_of

__getattr__, __dir__, __all__ = names_of(__name__, __file__)
