# pyright: strict
"""Tables that all simulations share: start, time span, tolerances, treatment of contact."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

from wormopt.errors import Fault
from wormopt.numerics.options import Exact, Recheck, Smooth, Tolerance
from wormopt.study.given import Given, entry, number, positive, says, whole, wrong_count
from wormopt.study.types import FinitePerMass


class Start(Given):
    """Initial positions and velocities of the masses."""

    position: FinitePerMass | None = entry(
        "of the masses, head first; left out, links have their rest length and the tail is at 0",
        quantity="length",
        default=None,
    )
    velocity: FinitePerMass = entry("of the masses", quantity="speed", default=0.0)

    def faults(self, links: int) -> Iterator[Fault]:
        """Yield what does not fit a worm of so many links."""
        for name in ("position", "velocity"):
            yield from wrong_count(f"start.{name}", getattr(self, name), links + 1, "masses")


class TimeSpan(Given):
    """Duration from time 0, and number of samples."""

    end: float = positive("time", "last time")
    samples: int = whole(
        2, 1000000, "equidistant times at which signals are kept, both ends included", default=2001
    )


class ToleranceTable(Given):
    """Tolerances of the simulation."""

    relative: float = number(
        "1", "error of a step, against the size of a state", least=1e-14, most=0.001, default=1e-11
    )
    absolute: float = positive("1", "the same, against the state's usual size", default=1e-12)
    max_steps: int = whole(
        1, 1000000000000, "steps after which the run is given up", default=10_000_000
    )
    max_step: float | None = positive(
        "time",
        "longest step; default: a fiftieth of the time; while nothing moves, an input "
        "shorter than a tenth of the step may be missed",
        usual=(1e-09, 1000000.0),
        default=None,
    )
    recheck: Recheck = entry(
        'whether a second route computes the end again; `"independent"`: without located events',
        default=True,
    )

    @property
    def options(self) -> Tolerance:
        """The tolerance as `simulate` takes it."""
        return Tolerance(self.relative, self.absolute, self.max_steps, self.max_step)


class SmoothContact(Given, tag_field="treatment", tag="smooth"):
    """Contact forces by the regularised law.

    It is an approximation: it knows no stiction, and a law with *F*<sub>−</sub> ≠ *F*<sub>+</sub>
    pushes a mass at rest. The trust report says so.
    """

    v_reg: float = positive(
        "speed", "width of velocities over which the law is steep", default=1 / 40
    )

    @property
    def options(self) -> Smooth:
        """The treatment of contact as `simulate` takes it."""
        return Smooth(self.v_reg)


class ExactContact(Given, tag_field="treatment", tag="exact"):
    """Set-valued contact laws: every reversal, stick and release is located as an event."""

    @property
    def options(self) -> Exact:
        """The treatment of contact as `simulate` takes it."""
        return Exact()


ContactTable = SmoothContact | ExactContact


class AveragingTable(Given):
    """How averages are computed."""

    nodes: int = whole(2, 64, "points of Gauss' quadrature between two reversals", default=16)


class MeshTable(Given):
    """Mesh of the optimal motion."""

    arcs: int = whole(
        2,
        2000,
        "pieces of time in the first solve; they are split where errors are large",
        default=20,
    )
    degree: int = whole(1, 9, "of the state polynomials on each piece", default=3)
    scheme: Literal["radau", "legendre"] = entry("collocation points", default="radau")
    tolerance: float = number(
        "1",
        "local error of every piece, in usual sizes of the states, to which the mesh is refined",
        least=1e-13,
        most=0.01,
        default=1e-9,
    )


# -- keys that many scenes have --------------------------------------------------------------------

Contacts = Annotated[ContactTable, says("", "how contact is treated; exact if left out")]
Horizon = Annotated[TimeSpan, says("", "duration and samples")]
Tolerances = Annotated[ToleranceTable, says("", "tolerances of simulations")]
