"""Tables that all simulations share: start, time span, tolerances, treatment of contact."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.scene.types import FinitePerMass, Positive, Table, wrong_count


class Start(Table, frozen=True, kw_only=True):
    """Where the masses start and how fast.

    Parameters
    ----------
    position : tuple of float, optional
        One per mass, head first. Left out, links have their rest length and the tail is at 0.
    velocity : float or tuple of float
        Alike for all or one per mass.
    """

    position: FinitePerMass | None = None
    velocity: FinitePerMass = 0.0

    def faults(self, links: int) -> Iterator[Fault]:
        """Yield what does not fit a worm of so many links."""
        for name in ("position", "velocity"):
            yield from wrong_count(f"start.{name}", getattr(self, name), links + 1, "masses")


class TimeSpan(Table, frozen=True, kw_only=True):
    """From time 0 to which, and how many instants are kept.

    Parameters
    ----------
    end : float
        Last time.
    samples : int
        Equidistant times at which signals are kept, both ends included.
    """

    end: Positive
    samples: Annotated[
        int, Meta(ge=2, le=1_000_000, description="a whole number from 2 to 1000000")
    ] = 2001


class ToleranceTable(Table, frozen=True, kw_only=True):
    """How exact the motion shall be.

    Parameters
    ----------
    relative : float
        Error of a step against the size of a state.
    absolute : float
        The same against the state's nominal size.
    max_steps : int
        Steps after which the run is given up.
    max_step : float, optional
        Longest step; a fiftieth of the time if left out.
    recheck : bool
        Whether a second route finds the end again.
    """

    relative: Annotated[
        float, Meta(ge=1e-14, le=1e-3, description="a number from 1e-14 to 1e-3")
    ] = 1e-11
    absolute: Positive = 1e-12
    max_steps: Annotated[int, Meta(ge=1, le=10**12, description="a whole number, 1 or above")] = (
        10_000_000
    )
    max_step: Positive | None = None
    recheck: bool = True


class SmoothContact(Table, frozen=True, kw_only=True, tag_field="treatment", tag="smooth"):
    """Contact forces by the regularised law.

    Parameters
    ----------
    v_reg : float
        Width of velocities over which the law is steep.
    """

    v_reg: Positive = 1 / 40


class ExactContact(Table, frozen=True, kw_only=True, tag_field="treatment", tag="exact"):
    """Set-valued contact laws: reversals, sticking and release are located as events."""


ContactTable = SmoothContact | ExactContact


class AveragingTable(Table, frozen=True, kw_only=True):
    """How averages are computed.

    Parameters
    ----------
    nodes : int
        Points of Gauss' quadrature between two reversals.
    """

    nodes: Annotated[int, Meta(ge=2, le=64, description="a whole number from 2 to 64")] = 16


class MeshTable(Table, frozen=True, kw_only=True):
    """How finely an optimal motion is resolved.

    Parameters
    ----------
    arcs : int
        Pieces of time in the first solve.
    degree : int
        Of the state polynomials on each.
    scheme : {"radau", "legendre"}
        Collocation points.
    tolerance : float
        Local error of every piece, in usual sizes of the states, to which the mesh is refined.
    """

    arcs: Annotated[int, Meta(ge=2, le=2000, description="a whole number from 2 to 2000")] = 20
    degree: Annotated[int, Meta(ge=1, le=9, description="a whole number from 1 to 9")] = 3
    scheme: Literal["radau", "legendre"] = "radau"
    tolerance: Annotated[
        float, Meta(ge=1e-13, le=1e-2, description="a number from 1e-13 to 1e-2")
    ] = 1e-9
