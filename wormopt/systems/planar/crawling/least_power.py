"""Velocities of bodies on dry ground with the least power, for many bodies at a time.

Masses move with v_i = b_i + J_i x. The unknown x minimises sum psi_i(v_i) - load.x, where psi are
the norms of `Ground`. At resting masses the sum has no slope. By convexity a set of resting masses
is the right one if the ground can hold it while the others balance. Without a guess every mass is
tried: with one mass at rest a single unknown is left. If the ground holds none of these motions, no
mass rests.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from wormopt.errors import SolveError
from wormopt.systems.planar.crawling.balance import LeastPower
from wormopt.systems.planar.crawling.held import FITS, Held, held
from wormopt.systems.planar.crawling.pivots import pivots
from wormopt.systems.planar.crawling.reactions import load_gauge, turned_out

# Accepted excess of a gauge over 1; relative power up to which masses are tried; largest number of
# changes of a guess. Accepted excess of a gauge where round-off keeps a mass from slipping.
_SLACK, _SAME, _CHANGES = 1e-11, 1e-8, 4
_DOUBTFUL = 1e-8
_ALL_BUT = 1e-4
_SLOW = (1e-10, 1e-9, 1e-8)  # powers due to round-off


def least_power(body: LeastPower) -> Held:
    """Return velocities of least power; raises SolveError if none exist."""
    check_load(body)
    least = _pivoted(body)
    open_ = np.flatnonzero(~_good(least))
    if open_.size:
        some = body.of(open_)
        moving = _let_go(some, least.of(open_))
        # A mass that hardly slips, and that round-off keeps from balance, is set at rest.
        takes = moving.balances | (least.hold[open_] > 1 + _DOUBTFUL) | ~least.fits[open_]
        least.put(open_[moving.balances], moving.of(moving.balances))
        left = takes & ~moving.balances
        if left.any():
            pivoted = least.of(open_[left])
            least.put(open_[left], _nearly(some.of(left), moving.x[left], pivoted))
    return _settled(body, least)


def _settled(body: LeastPower, least: Held) -> Held:
    """Return motions with masses that hardly move set at rest, if the ground can hold them.

    Round-off determines the direction of a slow mass: any may seem to balance. Rest is certain.
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
    """Return motions in which masses whose slow motion is due to round-off count as resting.

    They have least power for velocities changed by as little. If that fails, the result is the best
    motion about a resting mass that the ground almost holds.
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
    """Return the best of the motions about a resting mass."""
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
    """Return motions in which resting masses beyond their limit slip, and no mass rests."""
    way, none = way_out(body, least), np.zeros_like(least.rest)
    seen = body.seen_from(least.x, least.rest)
    start = seen.along(0 * least.x, way).least()[:, None] * way
    moving = held(seen, start, none)
    return replace(moving, x=least.x + moving.x)


def way_out(body: LeastPower, least: Held) -> np.ndarray:
    """Return the change (G, n) of velocities in which resting masses slip first."""
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
    """Return whether the ground can hold resting masses while all else balances."""
    return found.fits & found.balances & (found.hold <= 1 + _SLACK)


def check_load(body: LeastPower) -> None:
    """Refuse loads that the ground cannot hold even with all masses at rest."""
    loaded = np.flatnonzero(np.abs(body.load).max(axis=1) > 0)
    if loaded.size:
        most = float(load_gauge(body.of(loaded))[1].max())
        if most >= 1:
            raise SolveError(
                f"the load is {most:.4g} times the largest that the ground can hold, so no slow "
                "motion exists"
            )


def near(body: LeastPower, x: np.ndarray, rest: np.ndarray) -> Held:
    """Find motions from guesses of the velocities (G, n) and of the resting masses (G, m)."""
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
    """Return other sets of resting masses (G, m) to try.

    If the search for a balance stopped, it did so at a kink: at the mass that hardly moved there.
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
