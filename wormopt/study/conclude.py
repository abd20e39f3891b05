"""The end of every study: the Result of a scene, named and given units as its kind declares."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from wormopt.quantities import Scalar, Variable, unit_of
from wormopt.result import Check, Result
from wormopt.study.scene import Scene
from wormopt.study.study import status_of


def conclude(
    scene: Scene[Any],
    scalars: Mapping[str, Any],
    variables: Mapping[str, Any] | Sequence[Variable] = (),
    *,
    checks: Iterable[Check] = (),
    facts: Mapping[str, Any] | None = None,
    warnings: Iterable[str] = (),
    timings: Mapping[str, float] | None = None,
    attributes: Mapping[str, Any] | None = None,
) -> Result:
    """Make the Result of a scene: failed where a check is, unchecked where a warning says so.

    Units, dimensions and long names of numbers and arrays given by name are those that the table
    of the scene's kind declares; Scalars and Variables may be given too. `facts` are the part of
    the trust report that is neither accepted nor refused.
    """
    table, checks = scene.table, tuple(checks)
    trust: dict[str, Any] = {**table.facts, **(facts or {})}
    if checks:
        trust["checks"] = {check.name: check.found() for check in checks}
        assert len(trust["checks"]) == len(checks), [check.name for check in checks]
    warned = [*scene.warnings, *table.file_warnings(scene.folder, table.units), *warnings]
    status, reasons = status_of(checks, warned)
    return Result(
        scene.name,
        table.kind,
        scene.title,
        status=status,
        reason="; ".join(reasons),
        scalars={
            name: value
            if isinstance(value, Scalar)
            else Scalar(value, unit_of(table.scalars[name][0], table.units))
            for name, value in scalars.items()
        },
        variables=tuple(_arrays(table, variables)),
        trust=trust | {"warnings": list(dict.fromkeys(warned))},
        timings_s=timings or {},
        scene_text=scene.text,
        attributes=attributes or {},
    )


def _arrays(table: Any, found: Mapping[str, Any] | Sequence[Variable]) -> Iterator[Variable]:
    if not isinstance(found, Mapping):
        yield from found
        return
    for name, values in found.items():
        if isinstance(values, Variable):
            yield values
        else:
            quantity, dims, what = table.variables[name]
            yield Variable(name, unit_of(quantity, table.units), dims, values, what)
