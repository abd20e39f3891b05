"""Simulate a film in a travelling field, on points that resolve it.

Newton's method finds the closest steady films, with the growth rates of their deviations. Steady
films are continued in the amplitude of the wave that the field prescribes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, Literal

import casadi as ca
import numpy as np

from wormopt.analysis.continuation import Branch, continue_branch
from wormopt.analysis.steady import Rates, SteadyState, rates_of
from wormopt.errors import Interrupted, SolveError
from wormopt.model.model import Model, Signal, pack
from wormopt.numerics.newton import newton
from wormopt.numerics.workers import each
from wormopt.progress import Report, silent
from wormopt.simulation.options import Tolerance
from wormopt.simulation.simulate import simulate
from wormopt.systems.film.cosine import CosineWave
from wormopt.systems.film.given_field import (
    GivenField,
    WaveField,
    film_thickness,
    film_volume,
    resampled,
    thin_film,
)
from wormopt.systems.film.lubrication import field_slope
from wormopt.systems.film.shapes import grid
from wormopt.systems.film.tables import Duration, Resolution

Outcome = Literal["wave", "other", "moving", "breaks", "unresolved"]
OUTCOMES: tuple[Outcome, ...] = ("wave", "other", "moving", "breaks", "unresolved")
"""Outcomes of a film, by their codes in results."""

TAIL = 1e-3
"""Largest share of the highest harmonics in a resolved film."""

# Times between two checks of the least thickness, in periods; each is longer by this factor. The
# first is no longer than the second number over the tension, since the integrator takes no steps
# that are very small against it: the slowest ripple decays at a third of the tension.
_FIRST_SPAN, _DECAYED, _LONGER = 2.0, 100.0, 10.0
_CLOSER = 64
# A film whose highest harmonics are below this share is resolved without a second resolution.
_ENOUGH = 1e-6
# Points of a branch; films that differ by less are the same.
_MOST, _SAME = 400, 1e-6
# Points of the film in the field of a row of coils.
_POINTS = 256
# Steps this short, or NaN, mean that the points no longer resolve the film.
_GIVEN_UP = ("solver_failed", "not_finite", "step_too_small")


@dataclass(frozen=True)
class Setting:
    """A film, its field and the settings of the simulation, on any number of points."""

    slope: Callable[[int], np.ndarray]  # number of points to the slope of the field there
    tension: float  # number W
    start: Callable[[np.ndarray], np.ndarray]  # phases to the thickness at time 0
    # phases to the thickness of the prescribed wave
    wave: Callable[[np.ndarray], np.ndarray] | None
    duration: Duration = Duration()  # noqa: RUF009  frozen
    resolution: Resolution = Resolution()  # noqa: RUF009  frozen
    tolerance: Tolerance = Tolerance()  # noqa: RUF009  frozen

    def given(self, points: int) -> dict[str, Any]:
        """Parameters of `film_model` by name."""
        return {"field_slope": self.slope(points), "tension": self.tension}


@dataclass(frozen=True, eq=False)
class Steady:
    """A steady film."""

    thickness: np.ndarray  # (points,)
    rates: Rates
    x: np.ndarray
    p: np.ndarray

    @cached_property
    def state(self) -> SteadyState:
        """The state with eigenvalues, which take longer than the state itself."""
        return self.rates.steady(self.x, self.p)

    @property
    def growth(self) -> float:
        """Largest rate at which a small deviation grows."""
        return float(self.state.eigenvalues[0].real)


@dataclass(frozen=True, eq=False)
class Course:
    """A film simulated on given points.

    `outcome`: it converges to the prescribed wave or to another steady film, still moves at the
    end, becomes thinner than the rupture thickness, or is not resolved by the points.
    """

    points: int
    outcome: Outcome
    time: np.ndarray  # (m,), until its end or until it broke
    thickness: np.ndarray  # (points, m)
    steps: int  # of the integrator
    broke: tuple[float, float] | None  # when and where
    # steady film closest to the prescribed wave; under its own field the wave itself
    wave: Steady | None
    end: Steady | None  # steady film closest to the end
    distance: float | None  # from the prescribed wave, at the end
    settled_to: float | None  # distance from the steady film closest to the end

    @property
    def tail(self) -> float:
        """Largest of the highest eighth of harmonics over the largest of all, over all times."""
        size = np.abs(np.fft.rfft(self.thickness - 1, axis=0))
        top = np.maximum(size.max(axis=0), 1e-3 * self.points)
        return float(np.max(size[-(len(size) // 8) :].max(axis=0) / top))

    @property
    def volume_error(self) -> float:
        """Largest deviation of the mean thickness from 1."""
        return float(np.abs(self.thickness.mean(axis=0) - 1).max())


@lru_cache(maxsize=8)
def film_model(points: int, order: int) -> Model:
    """Model with the parameters ``field_slope`` (points) and ``tension``."""
    slope, tension = ca.SX.sym("field_slope", points), ca.SX.sym("tension")
    parameters = [Signal("field_slope", slope), Signal("tension", tension)]
    return thin_film(slope, tension, order=order, p=parameters)


@lru_cache(maxsize=8)
def _rates(points: int, order: int) -> Rates:
    return Rates(film_model(points, order))


def steady(setting: Setting, points: int, thickness: np.ndarray) -> Steady | None:
    """Steady film closest to `thickness` (points,) by Newton's method, None without one."""
    order, rates = setting.resolution.order, _rates(points, setting.resolution.order)
    p = rates.parameters(setting.given(points))
    x, found = newton(rates, film_volume(thickness, order=order)[None], p)
    if not found[0]:
        return None
    h = film_thickness(x[0], order=order)
    if h.min() <= 0:
        return None
    return Steady(h, rates, x[0], p)


def flow(setting: Setting, thickness: np.ndarray) -> np.ndarray:
    """Flow Q (points,) of a film of given thickness (points,)."""
    points, order = len(thickness), setting.resolution.order
    model, rates = film_model(points, order), _rates(points, order)
    at = ca.Function("flow", [pack(model.x), pack(model.p)], [model["flow"]])
    state = film_volume(thickness, order=order)
    return np.array(at(state, rates.parameters(setting.given(points)))).ravel()


def follow(setting: Setting, points: int, report: Report = silent) -> Course:
    """Simulate a film on given points; raises SolveError if the allowed steps do not suffice."""
    time, h, steps, failed = _integrated(setting, points, report)
    broke = None
    if h.min() < setting.duration.rupture:
        time, h, broke = _broken(setting, points, time, h)
    wave = None
    if setting.wave is not None:
        wave = steady(setting, points, setting.wave(grid(points)))
    course = Course(points, "breaks", time, h, steps, broke, wave, None, None, None)
    if setting.wave is not None:
        course = replace(course, distance=_apart(setting.wave(grid(points)), h[:, -1]))
    if broke is None and not failed:
        end = steady(setting, points, h[:, -1])
        settled = None if end is None else _apart(end.thickness, h[:, -1])
        course = replace(course, end=end, settled_to=settled)
    return replace(course, outcome=_outcome(setting, course, failed))


def _outcome(setting: Setting, course: Course, failed: bool) -> Outcome:
    near = setting.duration.settled
    if failed or course.tail > TAIL:
        return "unresolved"
    if course.broke is not None:
        return "breaks"
    if course.wave is not None and _apart(course.wave.thickness, course.thickness[:, -1]) < near:
        return "wave"
    return "other" if course.settled_to is not None and course.settled_to < near else "moving"


def _integrated(
    setting: Setting, points: int, report: Report
) -> tuple[np.ndarray, np.ndarray, int, bool]:
    """Times, thickness at these times, steps, and whether the integrator gave up."""
    order, turn = setting.resolution.order, 2 * math.pi
    kept = np.linspace(0.0, setting.duration.periods * turn, setting.duration.samples)
    state = film_volume(setting.start(grid(points)), order=order)
    times, states = [kept[:1]], [state[:, None]]
    span = min(_FIRST_SPAN, _DECAYED / setting.tension)
    steps, begin, failed = 0, 0.0, False
    while begin < kept[-1] and not failed:
        end = min(begin + span * turn, kept[-1])
        end = kept[-1] if kept[-1] - end < 0.5 * (end - begin) else end
        wanted = kept[(kept > begin) & (kept <= end)]
        wanted = np.unique(np.append(wanted, end))
        report(f"film on {points} points", begin / kept[-1])
        reached, found, count, failed = _leg(setting, points, state, (begin, end), wanted)
        steps += count
        times.append(reached)
        states.append(found)
        if found.shape[1]:
            state = found[:, -1]
            if film_thickness(found, order=order).min() < setting.duration.rupture:
                break
        begin, span = end, _LONGER * span
    return np.concatenate(times), film_thickness(np.hstack(states), order=order), steps, failed


def _leg(
    setting: Setting, points: int, state: np.ndarray, span: tuple[float, float], times: np.ndarray
) -> tuple[np.ndarray, np.ndarray, int, bool]:
    failed = False
    try:
        motion = simulate(
            film_model(points, setting.resolution.order),
            span,
            x0={"volume": state},
            p=setting.given(points),
            times=times,
            tolerance=setting.tolerance,
            route="cvodes",
        )
    except SolveError as error:
        if error.code not in _GIVEN_UP:
            raise SolveError(error.reason, error.suggestion, code=error.code) from None
        motion, failed = error.partial, True
    except Interrupted:
        raise KeyboardInterrupt from None  # a single leg is not a result
    return motion.time, motion["volume"], motion.n_steps, failed


def _broken(
    setting: Setting, points: int, time: np.ndarray, h: np.ndarray
) -> tuple[np.ndarray, np.ndarray, tuple[float, float]]:
    """End the motion at the rupture, whose time is located more closely."""
    first = int(np.flatnonzero(h.min(axis=0) < setting.duration.rupture)[0])
    if first == 0:
        return time[:1], h[:, :1], (float(time[0]), float(grid(points)[int(np.argmin(h[:, 0]))]))
    order = setting.resolution.order
    state = film_volume(h[:, first - 1], order=order)
    span = (float(time[first - 1]), float(time[first]))
    close, found, _, _ = _leg(setting, points, state, span, np.linspace(*span, _CLOSER)[1:])
    near = film_thickness(found, order=order)
    thin = np.flatnonzero(near.min(axis=0) < setting.duration.rupture)
    at, shape = (close[thin[0]], near[:, thin[0]]) if len(thin) else (time[first], h[:, first])
    time, h = np.append(time[:first], at), np.column_stack([h[:, :first], shape])
    return time, h, (float(at), float(grid(points)[int(np.argmin(shape))]))


def _apart(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.abs(one - other).max())


# -- on points fine enough -------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Resolved:
    """A motion, and the motion on half as many points for comparison."""

    course: Course  # on the most points
    coarser: Course | None  # on half as many points
    # of last thicknesses at common points; None if outcomes or end times differ
    difference: float | None


def resolved(setting: Setting, report: Report = silent, *, once: bool = False) -> Resolved:
    """Simulate a film on more and more points until two resolutions agree; callers check that.

    `once`: a single resolution suffices where its harmonics have decayed.
    """
    points = setting.resolution.points
    found = Resolved(follow(setting, points, report), None, None)
    while 2 * points <= setting.resolution.most:
        if once and found.course.outcome != "unresolved" and found.course.tail < _ENOUGH:
            break
        points *= 2
        finer = follow(setting, points, report)
        found = Resolved(finer, found.course, _difference(found.course, finer))
        if found.difference is not None and found.difference <= setting.resolution.agreement:
            break
    return found


def _difference(coarse: Course, fine: Course) -> float | None:
    if coarse.outcome != fine.outcome or fine.outcome == "unresolved":
        return None
    if fine.broke is not None and coarse.broke is not None:
        last = fine.broke[0]  # the shapes are those of other times
        return abs(coarse.broke[0] - last) / max(last, 2 * math.pi)
    return float(np.abs(coarse.thickness[:, -1] - fine.thickness[::2, -1]).max())


# -- steady films along the amplitude --------------------------------------------------------------


def steady_branches(
    course: Course,
    tension: float,
    span: tuple[float, float],
    *,
    points: int,
    order: int,
    report: Report,
) -> list[Branch]:
    """Continue the prescribed wave, and the steady film at the end of a motion, in the amplitude.

    `course`: in a cosine wave's field; `tension`: W; `span`: of amplitudes; `order`: of the
    differences on the given number of `points`. The branch of the end is left out if it is the
    same.
    """
    assert course.wave is not None
    delta, xi = ca.SX.sym("delta"), ca.DM(grid(points))
    wave, h = CosineWave(delta), course.wave.thickness
    slope = field_slope(wave.height(xi), wave.height(xi, 3), wave.constant, tension)
    own = float(2 * np.mean(h * np.cos(grid(len(h)))))
    model = thin_film(slope, tension, order=order, p=[Signal("delta", delta, value=own)])
    rates = rates_of(model)
    p, starts, branches = rates.parameters(None), [h], []
    if course.end is not None and np.abs(course.end.thickness - h).max() > _SAME:
        starts.append(course.end.thickness)
    for k, thickness in enumerate(starts):
        report("continuing steady films", k / len(starts))
        guess = film_volume(resampled(thickness, points), order=order)
        x, found = newton(rates, guess[None], p)
        if found[0]:
            start = rates.steady(x[0], p)
            branches.append(continue_branch(start, "delta", span, max_points=_MOST))
    return branches


# -- where flat films go ---------------------------------------------------------------------------


@dataclass(frozen=True)
class Fate:
    """Where a film goes: numbers of its Course on the most points."""

    outcome: Outcome = "unresolved"
    distance: float | None = None
    growth: float | None = None
    growth_end: float | None = None
    crest: float | None = None
    least: float | None = None
    time: float | None = None
    points: int | None = None


def basins(
    setting: Setting, delta: Sequence[float], tension: Sequence[float], report: Report
) -> list[list[Fate]]:
    """Simulate a flat film in the field of every cosine wave, by amplitude, then tension.

    Only the outcome is known, "unresolved", where the allowed steps did not suffice.
    """
    jobs = [
        replace(setting, slope=WaveField(wave, W).slope, tension=W, start=np.ones_like,
                wave=wave.height)
        for wave in map(CosineWave, delta)
        for W in tension
    ]  # fmt: skip
    found = dict(each(_fate, jobs, report, "films of the map"))
    row = range(len(tension))
    return [[found[i * len(row) + j] for j in row] for i in range(len(delta))]


def _fate(setting: Setting) -> Fate:
    try:
        course = resolved(setting, once=True).course
    except SolveError:
        return Fate()
    return Fate(
        course.outcome,
        course.distance,
        course.wave and course.wave.growth,
        course.end and course.end.growth,
        float(course.thickness[:, -1].max()),
        float(course.thickness.min()),
        float(course.time[-1]),
        course.points,
    )


# -- under the field of a row of coils -------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class CarriedFilm:
    """A steady film that travels with the mean field of a row of coils.

    Parameters
    ----------
    xi : ndarray, shape (points,)
        Phases in rad.
    thickness : ndarray, shape (points,)
        Thickness over the mean thickness.
    distance : float
        Largest difference of the thickness from the wanted wave.
    mean_flow : float
        Mean flow 1 + C of the film.
    growth : float
        Largest growth rate of a small deviation, in units of omega.
    residual : float
        Residual of Newton's method.

    Examples
    --------
    Under the field that a cosine wave needs, the film takes just this wave:

    >>> import wormopt as wo
    >>> wave, xi = wo.film.CosineWave(0.1), wo.film.grid(64)
    >>> pressure = -wave.field_function(xi, 0.1)
    >>> film = wo.film.carried_film(wave, pressure, tension=0.1)  # doctest: +SKIP
    >>> round(film.distance, 9), round(film.mean_flow - wave.mean_flow, 9)  # doctest: +SKIP
    (0.0, 0.0)
    """

    xi: np.ndarray
    thickness: np.ndarray
    distance: float
    mean_flow: float
    growth: float
    residual: float


def carried_film(wave: CosineWave, pressure: np.ndarray, tension: float) -> CarriedFilm | None:
    """Find the steady film closest to a wave, in a field that differs from the wave's own.

    Parameters
    ----------
    wave : CosineWave
        The wanted wave.
    pressure : ndarray, shape (m,)
        (mu - 1) H² / (8 pi) at equidistant phases of one wavelength, in units of P.
    tension : float
        Surface tension W, above 0.

    Returns
    -------
    CarriedFilm or None
        None if there is no steady film near the wave.

    Examples
    --------
    Under the field that a cosine wave needs, the film takes just this wave; the field is
    H² = H0² - D, and a constant part moves nothing:

    >>> import wormopt as wo
    >>> wave, xi = wo.film.CosineWave(0.1), wo.film.grid(64)
    >>> film = wo.film.carried_film(wave, 1.0 - wave.field_function(xi, 0.1), tension=0.1)
    >>> bool(film.distance < 1e-9), film.growth < 0
    (True, True)
    """
    setting = Setting(GivenField(pressure).slope, tension, np.ones_like, wave.height)
    xi = grid(_POINTS)
    film = steady(setting, _POINTS, wave.height(xi))
    if film is None:
        return None
    # Q at rest on the ground is h + C everywhere
    carried = flow(setting, film.thickness).mean()
    distance = float(np.abs(film.thickness - wave.height(xi)).max())
    return CarriedFilm(
        xi, film.thickness, distance, float(carried), film.growth, film.state.residual
    )
