"""Driving a plant open loop: its inputs are courses of time."""

from __future__ import annotations

from dataclasses import replace

from wormopt.control.loop import feed
from wormopt.control.reference import gait_reference
from wormopt.errors import ArgumentError
from wormopt.model.gait import Gait
from wormopt.model.model import Model, Output


def drive(plant: Model, inputs: Gait, *, periodic: bool = False) -> Model:
    """Put a course of time for all inputs of a plant.

    Parameters
    ----------
    plant : Model
        With at least one input.
    inputs : Gait
        Course of the inputs from time 0 on, one row per scalar input in the order of ``plant.u``.
        It may jump at breaks.
    periodic : bool, optional
        Whether the course repeats. Otherwise the inputs hold the course's last value after it has
        ended, and its first value before time 0.

    Returns
    -------
    Model
        The plant without inputs, with the output ``input`` (all of them, in their order) and the
        schedule ``input``, by which solvers stop at every break. Courses with as many pieces and
        powers share one compiled model.

    Raises
    ------
    ArgumentError
        If the course is no Gait, or has not one row per scalar input.

    Examples
    --------
    Both links are pushed apart by a force that grows, then by a constant one:

    >>> import numpy as np
    >>> from wormopt.systems.chain.build import chain
    >>> worm = chain(2, mass=1.0, stiffness=10.0, damping=5.0, rest_length=2.0, drag=0.1)
    >>> push = np.array([[[0.0, 3.0], [0.0, 3.0]], [[3.0, 0.0], [3.0, 0.0]]])
    >>> driven = drive(worm, Gait(np.array([0.0, 1.0, 2.0]), push))
    >>> list(driven.u), [schedule.name for schedule in driven.schedules]
    ([], ['input'])
    """
    if not isinstance(inputs, Gait):
        raise ArgumentError(f"inputs must be a Gait of one row each, not {type(inputs).__name__}")
    size = sum(signal.size for signal in plant.u)
    if inputs.links != size:
        raise ArgumentError(f"{plant.name} has {size} scalar inputs, the course {inputs.links}")
    course = gait_reference(inputs, plant.t, periodic=periodic, name="input")
    units = {signal.unit for signal in plant.u}
    shown = Output("input", course.value, units.pop() if len(units) == 1 else "1")
    fed = feed(plant, plant.u, course.value)
    return replace(
        fed,
        name=f"{plant.name}, driven",
        outputs=[*fed.outputs, shown],
        schedules=[*fed.schedules, *course.schedules],
    )
