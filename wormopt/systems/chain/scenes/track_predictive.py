"""Scenes of kind "track-predictive": a chain whose links follow a gait by predictive control."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import field

from wormopt.errors import Fault
from wormopt.scene.numerics import Horizon, Start, ToleranceTable
from wormopt.scene.types import SceneTable, says
from wormopt.systems.chain.scenes.chain import ChainTable, CoulombFriction
from wormopt.systems.chain.scenes.predictive import (
    EstimationTable,
    PlantsTable,
    PredictiveTable,
)
from wormopt.systems.chain.scenes.track import Reference
from wormopt.systems.chain.scenes.track_optimal import TubeTable
from wormopt.systems.shared.declared import GAIT, JUDGED, LOOP_SIGNALS, TIME, over

SHOWN = ("error_norm", "length", "input", "position")
"""Signals that are kept of every controller."""


class TrackPredictiveScene(SceneTable, frozen=True, kw_only=True):
    """Predictive control of a chain, decision by decision, beside the open-loop optimum and LQR.

    The optimal motion over the whole time is planned with the smooth law of friction, on arcs of
    one decision each, and driven open loop. The predictive controller plans anew at every decision
    from the state that it measures: in real time, by one step of sequential quadratic programming
    from the last decision's motion, or until steps end. The worm is simulated exactly between
    decisions; then all that was decided is simulated again as one motion, from which all numbers
    are. Decisions take no time in the simulation; how long they take on this machine is measured
    and told against their period.

    Each controller moves the worm as it is believed, and with `[plants]` others that it does not
    know, but the converged one; `[estimation]` lets the one in real time learn their parameters on
    the way. "plant known" is planned by somebody who knows.

    Where the worm obeys the smooth law that the controller believes, it must be as good as the open
    loop, to 1e-6 of its cost: the check `as good as the open loop`. Refused: friction of another
    kind than one `coulomb` table for each mass or all; `worm.random`.

    Attributes: `controllers`, `parameters` (estimated, by name and number), and `table`, what
    `table.md` holds. Scalars that are lists have an entry for each controller.
    """

    headline: ClassVar = ("cost", "excess", "decision_median", "decision_period", "distance")
    scalars: ClassVar = JUDGED | {
        "tube_radius": ("length", "*λ*"),
        "cost": ("length_squared_time", "∫(|*e*|² + *ρ*|*u*|²) d*t*, of the exact simulation"),
        "objective_found": ("length_squared_time", "the same, of the plan"),
        "plan_steps": ("count", "steps of sequential quadratic programming for the plan"),
        "right_cost": (
            "length_squared_time",
            "cost where the worm obeys the smooth law that is believed: open loop, in real time, "
            "converged",
        ),
        "excess": ("share", "by how much the larger of the last two exceeds the first"),
        "decisions": ("count", "decisions of each motion"),
        "decisions_unsolved": (
            "count",
            "those whose quadratic program was not solved: the last motion went on",
        ),
        "decision_period": ("s", "shortest time between decisions, by `predictive.seconds`"),
        "decision_median": (
            "s",
            "time that decisions take on this machine, estimation included: median over those for "
            "the worm as it is believed",
        ),
        "decision_most": ("s", "the same, 95 of 100 take less"),
        "decision_worst": ("s", "the same, longest"),
        "decision_processor": (
            "s",
            "time of the processor that decisions take, median: what they cost on a machine that "
            "does nothing else",
        ),
        "decision_steps": ("count", "steps of a decision, mean"),
        "parameter_error": (
            "share",
            "how far estimated parameters of the plants are off, root of the mean square of "
            "logarithms: a list for each of `estimation.parameters`, as believed and at the end",
        ),
        "recheck_error": ("share", "of the second route, largest over controllers without gains"),
    }
    variables: ClassVar = {
        **TIME,
        "reference": ("length", ("link", "time"), "reference of the link length"),
        **over({name: LOOP_SIGNALS[name] for name in SHOWN}, "controller"),
        "decision_time": ("time", ("decision",), "time of the decision"),
        "decision_seconds": ("s", ("controller", "decision"), "wall-clock time it took"),
        "drawn_cost": ("length_squared_time", ("controller", "member"), "cost on the plant"),
        "drawn_error_peak": (
            "length",
            ("controller", "member"),
            "largest |e| after capture on the plant",
        ),
        "drawn_distance": ("length", ("controller", "member"), "distance of the plant"),
        "estimated": (
            "share",
            ("parameter", "member", "decision"),
            "estimated parameter over the plant's own",
        ),
        **GAIT,
    }

    kind: Literal["track-predictive"]
    want: Annotated[
        tuple[Literal["predictive", "estimates"], ...],
        says(
            "",
            "`predictive`: errors in time, costs on all plants, time that decisions take; "
            "`estimates`: estimated parameters over the plants' own",
        ),
    ] = ()
    worm: Annotated[ChainTable, says("", "the worm as it is believed, without `random`")]
    start: Annotated[Start, says("", "where it starts")] = field(default_factory=Start)
    reference: Annotated[Reference, says("", "what its links shall do")]
    tube: Annotated[TubeTable, says("", "tube by which all are judged")]
    predictive: Annotated[PredictiveTable, says("", "how decisions are made")]
    estimation: Annotated[
        EstimationTable | None, says("", "what is learnt on the way; nothing if left out")
    ] = None
    plants: Annotated[
        PlantsTable | None, says("", "plants that are not as believed; none if left out")
    ] = None
    time: Horizon
    tolerance: Annotated[ToleranceTable, says("", "of the simulations")] = field(
        default_factory=ToleranceTable
    )

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows; `folder` is the scene's."""
        yield from super().faults(folder)
        links = self.worm.links
        yield from self.worm.faults(self.time.end, self.units)
        yield from self.start.faults(links)
        yield from self.reference.gait.faults(links, folder, "reference.gait")
        yield from self.predictive.faults(self.time.end, self.units)
        if self.estimation is not None:
            yield from self.estimation.faults(self.worm)
        if self.worm.random is not None:
            yield "worm.random", "plants vary by [plants] here; leave the table out"
        if self.worm.slope:
            yield "worm.slope", "masses are drawn here, their weights are not; write worm.load"
        if not all(isinstance(each, CoulombFriction) for each in self.worm.ground):
            yield "worm.friction", 'is compared with kind = "coulomb"'
        if self.tube.capture >= self.time.end:
            yield "tube.capture", f"is not before time.end = {self.time.end:g}; write less"
