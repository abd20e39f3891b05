"""Model of a thin film of magnetic fluid in a given travelling field.

Lubrication theory in the field's frame, xi = t - x, in the scales of eq. 25 of Zimmermann et al.
2007. With eq. 28, Q = -F h³ / 3 and F = W h''' + P', P = (mu - 1) H² / (8 pi), conservation h_t +
Q_x = 0 becomes

    h_t = d/dxi (Q - h),

whose steady state is eq. 29: Q - h = C. The state is the volume v = int (h - 1) dxi from xi = 0 on,
at equidistant points. Then v_t = (Q - h) - (Q - h at xi = 0) at every point separately. h = 1 + v'
has the mean 1 to round-off for every v, and no neutral direction remains. Derivatives are central
differences of high order.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from math import factorial
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError
from wormopt.model.model import Model, Output, Signal
from wormopt.model.values import numbers
from wormopt.quantities import parsed, scale
from wormopt.result import Result
from wormopt.systems.film.lubrication import field_slope, symbolic
from wormopt.systems.film.shapes import Wave, grid
from wormopt.tables import Wrong, read_table

ORDERS = tuple(range(4, 15, 2))
_MEAN = 1e-6
# A step from the last sample to the first is a jump if it exceeds the largest other step by this
# factor.
_JUMP = 3.0
# Slopes of a field must sum to 0 within this share of their size.
_CLOSED = 1e-8
# Units of values in files of SI scenes; a pressure is in multiples of P.
_UNITS = {"pressure": "1", "field_squared": "A2 m-2", "field": "A m-1"}


def thin_film(
    slope: ArrayLike | ca.SX, tension: float | ca.SX, *, order: int = 12, p: Sequence[Signal] = ()
) -> Model:
    """Model of a film of mean thickness 1 in a travelling field.

    Parameters
    ----------
    slope : array_like or casadi.SX, shape (points,)
        Derivative of (mu - 1) H² / (8 pi) with respect to xi at equidistant points from 0 on, in
        units of P.
    tension : float or casadi.SX
        Surface tension W, above 0.
    order : int, optional
        Order of the finite differences: even, 4 to 14.
    p : sequence of Signal, optional
        Parameters in the expressions of slope and tension.

    Returns
    -------
    Model
        State ``volume`` (points - 1), 0 for a flat film; outputs ``thickness`` and ``flow`` (Q of
        the film at rest on the ground), both at the points.

    Raises
    ------
    ArgumentError
        If W is not above 0, there are too few points for the order, or the field is not periodic.

    Examples
    --------
    Without a field, ripples exp(i k xi) decay at the rate W k⁴ / 3:

    >>> from wormopt.analysis.steady import Rates
    >>> film = thin_film(np.zeros(32), 0.3)
    >>> rates = Rates(film).steady(np.zeros(31), np.zeros(0)).eigenvalues
    >>> rates[[0, 2, 4]].real.round(4).tolist()
    [-0.1, -1.6, -8.1]
    """
    given: Any = slope if symbolic(slope) else numbers("slope", slope).ravel()
    points = given.numel() if symbolic(given) else given.size
    _check(given, tension, points, order)
    step = 2 * np.pi / points
    state = ca.SX.sym("volume", points - 1)
    volume = ca.vertcat(0, state)
    first, fourth = _weights(order)
    h = 1 + _applied(first, volume) / step
    # differences of differences: round-off grows with 1 / step² only, not with 1 / step⁴
    third = _applied(fourth, _second(_second(volume))) / step**4
    Q = -(h * h * h) / 3 * (tension * third + given)
    speed = Q - h
    return Model(
        "thin film",
        x=[Signal("volume", state, value=0.0)],
        ode=speed[1:] - speed[0],
        p=p,
        outputs=[Output("thickness", h, "length"), Output("flow", Q)],
    )


def _check(slope: Any, tension: Any, points: int, order: int) -> None:
    if order not in ORDERS:
        raise ArgumentError(f"order must be one of {', '.join(map(str, ORDERS))}, not {order!r}")
    if points < 2 * order:
        raise ArgumentError(f"{points} points are too few for order {order}; write {2 * order}")
    if not symbolic(tension) and not (numbers("tension", tension).size == 1 and tension > 0):
        raise ArgumentError(
            f"tension must be above 0, not {tension!r}: without surface tension the fronts of the "
            "film steepen until they break"
        )
    if symbolic(slope):
        return
    if not np.all(np.isfinite(slope)):
        raise ArgumentError("slope must be finite numbers")
    if abs(slope.sum()) > _CLOSED * (np.abs(slope).sum() + 1e-300):
        raise ArgumentError(
            f"the field is not periodic: its slope has the mean {slope.mean():.3g} over a "
            "wavelength, which must be 0"
        )


@lru_cache
def _weights(order: int) -> tuple[np.ndarray, np.ndarray]:
    """Weights of the first derivative, and of the fourth over fourth differences."""
    fourth, rest = np.polydiv(_central(order // 2 + 1, 4), [1.0, -4.0, 6.0, -4.0, 1.0])
    assert np.abs(rest).max() < 1e-10
    return _central(order // 2, 1), fourth


def _central(reach: int, derivative: int) -> np.ndarray:
    """Weights of a central difference with step 1, from Lagrange's polynomials."""
    places = np.arange(-reach, reach + 1)
    weights = []
    for place in places:
        others = places[places != place]
        coefficient = np.poly(others)[::-1][derivative] * factorial(derivative)
        weights.append(coefficient / np.prod((place - others).astype(float)))
    return np.array(weights)


def _applied(weights: np.ndarray, values: ca.SX) -> ca.SX:
    reach = len(weights) // 2
    parts = zip(weights.tolist(), range(-reach, reach + 1), strict=True)
    return sum((weight * _ahead(values, k) for weight, k in parts if weight), ca.SX(0))


def _ahead(values: ca.SX, count: int) -> ca.SX:
    """Values at points ahead, around the period."""
    count %= values.numel()
    return ca.vertcat(values[count:], values[:count])


def _second(values: ca.SX) -> ca.SX:
    return (_ahead(values, 1) - values) - (values - _ahead(values, -1))


def film_volume(thickness: ArrayLike, *, order: int = 12) -> np.ndarray:
    """State (points - 1,) of the Model of `thin_film` with a given thickness (points,)."""
    h = numbers("thickness", thickness).ravel()
    if not (h.size and np.all(np.isfinite(h))):
        raise ArgumentError("the thickness must be finite numbers")
    if abs(h.mean() - 1) > _MEAN:
        raise ArgumentError(f"the mean thickness must be 1, not {h.mean():.8g}")
    factor = _symbol(h.size, order)
    found = np.fft.rfft(h)
    usable = np.abs(factor) > 1e-9  # neither the mean nor a wave of two points per period
    found[usable] /= factor[usable]
    found[~usable] = 0
    volume = np.fft.irfft(found, h.size)
    return volume[1:] - volume[0]


def film_thickness(volume: np.ndarray, *, order: int = 12) -> np.ndarray:
    """Thickness at the points, (points,) or (points, m), from states of the `thin_film` Model.

    `volume`: (points - 1,) or (points - 1, m), a state in each column.
    """
    whole = np.concatenate([np.zeros((1, *volume.shape[1:])), volume])
    weights, _ = _weights(order)
    reach, step = order // 2, 2 * np.pi / len(whole)
    parts = zip(weights.tolist(), range(-reach, reach + 1), strict=True)
    slope = sum((w * np.roll(whole, -k, axis=0) for w, k in parts if w), np.zeros(whole.shape))
    return 1 + slope / step


def _symbol(points: int, order: int) -> np.ndarray:
    """Factor of the first difference on exp(i k xi), k = 0, 1, ..."""
    reach, step = order // 2, 2 * np.pi / points
    turn = np.arange(points // 2 + 1)[:, None] * np.arange(-reach, reach + 1) * step
    return 1j * (np.sin(turn) @ _weights(order)[0]) / step


def slope_on(points: int, samples: ArrayLike) -> np.ndarray:
    """Slope (points,) of the trigonometric polynomial through samples (m,), m ≥ 4, of a period.

    Harmonics that the points do not resolve are left out.
    """
    values = numbers("samples", samples).ravel()
    if values.size < 4:
        raise ArgumentError(f"{values.size} samples are too few; write 4 or more over a wavelength")
    if not np.all(np.isfinite(values)):
        raise ArgumentError("samples must be finite numbers")
    steps = np.abs(np.diff(values, append=values[0]))
    if steps[-1] > _JUMP * steps[:-1].max():
        raise ArgumentError(
            f"the field is not periodic: it jumps by {steps[-1]:.3g} from its last sample to its "
            f"first, and by at most {steps[:-1].max():.3g} between others; write one whole "
            "wavelength without its end"
        )
    harmonics = _harmonics(values, points)
    return np.fft.irfft(1j * np.arange(len(harmonics)) * harmonics * points, points)


def resampled(samples: np.ndarray, points: int) -> np.ndarray:
    """Trigonometric polynomial through samples (m,) of a period, at other points (points,)."""
    return np.fft.irfft(_harmonics(samples, points) * points, points)


def _harmonics(samples: np.ndarray, points: int) -> np.ndarray:
    """Harmonics of that polynomial, without those that the points do not resolve."""
    kept = min((samples.size - 1) // 2, (points - 1) // 2)
    found = np.zeros(points // 2 + 1, dtype=complex)
    found[: kept + 1] = np.fft.rfft(samples)[: kept + 1] / samples.size
    return found


class WaveField:
    """Least field that holds a prescribed wave at tension W, as (mu - 1) H² / (8 pi)."""

    def __init__(self, wave: Wave, tension: float) -> None:
        self.wave, self.tension = wave, tension

    def slope(self, points: int) -> np.ndarray:
        """Slope at equidistant points (points,)."""
        xi, wave = grid(points), self.wave
        return field_slope(wave.height(xi), wave.height(xi, 3), wave.constant, self.tension)

    def values(self, points: int) -> np.ndarray:
        """Values at equidistant points (points,)."""
        wave, tension = self.wave, self.tension
        return wave.peak(tension).value - wave.field_function(grid(points), tension)


class GivenField:
    """A field (mu - 1) H² / (8 pi) by samples (m,) at equidistant phases over a wavelength."""

    def __init__(self, samples: np.ndarray) -> None:
        self.samples = samples

    def slope(self, points: int) -> np.ndarray:
        """Slope at equidistant points (points,)."""
        return slope_on(points, self.samples)

    def values(self, points: int) -> np.ndarray:
        """Values (points,) at equidistant points, of the same trigonometric polynomial."""
        return resampled(self.samples, points)

    def left_out(self, points: int) -> float:
        """Root mean square of the harmonics that the points do not resolve, over that of all."""
        size = np.abs(np.fft.rfft(self.samples))[1:]
        kept = min((len(self.samples) - 1) // 2, (points - 1) // 2)
        whole = float(np.linalg.norm(size))
        return float(np.linalg.norm(size[kept:])) / whole if whole else 0.0


# -- fields in files -------------------------------------------------------------------------------


def read_field(path: Path, variable: str | None, quantity: str, units: str) -> np.ndarray:
    """Read samples (m,) of a field from a table, or a variable of an earlier result.

    `quantity` is "pressure", "field_squared" or "field"; `units` those of the scene.
    """
    if variable is None:
        return _read_table(path, quantity, units)
    values = Result.load(path)[variable].values
    if values.ndim != 1:
        raise ArgumentError(
            f"{variable} has {values.ndim} axes, but a field depends on xi only; write a variable "
            "with one axis"
        )
    return np.asarray(values, dtype=float)


def _read_table(path: Path, quantity: str, units: str) -> np.ndarray:
    """Last column of a table; the first of two columns is the phase."""
    wrong: list[Wrong] = []
    table = read_table(path, wrong, named=False)
    if wrong or table is None:
        raise ArgumentError(f"{path.name}{wrong[0][1]}")
    if table.texts:
        named = ", ".join(sorted(table.texts))
        raise ArgumentError(f"{path.name}: column {named} contains text; write numbers only")
    columns = [np.array(column) for column in table.values.values()]
    if not 1 <= len(columns) <= 2:
        raise ArgumentError(
            f"{path.name} must have one column of values, or two columns xi and values"
        )
    for name, column in zip(table.values, columns, strict=True):
        if not np.isfinite(column).all():
            line = table.lines[int(np.flatnonzero(~np.isfinite(column))[0])]
            raise ArgumentError(f"{path.name} line {line}, column {name}: a number is missing")
    if len(columns) == 2:
        wanted = grid(len(columns[0]))
        if np.abs(columns[0] - wanted).max() > 1e-6 * 2 * np.pi:
            raise ArgumentError(
                f"the phases in {path.name} must be 2 pi k / {len(columns[0])} for k = 0, 1, ...: "
                "one wavelength without its end"
            )
    name = list(table.values)[-1]
    return columns[-1] * _size(table.units.get(name, "1"), quantity, units, path.name)


def _size(unit: str, quantity: str, units: str, file: str) -> float:
    """Factor of values in a unit."""
    if unit == "1":
        return 1.0
    wanted = _UNITS[quantity] if units == "SI" else "1"
    try:
        (size, dimension), (one, needed) = scale(unit), parsed(wanted)
    except ValueError as error:
        raise ArgumentError(f'{file}: "{unit}" {error}; write {wanted}') from None
    if dimension != needed:
        raise ArgumentError(f'{file}: "{unit}" is not a unit of {quantity} here; write {wanted}')
    return float(size / one)
