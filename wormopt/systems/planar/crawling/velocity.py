"""Velocities of bodies that crawl slowly on dry ground: those of least power.

Masses move with v_i = b_i + J_i x. The unknown x minimises sum psi_i(v_i) - load.x, where psi are
the norms of `Ground`. At resting masses the sum has no slope. By convexity a set of resting masses
is the right one if the ground can hold it while the others balance. Without a guess every mass is
tried: with one mass at rest a single unknown is left. If the ground holds none of these motions, no
mass rests.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError, SolveError
from wormopt.model.planar_friction import PlanarLaw
from wormopt.systems.planar.crawling.balance import (
    RANK,
    Ground,
    LeastPower,
    ground_of,
    load_gauge,
    pivots,
    reactions,
    turned_out,
)
from wormopt.systems.planar.shape import Shape, kinematics_at

FITS = 1e-12  # residual velocities of masses that can rest together
_NARROW = 10.0 ** -np.arange(0, 12)


@dataclass(frozen=True, eq=False)
class Held:
    """Bodies with some masses held."""

    x: np.ndarray  # (G, n)
    rest: np.ndarray  # (G, m), the masses held
    fits: np.ndarray  # (G,), whether these masses can rest at once
    balances: np.ndarray  # (G,), whether the others, all moving, balance
    v: np.ndarray  # (G, m, 2), velocities
    push: np.ndarray  # (G, m, 2), push of each mass on the ground
    hold: np.ndarray  # (G,), least possible largest gauge of the held masses' pushes
    slips: np.ndarray  # (G, m), which of them slip if the ground cannot hold all
    stiffness: np.ndarray  # (G,), least curvature in remaining unknowns, infinite without any

    def put(self, where: np.ndarray, other: Held) -> None:
        """Replace some bodies by others."""
        for field in fields(Held):
            getattr(self, field.name)[where] = getattr(other, field.name)

    def of(self, points: np.ndarray) -> Held:
        """Return some of the bodies."""
        return Held(*(getattr(self, field.name)[points] for field in fields(Held)))


def freedom(body: LeastPower, x: np.ndarray, rest: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return the nearest `x` (G, n) with masses `rest` (G, m) at rest, free and fixed directions.

    Both directions are square (G, n, n), in columns and in rows, padded with zeros.
    """
    G, n = x.shape
    near, free, hindered = x.copy(), np.tile(np.eye(n), (G, 1, 1)), np.zeros((G, n, n))
    some = np.flatnonzero(rest.any(axis=1))
    if some.size:
        of = rest[some, :, None]
        JS = (body.J[some] * of[..., None]).reshape(len(some), -1, n)
        off = (body.velocities(x)[some] * of).reshape(len(some), -1)
        if JS.shape[1] < n:  # a single mass
            JS = np.concatenate([JS, np.zeros((len(some), n - JS.shape[1], n))], axis=1)
            off = np.concatenate([off, np.zeros((len(some), JS.shape[1] - off.shape[1]))], axis=1)
        columns, sizes, rows = np.linalg.svd(JS, full_matrices=False)
        in_way = sizes > RANK * sizes[:, :1]
        parts = np.einsum("gkn,gk->gn", columns, off)
        parts = np.divide(parts, sizes, np.zeros_like(parts), where=in_way)
        near[some] -= np.einsum("gnk,gn->gk", rows, parts)
        hindered[some] = rows * in_way[..., None]
        free[some] = (rows * ~in_way[..., None]).transpose(0, 2, 1)
    return near, free, hindered


def held(body: LeastPower, x: np.ndarray, rest: np.ndarray, *, careful: bool = True) -> Held:
    """Minimise the power with the masses `rest` (G, m) held, starting at `x` (G, n).

    `careful`: if the others do not balance at once, smoothing is used.
    """
    G, n = x.shape
    x, N, Q = freedom(body, x, rest)
    go = ~rest
    fits = np.abs(body.velocities(x) * rest[..., None]).max(axis=(1, 2), initial=0.0) < FITS
    balances, stiffness, v = np.ones(G, bool), np.full(G, np.inf), body.velocities(x)
    loose = np.flatnonzero((np.abs(N).max(axis=(1, 2), initial=0.0) > 0) & go.any(axis=1))
    if loose.size:
        free = body.of(loose).restricted(x[loose], go[loose], N[loose])
        z, v[loose], found = _from_lines(free, N[loose])
        if careful and not found.all():  # a mass that hardly moves needs a careful approach
            bad = free.of(~found)
            again = np.flatnonzero(~found)
            z[again], v[loose[again]], found[again] = bad.sharp(bad.smoothed(_NARROW))
        curvature = np.nan_to_num(free.slopes(z)[2])
        absent = np.eye(n) * (np.abs(N[loose]).max(axis=1) == 0)[:, None]
        most = np.trace(curvature, axis1=1, axis2=2)[:, None, None]
        stiffness[loose] = np.linalg.eigvalsh(curvature + (1 + most) * absent)[:, 0]
        balances[loose] = found
        x[loose] += (N[loose] @ z[..., None])[..., 0]
    power = np.maximum(body.ground.power(v), 1e-100)
    push = np.where(rest[..., None], 0.0, body.ground.squares(v) * v / power[..., None])
    slope = np.einsum("gmcn,gmc->gn", body.J, push) - body.load
    hold, slips = np.zeros(G), np.zeros(rest.shape, bool)
    counts = rest.sum(axis=1)
    for k in np.unique(counts[counts > 0]):
        some = np.flatnonzero(counts == k)
        which = np.argsort(~rest[some], axis=1, kind="stable")[:, :k]
        at = (some[:, None], which)
        ground = body.ground
        ground = ground.of(which if ground.forward.ndim == 1 else at)
        resting = LeastPower(body.J[at], body.b[at], -slope[some], ground)
        push[at], hold[some], slips[at] = reactions(resting, Q[some])
    return Held(x, rest.copy(), fits, balances, v, push, hold, slips, stiffness)


def _from_lines(body: LeastPower, N: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return least power (G, n) in the directions N (G, n, n), its velocities, and a flag."""
    z, v, found = body.sharp(np.zeros(body.load.shape))
    ways = np.abs(N).max(axis=1) > 0
    one = np.flatnonzero(~found & (ways.sum(axis=1) == 1))
    if one.size:
        line = body.of(one)
        way = ways[one].astype(float)
        start = line.along(0 * way, way).least()[:, None] * way
        z[one], v[one], found[one] = line.sharp(start)
    return z, v, found


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


_EVEN, _ASIDE = 1e-8, 1e-2


@dataclass(frozen=True, eq=False)
class Motion:
    """Motion of a body at G instants."""

    twist: np.ndarray  # (G, 3), velocity of the frame in the frame, and its angular velocity
    rest: np.ndarray  # (G, m), whether a mass rests
    velocities: np.ndarray  # (G, m, 2), along each mass' heading and to its left
    forces: np.ndarray  # (G, m, 2), of the ground on the worm, in the same directions
    hold: np.ndarray  # (G,), friction of resting masses relative to its limit
    power: np.ndarray  # (G,), dissipated by the ground


@dataclass(frozen=True, eq=False)
class Bodies:
    """Bodies in units that scale forces, velocities and lengths to 1, and these units."""

    body: LeastPower
    speed: np.ndarray  # (G,)
    sizes: np.ndarray  # (G, 3), scale factors of the twist

    def scaled(self, twist: np.ndarray) -> np.ndarray:
        """Return a twist in these units."""
        return twist * self.sizes / self.speed[:, None]


@dataclass(frozen=True, eq=False)
class Crawler:
    """A body on its ground, which maps shapes and rates to motions."""

    shape: Shape
    ground: Ground
    load: np.ndarray  # (3,), force and moment on the frame, in the frame

    @classmethod
    def of(cls, shape: Shape, laws: PlanarLaw | Sequence[PlanarLaw], load: ArrayLike) -> Crawler:
        """Return a crawler from its laws."""
        given = np.asarray(load, dtype=float)
        if given.shape != (3,) or not np.isfinite(given).all():
            raise ArgumentError(f"load must be two forces and a moment, not {load}")
        ground = ground_of(laws, shape.n_points).bounded(float(np.hypot(*given[:2])))
        return cls(shape, ground, given)

    @property
    def force(self) -> float:
        """Usual resistance of a mass."""
        return float(self.ground.sideways.mean())

    def bodies(self, s: np.ndarray, ds: np.ndarray) -> Bodies:
        """Return bodies at shapes (G, n_s) and rates."""
        G, m = len(s), self.shape.n_points
        at = kinematics_at(self.shape, s)
        J, b = at.J.reshape(G, m, 2, 3), (at.B @ ds[..., None]).reshape(G, m, 2)
        speed = np.abs(b).max(axis=(1, 2))
        speed[speed == 0] = 1.0
        length = np.sqrt((J[..., 2] ** 2).sum(axis=2).mean(axis=1))
        sizes = np.stack([np.ones(G), np.ones(G), length], axis=1)
        load = self.load / sizes / self.force
        body = LeastPower(
            J / sizes[:, None, None, :], b / speed[:, None, None], load, self.ground.by(self.force)
        )
        return Bodies(body, speed, sizes)

    def move(self, s: np.ndarray, ds: np.ndarray) -> Motion:
        """Return motions of least power; refuse motions that are not unique."""
        motion, open_ = self.sought(s, ds)
        refuse_open(self.shape, s, open_)
        return motion

    def sought(self, s: np.ndarray, ds: np.ndarray) -> tuple[Motion, np.ndarray]:
        """Return motions of least power, and whether (G,) they are not unique."""
        bodies = self.bodies(s, ds)
        least = least_power(bodies.body)
        return self._motion(bodies, least), open_instants(bodies.body, least)

    def follow(self, s: np.ndarray, ds: np.ndarray, rest: np.ndarray, twist: np.ndarray) -> Motion:
        """Return motions from guesses (G, m) of the resting masses and (G, 3) of the twist."""
        bodies = self.bodies(s, ds)
        return self._motion(bodies, near(bodies.body, bodies.scaled(twist), rest))

    def _motion(self, bodies: Bodies, least: Held) -> Motion:
        """Return the motion in the units of the caller."""
        v = np.where(least.rest[..., None], 0.0, least.v)
        power = bodies.body.ground.power(v).sum(axis=1) * bodies.speed * self.force
        return Motion(
            least.x / bodies.sizes * bodies.speed[:, None],
            least.rest,
            v * bodies.speed[:, None, None],
            -least.push * self.force,
            least.hold,
            power,
        )


def open_instants(body: LeastPower, least: Held) -> np.ndarray:
    """Return whether (G,) other velocities have as little power."""
    at_limit = least.rest.any(axis=1) & (np.abs(least.hold - 1) < _EVEN)
    open_ = least.stiffness < _EVEN
    some = np.flatnonzero(at_limit & ~open_)
    if some.size:
        tried, limit = body.of(some), least.of(some)
        way = way_out(tried, limit)
        way *= _ASIDE / np.abs(way).max(axis=1)[:, None]
        x = limit.x + way
        # While the resting masses slip, the others turn with least power.
        turning = freedom(tried, limit.x, limit.rest)[1].sum(axis=2)
        x += tried.along(x, turning).least()[:, None] * turning
        more = tried.smooth_value(x, 0.0) - tried.smooth_value(limit.x, 0.0)
        open_[some] = more < _EVEN * _ASIDE
    return open_


def refuse_open(shape: Shape, s: np.ndarray, open_: np.ndarray) -> None:
    """Refuse instants at which the motion is not unique."""
    if open_.any():
        first = s[np.flatnonzero(open_)[0]]
        named = zip(shape.names, first, strict=True)
        at = ", ".join(f"{name} {value:.4g}" for name, value in named)
        raise SolveError(
            f"the motion is not unique at {open_.sum()} of {len(open_)} instants, the first at "
            f"{at}: other velocities have as little power. Links of one length may turn in place "
            "of each other, or masses of a straight chain that move forward may have the same "
            "resistance as those that move backward",
            "change the resistance of a mass, or the length of an end link, by 1 %, or let the "
            "stroke avoid this shape",
        )


def crawl_velocity(
    shape: Shape,
    laws: PlanarLaw | Sequence[PlanarLaw],
    s: ArrayLike,
    ds: ArrayLike,
    *,
    load: ArrayLike = (0.0, 0.0, 0.0),
) -> Motion:
    """Return the velocity of a body that crawls so slowly that its inertia does not matter.

    Theory: docs/theory-planar.md, section 3.

    Parameters
    ----------
    shape : Shape
        Points of the body by its shape variables.
    laws : Elliptic, or sequence of Elliptic
        Friction law of all masses, or of each.
    s, ds : array_like, shape (G, n_s) or (n_s,)
        Shapes (lengths, angles in rad), and their rates.
    load : array_like, shape (3,), optional
        Force on the frame of the body, along its heading and to the left, and moment.

    Returns
    -------
    Motion
        Twists, resting masses, velocities and forces, at G instants.

    Raises
    ------
    ArgumentError
        If dimensions differ, or a law has no principle of least power.
    SolveError
        If the ground cannot hold the load, or the motion is not unique.

    Examples
    --------
    >>> import wormopt as wo
    >>> from wormopt.model.planar_friction import Elliptic
    >>> worm = wo.planar.chain_shape(3, lengths=(1.0, 1.0, 1.0))
    >>> motion = wo.planar.crawl_velocity(worm, Elliptic(1.0, 1.0, 3.0), [0.8, 0.6], [-0.6, 0.8])
    >>> bool(abs(motion.forces.sum(axis=1)).max() < 10)
    True
    """
    crawler = Crawler.of(shape, laws, load)
    shapes, rates = (np.atleast_2d(np.asarray(x, dtype=float)) for x in (s, ds))
    return crawler.move(shapes, rates)
