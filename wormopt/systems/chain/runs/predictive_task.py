"""Task of a scene of predictive control, with a row for each controller."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from wormopt.control.drive import drive
from wormopt.control.loop import with_reference
from wormopt.control.lqr import lqr
from wormopt.control.predictive import MpcPlan
from wormopt.control.receding import MpcRun
from wormopt.control.reference import Reference
from wormopt.model.gait import Gait
from wormopt.model.model import Model
from wormopt.simulation.trajectory import Trajectory
from wormopt.study.scene import Scene
from wormopt.systems.chain.measured import judged, judged_numbers
from wormopt.systems.chain.scenes.track_predictive import TrackPredictiveScene
from wormopt.systems.shared.declared import JUDGED
from wormopt.systems.shared.proof import CrossCheck

OPEN, LQR = "open-loop optimum", "LQR, feed-forward"
REAL_TIME, CONVERGED, ADAPTED = "predictive, real time", "predictive, converged", "with estimation"
KNOWN = ("open-loop optimum, plant known", "predictive, real time, plant known")
"""Names of the controllers, for tables and pictures."""

LOST: dict[str, Any] = dict.fromkeys((*JUDGED, "cost"), np.nan)
"""Quantities of a motion that was given up."""


@dataclass(frozen=True, eq=False)
class Task:
    """Reference, cost and evaluation of the controllers."""

    scene: Scene[TrackPredictiveScene]
    gait: Gait
    plant: Model
    reference: Reference
    plan: MpcPlan

    def judged(self, course: Gait | None) -> Model:
        """Simulate and evaluate the worm with inputs over time, or with LQR."""
        if course is None:
            weight = 1 / self.scene.table.predictive.input_weight
            loop = lqr(self.plant, self.reference, error_weight=weight)
        else:
            loop = drive(with_reference(self.plant, self.reference), course)
        return judged(loop, self.scene.table.tube)

    def cost(self, numbers: Mapping[str, Any]) -> float:
        """Integral of |e|^2 + rho |u|^2."""
        weight = self.scene.table.predictive.input_weight
        return numbers["error_integral"] + weight * numbers["input_integral"]

    def told(self, motion: Trajectory) -> dict[str, Any]:
        """Quantities of a motion, with its cost."""
        numbers = judged_numbers(motion, self.scene.table.tube)
        return numbers | {"cost": self.cost(numbers)}


@dataclass(frozen=True, eq=False)
class Row:
    """One controller on the nominal plant and on the other plants."""

    name: str
    motion: Trajectory
    second: CrossCheck | None
    numbers: dict[str, Any]
    receded: MpcRun | None  # None for those that decide nothing
    drawn: list[dict[str, Any]] = field(default_factory=list)  # one for each plant
    learnt: list[MpcRun] = field(default_factory=list)  # decisions for each plant
