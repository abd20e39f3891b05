"""Kind "film-wave": the best wave of a magnetic fluid film."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, ClassVar, Literal

from msgspec import Meta

from wormopt.errors import Fault, SceneError, SolveError
from wormopt.result import Check
from wormopt.study import (
    Given,
    Study,
    checks,
    entry,
    facts,
    number,
    on_use,
    parts,
    positive,
    scalar,
    signal,
    stage,
    value,
    warnings,
    whole,
)
from wormopt.study.numerics import MeshTable
from wormopt.study.types import Pair, Positive, wrong_order
from wormopt.systems.film.tables import CAPTURE_DELTA

with on_use():
    import numpy as np

    from wormopt.numerics.collocation import Collocation
    from wormopt.ocp.mesh import Mesh
    from wormopt.systems.film.cosine import CosineWave
    from wormopt.systems.film.float import cosine_drift
    from wormopt.systems.film.lubrication import surface_velocity
    from wormopt.systems.film.shapes import field_function, flow_constant, grid
    from wormopt.systems.film.wave_problem import (
        WaveAim,
        WaveLimits,
        carrying_cosine,
        field_needs,
        highest,
        largest_flow,
    )
    from wormopt.systems.film.wave_search import DesignedWave, best_wave
    from wormopt.systems.shared.optimum import in_keys, optimum_facts, warnings_of_optimum
    from wormopt.systems.shared.proof import CrossCheck

# Number of phases of the thickness. Where the field jumps, differences smooth it over two.
_NODES = 16384
# Slopes of the field use this many phases: they are third differences of the thickness.
_APART = 16
# A wave that barely holds a float may fail by round-off and quadrature.
_HELD = 1e-6
# Accepted errors: of quantities of order 1; of the field over its range; of its slope over the
# largest.
_NUMBER, _FIELD, _SLOPE = 1e-6, 1e-3, 1e-2
# Phases of the cosine wave.
_PHASES = 401

Values = Annotated[
    tuple[Positive, ...], Meta(min_length=1, max_length=32, description="1 to 32 numbers above 0")
]
# Each decade below takes four times as long, and changes the flow by a share of 1e-3.
Tension = Annotated[
    float, Meta(ge=1e-6, le=1e300, description="1e-6 or more: below, fronts are all but corners")
]
Tensions = Annotated[
    tuple[Tension, ...],
    Meta(min_length=1, max_length=32, description="1 to 32 numbers from 1e-6"),
]


class WavyFilm(Given):
    """The film."""

    tension: float = number(
        "1", "surface tension *W*; without it the field could make corners", least=1e-06
    )


class Limits(Given):
    """Limits of the wave."""

    thickness: Pair = entry(
        "bounds of the thickness over its mean 1, which lies between them", quantity="1"
    )
    field: float | None = positive(
        "1",
        "upper limit of the range of the field; required, but not allowed with `minimise`",
        default=None,
    )
    gradient: float | None = positive(
        "1",
        "upper limit of the slope of the field over the phase; default: the field may jump",
        default=None,
    )

    def faults_of_keys(self) -> Iterator[Fault]:
        wrong = list(wrong_order("thickness", self.thickness, may_be_equal=False))
        yield from wrong
        least, most = self.thickness
        if not wrong and not least < 1 < most:
            yield (
                "thickness",
                f"[{least:g}, {most:g}] does not contain the mean thickness 1; write one number "
                "below 1 and one above",
            )


class Aim(Given):
    """Objective of the wave: exactly one of `maximise` and `minimise`.

    `minimise` requires `mean_flow`, `capture`, or both. With `float_speed`, the wave with the
    largest flow is the result if it holds the float (speed 1). Otherwise a wave that holds the
    float is searched for; if none exists, the result is the wave with the largest drift.
    """

    maximise: Literal["mean_flow", "float_speed"] | None = entry(
        "mean flow, or mean velocity of a small float", default=None
    )
    minimise: Literal["field"] | None = entry("range of the field", default=None)
    mean_flow: float | None = number(
        "1", "lower limit of the mean flow, with `minimise`", above=0, below=1, default=None
    )
    capture: bool = entry(
        "whether the wave must hold a small float, with `minimise`", default=False
    )

    def faults_of_keys(self) -> Iterator[Fault]:
        if (self.maximise is None) == (self.minimise is None):
            yield (
                "",
                'no objective or two are given; write maximise = "mean_flow", maximise = '
                '"float_speed" or minimise = "field"',
            )
        elif self.minimise and self.mean_flow is None and not self.capture:
            yield (
                "",
                "is missing a requirement, since the least field makes no wave; write mean_flow = "
                "0.3, for example, or capture",
            )
        elif self.maximise and self.mean_flow is not None:
            yield "mean_flow", 'applies to minimise = "field" only; leave it out'
        elif self.maximise and self.capture:
            yield "capture", 'applies to minimise = "field" only; leave it out'


class Starts(Given):
    """Starting points of the search."""

    crests: int = whole(
        1,
        12,
        "largest number of crests at the start: waves with 1, 2, … equal crests; if a float "
        "must be held, also with one crest higher than the others",
        default=3,
    )


class OtherFilms(Given):
    """Combinations of other films and fields, with `maximise = "mean_flow"`."""

    tension: Tensions | None = entry(
        "values of *W*; default: that of the film", quantity="1", default=None
    )
    field: Values | None = entry(
        "ranges of the field; default: that of the limits", quantity="1", default=None
    )

    def faults_of_keys(self) -> Iterator[Fault]:
        if self.tension is None and self.field is None:
            yield "", "is empty; write tension = [0.1, 0.03], for example, or field = [...]"
        for name in ("tension", "field"):
            values = getattr(self, name) or ()
            if len(set(values)) < len(values):
                yield name, "repeats a number; write each once"


# -- what is computed together ---------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Sampled:
    """Results of a wave from values of its thickness alone."""

    thickness: np.ndarray  # (nodes,) on `grid`
    # (nodes,) (mu - 1) H² / (8 pi), least 0, by quadrature of (30) and second differences
    field: np.ndarray
    mean: float  # mean thickness
    mean_flow: float = value("1", "1 + *C*, by quadrature over the thickness found")
    c_constant: float = value("1", "*C*, by the same quadrature")
    float_drift: float = value(
        "1", "mean velocity of a small float over the wave speed; 1 if it is held"
    )
    capture_margin: float = value("1", "largest thickness + 3*C*; a float is held from −1e-6 on")
    thickness_min: float = value("1", "least thickness of the wave")
    thickness_max: float = value("1", "largest thickness of the wave")


@dataclass(frozen=True)
class CosineBeside:
    """The cosine wave within the same limits; all NaN where none meets the requirements."""

    cosine_delta: float = value("1", "amplitude of that wave")
    mean_flow_cosine: float = value(
        "1",
        "mean flow of the largest cosine wave within the limits; with `minimise` of the smallest "
        "that meets the requirements, unknown where thickness or gradient do not allow it",
    )
    field_range_cosine: float = value("1", "range of the field of the cosine wave")
    float_drift_cosine: float = value("1", "mean velocity of a small float on the cosine wave")


@dataclass(frozen=True)
class OverPhase:
    """The wave over its phase."""

    xi: np.ndarray = signal("rad", "xi", "phase t - x")
    height: np.ndarray = signal("1", "xi", "thickness over its mean")
    height_slope: np.ndarray = signal("1", "xi", "slope of the thickness over the phase")
    field_pressure: np.ndarray = signal("1", "xi", "least field as (mu - 1) H^2 / (8 pi)")
    surface_velocity: np.ndarray = signal(
        "1", "xi", "velocity of the surface over that of the wave"
    )


@dataclass(frozen=True)
class CosineOverPhase:
    """The cosine wave over its phase."""

    xi_cosine: np.ndarray = signal("rad", "xi_cosine", "phase t - x")
    height_cosine: np.ndarray = signal("1", "xi_cosine", "thickness of the cosine wave")
    field_pressure_cosine: np.ndarray = signal(
        "1", "xi_cosine", "least field of the cosine wave as (mu - 1) H^2 / (8 pi)"
    )
    surface_velocity_cosine: np.ndarray = signal(
        "1", "xi_cosine", "surface velocity of the cosine wave"
    )


@dataclass(frozen=True)
class Swept:
    """Best waves of other films and fields; NaN where none is found."""

    sweep_tension: np.ndarray = signal("1", "sweep_tension", "surface tension W")
    sweep_field: np.ndarray = signal("1", "sweep_field", "largest range of the field")
    sweep_mean_flow: np.ndarray = signal("1", "sweep_tension sweep_field", "largest mean flow")
    sweep_mean_flow_cosine: np.ndarray = signal(
        "1", "sweep_tension sweep_field", "mean flow of the cosine wave"
    )
    sweep_crests: np.ndarray = signal("1", "sweep_tension sweep_field", "crests of the best wave")


class FilmWave(Study, kind="film-wave"):
    """Optimise the wave of a magnetic fluid film: largest transport or least field.

    The wave has the largest mean flow, moves a small float fastest, or needs the least field. It is
    compared with the cosine wave within the same limits. Theory and results:
    [theory-film.md](../theory-film.md#4-wave-design). The scene is dimensionless, in the scales of
    eq. 25 of Zimmermann et al. 2007. Fields are (*μ* − 1)*H*²/(8π) over *P*, and only their range
    over a wavelength matters; `Fluid.field` converts them to A/m.

    Not allowed are requirements that no field can meet: a mean flow of `mean_flow_supremum` or
    more, and capture where even that flow does not suffice.

    Where the field jumps, variables over `xi` hold the values just before and just after. A crest
    is at 0. Variables of the sweep are NaN where no wave passes its checks.

    The trust report has `starts` (the result of each), and `checks` beside `accepted`. By
    quadrature of eq. 30 and second differences, these check *C*, mean and bounds of the thickness,
    range of the field, the field itself (mean difference over its range), its slope where limited,
    and the requirements. If one is violated, the status is `failed`.
    """

    pictures: ClassVar = {
        "film_wave": "shape, field and surface velocity, and other films if swept",
    }
    headline: ClassVar = (
        "mean_flow", "c_constant", "mean_flow_cosine", "cosine_delta", "mean_flow_supremum",
    )  # fmt: skip

    units: Literal["dimensionless"] = entry(
        "dimensionless, in the scales of eq. 25 of Zimmermann et al. 2007", default="dimensionless"
    )
    film: WavyFilm = entry("the film")
    limits: Limits = entry("limits of the wave")
    objective: Aim = entry("objective of the wave")
    mesh: MeshTable = entry(
        "mesh over the phase; the degree is at least 3",
        default=MeshTable(arcs=60),
    )
    search: Starts = entry("starting points of the search", default=Starts)
    map: OtherFilms | None = entry("other films and fields", default=None)

    def faults_of_keys(self) -> Iterator[Fault]:
        if self.objective.maximise and self.limits.field is None:
            yield "limits.field", "missing; write the largest range of the field"
        if self.objective.minimise and self.limits.field is not None:
            yield "limits.field", 'is the result of minimise = "field"; leave it out'
        if self.mesh.degree < 3:
            yield (
                "mesh.degree",
                "is below 3, but the field is at least linear on every arc; write 3 or more",
            )
        if self.map is not None and self.objective.maximise != "mean_flow":
            yield "map", 'needs maximise = "mean_flow"; leave [map] out'

    # -- the search --------------------------------------------------------------------------------

    @cached_property
    def bounds(self) -> WaveLimits:
        """Limits of the wave, with the tension of the film."""
        (least, most), limits = self.limits.thickness, self.limits
        return WaveLimits(self.film.tension, (least, most), limits.field, limits.gradient)

    @cached_property
    def sought(self) -> WaveAim:
        """The first objective; SceneError if no field can reach it."""
        if not self.objective.minimise:
            return WaveAim()
        sought = WaveAim("field", self.objective.mean_flow, self.objective.capture)
        if impossible := sought.out_of_reach(self.bounds.thickness):
            key = (
                "objective.mean_flow"
                if self.objective.mean_flow is not None
                else "objective.capture"
            )
            raise SceneError(self.name, [(key, impossible)])
        return sought

    def best(
        self, aim: WaveAim, near: DesignedWave | None = None, limits: WaveLimits | None = None
    ) -> DesignedWave:
        """Find the best wave for an objective, within the limits unless others are given."""
        mesh = self.mesh
        return best_wave(
            limits or self.bounds, aim, near=near, report=self.report, crests=self.search.crests,
            mesh=Mesh.even(1, mesh.arcs, Collocation(mesh.degree, mesh.scheme)),
            tolerance=mesh.tolerance,
        )  # fmt: skip

    @stage
    def optimisation(self) -> tuple[list[DesignedWave], list[str]]:
        """All waves found, the requested one last, and the reasons why later searches failed."""
        with np.errstate(all="ignore"):  # values that are not finite are checked later
            try:
                waves, missed = [self.best(self.sought)], list[str]()
            except SolveError as error:
                raise in_keys(error) from None
            if self.objective.maximise == "float_speed":
                self._carry_a_float(waves, missed)
            return waves, missed

    def _carry_a_float(self, waves: list[DesignedWave], missed: list[str]) -> None:
        """Add waves that carry a float faster than the wave with the largest flow."""

        def add(what: str, aim: WaveAim) -> None:
            try:
                waves.append(self.best(aim, waves[-1]))
            except SolveError as error:
                missed.append(
                    f"the search for the wave with {what} failed ({error.reason}): a float may be "
                    "faster than on the reported wave"
                )

        def margin(wave: DesignedWave) -> float:
            return sampled_wave(wave).capture_margin

        def speed(wave: DesignedWave) -> float:
            return sampled_wave(wave).float_drift

        if margin(waves[0]) >= 0:
            return
        add("the highest crest", WaveAim("margin"))  # with less flow, but it may hold the float
        if margin(waves[-1]) >= 0:
            return
        nearest = max(margin(waves[0]), margin(waves[-1]))
        waves.sort(key=speed)
        add("the fastest float", WaveAim("drift", margin=nearest))
        waves.sort(key=speed)

    @property
    def wave(self) -> DesignedWave:
        """The best wave."""
        return self.optimisation[0][-1]

    @stage
    def other_waves(self) -> Swept:
        limits, films = self.bounds, self.map
        assert films is not None
        assert limits.field is not None
        tensions, fields = films.tension or (limits.tension,), films.field or (limits.field,)
        found, cosine, crests = np.full((3, len(tensions), len(fields)), np.nan)
        for k, (i, j) in enumerate(np.ndindex(found.shape)):
            self.report(f"sweep: W = {tensions[i]:g}, field {fields[j]:g}", k / found.size)
            there = WaveLimits(tensions[i], limits.thickness, fields[j], limits.gradient)
            cosine[i, j] = CosineWave(there.cosine()).mean_flow
            try:
                with np.errstate(all="ignore"):
                    wave = self.best(self.sought, limits=there)
            except SolveError:
                continue
            shape = sampled_wave(wave)
            if all(check.passed for check in checks_of_wave(wave, self.sought, shape)):
                found[i, j], crests[i, j] = shape.mean_flow, wave.crests
        return Swept(np.array(tensions), np.array(fields), found, cosine, crests)

    # -- results -----------------------------------------------------------------------------------

    @parts(Sampled)
    def shape(self) -> Sampled:
        return sampled_wave(self.wave)

    @parts(CosineBeside)
    def cosine(self) -> CosineBeside:
        return cosine_beside(self.bounds, self.sought)

    @scalar("count", "number of upward crossings of the mean thickness in a wavelength")
    def crests(self) -> int:
        return self.wave.crests

    @scalar("1", "range of the field")
    def field_range(self) -> float:
        return self.wave.field_range

    @scalar("count", "number of phases between switches of the field, in a wavelength")
    def n_phases(self) -> int:
        return self.wave.repeats * self.wave.motion.mesh.phases

    @scalar("share", "largest local error of an arc, relative to nominal sizes of states")
    def defect_max(self) -> float:
        return float(self.wave.optimum.defects.max())

    @scalar("count", "iterations of all solves together")
    def solve_iterations(self) -> int:
        return sum(stage.iterations for stage in self.wave.stages.values())

    @scalar(
        "1", "least upper bound of the mean flow of all waves between the thicknesses, at any field"
    )
    def mean_flow_supremum(self) -> float:
        return largest_flow(self.bounds.thickness)

    @scalar("1", "difference between that bound and the mean flow")
    def gap_to_supremum(self) -> float:
        return self.mean_flow_supremum - self.shape.mean_flow

    @scalar(
        "1",
        "gain over the cosine wave: ratio of the flows, or of the drifts, or of the fields (how "
        "many times less)",
    )
    def gain(self) -> float:
        shape, cosine = self.shape, self.cosine
        if self.objective.minimise:
            return cosine.field_range_cosine / self.field_range
        if self.objective.maximise == "float_speed":
            return shape.float_drift / cosine.float_drift_cosine
        return shape.mean_flow / cosine.mean_flow_cosine

    @scalar("1", "whether the wave holds a small float")
    def captured(self) -> bool:
        return self.shape.float_drift == 1.0

    @scalar("1", "share of the wave at a bound of the thickness")
    def plateau_share(self) -> float:
        h, (least, most) = self.shape.thickness, self.bounds.thickness
        near = 1e-6 * (most - least)
        return float(np.mean((h <= least + near) | (h >= most - near)))

    @scalar("1", "surface tension *W*, as in the scene")
    def tension_number(self) -> float:
        return self.film.tension

    @scalar("1", "bounds of the thickness, as in the scene")
    def thickness_limits(self) -> tuple[float, float]:
        return self.bounds.thickness

    @scalar("1", "upper limit of the field's range, as in the scene")
    def field_limit(self) -> float | None:
        return self.limits.field

    @scalar("1", "difference of *C* between optimiser and quadrature; up to 1e-6 is accepted")
    def recheck_error(self) -> float:
        return abs(self.shape.mean_flow - self.wave.mean_flow)

    @parts(OverPhase)
    def over_phase(self) -> OverPhase:
        wave, xi = self.wave, self.wave.instants()
        h = wave.thickness(xi)
        velocity = surface_velocity(h, self.shape.c_constant)
        return OverPhase(xi, h, wave.slope(xi), wave.field(xi), velocity)

    @property
    def has_cosine(self) -> bool:
        """Whether a cosine wave meets the requirements."""
        return not math.isnan(self.cosine.cosine_delta)

    @parts(CosineOverPhase, when="has_cosine")
    def cosine_over_phase(self) -> CosineOverPhase:
        wave, xi = CosineWave(self.cosine.cosine_delta), np.linspace(0, 2 * math.pi, _PHASES)
        h, D = wave.height(xi), wave.field_function(xi, self.film.tension)
        return CosineOverPhase(xi, h, D.max() - D, surface_velocity(h, wave.constant))

    @parts(Swept, when="map")
    def swept(self) -> Swept:
        return self.other_waves

    # -- the trust report --------------------------------------------------------------------------

    @checks
    def by_quadrature(self) -> Iterator[Check]:
        return checks_of_wave(self.wave, self.sought, self.shape)

    @facts
    def of_optimisation(self) -> dict[str, Any]:
        wave, (constant, *_) = self.wave, self.by_quadrature
        second = CrossCheck(
            "quadrature over the thickness alone", constant.value, constant.limit,
            "the equations of the film",
        )  # fmt: skip
        trust = optimum_facts(wave.stages, second)
        phased = "phases" in wave.stages
        trust["treatment"] = "phases between switches of the field" if phased else "fixed mesh"
        del trust["complementarity_max"]
        starts = [
            {"start": t.start, "crests": t.crests, "reached": t.reached}
            for each in self.optimisation[0]
            for t in each.tries
        ]
        accepted = {check.name: check.limit for check in self.by_quadrature}
        return {**trust, "accepted": accepted, "starts": starts}

    @warnings
    def of_searches(self) -> Iterator[str]:
        wave, most, margin = self.wave, self.search.crests, self.shape.capture_margin
        yield from self.optimisation[1]
        yield from warnings_of_optimum(wave.optimum, self.mesh.tolerance)
        if wave.crests >= max(most, 2):
            yield (
                f"the best wave has {wave.crests} crests, and the search begins with at most "
                f"{most}; increase search.crests to check for better waves"
            )
        if -_HELD <= margin < _HELD:
            yield (
                f"the wave barely holds a small float: capture_margin is {margin:.2g}, and a "
                "disturbance may release it"
            )
        if self.limits.gradient is not None and "phases" not in wave.stages:
            yield (
                "with a limited slope, the field of the exact optimum switches infinitely often "
                "before the film reaches a bound of its thickness; on this mesh it switches a few "
                "times"
            )
        if not self.has_cosine:
            yield (
                "no cosine wave within the limits meets the requirements, so there is no comparison"
            )


# -- waves by quadrature of their shape alone ------------------------------------------------------


def sampled(h: np.ndarray, tension: float) -> Sampled:
    """Evaluate a wave from its thickness `h` (nodes,) on `grid`; its slope may have corners.

    Second differences smooth a jump of the curvature over two points, without overshoot.
    """
    C, apart = float(flow_constant(h)), 2 * np.pi / len(h)
    bend = (np.roll(h, 1) - 2 * h + np.roll(h, -1)) / apart**2
    field = -(np.asarray(field_function(h)) + tension * bend)
    margin = highest(h) + 3 * C
    # the surface is slower than the wave by (-3 C - h) / (2 h)
    held = margin >= -_HELD
    return Sampled(
        thickness=h,
        field=field - field.min(),
        mean=float(h.mean()),
        mean_flow=1 + C,
        c_constant=C,
        float_drift=1.0 if held else float(1 - 1 / np.mean(2 * h / (-3 * C - h))),
        capture_margin=margin,
        thickness_min=float(h.min()),
        thickness_max=float(h.max()),
    )


def sampled_wave(wave: DesignedWave) -> Sampled:
    """Evaluate an optimal wave from values of its thickness alone."""
    return sampled(wave.thickness(grid(_NODES)), wave.limits.tension)


def checks_of_wave(wave: DesignedWave, aim: WaveAim, shape: Sampled) -> Iterator[Check]:
    """Compare the optimiser's results and limits with those of the shape."""
    h, (least, most), limits = shape.thickness, wave.limits.thickness, wave.limits
    needed = float(np.ptp(shape.field)) / wave.field_range
    apart = shape.field - wave.field(grid(_NODES))
    mean = float(np.mean(np.abs(apart - np.median(apart)))) / wave.field_range
    yield _check("C by quadrature", abs(shape.mean_flow - wave.mean_flow), _NUMBER)
    yield _check("mean thickness", abs(shape.mean - 1), _NUMBER)
    beyond = max(least - h.min(), h.max() - most, 0.0)
    yield _check("thickness beyond its bounds", beyond, _NUMBER)
    yield _check("range of the field", max(0.0, needed - 1), _FIELD)
    yield _check("field by (30), mean difference", mean, _FIELD)
    if limits.gradient is not None:
        rise = np.roll(shape.field, -_APART) - shape.field
        steepest = np.abs(rise).max() * _NODES / (2 * np.pi * _APART)
        yield _check("slope of the field", max(0.0, steepest / limits.gradient - 1), _SLOPE)
    if aim.mean_flow is not None:
        yield _check("objective.mean_flow", max(0.0, aim.mean_flow - shape.mean_flow), _NUMBER)
    if aim.capture:
        yield _check("objective.capture", max(0.0, -shape.capture_margin), _NUMBER)


def _check(name: str, off: float, accepted: float) -> Check:
    advice = f"{name} differs by {off:.2g} where {accepted:g} is accepted"
    return Check(name, float(off), accepted, advice)


def cosine_beside(limits: WaveLimits, aim: WaveAim) -> CosineBeside:
    """Find the largest cosine wave within limits, or the smallest that meets the requirements."""
    if limits.field is not None:
        delta = limits.cosine()
    else:
        delta = carrying_cosine(aim.mean_flow or 0.0)
        delta = max(delta, CAPTURE_DELTA if aim.capture else 0.0)
        a, b = limits.thickness
        steep = field_needs(delta, limits.tension)[1] > (limits.gradient or math.inf)
        if delta > min(1 - a, b - 1) or steep:
            return CosineBeside(math.nan, math.nan, math.nan, math.nan)
    needed, _ = field_needs(delta, limits.tension)
    drift = 1.0 if delta >= CAPTURE_DELTA else float(cosine_drift(delta))
    return CosineBeside(delta, CosineWave(delta).mean_flow, needed, drift)
