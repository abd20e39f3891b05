"""The velocity of a body that takes the least power from dry ground, for many bodies at a time.

Masses move with v_i = b_i + J_i x; sought is the least of sum psi_i(v_i) - load.x, psi being the
norms of `Ground`. Where masses rest the sum has no slope: they are found by smoothed norms, and
then held exactly. By convexity a set of resting masses is the right one if the ground can hold it.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from wormopt.errors import SolveError
from wormopt.systems.planar.crawling.balance import WIDTHS, LeastPower
from wormopt.systems.planar.crawling.held import Held, held, load_gauge

# Slower than this against the fastest, a mass may be at rest; by so much a gauge may pass 1.
_STILL, _SLACK = 1e-6, 1e-9
# Smoothing where that does not tell. Where nothing does: by how much of the smoothing masses at
# rest creep, and forces that rounding leaves.
_FINER, _CREEP, _CREPT = 10.0 ** -np.arange(8.5, 11.1, 0.5), 100.0, 1e-5


@dataclass(frozen=True, eq=False)
class Least:
    """Velocities of least power."""

    x: np.ndarray  # (G, n)
    rest: np.ndarray  # (G, m), whether a mass rests
    push: np.ndarray  # (G, m, 2), what each mass pushes against the ground with
    hold: np.ndarray  # (G,), least largest gauge of the pushes of resting masses
    stiffness: np.ndarray  # (G,), least curvature where unknowns are left, infinite where none


def least_power(body: LeastPower) -> Least:
    """Find velocities of least power; SolveError where none is found."""
    check_load(body)
    x = body.smoothed()
    least, open_ = settle(body, *_slow(body, x))
    if open_.size:
        _put(least, open_, _careful(body.of(open_), x[open_]))
    return least


def _careful(body: LeastPower, x: np.ndarray) -> Least:
    """The same where many masses hardly move: from velocities `x` by a smoothing on.

    Masses at rest creep as the smoothing has it, and the others do not.
    """
    finer = body.smoothed(_FINER, x)
    rest = body.powers(finer) < body.powers(x) * np.sqrt(_FINER[-1] / WIDTHS[-1])
    least, open_ = settle(body, finer, rest)
    if open_.size:  # all but at a break of several masses: the creep is all that is left to tell
        _put(least, open_, _crept(body.of(open_), x[open_]))
    return least


def _crept(body: LeastPower, x: np.ndarray) -> Least:
    """Smoothed velocities: they miss the least power by less than m times the smoothing."""
    width = float(WIDTHS[-1])
    v = body.velocities(x)
    squares = body.ground.squares(v)
    power = np.sqrt((squares * v**2).sum(axis=-1))
    size = np.sqrt(power**2 + width**2)
    push = squares * v / size[..., None]
    _, slope, _ = body.slopes(x, width)
    if not (np.abs(slope).max(axis=1) < _CREPT).all():
        raise SolveError("no set of resting masses was found that the ground can hold")
    rest = power < _CREEP * width
    return Least(
        x, rest, push, np.where(rest, power / size, 0.0).max(axis=1), np.full(len(x), np.inf)
    )


def _put(least: Least, where: np.ndarray, other: Least) -> None:
    """Put others in the place of some."""
    for field in fields(Least):
        getattr(least, field.name)[where] = getattr(other, field.name)


def check_load(body: LeastPower) -> None:
    """Refuse loads that outrun the ground: even all masses at rest could not hold them."""
    loaded = np.flatnonzero(np.abs(body.load).max(axis=1) > 0)
    if loaded.size:
        most = float(load_gauge(body.of(loaded))[1].max())
        if most >= 1:
            raise SolveError(
                f"the load is {most:.4g} times the largest that the ground can hold: the body "
                "would run off with it, and no slow motion exists"
            )


def near(body: LeastPower, x: np.ndarray, rest: np.ndarray) -> Least:
    """Find them by guesses of the velocities (G, n) and of the resting masses (G, m)."""
    least, open_ = settle(body, x, rest)
    if open_.size:
        _put(least, open_, least_power(body.of(open_)))
    return least


def _slow(body: LeastPower, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Velocities, and which masses hardly move."""
    powers = body.powers(x)
    return x, powers <= _STILL * np.maximum(powers.max(axis=1), 0.1)[:, None]


def settle(body: LeastPower, x: np.ndarray, rest: np.ndarray) -> tuple[Least, np.ndarray]:
    """Change sets of resting masses (G, m) until the ground agrees; and which never did."""
    G, m, _, _ = body.J.shape
    first = body.powers(x)
    least = Least(x.copy(), rest.copy(), np.zeros((G, m, 2)), np.zeros(G), np.full(G, np.inf))
    open_ = np.arange(G)
    for _ in range(m + 4):
        again: list[np.ndarray] = []
        for pattern in np.unique(least.rest[open_], axis=0):
            group = open_[(least.rest[open_] == pattern).all(axis=1)]
            found = held(body.of(group), least.x[group], pattern)
            good = found.fits & found.balances & (found.hold <= 1 + _SLACK)
            for name in ("push", "hold", "stiffness"):
                getattr(least, name)[group] = getattr(found, name)
            least.x[group[good]] = found.x[good]
            least.rest[group[~good]] = _other(body.of(group), found, first[group], pattern)[~good]
            again.append(group[~good])
        open_ = np.sort(np.concatenate(again))
        if not open_.size:
            break
    return least, open_


def _other(body: LeastPower, found: Held, first: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """Sets of resting masses (G, m) to try instead.

    Where the search for a balance got stuck, it did so at a kink: the mass that hardly moved there.
    """
    tried = np.tile(rest, (len(first), 1))
    every = np.arange(len(first))
    fastest = np.where(rest, first, -np.inf).argmax(axis=1)
    slowest = np.where(rest, np.inf, body.powers(found.x)).argmin(axis=1)
    loose = ~found.fits
    tried[every[loose], fastest[loose]] = False
    stuck = found.fits & ~found.balances
    tried[every[stuck], slowest[stuck]] = True
    slack = found.fits & found.balances
    tried[slack] &= ~found.slips[slack]
    return tried
