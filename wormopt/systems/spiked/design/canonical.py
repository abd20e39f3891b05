"""Choose one of the gaits that are equally good, the same one on every machine.

An optimum is often a face: a link may rest long or short, or a cycle may be exchanged for its
mirror image, at the same speed. Rounding decides where on the face a linear program ends. The
canonical gait begins with the smallest order of rest, and its links are as long as they can be on
average over the period, with larger weights nearer to the head.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from wormopt.numerics.bilinear import BilinearProgram, Climb
from wormopt.numerics.linearised import Point
from wormopt.systems.shared.sequences import canonical, mirrored
from wormopt.systems.spiked.programs.program import GaitProgram, WaveProgram
from wormopt.systems.spiked.search.orders import is_mirror_symmetric
from wormopt.systems.spiked.search.trial import Trial, Trier

# Arcs stay longer than this share of the cycle: limits are kept times their duration.
_SHORTEST = 1e-3
# Shares of the objective that may be given up, the first that leaves room for a vertex; and what
# counts as none between two images, or two gaits.
_HELD, _SAME = (1e-15, 1e-12, 1e-11), 1e-9
# How far limits may be off, at best and at most; share of the mean length that it may cost to
# meet them exactly.
_OFF, _MOST_OFF, _LOST = 1e-12, 3e-10, 1e-6
# Arcs are cut in so many parts in turn, which counts where the mean length gains more than a
# share; last, arcs that only repeat are joined.
_PARTS, _GAIN = (4, 2, 1), 1e-10
_UNTIL, _AGAIN = Climb(tolerance=1e-12, steps=40), Climb(tolerance=1e-13, steps=15)
# Programs with more unknowns are left where they are: choosing takes longer than the design.
_MOST_UNKNOWNS = 450


def chosen(trier: Trier, trial: Trial, *, turn: bool) -> tuple[Trial, Trial]:
    """Choose the canonical one of the gaits that are as good as a trial.

    Gives the trial in its canonical order of rest, as a vertex of its own program, and the gait
    chosen, which is below it by a share of 1e-11 at most. Both are the trial itself where the
    objective is smooth, where velocities of all masses are those of one, and where the program
    is large. `turn`: whether the cycle may begin elsewhere or be mirrored.
    """
    program = trial.program
    if (
        trier.task.objective.is_smooth
        or isinstance(program, WaveProgram)
        or len(trial.point.x) > _MOST_UNKNOWNS
    ):
        return trial, trial
    best: tuple[Trial, Trial] | None = None
    most = -np.inf
    for image in _images(trial) if turn else (trial,):
        if image.value < trial.value - _SAME * abs(trial.value):
            continue
        gait, mean = _drawn_out(image)
        if best is None or mean > most + _SAME * abs(most):
            best, most = (image, gait), mean
    return best or (trial, trial)


def _images(trial: Trial) -> Iterator[Trial]:
    """The trial turned, and mirrored where that is as good, so that its order is canonical."""
    program, task = trial.program, trial.program.task
    masses, count = task.worm.links + 1, len(trial.sequence)
    mirror = is_mirror_symmetric(task)
    first = canonical(trial.sequence, masses, mirror=mirror)
    arcs = np.split(np.arange(program.total), np.cumsum(program.arcs)[:-1])
    widths = program.widths(trial.point)
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
            point = image.start_arcs(widths[order])
            if point is not None:
                sharp, _ = image.bilinear.sharpen(point)
                yield replace(trial, program=image, point=sharp)


def _drawn_out(trial: Trial) -> tuple[Trial, float]:
    """Make the links as long as the objective allows; the gait, and their mean length."""
    value, mean = trial.point.value, -np.inf
    for parts in _PARTS:
        least = mean * (1 - _SAME if parts == 1 else 1 + _GAIN)
        program, widths = trial.program.cut(trial.point, parts)
        found = None
        for held in _HELD:
            tried = _LongestLinks(program, value - held * abs(value)).best(widths)
            if tried is not None and tried[2] < (_MOST_OFF if found is None else found[2]):
                found = tried
            if found is not None and found[2] <= _OFF:
                break
        if found is not None and found[1] > least:
            trial, mean = replace(trial, program=program, point=found[0]), found[1]
    return trial, mean


@dataclass(eq=False)
class _LongestLinks:
    """The program of a gait with its objective held and mean lengths made large."""

    program: GaitProgram
    value: float  # least of the objective, scaled

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
        """Best point from durations of arcs on, its mean length, and by how much limits are off."""
        x = np.zeros(len(self.second.upper))
        x[self.own.h] = widths
        self.second.lower[self.own.h] = np.minimum(widths, _SHORTEST * widths.sum())
        start = self.second.restore(x)
        if start is None:  # joined arcs are a little worse before they are moved
            x[self.own.h] = self._moved(widths)
            start = self.second.restore(x)
        if start is None:
            return None
        found, _ = self.second.sharpen(self.second.climb(start, _UNTIL), lost=_LOST)
        x = found.x[: self._count]
        off = self.second.violation(found.x)
        return Point(x, self.program.bilinear.value(x)), found.value, off

    def _moved(self, widths: np.ndarray) -> np.ndarray:
        """Durations of arcs at which the objective is at its best again."""
        program = self.program
        x = np.zeros(len(program.bilinear.upper))
        x[program.h] = widths
        point = program.bilinear.restore(x)
        if point is None:
            return widths
        point, _ = program.bilinear.sharpen(program.bilinear.climb(point, _AGAIN))
        return point.x[program.h]
