"""Worms of membrane segments that swell and thin in turn, from coil to gait.

Examples
--------
>>> import wormopt as wo
>>> wo.peristaltic.anchored_wave(5, 2, stroke=1.0, step=0.5).speed
1.2
"""

from wormopt.lazy import names_of

__getattr__, __dir__, __all__ = names_of(__name__, __file__)
