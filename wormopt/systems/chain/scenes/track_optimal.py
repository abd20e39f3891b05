"""Scenes of kind "track-optimal": the best input by which a chain's links follow a gait."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta, field

from wormopt.errors import Fault
from wormopt.scene.numerics import Horizon, Start, ToleranceTable
from wormopt.scene.types import NonNegative, Positive, SceneTable, Table, says
from wormopt.systems.chain.scenes.chain import ChainTable
from wormopt.systems.chain.scenes.track import Reference
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


class TubeTable(Table, frozen=True, kw_only=True):
    """Tube around the reference, and from when on the error shall be in it."""

    radius: Annotated[Positive, says("length", "*λ*")]
    capture: Annotated[
        NonNegative,
        says(
            "time", "from then on |*e*| ≤ *λ* is asked for, or judged; before the end of the motion"
        ),
    ] = 0.0


class LeastError(Table, frozen=True, kw_only=True, tag_field="minimise", tag="error"):
    """Least ∫(|*e*|² + *ρ*|*u*|²) d*t*; |·| is the Euclidean norm over the links."""

    input_weight: Annotated[Positive, says("", "*ρ*")]


class LeastInput(Table, frozen=True, kw_only=True, tag_field="minimise", tag="input"):
    """Least ∫|*u*|² d*t* with the error in the tube from `tube.capture` on."""

    margin: Annotated[
        Share,
        says(
            "share",
            "part of *λ* left free for what happens between the points of the grid, and for what "
            "complementarity relaxes",
        ),
    ] = 0.02


class GridTable(Table, frozen=True, kw_only=True):
    """Grid of the optimiser: inputs are constant on each of its arcs."""

    arcs: Annotated[
        int,
        Meta(ge=1, le=1000, description="a whole number from 1 to 1000"),
        says(
            "count",
            "arcs per period of the reference, at least; none crosses a break of the reference",
        ),
    ] = 30
    degree: Annotated[
        int,
        Meta(ge=1, le=5, description="a whole number from 1 to 5"),
        says("count", "of the states on each arc (Radau collocation)"),
    ] = 2


class RelaxationTable(Table, frozen=True, kw_only=True):
    """Largest product of speed and force, in usual sizes, that complementarity allows.

    It falls from `first` to `last`, to a tenth from solve to solve. Refused: `last` above `first`.
    """

    first: Annotated[Positive, says("1", "in the first solve")] = 0.1
    last: Annotated[Positive, says("1", "in the last solve")] = 1e-3
    time_limit: Annotated[
        Positive, says("s", "processor time after which a solve is given up; there are several")
    ] = 60.0

    def faults(self) -> Iterator[Fault]:
        """Yield a fault if the last is not the smaller one."""
        if self.last > self.first:
            yield "relaxation.last", f"is above relaxation.first = {self.first:g}; write less"


class TrackOptimalScene(SceneTable, frozen=True, kw_only=True):
    """A chain whose links follow a gait by the best input, open loop.

    It is found with contact as a complementarity on a fixed grid, then simulated exactly. The
    first guess is a simulated LQR with feed-forward. Refused: `worm.random`; `tube.capture` not
    before the end. A tube that no motion keeps to ends with exit code 3 and names it.

    Scalars but `objective_found` are of the exact simulation. `contact_force` at rest is what
    holds the mass; `event_kind` counts from 0: reversal, stick, release, impact, switch (a
    crossing of the tube). `timings_s`: `build` and `solve` (of all programs), `simulate` and
    `recheck`. In the trust report `replay` is the difference between optimiser and simulation,
    `recheck` the second route of the simulation.
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
            'objective of the exact simulation; with `minimise = "input"` force² time',
        ),
        "objective_found": ("length_squared_time", "the same, of the optimiser"),
        "solve_iterations": ("count", "iterations of the optimiser, over all solves"),
        "recheck_error": (
            "share",
            "largest difference of any state at any sample between optimiser and exact "
            "simulation, against the larger of its size and its usual size; 0.05 is accepted",
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
    want: Annotated[
        tuple[Literal["trackers", "motion"], ...],
        says(
            "",
            "`trackers`: lengths with the *λ*-strip, error, input, motion; `motion`: paths, time "
            "upward, heavy where a mass rests",
        ),
    ] = ()
    worm: Annotated[ChainTable, says("", "the worm, without `random`")]
    start: Annotated[Start, says("", "where it starts")] = field(default_factory=Start)
    reference: Annotated[Reference, says("", "what its links shall do")]
    tube: Annotated[TubeTable, says("", "tube around the reference")]
    objective: Annotated[LeastError | LeastInput, says("", "what is minimised")]
    grid: Annotated[GridTable, says("", "grid of the optimiser")] = field(default_factory=GridTable)
    relaxation: Annotated[RelaxationTable, says("", "how exact contact is in the optimiser")] = (
        field(default_factory=RelaxationTable)
    )
    time: Horizon
    tolerance: Annotated[ToleranceTable, says("", "of the simulation of what was found")] = field(
        default_factory=ToleranceTable
    )

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows; `folder` is the scene's."""
        yield from super().faults(folder)
        links = self.worm.links
        yield from self.worm.faults(self.time.end, self.units)
        yield from self.start.faults(links)
        yield from self.reference.gait.faults(links, folder, "reference.gait")
        yield from self.relaxation.faults()
        if self.worm.random is not None:
            yield "worm.random", "an optimal input is one worm's own; leave the table out"
        if self.tube.capture >= self.time.end:
            yield "tube.capture", f"is not before time.end = {self.time.end:g}; write less"
