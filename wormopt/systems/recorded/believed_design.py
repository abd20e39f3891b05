"""Gaits for worms with fitted parameters: design, results, and a trial on the real worm."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from wormopt.errors import SolveError
from wormopt.quantities import Scalar, unit_of
from wormopt.result import Check
from wormopt.study import (
    arrays,
    checks,
    number,
    on_use,
    parts,
    scalar,
    scalars,
    signal,
    stage,
    value,
)
from wormopt.systems.recorded.found import checks_of_noise
from wormopt.systems.shared.declared import GAIT
from wormopt.systems.spiked import (
    DESIGN_SCALARS,
    MOTION_VARIABLES,
    GaitStudy,
    Limits,
    Objective,
    Search,
)

with on_use():
    import numpy as np

    from wormopt.systems.spiked import (
        Believed,
        Crawl,
        Design,
        DesignReport,
        Robust,
        design_believed,
        designed,
        load_band,
        of_design,
        on_plant,
        with_keys,
    )

# A key of each kind: a base with keys of its own cannot stand beside the tables of designs.
CONFIDENCE = number(
    "share",
    "confidence that the gait meets its limits at all times",
    least=0.5,
    below=1,
    default=0.9999,
)
_ACCEPTED = 1e-9  # share by which a limit on the plant may be exceeded


@dataclass(frozen=True)
class Band:
    """Load of a resting spike over a cycle, and its worst-case error."""

    band_time: np.ndarray = signal("time", "band", "times in a cycle")
    band_load: np.ndarray = signal("force", "band", "load of a resting spike with the estimates")
    band_error: np.ndarray = signal("force", "band", "worst-case error of this load")


@dataclass(frozen=True)
class OnPlant:
    """Motion of the gait on the real worm, compared with the best gait for that worm."""

    motion: Crawl
    plant_speed: float = value("speed", "with `[plant]`: speed of the gait there")
    plant_spike_load_max: float = value(
        "force", "with `[plant]`: largest spike load of the gait there"
    )
    plant_spike_load_bold: float = value(
        "force",
        "with `[plant]`: largest spike load there of the gait that assumes exact estimates",
    )
    plant_best: float = value(
        "speed", "with `[plant]`: speed of the gait designed for its parameters"
    )
    plant_share: float = value("share", "with `[plant]`: `plant_speed` divided by `plant_best`")
    plant_distance: float = value(
        "1",
        "with `[plant]`: distance of its parameters from the estimates, in standard errors; "
        "within `reach` the limits are guaranteed",
    )
    plant_time: np.ndarray = signal("time", "plant", "with `[plant]`: times in a cycle")
    plant_load: np.ndarray = signal("force", "plant", "with `[plant]`: largest spike load there")
    bold_time: np.ndarray = signal(
        "time", "bold", "with `[plant]`: times in a cycle of the bold gait"
    )
    bold_load: np.ndarray = signal(
        "force", "bold", "with `[plant]`: largest spike load of the bold gait there"
    )


class BelievedDesign(GaitStudy):
    """Base of kinds that design a gait for a worm with fitted parameters.

    A kind gives the fit, `believed` and the real worm. This class designs, reports and tests.
    """

    if TYPE_CHECKING:  # keys and members of each kind
        objective: Objective
        confidence: float
        fitting: Any  # a stage with the Fit
        believed: Any  # member with a Believed

    @property
    def converged(self) -> bool:
        """Whether the fit converged; else there is no design."""
        return self.fitting.converged

    @property
    def real(self) -> Believed | None:
        """The real worm, with parameters that are known exactly, if it is given."""
        raise NotImplementedError

    @property
    def plant_limits(self) -> Limits:
        """The limits, which may depend on the parameters of the real worm."""
        return self.limits

    def in_own_words(self, error: SolveError) -> SolveError:
        """Rewrite the error of a design with what the kind calls its limits."""
        return error

    # -- the design --------------------------------------------------------------------------------

    @stage
    def design(self) -> Robust:
        believed, limits = self.believed, self.limits
        how = self.objective, self.confidence, self.search, self.report
        try:
            return design_believed(believed, limits, *how)
        except SolveError as error:
            raise self.in_own_words(with_keys(error, self)) from None

    @stage
    def second_route(self) -> DesignReport:
        return of_design(self, self.design.design)

    @scalars(
        DESIGN_SCALARS
        | {"objective": ("speed", "objective reached, in its quantity, recomputed from the gait")},
        when="converged",
    )
    def numbers(self) -> Mapping[str, Any]:
        design: Design = self.design.design
        quantity = design.task.objective.quantity
        reached = Scalar(design.value, unit_of(quantity, self.units))
        return self.second_route.scalars | {"objective": reached}

    @arrays(MOTION_VARIABLES | GAIT, when="converged")
    def signals(self) -> Mapping[str, Any]:
        return self.second_route.variables

    @scalar(
        "share",
        "confidence that all limits hold at all times, if the model is correct",
        when="converged",
        name="confidence",
    )
    def confidence_of_limits(self) -> float:
        _ = self.design  # without a design there are no limits to hold
        return self.confidence

    @scalar("1", "size of the confidence ellipsoid, in standard errors", when="converged")
    def reach(self) -> float:
        return self.design.reach

    @scalar(
        "force",
        "how far the range of loads for which the gait is designed reaches below and above the "
        "estimate",
        when="converged",
    )
    def load_width(self) -> list[float]:
        return list(self.design.widths)

    @scalar("speed", "speed of the optimal gait if the estimates were exact", when="converged")
    def speed_if_known(self) -> float:
        return self.design.nominal.speed

    @parts(Band, when="converged")
    def band(self) -> Band:
        return Band(*load_band(self.design.design, self.believed, self.design.reach))

    # -- the test on the plant ---------------------------------------------------------------------

    @property
    def is_tested(self) -> bool:
        """Whether the gait is tested on the real worm."""
        return self.real is not None and self.converged

    @stage
    def best_on_plant(self) -> Design:
        nominal, real = self.design.nominal, self.real
        assert real is not None
        known = Search(sequence=nominal.sequence, workers=self.search.workers)
        task = nominal.task.vary(worm=real.worm(), limits=self.plant_limits)
        try:
            return designed(task, known, self.report)
        except SolveError as error:
            reason = f"the designed gait was found, but on the worm of plant {error.reason}"
            raise SolveError(reason, error.suggestion, error.partial, error.code) from None

    @parts(OnPlant, when="is_tested")
    def test_on_plant(self) -> OnPlant:
        real, found = self.real, self.design
        assert real is not None
        motion, bold = (on_plant(one, real.worm()) for one in (found.design, found.nominal))
        best = self.best_on_plant
        return OnPlant(
            motion=motion,
            plant_speed=motion.speed,
            plant_spike_load_max=motion.extremes("reaction")[1].max(),
            plant_spike_load_bold=bold.extremes("reaction")[1].max(),
            plant_best=best.speed,
            plant_share=motion.speed / best.speed,
            plant_distance=self.believed.distance(real.numbers),
            plant_time=motion.time,
            plant_load=motion["reaction"].max(axis=0),
            bold_time=bold.time,
            bold_load=bold["reaction"].max(axis=0),
        )

    # -- trust -------------------------------------------------------------------------------------

    @checks
    def verdicts(self) -> Iterator[Check]:
        fitted = self.fitting
        if not fitted.converged:
            advice = f"the fit did not converge: {fitted.reason}"
            yield Check("fit", fitted.offset, 0.0, advice, passed=False)
            return
        yield from checks_of_noise(fitted)
        yield from self.second_route.checks
        if self.is_tested:
            yield from self._checks_of_plant(self.test_on_plant.motion)

    def _checks_of_plant(self, motion: Crawl) -> Iterator[Check]:
        limits: dict[str, Any] = {
            "spike_load": ("reaction", self.plant_limits.spike_load),
            "actuator_force": ("actuator_force", self.plant_limits.actuator_force),
        }
        for key, (name, most) in limits.items():
            if most is None:
                continue
            low, high = motion.extremes(name)
            over = float(np.max(np.maximum(np.abs(low), np.abs(high)) / np.asarray(most))) - 1.0
            advice = (
                f"on the plant gait.{key} is exceeded by {over:.2g} of its value: the plant's "
                "parameters lie outside the ellipsoid, or the model does not describe the plant"
            )
            yield Check(f"gait.{key} on the plant", max(over, 0.0), _ACCEPTED, advice)
        glides = float(len(motion.glides))
        yield Check("glides on the plant", glides, 0.0, "the worm glides on the plant")

    @property
    def robust_facts(self) -> Mapping[str, Any]:
        """Facts on the design, for the trust report."""
        rule = (
            "Scheffe: with this confidence all parameters lie in one ellipsoid, and all limits "
            "hold at all times for all parameters in it, if the model is correct"
        )
        robust = {"rule": rule, "designs": self.design.rounds}
        return {**self.second_route.facts, "robust": robust}
