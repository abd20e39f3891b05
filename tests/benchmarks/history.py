"""Ratios of times, ours over theirs, by version: a loss is seen.

Ratios, not seconds: they travel from machine to machine, and a busy one slows all down alike.
"""

from __future__ import annotations

import json
import subprocess
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from statistics import median
from typing import Any

from wormopt.errors import OutputError
from wormopt.version import VERSION

LOST = 1.5
"""A ratio that has grown by more is told."""
_LAST = 5  # entries whose median counts: a single one may have been unlucky

Entry = dict[str, Any]
"""``version``, ``date``, ``processor``, ``quick``, and ``ratios`` by case, then by solver."""


def entry(machine: Mapping[str, str], quick: bool, ratios: Mapping[str, Any]) -> Entry:
    """What is known now."""
    return {"version": version(), "date": f"{datetime.now(UTC):%Y-%m-%d}",
            "processor": machine["processor"], "quick": quick, "ratios": dict(ratios)}  # fmt: skip


def version() -> str:
    """The version, and of a checkout the commit."""
    root = Path(__file__).resolve().parents[2]
    if not (root / ".git").exists():
        return VERSION
    asked = ["git", "-C", str(root), "describe", "--always", "--dirty", "--exclude=*"]
    try:
        found = subprocess.run(asked, capture_output=True, text=True, timeout=10, check=True)
    except (OSError, subprocess.SubprocessError):
        return VERSION
    return f"{VERSION}+{found.stdout.strip()}"


def read(file: Path) -> list[Entry]:
    """Entries so far, old ones first; OutputError if the file is something else."""
    try:
        found = json.loads(file.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return []
    except ValueError as error:
        raise OutputError(f"{file}: is no history of benchmarks; move it away") from error
    keys = {"version", "date", "processor", "quick", "ratios"}
    if not (isinstance(found, list) and all(isinstance(e, dict) and keys <= set(e) for e in found)):
        raise OutputError(f"{file}: is no history of benchmarks; move it away")
    return found


def append(file: Path, new: Entry) -> list[str]:
    """Add an entry; the ratios that have become worse, a line each."""
    before = read(file)
    unfinished = file.with_suffix(".part")
    unfinished.write_text(json.dumps([*before, new], indent=1) + "\n", encoding="utf-8")
    unfinished.replace(file)
    return losses(before, new)


def losses(before: Sequence[Entry], new: Entry) -> list[str]:
    """Ratios above `LOST` times the median of the last ones that were measured alike."""
    told: list[str] = []
    for case, ratios in new["ratios"].items():
        for solver, ratio in ratios.items():
            known = [e["ratios"].get(case, {}).get(solver) for e in before
                     if e["quick"] == new["quick"]]  # fmt: skip
            known = [each for each in known if each][-_LAST:]
            if known and ratio > LOST * (usual := median(known)):
                told.append(
                    f"lost: {case}: {ratio:.3g} of the time of {solver}, {usual:.3g} before "
                    f"(× {ratio / usual:.2g})"
                )
    return told


def table(entries: Sequence[Entry], case: str) -> list[list[str]]:
    """Ratios of a case by solver, a column per version; the first row is the head."""
    known = [e for e in entries if e["ratios"].get(case)]
    solvers = dict.fromkeys(name for e in known for name in e["ratios"][case])
    head = ["ours/theirs", *(e["version"] + (" quick" if e["quick"] else "") for e in known)]
    rows = [
        [name, *(f"{r:.3g}" if (r := e["ratios"][case].get(name)) else "" for e in known)]
        for name in solvers
    ]
    return [head, *rows] if rows else []
