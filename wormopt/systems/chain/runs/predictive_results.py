"""Results of predictive control: scalars, signals, checks and warnings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from wormopt.control.estimation import places
from wormopt.model.values import nominal_of
from wormopt.result import NOT_RECHECKED, Check, Result
from wormopt.study.conclude import conclude
from wormopt.systems.chain.copies import Draw, numbers_of
from wormopt.systems.chain.measured import balance, chain_checks
from wormopt.systems.chain.runs.predictive_tables import table_of
from wormopt.systems.chain.runs.predictive_task import ADAPTED, KNOWN, LOST, Row, Task
from wormopt.systems.chain.scenes.track_predictive import SHOWN
from wormopt.systems.shared.declared import JUDGED
from wormopt.systems.shared.proof import accepted_error
from wormopt.systems.shared.settings import tolerance_of
from wormopt.systems.shared.signals import fitted, gait_arrays, sample

# Accepted relative excess of the cost of predictive control over the open loop with a true model.
_AS_GOOD = 1e-6


def result_of(
    task: Task,
    rows: Sequence[Row],
    right: Sequence[float],
    draws: Sequence[Draw],
    known: Sequence[Sequence[dict[str, Any]]],
    timings: dict[str, float],
) -> Result:
    """Make the Result of all motions; `right` are the costs with a true model, open loop first."""
    scene = task.scene
    scalars = _scalars(task, rows, right, draws)
    drawn = {row.name: row.drawn for row in rows if row.drawn}
    drawn |= {name: [each[k] for each in known] for k, name in enumerate(KNOWN)}
    return conclude(
        scene,
        scalars,
        _signals(task, rows, draws),
        checks=_checks(task, rows, right),
        facts={
            "treatment": "smooth law in the optimiser, exact in every simulation",
            "recheck": {
                "error": {row.name: row.second and row.second.error for row in rows},
                "accepted": accepted_error(tolerance_of(scene.table.tolerance)),
            },
            "plan": {"violation": task.plan.violation, "steps": task.plan.steps},
        },
        warnings=_warnings(task, rows),
        timings=timings,
        attributes={
            "controllers": [row.name for row in rows],
            "parameters": _names(task),
            "table": table_of(scene.table, [r.name for r in rows], scalars, drawn),
        },
    )


def _scalars(
    task: Task, rows: Sequence[Row], right: Sequence[float], draws: Sequence[Draw]
) -> dict[str, Any]:
    table, receded = task.scene.table, [row.receded for row in rows]
    seconds = [each and each.seconds for each in receded]
    errors = [row.second.error for row in rows if row.second and row.second.error is not None]

    def quantile(share: float) -> list[float | None]:
        return [None if s is None else float(np.quantile(s, share)) for s in seconds]

    return {name: [row.numbers[name] for row in rows] for name in (*JUDGED, "cost")} | {
        "tube_radius": table.tube.radius,
        "objective_found": task.plan.objective,
        "plan_steps": task.plan.steps,
        "right_cost": right,
        "excess": _excess(right),
        "decisions": len(task.plan.times) - 1,
        "decisions_unsolved": [each and each.unsolved for each in receded],
        "decision_period": table.predictive.seconds * float(np.diff(task.plan.times).min()),
        "decision_median": quantile(0.5),
        "decision_most": quantile(0.95),
        "decision_worst": quantile(1.0),
        "decision_processor": [each and float(np.median(each.processor)) for each in receded],
        "decision_steps": [
            each and float(np.mean([d.steps for d in each.decisions])) for each in receded
        ],
        "parameter_error": _parameter_errors(task, rows, draws),
        "recheck_error": max(errors, default=None),
    }


def _names(task: Task) -> list[str]:
    """Names of estimated parameters, with numbers."""
    estimation = task.scene.table.estimation
    sizes = {s.name: s.size for s in task.plant.p}
    names = () if estimation is None else estimation.parameters
    return [
        f"{name} {k}" if sizes[name] > 1 else name for name in names for k in range(sizes[name])
    ]


def _estimates(task: Task, rows: Sequence[Row], draws: Sequence[Draw]) -> np.ndarray:
    """Estimated parameters over true values, shape (parameters, members, decisions)."""
    estimation = task.scene.table.estimation
    learnt = next((row.learnt for row in rows if row.name.endswith(ADAPTED)), [])
    if estimation is None or not draws or len(learnt) < len(draws):
        return np.zeros((0, 0, 0))
    own = numbers_of(task.plant)
    chosen = places(task.plan.stages, estimation.parameters)
    true = [
        np.concatenate([draw.get(name, own[name]) for name in estimation.parameters])
        for draw in draws
    ]
    found = [
        each.parameters[chosen] / numbers[:, None]
        for each, numbers in zip(learnt, true, strict=True)
    ]
    return np.array(found).transpose(1, 0, 2)


def _parameter_errors(
    task: Task, rows: Sequence[Row], draws: Sequence[Draw]
) -> list[list[float]] | None:
    """Errors by parameter: before estimation, and at the end."""
    shares, names = _estimates(task, rows, draws), _names(task)
    if not shares.size:
        return None
    off = np.log(shares[:, :, [0, -1]]) ** 2
    kinds = list(dict.fromkeys(name.split(" ")[0] for name in names))
    rows_of = [[k for k, name in enumerate(names) if name.split(" ")[0] == kind] for kind in kinds]
    return [np.sqrt(off[chosen].mean(axis=(0, 1))).tolist() for chosen in rows_of]


def _signals(task: Task, rows: Sequence[Row], draws: Sequence[Draw]) -> dict[str, Any]:
    table = task.scene.table
    sampled = []
    for row in rows:
        model = row.motion.system.model
        sampled.append(sample(row.motion, {name: model[name] for name in SHOWN}))
    arrays = {name: np.array([each[name] for each in sampled]) for name in SHOWN}
    none = np.full(len(task.plan.times) - 1, np.nan)
    found: dict[str, Any] = {
        "time": rows[0].motion.time,
        "reference": rows[0].motion["reference"],
        **fitted(arrays, table.variables),
        "decision_time": task.plan.times[:-1],
        "decision_seconds": np.array([r.receded.seconds if r.receded else none for r in rows]),
        **gait_arrays(task.gait),
    }
    if draws:
        for name in ("cost", "error_peak", "distance"):
            none = [LOST] * len(draws)
            values = [[each[name] for each in row.drawn or none] for row in rows]
            found[f"drawn_{name}"] = np.array(values)
    estimates = _estimates(task, rows, draws)
    return found | ({"estimated": estimates} if estimates.size else {})


def _checks(task: Task, rows: Sequence[Row], right: Sequence[float]) -> Iterator[Check]:
    tolerance = tolerance_of(task.scene.table.tolerance)
    for row in rows:
        yield from chain_checks(row.second, balance(row.motion), tolerance, row.name)
        if row.receded is not None:
            yield _replayed(task, row)
    yield _as_good(task, right)


def _as_good(task: Task, right: Sequence[float]) -> Check:
    """Whether decisions are as good as the open loop on a plant that equals the model."""
    table = task.scene.table.predictive
    excess, off = _excess(right), abs(task.plan.objective / right[0] - 1)
    advice = (
        "with a true model, predictive control costs more than the open loop, by a share "
        f"of {excess:.2g}: arcs of {table.period:g} do not resolve the smooth law of "
        f"v_reg = {table.v_reg:g} (a simulation differs from the plan's own cost by "
        f"{off:.1g}); write a smaller predictive.period, or a larger predictive.v_reg"
    )
    name = "as good as the open loop where the model is right"
    return Check(name, max(excess, 0.0), _AS_GOOD, advice)


def _excess(right: Sequence[float]) -> float:
    return max(right[1:]) / right[0] - 1


def _replayed(task: Task, row: Row) -> Check:
    """Whether the simulation of the whole motion agrees with that from decision to decision."""
    assert row.receded is not None
    sizes = nominal_of(task.plant.x)
    whole = row.motion.states[: task.plant.n_x, -1]
    off = np.abs(row.receded.states[:, -1] - whole) / np.maximum(sizes, np.abs(whole))
    error, accepted = float(off.max()), accepted_error(tolerance_of(task.scene.table.tolerance))
    advice = (
        f"{row.name}: the decisions simulated as one motion end elsewhere, by {error:.2g} "
        f"of the states' size, where {accepted:.2g} is accepted; write a smaller "
        "tolerance.relative"
    )
    return Check(f"{row.name}: decisions replayed", error, accepted, advice)


def _warnings(task: Task, rows: Sequence[Row]) -> Iterator[str]:
    period = task.scene.table.predictive.seconds * float(np.diff(task.plan.times).min())
    for row in rows:
        if row.receded is None:
            continue
        seconds, processor = (
            float(np.median(each)) for each in (row.receded.seconds, row.receded.processor)
        )
        if seconds > period:
            busy = processor < period
            yield (
                f"{row.name}: the median decision takes {seconds:.3g} s on this machine, longer "
                f"than the {period:.3g} s between decisions"
                + (
                    f"; its processor time is {processor:.3g} s, so the machine is busy"
                    if busy
                    else ""
                )
            )
        for unsolved, where in (
            (row.receded.unsolved, ""),
            (sum(each.unsolved for each in row.learnt), "for other plants"),
        ):
            if unsolved:
                yield f"{row.name}: {unsolved} decisions{where} failed; the previous plan continued"
        lost = sum(not np.isfinite(each["cost"]) for each in row.drawn)
        if lost:
            yield f"{row.name}: the simulation of {lost} plants failed"
    if not task.scene.table.tolerance.recheck:
        yield NOT_RECHECKED
