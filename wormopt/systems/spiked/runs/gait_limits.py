"""What binds a designed gait, as a part of its result: derivatives by every limit."""

from __future__ import annotations

import re
import time
from dataclasses import replace
from typing import Any

import numpy as np

from wormopt.quantities import Scalar, Variable, unit_of, unit_ratio
from wormopt.result import Result
from wormopt.systems.spiked.design.design import Design
from wormopt.systems.spiked.design.sensitivity import Sensitivity, scaling_error, sensitivities
from wormopt.systems.spiked.scenes.gait_design import GaitDesignScene
from wormopt.systems.spiked.scenes.gait_search import in_scene

# Programs with more unknowns take seconds; they are asked only if the picture is wanted.
_MOST_UNKNOWNS = 3000


def add_limits(result: Result, found: Design, table: GaitDesignScene) -> Result:
    """Add what every limit is worth (scalars ``sensitivity.*``), where that is known.

    Also adds the data of the picture ``limits``; the trust report says how, or why not.
    """
    reason = _reason_against(found, "limits" in table.want)
    if reason:
        return replace(result, trust={**result.trust, "sensitivity": f"unknown: {reason}"})
    clock = time.perf_counter()
    known = sensitivities(found)
    timings = {**result.timings_s, "sensitivity": time.perf_counter() - clock}
    elasticity = np.array([s.elasticity for s in known])
    return replace(
        result,
        scalars={**result.scalars, **_scalars(known, found, table.units)},
        variables=(
            *result.variables,
            Variable(
                "limit_elasticity",
                "1",
                ("limit",),
                elasticity,
                "per cent of the objective per per cent of the limit",
            ),
        ),
        attributes={**result.attributes, "limits": _names(known, found, table.units)},
        trust={**result.trust, "sensitivity": _trust(known, found)},
        timings_s=timings,
    )


def _reason_against(found: Design, wanted: bool) -> str:
    if found.trial is None:
        return "a smooth cost is found by another solver, whose multipliers are not kept"
    if found.ended == "interrupted":
        return "the design was interrupted"
    if len(found.trial.point.x) > _MOST_UNKNOWNS and not wanted:
        return 'the program is large; ask for the picture "limits" in want'
    return ""


def _scalars(known: tuple[Sensitivity, ...], found: Design, units: str) -> dict[str, Scalar]:
    """One for each key; a list where the key has one number per link or mass."""
    of = found.task.objective.quantity
    values: dict[str, Any] = {}
    named: dict[str, str] = {}
    for s in known:
        name = "sensitivity." + re.sub(r"\[\d+\]", "", s.name.partition(".")[2])
        named[name] = unit_ratio(of, s.quantity, units)
        if "[" in s.name:
            values.setdefault(name, []).append(s.derivative)
        else:
            values[name] = s.derivative
    return {name: Scalar(value, named[name]) for name, value in values.items()}


def _names(known: tuple[Sensitivity, ...], found: Design, units: str) -> dict[str, Any]:
    return {
        "objective": found.task.objective.minimise or "speed",
        "name": [in_scene(s.name) for s in known],
        "value": [s.value for s in known],
        "unit": [unit_of(s.quantity, units) for s in known],
        "one_sided": [s.one_sided for s in known],
    }


def _trust(known: tuple[Sensitivity, ...], found: Design) -> dict[str, Any]:
    return {
        "method": "multipliers of the program with each limit moved; the order of rest is kept",
        "one_sided": [in_scene(s.name) for s in known if s.one_sided],
        "scaling_error": scaling_error(known, found.task.objective),
    }
