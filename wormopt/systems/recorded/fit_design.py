"""Kind "fit-design": a gait for a worm whose parameters are measured."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, Literal

from wormopt.errors import Fault, SceneError
from wormopt.study import (
    Given,
    entry,
    facts,
    number,
    on_use,
    parts,
    signal,
    stage,
    value,
    warnings,
    whole,
)
from wormopt.study.types import PerMass, Positive, Seed, per
from wormopt.systems.recorded.believed_design import CONFIDENCE, BelievedDesign
from wormopt.systems.recorded.recordings import RecordingFile, Run, read_all, run_of
from wormopt.systems.recorded.tables import named_twice
from wormopt.systems.shared.studies import refused_at
from wormopt.systems.spiked import (
    DesignTable,
    Objective,
    Shape,
)

with on_use():
    import numpy as np

    from wormopt.fitting.estimate import Fit
    from wormopt.fitting.fit import fit
    from wormopt.fitting.task import FitTask
    from wormopt.fitting.unknowns import Unknown
    from wormopt.systems.spiked import (
        Believed,
        driven_worm,
        gait_of_shape,
    )

_FORCES = ("actuator_force", "spike_load")
# Signals that depend on mass, drag and load even while spikes hold the worm.
_NO_FORCE = (
    "no column is a force, and the gait prescribes the motion for any mass, drag and load; record "
    "actuator forces, for example "
    'columns = {mu0 = "actuator_force[0]"}, or spike_load'
)
_MOTION = ("position", "velocity")


class CrawlRecording(RecordingFile):
    """A recording of a run with a known gait: readings of gauges over time.

    The gait begins at time 0 of the file with the worm at rest. Columns are `actuator_force[0]` and
    so on, one per link; `spike_load`, the sum over all spikes; and additionally `position` and
    `velocity`. With this gait the worm may glide; corners are refused.
    """

    gait: Shape = entry("gait of the links; `shape` selects the other keys")


class CrawlFit(Given):
    """Settings of the fit."""

    numbers: tuple[Literal["mass", "drag", "load"], ...] = entry(
        "parameters of `[worm]` to estimate; the others keep their values there",
        default=("mass", "drag", "load"),
    )
    noise: dict[str, Positive] = entry(
        "known standard deviation of readings of each signal, `{actuator_force = 0.2}`; the "
        "others are estimated",
        default=dict,
    )
    seeds: int = whole(
        1, 1000, "number of starts: `[worm]`, and others spread within the bounds", default=4
    )
    seed: Seed = entry("seed of the random spread of the starts", quantity="count", default=0)


class Plant(Given):
    """The real worm to test the gait on; neither the fit nor the design uses it."""

    mass: PerMass = entry("point masses; mass 0 is the head", quantity="mass", per="masses")
    drag: float = number("drag", "viscous drag on each mass", least=0, default=0.0)
    load: float = number("force", "load on each mass", least=0, default=0.0)


@dataclass(frozen=True)
class Estimates:
    """Estimated parameters, with recorded and fitted forces run by run."""

    mass_found: list[float] = value("mass", "estimated point masses")
    mass_error: list[float] = value("mass", "standard errors of the masses, 0 if not fitted")
    drag_found: float = value("drag", "estimated drag")
    drag_error: float = value("drag", "standard error of the drag")
    load_found: float = value("force", "estimated load")
    load_error: float = value("force", "standard error of the load")
    n_readings: int = value("count", "number of fitted readings")
    reading_time: np.ndarray = signal("time", "reading", "times of the readings, run by run")
    reading_run: np.ndarray = signal("count", "reading", "index of the run")
    read_force: np.ndarray = signal(
        "force", "link reading", "recorded actuator forces, NaN if missing"
    )
    fitted_force: np.ndarray = signal("force", "link reading", "fitted actuator forces")


class FitDesign(DesignTable, BelievedDesign, kind="fit-design"):
    """Design a gait whose limits hold for a worm with fitted parameters.

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

    Refused: recordings without a force; a range of loads in `[worm]`.

    Exit code 3: the fit did not converge, or leaves residuals of more than three times the given
    noise; a parameter is not identifiable from the recordings; no gait meets the limits; or, with
    `[plant]`, the gait violates a limit there.
    """

    refuses: ClassVar = {
        "gait.sharing": "makes loads nonlinear in masses, drag and load, so errors cannot be "
        "propagated; remove it",
        "gait.impulses": "true, but impulses load spikes without bounds; remove the key",
        "recording.use": 'runs can be held out in kind "fit" only; remove the key',
    }
    headline: ClassVar = (
        "speed",
        "speed_if_known",
        "load_range",
        "plant_speed",
        "plant_spike_load_max",
        "plant_share",
        "mode_sequence",
    )
    pictures: ClassVar = {
        "forces": "readings, fit and residuals",
        "loads": "load of a resting spike, worst case and on the plant",
        "gait": ("as for kind `gait`", "wormopt.systems.spiked.pictures:gait"),
        "motion": ("as for kind `gait`", "wormopt.systems.spiked.pictures:motion"),
        "spikes": ("as for kind `gait`", "wormopt.systems.spiked.pictures:spikes"),
    }

    recording: tuple[CrawlRecording, ...] = entry("recorded runs of the worm")
    fit: CrawlFit = entry("the fit", default=CrawlFit)
    objective: Objective = entry("the objective")
    confidence: float = CONFIDENCE
    plant: Plant | None = entry("the real worm, to test the gait on", default=None)

    def faults_of_keys(self) -> Iterator[Fault]:
        """Yield faults between keys, and faults in the files."""
        yield from self.faults_of_design()
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
        if not self.fit.numbers:
            yield "fit.numbers", 'the list is empty; write for example ["load"]'
        if not self.recording:
            yield "recording", "no entry is given; write a table [[recording]]"
        for k, recording in enumerate(self.recording):
            for key, what in recording.faults_in(self.folder, self.units, self.variables):
                yield f"recording[{k}].{key}", what
            yield from recording.gait.faults(self.worm.links, self.folder, f"recording[{k}].gait")
        yield from self._faults_of_forces()
        yield from named_twice((one.label for one in self.recording), "recording")

    def _faults_of_forces(self) -> Iterator[Fault]:
        """Yield a fault if no column of the text files is named like a force."""
        signals: list[str] = []
        for recording in self.recording:
            try:
                columns = recording.read(self.folder) if recording.is_text else None
            except SceneError:
                return
            if columns is None:
                return
            signals += (recording.columns.get(column, column) for column in columns.values)
        named = [name for recording in self.recording for name in recording.columns.values()]
        moved = all(name.startswith(_MOTION) for name in named)
        if moved and not any(s.startswith(_FORCES) for s in signals):
            yield "recording", _NO_FORCE

    # -- the fit -----------------------------------------------------------------------------------

    @stage
    def reading(self) -> list[Run]:
        found, faults = read_all(self.recording, self._run)
        read = [name for run in found for name in run.recording.readings]
        if not faults and not any(name in read for name in _FORCES):
            faults.append(("recording", _NO_FORCE))
        if faults:
            raise SceneError(self.name, faults)
        return found

    def _run(self, recording: CrawlRecording) -> Run:
        """Give the run of a recording, which starts at time 0 with the worm at rest."""
        worm = self.worm
        gait = gait_of_shape(recording.gait, self.scene)
        with refused_at(self, "gait"):
            model = driven_worm(gait, worm.masses, worm.drag, worm.load_range[0])
        run = run_of(recording, self.folder, model, self.units)
        read = run.recording
        begun = replace(read, model=read.model or model, span=(0.0, float(read.times[-1])))
        return replace(run, recording=begun)

    @stage
    def fitting(self) -> Fit:
        recordings = [run.recording for run in self.reading]
        model, table = recordings[0].model, self.fit
        assert model is not None
        unknowns = [Unknown(name) for name in table.numbers]
        with refused_at(self, "fit"):
            task = FitTask(model, recordings, unknowns, noise=table.noise or None)
        return fit(task, seeds=table.seeds, seed=table.seed, report=self.report)

    @cached_property
    def believed(self) -> Believed:
        """Masses, drag and load from the fit or the scene, with their covariance."""
        fitted, worm = self.fitting, self.worm
        names = [*(f"mass[{i}]" for i in range(len(worm.masses))), "drag", "load"]
        numbers = np.array([*worm.masses, worm.drag, worm.load_range[0]])
        at = [names.index(name) for name in fitted.names]
        numbers[at] = fitted.values
        covariance = np.zeros((len(names), len(names)))
        covariance[np.ix_(at, at)] = fitted.covariance
        freedom = fitted.task.count - len(at) if fitted.estimated else np.inf
        mass = tuple(numbers[:-2].tolist())
        drag, load = numbers[-2:].tolist()
        return Believed.of_one_load(mass, drag, load, covariance, freedom)

    @parts(Estimates)
    def estimates(self) -> Estimates:
        return estimates_of(self.fitting, self.believed)

    # -- the test on the plant ---------------------------------------------------------------------

    @property
    def real(self) -> Believed | None:
        """The real worm, if it is given."""
        if (plant := self.plant) is None:
            return None
        mass = tuple(per(plant.mass, len(self.worm.masses)))
        exact = np.zeros((len(mass) + 2, len(mass) + 2))
        return Believed.of_one_load(mass, plant.drag, plant.load, exact)

    # -- trust -------------------------------------------------------------------------------------

    @warnings
    def doubts(self) -> Iterator[str]:
        yield from self.fitting.warnings
        for run in self.reading:
            yield from run.warnings
        if self.converged:
            yield from self.second_route.warnings

    @facts
    def evidence(self) -> Mapping[str, Any]:
        fitted = self.fitting
        found = {
            "fit": {
                "converged": fitted.converged,
                "starts": [
                    {"cost": start.cost, "agrees": start.agrees, "evaluations": start.evaluations}
                    for start in fitted.starts
                ],
                "noise": dict(fitted.noise),
                "noise_estimated": list(fitted.estimated),
                "at_bound": list(fitted.at_bound),
                "left_out": {r.recording.name: [*r.left_out] for r in self.reading if r.left_out},
            }
        }
        return {**found, **self.robust_facts} if fitted.converged else found


def estimates_of(fitted: Fit, believed: Believed) -> Estimates:
    """Collect estimates, and recorded and fitted actuator forces."""
    errors, masses = np.sqrt(np.diag(believed.spread)), len(believed.mass)
    runs, motions = fitted.task.runs, fitted.task.motions(fitted.theta)
    forces = [motion["actuator_force"] for motion in motions]
    read = [
        run.readings.get("actuator_force", np.full(force.shape, np.nan))
        for run, force in zip(runs, forces, strict=True)
    ]
    of_run = [np.full(len(run.times), k, dtype=np.int32) for k, run in enumerate(runs)]
    return Estimates(
        mass_found=list(believed.mass),
        mass_error=errors[:masses].tolist(),
        drag_found=believed.drag,
        drag_error=float(errors[masses]),
        load_found=believed.load[0],
        load_error=float(errors[-1]),
        n_readings=fitted.task.count,
        reading_time=np.concatenate([run.times for run in runs]),
        reading_run=np.concatenate(of_run),
        read_force=np.concatenate(read, axis=1),
        fitted_force=np.concatenate(forces, axis=1),
    )
