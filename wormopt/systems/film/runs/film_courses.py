"""Where a film goes under a travelling field: followed in time, on points fine enough for it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Literal

import casadi as ca
import numpy as np

from wormopt.analysis.steady import Rates, SteadyState
from wormopt.errors import Interrupted, SolveError
from wormopt.model.model import Model, Signal, pack
from wormopt.progress import Report, silent
from wormopt.simulation.options import Tolerance
from wormopt.simulation.simulate import simulate
from wormopt.systems.film.scenes.film_forward import CourseTable, GridTable, StepsTable
from wormopt.systems.film.shapes import grid
from wormopt.systems.film.thin_film import film_thickness, film_volume, thin_film

Outcome = Literal["wave", "other", "moving", "breaks", "unresolved"]
OUTCOMES: tuple[Outcome, ...] = ("wave", "other", "moving", "breaks", "unresolved")
"""What may become of a film, by the numbers that stand for it in results."""

# Spans from one look at the thinnest place to the next, in periods; each longer by this factor.
_FIRST_SPAN, _LONGER = 2.0, 10.0
# Highest harmonics of a resolved film, over the largest one.
_TAIL = 1e-3
_CLOSER = 64
# Steps that become this short, and numbers that are none: the film leaves what the points can hold.
_GIVEN_UP = ("solver_failed", "not_finite", "step_too_small")


@dataclass(frozen=True)
class Setting:
    """A film, its field and what is asked, on any number of points."""

    slope: Callable[[int], np.ndarray]  # number of points to the slope of the field there
    tension: float  # number W
    start: Callable[[np.ndarray], np.ndarray]  # phases to the thickness at time 0
    # phases to the thickness of the prescribed wave
    wave: Callable[[np.ndarray], np.ndarray] | None
    course: CourseTable  # how long, and what counts as settled or broken
    grid: GridTable
    tolerance: StepsTable

    def given(self, points: int) -> dict[str, Any]:
        """Parameters of `film_model` by name."""
        return {"field_slope": self.slope(points), "tension": self.tension}


@dataclass(frozen=True, eq=False)
class Steady:
    """A steady film."""

    state: SteadyState  # with eigenvalues
    thickness: np.ndarray  # (points,)

    @property
    def growth(self) -> float:
        """Largest rate at which a small deviation grows."""
        return float(self.state.eigenvalues[0].real)


@dataclass(frozen=True, eq=False)
class Course:
    """A film followed in time on given points.

    `outcome`: it comes to the prescribed wave or to another steady one, still moves at the
    end, gets thinner than the rupture thickness, or leaves what the points can hold.
    """

    points: int
    outcome: Outcome
    time: np.ndarray  # (m,), until its end or until it broke
    thickness: np.ndarray  # (points, m)
    steps: int  # of the integrator
    broke: tuple[float, float] | None  # when and where
    # steady film next to the prescribed wave; that wave itself under its own field
    wave: Steady | None
    end: Steady | None  # steady film next to the end
    distance: float | None  # from the prescribed wave, at the end
    settled_to: float | None  # distance from the steady film next to the end

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
    """Model whose parameters are ``field_slope`` (points) and ``tension``.

    `order`: of the differences.
    """
    slope, tension = ca.SX.sym("field_slope", points), ca.SX.sym("tension")
    parameters = [Signal("field_slope", slope), Signal("tension", tension)]
    return thin_film(slope, tension, order=order, p=parameters)


@lru_cache(maxsize=8)
def _rates(points: int, order: int) -> Rates:
    return Rates(film_model(points, order))


def steady(setting: Setting, points: int, thickness: np.ndarray) -> Steady | None:
    """Steady film of positive thickness next to `thickness` (points,), by Newton; None without."""
    order, rates = setting.grid.order, _rates(points, setting.grid.order)
    p = rates.parameters(setting.given(points))
    x, found = rates.newton(film_volume(thickness, order=order)[None], p)
    if not found[0]:
        return None
    h = film_thickness(x[0], order=order)
    if h.min() <= 0:
        return None
    return Steady(rates.steady(x[0], p), h)


def flow(setting: Setting, thickness: np.ndarray) -> np.ndarray:
    """Flow Q (points,) of a film of given thickness (points,)."""
    points, order = len(thickness), setting.grid.order
    model, rates = film_model(points, order), _rates(points, order)
    at = ca.Function("flow", [pack(model.x), pack(model.p)], [model.output("flow")])
    state = film_volume(thickness, order=order)
    return np.array(at(state, rates.parameters(setting.given(points)))).ravel()


def follow(setting: Setting, points: int, report: Report = silent) -> Course:
    """Follow a film in time on given points; raises SolveError if the allowed steps run out."""
    time, h, steps, failed = _integrated(setting, points, report)
    broke = None
    if h.min() < setting.course.rupture:
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
    near = setting.course.settled
    if failed or course.tail > _TAIL:
        return "unresolved"
    if course.broke is not None:
        return "breaks"
    if course.wave is not None and _apart(course.wave.thickness, course.thickness[:, -1]) < near:
        return "wave"
    return "other" if course.settled_to is not None and course.settled_to < near else "moving"


def _integrated(
    setting: Setting, points: int, report: Report
) -> tuple[np.ndarray, np.ndarray, int, bool]:
    """Times, thickness there, steps, and whether the integrator gave up."""
    table, order, turn = setting.course, setting.grid.order, 2 * math.pi
    kept = np.linspace(0.0, table.periods * turn, table.samples)
    state = film_volume(setting.start(grid(points)), order=order)
    times, states, steps, span, begin, failed = (
        [kept[:1]],
        [state[:, None]],
        0,
        _FIRST_SPAN,
        0.0,
        False,
    )
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
            if film_thickness(found, order=order).min() < table.rupture:
                break
        begin, span = end, _LONGER * span
    return np.concatenate(times), film_thickness(np.hstack(states), order=order), steps, failed


def _leg(
    setting: Setting,
    points: int,
    state: np.ndarray,
    span: tuple[float, float],
    times: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, int, bool]:
    numbers = setting.tolerance
    tolerance = Tolerance(numbers.relative, numbers.absolute, numbers.max_steps)
    failed = False
    try:
        motion = simulate(
            film_model(points, setting.grid.order),
            span,
            x0={"volume": state},
            p=setting.given(points),
            times=times,
            tolerance=tolerance,
            route="cvodes",
        )
    except SolveError as error:
        if error.code not in _GIVEN_UP:
            raise
        motion, failed = error.partial, True
    except Interrupted:
        raise KeyboardInterrupt from None  # a leg alone is nothing to keep
    return motion.time, motion.state("volume"), motion.n_steps, failed


def _broken(
    setting: Setting, points: int, time: np.ndarray, h: np.ndarray
) -> tuple[np.ndarray, np.ndarray, tuple[float, float]]:
    """Cut the course where it first is too thin, which is located more closely."""
    first = int(np.flatnonzero(h.min(axis=0) < setting.course.rupture)[0])
    if first == 0:
        return time[:1], h[:, :1], (float(time[0]), float(grid(points)[int(np.argmin(h[:, 0]))]))
    order = setting.grid.order
    state = film_volume(h[:, first - 1], order=order)
    span = (float(time[first - 1]), float(time[first]))
    close, found, _, _ = _leg(setting, points, state, span, np.linspace(*span, _CLOSER)[1:])
    near = film_thickness(found, order=order)
    thin = np.flatnonzero(near.min(axis=0) < setting.course.rupture)
    at, shape = (close[thin[0]], near[:, thin[0]]) if len(thin) else (time[first], h[:, first])
    time, h = np.append(time[:first], at), np.column_stack([h[:, :first], shape])
    return time, h, (float(at), float(grid(points)[int(np.argmin(shape))]))


def _apart(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.abs(one - other).max())
