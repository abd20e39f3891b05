"""Run scenes of kind ``harmonic-masses``: mean velocity of masses with prescribed oscillations."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any, TypeVar

import numpy as np

from wormopt.errors import SceneError, SolveError
from wormopt.model.model import Model
from wormopt.progress import Report
from wormopt.result import Check, Result
from wormopt.simulation.simulate import simulate
from wormopt.simulation.trajectory import Trajectory
from wormopt.study.conclude import conclude
from wormopt.study.scene import Scene
from wormopt.systems.shared.proof import accepted_error, count_events, warnings_of_motion
from wormopt.systems.shared.settings import tolerance_of
from wormopt.systems.swinging.harmonic_masses import (
    closed_form,
    extremes_of,
    model_of,
    relative_velocities,
    smallness_of,
)
from wormopt.systems.swinging.scenes.harmonic_masses import HarmonicMassesScene, SwingingTable
from wormopt.systems.swinging.steady import (
    Orbit,
    Runner,
    SlowVelocity,
    Steady,
    measured,
)

_T = TypeVar("_T")

# Instants of the period in the picture.
_POINTS = 721
# Steady velocities have round-off: a start this close, relative to the largest velocity, is on one.
_ON = 1e-9
# Friction's impulse in a period over the least momentum amplitude, above which it is not small.
_SMALL = 0.2
# Value of the same above which exact motions are not simulated, since their velocities round.
_LARGE = 1e9
# Accepted difference, relative to the largest velocity, of averages on twice as many nodes, and
# between first order and closed form.
_QUADRATURE = 1e-9
# Accepted error of second-order averaging: this many squares of the ripple, and at least this share
# of the largest velocity.
_FACTOR, _FLOOR = 10.0, 1e-8
# Averages of second order are not compared with the exact motion if the ripple exceeds this share
# of the distance to a velocity at which a mass begins or ceases to reverse.
_NEAR = 0.05


@dataclass(frozen=True, eq=False)
class _Found:
    """Results of all routes."""

    table: HarmonicMassesScene
    size: float  # largest velocity relative to the centre
    first: Sequence[Steady]  # steady velocities, average of first order
    second: Sequence[Steady | None]  # steady velocities, average of second order
    finer: Sequence[Steady]  # the first order on twice as many nodes
    chosen: int  # which of first the course tends to
    closed: float | None  # closed form, of dry friction and one harmonic
    orbits: Sequence[Orbit | None]  # exact, one per entry of first; None: gave up
    course: Trajectory | None  # exact, from the velocity given
    averaged: Trajectory  # course averaged to first order
    lost: str  # why the chosen orbit, or the course, is missing

    @property
    def orbit(self) -> Orbit | None:
        """The exact motion to which the simulated motion converges."""
        return self.orbits[self.chosen]

    @property
    def tends_to(self) -> tuple[Steady, float | None]:
        """The steady velocity to which the motion converges, in first and second order."""
        second = self.second[self.chosen]
        return self.first[self.chosen], second and second.velocity

    @property
    def quadrature(self) -> float | None:
        """Largest change of a steady velocity on twice as many nodes; None if one comes or goes."""
        if len(self.finer) != len(self.first):
            return None
        both = zip(self.first, self.finer, strict=True)
        return max(abs(coarse.velocity - fine.velocity) for coarse, fine in both)

    @property
    def accepted(self) -> float:
        """Accepted error of exact velocities."""
        return accepted_error(tolerance_of(self.table.tolerance)) * self.size

    @property
    def known_velocity(self) -> float | None:
        """Exact mean velocity of the chosen motion; None if not above the accepted error."""
        if self.orbit is None:
            return None
        return self.orbit.velocity if abs(self.orbit.velocity) > self.accepted else None


def run(scene: Scene[HarmonicMassesScene], report: Report) -> Result:
    """Find the steady velocities by averaging, in closed form and exactly.

    The result is "failed" where the routes disagree although friction is small, or no exact motion
    is found. Raises SolveError if no velocity is steady, and SceneError if friction is too large to
    be simulated.
    """
    table, begin = scene.table, time.perf_counter()
    if (smallness := smallness_of(table.worm)) > _LARGE:
        message = (
            f"can change the momentum in a period by {smallness:.3g} times the least "
            f"momentum amplitude, but at most {_LARGE:.0e} is simulated; write all "
            f"friction smaller by {smallness / _LARGE:.2g} or more"
        )
        raise SceneError(scene.name, [("worm.friction", message)])
    report("averaging", None)
    slow = model_of(table.worm, place=False)
    extremes = extremes_of(table.worm)
    size = float(np.abs(extremes).max())
    first, second, finer = _steady(slow, table, extremes)
    chosen = _tends_to(table.course.velocity, first, _ON * size)
    averaged_at = time.perf_counter()
    report("simulating", None)
    guesses = [(s or f).velocity for f, s in zip(first, second, strict=True)]
    orbits, course, lost = _exact(table, guesses, chosen, report)
    found = _Found(
        table=table,
        size=size,
        first=first,
        second=second,
        finer=finer,
        chosen=chosen,
        closed=closed_form(table.worm),
        orbits=orbits,
        course=course,
        averaged=_averaged_course(slow, table),
        lost=lost,
    )
    return conclude(
        scene,
        _scalars(found),
        _signals(found),
        checks=_checks(found),
        facts=_facts(found),
        warnings=_warnings(found),
        timings={
            "averaging": averaged_at - begin,
            "simulate": time.perf_counter() - averaged_at,
        },
    )


def _period(worm: SwingingTable) -> float:
    return 2 * np.pi / worm.frequency


def _apart(exact: float | None, other: float | None) -> float | None:
    """Difference of two numbers, if both are known."""
    return None if exact is None or other is None else abs(exact - other)


# -- routes --------------------------------------------------------------------------------------


def _steady(
    slow: Model, table: HarmonicMassesScene, extremes: np.ndarray
) -> tuple[list[Steady], list[Steady | None], list[Steady]]:
    period, nodes = 2 * np.pi / slow["frequency"], table.averaging.nodes
    first = SlowVelocity(slow, period, 1, nodes).steady(extremes.tolist())
    if not first:
        raise SolveError("no steady velocity exists", "write friction in both directions")
    finer = SlowVelocity(slow, period, 1, 2 * nodes).steady(extremes.tolist())
    second = SlowVelocity(slow, period, 2, nodes).steady(extremes.tolist())
    return first, [_nearest(steady, second) for steady in first], finer


def _nearest(steady: Steady, among: Sequence[Steady]) -> Steady | None:
    alike = [other for other in among if other.stable == steady.stable]
    return min(alike, key=lambda other: abs(other.velocity - steady.velocity), default=None)


def _tends_to(velocity: float, steady: Sequence[Steady], near: float) -> int:
    """Steady velocity to which a slow motion converges: it stays on one, and cannot pass one."""
    away = [abs(s.velocity - velocity) for s in steady]
    if min(away) <= near:
        return away.index(min(away))
    ahead = [k for k, s in enumerate(steady) if s.velocity > velocity]
    behind = [k for k, s in enumerate(steady) if s.velocity < velocity]
    for k in [*ahead[:1], *behind[-1:]]:
        if steady[k].stable:
            return k
    return (ahead[:1] or behind[-1:])[0]


def _averaged_course(slow: Model, table: HarmonicMassesScene) -> Trajectory:
    period = 2 * np.pi / slow["frequency"]
    averaged = SlowVelocity(slow, period, 1, table.averaging.nodes).averaged
    end = table.course.periods * _period(table.worm)
    stiff = smallness_of(table.worm) > 1.0  # it converges within a period
    return simulate(
        averaged,
        end,
        x0={"center_velocity": table.course.velocity},
        times=np.linspace(0.0, end, table.course.samples),
        tolerance=tolerance_of(table.tolerance),
        route="radau" if stiff else "auto",
    )


def _exact(
    table: HarmonicMassesScene,
    guesses: Sequence[float],
    chosen: int,
    report: Report,
) -> tuple[list[Orbit | None], Trajectory | None, str]:
    """Periodic motions near the guesses, the course of the scene, and why one is missing."""
    model = measured(model_of(table.worm, place=True))
    recheck, asked = table.tolerance.recheck, table.course
    runner = Runner(model, _period(table.worm), tolerance_of(table.tolerance), report)
    tried = [_tried(partial(runner.orbit, V, recheck=recheck)) for V in guesses]
    course, lost = _tried(partial(runner.run, asked.velocity, asked.periods, asked.samples))
    reasons = (str(error) for error in (tried[chosen][1], lost) if error)
    return [orbit for orbit, _ in tried], course, next(reasons, "")


def _tried(solve: Callable[[], _T]) -> tuple[_T | None, SolveError | None]:
    try:
        return solve(), None
    except SolveError as error:
        return None, error


# -- results -------------------------------------------------------------------------------------


def _scalars(found: _Found) -> dict[str, Any]:
    (first, second), orbit, known = found.tends_to, found.orbit, found.known_velocity
    exact, worm = orbit and orbit.velocity, found.table.worm
    return {
        "velocity_steady": first.velocity,
        "velocity_steady_second": second,
        "velocity_closed_form": found.closed,
        "velocity_exact_mean": known,
        "averaging_error": _apart(exact, first.velocity),
        "averaging_error_second": _apart(exact, second),
        "stable": int(first.stable),
        "settling_time": -1 / first.slope if first.stable else None,
        "steady_velocities": [s.velocity for s in found.first],
        "steady_stable": [int(s.stable) for s in found.first],
        "exact_velocities": [o and o.velocity for o in found.orbits],
        "advance": known and known * _period(worm),
        "velocity_ripple": orbit and orbit.ripple,
        "exact_drift": orbit and orbit.drift,
        "force_mean": orbit and orbit.force,
        "power_mean": orbit and orbit.power,
        "energy_per_distance": orbit and known and orbit.power / abs(known),
        "rest_share": orbit and orbit.rest_share,
        "smallness": smallness_of(worm),
        "recheck_error": orbit and orbit.second and orbit.second.error,
    }


def _signals(found: _Found) -> dict[str, Any]:
    worm, theta = found.table.worm, np.linspace(0.0, 1.0, _POINTS)
    signals: dict[str, Any] = {
        "share": theta,
        "relative_velocity": relative_velocities(worm, theta),
        "time": found.averaged.time,
        "center_velocity_averaged": found.averaged["center_velocity"][0],
    }
    if found.course is not None:
        for name in ("center_velocity", "center"):
            signals[name] = found.course[name][0]
    if found.orbit is None:
        return signals
    # events of the first period: which mass reverses when
    motion, period = found.orbit.motion, _period(worm)
    names = [contact.name for contact in motion.system.model.contacts]
    events = [e for e in motion.events if e.time < period]
    if events:
        signals["event_share"] = [e.time / period for e in events]
        signals["event_contact"] = [names.index(e.name) for e in events]
        signals["event_mode"] = [e.mode for e in events]
    return signals


# -- trust ---------------------------------------------------------------------------------------


def _facts(found: _Found) -> dict[str, Any]:
    (first, second), orbit, worm = found.tends_to, found.orbit, found.table.worm
    exact = orbit and orbit.velocity
    return {
        "routes": {
            "first_order": first.velocity,
            "second_order": second,
            "closed_form": found.closed,
            "exact": exact,
            "error": _apart(exact, second),
            "accepted": orbit and _accepted(orbit, worm),
        },
        "averaging": {
            "nodes": found.table.averaging.nodes,
            "change_by_doubled_nodes": found.quadrature,
            "closed_form_error": _apart(found.closed, first.velocity),
            "accepted": _QUADRATURE * found.size,
            "steady": [asdict(steady) for steady in found.first],
        },
        "smallness": {"value": smallness_of(worm), "small_up_to": _SMALL},
        "exact": orbit
        and {
            "route": orbit.motion.route,
            "start": orbit.start,
            "drift": orbit.drift,
            "simulations": orbit.trials,
            "events": count_events(orbit.motion),
            "recheck": orbit.second and orbit.second.facts,
            "mean_forces_add_up_to": float(orbit.force.sum()),
        },
    }


def _accepted(orbit: Orbit, worm: SwingingTable) -> float:
    """Accepted error of second-order averaging.

    It is of second order in the ripple over the least amplitude that is to be reversed.
    """
    speeds = np.abs(relative_velocities(worm, np.linspace(0, 1, 257))).max(axis=1)
    return float(_FACTOR * orbit.ripple**2 / speeds.min() + _FLOOR * speeds.max())


def _bends(orbit: Orbit, worm: SwingingTable) -> bool:
    """Whether ripple nearly reaches a velocity where a mass begins or ceases to reverse."""
    room = np.abs(extremes_of(worm) - orbit.velocity).min()
    return bool(orbit.ripple > _NEAR * room)


def _checks(found: _Found) -> Iterator[Check]:
    (first, second), orbit, change = found.tends_to, found.orbit, found.quadrature
    limit = _QUADRATURE * found.size
    by = "" if change is None else f", by {change:.2g}"
    advice = f"averages on twice as many nodes have other steady velocities{by}; write a larger "
    yield Check("averages on twice as many nodes", change, limit, advice + "averaging.nodes")
    if found.closed is not None:
        advice = f"the closed form gives {found.closed:.9g}, averaging gives {first.velocity:.9g}"
        yield Check("closed form", found.closed - first.velocity, limit, advice)
    missing = [orbit, found.course].count(None)
    yield Check(
        "exact motions missing", missing, 0.0, f"an exact motion was not found: {found.lost}"
    )
    if orbit is None:
        return
    if orbit.second:
        yield orbit.second.check
    if first.stable:
        advice = f"the exact motion drifts by {orbit.drift:.2g} in ten periods"
        yield Check("drift", orbit.drift, found.accepted, advice)
    small = smallness_of(found.table.worm) <= _SMALL
    if small and not orbit.rest_share and not _bends(orbit, found.table.worm):
        error = _apart(orbit.velocity, second)
        advice = (
            "friction is small, but the exact mean velocity differs from second-order averaging,"
            + ("which has no steady velocity" if error is None else f"by {error:.2g}")
        )
        yield Check("second order", error, _accepted(orbit, found.table.worm), advice)


def _warnings(found: _Found) -> Iterator[str]:
    orbit, smallness = found.orbit, smallness_of(found.table.worm)
    if smallness > _SMALL:
        yield (
            f"friction is not small: in a period it can change the momentum by {smallness:.2g} "
            "times the least momentum amplitude"
            + ("" if orbit is None else "; velocity_exact_mean is valid nevertheless")
        )
    if orbit is None:
        return
    if orbit.rest_share:
        yield (
            f"a mass rests for {orbit.rest_share:.2g} of the period, but averaging assumes that it "
            "passes through 0 at once"
        )
    if smallness <= _SMALL and _bends(orbit, found.table.worm):
        yield (
            "a mass nearly begins or ceases to reverse, where averages have a corner: second order "
            "is not compared with the exact motion; write worm.friction that is more alike in both "
            "directions"
        )
    missing = [
        f"{steady.velocity:.6g}"
        for k, steady in enumerate(found.first)
        if found.orbits[k] is None and k != found.chosen
    ]
    if missing:
        yield f"no exact motion was found at the steady velocity {', '.join(missing)}"
    if orbit.velocity and not found.known_velocity:
        yield (
            f"the exact mean velocity {orbit.velocity:.2g} may be zero, since it is below the "
            "accepted error; quantities divided by it are unknown"
        )
    if not found.first[found.chosen].stable:
        yield "the reported steady velocity is unstable: the motion starts on it"
    course = found.course
    if course is not None:
        left = abs(course["center_velocity"][0, -1] - orbit.start)
        if left > 0.01 * found.size:
            yield (
                f"the motion ends {left:.2g} away from the steady motion; write more course.periods"
            )
    yield from warnings_of_motion(orbit.motion, orbit.second)
