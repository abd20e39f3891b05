"""Tables of the ground under single masses of a planar worm."""

from __future__ import annotations

from typing import Annotated

from wormopt.study.given import Given, number, says
from wormopt.study.types import NonNegative, Positive

_Forward = Annotated[Positive, says("force", "*F*<sup>+</sup>, resistance to forward motion")]
_Backward = Annotated[
    Positive | None,
    says("force", "*F*<sup>−</sup>, resistance to backward motion; `forward` if left out"),
]
_Sideways = Annotated[
    Positive | None,
    says("force", "*F*<sub>n</sub>, resistance to sideways motion; `forward` if left out"),
]
_Slides = Annotated[NonNegative, says("force", "dry friction along the heading")]


class EllipticGround(Given, tag_field="law", tag="elliptic"):
    """Dry friction with an elliptic set of forces and the law of maximal dissipation."""

    forward: _Forward
    backward: _Backward = None
    sideways: _Sideways = None


class UnitGround(Given, tag_field="law", tag="unit"):
    """Dry friction by the direction of motion alone, without a minimum principle."""

    forward: _Forward
    backward: _Backward = None
    sideways: _Sideways = None


class BoxGround(Given, tag_field="law", tag="box"):
    """Dry friction along and across the heading, each independent of the other."""

    forward: _Forward
    backward: _Backward = None
    sideways: _Sideways = None


class ViscousGround(Given, tag_field="law", tag="viscous"):
    """Linear drag."""

    along: float = number("drag", "*k*<sub>t</sub>, drag along the heading", least=0)
    across: float = number("drag", "*k*<sub>n</sub>, drag across the heading", least=0)


class SkidGround(Given, tag_field="law", tag="skid"):
    """A skid or a wheel: no sideways motion."""

    along: _Slides = 0.0


class SpikeGround(Given, tag_field="law", tag="spike"):
    """A spike: no backward motion."""

    across: float = number("force", "dry friction across the heading", least=0, default=0.0)


class SpikedSkidGround(Given, tag_field="law", tag="spiked_skid"):
    """A skid with spikes: no sideways and no backward motion."""


class PinGround(Given, tag_field="law", tag="pin"):
    """A pin: no motion."""


class FreeGround(Given, tag_field="law", tag="free"):
    """No resistance."""


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
