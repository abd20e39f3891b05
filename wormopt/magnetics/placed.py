"""A coil under or over a layer of fluid, and its field in the plane through its axis."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from wormopt.errors import ArgumentError
from wormopt.magnetics.material import check_number
from wormopt.magnetics.winding import Coil

Direction = Literal["vertical", "along"]
Side = Literal["below", "above"]


@dataclass(frozen=True)
class Placed:
    """A coil under or over a layer whose bottom is at z = 0, its middle at x = 0.

    Raises ArgumentError if the distance is not above 0, or there is no such side or axis.
    """

    coil: Coil
    axis: Direction  # "vertical": along z; "along": along x
    side: Side  # "below" or "above"
    distance: float  # bottom of the layer to the nearest point of the coil, m

    def __post_init__(self) -> None:
        check_number("distance", self.distance)
        if self.side not in ("below", "above"):
            raise ArgumentError(f'no side "{self.side}"; there are below, above')
        if self.axis not in ("vertical", "along"):
            raise ArgumentError(f'no axis "{self.axis}"; there are vertical, along')

    @property
    def middle(self) -> float:
        """Height of the middle of the coil, in m."""
        size = self.coil.length / 2 if self.axis == "vertical" else self.coil.outer
        return (self.distance + size) * (1 if self.side == "above" else -1)

    @property
    def section(self) -> tuple[tuple[float, float, float, float], ...]:
        """Both halves of the winding in the plane: left end, lower end, width, height, in m."""
        deep, long = self.coil.outer - self.coil.inner, self.coil.length
        return tuple(
            (away, self.middle - long / 2, deep, long)
            if self.axis == "vertical"
            else (-long / 2, self.middle + away, long, deep)
            for away in (-self.coil.outer, self.coil.inner)
        )

    def clearance(self, x: Any, z: Any) -> Any:
        """Distance of points from the winding; `x`, `z` in m."""
        away, s = self._seen(x, z)
        return self.coil.clearance(away * away, s)

    def field(self, x: Any, z: Any, nodes: int | None = None) -> tuple[Any, Any]:
        """Field (Hx, Hz) per ampere-turn in the plane y = 0, in 1/m; `x`, `z` in m.

        `nodes`: of the quadrature over the winding, for expressions, see `Coil.nodes`;
        left out, `x` and `z` must be numbers.
        """
        away, s = self._seen(x, z)
        if nodes is None:
            axial, radial = self.coil.field(away * away, s)
        else:
            axial, radial = self.coil.expression(away * away, s, nodes)
        return (radial * away, axial) if self.axis == "vertical" else (axial, radial * away)

    def _seen(self, x: Any, z: Any) -> tuple[Any, Any]:
        """Distances from the axis and along it."""
        up = z - self.middle
        return (x, up) if self.axis == "vertical" else (up, x)
