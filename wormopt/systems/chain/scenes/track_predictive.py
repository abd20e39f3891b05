"""Tables of scenes of kind "track-predictive": links that follow a gait by predictive control."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar, Literal

from wormopt.errors import Fault
from wormopt.study.given import entry
from wormopt.study.numerics import Horizon, Start, ToleranceTable
from wormopt.study.types import SceneTable
from wormopt.systems.chain.scenes.predictive import (
    EstimationTable,
    PlantsTable,
    PredictiveTable,
)
from wormopt.systems.chain.tables import ChainTable, CoulombFriction, Reference, TubeTable
from wormopt.systems.shared.declared import GAIT, JUDGED, LOOP_SIGNALS, TIME, over

SHOWN = ("error_norm", "length", "input", "position")
"""Signals that are kept of every controller."""


class TrackPredictiveScene(SceneTable):
    """Predictive control of a chain, compared with the open-loop optimum and LQR.

    The optimal motion over the whole time is planned with the smooth friction law, with one arc per
    decision, and applied in open loop. The predictive controller makes a new plan at every decision
    from the measured state. In real time it makes one step of sequential quadratic programming from
    the previous plan; the converged controller iterates until the steps end. The chain is simulated
    exactly between decisions. All decisions are then simulated again as one motion, from which all
    results come. Decisions take no time in the simulation; their duration on this machine is
    measured and compared with their period.

    Each controller is applied to the nominal plant and, except for the converged one, to the plants
    of `[plants]`, which it does not know. `[estimation]` adds a real-time controller that estimates
    their parameters during the motion. The controller "plant known" plans with the true parameters.

    If the plant has the same smooth law as the controller's model, the controller must match the
    open loop to 1e-6 of its cost: check `as good as the open loop`. Not allowed: friction other
    than `coulomb` tables; `worm.random`.

    Attributes: `controllers`, `parameters` (estimated, by name and number), and `table`, the text
    of `table.md`. Scalars that are lists have an entry for each controller.
    """

    headline: ClassVar = ("cost", "excess", "decision_median", "decision_period", "distance")
    scalars: ClassVar = JUDGED | {
        "tube_radius": ("length", "*λ*"),
        "cost": ("length_squared_time", "∫(|*e*|² + *ρ*|*u*|²) d*t* of the exact simulation"),
        "objective_found": ("length_squared_time", "∫(|*e*|² + *ρ*|*u*|²) d*t* of the plan"),
        "plan_steps": ("count", "steps of sequential quadratic programming for the plan"),
        "right_cost": (
            "length_squared_time",
            "cost on a plant with the smooth friction law of the model: open loop, in real time, "
            "converged",
        ),
        "excess": ("share", "relative excess of the larger of the last two costs over the first"),
        "decisions": ("count", "decisions in each motion"),
        "decisions_unsolved": (
            "count",
            "decisions whose quadratic program failed; the previous plan continues",
        ),
        "decision_period": (
            "s",
            "shortest time between decisions, converted by `predictive.seconds`",
        ),
        "decision_median": (
            "s",
            "median duration of a decision on this machine, with estimation, for the nominal plant",
        ),
        "decision_most": ("s", "95 % quantile of the same"),
        "decision_worst": ("s", "maximum of the same"),
        "decision_processor": (
            "s",
            "median processor time of a decision: its cost on a machine without other load",
        ),
        "decision_steps": ("count", "mean number of solver steps per decision"),
        "parameter_error": (
            "share",
            "error of the estimated parameters of the plants, root mean square of the logarithms: "
            "a list for each of `estimation.parameters`, before estimation and at the end",
        ),
        "recheck_error": (
            "share",
            "error of the second route, largest over the controllers without gains",
        ),
    }
    variables: ClassVar = {
        **TIME,
        "reference": ("length", ("link", "time"), "reference of the link length"),
        **over({name: LOOP_SIGNALS[name] for name in SHOWN}, "controller"),
        "decision_time": ("time", ("decision",), "time of the decision"),
        "decision_seconds": (
            "s",
            ("controller", "decision"),
            "wall-clock duration of the decision",
        ),
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
            "estimated parameter over the plant's true value",
        ),
        **GAIT,
    }

    kind: Literal["track-predictive"]
    want: tuple[Literal["predictive", "estimates"], ...] = entry(
        "`predictive`: error over time, costs on all plants, duration of decisions; "
        "`estimates`: estimated parameters over the plants' true values",
        default=(),
    )
    worm: ChainTable = entry("the nominal chain, without `random`")
    start: Start = entry("initial state", default=Start)
    reference: Reference = entry("reference of the links")
    tube: TubeTable = entry("tube that all controllers are judged by")
    predictive: PredictiveTable = entry("predictive controller")
    estimation: EstimationTable | None = entry(
        "estimation of parameters during the motion; default: none", default=None
    )
    plants: PlantsTable | None = entry("plants with drawn parameters; default: none", default=None)
    time: Horizon
    tolerance: ToleranceTable = entry("tolerance of the simulations", default=ToleranceTable)

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
            yield (
                "worm.random",
                "is not allowed, since [plants] varies the plants; leave the table out",
            )
        if self.worm.slope:
            yield (
                "worm.slope",
                "is not allowed, since drawn masses would change the weights; write worm.load",
            )
        if not all(isinstance(each, CoulombFriction) for each in self.worm.ground):
            yield "worm.friction", 'is not supported; write tables with kind = "coulomb"'
        if self.tube.capture >= self.time.end:
            yield "tube.capture", f"is not before time.end = {self.time.end:g}; write less"
