"""Tables of the ground under single masses of a planar worm."""

from __future__ import annotations

from typing import Annotated

from wormopt.model.friction import Coulomb, Held, Spike, Viscous
from wormopt.model.planar_friction import Elliptic, Unit
from wormopt.scene.types import NonNegative, Positive, Table, says
from wormopt.systems.planar.dynamics.ground import Axes, Ground

_Forward = Annotated[Positive, says("force", "*F*<sup>+</sup>, against motion ahead")]
_Backward = Annotated[
    Positive | None, says("force", "*F*<sup>−</sup>, against motion back; as `forward`")
]
_Sideways = Annotated[
    Positive | None, says("force", "*F*<sub>n</sub>, against motion aside; as `forward`")
]
_Slides = Annotated[NonNegative, says("force", "dry friction along the heading")]


class EllipticGround(Table, frozen=True, kw_only=True, tag_field="law", tag="elliptic"):
    """Dry ground whose forces fill an ellipse: that which takes most power resists."""

    forward: _Forward
    backward: _Backward = None
    sideways: _Sideways = None

    def ground(self) -> Ground:
        """What it says."""
        ahead = self.forward
        return Elliptic(ahead, self.backward or ahead, self.sideways or ahead)


class UnitGround(Table, frozen=True, kw_only=True, tag_field="law", tag="unit"):
    """Dry ground that resists by the direction of motion alone; it has no minimum principle."""

    forward: _Forward
    backward: _Backward = None
    sideways: _Sideways = None

    def ground(self) -> Ground:
        """What it says."""
        ahead = self.forward
        return Unit(ahead, self.backward or ahead, self.sideways or ahead)


class BoxGround(Table, frozen=True, kw_only=True, tag_field="law", tag="box"):
    """Dry ground that resists motion along the heading and aside as if each were alone."""

    forward: _Forward
    backward: _Backward = None
    sideways: _Sideways = None

    def ground(self) -> Ground:
        """What it says."""
        ahead, aside = self.forward, self.sideways or self.forward
        return Axes(Coulomb(ahead, self.backward or ahead), Coulomb(aside, aside))


class ViscousGround(Table, frozen=True, kw_only=True, tag_field="law", tag="viscous"):
    """Linear drag."""

    along: Annotated[NonNegative, says("drag", "*k*<sub>t</sub>, along the heading")]
    across: Annotated[NonNegative, says("drag", "*k*<sub>n</sub>, across it")]

    def ground(self) -> Ground:
        """What it says."""
        return Axes(Viscous(self.along), Viscous(self.across))


class SkidGround(Table, frozen=True, kw_only=True, tag_field="law", tag="skid"):
    """A skid or a wheel: no motion aside."""

    along: _Slides = 0.0

    def ground(self) -> Ground:
        """What it says."""
        return Axes(Coulomb(self.along, self.along) if self.along else None, Held())


class SpikeGround(Table, frozen=True, kw_only=True, tag_field="law", tag="spike"):
    """A spike: no motion back."""

    across: Annotated[NonNegative, says("force", "dry friction across the heading")] = 0.0

    def ground(self) -> Ground:
        """What it says."""
        return Axes(Spike(), Coulomb(self.across, self.across) if self.across else None)


class SpikedSkidGround(Table, frozen=True, kw_only=True, tag_field="law", tag="spiked_skid"):
    """A skid with spikes: no motion aside or back."""

    def ground(self) -> Ground:
        """What it says."""
        return Axes(Spike(), Held())


class PinGround(Table, frozen=True, kw_only=True, tag_field="law", tag="pin"):
    """A pin: no motion."""

    def ground(self) -> Ground:
        """What it says."""
        return Axes(Held(), Held())


class FreeGround(Table, frozen=True, kw_only=True, tag_field="law", tag="free"):
    """Nothing resists."""

    def ground(self) -> Ground | None:
        """What it says."""
        return None


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
