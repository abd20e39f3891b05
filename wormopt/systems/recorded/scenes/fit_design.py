"""Scenes of kind "fit-design": a gait for a worm whose numbers were measured."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta, field

from wormopt.errors import Fault
from wormopt.scene.types import NonNegative, PerMass, Positive, Seed, Table, says
from wormopt.systems.recorded.scenes.fit import RecordingTable
from wormopt.systems.recorded.scenes.tables import Seeds, named_twice
from wormopt.systems.shared.declared import GAIT
from wormopt.systems.spiked import (
    DESIGN_SCALARS,
    MOTION_VARIABLES,
    DesignTable,
    ObjectiveTable,
    Shape,
    Worm,
)

Confidence = Annotated[
    float, Meta(ge=0.5, lt=1, description="a number from 0.5 to below 1, 0.9999 say")
]
Number = Literal["mass", "drag", "load"]

FORCES = ("actuator_force", "spike_load")
"""Signals that depend on mass, drag and load even while spikes hold the worm."""
NO_FORCE = (
    "no column is a force, and the gait prescribes the motion whatever mass, drag and load are; "
    'record actuator forces, columns = {mu0 = "actuator_force[0]"} say, or spike_load'
)
_MOTION = ("position", "velocity")


class CrawlRecording(RecordingTable, frozen=True, kw_only=True):
    """A run of the worm with a known gait: what gauges read, over time.

    The gait begins at time 0 of the file, the worm at rest. Columns are `actuator_force[0]` and so
    on, one per link; `spike_load`, of all spikes together; `position` and `velocity` beside these.
    The gait may make the worm glide; it has no corners.
    """

    gait: Annotated[Shape, says("", "how the links were moved; `shape` decides on the other keys")]


class FitTable(Table, frozen=True, kw_only=True):
    """What is found from the recordings."""

    numbers: Annotated[
        tuple[Number, ...],
        says("", "numbers of `[worm]` that are found; the others are as they stand there"),
    ] = ("mass", "drag", "load")
    noise: Annotated[
        dict[str, Positive],
        says(
            "",
            "standard deviations of readings by signal, `{actuator_force = 0.2}`, where they are "
            "known; estimated of the others",
        ),
    ] = field(default_factory=dict)
    seeds: Annotated[
        Seeds, says("count", "starts: `[worm]`, and others spread within the bounds")
    ] = 4
    seed: Annotated[Seed, says("count", "of the random numbers by which starts are spread")] = 0


class PlantTable(Table, frozen=True, kw_only=True):
    """The worm as it is, which neither the fit nor the design knows."""

    mass: Annotated[PerMass, says("mass", "point masses; mass 0 is the head")]
    drag: Annotated[NonNegative, says("drag", "viscous drag on each mass")] = 0.0
    load: Annotated[NonNegative, says("force", "load on each mass")] = 0.0


class FitDesignScene(DesignTable, frozen=True, kw_only=True):
    """The best gait within limits of a worm whose numbers were measured.

    Masses, drag and load are fitted to recordings of a crawl with known gaits. The gait is then
    designed so that its limits hold wherever the numbers may lie: in the ellipsoid that holds them
    all with the confidence asked for. What their errors do to loads and forces along the gait, at
    worst, a range of loads does too; for that range the gait is designed, and designed again until
    its own worst case lies within. With a table `[plant]` the gait is tried on the worm as it is,
    beside the gait that would have been designed with its true numbers.

    `[worm]` holds where the fit starts from, and what is not fitted. `[gait]`, `[objective]`,
    `[search]` are those of kind [`gait-design`](gait-design.md), as are the results of the gait,
    with loads and forces at the largest load of the range. Guide: [fitting.md](../fitting.md).

    Refused: recordings without any force; a range of loads in `[worm]`; `gait.sharing` other than
    `equal`, with which loads are not linear in the numbers; `gait.impulses`.

    Exit code 3: the fit did not converge; the recordings do not tell a number; no gait keeps the
    limits; or, with `[plant]`, the gait breaks a limit there.
    """

    headline: ClassVar = (
        "speed",
        "speed_if_known",
        "load_range",
        "plant_speed",
        "plant_spike_load_max",
        "plant_share",
        "mode_sequence",
    )
    scalars: ClassVar = DESIGN_SCALARS | {
        "objective": ("speed", "value reached, in its quantity, recomputed from the gait"),
        "mass_found": ("mass", "point masses found"),
        "mass_error": ("mass", "their standard errors, 0 where not fitted"),
        "drag_found": ("drag", "drag found"),
        "drag_error": ("drag", "its standard error"),
        "load_found": ("force", "load found"),
        "load_error": ("force", "its standard error"),
        "n_readings": ("count", "readings that were fitted"),
        "confidence": (
            "share",
            "with which all limits hold at all times, as far as the model does",
        ),
        "reach": ("1", "standard errors that this takes, for all numbers at once"),
        "load_width": ("force", "half the range of loads for which the gait is designed"),
        "load_width_needed": ("force", "the half range that is as bad for it as any numbers"),
        "speed_if_known": ("speed", "of the best gait, were the numbers exactly those found"),
        "plant_speed": ("speed", "with `[plant]`: of the gait there"),
        "plant_spike_load_max": ("force", "with `[plant]`: largest load of a spike there"),
        "plant_spike_load_bold": (
            "force",
            "with `[plant]`: the same of the gait that trusts the numbers found",
        ),
        "plant_best": ("speed", "with `[plant]`: of the gait designed with its numbers"),
        "plant_share": ("share", "with `[plant]`: speed over that"),
        "plant_distance": (
            "1",
            "with `[plant]`: of its numbers from those found, in standard errors; within `reach` "
            "the limits hold for sure",
        ),
    }
    variables: ClassVar = {
        **MOTION_VARIABLES,
        **GAIT,
        "reading_time": ("time", ("reading",), "times of the readings, run after run"),
        "reading_run": ("count", ("reading",), "number of the run"),
        "read_force": ("force", ("link", "reading"), "actuator forces read, NaN where none"),
        "fitted_force": ("force", ("link", "reading"), "the same as fitted"),
        "band_time": ("time", ("band",), "times in a cycle"),
        "band_load": ("force", ("band",), "load of a resting spike with the numbers found"),
        "band_error": ("force", ("band",), "by how much it may be off at worst"),
        "plant_time": ("time", ("plant",), "with `[plant]`: times in a cycle"),
        "plant_load": ("force", ("plant",), "with `[plant]`: largest load of a spike there"),
        "bold_time": ("time", ("bold",), "with `[plant]`: times in a cycle of the bold gait"),
        "bold_load": ("force", ("bold",), "with `[plant]`: its largest load of a spike there"),
    }

    kind: Literal["fit-design"]
    want: Annotated[
        tuple[Literal["forces", "loads", "gait", "motion", "spikes"], ...],
        says(
            "",
            "`forces`: readings, fit and residuals; `loads`: what a resting spike bears, at worst "
            "and on the plant; `gait`, `motion`, `spikes` as for kind `gait`",
        ),
    ] = ()
    recording: Annotated[tuple[CrawlRecording, ...], says("", "runs of the worm")]
    fit: Annotated[FitTable, says("", "the fit")] = field(default_factory=FitTable)
    objective: Annotated[ObjectiveTable, says("", "what to seek")]
    confidence: Annotated[
        Confidence, says("share", "with which the gait is to keep its limits at all times")
    ] = 0.9999
    plant: Annotated[PlantTable | None, says("", "the worm as it is, to try the gait on")] = None

    @property
    def plant_worm(self) -> Worm | None:
        """The worm as it is, where it is told."""
        if self.plant is None:
            return None
        return Worm(self.worm.links, self.plant.mass, self.plant.drag, self.plant.load)

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows, and the files; `folder` is the scene's."""
        yield from super().faults(folder)
        yield from self.objective.faults()
        yield from self.faults_of_cost("objective.minimise", self.objective.minimise)
        if isinstance(self.worm.load, tuple):
            yield "worm.load", "the fit finds one load for all masses; write one number"
        elif any(self.worm.worm.beyond):
            yield (
                "worm.slope",
                "pulls unequal masses back by unequal forces, and the fit finds one load for all; "
                "write one mass for all, or the load without worm.slope",
            )
        if self.gait.sharing != "equal":
            what = "is not linear in masses, drag and load, which errors are carried over by"
            yield "gait.sharing", f'"{self.gait.sharing}" {what}; write "equal"'
        if self.gait.impulses:
            yield "gait.impulses", "loads spikes without bounds; leave it out"
        if not self.fit.numbers:
            yield "fit.numbers", 'none is left to find; write ["load"] say'
        if not self.recording:
            yield "recording", "there is none; write a table [[recording]]"
        for k, recording in enumerate(self.recording):
            key = f"recording[{k}]"
            yield from recording.faults(folder, self.units, key)
            yield from recording.gait.faults(self.worm.links, folder, f"{key}.gait")
            if recording.use != "fit":
                yield f"{key}.use", 'runs are kept aside in kind "fit"; leave it out'
        yield from self._faults_of_forces(folder)
        yield from named_twice((one.label for one in self.recording), "recording")
        if (plant := self.plant_worm) is not None:
            for key, message in plant.faults():
                yield f"plant.{key}", message

    def _faults_of_forces(self, folder: Path) -> Iterator[Fault]:
        """Whether any column is a force, as far as names in files of text tell."""
        read = [recording.read(folder, [], "") for recording in self.recording]
        signals = [
            recording.columns.get(column, column)
            for recording, columns in zip(self.recording, read, strict=True)
            for column in (columns.values if columns is not None else ())
        ]
        named = [name for recording in self.recording for name in recording.columns.values()]
        moved = all(name.startswith(_MOTION) for name in named)
        if None not in read and moved and not any(s.startswith(FORCES) for s in signals):
            yield "recording", NO_FORCE
