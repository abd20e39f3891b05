"""Scenes of kind "planar-motion": simulation of a worm of masses and springs in the plane."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta, field

from wormopt.errors import Fault
from wormopt.quantities import GRAVITY
from wormopt.study.given import Given, entry, number, positive, whole, wrong_count
from wormopt.study.numerics import (
    Contacts,
    ExactContact,
    Horizon,
    Tolerances,
    ToleranceTable,
)
from wormopt.study.types import (
    Finite,
    NonNegativePerJoint,
    NonNegativePerLink,
    PerLink,
    PerMass,
    SceneTable,
)
from wormopt.systems.planar.scenes.ground import MassGround
from wormopt.systems.planar.scenes.standing import Standing
from wormopt.systems.shared.declared import EVENTS, STEPS, TIME, over

_Vector = Annotated[
    tuple[Finite, ...],
    Meta(min_length=2, max_length=2, description="two finite numbers, [x, y]"),
]
_Row = tuple[Finite, ...]
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
_JOINTS = ("bending_stiffness", "bending_damping", "rest_angle")


class PlanarChainTable(Given):
    """A chain of *n* + 1 point masses, joined by *n* extensible links at joints that bend."""

    links: int = whole(1, 50, "number of links *n*; mass 0 is the head")
    mass: PerMass = entry("point masses *m*<sub>i</sub>", quantity="mass")
    stiffness: NonNegativePerLink = entry("link stiffness *c*<sub>j</sub>", quantity="stiffness")
    damping: NonNegativePerLink = entry("link damping *d*<sub>j</sub>", quantity="drag")
    rest_length: PerLink = entry("link length without force", quantity="length")
    bending_stiffness: NonNegativePerJoint = entry(
        "joint stiffness *κ*<sub>j</sub>, torque per angle", quantity="joint_stiffness", default=0.0
    )
    bending_damping: NonNegativePerJoint = entry(
        "joint damping *δ*<sub>j</sub>, torque per angular rate",
        quantity="joint_damping",
        default=0.0,
    )
    rest_angle: _AnglePerJoint = entry(
        "joint angle without torque; positive if the front is turned to the left",
        quantity="rad",
        default=0.0,
    )
    rod_mass: NonNegativePerLink | None = entry(
        "mass of uniform rods along the links; massless if left out", quantity="mass", default=None
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
    def standard(self) -> float:
        """Return the acceleration of gravity."""
        return GRAVITY if self.gravity is None else self.gravity

    def faults(self, units: str) -> Iterator[Fault]:
        """Yield lists of a wrong length, and a slope without gravity."""
        yield from wrong_count("worm.mass", self.mass, self.links + 1, "masses")
        for name in ("stiffness", "damping", "rest_length", "rod_mass"):
            yield from wrong_count(f"worm.{name}", getattr(self, name), self.links, "links")
        for name in _JOINTS:
            yield from wrong_count(f"worm.{name}", getattr(self, name), self.links - 1, "joints")
        if self.slope and self.gravity is None and units != "SI":
            yield "worm.gravity", 'missing; worm.slope needs it if units are not "SI"'


class PlanarStart(Given):
    """Initial shape, place and velocity."""

    lengths: PerLink | None = entry(
        "link lengths; the rest lengths if left out", quantity="length", default=None
    )
    angles: _AnglePerJoint | None = entry(
        "joint angles; the rest angles if left out", quantity="rad", default=None
    )
    tail: _Vector = entry("place of the last mass", quantity="length", default=(0.0, 0.0))
    direction: float = number("rad", "direction of the last link, measured from *x*", default=0.0)
    velocity: _Vector = entry("velocity of all masses", quantity="speed", default=(0.0, 0.0))
    turning: float = number(
        "angular_frequency", "angular velocity about the centre of mass", default=0.0
    )

    def faults(self, links: int) -> Iterator[Fault]:
        """Yield lists of a wrong length."""
        yield from wrong_count("start.lengths", self.lengths, links, "links")
        yield from wrong_count("start.angles", self.angles, links - 1, "joints")


class Swinging(Given):
    """Harmonic values of links or joints; subclasses name the quantity."""

    mean: tuple[float, ...] | None = None
    cosine: tuple[tuple[float, ...], ...] = ()
    sine: tuple[tuple[float, ...], ...] = ()

    def faults(self, key: str, count: int, things: str) -> Iterator[Fault]:
        """Yield rows of a wrong length."""
        rows = {f"{key}.mean": self.mean} if self.mean is not None else {}
        for name in ("cosine", "sine"):
            rows |= {f"{key}.{name}[{h}]": row for h, row in enumerate(getattr(self, name))}
        for place, row in rows.items():
            if len(row) != count:
                yield place, f"has {len(row)} numbers for {count} {things}; write {count}"


class SwingingForce(Swinging):
    """Periodic forces: row *h* holds the coefficients of the *h*-th harmonic.

    mean + Σ cosine<sub>h</sub> cos(2π *h t*/`period`) + sine<sub>h</sub> sin(2π *h t*/`period`).
    """

    mean: _Row | None = entry(_MEAN, quantity="force", default=None)
    cosine: tuple[_Row, ...] = entry(_COSINE, quantity="force", default=())
    sine: tuple[_Row, ...] = entry(_SINE, quantity="force", default=())


class SwingingTorque(Swinging):
    """Periodic torques: row *h* holds the coefficients of the *h*-th harmonic.

    mean + Σ cosine<sub>h</sub> cos(2π *h t*/`period`) + sine<sub>h</sub> sin(2π *h t*/`period`).
    """

    mean: _Row | None = entry(_MEAN, quantity="torque", default=None)
    cosine: tuple[_Row, ...] = entry(_COSINE, quantity="torque", default=())
    sine: tuple[_Row, ...] = entry(_SINE, quantity="torque", default=())


class PlanarActuation(Given):
    """Periodic forces in the links and torques in the joints."""

    period: float = positive("time", "period of forces and torques")
    force: SwingingForce | None = entry(
        "link forces, which push the masses apart; none if left out", default=None
    )
    torque: SwingingTorque | None = entry(
        "joint torques, which turn the front to the left; none if left out", default=None
    )

    def faults(self, links: int) -> Iterator[Fault]:
        """Yield rows of a wrong length."""
        if self.force:
            yield from self.force.faults("actuation.force", links, "links")
        if self.torque and links == 1:
            yield "actuation.torque", "a single link has no joint; leave it out"
        elif self.torque:
            yield from self.torque.faults("actuation.torque", links - 1, "joints")


class PlanarMotionScene(SceneTable):
    """Simulation of a planar worm of masses and springs with actuators in links and joints.

    The ground resists forward, backward and sideways motion of each mass differently. With exact
    contact every stop and start is located. A second route repeats the motion with Moreau-Jean
    time stepping, which uses no events, at two step lengths. For skids, spikes, pins, `unit` and
    smooth contact, the second route is another integrator. Theory:
    [theory-planar.md](../theory-planar.md). The status is `failed` if the second route ends
    elsewhere, energy is not balanced, a joint folds, or the end depends on the stiffness of the
    obstacles. The run stops if a link closes up, because it then has no direction.
    """

    headline: ClassVar = ("distance", "turn", "actuator_work", "n_events")
    scalars: ClassVar = {
        "x_way": ("length", "displacement of the centre of mass along *x*"),
        "y_way": ("length", "displacement of the centre of mass along *y*"),
        "distance": ("length", "distance between start and end of the centre of mass"),
        "turn": ("angle", "rotation of the first link to the left"),
        "angle_max": ("angle", "largest joint angle; at π the joint has folded"),
        "length_min": ("length", "length of the shortest link"),
        "actuator_work": ("energy", "work of the actuators"),
        "ground_work": ("energy", "work of the ground"),
        "damping_work": ("energy", "work of the dashpots"),
        "pull_work": ("energy", "work of the weight along the slope"),
        "wall_work": ("energy", "work of the obstacles"),
        "wall_force_max": ("force", "largest sampled force of an obstacle on a mass"),
        "wall_depth": ("length", "largest sampled depth of a mass in an obstacle"),
        "wall_error": (
            "share",
            "change of the end places if obstacles are a quarter as stiff, relative to the longest "
            "displacement of a mass; estimates the error by the compliance of obstacles",
        ),
        "energy_error": ("share", "works less the energy gained, relative to the largest of them"),
        "rest_share": ("share", "share of samples at which a mass rests, mean over the masses"),
        **STEPS,
        "recheck_error": (
            "share",
            "largest difference of an end place to Moreau-Jean time stepping, relative to the "
            "longest displacement of a mass; else of any state, relative to its size",
        ),
        "moreau_coarse": ("share", "the same difference for steps four times as long"),
        "moreau_step": ("time", "the longer of the two steps of this first-order method"),
    }
    variables: ClassVar = (
        TIME
        | over(
            {
                "x": ("length", ("mass",), "*x* of the mass"),
                "y": ("length", ("mass",), "*y* of the mass"),
                "heading": ("angle", ("mass",), "heading of the mass"),
                "speed": ("speed", ("mass",), "speed of the mass"),
                "resting": ("count", ("mass",), "1 where the ground holds the mass, else 0"),
                "ground_x": ("force", ("mass",), "ground force along *x*"),
                "ground_y": ("force", ("mass",), "ground force along *y*"),
                "length": ("length", ("link",), "link length"),
                "angle": ("angle", ("joint",), "joint angle"),
                "input": ("force", ("link",), "actuator force in the link"),
                "torque": ("torque", ("joint",), "actuator torque in the joint"),
                "power": ("power", ("actuator",), "actuator power, links then joints"),
                "center_x": ("length", (), "*x* of the centre of mass"),
                "center_y": ("length", (), "*y* of the centre of mass"),
                "energy": ("energy", (), "kinetic and elastic energy"),
                "work_actuator": ("energy", (), "work of the actuators"),
                "work_ground": ("energy", (), "work of the ground"),
                "work_damping": ("energy", (), "work of the dashpots"),
                "work_pull": ("energy", (), "work of the weight along the slope"),
                "work_wall": ("energy", (), "work of the obstacles"),
                "wall_force": ("force", ("mass",), "sum of the obstacle forces on the mass"),
            }
        )
        | EVENTS
    )

    kind: Literal["planar-motion"]
    want: tuple[Literal["plane", "forces", "animation"], ...] = entry(
        "`plane`: the body over time in the plane; `forces`: forces and works over time; "
        "`animation`: the moving body, as a GIF",
        default=(),
    )
    worm: PlanarChainTable = entry("the worm")
    ground: MassGround | tuple[MassGround, ...] = entry(
        "ground under every mass, or a list of tables, one per mass, head first"
    )
    start: PlanarStart = entry("initial state", default=PlanarStart())
    actuation: PlanarActuation | None = entry("actuators; none if left out", default=None)
    obstacles: tuple[Standing, ...] = entry(
        "walls and discs that no mass can enter; links can pass over them", default=()
    )
    obstacle_stiffness: float | None = positive(
        "stiffness",
        "stiffness of obstacles; 1000 times the largest `worm.stiffness` if left out",
        default=None,
    )
    contact: Contacts = field(default_factory=ExactContact)
    time: Horizon
    tolerance: Tolerances = field(default_factory=ToleranceTable)

    @property
    def grounds(self) -> tuple[MassGround, ...]:
        """Return the ground under each mass."""
        if isinstance(self.ground, tuple):
            return self.ground
        return (self.ground,) * (self.worm.links + 1)

    @property
    def wall_stiffness(self) -> float | None:
        """Return the stiffness of obstacles, or None if no default exists."""
        if self.obstacle_stiffness is not None:
            return self.obstacle_stiffness
        given = self.worm.stiffness
        largest = max(given) if isinstance(given, tuple) else given
        return _STIFFER * largest if largest else None

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield faults that no single key shows."""
        yield from super().faults(folder)
        links = self.worm.links
        yield from self.worm.faults(self.units)
        yield from self.start.faults(links)
        yield from wrong_count("ground", self.ground, links + 1, "masses", "table")
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
            yield from self.actuation.faults(links)
