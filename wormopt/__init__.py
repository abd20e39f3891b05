"""Design, simulation and optimal control of worm-like locomotion systems.

Public names stand in ``__init__.pyi`` and are loaded on first use, so that importing the package
costs nothing. What belongs to one system has a name of its own: ``wo.film``, ``wo.pair``,
``wo.channel``, ``wo.peristaltic``, ``wo.magnetics``, ``wo.stepper``.

>>> import wormopt as wo
>>> scene = wo.load_scene("fast_gait")
>>> result = wo.run(scene)
>>> round(result.scalars["speed"].value, 9)
1.2
"""

from wormopt.lazy import names_of
from wormopt.version import VERSION

__version__ = VERSION
__getattr__, __dir__, __all__ = names_of(__name__, __file__)
