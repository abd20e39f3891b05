"""Values in friction and control laws turned into parameters of a model."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from numbers import Real
from typing import Any, TypeVar

import casadi as ca

from wormopt.model.given import fields_of
from wormopt.model.model import TINY, Signal

T = TypeVar("T")

# Quantity of each number of a friction law, by the name of its field.
QUANTITIES = {
    "forward": "force",
    "backward": "force",
    "stick_forward": "force",
    "stick_backward": "force",
    "scale": "force",
    "v_stribeck": "speed",
    "drag": "drag",
}
# Of friction and control laws; other fields may be any number.
_LEAST = {
    **dict.fromkeys(("forward", "backward", "stick_forward", "stick_backward", "drag"), 0.0),
    **dict.fromkeys(("scale", "v_stribeck", "growth", "dwell", "start", "end", "time"), TINY),
    "decay": 0.0,
    "exponent": 1.0,
}


def lift(
    laws: Sequence[T], prefix: str = "friction", units: Mapping[str, str] = QUANTITIES
) -> tuple[tuple[T, ...], tuple[Signal, ...]]:
    """Replace every number in the fields of laws by a symbol: one compiled model serves all.

    Returns the laws with symbols, and parameters ``<prefix>_<field>`` with one scalar per law
    that has a number there, in order. Fields that are None or symbols stay.
    """
    own = [_numbers(law) for law in laws]
    numbers: dict[str, list[float]] = {}
    for each in own:
        for name, value in each.items():
            numbers.setdefault(name, []).append(value)
    symbols = {name: ca.SX.sym(f"{prefix}_{name}", len(v)) for name, v in numbers.items()}
    left = {name: iter(ca.vertsplit(symbol)) for name, symbol in symbols.items()}
    lifted = [
        _replaced(law, {name: next(left[name]) for name in each})
        for law, each in zip(laws, own, strict=True)
    ]
    parameters = [
        Signal(
            f"{prefix}_{name}",
            symbol,
            units.get(name, "1"),
            lower=_LEAST.get(name, -math.inf),
            value=tuple(numbers[name]),
        )
        for name, symbol in symbols.items()
    ]
    return tuple(lifted), tuple(parameters)


def _numbers(law: object) -> dict[str, float]:
    values = fields_of(law).items()
    return {name: float(value) for name, value in values if isinstance(value, Real)}


def _replaced(law: Any, symbols: dict[str, ca.SX]) -> Any:
    return replace(law, **symbols) if symbols else law
