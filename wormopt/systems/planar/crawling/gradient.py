"""Derivatives of displacement, turn and work of a slow crawl by its stroke and its ground."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError, SolveError
from wormopt.systems.planar.crawling.balance import Ground, LeastPower
from wormopt.systems.planar.crawling.crawl import Crawl
from wormopt.systems.planar.crawling.recheck import motion_at
from wormopt.systems.planar.crawling.velocity import Motion, freedom
from wormopt.systems.planar.poses import rotate
from wormopt.systems.planar.shape import Shape, Stroke

_APART, _AT_LIMIT, _ACROSS, _SOFT = 1e-8, 1e-7, 1e-9, 1e-10


@dataclass(frozen=True, eq=False)
class CrawlGradient:
    """Result of `crawl_gradient`: derivatives of the displacement and of the work of a stroke.

    Parameters
    ----------
    stroke : ndarray, shape (K, 4)
        Derivatives of x, y, angle and work in each of K directions of the stroke.
    ground : ndarray, shape (m, 3, 4)
        Derivatives by the forward, backward and sideways resistances of each mass.

    Examples
    --------
    >>> import wormopt as wo
    >>> worm = wo.planar.chain_shape(2, lengths=(1.0, 1.0))
    >>> stroke = wo.planar.Harmonics([0.7], cosine=[[0.5]], sine=[[0.0]])
    >>> found = wo.planar.crawl(worm, wo.Elliptic(1.0, 1.0, 3.0), stroke)
    >>> wo.planar.crawl_gradient(found, [stroke]).ground.shape  # 3 masses, 3 resistances, 4 results
    (3, 3, 4)
    """

    stroke: np.ndarray
    ground: np.ndarray


@dataclass(frozen=True, eq=False)
class _Instants:
    """Linearisation data of a crawl at G phases."""

    motion: Motion
    J: np.ndarray  # (G, m, 2, 3), velocities by the twist
    by: np.ndarray  # (G, m, 2, D), velocities in D directions, with constant twist
    turned: np.ndarray  # (G, 3, D), pushes on the twist, as their arms and headings turn
    slope: np.ndarray  # (G, m, 2), of the power of each mass by its velocity
    curvature: np.ndarray  # (G, m, 2, 2)
    power: np.ndarray  # (G, D), change of the ground's power at constant velocities
    push: np.ndarray  # (G, m, 2, D), change of the pushes at constant velocities


def crawl_gradient(found: Crawl, strokes: Sequence[Stroke] = ()) -> CrawlGradient:
    """Differentiate displacement and work of a slow crawl.

    At each instant the velocity of least power is differentiated as an implicit function: resting
    masses stay at rest, the others stay in balance. Shifts of breaks contribute nothing, because
    the velocity is continuous there.

    Theory: docs/theory-planar.md, section 3.

    Parameters
    ----------
    found : Crawl
        Crawl of a stroke on ground with elliptic laws.
    strokes : sequence of Stroke
        Directions d(tau) of change, s + eps d, smooth where the stroke is smooth. ``Polygon`` and
        ``Harmonics`` are linear in their coefficients. With one coefficient 1 and all others 0 they
        are the direction of that coefficient.

    Returns
    -------
    CrawlGradient
        Derivatives by the strokes and by all resistances of the ground.

    Raises
    ------
    ArgumentError
        If a direction has other shape variables, or breaks where the stroke has none.
    SolveError
        If there is no derivative: masses rest together only for this stroke, a mass stays at its
        limit of static friction, or a mass slides exactly sideways with unequal forward and
        backward resistances.

    Examples
    --------
    >>> import wormopt as wo
    >>> from wormopt.model.planar_friction import Elliptic
    >>> worm = wo.planar.chain_shape(2, lengths=(1.0, 1.0))
    >>> to_and_fro = wo.planar.Harmonics([0.7], cosine=[[0.5]], sine=[[0.0]])
    >>> found = wo.planar.crawl(worm, Elliptic(1.0, 1.0, 3.0), to_and_fro)
    >>> slopes = wo.planar.crawl_gradient(found, [to_and_fro])
    >>> slopes.stroke.shape, slopes.ground.shape
    ((1, 4), (3, 3, 4))
    """
    stroke = found.course.stroke
    for one in strokes:
        if one.n_s != stroke.n_s or not np.isin(one.breaks, stroke.breaks).all():
            raise ArgumentError(
                f"the direction has {one.n_s} variables and breaks at {one.breaks.tolist()}; write "
                f"{stroke.n_s} variables, and no breaks but those of the stroke"
            )
    tau = found.travel.nodes
    at = _instants(found, tau, strokes)
    _check(found, at)
    twist, power = _implicit(at, found.course.crawler.ground)
    weights, poses = found.travel.weights[:, None], found.travel.node_poses
    ahead = found.displacement[:2] - poses[:, :2]
    lever = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)
    way = np.stack([rotate(poses[:, 2], one) for one in np.moveaxis(twist[:, :2], 2, 0)], axis=2)
    way += lever[..., None] * twist[:, 2, None]
    rates = np.concatenate([way, twist[:, 2, None], power[:, None]], axis=1)
    total = (weights[..., None] * rates).sum(axis=0).T
    return CrawlGradient(total[: len(strokes)], total[len(strokes) :].reshape(-1, 3, 4))


def _instants(found: Crawl, tau: np.ndarray, strokes: Sequence[Stroke]) -> _Instants:
    """Return velocities, forces, and their derivatives at constant twist."""
    course, motion = found.course, motion_at(found, tau)
    shape, ground = course.crawler.shape, course.crawler.ground
    G, m, n = len(tau), shape.n_points, course.stroke.n_s
    s, ds = course.stroke.at(tau)
    given = [s.T, ds.T, motion.twist.T, -motion.forces.reshape(G, -1).T]
    J, Y, turned = (np.array(part) for part in _derivatives(shape).map(G).call(given))
    J = J.reshape(2 * m, G, 3).transpose(1, 0, 2).reshape(G, m, 2, 3)
    Y = Y.reshape(2 * m, G, 2 * n).transpose(1, 0, 2)
    turned = turned.reshape(3, G, 2 * n).transpose(1, 0, 2)
    ways = [np.concatenate(one.at(tau), axis=1) for one in strokes]
    way = np.stack(ways, axis=2) if ways else np.zeros((G, 2 * n, 0))
    slope, curvature, power, push = _of_ground(ground, motion)
    none = way.shape[2]
    return _Instants(
        motion, J,
        _beside((Y @ way).reshape(G, m, 2, -1), 3 * m, before=False),
        _beside(turned @ way, 3 * m, before=False),
        slope, curvature,
        _beside(power, none, before=True), _beside(push, none, before=True),
    )  # fmt: skip


def _beside(values: np.ndarray, count: int, *, before: bool) -> np.ndarray:
    """Return derivatives padded with zeros for `count` more directions, before or after."""
    zeros = np.zeros((*values.shape[:-1], count))
    return np.concatenate([zeros, values] if before else [values, zeros], axis=-1)


def _derivatives(shape: Shape) -> ca.Function:
    """Return derivatives of velocities v (2m) by twist and (s, rates), and of pushes.v by both."""
    v, f = ca.vec(shape.velocities), ca.SX.sym("f", 2 * shape.n_points)
    y = ca.vertcat(shape.s, shape.rates)
    J = ca.jacobian(v, shape.twist)
    parts = [ca.densify(part) for part in (J, ca.jacobian(v, y), ca.jacobian(J.T @ f, y))]
    return ca.Function("derivatives", [shape.s, shape.rates, shape.twist, f], parts)


def _of_ground(ground: Ground, motion: Motion) -> tuple[np.ndarray, ...]:
    """Return slope (G, m, 2), curvature of psi for moving masses; psi and slope by resistances.

    Resistances are ordered forward, backward, sideways for each mass.
    """
    v, go = motion.velocities, ~motion.rest
    (G, m), ahead = go.shape, v[..., 0] >= 0
    F = np.sqrt(ground.squares(v))
    psi = np.where(go, np.sqrt(((F * v) ** 2).sum(axis=-1)), 1.0)[..., None]
    slope = go[..., None] * F**2 * v / psi
    own = go[..., None, None] * np.eye(2) * (F**2 / psi)[..., None]
    curvature = own - slope[..., None] * slope[..., None, :] / psi[..., None]
    by_force = go[..., None] * F * v**2 / psi  # of psi, along and aside
    turn = 2 * np.eye(2) * (go[..., None] * F * v / psi)[..., None]
    turn = turn - slope[..., None] * (by_force / psi)[..., None, :]  # (G, m, 2, along and aside)
    power, push = np.zeros((G, m, 3)), np.zeros((G, m, 2, m, 3))
    i, sides = np.arange(m), (ahead, ~ahead, np.ones_like(ahead))
    for k, (side, part) in enumerate(zip(sides, (0, 0, 1), strict=True)):
        power[..., k] = side * by_force[..., part]
        push[:, i, :, i, k] = (side[..., None] * turn[..., part]).transpose(1, 0, 2)
    return slope, curvature, power.reshape(G, -1), push.reshape(G, m, 2, -1)


def _implicit(at: _Instants, ground: Ground) -> tuple[np.ndarray, np.ndarray]:
    """Return derivatives of the twist (G, 3, D) and of the power (G, D)."""
    G, m, _, D = at.by.shape
    rest, J = at.motion.rest, at.J
    body = LeastPower(J, np.zeros((G, m, 2)), np.zeros((G, 3)), ground)
    _, N, _ = freedom(body, np.zeros((G, 3)), rest)
    JS = (J * rest[..., None, None]).reshape(G, 2 * m, 3)
    own = (at.by * rest[..., None, None]).reshape(G, 2 * m, D)
    held = -np.linalg.pinv(JS, rcond=1e-9) @ own
    off = np.abs(JS @ held + own).max(axis=(0, 1), initial=0.0)
    size = np.abs(at.by).max(axis=(0, 1, 2), initial=0.0)
    if (off > _APART * np.maximum(size, 1e-300)).any():
        raise SolveError(
            "masses rest together only while the stroke keeps their distance, and this direction "
            "changes it: one-sided derivatives differ, and there is no derivative"
        )
    by = at.by + np.einsum("gmcn,gnd->gmcd", J, held)
    turn = np.einsum("gmce,gmed->gmcd", at.curvature, by) + at.push
    left = at.turned + np.einsum("gmcn,gmcd->gnd", J, turn)
    H = np.einsum("gmcn,gmce,gmek->gnk", J, at.curvature, J)
    inner = N.transpose(0, 2, 1) @ H @ N
    absent = np.eye(3) * (np.abs(N).max(axis=1) == 0)[:, None]
    z = np.linalg.solve(inner + absent, -N.transpose(0, 2, 1) @ left)
    twist = held + N @ z
    v = at.by + np.einsum("gmcn,gnd->gmcd", J, twist)
    _check_across(at, ground, v)
    return twist, at.power + np.einsum("gmc,gmcd->gd", at.slope, v)


def _check(found: Crawl, at: _Instants) -> None:
    """Refuse crawls in which a mass stays at its limit of static friction."""
    hold = at.motion.hold.reshape(len(found.travel.ends) - 1, -1)
    if (np.abs(hold - 1) < _AT_LIMIT).all(axis=1).any():
        raise SolveError(
            "in a part of the stroke the resting masses are exactly at their limit: one-sided "
            "derivatives differ, and there is no derivative"
        )


def _check_across(at: _Instants, ground: Ground, v: np.ndarray) -> None:
    """Refuse changes (G, m, 2, D) that turn an exactly sideways slip forward or backward."""
    sizes = np.abs(at.motion.velocities).max(axis=(1, 2))[:, None]
    across = ~at.motion.rest & ground.one_sided
    across &= np.abs(at.motion.velocities[..., 0]) < _ACROSS * sizes
    most = np.abs(v).max(axis=(0, 1, 2), initial=0.0)
    turned = across[..., None] & (np.abs(v[..., 0, :]) > _SOFT**0.5 * most)
    if turned.any():
        raise SolveError(
            "a mass slides exactly across its heading and would turn forward or backward, where "
            "resistances differ: there is no derivative"
        )
