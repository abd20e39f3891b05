"""Parquet: the tables of CSV, typed; units are metadata of columns, remarks of the file."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

from wormopt.exports.common import optional, remarks
from wormopt.exports.csv_tables import tables
from wormopt.result import Result


def make(
    result: Result,
    stem: str,
    step: float | None = None,
    columns: Sequence[str] = (),
    *,
    whole_steps: bool = False,
) -> dict[str, bytes]:
    """``STEM.parquet`` over time, ``STEM_point.parquet`` and so on, see `csv_tables.make`."""
    arrow, parquet = optional("pyarrow", "parquet"), optional("pyarrow.parquet", "parquet")
    if result.kind == "sweep" and step is None and not columns:
        from wormopt.families.gathered import columns_of

        found = [(name, unit or "1", values) for name, (unit, values) in columns_of(result).items()]
        made: dict[str, tuple[Sequence[str], Sequence[tuple[str, str, Any]]]] = {
            stem: (remarks(result), found)
        }
    else:
        made = {**tables(result, stem, step, columns, whole_steps=whole_steps)}
    files: dict[str, bytes] = {}
    for name, (lines, found) in made.items():
        arrays = [arrow.array(_plain(values)) for _, _, values in found]
        fields = [
            arrow.field(column, array.type, metadata={"units": unit})
            for (column, unit, _), array in zip(found, arrays, strict=True)
        ]
        schema = arrow.schema(fields, metadata={"remarks": "\n".join(lines)})
        stream = io.BytesIO()
        parquet.write_table(arrow.table(arrays, schema=schema), stream)
        files[f"{name}.parquet"] = stream.getvalue()
    return files


def _plain(values: Any) -> list[Any]:
    """Values of Python, of which lists and texts have their own types."""
    return values if isinstance(values, list) else values.tolist()
