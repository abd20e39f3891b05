"""Parquet: the tables of CSV, typed; units are metadata of columns, remarks of the file."""

from __future__ import annotations

import io
from collections.abc import Sequence

from wormopt.exports.common import optional
from wormopt.exports.csv_tables import plain, tables
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
    files: dict[str, bytes] = {}
    made = tables(result, stem, step, columns, whole_steps=whole_steps)
    for name, (lines, found) in made.items():
        arrays = [arrow.array(plain(values)) for _, _, values in found]
        fields = [
            arrow.field(column, array.type, metadata={"units": unit or "1"})
            for (column, unit, _), array in zip(found, arrays, strict=True)
        ]
        schema = arrow.schema(fields, metadata={"remarks": "\n".join(lines)})
        stream = io.BytesIO()
        parquet.write_table(arrow.table(arrays, schema=schema), stream)
        files[f"{name}.parquet"] = stream.getvalue()
    return files
