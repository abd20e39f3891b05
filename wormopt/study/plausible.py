# pyright: strict
"""Warnings about sizes that no crawling robot from a millimetre to ten metres has."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, cast

from msgspec import NODEFAULT, Struct, structs

from wormopt.quantities import unit_of
from wormopt.study.given import said_of

# Quantity: smallest and largest usual size in its SI unit.
USUAL = {
    "length": (1e-7, 20.0),
    "area": (1e-12, 10.0),
    "time": (1e-5, 1e10),
    "speed": (1e-9, 20.0),
    "acceleration": (1e-6, 2e4),
    "angular_frequency": (1e-4, 1e6),
    "rate": (1e-4, 1e6),
    "rate_change": (1e-4, 1e8),
    "mass": (1e-9, 1e4),
    "density": (0.1, 3e4),
    "viscosity": (1e-6, 1e4),
    "surface_tension": (1e-5, 10.0),
    "force": (1e-10, 1e5),
    "drag": (1e-10, 1e6),
    "stiffness": (1e-9, 1e9),
    "stress": (1e-3, 1e12),
    "magnetic_field": (1.0, 1e7),
    "current": (1e-6, 1e6),
    "ampere_turns": (1e-6, 1e6),
    "diffusivity": (1e-14, 1e-2),
}
_SMALLER = {"m": "mm", "s": "ms", "kg": "g", "N": "mN", "m s-1": "mm/s", "m s-2": "mm/s^2"}


def unusual_sizes(table: Struct, units: str, path: str = "") -> Iterator[str]:
    """Yield a warning for each number in a table of a scene that is unlikely to be intended."""
    if units != "SI":
        return
    for each in structs.fields(table):
        value, key = getattr(table, each.name), f"{path}.{each.name}" if path else each.name
        if each.default is not NODEFAULT and value == each.default:
            continue
        declared = said_of(each.type)
        usual = declared.get("usual") or USUAL.get(declared.get("quantity", ""))
        for place, item in items_of(value, key):
            if isinstance(item, Struct):
                yield from unusual_sizes(item, units, place)
            elif usual and isinstance(item, float | int) and not isinstance(item, bool):
                yield from _unusual(place, abs(item), declared["quantity"], usual)


def items_of(value: Any, key: str) -> Iterator[tuple[str, Any]]:
    """Yield the entries of lists with their key paths, or the value itself."""
    if isinstance(value, tuple):
        for index, item in enumerate(cast("tuple[Any, ...]", value)):
            yield from items_of(item, f"{key}[{index}]")
    else:
        yield key, value


def _unusual(key: str, size: float, quantity: str, usual: tuple[float, float]) -> Iterator[str]:
    least, most = usual
    if size == 0 or least <= size <= most:
        return
    unit = unit_of(quantity, "SI")
    smaller = _SMALLER.get(unit, "") if size > most >= size / 1000 else ""
    hint = f'; did you mean "{size:g} {smaller}"?' if smaller else ""
    what = f"a {quantity.replace('_', ' ')} from {least:g} to {most:g} {unit} is usual"
    yield f"{key} = {size:g} {unit} is unusual for a crawling robot: {what}{hint}"
