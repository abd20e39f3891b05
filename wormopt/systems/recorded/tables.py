"""Tables common to scenes that estimate parameters from measurements."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any, Literal

from msgspec import Meta

from wormopt.errors import Fault, SceneError
from wormopt.files import is_there
from wormopt.study import Given, Scene, Study, entry, load_scene, number, on_use, positive
from wormopt.study.given import says
from wormopt.study.members import Member
from wormopt.study.scene import scene_within
from wormopt.study.types import Finite, Title, wrong_order

with on_use():
    import numpy as np

Prior = Annotated[
    tuple[Finite, ...],
    Meta(min_length=2, max_length=2, description="two finite numbers, [mean, standard deviation]"),
]
Span = Annotated[
    tuple[Finite, ...],
    Meta(min_length=2, max_length=2, description="two finite numbers, [first, last]"),
]
Level = Annotated[
    float, Meta(gt=0.5, lt=1, description="a number between 0.5 and 1, for example 0.95")
]
# Kinds whose scenes need an end time.
_TIMED = ("simulate", "track")
Keys = Annotated[
    str | tuple[str, ...],
    Meta(description='a key of the scene, for example "worm.density", or a list of keys'),
]
FiniteOrList = Annotated[
    Finite | tuple[Finite, ...],
    Meta(description="a finite number, or a list with one number per entry"),
]
SceneTables = Annotated[
    dict[str, Any],
    says(
        "",
        "a scene: `scene`, a file or a packaged scene, with other keys that change it; or `kind` "
        'with all its tables; or `file`, such as `"my_worm.py:build"`, and `parameters` of your '
        "own model, as in scenes of kind `simulate`",
    ),
]
Which = Annotated[str, says("", "label of the model, if the scene in `[model]` has several")]


class FromScene(Study):
    """Base of studies of parameters of another scene, that in `[model]`."""

    model: SceneTables

    def computed(self, member: Member[Any]) -> Any:
        """Compute a member; numbers that are not finite are found where they matter."""
        with np.errstate(all="ignore"):
            return super().computed(member)


class Parameter(Given):
    """A parameter to estimate, and prior knowledge of it."""

    name: Title = entry("name of the parameter in results")
    start: FiniteOrList | None = entry(
        "initial value of the search; default: the value of the scene in `[model]`", default=None
    )
    lower: FiniteOrList | None = entry(
        "lower bound; default: that of the model's signal", default=None
    )
    upper: FiniteOrList | None = entry(
        "upper bound; default: that of the model's signal", default=None
    )
    prior: Prior | None = entry(
        "prior knowledge: [mean, standard deviation] of a normal distribution; with `log`, of "
        "the logarithm",
        default=None,
    )
    log: bool = entry(
        "estimate the logarithm, for positive parameters of unknown magnitude", default=False
    )

    def faults_of_keys(self) -> Iterator[Fault]:
        """Yield faults between keys."""
        low, high, start = self.lower, self.upper, self.start
        if isinstance(low, float) and isinstance(high, float):
            yield from wrong_order("lower", (low, high), may_be_equal=False)
        if isinstance(start, float) and isinstance(low, float) and start < low:
            yield "start", f"{start:g} is below lower = {low:g}; write a larger number"
        if isinstance(start, float) and isinstance(high, float) and start > high:
            yield "start", f"{start:g} is above upper = {high:g}; write a smaller number"
        for name in ("start", "lower", "upper") if self.log else ():
            value = getattr(self, name)
            if isinstance(value, float) and value <= 0:
                yield name, f"{value:g} has no logarithm; write a number above 0"
        if self.prior and self.prior[1] <= 0:
            yield (
                "prior",
                f"the standard deviation {self.prior[1]:g} is not positive; write a number above 0",
            )


class Measured(Given):
    """A measured number, and the scalar of the scene that it measures."""

    scalar: str = entry("scalar in the results of the scene in `[model]`")
    value: float = number("", "measured value, in the unit of the scalar")
    deviation: float = positive(
        "", "standard deviation, including that of the computed scalar if it has one"
    )
    changes: dict[str, Any] = entry(
        'keys changed in the scene for this measurement, `{"switching.rate" = 100}`', default=dict
    )
    use: Literal["fit", "predict"] = entry(
        "`fit`: used in the fit; `predict`: held out and predicted by the fit", default="fit"
    )
    text: Title = entry("description or source of the measurement", default="")

    @property
    def name(self) -> str:
        """Description of the measurement, or its scalar and the changed keys."""
        changes = ", ".join(f"{key} = {value}" for key, value in self.changes.items())
        return self.text or self.scalar + (f" with {changes}" if changes else "")


class KeyUnknown(Parameter):
    """A parameter of the scene to estimate."""

    key: Keys = entry("key of the scene in `[model]`, or a list of keys that share this parameter")
    step: float = number(
        "share",
        "relative step for derivatives; with `log`, the ratio",
        above=0,
        most=1,
        default=0.01,
    )

    @property
    def keys(self) -> tuple[str, ...]:
        """Keys as a list, even if there is only one."""
        return self.key if isinstance(self.key, tuple) else (self.key,)


def named_twice(names: Iterable[str], key: str) -> Iterator[Fault]:
    """Yield a fault for each name that appears twice."""
    before: set[str] = set()
    for k, name in enumerate(names):
        if name in before:
            yield f"{key}[{k}].name", f'"{name}" appears twice; write another name'
        before.add(name)


def scene_of(tables: dict[str, Any], folder: Path, units: str, key: str = "model") -> Scene[Any]:
    """Load the scene inside another one; SceneError names keys below `key`."""
    raw = dict(tables)
    source = raw.pop("scene", None)
    try:
        if source is None:
            if "file" in raw:
                keys = ("file", "parameters", "output", "input")
                own = {name: raw.pop(name) for name in keys if name in raw}
                raw = {"kind": "simulate", "model": own} | raw
            raw = {"schema": 1, "units": units} | raw
            if raw.get("kind") in _TIMED:  # recordings determine the duration
                raw.setdefault("time", {"end": 1.0})
            return scene_within(folder, key, raw)
        beside = folder / str(source)
        found = load_scene(str(beside) if is_there(beside) else str(source), raw)
    except SceneError as error:
        named, said = (key, "") if source is None else (f"{key}.scene", f'"{source}": ')
        faults = [
            (f"{key}.{where}", what) if where else (named, f"{said}{what}")
            for where, what in error.faults
        ]
        raise SceneError(key, faults) from None
    if found.table.units != units:
        what = f'the scene in [{key}] has units = "{found.table.units}"; write the same here'
        raise SceneError(key, [("units", what)])
    return found


def near(name: str, known: Iterable[str]) -> str:
    """Suggest the known name that may be meant."""
    known = list(known)
    close = get_close_matches(name, known, n=1)
    return f"did you mean {close[0]}?" if close else f"write one of {', '.join(known) or 'none'}"


def value_at(scene: Scene[Any], key: str) -> Any:
    """Value of a key of a scene; None if the key does not exist."""
    value: Any = scene.table
    for part in key.replace("[", ".").replace("]", "").split("."):
        if isinstance(value, tuple) and part.isdecimal() and int(part) < len(value):
            value = value[int(part)]
        else:
            value = getattr(value, part, None)
    return value
