"""One order of rest tried: its best cycle found so far, and how often it fits into a period."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import ceil, floor

import numpy as np

from wormopt.core.task import Objective, Task
from wormopt.gaits.program import GaitProgram
from wormopt.gaits.sequences import Sequence_
from wormopt.optimal.bilinear import Climb, Point

__all__ = ["Trial", "Trier"]

Stop = Callable[[], bool]


@dataclass(frozen=True, eq=False)
class Trial:
    """A gait found for an order of rest.

    Parameters
    ----------
    program : GaitProgram
        The program of one cycle.
    point : Point
        What was found.
    cycles : int
        How many such cycles fill a period; 0 where it has not been fitted to one.
    level : int
        How often its arcs have been halved.
    """

    program: GaitProgram
    point: Point
    cycles: int = 0
    level: int = 0

    @property
    def sequence(self) -> Sequence_:
        """Resting masses of a cycle, phase after phase."""
        return self.program.sequence

    @property
    def value(self) -> float:
        """What is made large: the speed, or a cost with its sign changed."""
        return self.program.objective(self.point)

    @property
    def durations(self) -> np.ndarray:
        """Durations of the phases of a cycle."""
        return self.program.durations(self.point)


class Trier:
    """Tries orders of rest of one task.

    Parameters
    ----------
    task : Task
        Worm, limits, objective.
    arcs : int, optional
        Arcs per phase at level 0.
    stop : callable, optional
        Whether to give up; asked after every step of a climb.
    """

    def __init__(self, task: Task, arcs: int = 4, stop: Stop = lambda: False) -> None:
        self.task, self._arcs, self._stop = task, arcs, stop
        self.shortest, self.longest = task.limits.period_range

    def phase_guess(self) -> float:
        """Duration of a phase to begin with: half a stroke at the slower rate."""
        links = self.task.worm.links
        rates = np.min(self.task.limits.rate_bounds(links), axis=0)
        strokes = np.ptp(self.task.limits.length_ranges(links), axis=1)
        return float(np.median(strokes / rates)) / 2

    def free(
        self,
        sequence: Sequence_,
        durations: np.ndarray | None = None,
        enough: float = -np.inf,
    ) -> Trial | None:
        """Climb with a free period, as short as may be, up to the longest.

        Parameters
        ----------
        sequence : tuple of tuple of int
            Resting masses, phase after phase.
        durations : ndarray, optional
            Of the phases, to begin with.
        enough : float, optional
            Give up where this value seems out of reach.

        Returns
        -------
        Trial or None
            None where no gait of this order meets the limits.
        """
        if durations is None:
            durations = np.full(len(sequence), self.phase_guess())
        longest = min(self.longest, _LONGEST * float(durations.sum()))
        durations = durations * min(1.0, longest / durations.sum())
        return self._climb(sequence, (_SHORTEST * longest, longest), durations, enough)

    def fit(self, trial: Trial) -> Trial | None:
        """The best whole number of cycles in a period.

        Parameters
        ----------
        trial : Trial
            With a free period.

        Returns
        -------
        Trial or None
            None where no number of cycles has a gait.
        """
        period = float(trial.durations.sum())
        counts = {floor(self.longest / period * _UP), ceil(self.shortest / period / _UP)}
        fitted = [self._fitted(trial, max(1, count)) for count in sorted(counts)]
        return max((t for t in fitted if t is not None), key=lambda t: t.value, default=None)

    def _fitted(self, trial: Trial, cycles: int) -> Trial | None:
        low, high = self.shortest / cycles, self.longest / cycles
        period = float(trial.durations.sum())
        wanted = float(np.clip(period, low, high))
        program = GaitProgram(
            self.task, trial.sequence, (low, high), trial.program.arcs, trial.program.degree
        )
        start = program.start_arcs(trial.program.widths(trial.point) * (wanted / period))
        return start and self.climbed(Trial(program, start, cycles, trial.level))

    def _climb(
        self,
        sequence: Sequence_,
        period: tuple[float, float],
        durations: np.ndarray,
        enough: float,
    ) -> Trial | None:
        program = GaitProgram(self.task, sequence, period, self._arcs)
        if self.task.objective.speed is None:
            start = program.start(durations)
            return start and self.climbed(Trial(program, start), enough=enough)
        return self._climb_cost(program, durations, enough)

    def _climb_cost(
        self, program: GaitProgram, durations: np.ndarray, enough: float
    ) -> Trial | None:
        """Climb to the required speed first, then down the cost."""
        required = self.task.objective.speed or 0.0
        fastest = Task(self.task.worm, self.task.limits, Objective())
        fast = GaitProgram(fastest, program.sequence, program.period, self._arcs)
        start = fast.start(durations)
        if start is None:
            return None
        reached = fast.bilinear.climb(
            start, Climb(1e-4), lambda p: self._stop() or fast.objective(p) >= 1.02 * required
        )
        begin = program.start_arcs(fast.widths(reached))
        return begin and self.climbed(Trial(program, begin), enough=enough)

    def climbed(
        self, trial: Trial, tolerance: float = 1e-3, steps: int = 25, enough: float = -np.inf
    ) -> Trial:
        """Climb on from where a trial is.

        Parameters
        ----------
        trial : Trial
            Where to begin.
        tolerance, steps, enough : float, int, float
            See `Climb`; ``enough`` in the task's units.

        Returns
        -------
        Trial
            Never worse.
        """
        until = Climb(tolerance, steps, enough=enough / trial.program.unit)
        point = trial.program.bilinear.climb(trial.point, until, lambda _: self._stop())
        return replace(trial, point=point)

    def finer(self, trial: Trial, tolerance: float = 1e-4, degree: int | None = None) -> Trial:
        """Halve the arcs and climb on; never worse.

        Parameters
        ----------
        trial : Trial
            Where to begin.
        tolerance : float, optional
            See `Climb`.
        degree : int, optional
            Degree of the velocities on an arc; as it is if left out.
        """
        program, start = trial.program.finer(trial.point, degree)
        level = trial.level + 1
        if start is None:
            return replace(trial, level=level)
        better = self.climbed(Trial(program, start, trial.cycles, level), tolerance, 40)
        return better if better.value >= trial.value else replace(trial, level=level)


_UP = 1 + 1e-9
# A free period is no longer than so many times the first guess, and no shorter than this share.
_LONGEST, _SHORTEST = 20.0, 1e-4
