"""Serpenoid waves: the speed of a long worm with a bending wave that travels backward.

The tangent of an infinite body is at the angle psi = alpha sin(k (s + c t)) to its direction of
motion. Its material runs along a fixed wave at speed c and, with the wave, recoils at V - vc, where
vc = c J0(alpha). Speeds are relative to c; the wave speed in space is vc = J0(alpha).

Source: S. Hirose, Biologically Inspired Robots: Snake-Like Locomotors and Manipulators (1993).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq, minimize_scalar
from scipy.special import j0, jn_zeros

from wormopt.errors import ArgumentError
from wormopt.numerics.collocation import Collocation
from wormopt.systems.planar.shape import chain_shape
from wormopt.systems.planar.swimming.swimmer import Swim, Swimmer, swim

Ground = Literal["viscous", "elliptic", "unit"]
"""Drag proportional to velocity; dry friction by an ellipse; by the direction of motion alone."""

STEEPEST = float(jn_zeros(0, 1)[0])
"""Amplitude at which the body does not advance along its wave: J0 = 0."""
# Panels down to a remainder of round-off, and points on each.
_PANELS, _DEGREE = 56, 16


def serpenoid_speed(alpha: float, ratio: float, ground: Ground = "viscous") -> float:
    """Return the speed of an infinite serpenoid body relative to that of its material along it.

    Theory: docs/theory-planar.md, section 6.

    Parameters
    ----------
    alpha : float
        Amplitude of the tangent angle in rad, above 0 and below the first zero of J0, 2.4048.
    ratio : float
        Resistance across the body over that along it: r = c_n / c_t, or rho = F_n / F_t.
    ground : {"viscous", "elliptic", "unit"}, optional
        Viscous ground, with the speed in closed form; dry ground by the ellipse of maximal
        dissipation, from its minimum; dry ground by the unit law, from the balance of forces.

    Returns
    -------
    float
        V / c; divide by J0(alpha) for the speed over that of the wave.

    Raises
    ------
    ArgumentError
        If the amplitude or the ratio is out of range, or the ground unknown.

    Examples
    --------
    >>> from scipy.special import j0
    >>> float(round(serpenoid_speed(1.0, 2.0) / j0(1.0), 12))
    0.279567250102
    >>> float(round(serpenoid_speed(1.0, 2.0, "elliptic") / j0(1.0), 12))
    0.486936986396
    """
    if not 0 < alpha < STEEPEST:
        raise ArgumentError(f"alpha must be above 0 and below {STEEPEST:.4f}, not {alpha}")
    if not (ratio > 0 and np.isfinite(ratio)):
        raise ArgumentError(f"ratio must be a number above 0, not {ratio}")
    if ground not in ("viscous", "elliptic", "unit"):
        raise ArgumentError(f"ground must be viscous, elliptic or unit, not {ground!r}")
    phases, weights = _quarter(alpha, ratio)
    psi = alpha * np.sin(phases)
    if ground == "viscous":
        lean = (ratio - 1) * float(weights @ np.sin(psi) ** 2)
        return float(j0(alpha) * lean / (1 + lean))
    bend, y = _slow(alpha, ratio, psi, weights, unit=ground == "unit")
    return alpha**2 * (y - bend)


def _quarter(alpha: float, rho: float) -> tuple[np.ndarray, np.ndarray]:
    """Return phases over a quarter wave and weights of a mean, on ever shorter panels to 0.

    Near 0, where the tangent is along the direction of motion, dry friction changes direction
    within a phase of alpha / rho.
    """
    panels = _PANELS + max(0, int(np.log2(max(1.0, rho) / alpha)))
    ends = np.append(0.0, 0.5 ** np.arange(panels, -1, -1))
    rule = Collocation(_DEGREE)
    nodes = (ends[:-1, None] + np.diff(ends)[:, None] * rule.tau).ravel()
    return np.pi / 2 * nodes, (np.diff(ends)[:, None] * rule.B).ravel()


def _slow(
    alpha: float, rho: float, psi: np.ndarray, weights: np.ndarray, *, unit: bool
) -> tuple[float, float]:
    """Return shortfalls 1 - J0 and y = 1 - w of the recoil w on dry ground, over alpha^2."""
    c, s = np.cos(psi), np.sin(psi) / alpha
    bent = 2 * (np.sin(psi / 2) / alpha) ** 2  # (1 - c) / alpha^2

    def force(y: float) -> float:
        """Return the force on the material, which slips at 1 - w cos along and -w sin across."""
        w = 1 - alpha**2 * y
        ahead, aside = bent + y * c, w * s  # over alpha^2, and over alpha
        if unit:
            return float(weights @ ((ahead * c - rho * aside * s) / np.hypot(alpha * ahead, aside)))
        across = rho * aside
        return float(weights @ ((ahead * c - rho * across * s) / np.hypot(alpha * ahead, across)))

    # the force points forward without recoil, and backward with a fast recoil
    way = 1.0 if force(0.0) < 0 else -1.0
    near, far = 0.0, way
    while way * force(far) < 0:
        near, far = far, min(4 * far, 1 / alpha**2)
    tiny = np.finfo(float).tiny
    y = float(brentq(force, near, far, xtol=tiny, rtol=8.9e-16))  # pyright: ignore
    return float(weights @ bent), y


def best_serpenoid(ratio: float, ground: Ground = "viscous") -> tuple[float, float]:
    """Return amplitude (rad) and speed of the fastest infinite serpenoid body.

    The speed is relative to that of the material along the wave; `ratio` is the resistance across
    over along. ArgumentError if it does not exceed 1 by enough: on dry ground waves then move the
    body backward, because the recoil is a median of the tangents, not their mean.
    """
    if not ratio > 1:
        raise ArgumentError(f"ratio must be above 1 for forward motion, not {ratio}")
    found = minimize_scalar(
        lambda alpha: -serpenoid_speed(alpha, ratio, ground),
        bounds=(1e-3, STEEPEST - 1e-6), method="bounded", options={"xatol": 1e-6},
    )  # fmt: skip
    near = float(found.x)  # pyright: ignore[reportAttributeAccessIssue]
    if serpenoid_speed(near, ratio, ground) <= 0:
        raise ArgumentError(
            f"on {ground} ground no wave moves forward at a ratio of {ratio:g}; write a larger one"
        )
    return _polished(lambda a: serpenoid_speed(a, ratio, ground), near)


def _polished(speed: Callable[[float], float], x: float) -> tuple[float, float]:
    """Return the maximum of a smooth function near x, from a polynomial through even points."""
    step, nodes = min(0.05, 0.2 * x), np.cos(np.pi * (np.arange(17) + 0.5) / 17)
    values = [speed(x + step * node) for node in nodes]
    series = np.polynomial.Chebyshev.fit(nodes, values, 16, domain=[-1, 1])
    roots = series.deriv().roots()
    best = min((r.real for r in roots if abs(r.imag) < 1e-9 and abs(r) < 1), key=abs)
    return x + step * float(best), float(series(best))


@dataclass(frozen=True, eq=False)
class SerpenoidWave:
    """Stroke of a chain of even rods: joint angles of a serpenoid wave that travels backward.

    The angle of rod j is that of the wave in its middle, a sin(2 pi (tau - (j - 1/2) / N)), with N
    rods per wave; joint angles are the differences.
    """

    alpha: float  # amplitude of the tangent angle, rad
    rods: int
    per_wave: float

    def __post_init__(self) -> None:
        if self.rods < 2 or not self.per_wave > 0:
            raise ArgumentError("a serpenoid wave needs two or more rods, and rods on a wave")

    @property
    def n_s(self) -> int:
        """Number of joints."""
        return self.rods - 1

    @property
    def breaks(self) -> np.ndarray:
        """Phases 0 and 1: the curve is smooth everywhere."""
        return np.array([0.0, 1.0])

    def tangents(self, tau: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return angles (m, rods) of the rods to an infinite body's motion, and their rates."""
        phase = (
            2 * np.pi * (np.asarray(tau)[:, None] - (np.arange(self.rods) + 0.5) / self.per_wave)
        )
        return self.alpha * np.sin(phase), 2 * np.pi * self.alpha * np.cos(phase)

    def at(self, tau: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Return joint angles at phases (m,), and their derivatives."""
        angles, rates = self.tangents(np.atleast_1d(np.asarray(tau, dtype=float)))
        return -np.diff(angles, axis=1), -np.diff(rates, axis=1)


@dataclass(frozen=True)
class FiniteSerpenoid:
    """A serpenoid worm of rods over one wave that runs through it."""

    speed: float  # mean displacement per period over the length of material per wave: V / c
    over_wave: float  # speed over that of the wave, V / vc
    swim: Swim


def finite_serpenoid(
    alpha: float, ratio: float, *, per_wave: int = 12, waves: float = 1.0
) -> FiniteSerpenoid:
    """Return the speed of a serpenoid worm of even rods on viscous ground with c_n / c_t = `ratio`.

    The displacement per period is that of its frame; for a straight stroke it does not depend on
    the frame. The ends recoil, so it is slower than an infinite worm.
    """
    rods = round(per_wave * waves)
    shape = chain_shape(rods, lengths=(1.0 / per_wave,) * rods)
    found = swim(Swimmer(shape, rods=(1.0, ratio)), SerpenoidWave(alpha, rods, per_wave))
    return FiniteSerpenoid(found.distance, found.distance / float(j0(alpha)), found)
