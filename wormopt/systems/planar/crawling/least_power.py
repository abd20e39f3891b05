"""The velocity of a body that takes the least power from dry ground, for many bodies at a time.

Masses move with v_i = b_i + J_i x; sought is the least of sum psi_i(v_i) - load.x, psi being the
norms of `Ground`. Where masses rest the sum has no slope: they are found by smoothed norms, and
then held exactly. By convexity a set of resting masses is the right one if the ground can hold it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wormopt.errors import SolveError
from wormopt.systems.planar.crawling.balance import LeastPower
from wormopt.systems.planar.crawling.held import Held, held, load_gauge

# Slower than this against the fastest, a mass may be at rest; by so much a gauge may pass 1.
_STILL, _SLACK = 1e-6, 1e-9


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
    least, open_ = settle(body, *_slow(body, body.smoothed()))
    if open_.size:
        raise SolveError("no set of resting masses was found that the ground can hold")
    return least


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
        other = least_power(body.of(open_))
        for name in ("x", "rest", "push", "hold", "stiffness"):
            getattr(least, name)[open_] = getattr(other, name)
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
