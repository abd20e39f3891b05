"""Checks of a fitting task."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import get_args

import numpy as np

from wormopt.errors import ArgumentError, UnknownNameError
from wormopt.fitting.losses import Loss
from wormopt.fitting.recording import Recording
from wormopt.fitting.unknowns import Unknown
from wormopt.model.model import Model


def check_task(
    model: object,
    recordings: Sequence[Recording],
    unknowns: Sequence[Unknown],
    noise: Mapping[str, float] | None,
    loss: str,
) -> None:
    """Refuse arguments of wrong types, or that do not fit the model."""
    if not isinstance(model, Model):
        raise ArgumentError(f"model must be a Model, not {type(model).__name__}")
    for what, given, kind in (
        ("recordings", recordings, Recording),
        ("unknowns", unknowns, Unknown),
    ):
        if not isinstance(given, Sequence) or not given:
            raise ArgumentError(f"{what} must be a list of at least one {kind.__name__}")
        for each in given:
            if not isinstance(each, kind):
                raise ArgumentError(f"{what} must be {kind.__name__}s, not {each!r:.60}")
    if loss not in get_args(Loss):
        raise ArgumentError(f"loss must be one of {', '.join(get_args(Loss))}, not {loss!r}")
    for run in recordings:
        _check_run(model, run)
    readings = {signal for run in recordings for signal in run.readings}
    for name, sd in (noise or {}).items():
        if name not in readings:
            raise UnknownNameError("the recordings", "signal", [name], sorted(readings))
        if not 0 < sd < np.inf:
            raise ArgumentError(f"noise of {name} must be positive, not {sd!r}")


def _check_run(model: Model, run: Recording) -> None:
    model = run.model or model
    known = {state.name: state.size for state in model.x}
    known = {o.name: o.expression.numel() for o in model.outputs} | known
    for signal, rows in run.readings.items():
        if signal not in known:
            raise UnknownNameError(model.name, "state or output", [signal], list(known))
        if len(rows) != known[signal]:
            raise ArgumentError(
                f"{run.name}: {signal} has {known[signal]} entries, the readings have {len(rows)}; "
                "fill those that were not measured with NaN"
            )
