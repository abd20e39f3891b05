"""Kind "capsule": a capsule on rough ground, driven by an internal mass, and its optimal cycle."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

from wormopt.study import Given, entry, number, on_use, parts, positive, scalar, signal
from wormopt.systems.shared.optimal_motion import OptimalMotion

with on_use():
    import casadi as ca
    import numpy as np

    from wormopt.model.model import Model
    from wormopt.model.modes import ModeSequence
    from wormopt.numerics.collocation import Collocation
    from wormopt.ocp.contact import FixedModes
    from wormopt.ocp.mesh import Mesh
    from wormopt.ocp.motion import Guess
    from wormopt.ocp.nlp import Ipopt
    from wormopt.ocp.optimise import Optimum, optimise
    from wormopt.ocp.problem import Constraint, Ends, Problem
    from wormopt.systems.swinging.internal_mass import capsule


class CapsuleTable(Given):
    """A capsule with a mass inside."""

    share: float = number("share", "inner mass over total mass", above=0, below=1)
    friction: float = positive(
        "acceleration", "dry friction per total mass, equal in both directions"
    )
    stroke: float = positive("length", "displacement of the inner mass")

    @property
    def slow(self) -> float:
        """Usual duration of a cycle."""
        return 2 * math.sqrt(self.share * self.stroke / self.friction)

    def problem(self) -> Problem:
        """Optimal-control problem: the mean speed of a periodic cycle.

        Relative acceleration is by impulses only. The momentum is 0 at the cycle's ends: the body
        is at rest where the inner mass is.
        """
        model, slow = self._coasting(), self.slow
        ends = Ends.of(model)
        sizes = [signal.nominal for signal in model.x]
        return Problem(
            model,
            ends,
            -(ends.end[0] - ends.start[0]) / ends.duration,
            (1e-3 * slow, 10 * slow),
            periodic=["velocity", "inner_position", "inner_velocity"],
            boundary_constraints=[
                Constraint("start", ends.start[0], 0.0, 0.0, sizes[0]),
                Constraint("inner start", ends.start[2], 0.0, 0.0, sizes[2]),
                Constraint("momentum", ends.end[1] + self.share * ends.end[3], 0.0, 0.0, sizes[1]),
            ],
            impulses=True,
            nominal=self.share * self.stroke / slow,
        )

    def _coasting(self) -> Model:
        """Model whose only inputs are impulses."""
        model = capsule(share=self.share, friction=self.friction, stroke=self.stroke)
        return replace(model, u=[replace(signal, lower=0.0, upper=0.0) for signal in model.u])

    def guess(self) -> Guess:
        """First guess: to and fro at constant relative velocity."""
        duration, stroke = self.slow, self.stroke
        inner = 2 * stroke / duration
        speed = self.share * inner / 2

        def states(t: np.ndarray) -> np.ndarray:
            sign = np.where(t < duration / 2, 1, -1)
            inside = stroke - inner * np.abs(t - duration / 2)
            return np.vstack([0 * t, -speed * sign, inside, inner * sign])

        return Guess(duration, states)


@dataclass(frozen=True)
class Signals:
    """Motion of the capsule over a cycle."""

    instant: np.ndarray = signal("time", "instant", "time")
    position: np.ndarray = signal("length", "instant", "position of the body")
    velocity: np.ndarray = signal("speed", "instant", "velocity of the body")
    inner_position: np.ndarray = signal(
        "length", "instant", "position of the inner mass in the body"
    )
    inner_velocity: np.ndarray = signal(
        "speed", "instant", "velocity of the inner mass relative to the body"
    )
    contact_force: np.ndarray = signal(
        "acceleration", "instant", "force of the ground per total mass"
    )


class Capsule(OptimalMotion, kind="capsule"):
    """Optimise the cycle of a capsule driven by an internal mass.

    The inner mass has the relative velocities *u*<sub>1</sub> and −*u*<sub>2</sub> in turn, changed
    by impulses. The body is at rest at both ends of a cycle. The optimum is known in closed form.
    The arrays contain the instants at which arcs join twice.
    """

    pictures: ClassVar = {
        "signals": ("signals over time", "wormopt.systems.chain.pictures:signals"),
        "animation": ("both masses, as a moving GIF", "wormopt.pictures.worms:animation"),
    }

    capsule: CapsuleTable = entry("the capsule")

    def solve(self) -> dict[str, Optimum]:
        """Solve with the known phases: the body slides back, then forward."""
        found = optimise(
            self.capsule.problem(),
            Mesh.even(2, 1, Collocation(2)),
            FixedModes(ModeSequence(((-1,), (1,)))),
            self.capsule.guess(),
            solver=Ipopt(tolerance=1e-10),
            report=self.report,
        )
        return {"phases": found}

    def expressions(self) -> Mapping[str, ca.SX]:
        model = self.motion.program.problem.model
        names = ("position", "velocity", "inner_position", "inner_velocity")
        return {**{name: model[name] for name in names}, "contact_force": model.forces}

    @parts(Signals)
    def signals(self) -> Signals:
        return Signals(**self.sampled)

    @scalar("speed", "mean speed", headline=True)
    def speed(self) -> float:
        return -self.optimum.objective

    @scalar("speed", "relative velocities *u*<sub>1</sub>, −*u*<sub>2</sub>", headline=True)
    def inner_speeds(self) -> np.ndarray:
        return self.motion.arcs.start[self.motion.program.rows_of("inner_velocity")[0]]
