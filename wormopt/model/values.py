"""Values of signals by name, as one column."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from wormopt.errors import ArgumentError, UnknownNameError


def numbers(name: str, given: object) -> np.ndarray:
    """Convert to an array of numbers; raises ArgumentError if that is impossible.

    Masked values and missing values of pandas become NaN; spans of time become seconds.
    """
    try:
        if not _has_text(given):
            return np.asarray(_unmasked(given), dtype=float)
    except (TypeError, ValueError, OverflowError, RuntimeError):  # the last is CasADi's
        pass
    raise ArgumentError(f"{name} must be a number or a list of numbers, not {given!r:.60}")


def _has_text(given: Any) -> bool:
    """Whether it contains texts, which NumPy would read as numbers."""
    if isinstance(given, list | tuple):
        return any(map(_has_text, given))
    if hasattr(given, "to_numpy"):  # of pandas
        given = given.to_numpy()
    if getattr(getattr(given, "dtype", None), "kind", "") == "O":
        return any(map(_has_text, np.ravel(given)))
    return isinstance(given, str | bytes) or getattr(given, "dtype", np.dtype(float)).kind in "SU"


def column(name: str, given: object, size: int) -> np.ndarray:
    """Numbers of a column, one or `size`; a matrix of one column is accepted, a row is not."""
    array = numbers(name, given)
    if array.shape not in ((), (1,), (size,), (1, 1), (size, 1)):
        entries, given = "entry" if size == 1 else "entries", array.size
        shown = f"{given}" if array.ndim < 2 else f"the shape {array.shape}"
        wanted = "one number" if size == 1 else f"one number or a list of {size}"
        raise ArgumentError(f"{name} has {size} {entries}, not {shown}; write {wanted}")
    return array.ravel()


def _unmasked(given: Any) -> Any:
    if isinstance(given, np.ma.MaskedArray):
        return np.ma.filled(given.astype(float), np.nan)
    if isinstance(given, list | tuple):
        masked = any(isinstance(each, np.ma.MaskedArray) for each in given)
        return [_unmasked(each) for each in given] if masked else given
    kind = getattr(getattr(given, "dtype", None), "kind", "")
    if kind == "m":
        return np.asarray(given) / np.timedelta64(1, "s")
    if kind == "M":
        raise TypeError("a date")
    if hasattr(given, "to_numpy") and hasattr(given, "isna"):  # of pandas
        return given.to_numpy(dtype=float, na_value=np.nan)
    return given


def numbers_of(name: str, given: object, size: int) -> tuple[float, ...]:
    """`size` finite numbers, from one or from all of them; else ArgumentError."""
    values = numbers(name, given)
    if values.shape not in ((), (size,)):
        raise ArgumentError(f"{name} must be one number or {size}, not of the shape {values.shape}")
    if not np.all(np.isfinite(values)):
        raise ArgumentError(f"{name} must be finite")
    return tuple(np.broadcast_to(values, (size,)).tolist())


def nominal_of(signals: Sequence[Any]) -> np.ndarray:
    """Nominal sizes of signals, entry by entry."""
    return np.concatenate([np.zeros(0), *(np.full(s.size, s.nominal) for s in signals)])


def check_names(given: object, known: Sequence[str], what: str) -> None:
    """Refuse anything but a mapping from known names; `what` they name, such as "state"."""
    if not isinstance(given, Mapping):
        example = f"{{{known[0] if known else 'name'!r}: ...}}"
        raise ArgumentError(f"write each {what} by name, {example}, not {type(given).__name__}")
    unknown = [name for name in given if name not in known]
    if unknown:
        raise UnknownNameError("the model", what, unknown, known)


def by_name(signals: Sequence[Any], values: np.ndarray) -> dict[str, np.ndarray]:
    """Take a column apart; the inverse of `signal_values`."""
    ends = np.cumsum([s.size for s in signals], dtype=int).tolist()
    return {s.name: values[end - s.size : end] for s, end in zip(signals, ends, strict=True)}


def signal_values(
    signals: Sequence[Any],
    given: Mapping[str, object] | None,
    what: str,
    fill: float | None = None,
) -> np.ndarray:
    """Stack the values of signals: the given ones, else those of the model, else `fill`.

    One number applies to all entries.
    """
    given = {} if given is None else given
    check_names(given, [s.name for s in signals], what)
    sizes = [s.size for s in signals]
    stacked, at = np.empty(sum(sizes)), 0
    for signal, size in zip(signals, sizes, strict=True):
        value = given.get(signal.name, fill if signal.value is None else signal.value)
        if value is None:
            raise ArgumentError(f"{what} {signal.name} has no value; write one")
        array = column(f"{what} {signal.name}", value, size)
        signal.check(array)
        stacked[at : at + size] = array
        at += size
    return stacked
