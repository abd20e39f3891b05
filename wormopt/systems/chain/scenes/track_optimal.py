"""Tables of scenes of kind "track-optimal": the best input with which links follow a gait."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar, Literal

from wormopt.errors import Fault
from wormopt.study.given import entry
from wormopt.study.numerics import Horizon, Start, ToleranceTable
from wormopt.study.types import SceneTable
from wormopt.systems.chain.tables import (
    ChainTable,
    GridTable,
    LeastError,
    LeastInput,
    Reference,
    RelaxationTable,
    TubeTable,
)
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
