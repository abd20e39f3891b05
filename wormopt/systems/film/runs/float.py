"""Scenes of kind ``float``: what the wave on a film carries, simulated and by formulas."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from wormopt.errors import ArgumentError, SceneError
from wormopt.progress import Report
from wormopt.quantities import Scalar, Variable, unit_of
from wormopt.result import Result
from wormopt.scene.scene import Scene
from wormopt.simulation.options import Tolerance
from wormopt.simulation.simulate import simulate
from wormopt.simulation.trajectory import Trajectory
from wormopt.systems.chain.runs.chains import tolerance_of
from wormopt.systems.film.cosine import CosineWave
from wormopt.systems.film.drift import (
    Drift,
    Wave,
    body_velocity,
    capture_delta,
    float_drift,
    tracer_drift,
)
from wormopt.systems.film.float import floating, tracers
from wormopt.systems.film.runs.film_flow import fluid_of, wave_of
from wormopt.systems.film.scenes.film import FloatScene
from wormopt.systems.film.units import Fluid
from wormopt.systems.shared.proof import (
    Recheck,
    accepted_error,
    one_or_all,
    recheck,
    warnings_of_motion,
)

_TURN = 2 * math.pi
# How often a body shall be overtaken, how many periods are simulated at least and at most.
_OVERTAKEN, _LEAST, _MOST = 4, 20.0, 20_000.0
# A body is at rest on the wave if it moves less than this within the last period.
_STILL = 1e-6


def _apart(one: float, other: float) -> float:
    """Difference of two phases, from -pi to pi."""
    return math.remainder(one - other, _TURN)


@dataclass(frozen=True, eq=False)
class _Ride:
    """Bodies of one sort, and how they went."""

    what: str
    drifts: tuple[Drift, ...]
    motion: Trajectory
    recheck: Recheck | None

    @property
    def simulated(self) -> list[float | None]:
        """Mean velocities between the first and the last trough that passed.

        Of bodies that are held, over the second half of the time.
        """
        end = self.motion.end_time
        middle, last = self.motion.at(np.array([end / 2, end])).state("position").T
        found: list[float | None] = []
        for i, drift in enumerate(self.drifts):
            name = f"{self.what} {i} overtaken"
            times = [event.time for event in self.motion.events if event.name == name]
            if drift.captured:
                found.append(float(last[i] - middle[i]) / (end / 2))
            elif len(times) > 1:
                found.append(1 - _TURN * (len(times) - 1) / (times[-1] - times[0]))
            else:
                found.append(None)
        return found

    @property
    def rests(self) -> list[float | None]:
        """Of the phases at which a body is held, the nearest to where it is in the end."""
        return [
            min(drift.rests, key=lambda rest: abs(_apart(rest, phase))) if drift.rests else None
            for phase, drift in zip(self._phases(self.motion.end_time), self.drifts, strict=True)
        ]

    @property
    def phase_errors(self) -> list[float | None]:
        """Simulated phases less those of rest, of bodies that have come to rest."""
        end = self.motion.end_time
        still = [abs(_apart(*pair)) < _STILL for pair in zip(
            self._phases(end), self._phases(end - min(_TURN, end / 2)), strict=True
        )]  # fmt: skip
        return [
            None if rest is None or not held else _apart(phase, rest)
            for phase, rest, held in zip(self._phases(end), self.rests, still, strict=True)
        ]

    def _phases(self, time: float) -> list[float]:
        return [time - x for x in self.motion.at(np.array([time])).state("position")[:, 0]]

    @property
    def errors(self) -> list[float | None]:
        """Simulated mean velocities less those by formula, of bodies that are not held."""
        pairs = zip(self.simulated, self.drifts, strict=True)
        return [
            None if found is None or drift.captured else found - drift.velocity
            for found, drift in pairs
        ]


@np.errstate(all="ignore")  # what is not finite is noticed where it matters
def run(scene: Scene[FloatScene], report: Report) -> Result:
    """Simulate floats and tracers, and compare their drift with the formulas.

    Status "failed" where both disagree, or a tracer leaves the film. Raises SceneError also
    for a wave so near to holding a body that its drift cannot be told.
    """
    table, begin = scene.table, time.perf_counter()
    wave, fluid = wave_of(scene, table.film), fluid_of(table.film)
    places = _Places(table, wave)
    drifts, below = _drifts(scene, wave, places)
    end = _TURN * (table.course.periods or _periods((*drifts, *below)))
    rides = [
        _ridden("float", floating(wave, length=places.lengths, position=places.floats), drifts,
                end, table, report)
    ]  # fmt: skip
    if below:
        model = tracers(wave, height=places.heights, position=places.tracers)
        rides.append(_ridden("tracer", model, below, end, table, report))
    faults = [*_faults(rides, table)]
    return Result(
        scene=scene.name,
        kind=table.kind,
        title=table.title,
        status="failed" if faults else "ok",
        reason="; ".join(faults),
        scalars=_scalars(table, wave, rides, fluid),
        variables=(*_variables(table, wave, rides, fluid),),
        trust=_trust(rides, table, fluid),
        timings_s={"ride": time.perf_counter() - begin},
        scene_text=scene.text,
        attributes={"lengths": list(table.floats.length)},
    )


class _Places:
    """Lengths and starts of a scene, in units of 1/k and of the mean thickness."""

    def __init__(self, table: FloatScene, wave: Wave) -> None:
        self.lengths = _TURN * np.array(table.floats.length)
        self.floats = _TURN * table.floats.position
        shares = np.array(table.tracers.height if table.tracers else ())
        self.tracers = _TURN * (table.tracers.position if table.tracers else 0.0)
        self.heights = shares * wave.height(-self.tracers)


def _drifts(
    scene: Scene[FloatScene], wave: Wave, places: _Places
) -> tuple[tuple[Drift, ...], tuple[Drift, ...]]:
    """What the formulas say."""
    try:
        drifts = tuple(float_drift(wave, length) for length in places.lengths)
        below = tuple(tracer_drift(wave, height, places.tracers) for height in places.heights)
    except ArgumentError as error:
        raise SceneError(scene.name, [("film", str(error))]) from None
    top = [k for k, share in enumerate(_shares(scene.table)) if share == 1]
    if top and float_drift(wave).captured:
        key = f"tracers.height[{top[0]}]"
        message = (
            "this wave holds what floats, and at the place where it does any error takes a point "
            "off the surface; write a height below 1, and let floats tell of the surface"
        )
        raise SceneError(scene.name, [(key, message)])
    return drifts, below


def _shares(table: FloatScene) -> tuple[float, ...]:
    return table.tracers.height if table.tracers else ()


def _periods(drifts: Sequence[Drift]) -> float:
    """Periods of the wave in which every body that is not held is overtaken several times."""
    turns = [drift.turn / _TURN for drift in drifts if not drift.captured]
    return min(max([_LEAST, *(_OVERTAKEN * turn for turn in turns)]), _MOST)


def _ridden(
    what: str,
    model: Any,
    drifts: tuple[Drift, ...],
    end: float,
    table: FloatScene,
    report: Report,
) -> _Ride:
    tolerance = tolerance_of(table.tolerance)
    report(f"{what}s", 0.0)
    motion = simulate(
        model,
        end,
        times=np.linspace(0.0, end, table.course.samples),
        dense=True,
        tolerance=tolerance,
        report=report,
    )
    second = recheck(model, motion, tolerance, report=report) if table.tolerance.recheck else None
    return _Ride(what, drifts, motion, second)


# -- what is told ----------------------------------------------------------------------------------


def _faults(rides: Sequence[_Ride], table: FloatScene) -> Iterator[str]:
    accepted = accepted_error(_tolerance(table))
    for ride in rides:
        if ride.recheck and ride.recheck.fault:
            yield ride.recheck.fault
        for i, error in enumerate(ride.errors):
            if error is not None and not abs(error) <= accepted:
                yield f"the simulated drift of {ride.what} {i} is {error:.2g} off its formula"
        for i, error in enumerate(ride.phase_errors):
            if error is not None and not abs(error) <= _accepted_phase(ride, table):
                yield f"{ride.what} {i} is held {error:.2g} rad off the phase of rest"
    if len(rides) > 1:
        for name, value in _left(rides[1]).items():
            if not value <= accepted:
                yield f"{name} {value:.2g}, where {accepted:.2g} is accepted"


def _accepted_phase(ride: _Ride, table: FloatScene) -> float:
    """What is accepted of a phase t - x, the difference of two numbers as large as the time."""
    return max(
        _STILL, accepted_error(_tolerance(table)), table.tolerance.relative * ride.motion.end_time
    )


def _tolerance(table: FloatScene) -> Tolerance:
    return Tolerance(table.tolerance.relative, table.tolerance.absolute)


def _left(ride: _Ride) -> dict[str, float]:
    """How far tracers leave their lines, and the film."""
    stream, depth = ride.motion.output("stream"), ride.motion.output("depth")
    low = min(float(depth.min()), float(ride.motion.state("height").min()))
    return {
        "the stream function along paths changes by": float(np.ptp(stream, axis=1).max()),
        "tracers are outside the film by": max(0.0, -low),
    }


def _scalars(
    table: FloatScene, wave: Wave, rides: Sequence[_Ride], fluid: Fluid | None
) -> dict[str, Scalar]:
    size, speed = (fluid.speed, unit_of("speed", "SI")) if fluid else (1.0, "1")
    lengths = [_TURN * length for length in table.floats.length]
    found = {
        "float_length": Scalar(one_or_all(list(table.floats.length))),
        "trapped": Scalar(one_or_all([drift.captured for drift in rides[0].drifts])),
        "mean_flow": Scalar(wave.mean_flow),
        "body_speed_max": Scalar(
            one_or_all([float(np.max(_speeds(wave, length))) * size for length in lengths]), speed
        ),
        "phase_trapped": Scalar(one_or_all(rides[0].rests), "rad"),
        "phase_trapped_error": Scalar(one_or_all(rides[0].phase_errors), "rad"),
    }
    if isinstance(wave, CosineWave):
        captures = [capture_delta(length) for length in lengths]
        found["delta"] = Scalar(wave.delta)
        found["delta_capture"] = Scalar(one_or_all(captures))
    for ride in rides:
        closed = [drift.velocity * size for drift in ride.drifts]
        simulated = [value and value * size for value in ride.simulated]
        turns = [drift.turn / (fluid.frequency if fluid else 1.0) for drift in ride.drifts]
        found[f"{ride.what}_drift"] = Scalar(one_or_all(simulated), speed)
        found[f"{ride.what}_drift_closed"] = Scalar(one_or_all(closed), speed)
        found[f"{ride.what}_drift_error"] = Scalar(one_or_all(ride.errors))
        found[f"{ride.what}_turn"] = Scalar(
            one_or_all(turns), unit_of("time", "SI" if fluid else "dimensionless")
        )
    if len(rides) > 1:
        found["tracer_trapped"] = Scalar(one_or_all([d.captured for d in rides[1].drifts]))
    if fluid:
        found["wave_speed"] = Scalar(fluid.speed, speed)
        found["wavelength"] = Scalar(fluid.wavelength, unit_of("length", "SI"))
    return found


def _speeds(wave: Wave, length: float) -> np.ndarray:
    return body_velocity(wave, np.linspace(0.0, _TURN, 4097), length)


def _variables(
    table: FloatScene, wave: Wave, rides: Sequence[_Ride], fluid: Fluid | None
) -> Iterator[Variable]:
    units = "SI" if fluid else "dimensionless"
    along = 1 / fluid.wave_number if fluid else 1.0
    across = fluid.depth if fluid else 1.0
    duration = 1 / fluid.frequency if fluid else 1.0
    length, floats = unit_of("length", units), rides[0].motion
    yield Variable("time", unit_of("time", units), ("time",), floats.time * duration, "time")
    yield Variable(
        "float_position", length, ("body", "time"), floats.state("position") * along,
        "middles of the floats",
    )  # fmt: skip
    xi = np.linspace(0.0, _TURN, 401)
    yield Variable("xi", "rad", ("xi",), xi, "phase t - x of the wave")
    yield Variable("height", length, ("xi",), wave.height(xi) * across, "thickness of the film")
    speed = fluid.speed if fluid else 1.0
    speeds = np.array([body_velocity(wave, xi, _TURN * each) for each in table.floats.length])
    yield Variable(
        "body_velocity", unit_of("speed", units), ("body", "xi"), speeds * speed,
        "velocity of the floats by phase",
    )  # fmt: skip
    if len(rides) > 1:
        points = rides[1].motion
        rows = {"tracer_position": ("position", along), "tracer_height": ("height", across)}
        for name, (state, size) in rows.items():
            values = points.state(state) * size
            yield Variable(name, length, ("tracer", "time"), values, f"{state} of the tracers")


def _trust(rides: Sequence[_Ride], table: FloatScene, fluid: Fluid | None) -> dict[str, Any]:
    trust: dict[str, Any] = {
        "tolerance": {
            "relative": table.tolerance.relative, "absolute": table.tolerance.absolute
        },
        "route": one_or_all([ride.motion.route for ride in rides]),
        "recheck": one_or_all(
            [
                r and {"route": r.route, "error": r.error, "accepted": r.accepted,
                       "shared": r.shared}
                for r in (ride.recheck for ride in rides)
            ]
        ),
        "drift_error": [error for ride in rides for error in ride.errors],
        "phase_error": rides[0].phase_errors,
        "phase_accepted": _accepted_phase(rides[0], table),
        "drift_accepted": accepted_error(_tolerance(table)),
    }  # fmt: skip
    if len(rides) > 1:
        trust["tracers"] = _left(rides[1])
    warnings = [*_warnings(rides, table), *(fluid.warnings() if fluid else ())]
    return trust | {"warnings": list(dict.fromkeys(warnings))}


def _warnings(rides: Sequence[_Ride], table: FloatScene) -> Iterator[str]:
    for ride in rides:
        yield from warnings_of_motion(ride.motion, ride.recheck)
        rows = zip(ride.simulated, ride.drifts, ride.phase_errors, strict=True)
        for i, (found, drift, off) in enumerate(rows):
            if found is None:
                yield (
                    f"{ride.what} {i} was not overtaken twice, so that simulation tells no drift; "
                    f"write course.periods of {2.5 * drift.turn / _TURN:.4g} or more"
                )
            elif drift.captured and ride.what == "float" and (off is None or abs(found - 1) > 1e-6):
                yield f"{ride.what} {i} has not come to rest on the wave; write more course.periods"
    longest = max(table.floats.length)
    if longest > 0:
        yield (
            "floats with a length bend with the surface and are thin; that the film under them "
            "flows as if they were not there is an assumption"
        )
