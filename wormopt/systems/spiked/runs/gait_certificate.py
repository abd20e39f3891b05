"""The certificate of a designed gait: proof of how much better any gait could be."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from wormopt.progress import Report
from wormopt.quantities import Scalar, Variable, unit_of
from wormopt.result import Check
from wormopt.systems.shared.checkpoints import checkpoints, forget, keep
from wormopt.systems.shared.sequences import Sequence_, mirrored
from wormopt.systems.spiked.certify.proof import Certificate, Progress, certified
from wormopt.systems.spiked.design.design import Design
from wormopt.systems.spiked.runs.motion import Findings
from wormopt.systems.spiked.scenes.gait_design import GaitDesignScene
from wormopt.systems.spiked.search.orders import is_mirror_symmetric
from wormopt.systems.spiked.task import Certify, GaitProblem

# Rounding of the certificate and of the gait's own value, relative.
_ROUNDING = 1e-12


def of_certificate(
    table: GaitDesignScene, found: Design, report: Report
) -> tuple[Findings, Design]:
    """What is proven of a design, and that design, or a better one come upon.

    It is cached until the wanted gap is reached, so that a rerun goes on. A gait that beats its
    bound is a fault.
    """
    wanted, task = table.search.proof, found.task
    assert wanted is not None
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
    longer = better.phases > proof.phases
    advice = "the gait is better than its proven bound; please report this scene"
    beaten = Check("gait over its proven bound", max(0.0, -proof.gap), _ROUNDING, advice)
    whose = "of its own sequence of resting masses" if proof.sequence else "of any sequence"
    certificate = {
        "holds_for": f"every gait {whose}, of at most {proof.phases} phases a cycle, in which "
        f"gait.resting = {task.limits.resting} and all other limits hold at any time",
        "ended": proof.ending,
        "wanted_gap": wanted.gap,
    }
    bounds = Findings(
        *_bounds(table, proof, better, longer),
        checks=() if longer else (beaten,),
        facts={"certificate": certificate},
        warnings=tuple(_warnings(proof, wanted.gap, longer)),
        timings={"certify": proof.progress.seconds},
    )
    return bounds | _leaves(proof, better), better


def _file(task: GaitProblem, value: float, wanted: Certify) -> Path:
    key = repr((task, f"{value:.12e}", wanted.sequence, wanted.phases, wanted.gap))
    name = hashlib.sha256(key.encode()).hexdigest()[:32]
    return checkpoints("certificates", certified.__module__) / f"{name}.msgpack"


def _bounds(
    table: GaitDesignScene, proof: Certificate, design: Design, longer: bool
) -> tuple[dict[str, Any], dict[str, Any]]:
    """The bound and its course; their quantity is that of the objective."""
    progress = proof.progress
    unit = unit_of(design.task.objective.quantity, table.units)
    history = np.array([*progress.history, (progress.seconds, progress.bound)])
    courses = {"proof_bound": history[:, 1], "proof_value": 0 * history[:, 1] + design.value}
    scalars = {
        "bound": Scalar(progress.bound, unit),
        "gap_certified": None if longer else max(0.0, proof.gap),
        "certified_phases": proof.phases,
        "boxes_explored": progress.boxes,
        "certified_seconds": progress.seconds,
    }
    variables: dict[str, Any] = {"proof_time": history[:, 0]}
    for name, values in courses.items():
        _, dims, long_name = table.variables[name]
        variables[name] = Variable(name, unit, dims, values, long_name)
    return scalars, variables


def _leaves(proof: Certificate, design: Design) -> Findings:
    """Boxes of durations of one sequence of three phases: the gait's, or the most divided one."""
    tree, limits = proof.progress.tree, design.task.limits
    leaves = {sequence: [] for sequence in tree.watched} if tree else {}
    for branch in (*tree.leaves, *tree.open) if tree else ():
        one_cycle = tree is not None and branch.box[-1][1] >= tree.shortest
        if one_cycle and branch.sequence in leaves and np.isfinite(branch.bound):
            leaves[branch.sequence].append(branch)
    leaves = {sequence: found for sequence, found in leaves.items() if found}
    if not leaves:
        return Findings()
    images = _images(design)
    own = [sequence for sequence in leaves if sequence in images]
    chosen = own[0] if own else max(leaves, key=lambda sequence: len(leaves[sequence]))
    boxes = np.array([branch.durations for branch in leaves[chosen]]) * limits.period_range[1]
    scalars: dict[str, Any] = {"leaf_sequence": chosen, "leaf_period": limits.period_range}
    return Findings(
        scalars | ({"leaf_durations": images[chosen]} if own else {}),
        {
            "leaf_shortest": boxes[:, :, 0],
            "leaf_longest": boxes[:, :, 1],
            "leaf_bound": np.array([branch.bound for branch in leaves[chosen]]),
        },
    )


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


def _warnings(proof: Certificate, gap: float, longer: bool) -> Iterator[str]:
    if proof.ending == "interrupted":
        yield f"the gap {gap:g} was not reached: run again to go on from here"
    elif proof.ending == "time limit":
        yield (
            f"the gap {gap:g} was not reached (time limit): run again to go on from here, "
            "or give search.certify.time_limit more seconds"
        )
    elif proof.ending == "finest cells":
        yield (
            f"the gap {gap:g} was not reached with the finest cells: either the gait can "
            'still be better (try search.effort = "thorough") or the gap is too small'
        )
    if longer:
        yield (
            f"the gait has more than {proof.phases} phases, so that the bound is not one for it: "
            "raise search.certify.phases, or give search.phases no more than that"
        )
