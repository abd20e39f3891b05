"""Step commands for gaits on stepping motors, and the motion that they produce."""

from wormopt.lazy import names_of

__getattr__, __dir__, __all__ = names_of(__name__, __file__)
