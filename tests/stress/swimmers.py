"""Bodies in the plane: strokes on viscous ground, slow crawls on dry ground, serpenoid waves.

Judged by resistive forces written anew, by the balance of forces that proves least power, by paths
of the body, by quadrature and minimisation.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Iterable
from itertools import pairwise

import numpy as np
from scipy.integrate import quad, solve_ivp
from scipy.linalg import expm
from scipy.optimize import minimize

from tests.stress.means import least, refused, zero
from tests.stress.resistive import Chain, Heading, connection, resisted, turned
from tests.stress.strokes import STROKES
from tests.stress.verdict import Case, Dice, Judged, Undecided, above, apart, many, spread
from wormopt.model.planar_friction import Elliptic
from wormopt.systems.planar.crawling.crawl import crawl
from wormopt.systems.planar.crawling.velocity import crawl_velocity
from wormopt.systems.planar.kinematic import Constraints, kinematic_motion
from wormopt.systems.planar.planar_turn import swing_hold
from wormopt.systems.planar.poses import circle_of, compose
from wormopt.systems.planar.serpenoid import STEEPEST, best_serpenoid, serpenoid_speed
from wormopt.systems.planar.shape import Harmonics, Polygon, chain_shape
from wormopt.systems.planar.swimming.swimmer import Swimmer, swim

Rates = Callable[[float, np.ndarray], np.ndarray]


def cases(*, quick: bool) -> Iterable[Case]:
    """List the cases of bodies in the plane."""
    kinds = (
        ("swimmers", _local, 25),
        ("strokes of swimmers", _stroke, 18),
        ("slow crawls", _crawl, 25),
        ("strokes of crawls", _crawl_stroke, 6),
        ("serpenoid waves", _serpenoid, 20),
        ("best serpenoid waves", _best_wave, 5),
        ("pins and skids", _held, 8),
        ("turns in place", _turn, 8),
        ("poses", _pose, 6),
        *STROKES,
        ("no swimmers", _no_swimmer, 5),
    )
    return many(kinds, quick=quick, span=0.1)


# -- bodies ----------------------------------------------------------------------------------------


def _drawn(dice: Dice, most: int = 6) -> tuple[Chain, np.ndarray]:
    """A chain and a shape of it."""
    n = int(dice.integers(2, most + 1))
    sizes = spread(dice, 1e-3, 1e3) * dice.uniform(0.2, 2.0, n)
    bends = dice.uniform(-1, 1, n - 1) * spread(dice, 1e-3, 2.5)
    heading: Heading = ("bisector", "front", "rear")[int(dice.integers(3))]
    if dice.random() < 0.5:
        return Chain(n, tuple(sizes.tolist()), heading), bends
    return Chain(n, None, heading), np.concatenate([sizes, bends])


def _drags(dice: Dice) -> tuple[tuple[float, float], tuple[float, float]]:
    rods = (spread(dice, 1e-3, 1e3), spread(dice, 1e-3, 1e3))
    masses = (spread(dice, 1e-3, 1e3), spread(dice, 1e-3, 1e3))
    return (rods, (0.0, 0.0)) if dice.random() < 0.5 else (rods, masses)


# -- viscous ground --------------------------------------------------------------------------------


def _local(dice: Dice) -> Judged:
    chain, s = _drawn(dice)
    rods, masses = _drags(dice)
    body = Swimmer(
        chain_shape(chain.links, lengths=chain.lengths, heading=chain.heading), rods, masses
    )
    A, G = body.local(s)
    form = resisted(chain, s, rods, masses)
    size, n_s = float(np.abs(chain.places(s)[0]).max()), len(s)
    twists = np.array([[1 / size], [1 / size], [1.0]])  # by these, twists are of one size
    rates = np.ones(n_s)
    if chain.lengths is None:
        rates[: chain.links] = size
    known, power = connection(form)
    block = twists * form[:3, :3] * twists.T * size**2
    share = 1e-12 + 1e-15 * float(np.linalg.cond(block))
    yield "connection", apart(twists * A * rates, twists * known * rates, share, size=1.0)
    both = np.outer(rates, rates)
    largest = float(np.mean(both * np.abs(form[3:, 3:])))
    yield "metric", apart(both * G, both * power, share, size=largest)


def _course(dice: Dice, chain: Chain, wide: float) -> Harmonics | Polygon:
    """A stroke about a shape; lengths change by less than themselves."""
    n = chain.links
    sizes = 0 if chain.lengths else n
    mean = np.r_[np.ones(sizes), np.zeros(n - 1)]
    scale = np.r_[np.full(sizes, 0.5), np.full(n - 1, wide)]
    n_s = len(mean)
    if dice.random() < 0.4:
        return Polygon(mean + scale * dice.uniform(-1, 1, (int(dice.integers(3, 6)), n_s)))
    swing = dice.uniform(-0.5, 0.5, (2, 2, n_s)) * scale / np.array([1, 2])[:, None]
    return Harmonics(mean + 0.1 * scale * dice.normal(size=n_s), *swing)


def _even(dice: Dice, most: int) -> Chain:
    n = int(dice.integers(2, most + 1))
    varied = n == 2 or bool(dice.random() < 0.3)  # two links that only bend come back
    return Chain(n, None if varied else tuple(dice.uniform(0.5, 1.5, n).tolist()), "bisector")


def _stroke(dice: Dice) -> Judged:
    chain = _even(dice, 4)
    rods, masses = (1.0, spread(dice, 0.1, 100.0)), (0.0, 0.0)
    stroke = _course(dice, chain, spread(dice, 0.05, 1.8))
    shape = chain_shape(chain.links, lengths=chain.lengths)
    found = swim(Swimmer(shape, rods, masses), stroke)

    def rates(tau: float, y: np.ndarray) -> np.ndarray:
        s, ds = stroke.at(tau)
        v, w, turn = connection(resisted(chain, s[0], rods, masses))[0] @ ds[0]
        c, n = math.cos(y[2]), math.sin(y[2])
        return np.array([c * v - n * w, n * v + c * w, turn])

    def speed(tau: float) -> float:
        s, ds = stroke.at(tau)
        G = connection(resisted(chain, s[0], rods, masses))[1]
        return math.sqrt(max(float(ds[0] @ G @ ds[0]), 0.0))

    size = 1e-2 * float(found.length)
    pose = _followed(rates, stroke.breaks, np.zeros(3))
    yield "displacement", apart(found.displacement, pose, 1e-6, size=size)
    sides = (quad(speed, a, b - 1e-13 * (b - a), limit=200)[0] for a, b in pairwise(stroke.breaks))
    yield "length", apart(found.length, sum(sides), 1e-6)


def _followed(rates: Rates, breaks: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Follow a pose from break to break; at a break the course is that of the next side."""
    for a, b in pairwise(breaks):
        inside = 1e-13 * (b - a)
        y = solve_ivp(rates, (a, b - inside), y, rtol=1e-8, atol=1e-9, method="DOP853").y[:, -1]
    return y


# -- dry ground ------------------------------------------------------------------------------------


def _grounds(dice: Dice, masses: int) -> np.ndarray:
    """F+, F- and Fn of each mass, (3, m)."""
    ahead = dice.uniform(0.5, 2.0, masses) * spread(dice, 1e-3, 1e3)
    back = ahead * (1.0 if dice.random() < 0.3 else spread(dice, 1.0, 100.0))
    return np.array([ahead, back, ahead * spread(dice, 0.3, 30.0) * dice.uniform(0.8, 1.2, masses)])


def _powers(ground: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Power of masses by their velocities (m, 2) along and across."""
    along = np.where(v[:, 0] >= 0, ground[0], ground[1])
    return np.hypot(along * v[:, 0], ground[2] * v[:, 1])


def _proof(
    ground: np.ndarray, v: np.ndarray, forces: np.ndarray, balance: np.ndarray
) -> tuple[float, float, float]:
    """By how much velocities and forces miss what proves least power.

    Forces push with all the power the law takes, lie within its bounds, and balance: then no other
    twist takes less, whatever it is.
    """
    limit = np.where(forces[:, 0] <= 0, ground[0], ground[1])  # of a force on the worm
    gauge = float(np.hypot(forces[:, 0] / limit, forces[:, 1] / ground[2]).max())
    lost = _powers(ground, v).sum()
    given = -float(np.sum(forces * v))
    return gauge - 1, abs(lost - given) / max(lost, 1e-300), float(np.abs(balance).max())


def _crawl(dice: Dice) -> Judged:
    chain, s = _drawn(dice, 5)
    n_s = len(s)
    ds = dice.normal(size=n_s) * spread(dice, 1e-3, 1e3)
    points, looks, by = chain.moving(s)
    size, m = float(np.abs(points).max()), len(points)
    if chain.lengths is None:
        ds[: chain.links] *= size
    ground = _grounds(dice, m)
    load = np.zeros(3)
    if dice.random() < 0.4:
        load = 0.3 * ground[:2].min() * dice.uniform(-1, 1, 3) * np.array([1, 1, size])
    shape = chain_shape(chain.links, lengths=chain.lengths, heading=chain.heading)
    found = crawl_velocity(shape, [Elliptic(*g) for g in ground.T.tolist()], s, ds, load=load)
    turns = np.array([turned(look) for look in looks])
    rows = np.einsum("mij,mjk->mik", turns, by)  # velocities along and across
    v = rows @ np.concatenate([found.twist[0], ds])
    speed = float(np.abs(rows[:, :, 3:] @ ds).max())
    yield "velocities", apart(found.velocities[0], v, 1e-8, size=speed)
    forces = found.forces[0]
    missed = np.einsum("mi,mik->k", forces, rows[:, :, :3]) + load
    missed = missed / np.array([1, 1, size]) / ground.max(axis=1).max()
    gauge, power, balance = _proof(ground, found.velocities[0], forces, missed)
    yield "bounds of forces", max(gauge, 0.0) / 1e-9
    yield "power of forces", power / 1e-9
    yield "balance of forces", balance / 1e-9
    told = _powers(ground, v).sum() - load @ found.twist[0]
    yield (
        "least power",
        above(told, _least_power(ground, rows, ds, load, size), 1e-7, size=1e-9 * told),
    )


def _least_power(
    ground: np.ndarray, rows: np.ndarray, ds: np.ndarray, load: np.ndarray, size: float
) -> float:
    """Least power less that of the load, by a simplex from a few starts: from above."""
    unit = float(np.abs(rows[:, :, 3:] @ ds).max())
    scale = unit * np.array([1, 1, 1 / size])
    swing = rows[:, :, 3:] @ ds

    def power(x: np.ndarray) -> float:
        twist = scale * x
        return float(_powers(ground, rows[:, :, :3] @ twist + swing).sum() - load @ twist)

    best = np.zeros(3)
    for _ in range(3):
        best = minimize(power, best, method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 0}).x
    return power(best)


def _crawl_stroke(dice: Dice) -> Judged:
    """The way of a stroke from velocities at even phases, each proven to take least power."""
    n = int(dice.integers(2, 4))
    lengths = None if n == 2 else tuple(dice.uniform(0.7, 1.3, n).tolist())
    chain = Chain(n, lengths, "bisector")
    stroke = _course(dice, chain, float(dice.uniform(0.3, 1.0)))
    ground = _grounds(dice, n + 1)
    laws = [Elliptic(*g) for g in ground.T.tolist()]
    shape = chain_shape(n, lengths=lengths)
    found = crawl(shape, laws, stroke)
    parts, ends = 3200 // (len(stroke.breaks) - 1), stroke.breaks
    step = np.repeat(np.diff(ends) / parts, parts)
    shapes, rates = stroke.at(np.cumsum(step) - step / 2)
    motion = crawl_velocity(shape, laws, shapes, rates)
    for k in range(0, len(step), 40):
        _, looks, by = chain.moving(shapes[k])
        rows = np.einsum("mij,mjk->mik", np.array([turned(look) for look in looks]), by)
        v = rows @ np.concatenate([motion.twist[k], rates[k]])
        missed = np.einsum("mi,mik->k", motion.forces[k], rows[:, :, :3]) / ground.max()
        yield "proof", max(_proof(ground, v, motion.forces[k], missed)) / 1e-7
    pose, turn = 0j, 0.0
    for (a, b, w), h in zip(motion.twist, step, strict=True):
        half = w * h / 2  # a constant twist goes round a circle
        chord = complex(a, b) * h * (math.sin(half) / half if half else 1.0)
        pose += chord * cmath.exp(1j * (turn + half))
        turn += w * h
    yield "place", apart(found.displacement[:2], [pose.real, pose.imag], 1e-3, size=0.1)
    yield "turn", apart(found.displacement[2], turn, 1e-3, size=0.1)
    yield "work", apart(found.work, float(motion.power @ step), 1e-4)


# -- serpenoid waves -------------------------------------------------------------------------------


def _mean(f: Callable[[float], float]) -> float:
    """Mean over a quarter of a wave, of which all are alike."""
    return quad(f, 0, math.pi / 2, epsabs=1e-13, epsrel=1e-12, limit=200)[0] / (math.pi / 2)


def _speed(alpha: float, ratio: float, ground: str) -> float:
    """Speed by the recoil w: least power, or a balance of forces."""
    ahead = _mean(lambda x: math.cos(alpha * math.sin(x)))

    def force(w: float) -> float:
        def push(x: float) -> float:
            c, n = math.cos(alpha * math.sin(x)), math.sin(alpha * math.sin(x))
            along, aside = 1 - w * c, w * n
            if ground == "viscous":
                return along * c - ratio * aside * n
            if ground == "unit":
                return (along * c - ratio * aside * n) / math.hypot(along, aside)
            return (along * c - ratio**2 * aside * n) / math.hypot(along, ratio * aside)

        return _mean(push)

    high = 1.0
    while force(high) > 0:
        high *= 2
    return ahead - zero(force, 0.0, high)


def _serpenoid(dice: Dice) -> Judged:
    alpha, ratio = float(dice.uniform(0.05, 1.0)) * STEEPEST * 0.999, spread(dice, 0.05, 50.0)
    for ground in ("viscous", "elliptic", "unit"):
        known = _speed(alpha, ratio, ground)
        yield ground, apart(serpenoid_speed(alpha, ratio, ground), known, 1e-8, size=1e-2)


def _best_wave(dice: Dice) -> Judged:
    ratio, ground = spread(dice, 1.3, 100.0), "viscous" if dice.random() < 0.5 else "elliptic"
    alpha, speed = best_serpenoid(ratio + 2 * (ground == "elliptic"), ground)
    ratio += 2 * (ground == "elliptic")  # waves on dry ground carry back where it is little
    at, lowest = least(lambda a: -_speed(a, ratio, ground), 0.05, 2.3, 1e-6)
    yield "speed", apart(speed, -lowest, 1e-8)
    yield "amplitude", apart(alpha, at, 1e-4)


# -- held bodies, poses ----------------------------------------------------------------------------


def _held(dice: Dice) -> Judged:
    """Two links, the tail pinned, a skid at the head: its angle obeys one equation."""
    corners = np.column_stack(
        [dice.uniform(0.5, 1.5, (4, 2)), dice.uniform(-1.2, 1.2, 4)]
    )  # lengths, angle
    stroke = Polygon(corners)
    shape = chain_shape(2)
    found = kinematic_motion(shape, stroke, Constraints(pins=(2,), skids=(0,)))

    def rates(tau: float, _: np.ndarray) -> np.ndarray:
        s, ds = stroke.at(tau)
        (one, two, phi), (_, d_two, d_phi) = s[0], ds[0]
        # across the first link, which turns with the second and with the joint, the head is at rest
        rear = (d_two * math.sin(phi) - one * d_phi) / (one + two * math.cos(phi))
        return np.array([rear + d_phi])

    turn = _followed(rates, stroke.breaks, np.zeros(1))[0]
    yield "turn", apart(found.displacement[2], turn, 1e-7, size=0.1)
    one, two, phi = corners[0]
    tail = -one - two * cmath.exp(-1j * phi)  # seen from the head, which looks along x
    way = tail - tail * cmath.exp(1j * turn)
    yield "place", apart(found.displacement[:2], [way.real, way.imag], 1e-7, size=0.1)


def _turn(dice: Dice) -> Judged:
    """What a resting link needs of its hold: the least of all splits of the force along it."""
    phi, ratio, grip = (
        float(dice.uniform(-3, 3)),
        float(dice.uniform(0.02, 1)),
        spread(dice, 0.2, 20),
    )
    across, along = abs(math.cos(phi) + ratio), abs(math.sin(phi))

    def worst(near: float) -> float:
        return max(math.hypot(across, near) / grip, math.hypot(ratio, along - near))

    known = min(least(worst, 0.0, along, 1e-12)[1], worst(0.0), worst(along))
    yield "hold", apart(swing_hold(phi, ratio, grip), known, 1e-7)


def _pose(dice: Dice) -> Judged:
    a, b = dice.normal(size=(2, 3)) * spread(dice, 1e-3, 1e3)

    def matrix(pose: np.ndarray) -> np.ndarray:
        turn = expm(np.array([[0, -pose[2]], [pose[2], 0]]))
        return np.block([[turn, pose[:2, None]], [np.zeros((1, 2)), np.ones((1, 1))]])

    both = matrix(a) @ matrix(b)
    found = compose(a, b)
    yield "place", apart(found[:2], both[:2, 2], 1e-10)
    small = np.array([a[0], a[1], float(dice.uniform(0.01, 6.0))])
    circle = circle_of(small)
    if circle is None:
        raise Undecided("it does not turn")
    fixed = np.linalg.solve(np.eye(2) - matrix(small)[:2, :2], small[:2])
    yield "centre", apart(circle.centre, fixed, 1e-9)
    yield "radius", apart(circle.radius, math.hypot(*fixed), 1e-9)


def _no_swimmer(dice: Dice) -> Judged:
    """Bodies and strokes that cannot be."""
    more = 1 + spread(dice, 1e-6, 1e2)
    shape = chain_shape(2, lengths=(1.0, 1.0))
    yield "drag", refused(lambda: Swimmer(shape, rods=(1.0, -more)), "rods", "drags")
    yield "no drag", refused(lambda: Swimmer(shape, rods=(0.0, more)), "resist", "above 0")
    yield "length", refused(lambda: chain_shape(2, lengths=(1.0, -more)), "positive")
    wrong = Harmonics([0.0, 0.0], [[1.0, 0.0]], [[0.0, 1.0]])
    yield "stroke", refused(lambda: swim(Swimmer(shape, (1.0, 2.0)), wrong), "shape variables")
    yield "amplitude", refused(lambda: serpenoid_speed(STEEPEST * more, 2.0), "alpha", "below")
    yield "ratio", refused(lambda: best_serpenoid(1 / more), "ratio", "above 1")
    yield "held", refused(lambda: Constraints(pins=(0,)), "pin", "skid")
    law = Elliptic(1.0, 1.0, 1.0)
    load = (3.0 * more, 0.0, 0.0)
    yield "load", refused(lambda: crawl_velocity(shape, law, [0.3], [1.0], load=load), "load")
    link = chain_shape(1)  # which end rests is open
    yield (
        "open",
        refused(lambda: crawl_velocity(link, law, [more], [1.0]), "the motion is not unique"),
    )
