"""Scenes of kind ``resonance``: steady motions of the pair along the frequency of its field."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from wormopt.analysis.continuation import Branch, follow_branch
from wormopt.analysis.steady import SteadyState, rates_of
from wormopt.errors import Interrupted
from wormopt.magnetics.material import SMALL_STRAIN
from wormopt.progress import Report
from wormopt.quantities import Scalar, Variable, unit_of
from wormopt.result import Result
from wormopt.scene.scene import Scene
from wormopt.simulation.ensemble import Ensemble, Member, simulate_ensemble
from wormopt.systems.chain.runs.chains import tolerance_of
from wormopt.systems.pair.runs.pair import Pair, Scales, no_steady_motion, warnings_of_pair
from wormopt.systems.pair.scenes.magnetic_pair import ConfirmTable, ResonanceScene
from wormopt.systems.pair.scenes.pair_waveform import NATURAL

# Detunings at which steady states are searched to begin branches, as shares of the sweep.
_BEGINNINGS = (0.0, 0.13, 0.37, 0.63, 0.87, 1.0)
# Steady states that differ by less from those of a branch are on it.
_ALIKE = 1e-6
_MOST = 30  # branches
# Means over consecutive periods that differ by more have not settled.
_SETTLED = 1e-3
# Steady states of (18) and (19) shall agree to this, of their size.
_CLOSED = 1e-9


@dataclass(frozen=True, eq=False)
class _Points:
    """Steady states at the values of the sweep, all branches one after the other."""

    detuning: np.ndarray
    x: np.ndarray
    stable: np.ndarray
    branch: np.ndarray
    second: np.ndarray

    @property
    def velocity(self) -> np.ndarray:
        return self.x[:, 0]

    @property
    def amplitude(self) -> np.ndarray:
        return np.hypot(self.x[:, 1], self.x[:, 2])


@dataclass(frozen=True, eq=False)
class _Exact:
    """Mean velocities of exact motions from the stable points, NaN for others."""

    velocity: np.ndarray
    before: np.ndarray
    gave_up: int

    @property
    def settled(self) -> np.ndarray:
        """Whether the mean has come to its end."""
        size = np.maximum(np.abs(self.velocity), np.abs(self.before))
        return np.abs(self.velocity - self.before) <= _SETTLED * size


@np.errstate(all="ignore")  # what is not finite is noticed where it matters
def run(scene: Scene[ResonanceScene], report: Report) -> Result:
    """Follow the steady motions of the averaged pair, and confirm them.

    Raises SolveError without a steady motion; Interrupted, with the branches in `partial`,
    if the user stops the exact motions.
    """
    table, begin = scene.table, time.perf_counter()
    pair = Pair(table.pair, table.averaging.nodes)
    report("averaging", 0.0)
    branches = _branches(table, pair)
    if not branches:
        middle = sum(table.sweep.detuning) / 2
        raise no_steady_motion(scene, pair.why_none(middle or table.sweep.detuning[1]))
    points = _points(table, pair, branches)
    followed = time.perf_counter()
    exact = None
    if table.confirm is not None:
        try:
            exact = _confirmed(table, table.confirm, pair, points, report)
        except Interrupted:
            partial = _result(scene, pair, branches, points, None, {"follow": followed - begin})
            reason = "interrupted before the exact motions were done"
            raise Interrupted(replace(partial, status="failed", reason=reason)) from None
    timings = {"follow": followed - begin, "confirm": time.perf_counter() - followed}
    return _result(scene, pair, branches, points, exact, timings)


# -- averaged --------------------------------------------------------------------------------------


def _branches(table: ResonanceScene, pair: Pair) -> list[Branch]:
    """Branches through the steady states found at some detunings, each once."""
    low, high = table.sweep.detuning
    span = (pair.frequency(low), pair.frequency(high))
    found: list[Branch] = []
    places, seen = [low + share * (high - low) for share in _BEGINNINGS], 0
    while places:
        for state in pair.steady(places.pop(0)):
            if not any(_on(branch, state) for branch in found) and len(found) < _MOST:
                found.append(follow_branch(state, "frequency", span, largest=table.sweep.largest))
        for branch in found[seen:]:
            crossings = ((nu - NATURAL) / pair.eps for nu in _crossings(branch))
            places += [detuning for detuning in crossings if low <= detuning <= high]
        seen = len(found)
    return found


def _crossings(branch: Branch) -> Iterator[float]:
    """Where stability changes without a fold: other branches may begin there, on either side."""
    folds = np.array([fold.parameter for fold in branch.folds])
    for k in np.flatnonzero(np.diff(branch.stable)):
        ends = branch.parameter[k : k + 2]
        if np.any(np.abs(folds - ends[:, None]) < 1e-9):
            continue
        reach = max(abs(ends[1] - ends[0]), 1e-3 * np.ptp(branch.parameter))
        yield from (float(ends.min() - reach), float(ends.max() + reach))


def _on(branch: Branch, state: SteadyState) -> bool:
    place = rates_of(state.model).place("frequency")
    same = branch.at([state.p[place]])
    return any(np.abs(x - state.x).max() < _ALIKE for x in same.x)


def _points(table: ResonanceScene, pair: Pair, branches: list[Branch]) -> _Points:
    low, high = table.sweep.detuning
    grid = np.linspace(low, high, table.sweep.points)
    sampled = [branch.at(NATURAL + pair.eps * grid) for branch in branches]
    frequency = np.concatenate([branch.parameter for branch in sampled])
    x = np.concatenate([branch.x for branch in sampled])
    return _Points(
        (frequency - NATURAL) / pair.eps,
        x,
        np.concatenate([branch.stable for branch in sampled]),
        np.concatenate([np.full(len(b.parameter), k) for k, b in enumerate(sampled)]),
        _second(pair, x, frequency),
    )


def _second(pair: Pair, x: np.ndarray, frequency: np.ndarray) -> np.ndarray:
    """Velocities of the second average next to states of the first; NaN where there are none."""
    velocity = np.full(len(x), np.nan)
    large = pair.swung(x[:, 1:].T)
    if not large.any():
        return velocity
    rates = rates_of(pair.averages[1])
    p = np.tile(rates.parameters(None), (int(large.sum()), 1))
    p[:, rates.place("frequency")] = frequency[large]
    refined, found = rates.newton(x[large], p)
    velocity[large] = np.where(found, refined[:, 0], np.nan)
    return velocity


# -- exact -----------------------------------------------------------------------------------------


def _confirmed(
    table: ResonanceScene, confirm: ConfirmTable, pair: Pair, points: _Points, report: Report
) -> _Exact:
    """Simulate from every stable point."""
    which = np.flatnonzero(points.stable)
    members, marks = [], []
    for k in which:
        nu = pair.frequency(points.detuning[k])
        members.append(Member(x0=pair.start(points.x[k], nu), p={"frequency": nu}))
        length = 2 * np.pi / nu * confirm.periods
        marks.append([confirm.time - 2 * length, confirm.time - length, confirm.time])
    motions = simulate_ensemble(
        pair.exact,
        confirm.time,
        members,
        times=np.unique(marks),
        tolerance=tolerance_of(table.tolerance),
        report=report,
    )
    means = np.full((2, len(points.detuning)), np.nan)
    means[:, which] = _means(motions, np.array(marks)).T
    return _Exact(means[1], means[0], sum(code != "" for code in motions.codes))


def _means(motions: Ensemble, marks: np.ndarray) -> np.ndarray:
    """Displacement over time between the marks of every member, shape (N, 2)."""
    columns = np.searchsorted(motions.time, marks)
    center = motions.states[:, :2].mean(axis=1)
    places = np.take_along_axis(center, columns, axis=1)
    return np.diff(places, axis=1) / np.diff(marks, axis=1)


# -- what is told ----------------------------------------------------------------------------------


def _result(
    scene: Scene[ResonanceScene],
    pair: Pair,
    branches: list[Branch],
    points: _Points,
    exact: _Exact | None,
    timings: dict[str, float],
) -> Result:
    table, scales = scene.table, Scales.of(scene.table.pair)
    difference = _closed_form_difference(pair, points)
    wrong = difference is not None and difference > _CLOSED
    reason = f"steady states differ from (19) by {difference:.2g}" if wrong else ""
    return Result(
        scene=scene.name,
        kind=table.kind,
        title=scene.title,
        status="failed" if wrong else "ok",
        reason=reason,
        scalars=_scalars(table, pair, branches, points, exact, scales),
        variables=(*_variables(table, pair, branches, points, exact, scales),),
        trust=_trust(table, pair, branches, points, exact, difference),
        timings_s=timings,
        scene_text=scene.text,
    )


def _closed_form_difference(pair: Pair, points: _Points) -> float | None:
    """Largest difference from (19) of all points."""
    found = [
        pair.closed_form_difference(x, float(detuning))
        for detuning, x in zip(points.detuning, points.x, strict=True)
    ]
    return max((d for d in found if d is not None), default=None)


def _folds(pair: Pair, branches: list[Branch]) -> list[float]:
    return sorted((f.parameter - NATURAL) / pair.eps for b in branches for f in b.folds)


def _scalars(
    table: ResonanceScene,
    pair: Pair,
    branches: list[Branch],
    points: _Points,
    exact: _Exact | None,
    scales: Scales,
) -> dict[str, Scalar]:
    scalars = {
        "eps": Scalar(pair.eps),
        "delta_fold": Scalar(_folds(pair, branches)),
        "branches": Scalar(len(branches)),
        "steady_motions": Scalar(len(points.detuning)),
        "stable": Scalar(int(points.stable.sum())),
        "velocity_largest": Scalar(
            float(np.abs(points.velocity).max()) * scales.speed, unit_of("speed", table.units)
        ),
    }
    if table.pair.sample is not None:
        scalars["u0"] = Scalar(table.pair.sample.strain)
    if exact is not None:
        first, second = (
            _largest(np.abs(found - exact.velocity)[exact.settled])
            for found in (points.velocity, points.second)
        )
        scalars |= {
            "averaging_error": Scalar(first),
            "averaging_error_second": Scalar(second),
            "confirmed": Scalar(int(exact.settled.sum())),
        }
    return scalars


def _largest(values: np.ndarray) -> float | None:
    known = values[np.isfinite(values)]
    return float(known.max()) if known.size else None


def _variables(
    table: ResonanceScene,
    pair: Pair,
    branches: list[Branch],
    points: _Points,
    exact: _Exact | None,
    scales: Scales,
) -> Iterator[Variable]:
    speed, length = (unit_of(quantity, table.units) for quantity in ("speed", "length"))

    def of(name: str, unit: str, values: np.ndarray, what: str) -> Variable:
        dims = ("curve",) if name.startswith("curve") else ("point",)
        return Variable(name, unit, dims, values, what)

    V, a, s = "velocity of the centre", "amplitude of half the stretch", scales
    yield of("detuning", "1", points.detuning, "detuning of the field")
    yield of("velocity_steady", speed, points.velocity * s.speed, V)
    yield of("amplitude_steady", length, points.amplitude * s.length, a)
    yield of("stable_point", "1", points.stable, "whether it is stable")
    yield of("branch", "1", points.branch, "number of its branch")
    yield of("velocity_second", speed, points.second * s.speed, f"{V}, second order")
    if exact is not None:
        yield of("velocity_exact", speed, exact.velocity * s.speed, f"{V}, exact mean")
    curve = [
        np.concatenate(parts)
        for parts in zip(
            *(
                (
                    (b.parameter - NATURAL) / pair.eps,
                    b.x[:, 0],
                    np.hypot(b.x[:, 1], b.x[:, 2]),
                    b.stable,
                    np.full(len(b.x), k),
                )
                for k, b in enumerate(branches)
            ),
            strict=True,
        )
    ]
    yield of("curve_detuning", "1", curve[0], "detuning of the field")
    yield of("curve_velocity", speed, curve[1] * s.speed, V)
    yield of("curve_amplitude", length, curve[2] * s.length, a)
    yield of("curve_stable", "1", curve[3], "whether it is stable")
    yield of("curve_branch", "1", curve[4], "number of the branch")


def _trust(
    table: ResonanceScene,
    pair: Pair,
    branches: list[Branch],
    points: _Points,
    exact: _Exact | None,
    difference: float | None,
) -> dict[str, Any]:
    rates = rates_of(pair.averages[0])
    nearest = int(np.argmin(np.abs(points.detuning - table.sweep.detuning[1])))
    p = rates.parameters({"frequency": pair.frequency(float(points.detuning[nearest]))})
    state = rates.steady(points.x[nearest], p)
    return {
        "closed_form_difference": difference,
        "quadrature_error": pair.quadrature_error(state),
        "branch_ends": [list(branch.ends) for branch in branches],
        "exact": None
        if exact is None
        else {
            "motions": int(points.stable.sum()),
            "gave_up": exact.gave_up,
            "settled": int(exact.settled.sum()),
            "largest_drift": _largest(np.abs(exact.velocity - exact.before)),
        },
        "warnings": [*_warnings(pair, branches, points, exact)],
    }


def _warnings(
    pair: Pair, branches: list[Branch], points: _Points, exact: _Exact | None
) -> Iterator[str]:
    yield from warnings_of_pair(pair, None)
    runaways = sum("runaway" in branch.ends for branch in branches)
    if runaways:
        yield (
            f"{runaways} branches run away: nothing bounds the swing at the natural frequency, and "
            "the law of the material ends at small strains"
        )
    lost = sum("lost" in branch.ends or "steps" in branch.ends for branch in branches)
    if lost:
        yield f"{lost} branches were lost before they came to an end of the sweep"
    strained = float(np.mean(2 * points.amplitude > SMALL_STRAIN))
    if strained:
        yield (
            f"{strained:.0%} of the steady motions stretch the link by more than "
            f"{SMALL_STRAIN:.0%}: the law of the material assumes small strains"
        )
    small = float(np.mean(~pair.swung(points.x[:, 1:].T)))
    if small:
        yield (
            f"{small:.0%} of the steady motions swing too little against eps for an average of "
            "second order"
        )
    without = len(set(points.detuning.tolist()) - set(points.detuning[points.stable].tolist()))
    if without:
        yield f"at {without} of the detunings no stable steady motion was found"
    if exact is None:
        return
    unsettled = int(points.stable.sum()) - int(exact.settled.sum())
    if unsettled:
        yield f"{unsettled} exact motions have not settled; write a longer confirm.time"
    apart = int(np.sum(np.abs(points.velocity - exact.velocity)[exact.settled] > pair.eps))
    if apart:
        yield f"{apart} exact motions settle elsewhere than their average, by more than eps"
