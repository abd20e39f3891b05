"""Tables that several kinds of peristaltic worms share."""

from __future__ import annotations

from collections.abc import Iterator

from wormopt.errors import Fault
from wormopt.study import Given, number, on_use, positive

with on_use():
    from wormopt.systems.peristaltic.segment import Segment


class SegmentTable(Given):
    """The segment, a thin tube of rubber closed by rings."""

    length: float = positive("length", "unstressed length *L*")
    radius: float = positive("length", "unstressed radius *R*, also of the rings")
    wall: float = positive("length", "thickness *h* of the wall, small against the radius")
    shear_modulus: float = positive("stress", "shear modulus *G* of the rubber, *E*/3")
    neo_hookean: float = number(
        "share",
        "*a* of the Mooney-Rivlin energy *a I*<sub>1</sub> + (1 − *a*) *I*<sub>2</sub>",
        least=0,
        most=1,
        default=1.0,
    )

    def faults_in(self, where: str, tube: float) -> Iterator[Fault]:
        """Yield a fault, with the key `where`, unless the segment fits into a tube of a radius."""
        if tube <= self.radius:
            yield (
                where,
                f"a segment of radius {self.radius:g} m does not fit into a tube of {tube:g} m; "
                f"write more than {self.radius:g}",
            )

    def in_coil(self, share: float) -> Segment:
        """Return the segment with a share of its length in the field of its coil."""
        return Segment(
            self.length, self.radius, self.wall, self.shear_modulus, share, self.neo_hookean
        )
