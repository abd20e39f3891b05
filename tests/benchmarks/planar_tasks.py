"""Planar stops and crawls: what is simulated, and the answer."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tests.oracles.planar_worm import Drive, PlanarWorm, block
from wormopt.model.model import Model
from wormopt.model.planar_friction import Elliptic
from wormopt.systems.planar.dynamics.driven import driven_shape
from wormopt.systems.planar.shape import rigid_shape

TRIPOD_ANGLES = np.radians([90.0, 210.0, 330.0])
"""Where the feet of the tripod are, on a circle of radius 1."""


@dataclass(frozen=True, eq=False)
class Stop:
    """A motion that all solvers are asked for."""

    name: str
    title: str
    build: Callable[[], Model]
    span: float
    end: np.ndarray  # places at the end: the model's first states
    stop: float  # when all is at rest; NaN where the motion goes on
    source: str
    worm: PlanarWorm | None = None  # for those who write the masses down by hand


def stop_under_load(
    friction: float, load: float, speed: float, angle: float
) -> tuple[float, np.ndarray]:
    """Time and place of a block's stop: mass 1, isotropic friction above a load along x.

    `angle`: between the load and the first velocity. The hodograph in closed form: with the
    half angle's tangent q and k = F/f, speed ~ q^(k-1) (1 + q²), and x and y are powers of q.
    """
    if load == 0:
        way = speed**2 / (2 * friction)
        return speed / friction, way * np.array([math.cos(angle), math.sin(angle)])
    k, q0 = friction / load, math.tan(angle / 2)
    # s = C q^(k-1) (1+q²); f s sin(a) dt = -s da  =>  dt = -(C/f) (1+q²) q^(k-2) dq
    c = speed / (q0 ** (k - 1) * (1 + q0**2))
    time = c / load * (q0 ** (k - 1) / (k - 1) + q0 ** (k + 1) / (k + 1))
    x = c**2 / load * (q0 ** (2 * k - 2) / (2 * k - 2) - q0 ** (2 * k + 2) / (2 * k + 2))
    y = 2 * c**2 / load * (q0 ** (2 * k - 1) / (2 * k - 1) + q0 ** (2 * k + 1) / (2 * k + 1))
    return time, np.array([x, y])


def _stopping(name: str, what: str, friction: float) -> Stop:
    time, place = stop_under_load(friction, 1.0, 1.0, math.pi / 2)
    worm = block([0.0, 1.0], [friction] * 3, load=(1.0, 0.0))
    return Stop(name, what, worm.model, 1.5 * time, place, time, "closed form", worm)


def _elliptic_block() -> Stop:
    worm = block([1.0, 1.0], [1.0, 1.0, 2.0])
    # v_t = e^-T, v_n = e^-4T, dt = psi dT: three quadratures, 16 digits by substitution
    nodes, weights = np.polynomial.legendre.leggauss(60)
    u, du = 0.5 * (nodes + 1), 0.5 * weights  # u = e^-T from 0 to 1
    psi = np.sqrt(u**2 + 4 * u**8)
    time, x, y = (float(du @ (psi * f / u)) for f in (1.0, u, u**4))
    what = "a block that resists twice as much sideways, pushed aslant"
    source = "quadrature in the logarithm of the speed along"
    return Stop("elliptic", what, worm.model, 1.8, np.array([x, y]), time, source, worm)


def tripod() -> Model:
    """Rigid body of three masses 1 at distance 1, isotropic friction 1 on each."""
    feet = [(math.cos(a), math.sin(a)) for a in TRIPOD_ANGLES]
    return driven_shape(
        rigid_shape(feet), mass=1.0, law=Elliptic(1.0, 1.0, 1.0), velocity=(1.0, 0.0), turning=1.0
    )


def triangle() -> PlanarWorm:
    """Three masses that three driven springs join, on isotropic ground: they turn and crawl."""
    cosine = np.array([[3.0, -1.0, 2.0], [0.5, 1.0, -0.5]])
    sine = np.array([[1.0, 3.0, -2.0], [-1.0, 0.5, 1.0]])
    return PlanarWorm(
        np.array([1.0, 0.8, 1.2]),
        np.array([[1.0, 0.1], [0.0, 0.9], [-0.1, 0.0]]),
        np.zeros((3, 2)),
        *[np.array([1.0, 0.7, 1.3])] * 3,
        pairs=[(0, 1), (1, 2), (2, 0)],
        stiffness=np.array([12.0, 10.0, 11.0]),
        damping=np.array([1.0, 0.8, 1.2]),
        length=np.array([1.3, 0.9, 1.1]),
        drive=Drive(cosine, sine, 2.0),
        looks=False,
    )


_TRIPOD_END = (0.790731306371, 0.174436205446, 0.824935613109)
_TRIANGLE_END = (
    *(1.08911100344, 0.58739208008, -0.29488711318),
    *(0.31485525912, -0.22308752436, -0.04158432860),
)

TASKS = {
    task.name: task
    for task in (
        _stopping("block", "a block under half the load that would carry it off", 2.0),
        _elliptic_block(),
        Stop(
            "tripod",
            "a rigid tripod that comes to pivot on a foot, then rests",
            tripod,
            2.0,
            np.array(_TRIPOD_END),
            1.657170846008,
            "SciPy with a slowed time to a speed of 1e-13, then closed form (test_bench_planar.py)",
        ),
        Stop(
            "triangle",
            "three masses that three springs drive, t = 6",
            lambda: triangle().model(),
            6.0,
            np.array(_TRIANGLE_END),
            math.nan,
            "tests/oracles/planar_loop.py",
            triangle(),
        ),
    )
}
