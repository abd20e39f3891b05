"""Kind "float": drift of floats and tracers, simulated and by formulas."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, Any, ClassVar

from msgspec import Meta

from wormopt.errors import Fault, SceneError, SolveError
from wormopt.result import Check
from wormopt.study import (
    Given,
    Study,
    array,
    attributes,
    checks,
    entry,
    facts,
    number,
    on_use,
    parts,
    scalar,
    stage,
    value,
    warnings,
)
from wormopt.study.numerics import ToleranceTable
from wormopt.systems.film.tables import MOST_PERIODS, Film, Length, Ride
from wormopt.systems.shared.studies import refused_at

with on_use():
    import numpy as np

    from wormopt.simulation.simulate import simulate
    from wormopt.simulation.trajectory import Trajectory
    from wormopt.systems.film.body import mean_velocity
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
    from wormopt.systems.film.shapes import Wave
    from wormopt.systems.shared.proof import (
        CrossCheck,
        accepted_error,
        cross_check,
        one_or_all,
        warnings_of_motion,
    )

_TURN = 2 * math.pi
# Least number of times the wave overtakes a body, and least number of simulated periods.
_OVERTAKEN, _LEAST = 4, 20.0
# A body is at rest on the wave if it moves less than this within the last period.
_STILL = 1e-6

Lengths = Annotated[
    tuple[Length, ...],
    Meta(min_length=1, max_length=8, description="1 to 8 numbers from 0 to below 1"),
]
Levels = Annotated[
    tuple[Annotated[float, Meta(gt=0, le=1, description="a number above 0, up to 1")], ...],
    Meta(min_length=1, max_length=8, description="1 to 8 numbers above 0, up to 1"),
]


class Floats(Given):
    """Bodies on the surface."""

    length: Lengths = entry(
        "lengths in wavelengths; 0: a small float", quantity="1", default=(0.0,)
    )
    position: float = number(
        "1", "initial position of the middle, in wavelengths ahead of a crest", default=0.0
    )


class Tracers(Given):
    """Tracers in the fluid; default: none."""

    height: Levels = entry(
        "initial height as a share of the thickness; 1: on the surface", quantity="1"
    )
    position: float = number("1", "initial position, as for floats", default=0.0)


def _apart(one: float, other: float) -> float:
    """Difference of two phases, from -pi to pi."""
    return math.remainder(one - other, _TURN)


@dataclass(frozen=True, eq=False)
class Ridden:
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
                found.append(mean_velocity(places, (times[0], times[-1])))
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

    @property
    def streamline_errors(self) -> dict[str, float]:
        """Deviation of tracers from their streamlines, and from the film."""
        stream, depth = self.motion["stream"], self.motion["depth"]
        low = min(float(depth.min()), float(self.motion["height"].min()))
        return {
            "the stream function along paths changes by": float(np.ptp(stream, axis=1).max()),
            "tracers are outside the film by": max(0.0, -low),
        }


@dataclass(frozen=True)
class FloatNumbers:
    """Numbers of the floats, a list for several."""

    float_drift: Any = value(
        "speed",
        "simulated mean velocity between the first and the last trough that passed; for held "
        "floats over the second half of the time; unknown if fewer than two troughs passed",
    )
    float_drift_closed: Any = value(
        "speed",
        "mean velocity in closed form (small floats on a cosine wave) or by quadrature; 1 for "
        "held floats",
    )
    float_drift_error: Any = value("1", "difference of the two")
    float_turn: Any = value(
        "time",
        "time in which the wave overtakes the float by a wavelength; unknown for held floats",
    )
    trapped: Any = value("1", "whether the wave holds the float")
    phase_trapped: Any = value(
        "rad",
        "phase *t* − *x* at which the wave holds the float; with several such phases the one "
        "closest to its end",
    )
    phase_trapped_error: Any = value(
        "rad",
        "simulated final phase minus that phase; unknown for floats that still move on the wave",
    )


@dataclass(frozen=True)
class TracerNumbers:
    """Numbers of the tracers, a list for several."""

    tracer_drift: Any = value(
        "speed", "simulated mean velocity of the tracers, as for floats", when="tracers"
    )
    tracer_drift_closed: Any = value(
        "speed", "mean velocity of the tracers by quadrature", when="tracers"
    )
    tracer_drift_error: Any = value("1", "difference of the two", when="tracers")
    tracer_turn: Any = value(
        "time", "overtaking time of the tracers, as for floats", when="tracers"
    )
    tracer_trapped: Any = value("1", "whether the wave holds the tracer", when="tracers")


class Float(Study, kind="float"):
    """Compute the drift of floats and fluid particles on a film with a travelling wave.

    Floats of several lengths and tracers in the fluid are simulated, and compared with formulas.
    Theory: [theory-film.md](../theory-film.md#2-floats-and-tracers). With several floats or
    tracers, scalars are lists. Speeds are relative to the wave speed, in SI scenes in m/s.

    Not allowed: a tracer on the surface of a wave that holds floats, where it cannot be followed; a
    wave that nearly holds a body.

    The result fails if a drift differs from its formula by more than 1e-7 or a thousand tolerances.
    It also fails if a held float is away from its phase of rest by more than 1e-6, a thousand
    absolute tolerances, or the relative tolerance times the time, or if a tracer leaves its
    streamline or the film.
    """

    pictures: ClassVar = {
        "ride": "paths over the wave",
        "floats": "the floats on the wave, and the field (as figure 27 of Zimmermann et al. 2007)",
        "animation": "the floats on the wave, as a moving GIF",
    }
    refuses: ClassVar = {"film.tension": "has no effect on floats; leave it out"}
    headline: ClassVar = (
        "float_drift", "float_drift_closed", "float_drift_error", "float_drift_corrected",
        "float_drift_bar",
    )  # fmt: skip

    film: Film = entry("film and wave")
    floats: Floats = entry("bodies on the surface", default=Floats)
    tracers: Tracers | None = entry("tracers in the fluid", default=None)
    time: Ride = entry("duration of the simulation", default=Ride)
    tolerance: ToleranceTable = entry("tolerances of the simulation", default=ToleranceTable)

    def faults_of_keys(self) -> Iterator[Fault]:
        yield from self.film.faults_in(self.units)

    # -- drift by formulas -------------------------------------------------------------------------

    @cached_property
    def wave(self) -> Wave:
        """The wave."""
        return self.film.wave(self.name)

    @cached_property
    def lengths(self) -> list[float]:
        """Lengths of the floats."""
        return [_TURN * length for length in self.floats.length]

    @property
    def place(self) -> float:
        """Initial position of the tracers."""
        return _TURN * (self.tracers.position if self.tracers else 0.0)

    @property
    def heights(self) -> np.ndarray:
        """Initial heights of the tracers."""
        shares = self.tracers.height if self.tracers else ()
        return np.array(shares) * self.wave.height(-self.place)

    @cached_property
    def drifts(self) -> tuple[tuple[Drift, ...], tuple[Drift, ...]]:
        """Drifts of floats and of tracers; SceneError if one cannot be computed."""
        wave = self.wave
        with refused_at(self, "film"):
            drifts = tuple(float_drift(wave, length) for length in self.lengths)
            below = tuple(tracer_drift(wave, height, self.place) for height in self.heights)
        shares = self.tracers.height if self.tracers else ()
        if 1 in shares and float_drift(wave).captured:
            message = (
                "is on the surface of a wave that holds floats, and at the point of capture "
                "every error takes a tracer off the surface; write a height below 1, and use "
                "floats for the surface"
            )
            raise SceneError(self.name, [(f"tracers.height[{shares.index(1)}]", message)])
        return drifts, below

    # -- simulation --------------------------------------------------------------------------------

    @cached_property
    def end(self) -> float:
        """End of the simulation: the wave overtakes every body that is not held several times."""
        drifts = [drift for several in self.drifts for drift in several]
        turns = [drift.turn / _TURN for drift in drifts if not drift.captured]
        enough = max([_LEAST, *(_OVERTAKEN * turn for turn in turns)])
        return _TURN * (self.time.periods or min(enough, MOST_PERIODS))

    def moved(self, model: Any) -> Trajectory:
        """Simulate a model."""
        times = np.linspace(0.0, self.end, self.time.samples)
        return simulate(
            model,
            self.end,
            times=times,
            dense=True,
            tolerance=self.tolerance.options,
            report=self.report,
        )

    def again(self, model: Any, motion: Trajectory) -> CrossCheck | None:
        """Simulate a model by a second route."""
        recheck = self.tolerance.recheck
        return cross_check(
            model, motion, self.tolerance.options, recheck=recheck, report=self.report
        )

    @cached_property
    def model_of_floats(self) -> Any:
        """Model of the floats."""
        return floating(self.wave, length=self.lengths, position=_TURN * self.floats.position)

    @cached_property
    def model_of_tracers(self) -> Any:
        """Model of the tracers."""
        return tracers(self.wave, height=self.heights, position=self.place)

    @stage
    def motion_of_floats(self) -> Trajectory:
        return self.moved(self.model_of_floats)

    @stage
    def second_route_of_floats(self) -> CrossCheck | None:
        return self.again(self.model_of_floats, self.motion_of_floats)

    @stage
    def motion_of_tracers(self) -> Trajectory:
        try:
            return self.moved(self.model_of_tracers)
        except SolveError as error:  # a part of it has other times than the floats
            raise SolveError(error.reason, error.suggestion, code=error.code) from None

    @stage
    def second_route_of_tracers(self) -> CrossCheck | None:
        return self.again(self.model_of_tracers, self.motion_of_tracers)

    @property
    def ridden_floats(self) -> Ridden:
        """The floats and their motion."""
        drifts = self.drifts[0]
        return Ridden("float", drifts, self.motion_of_floats, self.second_route_of_floats)

    @property
    def ridden_tracers(self) -> Ridden:
        """The tracers and their motion."""
        drifts = self.drifts[1]
        return Ridden("tracer", drifts, self.motion_of_tracers, self.second_route_of_tracers)

    @cached_property
    def rides(self) -> list[Ridden]:
        """Floats, and tracers if there are any."""
        return [self.ridden_floats, *([self.ridden_tracers] if self.tracers else ())]

    # -- results -----------------------------------------------------------------------------------

    def numbers_of(self, ride: Ridden) -> dict[str, Any]:
        """Numbers of floats or of tracers, by name."""
        speed, time = self.film.speed_unit, self.film.time_unit
        return {
            f"{ride.what}_drift": one_or_all([v and v * speed for v in ride.simulated]),
            f"{ride.what}_drift_closed": one_or_all([d.velocity * speed for d in ride.drifts]),
            f"{ride.what}_drift_error": one_or_all(ride.errors),
            f"{ride.what}_turn": one_or_all([drift.turn * time for drift in ride.drifts]),
        }

    @parts(FloatNumbers)
    def of_floats(self) -> FloatNumbers:
        ride = self.rides[0]
        return FloatNumbers(
            **self.numbers_of(ride),
            trapped=one_or_all([drift.captured for drift in ride.drifts]),
            phase_trapped=one_or_all(ride.rests),
            phase_trapped_error=one_or_all(ride.phase_errors),
        )

    @parts(TracerNumbers)
    def of_tracers(self) -> TracerNumbers:
        ride = self.rides[1]
        captured = [drift.captured for drift in ride.drifts]
        return TracerNumbers(**self.numbers_of(ride), tracer_trapped=one_or_all(captured))

    @property
    def knows_eps(self) -> bool:
        """Whether depth times wave number is known."""
        return self.film.thinness is not None

    @cached_property
    def corrected(self) -> list[Any]:
        """Drifts with the next order."""
        eps = self.film.thinness or 0.0
        return [corrected_drift(self.wave, eps, length) for length in self.lengths]

    @scalar("speed", "drift by quadrature with the next order, *ε*²", when="knows_eps")
    def float_drift_corrected(self) -> Any:
        return one_or_all([each.value * self.film.speed_unit for each in self.corrected])

    @scalar(
        "speed",
        "error estimate of that drift for lubrication theory without inertia; unknown where "
        "*ε* times the highest harmonic is above 3",
        when="knows_eps",
    )
    def float_drift_bar(self) -> Any:
        bars = [each.bar for each in self.corrected]
        return one_or_all([None if bar is None else bar * self.film.speed_unit for bar in bars])

    @scalar(
        "1", "least amplitude at which a cosine wave holds floats of this length", when="film.delta"
    )
    def delta_capture(self) -> Any:
        return one_or_all([capture_delta(length) for length in self.lengths])

    @scalar("1", "amplitude of a cosine wave", when="film.delta")
    def delta(self) -> float | None:
        return self.film.delta

    @scalar("speed", "largest velocity of the float; the float is held from the wave speed on")
    def body_speed_max(self) -> Any:
        xi, speed = np.linspace(0.0, _TURN, 4097), self.film.speed_unit
        fastest = [np.max(body_velocity(self.wave, xi, length)) for length in self.lengths]
        return one_or_all([float(each) * speed for each in fastest])

    @scalar("1", "mean flow of the film")
    def mean_flow(self) -> float:
        return self.wave.mean_flow

    @scalar("1", "length of the float, as in the scene")
    def float_length(self) -> Any:
        return one_or_all(self.floats.length)

    @scalar("speed", "speed of the wave (SI)", when="film.fluid")
    def wave_speed(self) -> float:
        return self.film.speed_unit

    @scalar("length", "wavelength of the wave (SI)", when="film.fluid")
    def wavelength(self) -> float:
        return self.film.fluid.wavelength if self.film.fluid else 1.0

    @array("time", "time", "time", name="time")
    def instants(self) -> np.ndarray:
        return self.motion_of_floats.time * self.film.time_unit

    @array("length", "body time", "middles of the floats")
    def float_position(self) -> np.ndarray:
        return self.motion_of_floats["position"] * self.film.length_unit

    @array("length", "tracer time", "position of the tracers", when="tracers")
    def tracer_position(self) -> np.ndarray:
        return self.motion_of_tracers["position"] * self.film.length_unit

    @array("length", "tracer time", "height of the tracers", when="tracers")
    def tracer_height(self) -> np.ndarray:
        return self.motion_of_tracers["height"] * self.film.height_unit

    @array("rad", "xi", "phase t - x of the wave")
    def xi(self) -> np.ndarray:
        return np.linspace(0.0, _TURN, 401)

    @array("length", "xi", "thickness of the film")
    def height(self) -> np.ndarray:
        return self.wave.height(self.xi) * self.film.height_unit

    @array("1", "xi", "(mu - 1) H^2 / (8 pi) over P of the least field")
    def field_squared(self) -> np.ndarray:
        return self.wave.least_field(self.xi, self.film.tension_number)

    @array("speed", "body xi", "velocity of the floats over the phase")
    def body_velocity(self) -> np.ndarray:
        speeds = [body_velocity(self.wave, self.xi, length) for length in self.lengths]
        return np.array(speeds) * self.film.speed_unit

    @attributes
    def drawn(self) -> dict[str, Any]:
        return {"lengths": list(self.floats.length)}

    # -- the trust report --------------------------------------------------------------------------

    @property
    def accepted(self) -> float:
        """Accepted errors of drifts, streamlines and heights."""
        return accepted_error(self.tolerance.options)

    @property
    def accepted_phase(self) -> float:
        """Accepted error of a phase t - x, the difference of two numbers as large as the time."""
        return max(_STILL, self.accepted, self.tolerance.relative * self.motion_of_floats.end_time)

    @checks
    def formulas(self) -> Iterator[Check]:
        for ride in self.rides:
            if ride.cross_check:
                yield replace(ride.cross_check.check, name=f"second route of {ride.what}s")
            for i, error in enumerate(ride.errors):
                if error is not None:
                    advice = (
                        f"the simulated drift of {ride.what} {i} differs from its formula by "
                        f"{error:.2g}"
                    )
                    yield Check(f"drift of {ride.what} {i}", error, self.accepted, advice)
            for i, error in enumerate(ride.phase_errors):
                if error is not None:
                    advice = f"{ride.what} {i} is held {error:.2g} rad away from its phase of rest"
                    yield Check(f"phase of {ride.what} {i}", error, self.accepted_phase, advice)
        for name, error in self.rides[1].streamline_errors.items() if self.tracers else ():
            advice = f"{name} {error:.2g}, where {self.accepted:.2g} is accepted"
            yield Check(name, error, self.accepted, advice)

    @facts
    def found(self) -> dict[str, Any]:
        rides = self.rides
        found = {
            "tolerance": {
                "relative": self.tolerance.relative,
                "absolute": self.tolerance.absolute,
            },
            "route": one_or_all([ride.motion.route for ride in rides]),
            "recheck": one_or_all([ride.cross_check and ride.cross_check.facts for ride in rides]),
            "drift_error": [error for ride in rides for error in ride.errors],
            "phase_error": rides[0].phase_errors,
            "phase_accepted": self.accepted_phase,
            "drift_accepted": self.accepted,
        }
        return found | ({"tracers": rides[1].streamline_errors} if self.tracers else {})

    @warnings
    def of_motions(self) -> Iterator[str]:
        for ride in self.rides:
            yield from warnings_of_motion(ride.motion, ride.cross_check)
            yield from _of_ride(ride)
        if max(self.floats.length) > 0:
            yield (
                "floats with a length are thin and bend with the surface; they are assumed not to "
                "change the flow of the film"
            )

    @warnings
    def of_theory(self) -> Iterator[str]:
        yield from self.film.fluid.warnings() if self.film.fluid else ()
        yield from reach_warnings(self.wave, self.film.thinness)


def _of_ride(ride: Ridden) -> Iterator[str]:
    rows = zip(ride.simulated, ride.drifts, ride.phase_errors, strict=True)
    for i, (found, drift, off) in enumerate(rows):
        if found is None:
            yield (
                f"the wave overtakes {ride.what} {i} fewer than two times, so the simulated "
                f"drift is unknown; write time.periods = {2.5 * drift.turn / _TURN:.4g} or "
                "more"
            )
        elif drift.captured and ride.what == "float" and (off is None or abs(found - 1) > 1e-6):
            yield f"{ride.what} {i} has not come to rest on the wave; write more time.periods"
