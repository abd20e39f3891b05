"""The certificate of a designed gait: proof of how much better any gait could be."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from wormopt.core.task import Search, Task
from wormopt.gaits.certify import Certificate, Progress
from wormopt.gaits.design import Design
from wormopt.gaits.proof import certified
from wormopt.gaits.sequences import Sequence_
from wormopt.gaits.space import is_mirror_symmetric
from wormopt.progress import Report
from wormopt.result import Result, Scalar, Variable, unit_of
from wormopt.studies.checkpoints import checkpoints, forget, keep

__all__ = ["add_certificate"]

# Rounding of the certificate and of the gait's own value, relative.
_ROUNDING = 1e-12


def add_certificate(
    result: Result,
    found: Design,
    settings: Search,
    units: str,
    report: Report,
    restate: Callable[[Design], Result],
) -> tuple[Result, bool]:
    """Add a certificate to the result of a design.

    What is proven is kept in the user's cache folder until the gap that is wanted is reached, so
    that another run of the same design goes on.

    Parameters
    ----------
    result : Result
        Of the design.
    found : Design
        The design.
    settings : Search
        With the proof that is wanted.
    units : {"dimensionless", "SI"}
        The units of the scene.
    report : callable
        Told the gap.
    restate : callable
        Makes the result of a better design, where the proof comes upon one.

    Returns
    -------
    result : Result
        With ``bound``, ``gap_certified`` and what else is known; failed where the gait is better
        than its bound, which cannot be.
    interrupted : bool
        Whether the user stopped it.
    """
    task = found.task
    file = _file(task, found.value, settings)

    def save(progress: Progress) -> None:
        with suppress(OSError):  # a full disk must not cost the design: another run begins anew
            keep(file, msgspec.msgpack.encode(progress))

    begun = _begun(task, result)
    with suppress(OSError, msgspec.MsgspecError):  # not there, or damaged: begin again
        begun = msgspec.msgpack.decode(file.read_bytes(), type=Progress)
    outcome = certified(found, settings, report, begun, save)
    proof = outcome.certificate
    if proof.ending in ("gap reached", "finest cells"):
        forget(file)
    if outcome.design is not found:
        result = restate(outcome.design)
    faults = [result.reason] if result.reason else []
    longer = len(outcome.design.sequence) > proof.phases
    if proof.gap < -_ROUNDING and not longer:
        faults.append("the gait is better than its proven bound; please report this scene")
    unit = unit_of(_quantity(task), units)
    scalars, variables = _leaves(proof, task, result.trust["solver"], units)
    return (
        replace(
            result,
            status="failed" if faults else result.status,
            reason="; ".join(faults),
            scalars=dict(result.scalars) | _scalars(proof, task, units, longer) | scalars,
            variables=(*result.variables, *_course(proof, outcome.design.value, unit), *variables),
            trust=_trust(result, proof, settings, longer, task.limits.resting),
            timings_s=dict(result.timings_s) | {"certify": proof.progress.seconds},
        ),
        proof.ending == "interrupted",
    )


def _begun(task: Task, result: Result) -> Progress:
    """What is known before the proof: the ceiling of a speed, that a cost is not negative."""
    # the ceiling is exact to the tolerance 1e-10 of its solver
    ceiling = float(result.scalars["ceiling"].value) * (1 + 1e-6)
    bound = ceiling if task.objective.minimise is None else 0.0
    return Progress(bound, history=((0.0, bound),))


def _file(task: Task, value: float, settings: Search) -> Path:
    proof = settings.certify
    assert proof is not None
    key = repr((task, f"{value:.12e}", settings.sequence, proof.phases, proof.gap))
    name = hashlib.sha256(key.encode()).hexdigest()[:32]
    return checkpoints("certificates") / f"{name}.msgpack"


def _scalars(proof: Certificate, task: Task, units: str, longer: bool) -> dict[str, Scalar]:
    progress = proof.progress
    return {
        "bound": Scalar(progress.bound, unit_of(_quantity(task), units)),
        "gap_certified": Scalar(None if longer else max(0.0, proof.gap)),
        "certified_phases": Scalar(proof.phases),
        "boxes_explored": Scalar(progress.boxes),
        "certified_seconds": Scalar(progress.seconds, "s"),
    }


def _quantity(task: Task) -> str:
    return "speed" if task.objective.minimise is None else "force"


def _course(proof: Certificate, value: float, unit: str) -> list[Variable]:
    """The bound over time."""
    last = (proof.progress.seconds, proof.progress.bound)
    history = np.array([*proof.progress.history, last])
    return [
        Variable("proof_time", "s", ("proof",), history[:, 0], "time spent on the proof"),
        Variable("proof_bound", unit, ("proof",), history[:, 1], "proven bound"),
        Variable("proof_value", unit, ("proof",), 0 * history[:, 1] + value, "of the gait"),
    ]


def _leaves(
    proof: Certificate, task: Task, solver: dict[str, Any], units: str
) -> tuple[dict[str, Scalar], list[Variable]]:
    """Boxes of durations of one sequence of three phases: the gait's, or the most divided one."""
    tree = proof.progress.tree
    leaves = {sequence: [] for sequence in tree.watched} if tree else {}
    for branch in (*tree.leaves, *tree.open) if tree else ():
        one_cycle = tree is not None and branch.box[-1][1] >= tree.shortest
        if one_cycle and branch.sequence in leaves and np.isfinite(branch.bound):
            leaves[branch.sequence].append(branch)
    leaves = {sequence: found for sequence, found in leaves.items() if found}
    if not leaves:
        return {}, []
    images = _images(task, solver)
    own = [sequence for sequence in leaves if sequence in images]
    chosen = own[0] if own else max(leaves, key=lambda sequence: len(leaves[sequence]))
    boxes = np.array([branch.durations for branch in leaves[chosen]]) * task.limits.period_range[1]
    bounds = np.array([branch.bound for branch in leaves[chosen]])
    time, dims = unit_of("time", units), ("leaf", "leaf_phase")
    scalars = {
        "leaf_sequence": Scalar(chosen),
        "leaf_period": Scalar(task.limits.period_range, time),
    }
    if own:
        scalars["leaf_durations"] = Scalar(images[chosen], time)
    return scalars, [
        Variable("leaf_shortest", time, dims, boxes[:, :, 0], "shortest durations"),
        Variable("leaf_longest", time, dims, boxes[:, :, 1], "longest durations"),
        Variable("leaf_bound", unit_of("speed", units), ("leaf",), bounds, "bound on the speed"),
    ]


def _images(task: Task, solver: dict[str, Any]) -> dict[Sequence_, list[float]]:
    """The gait's sequence and durations as they look from other phases, and in the mirror."""
    masses, durations = range(task.worm.links + 1), list(solver["durations"])
    own = [tuple(resting) for resting in solver["sequence"]]
    views = [own]
    if is_mirror_symmetric(task):
        views.append([tuple(sorted(masses[-1] - i for i in resting)) for resting in own])
    return {
        (*view[k:], *view[:k]): durations[k:] + durations[:k]
        for view in views
        for k in range(len(own))
    }


def _trust(
    result: Result, proof: Certificate, settings: Search, longer: bool, resting: int
) -> dict[str, Any]:
    wanted = settings.certify
    assert wanted is not None
    warnings = list(result.trust["warnings"])
    if proof.ending == "interrupted":
        warnings.append(f"the gap {wanted.gap:g} was not reached: run again to go on from here")
    elif proof.ending == "time limit":
        warnings.append(
            f"the gap {wanted.gap:g} was not reached (time limit): run again to go on from here, "
            "or give search.certify.time_limit more seconds"
        )
    elif proof.ending == "finest cells":
        warnings.append(
            f"the gap {wanted.gap:g} was not reached with the finest cells: either the gait can "
            'still be better (try search.effort = "thorough") or the gap is too small'
        )
    if longer:
        warnings.append(
            f"the gait has more than {proof.phases} phases, so that the bound is not one for it: "
            "raise search.certify.phases, or give search.phases no more than that"
        )
    whose = "of its own sequence of resting masses" if proof.sequence else "of any sequence"
    return dict(result.trust) | {
        "warnings": warnings,
        "certificate": {
            "holds_for": f"every gait {whose}, of at most {proof.phases} phases a cycle, in which "
            f"gait.resting = {resting} and all other limits hold at any time",
            "ended": proof.ending,
            "wanted_gap": wanted.gap,
        },
    }
