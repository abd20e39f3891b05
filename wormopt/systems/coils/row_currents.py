"""Currents of a row of coils whose travelling field is closest to a prescribed H².

All coils share one waveform, delayed from coil to coil by the time the wave needs for a pitch: in
an infinite row symmetry requires nothing else. This row has ends, and the field is compared in its
interior. H² is quadratic in the currents, so the problem is not convex; starts with fields of
different offset and waveform are solved in turn.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, get_args

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError, SolveError
from wormopt.magnetics.coils import CoilRow
from wormopt.magnetics.travelling import shifted_course
from wormopt.model.gait import Gait
from wormopt.ocp.nlp import Bounds, Ipopt, NonlinearProgram, Solution
from wormopt.progress import Report

Polarity = Literal["any", "one", "alternating"]
# Initial fields: H0² over the least possible.
_OFFSETS = (1.02, 1.6, 2.5)
# Regularisation of initial currents, as a share of the largest influence.
_RIDGE = 1e-3
_ACCEPTED = 1e-7


@dataclass(frozen=True, eq=False)
class TravellingTarget:
    """A travelling H² = H0² - D(xi), xi = 2 pi (t / period - x / wavelength).

    Raises ArgumentError if a value is not positive, or H0² below the least.
    """

    function: Callable[[np.ndarray], np.ndarray]  # D of an array of phases, A²/m²
    least_square: float  # least H0², A²/m²: the largest D, or more
    wavelength: float  # m
    period: float  # s; the wave travels forward
    square: float | None = None  # H0², A²/m²; None: optimised, from `least_square` on

    def __post_init__(self) -> None:
        for name in ("least_square", "wavelength", "period"):
            if not 0 < getattr(self, name) < math.inf:
                raise ArgumentError(f"{name} must be above 0, not {getattr(self, name)!r}")
        if self.square is not None and not self.square >= self.least_square * (1 - 1e-12):
            raise ArgumentError(
                f"H0 = {math.sqrt(max(self.square, 0.0)):g} A/m is below the least, "
                f"{math.sqrt(self.least_square):g} A/m: H² would be negative somewhere"
            )


@dataclass(frozen=True, eq=False)
class RowFit:
    """Currents of the best fit."""

    nodes: np.ndarray  # (m,) ampere-turns of coil 0 at equidistant times of one period of the wave
    course: Gait  # of all coils
    square: float  # H0², A²/m²
    residual: float  # RMS of the difference of H² over that of D, at the points of the program
    solution: Solution  # of the program
    # each: H0² over the least, status, iterations, residual (None if it failed)
    starts: tuple[dict[str, object], ...]


@dataclass(frozen=True, eq=False)
class _Points:
    """Points of the program, and linear maps to them: all that targets of a wavelength share."""

    field: np.ndarray  # (3 or less, points, m) per ampere-turn at the nodes
    along: int  # component along the coils' axes
    turns: np.ndarray  # (points,) phase in the waveform of the nearest coil, turns
    phases: np.ndarray  # (points,) of the target, rad

    @property
    def gain(self) -> float:
        """Largest field per ampere-turn, in 1/m: the unit of currents in the program."""
        return float(np.abs(self.field).max())


def fit_currents(
    row: CoilRow,
    target: TravellingTarget,
    places: Sequence[float] | np.ndarray,
    z: float,
    *,
    nodes: int = 40,
    slew: float | None = None,
    polarity: Polarity = "any",
    starts: int = 4,
    seed: int = 0,
    options: Ipopt | None = None,
    report: Report = lambda text, fraction: None,  # noqa: ARG005
) -> RowFit:
    """Return currents whose H² is closest to the target in least squares over space and time.

    Compared at `places` (n,) and height `z`, in m, y = 0; `slew` in ampere-turns per second. The
    best of all starts. Raises ArgumentError (also for a coil in the fluid), SolveError if none.
    """
    if polarity not in get_args(Polarity):
        raise ArgumentError(f'no polarity "{polarity}"; there are {", ".join(get_args(Polarity))}')
    if nodes < 4 or starts < 1 or (slew is not None and not slew > 0):
        raise ArgumentError("give at least 4 nodes, 1 start, and a slew above 0")
    x = tuple(np.ravel(np.asarray(places, dtype=float)).tolist())
    made = _points(row, target.wavelength, x, z, nodes, polarity)
    scale, D = target.least_square, np.asarray(target.function(made.phases), dtype=float)
    guesses = [_guess(made, D, target, row, k, seed, polarity) for k in range(starts)]
    unit = math.sqrt(scale) / made.gain
    nlp = _program(made, slewed=slew is not None, alternating=polarity == "alternating")
    bounds = _bounds(made, D / scale, target, row, unit, slew, polarity)
    tries: list[dict[str, object]] = []
    best: Solution | None = None
    for k, (offset, currents) in enumerate(guesses):
        report(f"{k} of {starts} starts done", k / starts)
        field = (made.field @ currents).ravel() / math.sqrt(scale)
        w0 = np.concatenate([currents / unit, [offset], field])
        found = nlp.solve(np.clip(w0, bounds.lbw, bounds.ubw), bounds, options or Ipopt())
        good = found.success and found.violation <= _ACCEPTED
        residual = math.sqrt(max(found.objective, 0.0)) if good else None
        tries.append(
            {"offset": offset, "status": found.status, "iterations": found.iterations,
             "residual": residual}
        )  # fmt: skip
        if good and (best is None or found.objective < best.objective):
            best = found
    if best is None:
        raise SolveError(
            f"none of {starts} starts led to currents ({tries[-1]['status']})",
            "write more starts, fewer nodes, or a larger limit of the currents",
            code="not_solved",
        )
    found = unit * best.w[:nodes]
    exact = _exact(made, D, found, float(best.w[nodes]) * scale)
    course = shifted_course(
        found,
        target.period,
        target.period * row.pitch / target.wavelength,
        row.count,
        alternating=polarity == "alternating",
    )
    return RowFit(found, course, float(best.w[nodes]) * scale, exact, best, tuple(tries))


@lru_cache(maxsize=4)
def _points(
    row: CoilRow,
    wavelength: float,
    places: tuple[float, ...],
    z: float,
    nodes: int,
    polarity: Polarity,
) -> _Points:
    x = np.array(places)
    influence = row.influence(x, z)
    shown = [
        c for c in range(3) if np.max(np.abs(influence[c])) > 1e-12 * np.max(np.abs(influence))
    ]
    # at every other place, phases are midway between the corners, to include the field there
    turn = (np.arange(nodes)[None, :] + 0.5 * (np.arange(len(x)) % 2)[:, None]) / nodes
    away = (x[:, None, None] - row.places) / wavelength
    local = (turn[:, :, None] + away) * nodes
    whole = np.floor(local).astype(int)
    field = np.zeros((len(shown), len(x), nodes, nodes))
    at = np.indices(whole.shape)
    for corner, weight in ((whole, 1 - (local - whole)), (whole + 1, local - whole)):
        sign = (-1.0) ** (corner // nodes) if polarity == "alternating" else 1.0
        for c, component in enumerate(shown):
            part = influence[component][:, None, :] * weight * sign
            np.add.at(field[c], (at[0], at[1], corner % nodes), part)
    axis = ("along", "across", "vertical").index(row.axis)
    along = shown.index(axis) if axis in shown else 0
    nearest = np.abs(away).argmin(axis=2)
    turns = turn + np.take_along_axis(away, nearest[..., None], axis=2)[..., 0]
    phases = 2 * np.pi * turn.ravel()
    return _Points(field.reshape(len(shown), -1, nodes), along, turns.ravel(), phases)


@lru_cache(maxsize=4)
def _program(made: _Points, *, slewed: bool, alternating: bool) -> NonlinearProgram:
    """Return the program; its parameters are D at the points, and the objective's weight."""
    # Field strengths are variables too: the constraints are linear, second derivatives sparse.
    components, points, nodes = made.field.shape
    w = ca.MX.sym("w", nodes + 1 + components * points)
    currents, offset, field = w[:nodes], w[nodes], w[nodes + 1 :]
    p = ca.MX.sym("p", points + 1)
    square = ca.sum2(ca.reshape(field, points, components) ** 2)
    objective = p[-1] * ca.sumsqr(square - offset + p[:-1])
    g = [field - ca.DM(made.field.reshape(-1, nodes) / made.gain) @ currents]
    if slewed:
        after = ca.vertcat(currents[1:], currents[0] * (-1 if alternating else 1))
        g.append(after - currents)
    return NonlinearProgram(w, p, objective, ca.vertcat(*g))


def _guess(
    made: _Points,
    D: np.ndarray,
    target: TravellingTarget,
    row: CoilRow,
    k: int,
    seed: int,
    polarity: Polarity,
) -> tuple[float, np.ndarray]:
    """Offset and currents whose field along the axes is nearest to the root of the target."""
    offset = _OFFSETS[k % len(_OFFSETS)]
    if target.square is not None:
        offset = target.square / target.least_square
    root = np.sqrt(np.maximum(offset * target.least_square - D, 0.0))
    if polarity == "alternating":
        zero = np.mod(made.turns[np.argmax(D)], 1.0)
        root = root * (-1.0) ** np.floor(made.turns - zero)
    A = made.field[made.along]
    ridge = _RIDGE * np.linalg.norm(A, 2) * np.eye(A.shape[1])
    currents = np.linalg.lstsq(
        np.vstack([A, ridge]), np.concatenate([root, np.zeros(A.shape[1])]), rcond=None
    )[0]
    if k >= len(_OFFSETS):
        rng = np.random.default_rng([seed, k])
        currents = currents + np.abs(currents).max() * rng.uniform(-0.5, 0.5, len(currents))
    if polarity == "one" and np.sum(currents) < 0:
        currents = -currents  # H² is the same
    limit = row.coil.ampere_turns
    low = 0.0 if polarity == "one" else -limit
    return offset, np.clip(currents, low, limit)


def _bounds(
    made: _Points,
    D: np.ndarray,
    target: TravellingTarget,
    row: CoilRow,
    unit: float,
    slew: float | None,
    polarity: Polarity,
) -> Bounds:
    components, points, nodes = made.field.shape
    limits = np.zeros(components * points)
    if slew is not None:
        limits = np.append(limits, np.full(nodes, slew * target.period / nodes / unit))
    largest = row.coil.ampere_turns / unit
    ubw = np.full(nodes + 1 + components * points, np.inf)
    lbw = -ubw
    lbw[:nodes], ubw[:nodes] = (0.0 if polarity == "one" else -largest), largest
    lbw[nodes] = 1.0
    if target.square is not None:
        lbw[nodes] = ubw[nodes] = target.square / target.least_square
    return Bounds(lbw, ubw, -limits, limits, np.append(D, 1 / (points * np.var(D))))


def _exact(made: _Points, D: np.ndarray, currents: np.ndarray, square: float) -> float:
    """Residual with the field of these currents, not that of the program's variables."""
    H2 = np.sum((made.field @ currents) ** 2, axis=0)
    return float(np.sqrt(np.mean((H2 - square + D) ** 2)) / np.std(D))
