"""Parameters and friction laws of worm models: one for all, one for each, or over time."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError
from wormopt.model.friction import Law
from wormopt.model.model import TINY, Signal
from wormopt.model.schedule import ParameterPath, Schedule
from wormopt.model.values import numbers, numbers_of

_LEAST: Mapping[str, float] = {
    "mass": TINY,
    **dict.fromkeys(("stiffness", "damping", "drag"), 0.0),
    **dict.fromkeys(("bending_stiffness", "bending_damping", "rod_mass", "inertia"), 0.0),
}


def parameter(name: str, given: ArrayLike, size: int, unit: str) -> Signal:
    """Make a parameter of a model; masses must be positive, stiffness and damping not negative."""
    values, lower = numbers_of(name, given, size), _LEAST.get(name, -math.inf)
    signal = Signal(name, ca.SX.sym(name, size), unit, lower=lower, value=values)
    signal.check(np.array(values))
    return signal


def positive_parameter(name: str, given: float, unit: str) -> Signal:
    """Make a parameter of a model that is one positive number."""
    value = float(numbers(name, given))
    signal = Signal(name, ca.SX.sym(name), unit, lower=TINY, value=value)
    signal.check(np.array([value]))
    return signal


def laws_of_each(law: Law | Sequence[Law], masses: int) -> list[Law]:
    """Return the friction law of each mass, from one law for all or one for each."""
    laws: list[Any] = [law] * masses
    if isinstance(law, Sequence) and not isinstance(law, str):
        laws = [*law]
    if len(laws) != masses:
        raise ArgumentError(f"law has {len(laws)} entries; give one law, or {masses}, one per mass")
    for each in {type(each): each for each in laws}.values():
        if not isinstance(each, Law) or isinstance(each, type):
            raise ArgumentError(
                f"law contains {each!r}, which is not a friction law; write Coulomb(forward, "
                "backward), for example"
            )
    return laws


def varied_parameter(
    name: str, given: ArrayLike | ParameterPath, size: int, unit: str, t: ca.SX, of: str = "links"
) -> tuple[ca.SX, Signal | Schedule]:
    """Expression of a parameter that may vary in time, and its parameter or schedule."""
    if not isinstance(given, ParameterPath):
        signal = parameter(name, given, size, unit)
        return signal.symbol, signal
    if given.size != size:
        raise ArgumentError(f"the path of {name} has {given.size} parameters for {size} {of}")
    return given.schedule(name, t)


def first_numbers(name: str, given: ArrayLike | ParameterPath, size: int) -> np.ndarray:
    """Values (size,) of a parameter at time 0."""
    path = isinstance(given, ParameterPath)
    return np.array(numbers_of(name, given(np.zeros(1))[:, 0] if path else given, size))
