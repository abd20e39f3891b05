"""Fast crawls by another program: midpoint rule, friction as tanh of falling width, many starts.

It shares nothing with the optimiser of the package but CasADi's IPOPT. Its inputs are constant
between equal steps, so that a simulation can score them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

# Widths of the tanh over the usual speed, and steps of a cycle.
_WIDTHS, _STEPS = (0.5, 0.1, 0.02, 0.005), 50
_OPTIONS = {
    "print_time": False,
    "error_on_fail": False,
    "expand": True,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.max_iter": 400,
    "ipopt.tol": 1e-7,
}


@dataclass(frozen=True)
class Found:
    """Inputs of a cycle, and the objective with smoothed friction."""

    duration: float
    inputs: np.ndarray  # (links, steps)
    merit: float  # speed less effort


def crawls(scene: dict[str, Any], starts: int, seed: int) -> Iterator[Found]:
    """Solve from random waves; yields what converged."""
    dice, period = np.random.default_rng([1, seed]), scene["limits"]["period"]
    omega = _sizes(scene)[2]
    for k in range(starts):
        if isinstance(period, list):
            duration = min(period[1], 2 * np.pi / omega * 2 ** dice.uniform(-1.5, 1.0))
            range_ = (0.05 * period[0], period[1])
        else:
            duration = period / (1 + k % 3)
            range_ = (duration, duration)
        if (found := _solved(scene, duration, range_, dice)) is not None:
            yield found


def _sizes(scene: dict[str, Any]) -> tuple[float, float, float]:
    """Units of mass, length and of angular frequency."""
    worm = scene["worm"]
    mass, stiffness = float(np.mean(worm["mass"])), float(np.mean(worm["stiffness"]))
    return mass, 0.25 * worm["rest_length"], float(np.sqrt(stiffness / mass))


def _solved(
    scene: dict[str, Any], duration: float, range_: tuple[float, float], dice: np.random.Generator
) -> Found | None:
    worm, limits, effort = scene["worm"], scene["limits"], scene["objective"]["effort"]
    mass, length, omega = _sizes(scene)
    n, speed, force = worm["links"], length * omega, mass * length * omega**2
    m = ca.DM(worm["mass"]) / mass
    c, d = ca.DM(worm["stiffness"]) * length / force, worm["damping"] * speed / force
    rest, most = worm["rest_length"] / length, limits["actuator_force"] / force
    ahead, back = (worm["friction"][k] / force for k in ("forward", "backward"))
    load = ca.DM(worm["load"]) / force
    opti = ca.Opti()
    l, v, u = (
        opti.variable(n, _STEPS + 1),
        opti.variable(n + 1, _STEPS + 1),
        opti.variable(n, _STEPS),
    )
    T, width = opti.variable(), opti.parameter()
    h, middle_l, middle_v = T / _STEPS, (l[:, 1:] + l[:, :-1]) / 2, (v[:, 1:] + v[:, :-1]) / 2
    rate = middle_v[:-1, :] - middle_v[1:, :]
    link = ca.repmat(c, 1, _STEPS) * (middle_l - rest) + d * rate - u
    none = ca.MX(1, _STEPS)
    ground = (back - ahead) / 2 - (back + ahead) / 2 * ca.tanh(
        middle_v / width + np.arctanh((back - ahead) / (back + ahead))
    )
    net = ca.vertcat(none, link) - ca.vertcat(link, none) + ground - ca.repmat(load, 1, _STEPS)
    acceleration = net / ca.repmat(m, 1, _STEPS)
    opti.subject_to(ca.vec(l[:, 1:] - l[:, :-1] - h * rate) == 0)
    opti.subject_to(ca.vec(v[:, 1:] - v[:, :-1] - h * acceleration) == 0)
    opti.subject_to(l[:, 0] == l[:, -1])
    opti.subject_to(v[:, 0] == v[:, -1])
    opti.subject_to(opti.bounded(-most, ca.vec(u), most))
    low, high = (end / length for end in limits["length"])
    opti.subject_to(opti.bounded(low, ca.vec(l), high))
    scaled = [omega * end for end in range_]
    if scaled[0] < scaled[1]:
        opti.subject_to(opti.bounded(scaled[0], T, scaled[1]))
    else:
        opti.subject_to(scaled[0] == T)
    if (limit := limits.get("rate")) is not None:
        opti.subject_to(opti.bounded(-limit / speed, ca.vec(v[:-1, :] - v[1:, :]), limit / speed))
    if (limit := limits.get("acceleration")) is not None:
        of_links = ca.vec(acceleration[:-1, :] - acceleration[1:, :])
        size = limit / speed / omega
        opti.subject_to(opti.bounded(-size, of_links, size))
    if (limit := limits.get("actuator_power")) is not None:
        opti.subject_to(ca.vec(u * rate) <= limit / force / speed)
    merit = ca.sum2(middle_v[0, :]) / _STEPS - effort * force**2 / speed * ca.sumsqr(u) / _STEPS
    opti.minimize(-merit)
    opti.solver("ipopt", _OPTIONS)
    phase = dice.uniform(0, 2 * np.pi, (n, 1))
    t = np.linspace(0, 2 * np.pi, _STEPS + 1)[None]
    opti.set_initial(l, rest + 0.5 * np.cos(t + phase))
    opti.set_initial(T, omega * duration)
    opti.set_initial(u, dice.uniform(0.2, 0.9) * most * np.cos(t[:, :-1] + phase + 1.0))
    guess = None
    for one in _WIDTHS:
        opti.set_value(width, one)
        if guess is not None:
            opti.set_initial(guess.value_variables())
        try:
            guess = opti.solve()
        except RuntimeError:
            return None
        if not guess.stats()["success"]:
            return None
    assert guess is not None
    inputs = force * np.reshape(guess.value(u), (n, _STEPS))
    return Found(float(guess.value(T)) / omega, inputs, speed * float(guess.value(merit)))
