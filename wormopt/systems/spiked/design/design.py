"""A designed gait with measures of its quality, and its final refinement.

The arcs of the best trials of a search are halved until that gains nothing. Then the active limits
are met exactly. Of several equally good gaits every machine chooses the same one. Optimal gaits are
often not unique: a link may rest long or short, or a cycle may be replaced by its mirror image, at
the same speed. Rounding then decides at which of them a linear program ends. The canonical gait
begins with the smallest order of rest. Its links are as long as possible on average over the
period, with larger weights nearer to the head.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from wormopt.errors import ArgumentError
from wormopt.lazy import above
from wormopt.model.gait import Gait
from wormopt.model.given import check_choice
from wormopt.numerics.bilinear import BilinearProgram, Climb, Point
from wormopt.progress import Report
from wormopt.shown import Part, brief, html, lines
from wormopt.systems.shared.sequences import (
    Sequence_,
    canonical,
    lasting,
    lasting_arcs,
    mirrored,
    repetition,
)
from wormopt.systems.spiked.certify.bound import Bounded, at_once
from wormopt.systems.spiked.crawl import Crawl, crawl
from wormopt.systems.spiked.gait_problem import Cost, GaitProblem, Search
from wormopt.systems.spiked.programs.program import GaitProgram, WaveProgram
from wormopt.systems.spiked.search.orders import is_mirror_symmetric
from wormopt.systems.spiked.search.search import DONE, Survey, effort_of
from wormopt.systems.spiked.search.trial import BENT, UP, Trial, Trier
from wormopt.systems.spiked.verify import ACCEPTED, in_steps, speed_of, violations

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Halving of arcs ends below this relative gain, or above these numbers of unknowns and halvings.
_RESOLVED, _RESOLVED_DRAGGED, _MOST_UNKNOWNS, _MOST_HALVINGS = 1e-9, 1e-7, 1000, 5
# Largest number of steps of a climb between two halvings.
_STEPS = 15
# Trials within this share of the best are refined too, because one of them may end higher;
_CLOSE, _TIE = 2e-3, 1e-8
# so are those within this multiple of the best one's gain by refinement.
_GAINS = 8.0
# Tolerance of a climb between two halvings, as a share of the gain of the last halving.
_OF_GAIN = 0.01
# Number of further trials if the best ones exceed a limit.
_MOST_UNSOUND = 4
# Largest share of the value that exact limits may cost.
_MOST_LOST = 1e-2
# Distances from all limits, tried in turn if the exact solution violates one.
_MARGINS = (4e-9, 4e-8, 4e-7, 4e-6)
# Velocity of masses that need not rest, relative to those that do, in units of the program; without
# it they might rest in practice.
_APART = 1e-3, 0.0


@dataclass(frozen=True, eq=False)
class Design:
    """A designed gait with measures of its quality.

    Parameters
    ----------
    task : GaitProblem
        The problem of the design.
    gait : Gait
        One cycle of the gait.
    sequence : tuple of tuple of int
        Prescribed resting masses of each phase of a cycle.
    durations : tuple of float
        Duration of each phase.
    ceiling : float
        Upper bound on the speed of any gait from rates and resting masses alone.
    error : float
        Relative gain in the objective from the last halving of all arcs.
    survey : Survey
        Results of the search.
    solver : mapping
        Facts about the last program: status, violation, arcs, degree.
    timings_s : dict of str to float
        Seconds of each stage.
    ended : str
        "searched"; "proven" if no gait can be better by more than `Search.gap`; "time limit" or
        "interrupted" if the search ended early.
    trial : Trial, optional
        The last program, which gives the multipliers; None for smooth costs.
    free : Design, optional
        With `limits.tick`, the design without it.

    Examples
    --------
    >>> from wormopt.systems.spiked.gait_problem import Limits, Worm
    >>> from wormopt.systems.spiked.design.optimize import design
    >>> worm = Worm(links=1, load=5.0)
    >>> limits = Limits(period=1.0, length=(0.7, 1.3), rate=1.0, acceleration=20.0)
    >>> found = design(worm, limits)
    >>> round(found.speed, 9), found.sequence, max(found.violations.values()) < 1e-9
    (0.425, ((0,), (1,)), True)
    """

    task: GaitProblem
    gait: Gait = field(repr=False)
    sequence: Sequence_
    durations: tuple[float, ...]
    ceiling: float
    error: float
    survey: Survey = field(repr=False)
    solver: dict[str, Any] = field(repr=False)
    timings_s: dict[str, float]
    ended: str = "searched"
    trial: Trial | None = field(default=None, repr=False)
    free: Design | None = field(default=None, repr=False)

    def __repr__(self) -> str:
        rests = [list(masses) for masses in self.sequence]
        return lines(
            f"Design: {self._summary}", f"at rest {rests}, for {brief(list(self.durations))}"
        )

    @property
    def _summary(self) -> str:
        worm, cost = self.task.worm, self.task.objective.minimise
        least = f", {cost} {self.value:.6g}" if cost else ""
        period = f"period {self.period:.6g}"
        return f"{worm.links + 1} masses, speed {self.speed:.6g}{least}, {period} ({self.ended})"

    @property
    def bound(self) -> float:
        """Upper bound on the speed, proven by small linear programs; for a cost, the `ceiling`."""
        return self.ceiling if self.bounded is None else self.bounded.bound

    @cached_property
    def bounded(self) -> Bounded | None:
        """The bound on the speed with its proof; None for a cost."""
        return self.survey.bounded or at_once(self.task)

    def _repr_html_(self) -> str:
        phases = [
            (brief(list(masses)), f"{duration:.6g}")
            for masses, duration in zip(self.sequence, self.durations, strict=True)
        ]
        excess = [(name, f"{value:.2g}") for name, value in self.violations.items()]
        parts = [
            Part("Masses at rest, and duration", phases),
            Part("Violation of each limit, relative to it", excess),
            Part("Upper bound on the speed of any gait", [(f"{self.bound:.6g}", "")]),
        ]
        return html(f"Design: {self._summary}", parts)

    def plot(self, picture: str = "gait") -> Figure:
        """Draw the designed gait with its limits.

        Parameters
        ----------
        picture : {"gait", "motion", "spikes", "animation"}, optional
            Lengths and rests over a cycle; paths of the masses over two cycles; loads on spikes
            and actuator forces over a cycle; the worm, which moves in a notebook.

        Returns
        -------
        matplotlib.figure.Figure
            Bound to no window; a notebook shows it.

        Raises
        ------
        ArgumentError
            If there is no such picture.
        """
        check_choice("picture", picture, ("gait", "motion", "spikes", "animation"))
        return above("wormopt.systems.spiked.design_results:as_result")(self).plot(picture)

    @cached_property
    def motion(self) -> Crawl:
        """Motion of the worm with the gait, in closed form, at the largest load of a range."""
        return self.motion_under(self.task.worm.load_range[1])

    def motion_under(self, load: float) -> Crawl:
        """Motion of the worm with the gait at a given load.

        Parameters
        ----------
        load : float
            Load on each mass; the mean of loads that differ.

        Returns
        -------
        Crawl
        """
        return _motion_under(load, self.task, self.gait)

    @property
    def speed(self) -> float:
        """Mean speed."""
        return self.motion.speed

    @property
    def period(self) -> float:
        """Period of ``gait``, after which the motion repeats."""
        return self.gait.period

    @property
    def cycles(self) -> int:
        """Smallest number of cycles that fills a period within the limits."""
        return self.task.limits.cycles_of(self.period)

    @property
    def value(self) -> float:
        """The speed, or the cost that was minimised."""
        return objective_of(self.motion, self.task.objective.minimise)

    @cached_property
    def tick_loss(self) -> float:
        """Relative loss in the objective from cycles of whole ticks; 0 without a tick."""
        if self.free is None:
            return 0.0
        minimise = self.task.objective.minimise
        own, free = (objective_of(one.motion, minimise) for one in (self, self.free))
        worse = own - free if minimise else free - own
        return worse / abs(free) if free else 0.0

    @cached_property
    def table(self) -> np.ndarray:
        """Lengths (n, ticks + 1) at the ticks of a cycle, in whole `limits.length_step`.

        The last column equals the first. ArgumentError without a tick.
        """
        limits, links = self.task.limits, self.task.worm.links
        if limits.tick is None:
            missing = f"{limits.name}.tick"
            raise ArgumentError(f"a table needs ticks, but {missing} is not given; write it")
        ticks = round(self.period / limits.tick)
        lengths = self.gait(np.array([limits.whole_ticks(k) for k in [*range(ticks), 0]]))
        if limits.length_step is None:
            return lengths
        return in_steps(lengths, limits.length_step, limits.length_ranges(links))

    @cached_property
    def step_loss(self) -> float:
        """Relative loss of speed if lengths change linearly between those of `table`."""
        return 1.0 - speed_of(self.table, self.period) / self.speed

    @cached_property
    def phases(self) -> int:
        """Number of phases of a cycle, by the prescribed sequence or by the masses at rest."""
        return min(len(self.sequence), len(self.motion.resting_sequence))

    @cached_property
    def violations(self) -> dict[str, float]:
        """Violation of each limit, relative to the limit; negative if there is slack.

        The worst over the ends and the middle of a range of loads.
        """
        return dict(_violations(self.task, self.gait))


def _motion_under(load: float, task: GaitProblem, gait: Gait) -> Crawl:
    worm, limits = task.worm, task.limits
    return crawl(gait, worm.masses, worm.drag, worm.loads(load), limits.sharing, limits.spike_load)


@lru_cache(maxsize=4)
def _violations(task: GaitProblem, gait: Gait) -> dict[str, float]:
    """Violation of each limit, the worst over both ends and the middle of the range of loads."""
    low, high = task.worm.load_range
    found = [
        violations(_motion_under(load, task, gait), task.limits)
        for load in sorted({low, (low + high) / 2, high})
    ]
    return {key: max(excess[key] for excess in found) for key in found[0]}


def objective_of(motion: Crawl, minimise: Cost | None) -> float:
    """Speed of a motion, or the cost `minimise` if it is given."""
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
    task: GaitProblem,
    trial: Trial,
    error: float,
    ceiling: float,
    survey: Survey,
    ended: str,
    gait: Trial | None = None,
) -> Design:
    """Make a design of a trial without refinement; see `Design` for the other parameters.

    `gait` is an equally good trial whose gait is used instead.
    """
    gait = gait or trial
    widths = gait.program.widths(gait.point)
    sequence, durations, arcs = lasting_arcs(gait.sequence, gait.program.arcs, widths)
    return Design(
        task=task,
        gait=gait.gait,
        sequence=sequence,
        durations=durations,
        ceiling=ceiling,
        error=error,
        survey=survey,
        solver={
            "status": "solved" if ended in DONE else "cut short",
            "violation": gait.program.bilinear.violation(gait.point.x),
            "arcs_per_phase": arcs,
            "degree": gait.program.degree + 1,
        },
        timings_s={},
        ended=ended,
        trial=None if task.objective.is_smooth else trial,
    )


def sharpest(
    task: GaitProblem, settings: Search, survey: Survey, bound: float, report: Report
) -> Design:
    """Halve the arcs of the best trials until that gains nothing, and take the best vertex.

    `survey` holds the trials of the search; `bound` is the ceiling.
    """
    ended, solved = survey.ended, list[tuple[Trial, float, bool]]()
    trier, most = Trier(task), effort_of(settings).width
    for k, trial in enumerate(survey.trials[: _MOST_UNSOUND * most]):
        sound = any(keeps for *_, keeps in solved)
        if sound and (k >= most or trial.value < _hopeful(survey.trials[0], solved[0][0])):
            break
        try:
            report(f"sharpening gait {k}", 0.9)
            record = max((s[0].value for s in solved if s[2]), default=-np.inf)
            solved.append(sharpened(trier, trial, ended not in DONE, record))
        except KeyboardInterrupt:
            ended = "interrupted"
            solved.append((trial, np.nan, False))
        if ended not in DONE:
            break
    sound = [s for s in solved if s[2]] or [max(solved, key=lambda s: _as_it_is(task, s[0]))]
    value = max(trial.value for trial, *_ in sound)
    trial, error, _ = min(
        (s for s in sound if s[0].value >= value - _TIE * abs(value)),
        key=lambda s: len(lasting(s[0].sequence, s[0].durations.tolist())[0]),
    )
    both = trial, trial
    if ended in DONE:
        try:
            report("choosing among equal gaits", 0.95)
            trial, error = _recounted(trier, _in_fewer_phases(trier, trial), error)
            both = trial, trial
            both = _canonical(trier, trial, turn=settings.sequence is None)
        except KeyboardInterrupt:
            ended = "interrupted"
    return of_trial(task, both[0], error, bound, survey, ended, both[1])


def _recounted(trier: Trier, trial: Trial, error: float) -> tuple[Trial, float]:
    """The trial with its error, or a better one with another number of cycles.

    The number was chosen with few arcs; with more arcs the best period of a cycle differs.
    """
    shortest, longest = trier.shortest / trial.cycles, trier.longest / trial.cycles
    period = float(trial.durations.sum())
    ticks = trier.task.limits.tick is not None  # only this number of cycles has whole ticks
    if ticks or trial.cycles < 2 or shortest * UP < period < longest / UP:
        return trial, error
    free, before = trier.freed(trial), trial
    for other in trier.fits(free) if free else []:
        if other.cycles != trial.cycles:
            sharp, own, keeps = sharpened(trier, other, quickly=False, best=trial.value)
            if keeps and sharp.value > trial.value:
                trial, error = _in_fewer_phases(trier, sharp), own
    # a climb may stop before the best period
    return (trial, error) if trial is before else _recounted(trier, trial, error)


def _hopeful(best: Trial, sharp: Trial) -> float:
    """Value below which a trial is unlikely to end best, by the gain of the best in refinement."""
    return best.value - min(_CLOSE * abs(best.value), _GAINS * (sharp.value - best.value))


def _canonical(trier: Trier, trial: Trial, *, turn: bool) -> tuple[Trial, Trial]:
    """The trial in its canonical order, and the canonical one of all equally good gaits."""
    turned, gait = canonical_gait(trier, trial, turn=turn)
    if not _keeps(trier.task, turned):
        return trial, trial
    return turned, gait if _keeps(trier.task, gait) else turned


def _in_fewer_phases(trier: Trier, trial: Trial) -> Trial:
    """Omit phases and arcs of almost no duration, join equal arcs, omit repeated cycles."""
    tie = _RESOLVED_DRAGGED if trier.task.worm.drag else _TIE
    for simplified in (_without_short_phases, _one_repetition, _in_fewer_arcs):
        simpler = simplified(trier, trial)
        if simpler is None or simpler.value < trial.value - tie * abs(trial.value):
            continue
        if _keeps(trier.task, simpler):
            trial = simpler
    return trial


def _in_fewer_arcs(_: Trier, trial: Trial) -> Trial | None:
    program, point = trial.program.finer(trial.point, parts=1)
    return None if point is None else _exact(replace(trial, program=program, point=point))


def _without_short_phases(trier: Trier, trial: Trial) -> Trial | None:
    program, point = trial.program.lasting(trial.point)
    if program is trial.program or point is None:
        return None
    return _exact(trier.climbed(replace(trial, program=program, point=point), 1e-10, _STEPS))


def _one_repetition(trier: Trier, trial: Trial) -> Trial | None:
    sequence, durations = lasting(trial.sequence, trial.durations.tolist())
    count, shortest = len(sequence), repetition(sequence)
    found = None
    for part in range(shortest, count, shortest):
        if count % part:
            continue
        mean = np.reshape(durations, (-1, part)).mean(axis=0)
        one = trier.near(sequence[:part], mean, trial.cycles * count // part)
        found = one and sharpened(trier, one, quickly=False)[0]
        if found is not None and found.value >= trial.value - _TIE * abs(trial.value):
            break
    return found


def _keeps(task: GaitProblem, trial: Trial) -> bool:
    """Whether the gait meets all limits at the cost of its program."""
    meets, value = _as_it_is(task, trial)
    return meets and value >= trial.value - _TIE * abs(trial.value)


def _as_it_is(task: GaitProblem, trial: Trial) -> tuple[bool, float]:
    """Whether the gait meets all limits, and its value; all masses that rest share the load.

    In the program only prescribed masses rest, and limits on forces are multiplied by durations, so
    they are weak on short arcs. A further mass at rest takes load, and may raise a peak.
    """
    meets = max(_violations(task, trial.gait).values()) < ACCEPTED
    cost = task.objective.minimise
    if cost is None or task.objective.is_smooth:
        return meets, trial.value
    return meets, -objective_of(_motion_under(task.worm.load_range[1], task, trial.gait), cost)


def sharpened(
    trier: Trier, trial: Trial, quickly: bool, best: float = -np.inf
) -> tuple[Trial, float, bool]:
    """Halve arcs until that gains nothing, then solve the active limits exactly.

    Trials that cannot reach `best` are refined less. Also returns the remaining error, and whether
    all limits hold.
    """
    trial, error = _halved(trier, trial, 0 if quickly else _MOST_HALVINGS, best)
    if trial.value + 2 * error * abs(trial.value) < best:
        return trial, error, _keeps(trier.task, trial)
    close = _close(error) if trier.task.worm.drag else 1e-10
    trial = trier.climbed(trial, close, steps=_STEPS)
    inexact = None
    for sharp in _exactly(trier, trial):
        lost = (trial.value - sharp.value) / abs(trial.value or 1.0)
        if lost <= _MOST_LOST:
            if _keeps(trier.task, sharp):
                return sharp, max(error, lost), True
            inexact = inexact or sharp
    return inexact or trial, error, False


def _exactly(trier: Trier, trial: Trial) -> Iterator[Trial]:
    """Trials whose limits are met exactly, the best ones first."""
    yield _exact(trial)
    # limits are multiplied by durations, so very short arcs may violate them
    program, point = trial.program.finer(trial.point, parts=1)
    if point is not None:
        joined = replace(trial, program=program, point=point)
        for steps in (0, _STEPS):  # a climb may make new short arcs
            joined = trier.climbed(joined, 1e-10, steps)
            if joined.value >= trial.value - _TIE * abs(trial.value):
                trial = joined
                yield _exact(joined)
    for apart, margin in product(_APART, _MARGINS):
        inner = trial.program.inside(trial.point, margin, apart)
        if inner is not None:
            yield replace(trial, point=inner)


def _halved(trier: Trier, trial: Trial, halvings: int, best: float) -> tuple[Trial, float]:
    """Halve arcs while that gains something; with drag, raise the degree first."""
    error, dragged = np.inf, bool(trier.task.worm.drag)
    if dragged and trial.program.degree < BENT:
        degree = BENT if len(trial.point.x) < _MOST_UNKNOWNS // 2 else 2
        bent = trier.finer(trial, 1e-6, degree, parts=1, steps=_STEPS)
        error = (bent.value - trial.value) / abs(trial.value or 1.0)
        trial = bent
    for halved in range(halvings):
        hopeless = trial.value + 2 * error * abs(trial.value) < best
        most = _MOST_UNKNOWNS / 2 if dragged and halved else _MOST_UNKNOWNS
        if hopeless or len(trial.point.x) > most:
            break
        finer = trier.finer(trial, _close(error) if dragged else 1e-8, steps=_STEPS)
        error = (finer.value - trial.value) / abs(trial.value or 1.0)
        trial = finer
        if error <= (_RESOLVED_DRAGGED if dragged else _RESOLVED):
            break
    return trial, error


def _close(error: float) -> float:
    """Tolerance of a climb after a halving with this gain."""
    return float(np.clip(_OF_GAIN * error, 1e-8, 1e-5))


def _exact(trial: Trial) -> Trial:
    point, _ = trial.program.bilinear.sharpen(trial.point)
    return replace(trial, point=point)


# -- the canonical one of equally good gaits -------------------------------------------------------

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
_MOST_LENGTHENED = 400


def canonical_gait(trier: Trier, trial: Trial, *, turn: bool) -> tuple[Trial, Trial]:
    """Choose the canonical gait among those that are as good as a trial.

    Returns the trial in its canonical order of rest, as a vertex of its own program, and the chosen
    gait, whose value is lower by at most a share of 1e-11 and which meets limits as exactly. Both
    are the trial itself where the optimum is unique: for smooth objectives, with drag, or where the
    velocities of all masses are those of one. `turn`: the order may begin with another phase or
    be mirrored.
    """
    task = trier.task
    if task.objective.is_smooth or task.worm.drag or isinstance(trial.program, WaveProgram):
        return trial, trial
    least = trial.value - _SAME * abs(trial.value)
    trial = _smaller_of_both_ways(trial, least) if turn else trial
    images = [image for image in _images(trial) if image.value >= least] if turn else [trial]
    if not images:
        return trial, trial
    # a rotation does not change mean lengths: the first phases are as short as possible
    images.sort(key=lambda image: np.round(image.durations / image.durations.sum(), 4).tolist())
    if len(trial.point.x) > _MOST_LENGTHENED:
        return images[0], images[0]
    best, most = (images[0], images[0]), -np.inf
    for image in images:
        gait, mean = _lengthened(image)
        if np.isfinite(mean) and (np.isneginf(most) or mean > most + _AS_LONG * abs(most)):
            best, most = (image, gait), mean
    return best


def _smaller_of_both_ways(trial: Trial, least: float) -> Trial:
    """The trial, or the one of the order in reverse if that is smaller and as good.

    With time reversed and lengths mirrored all masses have the same velocities, and accelerations
    of the other sign: loads may differ.
    """
    program, task = trial.program, trial.program.task
    backward = program.changed(
        sequence=trial.sequence[::-1],
        arcs=program.arcs[::-1],
        patterns=program.patterns and program.patterns[::-1],
    )
    masses, mirror = task.worm.links + 1, is_mirror_symmetric(task)
    ways = [canonical(p.sequence, masses, mirror=mirror) for p in (backward, program)]
    if ways[0] >= ways[1]:
        return trial
    point = _mirrored(trial, backward, np.arange(program.total)[::-1])
    other = None if point is None else replace(trial, program=backward, point=point)
    if other is None or other.value < least or not _keeps(task, other):
        return trial
    return other


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
            image = program.changed(
                sequence=first, arcs=np.roll(program.arcs, -k), patterns=patterns
            )
            point = _mirrored(trial, image, order) if mirrors else _turned(trial, image, order)
            if point is not None:
                yield replace(trial, program=image, point=point)


def _turned(trial: Trial, image: GaitProgram, order: np.ndarray) -> Point | None:
    """Rotate a motion to another first arc; None if the programs have different columns."""
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
        own = self.program.changed()
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
        """Maximise the mean length from given durations of arcs."""
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
