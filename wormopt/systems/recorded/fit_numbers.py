"""Kind "fit-numbers": keys of another scene estimated from single measured numbers."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Literal

from msgspec import structs

from wormopt.errors import Fault, SceneError, SolveError
from wormopt.kinds import KINDS
from wormopt.quantities import Scalar, unit_of
from wormopt.result import Check
from wormopt.study import (
    Given,
    Scene,
    array,
    attributes,
    checks,
    entry,
    facts,
    load_scene,
    on_use,
    parts,
    positive,
    scalar,
    scalars,
    stage,
    warnings,
    whole,
)
from wormopt.study.given import meaning
from wormopt.study.members import NotComputedError
from wormopt.systems.recorded.found import Found
from wormopt.systems.recorded.tables import (
    FromScene,
    KeyUnknown,
    Level,
    Measured,
    named_twice,
    near,
    scene_of,
    value_at,
)

with on_use():
    import numpy as np
    from scipy.optimize import least_squares

    from wormopt.fitting.information import covariance_of, held_at, offset_of, spectrum
    from wormopt.systems.recorded.numbers_task import Looked, NumbersTask

# Smallest relative reduction of a prior error that counts as informed by the measurements.
_TELLS = 0.1
_FINEST = 0.5  # smallest distance of neighbours in a compass search, in steps
_SETTLED = 1e-8  # relative change of the cost, and of a parameter, that ends the search


class NumberSearch(Given):
    """Search for the estimates."""

    method: Literal["slopes", "compass"] = entry(
        "`slopes`: Gauss-Newton steps; `compass`: move to the best neighbour at distance "
        "`step`, then halve the distance, for results too irregular to have derivatives",
        default="slopes",
    )
    steps: int = whole(1, 1000, "largest number of steps", default=20)
    accepted: float = positive(
        "1",
        "largest distance from the minimum accepted as converged, in standard errors; "
        "`compass` has converged if no neighbour is better",
        default=0.1,
    )


@dataclass(frozen=True)
class Estimates:
    """Where the search ended, with weighted residuals and their derivatives there."""

    theta: np.ndarray  # coordinates
    residuals: np.ndarray
    jacobian: np.ndarray
    ended: str  # why the search ended before it converged; empty otherwise
    gain: float | None = None  # gain by the best neighbour of a compass search


class FitNumbers(FromScene, kind="fit-numbers"):
    """Estimate keys of a scene from single measured values, such as velocities.

    An example is a set of velocities at several frequencies. `[model]` may contain any scene. It is
    run for every measurement, with its `changes`, as often
    as the search needs. A `prior` counts as a measurement, so there may be fewer measurements than
    unknowns. The trust report states which parameters the measurements inform. Derivatives are
    finite differences with the given steps. Irregular results need large steps and the method
    `compass`. Guide: [fitting](../fitting.md).

    Results contain the estimate of every parameter as a scalar of its name, with `NAME_error` and
    `NAME_interval`. Exit code 3: the search did not converge, or the scene fails at the estimates.
    """

    pictures: ClassVar = {
        "measurements": "measured and computed values",
        "parameters": "estimates with intervals",
        "correlation": "of the errors",
    }
    table_file = True

    measured: tuple[Measured, ...] = entry("measurements")
    unknown: tuple[KeyUnknown, ...] = entry("parameters to estimate")
    search: NumberSearch = entry("the search", default=NumberSearch)
    level: Level = entry("confidence of the intervals", quantity="share", default=0.95)

    def faults_of_keys(self) -> Iterator[Fault]:
        for key in ("measured", "unknown"):
            if not getattr(self, key):
                yield key, f"no entry is given; write a table [[{key}]]"
        yield from named_twice((unknown.name for unknown in self.unknown), "unknown")
        if self.measured and all(one.use == "predict" for one in self.measured):
            yield "measured", 'all have use = "predict"; write use = "fit" for at least one'
        fitted = sum(one.use == "fit" for one in self.measured)
        free = sum(unknown.prior is None for unknown in self.unknown)
        if free > fitted:
            yield (
                "unknown",
                f"{free} unknowns without a prior, but {fitted} measurements; write priors",
            )
        try:
            scene = scene_of(self.model, self.folder, self.units)
        except SceneError as error:
            yield from error.faults
            return
        yield from self._faults_beside(scene)

    def _faults_beside(self, scene: Scene[Any]) -> Iterator[Fault]:
        known = KINDS[scene.table.kind].load().scalars
        for k, one in enumerate(self.measured):
            if one.scalar not in known:
                what = f'results of kind "{scene.table.kind}" have no scalar "{one.scalar}"'
                yield f"measured[{k}].scalar", f"{what}; {near(one.scalar, known)}"
            yield from _faults_of_changes(scene, one.changes, f"measured[{k}].changes")
        for k, unknown in enumerate(self.unknown):
            for key in unknown.keys:
                value = value_at(scene, key)
                if not isinstance(value, int | float) or isinstance(value, bool):
                    what = f"{key} is not a number of the scene in [model]"
                    yield f"unknown[{k}].key", f'{what}; write for example "worm.mass"'
                elif unknown.start is not None:
                    yield from _faults_of_changes(
                        scene, {key: unknown.start}, f"unknown[{k}].start"
                    )

    # -- the search --------------------------------------------------------------------------------

    @cached_property
    def task(self) -> NumbersTask:
        """Residuals of the scene in `[model]`; it keeps what was computed."""
        scene = scene_of(self.model, self.folder, self.units)
        return NumbersTask(scene, self.measured, self.unknown, self.report)

    @cached_property
    def points(self) -> list[np.ndarray]:
        """Coordinates to which the search came, the best or last of them at the end."""
        return [self.task.start]

    @stage
    def begun(self) -> Looked:
        begun = self.task.look([self.task.start])[0]
        if not np.isfinite(begun.values[self.task.fitted]).all():
            reason = f"cannot be computed at the start of the search: {begun.reasons[0]}"
            raise SolveError(f"the scene in [model] {reason}", "write another start")
        return begun

    @stage
    def estimation(self) -> Estimates:
        _ = self.begun
        return self._by_compass() if self.search.method == "compass" else self._by_slopes()

    def _by_slopes(self) -> Estimates:
        """Minimise by Gauss-Newton steps."""
        task, steps = self.task, self.search.steps
        jacobians: dict[bytes, np.ndarray] = {}

        def slopes(theta: np.ndarray) -> np.ndarray:
            self.points.append(np.array(theta))
            key = np.ascontiguousarray(theta).tobytes()
            if key not in jacobians:
                jacobians[key] = task.residuals(theta)[1]
            return jacobians[key]

        found = least_squares(
            task.misfit, task.start, slopes,  # pyright: ignore[reportArgumentType]
            task.bounds, x_scale=task.nominal, ftol=_SETTLED, xtol=_SETTLED, gtol=1e-12,
            max_nfev=steps,
        )  # fmt: skip
        ended = "" if found.status > 0 else f"it ended after {steps} steps; increase search.steps"
        theta = np.asarray(found.x)
        return Estimates(theta, *task.residuals(theta), ended)

    def _by_compass(self) -> Estimates:
        """Move to the best of all neighbours, or halve the steps, until none is better."""
        task, share = self.task, 1.0

        def squares(theta: np.ndarray) -> float:
            r = task.misfit(theta)
            return float(r @ r)

        for _ in range(self.search.steps):
            here = self.points[-1]
            around = task.neighbours(here, share)
            task.look(around)
            nearest = min(around, key=squares)
            if squares(nearest) < squares(here):
                self.points.append(nearest)
            elif share > _FINEST:
                share /= 2
            else:
                break
        here = self.points[-1]
        r, jacobian = task.wide_residuals(here, _FINEST)
        gain = max(float(r @ r) - min(map(squares, task.neighbours(here, _FINEST))), 0.0)
        ended = "a neighbour is still better; increase search.steps" if gain else ""
        return Estimates(here, r, jacobian, ended, gain)

    # -- the estimates -----------------------------------------------------------------------------

    @cached_property
    def covariance(self) -> np.ndarray:
        """Covariance of the coordinates, (n, n), infinite where not identifiable."""
        nominal = self.task.nominal
        return covariance_of(spectrum(self.estimation.jacobian, nominal), nominal)

    @cached_property
    def errors(self) -> dict[str, float]:
        """Standard error of each coordinate, infinite where not identifiable."""
        spread = np.sqrt(np.diag(self.covariance))
        return dict(zip(self.task.names, spread.tolist(), strict=True))

    @cached_property
    def free(self) -> np.ndarray:
        """Whether each parameter is free, not held by a bound."""
        found = self.estimation
        return ~held_at(self.task.bounds, found.theta, found.jacobian.T @ found.residuals)

    @parts(Found)
    def found(self) -> Found:
        task, theta = self.task, self.estimation.theta
        units, began = [*map(self.unit, self.unknown)], task.values(task.start).tolist()
        return Found.of(task.names, units, began, task, theta, self.covariance, self.level)

    def unit(self, unknown: KeyUnknown) -> str:
        """Return the unit of a key from its declaration in the table of the scene."""
        table: Any = self.task.scene.table
        *path, last = unknown.keys[0].split(".")
        for part in path:
            table = getattr(table, part, None)
        fields = structs.fields(table) if hasattr(table, "__struct_fields__") else ()
        quantity = next((meaning(one.type)[0] for one in fields if one.name == last), "")
        return unit_of(quantity, self.units) if quantity else "1"

    @scalars({})
    def estimates(self) -> dict[str, Scalar]:
        return self.found.scalars

    @scalar("count", "number of fitted measurements")
    def n_measurements(self) -> int:
        return sum(one.use == "fit" for one in self.measured)

    @scalar("count", "number of estimated parameters")
    def n_unknowns(self) -> int:
        return len(self.unknown)

    @scalar("count", "number of runs of the scene")
    def n_runs(self) -> int:
        with suppress(NotComputedError):  # of a search that was stopped: the runs before
            _ = self.estimation
        return self.task.runs

    @scalar("1", "half the sum of the squared weighted residuals, priors included")
    def cost(self) -> float:
        return float(self.estimation.residuals @ self.estimation.residuals) / 2

    @scalar(
        "1",
        "distance of the end of the search from the minimum by derivatives, in standard errors",
    )
    def offset(self) -> float:
        return offset_of(self.estimation.residuals, self.estimation.jacobian, self.free)

    @cached_property
    def reductions(self) -> dict[str, float]:
        """Relative reduction of each prior error by the measurements."""
        return {u.name: 1 - self.errors[u.name] / u.prior[1] for u in self.unknown if u.prior}

    @scalar(
        "share",
        "relative reduction of the prior error of each parameter by the measurements, a list",
    )
    def prior_reduction(self) -> list[float]:
        return [*self.reductions.values()]

    # -- measurements ------------------------------------------------------------------------------

    @cached_property
    def look(self) -> Looked:
        """Results of the scene with the estimates."""
        return self.task.look([self.estimation.theta])[0]

    @array("count", "measurement", "measured values", name="measured")
    def values(self) -> np.ndarray:
        return np.array([one.value for one in self.measured])

    @array("count", "measurement", "standard deviations of the measurements")
    def deviation(self) -> np.ndarray:
        return np.array([one.deviation for one in self.measured])

    @array("count", "measurement", "values computed with the estimates")
    def fitted(self) -> np.ndarray:
        return self.look.values

    @array("count", "measurement", "values computed with the initial parameters")
    def at_start(self) -> np.ndarray:
        return self.begun.values

    @array("count", "measurement", "value of the key that differs, if there is one")
    def changed(self) -> np.ndarray | None:
        key = self.changed_key
        return np.array([float(one.changes[key]) for one in self.measured]) if key else None

    @property
    def changed_key(self) -> str:
        """The key in which measurements differ, if it has one number for each; else ""."""
        keys = {key for one in self.measured for key in one.changes}
        if len(keys) != 1:
            return ""
        (key,) = keys
        values = [one.changes.get(key) for one in self.measured]
        return key if all(isinstance(value, int | float) for value in values) else ""

    # -- trust -------------------------------------------------------------------------------------

    @checks
    def converged(self) -> Iterator[Check]:
        found, accepted = self.estimation, self.search.accepted
        advice = found.ended or (
            f"the next step would be {self.offset:.2g} standard errors; increase search.steps, or "
            "change the steps of the unknowns if results are irregular"
        )
        advice = f"the search did not converge: {advice}"
        if found.gain is None:
            passed = not found.ended and self.offset <= accepted
            yield Check("distance from the bottom", self.offset, accepted, advice, passed)
        else:  # a compass search has no slopes, hence no distance
            yield Check("gain by the best neighbour", found.gain, 0.0, advice)
        reasons = self.look.reasons
        advice = f"the scene in [model] fails at the estimates: {reasons[0] if reasons else ''}"
        yield Check("failed runs at the estimates", float(len(reasons)), 0.0, advice)

    @warnings
    def doubts(self) -> Iterator[str]:
        for name, share in self.reductions.items():
            if share < _TELLS:
                yield (
                    f"{name} is known from its prior only: measurements reduce its error by "
                    f"{share:.0%}"
                )
        for name, free in zip(self.task.names, self.free, strict=True):
            if not free:
                yield f"{name} is at its bound"
        for name, error in self.errors.items():
            if not np.isfinite(error):
                yield (
                    f"{name} is not identifiable from the measurements; write a prior, or measure "
                    "more"
                )
        fitted = [one for one in self.measured if one.use == "fit"]
        for one, off in zip(fitted, self.estimation.residuals[: len(fitted)], strict=True):
            if abs(off) > 3:
                yield (
                    f"{one.name} is off by {abs(off):.2g} standard deviations: the model does not "
                    "explain it"
                )
        for one, value in zip(self.measured, self.look.values.tolist(), strict=True):
            if one.use == "predict" and not abs(value - one.value) <= 3 * one.deviation:
                yield (
                    f"{one.name} differs from its prediction: measured {one.value:.4g}, predicted "
                    f"{value:.4g}"
                )

    @facts
    def known(self) -> dict[str, Any]:
        return {
            "prior_reduction": self.reductions,
            "derivatives": "differences of runs, with the step of each unknown",
            "at_bound": [n for n, f in zip(self.task.names, self.free, strict=True) if not f],
        }

    @attributes
    def shown(self) -> dict[str, Any]:
        table = self.task.scene.table
        units = [unit_of(table.scalars[one.scalar][0], table.units) for one in self.measured]
        return {
            "unknowns": [*self.found.names],
            "unknown_units": [*self.found.units],
            "measurements": [one.text or one.scalar for one in self.measured],
            "scalars": [one.scalar for one in self.measured],
            "scalar_units": units,
            "uses": [one.use for one in self.measured],
            "changed_key": self.changed_key,
            "table": self.found.markdown(self.level),
        }

    @property
    def facts(self) -> dict[str, Any]:
        """Parameters at the current point of a search that did not end, for partial results."""
        if "points" not in vars(self) or "estimation" in vars(self):
            return super().facts
        values = self.task.values(self.points[-1]).tolist()
        return super().facts | {"came_to": dict(zip(self.task.names, values, strict=True))}


def _faults_of_changes(scene: Scene[Any], changes: dict[str, Any], key: str) -> Iterator[Fault]:
    try:
        load_scene(scene, changes)
    except SceneError as error:
        yield from ((key, f"{where}: {what}") for where, what in error.faults)
