"""Magnetic fields: loops, coils and rows of them, their courses, materials, fluids in them.

Judged by complete elliptic integrals, Biot and Savart's law summed over windings, dipoles far away,
differences, and laws of magnetisation integrated anew.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from itertools import pairwise

import numpy as np
from scipy.integrate import quad

from tests.oracles.windings import loop_by_integrals, seen, summed
from tests.stress.means import STENCIL, refused, zero
from tests.stress.rows import ROWS
from tests.stress.verdict import Case, Dice, Judged, apart, many, spread
from wormopt.magnetics import hydrostatics
from wormopt.magnetics.coils import CoilRow
from wormopt.magnetics.hydrostatics import Langevin
from wormopt.magnetics.material import MagnetoElastic
from wormopt.magnetics.pressure import field_of, magnetic_pressure
from wormopt.magnetics.travelling import harmonic_shares, moving_profile, switched_course
from wormopt.magnetics.winding import Coil, loop_field
from wormopt.systems.coils.membrane import Choice, Membrane

_MU0 = 4e-7 * math.pi
_AXES = ("along", "across", "vertical")


def cases(*, quick: bool) -> Iterable[Case]:
    """List the cases of fields."""
    kinds = (
        ("loops", _loop, 20),
        ("coils", _coil, 20),
        ("coils far away", _far, 6),
        ("rows of coils", _row, 18),
        ("travelling fields", _travelling, 8),
        ("composites", _composite, 12),
        ("fluids in fields", _fluid, 15),
        ("membranes", _membrane, 6),
        *ROWS,
        ("no fields", _no_field, 5),
    )
    return many(kinds, quick=quick, span=0.1)


# -- coils -----------------------------------------------------------------------------------------


def _loop(dice: Dice) -> Judged:
    a, kind = spread(dice, 1e-5, 10.0), dice.integers(3)
    if kind == 0:  # near the wire
        way, d = dice.uniform(0, 2 * math.pi), spread(dice, 1e-5, 0.5)
        rho, s = a * (1 + d * math.cos(way)), a * d * math.sin(way)
    else:
        rho, s = a * spread(dice, 1e-2, 10.0), a * float(dice.normal()) * 3
    axial, radial = loop_field(a, rho**2, s)
    known = loop_by_integrals(np.array(a), rho, np.array(s))
    size = float(np.hypot(*known))
    near = math.hypot(rho - a, s) / a
    share = 1e-12 + 1e-15 / near + 1e-14 * (a / rho) ** 2 + 1e-14 * (rho / a) ** 2
    yield "axial", apart(axial, known[0], share, size=size)
    yield "radial", apart(radial * rho, known[1], share, size=size)
    on_axis = a**2 / (2 * (a**2 + s**2) ** 1.5)
    yield "on the axis", apart(loop_field(a, 0.0, s)[0], on_axis, 1e-13)


def _winding(dice: Dice) -> Coil:
    outer = spread(dice, 1e-4, 1.0)
    return Coil(outer * float(dice.uniform(0.05, 0.99)), outer, outer * spread(dice, 0.02, 20.0))


def _off(dice: Dice, coil: Coil, least: float) -> tuple[float, float]:
    """Point off the winding, at least so many radii away from it."""
    while True:
        rho, s = coil.outer * dice.uniform(0.01, 3.0), coil.length * dice.uniform(-1.5, 1.5)
        if dice.random() < 0.4:  # near the face, or in the bore
            s = (coil.length / 2 + coil.outer * spread(dice, least, 0.3)) * dice.choice([-1, 1])
        if float(coil.clearance(rho**2, s)) >= least * coil.outer:
            return float(rho), float(s)


def _coil(dice: Dice) -> Judged:
    coil = _winding(dice)
    rho, s = _off(dice, coil, 0.01)
    known = summed(coil, rho, s, 16)
    axial, radial = coil.field(rho**2, s)
    size = float(np.hypot(*known))
    yield "axial", apart(axial, known[0], 1e-9, size=size)
    yield "radial", apart(radial * rho, known[1], 1e-9, size=size)
    # on the axis in closed form
    inner, outer, half = coil.inner, coil.outer, coil.length / 2

    def end(z: float) -> float:
        return z * (math.asinh(outer / abs(z)) - math.asinh(inner / abs(z))) if z else 0.0

    place = float(dice.uniform(-2, 2)) * coil.length
    axis = (end(place + half) - end(place - half)) / (2 * coil.length * (outer - inner))
    yield "on the axis", apart(coil.field(0.0, place)[0], axis, 1e-9)


def _far(dice: Dice) -> Judged:
    """Far away a coil is a dipole; the quadrupole is 0 by symmetry, the next share (size/r)²."""
    coil = _winding(dice)
    size = math.hypot(coil.outer, coil.length)
    r, angle = size * spread(dice, 1e2, 1e7), float(dice.uniform(0.1, 3.0))
    moment = math.pi * (coil.outer**2 + coil.outer * coil.inner + coil.inner**2) / 3
    c, n = math.cos(angle), math.sin(angle)
    known = moment / (4 * math.pi * r**3) * np.array([3 * c**2 - 1, 3 * c * n])
    axial, radial = coil.field((r * n) ** 2, r * c)
    share = 10 * (size / r) ** 2 + 1e-9
    yield "dipole", apart([float(axial), float(radial) * r * n], known, share)


def _row(dice: Dice) -> Judged:
    coil = _winding(dice)
    axis = _AXES[int(dice.integers(3))]
    count, gap = int(dice.integers(1, 6)), None
    pitch = (coil.length if axis == "along" else 2 * coil.outer) * spread(dice, 1.01, 3.0)
    sides = "both"
    if axis != "along" and dice.random() < 0.6:
        gap = coil.outer * spread(dice, 0.2, 5.0)
        sides = "alternating" if dice.random() < 0.5 else "both"
    row = CoilRow(coil, count, pitch, axis, gap, sides)
    middles = _middles(row)
    while True:
        place = np.array(
            [dice.uniform(-1, count) * pitch, *(coil.outer * dice.normal(size=2) * 1.5)]
        )
        if float(row.clearance(place[0], place[2], place[1])) > 0.1 * coil.outer:
            break
    currents = dice.uniform(-1, 1, count) * spread(dice, 1e-3, 1e5)

    def field(at: np.ndarray) -> np.ndarray:
        return sum(
            (currents[k] * seen(coil, _AXES.index(axis), at - m) for k, m in middles), np.zeros(3)
        )

    known = field(place)
    size = float(np.abs(currents).max() / coil.outer * 0.01)
    x, y, z = place
    found = row.field([x], z, currents[:, None], y)[:, 0, 0]
    yield "field", apart(found, known, 1e-9, size=size)
    step = 1e-3 * coil.outer
    by_steps = np.zeros(3)
    for e in np.eye(3):
        for k, weight in STENCIL:
            beside = field(place + k * step * e)
            by_steps += weight / step * (beside @ beside) * e
    told = row.square_gradient([x], z, currents, y)[:, 0]
    largest = float(known @ known) / coil.outer
    yield "gradient of the square", apart(told, by_steps, 1e-7, size=largest)


def _middles(row: CoilRow) -> list[tuple[int, np.ndarray]]:
    """Number and middle of each coil, by the words of the row's description."""
    found, e = [], np.eye(3)[_AXES.index(row.axis)]
    for k in range(row.count):
        place = np.array([k * row.pitch, 0.0, 0.0])
        if row.gap is None:
            found.append((k, place))
            continue
        off = (row.gap + row.coil.length) / 2 * e
        if row.sides == "both":
            found += [(k, place + off), (k, place - off)]
        else:
            found.append((k, place + off if k % 2 == 0 else place - off))
    return found


def _travelling(dice: Dice) -> Judged:
    """Blocks that are switched, seen from the wave, and the harmonics of what is seen."""
    outer, every = spread(dice, 1e-3, 0.1), int(dice.integers(2, 6))
    coil, count = Coil(0.4 * outer, outer, 2 * outer), 2 * every
    row = CoilRow(coil, count, 2.2 * outer, "vertical")
    on, rate = int(dice.integers(1, every)), spread(dice, 1e-2, 1e4)
    course = switched_course(count, 100.0, rate, on=on, every=every)
    phases, wavelength, period = 8, every * row.pitch, every / rate
    x = np.array([0.37, 1.21]) * row.pitch * every / 3
    z = 1.5 * outer + coil.length / 2
    profile = moving_profile(
        row, course, x, z, wavelength=wavelength, period=period, phases=phases
    )  # fmt: skip
    known = np.zeros((2, phases))
    for i, j in np.ndindex(2, phases):
        turns = j / phases + x[i] / wavelength + 0.0
        shift = math.floor(every * (turns % 1) + 1e-12)
        field = np.zeros(3)
        for k in range(count):
            if (k - shift) % every < on:
                place = np.array([x[i] - k * row.pitch, 1e-9 * outer, z])
                field += 100.0 * seen(coil, 2, place)
        known[i, j] = field @ field
    yield "square", apart(profile.square, known, 1e-6)
    n = int(dice.integers(8, 40))
    values, t = dice.normal(size=n), 2 * math.pi * np.arange(n) / n
    waves = [
        np.hypot(values @ np.cos(m * t), values @ np.sin(m * t)) ** 2 for m in range(1, n // 2 + 1)
    ]
    if n % 2 == 0:
        waves[-1] /= 2  # counts once in the variation, the others twice
    yield "harmonics", apart(harmonic_shares(values, 4), (np.array(waves) / sum(waves))[:4], 1e-10)


# -- materials -------------------------------------------------------------------------------------


def _composite(dice: Dice) -> Judged:
    """Numbers of the chapter from its formulas in exponents, and the end of what they hold for."""
    mu_r, eta = 1 + spread(dice, 1e-6, 1e3), spread(dice, 1.0, 1e12)
    rubber = MagnetoElastic(mu_r, eta)
    limit = math.exp((math.log(1.5) - math.log(_MU0 / 5 / eta)) / 2 - math.log(mu_r - 1))
    yield "limit", apart(rubber.largest_field, limit, 1e-9)
    beyond = limit * (1 + spread(dice, 1e-9, 10))
    yield "refusal", refused(lambda: rubber.youngs_modulus(beyond), "field below", "mu_r below")
    H = limit * spread(dice, 1e-6, 0.999)
    G = -1.5 * (H / limit) ** 2
    yield "softening", apart(rubber.softening(H), G, 1e-9)
    modulus = 3 * eta * (1 + 2 * G / 3) / (1 + G / 2)
    yield "modulus", apart(rubber.youngs_modulus(H), modulus, 1e-9)
    # the two parts of the field's strain: that of mu_r - 1, and that of G
    strain = (_MU0 * (mu_r - 1) * H**2 / (6 * eta) - G / 6) / (1 + 2 * G / 3)
    yield "strain", apart(rubber.field_strain(H), strain, 1e-9)
    stress = spread(dice, 1e-3, 1e3)
    again = rubber.stress(rubber.strain(stress, H), H)
    size = modulus * abs(strain) * 1e-3  # the strain of the stress hides in that of the field
    yield "there and back", apart(again, stress, 1e-9, size=size)


def _langevin(y: float) -> float:
    return y / 3 - y**3 / 45 + 2 * y**5 / 945 if y < 0.02 else 1 / math.tanh(y) - 1 / y


def _fluid(dice: Dice) -> Judged:
    chi, saturation = spread(dice, 1e-4, 1e2), spread(dice, 1e2, 1e6)
    H = saturation / chi * spread(dice, 1e-5, 1e4)
    law = Langevin(chi, saturation)

    def M(size: float) -> float:
        return saturation * _langevin(3 * chi * size / saturation)

    yield "magnetisation", apart(law.ratio(H**2) * H, M(H), 1e-9)
    knee = saturation / chi
    edges = [0.0, *(e for e in knee * 10.0 ** np.arange(-2, 5) if e < H), H]
    energy = sum(quad(M, a, b, epsabs=0, epsrel=1e-10)[0] for a, b in pairwise(edges))
    yield "energy", apart(law.energy(H**2), energy, 1e-8)
    fluid = hydrostatics.Fluid(spread(dice, 500, 5e3), spread(dice, 1e-3, 0.1), law)
    slope, way = float(dice.normal()), float(dice.uniform(0, 2 * math.pi))
    along, up = H * math.cos(way), H * math.sin(way)
    normal = (up - slope * along) / math.hypot(1, slope)
    stress = _MU0 * (energy + (M(H) / H * normal) ** 2 / 2)
    yield "pull", apart(hydrostatics.pull(fluid, (along, up), slope), stress, 1e-8)
    tangent = math.sqrt(max(H**2 - normal**2, 0.0))

    def off(inside: float) -> float:
        whole = math.hypot(inside, tangent)
        return inside * (1 + M(whole) / whole) - abs(normal)

    inside = zero(off, 0.0, abs(normal))
    whole = math.hypot(inside, tangent)
    thin = _MU0 * (float(law.energy(whole**2)) + (M(whole) / whole * inside) ** 2 / 2)
    found = hydrostatics.flat_layer_pull(fluid, (along, up), slope)
    yield "pull on a thin layer", apart(found, thin, 1e-8)
    p = float(magnetic_pressure(1 + chi, H))
    yield "field of a pressure", apart(field_of(1 + chi, p), H, 1e-12 + 1e-15 / chi)


def _membrane(dice: Dice) -> Judged:
    """The widest membrane within limits is as thin as the hardest of them lets it."""
    R, E, p = spread(dice, 1e-4, 0.1), spread(dice, 1e3, 1e9), spread(dice, 1.0, 1e5)
    D, drop, rho = spread(dice, 1e-14, 1e-8), spread(dice, 1.0, 1e3), spread(dice, 500, 5e3)
    tube, life = Membrane(R, E, p, D, drop, rho), spread(dice, 1.0, 1e8)
    limits = {"loss": spread(dice, 1e-3, 1), "stress": spread(dice, 1e3, 1e8),
              "strain": spread(dice, 1e-3, 1)}  # fmt: skip
    least = max(
        2 * D * drop * life / (R * rho * limits["loss"]), p * R / limits["stress"],
        p * R / (E * limits["strain"]),
    )  # fmt: skip
    span = (math.log(least * 1e-6), math.log(least * 1e6))
    found, excess = Choice(tube, life, limits).widest(span, **limits)
    yield "thickness", apart(found, least, 1e-9)
    yield "excess", max(excess, 0.0) / 1e-9
    yield "strain", apart(tube.strain(found), p * R / (E * least), 1e-9)


def _no_field(dice: Dice) -> Judged:
    """Coils and materials that cannot be."""
    more = 1 + spread(dice, 1e-6, 1e2)
    coil = Coil(1.0, 2.0, 1.0, ampere_turns=1.0)
    yield "inside out", refused(lambda: Coil(more, 1.0, 1.0), "must be below outer")
    yield "flat", refused(lambda: Coil(1.0, 2.0, -more), "length", "above 0")
    yield "overlap", refused(lambda: CoilRow(coil, 2, 4 / more), "overlap", "apart")
    yield "in the winding", refused(lambda: coil.field(2.25, 0.1), "winding")
    row = CoilRow(coil, 2, 5.0)
    yield (
        "current",
        refused(
            lambda: row.field([0.0], 9.0, [[more], [0.0]]), "current", "exceeds the coils' limit"
        ),
    )
    yield "no gap", refused(lambda: CoilRow(coil, 2, 5.0, sides="alternating"), "gap")
    yield "no magnet", refused(lambda: MagnetoElastic(1 / more, 1.0), "mu_r", "above 1")
    yield "saturation", refused(lambda: Langevin(1.0, -more), "saturation", "above 0")
    yield "blocks", refused(lambda: switched_course(3, 1.0, 1.0, on=4), "do not fit")
