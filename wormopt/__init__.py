"""Design, simulation and optimal control of worm-like locomotion systems.

Public names are loaded on first use, so that importing the package costs nothing.

>>> import wormopt as wo
>>> scene = wo.load_scene("fast_gait")
>>> result = wo.run(scene)
>>> round(result.scalars["speed"].value, 9)
1.2
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from wormopt.version import VERSION

if TYPE_CHECKING:
    from wormopt.core.friction import Law
    from wormopt.core.gait import Gait
    from wormopt.core.model import Contact, Model, Signal
    from wormopt.core.modes import ModeSequence
    from wormopt.errors import Interrupted, SceneError, SolveError, WormoptError
    from wormopt.gaits.files import load_gait
    from wormopt.gaits.optimize import design
    from wormopt.optimal.problem import Problem
    from wormopt.result import Result, Scalar, Variable
    from wormopt.runner import run
    from wormopt.scenes import Scene, load_scene
    from wormopt.worms.crawl import crawl

__version__ = VERSION

# Public name -> module it lives in. The imports above repeat it for type checkers.
_HOMES = {
    "Contact": "wormopt.core.model",
    "Gait": "wormopt.core.gait",
    "Interrupted": "wormopt.errors",
    "Law": "wormopt.core.friction",
    "ModeSequence": "wormopt.core.modes",
    "Model": "wormopt.core.model",
    "Problem": "wormopt.optimal.problem",
    "Result": "wormopt.result",
    "Scalar": "wormopt.result",
    "Scene": "wormopt.scenes",
    "SceneError": "wormopt.errors",
    "Signal": "wormopt.core.model",
    "SolveError": "wormopt.errors",
    "Variable": "wormopt.result",
    "WormoptError": "wormopt.errors",
    "crawl": "wormopt.worms.crawl",
    "design": "wormopt.gaits.optimize",
    "load_gait": "wormopt.gaits.files",
    "load_scene": "wormopt.scenes",
    "run": "wormopt.runner",
}

__all__ = [
    "Contact",
    "Gait",
    "Interrupted",
    "Law",
    "ModeSequence",
    "Model",
    "Problem",
    "Result",
    "Scalar",
    "Scene",
    "SceneError",
    "Signal",
    "SolveError",
    "Variable",
    "WormoptError",
    "__version__",
    "crawl",
    "design",
    "load_gait",
    "load_scene",
    "run",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
