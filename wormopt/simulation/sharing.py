"""Split of an undetermined load on resting contacts, such as two on one rigid body.

Their accelerations are unique but their forces are not. They rest as long as some split of the load
is within their holding forces, so the split with the least largest share decides. When that share
rises through 1, the gradients of the shares, times their multipliers, are possible velocities of
the bodies: slip begins with these, and contacts without multiplier remain at rest.

Source: theorems of limit analysis; D. C. Drucker, W. Prager, H. J. Greenberg, Quarterly of Applied
Mathematics 9 (1952) 381.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from operator import itemgetter

import casadi as ca
import numpy as np

from wormopt.lazy import on_use
from wormopt.model.model import Contact
from wormopt.model.planar_friction import Elliptic, PlanarLaw
from wormopt.numerics.expressions import Call
from wormopt.simulation.functions import System
from wormopt.simulation.initial_value import InitialValueProblem
from wormopt.simulation.steps import GivenUp

with on_use():  # slow to import, and few worms share loads
    from scipy.optimize import minimize, nnls

SHARE_REST = 1e-11
"""Excess of a share that is rounding of its split."""

# Relative to the largest singular value, and to the largest of the compared values.
_NOTHING = 1e-10
# Square of a share so far from the limit that no better split is needed.
_EASY = 0.7
# Shares so close to the largest bound it.
_ACTIVE = 1e-6
# A stronger side by more than this factor is evaluated near its limit only.
_WIDE = 100.0
# Convergence of the directions from accelerations, and number of steps.
_SETTLED, _STEPS = 1e-13, 20_000


@dataclass(frozen=True, eq=False)
class Split:
    """A load split among resting contacts with the least largest share."""

    contacts: np.ndarray
    rows: np.ndarray
    null: np.ndarray  # (rows, k) basis of forces without effect
    forces: np.ndarray  # (rows,)
    share: float  # of the holding forces; at most 1 at rest


@dataclass(frozen=True, eq=False)
class Slip:
    """Velocities, up to a factor, with which contacts that shared a load begin to move."""

    contacts: list[int]
    velocities: list[np.ndarray]  # (1,) or (2,) each


class Sharing:
    """Splits of the loads that resting contacts share; does not change modes."""

    def __init__(self, task: InitialValueProblem, p: np.ndarray, s: np.ndarray) -> None:
        system = self._system = task.system
        n = len(system.contacts)
        self._modes, self._row_contact = s[:n], system.row_contact
        self.active = False  # whether any contacts share a load now
        self._last = np.zeros(len(system.row_contact))
        self._state = Call(_state_function(system), ("p", p), ("s", s))
        self._loads = Call(_load_function(system), ("p", p), ("s", s))
        self._nearest = Call(_nearest_function(system), ("p", p), ("s", s))

    def look(self, t: float, x: np.ndarray) -> list[Split]:
        """Split shared loads, and note whether there are any."""
        response, forces, free = self._read(t, x)
        found = []
        for rows, null in self._groups(response):
            if self._parts(response, forces, free, rows):
                found.append(
                    Split(np.unique(self._row_contact[rows]), rows, null, 0 * rows, np.inf)
                )
            else:
                found.append(self._split(t, x, forces, rows, null))
            self._last[rows] = found[-1].forces
        self.active = bool(found)
        return found

    def _read(self, t: float, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Response to forces, forces, and accelerations without forces."""
        n = len(self._row_contact)
        found = self._state(t, x)[0]
        return found[: n * n].reshape(n, n).T, found[n * n : -n], found[-n:]

    def _groups(self, response: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """Independent groups of rows that share loads, with forces that have no effect."""
        rows = np.flatnonzero(self._modes[self._row_contact] == 0)
        if len(rows) < 2:
            return []
        _, sizes, right = np.linalg.svd(response[np.ix_(rows, rows)])
        null = right[sizes < _NOTHING * sizes[0]].T
        together = np.abs(null @ null.T) > _NOTHING
        owner = self._row_contact[rows]
        together |= owner[:, None] == owner
        found = []
        for own in _components(together):
            left, sizes, _ = np.linalg.svd(null[own], full_matrices=False)
            if (sizes > 0.5).any():  # singular values of a share of a projection: 0 or 1
                found.append((rows[own], left[:, sizes > 0.5]))
        return found

    def _parts(
        self, response: np.ndarray, forces: np.ndarray, free: np.ndarray, rows: np.ndarray
    ) -> bool:
        """Whether no forces keep contacts at rest, such as on the ground and on a belt."""
        slides = self._modes[self._row_contact] != 0
        others = response[np.ix_(rows, slides)] * forces[slides]
        free, sizes = (
            free[rows] + others.sum(axis=1),
            np.abs(free[rows]) + np.abs(others).sum(axis=1),
        )
        left, values, _ = np.linalg.svd(response[np.ix_(rows, rows)])
        lacking = left[:, values < _NOTHING * values[0]].T @ free
        return bool(np.abs(lacking).max() > _NOTHING * sizes.max())

    def _split(
        self, t: float, x: np.ndarray, forces: np.ndarray, rows: np.ndarray, null: np.ndarray
    ) -> Split:
        contacts = np.unique(self._row_contact[rows])
        every = forces.copy()

        def shares(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            every[rows] = forces[rows] + null @ (scale * z)
            load, slope = self._load(t, x, every)
            return load[contacts], slope[np.ix_(contacts, rows)] @ null * scale

        scale = max(float(np.abs(forces[rows]).max()), 1e-3 * self._nominal(contacts))
        first = null.T @ (self._last[rows] - forces[rows]) / scale
        largest, begin = min(
            ((shares(z)[0].max(), z) for z in (first, 0 * first)), key=itemgetter(0)
        )
        best = begin if largest < _EASY else _least_share(shares, begin)
        largest = max(float(shares(best)[0].max()), 0.0)
        return Split(contacts, rows, null, every[rows].copy(), float(np.sqrt(largest)))

    def _nominal(self, contacts: np.ndarray) -> float:
        return max(self._system.contacts[i].nominal_force for i in contacts)

    def _load(self, t: float, x: np.ndarray, forces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Squares of the shares of all contacts, and their derivatives by forces."""
        n = len(self._modes)
        found = self._loads(t, x, forces)[0]
        return found[:n], found[n:].reshape(-1, n).T

    def slip(self, t: float, x: np.ndarray, split: Split) -> Slip:
        """Contacts that begin to move when they no longer hold their load, with directions."""
        laws = [self._system.contacts[i].law for i in split.contacts]
        if any(isinstance(law, PlanarLaw) and not isinstance(law, Elliptic) for law in laws):
            raise GivenUp("no_contact_mode")  # no minimum determines the motion
        at_once = split.share > 1 + _ACTIVE
        velocity = self._accelerate(t, x, split) if at_once else self._give_way(t, x, split)
        owner = self._row_contact[split.rows]
        each = [velocity[owner == i] for i in split.contacts]
        sizes = np.array([np.linalg.norm(v) for v in each])
        moving = np.flatnonzero(sizes > _ACTIVE * sizes.max())
        return Slip([int(split.contacts[i]) for i in moving], [each[i] for i in moving])

    def _give_way(self, t: float, x: np.ndarray, split: Split) -> np.ndarray:
        """Velocity of a load that has reached the largest that holds."""
        every = np.zeros(len(self._row_contact))
        every[split.rows] = split.forces
        load, slope = self._load(t, x, every)
        bound = split.contacts[load[split.contacts] > split.share**2 - _ACTIVE]
        normals = slope[np.ix_(bound, split.rows)].T
        scale = np.abs(normals).max()
        balance = np.vstack([split.null.T @ normals / scale, np.ones(len(bound))])
        weights, _ = nnls(balance, np.append(np.zeros(split.null.shape[1]), 1.0))
        velocity = -normals @ weights
        return velocity - split.null @ (split.null.T @ velocity)

    def _accelerate(self, t: float, x: np.ndarray, split: Split) -> np.ndarray:
        """Accelerations under a load beyond the holding forces: accelerated projected gradients."""
        response, forces, free = self._read(t, x)
        rows, every = split.rows, forces.copy()
        others = np.setdiff1d(np.arange(len(forces)), rows)
        own = response[np.ix_(rows, rows)]
        free = free[rows] + response[np.ix_(rows, others)] @ forces[others]
        length = 1 / np.linalg.norm(own, 2)
        f = ahead = split.forces / split.share
        momentum = 1.0
        for _ in range(_STEPS):
            every[rows] = ahead - length * (own @ ahead + free)
            new = self._nearest(t, x, every)[0][rows].copy()
            if np.abs(new - ahead).max() < _SETTLED * np.abs(new).max():
                f = new
                break
            if (ahead - new) @ (new - f) > 0:
                momentum = 1.0
            after = (1 + np.sqrt(1 + 4 * momentum**2)) / 2
            f, ahead, momentum = new, new + (momentum - 1) / after * (new - f), after
        return own @ f + free


def _components(together: np.ndarray) -> np.ndarray:
    """Members (bool) of every connected component, one per row, of symmetric pairs (n, n)."""
    # Everything is connected with itself. For few members this is faster than SciPy's search.
    while True:
        wider = together @ together
        if (wider == together).all():
            return together[np.unique(together.argmax(axis=1))]
        together = wider


@lru_cache(maxsize=64)
def _state_function(system: System) -> ca.Function:
    response = ca.vec(ca.densify(system.delassus))
    return system.function("state", ca.vertcat(response, system.forces, system.pulled))


def _least_share(
    shares: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]], begin: np.ndarray
) -> np.ndarray:
    """Point with the least largest share, from shares with their slopes."""
    k, ahead = len(begin), np.append(0 * begin, 1.0)

    def slack(y: np.ndarray) -> np.ndarray:
        return y[k] - shares(y[:k])[0]

    def slopes(y: np.ndarray) -> np.ndarray:
        slope = shares(y[:k])[1]
        return np.hstack([-slope, np.ones((len(slope), 1))])

    found = minimize(
        lambda y: y[k],
        np.append(begin, shares(begin)[0].max()),
        jac=lambda _: ahead,
        constraints={"type": "ineq", "fun": slack, "jac": slopes},
        method="SLSQP",
        options={"ftol": 1e-15, "maxiter": 200},
    )
    return min((found.x[:k], begin), key=lambda z: float(shares(z)[0].max()))


def _own(system: System, f: ca.SX) -> list[tuple[Contact, ca.SX]]:
    rows = [np.flatnonzero(system.row_contact == i) for i in range(len(system.contacts))]
    return [(c, f[own.tolist()]) for c, own in zip(system.contacts, rows, strict=True)]


@lru_cache(maxsize=64)
def _load_function(system: System) -> ca.Function:
    f = ca.SX.sym("f", len(system.row_contact))
    loads = ca.vertcat(*(_load(contact, own) for contact, own in _own(system, f)))
    slopes = ca.densify(ca.jacobian(loads, f))
    return system.function("loads", ca.vertcat(loads, ca.vec(slopes)), f)


def _load(contact: Contact, force: ca.SX) -> ca.SX:
    """Convex share of the holding force, at most 1 if the contact can hold the force."""
    if isinstance(contact.law, PlanarLaw):
        return ca.SX(contact.law.gauge(force) ** 2)
    low, high = (ca.SX(bound) for bound in contact.law.stick_interval)
    below, above = (bound.is_constant() and math.isinf(float(bound)) for bound in (low, high))
    if below and above:
        return ca.SX(0)
    if below or above:
        beyond = force - high if below else low - force
        return ca.SX(1 + beyond / contact.nominal_force)
    weak = ca.fmin(ca.fabs(low), ca.fabs(high))
    weak = ca.if_else(weak > 0, weak, contact.nominal_force)
    width = ca.fmin((high - low) / 2, _WIDE * weak)
    return ca.SX((ca.fmax(0, ca.fmax(low + width - force, force - (high - width))) / width) ** 2)


@lru_cache(maxsize=64)
def _nearest_function(system: System) -> ca.Function:
    f = ca.SX.sym("f", len(system.row_contact))
    return system.function(
        "nearest", ca.vertcat(*(_nearest(c, own) for c, own in _own(system, f))), f
    )


def _nearest(contact: Contact, force: ca.SX) -> ca.SX:
    """Force nearest to a given one that the contact can hold."""
    law = contact.law
    if isinstance(law, PlanarLaw):
        return law.nearest(force) if isinstance(law, Elliptic) else force
    low, high = law.stick_interval
    return ca.SX(ca.fmin(ca.fmax(force, low), high))
