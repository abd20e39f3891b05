"""Tables that scenes share in which numbers of a worm are found from what was measured."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any

from msgspec import Meta

from wormopt.errors import Fault, SceneError
from wormopt.files import is_there
from wormopt.scene.scene import Scene, load_scene, scene_within
from wormopt.scene.types import Finite, Seed, Table, Title, says, wrong_order

Prior = Annotated[
    tuple[Finite, ...],
    Meta(min_length=2, max_length=2, description="two finite numbers, [mean, standard deviation]"),
]
Span = Annotated[
    tuple[Finite, ...],
    Meta(min_length=2, max_length=2, description="two finite numbers, [first, last]"),
]
Seeds = Annotated[int, Meta(ge=1, le=1000, description="a whole number from 1 to 1000")]
Level = Annotated[float, Meta(gt=0.5, lt=1, description="a number between 0.5 and 1, 0.95 say")]
# Kinds whose scenes must say when they end.
_TIMED = ("simulate", "track")
FiniteOrList = Annotated[
    Finite | tuple[Finite, ...],
    Meta(description="a finite number, or a list of them, one per entry"),
]
SceneTables = Annotated[
    dict[str, Any],
    says(
        "",
        "a scene: `scene`, a file or a packaged scene, and other keys that change it, or `kind` "
        "and all of its tables; a model of your own is a scene of kind `simulate` with `model = "
        '"my_worm.py:build"`',
    ),
]
FOUND = {
    "estimate": ("count", ("unknown",), "numbers found, in their own units"),
    "standard_error": ("count", ("unknown",), "their standard errors"),
    "interval": ("count", ("unknown", "end"), "their intervals, low and high"),
    "began": ("count", ("unknown",), "where the search began"),
    "correlation": ("count", ("unknown", "other_unknown"), "of the errors of numbers found"),
}
"""What results hold of numbers found, as arrays."""


class UnknownTable(Table, frozen=True, kw_only=True):
    """A number that is to be found, and what is known of it before."""

    name: Annotated[Title, says("", "what results call it")]
    start: Annotated[
        FiniteOrList | None,
        says("", "where the search begins; the value of the scene in `[model]` if left out"),
    ] = None
    lower: Annotated[FiniteOrList | None, says("", "bound; by its nature if left out")] = None
    upper: Annotated[FiniteOrList | None, says("", "bound; by its nature if left out")] = None
    prior: Annotated[
        Prior | None,
        says(
            "",
            "what is known of it otherwise: [mean, standard deviation] of a normal distribution, "
            "of its logarithm with `log`",
        ),
    ] = None
    log: Annotated[
        bool,
        says("", "whether its logarithm is sought: what is positive and known by its size only"),
    ] = False

    def faults(self, key: str) -> Iterator[Fault]:
        """Yield what is wrong between the keys of this table, which stands at `key`."""
        low, high, start = self.lower, self.upper, self.start
        if isinstance(low, float) and isinstance(high, float):
            yield from wrong_order(f"{key}.lower", (low, high), may_be_equal=False)
        if isinstance(start, float) and isinstance(low, float) and start < low:
            yield f"{key}.start", f"{start:g} is below lower = {low:g}; write a number between"
        if isinstance(start, float) and isinstance(high, float) and start > high:
            yield f"{key}.start", f"{start:g} is above upper = {high:g}; write a number between"
        for name in ("start", "lower", "upper") if self.log else ():
            value = getattr(self, name)
            if isinstance(value, float) and value <= 0:
                yield f"{key}.{name}", f"{value:g} has no logarithm; write a number above 0"
        if self.prior and self.prior[1] <= 0:
            yield f"{key}.prior", f"the standard deviation {self.prior[1]:g} must be above 0"


class SearchTable(Table, frozen=True, kw_only=True):
    """From where the best fit is sought."""

    seeds: Annotated[
        Seeds,
        says(
            "count",
            "starts at most: the one given, and others spread around it within the bounds; once "
            "three have ended at the best no other is tried",
        ),
    ] = 6
    seed: Annotated[Seed, says("count", "of the random numbers by which starts are spread")] = 0


def named_twice(names: Iterable[str], key: str) -> Iterator[Fault]:
    """Yield a fault for each name that stands there twice."""
    before: set[str] = set()
    for k, name in enumerate(names):
        if name in before:
            yield f"{key}[{k}].name", f'"{name}" stands there twice; write another name'
        before.add(name)


def scene_of(tables: dict[str, Any], folder: Path, units: str, key: str = "model") -> Scene[Any]:
    """Scene that stands in another one; SceneError with its keys below `key` where it is wrong."""
    raw = dict(tables)
    source = raw.pop("scene", None)
    try:
        if source is None:
            raw = {"schema": 1, "units": units} | raw
            if raw.get("kind") in _TIMED:  # recordings say how long it goes
                raw.setdefault("time", {"end": 1.0})
            return scene_within(folder, key, raw)
        beside = folder / str(source)
        found = load_scene(str(beside) if is_there(beside) else str(source), raw)
    except SceneError as error:
        faults = [(f"{key}.{where}" if where else key, what) for where, what in error.faults]
        raise SceneError(key, faults) from None
    if found.table.units != units:
        what = f'the scene has units = "{found.table.units}"; write the same here'
        raise SceneError(key, [("units", what)])
    return found


def near(name: str, known: Iterable[str]) -> str:
    """Hint which of the known names may be meant."""
    known = list(known)
    close = get_close_matches(name, known, n=1)
    return f"did you mean {close[0]}?" if close else f"there are {', '.join(known) or 'none'}"
