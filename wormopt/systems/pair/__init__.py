"""Two masses on a magneto-elastic link in a pulsating field."""

from wormopt.lazy import names_of

__getattr__, __dir__, __all__ = names_of(__name__, __file__)
