"""Scenes of kind ``harmonic-masses``: how fast masses travel that swing about their centre."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, TypeVar

import numpy as np

from wormopt.errors import SolveError
from wormopt.model.friction import Coulomb
from wormopt.model.model import Model
from wormopt.progress import Report
from wormopt.quantities import Scalar, Variable, unit_of
from wormopt.result import Result
from wormopt.scene.scene import Scene
from wormopt.scene.types import per
from wormopt.simulation.simulate import simulate
from wormopt.simulation.trajectory import Trajectory
from wormopt.systems.chain.runs.chains import tolerance_of
from wormopt.systems.shared.signals import symbol
from wormopt.systems.swinging.harmonic_masses import harmonic_masses, steady_masses
from wormopt.systems.swinging.runs.exact_orbit import Orbit, Runner, measured, nudged
from wormopt.systems.swinging.runs.harmonic_trust import (
    Found,
    difference,
    faults_of,
    known_velocity,
    laws_of,
    period_of,
    relative_velocities,
    smallness_of,
    trust,
)
from wormopt.systems.swinging.runs.slow_velocity import SlowVelocity, Steady
from wormopt.systems.swinging.scenes.harmonic_masses import HarmonicMassesScene, SwingingTable

_T = TypeVar("_T")

# Instants of the period for the picture.
_POINTS = 721
# How simulation gives up where masses reverse at once.
_AT_ONCE = ("no_contact_mode", "not_finite")
# Steady velocities are roots with round-off: so near, of the largest velocity, a start is on one.
_ON = 1e-9


def run(scene: Scene[HarmonicMassesScene], report: Report) -> Result:
    """Find the steady velocities by averaging, in closed form and exactly.

    "failed" where the routes disagree though friction is small, or no exact motion is found.
    Raises SolveError if no velocity is steady.
    """
    table, begin = scene.table, time.perf_counter()
    report("averaging", None)
    slow = model_of(table.worm, place=False)
    V0, extremes = table.course.velocity, _extremes(table.worm)
    size = float(np.abs(extremes).max())
    first, second, finer = _steady(slow, table, extremes)
    chosen = _tends_to(V0, first, _ON * size)
    averaged_at = time.perf_counter()
    report("simulating", None)
    guesses = [(s or f).velocity for f, s in zip(first, second, strict=True)]
    orbits, course, was_nudged, lost = _exact(table, guesses, chosen, report)
    found = Found(
        first=first,
        second=second,
        finer=finer,
        chosen=chosen,
        closed=_closed_form(table.worm),
        orbits=orbits,
        course=course,
        averaged=_averaged_course(slow, table),
        nudged=was_nudged,
        lost=lost,
    )
    faults = list(faults_of(found, table, size))
    return Result(
        scene.name,
        table.kind,
        scene.title,
        status="failed" if faults else "ok",
        reason="; ".join(faults),
        scalars=_scalars(found, table, size),
        variables=tuple(_variables(found, table)),
        trust=trust(found, table, size),
        timings_s={
            "averaging": averaged_at - begin,
            "simulate": time.perf_counter() - averaged_at,
        },
        scene_text=scene.text,
    )


# -- routes --------------------------------------------------------------------------------------


def model_of(worm: SwingingTable, *, place: bool) -> Model:
    """Make the Model of a scene; `place`: whether the place of the centre is a state."""
    coefficients = np.array(worm.coefficients)
    return harmonic_masses(
        coefficients[:, :, 0],
        coefficients[:, :, 1],
        law=laws_of(worm),
        frequency=worm.frequency,
        mass=worm.mass,
        place=place,
    )


def _extremes(worm: SwingingTable) -> np.ndarray:
    """Velocities V at which a mass begins or ceases to reverse, with round-off of a grid."""
    w = relative_velocities(worm, np.arange(4096) / 4096)
    before, after = np.roll(w, 1, axis=1), np.roll(w, -1, axis=1)
    bent = before - 2 * w + after
    turns = (w - before) * (after - w) <= 0
    top = w - (after - before) ** 2 / (8 * np.where(bent == 0, 1, bent))
    return -top[turns]


def _steady(
    slow: Model, table: HarmonicMassesScene, extremes: np.ndarray
) -> tuple[list[Steady], list[Steady | None], list[Steady]]:
    period, nodes = 2 * np.pi / symbol(slow, "frequency"), table.averaging.nodes
    first = SlowVelocity(slow, period, 1, nodes).steady(extremes.tolist())
    if not first:
        raise SolveError("no velocity is steady", "write friction that resists both ways")
    finer = SlowVelocity(slow, period, 1, 2 * nodes).steady(extremes.tolist())
    second = SlowVelocity(slow, period, 2, nodes).steady(extremes.tolist())
    return first, [_nearest(steady, second) for steady in first], finer


def _nearest(steady: Steady, among: Sequence[Steady]) -> Steady | None:
    alike = [other for other in among if other.stable == steady.stable]
    return min(alike, key=lambda other: abs(other.velocity - steady.velocity), default=None)


def _tends_to(velocity: float, steady: Sequence[Steady], near: float) -> int:
    """Which steady velocity a slow motion comes to: it stays on one, and cannot pass one."""
    away = [abs(s.velocity - velocity) for s in steady]
    if min(away) <= near:
        return away.index(min(away))
    ahead = [k for k, s in enumerate(steady) if s.velocity > velocity]
    behind = [k for k, s in enumerate(steady) if s.velocity < velocity]
    for k in [*ahead[:1], *behind[-1:]]:
        if steady[k].stable:
            return k
    return (ahead[:1] or behind[-1:])[0]


def _closed_form(worm: SwingingTable) -> float | None:
    laws = [law for law in laws_of(worm) if isinstance(law, Coulomb)]
    only, *others = worm.harmonic
    if others or len(laws) < worm.masses:
        return None
    return steady_masses(per(only.amplitude, worm.masses), laws)


def _averaged_course(slow: Model, table: HarmonicMassesScene) -> Trajectory:
    period = 2 * np.pi / symbol(slow, "frequency")
    averaged = SlowVelocity(slow, period, 1, table.averaging.nodes).averaged
    end = table.course.periods * period_of(table)
    return simulate(
        averaged,
        end,
        x0={"center_velocity": table.course.velocity},
        times=np.linspace(0.0, end, table.course.samples),
        tolerance=tolerance_of(table.tolerance),
    )


def _exact(
    table: HarmonicMassesScene,
    guesses: Sequence[float],
    chosen: int,
    report: Report,
) -> tuple[list[Orbit | None], Trajectory | None, bool, str]:
    """Simulate; where masses reverse at once, with friction a little different."""
    model = measured(model_of(table.worm, place=True))
    check, asked = table.tolerance.recheck, table.course
    orbits: list[Orbit | None] = []
    course: Trajectory | None = None
    lost: list[SolveError | None] = []
    for p in ({}, nudged(model)):
        runner = Runner(model, period_of(table), tolerance_of(table.tolerance), p, report)
        tried = [_tried(partial(runner.orbit, V, check=check)) for V in guesses]
        course, course_lost = _tried(
            partial(runner.run, asked.velocity, asked.periods, asked.samples)
        )
        orbits, lost = [orbit for orbit, _ in tried], [tried[chosen][1], course_lost]
        if not any(error and error.code in _AT_ONCE for error in lost):
            return orbits, course, bool(p), _first_of(lost)
    return orbits, course, True, _first_of(lost)


def _tried(solve: Callable[[], _T]) -> tuple[_T | None, SolveError | None]:
    try:
        return solve(), None
    except SolveError as error:
        return None, error


def _first_of(lost: Sequence[SolveError | None]) -> str:
    return next((str(error) for error in lost if error), "")


# -- results -------------------------------------------------------------------------------------


def _scalars(found: Found, table: HarmonicMassesScene, size: float) -> dict[str, Scalar]:
    chosen, units = found.chosen, table.units
    first, second, orbit = found.first[chosen], found.second[chosen], found.orbits[chosen]
    exact, second_velocity = orbit and orbit.velocity, second and second.velocity
    known = known_velocity(found, table, size)
    values: dict[str, tuple[Any, str]] = {
        "velocity_steady": (first.velocity, "speed"),
        "velocity_steady_second": (second_velocity, "speed"),
        "velocity_closed_form": (found.closed, "speed"),
        "velocity_exact_mean": (known, "speed"),
        "averaging_error": (difference(exact, first.velocity), "speed"),
        "averaging_error_second": (difference(exact, second_velocity), "speed"),
        "stable": (int(first.stable), "count"),
        "settling_time": (-1 / first.slope if first.stable else None, "time"),
        "steady_velocities": ([s.velocity for s in found.first], "speed"),
        "steady_stable": ([int(s.stable) for s in found.first], "count"),
        "exact_velocities": ([o and o.velocity for o in found.orbits], "speed"),
        "advance": (known and known * period_of(table), "length"),
        "velocity_ripple": (orbit and orbit.ripple, "speed"),
        "exact_drift": (orbit and orbit.drift, "speed"),
        "force_mean": (orbit and orbit.force, "force"),
        "power_mean": (orbit and orbit.power, "power"),
        "energy_per_distance": (
            orbit and known and orbit.power / abs(known),
            "energy_per_distance",
        ),
        "rest_share": (orbit and orbit.rest_share, "share"),
        "smallness": (smallness_of(table.worm), "share"),
        "recheck_error": (orbit and orbit.second and orbit.second.error, "share"),
    }
    return {name: Scalar(value, unit_of(kind, units)) for name, (value, kind) in values.items()}


def _variables(found: Found, table: HarmonicMassesScene) -> list[Variable]:
    units, theta = table.units, np.linspace(0.0, 1.0, _POINTS)
    speed, seconds = unit_of("speed", units), unit_of("time", units)
    averaged = found.averaged
    variables = [
        Variable("share", "1", ("share",), theta, "share of the period"),
        Variable(
            "relative_velocity",
            speed,
            ("mass", "share"),
            relative_velocities(table.worm, theta),
            "velocity of the mass relative to the centre",
        ),
        Variable("time", seconds, ("time",), averaged.time, "time"),
        Variable(
            "center_velocity_averaged",
            speed,
            ("time",),
            averaged.state("center_velocity")[0],
            "velocity of the centre, averaged to first order",
        ),
    ]
    if found.course is not None:
        V = found.course.state("center_velocity")[0]
        center = found.course.state("center")[0]
        variables += [
            Variable("center_velocity", speed, ("time",), V, "velocity of the centre, exact"),
            Variable("center", unit_of("length", units), ("time",), center, "place of the centre"),
        ]
    orbit = found.orbits[found.chosen]
    if orbit is not None:
        variables += _of_orbit(orbit, table)
    return variables


def _of_orbit(orbit: Orbit, table: HarmonicMassesScene) -> Iterator[Variable]:
    """Events of the first period: which mass reverses when."""
    names = [contact.name for contact in orbit.motion.system.model.contacts]
    period = period_of(table)
    events = [e for e in orbit.motion.events if e.time < period]
    if not events:
        return
    for name, values, what in (
        ("event_share", [e.time / period for e in events], "share of the period"),
        ("event_contact", [names.index(e.name) for e in events], "mass"),
        ("event_mode", [e.mode for e in events], "direction from then on, 0 at rest"),
    ):
        yield Variable(name, "1", ("event",), np.array(values), what)
