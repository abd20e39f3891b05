"""Kind "track-optimal": the input with which the links of a chain follow a gait best."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import Any, ClassVar

from wormopt.errors import Fault
from wormopt.quantities import Scalar
from wormopt.result import NOT_RECHECKED, Check
from wormopt.study import (
    arrays,
    attributes,
    check,
    checks,
    entry,
    facts,
    on_use,
    scalar,
    scalars,
    stage,
    warnings,
)
from wormopt.study.numerics import ToleranceTable
from wormopt.systems.chain.tables import (
    Grid,
    LeastError,
    LeastInput,
    Relaxation,
    Tube,
)
from wormopt.systems.chain.tracking import Tracking
from wormopt.systems.shared.declared import (
    CHAIN,
    GAIT,
    JUDGED,
    LOOP_SIGNALS,
    REFERENCE,
    TIME,
    TRACKER_EVENTS,
    gait_arrays,
    over,
)

with on_use():
    import numpy as np

    from wormopt.control.drive import drive
    from wormopt.control.loop import with_reference
    from wormopt.model.model import Model
    from wormopt.model.values import nominal_of
    from wormopt.ocp.optimise import Optimum
    from wormopt.simulation.options import Exact
    from wormopt.simulation.trajectory import Trajectory
    from wormopt.systems.chain.measured import (
        Balance,
        balance,
        chain_checks,
        judged,
        judged_numbers,
        signals_of,
    )
    from wormopt.systems.chain.optimal_tracking import optimal_input
    from wormopt.systems.shared.optimum import statistics
    from wormopt.systems.shared.proof import CrossCheck, accepted_error, cross_check
    from wormopt.systems.shared.signals import (
        event_arrays,
        fitted,
        sample,
        simulate_whole,
    )

_NUMBERS = JUDGED | {name: declared for name, declared in CHAIN.items() if name != "recheck_error"}
_OF_LOOP = {
    name: declared for name, declared in LOOP_SIGNALS.items() if name not in ("gain", "funnel")
}
_SIGNALS = TIME | REFERENCE | over(_OF_LOOP, "tracker") | TRACKER_EVENTS | GAIT
# Largest accepted difference of any state, at any time, between the optimiser's motion and the
# exact simulation of its input. In open loop, errors of the grid add up.
_ACCEPTED = 0.05


class TrackOptimal(Tracking, kind="track-optimal"):
    """Compute the optimal input that keeps a chain on a gait, checked by simulation.

    The optimiser treats contact as a complementarity condition on a fixed grid; an exact simulation
    repeats the motion found, in open loop. The first guess is a simulated LQR with feed-forward.
    `[model]` is a plant of your own in place of the chain; it needs linear equations between its
    input and output, but for contacts, for the LQR. Not allowed: `tube.capture` not before the
    end. If no motion stays in the tube, the exit code is 3 and the message names the tube.

    All scalars except `objective_found` come from the exact simulation. At rest, `contact_force` is
    the force that holds the mass. `event_kind` counts from 0: reversal, stick, release, impact,
    switch (a crossing of the tube). In the trust report, `replay` is the difference between
    optimiser and simulation, and `recheck` is the second route of the simulation.
    """

    pictures: ClassVar = {
        "trackers": "lengths with the *λ*-strip, error, input, motion",
        "motion": "paths with time upward, thick where a mass rests",
        "animation": ("the moving worms, as a GIF", "wormopt.pictures.worms:animation"),
    }
    refuses: ClassVar = {
        "worm.random": "is not allowed, since an optimal input belongs to a single chain; leave "
        "the table out"
    }
    headline: ClassVar = (
        "objective",
        "capture_time",
        "time_outside_tube",
        "error_peak",
        "input_rms",
        "distance",
    )

    tube: Tube = entry("tube around the reference")
    objective: LeastError | LeastInput = entry("minimised quantity")
    mesh: Grid = entry("mesh of the optimiser", default=Grid)
    relaxation: Relaxation = entry("relaxation of contact in the optimiser", default=Relaxation)
    tolerance: ToleranceTable = entry("tolerance of the exact simulation", default=ToleranceTable)

    def faults_of_keys(self) -> Iterator[Fault]:
        yield from super().faults_of_keys()
        yield from self.tube.faults_in(self.time.end)

    # -- computing ---------------------------------------------------------------------------------

    @stage
    def optimum(self) -> Optimum:
        with np.errstate(all="ignore"):  # values that are not finite are checked elsewhere
            return optimal_input(
                self.plant,
                self.followed,
                self.time.end,
                self.objective,
                self.tube,
                self.mesh,
                self.relaxation,
                period=self.gait.period,
                report=lambda text, fraction: self.report(f"optimising, {text}", fraction),
            )

    @cached_property
    def driven(self) -> Model:
        """The plant with the optimal input over time."""
        return drive(with_reference(self.plant, self.followed), self.optimum.motion.input_course())

    @stage
    def motion(self) -> Trajectory:
        span, measured = self.time, judged(self.driven, self.tube)
        return simulate_whole(
            measured,
            span.end,
            span.samples,
            Exact(),
            self.tolerance.options,
            lambda _, fraction: self.report("simulating", fraction),
        )

    @stage
    def recheck(self) -> CrossCheck | None:
        again = self.tolerance.recheck
        return cross_check(
            self.driven, self.motion, self.tolerance.options, recheck=again, report=self.report
        )

    # -- results -----------------------------------------------------------------------------------

    @scalars(_NUMBERS)
    def numbers(self) -> dict[str, Any]:
        return judged_numbers(self.motion, self.tube)

    @scalar(
        "length_squared_time",
        'objective of the exact simulation; its unit is force² time with `minimise = "input"`',
        name="objective",
    )
    def reached(self) -> Scalar:
        missed, spent = self.numbers["error_integral"], self.numbers["input_integral"]
        if isinstance(self.objective, LeastError):
            return self._objective(missed + self.objective.input_weight * spent)
        return self._objective(spent)

    @scalar("length_squared_time", "objective of the optimiser")
    def objective_found(self) -> Scalar:
        return self._objective(self.optimum.objective)

    def _objective(self, value: float) -> Scalar:
        squares = isinstance(self.objective, LeastError)
        return Scalar(value, self.unit_in_results("length_squared_time" if squares else "effort"))

    @scalar("count", "iterations of the optimiser, over all solves")
    def solve_iterations(self) -> int:
        return self.optimum.iterations

    @scalar(
        "share",
        "largest difference of any state at any sample between optimiser and exact "
        "simulation, relative to the larger of its size and its usual size; up to 0.05 is "
        "accepted",
    )
    def recheck_error(self) -> float:
        exact = self.motion.states[: self.driven.n_x]
        sizes = np.maximum(nominal_of(self.driven.x)[:, None], np.abs(exact))
        apart = np.abs(self.optimum.motion.states(self.motion.time) - exact) / sizes
        return float(apart.max())

    @arrays(_SIGNALS)
    def signals(self) -> dict[str, Any]:
        motion = self.motion
        model = motion.system.model
        expressions = signals_of(model) | {"error_norm": model["error_norm"]}
        found = {name: values[None] for name, values in sample(motion, expressions).items()}
        found["tube"] = np.full((1, 1, len(motion.time)), self.tube.radius)
        return {
            **self.own_arrays([motion], "tracker"),
            "time": motion.time,
            "reference": motion["reference"],
            **fitted(found, _SIGNALS),
            **event_arrays([motion], several=True),
            **gait_arrays(self.gait),
        }

    @attributes
    def labels(self) -> dict[str, Any]:
        return {"trackers": ["optimal input"]}

    # -- the trust report --------------------------------------------------------------------------

    @cached_property
    def energies(self) -> Balance | None:
        """Energy balance of the simulation."""
        return balance(self.motion)

    @checks
    def simulation(self) -> Iterator[Check]:
        yield from chain_checks(self.recheck, self.energies, self.tolerance.options)

    @check(
        _ACCEPTED,
        "the exact simulation of the input found ends elsewhere, by {value:.2g} of the states' "
        "size, where {limit:.2g} is accepted; write more mesh.arcs, or a smaller relaxation.last",
        name="exact_simulation_of_the_input_found",
    )
    def replay(self) -> float:
        return self.recheck_error

    @warnings
    def doubts(self) -> Iterator[str]:
        if self.recheck is None:
            yield NOT_RECHECKED
        outside, peak = self.numbers["time_outside_tube"], self.numbers["error_peak"]
        if isinstance(self.objective, LeastInput) and outside > 0:
            yield (
                f"in the exact simulation the error is outside the tube for {outside:.3g} in "
                f"total, and reaches {peak:.6g}; write more mesh.arcs or a larger objective.margin"
            )

    @facts
    def solutions(self) -> dict[str, Any]:
        optimum, second, energy = self.optimum, self.recheck, self.energies
        return {
            "treatment": "complementarity in the optimiser, exact in the simulation",
            "complementarity_max": optimum.complementarity,
            "defect_max": float(optimum.defects.max()),
            "replay": {"error": self.recheck_error, "accepted": _ACCEPTED},
            "recheck": second and second.facts,
            "energy_balance": energy and energy.residual,
            "accepted_energy": accepted_error(self.tolerance.options),
            "solves": statistics(optimum),
        }
