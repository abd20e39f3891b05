"""Tables of the ground under single masses of a planar worm."""

from __future__ import annotations

from typing import Annotated

from wormopt.scene.types import NonNegative, Positive, Table, says

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



class UnitGround(Table, frozen=True, kw_only=True, tag_field="law", tag="unit"):
    """Dry ground that resists by the direction of motion alone; it has no minimum principle."""

    forward: _Forward
    backward: _Backward = None
    sideways: _Sideways = None



class BoxGround(Table, frozen=True, kw_only=True, tag_field="law", tag="box"):
    """Dry ground that resists motion along the heading and aside as if each were alone."""

    forward: _Forward
    backward: _Backward = None
    sideways: _Sideways = None



class ViscousGround(Table, frozen=True, kw_only=True, tag_field="law", tag="viscous"):
    """Linear drag."""

    along: Annotated[NonNegative, says("drag", "*k*<sub>t</sub>, along the heading")]
    across: Annotated[NonNegative, says("drag", "*k*<sub>n</sub>, across it")]



class SkidGround(Table, frozen=True, kw_only=True, tag_field="law", tag="skid"):
    """A skid or a wheel: no motion aside."""

    along: _Slides = 0.0



class SpikeGround(Table, frozen=True, kw_only=True, tag_field="law", tag="spike"):
    """A spike: no motion back."""

    across: Annotated[NonNegative, says("force", "dry friction across the heading")] = 0.0



class SpikedSkidGround(Table, frozen=True, kw_only=True, tag_field="law", tag="spiked_skid"):
    """A skid with spikes: no motion aside or back."""



class PinGround(Table, frozen=True, kw_only=True, tag_field="law", tag="pin"):
    """A pin: no motion."""



class FreeGround(Table, frozen=True, kw_only=True, tag_field="law", tag="free"):
    """Nothing resists."""



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
