"""Tables shared by scenes of planar worms: body, ground, stroke and obstacles."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.study import Given, entry, number, on_use, positive, whole
from wormopt.study.types import Finite, Pair, wrong_order

with on_use():
    from wormopt.model.friction import Coulomb, NoSlip, Spike, Viscous
    from wormopt.model.planar_friction import AnisotropicCoulomb, Elliptic
    from wormopt.systems.planar.dynamics.chain import Axes
    from wormopt.systems.planar.shape import Harmonics, Polygon, Shape, chain_shape
    from wormopt.systems.planar.swimming.swimmer import Swimmer

Row = tuple[Finite, ...]
Vector = Annotated[
    tuple[Finite, ...],
    Meta(min_length=2, max_length=2, description="two finite numbers, [x, y]"),
]


class Body(Given):
    """The body: a chain of links, head first, with a mass at each end of every link."""

    links: int = whole(1, 200, "number of links *n*; masses 0 (the head) to *n*")
    lengths: float | tuple[float, ...] | None = positive(
        "length",
        "link lengths, one for each or for all; shape variables if left out",
        default=None,
        per="links",
    )
    heading: Literal["bisector", "front", "rear"] = entry(
        "heading of an inner mass: `bisector`, or along the link in `front` or `rear`",
        default="bisector",
    )

    @property
    def counts(self) -> dict[str, int]:
        return {"links": self.links}

    @property
    def sizes(self) -> tuple[float, ...] | None:
        """Lengths of all links, or None if they vary."""
        if self.lengths is None or isinstance(self.lengths, tuple):
            return self.lengths
        return (self.lengths,) * self.links

    @property
    def n_lengths(self) -> int:
        """Number of shape variables that are lengths; angles follow."""
        return self.links if self.lengths is None else 0

    @property
    def n_s(self) -> int:
        """Number of shape variables."""
        return self.n_lengths + self.links - 1

    def shape(self) -> Shape:
        """Return the places by the shape variables: lengths, if they vary, then joint angles."""
        return chain_shape(self.links, lengths=self.sizes, heading=self.heading)


# -- ground ----------------------------------------------------------------------------------------


class Resistances(Given):
    """Dry resistance to forward, backward and sideways motion of a mass."""

    forward: float = positive("force", "*F*<sup>+</sup>, resistance to forward motion")
    backward: float | None = positive(
        "force",
        "*F*<sup>−</sup>, resistance to backward motion; `forward` if left out",
        default=None,
    )
    sideways: float | None = positive(
        "force",
        "*F*<sub>n</sub>, resistance to sideways motion; `forward` if left out",
        default=None,
    )

    @property
    def numbers(self) -> tuple[float, float, float]:
        """Resistance to forward, backward and sideways motion."""
        ahead = self.forward
        return ahead, self.backward or ahead, self.sideways or ahead

    def elliptic(self) -> Elliptic:
        """Return the law of maximal dissipation."""
        return Elliptic(*self.numbers)

    def unit(self) -> Elliptic | AnisotropicCoulomb:
        """Return the law by the direction of motion alone, which is elliptic if all are equal."""
        equal = len(set(self.numbers)) == 1
        return (Elliptic if equal else AnisotropicCoulomb)(*self.numbers)


class DryGround(Resistances):
    """Dry ground that resists forward, backward and sideways motion of a mass differently."""

    law: Literal["elliptic", "unit"] = entry(
        "`elliptic`: elliptic set of forces with maximal dissipation; `unit`: resistance by "
        "the direction of motion alone, without a minimum principle",
        default="elliptic",
    )

    def friction(self) -> Elliptic | AnisotropicCoulomb:
        """Return the friction law of one mass."""
        return self.elliptic() if self.law == "elliptic" else self.unit()


class EllipticGround(Resistances, tag_field="law", tag="elliptic"):
    """Dry friction with an elliptic set of forces and the law of maximal dissipation."""

    friction = Resistances.elliptic


class UnitGround(Resistances, tag_field="law", tag="unit"):
    """Dry friction by the direction of motion alone, without a minimum principle."""

    friction = Resistances.unit


class BoxGround(Resistances, tag_field="law", tag="box"):
    """Dry friction along and across the heading, each independent of the other."""

    def friction(self) -> Axes:
        """Return the friction law of one mass."""
        ahead, back, aside = self.numbers
        return Axes(Coulomb(ahead, back), Coulomb(aside, aside))


class ViscousGround(Given, tag_field="law", tag="viscous"):
    """Linear drag."""

    along: float = number("drag", "*k*<sub>t</sub>, drag along the heading", least=0)
    across: float = number("drag", "*k*<sub>n</sub>, drag across the heading", least=0)

    def friction(self) -> Axes:
        """Return the friction law of one mass."""
        return Axes(Viscous(self.along), Viscous(self.across))


class SkidGround(Given, tag_field="law", tag="skid"):
    """A skid or a wheel: no sideways motion."""

    along: float = number("force", "dry friction along the heading", least=0, default=0.0)

    def friction(self) -> Axes:
        """Return the friction law of one mass."""
        return Axes(_dry(self.along), NoSlip())


class SpikeGround(Given, tag_field="law", tag="spike"):
    """A spike: no backward motion."""

    across: float = number("force", "dry friction across the heading", least=0, default=0.0)

    def friction(self) -> Axes:
        """Return the friction law of one mass."""
        return Axes(Spike(), _dry(self.across))


class SpikedSkidGround(Given, tag_field="law", tag="spiked_skid"):
    """A skid with spikes: no sideways and no backward motion."""

    def friction(self) -> Axes:
        """Return the friction law of one mass."""
        return Axes(Spike(), NoSlip())


class PinGround(Given, tag_field="law", tag="pin"):
    """A pin: no motion."""

    def friction(self) -> Axes:
        """Return the friction law of one mass."""
        return Axes(NoSlip(), NoSlip())


class FreeGround(Given, tag_field="law", tag="free"):
    """No resistance."""

    def friction(self) -> None:
        """Return None: nothing resists."""


MassGround = (
    EllipticGround
    | UnitGround
    | BoxGround
    | ViscousGround
    | SkidGround
    | SpikeGround
    | SpikedSkidGround
    | PinGround
    | FreeGround
)
"""Ground under one mass."""


def _dry(force: float) -> Coulomb | None:
    return Coulomb(force, force) if force else None


class Drags(Given):
    """Viscous ground: drag of rods per length and of masses, along and across them."""

    along: float = number(
        "viscosity", "*c*<sub>t</sub>, drag of rods per length, along them", least=0, default=0.0
    )
    across: float = number(
        "viscosity", "*c*<sub>n</sub>, drag of rods per length, across them", least=0, default=0.0
    )
    mass_along: float = number(
        "drag", "*k*<sub>t</sub>, drag of masses along the heading", least=0, default=0.0
    )
    mass_across: float = number(
        "drag", "*k*<sub>n</sub>, drag of masses across the heading", least=0, default=0.0
    )

    def swimmer(self, shape: Shape) -> Swimmer:
        """Return a body on this ground."""
        return Swimmer(
            shape, rods=(self.along, self.across), masses=(self.mass_along, self.mass_across)
        )

    def faults_of_keys(self) -> Iterator[Fault]:
        if max(min(self.along, self.across), min(self.mass_along, self.mass_across)) == 0:
            yield (
                "",
                "the ground must resist along and across; write along and across, or mass_along "
                "and mass_across, both above 0",
            )


# -- strokes ---------------------------------------------------------------------------------------


class HarmonicStroke(Given, tag_field="course", tag="harmonic"):
    """Harmonic shape variables: row *h* holds the coefficients of the *h*-th harmonic."""

    mean: Row = entry("mean of each shape variable")
    cosine: tuple[Row, ...] = entry("coefficients of cos(2π *h* τ)")
    sine: tuple[Row, ...] = entry("coefficients of sin(2π *h* τ)")

    def stroke(self) -> Harmonics:
        """Return the stroke of this table."""
        return Harmonics(self.mean, self.cosine, self.sine)

    @property
    def rows(self) -> dict[str, tuple[Row, ...]]:
        """Rows with one number for each shape variable, by key."""
        return {"mean": (self.mean,), "cosine": self.cosine, "sine": self.sine}

    def faults_of_keys(self) -> Iterator[Fault]:
        if not self.cosine:
            yield "cosine", "there is no harmonic; write a row for each"
        if len(self.cosine) != len(self.sine):
            yield "sine", f"has {len(self.sine)} rows; cosine has {len(self.cosine)}"


class PolygonStroke(Given, tag_field="course", tag="polygon"):
    """Shape variables that change linearly from corner to corner and back to the first."""

    corners: tuple[Row, ...] = entry("shapes in order, one row each")

    def stroke(self) -> Polygon:
        """Return the stroke of this table."""
        return Polygon(self.corners)

    @property
    def rows(self) -> dict[str, tuple[Row, ...]]:
        """Rows with one number for each shape variable, by key."""
        return {"corners": self.corners}

    def faults_of_keys(self) -> Iterator[Fault]:
        if len(self.corners) < 2:
            yield "corners", "there are fewer than two corners; write two or more"


StrokeTable = HarmonicStroke | PolygonStroke


def wrong_rows(stroke: StrokeTable, n_s: int) -> Iterator[Fault]:
    """Yield keys below `stroke` with a row that has not one number for each shape variable."""
    for name, rows in stroke.rows.items():
        for row in rows:
            if len(row) != n_s:
                yield (
                    f"stroke.{name}",
                    f"has {len(row)} numbers for {n_s} shape variables; write link lengths, if "
                    "they vary, then joint angles",
                )
                break


class PlanarLimits(Given):
    """Limits of shape, rates, work and room.

    Examples
    --------
    >>> PlanarLimits(length=(0.5, 1.0), angle=(-1.0, 1.0)).angle
    (-1.0, 1.0)
    """

    angle: Annotated[
        tuple[Finite, ...],
        Meta(min_length=2, max_length=2, description="two finite numbers, [smallest, largest]"),
    ] = entry("least and largest joint angle", quantity="angle", default=(-2.0, 2.0))
    length: Pair | None = entry(
        "least and largest link length; required if lengths are shape variables",
        quantity="length",
        default=None,
    )
    angle_rate: float = positive("rate", "largest rate of a joint angle", default=1.0)
    length_rate: float = positive("speed", "largest rate of a link length", default=1.0)
    effort: float | None = positive(
        "energy",
        "largest work per cycle; for dry ground, or if `objective.purpose` is `work`",
        default=None,
    )
    half_width: float | None = positive(
        "length", "half the width of a passage along the displacement", default=None
    )
    radius: float = number(
        "length", "radius of the links, rods with round ends, in the passage", least=0, default=0.0
    )

    def faults_of_keys(self) -> Iterator[Fault]:
        for name, pair in (("angle", self.angle), ("length", self.length)):
            if pair is not None:
                yield from wrong_order(name, pair, may_be_equal=False)
        if max(map(abs, self.angle)) >= math.pi:
            yield "angle", "reaches a half turn, where links overlap; write angles within ±π"
        if self.half_width is not None and self.half_width <= self.radius:
            yield (
                "half_width",
                f"{self.half_width:g} is not above the radius of the links, {self.radius:g}; "
                "write more",
            )
