"""Worms on dry ground whose link lengths are prescribed, by scipy alone.

Shares nothing with the package: a gait is tables of polynomials, friction is smooth with a narrow
width, and the only unknown is the velocity of the centre of mass, which a stiff solver finds.
Forces act on masses, positive forward.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.integrate import solve_ivp

Array = np.ndarray


@dataclass(frozen=True)
class Lengths:
    """Link lengths over a cycle: breaks (pieces + 1,), coefficients (pieces, n, powers)."""

    breaks: Array
    coefficients: Array

    @property
    def period(self) -> float:
        return float(self.breaks[-1] - self.breaks[0])

    def at(self, piece: int, s: Array | float) -> Array:
        """Lengths, rates and accelerations (3, n, ...) at times s since the piece began."""
        rows, found = np.moveaxis(self.coefficients[piece], -1, 0), []
        for _ in range(3):
            found.append(np.polynomial.polynomial.polyval(s, rows) if len(rows) else 0 * found[0])
            rows = np.arange(1, len(rows))[:, None] * rows[1:]
        return np.array(found)


@dataclass(frozen=True)
class Rubbing:
    """Masses, head first, and what resists their motion."""

    mass: Array
    drag: float
    forward: Array
    backward: Array
    load: Array


@dataclass(frozen=True)
class Played:
    """Motion over the last cycle at times (m,): all that limits are about."""

    worm: Rubbing
    time: Array
    length: Array
    rate: Array
    acceleration: Array
    velocity: Array
    ground: Array  # force on each mass
    link_force: Array  # positive in tension
    speed: float
    width: float  # of the smooth friction

    @cached_property
    def slip(self) -> float:
        """Largest velocity backward, in widths."""
        return float(-self.velocity.min() / self.width)

    @cached_property
    def unheld(self) -> float:
        """Largest velocity over time of the mass that is then slowest, in widths."""
        return float(np.abs(self.velocity).min(axis=0).max() / self.width)


def play(
    worm: Rubbing, lengths: Lengths, *, cycles: int = 2, width: float = 1e-4, samples: int = 25
) -> Played:
    """Follow a worm from rest for some cycles; the width of friction is relative to the speeds."""
    ends = [lengths.at(k, 0.0)[1] for k in range(len(lengths.breaks) - 1)]
    narrow = width * float(np.abs(ends).max())
    middle, half = (worm.backward - worm.forward) / 2, (worm.backward + worm.forward) / 2
    total = worm.mass.sum()

    def relative(rows: Array) -> Array:
        """Of each mass against the centre of mass, from those of the links."""
        behind = np.concatenate([0 * rows[:1], np.cumsum(rows, axis=0)])
        return np.tensordot(worm.mass, behind, 1) / total - behind

    def ground(v: Array) -> Array:
        shape = (-1,) + (1,) * (v.ndim - 1)
        return middle.reshape(shape) - half.reshape(shape) * np.tanh(v / narrow)

    drift, seen = 0.0, []
    place, begun = 0.0, 0.0
    for cycle in range(cycles):
        begun = place
        for k, duration in enumerate(np.diff(lengths.breaks)):

            def rhs(s: float, y: Array, k: int = k) -> list[float]:
                v = y[0] + relative(lengths.at(k, s)[1])
                pushed = ground(v) - worm.drag * v - worm.load
                return [pushed.sum() / total, y[0]]

            s = np.linspace(0.0, duration, samples)
            part = solve_ivp(
                rhs, (0.0, duration), [drift, place], "Radau", t_eval=s, rtol=1e-8,
                atol=[1e-3 * narrow, 1e-9 * narrow * lengths.period], max_step=duration / 4,
            )  # fmt: skip
            drift, place = part.y[:, -1]
            if cycle == cycles - 1:
                seen.append((lengths.breaks[k] + s, lengths.at(k, s), part.y[0]))
    time, drifts = (np.concatenate([one[i] for one in seen]) for i in (0, 2))
    length, rate, bend = np.concatenate([one[1] for one in seen], axis=-1)
    v = drifts + relative(rate)
    pushed = ground(v) - worm.drag * v - worm.load[:, None]
    # each mass needs m a; what its ground lacks comes through the links, from the head down
    needed = worm.mass[:, None] * (pushed.sum(axis=0) / total + relative(bend))
    link = np.cumsum(pushed - needed, axis=0)[:-1]
    return Played(
        worm, time, length, rate, bend, v, ground(v), link, (place - begun) / lengths.period, narrow
    )
