"""What a camera would see of worms on dry ground: scipy's steps and events, noise, gaps, outliers.

Shares nothing with the package: equations (9), (10) and (16) are typed in again, and who sticks,
slips or lets go is decided here. Forces act on masses, positive forward.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import solve_ivp

Array = np.ndarray
Push = Callable[[float, Array, Array, Array], Array]
"""Force on each mass but the ground's, from t, positions, velocities and the course's values."""

# Of a stick force, of a time, of a speed: less is round-off.
_HOLD, _SPLIT, _LEFT = 1e-11, 1e-9, 1e-12


@dataclass(frozen=True)
class Ground:
    """Coulomb friction of one mass; stiction is the sliding force unless said."""

    forward: float = 0.0
    backward: float = 0.0
    stick_forward: float | None = None
    stick_backward: float | None = None

    @property
    def dry(self) -> bool:
        return self.most > 0 or self.least < 0

    @property
    def least(self) -> float:
        return -(self.forward if self.stick_forward is None else self.stick_forward)

    @property
    def most(self) -> float:
        return self.backward if self.stick_backward is None else self.stick_backward

    def slides(self, way: int) -> float:
        return -self.forward if way > 0 else self.backward

    def way(self, push: float, let_go: bool) -> int:
        """Where a resting mass goes under a push: 1, -1, or 0 if the ground holds it."""
        slack = _HOLD * (self.most - self.least)
        if push > -self.least - (slack if let_go else -slack):
            return 1
        return -1 if push < -self.most + (slack if let_go else -slack) else 0


@dataclass(frozen=True)
class Course:
    """Piecewise polynomials: breaks (pieces + 1,) from 0, coefficients (pieces, n, powers)."""

    breaks: Array
    coefficients: Array
    periodic: bool = True

    def turn(self, t: float) -> tuple[int, float, float]:
        """Piece that holds a moment after t, when it began, when it ends."""
        period, last = self.breaks[-1], len(self.breaks) - 2
        turns = np.floor(t / period + _SPLIT) if self.periodic else 0.0
        k = int(np.searchsorted(self.breaks, t - turns * period + _SPLIT * period, "right")) - 1
        k = min(max(k, 0), last)
        ends = self.periodic or k < last
        return k, turns * period + self.breaks[k], (
            turns * period + self.breaks[k + 1] if ends else np.inf
        )  # fmt: skip

    def at(self, t: float, piece: int, begin: float) -> Array:
        return self.coefficients[piece] @ (t - begin) ** np.arange(self.coefficients.shape[2])


def square(period: float, low: ArrayLike, high: ArrayLike, phase: ArrayLike) -> Course:
    """Courses that jump between two values, each at its own share of the period."""
    phase = np.asarray(phase) % 1.0
    cuts = np.unique(np.round(np.concatenate([[0.0, 1.0], phase, (phase + 0.5) % 1.0]), 12))
    middle = (cuts[1:] + cuts[:-1]) / 2
    up = (middle[:, None] - phase) % 1.0 < 0.5
    return Course(period * cuts, np.where(up, high, low)[:, :, None])


def smooth_waves(period: float, mean: ArrayLike, amplitude: ArrayLike, phase: ArrayLike) -> Course:
    """Courses mean + amplitude s(t/period + phase), s a sine of cubic pieces, twice smooth."""
    pieces = 16
    knots = np.arange(pieces + 1) / pieces
    # the periodic cubic spline through a sine's values, by its known exact slopes
    turn = 2 * np.pi * (knots[:, None] + np.asarray(phase))
    value, slope = np.sin(turn), 2 * np.pi * np.cos(turn)
    h, rise = 1 / pieces, np.diff(value, axis=0)
    third = (slope[:-1] + slope[1:] - 2 * rise / h) / h**2
    second = (3 * rise / h - 2 * slope[:-1] - slope[1:]) / h
    shape = np.stack([value[:-1], slope[:-1], second, third], axis=2)
    shape = shape * np.asarray(amplitude)[:, None] / period ** np.arange(4)
    shape[:, :, 0] += np.asarray(mean)
    return Course(period * knots, shape)


NOTHING = Course(np.array([0.0, 1.0]), np.zeros((1, 1, 1)), periodic=False)


@dataclass(frozen=True)
class Bodies:
    """Masses in a row, what pushes them, and the ground below each."""

    mass: Array
    ground: Sequence[Ground]
    push: Push
    course: Course


@dataclass(frozen=True)
class Seen:
    """Samples: time (m,), values by name (size, m); what happened: (time, mass, kind)."""

    time: Array
    values: Mapping[str, Array]
    events: Sequence[tuple[float, int, str]] = ()
    noise: Mapping[str, float] = field(default_factory=dict)


# -- the bodies ------------------------------------------------------------------------------------


def block(mass: float, ground: Ground, course: Course) -> Bodies:
    """A block that the course, a force, pushes."""
    return Bodies(np.array([mass]), [ground], lambda t, x, v, u: u, course)


def chain(
    mass: ArrayLike, stiffness: Array, damping: Array, rest: Array | float,
    ground: Sequence[Ground], course: Course, *, drag: Array | float = 0.0,
    load: Array | float = 0.0, drives: str = "force",
) -> Bodies:  # fmt: skip
    """(10) for n+1 masses, head first; the course gives forces u, or what is added to `rest`."""

    def push(t: float, x: Array, v: Array, u: Array) -> Array:
        longer = u if drives == "rest_length" else 0.0
        pull = stiffness * (-np.diff(x) - rest - longer) - damping * np.diff(v)
        pull = pull - (0.0 if drives == "rest_length" else u)
        return np.append(0.0, pull) - np.append(pull, 0.0) - drag * v - load

    return Bodies(np.asarray(mass, float), ground, push, course)


def pair(
    push: float, frequency: float, ground: Sequence[Ground], *, mass: float = 1.0,
    stiffness: float = 1.0, damping: float = 0.0, cosines: Sequence[float] = (1.0, 1.0),
) -> Bodies:  # fmt: skip
    """(16) in units of force, x_2 ahead of x_1: the field pushes with `push` times its cosines."""
    orders = np.arange(len(cosines))

    def forces(t: float, x: Array, v: Array, u: Array) -> Array:
        field = np.dot(cosines, np.cos(orders * frequency * t))
        pull = stiffness * (x[1] - x[0]) + damping * (v[1] - v[0]) - push * field
        return np.array([pull, -pull])

    return Bodies(np.full(2, mass), ground, forces, NOTHING)


# -- what moves them -------------------------------------------------------------------------------


def follow(
    bodies: Bodies, times: ArrayLike, position: ArrayLike, velocity: ArrayLike,
    *, exact: float = 1e-11, longest: float = 0.05,
) -> Seen:  # fmt: skip
    """Positions and velocities at times that ascend from the start, by DOP853 piece by piece."""
    n, times = len(bodies.mass), np.asarray(times, float)
    y = np.concatenate([np.asarray(position, float), np.asarray(velocity, float)])
    t, end, found = float(times[0]), float(times[-1]), np.full((2 * n, len(times)), np.nan)
    events: list[tuple[float, int, str]] = []
    fresh: set[int] = set()
    while True:
        piece, begin, until = bodies.course.turn(t)
        ways = _decide(bodies, t, y, bodies.course.at(t, piece, begin), fresh)
        if t >= end:
            break
        part = _stretch(bodies, ways, y, (t, min(until, end)), (piece, begin), exact, longest)
        inside = (times >= t) & (times <= part.t[-1])
        if inside.any():
            found[:, inside] = part.sol(times[inside])
        t, y, fresh = float(part.t[-1]), part.y[:, -1].copy(), set()
        for (i, kind), at in zip(_watched(bodies, ways), part.t_events, strict=True):
            if len(at):
                y[n + i], fresh = 0.0, fresh | ({i} if kind == "release" else set())
                events.append((t, i, kind))
        if abs(t - until) < _SPLIT * max(1.0, abs(until)):
            t = until
    return Seen(times, {"position": found[:n], "velocity": found[n:]}, events)


def _decide(bodies: Bodies, t: float, y: Array, u: Array, fresh: set[int]) -> list[int]:
    n = len(bodies.mass)
    push = bodies.push(t, y[:n], y[n:], u)
    ways = []
    for i, ground in enumerate(bodies.ground):
        v = y[n + i]
        if not ground.dry:
            ways.append(1)
        else:
            ways.append(int(np.sign(v)) if v else ground.way(push[i], i in fresh))
    return ways


def _watched(bodies: Bodies, ways: list[int]) -> list[tuple[int, str]]:
    return [
        (i, "stop" if ways[i] else "release") for i, g in enumerate(bodies.ground) if g.dry
    ]  # fmt: skip


def _stretch(
    bodies: Bodies, ways: list[int], y: Array, span: tuple[float, float],
    held: tuple[int, float], exact: float, longest: float,
) -> Any:  # fmt: skip
    """Follow one choice of who slides where, to its end or the course's next break."""
    n = len(bodies.mass)
    slides = np.array([g.slides(w) for g, w in zip(bodies.ground, ways, strict=True)])
    moves = np.array([w != 0 or not g.dry for g, w in zip(bodies.ground, ways, strict=True)])

    def push(t: float, y: Array) -> Array:
        return bodies.push(t, y[:n], y[n:], bodies.course.at(t, *held))

    def rhs(t: float, y: Array) -> Array:
        return np.concatenate([y[n:], moves * (push(t, y) + slides) / bodies.mass])

    def stops(i: int) -> Any:
        slack = _LEFT if y[n + i] == 0 else 0.0  # who has just let go shall not stop by rounding
        return lambda t, y: ways[i] * y[n + i] + slack

    def lets_go(i: int) -> Any:
        ground = bodies.ground[i]
        return lambda t, y: min(push(t, y)[i] + ground.most, -ground.least - push(t, y)[i])

    watched = []
    for i, kind in _watched(bodies, ways):
        event = stops(i) if kind == "stop" else lets_go(i)
        event.terminal, event.direction = True, -1
        watched.append(event)
    return solve_ivp(
        rhs, span, y, "DOP853", rtol=max(exact, 3e-14), atol=exact * 1e-2, max_step=longest,
        events=watched, dense_output=True,
    )  # fmt: skip


# -- what is seen of it ----------------------------------------------------------------------------


def disturb(
    seen: Seen, noise: Mapping[str, float], seed: int, *,
    gaps: float = 0.0, outliers: float = 0.0, far: float = 20.0,
) -> Seen:  # fmt: skip
    """Add Gaussian noise to the values named, which alone are kept.

    A share `gaps` of them is NaN, a share `outliers` is off by up to `far` standard deviations.
    """
    rng = np.random.default_rng(seed)
    values = {}
    for name, sd in noise.items():
        clean = seen.values[name]
        heard = clean + sd * rng.standard_normal(clean.shape)
        wild = rng.random(clean.shape) < outliers
        heard = np.where(wild, heard + far * sd * rng.uniform(-1, 1, clean.shape), heard)
        values[name] = np.where(rng.random(clean.shape) < gaps, np.nan, heard)
    return replace(seen, values=values, noise=dict(noise))


def with_lengths(seen: Seen) -> Seen:
    """The same, with the link lengths of a chain."""
    return replace(
        seen, values={**seen.values, "length": -np.diff(seen.values["position"], axis=0)}
    )


def irregular(end: float, count: int, seed: int) -> Array:
    """Sample times from 0 to the end as a clock that stutters gives them."""
    inner = np.random.default_rng(seed).uniform(0.0, end, count - 2)
    return np.concatenate([[0.0], np.sort(inner), [end]])
