"""Short form of a Result: scalars in groups, active limits, and trust."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np

from wormopt.kinds import KINDS
from wormopt.shown import Part, brief, whole_lists

# Better direction of numbers, if it is defined.
BETTER = {
    "speed": 1, "mean_speed": 1, "distance": 1, "velocity_best": 1, "mean_flow": 1,
    "spike_load_max": -1, "actuator_force_max": -1, "energy_per_distance": -1,
    "cost_of_transport": -1, "input_rms": -1, "input_peak": -1, "time_outside_tube": -1,
    "capture_time": -1, "gap_certified": -1,
}  # fmt: skip
# Number of scalars shown first if a kind does not name them.
_FIRST = 5
# Scalars about the computation; they are not part of the short form.
_OF_THE_COMPUTATION = ("recheck_", "solve_", "defect_", "complementarity_", "discretisation_",
                       "worst_", "n_steps", "assumed_")  # fmt: skip
# A limit is reached if this share of it is left, and has no effect below this many per cent.
_REACHED, _NO_EFFECT = 1e-6, 1e-6


def groups(result: Any) -> list[Part]:
    """Group scalars: requested ones, limits, the rest; rows of name, value, remark."""
    first, limits = leading(result), [*_limits(result)]
    taken = {*first, *(row[0] for row in limits), *_aside(result)}
    taken |= {"objective"} if _repeated(result, first) else set()
    return [
        Part("", [*_entries(result), *(_row(result, name) for name in first), *_best(result)]),
        Part(_heading_of_limits(result), limits),
        Part("Other results", [_row(result, name) for name in result.scalars if name not in taken]),
    ]


def trust(result: Any) -> Iterator[str]:
    """Describe trust in lines: status and worst check, second route, warnings."""
    reason = f": {result.reason}" if result.reason else ""
    yield f"{result.status}{reason}{_worst(result.checks)}"
    yield from (f"{count} × {why}" for why, count in result.trust.get("reasons", {}).items())
    second = _second_route(result)
    if second:
        yield f"second route: {second}"
    warnings = result.trust.get("warnings", [])
    if not warnings:
        yield "no warnings"
    elif len(warnings) == 1:
        yield f"1 warning: {warnings[0]}"
    else:
        yield f"{len(warnings)} warnings:"
        yield from (f"- {warning}" for warning in warnings)


def headline(result: Any) -> str:
    """Write the main scalars on one line."""
    rows = [_row(result, name) for name in leading(result)]
    return ", ".join(f"{name} {value}" for name, value, _ in rows)


def leading(result: Any) -> list[str]:
    """Names of the main scalars; the first ones if a kind does not name them."""
    declared = KINDS[result.kind].load().headline if result.kind in KINDS else ()
    chosen = [name for name in declared if name in result.scalars]
    chosen = chosen or [name for name in result.scalars if name not in _aside(result)][:_FIRST]
    return [name for name in chosen if name != "objective" or not _repeated(result, chosen)]


def _repeated(result: Any, chosen: Iterable[str]) -> bool:
    """Whether the objective is one of the others, up to its sign."""
    best = _size(result.scalars["objective"].value) if "objective" in result.scalars else None
    others = (_size(result.scalars[name].value) for name in chosen if name != "objective")
    return best is not None and best in others


def _aside(result: Any) -> set[str]:
    """Scalars that the short form omits: about the computation, or redundant."""
    effects = ("sensitivity.",) if _effects_known(result) else ()
    found = {name for name in result.scalars if name.startswith((*_OF_THE_COMPUTATION, *effects))}
    found |= {part for name in result.scalars for part in _errors(result, name)}
    return found | {name for name in result.scalars if effects and _limited(name)}


def _size(value: Any) -> float | None:
    known = isinstance(value, int | float) and not isinstance(value, bool)
    return abs(value) if known else None


def _limited(name: str) -> str:
    """Quantity that a scalar limits, by its name; empty if it is no limit."""
    found = re.fullmatch(r"(.+)_limits?", name)
    return found[1] if found else ""


def _effects_known(result: Any) -> bool:
    return isinstance(result.attributes.get("limits"), Mapping) and "limit_elasticity" in result


def _row(result: Any, name: str) -> tuple[str, str, str]:
    scalar, errors = result.scalars[name], _errors(result, name)
    remark = f"± {brief(result.scalars[errors[0]].value)}" if errors else ""
    return name, _with_unit(scalar.value, scalar.unit), remark


def _errors(result: Any, name: str) -> list[str]:
    """Scalars with the standard error and the interval of an estimate; none of other scalars."""
    names = [f"{name}_error", f"{name}_interval"]
    return names if all(one in result.scalars for one in names) else []


def _with_unit(value: Any, unit: str) -> str:
    return brief(value) if unit == "1" or value in (None, []) else f"{brief(value)} {unit}"


def _entries(result: Any) -> Iterator[tuple[str, str, str]]:
    """Names of the parts that have one entry each in lists."""
    held = dict.fromkeys(
        dim for v in result.variables for dim in v.dims if f"{dim}s" in result.attributes
    )
    for dim in held:
        names = result.labels.get(dim, [])
        if len(names) > 1 and dim != "limit":
            yield f"{dim}s", brief(names, 100), ""


def _best(result: Any) -> Iterator[tuple[str, str, str]]:
    """Best point of a sweep: least cost if its scenes have one, else by the first in BETTER."""
    if result.kind != "sweep":
        return
    asked = json.loads(result.scene_text or "{}").get("objective")
    cost = asked.get("minimise") if isinstance(asked, Mapping) else None
    numbers = result.attributes.get("numbers", [])
    name = next((name for name in (cost, *BETTER) if name in numbers), None)
    if name is None:
        return
    found, status = result[name], result["status"].values
    known = np.isin(status, (0, 4))  # ok, unchecked
    worth = np.where(known, BETTER.get(name, -1) * found.values, -np.inf)
    at = np.unravel_index(np.nan_to_num(worth, nan=-np.inf).argmax(), worth.shape)
    if np.isfinite(worth[at]):
        axes = result.attributes["axes"]
        places = at if len(at) == len(axes) else at * len(axes)  # drawn points: one for all axes
        place = (
            f"{axis['key']} {_with_unit(axis['values'][k], result[axis['dim']].unit)}"
            for axis, k in zip(axes, places, strict=True)
        )
        yield f"best {name}", _with_unit(float(found.values[at]), found.unit), ", ".join(place)


# -- limits --------------------------------------------------------------------------------------


def _heading_of_limits(result: Any) -> str:
    if _effects_known(result):
        objective = result.attributes["limits"]["objective"]
        return f"Limits, and the effect of 1 % more of each on {objective}"
    return "Limits"


def _limits(result: Any) -> Iterator[tuple[str, str, str]]:
    """Active limits, if the result contains them."""
    if _effects_known(result):
        yield from _effects(result.attributes["limits"], result["limit_elasticity"].values.tolist())
        return
    excess = result.trust.get("violations")
    if isinstance(excess, Mapping):
        yield from _reached(excess)
    for name in result.scalars:
        if _limited(name):
            yield _against(result, name, f"{_limited(name)}_max")


def _effects(known: Mapping[str, Any], shares: list[float]) -> Iterator[tuple[str, str, str]]:
    rows = list(zip(known["name"], known["value"], known["unit"], shares, strict=True))
    for name, value, unit, share in sorted(rows, key=lambda row: -abs(row[3])):
        if abs(share) >= _NO_EFFECT:
            yield name, _with_unit(value, unit), f"{share:+.3g} %"
    without = [name for name, *_, share in rows if not abs(share) >= _NO_EFFECT]
    if without:
        yield "without effect", "", ", ".join(whole_lists(without, known["name"]))


def _reached(excess: Mapping[str, Any]) -> Iterator[tuple[str, str, str]]:
    numbers = {name: value for name, value in excess.items() if isinstance(value, int | float)}
    for no_share in ("closed", "gait.resting", "limits.resting"):
        numbers.pop(no_share, None)
    if not any(value < 0 for value in numbers.values()):  # earlier versions saved no room
        numbers = {name: value for name, value in numbers.items() if value != 0}
    reached = [name for name, value in numbers.items() if value >= -_REACHED]
    spare = [f"{name} {-value:.2g}" for name, value in numbers.items() if value < -_REACHED]
    if reached:
        yield "reached", ", ".join(reached), ""
    if spare:
        yield "share to spare", ", ".join(spare), ""


def _against(result: Any, limit: str, largest: str) -> tuple[str, str, str]:
    """A limit, with the used share of it if the result has both as numbers."""
    name, value, _ = _row(result, limit)
    most = _size(result.scalars[limit].value)
    used = _size(result.scalars[largest].value) if largest in result.scalars else None
    remark = "" if used is None or not most else f"{largest} is {100 * used / most:.3g} % of it"
    return name, value, remark


# -- trust ---------------------------------------------------------------------------------------


def _share(check: Any) -> float:
    if check.value is None:
        return float("inf")
    if check.limit:
        return abs(check.value) / check.limit
    return 0.0 if check.passed else float("inf")


def _worst(checks: tuple[Any, ...]) -> str:
    if not checks:
        return ""
    worst = max(checks, key=lambda check: (not check.passed, _share(check)))
    which = f"the worst of {len(checks)} checks" if len(checks) > 1 else "the one check"
    name = worst.name if worst.passed else f"{worst.name} (not passed)"
    if worst.value is None or not worst.limit:
        return f"; {which}, {name}, is {brief(worst.value)}, where {worst.limit:.2g} is accepted"
    share = f"{100 * _share(worst):.3g} % of the {worst.limit:.2g} accepted"
    return f"; {which}, {name}, is {worst.value:.2g}, {share}"


def _is_known(value: Any) -> bool:
    return any(map(_is_known, value)) if isinstance(value, list) else value is not None


def _second_route(result: Any) -> str:
    """Result of the second route: its status, and the difference."""
    given = result.trust.get("recheck")
    each = [
        one for one in (given if isinstance(given, list) else [given]) if isinstance(one, Mapping)
    ]
    routes = dict.fromkeys(str(one.get("method") or one.get("route") or "") for one in each)
    errors = [one["error"] for one in each if isinstance(one.get("error"), int | float)]
    found = [f"differs by {max(map(abs, errors)):.2g}"] if errors else []
    if not errors:
        asked = [name for name in result.scalars if name.startswith("recheck_")]
        known = [name for name in asked if _is_known(result.scalars[name].value)]
        found += ["not taken"] if asked and not known else []
        for name in known:
            what = name.removeprefix("recheck_").removesuffix("error").strip("_")
            found.append(f"{what} differs by {brief(result.scalars[name].value)}".strip())
    return ", ".join([*filter(None, routes), *found])
