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
from wormopt.systems.planar.crawling.reactions import split_pair

# Slower than this against the fastest, a mass may be at rest; by so much a gauge may pass 1.
_STILL, _SLACK = 1e-6, 1e-9
# Smoothing where that does not tell. Where nothing does: by how much of the smoothing masses at
# rest creep, and forces that rounding leaves.
_FINER, _CREEP, _CREPT = 10.0 ** -np.arange(8.5, 11.1, 0.5), 100.0, 1e-5
_FITS = 1e-10  # rates at which masses part that can rest together
_BALANCED = 1e-9  # forces that are left
_RANK, _ROUNDING, _SLOWEST = 1e-9, 1e-14, 1e-9
_NARROW = 10.0 ** -np.arange(0, 12)


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


# -- some masses held ----------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Held:
    """Bodies of which some masses are held."""

    x: np.ndarray  # (G, n)
    fits: np.ndarray  # (G,), whether these masses can rest at once
    balances: np.ndarray  # (G,), whether the others, all moving, balance
    push: np.ndarray  # (G, m, 2), what each mass pushes against the ground with
    hold: np.ndarray  # (G,), least largest gauge of the pushes of the masses held
    slips: np.ndarray  # (G, m), which of them slip when the ground cannot hold all
    stiffness: np.ndarray  # (G,), least curvature where unknowns are left, infinite where none


def held(body: LeastPower, x: np.ndarray, rest: np.ndarray, *, careful: bool = True) -> Held:
    """Least power where the masses `rest` (m,) are held, begun at `x` (G, n).

    `careful`: where the others do not balance at once, they are approached by smoothing.
    """
    G, n = x.shape
    if not rest.any():
        every, none = np.tile(np.eye(n), (G, 1, 1)), np.zeros((G, 0, n))
        return _free(body, x, rest, every, none, careful)
    JS = body.J[:, rest].reshape(G, -1, n)
    _, sizes, rows = np.linalg.svd(JS)
    ranks = (sizes > _RANK * sizes[:, :1]).sum(axis=1)
    off = body.velocities(x)[:, rest].reshape(G, -1)
    x = x - (np.linalg.pinv(JS, rcond=_RANK) @ off[..., None])[..., 0]
    parts = [np.flatnonzero(ranks == rank) for rank in np.unique(ranks)]
    found = []
    for part, rank in zip(parts, np.unique(ranks), strict=True):
        free, hindered = rows[part, rank:].transpose(0, 2, 1), rows[part, :rank]
        found.append(_free(body.of(part), x[part], rest, free, hindered, careful))
    return _joined(found, np.concatenate(parts))


def _joined(found: list[Held], order: np.ndarray) -> Held:
    """Bodies in their order again."""
    back = np.argsort(order)
    return Held(
        *(np.concatenate([getattr(one, f.name) for one in found])[back] for f in fields(Held))
    )


def _free(
    body: LeastPower, x: np.ndarray, rest: np.ndarray, N: np.ndarray, Q: np.ndarray, careful: bool
) -> Held:
    """Let the other masses move along N (G, n, k), free of those held, whose rows Q span."""
    G, go = len(x), ~rest
    fits = np.abs(body.velocities(x)[:, rest]).max(axis=(1, 2), initial=0.0) < _FITS
    balances, stiffness = np.ones(G, bool), np.full(G, np.inf)
    if N.shape[2] and go.any():
        free = body.restricted(x, go, N)
        z, balances = free.sharp(np.zeros((G, N.shape[2])))
        if careful and not balances.all():  # a mass that hardly moves needs a careful approach
            bad = free.of(~balances)
            z[~balances], balances[~balances] = bad.sharp(bad.smoothed(_NARROW))
        _, left, curvature = free.slopes(z)
        # The direction of a mass that hardly moves is known no better than its velocity.
        slowest = np.maximum(free.powers(z).min(axis=1), _SLOWEST)
        balances &= np.abs(left).max(axis=1) < np.maximum(_BALANCED, _ROUNDING / slowest)
        stiffness = np.linalg.eigvalsh(np.nan_to_num(curvature))[:, 0]
        x = x + (N @ z[..., None])[..., 0]
    v = body.velocities(x)
    power = np.maximum(body.ground.power(v), 1e-300)
    push = np.where(rest[:, None], 0.0, body.ground.squares(v) * v / power[..., None])
    hold, slips = np.zeros(G), np.zeros((G, len(rest)), bool)
    if rest.any():
        slope = np.einsum("gmcn,gmc->gn", body.J, push) - body.load
        push[:, rest], hold, slips[:, rest] = reactions(body, rest, Q, slope)
    return Held(x, fits, balances, push, hold, slips, stiffness)


def reactions(
    body: LeastPower, rest: np.ndarray, Q: np.ndarray, slope: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pushes (G, k, 2) of least largest gauge that balance `slope`, that gauge, and who slips.

    Q (G, r, n) spans what resting masses hinder.
    """
    G, n = slope.shape
    k, ground, JS = int(rest.sum()), body.ground.of(rest), body.J[:, rest]
    rows = JS.reshape(G, 2 * k, n)
    if k == 1 or (k == 2 and Q.shape[1] == 3):
        across = rows.transpose(0, 2, 1)
        push = (np.linalg.pinv(across) @ -slope[..., None]).reshape(G, k, 2)
        if k == 2:
            return split_pair(push, np.linalg.svd(across)[2][:, -1].reshape(G, 2, 2), ground)
        return push, ground.gauge(push)[:, 0], np.ones((G, 1), bool)
    g = (Q @ slope[..., None])[..., 0]
    some = np.flatnonzero(np.linalg.norm(g, axis=1) > 1e-13)
    push, hold, slips = np.zeros((G, k, 2)), np.zeros(G), np.zeros((G, k), bool)
    if some.size:
        reduced = LeastPower(
            (rows[some] @ Q[some].transpose(0, 2, 1)).reshape(len(some), k, 2, -1),
            np.zeros((len(some), k, 2)),
            -g[some],
            ground,
        )
        push[some], hold[some], slips[some] = load_gauge(reduced)
    return push, hold, slips


def load_gauge(body: LeastPower) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """How much of what all masses at rest can hold a load is, by duality.

    It is the largest load.x among motions x that take the power 1. Gives the pushes (G, m, 2),
    the gauge (G,), and which masses slip first (G, m).
    """
    size = np.linalg.norm(body.load, axis=1)
    along = body.load / size[:, None] ** 2
    M = np.linalg.svd(body.load[:, None, :])[2][:, 1:].transpose(0, 2, 1)
    inner = body.restricted(along, np.ones(body.J.shape[1], bool), M)
    # Motions along the load alone, and its unit, as they are for a body without load.
    b = np.einsum("gmcn,gn->gmc", body.J, along)
    scale = np.abs(b).max(axis=(1, 2))
    inner = LeastPower(inner.J, b / scale[:, None, None], np.zeros_like(inner.load), body.ground)
    least = least_power(inner)
    worth = inner.powers(least.x).sum(axis=1) * scale
    return least.push / worth[:, None, None], 1 / worth, ~least.rest
