"""Worms that move in the plane: chains whose links change length and whose joints bend.

Examples
--------
>>> import wormopt as wo
>>> worm, ground = wo.planar.chain_shape(2, lengths=(1.0, 1.0)), wo.Elliptic(1.0, 1.0, 3.0)
>>> to_and_fro = wo.planar.Polygon([[0.2], [1.2]])
>>> wo.planar.crawl(worm, ground, to_and_fro).displacement.round(6) + 0.0
array([0., 0., 0.])
"""

from wormopt.lazy import names_of

__getattr__, __dir__, __all__ = names_of(__name__, __file__)
