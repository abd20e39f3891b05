"""Velocities of a body that crawls slowly, for shapes and their rates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError, SolveError
from wormopt.model.planar_friction import PlanarLaw
from wormopt.systems.planar.body.shape import Shape
from wormopt.systems.planar.crawling.balance import LeastPower
from wormopt.systems.planar.crawling.ground import Ground, ground_of
from wormopt.systems.planar.crawling.held import Held, freedom
from wormopt.systems.planar.crawling.least_power import least_power, near, way_out

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
        return cls(shape, ground_of(laws, shape.n_points), given)

    @property
    def force(self) -> float:
        """Usual resistance of a mass."""
        return float(self.ground.sideways.mean())

    def bodies(self, s: np.ndarray, ds: np.ndarray) -> Bodies:
        """Return bodies at shapes (G, n_s) and rates."""
        G, m = len(s), self.shape.n_points
        mapped = self.shape.kinematics.map(G)
        _, _, J, B = (np.array(part) for part in mapped.call([s.T]))
        J = J.reshape(2 * m, G, 3).transpose(1, 0, 2).reshape(G, m, 2, 3)
        B = B.reshape(2 * m, G, -1).transpose(1, 0, 2)
        b = (B @ ds[..., None]).reshape(G, m, 2)
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
