"""Run scenes of kind ``resonance``: steady motions of the pair over the frequency of its field."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from wormopt.analysis.continuation import Branch
from wormopt.analysis.steady import rates_of
from wormopt.errors import Interrupted
from wormopt.magnetics.material import SMALL_STRAIN
from wormopt.progress import Report
from wormopt.result import Check, Result, left_out
from wormopt.study.conclude import conclude
from wormopt.study.scene import Scene
from wormopt.systems.pair.runs.pair import Scales, no_steady_motion, pair_of, warnings_of_pair
from wormopt.systems.pair.scenes.magnetic_pair import ResonanceScene
from wormopt.systems.pair.steady import Exact, Pair, Points, branches_of, confirmed, points_of
from wormopt.systems.shared.settings import tolerance_of

# Accepted relative difference between steady states of eqs. 18 and 19.
_CLOSED = 1e-9


@np.errstate(all="ignore")  # values that are not finite are noticed where they matter
def run(scene: Scene[ResonanceScene], report: Report) -> Result:
    """Continue the steady motions of the averaged pair in the frequency, and confirm them.

    Raises SolveError without a steady motion; Interrupted, with the branches in `partial`, if the
    user stops the exact motions.
    """
    table, begin = scene.table, time.perf_counter()
    pair = pair_of(table.pair, table.averaging.nodes)
    low, high = table.frequencies.detuning
    report("averaging", 0.0)
    branches = branches_of(pair, (low, high), table.frequencies.largest)
    if not branches:
        raise no_steady_motion(scene, pair.why_none((low + high) / 2 or high))
    points = points_of(pair, branches, np.linspace(low, high, table.frequencies.points))
    timings, exact = {"follow": time.perf_counter() - begin}, None
    if table.confirm is not None:
        end, periods = table.confirm.time, table.confirm.periods
        try:
            tolerance = tolerance_of(table.tolerance)
            exact = confirmed(pair, points, end, periods, tolerance, report)
        except Interrupted:
            partial = _result(scene, pair, branches, points, None, timings)
            reason = "interrupted before the exact motions were complete"
            raise Interrupted(partial.failed(reason)) from None
    timings["confirm"] = time.perf_counter() - begin - timings["follow"]
    return _result(scene, pair, branches, points, exact, timings)


def _result(
    scene: Scene[ResonanceScene],
    pair: Pair,
    branches: list[Branch],
    points: Points,
    exact: Exact | None,
    timings: dict[str, float],
) -> Result:
    found = [
        pair.closed_form_difference(x, float(detuning))
        for detuning, x in zip(points.detuning, points.x, strict=True)
    ]
    difference = max((d for d in found if d is not None), default=None)
    advice = f"steady states differ from eq. 19 by {difference or 0:.2g}"
    check = Check("closed form (19)", difference, _CLOSED, advice)
    return conclude(
        scene,
        _scalars(scene.table, pair, branches, points, exact),
        _variables(scene.table, pair, branches, points, exact),
        checks=() if difference is None else (check,),
        facts=_facts(scene.table, pair, branches, points, exact)
        | {"closed_form_difference": difference},
        warnings=_warnings(pair, branches, points, exact),
        timings=timings,
    )


# -- results ---------------------------------------------------------------------------------------


def _scalars(
    table: ResonanceScene, pair: Pair, branches: list[Branch], points: Points, exact: Exact | None
) -> dict[str, Any]:
    speed = Scales.of(table.pair).speed
    scalars = {
        "eps": pair.eps,
        "delta_fold": sorted(pair.detuning(f.parameter) for b in branches for f in b.folds),
        "branches": len(branches),
        "steady_motions": len(points.detuning),
        "stable": int(points.stable.sum()),
        "velocity_largest": float(np.abs(points.velocity).max()) * speed,
    }
    if table.pair.sample is not None:
        scalars["u0"] = table.pair.sample.strain
    if exact is not None:
        first, second = (
            _largest(np.abs(found - exact.velocity)[exact.settled])
            for found in (points.velocity, points.second)
        )
        scalars |= {"averaging_error": first, "averaging_error_second": second}
        scalars["confirmed"] = int(exact.settled.sum())
    return scalars


def _largest(values: np.ndarray) -> float | None:
    known = values[np.isfinite(values)]
    return float(known.max()) if known.size else None


def _variables(
    table: ResonanceScene, pair: Pair, branches: list[Branch], points: Points, exact: Exact | None
) -> dict[str, np.ndarray]:
    scales = Scales.of(table.pair)
    found = {
        "detuning": points.detuning,
        "velocity_steady": points.velocity * scales.speed,
        "amplitude_steady": points.amplitude * scales.length,
        "stable_point": points.stable,
        "branch": points.branch,
        "velocity_second": points.second * scales.speed,
    }
    if exact is not None:
        found["velocity_exact"] = exact.velocity * scales.speed
    x = np.concatenate([branch.x for branch in branches])
    numbers = [np.full(len(branch.x), k) for k, branch in enumerate(branches)]
    return found | {
        "curve_detuning": pair.detuning(np.concatenate([b.parameter for b in branches])),
        "curve_velocity": x[:, 0] * scales.speed,
        "curve_amplitude": np.hypot(x[:, 1], x[:, 2]) * scales.length,
        "curve_stable": np.concatenate([branch.stable for branch in branches]),
        "curve_branch": np.concatenate(numbers),
    }


def _facts(
    table: ResonanceScene, pair: Pair, branches: list[Branch], points: Points, exact: Exact | None
) -> dict[str, Any]:
    rates = rates_of(pair.averages[0])
    nearest = int(np.argmin(np.abs(points.detuning - table.frequencies.detuning[1])))
    p = rates.parameters({"frequency": pair.frequency(float(points.detuning[nearest]))})
    state = rates.steady(points.x[nearest], p)
    return {
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
    }


def _warnings(
    pair: Pair, branches: list[Branch], points: Points, exact: Exact | None
) -> Iterator[str]:
    yield from warnings_of_pair(pair, None)
    runaways = sum("runaway" in branch.ends for branch in branches)
    if runaways:
        yield (
            f"{runaways} branches are unbounded: nothing limits the swing at the natural "
            "frequency, and the law of the material is for small strains"
        )
    lost = sum("lost" in branch.ends or "steps" in branch.ends for branch in branches)
    if lost:
        yield f"{lost} branches ended before the end of the sweep"
    strains = 2 * points.amplitude
    if np.any(strains > SMALL_STRAIN):
        yield left_out(
            float(np.median(strains)),
            f"{np.mean(strains > SMALL_STRAIN):.0%} of the steady motions stretch the link by "
            f"more than {SMALL_STRAIN:.0%}, but the law of the material assumes small strains",
        )
    small = float(np.mean(~pair.swung(points.x[:, 1:].T)))
    if small:
        yield (
            f"{small:.0%} of the steady motions have too small a swing, compared with eps, for an "
            "average of second order"
        )
    without = len(set(points.detuning.tolist()) - set(points.detuning[points.stable].tolist()))
    if without:
        yield f"no stable steady motion was found at {without} of the detunings"
    if exact is None:
        return
    unsettled = int(points.stable.sum()) - int(exact.settled.sum())
    if unsettled:
        yield f"{unsettled} exact motions have not converged; write a longer confirm.time"
    apart = int(np.sum(np.abs(points.velocity - exact.velocity)[exact.settled] > pair.eps))
    if apart:
        yield (
            f"{apart} exact motions converge to a velocity that differs from the average by "
            "more than eps"
        )
