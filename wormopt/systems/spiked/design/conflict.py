"""Why no gait exists: the limits that stand against each other."""

from __future__ import annotations

from collections.abc import Sequence
from time import monotonic

import numpy as np

from wormopt.errors import SolveError
from wormopt.model.modes import ModeSequence
from wormopt.ocp.elastic import elastic
from wormopt.ocp.nlp import Ipopt
from wormopt.ocp.transcription import Transcription
from wormopt.progress import Report, silent
from wormopt.systems.spiked.design.problem import gait_problem
from wormopt.systems.spiked.design.smooth import mesh_of, resting_state
from wormopt.systems.spiked.search.sequences import Sequence_
from wormopt.systems.spiked.task import Task

# Orders that are tried: what stands against each other is mostly the same in all.
_MOST = 8


def conflict(
    task: Task, sequences: Sequence[Sequence_], report: Report = silent, seconds: float = np.inf
) -> SolveError:
    """Explain which limits conflict, by the least slack that lets a gait exist; to be raised.

    Typical `sequences` are tried; none is begun once `seconds` are over.
    """
    rigid = gait_problem(task.worm, task.limits, task.objective)
    problem = elastic(rigid)
    least, slack = np.inf, np.zeros(len(problem.design))
    until, tried = monotonic() + seconds, _typical(sequences)
    for k, sequence in enumerate(tried):
        if k and monotonic() > until:
            break
        report(f"looking for the limits in conflict, order {k + 1} of {len(tried)}", 0.8)
        program = Transcription(problem, mesh_of(sequence, 4))
        bounds = program.bounds(ModeSequence.of_resting(sequence, task.worm.links + 1))
        total = program.mesh.total
        durations = np.full(total, np.mean(task.limits.period_range) / total)
        w = program.rest(durations, resting_state(task))
        w[-len(slack) :] = 10.0
        answer = program.nlp.solve(w, bounds, Ipopt(tolerance=1e-7))
        if answer.violation < 1e-5 and answer.objective < least:
            least, slack = answer.objective, program.unpack(answer.w).design
    nominal = {b.name: b.nominal for b in (*rigid.along, *rigid.at_ends)}
    given = [
        f"{name} by {size * nominal[name]:.4g}"
        for signal, size in zip(problem.design, slack, strict=True)
        if (name := signal.name.removeprefix("slack ")) in nominal and size > 1e-5
    ]
    if not given:
        return SolveError(
            "no order of resting masses was solved, though the limits do not seem to conflict",
            'try search.effort = "thorough" or another search.seed',
        )
    return SolveError(
        "no gait meets these limits together; the least that has to give way is "
        + " and ".join(given),
        "relax that, or what stands against it",
    )


def _typical(sequences: Sequence[Sequence_]) -> list[Sequence_]:
    """Short orders of few and of many resting masses: loads want many, rates and ways few."""
    by_size: dict[int, list[Sequence_]] = {}
    for sequence in sorted(sequences, key=len):
        by_size.setdefault(min(map(len, sequence)), []).append(sequence)
    sizes = sorted(by_size)
    outer = sizes if len(sizes) <= _MOST // 2 else [*sizes[:2], *sizes[-2:]]
    return [sequence for size in outer for sequence in by_size[size][: _MOST // len(outer)]]
