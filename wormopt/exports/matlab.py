"""MATLAB: a whole result, as one structure in a file for ``load``."""

from __future__ import annotations

import io
import json
from collections.abc import Iterable
from typing import Any

import numpy as np

from wormopt.files import MARK
from wormopt.result import Result
from wormopt.version import VERSION

# SciPy's own header contains the time, so that equal results would have different files.
_HEADER = b"MATLAB 5.0 MAT-file, written by wormopt".ljust(116)
_LONGEST = 63
_KEYWORDS = frozenset(
    "break case catch classdef continue else elseif end for function global if otherwise parfor "
    "persistent return spmd switch try while".split()
)


def make(result: Result, stem: str) -> dict[str, bytes]:
    """``STEM.mat`` with structures ``variables`` and ``scalars``, and texts, trust as JSON."""
    from scipy.io import savemat

    variables = {
        v.name: {
            "value": v.values.astype(float),
            "units": v.unit,
            "dims": np.array(v.dims, dtype=object),
            "long_name": v.long_name,
        }
        for v in result.variables
    }
    scalars = {n: {"value": value_of(s.value), "units": s.unit} for n, s in result.scalars.items()}
    whole = {
        "variables": _named(variables),
        "scalars": _named(scalars),
        **texts_of(result),
        "mark": np.frombuffer(MARK.encode(), np.uint8),
    }
    stream = io.BytesIO()
    savemat(stream, whole, long_field_names=True, oned_as="column")
    return {f"{stem}.mat": _HEADER + stream.getvalue()[len(_HEADER) :]}


def texts_of(result: Result) -> dict[str, str]:
    """Texts of a result, its trust report and scene as JSON."""
    names = ("scene", "kind", "title", "status", "reason", "scene_text")
    trust = json.dumps(result.trust, ensure_ascii=False)
    return {"trust": trust, "wormopt": VERSION, **{name: getattr(result, name) for name in names}}


def field_names(names: Iterable[str]) -> dict[str, str]:
    """Names of fields that MATLAB allows: no keywords, at most 63 letters, no duplicates."""
    found: dict[str, str] = {}
    for name in names:
        valid = "".join(c if c.isascii() and (c.isalnum() or c == "_") else "_" for c in name)
        if valid in _KEYWORDS or not valid[:1].isalpha():
            valid = f"x_{valid}"
        valid, number = valid[:_LONGEST], 2
        base = valid
        while valid in found.values():
            ending = f"_{number}"
            valid, number = base[: _LONGEST - len(ending)] + ending, number + 1
        found[name] = valid
    return found


def _named(parts: dict[str, Any]) -> dict[str, Any]:
    names = field_names(parts)
    return {names[name]: part for name, part in parts.items()}


def value_of(value: Any) -> Any:
    """Number, array or text; NaN if unknown, JSON for ragged lists."""
    if value is None:
        return np.nan
    if isinstance(value, list):
        try:
            return np.array(value, dtype=float)
        except (ValueError, TypeError):
            return json.dumps(value, ensure_ascii=False)
    return float(value) if isinstance(value, bool | int) else value
