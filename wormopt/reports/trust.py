"""Reasons to trust a result, or not, in plain words."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from wormopt.reports.numbers import is_number
from wormopt.reports.parts import details, scrolled, table
from wormopt.reports.words import escaped, name_text, number, sentence, value_text
from wormopt.result import Check, Result

_SAID = ("checks", "warnings", "recheck")  # described separately
_LONGEST = 60_000  # largest number of letters of a report in full


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
    way = recheck.get("method") or recheck.get("route")
    if not isinstance(way, str):
        return
    text = f"Computed a second time, by another route ({way})"
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
    return details(f"{title}: what was found, and what is accepted", whole, opened=failed > 0)


def _rest(trust: Mapping[str, Any]) -> str:
    kept = {key: value for key, value in trust.items() if key not in _SAID[:2]}
    text = _tree(kept) if kept else ""
    if len(text) > _LONGEST:
        text = "<p>It is too long for this page; it stands in the result.</p>"
    return details("Trust report in full", text) if text else ""


def _tree(value: Any) -> str:
    if isinstance(value, Mapping) and value:
        parts = (f"<dt>{escaped(name_text(k))}</dt><dd>{_tree(v)}</dd>" for k, v in value.items())
        return f'<dl class="tree">{"".join(parts)}</dl>'
    if isinstance(value, list) and any(isinstance(item, Mapping) for item in value):
        return f"<ol>{''.join(f'<li>{_tree(item)}</li>' for item in value)}</ol>"
    return escaped(value_text(value))
