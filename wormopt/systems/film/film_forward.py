"""Kind "film-forward": the wave of a magnetic fluid film in a given travelling field."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, Any, ClassVar, Literal

from msgspec import Meta

from wormopt.errors import ArgumentError, Fault, SceneError
from wormopt.result import NOT_RECHECKED, Check
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
from wormopt.study.types import Positive, wrong_order
from wormopt.systems.film.tables import Duration, Field, Film, Resolution, Share, SharePair
from wormopt.systems.shared.studies import refused_at

with on_use():
    import numpy as np

    from wormopt.analysis.continuation import Branch
    from wormopt.simulation.options import Tolerance
    from wormopt.systems.film.courses import (
        OUTCOMES,
        TAIL,
        Course,
        Fate,
        Resolved,
        Setting,
        basins,
        flow,
        follow,
        resolved,
        steady_branches,
    )
    from wormopt.systems.film.given_field import (
        GivenField,
        WaveField,
        film_thickness,
        film_volume,
        resampled,
    )
    from wormopt.systems.film.next_order import reach_warnings
    from wormopt.systems.film.shapes import Wave, grid

# Accepted loss of volume, residual of steady films, and effect of a tighter integrator.
_VOLUME, _RESIDUAL, _STEPS = 1e-12, 1e-6, 1e-5
# Share of the field in unresolved harmonics above which a warning is given.
_LEFT_OUT = 1e-6
# Number of eigenvalues that are kept.
_MODES = 24

Thicknesses = Annotated[
    tuple[Positive, ...],
    Meta(min_length=4, max_length=100_000, description="4 to 100000 finite numbers above 0"),
]
Amplitudes = Annotated[
    tuple[Share, ...],
    Meta(min_length=1, max_length=100, description="1 to 100 numbers above 0 and below 1"),
]
Tensions = Annotated[
    tuple[Positive, ...], Meta(min_length=1, max_length=100, description="1 to 100 numbers above 0")
]


class Start(Given):
    """The film at time 0."""

    shape: Literal["flat", "wave", "samples"] = entry(
        "shape: flat, the prescribed wave, or given samples", default="flat"
    )
    samples: Thicknesses | None = entry(
        "thickness at equidistant phases from 0 on, with mean 1", quantity="1", default=None
    )
    nudge: float = number(
        "1", "amplitude of an added ripple `nudge` cos(`harmonic` *ξ*)", default=0.0
    )
    harmonic: int = whole(1, 16, "harmonic of the ripple", default=1)

    def faults_of_keys(self) -> Iterator[Fault]:
        if self.shape == "samples" and self.samples is None:
            yield "samples", "missing; write the thickness over a wavelength"
        if self.shape != "samples" and self.samples is not None:
            yield "samples", 'applies to shape = "samples" only; write it, or leave samples out'

    def thickness(self, wave: Wave | None) -> Callable[[np.ndarray], np.ndarray]:
        """Thickness over the phase."""

        def thickness(xi: np.ndarray) -> np.ndarray:
            h = np.ones(len(xi))
            if self.shape == "wave" and wave is not None:
                h = wave.height(xi)
            elif self.samples is not None:
                h = resampled(np.array(self.samples), len(xi))
            return h + self.nudge * np.cos(self.harmonic * xi)

        return thickness


class StepTolerance(Given):
    """Tolerances of the simulation."""

    relative: float = number(
        "1",
        "relative error per step, against the size of a state",
        least=1e-12,
        most=0.001,
        default=1e-8,
    )
    absolute: float = positive("1", "absolute error per step, against 1", default=1e-10)
    max_steps: int = whole(1, 1000000000, "largest number of steps of a run", default=200_000)
    recheck: bool = entry(
        "whether the simulation is repeated with a hundredth of these tolerances", default=True
    )


class FlatFilms(Given):
    """Final states of flat films in the fields of many cosine waves.

    The map uses a single resolution where harmonics have decayed.
    """

    delta: Amplitudes = entry("amplitudes, ascending", quantity="1")
    tension: Tensions = entry("values of the surface tension *W*, ascending", quantity="1")

    def faults_of_keys(self) -> Iterator[Fault]:
        for name in ("delta", "tension"):
            values = getattr(self, name)
            if list(values) != sorted(set(values)):
                yield name, "is not strictly ascending; sort it, without repetitions"


class Continuation(Given):
    """Continuation of steady films in the amplitude of the prescribed cosine wave."""

    delta: SharePair = entry(
        "least and largest amplitude; the continuation passes folds", quantity="1"
    )
    points: int = whole(32, 256, "equidistant points over a wavelength", default=64)

    def faults_of_keys(self) -> Iterator[Fault]:
        yield from wrong_order("delta", self.delta, may_be_equal=False)


# -- what is computed together ---------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Simulated:
    """A film over time, and the steady films close to it."""

    outcome: str = value(
        "1",
        "`wave`: the film converges to the prescribed wave (with `[field]`: to the steady film "
        "closest to that wave); `other`: to another steady film; `moving`: it still moves at the "
        "end; `breaks`: it becomes thinner than `rupture`; `unresolved`: the points do not resolve "
        "it, status `failed`",
    )
    distance_to_wave: float | None = value(
        "1", "largest difference between the thickness at the end and the prescribed wave"
    )
    distance_to_steady: float | None = value(
        "1", "largest difference between the thickness at the end and the closest steady film"
    )
    growth_rate_max: float | None = value(
        "1",
        "largest growth rate of small deviations from the prescribed wave (with `[field]`: from "
        "the closest steady film); below 0: stable",
    )
    growth_rate_end: float | None = value(
        "1", "largest growth rate of small deviations from the steady film closest to the end"
    )
    mean_flow: float = value("1", "mean of *Q* at the end")
    mean_flow_wave: float | None = value("1", "mean of *Q* for the prescribed wave")
    volume_error: float = value("1", "largest deviation of the mean thickness from 1")
    thickness_max: float = value("1", "largest thickness at the end")
    thickness_min: float = value("1", "least thickness at the end")
    thickness_least: float = value("1", "least thickness over all times")
    broke_time: float | None = value("1", "time of rupture", when="broke")
    broke_xi: float | None = value("rad", "phase of rupture", when="broke")
    points: int = value("count", "final number of points")
    xi: np.ndarray = signal("rad", "xi", "phase t - x")
    instants: np.ndarray = signal("1", "time", "time", name="time")
    thickness: np.ndarray = signal("1", "time xi", "thickness over the mean thickness")
    thickness_end: np.ndarray = signal("1", "xi", "thickness at the end")
    thickness_wave: np.ndarray | None = signal("1", "xi", "prescribed thickness")
    flow_end: np.ndarray = signal("1", "xi", "flow Q at the end")
    field_pressure: np.ndarray = signal("1", "xi", "(mu - 1) H² / (8 pi)")
    growth_wave: np.ndarray | None = signal("1", "mode_wave", "growth rates of the prescribed wave")
    swing_wave: np.ndarray | None = signal(
        "1", "mode_wave", "angular frequencies of the prescribed wave's modes"
    )
    growth_end: np.ndarray | None = signal(
        "1", "mode_end", "growth rates of the steady film at the end"
    )
    swing_end: np.ndarray | None = signal("1", "mode_end", "angular frequencies of its modes")


@dataclass(frozen=True, eq=False)
class Branches:
    """Steady films over the amplitude."""

    branches: int = value("count", "number of branches of steady films")
    delta_fold: list[float] = value("1", "amplitudes of the folds")
    delta_stability: list[float] = value("1", "amplitudes near which stability changes")
    branch_delta: np.ndarray | None = signal(
        "1", "branch", "amplitude of the wave that the field prescribes"
    )
    branch_thickness_max: np.ndarray | None = signal("1", "branch", "largest thickness")
    branch_thickness_min: np.ndarray | None = signal("1", "branch", "least thickness")
    branch_mean_flow: np.ndarray | None = signal("1", "branch", "mean flow")
    branch_growth: np.ndarray | None = signal("1", "branch", "largest growth rate")
    branch_number: np.ndarray | None = signal("1", "branch", "index of the branch")


_MAP = "map_delta map_tension"
_OF_FILMS = ("distance", "growth_end", "crest", "least", "time", "points")


@dataclass(frozen=True, eq=False)
class Basins:
    """Outcomes of flat films by amplitude and tension; NaN where they are unknown."""

    map_wave: int = value("count", "films of the map that converge to the wave")
    map_other: int = value("count", "films of the map that converge to another steady film")
    map_moving: int = value("count", "films of the map that still move")
    map_breaks: int = value("count", "films of the map that rupture")
    map_unresolved: int = value("count", "films of the map that the points do not resolve")
    map_wave_unstable: int = value("count", "unstable waves of the map")
    map_wave_stable_not_reached: int = value(
        "count", "stable waves of the map that the flat film does not reach"
    )
    map_delta: Sequence[float] = signal("1", "map_delta", "amplitude of the wave")
    map_tension: Sequence[float] = signal("1", "map_tension", "surface tension W")
    map_outcome: np.ndarray = signal("1", _MAP, "0 wave, 1 other, 2 moving, 3 breaks, 4 unresolved")
    map_distance: np.ndarray = signal("1", _MAP, "distance from the prescribed wave at the end")
    map_growth: np.ndarray = signal("1", _MAP, "largest growth rate of the prescribed wave")
    map_growth_end: np.ndarray = signal(
        "1", _MAP, "largest growth rate of the steady film at the end"
    )
    map_crest: np.ndarray = signal("1", _MAP, "largest thickness at the end")
    map_least: np.ndarray = signal("1", _MAP, "least thickness over time")
    map_time: np.ndarray = signal("1", _MAP, "time of the end, or of rupture")
    map_points: np.ndarray = signal("1", _MAP, "points")


class FilmForward(Study, kind="film-forward"):
    """Compute the wave of a magnetic fluid film under a given field, and its stability.

    It answers whether the film takes the wave for which the field was made, and whether that wave
    is stable. Theory: [theory-film.md](../theory-film.md#3-forward-problem). `[film]` is the
    prescribed wave with its surface tension, in the least field that holds it. `[field]` replaces
    that field; the wave may then be left out, or is used for comparison. All results are
    dimensionless, in the scales of eq. 25 of Zimmermann et al. 2007, in SI scenes too.

    Not allowed: surface tension 0, with which the equation is of first order and its fronts break;
    fields that jump from their last sample to their first; permeabilities of 1 or below; too few
    points for the order.

    The trust report contains both resolutions with outcomes and difference, the share of the
    highest harmonics, the run with tighter tolerances, residuals of Newton's method, the difference
    between the closed form of the wave and the film on the points (`closed_form_difference`), and
    assumptions. The status is `failed` if twice the points or tighter tolerances change the
    outcome.
    """

    pictures: ClassVar = {
        "forward": "thickness over phase and time, film, field, eigenvalues, branches",
        "basins": "the map",
        "animation": ("the film, as a moving GIF", "animation_of_film"),
    }
    refuses: ClassVar = {
        "film.eps": "has no effect, since lubrication theory neglects it; leave it out"
    }
    headline: ClassVar = (
        "outcome", "distance_to_wave", "distance_to_steady", "growth_rate_max", "growth_rate_end",
    )  # fmt: skip

    film: Film = entry("prescribed wave, and surface tension above 0")
    field: Field | None = entry(
        "another field that replaces that of the prescribed wave", default=None
    )
    start: Start = entry("the film at time 0", default=Start)
    time: Duration = entry("duration of the simulation", default=Duration)
    grid: Resolution = entry("resolution of the film", default=Resolution)
    tolerance: StepTolerance = entry("tolerances of the simulation", default=StepTolerance)
    branch: Continuation | None = entry(
        "continuation of steady films in the amplitude; default: none", default=None
    )
    map: FlatFilms | None = entry("flat films in many fields; default: none", default=None)

    def faults_of_keys(self) -> Iterator[Fault]:
        yield from self.film.faults_in(self.units, needs_wave=self.field is None)
        yield from self._faults_of_tension()
        if self.field is not None:
            yield from self.field.faults_in(self.units, self.folder)
        if self.start.shape == "wave" and not self.film.has_wave:
            yield "start.shape", "needs a prescribed wave; write film.delta"
        if self.branch is not None:
            yield from self._faults_of_branch(self.branch)
        if self.map is None and "basins" in self.want:
            yield "map", 'missing; want = ["basins"] needs it'

    def _faults_of_tension(self) -> Iterator[Fault]:
        why = (
            "without surface tension the equation is of first order, and its fronts steepen "
            "until they break"
        )
        if self.units != "SI" and self.film.tension is None:
            yield "film.tension", "missing; write the surface tension W, for example 0.1"
        elif self.film.tension == 0:
            yield "film.tension", f"is not above 0; {why}; write 0.1, for example"
        if self.film.fluid is not None and self.film.fluid.surface_tension == 0:
            yield "film.fluid.surface_tension", f"is not above 0; {why}"

    def _faults_of_branch(self, branch: Continuation) -> Iterator[Fault]:
        least, largest = branch.delta
        if self.field is not None or self.film.delta is None:
            yield "branch", "follows cosine waves; write film.delta and no field"
        elif not least <= self.film.delta <= largest:
            yield "branch.delta", f"does not contain film.delta = {self.film.delta:g}"
        if branch.points < 2 * self.grid.order:
            yield (
                "branch.points",
                f"is too small for order {self.grid.order}; write {2 * self.grid.order}",
            )

    # -- the film and its field --------------------------------------------------------------------

    @cached_property
    def wave(self) -> Wave | None:
        """The prescribed wave."""
        return self.film.wave(self.name) if self.film.has_wave else None

    @cached_property
    def travelling_field(self) -> WaveField | GivenField:
        """The field; SceneError if a file contains none, or it is not periodic."""
        given = self.field
        if given is None:
            assert self.wave is not None  # the scene's faults ensure it
            return WaveField(self.wave, self.film.tension_number)
        try:
            field = GivenField(given.pressure(self.folder, self.units, self.film.fluid))
            field.slope(self.grid.points)
        except (ArgumentError, ValueError, OSError, KeyError) as error:
            key = "field.samples" if given.samples is not None else "field.file"
            raise SceneError(self.name, [(key, str(error).strip("'\""))]) from None
        return field

    @cached_property
    def setting(self) -> Setting:
        """The film and the settings of its simulation; SceneError for an impossible start."""
        wave, start, steps = self.wave, self.start.thickness(self.wave), self.tolerance
        field = self.travelling_field
        with refused_at(self, "start.samples" if self.start.shape == "samples" else "start.nudge"):
            h = start(grid(self.grid.points))
            if h.min() <= 0:
                raise ArgumentError("the thickness must be above 0 everywhere")
            film_volume(h, order=self.grid.order)
        tolerance = Tolerance(steps.relative, steps.absolute, steps.max_steps)
        height = None if wave is None else wave.height
        tension = self.film.tension_number
        return Setting(field.slope, tension, start, height, self.time, self.grid, tolerance)

    # -- what is computed --------------------------------------------------------------------------

    @stage
    def motion(self) -> Resolved:
        return resolved(self.setting, self.report)

    @property
    def followed(self) -> Course:
        """The film over time on the most points."""
        return self.motion.course

    @stage
    def motion_with_tighter_tolerances(self) -> Course | None:
        if not self.tolerance.recheck:
            return None
        given = self.setting.tolerance
        close = replace(
            given, relative=max(given.relative / 100, 1e-13), absolute=given.absolute / 100
        )
        return follow(replace(self.setting, tolerance=close), self.followed.points, self.report)

    @stage
    def steady_films(self) -> list[Branch]:
        assert self.branch is not None
        least, largest = self.branch.delta
        return steady_branches(
            self.followed, self.film.tension_number, (least, largest), points=self.branch.points,
            order=self.grid.order, report=self.report,
        )  # fmt: skip

    @stage
    def flat_films(self) -> list[list[Fate]]:
        assert self.map is not None
        return basins(self.setting, self.map.delta, self.map.tension, self.report)

    # -- results -----------------------------------------------------------------------------------

    @parts(Simulated)
    def simulated(self) -> Simulated:
        return _simulated(self.followed, self.setting, self.wave, self.travelling_field)

    @property
    def broke(self) -> bool:
        """Whether the film ruptured."""
        return self.followed.broke is not None

    @scalar("1", "*W*")
    def tension_number(self) -> float:
        return self.film.tension_number

    @scalar("1", "rupture thickness, as in the scene")
    def rupture_thickness(self) -> float:
        return self.time.rupture

    @parts(Branches, when="branch")
    def branches_found(self) -> Branches:
        return _branches(self.steady_films, self.grid.order)

    @parts(Basins, when="map")
    def map_found(self) -> Basins:
        assert self.map is not None
        return _basins(self.flat_films, self.map)

    # -- the trust report --------------------------------------------------------------------------

    @cached_property
    def tolerance_difference(self) -> float | None:
        """Effect of a hundredth of the tolerances on the end state."""
        one, other = self.followed, self.motion_with_tighter_tolerances
        if other is None or one.outcome != other.outcome or one.outcome == "unresolved":
            return None
        if one.broke is not None and other.broke is not None:
            return abs(one.broke[0] - other.broke[0])
        return float(np.abs(one.thickness[:, -1] - other.thickness[:, -1]).max())

    @checks
    def resolution(self) -> Iterator[Check]:
        course, coarser = self.followed, self.motion.coarser
        thin, last = course.thickness[:, -1], course.time[-1]
        held = course.outcome != "unresolved"
        advice = (
            f"{course.points} points do not resolve the film at t = {last:.6g} "
            f"({last / (2 * math.pi):.4g} periods), with thicknesses from {thin.min():.3g} to "
            f"{thin.max():.4g}; write more grid.most, or a larger time.rupture"
        )
        yield Check("points hold the film", course.tail, TAIL, advice, passed=held)
        if held and coarser is not None:
            advice = (
                f"{coarser.points} points end with {coarser.outcome!r}, {course.points} with "
                f"{course.outcome!r}; write more than grid.most = {self.grid.most}"
            )
            alike, limit = coarser.outcome == course.outcome, self.grid.agreement
            yield Check("outcome on half the points", self.motion.difference, limit, advice, alike)

    @checks
    def exactness(self) -> Iterator[Check]:
        course, tighter = self.followed, self.motion_with_tighter_tolerances
        if course.outcome == "unresolved":
            return
        advice = f"the volume changes by a share of {course.volume_error:.2g}"
        yield Check("volume", course.volume_error, _VOLUME, advice)
        changed = self.tolerance_difference
        if tighter is not None and tighter.outcome != course.outcome:
            advice = (
                f"with a hundredth of the tolerances the film ends with {tighter.outcome!r}, "
                f"not {course.outcome!r}; write smaller tolerances"
            )
            yield Check("tighter tolerances", None, _STEPS, advice)
        elif changed is not None:
            advice = f"a hundredth of the tolerances changes the end state by {changed:.2g}"
            fine = course.outcome == "moving" or not changed > _STEPS
            yield Check("tighter tolerances", changed, _STEPS, advice, fine)
        for name, film in (("prescribed wave", course.wave), ("film at the end", course.end)):
            if film is not None:
                # the film errs by its rates of change over those at which deviations change
                left = film.state.residual
                quick = max(1.0, float(np.abs(film.state.eigenvalues).min()))
                advice = f"{name} is not steady: its rates of change are {left:.2g}"
                yield Check(f"rates of the {name}", left / quick, _RESIDUAL, advice)

    @facts
    def of_simulation(self) -> dict[str, Any]:
        course, coarser = self.followed, self.motion.coarser
        tighter = self.motion_with_tighter_tolerances
        off = None  # the prescribed wave on the points, compared with its closed form
        if course.wave is not None and self.wave is not None and self.field is None:
            off = np.abs(course.wave.thickness - self.wave.height(grid(course.points))).max()
        return {
            "points": course.points,
            "points_coarser": coarser and coarser.points,
            "outcome_coarser": coarser and coarser.outcome,
            "resolution_difference": self.motion.difference,
            "highest_harmonics": course.tail,
            "outcome_tighter": tighter and tighter.outcome,
            "tolerance_difference": self.tolerance_difference,
            "steps": course.steps,
            "volume_error": course.volume_error,
            "residual_wave": course.wave and course.wave.state.residual,
            "residual_end": course.end and course.end.state.residual,
            "closed_form_difference": off,
            "assumptions": [
                "lubrication theory: slopes are small against 1 / (depth times wave number)",
                f"a film thinner than {self.time.rupture:g} of its mean counts as ruptured",
            ],
        }

    @warnings
    def of_resolution(self) -> Iterator[str]:
        points, difference = self.followed.points, self.motion.difference
        field = self.travelling_field
        lost = field.left_out(points) if isinstance(field, GivenField) else 0.0
        if lost > _LEFT_OUT:
            yield (
                f"a share of {lost:.2g} of the field is in harmonics that {points} points do not "
                "resolve"
            )
        if self.motion.coarser is None:
            yield "there is only one resolution, since grid.most does not allow a second"
        elif difference is not None and difference > self.grid.agreement:
            yield (
                f"twice the points change the end state by {difference:.2g}: its outcome is "
                "reliable, its last digits are not"
            )

    @warnings
    def of_the_wave(self) -> Iterator[str]:
        outcome, wave = self.followed.outcome, self.followed.wave
        if wave is not None and wave.growth > 0:
            yield f"the prescribed wave is unstable: deviations grow at the rate {wave.growth:.4g}"
        elif wave is not None and outcome in ("other", "breaks"):
            yield "the prescribed wave is stable, but the film does not reach it from this start"
        if outcome == "wave" and wave is not None and wave.growth > 0:
            yield "the film stays on it only because it starts there"
        if outcome == "moving":
            yield "the film still moves at the end; write more time.periods"
        if self.wave is not None and self.field is not None:
            yield (
                "the field is not that of film's wave: the film is compared with that wave, and "
                "growth rates are those of the nearest steady film"
            )

    @warnings
    def of_theory(self) -> Iterator[str]:
        yield from self.film.fluid.warnings() if self.film.fluid else ()
        yield from reach_warnings(self.wave, self.film.thinness) if self.wave else ()
        yield from () if self.tolerance.recheck else (NOT_RECHECKED,)


# -- numbers and variables -------------------------------------------------------------------------


def _simulated(
    course: Course, setting: Setting, wave: Wave | None, field: WaveField | GivenField
) -> Simulated:
    xi, last = grid(course.points), course.thickness[:, -1]
    flow_end = flow(setting, last)
    rates_wave, rates_end = (
        film and film.state.eigenvalues[:_MODES] for film in (course.wave, course.end)
    )
    return Simulated(
        outcome=course.outcome,
        distance_to_wave=course.distance,
        distance_to_steady=course.settled_to,
        growth_rate_max=course.wave and course.wave.growth,
        growth_rate_end=course.end and course.end.growth,
        mean_flow=float(np.mean(flow_end)),
        mean_flow_wave=wave and wave.mean_flow,
        volume_error=course.volume_error,
        thickness_max=float(last.max()),
        thickness_min=float(last.min()),
        thickness_least=float(course.thickness.min()),
        broke_time=course.broke and course.broke[0],
        broke_xi=course.broke and course.broke[1],
        points=course.points,
        xi=xi,
        instants=course.time,
        thickness=course.thickness.T,
        thickness_end=last,
        thickness_wave=wave and wave.height(xi),
        flow_end=flow_end,
        field_pressure=field.values(course.points),
        growth_wave=None if rates_wave is None else rates_wave.real,
        swing_wave=None if rates_wave is None else rates_wave.imag,
        growth_end=None if rates_end is None else rates_end.real,
        swing_end=None if rates_end is None else rates_end.imag,
    )


def _branches(found: Sequence[Branch], order: int) -> Branches:
    """Numbers of branches, and their films one after the other; `order`: of the differences."""
    crossings, folds = [], [fold.parameter for branch in found for fold in branch.folds]
    rates = [branch.eigenvalues[:, 0].real for branch in found]
    for branch, rate in zip(found, rates, strict=True):
        # amplitudes at which the largest growth rate passes 0, between neighbours
        delta, at = branch.parameter, np.flatnonzero(rate[:-1] * rate[1:] < 0)
        share = rate[at] / (rate[at] - rate[at + 1])
        crossings += (delta[at] + share * (delta[at + 1] - delta[at])).tolist()
    numbers = len(found), sorted(folds), sorted(crossings)
    if not found:
        return Branches(*numbers, None, None, None, None, None, None)
    h = np.hstack([film_thickness(branch.x.T, order=order) for branch in found])
    return Branches(
        *numbers,
        branch_delta=np.concatenate([branch.parameter for branch in found]),
        branch_thickness_max=h.max(axis=0),
        branch_thickness_min=h.min(axis=0),
        # steady films have the flow Q = h + C
        branch_mean_flow=1 - np.mean(h**-2, axis=0) / np.mean(h**-3, axis=0),
        branch_growth=np.concatenate(rates),
        branch_number=np.repeat(np.arange(len(found)), [len(rate) for rate in rates]),
    )


def _basins(fates: Sequence[Sequence[Fate]], films: FlatFilms) -> Basins:
    def over(name: str) -> np.ndarray:
        return np.array([[getattr(fate, name) for fate in row] for row in fates], dtype=float)

    outcome = np.array([[OUTCOMES.index(fate.outcome) for fate in row] for row in fates])
    growth = over("growth")
    return Basins(
        *(int(np.sum(outcome == k)) for k in range(len(OUTCOMES))),
        map_wave_unstable=int(np.sum(growth > 0)),
        map_wave_stable_not_reached=int(np.sum((growth < 0) & (outcome > 0))),
        map_delta=films.delta,
        map_tension=films.tension,
        map_outcome=outcome,
        map_growth=growth,
        **{f"map_{name}": over(name) for name in _OF_FILMS},
    )
