"""Supervisor: compares measured loads of spikes and actuators with thresholds over whole cycles.

Over a cycle, the mean load of all spikes is (n+1)(k speed + load) for any gait. The mean square of
the actuator forces increases with the load too. Each of them gives the load on each mass, and thus
the peak loads in this gear and in the next. A single stroke also gives the load on the masses, by
the balance of impulses. On rising ground it responds first.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wormopt.systems.gears.box import GearBox, Row
from wormopt.systems.gears.gear import Gear, Limits


@dataclass(frozen=True, eq=False)
class Supervisor:
    """Thresholds of each gear on measured means: above `down` it shifts down, below `up` up.

    The means over a cycle are those of the total spike load and of the sum of squared actuator
    forces. A decision needs a whole cycle in the gear, and `dwell` since the last shift. An
    impulse of all spikes over a stroke above `alarm` requests the slower gear immediately.
    """

    spike_down: np.ndarray  # (gears,) -> slower
    spike_up: np.ndarray  # (gears,) -> faster
    actuator_down: np.ndarray  # (gears,)
    actuator_up: np.ndarray  # (gears,)
    alarm: np.ndarray  # (rows,) of the table of strokes
    dwell: float

    def decide(self, gear: int, spike: float, actuator: float) -> int:
        """Gear wanted after a cycle with these measured means."""
        if spike > self.spike_down[gear] or actuator > self.actuator_down[gear]:
            return gear - 1
        if spike < self.spike_up[gear] and actuator < self.actuator_up[gear]:
            return gear + 1
        return gear


def supervise(box: GearBox, limits: Limits, *, down: float, up: float, dwell: float) -> Supervisor:
    """Set thresholds such that peak loads in a gear stay within a share `down` of the limits.

    The next faster gear is selected if its peaks would stay below a share `up`, less than `down`,
    which gives the hysteresis.
    """
    gears = box.gears
    most = [gear.bears(limits.times(down)) for gear in gears]
    spike_down, actuator_down = _measures(gears, most)
    borne = [gear.bears(limits.times(up)) for gear in gears[1:]]
    spike_up, actuator_up = _measures(gears[:-1], borne)
    # the slowest gear has none below it, the fastest none above it
    spike_down[0] = actuator_down[0] = np.inf
    return Supervisor(
        spike_down,
        np.append(spike_up, -np.inf),
        actuator_down,
        np.append(actuator_up, -np.inf),
        np.array([_alarm(row, gears[row.gear], min(most[row.gear])) for row in box.rows]),
        dwell,
    )


def _alarm(row: Row, gear: Gear, most: float) -> float:
    """Impulse of all spikes over a stroke at the load `most`; none in the slowest gear."""
    if row.gear == 0 or row.shifting:
        return np.inf
    ends = row.stroke.at(np.array([0.0, row.stroke.duration]))
    gained = gear.mass @ (ends[:, 1] - ends[:, 0])
    return float(gained + gear.drag * row.stroke.way.sum() + len(ends) * most * row.stroke.duration)


def _measures(
    gears: tuple[Gear, ...], borne: list[tuple[float, float]]
) -> tuple[np.ndarray, np.ndarray]:
    """Measured means in gears at the load limits of spikes, and at those of actuators."""
    spike = [gear.spike_mean(most) for gear, (most, _) in zip(gears, borne, strict=True)]
    force = [
        gear.actuator_square(most) if np.isfinite(most) else most
        for gear, (_, most) in zip(gears, borne, strict=True)
    ]
    return np.array(spike), np.array(force)
