"""Values of signals by name, as one column."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from wormopt.errors import ArgumentError, UnknownNameError

__all__ = ["by_name", "check_names", "numbers", "signal_values"]


def numbers(name: str, given: object) -> np.ndarray:
    """Array of numbers from whatever a caller wrote.

    Parameters
    ----------
    name : str
        What it is, for the message.
    given : array_like
        A number, a list, an array.

    Returns
    -------
    ndarray

    Raises
    ------
    ArgumentError
        If it is no number and no array of numbers.

    Examples
    --------
    >>> numbers("mass", [1, 2])
    array([1., 2.])
    """
    try:
        return np.asarray(given, dtype=float)
    except (TypeError, ValueError, RuntimeError):  # the last is CasADi's, of symbols
        raise ArgumentError(
            f"{name} must be a number or a list of numbers, not {given!r}"
        ) from None


def check_names(given: object, known: Sequence[str], what: str) -> None:
    """Refuse what is no mapping from names that are known.

    Parameters
    ----------
    given : object
        From a caller.
    known : sequence of str
        The names there are.
    what : str
        What they are names of, "state" say.

    Raises
    ------
    ArgumentError
        If it is no mapping.
    UnknownNameError
        If it has other names.

    Examples
    --------
    >>> check_names({"position": 1.0}, ["position", "velocity"], "state")
    """
    if not isinstance(given, Mapping):
        example = f"{{{known[0] if known else 'name'!r}: ...}}"
        raise ArgumentError(f"write each {what} by its name, {example}, not {type(given).__name__}")
    unknown = [name for name in given if name not in known]
    if unknown:
        raise UnknownNameError("the model", what, unknown, known)


def by_name(signals: Sequence[Any], values: np.ndarray) -> dict[str, np.ndarray]:
    """Take a column apart; the inverse of `signal_values`.

    Parameters
    ----------
    signals : sequence of Signal
        What the column holds, in order.
    values : ndarray
        The column.

    Returns
    -------
    dict of str to ndarray

    Examples
    --------
    >>> import casadi as ca
    >>> from wormopt.model.model import Signal
    >>> signals = [Signal("x", ca.SX.sym("x", 2)), Signal("v", ca.SX.sym("v"))]
    >>> by_name(signals, np.array([1.0, 2.0, 3.0]))
    {'x': array([1., 2.]), 'v': array([3.])}
    """
    ends = np.cumsum([s.size for s in signals], dtype=int).tolist()
    return {s.name: values[end - s.size : end] for s, end in zip(signals, ends, strict=True)}


def signal_values(
    signals: Sequence[Any],
    given: Mapping[str, object] | None,
    what: str,
    fill: float | None = None,
) -> np.ndarray:
    """Stack the values of signals, those given before those the model brings.

    Parameters
    ----------
    signals : sequence of Signal
        What needs a value.
    given : mapping of str to float or array, optional
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
    ArgumentError
        If a name is unknown, a value is missing, no number, not of the signal's size or beyond its
        bounds.

    Examples
    --------
    >>> import casadi as ca
    >>> from wormopt.model.model import Signal
    >>> stiffness = Signal("stiffness", ca.SX.sym("c", 2), value=(10.0, 12.0))
    >>> signal_values((stiffness,), {"stiffness": 9.0}, "parameter")
    array([9., 9.])
    """
    given = {} if given is None else given
    check_names(given, [s.name for s in signals], what)
    sizes = [s.size for s in signals]
    stacked, at = np.empty(sum(sizes)), 0
    for signal, size in zip(signals, sizes, strict=True):
        value = given.get(signal.name, fill if signal.value is None else signal.value)
        if value is None:
            raise ArgumentError(f"{what} {signal.name} has no value; give one")
        array = numbers(f"{what} {signal.name}", value).ravel()
        if array.size not in (1, size):
            raise ArgumentError(f"{what} {signal.name} has {size} entries, not {array.size}")
        signal.check(array)
        stacked[at : at + size] = array
        at += size
    return stacked
