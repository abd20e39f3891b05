"""Groups of cases run side by side, counts and tables of what became of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from importlib import import_module
from typing import Any

from tests.stress import GROUPS
from tests.stress.verdict import Verdict
from wormopt.numerics.workers import Workers
from wormopt.progress import Report


def stress(groups: Sequence[str] = (), *, quick: bool, report: Report) -> Iterator[Verdict]:
    """Run groups of the matrix, all if none is named, on two processors.

    Yields verdicts as cases are done. `quick`: a few cases of each group only.
    """
    todo = [case for group in groups or GROUPS for case in cases(group, quick=quick)]
    todo.sort(key=lambda c: -c.span)  # what takes long comes first
    wrong = 0
    with Workers(2) as workers:
        for k, (_, verdict) in enumerate(workers.as_completed(_judge, todo), start=1):
            wrong += verdict.verdict == "wrong"
            report(f"{k} of {len(todo)} cases, {wrong} wrong", k / len(todo))
            yield verdict


def cases(group: str, *, quick: bool) -> list[Any]:
    """List the cases of a group; each has a name, a group, a span and the method `judge`."""
    return list(import_module(f"tests.stress.{group}").cases(quick=quick))


def _judge(case: Any) -> Verdict:
    return case.judge()


def summary(verdicts: Sequence[Verdict], *, complete: bool = True) -> dict[str, Any]:
    """Count the verdicts; a run that is not `complete` has not passed.

    ``right_in_part``: right as far as can be known, not to the end; ``reasons``: refusals
    by code; ``not_right``: every cell that is not right, and why.
    """
    count = Counter(v.verdict for v in verdicts)
    core = [v for v in verdicts if v.core]
    core_right = sum(v.verdict == "right" for v in core)
    return {
        "cells": len(verdicts),
        **{kind: count[kind] for kind in ("right", "refused", "wrong", "undecided")},
        "core": len(core),
        "core_right": core_right,
        "right_in_part": sum(v.verdict == "right" and v.known < 1 for v in verdicts),
        "reasons": dict(Counter(v.reason for v in verdicts if v.verdict == "refused")),
        "not_right": [
            {"cell": v.name, "group": v.group, "verdict": v.verdict, "reason": v.reason}
            for v in verdicts
            if v.verdict != "right"
        ],
        "complete": complete,
        "passed": complete
        and bool(verdicts)
        and count["wrong"] == 0
        and core_right == len(core)
        and count["right"] >= 0.9 * len(verdicts),
    }


def table(verdicts: Sequence[Verdict], *, complete: bool = True) -> str:
    """Lay out verdicts for readers: counts by group, and every cell that is not right.

    `complete`: whether `verdicts` are those of all cells.
    """
    kinds = ("right", "refused", "undecided", "wrong")
    lines = [f"{'group':24}{'cells':>7}" + "".join(f"{kind:>11}" for kind in kinds)]
    groups = dict.fromkeys(v.group for v in sorted(verdicts, key=lambda v: v.group))
    for group in [*groups, "all"]:
        count = Counter(v.verdict for v in verdicts if group in (v.group, "all"))
        row = "".join(f"{count[kind]:11}" for kind in kinds)
        lines.append(f"{group:24}{sum(count.values()):7}{row}")
    others = [v for v in verdicts if v.verdict != "right"]
    others.sort(key=lambda v: (v.verdict, v.group))
    lines += [f"{v.verdict}: {v.name} ({v.group}): {v.reason}" for v in others]
    found = summary(verdicts, complete=complete)
    share = found["right"] / max(found["cells"], 1)
    core = f"{found['core_right']} of {found['core']} ordinary cells right"
    lines.append(
        f"{found['wrong']} wrong, {share:.1%} right{f', {core}' if found['core'] else ''}: "
        + ("passed" if found["passed"] else "NOT passed" if complete else "interrupted")
    )
    return "\n".join(lines)
