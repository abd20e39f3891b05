"""The numbers of results: the few that answer, all of them, and those of several side by side."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from wormopt.kinds import KINDS
from wormopt.quantities import Scalar
from wormopt.reports.asked import all_keys
from wormopt.reports.parts import details, scrolled, table
from wormopt.reports.words import escaped, marked, name_text, unit_text, value_text
from wormopt.result import Result

# Which way is better, where that can be said of a number by itself.
BETTER = {
    "speed": 1, "mean_speed": 1, "distance": 1, "velocity_best": 1, "mean_flow": 1,
    "spike_load_max": -1, "actuator_force_max": -1, "energy_per_distance": -1,
    "cost_of_transport": -1, "input_rms": -1, "input_peak": -1, "time_outside_tube": -1,
    "capture_time": -1, "gap_certified": -1,
}  # fmt: skip
_MOST_HEADLINES, _LONGEST_LIST, _MOST_DIFFERENCES = 6, 4, 12
_ASIDE = ("recheck", "n_", "sensitivity", "lambda_", "resting", "assumed", "defect", "order_",
          "complementarity", "worst", "discretisation", "solve_", "cycles", "objective", "same_",
          "certified_", "boxes_", "leaf_", "smallest_")  # fmt: skip


def is_number(value: Any) -> bool:
    """Whether a value is a number, truth values not included."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def headlines(result: Result) -> dict[str, Scalar]:
    """The few scalars that a reader looks for first."""
    fit = {name: s for name, s in result.scalars.items() if _short(s.value)}
    order = [n for n in fit if n in BETTER]
    order += [n for n in fit if n not in BETTER and not n.startswith(_ASIDE)]
    chosen = set(order[:_MOST_HEADLINES])
    return {name: s for name, s in fit.items() if name in chosen}


def _short(value: Any) -> bool:
    if isinstance(value, list):
        return 0 < len(value) <= _LONGEST_LIST and all(map(is_number, value))
    return is_number(value)


def headline_html(result: Result) -> str:
    """The answer in a few large numbers."""
    meanings = _meanings(result.kind)
    parts = "".join(
        f"<div><dt>{escaped(name_text(name))}</dt>"
        f'<dd><span class="value">{escaped(value_text(s.value, "1", 5))}</span> '
        f'<span class="unit">{escaped(unit_text(s.unit))}</span></dd>'
        f'<dd class="meaning">{marked(meanings.get(name, ""))}</dd></div>'
        for name, s in headlines(result).items()
    )
    if not parts:
        return "<p>No number was found.</p>"
    return f'<dl class="headline">{parts}</dl>{_columns(result)}'


def _columns(result: Result) -> str:
    """Say what the entries of a list stand for, where the result names them."""
    lengths = {len(s.value) for s in headlines(result).values() if isinstance(s.value, list)}
    names = result.attributes.get("trackers")
    if not isinstance(names, list) or lengths != {len(names)} or len(names) < 2:
        return ""
    named = ", then ".join(map(escaped, names))
    return f'<p class="note">Where there are several values: {named}.</p>'


def table_html(result: Result) -> str:
    """All scalars with what they mean."""
    if not result.scalars:
        return ""
    meanings = _meanings(result.kind)
    rows = (
        (escaped(name_text(name)), escaped(value_text(s.value, "1", 9)),
         escaped(unit_text(s.unit)), marked(meanings.get(name, "")))
        for name, s in result.scalars.items()
    )  # fmt: skip
    whole = table("numbers", ("number", "value", "unit", "meaning"), rows)
    return details(f"All {len(result.scalars)} numbers", scrolled("All numbers", whole))


def _meanings(kind: str) -> dict[str, str]:
    known = KINDS[kind].load_table().scalars if kind in KINDS else {}
    return {name: what for name, (_, what) in known.items()}


def comparison_html(results: Sequence[Result]) -> str:
    """What several results were asked differently, and the scalars that they share.

    The best is marked where it is known which that is.
    """
    names = dict.fromkeys(n for r in results for n in r.scalars)
    rows = [_row(n, results) for n in names if not n.startswith(_ASIDE) and _comparable(n, results)]
    heads = [
        f'<a href="#r{k}">{k}. {escaped(r.title or r.scene)}</a>' for k, r in enumerate(results, 1)
    ]
    states = ["failed" if r.status == "failed" else "accepted" for r in results]
    whole = table("compare", ["", *heads], [*_differences(results), ["status", *states], *rows])
    return scrolled("Comparison", whole) + ("" if rows else "<p>They share no number.</p>")


def _differences(results: Sequence[Result]) -> list[list[str]]:
    """Keys in which the scenes of results of one kind differ, if they are not too many to see."""
    asked = [all_keys(result) for result in results]
    paths = dict.fromkeys(path for keys in asked for path in keys)
    different = [path for path in paths if len({repr(keys.get(path)) for keys in asked}) > 1]
    if len({result.kind for result in results}) > 1 or len(different) > _MOST_DIFFERENCES:
        return []
    return [
        [f"<code>{escaped(path)}</code>",
         *(escaped(value_text(keys[path])) if path in keys else "–" for keys in asked)]
        for path in different
    ]  # fmt: skip


def _comparable(name: str, results: Sequence[Result]) -> bool:
    values = [r.scalars[name].value for r in results if name in r.scalars]
    return sum(map(_short, values)) > 1 and all(_short(v) or v is None for v in values)


def _row(name: str, results: Sequence[Result]) -> list[str]:
    scalars = [r.scalars.get(name) for r in results]
    units = {s.unit for s in scalars if s}
    one_unit = len(units) == 1
    best = _best(name, results) if one_unit else None
    unit = unit_text(min(units)) if one_unit else ""
    cells = []
    for result, s in zip(results, scalars, strict=True):
        if s is None:
            cells.append("–")
            continue
        told = escaped(value_text(s.value, "1" if one_unit else s.unit))
        if result.status == "ok" and best is not None and s.value == best:
            told = f'<strong>{told}</strong> <span class="best">best</span>'
        cells.append(told)
    shown = f' <span class="unit">{escaped(unit)}</span>' if unit else ""
    return [f"{escaped(name_text(name))}{shown}", *cells]


def _best(name: str, results: Sequence[Result]) -> float | None:
    """Best value among accepted results, None where all are the same."""
    found = [r.scalars[name].value for r in results if r.status == "ok" and name in r.scalars]
    found = [value for value in found if is_number(value)]
    if name not in BETTER or len(found) < 2 or len(set(found)) == 1:
        return None
    return max(found) if BETTER[name] > 0 else min(found)
