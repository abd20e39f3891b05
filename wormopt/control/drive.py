"""Open-loop control: inputs of a plant as functions of time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import casadi as ca
import numpy as np

from wormopt.control.loop import feed, gait_reference
from wormopt.errors import ArgumentError
from wormopt.model.gait import Gait
from wormopt.model.given import check_flag, check_kind
from wormopt.model.model import Model, Output, Signal

# Share of its bound, or nominal size, by which an input may exceed it: optimised inputs follow
# bounds up to rounding and the tolerance of the solver.
_EXCESS = 1e-8


def drive(plant: Model, inputs: Gait, *, periodic: bool = False) -> Model:
    """Replace all inputs of a plant by functions of time.

    Parameters
    ----------
    plant : Model
        Model with at least one input.
    inputs : Gait
        Inputs from time 0 on, one row per scalar input in the order of ``plant.u``. They may jump
        at breaks.
    periodic : bool, optional
        Whether they repeat. Otherwise the inputs keep their first value before time 0 and their
        last value after the end.

    Returns
    -------
    Model
        The plant without inputs, with the output ``input`` (all of them, in their order) and the
        schedule ``input``, by which solvers stop at every break. Inputs with equal numbers of
        pieces and powers share one compiled model. Inputs with bounds are cut to them where they
        exceed them by more than 1e-8 of their size; the output ``saturated`` is then 1 for each
        input that is cut, else 0.

    Raises
    ------
    ArgumentError
        If the plant is not a Model, or `inputs` not a Gait with one row per scalar input.

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
    check_kind("plant", plant, Model)
    check_flag("periodic", periodic)
    if not isinstance(inputs, Gait):
        raise ArgumentError(f"inputs must be a Gait of one row each, not {type(inputs).__name__}")
    size = sum(signal.size for signal in plant.u)
    if inputs.links != size:
        raise ArgumentError(f"inputs: {inputs.links} rows for {size} scalar inputs of {plant.name}")
    reference = gait_reference(inputs, plant.t, periodic=periodic, name="input")
    value, saturation = _cut(plant.u, reference.value)
    units = {signal.unit for signal in plant.u}
    shown = Output("input", value, units.pop() if len(units) == 1 else "1")
    fed = feed(plant, plant.u, value)
    return replace(
        fed,
        name=f"{plant.name}, driven",
        outputs=[*fed.outputs, shown, *saturation],
        schedules=[*fed.schedules, *reference.schedules],
    )


def _cut(inputs: Sequence[Signal], values: ca.SX) -> tuple[ca.SX, tuple[Output, ...]]:
    """Cut inputs over time to their bounds; also the output that shows where."""
    bounds = np.array([(s.lower, s.upper, s.nominal) for s in inputs for _ in range(s.size)])
    if not np.any(np.isfinite(bounds[:, :2])):
        return values, ()
    kept, cut = [], []
    for command, (lower, upper, nominal) in zip(ca.vertsplit(values), bounds.tolist(), strict=True):
        low = command < lower - _EXCESS * max(abs(lower), nominal) if lower > -np.inf else ca.SX(0)
        high = command > upper + _EXCESS * max(abs(upper), nominal) if upper < np.inf else ca.SX(0)
        kept.append(ca.if_else(low, lower, ca.if_else(high, upper, command)))
        cut.append(low + high)
    return ca.vertcat(*kept), (Output("saturated", ca.vertcat(*cut)),)
