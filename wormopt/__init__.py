"""Design, simulation and optimal control of worm-like locomotion systems.

A scene is a TOML file, and `run` computes its result. Models, solvers and systems can also be used
directly from Python.

>>> import wormopt as wo
>>> scene = wo.load_scene("fast_gait")
>>> result = wo.run(scene)
>>> round(result.scalars["speed"].value, 9)
1.2

Functions of one system are in a module of its own, such as ``wo.film`` or ``wo.planar``. American
spellings such as ``wo.optimize`` work too. Each name below is loaded on first use; call
``help(wo.simulate)`` for its documentation.
"""

from wormopt.lazy import grouped_names, names_of
from wormopt.version import VERSION

__doc__ = f"{__doc__ or ''}\n{grouped_names(__file__)}\n"
__version__ = VERSION
__getattr__, __dir__, __all__ = names_of(__name__, __file__)
