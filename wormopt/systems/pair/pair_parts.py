"""What all forms of the magneto-elastic pair share: its parameters, field and ground."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError
from wormopt.model.friction import Law
from wormopt.model.lift import lift
from wormopt.model.model import TINY, Contact, Signal
from wormopt.model.values import numbers


@dataclass(frozen=True, eq=False)
class PairParts:
    """What all forms of the pair share."""

    t: ca.SX  # time
    mass: ca.SX
    stiffness: ca.SX
    push: ca.SX
    frequency: ca.SX
    field: ca.SX  # G(t), an expression or the symbol of an input
    harmonics: ca.SX  # coefficients of its cosines, empty for an input
    inputs: tuple[Signal, ...]
    parameters: tuple[Signal, ...]
    laws: tuple[Law, ...]  # friction of both masses, with parameters for numbers
    forces: ca.SX  # (2, 1) friction forces

    @property
    def natural_frequency(self) -> ca.SX:
        """Frequency of the free masses against each other, the square root of 2 in (17)."""
        return ca.sqrt(2 * self.stiffness / self.mass)

    def contacts(self, velocities: ca.SX, nominal_force: float) -> list[Contact]:
        """Put both masses, of velocities (2, 1), on the ground.

        `nominal_force`: usual friction.
        """
        return [
            Contact(f"mass {i + 1}", velocities[i], self.forces[i], law, nominal_force)
            for i, law in enumerate(self.laws)
        ]


def pair_parts(
    *,
    law: Law | Sequence[Law],
    mass: float,
    stiffness: float,
    push: float,
    frequency: float,
    cosines: Sequence[float] | None,
) -> PairParts:
    """Make the symbols that all forms of the pair share, from arguments of `magnetic_pair`.

    Raises ArgumentError as `magnetic_pair` does.
    """
    t = ca.SX.sym("t")
    positive = [
        _positive("mass", mass, "mass"),
        _positive("stiffness", stiffness, "stiffness"),
        _positive("push", push, "force"),
        _positive("frequency", frequency, "angular_frequency"),
    ]
    m, c, p, nu = (signal.symbol for signal in positive)
    if cosines is None:
        field = ca.SX.sym("field")
        inputs, shape = (Signal("field", field, value=0.0),), ()
        harmonics = ca.SX(0, 1)
    else:
        inputs, shape = (), (_harmonics(cosines),)
        harmonics = shape[0].symbol
        orders = ca.DM(np.arange(harmonics.numel()))
        field = ca.dot(harmonics, ca.cos(nu * t * orders))
    laws, friction = lift(_laws(law))
    ground, known = ca.SX.sym("friction", 2), (*positive, *shape, *friction)
    return PairParts(t, m, c, p, nu, field, harmonics, inputs, known, laws, ground)


def _positive(name: str, value: float, unit: str) -> Signal:
    number = float(numbers(name, value))
    signal = Signal(name, ca.SX.sym(name), unit, lower=TINY, value=number)
    signal.check(np.array([number]))
    return signal


def _harmonics(cosines: Sequence[float]) -> Signal:
    values = numbers("cosines", cosines).ravel()
    if not (values.size and np.all(np.isfinite(values))):
        raise ArgumentError("cosines must be finite numbers, the mean first")
    return Signal("cosines", ca.SX.sym("cosines", values.size), value=tuple(values.tolist()))


def _laws(law: Any) -> list[Law]:
    laws = list(law) if isinstance(law, list | tuple) else [law, law]
    if len(laws) != 2 or not all(isinstance(each, Law) for each in laws):
        raise ArgumentError(f"law must be one friction law or two, not {law!r}")
    return laws
