"""Tables that all simulations share: start, time span, tolerances, treatment of contact."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.scene.types import FinitePerMass, Positive
from wormopt.study.given import Given, says, wrong_count


class Start(Given):
    """Where the masses start and how fast."""

    position: Annotated[
        FinitePerMass | None,
        says(
            "length",
            "of the masses, head first; left out, links have their rest length and the tail is "
            "at 0",
        ),
    ] = None
    velocity: Annotated[FinitePerMass, says("speed", "of the masses")] = 0.0

    def faults(self, links: int) -> Iterator[Fault]:
        """Yield what does not fit a worm of so many links."""
        for name in ("position", "velocity"):
            yield from wrong_count(f"start.{name}", getattr(self, name), links + 1, "masses")


class TimeSpan(Given):
    """From time 0 to which, and how many instants are kept."""

    end: Annotated[Positive, says("time", "last time")]
    samples: Annotated[
        int,
        Meta(ge=2, le=1_000_000, description="a whole number from 2 to 1000000"),
        says("count", "equidistant times at which signals are kept, both ends included"),
    ] = 2001


class ToleranceTable(Given):
    """How exact the motion shall be."""

    relative: Annotated[
        float,
        Meta(ge=1e-14, le=1e-3, description="a number from 1e-14 to 1e-3"),
        says("1", "error of a step, against the size of a state"),
    ] = 1e-11
    absolute: Annotated[Positive, says("1", "the same, against the state's usual size")] = 1e-12
    max_steps: Annotated[
        int,
        Meta(ge=1, le=10**12, description="a whole number, 1 or above"),
        says("count", "steps after which the run is given up"),
    ] = 10_000_000
    max_step: Annotated[
        Positive | None,
        says(
            "time",
            "longest step, a fiftieth of the time if left out; while nothing moves, an input "
            "shorter than a tenth of it may go unseen",
            usual=(1e-9, 1e6),
        ),
    ] = None
    recheck: Annotated[
        bool | Literal["independent"],
        says(
            "",
            "whether a second route finds the end again; "
            '`"independent"`: one that locates no events',
        ),
    ] = True


class SmoothContact(Given, tag_field="treatment", tag="smooth"):
    """Contact forces by the regularised law.

    It is an approximation: it knows no stiction, and a law with *F*<sub>−</sub> ≠ *F*<sub>+</sub>
    pushes a mass at rest. The trust report says so.
    """

    v_reg: Annotated[
        Positive,
        says("speed", "width of velocities over which the law is steep"),
    ] = 1 / 40


class ExactContact(Given, tag_field="treatment", tag="exact"):
    """Set-valued contact laws: every reversal, stick and release is located as an event."""


ContactTable = SmoothContact | ExactContact


class AveragingTable(Given):
    """How averages are computed."""

    nodes: Annotated[
        int,
        Meta(ge=2, le=64, description="a whole number from 2 to 64"),
        says("count", "points of Gauss' quadrature between two reversals"),
    ] = 16


class MeshTable(Given):
    """How finely an optimal motion is resolved."""

    arcs: Annotated[
        int,
        Meta(ge=2, le=2000, description="a whole number from 2 to 2000"),
        says("count", "pieces of time in the first solve; they are split where errors are large"),
    ] = 20
    degree: Annotated[
        int,
        Meta(ge=1, le=9, description="a whole number from 1 to 9"),
        says("count", "of the state polynomials on each piece"),
    ] = 3
    scheme: Annotated[Literal["radau", "legendre"], says("", "collocation points")] = "radau"
    tolerance: Annotated[
        float,
        Meta(ge=1e-13, le=1e-2, description="a number from 1e-13 to 1e-2"),
        says(
            "1",
            "local error of every piece, in usual sizes of the states, to which the mesh is "
            "refined",
        ),
    ] = 1e-9


# -- keys that many scenes have --------------------------------------------------------------------

Contacts = Annotated[ContactTable, says("", "how contact is treated; exact if left out")]
Horizon = Annotated[TimeSpan, says("", "how long")]
Tolerances = Annotated[ToleranceTable, says("", "how exact simulations are")]
