"""Scenes of kind "planar-motion": a worm of masses and springs in the plane, simulated."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta, field

from wormopt.errors import Fault
from wormopt.quantities import GRAVITY
from wormopt.scene.numerics import (
    Contacts,
    ExactContact,
    Horizon,
    Tolerances,
    ToleranceTable,
)
from wormopt.scene.types import (
    Finite,
    NonNegativePerJoint,
    NonNegativePerLink,
    PerLink,
    PerMass,
    Positive,
    SceneTable,
    Table,
    says,
    wrong_count,
)
from wormopt.systems.planar.scenes.ground import MassGround
from wormopt.systems.planar.scenes.standing import Standing
from wormopt.systems.shared.declared import EVENTS, STEPS, TIME, over

_Links = Annotated[int, Meta(ge=1, le=50, description="a whole number from 1 to 50")]
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
_Slope = Annotated[float, Meta(ge=0, le=1.5707, description="an angle from 0 to 1.5707")]
_MEAN, _COSINE, _SINE = (
    "mean of each; 0 if left out",
    "coefficients of the cosines",
    "coefficients of the sines",
)
_STIFFER = 1000.0  # obstacles than links
_JOINTS = ("bending_stiffness", "bending_damping", "rest_angle")


class PlanarChainTable(Table, frozen=True, kw_only=True):
    """A chain of *n* + 1 point masses joined by *n* links that change length; its joints bend."""

    links: Annotated[_Links, says("count", "*n*; mass 0 is the head")]
    mass: Annotated[PerMass, says("mass", "point masses *m*<sub>i</sub>")]
    stiffness: Annotated[NonNegativePerLink, says("stiffness", "*c*<sub>j</sub> of the links")]
    damping: Annotated[NonNegativePerLink, says("drag", "*d*<sub>j</sub> of the links")]
    rest_length: Annotated[PerLink, says("length", "of the links, without force")]
    bending_stiffness: Annotated[
        NonNegativePerJoint,
        says("joint_stiffness", "*κ*<sub>j</sub> of the joints, torque per angle"),
    ] = 0.0
    bending_damping: Annotated[
        NonNegativePerJoint,
        says("joint_damping", "*δ*<sub>j</sub> of the joints, torque per turning"),
    ] = 0.0
    rest_angle: Annotated[
        _AnglePerJoint,
        says("rad", "of the joints, without torque; positive: the front is turned to the left"),
    ] = 0.0
    rod_mass: Annotated[
        NonNegativePerLink | None,
        says("mass", "of uniform rods along the links; none if left out"),
    ] = None
    heading: Annotated[
        Literal["bisector", "front", "rear"],
        says("", "along what an inner mass looks: `bisector`, or the link in `front` or `rear`"),
    ] = "bisector"
    slope: Annotated[
        _Slope, says("rad", "of the ground, which rises along *x*; forces of the ground stay")
    ] = 0.0
    gravity: Annotated[
        Positive | None,
        says("acceleration", "*g* of `slope`; left out, 9.80665 m/s² in SI scenes"),
    ] = None

    @property
    def standard(self) -> float:
        """Acceleration of the fall."""
        return GRAVITY if self.gravity is None else self.gravity

    def faults(self, units: str) -> Iterator[Fault]:
        """Yield lists of wrong lengths, and a slope without gravity."""
        yield from wrong_count("worm.mass", self.mass, self.links + 1, "masses")
        for name in ("stiffness", "damping", "rest_length", "rod_mass"):
            yield from wrong_count(f"worm.{name}", getattr(self, name), self.links, "links")
        for name in _JOINTS:
            yield from wrong_count(f"worm.{name}", getattr(self, name), self.links - 1, "joints")
        if self.slope and self.gravity is None and units != "SI":
            yield "worm.gravity", 'missing; worm.slope needs it where units are not "SI"'


class PlanarStart(Table, frozen=True, kw_only=True):
    """Shape, place and motion at time 0."""

    lengths: Annotated[
        PerLink | None, says("length", "of the links; their rest lengths if left out")
    ] = None
    angles: Annotated[
        _AnglePerJoint | None,
        says("rad", "of the joints; their rest angles if left out"),
    ] = None
    tail: Annotated[_Vector, says("length", "place of the last mass")] = (0.0, 0.0)
    direction: Annotated[Finite, says("rad", "of the last link, from *x* to the left")] = 0.0
    velocity: Annotated[_Vector, says("speed", "of all masses")] = (0.0, 0.0)
    turning: Annotated[
        Finite, says("angular_frequency", "of the whole body about its centre of mass")
    ] = 0.0

    def faults(self, links: int) -> Iterator[Fault]:
        """Yield lists of wrong lengths."""
        yield from wrong_count("start.lengths", self.lengths, links, "links")
        yield from wrong_count("start.angles", self.angles, links - 1, "joints")


class Swinging(Table, frozen=True, kw_only=True):
    """Values that swing, of links or joints; the tables below say of which quantity."""

    mean: tuple[float, ...] | None = None
    cosine: tuple[tuple[float, ...], ...] = ()
    sine: tuple[tuple[float, ...], ...] = ()

    def faults(self, key: str, count: int, things: str) -> Iterator[Fault]:
        """Yield rows of wrong lengths."""
        rows = {f"{key}.mean": self.mean} if self.mean is not None else {}
        for name in ("cosine", "sine"):
            rows |= {f"{key}.{name}[{h}]": row for h, row in enumerate(getattr(self, name))}
        for place, row in rows.items():
            if len(row) != count:
                yield place, f"{len(row)} for {count} {things}; write a list of {count}"


class SwingingForce(Swinging, frozen=True, kw_only=True):
    """Forces that swing: row *h* holds the coefficients of the *h*-th harmonic.

    mean + Σ cosine<sub>h</sub> cos(2π *h t*/`period`) + sine<sub>h</sub> sin(2π *h t*/`period`).
    """

    mean: Annotated[_Row | None, says("force", _MEAN)] = None
    cosine: Annotated[tuple[_Row, ...], says("force", _COSINE)] = ()
    sine: Annotated[tuple[_Row, ...], says("force", _SINE)] = ()


class SwingingTorque(Swinging, frozen=True, kw_only=True):
    """Torques that swing: row *h* holds the coefficients of the *h*-th harmonic.

    mean + Σ cosine<sub>h</sub> cos(2π *h t*/`period`) + sine<sub>h</sub> sin(2π *h t*/`period`).
    """

    mean: Annotated[_Row | None, says("torque", _MEAN)] = None
    cosine: Annotated[tuple[_Row, ...], says("torque", _COSINE)] = ()
    sine: Annotated[tuple[_Row, ...], says("torque", _SINE)] = ()


class PlanarActuation(Table, frozen=True, kw_only=True):
    """Forces in the links and torques in the joints that swing."""

    period: Annotated[Positive, says("time", "of both")]
    force: Annotated[
        SwingingForce | None, says("", "push the masses of a link apart; none if left out")
    ] = None
    torque: Annotated[
        SwingingTorque | None,
        says("", "turn the front of a joint to the left; none if left out"),
    ] = None

    def faults(self, links: int) -> Iterator[Fault]:
        """Yield rows of wrong lengths."""
        if self.force:
            yield from self.force.faults("actuation.force", links, "links")
        if self.torque and links == 1:
            yield "actuation.torque", "one link has no joint; leave it out"
        elif self.torque:
            yield from self.torque.faults("actuation.torque", links - 1, "joints")


class PlanarMotionScene(SceneTable, frozen=True, kw_only=True):
    """A worm of masses on springs in the plane, with actuators in links and joints, simulated.

    The ground resists forward, backward and sideways motion of each mass differently; where
    contact is exact, every stop and start is located. The motion is followed again by steps of
    Moreau and Jean, which know no events, at two lengths of step; where these do not treat the
    ground (skids, spikes, pins, `unit`) or contact is smooth, by another integrator. Theory:
    [theory-planar.md](../theory-planar.md). Status `failed`: a second route ends elsewhere,
    energies do not balance, a joint folds, or obstacles are so soft that the end hangs on it.
    The run is given up where a link closes up: it has no direction then.
    """

    headline: ClassVar = ("distance", "turn", "actuator_work", "n_events")
    scalars: ClassVar = {
        "x_way": ("length", "way of the centre of mass along *x*"),
        "y_way": ("length", "way of the centre of mass along *y*"),
        "distance": ("length", "between start and end of the centre of mass"),
        "turn": ("angle", "by which the first link has turned to the left"),
        "angle_max": ("angle", "largest of the joints; at π one has folded"),
        "length_min": ("length", "of the shortest link"),
        "actuator_work": ("energy", "done by the actuators"),
        "ground_work": ("energy", "likewise by the ground"),
        "damping_work": ("energy", "likewise by the dashpots"),
        "pull_work": ("energy", "likewise by the weight along the slope"),
        "wall_work": ("energy", "likewise by the obstacles"),
        "wall_force_max": ("force", "largest of an obstacle on a mass, of the samples"),
        "wall_depth": ("length", "deepest that a mass enters an obstacle, of the samples"),
        "wall_error": (
            "share",
            "largest difference of a place at the end, over the longest way of a mass, where "
            "obstacles are a quarter as stiff; about the error by their giving way",
        ),
        "energy_error": ("share", "works less the energy gained, over the largest of them"),
        "rest_share": ("share", "of the samples at which a mass rests, mean over the masses"),
        **STEPS,
        "recheck_error": (
            "share",
            "second route: where it goes by steps of Moreau and Jean, largest difference of a "
            "place at the end over the longest way of a mass; else of any state, over its size",
        ),
        "moreau_coarse": ("share", "likewise, by steps four times as long"),
        "moreau_step": ("time", "the longer of these steps, which are of first order"),
    }
    variables: ClassVar = (
        TIME
        | over(
            {
                "x": ("length", ("mass",), "place of the mass"),
                "y": ("length", ("mass",), "place of the mass"),
                "heading": ("angle", ("mass",), "direction along which the mass looks"),
                "speed": ("speed", ("mass",), "speed of the mass"),
                "resting": ("count", ("mass",), "1 where the ground holds the mass"),
                "ground_x": ("force", ("mass",), "force of the ground"),
                "ground_y": ("force", ("mass",), "force of the ground"),
                "length": ("length", ("link",), "link length"),
                "angle": ("angle", ("joint",), "angle of the joint"),
                "input": ("force", ("link",), "force of the actuator"),
                "torque": ("torque", ("joint",), "torque of the actuator"),
                "power": ("power", ("actuator",), "power of the actuator, links then joints"),
                "center_x": ("length", (), "place of the centre of mass"),
                "center_y": ("length", (), "place of the centre of mass"),
                "energy": ("energy", (), "kinetic and elastic energy"),
                "work_actuator": ("energy", (), "done by the actuators"),
                "work_ground": ("energy", (), "done by the ground"),
                "work_damping": ("energy", (), "done by the dashpots"),
                "work_pull": ("energy", (), "done by the weight along the slope"),
                "work_wall": ("energy", (), "done by the obstacles"),
                "wall_force": ("force", ("mass",), "of all obstacles on the mass"),
            }
        )
        | EVENTS
    )

    kind: Literal["planar-motion"]
    want: Annotated[
        tuple[Literal["plane", "forces", "animation"], ...],
        says(
            "",
            "`plane`: the body over time in the plane; `forces`: forces and works over time; "
            "`animation`: a GIF",
        ),
    ] = ()
    worm: Annotated[PlanarChainTable, says("", "what moves")]
    ground: Annotated[
        MassGround | tuple[MassGround, ...],
        says("", "under every mass, or a list of tables, one per mass, head first"),
    ]
    start: Annotated[PlanarStart, says("", "how it begins")] = PlanarStart()
    actuation: Annotated[PlanarActuation | None, says("", "what moves it; nothing if left out")] = (
        None
    )
    obstacles: Annotated[
        tuple[Standing, ...],
        says("", "walls and discs that masses do not enter; links pass over them"),
    ] = ()
    obstacle_stiffness: Annotated[
        Positive | None,
        says(
            "stiffness",
            "of obstacles, which give way by the force over it; 1000 times the largest "
            "`worm.stiffness` if left out",
        ),
    ] = None
    contact: Contacts = field(default_factory=ExactContact)
    time: Horizon
    tolerance: Tolerances = field(default_factory=ToleranceTable)

    @property
    def grounds(self) -> tuple[MassGround, ...]:
        """Ground under each mass."""
        if isinstance(self.ground, tuple):
            return self.ground
        return (self.ground,) * (self.worm.links + 1)

    @property
    def wall_stiffness(self) -> float | None:
        """Stiffness of obstacles; None where nothing tells."""
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
            yield "obstacle_stiffness", "missing; links without stiffness tell no usual one"
        for k, each in enumerate(self.obstacles):
            if each.friction and isinstance(self.contact, ExactContact):
                yield (
                    f"obstacles[{k}].friction",
                    'friction on obstacles is smooth; write contact = {treatment = "smooth"}, or 0',
                )
        if self.obstacle_stiffness is not None and not self.obstacles:
            yield (
                "obstacle_stiffness",
                "there are none; write [[obstacles]] or leave it out",
            )
        if self.actuation:
            yield from self.actuation.faults(links)
