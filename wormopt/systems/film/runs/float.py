"""Run scenes of kind ``float``: drift of floats and tracers, simulated and by formulas."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from wormopt.errors import ArgumentError, SceneError
from wormopt.progress import Report
from wormopt.result import Check, Result
from wormopt.simulation.simulate import simulate
from wormopt.simulation.trajectory import Trajectory
from wormopt.study.conclude import conclude
from wormopt.study.scene import Scene
from wormopt.systems.film.body import mean_velocity
from wormopt.systems.film.cosine import CosineWave
from wormopt.systems.film.float import (
    Drift,
    body_velocity,
    capture_delta,
    corrected_drift,
    float_drift,
    floating,
    tracer_drift,
    tracers,
)
from wormopt.systems.film.next_order import reach_warnings
from wormopt.systems.film.scenes.film import FloatScene
from wormopt.systems.film.shapes import Wave
from wormopt.systems.film.tables import MOST_PERIODS
from wormopt.systems.film.units import Fluid
from wormopt.systems.shared.proof import (
    CrossCheck,
    accepted_error,
    cross_check,
    one_or_all,
    warnings_of_motion,
)
from wormopt.systems.shared.settings import tolerance_of

_TURN = 2 * math.pi
# Least number of times the wave overtakes a body, and least number of simulated periods.
_OVERTAKEN, _LEAST = 4, 20.0
# A body is at rest on the wave if it moves less than this within the last period.
_STILL = 1e-6


def _apart(one: float, other: float) -> float:
    """Difference of two phases, from -pi to pi."""
    return math.remainder(one - other, _TURN)


@dataclass(frozen=True, eq=False)
class _Ride:
    """Bodies of one type, and their motion."""

    what: str
    drifts: tuple[Drift, ...]
    motion: Trajectory
    cross_check: CrossCheck | None

    @property
    def simulated(self) -> list[float | None]:
        """Mean velocity between the first and the last trough that passed.

        For bodies that are held, the mean velocity over the second half of the time.
        """
        end = self.motion.end_time
        middle, last = self.motion.at(np.array([end / 2, end]))["position"].T
        found: list[float | None] = []
        for i, drift in enumerate(self.drifts):
            name = f"{self.what} {i} overtaken"
            times = [event.time for event in self.motion.events if event.name == name]
            if drift.captured:
                found.append(float(last[i] - middle[i]) / (end / 2))
            elif len(times) > 1:
                places = self.motion.at(np.array([times[0], times[-1]]))["position"][i]
                found.append(mean_velocity(places, len(times) - 1, times))
            else:
                found.append(None)
        return found

    @property
    def rests(self) -> list[float | None]:
        """Phase of rest of each held body that is closest to its final phase."""
        return [
            min(drift.rests, key=lambda rest: abs(_apart(rest, phase))) if drift.rests else None
            for phase, drift in zip(self._phases(self.motion.end_time), self.drifts, strict=True)
        ]

    @property
    def phase_errors(self) -> list[float | None]:
        """Simulated phases minus phases of rest, for bodies that have come to rest."""
        end = self.motion.end_time
        last, before = self._phases(end), self._phases(end - min(_TURN, end / 2))
        return [
            None if rest is None or abs(_apart(phase, earlier)) >= _STILL else _apart(phase, rest)
            for phase, earlier, rest in zip(last, before, self.rests, strict=True)
        ]

    def _phases(self, time: float) -> list[float]:
        return [time - x for x in self.motion.at(np.array([time]))["position"][:, 0]]

    @property
    def errors(self) -> list[float | None]:
        """Simulated mean velocities minus those of the formula, for bodies that are not held."""
        return [
            None if found is None or drift.captured else found - drift.velocity
            for found, drift in zip(self.simulated, self.drifts, strict=True)
        ]


@np.errstate(all="ignore")  # what is not finite is noticed where it matters
def run(scene: Scene[FloatScene], report: Report) -> Result:
    """Simulate floats and tracers, and compare their drift with the formulas.

    The result is "failed" where both disagree, or a tracer leaves the film. Raises SceneError also
    for a wave that nearly holds a body, so its drift cannot be computed.
    """
    table, begin = scene.table, time.perf_counter()
    wave, fluid = table.film.wave(scene.name), table.film.scales
    lengths = [_TURN * length for length in table.floats.length]
    given = table.tracers
    place = _TURN * (given.position if given else 0.0)
    heights = np.array(given.height if given else ()) * wave.height(-place)
    drifts, below = _drifts(scene, wave, lengths, heights, place)
    end = _TURN * (table.course.periods or _periods((*drifts, *below)))
    floats = floating(wave, length=lengths, position=_TURN * table.floats.position)
    rides = [_ridden("float", floats, drifts, end, table, report)]
    if below:
        points = tracers(wave, height=heights, position=place)
        rides.append(_ridden("tracer", points, below, end, table, report))
    return conclude(
        scene,
        _scalars(table, wave, lengths, rides, fluid),
        _variables(wave, lengths, rides, fluid),
        checks=_checks(rides, table),
        facts=_facts(rides, table),
        warnings=[
            *_warnings(rides, table),
            *(fluid.warnings() if fluid else ()),
            *reach_warnings(wave, table.film.thinness),
        ],
        timings={"ride": time.perf_counter() - begin},
        attributes={"lengths": list(table.floats.length)},
    )


def _drifts(
    scene: Scene[FloatScene], wave: Wave, lengths: list[float], heights: np.ndarray, place: float
) -> tuple[tuple[Drift, ...], tuple[Drift, ...]]:
    """Drifts of floats and tracers by formulas."""
    try:
        drifts = tuple(float_drift(wave, length) for length in lengths)
        below = tuple(tracer_drift(wave, height, place) for height in heights)
    except ArgumentError as error:
        raise SceneError(scene.name, [("film", str(error))]) from None
    shares = scene.table.tracers.height if scene.table.tracers else ()
    if 1 in shares and float_drift(wave).captured:
        message = (
            "is on the surface of a wave that holds floats, and at the point of capture "
            "every error takes a tracer off the surface; write a height below 1, and use "
            "floats for the surface"
        )
        raise SceneError(scene.name, [(f"tracers.height[{shares.index(1)}]", message)])
    return drifts, below


def _periods(drifts: Sequence[Drift]) -> float:
    """Periods in which the wave overtakes every body that is not held several times."""
    turns = [drift.turn / _TURN for drift in drifts if not drift.captured]
    return min(max([_LEAST, *(_OVERTAKEN * turn for turn in turns)]), MOST_PERIODS)


def _ridden(
    what: str, model: Any, drifts: tuple[Drift, ...], end: float, table: FloatScene, report: Report
) -> _Ride:
    tolerance = tolerance_of(table.tolerance)
    report(f"{what}s", 0.0)
    times = np.linspace(0.0, end, table.course.samples)
    motion = simulate(model, end, times=times, dense=True, tolerance=tolerance, report=report)
    recheck = table.tolerance.recheck
    second = cross_check(model, motion, tolerance, recheck=recheck, report=report)
    return _Ride(what, drifts, motion, second)


# -- results ---------------------------------------------------------------------------------------


def _checks(rides: Sequence[_Ride], table: FloatScene) -> Iterator[Check]:
    accepted = accepted_error(tolerance_of(table.tolerance))
    for ride in rides:
        if ride.cross_check:
            yield replace(ride.cross_check.check, name=f"second route of {ride.what}s")
        for i, error in enumerate(ride.errors):
            if error is not None:
                advice = (
                    f"the simulated drift of {ride.what} {i} differs from its formula by "
                    f"{error:.2g}"
                )
                yield Check(f"drift of {ride.what} {i}", error, accepted, advice)
        for i, error in enumerate(ride.phase_errors):
            if error is not None:
                limit = _accepted_phase(ride, table)
                advice = f"{ride.what} {i} is held {error:.2g} rad away from its phase of rest"
                yield Check(f"phase of {ride.what} {i}", error, limit, advice)
    for name, value in _left(rides[1]).items() if len(rides) > 1 else ():
        yield Check(name, value, accepted, f"{name} {value:.2g}, where {accepted:.2g} is accepted")


def _accepted_phase(ride: _Ride, table: FloatScene) -> float:
    """Accepted error of a phase t - x, the difference of two numbers as large as the time."""
    accepted = accepted_error(tolerance_of(table.tolerance))
    return max(_STILL, accepted, table.tolerance.relative * ride.motion.end_time)


def _left(ride: _Ride) -> dict[str, float]:
    """Deviation of tracers from their streamlines, and from the film."""
    stream, depth = ride.motion["stream"], ride.motion["depth"]
    low = min(float(depth.min()), float(ride.motion["height"].min()))
    return {
        "the stream function along paths changes by": float(np.ptp(stream, axis=1).max()),
        "tracers are outside the film by": max(0.0, -low),
    }


def _scalars(
    table: FloatScene, wave: Wave, lengths: list[float], rides: Sequence[_Ride], fluid: Fluid | None
) -> dict[str, Any]:
    speed, rate = (fluid.speed, fluid.frequency) if fluid else (1.0, 1.0)
    xi = np.linspace(0.0, _TURN, 4097)
    fastest = [float(np.max(body_velocity(wave, xi, length))) * speed for length in lengths]
    found = {
        "float_length": one_or_all(table.floats.length),
        "trapped": one_or_all([drift.captured for drift in rides[0].drifts]),
        "mean_flow": wave.mean_flow,
        "body_speed_max": one_or_all(fastest),
        "phase_trapped": one_or_all(rides[0].rests),
        "phase_trapped_error": one_or_all(rides[0].phase_errors),
    }
    if isinstance(wave, CosineWave):
        found["delta"] = wave.delta
        found["delta_capture"] = one_or_all([capture_delta(length) for length in lengths])
    eps = table.film.thinness
    if eps is not None:
        corrected = [corrected_drift(wave, eps, length) for length in lengths]
        found["float_drift_corrected"] = one_or_all([each.value * speed for each in corrected])
        bars = [None if each.bar is None else each.bar * speed for each in corrected]
        found["float_drift_bar"] = one_or_all(bars)
    for ride in rides:
        simulated = [value and value * speed for value in ride.simulated]
        found[f"{ride.what}_drift"] = one_or_all(simulated)
        found[f"{ride.what}_drift_closed"] = one_or_all([d.velocity * speed for d in ride.drifts])
        found[f"{ride.what}_drift_error"] = one_or_all(ride.errors)
        found[f"{ride.what}_turn"] = one_or_all([drift.turn / rate for drift in ride.drifts])
    if len(rides) > 1:
        found["tracer_trapped"] = one_or_all([drift.captured for drift in rides[1].drifts])
    return found | ({"wave_speed": speed, "wavelength": fluid.wavelength} if fluid else {})


def _variables(
    wave: Wave, lengths: list[float], rides: Sequence[_Ride], fluid: Fluid | None
) -> dict[str, np.ndarray]:
    along, across = (1 / fluid.wave_number, fluid.depth) if fluid else (1.0, 1.0)
    speed, duration = (fluid.speed, 1 / fluid.frequency) if fluid else (1.0, 1.0)
    floats, xi = rides[0].motion, np.linspace(0.0, _TURN, 401)
    speeds = np.array([body_velocity(wave, xi, length) for length in lengths])
    found = {
        "time": floats.time * duration,
        "float_position": floats["position"] * along,
        "xi": xi,
        "height": wave.height(xi) * across,
        "field_squared": wave.least_field(xi, fluid.tension if fluid else 0.0),
        "body_velocity": speeds * speed,
    }
    if len(rides) > 1:
        points = rides[1].motion
        found["tracer_position"] = points["position"] * along
        found["tracer_height"] = points["height"] * across
    return found


def _facts(rides: Sequence[_Ride], table: FloatScene) -> dict[str, Any]:
    tolerance = tolerance_of(table.tolerance)
    facts = {
        "tolerance": {"relative": tolerance.relative, "absolute": tolerance.absolute},
        "route": one_or_all([ride.motion.route for ride in rides]),
        "recheck": one_or_all([ride.cross_check and ride.cross_check.facts for ride in rides]),
        "drift_error": [error for ride in rides for error in ride.errors],
        "phase_error": rides[0].phase_errors,
        "phase_accepted": _accepted_phase(rides[0], table),
        "drift_accepted": accepted_error(tolerance),
    }
    return facts | ({"tracers": _left(rides[1])} if len(rides) > 1 else {})


def _warnings(rides: Sequence[_Ride], table: FloatScene) -> Iterator[str]:
    for ride in rides:
        yield from warnings_of_motion(ride.motion, ride.cross_check)
        rows = zip(ride.simulated, ride.drifts, ride.phase_errors, strict=True)
        for i, (found, drift, off) in enumerate(rows):
            if found is None:
                yield (
                    f"the wave overtakes {ride.what} {i} fewer than two times, so the simulated "
                    f"drift is unknown; write course.periods = {2.5 * drift.turn / _TURN:.4g} or "
                    "more"
                )
            elif drift.captured and ride.what == "float" and (off is None or abs(found - 1) > 1e-6):
                yield f"{ride.what} {i} has not come to rest on the wave; write more course.periods"
    if max(table.floats.length) > 0:
        yield (
            "floats with a length are thin and bend with the surface; they are assumed not to "
            "change the flow of the film"
        )
