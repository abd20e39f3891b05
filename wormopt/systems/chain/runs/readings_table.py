"""Tables of readings: entries that support each sentence, the best readings, and all as CSV."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from wormopt.result import Result
from wormopt.systems.chain.readings import SENTENCES
from wormopt.systems.chain.scenes.readings import ReadingsScene

_SHOWN = 30  # readings in Markdown
_NUMBERS = (
    "gain_middle",
    "gain_end",
    "gain_growth",
    "error_peak",
    "captured_outputs",
    "captured_norm",
)
_TRACKERS = ("14", "13")


def table_of(
    table: ReadingsScene,
    choices: Mapping[str, Sequence],
    found: Mapping[str, np.ndarray],
    chosen: int,
) -> str:
    """Markdown with the results of all readings."""
    by, half = table.sentences, table.time.end / 2
    lines = [
        f"{len(found['supported'])} readings to t = {table.time.end:g}. Strips: {by.strips}; "
        f"quick: within {by.quick:g}; growth and errors: in the last {by.window:g}; converged: "
        f"growth up to {by.settled:g}; growing: from {by.growing:g} on.",
        "",
        *(f"- **{name}**: {what}" for name, what in SENTENCES.items()),
        "",
        "## Readings that support each sentence, by entry",
        "",
        *_shares(choices, found),
        "",
        "## Best readings",
        "",
        f"The first row is the literal reading. Columns: k at t = {half:g} and at the end; growth "
        "and largest \\|e\\| in the window; capture by outputs and by norm; ends: range of ends "
        "for which all sentences hold.",
        "",
        *_best(choices, found, chosen),
        "",
    ]
    return "\n".join(lines)


def _shares(choices: Mapping[str, Sequence], found: Mapping[str, np.ndarray]) -> Iterator[str]:
    said, picks = found["supported"] > 0, found["reading_choice"]
    yield from _head(["", "", *SENTENCES, "all"])
    rows = [("every reading", "", np.ones(len(said), bool))]
    for k, (name, entries) in enumerate(choices.items()):
        rows += [(name, _text(entry), picks[:, k] == i) for i, entry in enumerate(entries)]
    for name, entry, own in rows:
        counts = [*said[own].sum(axis=0), said[own].all(axis=1).sum()]
        yield _line([name, entry, *(f"{count} / {own.sum()}" for count in counts)])


def _best(
    choices: Mapping[str, Sequence], found: Mapping[str, np.ndarray], chosen: int
) -> Iterator[str]:
    said, picks = found["supported"] > 0, found["reading_choice"]
    order = np.lexsort((np.sum(picks > 0, axis=1), -said.sum(axis=1)))
    shown = list(dict.fromkeys([0, chosen, *order.tolist()]))[:_SHOWN]
    yield from _head([*choices, *(f"({t})" for t in _TRACKERS), "ends", "not supported"])
    for k in shown:
        own = [_text(e[i]) for e, i in zip(choices.values(), picks[k], strict=True)]
        ends = f"{found['ends_first'][k]:.3g} to {found['ends_last'][k]:.3g}"
        missing = ", ".join(np.array(list(SENTENCES))[~said[k]]) or "none"
        motions = [_numbers(found, row, k) for row in range(2)]
        yield _line([*own, *motions, ends if said[k].all() else "–", missing])


def _numbers(found: Mapping[str, np.ndarray], tracker: int, reading: int) -> str:
    values = [found[name][tracker, reading] for name in _NUMBERS]
    if not np.isfinite(values[1]):
        return "grows beyond bounds"
    first = [f"{value:.4g}" for value in values[:2]] + [f"{value:.2g}" for value in values[2:4]]
    return " · ".join(first + ["never" if np.isnan(v) else f"{v:.2f}" for v in values[4:]])


def csv_of(result: Result) -> str:
    """All readings as CSV, one per line: choices, results of both trackers, sentences."""
    choices: Mapping[str, Sequence[Any]] = result.attributes["choices"]
    names = result.attributes["sentences"]
    picks, said = result["reading_choice"].values, result["supported"].values
    head = [*choices, *(f"{n}_{t}" for t in _TRACKERS for n in _NUMBERS), *names]
    lines = [",".join([*head, "ends_first", "ends_last"])]
    for k in range(len(said)):
        own = [_plain(e[int(i)]) for e, i in zip(choices.values(), picks[k], strict=True)]
        numbers = [result[n].values[t, k] for t in range(2) for n in _NUMBERS]
        ends = [result[n].values[k] for n in ("ends_first", "ends_last")]
        cells = [*own, *map(_number, numbers), *(f"{int(s)}" for s in said[k])]
        lines.append(",".join([*cells, *map(_number, ends)]))
    return "\n".join([*lines, ""])


def _text(entry: Any) -> str:
    if entry is None:
        return "reference"
    if isinstance(entry, list | tuple):
        return "(" + ", ".join(f"{value:g}" for value in entry) + ")"
    return entry if isinstance(entry, str) else f"{entry:.3g}"


def _plain(entry: Any) -> str:
    if isinstance(entry, list | tuple):
        return " ".join(repr(value) for value in entry)
    return "reference" if entry is None else str(entry)


def _number(value: float) -> str:
    return "" if np.isnan(value) else repr(float(value))


def _head(names: Sequence[str]) -> Iterator[str]:
    yield _line(names)
    yield _line(["---"] * len(names))


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"
