"""Markdown table of a scene of predictive control."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from wormopt.systems.chain.runs.compare_tables import head_of, line_of, text_of
from wormopt.systems.chain.scenes.track_predictive import TrackPredictiveScene

_COLUMNS = {
    "cost": "∫\\|e\\|² + ρ\\|u\\|²",
    "error_integral": "∫\\|e\\|²",
    "error_peak": "largest \\|e\\|",
    "input_rms": "u rms",
    "distance": "distance",
}
_TIMES = {
    "decision_processor": "processor, median",
    "decision_median": "median",
    "decision_most": "95 %",
    "decision_worst": "worst",
}


def table_of(
    table: TrackPredictiveScene,
    names: Sequence[str],
    scalars: Mapping[str, Any],
    drawn: Mapping[str, Sequence[Mapping[str, float]]],
) -> str:
    """All figures in Markdown: the nominal plant, durations of decisions, the other plants."""
    lines = [*_believed(names, scalars), "", *_right(scalars)]
    if table.plants is not None:
        lines += ["", *_plants(table, drawn)]
        if scalars["parameter_error"] is not None and table.estimation is not None:
            lines += ["", *_learnt(table.estimation.parameters, scalars["parameter_error"])]
    return "\n".join([*lines, ""])


def _believed(names: Sequence[str], scalars: Mapping[str, Any]) -> Iterator[str]:
    period = scalars["decision_period"]
    yield "## The nominal plant"
    yield ""
    times = [f"decision, {words}" for words in _TIMES.values()]
    yield from head_of(["", *_COLUMNS.values(), *times, "steps"])
    for k, name in enumerate(names):
        numbers = [_digits(scalars[key][k]) for key in _COLUMNS]
        seconds = [_milliseconds(scalars[key][k]) for key in _TIMES]
        steps = scalars["decision_steps"][k]
        yield line_of([name, *numbers, *seconds, "–" if steps is None else f"{steps:.2g}"])
    yield ""
    yield (
        f"Decisions: {scalars['decisions']}, one in {1000.0 * period:.3g} ms or more. One "
        "simulator with exact contact computes all motions. Processor time is the cost of "
        "decisions on a machine without other load; the other durations are wall-clock times."
    )


def _right(scalars: Mapping[str, Any]) -> Iterator[str]:
    open_loop, real, full = scalars["right_cost"]
    yield "## A plant with the smooth law of the model"
    yield ""
    yield from head_of(["", "cost", "excess over the open loop"])
    yield line_of(["open-loop optimum", f"{open_loop:.8g}", "0"])
    for name, cost in (("predictive, real time", real), ("predictive, converged", full)):
        yield line_of([name, f"{cost:.8g}", f"{cost / open_loop - 1:.2g}"])


def _plants(
    table: TrackPredictiveScene, drawn: Mapping[str, Sequence[Mapping[str, float]]]
) -> Iterator[str]:
    assert table.plants is not None
    yield f"## {table.plants.members} plants, ±{table.plants.spread:.0%}"
    yield ""
    yield from head_of(["", "cost, mean", "least", "most", "largest \\|e\\|", "distance, mean"])
    for name, each in drawn.items():
        cost, peak, way = (
            np.array([numbers[key] for numbers in each])
            for key in ("cost", "error_peak", "distance")
        )
        yield line_of(
            [name, *map(_digits, (cost.mean(), cost.min(), cost.max(), peak.max(), way.mean()))]
        )


def _learnt(names: Sequence[str], errors: Sequence[Sequence[float]]) -> Iterator[str]:
    yield from head_of(["estimated", "error before estimation", "error at the end"])
    for name, (before, after) in zip(names, errors, strict=True):
        yield line_of([name.replace("_", " "), f"{before:.1%}", f"{after:.1%}"])
    yield ""
    yield "Errors are root mean squares of logarithms over plants, and over masses or links."


def _digits(value: float | None) -> str:
    return text_of(value) if value is None or not np.isfinite(value) else f"{value:.4g}"


def _milliseconds(value: float | None) -> str:
    if value is None:
        return "–"
    digits = 1 if value < 0.01 else 0
    return f"{1e3 * value:.{digits}f} ms"
