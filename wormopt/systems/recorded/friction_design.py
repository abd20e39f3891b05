"""Kind "friction-design": a gait for a worm on dry ground whose parameters a fit has found."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

from msgspec import structs

from wormopt.errors import Fault, SceneError, SolveError
from wormopt.quantities import Scalar
from wormopt.study import (
    entry,
    facts,
    on_use,
    parts,
    scalars,
    signal,
    stage,
    value,
    warnings,
)
from wormopt.study.scene import Scene, load_scene
from wormopt.systems.recorded.believed_design import CONFIDENCE, BelievedDesign
from wormopt.systems.recorded.fit import FitRecordings
from wormopt.systems.recorded.found import label_of
from wormopt.systems.recorded.tables import SceneTables, scene_of
from wormopt.systems.shared.gravity import assumed
from wormopt.systems.spiked import Objective, WormlessDesignTable

with on_use():
    import numpy as np
    from scipy.special import fdtr, fdtri

    from wormopt.fitting.estimate import Fit
    from wormopt.fitting.profile import Profile, profile
    from wormopt.model.model import Model
    from wormopt.systems.spiked import Believed, Limits

_CHAIN = ("mass", "drag", "load", "friction_forward", "friction_backward")
_SPRINGS = ("stiffness", "damping", "rest_length")
_ASSUMED = {
    "lengths": "the drives prescribe the link lengths, whatever the forces",
    "rest": "at least gait.resting masses rest at any time and none moves backward, so friction "
    "backward acts on resting masses only; gaits that slip are not considered",
    "stiction": "equal to the sliding friction, as in the fit",
    "split": "several resting masses carry the same load each, friction forward included; statics "
    "leaves the split open, but not whether they hold if their friction is the same",
    "springs": "actuators act beside the springs of the links: their force is stiffness * (length "
    "- rest_length) + damping * rate - link force",
}


@dataclass(frozen=True)
class FoundWorm:
    """The fitted worm and the forces along its gait, with the estimates."""

    mass_found: list[float] = value("mass", "masses, head first, fitted or given")
    drag_found: float = value("drag", "drag of each mass")
    load_found: list[float] = value("force", "load on each mass, without friction")
    forward_found: list[float] = value("force", "friction of each mass against forward motion")
    backward_found: list[float] = value("force", "friction of each mass against backward motion")
    held_max: list[float] = value(
        "force", "largest forward force of the ground on each resting mass, to compare with "
        "`backward_found`",
    )  # fmt: skip
    held_min: list[float] = value(
        "force", "smallest such force; negative ones are at most `forward_found` in size"
    )
    input_max: list[float] = value("force", "largest size of `input` of each link")
    held: np.ndarray = signal("force", "mass time", "force of the ground on a resting mass")
    input: np.ndarray = signal("force", "link time", "force of the actuators beside the springs")
    commanded_length: np.ndarray = signal(
        "length",
        "link time",
        "rest lengths that give the gait if the springs are driven through them; NaN without a "
        "spring",
    )


class FrictionDesign(WormlessDesignTable, BelievedDesign, kind="friction-design"):
    """Design a gait for a worm on dry ground from recordings of its motion.

    `[fit]` is a scene of kind [`fit`](fit.md): a chain under dry friction, its recordings and its
    unknown parameters. The fit runs first. The gait is then designed so that its limits hold for
    all parameters in a confidence ellipsoid with the requested confidence: no resting mass slips
    under more than its friction backward, none is dragged forward against its friction forward,
    and no actuator needs more than `gait.actuator_force`. The ellipsoid is wider where the profile
    of a friction is wider than its standard error says.

    The sliding friction forward loads every mass, and a resting mass carries at most the sum of its
    friction forward and backward. The gait is that of kind [`gait-design`](gait-design.md) for this
    load and this `spike_load`. Results such as `spike_load_max` and `actuator_force` are those at
    the largest load of a range, and contain the friction forward. `held`, the force of the ground
    itself, `input` and `commanded_length` are those of the estimates. Theory:
    [dry ground](../theory-kinematic.md#9-gaits-on-dry-ground). Guide:
    [fit friction from a video](../howto/fit-friction-from-a-video.md).

    With `[plant]`, the gait is tested on the real worm. The trust report lists the assumptions.

    Refused: other friction than `coulomb` without stiction, or none; drag that differs between
    masses; parameters fitted for each run; costs that depend on the parameters.

    Exit code 3: the fit did not converge, or leaves residuals of more than three times the given
    noise; a parameter is not identifiable from the recordings; no gait meets the limits; or, with
    `[plant]`, the gait violates a limit there.
    """

    refuses: ClassVar = {
        "gait.spike_load": "given, but the fitted friction holds the masses; remove it",
        "gait.sharing": "makes loads nonlinear in the parameters, so errors cannot be propagated; "
        "remove it",
        "gait.impulses": "true, but friction holds no impulse; remove the key",
    }
    headline: ClassVar = (
        "speed",
        "speed_if_known",
        "held_max",
        "backward_found",
        "plant_speed",
        "plant_share",
        "mode_sequence",
    )
    pictures: ClassVar = {
        "holding": (
            "force of the ground on resting masses, and what is left until one slips, with its "
            "worst case",
            "wormopt.systems.recorded.holding:holding",
        ),
        "gait": ("as for kind `gait`", "wormopt.systems.spiked.pictures:gait"),
        "motion": ("as for kind `gait`", "wormopt.systems.spiked.pictures:motion"),
    }

    fit: SceneTables = entry(
        "a scene of kind `fit`: `scene`, its file, with other keys that change it; or its tables"
    )
    objective: Objective = entry("the objective")
    confidence: float = CONFIDENCE
    plant: dict[str, Any] | None = entry(
        "the real worm, to test the gait on: keys of the scene in `[fit.model]` with its values, "
        '`{"worm.friction.forward" = 0.3}`. Neither the fit nor the design uses it',
        default=None,
    )

    # -- the scene of the fit ----------------------------------------------------------------------

    @cached_property
    def fit_scene(self) -> Scene[Any]:
        """The scene of the fit; SceneError if it is wrong."""
        found = scene_of(self.fit, self.folder, self.units, "fit")
        if not isinstance(found.table, FitRecordings):
            what = f'"{found.table.kind}"; write a scene of kind "fit"'
            raise SceneError("fit", [("fit.kind", what)])
        return found

    @property
    def study(self) -> FitRecordings:
        """The study of the fit."""
        return self.fit_scene.table

    @property
    def chain(self) -> Any:
        """Table of the chain that is fitted."""
        study = self.study
        return getattr(scene_of(study.model, study.folder, study.units).table, "worm", None)

    @property
    def counts(self) -> Mapping[str, int]:
        """Numbers of links and masses."""
        try:
            links = self.chain.links
        except (SceneError, AttributeError):
            return {}
        return {"links": links, "masses": links + 1}

    def faults_of_keys(self) -> Iterator[Fault]:
        """Yield faults between keys, and faults of the fit."""
        try:
            wrong = [*_faults_of_chain(self.chain)]
        except SceneError as error:
            yield from error.faults
            return
        yield from wrong
        if wrong:
            return
        yield from self.faults_of_limits()
        yield from self.objective.faults_in_scene()
        yield from self._faults_of_gait()
        if self.plant is not None:
            try:
                _ = self._plant_scene
            except SceneError as error:
                yield from ((f"plant.{key}", what) for key, what in error.faults)

    def _faults_of_gait(self) -> Iterator[Fault]:
        if self.objective.is_smooth:
            yield (
                "objective.minimise",
                f"{self.objective.minimise} depends on the parameters, which have errors; choose "
                "speed or a peak",
            )

    # -- the fit -----------------------------------------------------------------------------------

    @stage
    def fitting(self) -> Fit:
        study = self.study
        study.part_of(self)
        try:
            coordinates = study.task.coordinates
        except SceneError as error:
            faults = [(f"fit.{key}".removesuffix("."), what) for key, what in error.faults]
            raise SceneError(self.name, faults) from None
        for one in coordinates:
            if one.run is not None and set(one.directions) & {*_CHAIN, *_SPRINGS}:
                what = f"{one.name} is fitted for each run, but the gait needs one value"
                raise SceneError(self.name, [("fit.unknown", f"{what}; remove per_run")])
        return study.estimation

    @scalars({})
    def estimates(self) -> dict[str, Scalar]:
        _ = self.fitting
        found = dict(self.study.found.scalars)
        for name, one in (self.profiling if self.converged else {}).items():
            label = f"{label_of(name)}_interval"
            found[label] = Scalar(_interval(one, self.fitting, self.study.level), found[label].unit)
        return found

    @cached_property
    def _parameters(self) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
        """Values of the fitted model's parameters, and their derivatives by its coordinates."""
        fitted = self.fitting
        values = values_of(self.study.fitted_model)
        slopes = {name: np.zeros((len(v), len(fitted.theta))) for name, v in values.items()}
        for k, one in enumerate(fitted.task.coordinates):
            for name, direction in one.directions.items():
                if name in values:
                    moved = direction != 0
                    values[name][moved] = one.value(fitted.theta[k]) * direction[moved]
                    slopes[name][:, k] = one.slope(fitted.theta[k]) * direction
        return values, slopes

    @property
    def friction_names(self) -> list[str]:
        """Names of the estimates that friction depends on."""
        known = np.isfinite(np.diag(self.fitting.covariance))
        pairs = zip(self.fitting.task.coordinates, known, strict=True)
        rubs = {"friction_forward", "friction_backward"}
        return [one.name for one, finite in pairs if finite and rubs & set(one.directions)]

    @stage
    def profiling(self) -> Mapping[str, Profile]:
        """Profiles of the friction, to the size of the ellipsoid."""
        first, names = self._by_curvature, self.friction_names
        if not names:
            return {}
        level = float(fdtr(1, min(first.freedom, 1e9), first.reach(self.confidence) ** 2))
        return profile(self.fitting, names, level=level, report=self.report)

    @cached_property
    def widened(self) -> np.ndarray:
        """Factor of each estimate's error by its profile; infinite where readings do not bound it.

        More friction backward than estimated breaks no limit, so only its lower end counts.
        """
        fitted = self.fitting
        reached = self._by_curvature.reach(self.confidence) * np.sqrt(np.diag(fitted.covariance))
        found = np.ones(len(fitted.theta))
        for name, one in self.profiling.items():
            k = fitted.names.index(name)
            coordinate = fitted.task.coordinates[k]
            ends = np.where(one.open, [-np.inf, np.inf], one.interval)
            if coordinate.log:
                ends = np.log(ends, where=ends > 0, out=np.full(2, -np.inf))
            sides = np.abs(ends - fitted.theta[k]) / reached[k]
            only_backward = set(coordinate.directions) == {"friction_backward"}
            found[k] = max(1.0, *(sides[:1] if only_backward else sides))
        return found

    @cached_property
    def believed(self) -> Believed:
        """The worm with errors as wide as its profiles."""
        first = self._by_curvature
        return replace(first, covariance=first.covariance * np.outer(self.widened, self.widened))

    @cached_property
    def _by_curvature(self) -> Believed:
        """Masses, drag, loads and grips of the worm, with their covariance."""
        fitted = self.fitting
        values, slopes = self._parameters
        _, drag, load, grip = _as_spiked(values)
        _, d_drag, *_ = _as_spiked(slopes)
        if not np.allclose(drag, drag[0]) or not np.allclose(d_drag, d_drag[0]):
            what = "the drag differs between masses; give or fit one drag for all"
            raise SceneError(self.name, [("fit", what)])
        if not (np.all(load > 0) and np.all(grip > load)):
            raise SolveError(
                "friction forward with the load must be positive and below friction forward and "
                f"backward together, but these are {load.tolist()} and {grip.tolist()}",
                "give bounds of the friction, or turn the worm round",
            )
        freedom = fitted.task.count - len(fitted.theta) if fitted.estimated else np.inf
        found = _believed(values, slopes, fitted.covariance, freedom)
        if self.gait.actuator_force is None:
            return found
        return replace(found, beside=np.vstack([slopes[name] for name in _SPRINGS]))

    # -- limits ------------------------------------------------------------------------------------

    @property
    def limits(self) -> Limits:
        """Limits of the gait; those of the actuators without what the springs may need."""
        return self._beside_springs(*self._parameters, self.believed.reach(self.confidence))

    def _beside_springs(
        self, values: dict[str, np.ndarray], slopes: dict[str, np.ndarray], reach: float
    ) -> Limits:
        """Limits less the largest forces of springs and dashpots, within `reach` of the values."""
        limits = super().limits
        if (given := limits.actuator_force) is None:
            return limits
        ranges = np.array(limits.length_ranges(self.counts["links"]))
        rates = np.max(limits.rate_bounds(self.counts["links"]), axis=0)
        covariance, most = self.fitting.covariance, np.zeros(len(ranges))
        names, errors = self.fitting.names, np.diag(covariance)
        unknown = {n for n, error in zip(names, errors, strict=True) if not np.isfinite(error)}
        c, d, rest = (values[name] for name in _SPRINGS)
        for length in ranges.T:
            for rate in (-rates, rates):
                force = c * (length - rest) + d * rate
                slope = slopes["stiffness"] * (length - rest)[:, None]
                slope += slopes["damping"] * rate[:, None] - slopes["rest_length"] * c[:, None]
                used = np.any(slope != 0, axis=0)
                if lost := [n for n, k in zip(names, used, strict=True) if k and n in unknown]:
                    raise SolveError(
                        f"{', '.join(lost)} cannot be identified from the recordings, but the "
                        "actuators act beside springs and dashpots",
                        "record forces, give known values, or remove gait.actuator_force",
                    )
                inner = slope[:, used] @ covariance[np.ix_(used, used)] @ slope[:, used].T
                most = np.maximum(most, np.abs(force) + reach * np.sqrt(np.diag(inner)))
        left = np.asarray(given) - most
        if np.any(left <= 0):
            raise SolveError(
                "springs and dashpots alone may need "
                f"{', '.join(f'{one:.6g}' for one in most)} of gait.actuator_force = "
                f"{', '.join(f'{one:g}' for one in np.ravel(given))}, link by link",
                "write a narrower gait.length around the rest length, a smaller gait.rate, or a "
                "larger gait.actuator_force",
            )
        return structs.replace(limits, actuator_force=tuple(left.tolist()))

    def in_own_words(self, error: SolveError) -> SolveError:
        """Rewrite the error of a design: what limits spike loads here is friction."""
        if "gait.spike_load" not in f"{error.reason} {error.suggestion}":
            return error
        what = "gait.spike_load is here friction forward and backward of a mass together"
        return SolveError(error.reason, f"{error.suggestion}; {what}", code=error.code)

    # -- the worm under the gait -------------------------------------------------------------------

    @parts(FoundWorm, when="converged")
    def worm_found(self) -> FoundWorm:
        values, _ = self._parameters
        motion = self.design.design.motion_under(self.believed.mean_load)
        forward = values["friction_forward"]
        rests = motion["resting"] > 0
        held = np.where(rests, motion["reaction"] - forward[:, None], np.nan)
        c, d, rest = (values[name][:, None] for name in _SPRINGS)
        force = c * (motion["length"] - rest) + d * motion["rate"] - motion["actuator_force"]
        with np.errstate(all="ignore"):
            commanded = np.where(c > 0, rest + force / c, np.nan)
        return FoundWorm(
            mass_found=values["mass"].tolist(),
            drag_found=self.believed.drag,
            load_found=values["load"].tolist(),
            forward_found=forward.tolist(),
            backward_found=values["friction_backward"].tolist(),
            held_max=np.nanmax(held, axis=1).tolist(),
            held_min=np.nanmin(held, axis=1).tolist(),
            input_max=np.abs(force).max(axis=1).tolist(),
            held=held,
            input=force,
            commanded_length=commanded,
        )

    # -- the test on the plant ---------------------------------------------------------------------

    @property
    def _plant_scene(self) -> Scene[Any]:
        """Scene of the real worm."""
        study = self.study
        return load_scene(scene_of(study.model, study.folder, study.units), self.plant or {})

    @cached_property
    def _exact(self) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
        """Values of the real worm's parameters, and their derivatives, which are 0."""
        values = values_of(next(iter(self._plant_scene.table.models().values())))
        return values, {name: np.zeros_like(rows) for name, rows in self._parameters[1].items()}

    @property
    def real(self) -> Believed | None:
        """The real worm, if it is given."""
        return None if self.plant is None else _believed(*self._exact, self.fitting.covariance)

    @property
    def plant_limits(self) -> Limits:
        """Limits on the real worm, whose friction holds the masses."""
        limits, grip = self._beside_springs(*self._exact, 0.0), _as_spiked(self._exact[0])[3]
        return structs.replace(limits, spike_load=tuple(grip.tolist()))

    # -- trust -------------------------------------------------------------------------------------

    @warnings
    def doubts(self) -> Iterator[str]:
        yield from self.fitting.warnings
        if self.converged:
            yield from (words for one in self.profiling.values() for words in one.words)
        for run in self.study.reading:
            yield from run.warnings
        if self.converged:
            yield from self.second_route.warnings

    @facts
    def evidence(self) -> Mapping[str, Any]:
        fit = self.study.evidence
        if not self.converged:
            return {"fit": fit}
        return {"fit": fit, **self.robust_facts, **assumed(self.units, **_ASSUMED)}


def _as_spiked(of: Mapping[str, np.ndarray]) -> tuple[np.ndarray, ...]:
    """Mass, drag, load and grip of each mass of a spiked worm; or derivatives of these."""
    mass, drag, load, forward, backward = (of[name] for name in _CHAIN)
    return mass, drag, load + forward, forward + backward


def _believed(
    values: Mapping[str, np.ndarray],
    slopes: Mapping[str, np.ndarray],
    covariance: np.ndarray,
    freedom: float = math.inf,
) -> Believed:
    """Spiked worm with a chain's parameters; `slopes` are their derivatives by the coordinates."""
    mass, drag, load, grip = (tuple(each.tolist()) for each in _as_spiked(values))
    d_mass, d_drag, d_load, d_grip = _as_spiked(slopes)
    rows = np.vstack([d_mass, d_drag[:1], d_load, d_grip])
    return Believed(mass, drag[0], load, rows, covariance, freedom, grip)


def values_of(model: Model) -> dict[str, np.ndarray]:
    """Values of a chain's parameters, one for each mass or link."""
    masses = len(model.contacts)
    sizes = dict.fromkeys(_CHAIN, masses) | dict.fromkeys(_SPRINGS, masses - 1)
    found = {s.name: np.asarray(s.value, float) for s in (*model.p, *model.u)}
    return {name: np.array(np.broadcast_to(found[name], size)) for name, size in sizes.items()}


def _interval(profile: Profile, fitted: Fit, level: float) -> list[float]:
    """Confidence interval at another level from the points of a profile."""
    readings = min(fitted.task.count - len(fitted.theta), 1e9) if fitted.estimated else 1e9
    target = math.sqrt(fdtri(1, readings, level))
    z = np.sign(profile.values - profile.best) * np.sqrt(np.maximum(profile.rises, 0.0))
    z = np.maximum.accumulate(z)
    ends = np.interp([-target, target], z, profile.values, left=-np.inf, right=np.inf)
    return np.clip(ends, *profile.interval).tolist()


def _faults_of_chain(worm: Any) -> Iterator[Fault]:
    """Yield why no gait can be designed for the chain of a fit."""
    if not hasattr(worm, "ground"):
        what = 'the scene in [fit.model] has no chain; write kind = "simulate" with [worm]'
        yield "fit.model", what
        return
    laws = {getattr(law.__struct_config__, "tag", "") for law in worm.ground}
    if laws != {"coulomb"}:
        given = ", ".join(sorted(map(str, laws))) or "none"
        what = f'friction is {given}; write worm.friction.kind = "coulomb" for all masses'
        yield "fit.model", what
    elif any(law.stick_forward or law.stick_backward for law in worm.ground):
        yield "fit.model", "worm.friction has stiction, which is not considered; remove its keys"
    if worm.random is not None:
        yield "fit.model", "worm.random makes random links; remove it"
