"""Base of studies whose result is an optimal motion, confirmed by simulating its inputs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar

from wormopt.errors import SolveError
from wormopt.result import Check
from wormopt.study import (
    Study,
    attributes,
    checks,
    facts,
    on_use,
    parts,
    scalar,
    stage,
    value,
    warnings,
)
from wormopt.study.numerics import MeshTable

with on_use():
    import casadi as ca
    import numpy as np

    from wormopt.ocp.motion import Motion
    from wormopt.ocp.optimise import Optimum
    from wormopt.simulation.options import Exact, Treatment
    from wormopt.systems.shared.optimum import (
        ACCEPTED,
        cross_check,
        in_keys,
        input_sizes,
        modes_of,
        optimum_facts,
        replay_check,
        sample_motion,
        warnings_of_optimum,
    )
    from wormopt.systems.shared.proof import CrossCheck


@dataclass(frozen=True)
class Solves:
    """Successive programs; the last one is the result."""

    motion: Motion  # of the last program; of a failed solve where it stopped
    optima: Mapping[str, Optimum] = field(default_factory=dict)

    @property
    def best(self) -> Optimum:
        """The result."""
        return [*self.optima.values()][-1]


@dataclass(frozen=True)
class OptimumNumbers:
    """Numbers of an optimal motion."""

    duration: float = value("time", "duration of the motion", name="time", headline=True)
    minimised: float = value(
        "speed", "value that was minimised; a speed is maximised as its negative",
        headline=True, name="objective",
    )  # fmt: skip
    input_rms: float | None = value(
        "force", "root mean square of \\|*u*\\| over time; unknown if inputs act by impulses"
    )
    input_peak: float | None = value(
        "force", "largest \\|*u*<sub>j</sub>\\|; unknown if inputs act by impulses"
    )
    defect_max: float = value(
        "share", "largest local error of an arc, relative to nominal sizes of states"
    )
    complementarity_max: float = value(
        "share",
        "largest product of a contact's velocity component and the distance of its force from "
        "sliding",
    )
    solve_iterations: int = value("count", "iterations of all solves together")
    n_phases: int = value(
        "count",
        "number of phases; a phase ends when a contact changes its mode, or an input reaches or "
        "leaves its limit",
    )
    mode_sequence: list[list[int]] = value(
        "count", "modes of all contacts in each phase (0 rests, +1 and −1 slide)"
    )
    phase_times: list[float] = value("time", "start times of the phases, and the end time")


def optimum_numbers(optima: Mapping[str, Optimum]) -> OptimumNumbers:
    """Numbers of successive programs; the last one is the result."""
    optimum = [*optima.values()][-1]
    modes, times = modes_of(optimum)
    rms, peak = input_sizes(optimum.motion)
    return OptimumNumbers(
        duration=optimum.motion.duration,
        minimised=optimum.objective,
        input_rms=rms,
        input_peak=peak,
        defect_max=float(optimum.defects.max()),
        complementarity_max=optimum.complementarity,
        solve_iterations=sum(one.iterations for one in optima.values()),
        n_phases=len(modes),
        mode_sequence=modes,
        phase_times=times,
    )


class OptimalMotion(Study):
    """An optimal motion: a kind gives `solve`, `expressions`, `defect` and its arrays."""

    keys_of_names: ClassVar[Mapping[str, str]] = {}
    """Keys of the scene by the names that the optimiser gives its bounds."""
    advice_by_code: ClassVar[Mapping[str, str]] = {}
    """What to write instead, by the code of the optimiser's failure, where its own is not fit."""

    # -- given by a kind --------------------------------------------------------------------------

    def solve(self) -> dict[str, Optimum]:
        """Solve the programs, by name and in their order; the last one is the result."""
        raise NotImplementedError

    def expressions(self) -> Mapping[str, ca.SX]:
        """Return the signals to sample and draw, as columns of the symbols of the problem."""
        raise NotImplementedError

    @property
    def defect(self) -> float:
        """Requested local error of an arc: that of the kind's mesh, if it has one."""
        mesh: MeshTable | None = getattr(self, "mesh", None)
        return mesh.tolerance if mesh else 1e-9

    @property
    def treatment(self) -> Treatment:
        """Treatment of contact in the simulation."""
        return Exact()

    @property
    def accepted(self) -> float:
        """Largest accepted difference between the ends of the optimum and of its simulation."""
        return ACCEPTED

    # -- computing ---------------------------------------------------------------------------------

    @stage
    def optimisation(self) -> Solves:
        try:
            with np.errstate(all="ignore"):  # values that are not finite are checked elsewhere
                optima = self.solve()
        except SolveError as error:
            found = Solves(error.partial) if isinstance(error.partial, Motion) else None
            raise in_keys(error, self.keys_of_names, self.advice_by_code, found) from None
        return Solves([*optima.values()][-1].motion, optima)

    @property
    def motion(self) -> Motion:
        """The optimal motion."""
        return self.optimisation.motion

    @property
    def optimum(self) -> Optimum:
        """Optimum of the last program."""
        return self.optimisation.best

    @stage
    def recheck(self) -> CrossCheck:
        with np.errstate(all="ignore"):
            return cross_check(
                self.motion, self.treatment, accepted=self.accepted, report=self.report
            )

    @cached_property
    def sampled(self) -> dict[str, np.ndarray]:
        """Samples of the signals by name, with their times as ``instant``."""
        return sample_motion(self.motion, self.expressions()).arrays(self.variables)

    # -- results -----------------------------------------------------------------------------------

    @parts(OptimumNumbers)
    def numbers(self) -> OptimumNumbers:
        return optimum_numbers(self.optimisation.optima)

    @scalar("share", "largest difference at the end from a simulation with the optimal inputs")
    def recheck_error(self) -> float | None:
        return self.recheck.error

    @attributes
    def drawn(self) -> dict[str, Sequence[str]]:
        model = self.motion.program.problem.model
        return {
            "contacts": [contact.name for contact in model.contacts],
            "signals": [*self.expressions()],
        }

    # -- the trust report --------------------------------------------------------------------------

    @checks
    def simulation(self) -> list[Check]:
        return [replay_check(self.recheck)]

    @warnings
    def of_optimum(self) -> Iterator[str]:
        return warnings_of_optimum(self.optimum, self.defect)

    @facts
    def solver(self) -> dict[str, Any]:
        return optimum_facts(self.optimisation.optima, self.recheck)
