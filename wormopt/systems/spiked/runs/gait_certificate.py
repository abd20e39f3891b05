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

from wormopt.progress import Report
from wormopt.quantities import Scalar, Variable, unit_of
from wormopt.result import Result
from wormopt.systems.shared.checkpoints import checkpoints, forget, keep
from wormopt.systems.spiked.certify.proof import certified
from wormopt.systems.spiked.certify.prove import Certificate, Progress
from wormopt.systems.spiked.design.design import Design
from wormopt.systems.spiked.search.sequences import Sequence_, mirrored
from wormopt.systems.spiked.search.space import is_mirror_symmetric
from wormopt.systems.spiked.task import Certify, Task

# Rounding of the certificate and of the gait's own value, relative.
_ROUNDING = 1e-12


def add_certificate(
    result: Result,
    found: Design,
    wanted: Certify,
    units: str,
    report: Report,
    restate: Callable[[Design], Result],
) -> tuple[Result, bool]:
    """Add a certificate to the result of a design; the flag tells whether the user stopped it.

    What is proven is cached until the wanted gap is reached, so that a rerun goes on. Failed
    where the gait beats its bound. `restate` makes the result of a better design come upon.
    """
    task = found.task
    file = _file(task, found.value, wanted)

    def save(progress: Progress) -> None:
        with suppress(OSError):  # a full disk must not cost the design: another run begins anew
            keep(file, msgspec.msgpack.encode(progress))

    begun = None
    with suppress(OSError, msgspec.MsgspecError):  # not there, or damaged: begin again
        begun = msgspec.msgpack.decode(file.read_bytes(), type=Progress)
    outcome = certified(found, wanted, report, begun, save)
    proof, better = outcome.certificate, outcome.design
    if proof.ending in ("gap reached", "finest cells"):
        forget(file)
    if better is not found:
        result = restate(better)
    faults = [result.reason] if result.reason else []
    longer = len(better.sequence) > proof.phases
    if proof.gap < -_ROUNDING and not longer:
        faults.append("the gait is better than its proven bound; please report this scene")
    unit = unit_of(task.objective.quantity, units)
    scalars, variables = _leaves(proof, better, units)
    return (
        replace(
            result,
            status="failed" if faults else result.status,
            reason="; ".join(faults),
            scalars=dict(result.scalars) | _scalars(proof, unit, longer) | scalars,
            variables=(*result.variables, *_course(proof, better.value, unit), *variables),
            trust=_trust(result, proof, wanted.gap, longer, task.limits.resting),
            timings_s=dict(result.timings_s) | {"certify": proof.progress.seconds},
        ),
        proof.ending == "interrupted",
    )


def _file(task: Task, value: float, wanted: Certify) -> Path:
    key = repr((task, f"{value:.12e}", wanted.sequence, wanted.phases, wanted.gap))
    name = hashlib.sha256(key.encode()).hexdigest()[:32]
    return checkpoints("certificates", certified.__module__) / f"{name}.msgpack"


def _scalars(proof: Certificate, unit: str, longer: bool) -> dict[str, Scalar]:
    progress = proof.progress
    return {
        "bound": Scalar(progress.bound, unit),
        "gap_certified": Scalar(None if longer else max(0.0, proof.gap)),
        "certified_phases": Scalar(proof.phases),
        "boxes_explored": Scalar(progress.boxes),
        "certified_seconds": Scalar(progress.seconds, "s"),
    }


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
    proof: Certificate, design: Design, units: str
) -> tuple[dict[str, Scalar], list[Variable]]:
    """Boxes of durations of one sequence of three phases: the gait's, or the most divided one."""
    tree, limits = proof.progress.tree, design.task.limits
    leaves = {sequence: [] for sequence in tree.watched} if tree else {}
    for branch in (*tree.leaves, *tree.open) if tree else ():
        one_cycle = tree is not None and branch.box[-1][1] >= tree.shortest
        if one_cycle and branch.sequence in leaves and np.isfinite(branch.bound):
            leaves[branch.sequence].append(branch)
    leaves = {sequence: found for sequence, found in leaves.items() if found}
    if not leaves:
        return {}, []
    images = _images(design)
    own = [sequence for sequence in leaves if sequence in images]
    chosen = own[0] if own else max(leaves, key=lambda sequence: len(leaves[sequence]))
    boxes = np.array([branch.durations for branch in leaves[chosen]]) * limits.period_range[1]
    bounds = np.array([branch.bound for branch in leaves[chosen]])
    time, dims = unit_of("time", units), ("leaf", "leaf_phase")
    scalars = {
        "leaf_sequence": Scalar(chosen),
        "leaf_period": Scalar(limits.period_range, time),
    }
    if own:
        scalars["leaf_durations"] = Scalar(images[chosen], time)
    return scalars, [
        Variable("leaf_shortest", time, dims, boxes[:, :, 0], "shortest durations"),
        Variable("leaf_longest", time, dims, boxes[:, :, 1], "longest durations"),
        Variable("leaf_bound", unit_of("speed", units), ("leaf",), bounds, "bound on the speed"),
    ]


def _images(design: Design) -> dict[Sequence_, list[float]]:
    """The gait's sequence and durations as they look from other phases, and in the mirror."""
    own, durations = design.sequence, list(design.durations)
    views = [own]
    if is_mirror_symmetric(design.task):
        views.append(mirrored(own, design.task.worm.links + 1))
    return {
        (*view[k:], *view[:k]): durations[k:] + durations[:k]
        for view in views
        for k in range(len(own))
    }


def _trust(
    result: Result, proof: Certificate, gap: float, longer: bool, resting: int
) -> dict[str, Any]:
    warnings = list(result.trust["warnings"])
    if proof.ending == "interrupted":
        warnings.append(f"the gap {gap:g} was not reached: run again to go on from here")
    elif proof.ending == "time limit":
        warnings.append(
            f"the gap {gap:g} was not reached (time limit): run again to go on from here, "
            "or give search.certify.time_limit more seconds"
        )
    elif proof.ending == "finest cells":
        warnings.append(
            f"the gap {gap:g} was not reached with the finest cells: either the gait can "
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
            "wanted_gap": gap,
        },
    }
