"""When to shift: measured loads of spikes and actuators against thresholds, over whole cycles.

Over a cycle the mean load of all spikes is (n+1)(k speed + load), whatever the gait, and the mean
square of the actuator forces grows with the load too. Either tells the load on each mass, and that
tells how large the peaks are in this gear and how large they would be in the next. A single stroke
tells the load on the masses as well, by the balance of impulses; on ground that rises it is the
first to tell.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wormopt.systems.gears.box import GearBox, Row
from wormopt.systems.gears.gear import Gear, Limits


@dataclass(frozen=True, eq=False)
class Supervisor:
    """Thresholds of each gear for what is measured: above `down` it is too fast, below `up` slow.

    Means over a cycle: of the load of all spikes together, and of the sum of squared actuator
    forces; a decision needs a whole cycle in the gear, and `dwell` since the last shift. Impulses
    of all spikes over a stroke above `alarm` want the slower gear without waiting for the cycle.
    """

    spike_down: np.ndarray  # (gears,) -> slower
    spike_up: np.ndarray  # (gears,) -> faster
    actuator_down: np.ndarray  # (gears,)
    actuator_up: np.ndarray  # (gears,)
    alarm: np.ndarray  # (rows,) of the table of strokes
    dwell: float

    def decide(self, gear: int, spike: float, actuator: float) -> int:
        """Gear that is wanted after a cycle in which this was measured."""
        if spike > self.spike_down[gear] or actuator > self.actuator_down[gear]:
            return gear - 1
        if spike < self.spike_up[gear] and actuator < self.actuator_up[gear]:
            return gear + 1
        return gear


def supervise(box: GearBox, limits: Limits, *, down: float, up: float, dwell: float) -> Supervisor:
    """Thresholds by which peaks in a gear reach no more than a share `down` of the limits.

    The next faster gear is taken where its peaks would stay below a share `up`, less than `down`:
    the hysteresis.
    """
    gears = box.gears
    most = [gear.bears(limits.times(down)) for gear in gears]
    spike_down, actuator_down = _measures(gears, most)
    borne = [gear.bears(limits.times(up)) for gear in gears[1:]]
    spike_up, actuator_up = _measures(gears[:-1], borne)
    # the slowest gear has none below it, the fastest none above
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
    """What is measured in gears at the loads that spikes bear, and at those that actuators bear."""
    spike = [gear.spike_mean(most) for gear, (most, _) in zip(gears, borne, strict=True)]
    force = [
        gear.actuator_square(most) if np.isfinite(most) else most
        for gear, (_, most) in zip(gears, borne, strict=True)
    ]
    return np.array(spike), np.array(force)
