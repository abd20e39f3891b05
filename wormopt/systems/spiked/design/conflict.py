"""Why no gait meets some limits: each is relaxed in turn, and then only as far as it must be."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from time import monotonic
from typing import Any

import numpy as np

from wormopt.errors import SolveError
from wormopt.progress import Report
from wormopt.shown import enough
from wormopt.systems.shared.sequences import Sequence_
from wormopt.systems.spiked.limits import Rates
from wormopt.systems.spiked.search.orders import ceiling_of
from wormopt.systems.spiked.search.trial import Trier
from wormopt.systems.spiked.task import GaitProblem

# Slower gaits, as a share of the rates, stand still.
STANDS = 1e-9
# Number of sequences that are tried; the limits in conflict are mostly the same in all.
_MOST = 8
# Shares by which a limit is relaxed: from the first to the second, found to the third.
_LEAST, _FULL, _SAME = 1e-4, 1e3, 1.0005


def conflict(
    task: GaitProblem, sequences: Sequence[Sequence_], report: Report, seconds: float = np.inf
) -> SolveError:
    """Find the limits in conflict and their smallest relaxation; returns an error to raise.

    Typical `sequences` are tried; no new trial begins after `seconds`.
    """
    until, orders = monotonic() + seconds, _typical(sequences)

    def least(keys: Sequence[str], given: Mapping[str, float]) -> float:
        """By which share some limits have to give way besides others; infinite if none helps."""
        report(f"relaxing {' and '.join(keys)}", 0.8)

        def exists(share: float, order: Sequence_) -> bool:
            shares = {**given, **dict.fromkeys(keys, share)}
            return monotonic() < until and _exists(relaxed(task, shares), order, until)

        helped = [order for order in orders if exists(_FULL, order)]
        low, high = _LEAST, _FULL if helped else np.inf
        while low * _SAME < high < np.inf and monotonic() < until:
            share = float(np.sqrt(low * high))
            still = [order for order in helped if exists(share, order)]
            helped, low, high = (still, low, share) if still else (helped, share, high)
        return high

    keys = [key for key in _WAYS if relaxed(task, {key: _FULL}) != task]
    alone = {key: share for key in keys if np.isfinite(share := least([key], {}))}
    if alone:
        found, word = dict(sorted(alone.items(), key=lambda item: item[1])), " or "
    elif np.isfinite(least(keys, {})):
        found, word = _together(keys, least), " and "
    else:
        return SolveError(
            "no resting sequence has a gait, even with all limits relaxed a thousandfold",
            'write limits that match the size of the motion, or try search.effort = "thorough" or '
            "another search.seed",
        )
    told = word.join(_told(task, key, share) for key, share in found.items())
    return SolveError(
        f"no gait meets these limits together; one needs {told}",
        "relax that" if word == " and " or len(found) == 1 else "relax one of these",
    )


def _together(
    keys: list[str], least: Callable[[Sequence[str], Mapping[str, float]], float]
) -> dict[str, float]:
    """Limits none of which can be left out, each relaxed no farther than those before it ask."""
    for key in list(keys):
        if np.isfinite(least(fewer := [k for k in keys if k != key], {})):
            keys = fewer
    shares = dict.fromkeys(keys, least(keys, {}))
    for key in keys:
        shares[key] = least([key], {k: share for k, share in shares.items() if k != key})
    return shares


def _exists(task: GaitProblem, order: Sequence_, until: float) -> bool:
    trier = Trier(task, until=until, work=1.0)  # a step is enough to see
    trial = trier.free(order)
    if trial is None or (trial := trier.fit(trial)) is None:
        return False
    return task.objective.speed is not None or trial.value > STANDS * task.speed_nominal


def relaxed(task: GaitProblem, shares: Mapping[str, float]) -> GaitProblem:
    """The task with limits relaxed by shares of their size; what is not given stays."""
    for key, share in shares.items():
        part, _, name = key.partition(".")
        value = getattr(getattr(task, part), name)
        if value is not None:
            given = replace(getattr(task, part), **{name: _WAYS[key](value, 1.0 + share)})
            task = replace(task, **{part: given})
    return task


def deciding(task: GaitProblem, bound: float) -> list[str]:
    """Limits that hold the ceiling where it is, `bound`; each by itself if any does."""
    keys = ("limits.rate", "limits.acceleration", "limits.resting", "limits.length")
    given = [key for key in keys if relaxed(task, {key: _FULL}) != task]
    raised = [k for k in given if ceiling_of(relaxed(task, {k: _FULL})) > bound * _SAME]
    return raised or given


def _told(task: GaitProblem, key: str, share: float) -> str:
    part, _, name = key.partition(".")
    old, new = (getattr(getattr(t, part), name) for t in (task, relaxed(task, {key: share})))
    if isinstance(old, int | float) and isinstance(new, int | float):
        return f"{key} {'larger' if new > old else 'smaller'} by {enough(abs(new - old), 3):g}"
    return f"{key} wider by {enough(100 * share, 3):g} %"


def _raised(value: Any, factor: float) -> Any:
    if isinstance(value, tuple):
        return tuple(_raised(item, factor) for item in value)
    if isinstance(value, Rates):
        return Rates(_raised(value.contraction, factor), _raised(value.extension, factor))
    return value * factor


def _widened(value: Any, factor: float) -> Any:
    if isinstance(value[0], tuple):
        return tuple(_widened(item, factor) for item in value)
    low, high = value
    return low, low + (high - low) * factor


def _longer(value: Any, factor: float) -> Any:
    low, high = value if isinstance(value, tuple) else (value, value)
    return low, high * factor


_WAYS: dict[str, Callable[[Any, float], Any]] = {
    "limits.spike_load": _raised,
    "limits.actuator_force": _raised,
    "limits.sigma_margin": lambda value, factor: value / factor,
    "limits.resting": lambda value, factor: max(1, int(value / factor)),
    "objective.speed": lambda value, factor: value / factor,
    "limits.rate": _raised,
    "limits.acceleration": _raised,
    "limits.length": _widened,
    "limits.period": _longer,
}


def _typical(sequences: Sequence[Sequence_]) -> list[Sequence_]:
    """Short orders of few and of many resting masses: loads want many, rates and ways few."""
    by_size: dict[int, list[Sequence_]] = {}
    for sequence in sorted(sequences, key=len):
        by_size.setdefault(min(map(len, sequence)), []).append(sequence)
    sizes = sorted(by_size)
    outer = sizes if len(sizes) <= _MOST // 2 else [*sizes[:2], *sizes[-2:]]
    return [sequence for size in outer for sequence in by_size[size][: _MOST // len(outer)]]
