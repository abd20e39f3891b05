"""Numbers of results: the most important, all, comparisons, and how far to trust them."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from wormopt.digest import BETTER, leading
from wormopt.kinds import KINDS
from wormopt.quantities import Scalar
from wormopt.reports.parts import (
    details,
    escaped,
    marked,
    name_text,
    number,
    scrolled,
    sentence,
    table,
    unit_text,
    value_text,
)
from wormopt.reports.source import all_keys
from wormopt.result import Check, Result


def markdown_html(text: str) -> str:
    """Convert the headings, paragraphs and tables of a text."""
    return "".join(_block(block) for block in re.split(r"\n\s*\n", text.strip()) if block)


def _block(block: str) -> str:
    if block.startswith("#"):
        return f'<p class="name">{marked(block.lstrip("# "))}</p>'
    if not block.startswith("|"):
        return f'<p class="note">{marked(block)}</p>'
    heads, _, *rows = (
        [marked(cell.strip()) for cell in re.split(r"(?<!\\)\|", line.strip()[1:-1])]
        for line in block.splitlines()
    )
    return scrolled("Table", table("figures", heads, rows))


_MOST_DIFFERENCES, _FEW = 12, 4
_LONG, _LONGEST = 24, 100  # letters of a value on its own line, and of one that is left out
_ASIDE = ("recheck", "n_", "sensitivity", "lambda_", "resting", "assumed", "defect", "order_",
          "complementarity", "worst", "discretisation", "solve_", "objective", "same_", "front_",
          "certified_", "smallest_")  # fmt: skip


def is_number(value: Any) -> bool:
    """Whether a value is a number; booleans are not."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def answers(result: Result) -> dict[str, Scalar]:
    """The few most important scalars, if they are known and short."""
    asked = {name: result.scalars[name] for name in leading(result)}
    return {name: s for name, s in asked.items() if _short(s.value)}


def _short(value: Any) -> bool:
    return value is not None and len(value_text(value)) <= _LONGEST


def _is_plain(value: Any) -> bool:
    """Whether a value is a number, or a few of them."""
    if isinstance(value, list):
        return 0 < len(value) <= _FEW and all(map(is_number, value))
    return is_number(value)


def headline_html(result: Result) -> str:
    """The most important numbers, in large letters."""
    meanings = _meanings(result.kind)
    parts = "".join(_answer(n, s, meanings.get(n, "")) for n, s in answers(result).items())
    if not parts:
        return "<p>No number was found.</p>"
    table = markdown_html(str(result.attributes.get("table", "")))
    return f'{_whose(result)}<dl class="headline">{parts}</dl>{_columns(result)}{table}'


def _answer(name: str, found: Scalar, meaning: str) -> str:
    shown = value_text(found.value, "1", 5)
    kind = "long" if len(shown) > _LONG else "short"
    return (
        f'<div class="{kind}"><dt>{escaped(name_text(name))}</dt>'
        f'<dd><span class="value">{escaped(shown)}</span> '
        f'<span class="unit">{escaped(unit_text(found.unit))}</span></dd>'
        f'<dd class="meaning">{marked(meaning)}</dd></div>'
    )


def _whose(result: Result) -> str:
    """Note on the point of a front to which other numbers belong."""
    if "front_knee" not in result.scalars or "front_speed" not in result:
        return ""
    knee, last = result.scalars["front_knee"].value, len(result["front_speed"].values) - 1
    return (
        f'<p class="note">The gait at the knee of the front, point {knee} of 0 to {last}, is the '
        "selected one: the motion, the checks and all values except those of the front belong to "
        "it.</p>"
    )


def _columns(result: Result) -> str:
    """Note on the meaning of entries of a list, if the result names them."""
    lengths = {len(s.value) for s in answers(result).values() if isinstance(s.value, list)}
    names = result.attributes.get("trackers")
    if not isinstance(names, list) or lengths != {len(names)} or len(names) < 2:
        return ""
    named = ", then ".join(map(escaped, names))
    return f'<p class="note">Where there are several values: {named}.</p>'


def table_html(result: Result) -> str:
    """All scalars with their meanings."""
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
    known = KINDS[kind].load().scalars if kind in KINDS else {}
    return {name: what for name, (_, what) in known.items()}


def comparison_html(results: Sequence[Result]) -> str:
    """Differences between the scenes of several results, and the scalars that they share."""
    first = [name for result in results for name in leading(result)]
    others = [
        name
        for result in results
        for name, s in result.scalars.items()
        if not name.startswith(_ASIDE) and _is_plain(s.value)
    ]
    rows = [_row(n, results) for n in dict.fromkeys(first + others) if _comparable(n, results)]
    heads = [
        f'<a href="#r{k}">{k}. {escaped(r.title or r.scene)}</a>'
        f"{' (at its knee)' if 'front_knee' in r.scalars else ''}"
        for k, r in enumerate(results)
    ]
    states = ["accepted" if r.status == "ok" else r.status for r in results]
    whole = table("compare", ["", *heads], [*_differences(results), ["status", *states], *rows])
    return scrolled("Comparison", whole) + ("" if rows else "<p>They share no number.</p>")


def _differences(results: Sequence[Result]) -> list[list[str]]:
    """Keys in which the scenes of results of one kind differ, if they are not too many."""
    different = _different(results)
    if len({result.kind for result in results}) > 1 or len(different) > _MOST_DIFFERENCES:
        return []
    return [[f"<code>{escaped(path)}</code>", *values] for path, values in different.items()]


def _different(results: Sequence[Result]) -> dict[str, list[str]]:
    """Values in several scenes of the keys in which they differ."""
    asked = [all_keys(result) for result in results]
    paths = dict.fromkeys(path for keys in asked for path in keys)
    return {
        path: [escaped(value_text(keys[path])) if path in keys else "–" for keys in asked]
        for path in paths
        if len({repr(keys.get(path)) for keys in asked}) > 1
    }


def told_apart(result: Result, results: Sequence[Result]) -> str:
    """Kind or keys by which a result differs from others of its title; empty if there are none."""
    alike = [r for r in results if (r.title or r.scene) == (result.title or result.scene)]
    if len({r.kind for r in alike}) == len(alike) > 1:
        return f"kind {escaped(result.kind)}"
    at = alike.index(result)
    shown = [
        f"<code>{escaped(path)}</code> = {each[at]}" for path, each in _different(alike).items()
    ]
    more = f" and {len(shown) - _FEW} keys more" if len(shown) > _FEW else ""
    return ", ".join(shown[:_FEW]) + more


def _comparable(name: str, results: Sequence[Result]) -> bool:
    values = [r.scalars[name].value for r in results if name in r.scalars]
    return sum(map(_short, values)) > 1 and all(_short(v) or v is None for v in values)


def _row(name: str, results: Sequence[Result]) -> list[str]:
    scalars = [r.scalars.get(name) for r in results]
    units = {s.unit for s in scalars if s}
    one_unit = len(units) == 1
    best = _best(name, results) if one_unit else ""
    unit = unit_text(min(units)) if one_unit else ""
    cells = []
    for result, s in zip(results, scalars, strict=True):
        if s is None:
            cells.append("–")
            continue
        cell = escaped(value_text(s.value, "1" if one_unit else s.unit))
        if result.status != "failed" and cell == best:
            cell = f'<strong>{cell}</strong> <span class="best">best</span>'
        cells.append(cell)
    shown = f' <span class="unit">{escaped(unit)}</span>' if unit else ""
    return [f"{escaped(name_text(name))}{shown}", *cells]


def _best(name: str, results: Sequence[Result]) -> str:
    """Formatted best value among accepted results, empty if all are formatted the same."""
    found = [r.scalars[name].value for r in results if r.status != "failed" and name in r.scalars]
    found = [value for value in found if is_number(value)]
    if name not in BETTER or len({number(value) for value in found}) < 2:
        return ""
    return number(max(found) if BETTER[name] > 0 else min(found))


_SAID = ("checks", "warnings", "recheck")  # described separately
_MOST_LETTERS = 60_000  # largest number of letters of a report in full


def status_html(result: Result) -> str:
    """Status on one line, with the reason."""
    checks = result.checks
    if result.status == "failed":
        why = sentence(result.reason or "no reason is given")
        return f'<p class="status failed"><strong>Failed.</strong> {escaped(why)}</p>'
    if result.status == "unchecked":
        why = escaped(sentence(result.reason))
        return f'<p class="status unchecked"><strong>Unchecked.</strong> {why}</p>'
    warnings = len(result.trust.get("warnings") or [])
    words = "Accepted."
    if checks:
        words += (
            " The one check passed." if len(checks) == 1 else f" All {len(checks)} checks passed."
        )
    if warnings:
        words += (
            f" There {'is a warning' if warnings == 1 else f'are {warnings} warnings'}, see below."
        )
    return f'<p class="status ok">{words}</p>'


def trust_html(result: Result) -> str:
    """Checks, second routes, bounds and warnings."""
    found = [
        *_failures(result.checks),
        *_routes(result.trust.get("recheck")),
        *_bounds(result),
    ]
    lines = "".join(f"<li>{escaped(line)}</li>" for line in found)
    warnings = "".join(
        f"<li>{escaped(sentence(str(line)))}</li>" for line in result.trust.get("warnings") or []
    )
    parts = [f"<ul>{lines}</ul>" if lines else ""]
    parts.append(f'<p>Warnings:</p><ul class="warnings">{warnings}</ul>' if warnings else "")
    parts.append(_checks_html(result.checks))
    parts.append(_rest(result.trust))
    return "".join(parts)


def _failures(checks: tuple[Check, ...]) -> Iterator[str]:
    for check in checks:
        if not check.passed:
            found = "unknown" if check.value is None else number(check.value, 3)
            yield (
                f"Not accepted: {name_text(check.name)} is {found}, accepted is up to "
                f"{number(check.limit, 3)}. {sentence(check.advice)}"
            )


def _routes(recheck: Any) -> Iterator[str]:
    """Sentences about second computations."""
    if isinstance(recheck, list):
        yield from dict.fromkeys(line for item in recheck for line in _routes(item))
    if not isinstance(recheck, Mapping):
        return
    method = recheck.get("method") or recheck.get("route")
    if not isinstance(method, str):
        return
    text = f"Computed a second time, by another route ({method})"
    error, accepted = recheck.get("error"), recheck.get("accepted")
    if is_number(error):
        text += f"; the two differ by {number(error, 2)}"
        text += f", accepted is {number(accepted, 2)}" if is_number(accepted) else ""
    text += "."
    if isinstance(recheck.get("shared"), str):
        text += f" Both share {recheck['shared']}."
    yield text


def _bounds(result: Result) -> Iterator[str]:
    known = {name: s for name, s in result.scalars.items() if is_number(s.value)}
    if "bound" in known:
        proof = result.trust.get("certificate")
        holds = proof.get("holds_for") if isinstance(proof, Mapping) else None
        far = known.get("gap_certified")
        gap = f"; the result is within {_percent(far.value)} of it" if far else ""
        bound = value_text(known["bound"].value, known["bound"].unit)
        yield f"Proven bound: {bound}{gap}." + (f" It holds for {holds}." if holds else "")
    elif "ceiling" in known:
        what = result.trust.get("ceiling")
        why = f" ({what})" if isinstance(what, str) else ""
        ceiling = known["ceiling"]
        yield f"Nothing can be faster than {value_text(ceiling.value, ceiling.unit)}{why}."


def _percent(share: float) -> str:
    return f"{number(100 * share, 3)}\u202f%"


def _checks_html(checks: tuple[Check, ...]) -> str:
    if not checks:
        return ""
    rows = (
        (escaped(name_text(c.name)), number(c.value, 3), number(c.limit, 3),
         "passed" if c.passed else "<strong>failed</strong>")
        for c in checks
    )  # fmt: skip
    whole = scrolled("Checks", table("checks", ("check", "found", "accepted up to", ""), rows))
    failed = sum(not c.passed for c in checks)
    title = f"{failed} of {len(checks)} checks failed" if failed else f"{len(checks)} checks"
    return details(f"{title}: values found and accepted limits", whole, opened=failed > 0)


def _rest(trust: Mapping[str, Any]) -> str:
    kept = {key: value for key, value in trust.items() if key not in _SAID[:2]}
    text = _tree(kept) if kept else ""
    if len(text) > _MOST_LETTERS:
        text = "<p>It is too long for this page; the result contains it.</p>"
    return details("Trust report in full", text) if text else ""


def _tree(value: Any) -> str:
    if isinstance(value, Mapping) and value:
        parts = (f"<dt>{escaped(name_text(k))}</dt><dd>{_tree(v)}</dd>" for k, v in value.items())
        return f'<dl class="tree">{"".join(parts)}</dl>'
    if isinstance(value, list) and any(isinstance(item, Mapping) for item in value):
        return f"<ol>{''.join(f'<li>{_tree(item)}</li>' for item in value)}</ol>"
    return escaped(value_text(value))
