"""Trials of an order of rest: the best cycle found so far, and its number in a period."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from math import ceil, floor
from time import monotonic
from typing import Any

import numpy as np

from wormopt.model.gait import Gait
from wormopt.numerics.bilinear import BilinearProgram, Climb, Point
from wormopt.systems.shared.sequences import Sequence_, wave_direction
from wormopt.systems.spiked.gait_problem import GaitProblem
from wormopt.systems.spiked.programs.gait_rows import split_matters
from wormopt.systems.spiked.programs.program import GaitProgram, WaveProgram


@dataclass(frozen=True, eq=False)
class Trial:
    """A gait found for one order of rest."""

    program: GaitProgram  # program of one cycle
    point: Point  # solution of the program
    cycles: int = 0  # number that fills a period; 0: not fitted yet
    level: int = 0  # number of halvings of the arcs

    @property
    def sequence(self) -> Sequence_:
        """Resting masses of a cycle, phase after phase."""
        return self.program.sequence

    @cached_property
    def value(self) -> float:
        """Maximised value: the speed, or a cost with its sign changed."""
        return self.program.objective(self.point)

    @cached_property
    def gait(self) -> Gait:
        """Link lengths over a cycle."""
        return self.program.gait(self.point)

    @property
    def cost(self) -> float:
        """The objective of the task: the speed, or the whole cost."""
        return abs(self.value) + self.program.same_for_all()

    @property
    def durations(self) -> np.ndarray:
        """Durations of the phases of a cycle."""
        return self.program.durations(self.point)


class Trier:
    """Tries orders of rest of one task.

    Climbs stop at the time `until` (monotonic clock) or after `work`, pivots × (rows + columns).
    """

    def __init__(self, task: GaitProblem, until: float = np.inf, work: float = np.inf) -> None:
        self.task, self._until, self._most = task, until, work
        self.programs = self.work = 0  # linear programs of all climbs; pivots × (rows + columns)
        self.shortest, self.longest = task.limits.period_range

    def stopped(self) -> bool:
        """Whether the time is over."""
        return monotonic() > self._until

    def phase_guess(self) -> float:
        """Initial duration of a phase: half a stroke at the slower rate."""
        links = self.task.worm.links
        rates = np.min(self.task.limits.rate_bounds(links), axis=0)
        strokes = np.ptp(self.task.limits.length_ranges(links), axis=1)
        return float(np.median(strokes / rates)) / 2

    def _arcs(self, sequence: Sequence_) -> int:
        """Arcs per phase of a first trial; few say too little about speeds and smooth costs."""
        if self.task.objective.minimise is None or self.task.objective.is_smooth:
            return _MOST_ARCS
        return max(_FEWEST_ARCS, min(_MOST_ARCS, _ARCS // len(sequence)))

    def program(
        self, sequence: Sequence_, period: tuple[float, float], arcs: Any, degree: int = 1
    ) -> GaitProgram:
        """The program of an order; that of a travelling wave if this would be large.

        `period`: shortest and longest cycle; `arcs` per phase; `degree` of velocities.
        """
        masses = self.task.worm.links + 1
        large = int(np.broadcast_to(arcs, len(sequence)).sum()) * 2 * masses > _LARGE
        kind = WaveProgram if large and wave_direction(sequence, masses) else GaitProgram
        return kind(self.task, sequence, period, arcs, degree)

    def free(
        self,
        sequence: Sequence_,
        durations: np.ndarray | None = None,
        enough: float = -np.inf,
        random: np.random.Generator | None = None,
        *,
        patient: bool = False,
    ) -> Trial | None:
        """Climb with a free period up to the longest; give up below `enough`.

        The start has phases of `durations`; `random` draws the arcs, equal by default. `patient`:
        a required speed is climbed to even if it seems out of reach.
        """
        if durations is None:
            durations = np.full(len(sequence), self.phase_guess())
        longest = min(self.longest, _LONGEST * float(durations.sum()))
        durations = durations * min(1.0, longest / durations.sum())
        period = (_SHORTEST * longest, longest)
        return self._climb(sequence, period, durations, enough, random, patient=patient)

    def freed(self, trial: Trial) -> Trial | None:
        """Continue a climb with a free period; None if the solver fails."""
        period = float(trial.durations.sum())
        program = trial.program.changed(period=(period / 2, min(self.longest, 2 * period)))
        start = self._near(trial, program, trial.program.widths(trial.point))
        return start and self.climbed(replace(trial, program=program, point=start), 1e-6, 40)

    def near(
        self, sequence: Sequence_, durations: np.ndarray, cycles: int, enough: float = -np.inf
    ) -> Trial | None:
        """Climb from durations near those of a gait whose `cycles` cycles fill a period."""
        total = float(durations.sum())
        period = self._cycle(cycles, total)
        durations = durations * (np.clip(total, *period) / total)
        trial = self._climb(sequence, period, durations, enough, None)
        return trial and self.settled(replace(trial, cycles=cycles))

    def fit(self, trial: Trial) -> Trial | None:
        """Fit a trial with a free period to the best number of cycles in a period.

        None if no number of cycles has a gait.
        """
        best = max(self.fits(trial), key=lambda t: t.value, default=None)
        if best is None or self.task.objective.speed is None:
            return best
        return self._fewer_cycles(best)

    def fits(self, trial: Trial) -> list[Trial]:
        """Fit a trial with a free period to the nearest numbers of cycles."""
        period = float(trial.durations.sum())
        counts = {max(1, ceil(self.shortest / period / UP))}
        if max(counts) * period > self.longest * UP:  # no whole number of cycles is in the range
            counts.add(max(1, floor(self.longest / period * UP)))
        fitted = [self.fitted(trial, count) for count in sorted(counts)]
        if not any(fitted) and self.task.objective.speed is not None:
            # the cheapest gait has no speed to spare: search for a fast one again
            fitted = [self.near(trial.sequence, trial.durations, count) for count in sorted(counts)]
        return [t for t in fitted if t is not None]

    def _fewer_cycles(self, best: Trial) -> Trial:
        """Use fewer cycles while this lowers the cost: climbs of costs end near their start."""
        while best.cycles > 1:
            fewer = [self.fitted(best, n) for n in sorted({best.cycles // 2, best.cycles - 1})]
            better = [t for t in fewer if t is not None and t.value > best.value]
            if not better:
                break
            best = max(better, key=lambda t: t.value)
        return best

    def fitted(self, trial: Trial, cycles: int) -> Trial | None:
        """Fit a trial to a number of cycles in a period; None if it has no gait."""
        if self.task.objective.is_smooth and trial.program.degree > 1:
            return None  # these costs take straight velocities
        period = float(trial.durations.sum())
        low, high = self._cycle(cycles, period)
        wanted = float(np.clip(period, low, high))
        program = trial.program.changed(task=self.task, period=(low, high), patterns=None)
        widths = trial.program.widths(trial.point) * (wanted / period)
        if self.task.objective.is_smooth:
            start = self._near(trial, program, widths)
        else:
            start = program.start_arcs(widths)
        if start is None:
            return None
        return self.settled(self.climbed(Trial(program, start, cycles, trial.level)))

    def _cycle(self, cycles: int, like: float) -> tuple[float, float]:
        """Shortest and longest cycle if `cycles` fill a period; at most some times `like`.

        Programs lose their digits where a period may be far longer than it is.
        """
        low, high = self.shortest / cycles, self.longest / cycles
        return low, max(low, min(high, _LONGEST * like))

    def with_the_motion(self, fast: Trial) -> Trial | None:
        """A trial of the cost that begins as a fast enough one; None if there is none so near."""
        if self.task.objective.is_smooth and fast.program.degree > 1:
            return None
        program, start = self._as_fast_as(fast)
        return start and self.settled(self.climbed(replace(fast, program=program, point=start)))

    def _near(self, trial: Trial, program: GaitProgram, widths: np.ndarray) -> Point | None:
        """A motion like that of a trial, with other durations."""
        _, v, first = trial.program.motion(trial.point)
        old, new = trial.program.limits.time, program.limits.time
        like = program.moving(widths / new, v, first * (old / new))
        found = (program.bilinear.restore(like.x, factors) for factors in _NEARNESS)
        return next((point for point in found if point is not None), None)

    def _climb(
        self,
        sequence: Sequence_,
        period: tuple[float, float],
        durations: np.ndarray,
        enough: float,
        random: np.random.Generator | None,
        *,
        patient: bool = False,
    ) -> Trial | None:
        required = self.task.objective.speed
        if required is None:
            program = self.program(sequence, period, self._arcs(sequence))
            begin = program.start(durations, random)
        else:
            fast = self._fast_enough(required, sequence, period, durations, random, patient=patient)
            if fast is None:
                return None
            program, begin = self._as_fast_as(fast)
        return begin and self.climbed(Trial(program, begin), enough=enough)

    def _as_fast_as(self, fast: Trial) -> tuple[GaitProgram, Point | None]:
        """The program of the cost for the arcs of a fast trial, and a start at their durations."""
        same = fast.program
        program = type(same)(self.task, same.sequence, same.period, same.arcs, same.degree)
        if self.task.objective.is_smooth:
            # a smooth cost needs the motion itself, which is feasible here too
            return program, program.moving(*same.motion(fast.point))
        return program, program.start_arcs(same.widths(fast.point))

    def _fast_enough(
        self,
        required: float,
        sequence: Sequence_,
        period: tuple[float, float],
        durations: np.ndarray,
        random: np.random.Generator | None,
        *,
        patient: bool,
    ) -> Trial | None:
        """Climb to the required speed; few arcs may just miss it where more reach it."""
        fastest = Trier(GaitProblem(self.task.worm, self.task.limits), self._until)
        fast = None
        for arcs in sorted({self._arcs(sequence), _MOST_ARCS}):  # few may be far too slow
            program = fastest.program(sequence, period, arcs)
            start = program.start(durations, random)
            if start is None:
                continue
            reach = -np.inf if patient else _NEARLY * required / program.unit
            until = Climb(1e-4, enough=reach)
            reached = program.bilinear.climb(
                start,
                until,
                lambda p, of=program: self.stopped() or of.objective(p) >= _AMPLY * required,
            )
            self._count(program.bilinear)
            fast = Trial(program, reached)
            if fast.value >= _NEARLY * required:
                break
        if fast is None:
            return None
        if not self.task.worm.drag or not _NEARLY * required <= fast.value < required:
            return fastest._as_fast(fast, required, _MOST_FINER)
        # with drag optimal velocities bend, and linear ones approach them slowly
        bent = fastest._as_fast(fastest.finer(fast, 1e-6, BENT, parts=1), required, _MOST_FINER)
        if bent is None or not self.task.objective.is_smooth:
            return bent
        return fastest._as_fast(fast, required, _MOST_STRAIGHT)

    def _as_fast(self, fast: Trial, required: float, most: int) -> Trial | None:
        """Halve arcs, at most `most` times, until the required speed is reached, if it is near."""
        for _ in range(most):
            if not _NEARLY * required <= fast.value < required:
                break
            fast = self.finer(fast, 1e-6, enough=required)
        return fast if fast.value >= required else None

    def climbed(
        self, trial: Trial, tolerance: float = 1e-3, steps: int = 25, enough: float = -np.inf
    ) -> Trial:
        """Continue the climb of a trial; the result is never worse.

        Settings are those of `Climb`, but `enough` has the task's units.
        """
        bilinear = trial.program.bilinear
        until = Climb(tolerance, steps, enough=enough / trial.program.unit)
        before = bilinear.programs, bilinear.work
        most = bilinear.work + self._most
        point = bilinear.climb(trial.point, until, lambda _: self.stopped() or bilinear.work > most)
        self._count(bilinear, *before)
        return replace(trial, point=point)

    def _count(self, bilinear: BilinearProgram, programs: int = 0, work: int = 0) -> None:
        self.programs += bilinear.programs - programs
        self.work += bilinear.work - work

    def settled(self, trial: Trial) -> Trial | None:
        """The trial with the split of least actuation instead of any split; None if it has none."""
        if not any(split_matters(self.task, resting) for resting in trial.sequence):
            return trial
        best = self._split(trial)
        required = self.task.objective.speed
        # durations of the least cost with any split may not suit this one
        if required is not None and (fast := self._fast_like(trial, required)) is not None:
            for cuts in range(_CUTS):
                if cuts:
                    fast = self.finer(fast)
                program, start = self._as_fast_as(fast)
                like = start and Trial(program, start, trial.cycles, trial.level + cuts)
                found = like and self._split(like)
                if found is not None and (best is None or found.value > best.value):
                    best = found
                if self.stopped():
                    break
        return best and self._other_patterns(best)

    def _fast_like(self, trial: Trial, required: float) -> Trial | None:
        """Climb to the required speed from durations of a trial."""
        of = trial.program
        return self._fast_enough(
            required, of.sequence, of.period, trial.durations, None, patient=True
        )

    def _split(self, trial: Trial) -> Trial | None:
        """Climb with the durations of a trial and the patterns of its split, or simple ones."""
        program, found = trial.program, []
        widths = program.widths(trial.point)
        for patterns in (program.least_patterns(trial.point), *program.simple_patterns()):
            own = program.with_patterns(patterns)
            start = own.start_arcs(widths)
            if start is not None:
                found.append(self.climbed(replace(trial, program=own, point=start)))
        return max(found, key=lambda t: t.value, default=None)

    def _other_patterns(self, trial: Trial, tolerance: float = 1e-3) -> Trial:
        """Continue the climb with the other pattern wherever two hold, while that helps."""
        for _ in range(_FLIPS if trial.program.patterns else 0):
            patterns = trial.program.least_patterns(trial.point, other=True)
            if patterns == trial.program.patterns:
                break
            program = trial.program.with_patterns(patterns)
            start = program.start_arcs(trial.program.widths(trial.point))
            if start is None:
                break
            better = self.climbed(replace(trial, program=program, point=start), tolerance)
            if better.value <= trial.value + tolerance * abs(trial.value):
                break
            trial = better
        return trial

    def finer(
        self,
        trial: Trial,
        tolerance: float = 1e-4,
        degree: int | None = None,
        parts: int = 2,
        steps: int = 40,
        enough: float = -np.inf,
    ) -> Trial:
        """Cut each arc in `parts`, or raise the degree, and continue the climb; never worse.

        `degree` of the velocities, kept if None; `tolerance`, `steps`, `enough` of the climb.
        """
        program, start = trial.program.finer(trial.point, degree, parts)
        level = trial.level + 1
        if start is None:
            return replace(trial, level=level)
        better = self.climbed(Trial(program, start, trial.cycles, level), tolerance, steps, enough)
        better = self._other_patterns(better, tolerance)
        return better if better.value >= trial.value else replace(trial, level=level)


# Arcs per phase of a first trial, and of all its phases together where these are many.
_FEWEST_ARCS, _MOST_ARCS, _ARCS = 2, 4, 16
# Programs of travelling waves with more unknowns are reduced to one phase.
_LARGE = 1800
UP = 1 + 1e-9  # a period within this share of a bound is at the bound
# Shares of their ranges in which velocities may change when durations change.
_NEARNESS = (0.05, 0.4, np.inf)
# Bounds of a free period, as multiples of its first guess.
_LONGEST, _SHORTEST = 20.0, 1e-4
# Share by which a required speed may be missed before arcs are halved; largest numbers of halvings,
# in general and for linear velocities; share by which a speed must be exceeded to lower a cost.
_NEARLY, _MOST_FINER, _MOST_STRAIGHT, _AMPLY = 0.95, 3, 7, 1.02
# Degree of velocities with drag, which bends them.
BENT = 3
# Largest numbers of rounds with other patterns of unloaded spikes, and of meshes of a fast gait on
# which patterns are sought.
_FLIPS, _CUTS = 4, 4
