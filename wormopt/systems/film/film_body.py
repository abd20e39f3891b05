"""Kind "film-body": the motion of a body with mass in a given wave."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cached_property
from typing import Any, ClassVar, Literal

from wormopt.errors import Fault, SceneError
from wormopt.quantities import GRAVITY
from wormopt.result import Check, left_out
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
    positive,
    scalar,
    stage,
    warnings,
)
from wormopt.study.numerics import ToleranceTable
from wormopt.systems.film.tables import Film, Length, Ride
from wormopt.systems.shared.studies import refused_at

with on_use():
    import numpy as np
    from scipy.optimize import minimize_scalar

    from wormopt.simulation.simulate import simulate
    from wormopt.simulation.trajectory import Trajectory
    from wormopt.systems.film.body import HeavyFloat, LyingBody, carried_body, mean_velocity
    from wormopt.systems.film.next_order import reach_warnings
    from wormopt.systems.film.shapes import Wave, grid
    from wormopt.systems.shared.proof import (
        CrossCheck,
        accepted_error,
        cross_check,
        warnings_of_motion,
    )

# Keys that apply to one type of body, or to one system of units, only.
_GROUND = ("friction_forward", "friction_backward", "friction_coefficient")
_SCALED = ("mass", "weight", "friction_forward", "friction_backward")
_SI = ("density", "friction_coefficient")
_FARTHEST = 1e6  # In wavelengths: farther away, phases have no more than nine digits.
_TURN = 2 * math.pi
# Default number of simulated periods; phases in sums; samples of the last turn.
_PERIODS, _PHASES, _SAMPLES = 40.0, 1 << 16, 2001
# Velocities this close to the wave's are held by it; two turns this close to each other converged.
_HELD, _SETTLED = 1e-6, 1e-5
_MOST_SWINGS = 5e4  # of a float in a trough, without the fluid's drag: some minutes
_DRAUGHT = 0.1  # share of the thickness from which a float is reported to dent the surface


class Body(Given):
    """The body.

    Scenes without units use the scales of eq. 25 of Zimmermann et al. 2007: *η* is the viscosity,
    *ω* and *k* are frequency and wave number, *d* is the mean thickness.
    """

    on: Literal["surface", "ground"] = entry(
        "type of body: it floats, or lies in the film on the ground"
    )
    length: Length = entry("length in wavelengths; 0: a short body", quantity="1", default=0.0)
    height: float = number(
        "1",
        "height over the mean film thickness; on the ground below the least film thickness",
        least=0,
        default=0.0,
    )
    position: float = number(
        "1", "initial position of the middle, in wavelengths ahead of a crest", default=0.0
    )
    mass: float | None = positive("1", "mass per area times *ω d*/*η*", default=None)
    weight: float | None = number(
        "1", "weight of a float per area, times (*k d*)²/(*η ω*); default 0", least=0, default=None
    )
    friction_forward: float | None = number(
        "1",
        "friction on the ground per area, times *k d*/(*η ω*), against motion with the wave",
        least=0,
        default=None,
    )
    friction_backward: float | None = number(
        "1",
        "friction on the ground against motion opposite to the wave; default: the same",
        least=0,
        default=None,
    )
    density: float | None = positive("density", "density of the body (SI)", default=None)
    friction_coefficient: float | None = number(
        "1", "friction on the ground over weight minus buoyancy (SI)", least=0, default=None
    )

    def faults_of_keys(self) -> Iterator[Fault]:
        if abs(self.position) > _FARTHEST:
            yield (
                "position",
                f"{self.position:g} wavelengths are too far for an accurate phase; all "
                f"wavelengths are equal: write {math.fmod(self.position, 1.0):g}",
            )

    def faults_in(self, units: str, fluid_density: float | None) -> Iterator[Fault]:
        """Yield what does not fit the type of body, the units or the fluid."""
        given = {name for name in self.__struct_fields__ if getattr(self, name) is not None}
        scenes = "with SI" if units != "SI" else "without"
        for name in _SI if units != "SI" else _SCALED:
            if name in given:
                other = 'write units = "SI"' if units != "SI" else "density determines it here"
                yield f"body.{name}", f"applies to scenes {scenes} units only; {other}"
        for name in _GROUND if self.on == "surface" else ("weight",):
            if name in given and name not in (_SI if units != "SI" else _SCALED):
                yield f"body.{name}", f'does not apply to on = "{self.on}"; leave it out'
        needed = ["mass"] if units != "SI" else ["density"]
        if self.on == "ground":
            needed.append("friction_forward" if units != "SI" else "friction_coefficient")
        for name in needed:
            if name not in given:
                yield f"body.{name}", "missing"
        if units == "SI" and not self.height:
            yield (
                "body.height",
                "is 0, but the mass is density times height; write a height above 0",
            )
        if fluid_density is not None and self.density is not None:
            lighter = self.density < fluid_density
            if lighter != (self.on == "surface"):
                place, does = ("ground", "sinks") if not lighter else ("surface", "rises")
                message = f"a body of this density {does} in a fluid of {fluid_density:g} kg/m³"
                yield "body.on", f'{message}; write on = "{place}"'


class FilmBody(Study, kind="film-body"):
    """Simulate a body with mass in a film with a wave: floating or on the ground.

    The body is a float with mass and weight, or lies in the film on the ground, where it sticks and
    slips. It does not change the wave. Theory:
    [theory-film.md](../theory-film.md#26-floats-with-a-mass). Speeds are relative to the wave
    speed, in SI scenes in m/s.

    The integrals of the forces must agree with momentum and energy of the body, to 1e-7 or a
    thousand tolerances. A second route must end at the same state.
    """

    pictures: ClassVar = {
        "carried": "the body in the wave, and its velocity",
        "animation": "the body, as a moving GIF",
    }
    headline: ClassVar = ("drift", "drift_massless", "held", "settled", "speed_max")

    film: Film = entry("film and wave")
    body: Body = entry("the body")
    time: Ride = entry("duration of the simulation", default=Ride)
    tolerance: ToleranceTable = entry("tolerances of the simulation", default=ToleranceTable)

    def faults_of_keys(self) -> Iterator[Fault]:
        yield from self.film.faults_in(self.units)
        fluid = self.film.fluid
        yield from self.body.faults_in(self.units, fluid.density if fluid else None)
        if self.film.tension and self.floats:
            yield "film.tension", "has no effect on floats; leave it out"

    # -- the body in the scales of eq. 25 ----------------------------------------------------------

    @property
    def floats(self) -> bool:
        """Whether the body floats."""
        return self.body.on == "surface"

    @property
    def lies(self) -> bool:
        """Whether the body lies on the ground."""
        return not self.floats

    @property
    def periods(self) -> float:
        """Number of wave periods simulated."""
        return self.time.periods or _PERIODS

    @property
    def bulk(self) -> float:
        """Mass per area in SI units."""
        return (self.body.density or 0.0) * (self.body.height * self.film.height_unit)

    @scalar("1", "mass per area times *ω d*/*η*")
    def mass(self) -> float:
        fluid = self.film.fluid
        if fluid is None:
            return self.body.mass or 0.0
        return self.bulk * fluid.frequency * fluid.depth / fluid.viscosity

    @scalar("1", "weight per area times (*k d*)²/(*η ω*)", when="floats")
    def weight(self) -> float:
        fluid = self.film.fluid
        if fluid is None:
            return self.body.weight or 0.0
        return self.bulk * GRAVITY * fluid.eps / self.film.stress_unit

    @cached_property
    def frictions(self) -> tuple[float, float]:
        """Friction against motion with the wave, and opposite to it."""
        body, fluid = self.body, self.film.fluid
        if fluid is None:
            forward = body.friction_forward or 0.0
            backward = forward if body.friction_backward is None else body.friction_backward
            return forward, backward
        if self.floats:
            return 0.0, 0.0
        depth = body.height * fluid.depth
        heavy = ((body.density or 0.0) - fluid.density) * depth * GRAVITY
        friction = (body.friction_coefficient or 0.0) * heavy / self.film.stress_unit
        return friction, friction

    @cached_property
    def carried(self) -> HeavyFloat | LyingBody:
        """The body in the wave; SceneError if it cannot be simulated."""
        wave, length = self.film.wave(self.name), _TURN * self.body.length
        if self.floats:
            self._check_weight(wave)
            return HeavyFloat(wave, length, self.weight)
        with refused_at(self, "body.height"):
            return LyingBody(wave, self.body.height, length, self.film.tension_number)

    def _check_weight(self, wave: Wave) -> None:
        """Refuse a float that oscillates in a trough too often to be simulated."""
        bend = float(np.abs(wave.height(grid(4096), 2)).max())
        swings = self.periods * math.sqrt(self.weight * bend / self.mass)
        if swings <= _MOST_SWINGS:
            return
        share = 0.95 * _MOST_SWINGS / swings  # values in the message have two digits
        fewer = f"write time.periods = {share * self.periods:.2g} at most"
        key, given = ("time.periods", self.periods)
        if self.units != "SI":  # in SI scenes mass and weight increase together
            key, given = "body.weight", self.weight
            fewer = f"write {share**2 * given:.2g} at most, or {fewer.removeprefix('write ')}"
        message = (
            f"{given:g}: the float would oscillate about {swings:.1g} times in a trough, too often"
        )
        raise SceneError(self.name, [(key, message + f" to be simulated; {fewer}")])

    def massless(self, xi: np.ndarray) -> np.ndarray:
        """Velocity of the body without mass, at phases (n,)."""
        if isinstance(self.carried, LyingBody):
            return self.carried.velocity(xi, *self.frictions)
        return self.carried.velocity(xi)

    # -- the motion --------------------------------------------------------------------------------

    @cached_property
    def model(self) -> Any:
        """Model of the body in the wave."""
        forward, backward = self.frictions
        return carried_body(
            self.carried, mass=self.mass, forward=forward, backward=backward,
            position=_TURN * self.body.position,
        )  # fmt: skip

    @stage
    def motion(self) -> Trajectory:
        end = _TURN * self.periods
        times = np.linspace(0.0, end, self.time.samples)
        return simulate(
            self.model,
            end,
            times=times,
            dense=True,
            tolerance=self.tolerance.options,
            report=self.report,
        )

    @stage
    def second_route(self) -> CrossCheck | None:
        return cross_check(
            self.model, self.motion, self.tolerance.options, recheck=self.tolerance.recheck,
            report=self.report,
        )  # fmt: skip

    @scalar(
        "1",
        "whether the wave carries the body along at the end: at rest in the wave, or swinging in "
        "a trough",
    )
    def held(self) -> bool:
        end = self.motion.end_time
        late = self.motion.at(np.linspace(end - min(_TURN, end / 2), end, 101))["velocity"][0]
        return bool(np.all(np.abs(late - 1) < _HELD)) or self.swings

    @cached_property
    def overtaken(self) -> list[float]:
        """Times at which troughs pass the body."""
        return [event.time for event in self.motion.events if event.name == "body 0 overtaken"]

    @property
    def swings(self) -> bool:
        """Whether the same trough passed twice and has not left the body since."""
        times = np.array([*self.overtaken[-2:], self.motion.end_time])
        phases = times - self.motion.at(times)["position"][0]
        return len(times) == 3 and bool(np.all(np.abs(phases - phases[1]) < math.pi))

    @cached_property
    def turns(self) -> np.ndarray:
        """Times between troughs; none if the wave holds the body."""
        return np.diff([] if self.held else self.overtaken)

    @cached_property
    def late_velocity(self) -> np.ndarray:
        """Velocities in the last turn, or in the last period."""
        end = self.motion.end_time
        turn = self.turns[-1] if len(self.turns) else min(_TURN, end)
        return self.motion.at(np.linspace(end - turn, end, _SAMPLES))["velocity"][0]

    @array("time", "time", "time", name="time")
    def instants(self) -> np.ndarray:
        return self.motion.time * self.film.time_unit

    @array("length", "time", "position of the middle of the body")
    def position(self) -> np.ndarray:
        return self.motion["position"][0] * self.film.length_unit

    @array("speed", "time", "velocity of the body")
    def velocity(self) -> np.ndarray:
        return self.motion["velocity"][0] * self.film.speed_unit

    @array("rad", "xi", "phase t - x of the wave")
    def xi(self) -> np.ndarray:
        return np.linspace(0.0, _TURN, 401)

    @array("length", "xi", "thickness of the film")
    def height(self) -> np.ndarray:
        return self.carried.wave.height(self.xi) * self.film.height_unit

    @array("speed", "xi", "velocity of the body without mass over the phase")
    def velocity_massless(self) -> np.ndarray:
        return self.massless(self.xi) * self.film.speed_unit

    # -- numbers -----------------------------------------------------------------------------------

    @scalar(
        "speed",
        "mean velocity between the last two troughs that passed; the wave speed if the body "
        "is held; unknown if fewer passed",
    )
    def drift(self) -> float | None:
        if self.held:
            return self.film.speed_unit
        if not len(self.turns):
            return None
        times = self.overtaken[-2:]
        places = self.motion.at(np.array(times))["position"][0]
        return mean_velocity(places, times) * self.film.speed_unit

    @scalar("speed", "mean velocity of the same body without mass, by quadrature")
    def drift_massless(self) -> float:
        velocity = self.massless(grid(_PHASES))
        if np.min(velocity) <= 1 <= np.max(velocity):  # it reaches the speed of the wave
            return self.film.speed_unit
        return (1 - 1 / float(np.mean(1 / (1 - velocity)))) * self.film.speed_unit

    @scalar("1", "relative difference between the last two turns")
    def settled(self) -> float | None:
        if len(self.turns) < 2:
            return None
        return float(abs(self.turns[-1] / self.turns[-2] - 1))

    @scalar("time", "time between the last two troughs")
    def turn(self) -> float | None:
        return self.turns[-1] * self.film.time_unit if len(self.turns) else None

    @scalar("speed", "largest velocity in the last turn")
    def speed_max(self) -> float:
        return float(self.late_velocity.max()) * self.film.speed_unit

    @scalar("speed", "least velocity in the last turn; negative: opposite to the wave")
    def speed_min(self) -> float:
        return float(self.late_velocity.min()) * self.film.speed_unit

    @scalar("1", "share of the last turn in which the ground holds the body", when="lies")
    def at_rest(self) -> float:
        return float(np.mean(self.late_velocity == 0))

    @scalar("stress", "friction of the ground per area, against motion with the wave", when="lies")
    def friction(self) -> float:
        return self.frictions[0] * self.film.stress_unit

    def push(self, sign: int) -> float:
        """Largest force per area on the body at rest on the ground, in one direction."""
        body = self.carried
        assert isinstance(body, LyingBody)
        xi = grid(4096)
        first = xi[np.argmax(sign * body.push(xi))]
        found: Any = minimize_scalar(
            lambda at: -sign * float(body.push(np.array([at]))[0]),
            bounds=(first - xi[1], first + xi[1]),
            method="bounded",
            options={"xatol": 1e-10},
        )
        return max(0.0, -float(found.fun)) * self.film.stress_unit

    @scalar(
        "stress",
        "least friction per area at which the body never moves with the wave (on the ground)",
        when="lies",
    )
    def friction_forward(self) -> float:
        return self.push(1)

    @scalar(
        "stress",
        "least friction per area at which the body never moves opposite to the wave (on the "
        "ground)",
        when="lies",
    )
    def friction_backward(self) -> float:
        return self.push(-1)

    @property
    def floats_in_si(self) -> bool:
        """Whether the draught of the body is known."""
        return self.floats and self.film.fluid is not None

    @scalar("1", "draught of the float over the mean film thickness (SI)", when="floats_in_si")
    def draught(self) -> float:
        fluid = self.film.fluid
        return self.body.height * (self.body.density or 0.0) / fluid.density if fluid else 0.0

    @scalar("speed", "speed of the wave (SI)", when="film.fluid")
    def wave_speed(self) -> float:
        return self.film.speed_unit

    @scalar("length", "wavelength of the wave (SI)", when="film.fluid")
    def wavelength(self) -> float:
        return self.film.fluid.wavelength if self.film.fluid else 1.0

    @attributes
    def shape(self) -> dict[str, Any]:
        return {name: getattr(self.body, name) for name in ("on", "length", "height")}

    # -- the trust report --------------------------------------------------------------------------

    @checks
    def balances(self) -> Iterator[Check]:
        if self.second_route:
            yield self.second_route.check
        motion, mass = self.motion, self.mass
        speed = motion["velocity"][0, -1]
        size = mass * max(1.0, float(np.abs(motion["velocity"]).max()))
        for name, gained, forces in (
            ("momentum", mass * speed, "impulse"),
            ("energy", mass * speed**2 / 2, "work"),
        ):
            error = float((gained - motion[forces][0, -1]) / size)
            advice = (
                f"the {name} of the body differs by {error:.2g} from the integral of the "
                "forces; lower the tolerance"
            )
            yield Check(name, error, accepted_error(self.tolerance.options), advice)

    @facts
    def route(self) -> dict[str, Any]:
        tolerance, second = self.tolerance, self.second_route
        return {
            "tolerance": {"relative": tolerance.relative, "absolute": tolerance.absolute},
            "route": self.motion.route,
            "recheck": second and second.facts,
        }

    @warnings
    def assumptions(self) -> Iterator[str]:
        yield "the body is assumed not to change the wave"
        if self.drift is None:
            yield (
                "fewer than two troughs passed, so the drift is unknown; write more time.periods"
            )
        elif self.settled is not None and self.settled > _SETTLED:
            yield (
                f"the last two turns differ by {self.settled:.2g}: the motion still depends on its "
                "start; write more time.periods"
            )
        if self.floats_in_si and self.draught > _DRAUGHT:
            yield left_out(
                self.draught,
                f"the draught is {self.draught:.3g} of the film's thickness, which is not small: a "
                "heavy float dents the surface",
            )
        yield from warnings_of_motion(self.motion, self.second_route)
        yield from self.film.fluid.warnings() if self.film.fluid else ()
        yield from reach_warnings(self.carried.wave, self.film.thinness)
