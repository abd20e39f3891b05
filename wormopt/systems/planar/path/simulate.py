"""Second route to paths: masses in Cartesian coordinates, and crawls without rest.

Motions with pins and skids use neither the frame of the body nor its quadrature or kinematics: at
every instant the velocities of all masses are solved for with the given rates of links and joints
and with the constraints. Slow crawls use smoothed laws, a frame at the tail and a product of
exponentials; they find neither resting masses nor their breaks, and use nothing of `Shape` or
`Travel`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.integrate import solve_ivp

from wormopt.errors import ArgumentError
from wormopt.systems.planar.crawling.balance import Ground, LeastPower
from wormopt.systems.planar.crawling.crawl import Crawl
from wormopt.systems.planar.kinematic import Constraints, KinematicMotion, Phase
from wormopt.systems.planar.obstacles import Block, Capsule, Disc, Obstacle, Wall, inside
from wormopt.systems.planar.path.plan import PlannedPath
from wormopt.systems.planar.poses import rotate
from wormopt.systems.planar.shape import Heading, Stroke

_BEHIND = {"bisector": 0.5, "front": 1.0, "rear": 0.0}


def simulate_held(
    places: np.ndarray,
    stroke: Stroke,
    phases: Sequence[Phase],
    lengths: Sequence[float] | None = None,
    heading: Heading = "bisector",
    looks: int = 32,
    *,
    accuracy: float = 1e-11,
) -> tuple[np.ndarray, np.ndarray]:
    """Return places of the masses of a chain over one stroke, by Runge-Kutta steps of order 8.

    `places` (n + 1, 2) are the start; `lengths` are those of links that do not stretch (the stroke
    then has angles only). Returns phases (m,) and places (m, n + 1, 2), `looks` for each smooth
    part of the stroke.
    """
    n = len(places) - 1
    ends = np.union1d(stroke.breaks, [phase.until for phase in phases])
    ends = ends[np.diff(ends, prepend=-np.inf) > 1e-12]  # differ by more than rounding
    tau, course = [0.0], [np.asarray(places, dtype=float).ravel()]
    for a, b in pairwise(ends):
        held = next(phase.constraints for phase in phases if phase.until > (a + b) / 2)

        def velocity(t: float, r: np.ndarray, held: Constraints = held, b: float = b) -> np.ndarray:
            # the rate at the very end of a part is that of the part, not of the next one
            rates = stroke.at(min(t, b - 1e-12))[1][0]
            stretch = np.zeros(n) if lengths is not None else rates[:n]
            bend = rates if lengths is not None else rates[n:]
            return _velocities(r.reshape(-1, 2), stretch, bend, held, heading)

        t = np.linspace(a, b, looks + 1)
        found = solve_ivp(velocity, (a, b), course[-1], method="DOP853", t_eval=t[1:],
                          rtol=accuracy, atol=accuracy)  # fmt: skip
        tau.extend(found.t)
        course.extend(found.y.T)
    return np.array(tau), np.array(course).reshape(len(tau), -1, 2)


def _velocities(
    r: np.ndarray, stretch: np.ndarray, bend: np.ndarray, held: Constraints, heading: Heading
) -> np.ndarray:
    """Return velocities of all masses, (2 (n + 1),), from rows for links, joints, constraints."""
    n = len(r) - 1
    d = r[:-1] - r[1:]
    size = np.hypot(d[:, 0], d[:, 1])
    along = d / size[:, None]
    across = np.stack([-along[:, 1], along[:, 0]], axis=-1)
    rows, given = [], []

    def turning(j: int) -> np.ndarray:
        """Row of how fast link j turns."""
        row = np.zeros((n + 1, 2))
        row[j], row[j + 1] = across[j] / size[j], -across[j] / size[j]
        return row.ravel()

    for j in range(n):
        row = np.zeros((n + 1, 2))
        row[j], row[j + 1] = along[j], -along[j]
        rows.append(row.ravel())
        given.append(stretch[j])
    for j in range(n - 1):
        rows.append(turning(j) - turning(j + 1))
        given.append(bend[j])
    for i, normal in _normals(along, held, heading):
        row = np.zeros((n + 1, 2))
        row[i] = normal
        rows.append(row.ravel())
        given.append(0.0)
    return np.linalg.lstsq(np.array(rows), np.array(given), rcond=None)[0]


def _normals(
    along: np.ndarray, held: Constraints, heading: Heading
) -> list[tuple[int, tuple[float, float]]]:
    """Directions into which masses cannot move."""
    found: list[tuple[int, tuple[float, float]]] = []
    for i in held.pins:
        found += [(i, (1.0, 0.0)), (i, (0.0, 1.0))]
    for i in held.skids:
        front, rear = along[max(i - 1, 0)], along[min(i, len(along) - 1)]
        turn = np.arctan2(rear[0] * front[1] - rear[1] * front[0], front @ rear)
        angle = np.arctan2(rear[1], rear[0]) + _BEHIND[heading] * turn
        found.append((i, (-float(np.sin(angle)), float(np.cos(angle)))))
    return found


_GAUSS = 0.5 + np.array([-1.0, 1.0]) * np.sqrt(3) / 6


def simulate_crawled(
    places: np.ndarray,
    stroke: Stroke,
    ground: Ground,
    lengths: Sequence[float] | None = None,
    heading: Heading = "bisector",
    looks: int = 64,
    *,
    steps: int = 256,
) -> tuple[np.ndarray, np.ndarray]:
    """Return places of the masses of a chain over one stroke, by steps of order 4.

    Across a break the order is 2. `places` (n + 1, 2) are the start; `lengths` are those of links
    that do not stretch (the stroke then has angles only). Returns phases (m,) and places
    (m, n + 1, 2): `looks` for each smooth part of the stroke, which takes at least `steps` steps.
    """
    dx, dy = places[-2] - places[-1]
    pose = np.array([*places[-1], np.arctan2(dy, dx)])
    tau, course = [np.zeros(1)], [places[None]]
    for a, b in pairwise(stroke.breaks):
        each = -(-steps // looks)
        ends = np.linspace(a, b, looks * each + 1)
        h = np.diff(ends)[:, None]
        inner = (ends[:-1, None] + h * _GAUSS).ravel()
        first, second = np.moveaxis(_twists(stroke, inner, lengths, heading, ground), 1, 0)
        # the logarithm of a step, to order 4
        moves = h / 2 * (first + second) + np.sqrt(3) / 12 * h**2 * _bracket(first, second)
        poses = _multiplied(pose, _exponential(moves))[each - 1 :: each]
        phases = ends[each::each]
        # at the end of a part the shape is that of this part, not of the next one
        shape = _chain(stroke.at(phases)[0], None, lengths)[0]
        tau.append(phases)
        course.append(poses[:, None, :2] + rotate(poses[:, None, 2], shape))
        pose = poses[-1]
    return np.concatenate(tau), np.concatenate(course)


def _twists(
    stroke: Stroke, tau: np.ndarray, lengths: Sequence[float] | None, heading: Heading,
    ground: Ground,
) -> np.ndarray:  # fmt: skip
    """Return velocities (G, 2, 3) of the tail's frame, by the phase, at pairs of phases (2 G,)."""
    s, ds = stroke.at(tau)
    places, rates, links, bends = _chain(s, ds, lengths)
    angle = np.concatenate(
        [links[:, :1], links[:, 1:] + _BEHIND[heading] * bends, links[:, -1:]], axis=1
    )
    along = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    across = np.stack([-along[..., 1], along[..., 0]], axis=-1)
    speed = np.maximum(np.abs(rates).max(axis=(1, 2)), 1e-300)
    size = np.sqrt((places**2).sum(axis=-1).mean(axis=-1))
    lever = np.stack([-places[..., 1], places[..., 0]], axis=-1) / size[:, None, None]

    def own(v: np.ndarray) -> np.ndarray:
        """Return components along and across the headings."""
        return np.stack([(along * v).sum(axis=-1), (across * v).sum(axis=-1)], axis=-1)

    J = np.stack([along, across], axis=-2)
    J = np.concatenate([J, own(lever)[..., None]], axis=-1)
    force = float(ground.sideways.mean())
    unit = Ground(ground.forward / force, ground.backward / force, ground.sideways / force)
    body = LeastPower(J, own(rates) / speed[:, None, None], np.zeros((len(tau), 3)), unit)
    twist = body.smoothed() * speed[:, None]
    twist[:, 2] /= size
    return twist.reshape(-1, 2, 3)


def _chain(
    s: np.ndarray, ds: np.ndarray | None, lengths: Sequence[float] | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return places, velocities (G, n + 1, 2) from the tail, angles (G, n) of links and joints."""
    ds = np.zeros_like(s) if ds is None else ds
    n = s.shape[1] + 1 if lengths is not None else (s.shape[1] + 1) // 2
    joints = s.shape[1] - (n - 1)
    size = s[:, :joints] if lengths is None else np.tile(np.asarray(lengths), (len(s), 1))
    stretch = ds[:, :joints] if lengths is None else np.zeros_like(size)
    links, turning = (_summed(x[:, joints:]) for x in (s, ds))
    e = np.stack([np.cos(links), np.sin(links)], axis=-1)
    normal = np.stack([-e[..., 1], e[..., 0]], axis=-1)
    places = _summed(size[..., None] * e)
    rates = _summed(stretch[..., None] * e + (size * turning)[..., None] * normal)
    return places, rates, links, s[:, joints:]


def _summed(values: np.ndarray) -> np.ndarray:
    """Return cumulative sums (G, n + 1, ...) from the tail, starting at 0, of n terms."""
    sums = np.cumsum(values[:, ::-1], axis=1)[:, ::-1]
    return np.concatenate([sums, np.zeros_like(values[:, :1])], axis=1)


def _bracket(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    x = b[:, 1] * -a[:, 2] + a[:, 1] * b[:, 2]
    y = b[:, 0] * a[:, 2] - a[:, 0] * b[:, 2]
    return np.stack([x, y, np.zeros_like(x)], axis=-1)


def _exponential(moves: np.ndarray) -> np.ndarray:
    """Return displacements (G, 3) by constant twists."""
    half = moves[:, 2] / 2
    chord = np.sinc(half / np.pi)
    return np.column_stack([rotate(half, chord[:, None] * moves[:, :2]), moves[:, 2]])


def _multiplied(start: np.ndarray, moves: np.ndarray) -> np.ndarray:
    """Return poses (G, 3) after successive displacements."""
    angles = start[2] + np.cumsum(moves[:, 2])
    before = np.append(start[2], angles[:-1])
    places = start[:2] + np.cumsum(rotate(before, moves[:, :2]), axis=0)
    return np.column_stack([places, angles])


@dataclass(frozen=True, eq=False)
class Course:
    """Places of all masses over a whole path."""

    step: np.ndarray  # (m,) number of the step and phase within, together
    places: np.ndarray  # (m, n, 2)

    @property
    def pose(self) -> np.ndarray:
        """x, y of the head and angle of the first link at the end, (3,)."""
        head, next_to = self.places[-1, 0], self.places[-1, 1]
        dx, dy = head - next_to
        return np.array([*head, np.arctan2(dy, dx)])


def simulate_path(
    path: PlannedPath,
    *,
    lengths: Sequence[float] | None = None,
    heading: Heading = "bisector",
    looks: int = 64,
) -> Course:
    """Simulate all steps of a path, one after another from the start, by independent methods.

    Motions with pins and skids are integrated with all masses in Cartesian coordinates. Slow crawls
    use smoothed laws, without rest or breaks, in a frame at the tail. Each step begins where the
    previous one ended, including its error.

    Parameters
    ----------
    path : PlannedPath
        Its steps must come from `gait_family`.
    lengths : sequence of float, optional
        Link lengths, if they are no shape variables.
    heading : {"bisector", "front", "rear"}, optional
        Heading of inner masses.
    looks : int, optional
        Instants kept of each smooth part of a stroke.

    Returns
    -------
    Course
        Places of all masses; `pose` is that of the head at the end.

    Raises
    ------
    ArgumentError
        If a step has another origin.

    Examples
    --------
    >>> import wormopt as wo
    >>> P, worm = wo.planar, wo.planar.chain_shape(2)
    >>> push = P.Phase(0.5, P.Constraints(pins=(2,), skids=(0,)))
    >>> pull = P.Phase(1.0, P.Constraints(pins=(0,), skids=(2,)))
    >>> ahead = P.gait_family(
    ...     "ahead", worm, (0.6, 0.6, 0.0), [(0.4, 0.4, 0.0)], (0.5, 1.0), held=[push, pull]
    ... )
    >>> near = {"place": 1e-9, "angle": 1e-9}
    >>> task = P.PathTask((0.0, 0.0, 0.0), (1.5, 0.0, 0.0), near)
    >>> path = P.plan_path(task, P.Library([ahead]), (0.3, 0.1), cost="time")
    >>> bool(abs(P.simulate_path(path).pose - [1.5, 0.0, 0.0]).max() < 1e-9)
    True
    """
    start = path.task.start
    places = start[:2] + rotate(start[2], path.library.rest)
    when, course = [np.zeros(1)], [places[None]]
    for k, step in enumerate(path.steps):
        motion, places = step.motion, course[-1][-1]
        if isinstance(motion, KinematicMotion):
            tau, found = simulate_held(
                places, motion.stroke, motion.phases, lengths, heading, looks
            )
        elif isinstance(motion, Crawl):
            own = motion.course
            tau, found = simulate_crawled(
                places, own.stroke, own.crawler.ground, lengths, heading, looks
            )
        else:
            raise ArgumentError(
                f"{step.name!r} is neither constrained nor a crawl; make it with gait_family"
            )
        when.append(k + tau[1:])
        course.append(found[1:])
    return Course(np.concatenate(when), np.concatenate(course))


def least_distance(course: np.ndarray, obstacles: Sequence[Obstacle], *, points: int = 41) -> float:
    """Return the least distance of points along all links, of masses (m, n, 2), from obstacles.

    It uses points alone, neither distances of segments nor bounds of the plan: a second route.
    """
    share = np.linspace(0.0, 1.0, points)[:, None]
    a, b = course[:, :-1, None], course[:, 1:, None]
    along = (a + share * (b - a)).reshape(-1, 2)
    return min((float(_from(obstacle, along).min()) for obstacle in obstacles), default=np.inf)


def _from(obstacle: Obstacle, points: np.ndarray) -> np.ndarray:
    """Return distances of points (m, 2) from an obstacle, negative inside."""
    if isinstance(obstacle, Disc):
        off = points - np.array(obstacle.centre)
        return np.hypot(off[:, 0], off[:, 1]) - obstacle.radius
    if isinstance(obstacle, Wall):
        normal = np.array([np.cos(obstacle.angle), np.sin(obstacle.angle)])
        return (points - np.array(obstacle.point)) @ normal
    if isinstance(obstacle, Capsule):
        return _from_segment(points, np.array(obstacle.start), np.array(obstacle.end)) - (
            obstacle.radius
        )
    assert isinstance(obstacle, Block)
    corners = np.array(obstacle.corners)
    sides = zip(corners, np.roll(corners, -1, axis=0), strict=True)
    least = np.min([_from_segment(points, p, q) for p, q in sides], axis=0)
    return np.where(inside(corners, points), -least, least)


def _from_segment(points: np.ndarray, p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Return distances of points from a segment, from components along and across it."""
    size = float(np.hypot(*(q - p)))
    if size == 0:
        return np.hypot(*(points - p).T)
    e = (q - p) / size
    x, y = (points - p) @ e, (points - p) @ np.array([-e[1], e[0]])
    return np.hypot(np.maximum(np.maximum(-x, x - size), 0.0), y)
