"""Dry friction in the plane by other people's integrators: the second route of planar worms.

A sliding mass is told by the logarithm of its speed and the direction it goes. In a time T that
runs the faster the slower the slowest mass is, dt = dT / (1 + sum of s0 / s_i), its equations are
smooth up to a stop, which lies at T = infinity: a stop is no singular point, a near miss turns back
by itself, and nothing has to be told apart by size. The mass is set to rest where its speed has
fallen by fourteen decades. Then the force that it needs decides, mass by mass: it rests if the
ground can give it, else it slides off along what the nearest force in the ellipse leaves over.
After a release the direction follows the forces ever faster the slower the mass is: there Radau
goes on until the mass has some speed. All else is DOP853 and terminal events of SciPy.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from tests.oracles.driven_chain import Grip, Happening, Motion, Plant
from tests.oracles.integrators import event_loop
from tests.oracles.planar_worm import PlanarWorm, flat, plane

_BRISK = 0.1  # speed s0, below which time runs slower
_GROWN = 2e-3  # speed from which a mass that was let go needs no implicit steps
_MOST = 2000  # starts of an integrator


@dataclass(frozen=True)
class Care:
    """How exactly a motion is followed."""

    relative: float = 1e-12
    fresh: float = 1e-8  # of the direction, and of the logarithm of a speed below `_GROWN`
    stop: float = 1e-14  # speed at which a mass is at rest
    seed: float = 1e-12  # speed with which a mass is let go
    step: float = 0.1  # longest, in T


TIGHT, LOOSE = Care(), Care(1e-11, 3e-8, 1e-13, 1e-11, 0.08)


def force_of(direction: complex, resistance: Sequence[float]) -> complex:
    """Friction of an ellipse F+, F-, Fn while sliding along a direction, in the frame of the body.

    Vectors are complex numbers.
    """
    ahead = resistance[0] if direction.real >= 0 else resistance[1]
    along, across = ahead * direction.real, resistance[2] * direction.imag
    return -complex(ahead * along, resistance[2] * across) / math.hypot(along, across)


def held(force: np.ndarray, resistance: Sequence[float]) -> float:
    """Length of a force at rest in units of the ellipse's radius in its direction."""
    ahead = resistance[0] if force[0] < 0 else resistance[1]
    return float(np.hypot(force[0] / ahead, force[1] / resistance[2]))


def nearest(force: np.ndarray, resistance: Sequence[float]) -> np.ndarray:
    """Force of the ellipse that is nearest to one out of it."""
    ahead = resistance[0] if force[0] < 0 else resistance[1]
    squared = np.array([ahead, resistance[2]]) ** 2

    def excess(shift: float) -> float:
        return float(np.sum(squared * (force / (squared + shift)) ** 2)) - 1.0

    far = float(np.sqrt(np.sum(squared * force**2)))
    shift = brentq(excess, 0.0, far, xtol=1e-16) if excess(0.0) > 0 else 0.0
    return squared * force / (squared + shift)


@dataclass
class _Planar:
    worm: PlanarWorm
    care: Care
    slides: np.ndarray  # (m,) whether
    fresh: np.ndarray  # (m,) whether let go and still slow
    happenings: list[Happening] = field(default_factory=list)

    def __post_init__(self) -> None:
        worm = self.worm
        each = np.stack([worm.forward, worm.backward, worm.sideways], axis=1)
        self.resistance: list[list[float]] = each.tolist()

    # -- coordinates: places, then (ln speed, direction) of all masses, then t ---------------------

    def velocity(self, z: np.ndarray) -> list[complex]:
        """Velocities as complex numbers."""
        m = self.worm.n
        told = zip(self.slides.tolist(), *z[2 * m : 4 * m].reshape(2, m).tolist(), strict=True)
        return [cmath.rect(math.exp(min(log, 50.0)), angle) * on for on, log, angle in told]

    def place(self, z: np.ndarray) -> list[complex]:
        """Places as complex numbers."""
        return plane(z[: 2 * self.worm.n]).tolist()

    def rates(self, _T: float, z: np.ndarray) -> np.ndarray:
        """Derivatives by the slowed time T."""
        worm, m = self.worm, self.worm.n
        log, angle = z[2 * m : 4 * m].reshape(2, m).tolist()
        r, v = self.place(z), self.velocity(z)
        inverse = [math.exp(min(-log[i], 700.0)) * on for i, on in enumerate(self.slides.tolist())]
        slow = sum(inverse[i] for i, fresh in enumerate(self.fresh.tolist()) if not fresh)
        pace = 1.0 / (1.0 + _BRISK * slow)
        h, _ = worm.look(r, v)
        pull, rates = worm.pull(float(z[-1]), r, v), []
        for i, mass in enumerate(worm.mass.tolist()):
            e = cmath.rect(1.0, angle[i])
            force = pull[i] + h[i] * force_of(e * h[i].conjugate(), self.resistance[i])
            rates.append(force * e.conjugate() * (inverse[i] * pace / mass))
        along, turning = [each.real for each in rates], [each.imag for each in rates]
        return np.concatenate([pace * flat(v), along, turning, [pace]])

    # -- rest ------------------------------------------------------------------------------------

    def needed(self, z: np.ndarray) -> np.ndarray:
        """Forces (m, 2) that the masses need to stay at rest, along their headings and across."""
        r, v = self.place(z), self.velocity(z)
        h, _ = self.worm.look(r, v)
        pull = self.worm.pull(float(z[-1]), r, v)
        return flat([-p * e.conjugate() for p, e in zip(pull, h, strict=True)]).reshape(-1, 2)

    def size(self, z: np.ndarray, i: int) -> float:
        return held(self.needed(z)[i], self.resistance[i])

    def stop(self, z: np.ndarray, i: int) -> None:
        """A mass has come to a stop, or begins at rest."""
        self.slides[i] = self.fresh[i] = False
        if self.size(z, i) > 1.0:
            self.release(z, i)
            kind = "reversal"
        else:
            kind = "stick"
        self.happenings.append(Happening(float(z[-1]), i, kind))

    def release(self, z: np.ndarray, i: int) -> None:
        """Let a mass go, with next to no speed, into the direction in which it will slide."""
        needed, resistance, m = self.needed(z)[i], self.resistance[i], self.worm.n
        force = nearest(needed, resistance)
        left = force - needed
        ahead = resistance[0] if force[0] < 0 else resistance[1]
        edge = bool(np.hypot(*left) < 1e-6 * np.hypot(*force))
        if edge:  # normal of the ellipse
            left = -force / np.array([ahead, resistance[2]]) ** 2
        h, _ = self.worm.look(self.place(z), self.velocity(z))
        z[2 * m + i] = np.log(self.care.seed)
        z[3 * m + i] = np.angle(h[i] * complex(*left))
        self.slides[i], self.fresh[i] = True, edge

    def error(self, usual: float) -> np.ndarray:
        """What a step may be off in each coordinate: more where a slow mass has to follow."""
        m = self.worm.n
        error = np.full(4 * m + 1, usual)
        slow = np.tile(self.fresh, 2)
        error[2 * m : 4 * m][slow] = self.care.fresh
        return error

    def events(self) -> list[Any]:
        m, functions = self.worm.n, []
        least, grown = np.log(self.care.stop), np.log(_GROWN)
        for i in range(m):
            found: list[tuple[str, Any, int]] = []
            if self.slides[i]:
                found.append(("stop", lambda _, z, k=2 * m + i: z[k] - least, -1))
                if self.fresh[i]:
                    found.append(("grown", lambda _, z, k=2 * m + i: z[k] - grown, 1))
            else:
                found.append(("release", lambda _, z, i=i: self.size(z, i) - 1.0, 1))
            for kind, function, direction in found:
                function.terminal, function.direction = True, direction
                function.kind, function.mass = kind, i
                functions.append(function)
        return functions

    def happened(self, function: Any, z: np.ndarray) -> None:
        i = function.mass
        if function.kind == "grown":
            self.fresh[i] = False
        elif function.kind == "stop":
            self.stop(z, i)
        else:
            self.release(z, i)
            self.happenings.append(Happening(float(z[-1]), i, "release"))

    def start(self, start: np.ndarray) -> np.ndarray:
        m = self.worm.n
        v = start[2 * m :].reshape(-1, 2)
        speed = np.hypot(v[:, 0], v[:, 1])
        self.slides[:] = speed > self.care.stop
        log = np.log(np.where(self.slides, speed, 1.0))
        z = np.concatenate([start[: 2 * m], log, np.arctan2(v[:, 1], v[:, 0]), [0.0]])
        for i in np.flatnonzero(~self.slides):
            if self.size(z, int(i)) > 1.0:
                self.release(z, int(i))
        return z


def planar_flow(
    worm: PlanarWorm,
    span: float,
    times: Sequence[float] | np.ndarray = (),
    *,
    start: np.ndarray | None = None,
    care: Care = TIGHT,
) -> Motion:
    """Follow a worm on elliptic ground from 0 to `span`; `times` (k,) are sampled, ascending.

    States are places and velocities as in `PlanarWorm.model`.
    Raises RuntimeError if solve_ivp fails or does not come forward.
    """
    flow = _Planar(worm, care, np.zeros(worm.n, dtype=bool), np.zeros(worm.n, dtype=bool))
    z = flow.start(worm.start if start is None else start)
    wanted, states = list(times), []

    def ended(_: float, z: np.ndarray) -> float:
        return z[-1] - span

    def reached(z: np.ndarray) -> np.ndarray:
        return np.concatenate([z[: 2 * worm.n], flat(flow.velocity(z))])

    ended.terminal, ended.direction = True, 1  # type: ignore[attr-defined]
    for _ in range(_MOST):
        functions, implicit = [ended, *flow.events()], bool(flow.fresh.any())
        found = solve_ivp(
            flow.rates,
            (0.0, 1e12),
            z,
            "Radau" if implicit else "DOP853",
            events=functions,
            dense_output=True,
            rtol=max(care.relative, 1e-11) if implicit else care.relative,
            atol=flow.error(0.1 * care.relative),
            first_step=1e-8 if implicit else 1e-3,
            max_step=np.inf if implicit else care.step,
        )
        if found.status < 1:
            raise RuntimeError(f"given up at t = {found.y[-1, -1]:g}: {found.message}")
        first = [k for k, at in enumerate(found.t_events) if len(at)]
        k = min(first, key=lambda k: found.t_events[k][0])
        last, z = float(found.t_events[k][0]), found.y_events[k][0].copy()
        while wanted and (wanted[0] <= z[-1] or k == 0):
            states.append(reached(_at(found.sol, wanted.pop(0), last)))
        if k == 0:
            return Motion(np.array(states).T, reached(z), flow.happenings)
        flow.happened(functions[k], z)
    raise RuntimeError(f"{_MOST} events by t = {z[-1]:g}")


def _at(solution: Any, time: float, last: float) -> np.ndarray:
    """State at a time t, which lies within T from 0 to `last`."""
    grid = np.append(solution.ts[solution.ts < last], last)
    clock = np.array([solution(T)[-1] for T in grid]) if len(grid) < 3 else solution(grid)[-1]
    k = int(np.clip(np.searchsorted(clock, time), 1, len(grid) - 1))
    low, high = grid[k - 1], grid[k]
    if not clock[k - 1] < time < clock[k]:
        return solution(high if time >= clock[k] else low)
    return solution(brentq(lambda T: solution(T)[-1] - time, low, high, xtol=1e-15))


# -- boxes and spikes ----------------------------------------------------------------------------


def box_flow(
    worm: PlanarWorm,
    span: float,
    times: np.ndarray,
    *,
    start: np.ndarray | None = None,
    relative: float = 1e-13,
) -> Motion:
    """Follow a worm on ground that resists along and across each by itself; see `planar_flow`.

    The event loop of the line, with velocities in the frames of the masses as states.
    """
    begin = worm.start if start is None else start
    motion = event_loop(
        _plant(worm),
        span,
        times,
        start=_turned(worm, begin[:, None], -1.0)[:, 0],
        relative=relative,
        max_step=0.02,
    )
    states = _turned(worm, motion.states, 1.0)
    return Motion(states, _turned(worm, motion.end[:, None], 1.0)[:, 0], motion.happenings)


def _turned(worm: PlanarWorm, states: np.ndarray, way: float) -> np.ndarray:
    """Velocities into the frames of the masses (`way` -1) or out of them (1)."""
    out, m = states.copy(), worm.n
    for k in range(states.shape[1]):
        v = plane(states[2 * m :, k])
        h = np.array(worm.look(plane(states[: 2 * m, k]).tolist(), v.tolist())[0])
        out[2 * m :, k] = (v * (h if way > 0 else h.conj())).view(float)
    return out


def _plant(worm: PlanarWorm) -> Plant:
    m = worm.n

    def rates(t: float, y: np.ndarray, force: np.ndarray) -> np.ndarray:
        r, local = plane(y[: 2 * m]).tolist(), plane(y[2 * m :])
        h = np.array(worm.look(r, local.tolist())[0])  # headings do not depend on velocities
        v = local * h
        _, turning = worm.look(r, v.tolist())
        a = (np.array(worm.pull(t, r, v.tolist())) * h.conj() + plane(force)) / worm.mass
        a -= 1j * np.array(turning) * local  # the frame turns
        return np.concatenate([v.view(float), a.view(float)])

    grips = []
    for i in range(m):
        ahead = Grip.spike() if worm.ground == "spike" else Grip(worm.forward[i], worm.backward[i])
        grips += [ahead, Grip(worm.sideways[i], worm.sideways[i])]
    start = _turned(worm, worm.start[:, None], -1.0)[:, 0]
    velocity = np.arange(2 * m, 4 * m)
    return Plant(rates, start, velocity, np.repeat(worm.mass, 2), grips, lambda _: np.zeros(0))
