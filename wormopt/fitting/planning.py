"""The verb `plan_experiment`: the next run that determines the wanted numbers best."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.optimize import minimize

from wormopt.errors import ArgumentError, Interrupted, SolveError
from wormopt.fitting.experiment import Experiment, Run, departure, largest_excess
from wormopt.fitting.information import Criterion, Knowledge
from wormopt.progress import Report, silent
from wormopt.simulation.options import Tolerance

# Step of chosen numbers, from -1 to 1, for difference quotients: derivatives are exact to about
# 1e-8, and jump little where events pass samples.
_STEP = 1e-4
_ROUNDS, _GAIN = 60, 1e-5
# Number of times at which limits along a motion are checked in the end; how often limits are
# tightened by the excess between the times of the search.
_CLOSER, _TIGHTER = 4001, 3
_FINER = Tolerance(1e-11, 1e-12)
# A smaller excess of a limit is accepted.
_KEPT = 1e-6
# Value of a motion that fails, or gives no information.
_WORTHLESS = 100.0
# Largest nonlinearity of measurements, in standard errors; else inputs are varied, ever further,
# this many at each distance.
_LINEAR, _BESIDE, _TRIES = 0.1, (0.003, 0.01, 0.03, 0.1), 12
# How often an input is halved until it satisfies limits; how often it is redrawn if it cannot.
_HALVINGS, _DRAWS = 12, 30


@dataclass(frozen=True, eq=False)
class Rival:
    """A random experiment within all limits."""

    chosen: np.ndarray
    value: float  # of the criterion
    known: Knowledge


@dataclass(frozen=True, eq=False)
class Plan:
    """The best experiment found.

    Parameters
    ----------
    experiment : Experiment
        The planned experiment.
    criterion : Criterion
        Criterion of the search.
    chosen : ndarray, shape (size,)
        Chosen values, choice by choice.
    run : Run
        Run of the chosen values.
    rivals : tuple of Rival
        Experiments drawn at random within the same limits, the best first.
    ends : tuple of float
        Criterion at which each start of the search ended.
    excess : float
        Largest excess of any limit, of inputs or motion, as a share, on a fine grid.
    departure : float
        Deviation of measurements from linear ones within two standard errors, in standard
        errors for each: above 0.1, expected errors may be off.
    recheck : float
        The criterion again, by the Python route with a hundredth of the tolerance.

    Examples
    --------
    An experiment that identifies the damping of one link, compared with random ones:

    >>> import wormopt as wo
    >>> worm = wo.chain(1, mass=1.0, stiffness=10.0, damping=1.0, rest_length=2.0, drag=0.5)
    >>> ramps = wo.Ramps("rest_length", (2.0,), duration=4.0, pieces=4, change=0.5)
    >>> todo = wo.Experiment(
    ...     worm, [wo.Unknown("damping")], {"length": 0.01}, np.linspace(0.0, 4.0, 41), [ramps]
    ... )
    >>> plan = wo.plan_experiment(todo, todo.criterion("D"), rivals=5, starts=1)
    >>> plan.value < plan.rivals[0].value, plan.known.rank
    (True, 1)
    """

    experiment: Experiment
    criterion: Criterion
    chosen: np.ndarray
    run: Run
    rivals: tuple[Rival, ...]
    ends: tuple[float, ...]
    excess: float
    departure: float
    recheck: float

    @property
    def known(self) -> Knowledge:
        """Information after the planned experiment."""
        return self.run.known

    @property
    def value(self) -> float:
        """Value of the criterion, a logarithm."""
        return self.criterion(self.known)

    def shrinks(self, other: Knowledge) -> float:
        """Ratio of the confidence region, or error, of other knowledge to that of this plan.

        Parameters
        ----------
        other : Knowledge
            Knowledge to compare with, such as that after a rival's run.
        """
        power = len(self.criterion.rows) if self.criterion.kind == "D" else 1
        return float(np.exp(power * (self.criterion(other) - self.value)))


def plan_experiment(
    experiment: Experiment,
    criterion: Criterion,
    *,
    rivals: int = 20,
    starts: int = 4,
    seed: int = 0,
    report: Report = silent,
) -> Plan:
    """Find the experiment within the limits that identifies the wanted unknowns best.

    Experiments are drawn at random, each as large as the limits allow. SLSQP then improves the
    best of them; its gradients are differences of exact sensitivities.

    Parameters
    ----------
    experiment : Experiment
        The choices and the measurements.
    criterion : Criterion
        `Experiment.criterion` or `mean_rate`.
    rivals : int, optional
        Number of random experiments.
    starts : int, optional
        Number of the best random experiments from which the search starts.
    seed : int, optional
        Seed of the random numbers.
    report : callable, optional
        Receives the progress, see `wormopt.progress`.

    Returns
    -------
    Plan

    Raises
    ------
    SolveError
        If limits are exceeded even without motion, or no run identifies the wanted unknowns; the
        message names the combination that is not identifiable.
    Interrupted
        If the user stopped it; `partial` is the best Plan until then, None before there was one.

    Examples
    --------
    >>> import wormopt as wo
    >>> worm = wo.chain(1, mass=1.0, stiffness=10.0, damping=1.0, rest_length=2.0, drag=0.5)
    >>> ramps = wo.Ramps("rest_length", (2.0,), duration=4.0, pieces=4, change=0.5)
    >>> todo = wo.Experiment(
    ...     worm, [wo.Unknown("damping")], {"length": 0.01}, np.linspace(0.0, 4.0, 41), [ramps]
    ... )
    >>> plan = wo.plan_experiment(todo, todo.criterion("D"), rivals=5, starts=1)
    >>> plan.shrinks(plan.rivals[0].known) > 1.0, plan.excess < 1e-6
    (True, True)
    """
    if min(rivals, starts) < 1:
        raise ArgumentError("there must be at least one rival and one start")
    search, drawn, ends = _Search(experiment, criterion), (), []
    try:
        drawn = search.draw(rivals, seed, report)
        first = drawn[:starts]
        for number, rival in enumerate(first):
            text, done = f"search {number + 1} of {len(first)}", number / len(first)
            ends.append(search.improve(rival.chosen, partial(report, text, done)))
        report("rechecking", None)
        return search.plan(drawn, ends)
    except KeyboardInterrupt:
        best = search.plan(drawn, ends) if search.found else None
        raise Interrupted(best) from None


@dataclass(frozen=True, eq=False)
class _Look:
    """Results at a point."""

    run: Run | None
    value: float
    excess: np.ndarray  # of limits along the motion


class _Search:
    """Search over experiments; stores the best point within all limits."""

    def __init__(self, experiment: Experiment, criterion: Criterion) -> None:
        self.experiment, self.criterion = experiment, criterion
        self.over = partial(largest_excess, experiment, looks=_CLOSER)
        self.found: tuple[float, np.ndarray] | None = None
        self._last: tuple[bytes, _Look] | None = None
        self._slopes: tuple[bytes, np.ndarray, np.ndarray] | None = None

    def look(self, chosen: np.ndarray) -> _Look:
        """Evaluate an experiment; the last one is cached."""
        key = np.asarray(chosen).tobytes()
        if self._last is None or self._last[0] != key:
            self._last = key, self._look(chosen)
        return self._last[1]

    def _look(self, chosen: np.ndarray) -> _Look:
        try:
            run = self.experiment.run(chosen)
        except SolveError:
            return _Look(None, _WORTHLESS, np.zeros(0))
        return _Look(run, min(self.criterion(run.known), _WORTHLESS), run.excess)

    def slopes(self, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives of the criterion and of the excess, by difference quotients."""
        key = np.asarray(chosen).tobytes()
        if self._slopes is None or self._slopes[0] != key:
            here = self.look(chosen)
            value, excess = np.zeros(len(chosen)), np.zeros((len(here.excess), len(chosen)))
            for k in range(len(chosen)):
                beside = np.array(chosen)
                beside[k] -= np.copysign(_STEP, beside[k])  # inwards
                there = self._look(beside)
                step = beside[k] - chosen[k]
                if there.run is not None and here.run is not None:
                    value[k] = (there.value - here.value) / step
                    excess[:, k] = (there.excess - here.excess) / step
            self._slopes = key, value, excess
        return self._slopes[1:]

    def draw(self, count: int, seed: int, report: Report) -> tuple[Rival, ...]:
        """Draw experiments, each as large as all limits allow; the best first."""
        rng, found = np.random.default_rng(seed), []
        for number in range(count):
            report("drawing experiments", number / count)
            chosen = self._drawn(rng)
            run = self.experiment.run(chosen)
            found.append(Rival(chosen, self.criterion(run.known), run.known))
        found.sort(key=lambda rival: rival.value)
        if not np.isfinite(found[0].value):
            self._refuse(found[0].known)
        self.found = found[0].value, found[0].chosen
        return tuple(found)

    def _refuse(self, known: Knowledge) -> None:
        names = known.unseen[0] if known.unseen else {}
        listed = ", ".join(f"{share:+.3g} {name}" for name, share in names.items())
        raise SolveError(
            f"no experiment identifies the wanted unknowns: no measurement depends on {listed}",
            "measure other signals, fix more parameters, or name fewer wanted unknowns",
            code="not_identified",
        )

    def _drawn(self, rng: np.random.Generator) -> np.ndarray:
        for _ in range(_DRAWS):
            chosen = self.within(self.experiment.chosen.draw(rng))
            if chosen is not None:
                return chosen
        raise SolveError(
            "limits along the motion are exceeded even where the inputs do not change",
            "widen the limits, or change the start",
            code="no_room",
        )

    def within(self, chosen: np.ndarray) -> np.ndarray | None:
        """Shrink inputs until motions keep their limits, closely checked; None if it cannot."""
        if self.over(chosen) <= _KEPT:
            return chosen
        low, high = 0.0, 1.0
        if self.over(self.experiment.chosen.shrunk(chosen, low)) > _KEPT:
            return None
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            kept = self.over(self.experiment.chosen.shrunk(chosen, middle)) <= _KEPT
            low, high = (middle, high) if kept else (low, middle)
        return self.experiment.chosen.shrunk(chosen, low)

    def improve(self, start: np.ndarray, report: Callable[[], None]) -> float:
        """Search from a point within all limits; returns the criterion at the end."""
        margin, here, value = 0.0, start, self.look(start).value
        for _ in range(_TIGHTER):
            here = self._steps(here, margin, report)
            over = self.over(here)
            if over <= _KEPT:
                break
            margin += over
        else:
            kept = self.within(here)
            here = start if kept is None else kept
        here = self._settled(here)
        end = self.look(here).value
        if self.found is None or end < self.found[0]:
            self.found = end, here
        return min(value, end)

    def _settled(self, chosen: np.ndarray) -> np.ndarray:
        """Move off kinks, at which masses begin to stick, within the expected errors."""
        # Searches end at them: the criterion jumps there, and derivatives are one-sided.
        if departure(self.experiment, chosen) <= _LINEAR:
            return chosen
        rng = np.random.default_rng(0)
        for distance in _BESIDE:
            drawn = [chosen + distance * rng.standard_normal(len(chosen)) for _ in range(_TRIES)]
            near = [one for one in map(self.within, np.clip(drawn, -1, 1)) if one is not None]
            for one in sorted(near, key=lambda one: self.look(one).value):
                if departure(self.experiment, one) <= _LINEAR:
                    return one
        return chosen

    def _steps(self, start: np.ndarray, margin: float, report: Callable[[], None]) -> np.ndarray:
        """Sequential quadratic programs, with a margin to limits along the motion."""
        allowed = self.experiment.chosen.excess

        def room(chosen: np.ndarray) -> np.ndarray:
            return -np.concatenate([allowed(chosen)[0], self.look(chosen).excess + margin])

        def by_chosen(chosen: np.ndarray) -> np.ndarray:
            return -np.vstack([allowed(chosen)[1], self.slopes(chosen)[1]])

        def value(chosen: np.ndarray) -> float:
            report()
            return self.look(chosen).value

        limits = {"type": "ineq", "fun": room, "jac": by_chosen}
        answer = minimize(
            value,
            start,
            jac=lambda chosen: self.slopes(chosen)[0],
            method="SLSQP",
            bounds=[(-1.0, 1.0)] * len(start),
            constraints=[limits] if len(room(start)) else [],
            options={"maxiter": _ROUNDS, "ftol": _GAIN},
        )
        return np.clip(answer.x, -1.0, 1.0)

    def plan(self, drawn: tuple[Rival, ...], ends: list[float]) -> Plan:
        """Evaluate the best point again, by another route."""
        assert self.found is not None
        chosen = self.found[1]
        run = self.experiment.run(chosen)
        again = self.experiment.run(chosen, tolerance=_FINER, route="python")
        return Plan(
            self.experiment,
            self.criterion,
            chosen,
            run,
            drawn,
            tuple(ends),
            self.over(chosen),
            departure(self.experiment, chosen),
            self.criterion(again.known),
        )
