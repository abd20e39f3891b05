"""Runs scenes of kind ``fit-numbers``: keys of a scene estimated from single measured numbers."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from wormopt.errors import Interrupted, SolveError
from wormopt.fitting.uncertainty import covariance_of, held_at, offset_of, spectrum
from wormopt.progress import Report
from wormopt.quantities import unit_of
from wormopt.result import Check, Result
from wormopt.study.conclude import conclude
from wormopt.study.scene import Scene
from wormopt.systems.recorded.found import Found, Number, markdown
from wormopt.systems.recorded.numbers_task import Looked, NumbersTask
from wormopt.systems.recorded.scenes.fit_numbers import FitNumbersScene, KeyUnknown, MeasuredTable
from wormopt.systems.recorded.scenes.tables import scene_of

# Smallest relative reduction of a prior error that counts as informed by the measurements.
_TELLS = 0.1
_FINEST = 0.5  # smallest distance of neighbours in a compass search, in steps
_SETTLED = 1e-8  # relative change of the cost, and of a parameter, that ends the search


@dataclass(frozen=True, eq=False)
class _Study:
    """Estimates, and the scene's results with them."""

    scene: Scene[FitNumbersScene]
    task: NumbersTask
    theta: np.ndarray
    residuals: np.ndarray
    jacobian: np.ndarray
    ended: str  # why the search ended before it converged; empty otherwise
    gain: float | None = None  # gain by the best neighbour of a compass search

    @property
    def free(self) -> np.ndarray:
        """Whether each parameter is free, not held by a bound."""
        return ~held_at(self.task.bounds, self.theta, self.jacobian.T @ self.residuals)

    @property
    def offset(self) -> float:
        """Length of the next step, in standard errors, over sqrt(n)."""
        return offset_of(self.residuals, self.jacobian, self.free)

    @property
    def covariance(self) -> np.ndarray:
        """Covariance of the coordinates, (n, n), infinite where not identifiable."""
        return covariance_of(spectrum(self.jacobian, self.task.nominal), self.task.nominal)

    @property
    def look(self) -> Looked:
        """Results of the scene with the estimates."""
        return self.task.look([self.theta])[0]

    @property
    def tells(self) -> dict[str, float]:
        """Relative reduction of each prior error by the measurements."""
        errors = np.sqrt(np.diag(self.covariance))
        known = zip(self.task.unknowns, errors.tolist(), strict=True)
        return {u.name: 1 - error / u.prior[1] for u, error in known if u.prior}


@np.errstate(all="ignore")  # non-finite values are detected where they matter
def run(scene: Scene[FitNumbersScene], report: Report) -> Result:
    """Fit keys of a scene to measured numbers.

    The result is "failed" if the search did not converge, or if the scene fails at the estimates.
    Raises SolveError if the scene cannot be computed at the start, Interrupted by the user.
    """
    table, clock = scene.table, time.perf_counter()
    inner = scene_of(table.model, scene.folder, table.units)
    task = NumbersTask(inner, table.measured, table.unknown)
    task.say = lambda done, of: report(f"run {task.runs + done}", done / of)
    best: list[np.ndarray] = [task.start]
    try:
        begun = task.look([task.start])[0]
        if not np.isfinite(begun.values[task.fitted]).all():
            reason = f"cannot be computed at the start of the search: {begun.reasons[0]}"
            raise SolveError(f"the scene in [model] {reason}", "write another start")
        study = _search(scene, task, best)
        return _result(study, begun, {"search": time.perf_counter() - clock})
    except KeyboardInterrupt:
        partial = _partial(scene, task, best[-1])
        raise Interrupted(partial.failed("interrupted before the search ended")) from None


def _search(scene: Scene[FitNumbersScene], task: NumbersTask, best: list[np.ndarray]) -> _Study:
    """Minimise from the start; `best` collects the points, the best last."""
    if scene.table.search.method == "compass":
        return _compass(scene, task, best)
    jacobians: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}

    def slopes(theta: np.ndarray) -> np.ndarray:
        best.append(np.array(theta))
        key = np.ascontiguousarray(theta).tobytes()
        if key not in jacobians:
            jacobians[key] = task.residuals(theta)
        return jacobians[key][1]

    steps = scene.table.search.steps
    found = least_squares(
        task.misfit, task.start, slopes,  # pyright: ignore[reportArgumentType]
        task.bounds, x_scale=task.nominal, ftol=_SETTLED, xtol=_SETTLED, gtol=1e-12,
        max_nfev=steps,
    )  # fmt: skip
    ended = "" if found.status > 0 else f"it ended after {steps} steps; increase search.steps"
    r, jacobian = task.residuals(np.asarray(found.x))
    return _Study(scene, task, np.asarray(found.x), r, jacobian, ended)


def _compass(scene: Scene[FitNumbersScene], task: NumbersTask, best: list[np.ndarray]) -> _Study:
    """Move to the best of all neighbours, or halve the steps, until none is better."""
    share = 1.0
    for _ in range(scene.table.search.steps):
        here = best[-1]
        around = task.neighbours(here, share)
        task.look(around)
        nearest = min(around, key=lambda theta: _squares(task, theta))
        if _squares(task, nearest) < _squares(task, here):
            best.append(nearest)
        elif share > _FINEST:
            share /= 2
        else:
            break
    r, jacobian = task.wide_residuals(best[-1], _FINEST)
    better = min(_squares(task, theta) for theta in task.neighbours(best[-1], _FINEST))
    gain = max(float(r @ r) - better, 0.0)
    ended = "a neighbour is still better; increase search.steps" if gain else ""
    return _Study(scene, task, best[-1], r, jacobian, ended, gain)


def _squares(task: NumbersTask, theta: np.ndarray) -> float:
    r = task.misfit(theta)
    return float(r @ r)


# -- the result ------------------------------------------------------------------------------------


def _numbers(study: _Study) -> Found:
    task, units = study.task, study.scene.table.units
    began = task.values(task.start)
    table = [
        Number(u.name, _unit(study, u, units), float(b))
        for u, b in zip(task.unknowns, began, strict=True)
    ]
    return Found.of(table, task, study.theta, study.covariance, study.scene.table.level)


def _unit(study: _Study, unknown: KeyUnknown, units: str) -> str:
    """Unit of a key from its declaration in the scene's table."""
    from msgspec import structs

    from wormopt.study.given import meaning

    value: Any = study.task.scene.table
    *path, last = unknown.keys[0].split(".")
    for part in path:
        value = getattr(value, part, None)
    kinds = (
        {f.name: f.type for f in structs.fields(value)}
        if hasattr(value, "__struct_fields__")
        else {}
    )
    quantity = meaning(kinds[last])[0] if last in kinds else ""
    return unit_of(quantity, units) if quantity else "1"


def _result(study: _Study, begun: Looked, timings: Mapping[str, float]) -> Result:
    scene, task, numbers, tells = study.scene, study.task, _numbers(study), study.tells
    return conclude(
        scene,
        numbers.scalars
        | {
            "n_measurements": int(task.fitted.sum()),
            "n_unknowns": len(study.theta),
            "n_runs": task.runs,
            "cost": float(study.residuals @ study.residuals) / 2,
            "offset": study.offset,
            "tells": list(tells.values()),
        },
        numbers.variables | _measured(study, begun),
        checks=_checks(study),
        facts={
            "tells": tells,
            "derivatives": "differences of runs, with the step of each unknown",
            "at_bound": [n for n, f in zip(task.names, study.free, strict=True) if not f],
        },
        warnings=_warnings(study),
        timings=timings,
        attributes={
            "unknowns": list(numbers.names),
            "unknown_units": [number.unit for number in numbers.numbers],
            "measurements": [one.text or one.scalar for one in task.measured],
            "scalars": [one.scalar for one in task.measured],
            "scalar_units": [_unit_of_scalar(task, one.scalar) for one in task.measured],
            "uses": [one.use for one in task.measured],
            "changed_key": _changed(task) or "",
            "table": markdown(numbers, scene.table.level),
        },
    )


def _unit_of_scalar(task: NumbersTask, name: str) -> str:
    table = task.scene.table
    return unit_of(table.scalars[name][0], table.units)


def _partial(scene: Scene[FitNumbersScene], task: NumbersTask, theta: np.ndarray) -> Result:
    """Parameters at the current point of the search, without errors."""
    own = {u.name: float(v) for u, v in zip(task.unknowns, task.values(theta), strict=True)}
    return conclude(scene, {"n_runs": task.runs}, facts={"came_to": own})


def _changed(task: NumbersTask) -> str | None:
    """The key in which measurements differ, if it has one number for each; else None."""
    keys = {key for one in task.measured for key in one.changes}
    if len(keys) != 1:
        return None
    (key,) = keys
    values = [one.changes.get(key) for one in task.measured]
    return key if all(isinstance(v, int | float) for v in values) else None


def _measured(study: _Study, begun: Looked) -> dict[str, np.ndarray]:
    task, key = study.task, _changed(study.task)
    arrays: dict[str, Any] = {
        "measured": [one.value for one in task.measured],
        "deviation": [one.deviation for one in task.measured],
        "fitted": study.look.values,
        "at_start": begun.values,
    }
    if key is not None:
        arrays["changed"] = [float(one.changes[key]) for one in task.measured]
    return {name: np.array(values, dtype=float) for name, values in arrays.items()}


def _checks(study: _Study) -> Iterator[Check]:
    accepted = study.scene.table.search.accepted
    advice = study.ended or (
        f"the next step would be {study.offset:.2g} standard errors; increase search.steps, or "
        "change the steps of the unknowns if results are irregular"
    )
    advice = f"the search did not converge: {advice}"
    if study.gain is None:
        passed = not study.ended and study.offset <= accepted
        yield Check("distance from the bottom", study.offset, accepted, advice, passed)
    else:  # a compass search has no slopes, hence no such distance
        yield Check("gain by the best neighbour", study.gain, 0.0, advice)
    reasons = study.look.reasons
    said = f"the scene in [model] fails at the estimates: {reasons[0] if reasons else ''}"
    yield Check("failed runs at the estimates", float(len(reasons)), 0.0, said)


def _warnings(study: _Study) -> Iterator[str]:
    for name, share in study.tells.items():
        if share < _TELLS:
            yield (
                f"{name} is known from its prior only: measurements reduce its error by {share:.0%}"
            )
    for name, free in zip(study.task.names, study.free, strict=True):
        if not free:
            yield f"{name} is at its bound"
    errors = np.sqrt(np.diag(study.covariance))
    for name, error in zip(study.task.names, errors.tolist(), strict=True):
        if not np.isfinite(error):
            yield (
                f"{name} is not identifiable from the measurements; write a prior, or measure more"
            )
    left = np.array(study.residuals[: study.task.fitted.sum()])
    for one, off in zip([m for m in study.task.measured if m.use == "fit"], left, strict=True):
        if abs(off) > 3:
            yield (
                f"{_named(one)} is off by {abs(off):.2g} standard deviations: the model does not "
                "explain it"
            )
    yield from _of_aside(study)


def _named(one: MeasuredTable) -> str:
    changes = ", ".join(f"{key} = {value}" for key, value in one.changes.items())
    return one.text or one.scalar + (f" with {changes}" if changes else "")


def _of_aside(study: _Study) -> Iterator[str]:
    for one, value in zip(study.task.measured, study.look.values.tolist(), strict=True):
        if one.use == "predict" and not abs(value - one.value) <= 3 * one.deviation:
            yield (
                f"{_named(one)} differs from its prediction: measured {one.value:.4g}, predicted "
                f"{value:.4g}"
            )
