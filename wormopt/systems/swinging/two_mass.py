"""Kind "two-mass": two masses on rough ground that push each other, and their best cycle."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from wormopt.errors import Fault
from wormopt.study import Given, entry, on_use, parts, positive, scalar, signal
from wormopt.study.types import wrong_order
from wormopt.systems.shared.optimal_motion import OptimalMotion

with on_use():
    import casadi as ca
    import numpy as np

    from wormopt.model.model import Signal
    from wormopt.model.modes import ModeSequence
    from wormopt.numerics.collocation import Collocation
    from wormopt.ocp.contact import FixedModes
    from wormopt.ocp.mesh import Mesh
    from wormopt.ocp.motion import Guess
    from wormopt.ocp.nlp import Ipopt
    from wormopt.ocp.optimise import Optimum, optimise
    from wormopt.ocp.problem import Constraint, Ends, Problem
    from wormopt.systems.swinging.internal_mass import pair


class Pair(Given):
    """Two masses on rough ground."""

    mass: float = positive("mass", "big mass", default=1.0)
    ratio: float | tuple[float, ...] = positive(
        "share",
        "small mass over big mass, below 1, fixed or a range",
        default=(0.01, 0.99),
        per="ends",
    )
    friction: float = positive("share", "coefficient of dry friction, equal in both directions")
    gravity: float = positive("acceleration", "gravitational acceleration", default=1.0)
    stroke: float = positive("length", "displacement of the small mass relative to the big one")

    @property
    def ratios(self) -> tuple[float, float]:
        """Smallest and largest ratio."""
        low, high = self.ratio if isinstance(self.ratio, tuple) else (self.ratio, self.ratio)
        return low, high

    def faults_of_keys(self) -> Iterator[Fault]:
        yield from wrong_order("ratio", self.ratios, may_be_equal=True)
        if self.ratios[1] >= 1:
            yield (
                "ratio",
                "is 1 or above, and then the big mass cannot hold the small one; write less than 1",
            )

    def advance(self, ratio: Any) -> Any:
        """Displacement of the big mass in the return, which conserves the zero momentum."""
        return self.stroke * ratio / (1 + ratio)

    @property
    def slow(self) -> float:
        """Usual duration of the slow stroke, with the heaviest small mass."""
        return 2 * math.sqrt(self.stroke * self.ratios[1] / (self.friction * self.gravity))

    def problem(self) -> Problem:
        """Optimal-control problem: the mean speed of a slow stroke and an instantaneous return.

        The problem covers the slow stroke; its mode keeps the big mass at rest.
        """
        ratio, (low, high), slow = ca.SX.sym("ratio"), self.ratios, self.slow
        model = pair(
            friction=self.friction,
            ratio=ratio,
            mass=self.mass,
            gravity=self.gravity,
            length_nominal=self.stroke,
        )
        ends, size = Ends.of(model), self.stroke
        return Problem(
            model,
            ends,
            -self.advance(ratio) / ends.duration,
            (
                1e-3 * slow,
                10 * slow / math.sqrt(1 - high**2),
            ),  # what presses with little more is slow
            boundary_constraints=[
                Constraint("start", ends.start[:2], 0.0, 0.0, size),
                Constraint("rest at the start", ends.start[3], 0.0, 0.0, model.x[1].nominal),
                Constraint("stroke", ends.end[1] - ends.end[0], size, size, size),
                Constraint("rest at the end", ends.end[3], 0.0, 0.0, model.x[1].nominal),
            ],
            design=[Signal("mass_ratio", ratio, "share", math.sqrt(low * high), low, high)],
            nominal=self.advance(high) / slow,
        )

    def guess(self) -> Guess:
        """First guess: a stroke at constant velocity."""
        speed = self.stroke / self.slow
        return Guess(self.slow, lambda t: np.vstack([0 * t, speed * t, 0 * t, 0 * t + speed]))


@dataclass(frozen=True)
class Signals:
    """Motion of the masses in the slow stroke."""

    instant: np.ndarray = signal("time", "instant", "time")
    position: np.ndarray = signal("length", "mass instant", "position of the mass")
    velocity: np.ndarray = signal("speed", "mass instant", "velocity of the mass")
    force: np.ndarray = signal("force", "instant", "force of the actuator")
    contact_share: np.ndarray = signal(
        "share", "mass instant", "force of the ground over the weight"
    )


class TwoMass(OptimalMotion, kind="two-mass"):
    """Optimise two masses on rough ground: slow stroke, fast return, best mass ratio.

    A mass that moves to and fro drives the worm. In the slow stroke of the small mass, the big mass
    is at rest. The return is instantaneous: momentum is conserved and friction has no effect. The
    optimum is known in closed form. Signals cover the slow stroke and contain the instants at which
    arcs join twice.
    """

    pictures: ClassVar = {
        "signals": ("signals over time", "wormopt.systems.chain.pictures:signals"),
    }

    pair: Pair = entry("the masses")

    def solve(self) -> dict[str, Optimum]:
        """Solve with the known phases: the small mass is driven forward, then braked."""
        found = optimise(
            self.pair.problem(),
            Mesh.even(2, 1, Collocation(2)),
            FixedModes(ModeSequence(((0, 1), (0, 1)))),
            self.pair.guess(),
            solver=Ipopt(tolerance=1e-10),
            report=self.report,
        )
        return {"phases": found}

    def expressions(self) -> Mapping[str, ca.SX]:
        model = self.motion.program.problem.model
        signals = {name: model[name] for name in ("position", "velocity", "force")}
        return {**signals, "contact_share": model.forces}

    @parts(Signals)
    def signals(self) -> Signals:
        return Signals(**self.sampled)

    @scalar("speed", "mean speed", headline=True)
    def speed(self) -> float:
        return -self.optimum.objective

    @scalar("length", "displacement in a cycle", headline=True)
    def advance(self) -> float:
        return self.pair.advance(self.mass_ratio)

    @scalar("share", "small mass over big mass", headline=True)
    def mass_ratio(self) -> float:
        return float(self.motion.arcs.design[0])
