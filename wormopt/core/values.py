"""Values of signals by name, as one column."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

__all__ = ["signal_values"]


def signal_values(
    signals: Sequence[Any], given: Mapping[str, object], what: str, fill: float | None = None
) -> np.ndarray:
    """Stack the values of signals, those given before those the model brings.

    Parameters
    ----------
    signals : sequence of Signal
        What needs a value.
    given : mapping of str to float or array
        Values by name; a number stands for all entries.
    what : str
        What they are called in messages.
    fill : float, optional
        Value of what has none.

    Returns
    -------
    ndarray

    Raises
    ------
    ValueError
        If a name is unknown, a value is missing or not of the signal's size.

    Examples
    --------
    >>> import casadi as ca
    >>> from wormopt.core.model import Signal
    >>> stiffness = Signal("stiffness", ca.SX.sym("c", 2), value=(10.0, 12.0))
    >>> signal_values((stiffness,), {"stiffness": 9.0}, "parameter")
    array([9., 9.])
    """
    unknown = set(given) - {s.name for s in signals}
    if unknown:
        names = [s.name for s in signals]
        raise ValueError(f"no {what} is called {sorted(unknown)}; the model has {names}")
    sizes = [s.size for s in signals]
    stacked, at = np.empty(sum(sizes)), 0
    for signal, size in zip(signals, sizes, strict=True):
        value = given.get(signal.name, fill if signal.value is None else signal.value)
        if value is None:
            raise ValueError(f"{what} {signal.name} has no value; give one")
        array = np.asarray(value, dtype=float).ravel()
        if array.size not in (1, size):
            raise ValueError(f"{what} {signal.name} has {size} entries, not {array.size}")
        stacked[at : at + size] = array
        at += size
    return stacked
