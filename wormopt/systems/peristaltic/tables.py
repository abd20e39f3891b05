"""Tables that several kinds of peristaltic worms share."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from wormopt.errors import ArgumentError, Fault
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

    def faults_of_keys(self) -> Iterator[Fault]:
        if self.wall >= self.radius / 2:
            yield (
                "wall",
                f"{self.wall:g} m is not thin for a radius of {self.radius:g} m; write less than "
                f"{self.radius / 2:g}",
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


class Tube(Given, kw_only=False):
    """A rigid tube that swollen segments grip, in SI units.

    Examples
    --------
    >>> from wormopt.systems.peristaltic.segment import Segment
    >>> segment, tube = Segment(20e-3, 5e-3, 0.3e-3, 20e3), Tube(5.05e-3, 0.3)
    >>> round(tube.stretch_at_contact(segment), 6), round(tube.normal_force(segment, 564.0), 6)
    (0.980296, 0.09069)
    """

    radius: float = positive("length", "inner radius, above that of the segment")
    friction: float = number("1", "Coulomb coefficient on the membrane", least=0, default=0.3)

    def stretch_at_contact(self, segment: Segment) -> float:
        """Return the stretch (R / R_t)² at which a sealed segment fills the tube.

        Parameters
        ----------
        segment : Segment
            Segment, thinner than the tube.

        Raises
        ------
        ArgumentError
            If the segment is not thinner.
        """
        if not segment.radius < self.radius:
            raise ArgumentError(
                f"a segment of radius {segment.radius:g} m does not fit into a tube of radius "
                f"{self.radius:g} m; radius must be below {self.radius:g}"
            )
        return (segment.radius / self.radius) ** 2

    def surplus(self, segment: Segment, pressure: Any, pull: Any = 0.0) -> Any:
        """Return the axial force, in N, that the wall carries if a segment fills the tube.

        A negative value means no contact.

        Parameters
        ----------
        segment : Segment
            Segment, thinner than the tube.
        pressure, pull : float, ndarray or expression
            Magnetic pressure, Pa; axial force by which the neighbours pull it apart, N.
        """
        stretch = self.stretch_at_contact(segment)
        return segment.coil_pull(stretch, pressure) + segment.elastic_pull(stretch) - pull

    def normal_force(self, segment: Segment, pressure: Any, pull: Any = 0.0) -> Any:
        """Return the normal force between wall and segment, (2 l_c / R_t) times `surplus`, in N.

        Parameters
        ----------
        segment, pressure, pull : Any
            See `surplus`.
        """
        length = segment.length * self.stretch_at_contact(segment)
        return 2 * length / self.radius * self.surplus(segment, pressure, pull)
