"""Tables that scenes of planar worms share: the body, the ground, the stroke."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.scene.types import Finite, Positive, Table, says, wrong_count

if TYPE_CHECKING:  # what tables tell is built in runs: checking a scene loads no numerics
    from wormopt.model.planar_friction import PlanarLaw
    from wormopt.systems.planar.body.shape import Shape
    from wormopt.systems.planar.body.strokes import Stroke

Heading = Literal["bisector", "front", "rear"]
Links = Annotated[int, Meta(ge=1, le=200, description="a whole number from 1 to 200")]
Row = tuple[Finite, ...]


class BodyTable(Table, frozen=True, kw_only=True):
    """The body: links in a chain, head first, with a mass at each end of every link."""

    links: Annotated[Links, says("count", "*n*; masses 0 (the head) to *n*")]
    lengths: Annotated[
        Positive | tuple[Positive, ...] | None,
        says("length", "of the links, or one for all; left out, lengths are shape variables"),
    ] = None
    heading: Annotated[
        Heading,
        says("", "along what an inner mass looks: `bisector`, or the link in `front` or `rear`"),
    ] = "bisector"

    def shape(self) -> Shape:
        """Its points by its shape variables: lengths, if they vary, then angles of the joints."""
        from wormopt.systems.planar.body.shape import chain_shape

        return chain_shape(self.links, lengths=self.sizes, heading=self.heading)

    @property
    def sizes(self) -> tuple[float, ...] | None:
        """Lengths of all links, None where they vary."""
        if self.lengths is None or isinstance(self.lengths, tuple):
            return self.lengths
        return (self.lengths,) * self.links

    def faults(self, key: str) -> Iterator[Fault]:
        """Check that there are as many lengths as links."""
        yield from wrong_count(f"{key}.lengths", self.lengths, self.links, "links")


class GroundTable(Table, frozen=True, kw_only=True):
    """Dry ground that resists forward, backward and sideways motion of a mass differently."""

    law: Annotated[
        Literal["elliptic", "unit"],
        says(
            "",
            "`elliptic`: the force of an ellipse that takes most power; `unit`: resistances by the "
            "direction of motion alone, without a minimum principle",
        ),
    ] = "elliptic"
    forward: Annotated[Positive, says("force", "*F*<sup>+</sup>, against motion ahead")]
    backward: Annotated[
        Positive | None, says("force", "*F*<sup>−</sup>, against motion back; as `forward`")
    ] = None
    sideways: Annotated[
        Positive | None, says("force", "*F*<sub>n</sub>, against motion aside; as `forward`")
    ] = None

    def friction(self) -> PlanarLaw:
        """The law of one mass."""
        from wormopt.model.planar_friction import AnisotropicCoulomb, Elliptic

        kinds: dict[str, type[Elliptic] | type[AnisotropicCoulomb]] = {
            "elliptic": Elliptic,
            "unit": AnisotropicCoulomb,
        }
        ahead = self.forward
        return kinds[self.law](ahead, self.backward or ahead, self.sideways or ahead)


class HarmonicStroke(Table, frozen=True, kw_only=True, tag_field="course", tag="harmonic"):
    """Shape variables that swing by harmonics: row *h* of a table holds the *h*-th of each."""

    mean: Annotated[Row, says("", "mean of each shape variable")]
    cosine: Annotated[tuple[Row, ...], says("", "coefficients of cos(2π *h* τ)")]
    sine: Annotated[tuple[Row, ...], says("", "coefficients of sin(2π *h* τ)")]

    def stroke(self) -> Stroke:
        """What it tells."""
        from wormopt.systems.planar.body.strokes import Harmonics

        return Harmonics(self.mean, self.cosine, self.sine)

    def faults(self, key: str, n_s: int) -> Iterator[Fault]:
        """Check that every row has one number for each of `n_s` shape variables."""
        yield from _wrong_rows(f"{key}.mean", (self.mean,), n_s)
        for name in ("cosine", "sine"):
            yield from _wrong_rows(f"{key}.{name}", getattr(self, name), n_s)
        if not self.cosine:
            yield f"{key}.cosine", "a stroke needs a harmonic; write a row for each"
        if len(self.cosine) != len(self.sine):
            yield f"{key}.sine", f"{len(self.sine)} rows for {len(self.cosine)} of cosine"


class PolygonStroke(Table, frozen=True, kw_only=True, tag_field="course", tag="polygon"):
    """Shape variables that go straight from corner to corner and back to the first."""

    corners: Annotated[tuple[Row, ...], says("", "shapes in order, a row each")]

    def stroke(self) -> Stroke:
        """What it tells."""
        from wormopt.systems.planar.body.strokes import Polygon

        return Polygon(self.corners)

    def faults(self, key: str, n_s: int) -> Iterator[Fault]:
        """Check that every corner has one number for each of `n_s` shape variables."""
        yield from _wrong_rows(f"{key}.corners", self.corners, n_s)
        if len(self.corners) < 2:
            yield f"{key}.corners", "a stroke needs two corners or more"


StrokeTable = HarmonicStroke | PolygonStroke


def _wrong_rows(key: str, rows: tuple[Row, ...], n_s: int) -> Iterator[Fault]:
    for row in rows:
        if len(row) != n_s:
            yield (
                key,
                f"{len(row)} numbers for {n_s} shape variables; write lengths, where they vary, "
                "then angles of the joints",
            )
            return
