"""Rows of coils without ends, of which blocks are on, and currents fitted to a travelling field.

Judged by Biot and Savart's law summed over windings of twice as long rows, by SciPy's least
squares, which must find nothing better, and by differences.
"""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
from scipy.optimize import least_squares

from tests.oracles.windings import seen
from tests.stress.means import STENCIL, refused
from tests.stress.verdict import Dice, Judged, Kind, above, apart, spread
from wormopt.magnetics.blocks import BlockField, block_field
from wormopt.magnetics.coils import Coil, CoilRow
from wormopt.systems.coils.row_currents import TravellingTarget, fit_currents

_BLOCKS = 6  # on each side; the package takes 3


def _valued(field: BlockField, x: float, y: float) -> tuple[float, np.ndarray]:
    place = ca.SX.sym("place", 2)
    square = ca.Function("square", [place], [field.expression(place[0], place[1])])
    return float(square([x, y])), np.array(field.gradient([x, y]))[:, 0]


def _block(dice: Dice) -> Judged:
    """H² and its slope anywhere on the strip, in blocks far to the left and to the right."""
    outer = spread(dice, 1e-4, 0.1)
    coil = Coil(outer * float(dice.uniform(0.1, 0.8)), outer, outer * spread(dice, 0.3, 3.0))
    pitch, every = 2 * outer * spread(dice, 1.01, 2.0), int(dice.integers(3, 6))
    on = int(dice.integers(1, every))
    sides = "alternating" if dice.random() < 0.7 else "both"
    gap = outer * spread(dice, 0.7, 3.0)
    half = gap / 2 * float(dice.uniform(0.2, 0.6))
    row = CoilRow(coil, 2, pitch, gap=gap, sides=sides)
    field = block_field(row, half, on, every)
    middle = (on - 1) / 2

    def strength(x: float, y: float) -> np.ndarray:
        found = np.zeros(3)
        for k in range(-_BLOCKS * every, _BLOCKS * every):
            if k % every >= on:
                continue
            for side in (1.0, -1.0) if sides == "both" else (1.0 - 2.0 * (k % 2),):
                away = np.array([x - (k - middle) * pitch, y - side * (gap + coil.length) / 2, 0.0])
                found += seen(coil, 1, away + np.array([1e-9 * outer, 0.0, 0.0]))
        return found

    places = [(dice.uniform(-1, 1) * every * pitch, dice.uniform(-1, 1) * half) for _ in range(3)]
    places.append((0.0, half))
    known = [float(np.sum(strength(*at) ** 2)) for at in places]
    found = [_valued(field, *at) for at in places]
    largest = max(*known, *(value for value, _ in found))
    # blocks left out by the package and here are dipoles in an even row
    far = 4 * (outer / (3 * every * pitch)) ** 2
    yield "square", apart([v for v, _ in found], known, 2 * field.error + 1e-3 * far, size=largest)
    yield "error told", field.error / 2e-2
    x, y = places[0]
    step = 1e-3 * outer
    slope = [
        sum(w * float(np.sum(strength(x + k * step * a, y + k * step * b) ** 2))
            for k, w in STENCIL) / step
        for a, b in ((1, 0), (0, 1))
    ]  # fmt: skip
    share = 30 * field.error + 1e-3 * far
    yield "slope", apart(found[0][1], slope, share, size=largest / half)


def _fit(dice: Dice) -> Judged:
    """Currents after which SciPy's least squares, by the same places and instants, find no better.

    Coil k follows the wave: its current at the turn s of the place x is the course at
    s + (x - x_k) / wavelength, between nodes a straight line.
    """
    outer = spread(dice, 1e-3, 0.1)
    most = spread(dice, 1e2, 1e4)
    coil = Coil(0.4 * outer, outer, outer * float(dice.uniform(0.5, 2.0)), ampere_turns=most)
    count, nodes = int(dice.integers(5, 9)), int(dice.integers(8, 13))
    row = CoilRow(coil, count, 2.2 * outer, "vertical")
    wavelength = row.pitch * float(dice.uniform(3.0, 5.0))
    x = row.pitch * ((count - 1) / 2 + dice.uniform(-0.5, 0.5, 3))
    z = coil.length / 2 + outer * float(dice.uniform(0.5, 1.5))
    on_axis = float(np.linalg.norm(seen(coil, 2, np.array([1e-9 * outer, 0.0, z]))))
    size = (most * on_axis * float(dice.uniform(0.1, 0.8))) ** 2
    second = float(dice.uniform(0.0, 0.4))

    def D(xi: np.ndarray) -> np.ndarray:
        return size / 2 * (np.cos(xi) + second * np.cos(2 * xi))

    target = TravellingTarget(D, size / 2 * (1 + second), wavelength, spread(dice, 1e-3, 1.0))
    polarity = str(dice.choice(["any", "one", "alternating"]))
    found = fit_currents(row, target, x, z, nodes=nodes, starts=2, polarity=polarity)  # type: ignore[arg-type]
    # each place sees the coils' fields, each coil a combination of two nodes
    turn = (np.arange(nodes) + 0.5 * (np.arange(3) % 2)[:, None]) / nodes
    fields = np.zeros((3, 3, nodes, nodes))
    for i, j in np.ndindex(3, nodes):
        for k in range(count):
            away = np.array([x[i] - k * row.pitch, 1e-9 * outer, z])
            one = seen(coil, 2, away)
            at = (turn[i, j] + away[0] / wavelength) * nodes
            for corner in (math.floor(at), math.floor(at) + 1):
                sign = -1.0 if polarity == "alternating" and (corner // nodes) % 2 else 1.0
                fields[:, i, j, corner % nodes] += sign * (1 - abs(at - corner)) * one
    wanted = D(2 * math.pi * turn)

    def rest(w: np.ndarray) -> np.ndarray:
        square = np.sum((fields @ (w[:-1] * most)) ** 2, axis=0)
        return ((square - w[-1] * target.least_square + wanted) / np.std(wanted)).ravel()

    begin = np.append(found.nodes / most, found.square / target.least_square)
    residual = float(np.sqrt(np.mean(rest(begin) ** 2)))
    yield "residual", apart(found.residual, residual, 1e-6, size=1e-3)
    low = np.append(np.full(nodes, 0.0 if polarity == "one" else -1.0), 1.0)
    high = np.append(np.ones(nodes), np.inf)
    yield "limits", above(float(np.abs(begin[:-1]).max()), 1.0, 1e-6)
    yield "offset", above(1.0, float(begin[-1]), 1e-6)
    inside = np.clip(begin, low + 1e-9, np.minimum(high, 1e9) - 1e-9)
    better = least_squares(rest, inside, bounds=(low, high), xtol=1e-12, ftol=1e-12, gtol=1e-12)
    again = float(np.sqrt(np.mean(better.fun**2)))
    yield "beaten", above(residual, again, 1e-4, size=1e-2)


def _no_row(dice: Dice) -> Judged:
    """Blocks, strips and targets that cannot be."""
    more = 1 + spread(dice, 1e-3, 10.0)
    row = CoilRow(Coil(1e-3, 5e-3, 5e-3), 2, 12e-3, gap=10e-3, sides="alternating")
    every = int(dice.integers(2, 6))
    yield "block", refused(lambda: block_field(row, 1e-3, every, every), "does not fit", "pattern")
    yield (
        "strip",
        refused(lambda: block_field(row, 5e-3 * more, 1, 3), "strip", "touches the coils"),
    )

    def target(least: float, square: float | None = None) -> TravellingTarget:
        return TravellingTarget(np.cos, least, 0.1, 1.0, square)

    yield "least", refused(lambda: target(-more), "least_square must be above 0")
    yield "root", refused(lambda: target(more, 1.0), "below the least", "negative")
    flat = CoilRow(Coil(1e-3, 5e-3, 5e-3), 5, 12e-3, "vertical")
    few = refused(lambda: fit_currents(flat, target(1.0), [0.02], 0.01, nodes=3), "4 nodes")
    yield "nodes", few


ROWS: tuple[Kind, ...] = (
    ("blocks of coils", _block, 10),
    ("currents for a field", _fit, 10),
    ("no rows", _no_row, 3),
)
