"""Scenes of kind "fit-numbers": keys of another scene estimated from single measured numbers."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from msgspec import Meta, field

from wormopt.errors import Fault, SceneError
from wormopt.kinds import KINDS
from wormopt.study.given import Given, entry, number, positive, says, whole
from wormopt.study.scene import Scene, load_scene
from wormopt.study.types import SceneTable, Title
from wormopt.systems.recorded.scenes.tables import (
    FOUND,
    Level,
    SceneTables,
    UnknownTable,
    named_twice,
    near,
    scene_of,
)

Keys = Annotated[
    str | tuple[str, ...],
    Meta(description='a key of the scene, for example "worm.density", or a list of keys'),
]
Changes = Annotated[
    dict[str, Any],
    says("", 'keys changed in the scene for this measurement, `{"switching.rate" = 100}`'),
]


class MeasuredTable(Given):
    """A measured number, and the scalar of the scene that it measures."""

    scalar: str = entry("scalar in the results of the scene in `[model]`")
    value: float = number("", "measured value, in the unit of the scalar")
    deviation: float = positive(
        "", "standard deviation, including that of the computed scalar if it has one"
    )
    changes: Changes = field(default_factory=dict)
    use: Literal["fit", "predict"] = entry(
        "`fit`: used in the fit; `predict`: held out and predicted by the fit", default="fit"
    )
    text: Title = entry("description or source of the measurement", default="")


class KeyUnknown(UnknownTable):
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


class NumberSearchTable(Given):
    """Search for the estimates."""

    method: Literal["slopes", "compass"] = entry(
        "`slopes`: Gauss-Newton steps; `compass`: move to the best neighbour at distance "
        "`step`, then halve the distance, for results too irregular to have derivatives",
        default="slopes",
    )
    steps: int = whole(1, 1000, "largest number of steps", default=20)
    accepted: float = positive(
        "1",
        "largest distance from the minimum accepted as converged, in standard errors; "
        "`compass` has converged if no neighbour is better",
        default=0.1,
    )


class FitNumbersScene(SceneTable):
    """Keys of another scene, estimated from single measured numbers.

    An example is a set of velocities at several frequencies. `[model]` may contain any scene. It is
    run for every measurement, with its `changes`, as often
    as the search needs. A `prior` counts as a measurement, so there may be fewer measurements than
    unknowns. The trust report states which parameters the measurements inform. Derivatives are
    finite differences with the given steps. Irregular results need large steps and the method
    `compass`. Guide: [fitting](../fitting.md).

    Results contain the estimate of every parameter as a scalar of its name, with `NAME_error` and
    `NAME_interval`. Exit code 3: the search did not converge, or the scene fails at the estimates.
    """

    headline: ClassVar = ()
    scalars: ClassVar = {
        "n_measurements": ("count", "number of fitted measurements"),
        "n_unknowns": ("count", "number of estimated parameters"),
        "n_runs": ("count", "number of runs of the scene"),
        "cost": ("1", "half the sum of the squared weighted residuals, priors included"),
        "offset": (
            "1",
            "distance of the end of the search from the minimum by derivatives, in standard errors",
        ),
        "tells": (
            "share",
            "relative reduction of the prior error of each parameter by the measurements, a list",
        ),
    }
    variables: ClassVar = FOUND | {
        "measured": ("count", ("measurement",), "measured values"),
        "deviation": ("count", ("measurement",), "standard deviations of the measurements"),
        "fitted": ("count", ("measurement",), "values computed with the estimates"),
        "at_start": ("count", ("measurement",), "values computed with the initial parameters"),
        "changed": ("count", ("measurement",), "value of the key that differs, if there is one"),
    }

    kind: Literal["fit-numbers"]
    want: tuple[Literal["measurements", "parameters", "correlation"], ...] = entry(
        "`measurements`: measured and computed values; `parameters`: estimates with "
        "intervals; `correlation`: of the errors",
        default=(),
    )
    model: SceneTables
    measured: tuple[MeasuredTable, ...] = entry("measurements")
    unknown: tuple[KeyUnknown, ...] = entry("parameters to estimate")
    search: NumberSearchTable = entry("the search", default=NumberSearchTable)
    level: Level = entry("confidence of the intervals", quantity="share", default=0.95)

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check everything that no single key shows; `folder` is the scene's."""
        yield from super().faults(folder)
        for key in ("measured", "unknown"):
            if not getattr(self, key):
                yield key, f"no entry is given; write a table [[{key}]]"
        for k, unknown in enumerate(self.unknown):
            yield from unknown.faults(f"unknown[{k}]")
        yield from named_twice((unknown.name for unknown in self.unknown), "unknown")
        if self.measured and all(one.use == "predict" for one in self.measured):
            yield "measured", 'all have use = "predict"; write use = "fit" for at least one'
        told = sum(one.use == "fit" for one in self.measured)
        free = sum(unknown.prior is None for unknown in self.unknown)
        if free > told:
            yield (
                "unknown",
                f"{free} unknowns without a prior, but {told} measurements; write priors",
            )
        try:
            scene = scene_of(self.model, folder, self.units)
        except SceneError as error:
            yield from error.faults
            return
        yield from self._faults_beside(scene)

    def _faults_beside(self, scene: Scene[Any]) -> Iterator[Fault]:
        known = KINDS[scene.table.kind].load_table().scalars
        for k, one in enumerate(self.measured):
            if one.scalar not in known:
                what = f'results of kind "{scene.table.kind}" have no scalar "{one.scalar}"'
                yield f"measured[{k}].scalar", f"{what}; {near(one.scalar, known)}"
            yield from _faults_of_changes(scene, one.changes, f"measured[{k}].changes")
        for k, unknown in enumerate(self.unknown):
            for key in unknown.keys:
                value = value_at(scene, key)
                if not isinstance(value, int | float) or isinstance(value, bool):
                    what = f"{key} is not a number of the scene in [model]"
                    yield f"unknown[{k}].key", f'{what}; write for example "worm.mass"'
                elif unknown.start is not None:
                    yield from _faults_of_changes(
                        scene, {key: unknown.start}, f"unknown[{k}].start"
                    )


def _faults_of_changes(scene: Scene[Any], changes: dict[str, Any], key: str) -> Iterator[Fault]:
    try:
        load_scene(scene, changes)
    except SceneError as error:
        yield from ((key, f"{where}: {what}") for where, what in error.faults)


def value_at(scene: Scene[Any], key: str) -> Any:
    """Value of a key of a scene; None if the key does not exist."""
    value: Any = scene.table
    for part in key.replace("[", ".").replace("]", "").split("."):
        if isinstance(value, tuple) and part.isdecimal() and int(part) < len(value):
            value = value[int(part)]
        else:
            value = getattr(value, part, None)
    return value
