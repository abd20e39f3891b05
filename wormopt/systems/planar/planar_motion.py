"""Kind "planar-motion": simulation of a worm of masses and springs in the plane."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar, Literal

from msgspec import Meta, to_builtins

from wormopt.errors import Fault, Interrupted, SceneError, SolveError
from wormopt.quantities import GRAVITY
from wormopt.result import Check
from wormopt.study import (
    Given,
    Study,
    array,
    arrays,
    attributes,
    check,
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
from wormopt.study.given import wrong_count
from wormopt.study.numerics import (
    ContactTable,
    ExactContact,
    SmoothContact,
    TimeSpan,
    ToleranceTable,
)
from wormopt.study.types import per
from wormopt.systems.planar.obstacles import Disc, Wall
from wormopt.systems.planar.tables import EllipticGround, MassGround, Row, Vector
from wormopt.systems.shared.declared import EVENTS, STEPS

with on_use():
    import numpy as np

    from wormopt.model.model import Model
    from wormopt.simulation.options import Exact, Tolerance
    from wormopt.simulation.simulate import simulate
    from wormopt.simulation.trajectory import Trajectory
    from wormopt.systems.planar.dynamics.chain import chain_places, planar_chain
    from wormopt.systems.planar.dynamics.motion import (
        Stepped,
        Yielding,
        closed_link,
        energy_error,
        energy_stopped,
        gaps_at_start,
        let_give_way,
        longest_way,
        resting_masses,
        step_again,
        stepper_of,
        swing,
        unwrapped,
        watch_links,
    )
    from wormopt.systems.planar.shape import Harmonics
    from wormopt.systems.shared.models import measure_works
    from wormopt.systems.shared.proof import (
        CrossCheck,
        accepted_error,
        cross_check,
        motion_facts,
        warnings_of_motion,
    )
    from wormopt.systems.shared.signals import event_arrays, simulate_whole

_Angle = Annotated[float, Meta(gt=-3.14159, lt=3.14159, description="an angle within ±3.14159")]
_AnglePerJoint = Annotated[
    _Angle | tuple[_Angle, ...],
    Meta(description="an angle within ±3.14159, or a list of such angles, one per joint"),
]
_MEAN, _COSINE, _SINE = (
    "mean of each value; 0 if left out",
    "cosine coefficients",
    "sine coefficients",
)
_STIFFER = 1000.0  # default stiffness of obstacles over the largest of links
_FOLDED = 3.1  # a joint angle above this counts as folded
_CLOSED = 1e-3  # a link shorter than this share of the usual length has closed up
_STEEP = 100.0  # resistance sideways over forward from which ellipses may need very many steps
# Softening of obstacles, and the accepted change of the end: estimates the error to rigid ones.
_SOFTER, _YIELDING = 0.25, 0.02
# A mass pressed against a compliant obstacle slips as slowly as the forces change, and its
# direction turns ever faster. Below this share of the usual speed it stops. The paths change far
# less by this than by compliant obstacles. Other slow slip may still cost many steps.
_STOP_AT_OBSTACLES, _STEPS_AT_OBSTACLES = 1e-7, 300_000
# Accepted error of the second route's end over the longest path if its steps are of first order,
# and the accepted part of it at a quarter of the step (a quarter), unless that is noise: single
# stops and releases that fall into one step or the next cause as much.
_STEPPED, _ORDER, _NOISE = 0.01, 0.5, 1e-6


# -- tables ----------------------------------------------------------------------------------------


class Chain(Given):
    """A chain of *n* + 1 point masses, joined by *n* extensible links at joints that bend."""

    links: int = whole(1, 50, "number of links *n*; mass 0 is the head")
    mass: float | tuple[float, ...] = positive("mass", "point masses *m*<sub>i</sub>", per="masses")
    stiffness: float | tuple[float, ...] = number(
        "stiffness", "link stiffness *c*<sub>j</sub>", least=0, per="links"
    )
    damping: float | tuple[float, ...] = number(
        "drag", "link damping *d*<sub>j</sub>", least=0, per="links"
    )
    rest_length: float | tuple[float, ...] = positive(
        "length", "link length without force", per="links"
    )
    bending_stiffness: float | tuple[float, ...] = number(
        "joint_stiffness",
        "joint stiffness *κ*<sub>j</sub>, torque per angle",
        least=0,
        per="joints",
        default=0.0,
    )
    bending_damping: float | tuple[float, ...] = number(
        "joint_damping",
        "joint damping *δ*<sub>j</sub>, torque per angular rate",
        least=0,
        per="joints",
        default=0.0,
    )
    rest_angle: _AnglePerJoint = entry(
        "joint angle without torque; positive if the front is turned to the left",
        quantity="rad",
        per="joints",
        default=0.0,
    )
    rod_mass: float | tuple[float, ...] | None = number(
        "mass",
        "mass of uniform rods along the links; massless if left out",
        least=0,
        per="links",
        default=None,
    )
    heading: Literal["bisector", "front", "rear"] = entry(
        "heading of an inner mass: `bisector`, or along the link in `front` or `rear`",
        default="bisector",
    )
    slope: float = number(
        "rad",
        "slope of the ground, rising along *x*; ground forces do not change",
        least=0,
        most=1.5707,
        default=0.0,
    )
    gravity: float | None = positive(
        "acceleration", "*g* for `slope`; 9.80665 m/s² in SI scenes if left out", default=None
    )

    @property
    def counts(self) -> dict[str, int]:
        return {"masses": self.links + 1, "links": self.links, "joints": self.links - 1}

    def masses(self) -> np.ndarray:
        """Return the masses with half of the rods beside them."""
        found = np.array(per(self.mass, self.links + 1))
        if self.rod_mass is None:
            return found
        half = np.array(per(self.rod_mass, self.links)) / 2
        return found + np.append(half, 0.0) + np.append(0.0, half)

    def weights(self) -> np.ndarray:
        """Return the weight of each mass and its half rods along the slope."""
        gravity = GRAVITY if self.gravity is None else self.gravity
        down = gravity * np.sin(self.slope) if self.slope else 0.0
        masses = self.masses()
        return np.stack([-down * masses, 0.0 * masses], axis=1)


class Start(Given):
    """Initial shape, place and velocity."""

    lengths: float | tuple[float, ...] | None = positive(
        "length", "link lengths; the rest lengths if left out", per="links", default=None
    )
    angles: _AnglePerJoint | None = entry(
        "joint angles; the rest angles if left out", quantity="rad", per="joints", default=None
    )
    tail: Vector = entry("place of the last mass", quantity="length", default=(0.0, 0.0))
    direction: float = number("rad", "direction of the last link, measured from *x*", default=0.0)
    velocity: Vector = entry("velocity of all masses", quantity="speed", default=(0.0, 0.0))
    turning: float = number(
        "angular_frequency", "angular velocity about the centre of mass", default=0.0
    )

    def places(self, worm: Chain) -> np.ndarray:
        """Return the places of all masses."""
        lengths = per(worm.rest_length if self.lengths is None else self.lengths, worm.links)
        angles = per(worm.rest_angle if self.angles is None else self.angles, worm.links - 1)
        c, s = np.cos(self.direction), np.sin(self.direction)
        return chain_places(lengths, angles) @ np.array([[c, s], [-s, c]]) + self.tail

    def velocities(self, worm: Chain) -> np.ndarray:
        """Return the velocities of all masses: a common one, and a rotation about their centre."""
        places, masses = self.places(worm), worm.masses()
        arms = places - masses @ places / masses.sum()
        left = np.stack([-arms[:, 1], arms[:, 0]], axis=1)
        return np.array(self.velocity) + self.turning * left


class SwingingForce(Given):
    """Periodic forces: row *h* holds the coefficients of the *h*-th harmonic.

    mean + Σ cosine<sub>h</sub> cos(2π *h t*/`period`) + sine<sub>h</sub> sin(2π *h t*/`period`).
    """

    mean: Row | None = entry(_MEAN, quantity="force", default=None)
    cosine: tuple[Row, ...] = entry(_COSINE, quantity="force", default=())
    sine: tuple[Row, ...] = entry(_SINE, quantity="force", default=())

    def harmonics(self, count: int) -> Harmonics:
        """Return the harmonics of `count` values; missing rows are 0."""
        most = max(len(self.cosine), len(self.sine))
        part = np.zeros((2, most, count))
        for k, rows in enumerate((self.cosine, self.sine)):
            part[k, : len(rows)] = np.reshape(rows, (len(rows), count))
        return Harmonics(np.array(self.mean or (0.0,) * count), *part)

    def faults_in(self, key: str, count: int, things: str) -> Iterator[Fault]:
        """Yield rows of a wrong length, by keys below `key`."""
        rows = {f"{key}.mean": self.mean} if self.mean is not None else {}
        for name in ("cosine", "sine"):
            rows |= {f"{key}.{name}[{h}]": row for h, row in enumerate(getattr(self, name))}
        for place, row in rows.items():
            if len(row) != count:
                yield place, f"has {len(row)} numbers for {count} {things}; write {count}"


class SwingingTorque(SwingingForce):
    """Periodic torques: row *h* holds the coefficients of the *h*-th harmonic.

    mean + Σ cosine<sub>h</sub> cos(2π *h t*/`period`) + sine<sub>h</sub> sin(2π *h t*/`period`).
    """

    mean: Row | None = entry(_MEAN, quantity="torque", default=None)
    cosine: tuple[Row, ...] = entry(_COSINE, quantity="torque", default=())
    sine: tuple[Row, ...] = entry(_SINE, quantity="torque", default=())


class Actuation(Given):
    """Periodic forces in the links and torques in the joints."""

    period: float = positive("time", "period of forces and torques")
    force: SwingingForce | None = entry(
        "link forces, which push the masses apart; none if left out", default=None
    )
    torque: SwingingTorque | None = entry(
        "joint torques, which turn the front to the left; none if left out", default=None
    )

    def faults_in(self, links: int) -> Iterator[Fault]:
        """Yield rows of a wrong length."""
        if self.force:
            yield from self.force.faults_in("actuation.force", links, "links")
        if self.torque and links == 1:
            yield "actuation.torque", "a single link has no joint; leave it out"
        elif self.torque:
            yield from self.torque.faults_in("actuation.torque", links - 1, "joints")


# -- results computed together ---------------------------------------------------------------------


@dataclass(frozen=True)
class Signals:
    """Motion of the worm over time."""

    x: np.ndarray = signal("length", "mass time", "*x* of the mass")
    y: np.ndarray = signal("length", "mass time", "*y* of the mass")
    heading: np.ndarray = signal("angle", "mass time", "heading of the mass")
    speed: np.ndarray = signal("speed", "mass time", "speed of the mass")
    resting: np.ndarray = signal("count", "mass time", "1 where the ground holds the mass, else 0")
    ground_x: np.ndarray = signal("force", "mass time", "ground force along *x*")
    ground_y: np.ndarray = signal("force", "mass time", "ground force along *y*")
    length: np.ndarray = signal("length", "link time", "link length")
    angle: np.ndarray | None = signal("angle", "joint time", "joint angle")
    input: np.ndarray = signal("force", "link time", "actuator force in the link")
    torque: np.ndarray | None = signal("torque", "joint time", "actuator torque in the joint")
    power: np.ndarray = signal("power", "actuator time", "actuator power, links then joints")
    center_x: np.ndarray = signal("length", "time", "*x* of the centre of mass")
    center_y: np.ndarray = signal("length", "time", "*y* of the centre of mass")
    energy: np.ndarray = signal("energy", "time", "kinetic and elastic energy")
    work_actuator: np.ndarray = signal("energy", "time", "work of the actuators")
    work_ground: np.ndarray = signal("energy", "time", "work of the ground")
    work_damping: np.ndarray = signal("energy", "time", "work of the dashpots")
    work_pull: np.ndarray = signal("energy", "time", "work of the weight along the slope")
    work_wall: np.ndarray | None = signal("energy", "time", "work of the obstacles")
    wall_force: np.ndarray | None = signal(
        "force", "mass time", "sum of the obstacle forces on the mass"
    )


@dataclass(frozen=True)
class Numbers:
    """Displacement and works of the motion."""

    x_way: float = value("length", "displacement of the centre of mass along *x*")
    y_way: float = value("length", "displacement of the centre of mass along *y*")
    distance: float = value("length", "distance between start and end of the centre of mass")
    turn: float = value("angle", "rotation of the first link to the left")
    angle_max: float = value("angle", "largest joint angle; at π the joint has folded")
    length_min: float = value("length", "length of the shortest link")
    actuator_work: float = value("energy", "work of the actuators")
    ground_work: float = value("energy", "work of the ground")
    damping_work: float = value("energy", "work of the dashpots")
    pull_work: float = value("energy", "work of the weight along the slope")
    energy_error: float = value(
        "share", "works less the energy gained, relative to the largest of them"
    )
    rest_share: float = value(
        "share", "share of samples at which a mass rests, mean over the masses"
    )


@dataclass(frozen=True)
class Recheck:
    """Results of the second route."""

    check: CrossCheck
    stepped: Stepped | None = None  # if it is time stepping
    wall_error: float | None = None  # if there are obstacles


class PlanarMotion(Study, kind="planar-motion"):
    """Simulate a planar chain of masses and springs with bending joints.

    Actuators are in links and joints. The ground resists forward, backward and sideways motion of
    each mass differently. With exact contact every stop and start is located. A second route
    repeats the motion with Moreau-Jean time stepping, which uses no events, at two step lengths.
    For skids, spikes, pins, `unit` and smooth contact, the second route is another integrator.
    Theory: [theory-planar.md](../theory-planar.md). The status is `failed` if the second route ends
    elsewhere, energy is not balanced, a joint folds, or the end depends on the stiffness of the
    obstacles. The run stops if a link closes up, because it then has no direction.
    """

    pictures: ClassVar = {
        "plane": "the body at equal times, with the path of its centre of mass; resting masses "
        "are filled",
        "forces": ("forces of ground and actuators over time, and works", "motion_forces"),
        "animation": "the moving body, as a GIF",
    }
    headline: ClassVar = ("distance", "turn", "actuator_work", "n_events")

    worm: Chain = entry("the worm")
    ground: MassGround | tuple[MassGround, ...] = entry(
        "ground under every mass, or a list of tables, one per mass, head first"
    )
    start: Start = entry("initial state", default=Start)
    actuation: Actuation | None = entry("actuators; none if left out", default=None)
    obstacles: tuple[Disc | Wall, ...] = entry(
        "walls and discs that no mass can enter; links can pass over them", default=()
    )
    obstacle_stiffness: float | None = positive(
        "stiffness",
        "stiffness of obstacles; 1000 times the largest `worm.stiffness` if left out",
        default=None,
    )
    contact: ContactTable = entry("how contact is treated; exact if left out", default=ExactContact)
    time: TimeSpan = entry("duration and samples")
    tolerance: ToleranceTable = entry("tolerances of simulations", default=ToleranceTable)

    @property
    def counts(self) -> dict[str, int]:
        return self.worm.counts

    @property
    def wall_stiffness(self) -> float | None:
        """Stiffness of obstacles, or None if no default exists."""
        largest = max(per(self.worm.stiffness, self.worm.links))
        return self.obstacle_stiffness or _STIFFER * largest or None

    def faults_of_keys(self) -> Iterator[Fault]:
        worm = self.worm
        if worm.slope and worm.gravity is None and self.units != "SI":
            yield "worm.gravity", 'missing; worm.slope needs it if units are not "SI"'
        yield from wrong_count("ground", self.ground, worm.links + 1, "masses", "table")
        if self.obstacles and self.wall_stiffness is None:
            yield "obstacle_stiffness", "missing; without link stiffness there is no default"
        for k, each in enumerate(self.obstacles):
            if each.friction and isinstance(self.contact, ExactContact):
                yield (
                    f"obstacles[{k}].friction",
                    'friction on obstacles is smooth; write contact = {treatment = "smooth"}, or 0',
                )
        if self.obstacle_stiffness is not None and not self.obstacles:
            yield (
                "obstacle_stiffness",
                "there are no obstacles; write [[obstacles]], or leave this key out",
            )
        if self.actuation:
            yield from self.actuation.faults_in(worm.links)

    # -- the model ---------------------------------------------------------------------------------

    def model(self, *, stiffer: float = 1.0) -> Model:
        """Return the worm with its actuators; obstacles may be `stiffer` by a factor."""
        worm, start, drive = self.worm, self.start, self.actuation
        ground = self.ground
        grounds = ground if isinstance(ground, tuple) else (ground,) * (worm.links + 1)
        lengths = worm.rest_length if start.lengths is None else start.lengths
        model = planar_chain(
            worm.links,
            mass=np.array(per(worm.mass, worm.links + 1)),
            stiffness=worm.stiffness,
            damping=worm.damping,
            rest_length=worm.rest_length,
            bending_stiffness=worm.bending_stiffness,
            bending_damping=worm.bending_damping,
            rest_angle=worm.rest_angle,
            rod_mass=worm.rod_mass,
            law=[each.friction() for each in grounds],
            pull=worm.weights(),
            heading=worm.heading,
            obstacles=self.obstacles,
            position=start.places(worm),
            velocity=start.velocities(worm),
            length_nominal=float(np.mean(per(lengths, worm.links))),
            time_nominal=drive.period if drive else self.time.end,
        )
        if self.obstacles:
            self._refuse_overlap(model)
            stiffness = stiffer * (self.wall_stiffness or 0.0)
            v_reg = self.contact.v_reg if isinstance(self.contact, SmoothContact) else np.inf
            largest = max(per(worm.mass, worm.links + 1))
            model = let_give_way(model, Yielding(stiffness, largest, v_reg))
        if drive is None:
            return model
        given = {"input": (drive.force, worm.links), "torque": (drive.torque, worm.links - 1)}
        courses = {n: one.harmonics(count) for n, (one, count) in given.items() if one}
        return swing(model, drive.period, courses)

    def _refuse_overlap(self, model: Model) -> None:
        for k, row in enumerate(gaps_at_start(model)):
            i = int(np.argmin(row))
            if not row[i] > 0:
                fault = f"mass {i} starts within it, {-row[i]:.3g} deep; move it, or start.tail"
                raise SceneError(self.name, [(f"obstacles[{k}]", fault)])

    def models(self) -> dict[str, Model]:
        return {"": self.model()}

    # -- computing ---------------------------------------------------------------------------------

    @stage
    def build(self) -> Model:
        return self.model()

    @property
    def accuracy(self) -> Tolerance:
        """Tolerance of the scene, with a least speed among obstacles."""
        tolerance = self.tolerance.options
        if not self.obstacles:
            return tolerance
        steps = min(tolerance.max_steps, _STEPS_AT_OBSTACLES)
        return replace(tolerance, max_steps=steps, stop=_STOP_AT_OBSTACLES)

    @property
    def steep(self) -> str:
        """Advice if a resistance sideways is so large that the ellipse makes the motion stiff."""
        grounds = self.ground if isinstance(self.ground, tuple) else (self.ground,)
        ellipses = [each.numbers for each in grounds if isinstance(each, EllipticGround)]
        if all(aside < _STEEP * ahead for ahead, _, aside in ellipses):
            return ""
        return 'ground.sideways is many times ground.forward; write law = "skid" or "box", or less'

    @stage
    def motion(self) -> Trajectory:
        worm, drive, plain = self.worm, self.actuation, self.build
        period = drive.period if drive else self.time.end
        speed = np.mean(per(worm.rest_length, worm.links)) / period
        usual_work = float(np.mean(per(worm.mass, worm.links + 1)) * speed**2)
        watched = watch_links(measure_works(plain, usual_work), _CLOSED * plain.x[0].nominal)
        try:
            with np.errstate(all="ignore"):  # values that are not finite are checked later
                motion = simulate_whole(
                    watched,
                    self.time.end,
                    self.time.samples,
                    self.contact.options,
                    self.accuracy,
                    self.report,
                )
        except SolveError as error:
            advice = error.suggestion
            if self.obstacles and error.code == "too_many_steps":
                advice = "masses stop too slowly at obstacles; write a smaller obstacle_stiffness"
            elif self.steep and error.code in ("too_many_steps", "step_too_small"):
                advice = self.steep
            raise SolveError(error.reason, advice, _sampled(error.partial), error.code) from None
        except Interrupted as stop:
            raise Interrupted(_sampled(stop.partial)) from None
        if link := closed_link(motion):
            raise SolveError(
                f"{link} closes up at t = {motion.end_time:.6g} and has no direction there",
                "write less actuation.force, or a larger worm.stiffness, worm.damping or "
                "worm.bending_stiffness",
                _sampled(motion),
                "link_closed",
            )
        return motion

    @stage
    def recheck(self) -> Recheck | None:
        """Repeat the motion by Moreau-Jean steps, or where they do not apply by an integrator."""
        wanted, model, motion = self.tolerance.recheck, self.build, self.motion
        if not wanted:
            return None
        exact = isinstance(motion.system.treatment, Exact) and not self.obstacles
        with np.errstate(all="ignore"):
            stepper = stepper_of(model) if exact else None
            if stepper is None:
                found = cross_check(
                    model, motion, self.accuracy, recheck=wanted, report=self.report
                )
                softness = self._softness() if found and self.obstacles else None
                return found and Recheck(found, wall_error=softness)
            name, shared = "Moreau-Jean time stepping", "the model"
            try:
                stepped = step_again(stepper, motion, report=self.report)
            except SolveError as error:
                return Recheck(CrossCheck(name, None, _STEPPED, shared, error.reason))
        return Recheck(CrossCheck(name, stepped.fine, _STEPPED, shared), stepped)

    def _softness(self) -> float:
        """Return the change of the end among softer obstacles, over the longest path of a mass."""
        softer, end = self.model(stiffer=_SOFTER), self.motion.end_time
        again = simulate(
            softer,
            end,
            contact=self.motion.system.treatment,
            times=[end],
            tolerance=self.accuracy,
            report=self.report,
        )
        off = np.abs(again["position"][:, -1] - self.motion["position"][:, -1]).max()
        return float(off / longest_way(self.motion))

    # -- results -----------------------------------------------------------------------------------

    @array("time", "time", "time", name="time")
    def times(self) -> np.ndarray:
        return self.motion.time

    @parts(Signals)
    def signals(self) -> Signals:
        return signals_of(self.motion)

    @arrays(EVENTS)
    def events(self) -> Mapping[str, np.ndarray]:
        return event_arrays([self.motion], several=False)

    @parts(Numbers)
    def numbers(self) -> Numbers:
        return numbers_of(self.motion, self.signals)

    @scalar("energy", "work of the obstacles", when="obstacles")
    def wall_work(self) -> float:
        return float(self.motion["wall_work"][0, -1])

    @scalar("force", "largest sampled force of an obstacle on a mass", when="obstacles")
    def wall_force_max(self) -> float:
        return float(self.motion["wall_force"].max())

    @scalar("length", "largest sampled depth of a mass in an obstacle", when="obstacles")
    def wall_depth(self) -> float:
        return max(-float(self.motion["wall_gap"].min()), 0.0)

    @scalar(
        "share",
        "change of the end places if obstacles are a quarter as stiff, relative to the longest "
        "displacement of a mass; estimates the error by the compliance of obstacles",
    )
    def wall_error(self) -> float | None:
        return self.recheck and self.recheck.wall_error

    @scalar(*STEPS["n_events"])
    def n_events(self) -> int:
        return len(self.motion.events)

    @scalar(*STEPS["n_steps"])
    def n_steps(self) -> int:
        return self.motion.n_steps

    @scalar(
        "share",
        "largest difference of an end place to Moreau-Jean time stepping, relative to the "
        "longest displacement of a mass; else of any state, relative to its size",
    )
    def recheck_error(self) -> float | None:
        return self.recheck and self.recheck.check.error

    @property
    def stepped(self) -> Stepped | None:
        """Results of time stepping, if that is the second route."""
        return self.recheck and self.recheck.stepped

    @scalar("share", "`recheck_error` for steps four times as long")
    def moreau_coarse(self) -> float | None:
        return self.stepped and self.stepped.coarse

    @scalar("time", "the longer of the two steps of this first-order method")
    def moreau_step(self) -> float | None:
        return self.stepped and self.stepped.step

    @attributes
    def drawn(self) -> Mapping[str, Any]:
        found = {"contacts": [contact.name for contact in self.build.contacts]}
        shapes = {"obstacles": [to_builtins(each) for each in self.obstacles]}
        return found | (shapes if self.obstacles else {})

    # -- the trust report --------------------------------------------------------------------------

    @checks
    def second_route(self) -> Iterator[Check]:
        if self.recheck:
            yield self.recheck.check.check
        if stepped := self.stepped:
            yield Check(
                "second route, order",
                stepped.fine / max(stepped.coarse, stepped.rounding / _ORDER, _NOISE),
                _ORDER,
                "the second route does not converge at its order; a motion this sensitive is not "
                "reliable",
            )
        if self.wall_error is not None:
            yield Check(
                "obstacles",
                self.wall_error,
                _YIELDING,
                "the motion depends on the compliance of obstacles; write a larger "
                "obstacle_stiffness or a shorter time.end",
            )

    @property
    def accepted(self) -> float:
        """Accepted error of the energy."""
        return accepted_error(self.accuracy)

    @check("accepted", "energy is not balanced; the error is {value:.2g}, relative to the works")
    def energy_balance(self) -> float:
        return self.numbers.energy_error

    @check(
        _FOLDED,
        "a joint folds, where its angle and the opposite angle coincide; write a larger "
        "worm.bending_stiffness or smaller actuation.torque",
    )
    def joints(self) -> float:
        return self.numbers.angle_max

    @facts
    def routes(self) -> Mapping[str, Any]:
        return motion_facts([self.motion], [self.recheck and self.recheck.check], self.accuracy)

    @warnings
    def of_motion(self) -> Iterator[str]:
        yield from self.motion.warnings
        yield from warnings_of_motion(self.motion, self.recheck and self.recheck.check)


def _sampled(motion: Trajectory | None) -> Trajectory | None:
    """Return a motion up to its end, or None if it has no sample."""
    return motion if motion and len(motion.time) else None


def signals_of(motion: Trajectory) -> Signals:
    """Return the motion of the worm over time."""
    ground, center = motion["ground_force"], motion["center_of_mass"]
    links, joints = len(motion["length"]), len(motion["angle"])
    walls, masses = "wall_work" in motion.names, len(ground) // 2
    works = {name: motion[f"{name}_work"][0] for name in ("input", "torque", "ground", "damping")}
    # the first instant has no duration, and forces without bound no power in it
    works["ground"] = works["ground"] - works["ground"][0] - energy_stopped(motion, "energy")
    return Signals(
        x=motion["position"][::2],
        y=motion["position"][1::2],
        heading=unwrapped(motion, "heading"),
        speed=motion["speed"],
        resting=resting_masses(motion).astype(float),
        ground_x=ground[::2],
        ground_y=ground[1::2],
        length=motion["length"],
        angle=motion["angle"] if joints else None,
        input=motion["input"],
        torque=motion["torque"] if joints else None,
        power=motion["power"].reshape(links + joints, -1),
        center_x=center[0],
        center_y=center[1],
        energy=motion["energy"][0],
        work_actuator=works["input"] + works["torque"],
        work_ground=works["ground"],
        work_damping=works["damping"],
        work_pull=motion["pull_work"][0],
        work_wall=motion["wall_work"][0] if walls else None,
        # rows are obstacles x masses
        wall_force=motion["wall_force"].reshape(-1, masses, len(motion.time)).sum(axis=0)
        if walls
        else None,
    )


def numbers_of(motion: Trajectory, over_time: Signals) -> Numbers:
    """Return displacement and works of the motion."""
    center, looks = motion["center_of_mass"], over_time.heading[0]
    way = center[:, -1] - center[:, 0]
    return Numbers(
        x_way=float(way[0]),
        y_way=float(way[1]),
        distance=float(np.hypot(*way)),
        turn=float(looks[-1] - looks[0]),
        angle_max=motion.largest("angle") if over_time.angle is not None else 0.0,
        length_min=1 / motion.largest(1 / motion.system.model["length"]),
        actuator_work=float(over_time.work_actuator[-1]),
        ground_work=float(over_time.work_ground[-1]),
        damping_work=float(over_time.work_damping[-1]),
        pull_work=float(over_time.work_pull[-1]),
        energy_error=energy_error(motion, "energy"),
        rest_share=float(over_time.resting.mean()),
    )
