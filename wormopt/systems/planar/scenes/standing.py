"""Tables of obstacles in the plane that push masses back."""

from __future__ import annotations

from typing import Annotated

from wormopt.study.given import says
from wormopt.study.types import NonNegative
from wormopt.systems.planar.scenes.path import DiscTable, WallTable

_Friction = Annotated[NonNegative, says("1", "coefficient of dry friction, if contact is smooth")]


class StandingDisc(DiscTable, tag_field="shape", tag="disc"):
    """A round obstacle."""

    friction: _Friction = 0.0


class StandingWall(WallTable, tag_field="shape", tag="wall"):
    """A straight wall without end: everything behind it is closed."""

    friction: _Friction = 0.0


Standing = StandingDisc | StandingWall
