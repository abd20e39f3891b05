"""A chain driven by a gait, told three times: as a Model, as NumPy code, and as a linear system.

The three share the numbers and nothing else, so that what is wrong in one is not wrong in all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from wormopt.model.friction import Coulomb, Law, Spike
from wormopt.model.gait import Gait
from wormopt.model.model import Model


@dataclass(frozen=True)
class Grip:
    """Dry friction of one mass in numbers; a spike where backward forces are infinite."""

    forward: float  # sliding force F+
    backward: float  # sliding force F-
    stick_forward: float | None = None  # largest force at rest; None: sliding force
    stick_backward: float | None = None  # largest force at rest; None: sliding force

    @classmethod
    def spike(cls) -> Grip:
        """No friction forward, no way backward."""
        return cls(0.0, np.inf)

    @property
    def hold(self) -> tuple[float, float]:
        """Least and largest force at rest."""
        ahead = self.forward if self.stick_forward is None else self.stick_forward
        behind = self.backward if self.stick_backward is None else self.stick_backward
        return -ahead, behind

    def law(self) -> Law:
        """The same as a Law."""
        if np.isinf(self.backward):
            return Spike()
        return Coulomb(self.forward, self.backward, self.stick_forward, self.stick_backward)


@dataclass(frozen=True, eq=False)
class DrivenChain:
    """n+1 masses, n links whose rest lengths a gait commands, u_j = c_j (y_ref,j - l0_j), (11)."""

    mass: np.ndarray  # (n+1,)
    stiffness: np.ndarray  # (n,)
    damping: np.ndarray  # (n,)
    gait: Gait  # commanded lengths; jumps are allowed
    grips: Sequence[Grip]  # friction of each mass
    drag: float = 0.0  # viscous, on every mass
    position: np.ndarray | None = None  # (n+1,) start; None: commanded lengths, tail at 0
    velocity: np.ndarray = field(default_factory=lambda: np.zeros(1))  # (n+1,) at the start

    @property
    def links(self) -> int:
        """Number of links n."""
        return len(self.stiffness)

    @property
    def start(self) -> np.ndarray:
        """Positions and velocities at time 0, shape (2 n + 2,)."""
        lengths = self.gait(np.zeros(1))[:, 0]
        stretched = np.append(np.cumsum(lengths[::-1])[::-1], 0.0)
        x = stretched if self.position is None else self.position
        return np.concatenate([x, np.broadcast_to(self.velocity, len(self.mass))])

    def model(self) -> Model:
        """Build the Model, by the package's builders."""
        from wormopt.control.loop import FeedForward, TrackingError, close
        from wormopt.control.reference import follow
        from wormopt.systems.chain.build import chain

        n = self.links
        worm = chain(
            n,
            mass=self.mass,
            stiffness=self.stiffness,
            damping=self.damping,
            rest_length=0.0,
            drag=self.drag,
            law=[grip.law() for grip in self.grips],
            position=self.start[: n + 1],
            velocity=self.start[n + 1 :],
        )
        reference = follow(self.gait, worm.t)
        force, believed = FeedForward(self.stiffness, 0.0).force(reference)
        error = TrackingError.of(worm, reference)
        return close(worm, reference, error, force, name="command", parameters=believed)

    def rates(self, t: float, y: np.ndarray, force: np.ndarray) -> np.ndarray:
        """Time derivatives of `y` = positions and velocities (2 n + 2,), in plain NumPy.

        `force` (n+1,): friction on each mass.
        """
        masses = self.links + 1
        x, v = y[:masses], y[masses:]
        pull = self.stiffness * (x[:-1] - x[1:] - self.commanded(t)) + self.damping * (
            v[:-1] - v[1:]
        )
        net = force - self.drag * v
        net[:-1] -= pull
        net[1:] += pull
        return np.concatenate([v, net / self.mass])

    def commanded(self, t: float) -> np.ndarray:
        """Lengths (n,) that the gait commands at time t."""
        gait = self.gait
        since = t % gait.period
        piece = min(int(np.searchsorted(gait.breaks, since, side="right")) - 1, gait.pieces - 1)
        s = since - gait.breaks[piece]
        value = np.zeros(self.links)
        for column in gait.polynomial[piece].T[::-1]:
            value = value * s + column
        if gait.omega is None or gait.cosine is None or gait.sine is None:
            return value
        angle = gait.omega[piece] * s
        return value + gait.cosine[piece] * np.cos(angle) + gait.sine[piece] * np.sin(angle)

    def generator(self, piece: int) -> np.ndarray:
        """Matrix G of z' = G z on a piece of the gait, all masses sliding without friction.

        z holds positions, velocities, the powers 1, s, s^2, ... of the time since the piece
        began, cos(omega s) and sin(omega s): 2 n + 4 + powers entries.
        """
        masses, gait = self.links + 1, self.gait
        powers = gait.polynomial.shape[2]
        size = 2 * masses + powers + 2
        links = np.eye(self.links, masses) - np.eye(self.links, masses, 1)
        lengths = np.zeros((self.links, size))  # l - y_ref of z
        lengths[:, :masses] = links
        lengths[:, 2 * masses : 2 * masses + powers] = -gait.polynomial[piece]
        if gait.cosine is not None and gait.sine is not None:
            lengths[:, -2:] = -np.stack([gait.cosine[piece], gait.sine[piece]], axis=1)
        pull = self.stiffness[:, None] * lengths
        pull[:, masses : 2 * masses] += self.damping[:, None] * links
        G = np.zeros((size, size))
        G[:masses, masses : 2 * masses] = np.eye(masses)
        G[masses : 2 * masses] = -(links.T @ pull) / self.mass[:, None]
        G[masses : 2 * masses, masses : 2 * masses] -= np.diag(self.drag / self.mass)
        for power in range(1, powers):
            G[2 * masses + power, 2 * masses + power - 1] = power
        omega = 0.0 if gait.omega is None else float(gait.omega[piece])
        G[-2, -1], G[-1, -2] = -omega, omega
        return G
