"""Tables shared by scenes of planar worms: body, ground and stroke."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.study.given import Given, entry, positive, whole, wrong_count
from wormopt.study.types import Finite, Positive

if TYPE_CHECKING:  # numerics are built in runs, so that checking a scene loads none
    from wormopt.model.planar_friction import PlanarLaw
    from wormopt.systems.planar.body.shape import Shape
    from wormopt.systems.planar.body.strokes import Stroke

Heading = Literal["bisector", "front", "rear"]
Links = Annotated[int, Meta(ge=1, le=200, description="a whole number from 1 to 200")]
Row = tuple[Finite, ...]


class BodyTable(Given):
    """The body: a chain of links, head first, with a mass at each end of every link."""

    links: int = whole(1, 200, "number of links *n*; masses 0 (the head) to *n*")
    lengths: Positive | tuple[Positive, ...] | None = entry(
        "link lengths, one for each or for all; shape variables if left out",
        quantity="length",
        default=None,
    )
    heading: Heading = entry(
        "heading of an inner mass: `bisector`, or along the link in `front` or `rear`",
        default="bisector",
    )

    def shape(self) -> Shape:
        """Return the places by the shape variables: lengths, if they vary, then joint angles."""
        from wormopt.systems.planar.body.shape import chain_shape

        return chain_shape(self.links, lengths=self.sizes, heading=self.heading)

    @property
    def sizes(self) -> tuple[float, ...] | None:
        """Return the lengths of all links, or None if they vary."""
        if self.lengths is None or isinstance(self.lengths, tuple):
            return self.lengths
        return (self.lengths,) * self.links

    def faults(self, key: str) -> Iterator[Fault]:
        """Yield a fault if the number of lengths is not the number of links."""
        yield from wrong_count(f"{key}.lengths", self.lengths, self.links, "links")


class GroundTable(Given):
    """Dry ground that resists forward, backward and sideways motion of a mass differently."""

    law: Literal["elliptic", "unit"] = entry(
        "`elliptic`: elliptic set of forces with maximal dissipation; `unit`: resistance by "
        "the direction of motion alone, without a minimum principle",
        default="elliptic",
    )
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

    def friction(self) -> PlanarLaw:
        """Return the friction law of one mass."""
        from wormopt.model.planar_friction import AnisotropicCoulomb, Elliptic

        kinds: dict[str, type[Elliptic] | type[AnisotropicCoulomb]] = {
            "elliptic": Elliptic,
            "unit": AnisotropicCoulomb,
        }
        ahead = self.forward
        return kinds[self.law](ahead, self.backward or ahead, self.sideways or ahead)


class HarmonicStroke(Given, tag_field="course", tag="harmonic"):
    """Harmonic shape variables: row *h* holds the coefficients of the *h*-th harmonic."""

    mean: Row = entry("mean of each shape variable")
    cosine: tuple[Row, ...] = entry("coefficients of cos(2π *h* τ)")
    sine: tuple[Row, ...] = entry("coefficients of sin(2π *h* τ)")

    def stroke(self) -> Stroke:
        """Return the stroke of this table."""
        from wormopt.systems.planar.body.strokes import Harmonics

        return Harmonics(self.mean, self.cosine, self.sine)

    def faults(self, key: str, n_s: int) -> Iterator[Fault]:
        """Yield rows that have not one number for each of `n_s` shape variables."""
        yield from _wrong_rows(f"{key}.mean", (self.mean,), n_s)
        for name in ("cosine", "sine"):
            yield from _wrong_rows(f"{key}.{name}", getattr(self, name), n_s)
        if not self.cosine:
            yield f"{key}.cosine", "there is no harmonic; write a row for each"
        if len(self.cosine) != len(self.sine):
            yield f"{key}.sine", f"has {len(self.sine)} rows; cosine has {len(self.cosine)}"


class PolygonStroke(Given, tag_field="course", tag="polygon"):
    """Shape variables that change linearly from corner to corner and back to the first."""

    corners: tuple[Row, ...] = entry("shapes in order, one row each")

    def stroke(self) -> Stroke:
        """Return the stroke of this table."""
        from wormopt.systems.planar.body.strokes import Polygon

        return Polygon(self.corners)

    def faults(self, key: str, n_s: int) -> Iterator[Fault]:
        """Yield corners that have not one number for each of `n_s` shape variables."""
        yield from _wrong_rows(f"{key}.corners", self.corners, n_s)
        if len(self.corners) < 2:
            yield f"{key}.corners", "there are fewer than two corners; write two or more"


StrokeTable = HarmonicStroke | PolygonStroke


def _wrong_rows(key: str, rows: tuple[Row, ...], n_s: int) -> Iterator[Fault]:
    for row in rows:
        if len(row) != n_s:
            yield (
                key,
                f"has {len(row)} numbers for {n_s} shape variables; write link lengths, if they "
                "vary, then joint angles",
            )
            return
