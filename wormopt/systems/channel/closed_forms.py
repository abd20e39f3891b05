"""A magnetisable body in a channel beside a row of coils, with assumed segment shapes.

Source: eqs 32-36 of K. Zimmermann, I. Zeidis, J. Steigenberger, C. Behn, V. Böhm, J. Popp,
E. Kolev, V. A. Naletova, "Worm-like Locomotion Systems (WLLS): Theory, Control and Prototypes",
in H. Zhang (ed.), "Climbing and Walking Robots: Towards New Applications", 2007, from page 429.

A segment is the part of the body between two neighbouring coils, a distance L apart. Its centre
line goes from one wall to the other, from the height d_w/2 to d - d_w/2, where d and d_w are the
diameters of channel and body. Three shapes are assumed: a sine (eq. 33), with its shift; a cubic,
the beam with small deflection (eq. 34); a straight line (eq. 35), with the half of d_w that the
printed equation lacks.

Functions take numbers, arrays or CasADi expressions, and check nothing; `ChannelWorm` checks
numbers. Units are SI, or any others that are consistent.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields
from functools import lru_cache
from numbers import Real
from typing import Any, Literal, get_args

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError, UnknownNameError
from wormopt.result import left_out
from wormopt.systems.channel.samples import SAMPLES, STEEPEST

Shape = Literal["sine", "beam", "line"]
CountRule = Literal["nearest", "floor"]
SHAPES: tuple[Shape, ...] = get_args(Shape)
DIRECTION = -1
"""The body moves against the travel of the field."""

# Steps of the arithmetic-geometric mean and Gauss points that reach round-off up to STEEPEST.
_STEPS = 7
_POINTS = 128
_SMALLEST, _LARGEST = 1e-30, 1e30


def center_line(shape: Shape, x: Any, pitch: Any, channel: Any, body: Any) -> Any:
    """Return the height of a segment's centre line above its first wall.

    The shapes are sine, beam and line (eqs 33-35 of Zimmermann et al. 2007). `x` runs along the
    channel from 0 to `pitch`, the distance L of neighbouring coils; the height goes from body / 2
    to channel - body / 2, with diameters d_w and d. Numbers, arrays or casadi.SX.
    """
    rise, share = channel - body, x / pitch
    _check_shape(shape)
    if shape == "sine":
        # ca.cos would turn arrays into matrices of CasADi
        numeric = isinstance(share, np.ndarray | Real)
        cosine: Any = (np if numeric else ca).cos(np.pi * share)
        return body / 2 + rise * (1 - cosine) / 2
    if shape == "beam":
        return body / 2 + rise * share * share * (3 - 2 * share)
    return body / 2 + rise * share


def arc_length(shape: Shape, pitch: Any, rise: Any) -> Any:
    """Return the length l_s of a segment's centre line of `rise` d - d_w over `pitch` L.

    Sine: complete elliptic integral of the second kind by the AGM (DLMF 19.8); beam: L int_0^1
    sqrt(1 + (3 rise/(2 L))² (1 - t²)²) dt, 128 Gauss points; exact to round-off up to rise = 10 L.
    """
    _check_shape(shape)
    slope = rise / pitch
    if shape == "sine":
        return pitch * _ellipse((1 + (np.pi * slope / 2) ** 2) ** 0.5)
    if shape == "beam":
        steep = 1.5 * slope
        return pitch * sum(
            weight * (1 + steep * steep * bend) ** 0.5 for bend, weight in _gauss_points()
        )
    return pitch * (1 + slope * slope) ** 0.5


def _check_shape(shape: str) -> None:
    if shape not in SHAPES:
        raise ArgumentError(f'no assumed shape "{shape}"; there are {", ".join(SHAPES)}')


def segment_count(length: Any, segment: Any, rule: CountRule = "nearest") -> Any:
    """Return the number k_s of segments of arc length l_s in a body of length l_w.

    "nearest": integer nearest to l_w / l_s, the larger of two equally near ones, which the
    published velocities need; "floor": integral part, as eq. 32 is printed. An int for two numbers.
    """
    ratio = length / segment + (0.5 if rule == "nearest" else 0.0)
    if isinstance(ratio, Real):
        return int(np.floor(float(ratio)))
    return np.floor(ratio) if isinstance(ratio, np.ndarray) else ca.floor(ratio)


def velocity_per_frequency(pitch: Any, segment: Any, count: Any) -> Any:
    """Return the magnitude of the velocity for one coil switch per second.

    k_s (l_s - L) / (k_s + 3), eq. 32 of Zimmermann et al. 2007, in units of `pitch` L, the distance
    of neighbouring coils; `segment` is l_s, `count` k_s. The velocity is this times the switches
    per second; its direction is `DIRECTION`.
    """
    return count * (segment - pitch) / (count + 3)


@dataclass(frozen=True)
class ChannelWorm:
    """A body in a channel, in SI units.

    Source: eqs 32-36 of Zimmermann et al. 2007 (WLLS), see the module.

    Parameters
    ----------
    pitch : float or casadi.SX
        Distance L of neighbouring coils, m.
    channel, body : float or casadi.SX
        Diameters d and d_w, m.
    length : float or casadi.SX
        Length l_w of the body, m.
    youngs_modulus : float or casadi.SX, optional
        Young's modulus in Pa; without it forces and energies are unknown.
    rule : {"nearest", "floor"}, optional
        Rounding of the number of segments.

    Raises
    ------
    ArgumentError
        If a value is not above 0, the body does not fit in the channel or is shorter than the
        pitch, or the rise is more than ten pitches.

    Examples
    --------
    >>> worm = ChannelWorm.of("sample-1")
    >>> [round(1e3 * worm.velocity_per_frequency(shape), 2) for shape in SHAPES]
    [1.46, 1.43, 1.26]
    >>> worm.count("beam"), ChannelWorm.of("capsule").count("line")
    (4, 6)
    """

    pitch: Any
    channel: Any
    body: Any
    length: Any
    youngs_modulus: Any = None
    rule: CountRule = "nearest"

    def __post_init__(self) -> None:
        if self.rule not in get_args(CountRule):
            raise ArgumentError(f"rule must be 'nearest' or 'floor', not {self.rule!r}")
        for field in fields(self)[:5]:
            _check(field.name, getattr(self, field.name))
        if _surely(self.body, self.channel):
            raise ArgumentError(
                f"a body of diameter {self.body:g} does not fit in a channel of "
                f"{self.channel:g}; body must be less than channel"
            )
        if _surely(self.pitch, self.length) and self.pitch != self.length:
            raise ArgumentError(
                f"a body of length {self.length:g} is shorter than the pitch {self.pitch:g}; "
                "length must be at least the pitch"
            )
        if _surely(self.rise, STEEPEST * self.pitch):
            raise ArgumentError(
                f"a segment with a rise of {self.rise:g} within a pitch of {self.pitch:g} is too "
                f"steep; channel - body must be less than {STEEPEST:g} times the pitch"
            )

    @classmethod
    def of(cls, name: str, rule: CountRule = "nearest") -> ChannelWorm:
        """Return a body of Zimmermann et al. 2007.

        Parameters
        ----------
        name : {"sample-1", "sample-2", "capsule"}
            Name of the body.
        rule : {"nearest", "floor"}, optional
            Rounding of the number of segments.

        Raises
        ------
        UnknownNameError
            If there is no body of that name.

        Examples
        --------
        >>> ChannelWorm.of("capsule").body
        0.004
        """
        if name not in SAMPLES:
            raise UnknownNameError("Zimmermann et al. 2007", "body", [name], SAMPLES)
        s = SAMPLES[name]
        return cls(s.pitch, s.channel, s.body, s.length, s.youngs_modulus, rule)

    @property
    def rise(self) -> Any:
        """Height d - d_w that a segment's centre line climbs, in m."""
        return self.channel - self.body

    @property
    def bending_stiffness(self) -> Any:
        """E I in N m² of a solid round body, I = pi d_w⁴ / 64; None without a modulus."""
        if self.youngs_modulus is None:
            return None
        return self.youngs_modulus * np.pi / 64 * self.body**4

    def center_line(self, shape: Shape, x: Any) -> Any:
        """Return the height of the centre line above the wall where the segment begins, in m.

        Parameters
        ----------
        shape : {"sine", "beam", "line"}
            Assumed shape.
        x : float, ndarray or casadi.SX
            Position in the segment, 0 to `pitch`, in m.
        """
        return center_line(shape, x, self.pitch, self.channel, self.body)

    def arc_length(self, shape: Shape) -> Any:
        """Return the length l_s of a segment's centre line, in m.

        Parameters
        ----------
        shape : {"sine", "beam", "line"}
            Assumed shape.
        """
        return arc_length(shape, self.pitch, self.rise)

    def count(self, shape: Shape) -> Any:
        """Return the number k_s of segments, by `rule`.

        Parameters
        ----------
        shape : {"sine", "beam", "line"}
            Assumed shape.
        """
        return segment_count(self.length, self.arc_length(shape), self.rule)

    def missing_length(self, shape: Shape) -> Any:
        """Return k_s l_s - l_w, in m: positive if the segments need more body than there is.

        Parameters
        ----------
        shape : {"sine", "beam", "line"}
            Assumed shape.

        Examples
        --------
        >>> round(1e3 * ChannelWorm.of("sample-1").missing_length("sine"), 2)
        2.2
        """
        return self.count(shape) * self.arc_length(shape) - self.length

    def velocity_per_frequency(self, shape: Shape) -> Any:
        """Return the magnitude of the velocity for one coil switch per second, in m.

        Parameters
        ----------
        shape : {"sine", "beam", "line"}
            Assumed shape.
        """
        return velocity_per_frequency(self.pitch, self.arc_length(shape), self.count(shape))


def _check(name: str, value: Any) -> None:
    """Refuse values that are neither usable numbers nor expressions; the modulus may be None."""
    if isinstance(value, ca.SX | ca.MX) or (value is None and name == "youngs_modulus"):
        return
    fits = isinstance(value, Real) and not isinstance(value, bool)
    if not (fits and _SMALLEST <= float(value) <= _LARGEST):  # pyright: ignore
        raise ArgumentError(f"{name} must be a number above 0, not {value!r}")


def _surely(large: Any, small: Any) -> bool:
    """Return whether two numbers are in this order or equal; False for expressions."""
    return isinstance(large, Real) and isinstance(small, Real) and float(large) >= float(small)


def _ellipse(longest: Any) -> Any:
    """Return 2 E / pi, the mean radius of an ellipse's quarter with half axes 1 and `longest`."""
    a, b = longest, 1.0 + 0.0 * longest
    squares = (a * a + b * b) / 2
    for step in range(_STEPS):
        half = (a - b) / 2
        a, b = a - half, (a * b) ** 0.5
        squares = squares - 2.0**step * half * half
    return squares / a


@lru_cache(maxsize=1)
def _gauss_points() -> tuple[tuple[float, float], ...]:
    """Return (1 - t²)² at the Gauss points t in [0, 1], and their weights."""
    points, weights = np.polynomial.legendre.leggauss(_POINTS)
    bends = (1 - ((points + 1) / 2) ** 2) ** 2
    return tuple(zip(bends.tolist(), (weights / 2).tolist(), strict=True))


def warnings_of_count(name: str, worm: ChannelWorm, count: int, length: float) -> Iterator[str]:
    """Yield warnings if `count` segments k_s of `length` l_s, in m, do not fit the body."""
    if not count:
        yield (
            f"{name}: the body is shorter than one segment of {1e3 * length:.4g} mm; by eq. 32 of "
            "Zimmermann et al. it does not move"
        )
    elif count * length > worm.length:
        yield (
            f"{name}: {count} segments of {1e3 * length:.4g} mm exceed the body of "
            f'{1e3 * worm.length:.4g} mm; worm.count = "floor" counts whole segments only'
        )


def warnings_of_susceptibility(value: float, label: str = "") -> Iterator[str]:
    """Warn if the body changes the field; across a rod it does by 1 / (1 + χ / 2)."""
    if value > 1:
        yield left_out(
            value / 2,
            f"{label}a susceptibility of {value:g} changes the field in and near the body, but the "
            "pull is computed with the field without the body",
        )
