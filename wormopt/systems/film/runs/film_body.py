"""Run scenes of kind ``film-body``: the motion of a body with mass in a given wave."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar

from wormopt.errors import ArgumentError, SceneError
from wormopt.progress import Report
from wormopt.quantities import GRAVITY
from wormopt.result import Check, Result, left_out
from wormopt.simulation.simulate import simulate
from wormopt.simulation.trajectory import Trajectory
from wormopt.study.conclude import conclude
from wormopt.study.scene import Scene
from wormopt.systems.film.body import HeavyFloat, LyingBody, carried_body
from wormopt.systems.film.next_order import reach_warnings
from wormopt.systems.film.scenes.film_body import FilmBodyScene
from wormopt.systems.film.shapes import Wave, grid
from wormopt.systems.film.units import Fluid
from wormopt.systems.shared.proof import CrossCheck, accepted_error, cross_check, warnings_of_motion
from wormopt.systems.shared.settings import tolerance_of

_TURN = 2 * math.pi
# Default number of simulated periods; phases in sums; samples of the last turn.
_PERIODS, _PHASES, _SAMPLES = 40.0, 1 << 16, 2001
# Velocities this near to the wave's are held by it; two turns this near to each other settled.
_HELD, _SETTLED = 1e-6, 1e-5
_MOST_SWINGS = 5e4  # of a float in a trough, without the fluid's drag: some minutes
_DRAUGHT = 0.1  # above this share of the thickness a float is not told to leave the film alone


@dataclass(frozen=True)
class _Numbers:
    """Parameters of a body in the scales of eq. 25 of Zimmermann et al. 2007."""

    mass: float
    weight: float = 0.0
    forward: float = 0.0
    backward: float = 0.0


@dataclass(frozen=True, eq=False)
class _Course:
    """Motion of a body, and its last turn in the wave."""

    motion: Trajectory

    @cached_property
    def held(self) -> bool:
        """Whether the wave carries the body along at the end."""
        end = self.motion.end_time
        late = self.motion.at(np.linspace(end - min(_TURN, end / 2), end, 101))["velocity"][0]
        return bool(np.all(np.abs(late - 1) < _HELD))

    @cached_property
    def turns(self) -> np.ndarray:
        """Times at which troughs pass the body."""
        return np.diff([e.time for e in self.motion.events if e.name == "body 0 overtaken"])

    @property
    def drift(self) -> float | None:
        """Mean velocity over the last turn; 1 if the body is held."""
        if self.held:
            return 1.0
        if not len(self.turns):
            return None
        times = [e.time for e in self.motion.events if e.name == "body 0 overtaken"][-2:]
        return mean_velocity(self.motion.at(np.array(times))["position"][0], 1, times)

    @property
    def settled(self) -> float | None:
        """Relative difference between the last two turns."""
        if self.held or len(self.turns) < 2:
            return None
        return float(abs(self.turns[-1] / self.turns[-2] - 1))

    @cached_property
    def late(self) -> np.ndarray:
        """Velocities in the last turn, or in the last period."""
        end = self.motion.end_time
        turn = self.turns[-1] if len(self.turns) and not self.held else min(_TURN, end)
        return self.motion.at(np.linspace(end - turn, end, _SAMPLES))["velocity"][0]


def mean_velocity(places: np.ndarray, turns: int, times: Sequence[float]) -> float:
    """Mean velocity of a body over whole turns, as exact as their times.

    The wave overtakes the body, or the body the wave: its `places` (2,) at the first and the last
    of the `times` decide.
    """
    took = times[-1] - times[0]
    ahead = 1.0 if places[-1] - places[0] > took else -1.0
    return 1 + ahead * _TURN * turns / took


@np.errstate(all="ignore")  # what is not finite is noticed where it matters
def run(scene: Scene[FilmBodyScene], report: Report) -> Result:
    """Simulate a body with mass; "failed" where balances or the second route disagree."""
    table, begin = scene.table, time.perf_counter()
    fluid, numbers = table.film.scales, _numbers(table)
    body = _body(scene, numbers)
    end = _TURN * (table.course.periods or _PERIODS)
    tolerance = tolerance_of(table.tolerance)
    model = carried_body(
        body, mass=numbers.mass, forward=numbers.forward, backward=numbers.backward,
        position=_TURN * table.body.position,
    )  # fmt: skip
    times = np.linspace(0.0, end, table.course.samples)
    motion = simulate(model, end, times=times, dense=True, tolerance=tolerance, report=report)
    recheck = table.tolerance.recheck
    second = cross_check(model, motion, tolerance, recheck=recheck, report=report)
    course = _Course(motion)
    return conclude(
        scene,
        _scalars(table, body, numbers, course, fluid),
        _variables(body, numbers, motion, fluid),
        checks=_checks(motion, second, numbers, accepted_error(tolerance)),
        facts={
            "tolerance": {"relative": tolerance.relative, "absolute": tolerance.absolute},
            "route": motion.route,
            "recheck": second and second.facts,
        },
        warnings=[
            *_warnings(table, course, fluid),
            *warnings_of_motion(motion, second),
            *(fluid.warnings() if fluid else ()),
            *reach_warnings(body.wave, table.film.thinness),
        ],
        timings={"carry": time.perf_counter() - begin},
        attributes={"on": table.body.on, "length": table.body.length, "height": table.body.height},
    )


def _numbers(table: FilmBodyScene) -> _Numbers:
    body, fluid = table.body, table.film.scales
    if fluid is None:
        forward = body.friction_forward or 0.0
        backward = forward if body.friction_backward is None else body.friction_backward
        return _Numbers(body.mass or 0.0, body.weight or 0.0, forward, backward)
    density, depth = body.density or 0.0, body.height * fluid.depth
    shear = _shear(fluid)
    mass = density * depth * fluid.frequency * fluid.depth / fluid.viscosity
    if body.on == "surface":
        return _Numbers(mass, density * depth * GRAVITY * fluid.eps / shear)
    heavy = (density - fluid.density) * depth * GRAVITY
    friction = (body.friction_coefficient or 0.0) * heavy / shear
    return _Numbers(mass, 0.0, friction, friction)


def _shear(fluid: Fluid | None) -> float:
    """Unit of forces per area, eta omega / (k d), in Pa."""
    return fluid.viscosity * fluid.frequency / fluid.eps if fluid else 1.0


def _body(scene: Scene[FilmBodyScene], numbers: _Numbers) -> HeavyFloat | LyingBody:
    table = scene.table
    wave, length = table.film.wave(scene.name), _TURN * table.body.length
    if table.body.on == "surface":
        _check_weight(scene, numbers, wave)
        return HeavyFloat(wave, length, numbers.weight)
    tension = table.film.tension_number
    try:
        return LyingBody(wave, table.body.height, length, tension)
    except ArgumentError as error:
        raise SceneError(scene.name, [("body.height", str(error))]) from None


def _check_weight(scene: Scene[FilmBodyScene], numbers: _Numbers, wave: Wave) -> None:
    """Refuse a float that oscillates in a trough too often to be simulated."""
    bend = float(np.abs(wave.height(grid(4096), 2)).max())
    periods = scene.table.course.periods or _PERIODS
    swings = periods * math.sqrt(numbers.weight * bend / numbers.mass)
    if swings <= _MOST_SWINGS:
        return
    share = 0.95 * _MOST_SWINGS / swings  # Values in the message have two digits.
    fewer = f"write course.periods = {share * periods:.2g} at most"
    key, given = ("course.periods", periods)
    if scene.table.units != "SI":  # in these scenes mass and weight increase together
        key, given = "body.weight", numbers.weight
        fewer = f"write {share**2 * given:.2g} at most, or {fewer.removeprefix('write ')}"
    message = (
        f"{given:g}: the float would oscillate about {swings:.1g} times in a trough, too often"
    )
    raise SceneError(scene.name, [(key, message + f"to be simulated; {fewer}")])


# -- results ---------------------------------------------------------------------------------------


def _checks(
    motion: Trajectory, second: CrossCheck | None, numbers: _Numbers, accepted: float
) -> Iterator[Check]:
    if second:
        yield second.check
    speed, mass = motion["velocity"][0, -1], numbers.mass
    size = mass * max(1.0, float(np.abs(motion["velocity"]).max()))
    for name, gained in (("momentum", mass * speed), ("energy", mass * speed**2 / 2)):
        given = motion["impulse" if name == "momentum" else "work"][0, -1]
        error = float((gained - given) / size)
        advice = (
            f"the {name} of the body differs by {error:.2g} from the integral of the "
            "forces; lower the tolerance"
        )
        yield Check(name, error, accepted, advice)


def _scalars(
    table: FilmBodyScene,
    body: HeavyFloat | LyingBody,
    numbers: _Numbers,
    course: _Course,
    fluid: Fluid | None,
) -> dict[str, Any]:
    speed, rate = (fluid.speed, fluid.frequency) if fluid else (1.0, 1.0)
    found: dict[str, Any] = {
        "drift": course.drift and course.drift * speed,
        "drift_massless": _massless(body, numbers) * speed,
        "held": course.held,
        "settled": course.settled,
        "speed_max": float(course.late.max()) * speed,
        "speed_min": float(course.late.min()) * speed,
        "mass": numbers.mass,
        "turn": None if course.held or not len(course.turns) else course.turns[-1] / rate,
    }
    if isinstance(body, LyingBody):
        forward, backward = (_largest(body, sign) for sign in (1, -1))
        found |= {
            "at_rest": float(np.mean(course.late == 0)),
            "friction": numbers.forward * _shear(fluid),
            "friction_forward": forward * _shear(fluid),
            "friction_backward": backward * _shear(fluid),
        }
    else:
        found["weight"] = numbers.weight
    if fluid:
        found |= {"wave_speed": fluid.speed, "wavelength": fluid.wavelength}
        if table.body.on == "surface":
            found["draught"] = _draught(table, fluid)
    return found


def _massless(body: HeavyFloat | LyingBody, numbers: _Numbers) -> float:
    """Drift of the body without mass."""
    velocity = _light(body, numbers, grid(_PHASES))
    if np.min(velocity) <= 1 <= np.max(velocity):  # The massless body reaches the speed of the wave
        # somewhere.
        return 1.0
    return 1 - 1 / float(np.mean(1 / (1 - velocity)))


def _light(body: HeavyFloat | LyingBody, numbers: _Numbers, xi: np.ndarray) -> np.ndarray:
    if isinstance(body, LyingBody):
        return body.velocity(xi, numbers.forward, numbers.backward)
    return body.velocity(xi)


def _largest(body: LyingBody, sign: int) -> float:
    """Largest force on the body at rest, in one direction."""
    xi = grid(4096)
    first = xi[np.argmax(sign * body.push(xi))]
    found: Any = minimize_scalar(
        lambda at: -sign * float(body.push(np.array([at]))[0]),
        bounds=(first - xi[1], first + xi[1]),
        method="bounded",
        options={"xatol": 1e-10},
    )
    return max(0.0, -float(found.fun))


def _draught(table: FilmBodyScene, fluid: Fluid) -> float:
    return table.body.height * (table.body.density or 0.0) / fluid.density


def _variables(
    body: HeavyFloat | LyingBody, numbers: _Numbers, motion: Trajectory, fluid: Fluid | None
) -> dict[str, np.ndarray]:
    along, across = (1 / fluid.wave_number, fluid.depth) if fluid else (1.0, 1.0)
    speed, duration = (fluid.speed, 1 / fluid.frequency) if fluid else (1.0, 1.0)
    xi = np.linspace(0.0, _TURN, 401)
    return {
        "time": motion.time * duration,
        "position": motion["position"][0] * along,
        "velocity": motion["velocity"][0] * speed,
        "xi": xi,
        "height": body.wave.height(xi) * across,
        "velocity_massless": _light(body, numbers, xi) * speed,
    }


def _warnings(table: FilmBodyScene, course: _Course, fluid: Fluid | None) -> Iterator[str]:
    yield "the body is assumed not to change the wave"
    if course.drift is None:
        yield "fewer than two troughs passed, so the drift is unknown; write more course.periods"
    elif course.settled is not None and course.settled > _SETTLED:
        yield (
            f"the last two turns differ by {course.settled:.2g}: the motion still depends on its "
            "start; write more course.periods"
        )
    draught = _draught(table, fluid) if fluid and table.body.on == "surface" else 0.0
    if draught > _DRAUGHT:
        yield left_out(
            draught,
            f"the draught is {draught:.3g} of the film's thickness, which is not small: a heavy "
            "float dents the surface",
        )
