# pyright: strict, reportMissingTypeStubs=false, reportUnknownVariableType=false, reportUnknownArgumentType=false, reportUnknownMemberType=false
"""All points of a sweep as one Result, over the keys that vary."""

from __future__ import annotations

import csv
import io
import json
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, get_args

import msgspec
import numpy as np

from wormopt.families.axes import Plan, dim_of
from wormopt.families.points import Point, Status
from wormopt.labelled import optional
from wormopt.quantities import Scalar, Variable, has_unit, to_number, unit_of
from wormopt.result import Result
from wormopt.study import Scene
from wormopt.study.reference import quantity_of

if TYPE_CHECKING:
    import pandas

STATUS = get_args(Status)
"""Names of the numbers in the variable ``status``."""
NUMBERED = tuple(map(STATUS.index, ("ok", "unchecked")))
"""Status numbers of the points with valid scalars."""
_NUMBER = re.compile(r"(?<![\w.])-?\d+(\.\d+)?(e[-+]?\d+)?")
# Most reasons, warnings and failed checks in the trust report, the most frequent first.
_MOST = 10


def gathered(
    base: Scene[Any],
    asked: Plan,
    tables: Sequence[Any],
    points: Sequence[Point],
    in_files: bool,
) -> Result:
    """Make the Result of a sweep: numbers over the dimensions of the plan, the rest in lists."""
    axes = {dim_of(key): _axis(key, asked, tables, base) for key in asked.keys}
    table = base.table
    found = [
        *_coordinates(asked, axes, base),
        Variable("status", "1", asked.dims, _shaped([STATUS.index(p.status) for p in points],
                 asked), "0 ok, 1 failed, 2 refused, 3 not computed, 4 unchecked"),
        Variable("seconds", "s", asked.dims, _shaped([p.seconds for p in points], asked),
                 "time that it took"),
    ]  # fmt: skip
    # requested results first
    first = {name: table.scalars[name] for name in table.headline if name in table.scalars}
    arrays, lists = _scalars(points, asked, first | dict(table.scalars))
    counts = Counter(point.status for point in points)
    return Result(
        base.name,
        "sweep",
        base.title,
        scalars={
            "points": Scalar(len(points)),
            **{name.replace(" ", "_"): Scalar(counts[name]) for name in STATUS},
            "computed_now": Scalar(len({p.key for p in points if p.is_new})),
            "time_of_all": Scalar(sum(point.seconds for point in points), "s"),
        },
        variables=(*found, *arrays),
        trust=_trust(points),
        scene_text=json.dumps(
            {**json.loads(base.text), "sweep": msgspec.to_builtins(base.sweep)}, ensure_ascii=False
        ),
        attributes={
            "kind": table.kind,
            "units": table.units,
            "axes": [
                {"key": key, "dim": dim, "values": axes[dim]}
                for key, dim in zip(asked.keys, map(dim_of, asked.keys), strict=True)
            ],
            "numbers": [v.name for v in arrays if v.dims == asked.dims],
            "series": [v.name for v in arrays if v.dims[:-1] == asked.dims],
            "files": [f"{p.key}.nc" if p.key and in_files else None for p in points],
            "reasons": [point.reason for point in points],
            "lists": lists,
        },
    )


def _axis(key: str, asked: Plan, tables: Sequence[Any], base: Scene[Any]) -> list[Any]:
    """Values of a key, numbers without units; along its own dimension."""
    values = [
        _plain(point[key], key, base) if table is None else _value_at(table, key)
        for point, table in zip(asked.points, tables, strict=True)
    ]
    if not asked.is_grid:
        return values
    axis = asked.keys.index(key)
    index = np.moveaxis(np.arange(len(values)).reshape(asked.shape), axis, 0)
    refused = [table is None for table in tables]
    # any valid scene may show a value
    best = [min(row.ravel().tolist(), key=refused.__getitem__) for row in index]
    return [values[k] for k in best]


def _plain(value: Any, key: str, base: Scene[Any]) -> Any:
    """Value of a refused point, without its unit if that can be read."""
    if not isinstance(value, str) or not has_unit(value):
        return value
    try:
        return to_number(value, quantity_of(type(base.table), key), base.table.units)
    except ValueError:
        return value


def _value_at(table: Any, key: str) -> Any:
    """Value of a dotted key in a table, as plain data."""
    found = msgspec.to_builtins(table)
    for name in filter(None, re.split(r"[.\[\]]+", key)):
        found = found[int(name)] if isinstance(found, list | tuple) else found[name]
    return found


def _coordinates(
    asked: Plan, axes: Mapping[str, list[Any]], base: Scene[Any]
) -> Iterator[Variable]:
    for key, (dim, values) in zip(asked.keys, axes.items(), strict=True):
        numbers = all(isinstance(v, int | float) and not isinstance(v, bool) for v in values)
        unit = unit_of(quantity_of(type(base.table), key) or "1", base.table.units)
        what = key if numbers else f"{key}: " + ", ".join(f"{k} {v}" for k, v in enumerate(values))
        shown = np.array(values, float) if numbers else np.arange(len(values))
        dims = (dim,) if asked.is_grid else asked.dims
        yield Variable(dim, unit if numbers else "1", dims, shown, what)


def _scalars(
    points: Sequence[Point], asked: Plan, declared: Mapping[str, tuple[str, str]]
) -> tuple[list[Variable], dict[str, list[Any]]]:
    """Numbers and lists of equal lengths as arrays; others unchanged."""
    names = dict.fromkeys(n for n in declared if any(n in p.scalars for p in points))
    names |= dict.fromkeys(name for point in points for name in point.scalars)
    arrays, lists = [], {}
    for name in names:
        values = [p.scalars[name].value if name in p.scalars else None for p in points]
        unit = next(p.scalars[name].unit for p in points if name in p.scalars)
        array = _array(values)
        if array is None:
            lists[name] = values
            continue
        own = re.sub(r"[^A-Za-z0-9_]", "_", name)
        own = f"{own}_found" if own in {*map(dim_of, asked.keys), "status", "seconds"} else own
        dims = (*asked.dims, *(f"{own}_{'entry' if k == 0 else 'part'}"
                               for k in range(array.ndim - 1)))  # fmt: skip
        shape = (*asked.shape, *array.shape[1:])
        what = declared[name][1] if name in declared else name
        arrays.append(Variable(own, unit, dims, array.reshape(shape), what))
    return arrays, lists


def _array(values: Sequence[Any]) -> np.ndarray | None:
    """Numbers as an array, NaN for missing ones; None for texts and ragged lists."""
    given = [value for value in values if value is not None]
    try:
        shapes = {np.shape(np.array(value, float)) for value in given}
    except (TypeError, ValueError):
        return None
    if len(shapes) != 1 or any(isinstance(value, str) for value in given):
        return None
    (shape,) = shapes
    if len(shape) > 2 or 0 in shape:
        return None
    return np.array([np.full(shape, np.nan) if v is None else np.array(v, float) for v in values])


def _shaped(values: Sequence[float], asked: Plan) -> np.ndarray:
    return np.array(values).reshape(asked.shape)


def _alike(reasons: Iterable[str]) -> Counter[str]:
    """Frequencies of reasons; those that differ only in numbers are merged, without these."""
    found: dict[str, list[str]] = {}
    for reason in reasons:
        found.setdefault(_NUMBER.sub("…", reason), []).append(reason)
    return Counter({(g[0] if len(set(g)) == 1 else text): len(g) for text, g in found.items()})


def _trust(points: Sequence[Point]) -> dict[str, Any]:
    """Messages with numbers of points."""
    checks = [p.trust.get("checks", {}) for p in points]
    poor = Counter(name for found in checks for name, c in found.items() if not c["passed"])
    warned = Counter(text for p in points for text in p.trust.get("warnings", ()))
    return {
        "reasons": dict(_alike(p.reason for p in points if p.reason).most_common(_MOST)),
        "checks_failed": dict(poor.most_common(_MOST)),
        "warnings": [
            text if count == 1 else f"{text} ({count} points)"
            for text, count in warned.most_common(_MOST)
        ],
    }


def as_typed(result: Result) -> Result:
    """Convert angles of a sweep to degrees if the scene had degrees."""
    typed = json.loads(result.scene_text or "{}").get("sweep", {}).get("over", {})
    axes, variables = [], {variable.name: variable for variable in result.variables}
    for axis in result.attributes["axes"]:
        own, text = result[axis["dim"]], str(typed.get(axis["key"]))
        if own.unit == "rad" and ("deg" in text or "°" in text):
            own = replace(own, unit="deg", values=np.degrees(own.values))
            variables[own.name], axis = own, axis | {"values": own.values.tolist()}
        axes.append(axis)
    return replace(
        result,
        variables=tuple(variables.values()),
        attributes={**result.attributes, "axes": axes},
    )


def everywhere(result: Result, dim: str, values: np.ndarray) -> np.ndarray:
    """Values along the dimension of a key at every point of a sweep, in one row."""
    status = result["status"]
    place = status.dims.index(result[dim].dims[0])
    along = values.reshape([-1 if k == place else 1 for k in range(len(status.dims))])
    return np.broadcast_to(along, status.values.shape).ravel()


def as_csv(result: Result) -> str:
    """Table of a sweep: a row for every point, with units in the header."""
    columns = columns_of(result)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(f"{name} [{unit}]" if unit else name for name, (unit, _) in columns.items())
    writer.writerows(zip(*(values for _, values in columns.values()), strict=True))
    return text.getvalue()


def dataframe(result: Result) -> pandas.DataFrame:
    """Table of a sweep as a pandas.DataFrame, with units in ``attrs["units"]``."""
    pandas = optional("pandas")
    columns = columns_of(result)
    frame = pandas.DataFrame({name: values for name, (_, values) in columns.items()})
    frame.attrs["units"] = {name: unit for name, (unit, _) in columns.items() if unit}
    return frame


def columns_of(result: Result) -> dict[str, tuple[str, list[Any]]]:
    """Unit, or none, and one value for each point: of swept keys and of results."""

    def column(unit: str, values: Any) -> tuple[str, list[Any]]:
        return "" if unit == "1" else unit, np.asarray(values, object).ravel().tolist()

    status = result["status"]
    columns: dict[str, tuple[str, list[Any]]] = {}
    for axis in result.attributes["axes"]:
        values = np.array([*axis["values"], None], dtype=object)[:-1]  # lists are values too
        at = everywhere(result, axis["dim"], values)
        columns[axis["key"]] = column(result[axis["dim"]].unit, at)
    columns["status"] = column("1", [STATUS[k] for k in status.values.ravel()])
    columns["reason"] = column("1", result.attributes["reasons"])
    for name in ("seconds", *result.attributes["numbers"]):
        columns[name] = column(result[name].unit, result[name].values)
    return columns
