"""The certificate of a designed gait: a proven bound on the objective of any gait."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from wormopt.progress import Report
from wormopt.quantities import Scalar, Variable, unit_of
from wormopt.result import Check
from wormopt.systems.spiked.certify.bound import Bounded, bounded, gap_of
from wormopt.systems.spiked.certify.certificate import verify
from wormopt.systems.spiked.design.design import Design
from wormopt.systems.spiked.design_tables import DesignTable
from wormopt.systems.spiked.motion import Findings

# Rounding of the gait's own value, relative.
_ROUNDING = 1e-12


def of_certificate(table: DesignTable, found: Design, report: Report) -> Findings:
    """Bound the objective of every gait, verify the proof exactly, and compare with the gait.

    Without a table `[search.certify]` the bound is the one that the search began with.
    """
    wanted, task = table.search.proof, found.task
    clock = time.perf_counter()
    if wanted is not None:
        proven = bounded(task, found.value, wanted, report, found.survey.bounded)
    else:
        assert found.bounded is not None
        proven = found.bounded
    proved = time.perf_counter()
    cost = task.objective.minimise is not None
    gap = gap_of(found.value, proven.bound, cost)
    advice = "the gait is better than its proven bound, which is an error; please report this scene"
    checks = [Check("gait over its proven bound", max(0.0, -gap), _ROUNDING, advice)]
    facts: dict[str, Any] = {
        "holds_for": "every gait with any resting sequence, number of phases and cycles in which "
        f"gait.resting = {task.limits.resting} and all other limits hold at all times",
        "source": proven.source,
    }
    timings: dict[str, float] = {}
    if proven.certificate is not None:
        report("verifying the certificate in exact arithmetic", None)
        verified = verify(proven.certificate)
        advice = (
            f"verification of the certificate failed: {verified.reason}; please report this scene"
        )
        checks.append(Check("certificate verified", 0.0 if verified.holds else 1.0, 0.0, advice))
        facts["verified_inequalities"] = verified.inequalities
        timings["verify"] = time.perf_counter() - proved
    unit = unit_of(task.objective.quantity, table.units)
    known = Findings(
        {"bound": Scalar(proven.bound, unit), "gap_certified": max(0.0, gap)},
        checks=tuple(checks),
        facts={"certificate": facts},
        timings=timings,
        attributes={"certificate": proven.certificate.text} if proven.certificate else {},
    )
    if wanted is None:
        return known
    facts |= {"ended": proven.ending, "wanted_gap": wanted.gap}
    history = np.array(proven.history)
    courses = {"proof_bound": history[:, 1], "proof_value": 0 * history[:, 1] + found.value}
    variables: dict[str, Any] = {"proof_time": history[:, 0]}
    for name, values in courses.items():
        long_name = {"proof_bound": "proven bound", "proof_value": "objective of the gait"}[name]
        variables[name] = Variable(name, unit, ("proof",), values, long_name)
    return known | Findings(
        {"certified_seconds": proved - clock},
        variables,
        warnings=tuple(_warnings(proven, wanted.gap)),
        timings={"certify": proved - clock},
    )


def _warnings(proven: Bounded, gap: float) -> Iterator[str]:
    missed = f"the gap {gap:g} was not reached"
    match proven.ending:
        case "time limit" | "interrupted":
            yield f"{missed} ({proven.ending}): increase search.certify.time_limit"
        case "finest program":
            yield (
                f"{missed} with the largest program; either a better gait exists (try "
                'search.effort = "thorough"), or the bound is not tight'
            )
