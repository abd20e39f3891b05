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
    from wormopt.errors import Interrupted, SceneError, SolveError, WormoptError
    from wormopt.result import Result, Scalar, Variable
    from wormopt.runner import run
    from wormopt.scenes import Scene, load_scene

__version__ = VERSION

# Public name -> module it lives in. The imports above repeat it for type checkers.
_HOMES = {
    "Interrupted": "wormopt.errors",
    "Result": "wormopt.result",
    "Scalar": "wormopt.result",
    "Scene": "wormopt.scenes",
    "SceneError": "wormopt.errors",
    "SolveError": "wormopt.errors",
    "Variable": "wormopt.result",
    "WormoptError": "wormopt.errors",
    "load_scene": "wormopt.scenes",
    "run": "wormopt.runner",
}

__all__ = [
    "Interrupted",
    "Result",
    "Scalar",
    "Scene",
    "SceneError",
    "SolveError",
    "Variable",
    "WormoptError",
    "__version__",
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
