"""Find the best wave of a film: first its number of crests, then where its field switches."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from wormopt.errors import SolveError
from wormopt.numerics.collocation import Collocation
from wormopt.ocp.contact import Regularised
from wormopt.ocp.mesh import Mesh
from wormopt.ocp.motion import Guess, Motion
from wormopt.ocp.nlp import Ipopt
from wormopt.ocp.optimise import Optimum, optimise, refine
from wormopt.ocp.switching import structure_of
from wormopt.progress import Report, silent
from wormopt.systems.film.wave_problem import (
    TURN,
    WaveAim,
    WaveLimits,
    nearby_cosine,
    wave_guess,
    wave_problem,
)

# Waves with the same number of crests are equal if their objectives differ by less.
_ALIKE = 1e-3
_PLAIN = Mesh.even(1, 60, Collocation(3, "radau"))
# Width of fronts, the root of tension over field, that is solved directly; largest ratio of two
# tensions of the continuation; local error of its intermediate solves.
_FRONT, _STEP, _COARSE = 0.3, 4.0, 1e-5
_NEAR = Ipopt(mu_init=1e-4, warm=True)
# Phases at which crests are counted.
_FINE = 8192
# There is no contact; its treatment only reports which inputs are at their limits.
_WIDTH = 1.0
# Local error at which the mesh shows where the field switches.
_SHOWN, _ROUNDS = 1e-6, 4
# State polynomials between switches, and arcs of a phase in which the field is at a limit.
_EXACT, _HALVES = Collocation(6), 2
# Phases may lose this share of the objective before others are tried.
_LOST = 1e-5
# A field this close to a limit, as a share of its range, touches it; missing phases begin with this
# share of the wave.
_TOUCH, _BRIEF = 5e-3, 1e-3
_TIGHT = Ipopt(tolerance=1e-10, mu_init=1e-2)


@dataclass(frozen=True)
class Try:
    """Result of a start."""

    start: str  # name
    repeats: int  # of the optimised wave in 2 pi
    crests: int = 0  # in 2 pi; 0: nothing found
    reached: float = math.nan  # value of the objective; NaN: nothing found


@dataclass(frozen=True, eq=False)
class DesignedWave:
    """An optimal wave."""

    # all solves, the last of the single wave itself, see wormopt.systems.film.wave_problem
    stages: dict[str, Optimum]
    limits: WaveLimits
    repeats: int  # of the optimised wave in 2 pi
    tries: tuple[Try, ...]  # all starts

    @property
    def optimum(self) -> Optimum:
        """Last solve."""
        return [*self.stages.values()][-1]

    @property
    def motion(self) -> Motion:
        """Motion of the single wave."""
        return self.optimum.motion

    @property
    def mean_flow(self) -> float:
        """Mean flow 1 + C."""
        return float(self.motion.arcs.design[0])

    @property
    def field_range(self) -> float:
        """Largest field that the optimiser could use, or chose."""
        design = self.motion.arcs.design
        return self.limits.field or float(design[1]) / self.repeats

    @property
    def reached(self) -> float:
        """Objective reached: the range of the field in 2 pi, if that is minimised."""
        return self.field_range if self.limits.field is None else -self.optimum.objective

    @cached_property
    def start(self) -> float:
        """Phase of the single wave in the middle of the first of its highest crests."""
        h = self._fine
        top = np.flatnonzero(h >= h.max() - 1e-6 * np.ptp(h))
        gaps = np.diff(top, prepend=top[-1] - _FINE)
        first = int(top[int(np.argmax(gaps))])  # The end of the period may cut a crest.
        last = first
        while h[(last + 1) % _FINE] >= h[first] - 1e-6 * np.ptp(h):
            last += 1
        return TURN * (first + last) / 2 / _FINE

    @cached_property
    def _fine(self) -> np.ndarray:
        return self.motion.state("thickness", TURN * np.arange(_FINE) / _FINE)[0]

    @cached_property
    def crests(self) -> int:
        """Number of upward crossings of the mean thickness in 2 pi."""
        h = self._fine
        return self.repeats * int(np.sum((h <= 1) & (np.roll(h, -1) > 1)))

    def thickness(self, xi: np.ndarray) -> np.ndarray:
        """Thickness h at phases (m,); a crest is at 0."""
        return self.motion.state("thickness", self._inner(xi))[0]

    def slope(self, xi: np.ndarray) -> np.ndarray:
        """Slope of the thickness at phases (m,)."""
        return self.motion.state("slope", self._inner(xi))[0] * self.repeats

    def field(self, xi: np.ndarray) -> np.ndarray:
        """Field (mu - 1) H² / (8 pi) of the optimiser at phases (m,), with least value 0.

        At a jump, the later value.
        """
        t = self._inner(xi)
        if self.limits.gradient is not None:
            return self.motion.state("field", t)[0] / self.repeats
        return self.motion.inputs(t)[0] * self.field_range

    def guess(self, *, on_crest: bool) -> Guess:
        """The single wave as a start for another objective within the same limits."""
        motion, first = self.motion, self.start if on_crest else 0.0
        return Guess(
            TURN,
            lambda t: motion.states(np.mod(t + first, TURN)),
            lambda t: motion.inputs(np.mod(t + first, TURN)),
        )

    def _inner(self, xi: np.ndarray) -> np.ndarray:
        return np.mod(self.repeats * np.asarray(xi) + self.start, TURN)

    def instants(self, least: int = 400) -> np.ndarray:
        """Ascending phases from 0 to 2 pi with every jump of the field, before and after."""
        arcs = self.motion.arcs.duration > 1e-9
        each = max(4, -(-least // (int(np.sum(arcs)) * self.repeats)))
        begin, spans = self.motion.breaks[:-1][arcs], self.motion.arcs.duration[arcs]
        t = (begin[:, None] + spans[:, None] * np.linspace(1e-9, 1 - 1e-9, each)).ravel()
        shares = np.sort(np.mod(t - self.start, TURN))
        every = np.add.outer(TURN * np.arange(self.repeats), shares).ravel() / self.repeats
        return np.concatenate([[0.0], every[(every > 0) & (every < TURN)], [TURN]])


def best_wave(
    limits: WaveLimits,
    aim: WaveAim,
    *,
    crests: int = 3,
    near: DesignedWave | None = None,
    mesh: Mesh | None = None,
    tolerance: float = 1e-9,
    report: Report = silent,
) -> DesignedWave:
    """Find the best wave of a film of magnetic fluid.

    Starts are cosine waves of 1, 2, ... equal crests. Objectives that refer to a crest also start
    from waves with one crest higher than the others.

    Parameters
    ----------
    limits : WaveLimits
        Limits of the wave.
    aim : WaveAim
        Objective of the wave.
    crests : int, optional
        Largest number of crests at the start.
    near : DesignedWave, optional
        Additional start: the best wave for another objective within the same limits.
    mesh : Mesh, optional
        Mesh of the first solves.
    tolerance : float, optional
        Accepted local error on each arc at the end.
    report : callable, optional
        Receives the progress.

    Returns
    -------
    DesignedWave
        The best local optimum found.

    Raises
    ------
    SolveError
        If no start leads to a wave.

    Examples
    --------
    Of all waves with a thickness between 0.5 and 1.5, none has a mean flow above 0.464286; this
    one comes near:

    >>> import wormopt as wo
    >>> limits = wo.film.WaveLimits(tension=0.1, thickness=(0.5, 1.5), field=4.0)
    >>> wave = wo.film.best_wave(limits, wo.film.WaveAim(), crests=1)  # doctest: +SKIP
    >>> round(wave.mean_flow, 6)  # doctest: +SKIP
    0.448393
    """
    waves: list[DesignedWave] = []
    tries: list[Try] = []
    error: SolveError | None = None
    starts = [*_starts(aim, crests, near)]
    for k, (name, repeats, guess) in enumerate(starts):
        report(f"start: {name}", k / (len(starts) + 1))
        try:
            first = _first(limits.single(repeats), aim, guess, mesh or _PLAIN)
        except SolveError as failed:
            error = failed
            tries.append(Try(name, repeats))
            continue
        wave = DesignedWave({"first": first}, limits, repeats, ())
        waves.append(wave)
        tries.append(Try(name, repeats, wave.crests, wave.reached))
    if not waves:
        raise error or SolveError("crests is 0, so there is no start", "write at least one crest")
    best = _chosen(waves)
    report("phases of the field", len(starts) / (len(starts) + 1))
    stages = _exact_phases(best.optimum, tolerance, report)
    return replace(best, stages=stages, tries=tuple(tries))


def _starts(
    aim: WaveAim, crests: int, near: DesignedWave | None
) -> Iterator[tuple[str, int, Guess | int]]:
    """Name, repeats, and a guess, or the second harmonic of a guess."""
    if near is not None:
        guess = near.guess(on_crest=aim.on_crest)
        yield "the best wave for another aim", near.repeats, guess
    for n in range(1, crests + 1):
        yield "1 crest" if n == 1 else f"{n} equal crests", n, 1
    for n in range(2, crests + 1) if aim.on_crest else ():
        yield f"{n} crests, one higher", 1, n


def _chosen(waves: list[DesignedWave]) -> DesignedWave:
    """Best wave; of equally good waves with the same number of crests that of most repeats."""
    sign = 1 if waves[0].limits.field is None else -1
    best = min(waves, key=lambda wave: sign * wave.reached)
    size = max(abs(best.reached), 1e-300)
    alike = [
        wave
        for wave in waves
        if wave.crests == best.crests and abs(wave.reached - best.reached) <= _ALIKE * size
    ]
    most = max(wave.repeats for wave in alike)
    return min((w for w in alike if w.repeats == most), key=lambda wave: sign * wave.reached)


def _first(limits: WaveLimits, aim: WaveAim, guess: Guess | int, mesh: Mesh) -> Optimum:
    """Solve on an even mesh; narrower fronts are continued from a larger tension."""
    # an input of the curvature's degree: h'' = (m - B) / W is then 0 on plateaus, not only at nodes
    lower = 2 if limits.gradient is None else 3
    mesh = replace(mesh, input_degree=max(0, mesh.collocation.degree - lower))
    tensions = (limits.tension,) if isinstance(guess, Guess) else _tensions(limits, aim)
    optimum, solver = None, Ipopt()
    for tension in tensions:
        there = replace(limits, tension=tension)
        if optimum is not None:
            solver = _NEAR  # a large barrier would lead to waves with other numbers of crests
            optimum = refine(optimum, _COARSE, rounds=2, solver=solver)
            mesh, guess = optimum.motion.mesh, optimum.motion.guess
        elif not isinstance(guess, Guess):
            guess = wave_guess(there, aim, second=guess)
        assert isinstance(guess, Guess)
        problem = wave_problem(there, aim)
        optimum = optimise(problem, mesh, Regularised(_WIDTH, _WIDTH), guess, solver=solver)
    assert optimum is not None
    return optimum


def _tensions(limits: WaveLimits, aim: WaveAim) -> tuple[float, ...]:
    """Tensions from one whose fronts are wide enough down to that of the film."""
    wide = _FRONT**2 * nearby_cosine(limits, aim)[1]
    steps = max(0, math.ceil(math.log(wide / limits.tension) / math.log(_STEP)))
    if not steps:
        return (limits.tension,)
    return tuple(np.geomspace(wide, limits.tension, steps + 1).tolist())


# -- phases at whose ends the field switches -------------------------------------------------------


def _exact_phases(first: Optimum, tolerance: float, report: Report) -> dict[str, Optimum]:
    """Find the phases between switches of the field, with free ends and high polynomials."""
    # Many arcs are used where phases fail: with a limited slope the field switches infinitely often
    # before the film reaches a bound of its thickness. Returns all solves by name, the best last.
    near = replace(_TIGHT, warm=True, mu_init=1e-5)
    shown = refine(first, _SHOWN, rounds=_ROUNDS, solver=near)
    stages, best = {"first": first, "refined": shown}, None
    enough = shown.objective + _LOST * abs(shown.objective)
    steep = "field" in [signal.name for signal in first.motion.program.problem.model.x]
    for active, durations in () if steep else _readings(shown.motion):
        report(f"{len(durations)} phases", None)
        try:
            found = _between(shown.motion, active, durations)
            if best is None or found.objective < best.objective:
                best = refine(found, tolerance, solver=replace(near, mu_init=1e-6))
        except SolveError:
            continue
        if best.objective <= enough:
            return {**stages, "phases": _touching(best, tolerance)}
    report("finer arcs", None)
    return {**stages, "finer": refine(shown, tolerance, solver=near)}


def _touching(found: Optimum, tolerance: float) -> Optimum:
    """Let the field stay at limits that it reaches at the end of a phase, if that is better."""
    motion = found.motion
    assert isinstance(found.treatment, Regularised)
    active, edges = found.treatment.active or (), motion.phase_breaks()
    phases: list[tuple[int, ...]] = []
    spans: list[float] = []
    for k, held in enumerate(active):
        span = edges[k + 1] - edges[k]
        inside = np.array([edges[k], edges[k + 1]]) + 1e-6 * span * np.array([1, -1])
        before, after = (_limit(motion, float(t)) if not any(held) else 0 for t in inside)
        beside = active[k - 1], active[(k + 1) % len(active)]
        short = _BRIEF * motion.duration
        if before and (before,) != beside[0]:
            phases.append((before,))
            spans.append(short)
        phases.append(held)
        spans.append(span)
        if after and (after,) != beside[1]:
            phases.append((after,))
            spans.append(short)
    if len(phases) == len(active):
        return found
    try:
        more = _between(motion, tuple(phases), np.array(spans))
        more = refine(more, tolerance, solver=replace(_TIGHT, mu_init=1e-6, warm=True))
    except SolveError:
        return found
    return more if more.objective < found.objective else found


def _limit(motion: Motion, t: float) -> int:
    """Limit that the input touches at some time: -1, 1, or 0 for none."""
    (signal,) = motion.program.problem.model.u
    share = (motion.inputs(np.array([t]))[0, 0] - signal.lower) / (signal.upper - signal.lower)
    return int(share >= 1 - _TOUCH) - int(share <= _TOUCH)


def _readings(motion: Motion) -> Iterator[tuple[tuple[tuple[int, ...], ...], np.ndarray]]:
    """Phases by the width that counts as noise."""
    seen = set()
    for least in (2, 3, 1):
        found = structure_of(motion, speed=None, least=least)
        if found.active not in seen:
            seen.add(found.active)
            yield found.active, found.durations


def _between(motion: Motion, active: tuple[tuple[int, ...], ...], durations: np.ndarray) -> Optimum:
    falls = motion.mesh.collocation.degree - motion.mesh.input_degree
    counts = tuple(_HALVES if any(each) else 1 for each in active)
    mesh = Mesh.even(len(counts), counts, _EXACT, _EXACT.degree - falls)
    return optimise(
        motion.program.problem,
        mesh,
        Regularised(_WIDTH, _WIDTH, active=active),
        replace(motion.guess, phases=durations),
        solver=_TIGHT,
    )
