"""Films of magnetic fluid: travelling waves, floats on them, forward problem, optimal waves."""

from wormopt.lazy import names_of

__getattr__, __dir__, __all__ = names_of(__name__, __file__)
