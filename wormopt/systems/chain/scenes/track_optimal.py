"""Tables of scenes of kind "track-optimal": the best input with which links follow a gait."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.study.given import Given, entry, number, positive, whole
from wormopt.study.numerics import Horizon, Start, ToleranceTable
from wormopt.study.types import SceneTable
from wormopt.systems.chain.tables import ChainTable, Reference
from wormopt.systems.shared.declared import (
    CHAIN,
    GAIT,
    JUDGED,
    LOOP_SIGNALS,
    REFERENCE,
    TIME,
    TRACKER_EVENTS,
    over,
)

Share = Annotated[float, Meta(ge=0, lt=1, description="a number from 0 to below 1")]


class TubeTable(Given):
    """Tube around the reference, and the time from which the error must stay in it."""

    radius: float = positive("length", "*λ*")
    capture: float = number(
        "time",
        "time from which |*e*| ≤ *λ* is required or judged; before the end of the motion",
        least=0,
        default=0.0,
    )


class LeastError(Given, tag_field="minimise", tag="error"):
    """Minimises ∫(|*e*|² + *ρ*|*u*|²) d*t*; |·| is the Euclidean norm over the links."""

    input_weight: float = positive("", "*ρ*")


class LeastInput(Given, tag_field="minimise", tag="input"):
    """Minimises ∫|*u*|² d*t* with the error in the tube from `tube.capture` on."""

    margin: float = number(
        "share",
        "share of *λ* kept free for the error between grid points and for the relaxation of "
        "complementarity",
        least=0,
        below=1,
        default=0.02,
    )


class GridTable(Given):
    """Grid of the optimiser, with a constant input on each arc."""

    arcs: int = whole(
        1,
        1000,
        "least number of arcs per period of the reference; breaks of the reference lie "
        "between arcs",
        default=30,
    )
    degree: int = whole(
        1, 5, "polynomial degree of the states on each arc (Radau collocation)", default=2
    )


class RelaxationTable(Given):
    """Largest product of speed and force, in usual sizes, that the relaxed complementarity allows.

    Each solve divides it by ten, from `first` down to `last`. Not allowed: `last` above `first`.
    """

    first: float = positive("1", "product in the first solve", default=0.1)
    last: float = positive("1", "product in the last solve", default=1e-3)
    time_limit: float = positive("s", "processor time limit of each of the solves", default=60.0)

    def faults(self) -> Iterator[Fault]:
        """Yield a fault if the last product is above the first."""
        if self.last > self.first:
            yield "relaxation.last", f"is above relaxation.first = {self.first:g}; write less"


class TrackOptimalScene(SceneTable):
    """The best open-loop input with which the links of a chain follow a gait.

    The optimiser treats contact as a complementarity condition on a fixed grid; an exact simulation
    repeats the motion found. The first guess is a simulated LQR with feed-forward. Not allowed:
    `worm.random`; `tube.capture` not before the end. If no motion stays in the tube, the exit code
    is 3 and the message names the tube.

    All scalars except `objective_found` come from the exact simulation. At rest, `contact_force` is
    the force that holds the mass. `event_kind` counts from 0: reversal, stick, release, impact,
    switch (a crossing of the tube). `timings_s`: `build` and `solve` (of all programs), `simulate`
    and `recheck`. In the trust report, `replay` is the difference between optimiser and simulation,
    and `recheck` is the second route of the simulation.
    """

    headline: ClassVar = (
        "objective",
        "capture_time",
        "time_outside_tube",
        "error_peak",
        "input_rms",
        "distance",
    )
    scalars: ClassVar = {
        **JUDGED,
        **CHAIN,
        "objective": (
            "length_squared_time",
            'objective of the exact simulation; its unit is force² time with `minimise = "input"`',
        ),
        "objective_found": ("length_squared_time", "objective of the optimiser"),
        "solve_iterations": ("count", "iterations of the optimiser, over all solves"),
        "recheck_error": (
            "share",
            "largest difference of any state at any sample between optimiser and exact "
            "simulation, relative to the larger of its size and its usual size; up to 0.05 is "
            "accepted",
        ),
    }
    variables: ClassVar = {
        **TIME,
        **REFERENCE,
        **over({k: v for k, v in LOOP_SIGNALS.items() if k not in ("gain", "funnel")}, "tracker"),
        **TRACKER_EVENTS,
        **GAIT,
    }

    kind: Literal["track-optimal"]
    want: tuple[Literal["trackers", "motion"], ...] = entry(
        "`trackers`: lengths with the *λ*-strip, error, input, motion; `motion`: paths with "
        "time upward, thick where a mass rests",
        default=(),
    )
    worm: ChainTable = entry("the chain, without `random`")
    start: Start = entry("initial state", default=Start)
    reference: Reference = entry("reference of the links")
    tube: TubeTable = entry("tube around the reference")
    objective: LeastError | LeastInput = entry("minimised quantity")
    grid: GridTable = entry("grid of the optimiser", default=GridTable)
    relaxation: RelaxationTable = entry(
        "relaxation of contact in the optimiser", default=RelaxationTable
    )
    time: Horizon
    tolerance: ToleranceTable = entry("tolerance of the exact simulation", default=ToleranceTable)

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows; `folder` is the scene's."""
        yield from super().faults(folder)
        links = self.worm.links
        yield from self.worm.faults(self.time.end, self.units)
        yield from self.start.faults(links)
        yield from self.reference.gait.faults(links, folder, "reference.gait")
        yield from self.relaxation.faults()
        if self.worm.random is not None:
            yield (
                "worm.random",
                "is not allowed, since an optimal input belongs to a single chain; leave the "
                "table out",
            )
        if self.tube.capture >= self.time.end:
            yield "tube.capture", f"is not before time.end = {self.time.end:g}; write less"
