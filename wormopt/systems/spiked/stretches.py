"""Changes of the resting masses and glides: the modes of eq. 7 over a period."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations, pairwise

import numpy as np

from wormopt.errors import SolveError
from wormopt.model.gait import Gait
from wormopt.numerics.chebyshev import Series, relaxed, resolve
from wormopt.systems.spiked.limits import Sharing

# A glide longer than this many time constants of drag is split after a number of them: the first
# series contains the decay of the initial velocity, the second only drag and drive.
_STIFF, _LAYER = 300.0, 40.0


@dataclass(frozen=True, eq=False)
class Drive:
    """A gait that drives a worm, as explicit functions of time on each piece of the gait."""

    gait: Gait
    mass: np.ndarray  # (n+1,)
    drag: float  # viscous drag k of every mass
    load: float  # Gamma on every mass, or the mean of different loads
    sharing: Sharing  # rule by which resting masses share the load
    # load that each spike can carry; for "least_actuation"
    spike_load: float | Sequence[float] | None = None
    # load of each mass minus the mean, (n+1,); the motion does not depend on it
    beyond: np.ndarray | float = 0.0

    @property
    def mean_mass(self) -> float:
        """Mean of the point masses, which replaces m in eq. 7."""
        return float(self.mass.mean())

    @cached_property
    def rate_scale(self) -> float:
        """Size of the link rates."""
        return self._largest(1)

    @cached_property
    def force_scale(self) -> float:
        """Size of the forces: load, inertia and drag."""
        most = self.load + float(np.max(self.beyond))
        return most + self.mean_mass * self._largest(2) + self.drag * self.rate_scale

    def _largest(self, derivative: int) -> float:
        steps = [np.linspace(0, h, 9) for h in np.diff(self.gait.breaks)]
        values = [self.gait.on_piece(q, s, derivative) for q, s in enumerate(steps)]
        return max(float(np.abs(v).max()) for v in values) or 1.0

    def spans(self, piece: int, s: np.ndarray, derivative: int) -> np.ndarray:
        """Derivatives of S_i = x_0 - x_i, shape (n+1, m), at times `s` since the piece began."""
        links = self.gait.on_piece(piece, s, derivative)
        return np.vstack([np.zeros(len(s)), np.cumsum(links, axis=0)])

    def kinematic(self, piece: int, leader: int, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Velocities and accelerations of the masses while mass `leader` rests.

        `s` (m,) are times since the piece began.
        """
        first, second = self.spans(piece, s, 1), self.spans(piece, s, 2)
        return first[leader] - first, second[leader] - second

    def sigma(self, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Driving term of eq. 7, for masses that may differ.

        `v` and `a` (n+1, m) are velocities and accelerations while a mass rests.
        """
        return self.mass @ a / len(self.mass) + self.drag * v.mean(axis=0) + self.load


@dataclass(frozen=True, eq=False)
class Stretch:
    """An interval on which the same masses rest, or all glide, and everything is smooth."""

    piece: int  # of the gait
    start: float  # since the piece began
    stop: float  # since the piece began
    resting: tuple[int, ...]  # masses at rest, ascending; empty in a glide
    leader: int  # a mass that rests in mode 2, or would without the glide
    common: Series | None = None  # velocity w in a glide; None in mode 2


def periodic_stretches(
    drive: Drive,
) -> tuple[tuple[Stretch, ...], tuple[tuple[float, float], ...], tuple[float, ...]]:
    """Follow the worm from w = 0 until its motion repeats.

    Returns the stretches of one period, times and sizes of spike impulses, and times at which the
    kinematic velocity W0 jumps down. Raises SolveError if it glides faster from period to period.
    """
    cells, w = _driven_cells(drive), 0.0
    for _ in range(500):
        stretches, impulses, drops, end = _one_period(drive, cells, w)
        if abs(end - w) <= 1e-13 * drive.rate_scale:
            return tuple(stretches), tuple(impulses), tuple(drops)
        w = end
    raise SolveError(
        "the glide of the worm does not become periodic",
        "increase worm.load or worm.drag, or write a longer period",
    )


def kinematic_stretches(drive: Drive) -> list[Stretch]:
    """Stretches of one period without a glide, which depend on the gait alone."""
    return [cell for piece in range(drive.gait.pieces) for cell in _cells(drive, piece)]


def _cells(drive: Drive, piece: int) -> list[Stretch]:
    """Split a piece where the resting masses change."""
    width = float(drive.gait.breaks[piece + 1] - drive.gait.breaks[piece])
    tie = 1e-10 * drive.rate_scale
    spans = resolve(lambda s: drive.spans(piece, s, 1), 0.0, width, exact_degree(drive.gait))
    cuts, alike = [0.0, width], {i: {i} for i in range(len(drive.mass))}
    for i, j in combinations(alike, 2):
        gap = Series(0.0, width, (spans.coefficients[i] - spans.coefficients[j])[None])
        if np.abs(gap.coefficients).sum() <= tie:
            # The functions are analytic: masses that rest together rest so on the whole piece.
            alike[i].add(j)
            alike[j].add(i)
            continue
        for root in gap.roots():
            values = spans(np.array([root])).ravel()
            if values[i] >= values.max() - 1e3 * tie:
                cuts.append(float(root))
    cells: list[Stretch] = []
    for a, b in pairwise(sorted(cuts)):
        values = spans(a + (b - a) * np.array([0.1, 0.5, 0.9]))
        ahead = (values >= values.max(axis=0) - tie).all(axis=1)
        # Where curves only touch, round-off must not choose the leader: keep the previous one.
        leader = (
            cells[-1].leader if cells and ahead[cells[-1].leader] else int(values[:, 1].argmax())
        )
        resting = tuple(sorted(alike[leader]))
        if not cells or cells[-1].resting != resting:
            cells.append(Stretch(piece, a, width, resting, resting[0]))
    ends = [*(cell.start for cell in cells[1:]), width]
    cells = [replace(cell, stop=end) for cell, end in zip(cells, ends, strict=True)]
    return _absorb_touching(cells, spans, tie)


def _absorb_touching(cells: list[Stretch], spans: Series, tie: float) -> list[Stretch]:
    """Merge a first cell that is a mere touch into the next cell."""
    while len(cells) > 1:
        first, second = cells[:2]
        values = spans(np.linspace(first.start, first.stop, 5))
        if np.any(values[second.leader] < values.max(axis=0) - tie):
            break
        cells = [replace(second, start=first.start), *cells[2:]]
    return cells


@dataclass(frozen=True, eq=False)
class _Cell:
    """A stretch of `kinematic_stretches`, with the drive of the worm in it."""

    stretch: Stretch
    jump: float  # of the velocity of the centre of mass at its start, while a mass rests
    sigma: Series  # driving term of eq. 7
    edges: np.ndarray  # start, zeros of sigma, stop


def _driven_cells(drive: Drive) -> list[_Cell]:
    total = float(drive.mass.sum())

    def momentum(cell: Stretch, s: float) -> float:
        v, _ = drive.kinematic(cell.piece, cell.leader, np.array([s]))
        return (drive.mass @ v).item() / total

    def driven(before: Stretch, cell: Stretch) -> _Cell:
        jump = momentum(cell, cell.start) - momentum(before, before.stop)
        sigma = resolve(
            lambda s: drive.sigma(*drive.kinematic(cell.piece, cell.leader, s))[None],
            cell.start, cell.stop, exact_degree(drive.gait),
        )  # fmt: skip
        edges = np.concatenate([[cell.start], sigma.roots(), [cell.stop]])
        return _Cell(cell, jump, sigma, edges)

    cells = kinematic_stretches(drive)
    return [driven(cells[k - 1], cell) for k, cell in enumerate(cells)]


def _one_period(
    drive: Drive, cells: list[_Cell], w: float
) -> tuple[list[Stretch], list[tuple[float, float]], list[float], float]:
    """Follow the cells once from common velocity ``w``; returns also w at the end."""
    total = float(drive.mass.sum())
    still = 1e-11 * drive.rate_scale
    stretches: list[Stretch] = []
    impulses: list[tuple[float, float]] = []
    drops: list[float] = []
    for cell in cells:
        if abs(cell.jump) > 1e2 * still:
            # jumps occur only where pieces meet
            time = float(drive.gait.breaks[cell.stretch.piece])
            w -= cell.jump
            if cell.jump < 0:
                drops.append(time)
            if w < 0:
                impulses.append((time, -w * total))
        for stretch in _glide_or_hold(drive, cell, w if w > still else 0.0):
            stretches.append(stretch)
            w = stretch.common(np.array([stretch.stop])).item() if stretch.common else 0.0
            w = w if w > still else 0.0
    return stretches, impulses, drops, w


def _glide_or_hold(drive: Drive, driven: _Cell, w: float) -> Iterator[Stretch]:
    """Split a cell into mode 2 (a mass rests) and mode 1 (the worm glides)."""
    cell, sigma, edges = driven.stretch, driven.sigma, driven.edges
    now, end = cell.start, cell.stop
    touch, decay = 1e-9 * drive.force_scale, drive.drag / drive.mean_mass
    settled = False
    while now < end:
        if w == 0.0:
            begin = _first_dip(sigma, edges, now, touch)
            if begin is None:
                yield replace(cell, start=now)
                return
            if begin > now:
                yield replace(cell, start=now, stop=begin)
            now = begin
        far = end
        if not settled and decay * (end - now) > _STIFF and now + _LAYER / decay > now:
            far = now + _LAYER / decay
        # m w' + k w + sigma = 0, and sigma is known
        common = relaxed(lambda s: -sigma(s) / drive.mean_mass, decay, w, now, far)
        # A glide ends where w falls through 0; at its start w is 0 too, but increases.
        slope = common.derivative()
        falls = [r for r in common.roots() if r > now and slope(np.array([r])).item() < 0]
        stop = float(falls[0]) if falls else far
        yield replace(cell, start=now, stop=stop, resting=(), common=common)
        settled = not falls
        now, w = stop, 0.0 if falls else common(np.array([far])).item()


def _first_dip(sigma: Series, edges: np.ndarray, now: float, touch: float) -> float | None:
    """First time from ``now`` at which sigma falls below zero by more than a touch."""
    for a, b in pairwise(np.maximum(edges, now).tolist()):
        if b > a and sigma(np.linspace(a, b, 11)).min() < -touch:
            return a
    return None


def exact_degree(gait: Gait, power: int = 1) -> int | None:
    """Degree that resolves a power of a gait's pieces without error; None for harmonics."""
    return gait.degree and power * gait.degree


def at_breaks(gait: Gait, derivative: int) -> tuple[np.ndarray, np.ndarray]:
    """Values right after and right before the start of every piece, (pieces, n) each, periodic."""
    widths = np.diff(gait.breaks)
    begins = [gait.on_piece(q, np.zeros(1), derivative).ravel() for q in range(gait.pieces)]
    ends = [gait.on_piece(q, widths[q : q + 1], derivative).ravel() for q in range(gait.pieces)]
    return np.array(begins), np.roll(ends, 1, axis=0)
