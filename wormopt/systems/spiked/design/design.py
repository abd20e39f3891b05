"""A designed gait with what is known of its quality."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from wormopt.model.gait import Gait
from wormopt.systems.spiked.crawl import Crawl, crawl
from wormopt.systems.spiked.search.search import Survey
from wormopt.systems.spiked.search.sequences import Sequence_, lasting
from wormopt.systems.spiked.search.trial import Trial
from wormopt.systems.spiked.task import Cost, Task
from wormopt.systems.spiked.verify import violations


@dataclass(frozen=True, eq=False)
class Design:
    """A designed gait with what is known of its quality.

    Parameters
    ----------
    task : Task
        What was asked for.
    gait : Gait
        One cycle of the gait.
    cycles : int
        How many such cycles fill the period.
    sequence : tuple of tuple of int
        Resting masses of a cycle, phase after phase.
    durations : tuple of float
        How long each phase is.
    ceiling : float
        Bound on the speed by rates and resting masses alone, for any gait.
    error : float
        Relative gain in the objective that the last halving of every arc brought.
    survey : Survey
        What was searched.
    solver : mapping
        How the last program ended: violation, arcs, degree and the like.
    timings_s : dict of str to float
        Seconds of each stage.
    ended : str
        "searched"; or "time limit" or "interrupted", where the search was cut short.
    trial : Trial, optional
        The last program, from which multipliers are taken; None for smooth costs.

    Examples
    --------
    >>> from wormopt.systems.spiked.limits import Limits
    >>> from wormopt.systems.spiked.task import Worm
    >>> from wormopt.systems.spiked.design.optimize import design
    >>> worm = Worm(links=1, load=5.0)
    >>> limits = Limits(period=1.0, length=(0.7, 1.3), rate=1.0, acceleration=20.0)
    >>> found = design(worm, limits)
    >>> round(found.speed, 9), found.sequence, max(found.violations.values()) < 1e-9
    (0.425, ((0,), (1,)), True)
    """

    task: Task
    gait: Gait = field(repr=False)
    cycles: int
    sequence: Sequence_
    durations: tuple[float, ...]
    ceiling: float
    error: float
    survey: Survey = field(repr=False)
    solver: dict[str, Any] = field(repr=False)
    timings_s: dict[str, float]
    ended: str = "searched"
    trial: Trial | None = field(default=None, repr=False)

    @cached_property
    def motion(self) -> Crawl:
        """How the worm crawls with it, in closed form; under the largest load of a range."""
        return self.motion_under(self.task.worm.load_range[1])

    def motion_under(self, load: float) -> Crawl:
        """How the worm crawls with it under some load.

        Parameters
        ----------
        load : float
            On each mass.
        """
        worm, limits = self.task.worm, self.task.limits
        return crawl(self.gait, worm.masses, worm.drag, load, limits.sharing, limits.spike_load)

    @property
    def speed(self) -> float:
        """Mean speed."""
        return self.motion.speed

    @property
    def period(self) -> float:
        """Period of all cycles together; ``gait`` is one of them."""
        return self.cycles * self.gait.period

    @property
    def value(self) -> float:
        """The objective as it was optimised: the speed, or a cost."""
        if self.trial is None:
            return objective_of(self.motion, self.task.objective.minimise)
        return abs(self.trial.value)

    @cached_property
    def violations(self) -> dict[str, float]:
        """Excess over each limit by its size, negative where there is room to spare.

        The worst of a load range's ends and middle.
        """
        low, high = self.task.worm.load_range
        loads = [low] if low == high else [low, (low + high) / 2, high]
        found = [
            violations(self.motion_under(load), self.task.limits, self.cycles) for load in loads
        ]
        return {key: max(excess[key] for excess in found) for key in found[0]}


def objective_of(motion: Crawl, minimise: Cost | None) -> float:
    """Speed of a motion, or the cost `minimise` if one is given."""
    match minimise:
        case None:
            return motion.speed
        case "peak_spike_load":
            return float(motion.extremes("reaction")[1].max())
        case "peak_actuator_force":
            return max(float(abs(v).max()) for v in motion.extremes("actuator_force"))
        case "energy_per_distance":
            return motion.energy / motion.advance if motion.advance else math.inf
        case "acceleration_effort":
            return motion.effort


def of_trial(
    task: Task, trial: Trial, error: float, ceiling: float, survey: Survey, ended: str
) -> Design:
    """Make a design of a trial as it is; the other parameters are those of `Design`."""
    sequence, durations = lasting(trial.sequence, trial.durations.tolist())
    return Design(
        task=task,
        gait=trial.program.gait(trial.point),
        cycles=trial.cycles,
        sequence=sequence,
        durations=durations,
        ceiling=ceiling,
        error=error,
        survey=survey,
        solver={
            "status": "solved" if ended == "searched" else "cut short",
            "violation": trial.program.bilinear.violation(trial.point.x),
            "arcs_per_phase": trial.program.arcs.tolist(),
            "degree": trial.program.degree + 1,
        },
        timings_s={},
        ended=ended,
        trial=None if task.objective.is_smooth else trial,
    )
