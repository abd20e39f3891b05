"""Relative degree of a Model by Lie derivatives, nonlinear and in exact arithmetic."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from wormopt.model.explicit import Explicit
from wormopt.model.model import Model
from wormopt.model.values import signal_values
from wormopt.numerics.identically import identically_zero

Values = Mapping[str, ArrayLike]


def relative_degree(
    model: Model, *, output: str | Sequence[str], p: Values | None = None, v_reg: float = 1 / 40
) -> tuple[float, ...]:
    """Relative degree of a model's outputs, nonlinear and without any threshold.

    It is the order of the first time derivative (Lie derivative along the ode) of an output in
    which an input appears, in general: at special states the input's factor may vanish.

    Parameters
    ----------
    model : Model
        What moves.
    output : str or sequence of str
        Names of outputs.
    p : mapping of str to array_like, optional
        Parameters by name, where they are not the model's own. They count as the exact numbers
        that doubles are: 0.1 + 0.2 is not 0.3.
    v_reg : float, optional
        Width of the smooth law, positive.

    Returns
    -------
    tuple of int or inf
        For each scalar output; inf where no input ever reaches it.

    Raises
    ------
    ArgumentError
        If names or sizes do not fit the model, or it has algebraic variables.
    ZeroDivisionError
        If the model divides by zero for these parameters.
    UnknownNameError
        If the model has no such output.

    Examples
    --------
    Actuators between masses move the centre of mass only by way of friction or unequal drag:

    >>> from wormopt.systems.chain.build import chain
    >>> worm = chain(1, mass=1.0, stiffness=10.0, damping=5.0, rest_length=2.0, drag=0.1)
    >>> relative_degree(worm, output=["length", "center_of_mass"])
    (2, inf)
    >>> relative_degree(worm, output="center_of_mass", p={"drag": [0.1, 0.2]})
    (3,)
    """
    explicit = Explicit(model, output)
    symbols = explicit.symbols
    known = ca.vertcat(symbols["p"], symbols["v_reg"])
    numbers = np.append(signal_values(model.p, p, "parameter"), v_reg)
    everything = ca.vertcat(known, *(symbols[key] for key in "txus"))
    values = {i: float(number) for i, number in enumerate(numbers)}

    def reached(expression: ca.SX) -> bool:
        factors = ca.jacobian(expression, symbols["u"])
        return factors.nnz() > 0 and not np.all(identically_zero(factors, everything, values))

    return tuple(
        _lie_degree(explicit, reached, explicit.observed[i])
        for i in range(explicit.observed.numel())
    )


def _lie_degree(explicit: Explicit, reached: Callable[[ca.SX], bool], y: ca.SX) -> float:
    x, t, n = explicit.symbols["x"], explicit.symbols["t"], len(explicit.names["states"])
    if not _connected(explicit, y):
        return math.inf
    for degree in range(n + 1):
        if reached(y):
            return degree
        rate = ca.jtimes(y, x, explicit.rates) + ca.jacobian(y, t)
        y = ca.cse(rate)
    return math.inf


def _connected(explicit: Explicit, y: ca.SX) -> bool:
    """Whether some chain of dependent states leads from an input to y."""
    x, u = explicit.symbols["x"], explicit.symbols["u"]
    if ca.depends_on(y, u):
        return True
    feeds = _pattern(explicit.rates, x)
    driven = _pattern(explicit.rates, u) @ np.ones(u.numel(), dtype=bool)
    for _ in range(x.numel()):
        driven = driven | (feeds @ driven)
    return bool(np.any(_pattern(y, x) @ driven))


def _pattern(expression: ca.SX, by: ca.SX) -> np.ndarray:
    sparsity = ca.jacobian_sparsity(expression, by)
    pattern = np.zeros(sparsity.shape, dtype=bool)
    pattern[sparsity.get_triplet()] = True
    return pattern
