"""Scenes of kind "fit-design": a gait for a worm whose parameters are measured."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar, Literal

from wormopt.errors import Fault
from wormopt.study.given import Given, entry, number
from wormopt.study.types import PerMass, Positive, Seed
from wormopt.systems.recorded.scenes.fit import RecordingTable
from wormopt.systems.recorded.tables import Seeds, named_twice
from wormopt.systems.shared.declared import GAIT
from wormopt.systems.spiked import (
    DESIGN_SCALARS,
    MOTION_VARIABLES,
    DesignTable,
    Objective,
    Shape,
    Worm,
)

Number = Literal["mass", "drag", "load"]

FORCES = ("actuator_force", "spike_load")
"""Signals that depend on mass, drag and load even while spikes hold the worm."""
NO_FORCE = (
    "no column is a force, and the gait prescribes the motion for any mass, drag and load; record "
    "actuator forces, for example "
    'columns = {mu0 = "actuator_force[0]"}, or spike_load'
)
_MOTION = ("position", "velocity")


class CrawlRecording(RecordingTable):
    """A recording of a run with a known gait: readings of gauges over time.

    The gait begins at time 0 of the file with the worm at rest. Columns are `actuator_force[0]` and
    so on, one per link; `spike_load`, the sum over all spikes; and additionally `position` and
    `velocity`. With this gait the worm may glide; corners are refused.
    """

    gait: Shape = entry("gait of the links; `shape` selects the other keys")


class FitTable(Given):
    """Settings of the fit."""

    numbers: tuple[Number, ...] = entry(
        "parameters of `[worm]` to estimate; the others keep their values there",
        default=("mass", "drag", "load"),
    )
    noise: dict[str, Positive] = entry(
        "known standard deviation of readings of each signal, `{actuator_force = 0.2}`; the "
        "others are estimated",
        default=dict,
    )
    seeds: Seeds = entry(
        "number of starts: `[worm]`, and others spread within the bounds",
        quantity="count",
        default=4,
    )
    seed: Seed = entry("seed of the random spread of the starts", quantity="count", default=0)


class PlantTable(Given):
    """The real worm to test the gait on; neither the fit nor the design uses it."""

    mass: PerMass = entry("point masses; mass 0 is the head", quantity="mass", per="masses")
    drag: float = number("drag", "viscous drag on each mass", least=0, default=0.0)
    load: float = number("force", "load on each mass", least=0, default=0.0)


class FitDesignScene(DesignTable):
    """The optimal gait within limits for a worm whose parameters are measured.

    Masses, drag and load are fitted to recordings of a crawl with known gaits. The gait is then
    designed so that its limits hold for all parameters in a confidence ellipsoid with the requested
    confidence. The worst effect of these errors on loads and forces along the gait equals that of a
    range of loads. The gait is designed for that range, and redesigned until its own worst case is
    within the range. With a table `[plant]` the gait is tested on the real worm and compared with
    the gait designed for the true parameters.

    `[worm]` contains the start of the fit and the parameters that are not fitted. Kind
    [`gait-design`](gait-design.md) explains `[gait]`, `[objective]`, `[search]` and the results of
    the gait; loads and forces are those at the largest load of the range. Guide:
    [fitting](../fitting.md).

    Refused: recordings without a force; a range of loads in `[worm]`; `gait.sharing` other than
    `equal`, because loads are then not linear in the parameters; `gait.impulses`.

    Exit code 3: the fit did not converge; a parameter is not identifiable from the recordings; no
    gait meets the limits; or, with `[plant]`, the gait violates a limit there.
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
        "objective": ("speed", "objective reached, in its quantity, recomputed from the gait"),
        "mass_found": ("mass", "estimated point masses"),
        "mass_error": ("mass", "standard errors of the masses, 0 if not fitted"),
        "drag_found": ("drag", "estimated drag"),
        "drag_error": ("drag", "standard error of the drag"),
        "load_found": ("force", "estimated load"),
        "load_error": ("force", "standard error of the load"),
        "n_readings": ("count", "number of fitted readings"),
        "confidence": (
            "share",
            "confidence that all limits hold at all times, if the model is correct",
        ),
        "reach": ("1", "size of the confidence ellipsoid, in standard errors"),
        "load_width": ("force", "half the range of loads for which the gait is designed"),
        "load_width_needed": ("force", "half range equivalent to the worst parameter errors"),
        "speed_if_known": ("speed", "speed of the optimal gait if the estimates were exact"),
        "plant_speed": ("speed", "with `[plant]`: speed of the gait there"),
        "plant_spike_load_max": ("force", "with `[plant]`: largest spike load of the gait there"),
        "plant_spike_load_bold": (
            "force",
            "with `[plant]`: largest spike load there of the gait that assumes exact estimates",
        ),
        "plant_best": ("speed", "with `[plant]`: speed of the gait designed for its parameters"),
        "plant_share": ("share", "with `[plant]`: `plant_speed` divided by `plant_best`"),
        "plant_distance": (
            "1",
            "with `[plant]`: distance of its parameters from the estimates, in standard errors; "
            "within `reach` the limits are guaranteed",
        ),
    }
    variables: ClassVar = {
        **MOTION_VARIABLES,
        **GAIT,
        "reading_time": ("time", ("reading",), "times of the readings, run by run"),
        "reading_run": ("count", ("reading",), "index of the run"),
        "read_force": ("force", ("link", "reading"), "recorded actuator forces, NaN if missing"),
        "fitted_force": ("force", ("link", "reading"), "fitted actuator forces"),
        "band_time": ("time", ("band",), "times in a cycle"),
        "band_load": ("force", ("band",), "load of a resting spike with the estimates"),
        "band_error": ("force", ("band",), "worst-case error of this load"),
        "plant_time": ("time", ("plant",), "with `[plant]`: times in a cycle"),
        "plant_load": ("force", ("plant",), "with `[plant]`: largest spike load there"),
        "bold_time": ("time", ("bold",), "with `[plant]`: times in a cycle of the bold gait"),
        "bold_load": (
            "force",
            ("bold",),
            "with `[plant]`: largest spike load of the bold gait there",
        ),
    }

    kind: Literal["fit-design"]
    want: tuple[Literal["forces", "loads", "gait", "motion", "spikes"], ...] = entry(
        "`forces`: readings, fit and residuals; `loads`: load of a resting spike, worst case "
        "and on the plant; `gait`, `motion`, `spikes`: as for kind `gait`",
        default=(),
    )
    recording: tuple[CrawlRecording, ...] = entry("recorded runs of the worm")
    fit: FitTable = entry("the fit", default=FitTable)
    objective: Objective = entry("the objective")
    confidence: float = number(
        "share",
        "confidence that the gait meets its limits at all times",
        least=0.5,
        below=1,
        default=0.9999,
    )
    plant: PlantTable | None = entry("the real worm, to test the gait on", default=None)

    @property
    def plant_worm(self) -> Worm | None:
        """The real worm; None if not given."""
        if self.plant is None:
            return None
        return Worm(self.worm.links, self.plant.mass, self.plant.drag, self.plant.load)

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check everything that no single key shows, and the files, in the scene's `folder`."""
        yield from super().faults(folder)
        yield from self.objective.faults_in_scene()
        yield from self.faults_of_cost("objective.minimise", self.objective.minimise)
        if isinstance(self.worm.load, tuple):
            yield "worm.load", "a range or list, but the fit finds one load; write one number"
        elif any(self.worm.beyond):
            yield (
                "worm.slope",
                "the slope pulls unequal masses back by unequal forces, but the fit finds one "
                "load for all; write one mass for all, or the load without worm.slope",
            )
        if self.gait.sharing != "equal":
            what = "makes loads nonlinear in masses, drag and load, so errors cannot be propagated"
            yield "gait.sharing", f'"{self.gait.sharing}" {what}; write "equal"'
        if self.gait.impulses:
            yield "gait.impulses", "true, but impulses load spikes without bounds; remove the key"
        if not self.fit.numbers:
            yield "fit.numbers", 'the list is empty; write for example ["load"]'
        if not self.recording:
            yield "recording", "no entry is given; write a table [[recording]]"
        for k, recording in enumerate(self.recording):
            key = f"recording[{k}]"
            yield from recording.faults(folder, self.units, key)
            yield from recording.gait.faults(self.worm.links, folder, f"{key}.gait")
            if recording.use != "fit":
                yield f"{key}.use", 'runs can be held out in kind "fit" only; remove the key'
        yield from self._faults_of_forces(folder)
        yield from named_twice((one.label for one in self.recording), "recording")

    def _faults_of_forces(self, folder: Path) -> Iterator[Fault]:
        """Yield a fault if no column of the text files is named like a force."""
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
