"""What the motors of a scene have to do with the limits of a designed gait, and its use of them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import msgspec
import numpy as np

from wormopt.errors import SolveError
from wormopt.model.gait import Gait
from wormopt.quantities import Scalar
from wormopt.scene.types import per
from wormopt.systems.spiked.scenes.gait_design import DesignTable
from wormopt.systems.spiked.scenes.gait_search import in_scene
from wormopt.systems.spiked.scenes.motor import MotorTable
from wormopt.systems.spiked.stepper.stepper import Stepper, demand

_ACCEPTED = 1e-9
_ASSUMED = (
    "one motor per link turns a threaded rod: |l'| <= lead rate_max and |l''| <= lead "
    "acceleration_max hold at all times, also below motor.start_rate, where motors need no ramp; "
    "no step is lost within them, whatever the force"
)


def motor_scalars(table: DesignTable, gait: Gait) -> dict[str, Scalar]:
    """Which limits are the motor's, and how much of its own a gait uses; empty without a motor."""
    if table.motor is None:
        return {}
    motor, asked = table.motor, demand(gait, _always_ramped(table.motor))
    return {
        **{f"{name}_limit_from": Scalar(whose) for name, whose in _whose(table, motor).items()},
        "motor_rate_share": Scalar(float(asked.rate.max()) / motor.rate_max),
        "motor_acceleration_share": Scalar(
            float(asked.acceleration.max()) / motor.acceleration_max
        ),
    }


def motor_trust(table: DesignTable) -> dict[str, Any]:
    """What is assumed of the motors, for the trust report; empty without a motor."""
    return {} if table.motor is None else {"assumptions": {"motors": _ASSUMED}}


def motor_faults(table: DesignTable, gait: Gait) -> list[str]:
    """Say where a gait asks more of the motors than they can do.

    Found from the gait alone, independently of the design's own check of its limits.
    """
    if table.motor is None:
        return []
    asked = demand(gait, _always_ramped(table.motor))
    # a period that is short by a share stands for accelerations that are over by twice that
    if gait.period >= asked.period_min * (1 - _ACCEPTED):
        return []
    return [f"motor.{asked.strictest.name} is exceeded: it asks for a period of {asked.period_min}"]


def say_whose(error: SolveError, table: DesignTable) -> SolveError:
    """Name the motor where a refusal names a limit that is the motor's."""
    reason, suggestion = in_scene(error.reason), in_scene(error.suggestion)
    notes = [
        f"gait.{name} is here the motor's, motor.lead * motor.{name}_max"
        for name, whose in (_whose(table, table.motor) if table.motor else {}).items()
        if "motor" in whose and f"gait.{name}" in f"{reason} {suggestion}"
    ]
    return SolveError(reason, "; ".join([suggestion, *notes]), code=error.code)


def _whose(table: DesignTable, motor: MotorTable) -> dict[str, list[str]]:
    """Of each link, whether the gait's limit or the motor's is the smaller."""
    links, limits = table.worm.links, table.gait.limits
    rates = limits.rate_limits(links)
    given = {
        "rate": np.full(links, np.inf) if rates is None else np.min(rates, axis=0),
        "acceleration": np.array(per(limits.acceleration or np.inf, links)),
    }
    own = {"rate": motor.length_rate, "acceleration": motor.length_acceleration}
    return {
        name: ["motor" if own[name] <= limit else "gait" for limit in values]
        for name, values in given.items()
    }


def _always_ramped(motor: MotorTable) -> Stepper:
    return replace(Stepper(**msgspec.structs.asdict(motor)), start_rate=0.0)
