"""Parameters of worm models: one number for all, one for each, or a function of time."""

from __future__ import annotations

import math
from collections.abc import Mapping

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError
from wormopt.model.model import TINY, Signal
from wormopt.model.schedule import ParameterPath, Schedule
from wormopt.model.values import numbers_of

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
