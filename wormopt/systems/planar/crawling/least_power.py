"""The velocity of a body that takes the least power from dry ground, for many bodies at a time.

Masses move with v_i = b_i + J_i x; sought is the least of sum psi_i(v_i) - load.x, psi being the
norms of `Ground`. Where masses rest the sum has no slope. By convexity a set of resting masses is
the right one if the ground can hold it while the others balance. Without a guess of it every mass
is tried: with one at rest a single number is left, and where none of these motions is held by the
ground no mass rests at all.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from wormopt.errors import SolveError
from wormopt.systems.planar.crawling.balance import LeastPower
from wormopt.systems.planar.crawling.held import FITS, Held, held
from wormopt.systems.planar.crawling.pivots import pivots
from wormopt.systems.planar.crawling.reactions import load_gauge, turned_out

# By so much a gauge may pass 1; masses are tried whose power is as near the least; how often a
# guess is changed. By how much a gauge may pass 1 where rounding keeps a mass from slipping.
_SLACK, _SAME, _CHANGES = 1e-11, 1e-8, 4
_DOUBTFUL = 1e-8
_ALL_BUT = 1e-4
_SLOW = (1e-10, 1e-9, 1e-8)  # powers that rounding may make


def least_power(body: LeastPower) -> Held:
    """Find velocities of least power; SolveError where none exist."""
    check_load(body)
    least = _pivoted(body)
    open_ = np.flatnonzero(~_good(least))
    if open_.size:
        some = body.of(open_)
        moving = _let_go(some, least.of(open_))
        # Where rounding keeps a mass that hardly slips from balance, it is left at rest.
        takes = moving.balances | (least.hold[open_] > 1 + _DOUBTFUL) | ~least.fits[open_]
        least.put(open_[moving.balances], moving.of(moving.balances))
        left = takes & ~moving.balances
        if left.any():
            pivoted = least.of(open_[left])
            least.put(open_[left], _nearly(some.of(left), moving.x[left], pivoted))
    return _settled(body, least)


def _settled(body: LeastPower, least: Held) -> Held:
    """Motions in which masses rest that hardly move, wherever the ground can hold them.

    Of so slow a mass rounding tells the direction: any may seem to balance. At rest it is certain.
    """
    slow = ~least.rest & (body.powers(least.x) < _SLOW[-1])
    some = np.flatnonzero(slow.any(axis=1))
    if some.size:
        rest = least.rest[some] | slow[some]
        tried = held(body.of(some), least.x[some], rest, careful=False)
        good = _good(tried)
        least.put(some[good], tried.of(good))
    return least


def _nearly(body: LeastPower, x: np.ndarray, pivoted: Held) -> Held:
    """Motions in which masses so slow that rounding decides count as at rest.

    They are of least power for velocities changed by as little. Where that does not help, the best
    motion about a mass at rest, if the ground all but holds it.
    """
    least = held(body, x, body.powers(x) < _SLOW[0])
    bad = np.flatnonzero(~(least.balances & (least.hold <= 1 + _SLACK)))
    for slow in _SLOW[1:]:
        if bad.size:
            some = body.of(bad)
            least.put(bad, held(some, x[bad], some.powers(x[bad]) < slow))
        bad = np.flatnonzero(~(least.balances & (least.hold <= 1 + _SLACK)))
    least.put(bad, pivoted.of(bad))
    if not (pivoted.fits & pivoted.balances & (pivoted.hold < 1 + _ALL_BUT))[bad].all():
        raise SolveError("no velocity of least power was found")
    return least


def _pivoted(body: LeastPower) -> Held:
    """The best of the motions about a mass at rest."""
    x, value = pivots(body)
    best = value.min(axis=1)
    of, i = np.nonzero(value <= (best + _SAME * (1 + np.abs(best)))[:, None])
    bodies = body.of(of)
    rest = bodies.powers(x[of, i]) < FITS
    rest[np.arange(len(i)), i] = True
    tried = held(bodies, x[of, i], rest)
    order = np.lexsort((tried.hold, ~(tried.fits & tried.balances), of))
    return tried.of(order[np.append(True, np.diff(of[order]) > 0)])


def _let_go(body: LeastPower, least: Held) -> Held:
    """Motions in which masses at rest go that the ground cannot hold, and no mass rests."""
    way, none = way_out(body, least), np.zeros_like(least.rest)
    seen = body.seen_from(least.x, least.rest)
    start = seen.along(0 * least.x, way).least()[:, None] * way
    moving = held(seen, start, none)
    return replace(moving, x=least.x + moving.x)


def way_out(body: LeastPower, least: Held) -> np.ndarray:
    """Change (G, n) of the velocities with which the masses at rest go first, or resist least."""
    push = least.push * ~least.rest[..., None]
    way = turned_out(body, push, least.rest.argmax(axis=1))[1]
    many = np.flatnonzero(least.rest.sum(axis=1) > 1)
    if many.size:
        some, every = body.of(many), np.tile(np.eye(body.load.shape[1]), (len(many), 1, 1))
        slope = np.einsum("gmcn,gmc->gn", some.J, push[many]) - some.load
        resting = some.restricted(least.x[many], least.rest[many], every)
        way[many] = load_gauge(replace(resting, load=-slope))[3]
    return way


def _good(found: Held) -> np.ndarray:
    """Whether the ground can hold what rests while all else balances."""
    return found.fits & found.balances & (found.hold <= 1 + _SLACK)


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


def near(body: LeastPower, x: np.ndarray, rest: np.ndarray) -> Held:
    """Find them by guesses of the velocities (G, n) and of the resting masses (G, m)."""
    first = body.powers(x)
    least = held(body, x, rest, careful=False)
    open_ = np.flatnonzero(~_good(least))
    for _ in range(_CHANGES):
        if not open_.size:
            return _settled(body, least)
        other = _other(body.of(open_), least.of(open_), first[open_])
        least.put(open_, held(body.of(open_), x[open_], other, careful=False))
        open_ = open_[~_good(least.of(open_))]
    if open_.size:
        least.put(open_, least_power(body.of(open_)))
    return _settled(body, least)


def _other(body: LeastPower, found: Held, first: np.ndarray) -> np.ndarray:
    """Sets of resting masses (G, m) to try instead.

    Where the search for a balance got stuck, it did so at a kink: the mass that hardly moved there.
    """
    rest = found.rest
    tried, every = rest.copy(), np.arange(len(first))
    fastest = np.where(rest, first, -np.inf).argmax(axis=1)
    slowest = np.where(rest, np.inf, body.powers(found.x)).argmin(axis=1)
    loose = ~found.fits
    tried[every[loose], fastest[loose]] = False
    stuck = found.fits & ~found.balances
    tried[every[stuck], slowest[stuck]] = True
    slack = found.fits & found.balances
    tried[slack] &= ~found.slips[slack]
    return tried
