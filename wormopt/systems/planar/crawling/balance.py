"""Power of bodies on dry ground as functions to minimise, and pushes of masses at rest.

Bodies are many at a time. Resistances below the masses are arrays (`Ground`); pushes of resting
masses are distributed as evenly as the ground allows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wormopt.errors import ArgumentError
from wormopt.model.planar_friction import Elliptic, PlanarLaw

_TINY = 1e-100
_DOUBLED, _LAST = 60, 1e-17


@dataclass(frozen=True, eq=False)
class Line:
    """Problem of G bodies: minimise sum psi_i(v_i + w a_i) - w load over w.

    Arrays are (m, G), masses first, which makes sums over them fast.
    """

    v: np.ndarray  # along the headings
    v_n: np.ndarray  # to the left, times the resistance there
    a: np.ndarray
    a_n: np.ndarray
    ahead: np.ndarray  # resistances
    back: np.ndarray
    load: np.ndarray  # (G,)

    def slope(self, w: np.ndarray) -> np.ndarray:
        """Return the slope (G,) at w (G,), which never falls and jumps where masses stop."""
        along, aside = self.v + w * self.a, self.v_n + w * self.a_n
        force = np.where(along >= 0, self.ahead, self.back)
        along *= force
        size = np.maximum(np.hypot(along, aside), _TINY)
        return ((along * force * self.a + aside * self.a_n) / size).sum(axis=0) - self.load

    def least(self) -> np.ndarray:
        """Return the minimum (G,) by bisection to the last digit, the most reliable method."""
        force = np.where(self.v >= 0, self.ahead, self.back)
        square = (force * self.a) ** 2 + self.a_n**2
        product = force**2 * self.v * self.a + self.v_n * self.a_n
        stops = np.divide(-product, square, np.zeros_like(square), where=square > 0)
        low, high = stops.min(axis=0), stops.max(axis=0)
        gap = high - low + np.abs(stops).max(axis=0) + _TINY
        low, high = self._beyond(low, -gap), self._beyond(high, gap)
        while (high - low > _LAST * gap).any():
            middle = (low + high) / 2
            if not ((low < middle) & (middle < high)).any():
                break
            up = self.slope(middle) < 0
            low, high = np.where(up, middle, low), np.where(up, high, middle)
        return self._stopped(low, high, stops, gap)

    def _beyond(self, end: np.ndarray, reach: np.ndarray) -> np.ndarray:
        """Return an end of the bracket, moved out until the slope leads back."""
        for _ in range(_DOUBLED):
            out = np.sign(reach) * self.slope(end) < 0
            if not out.any():
                break
            end = np.where(out, end + reach, end)
            reach = 2 * reach
        return end

    def _stopped(
        self, low: np.ndarray, high: np.ndarray, stops: np.ndarray, gap: np.ndarray
    ) -> np.ndarray:
        """Return the better end of the last bracket, or the stop of a mass beside it."""
        w = np.where(np.abs(self.slope(low)) < np.abs(self.slope(high)), low, high)
        off = np.abs(stops - w)
        nearest = np.take_along_axis(stops, off.argmin(axis=0)[None], axis=0)[0]
        return np.where(off.min(axis=0) < 1e-15 * gap, nearest, w)


@dataclass(frozen=True, eq=False)
class Ground:
    """Resistances of the masses, each an array (m,), or (G, m) if bodies differ."""

    forward: np.ndarray
    backward: np.ndarray
    sideways: np.ndarray

    def squares(self, v: np.ndarray) -> np.ndarray:
        """Return squared resistances for velocities or forces of the worm (..., m, 2)."""
        along = np.where(v[..., 0] >= 0, self.forward, self.backward)
        return np.stack([along, np.broadcast_to(self.sideways, along.shape)], axis=-1) ** 2

    def power(self, v: np.ndarray) -> np.ndarray:
        """Return the power of each mass (..., m) that slides with velocity `v` (..., m, 2)."""
        return np.sqrt((self.squares(v) * v**2).sum(axis=-1))

    def gauge(self, push: np.ndarray) -> np.ndarray:
        """Return the pushes (..., m) on the ground relative to their limit."""
        return np.sqrt((push**2 / self.squares(push)).sum(axis=-1))

    def of(self, index: np.ndarray | tuple[np.ndarray | slice | None, ...]) -> Ground:
        """Return the ground below some of the masses, or of some of the bodies."""
        return Ground(self.forward[index], self.backward[index], self.sideways[index])

    def of_bodies(self, points: np.ndarray) -> Ground:
        """Return the ground of some of the bodies, if they differ."""
        return self.of(points) if self.forward.ndim == 2 else self

    def by(self, force: float) -> Ground:
        """Return the ground in units of a force."""
        return Ground(self.forward / force, self.backward / force, self.sideways / force)

    def bounded(self, load: float) -> Ground:
        """Return a ground (m,) with the same motions, without a resistance that pins a mass.

        A mass rests that resists more than all others and the load can push. Its resistance has no
        further effect, but much larger ones than the others leave no digits to them.
        """
        each = np.stack([self.forward, self.backward, self.sideways])
        most = each.max(axis=0)
        others = np.array([np.delete(most, i).sum() for i in range(len(most))]) + load
        top = np.where(each.min(axis=0) > others, 2 * others, np.inf)
        return Ground(*np.minimum(each, np.where(others > 0, top, np.inf)))

    @property
    def one_sided(self) -> np.ndarray:
        """Masses with unequal forward and backward resistances."""
        return self.forward != self.backward


def ground_of(laws: PlanarLaw | Sequence[PlanarLaw], n_points: int) -> Ground:
    """Return resistances of one law for all masses, or of one for each; refuse other laws."""
    each = [laws] * n_points if isinstance(laws, PlanarLaw) else list(laws)
    if len(each) != n_points:
        raise ArgumentError(f"{len(each)} laws for {n_points} masses; give one, or one for each")
    for law in each:
        if not isinstance(law, Elliptic):
            raise ArgumentError(
                f"{type(law).__name__} has no principle of least power, so the velocity of a slow "
                "crawl need not be unique nor exist; use Elliptic with the same parameters"
            )
    names = ("forward", "backward", "sideways")
    return Ground(*(np.array([float(getattr(law, name)) for law in each]) for name in names))


WIDTHS = 10.0 ** -np.arange(0, 9)
_FARTHEST = 1e3
_STOPPED = 1e-13  # powers of masses that do not move
# Residual forces, residual steps, and speeds below which directions are smoothed.
_BALANCED, _NEAR, _SLOW = 1e-9, 1e-11, 1e-6
_STEPS, _SHORTENED, _SHARP, _SHARPENED, _ROUNDING, _LEVEL = 60, 40, 25, 12, 1e-13, 3e-15


@dataclass(frozen=True, eq=False)
class LeastPower:
    """Problem of G bodies: minimise sum psi_i(b_i + J_i x) - load.x over x (n,).

    Values are scaled to size 1.
    """

    J: np.ndarray  # (G, m, 2, n)
    b: np.ndarray  # (G, m, 2)
    load: np.ndarray  # (G, n)
    ground: Ground

    def of(self, points: np.ndarray) -> LeastPower:
        """Return some of the bodies."""
        ground = self.ground.of_bodies(points)
        return LeastPower(self.J[points], self.b[points], self.load[points], ground)

    def velocities(self, x: np.ndarray) -> np.ndarray:
        """Return velocities (G, m, 2) of the masses."""
        return self.b + np.einsum("gmcn,gn->gmc", self.J, x)

    def powers(self, x: np.ndarray) -> np.ndarray:
        """Return powers (G, m) dissipated by the ground."""
        return self.ground.power(self.velocities(x))

    def slopes(
        self, x: np.ndarray, width: float = 0.0
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return value (G,), slope (G, n) and curvature (G, n, n) of the smoothed sum."""
        G, m, _, n = self.J.shape
        v = self.velocities(x)
        squares = self.ground.squares(v)
        push = squares * v
        size = np.maximum(np.sqrt((push * v).sum(axis=-1) + width**2), _TINY)[..., None]
        push = push / size
        value = size.sum(axis=(1, 2)) - (self.load * x).sum(axis=1)
        J = self.J.reshape(G, 2 * m, n)
        slope = (push.reshape(G, 1, -1) @ J)[:, 0] - self.load
        pull = (push[..., None] * self.J).sum(axis=2)
        first = ((squares / size).reshape(G, -1, 1) * J).transpose(0, 2, 1) @ J
        return value, slope, first - pull.transpose(0, 2, 1) @ (pull / size)

    def smooth_value(self, x: np.ndarray, width: float) -> np.ndarray:
        """Return the value of the smoothed sum."""
        v = self.velocities(x)
        size = np.sqrt((self.ground.squares(v) * v**2).sum(axis=-1) + width**2)
        return size.sum(axis=1) - (self.load * x).sum(axis=1)

    def restricted(self, x: np.ndarray, go: np.ndarray, N: np.ndarray) -> LeastPower:
        """Return the problem of masses that `go` (G, m), for x plus N (G, n, k) times unknowns."""
        of = go[..., None]
        return LeastPower(
            np.einsum("gmcn,gnk->gmck", self.J * of[..., None], N),
            self.velocities(x) * of,
            np.einsum("gnk,gn->gk", N, self.load),
            self.ground,
        )

    def along(self, x: np.ndarray, way: np.ndarray) -> Line:
        """Return the problem on lines from `x` (G, n) along `way`."""
        v, by = self.velocities(x), np.einsum("gmcn,gn->gmc", self.J, way)
        ground = self.ground
        ahead, back, aside = (
            np.broadcast_to(f, v.shape[:2]).T
            for f in (ground.forward, ground.backward, ground.sideways)
        )
        return Line(
            v[..., 0].T, aside * v[..., 1].T, by[..., 0].T, aside * by[..., 1].T,
            ahead, back, (self.load * way).sum(axis=1),
        )  # fmt: skip

    def smoothed(self, widths: np.ndarray = WIDTHS, x: np.ndarray | None = None) -> np.ndarray:
        """Minimise sum sqrt(psi_i^2 + width^2) - load.x for decreasing widths, from `x` on."""
        x = self._squares() if x is None else x
        for width in widths:
            x = self.descended(x, float(width), 1e-9)
        return x

    def sharp(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Minimise the power without smoothing from `x` on; flag where no mass stops.

        The second of three results has velocities (G, m, 2) in balance, which round-off of `x`
        would blur.
        """
        x, found = _sharpened(self, x)
        v = self.velocities(x)
        free = np.abs(self.J).max(axis=(2, 3), initial=0.0) > 0
        slowest = np.where(free, self.powers(x), 1.0).min(axis=1)
        left = np.flatnonzero(~found & (slowest < _SLOW))
        if left.size:
            # Round-off blurs the direction of a mass that hardly moves; relative to x it does not.
            bad = self.of(left).seen_from(x[left], np.zeros((len(left), self.b.shape[1]), bool))
            z, found[left] = _sharpened(bad, np.zeros(bad.load.shape))
            x[left] += z
            v[left] = bad.velocities(z)
            slowest[left] = np.where(free[left], bad.powers(z), 1.0).min(axis=1)
        return x, v, found & (slowest > _STOPPED)  # pushes of resting masses may balance as well

    def seen_from(self, x: np.ndarray, rest: np.ndarray) -> LeastPower:
        """Return the problem for changes of `x` (G, n), with the masses `rest` (G, m) at rest."""
        return replace(self, b=self.velocities(x) * ~rest[..., None])

    def descended(self, x: np.ndarray, width: float, last: float) -> np.ndarray:
        """Minimise a convex sum by Newton's steps, each shortened until it descends.

        `numerics.newton` reduces the slope, which is bounded far out, so it would diverge.
        """
        x = x.copy()
        free = np.abs(self.J).max(axis=(2, 3), initial=0.0) > 0
        open_ = np.arange(len(x))
        for _ in range(_STEPS if width else _SHARP):
            body = self.of(open_)
            value, slope, curvature = body.slopes(x[open_], width)
            step = _step(slope, curvature)
            # Between kinks a sum along one line is linear: the step would diverge.
            most = _FARTHEST * (1 + np.abs(x[open_]).max(axis=1))
            step *= np.minimum(1, most / np.maximum(np.abs(step).max(axis=1), _TINY))[:, None]
            small = np.abs(step).max(axis=1) < last * (1 + np.abs(x[open_]).max(axis=1))
            if not width:  # the direction of a slow mass depends on equally small steps
                slow = np.where(free[open_], body.powers(x[open_]), 1.0).min(axis=1) / _SLOW
                small &= np.abs(step).max(axis=1) < last * np.minimum(1, slow)
            # With little curvature, round-off of the slope moves the minimum by more than that.
            small |= np.abs(slope).max(axis=1) < _LEVEL
            x[open_[small]] += step[small]
            body, open_, step = body.of(~small), open_[~small], step[~small]
            if not open_.size:
                break
            factor = body.shortened(x[open_], step, value[~small], slope[~small], width)
            x[open_] += factor[:, None] * step
            open_ = open_[factor > 0]
            if not open_.size:
                break
        return x

    def shortened(
        self, x: np.ndarray, step: np.ndarray, value: np.ndarray, slope: np.ndarray, width: float
    ) -> np.ndarray:
        """Return the factor of each step; 0 if none descends.

        Values are less accurate than slopes: near the minimum they differ by round-off only.
        """
        falls = (slope * step).sum(axis=1)
        level = _ROUNDING * np.abs(value)
        factor, worse = np.ones(len(x)), np.arange(len(x))
        for _ in range(_SHORTENED if width else _SHARPENED):
            part = self.of(worse)
            by = factor[worse, None] * step[worse]
            tried = part.smooth_value(x[worse] + by, width)
            clear = -factor[worse] * falls[worse] > level[worse]
            good = clear & (tried <= value[worse] + 1e-4 * factor[worse] * falls[worse])
            doubt = ~good & (tried <= value[worse] + level[worse])
            if doubt.any():
                some = worse[doubt]
                after = self.of(some).slopes(x[some] + by[doubt], width)[1]
                good[doubt] = np.abs((after * step[some]).sum(axis=1)) <= -falls[some] / 2
            worse = worse[~good]
            if not worse.size:
                return factor
            factor[worse] /= 2
        factor[worse] = 0.0
        return factor

    def _squares(self) -> np.ndarray:
        """Minimise the sum of squared powers, with equal resistance forward and backward."""
        weights = self.ground.squares(np.ones((*self.b.shape[:2], 2)))
        H = np.einsum("gmcn,gmc,gmck->gnk", self.J, weights, self.J)
        g = np.einsum("gmcn,gmc,gmc->gn", self.J, weights, self.b)
        return _step(g, H)


def _step(slope: np.ndarray, curvature: np.ndarray) -> np.ndarray:
    """Return Newton's step, with minimal added curvature where there might be none."""
    n = slope.shape[1]
    usual = np.trace(curvature, axis1=1, axis2=2)[:, None, None]
    ridge = (1e-15 * usual + _TINY) * np.eye(n)
    try:
        return -np.linalg.solve(curvature + ridge, slope[..., None])[..., 0]
    except np.linalg.LinAlgError:  # one is so steep that round-off absorbs the added curvature
        return -(np.linalg.pinv(curvature, hermitian=True) @ slope[..., None])[..., 0]


def _sharpened(body: LeastPower, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Minimise the power by Newton's steps from `x` (G, n), and flag those ended in balance."""
    x = body.descended(x, 0.0, 1e-13)
    _, slope, curvature = body.slopes(x)
    step = np.abs(_step(slope, np.nan_to_num(curvature))).max(axis=1, initial=0.0)
    near = step < _NEAR * (1 + np.abs(x).max(axis=1, initial=0.0))
    return x, near & (np.abs(slope).max(axis=1, initial=0.0) < _BALANCED)


_SINGULAR = 1e-20


def pivots(body: LeastPower) -> tuple[np.ndarray, np.ndarray]:
    """Return least power with each mass at rest: x (G, m, n), value (G, m), for n of 2 or 3.

    If any mass rests at least power, the lowest of these is that power. The value is infinite if a
    mass cannot rest.
    """
    G, m, _, n = body.J.shape
    each = np.repeat(np.arange(G), m)
    J, b = body.J.reshape(G * m, 2, n), body.b.reshape(G * m, 2)
    x = _resting(J, b, np.zeros((G * m, n)))
    x = _resting(J, b, x)
    bodies = body.of(each)
    if n == 3:
        way = np.cross(J[:, 0], J[:, 1])
        way /= np.linalg.norm(way, axis=1)[:, None]
        x += bodies.along(x, way).least()[:, None] * way
    value = bodies.smooth_value(x, 0.0)
    value[_stays(J)] = np.inf
    return x.reshape(G, m, n), value.reshape(G, m)


def _resting(J: np.ndarray, b: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return the nearest x (K, n) at which a mass rests."""
    across = J @ J.transpose(0, 2, 1)
    across[_stays(J)] = np.eye(2)
    off = b + (J @ x[..., None])[..., 0]
    return x - (J.transpose(0, 2, 1) @ np.linalg.solve(across, off[..., None]))[..., 0]


def _stays(J: np.ndarray) -> np.ndarray:
    """Return whether a mass (K,) has a velocity, in at least one direction, that no x changes."""
    return np.linalg.det(J @ J.transpose(0, 2, 1)) < _SINGULAR


RANK = 1e-9
_SAME = 1e-9  # gauges closer than this count as equal


def reactions(body: LeastPower, Q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return pushes (G, k, 2) of least largest gauge that carry a load, that gauge, who slips.

    The rows of Q (G, n, n) span the directions that the masses, all at rest, block.
    """
    G, k, _, n = body.J.shape
    rows = body.J.reshape(G, 2 * k, n)
    ranks = (np.abs(Q).max(axis=2) > 0).sum(axis=1)
    push, hold, slips = np.zeros((G, k, 2)), np.zeros(G), np.zeros((G, k), bool)
    for rank in np.unique(ranks):
        some = np.flatnonzero(ranks == rank)
        ground = body.ground.of_bodies(some)
        if k == 1 or (k == 2 and rank == 3):
            across = rows[some].transpose(0, 2, 1)
            pushes = np.linalg.pinv(across, rcond=RANK) @ body.load[some, :, None]
            pushes = pushes.reshape(-1, k, 2)
            if k == 2:
                way = np.linalg.svd(across)[2][:, -1].reshape(-1, 2, 2)
                push[some], hold[some], slips[some] = split_pair(pushes, way, ground)
            else:
                push[some], hold[some], slips[some] = pushes, ground.gauge(pushes)[:, 0], True
            continue
        span = Q[some][:, :rank]  # singular values fall
        load = (span @ body.load[some, :, None])[..., 0]
        borne = np.linalg.norm(load, axis=1) > 1e-13
        some, span, load = some[borne], span[borne], load[borne]
        if some.size:
            J = (rows[some] @ span.transpose(0, 2, 1)).reshape(len(some), k, 2, rank)
            resting = LeastPower(J, np.zeros((len(some), k, 2)), load, ground.of_bodies(borne))
            push[some], hold[some], slips[some], _ = load_gauge(resting)
    return push, hold, slips


def load_gauge(body: LeastPower) -> tuple[np.ndarray, ...]:
    """Return the load relative to the largest that all masses at rest can hold, by duality.

    It is the largest load.x among motions x of power 1. Returns the pushes (G, m, 2), the gauge
    (G,), which masses slip first (G, m), and their motion (G, n).
    """
    size = np.linalg.norm(body.load, axis=1)
    along = body.load / size[:, None] ** 2
    M = np.linalg.svd(body.load[:, None, :])[2][:, 1:].transpose(0, 2, 1)
    inner = body.restricted(along, np.ones(body.b.shape[:2], bool), M)
    inner = replace(inner, b=np.einsum("gmcn,gn->gmc", body.J, along), load=0 * inner.load)
    # Motions along the load alone, and its unit, as for a body without load.
    scale = np.abs(inner.b).max(axis=(1, 2))
    scale[scale == 0] = 1.0
    inner = replace(inner, b=inner.b / scale[:, None, None])
    push, slips, worth, z = (_across if M.shape[2] == 2 else _on_a_line)(inner)
    worth = np.maximum(worth * scale, _TINY)
    way = along + scale[:, None] * (M @ z[..., None])[..., 0]
    return push / worth[:, None, None], 1 / worth, slips, way


def _on_a_line(body: LeastPower) -> tuple[np.ndarray, ...]:
    """Return pushes, slipping masses, power and z, with one direction of motion or none."""
    z = np.zeros(body.load.shape)
    if z.size:
        z[:, 0] = body.along(z, np.ones(z.shape)).least()
    power = body.powers(z)
    return _pushes(body, body.velocities(z)), power > 0, power.sum(axis=1), z


def _across(body: LeastPower) -> tuple[np.ndarray, ...]:
    """Return these for two directions: one mass rests and the others turn about it, or none."""
    G, m = body.b.shape[:2]
    z, value = pivots(body)
    i, every = value.argmin(axis=1), np.arange(G)
    z, rests = z[every, i], np.isfinite(value[every, i])
    push = _pushes(body, body.velocities(z) * (np.arange(m) != i[:, None])[..., None])
    push[every, i], way = turned_out(body, push, i)
    rests &= body.ground.gauge(push)[every, i] <= 1
    go = np.flatnonzero(~rests)
    if go.size:
        moving, way = body.of(go), way[go]
        start = z[go] + moving.along(z[go], way).least()[:, None] * way
        z[go], v, found = moving.sharp(start)
        if (lost := np.flatnonzero(~found)).size:
            z[go[lost]], v[lost], _ = moving.of(lost).sharp(moving.of(lost).smoothed())
        push[go] = _pushes(moving, v)
    slips = np.ones((G, m), bool)
    slips[rests, i[rests]] = False
    return push, slips, body.powers(z).sum(axis=1), z


def _pushes(body: LeastPower, v: np.ndarray) -> np.ndarray:
    """Return pushes of masses with velocities `v` (G, m, 2), 0 for resting ones."""
    power = body.ground.power(v)
    return body.ground.squares(v) * v / np.maximum(power, _TINY)[..., None]


def turned_out(body: LeastPower, push: np.ndarray, i: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the push (G, 2) of a resting mass i (G,) from the others', and its slip (G, n)."""
    every = np.arange(len(i))
    slope = np.einsum("gmcn,gmc->gn", body.J, push) - body.load
    back = np.linalg.pinv(body.J[every, i], rcond=RANK)
    own = -(back.transpose(0, 2, 1) @ slope[..., None])[..., 0]
    ground = body.ground
    ground = ground.of((every, i) if ground.forward.ndim == 2 else i)
    return own, (back @ (own / ground.squares(own))[..., None])[..., 0]


def split_pair(
    push: np.ndarray, way: np.ndarray, ground: Ground
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the pushes (G, 2, 2) of two masses along a line with the least larger gauge.

    All pushes that balance are `push` + a `way`. Each squared gauge consists of parabolas in a, one
    for each of forward and backward resistance. The best a is therefore the minimum of one of them,
    or a crossing of two. Returns the pushes, the gauge, and which masses are at it (G, 2).
    """
    ahead = np.abs(way[..., 0]) > _TINY  # others do not turn, however far
    turns = np.divide(-push[..., 0], way[..., 0], out=np.zeros_like(push[..., 0]), where=ahead)
    turns = np.sort(turns, axis=1)
    gap = 1 + np.abs(turns).max(axis=1)
    inside = [turns[:, 0] - gap, turns.mean(axis=1), turns[:, 1] + gap]
    tried = [turns[:, 0], turns[:, 1]]
    for a in inside:
        squares = ground.squares(push + a[:, None, None] * way)
        c2, c1 = (way**2 / squares).sum(-1), 2 * (push * way / squares).sum(-1)
        c0 = (push**2 / squares).sum(-1)
        tried += [-c1[:, 0] / (2 * c2[:, 0]), -c1[:, 1] / (2 * c2[:, 1])]
        tried += _crossings(c2[:, 0] - c2[:, 1], c1[:, 0] - c1[:, 1], c0[:, 0] - c0[:, 1])
    a = np.stack(tried, axis=1)
    a[~(np.abs(a) < 1 / _TINY)] = 0.0
    wide = ground.of((slice(None), None))
    gauges = wide.gauge(push[:, None] + a[..., None, None] * way[:, None])
    worst = gauges.max(axis=-1)
    best = np.nanargmin(worst, axis=1)
    rows = np.arange(len(a))
    hold = worst[rows, best]
    at_it = gauges[rows, best] > hold[:, None] * (1 - _SAME)
    return push + a[rows, best][:, None, None] * way, hold, at_it


def _crossings(c2: np.ndarray, c1: np.ndarray, c0: np.ndarray) -> list[np.ndarray]:
    """Return both roots of parabolas, NaN if there are none."""
    with np.errstate(all="ignore"):
        root = np.sqrt(c1**2 - 4 * c2 * c0)
        q = -(c1 + np.where(c1 >= 0, root, -root)) / 2
        return [q / c2, c0 / q]
