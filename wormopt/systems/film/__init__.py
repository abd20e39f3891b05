"""Films of magnetic fluid: travelling waves, floats on them, forward problem, optimal waves.

Examples
--------
>>> import wormopt as wo
>>> round(wo.film.CosineWave(0.5).mean_flow, 6)
0.333333
"""

from wormopt.lazy import names_of

__getattr__, __dir__, __all__ = names_of(__name__, __file__)
