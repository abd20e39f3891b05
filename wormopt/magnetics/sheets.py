"""Field of a loop of wire and of a thin solenoid, in closed form and without special cases.

Complete elliptic integrals are found by the arithmetic-geometric mean of the largest and the
least distance to the wire. Its first step is written out by hand: what follows depends on the
distance from the axis by its square ``q`` only, so that values and derivatives are regular on the
axis. The number of steps is fixed. All functions take numbers, arrays or CasADi expressions, use
nothing but arithmetic and comparisons, and check nothing.

Sources: N. Derby and S. Olbert, Cylindrical magnets and ideal solenoids, Am. J. Phys. 78 (2010)
229; DLMF 19.8 for the means; F. Paxton, Rev. Sci. Instrum. 30 (1959) 254 for the solid angle.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import casadi as ca
    import numpy as np

    Expression = ca.SX | np.ndarray | float


# Steps of the mean after the first: enough for distances from the wire of 1e-7 of its radius.
_STEPS = 6


def loop_field(radius: Expression, q: Expression, s: Expression) -> tuple[Any, Any]:
    """Field of a wire loop that carries one ampere: axial (A/m), radial / distance (A/m²).

    `q`: squared distance from the axis, m²; `s`: distance from the loop's plane, m.
    The radial component over the distance from the axis is regular on the axis.
    """
    a2 = radius * radius
    A, P, means, sigma = _means(a2, q, s)
    M = means[-1][0]
    axial = (2 * a2 * (a2 + s * s - q) + (q + s * s - a2) * q * sigma) / (4 * M * P * P)
    radial = s * (4 * a2 - A * sigma) / (4 * M * P * P)
    return axial, radial


def sheet_field(radius: Expression, half: Expression, q: Expression, s: Expression) -> Any:
    """Field of a thin solenoid with one ampere per metre, less what is uniform inside.

    Axial, and radial / distance (1/m); `q`, `s` as for `loop_field`, `s` from the middle.
    Add 1 to axial where |s| < half, q < radius²; without it, smooth beyond the ends.
    """
    axial, radial = 0.0, 0.0
    for end, sign in ((s + half, -1), (s - half, 1)):
        side = 2 * (end >= 0) - 1  # not sign(): at 0 the derivative from the right is the one
        cover, potential = _end(radius * radius, q, side * end)
        axial = axial + sign * side * cover
        radial = radial + sign * potential
    return axial, radial


def _end(a2: Any, q: Any, z: Any) -> tuple[Any, Any]:
    """Cover and potential of one end, at the distance z >= 0 beyond it.

    The cover is the field along the axis beyond the end of a half-infinite solenoid: the solid
    angle of its disc over 4 pi. It is an integral of the third kind, of the characteristic that
    stays regular where q passes a2. The potential is that of the loop, over the distance from the
    axis.
    """
    _, P, means, sigma = _means(a2, q, z)
    M = means[-1][0]
    # e is z times the third variable of the mean, so that z = 0 is no special case
    e = (z * z + P) / 2
    ratio = z / e
    total, weight = ratio, (1 - z * ratio) / 2
    for mean, geometric in means[:-1]:
        product = mean * geometric
        square = e * e + z * z * product
        ratio = 2 * z * product / square
        total = total + weight * ratio
        weight = weight * (1 - z * ratio) / 2
        e = square / (2 * e)
    # what infinitely many steps more would add, now that both means are M
    total = total + weight * 2 * M / (e + M * z)
    return 0.25 - (2 * z - (a2 - q) * total) / (8 * M), sigma / (4 * M)


def _means(a2: Any, q: Any, s: Any) -> tuple[Any, Any, list[tuple[Any, Any]], Any]:
    """Squares summed, product of the largest and least distance, the means, and their defect.

    The defect is the sum of 2^(n-1) c_n² / q over n >= 1, with c_n the half differences, here by
    c_{n+1} = c_n² / (4 a_{n+1}), which cancels nothing.
    """
    A = a2 + q + s * s
    P = ((a2 - q) * (a2 - q) + s * s * (2 * (a2 + q) + s * s)) ** 0.5
    mean, geometric = ((A + P) / 2) ** 0.5, P**0.5
    part = 2 * a2 / (A + P)
    sigma, means = part, [(mean, geometric)]
    for step in range(_STEPS):
        mean, geometric = (mean + geometric) / 2, (mean * geometric) ** 0.5
        part = q * part * part / (16 * mean * mean)
        sigma = sigma + 2.0 ** (step + 1) * part
        means.append((mean, geometric))
    return A, P, means, sigma
