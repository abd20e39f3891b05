"""Scenes of kind "fit-numbers": keys of another scene found from single numbers measured."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from msgspec import Meta, field

from wormopt.errors import Fault, SceneError
from wormopt.kinds import KINDS
from wormopt.scene.scene import Scene, load_scene
from wormopt.scene.types import Finite, Positive, SceneTable, Table, Title, says
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
    Meta(description='a key of the scene, "worm.density" say, or a list of them'),
]
Looks = Annotated[int, Meta(ge=1, le=1000, description="a whole number from 1 to 1000")]
Step = Annotated[float, Meta(gt=0, le=1, description="a number above 0, at most 1")]
Changes = Annotated[
    dict[str, Any],
    says("", 'keys of the scene in `[model]` at this measurement, `{"switching.rate" = 100}`'),
]


class MeasuredTable(Table, frozen=True, kw_only=True):
    """A number that was measured, and what the scene calls it."""

    scalar: Annotated[str, says("", "a scalar of the results of the scene in `[model]`")]
    value: Annotated[Finite, says("", "what was measured, in the unit of that scalar")]
    deviation: Annotated[
        Positive,
        says("", "its standard deviation, that of the computed number included where it has one"),
    ]
    changes: Changes = field(default_factory=dict)
    use: Annotated[
        Literal["fit", "predict"], says("", "`predict`: kept aside, and predicted by the fit")
    ] = "fit"
    text: Annotated[Title, says("", "what it is, or where it is said")] = ""


class KeyUnknown(UnknownTable, frozen=True, kw_only=True):
    """A number of the scene that is to be found."""

    key: Annotated[
        Keys, says("", "key of the scene in `[model]`, or a list of keys that all are this number")
    ]
    step: Annotated[
        Step,
        says("share", "by which it is moved for derivatives: its size, or its ratio with `log`"),
    ] = 0.01

    @property
    def keys(self) -> tuple[str, ...]:
        """Keys as a list, also where there is one."""
        return self.key if isinstance(self.key, tuple) else (self.key,)


class NumberSearchTable(Table, frozen=True, kw_only=True):
    """How numbers are sought."""

    method: Annotated[
        Literal["slopes", "compass"],
        says(
            "",
            "`slopes`: steps of Gauss and Newton; `compass`: to the best of all neighbours a "
            "`step` away, then half as far, for runs so irregular that they have no slopes",
        ),
    ] = "slopes"
    steps: Annotated[Looks, says("count", "at most")] = 20
    accepted: Annotated[
        Positive,
        says(
            "1",
            "largest distance from the bottom that counts as converged, in standard errors; "
            "`compass` has converged where no neighbour is better",
        ),
    ] = 0.1


class FitNumbersScene(SceneTable, frozen=True, kw_only=True):
    """Keys of another scene, found from single numbers: velocities at several frequencies, say.

    Any scene can stand in `[model]`: it is run for every measurement, with its `changes`, as often
    as the search needs. What is known before (`prior`) counts as a measurement does, so that there
    may be fewer of these than unknowns; the trust report says which numbers the measurements tell
    anything about. Derivatives are differences of runs, with steps as they are told: runs that are
    irregular want large ones, and the method `compass`. Guide: [fitting.md](../fitting.md).

    Results hold every number found as a scalar of its name, with `NAME_error` and `NAME_interval`.
    Exit code 3: the search did not converge, or the scene fails at the numbers found.
    """

    headline: ClassVar = ()
    scalars: ClassVar = {
        "n_measurements": ("count", "numbers that were fitted"),
        "n_unknowns": ("count", "numbers that were sought"),
        "n_runs": ("count", "runs of the scene"),
        "cost": ("1", "half the sum of the squares of weighted residuals, priors included"),
        "offset": (
            "1",
            "how far from the bottom the search ended, in standard errors, by slopes",
        ),
        "tells": (
            "share",
            "by how much measurements lessen the error of each number that a prior brings, a list",
        ),
    }
    variables: ClassVar = FOUND | {
        "measured": ("count", ("measurement",), "what was measured"),
        "deviation": ("count", ("measurement",), "its standard deviation"),
        "fitted": ("count", ("measurement",), "what the scene says with the numbers found"),
        "at_start": ("count", ("measurement",), "and with those that the search began with"),
        "changed": ("count", ("measurement",), "the key that differs, where there is one"),
    }

    kind: Literal["fit-numbers"]
    want: Annotated[
        tuple[Literal["measurements", "parameters", "correlation"], ...],
        says(
            "",
            "`measurements` beside what the scene says; `parameters`: numbers with intervals; "
            "`correlation`, of their errors",
        ),
    ] = ()
    model: SceneTables
    measured: Annotated[tuple[MeasuredTable, ...], says("", "what was measured")]
    unknown: Annotated[tuple[KeyUnknown, ...], says("", "numbers to be found")]
    search: Annotated[NumberSearchTable, says("", "the search")] = field(
        default_factory=NumberSearchTable
    )
    level: Annotated[Level, says("share", "confidence of the intervals")] = 0.95

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows; `folder` is the scene's."""
        yield from super().faults(folder)
        for key in ("measured", "unknown"):
            if not getattr(self, key):
                yield key, f"there is none; write a table [[{key}]]"
        for k, unknown in enumerate(self.unknown):
            yield from unknown.faults(f"unknown[{k}]")
        yield from named_twice((unknown.name for unknown in self.unknown), "unknown")
        if self.measured and all(one.use == "predict" for one in self.measured):
            yield "measured", 'all are kept aside; write use = "fit" for at least one'
        told = sum(one.use == "fit" for one in self.measured)
        free = sum(unknown.prior is None for unknown in self.unknown)
        if free > told:
            yield "unknown", f"{free} without a prior from {told} measurements; write priors"
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
                    what = f"{key} is no number of the scene in [model]"
                    yield f"unknown[{k}].key", f'{what}; write a key that is, "worm.mass" say'
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
    """Value of a key of a scene, None where there is none."""
    value: Any = scene.table
    for part in key.replace("[", ".").replace("]", "").split("."):
        if isinstance(value, tuple) and part.isdecimal() and int(part) < len(value):
            value = value[int(part)]
        else:
            value = getattr(value, part, None)
    return value
