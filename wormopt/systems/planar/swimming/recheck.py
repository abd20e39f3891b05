"""Second routes to strokes on viscous ground: the best stroke, and the displacement of any.

The best stroke has harmonic coefficients and even phases, and shares only the local connection with
collocation. The displacement is a sum over even phases, the angle an integral of its trigonometric
polynomial. The harmonics include the pace, and SciPy's sequential quadratic programming uses exact
gradients. `stepped` shares nothing with the local connection: drags act at Gauss points of the rods
as vectors in the plane, the pose is that in the plane, and SciPy's DOP853 integrates it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import minimize

from wormopt.errors import SolveError
from wormopt.systems.planar.poses import rotate
from wormopt.systems.planar.shape import Harmonics, Stroke
from wormopt.systems.planar.swimming.swimmer import Swimmer

_ORDERS, _PER_ORDER, _STEPS = 14, 12, 400
# Harmonics are added until they change the efficiency by at most this share, up to a number.
_SETTLED, _MORE, _MOST = 1e-9, 10, 94


@dataclass(frozen=True, eq=False)
class SpectralStroke:
    """A stroke of harmonics, its efficiency, and its turn."""

    stroke: Harmonics
    efficiency: float
    turn: float
    iterations: int
    change: float  # relative change of the efficiency by the last added harmonics


def spectral_stroke(
    swimmer: Swimmer, first: Harmonics, drag: float, *, orders: int = _ORDERS
) -> SpectralStroke:
    """Return the best stroke near the ellipse of the first harmonic of another stroke.

    The mean and first harmonic of `first` are the start; `drag` is that of the straight body, for
    the efficiency. SolveError if the search does not converge.
    """
    start = Harmonics(first.mean, first.cosine[:1], first.sine[:1])
    found = _climbed(swimmer, start, drag, orders)
    while not found.change <= _SETTLED:
        orders += _MORE
        if orders > _MOST:
            raise SolveError(
                f"{_MOST} harmonics do not suffice: the last {_MORE} changed the efficiency by a "
                f"share of {found.change:.1g}",
                "write wider limits, so that the stroke has gentler bends",
            )
        more = _climbed(swimmer, found.stroke, drag, orders)
        found = replace(more, change=abs(more.efficiency / found.efficiency - 1))
    return found


def _climbed(swimmer: Swimmer, first: Harmonics, drag: float, orders: int) -> SpectralStroke:
    """Return the best stroke of `orders` harmonics, starting from one with fewer."""
    n, known = first.n_s, len(first.cosine)
    phases = np.arange(_PER_ORDER * orders) / (_PER_ORDER * orders)
    rows = np.arange(1, orders + 1)
    angle = 2 * np.pi * np.outer(phases, rows)
    # coefficients of order h are scaled by h, so that all matter alike
    base = np.hstack([np.ones((len(phases), 1)), np.cos(angle) / rows, np.sin(angle) / rows])
    slope = 2 * np.pi * np.hstack([np.zeros((len(phases), 1)), -np.sin(angle), np.cos(angle)])
    start = np.zeros((2 * orders + 1, n))
    start[0] = first.mean
    start[1 : known + 1] = first.cosine * rows[:known, None]
    start[orders + 1 : orders + known + 1] = first.sine * rows[:known, None]
    objective = _objective(swimmer, base, slope, drag)

    def cost(c: np.ndarray) -> tuple[float, np.ndarray]:
        value, gradient, _, _ = objective(c)
        return -float(value), -np.asarray(gradient).ravel()

    turn = {
        "type": "eq",
        "fun": lambda c: np.asarray(objective(c)[2]).ravel(),
        "jac": lambda c: np.asarray(objective(c)[3]),
    }
    found = minimize(
        cost, start.ravel(order="F"), jac=True, method="SLSQP", constraints=[turn],
        options={"maxiter": _STEPS, "ftol": 1e-15},
    )  # fmt: skip
    if not found.success and found.status != 8:  # 8: no step gains any more
        raise SolveError(f"the search over harmonics ended: {found.message}", "write other starts")
    c = found.x.reshape(2 * orders + 1, n, order="F")
    stroke = Harmonics(c[0], c[1 : orders + 1] / rows[:, None], c[orders + 1 :] / rows[:, None])
    value, _, turned, _ = objective(found.x)
    efficiency, steps = float(np.exp(float(value))), int(found.nit)
    return SpectralStroke(stroke, efficiency, float(turned), steps, np.inf)


def _objective(swimmer: Swimmer, base: np.ndarray, slope: np.ndarray, drag: float) -> ca.Function:
    """Return the logarithm of efficiency, and the turn, with gradients by the coefficients."""
    count, n = len(base), swimmer.shape.s.numel()
    c = ca.MX.sym("c", base.shape[1] * n)
    table = ca.reshape(c, base.shape[1], n)
    shapes, rates = ca.mtimes(ca.DM(base), table), ca.mtimes(ca.DM(slope), table)
    s, ds = swimmer.shape.s, swimmer.shape.rates
    twist = ca.mtimes(swimmer.connection, ds)
    power = ca.dot(ds, ca.mtimes(swimmer.metric, ds))
    point = ca.Function("point", [s, ds], [twist, power]).map(count)
    xi, powers = point(shapes.T, rates.T)
    angle = ca.mtimes(xi[2, :], ca.DM(_primitive(count)).T)
    turn = ca.sum2(xi[2, :]) / count
    cos, sin = ca.cos(angle), ca.sin(angle)
    way_x = ca.sum2(cos * xi[0, :] - sin * xi[1, :]) / count
    way_y = ca.sum2(sin * xi[0, :] + cos * xi[1, :]) / count
    work = ca.sum2(powers) / count
    value = ca.log(drag * (way_x**2 + way_y**2)) - ca.log(work)
    return ca.Function("objective", [c], [value, ca.gradient(value, c), turn, ca.jacobian(turn, c)])


def _primitive(count: int) -> np.ndarray:
    """Return the matrix from values of a trigonometric polynomial to its integral from 0."""
    orders = np.fft.fftfreq(count, 1 / count)
    wave = np.fft.fft(np.eye(count), axis=0)
    factor = np.zeros(count, complex)
    kept = (orders != 0) & (np.abs(orders) < count / 2)
    factor[kept] = 1 / (2j * np.pi * orders[kept])
    swing = np.fft.ifft(factor[:, None] * wave, axis=0).real
    phases = np.arange(count) / count
    return swing - swing[0] + np.outer(phases, np.full(count, 1 / count))


_AT = np.array([-1.0, 1.0]) / (2 * np.sqrt(3.0))  # Gauss's points from the middle of a rod


def balanced(swimmer: Swimmer, s: np.ndarray, rates: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the twist (3) of the body's frame at which all drags balance, and their power."""
    places, headings, J, B = map(np.asarray, swimmer.shape.kinematics(s))
    places, headings = places.T, headings.ravel()
    own = J.reshape(-1, 2, 3), (B @ rates).reshape(-1, 2)
    c, sn = np.cos(headings), np.sin(headings)
    back = np.stack([np.stack([c, -sn], -1), np.stack([sn, c], -1)], -2)
    by_twist, by_rates = back @ own[0], np.einsum("mij,mj->mi", back, own[1])
    force, moment = np.zeros((2, 4)), np.zeros(4)
    ahead = np.stack([c, sn], axis=-1)
    drags = [
        (places[i], ahead[i], by_twist[i], by_rates[i], *swimmer.masses) for i in range(len(places))
    ]
    for j in range(1, len(places)):
        d = places[j - 1] - places[j]
        length = np.hypot(*d)
        for at in _AT:
            front, rear = 0.5 + at, 0.5 - at
            drags.append((
                front * places[j - 1] + rear * places[j], d / length,
                front * by_twist[j - 1] + rear * by_twist[j],
                front * by_rates[j - 1] + rear * by_rates[j],
                swimmer.rods[0] * length / 2, swimmer.rods[1] * length / 2,
            ))  # fmt: skip
    pulls = []
    for place, e, twist, rate, along, across in drags:
        n = np.array([-e[1], e[0]])
        drag = along * np.outer(e, e) + across * np.outer(n, n)
        velocity = np.column_stack([twist, rate])  # by the twist, and 1
        pull = -drag @ velocity
        force += pull
        moment += place[0] * pull[1] - place[1] * pull[0]
        pulls.append((pull, velocity))
    rows = np.vstack([force, moment])
    twist = np.linalg.solve(rows[:, :3], -rows[:, 3])
    whole = np.append(twist, 1.0)
    return twist, float(-sum((pull @ whole) @ (velocity @ whole) for pull, velocity in pulls))


def stepped(swimmer: Swimmer, stroke: Stroke, tolerance: float = 1e-10) -> np.ndarray:
    """Return displacement (3) of a stroke, from break to break, and work at even phases."""

    def moves(tau: float, pose: np.ndarray, end: float) -> np.ndarray:
        s, rates = stroke.at(np.array([min(tau, end)]))
        twist, power = balanced(swimmer, s[0], rates[0])
        return np.concatenate([rotate(pose[2], twist[:2]), twist[2:], [power]])

    pose = np.zeros(4)
    for begin, end in zip(stroke.breaks, stroke.breaks[1:], strict=False):
        last = np.nextafter(end, begin)  # at a break the rate is that of what follows
        found = solve_ivp(
            moves, (begin, end), pose, "DOP853", rtol=tolerance, atol=tolerance, args=(last,)
        )  # fmt: skip
        pose = found.y[:, -1]
    return pose
