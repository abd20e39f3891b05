"""Choose one of several equally good gaits, the same one on every machine.

Optimal gaits are often not unique: a link may rest long or short, or a cycle may be replaced by its
mirror image, at the same speed. Rounding then decides at which of them a linear program ends. The
canonical gait begins with the smallest order of rest. Its links are as long as possible on average
over the period, with larger weights nearer to the head.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from wormopt.numerics.bilinear import BilinearProgram, Climb, Point
from wormopt.systems.shared.sequences import canonical, mirrored
from wormopt.systems.spiked.programs.program import GaitProgram, WaveProgram
from wormopt.systems.spiked.search.orders import is_mirror_symmetric
from wormopt.systems.spiked.search.trial import Trial, Trier

# Smallest duration of an arc, as a share of the cycle: limits are multiplied by durations.
_SHORTEST = 1e-3
# Shares of the objective that may be lost, tried in turn; the loss of an image; differences of mean
# lengths that count as none.
_HELD, _SAME, _AS_LONG = (1e-15, 1e-12, 1e-11), 1e-12, 1e-9
# Largest violation of limits; loss of mean length allowed to meet them exactly.
_OFF, _LOST = 1e-12, 1e-6
# Arcs are cut in these numbers of parts in turn, if the mean length gains more than a share. Last,
# arcs that only repeat are joined.
_PARTS, _GAIN = (5, 3, 1), 1e-10
_UNTIL, _AGAIN = Climb(tolerance=1e-12, steps=40), Climb(tolerance=1e-13, steps=15)
# Gaits with more unknowns keep their links: lengthening would take as long as the design.
_MOST_UNKNOWNS = 400


def chosen(trier: Trier, trial: Trial, *, turn: bool) -> tuple[Trial, Trial]:
    """Choose the canonical gait among those that are as good as a trial.

    Returns the trial in its canonical order of rest, as a vertex of its own program, and the chosen
    gait, whose value is lower by at most a share of 1e-11 and which meets limits as exactly. Both
    are the trial itself where the optimum is unique: for smooth objectives, with drag, or where the
    velocities of all masses are those of one. `turn`: whether the cycle may begin elsewhere or be
    mirrored.
    """
    task = trier.task
    if task.objective.is_smooth or task.worm.drag or isinstance(trial.program, WaveProgram):
        return trial, trial
    least = trial.value - _SAME * abs(trial.value)
    images = [image for image in _images(trial) if image.value >= least] if turn else [trial]
    if not images:
        return trial, trial
    if len(trial.point.x) > _MOST_UNKNOWNS:
        return images[0], images[0]
    best, most = (images[0], images[0]), -np.inf
    for image in images:
        gait, mean = _lengthened(image)
        if np.isfinite(mean) and (np.isneginf(most) or mean > most + _AS_LONG * abs(most)):
            best, most = (image, gait), mean
    return best


def _images(trial: Trial) -> Iterator[Trial]:
    """Rotations of a trial, and equally good mirror images, whose order is canonical."""
    program, task = trial.program, trial.program.task
    masses, count = task.worm.links + 1, len(trial.sequence)
    mirror = is_mirror_symmetric(task)
    first = canonical(trial.sequence, masses, mirror=mirror)
    arcs = np.split(np.arange(program.total), np.cumsum(program.arcs)[:-1])
    for mirrors in (False, True) if mirror else (False,):
        word = mirrored(trial.sequence, masses) if mirrors else trial.sequence
        for k in range(count):
            if word[k:] + word[:k] != first:
                continue
            if k == 0 and not mirrors:
                yield trial
                continue
            order = np.concatenate([*arcs[k:], *arcs[:k]])
            patterns = program.patterns and tuple(
                one[::-1] if mirrors and one is not None else one
                for one in (program.patterns[i] for i in order)
            )
            same = (program.degree, patterns, program.limits)
            image = GaitProgram(task, first, program.period, np.roll(program.arcs, -k), *same)
            point = _mirrored(trial, image, order) if mirrors else _turned(trial, image, order)
            if point is not None:
                yield replace(trial, program=image, point=point)


def _turned(trial: Trial, image: GaitProgram, order: np.ndarray) -> Point | None:
    """The same motion from another arc on; None if the programs have different columns."""
    program = trial.program
    if len(image.bilinear.upper) != len(trial.point.x):
        return None
    x = trial.point.x.copy()
    for there, here in ((image.h, program.h), (image.v, program.v), (image.length, program.length)):
        x[there] = trial.point.x[here[order]]
    off = max(_OFF, program.bilinear.violation(trial.point.x))
    return Point(x, image.bilinear.value(x)) if image.bilinear.violation(x) <= off else None


def _mirrored(trial: Trial, image: GaitProgram, order: np.ndarray) -> Point | None:
    """The best motion with the same durations of arcs."""
    point = image.start_arcs(trial.program.widths(trial.point)[order])
    return None if point is None else image.bilinear.sharpen(point)[0]


def _lengthened(trial: Trial) -> tuple[Trial, float]:
    """Lengthen the links at a fixed objective; return the gait and its mean length."""
    value, mean = trial.point.value, -np.inf
    for parts in _PARTS:
        least = mean * (1 - _AS_LONG if parts == 1 else 1 + _GAIN)
        program, widths = trial.program.cut(trial.point, parts)
        for held in _HELD:
            found = _LongestLinks(program, value - held * abs(value)).best(widths)
            if found is not None and found[2] <= _OFF:
                if found[1] > least:
                    trial, mean = replace(trial, program=program, point=found[0]), found[1]
                break
    return trial, mean


@dataclass(eq=False)
class _LongestLinks:
    """The program of a gait with its objective fixed, to maximise mean lengths."""

    program: GaitProgram
    value: float  # smallest objective, scaled

    def __post_init__(self) -> None:
        like = self.program
        given = (like.task, like.sequence, like.period, like.arcs, like.degree, like.patterns)
        own = type(like)(*given, like.limits)
        rows, self.own, self._count = own.rows, own, len(own.rows.upper)
        degree, links = own.degree, own.limits.links
        strokes = np.broadcast_to(own.limits.strokes, own.length.shape)
        inner = [rows.columns(strokes) for _ in range(degree)]
        coefficients = [own.length, *inner, np.roll(own.length, -1, axis=0)]
        share, weights = 1.0 / (degree + 1), 1.0 - np.arange(links) / (2.0 * links)
        mean = []
        for j, weight in enumerate(weights.tolist()):
            for k in range(1, degree + 1):
                change = [
                    (own.h, own.v[:, i, mass], sign * share)
                    for i in range(k)
                    for mass, sign in ((j, -1.0), (j + 1, 1.0))
                ]
                rows.add([(coefficients[k][:, j], 1.0), (own.length[:, j], -1.0)], change, 0, 0)
            mean += [
                (int(h), int(column), weight / (degree + 2))
                for of_arcs in coefficients
                for h, column in zip(own.h, of_arcs[:, j], strict=True)
            ]
        gain = int(rows.add([(0, 0.0)], mean, -np.inf, np.inf)[0])
        own.hold(self.value)
        self.second = BilinearProgram(rows, np.unique(own.h), gain, own.period_row, None, 1e-10)

    def best(self, widths: np.ndarray) -> tuple[Point, float, float] | None:
        """Maximise the mean length from given durations of arcs.

        Returns the point, its mean length, and the violation of limits.
        """
        x = np.zeros(len(self.second.upper))
        x[self.own.h] = widths
        self.second.lower[self.own.h] = np.minimum(widths, _SHORTEST * widths.sum())
        start = self.second.restore(x)
        if start is None:  # with joined arcs the objective is slightly worse at first
            x[self.own.h] = self._moved(widths)
            start = self.second.restore(x)
        if start is None:
            return None
        found, _ = self.second.sharpen(self.second.climb(start, _UNTIL), lost=_LOST)
        x = found.x[: self._count]
        off = self.second.violation(found.x)
        return Point(x, self.program.bilinear.value(x)), found.value, off

    def _moved(self, widths: np.ndarray) -> np.ndarray:
        """Durations of arcs that restore the objective."""
        program = self.program
        x = np.zeros(len(program.bilinear.upper))
        x[program.h] = widths
        point = program.bilinear.restore(x)
        if point is None:
            return widths
        point, _ = program.bilinear.sharpen(program.bilinear.climb(point, _AGAIN))
        return point.x[program.h]
