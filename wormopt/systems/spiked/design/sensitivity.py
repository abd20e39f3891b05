"""Sensitivity of a designed gait to its limits.

The optimum is often a vertex where more limits are active than necessary, so multipliers are not
unique. Every limit is therefore moved a little, and the program with the moved limit is linearised
at the optimum. Its multipliers are those of this direction, and give the derivative of the best
gait with the same order of rest. If derivatives to both sides differ, a family of gaits may be
equally good, each of which is best to one side only. The moved program is then solved again, and
the larger gain counts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from msgspec import structs

from wormopt.errors import ArgumentError
from wormopt.model.given import per
from wormopt.numerics.bilinear import Climb
from wormopt.quantities import UNITS, parsed
from wormopt.shown import Part, html, lines
from wormopt.systems.spiked.design.design import Design
from wormopt.systems.spiked.gait_problem import GaitProblem, Objective
from wormopt.systems.spiked.limits import Rates
from wormopt.systems.spiked.programs.program import GaitProgram
from wormopt.systems.spiked.search.trial import Trial

# Share by which limits are moved; multipliers give the gain without rounding.
_SHARE = 1e-5
# Derivatives to both sides that differ by less than this share are equal.
_SAME = 0.01
# Elasticities below this are rounding.
_NOTHING = 1e-5
# Share by which limits are moved to solve again, and when that ends.
_FAR, _AGAIN = 1e-4, Climb(tolerance=1e-10, steps=40)
# Programs with more unknowns are not solved again, which would take seconds for each limit.
_MOST_AGAIN = 400


@dataclass(frozen=True)
class Limit:
    """A number of a task that can be changed."""

    name: str  # in the task: "limits.acceleration[1]"
    value: float
    quantity: str  # physical quantity, a name for `unit_of`
    moved: Callable[[float], GaitProblem]  # the task with another value


@dataclass(frozen=True)
class Sensitivity:
    """Sensitivity of the optimal objective to one limit.

    Parameters
    ----------
    name : str
        Name of the limit in the task: "limits.acceleration[1]", "limits.length.longest".
    value : float
        Value of the limit.
    quantity : str
        Physical quantity of the limit, a name for `unit_of`.
    derivative : float
        Change of the objective (speed or cost) per unit of the limit, in the direction in which
        the objective improves; 0 if it improves in neither. A limit of 0 can only be raised.
    elasticity : float
        Relative change of the objective over the relative change of the limit; 0 for a limit of 0.
    raised, lowered : float
        Derivatives for raising and lowering the limit; NaN if this is impossible.
    one_sided : bool
        Whether these differ by more than 1 %. Then another limit becomes active here, or, in a
        program with more than 400 unknowns, a family of gaits is equally good. The derivatives
        are then lower bounds on the improvement in each direction.

    Examples
    --------
    >>> import wormopt as wo
    >>> limits = wo.Limits(period=1.0, length=(0.7, 1.3), rate=1.0, acceleration=20.0)
    >>> found = wo.sensitivities(wo.design(wo.Worm(links=1, load=5.0), limits))
    >>> (rate,) = (each for each in found if each.name == "limits.rate")
    >>> round(rate.derivative, 6), rate.one_sided
    (0.35, False)
    """

    name: str
    value: float
    quantity: str
    derivative: float
    elasticity: float
    raised: float
    lowered: float
    one_sided: bool

    def __repr__(self) -> str:
        effect = f"derivative {self.derivative:.6g}, elasticity {self.elasticity:.6g}"
        return lines(f"Sensitivity to {self.name} = {self.value:.6g}: {effect}")


class Sensitivities(tuple[Sensitivity, ...]):
    """Sensitivities of a design, which notebooks show as a table."""

    __slots__ = ()

    def __repr__(self) -> str:
        binding = [f"{s.name} {s.elasticity:.3g}" for s in self if s.elasticity]
        return lines(f"Sensitivities to {len(self)} limits", f"elasticity: {', '.join(binding)}")

    def _repr_html_(self) -> str:
        rows = [("limit", "value", "derivative", "elasticity", "")]
        for s in sorted(self, key=lambda s: -abs(s.elasticity)):
            remark = "differs to both sides" if s.one_sided else ""
            value, derivative = f"{s.value:.6g}", f"{s.derivative:.6g}"
            rows.append((s.name, value, derivative, f"{s.elasticity:.6g}", remark))
        return html("Sensitivity of the objective to each limit", [Part("", rows)])


def sensitivities(design: Design) -> Sensitivities:
    """Compute the sensitivities of the optimal objective to all limits at fixed resting sequence.

    Parameters
    ----------
    design : Design
        A design for speed or a peak load. If its cycles are whole ticks, its `free` design is used.

    Returns
    -------
    tuple of Sensitivity
        In the order of the scene's keys; limits that do not bind have 0.

    Raises
    ------
    ArgumentError
        If the design minimises energy or effort, for which there are no multipliers.

    Examples
    --------
    Two masses m that rest alternately, at rate r, period T, acceleration a and load G, reach the
    speed r/2 - r r/(2 T) (1/a + m/(2 G)), whose derivative by r = 1 is 0.35 here.

    >>> from wormopt.systems.spiked.gait_problem import Limits, Worm
    >>> from wormopt.systems.spiked.design.optimize import design
    >>> limits = Limits(period=1.0, length=(0.7, 1.3), rate=1.0, acceleration=20.0)
    >>> found = sensitivities(design(Worm(1, load=5.0), limits))
    >>> {s.name: round(s.derivative, 4) for s in found if abs(s.elasticity) > 1e-9}
    {'limits.period': 0.075, 'limits.rate': 0.35, 'limits.acceleration': 0.0012, ...
    """
    if design.free is not None:  # with whole ticks the best objective changes in jumps
        return sensitivities(design.free)
    trial = design.trial
    if trial is None:
        raise ArgumentError(
            f"the design minimises {design.task.objective.minimise}, for which there are no "
            "sensitivities; design for speed, peak_spike_load or peak_actuator_force"
        )
    program, point = trial.program.finer(trial.point)
    if point is not None:  # a single link's limit may bend the motion inside an arc
        trial = replace(trial, program=program, point=point)
    trial.program.bilinear.linearise(trial.point.x)
    found = (_sensitivity(design.task, trial, limit) for limit in limits_of(design.task))
    return Sensitivities(found)


def scaling_error(known: Iterable[Sensitivity], objective: Objective) -> float:
    """Largest error of elasticities against a change of units of mass, length and time; near 0.

    Elasticities of all limits, times their powers of a unit, sum to the objective's power. This
    does not hold if derivatives to both sides differ.
    """
    sums = sum((s.elasticity * _powers(s.quantity) for s in known), np.zeros(3))
    return float(np.abs(sums - _powers(objective.quantity)).max())


def _powers(quantity: str) -> np.ndarray:
    """Powers of mass, length and time in a quantity."""
    _, dimension = parsed(UNITS[quantity])
    return np.array([dimension.get(unit, 0) for unit in ("kg", "m", "s")])


def _sensitivity(task: GaitProblem, trial: Trial, limit: Limit) -> Sensitivity:
    sign = 1.0 if task.objective.minimise is None else -1.0
    value = abs(trial.value)
    scale = limit.value or trial.program.limits.force  # only forces may be 0
    raised, lowered = (_gain(trial, limit, way * _SHARE * scale) for way in (1.0, -1.0))
    unsure = np.isnan(raised) or _apart(raised, lowered, value / scale)
    if unsure and len(trial.point.x) <= _MOST_AGAIN:
        # If a family of gaits is best, another of them may gain more.
        raised = np.fmax(raised, _gain_again(trial, limit, _FAR * scale))
        lowered = np.fmin(lowered, _gain_again(trial, limit, -_FAR * scale))
    better = raised if raised > 0 or np.isnan(lowered) else lowered if lowered < 0 else 0.0
    derivative = float(sign * better + 0.0)
    return Sensitivity(
        name=limit.name,
        value=limit.value,
        quantity=limit.quantity,
        derivative=derivative,
        elasticity=derivative * limit.value / value if value else np.nan,
        raised=float(sign * raised),
        lowered=float(sign * lowered),
        one_sided=_apart(raised, lowered, value / scale),
    )


def _apart(raised: float, lowered: float, size: float) -> bool:
    """Whether derivatives to both sides differ by more than rounding."""
    return abs(raised - lowered) > max(_SAME * max(abs(raised), abs(lowered)), _NOTHING * size)


def _gain(trial: Trial, limit: Limit, step: float) -> float:
    """Derivative of the maximised value to one side of a limit, at the same gait."""
    if limit.value + step < 0.0:
        return np.nan
    moved = _moved(trial, limit.moved(limit.value + step))
    return trial.program.bilinear.gain(moved.bilinear, trial.point.x) * trial.program.unit / step


def _gain_again(trial: Trial, limit: Limit, step: float) -> float:
    """The derivative of `_gain`, by solving again from the gait."""
    if limit.value + step < 0.0:
        return np.nan
    program, moved = trial.program, _moved(trial, limit.moved(limit.value + step))
    widths = program.widths(trial.point)
    start = moved.start_arcs(widths * (np.clip(widths.sum(), *moved.period) / widths.sum()))
    if start is None:
        return np.nan
    return (moved.objective(moved.bilinear.climb(start, _AGAIN)) - trial.value) / step


def _moved(trial: Trial, task: GaitProblem) -> GaitProgram:
    """The program of a task with a moved limit: with the same unknowns, rows and units."""
    shortest, longest = task.limits.period_range
    cycles, same = max(1, trial.cycles), trial.program
    return same.changed(task=task, period=(shortest / cycles, longest / cycles), like=same.limits)


def limits_of(task: GaitProblem) -> Iterator[Limit]:
    """All numbers of a task that may be moved: limits, worm, required speed.

    One for each number as written; a drag or limit that is not given is omitted.
    """
    task = structs.replace(task, worm=task.worm.on_level_ground)
    for part, key, quantity, ends in _KEYS:
        value = getattr(getattr(task, part), key)
        if value is None or (key == "drag" and value == 0.0):
            continue
        if key == "load" and isinstance(value, tuple) and len(value) > 2:
            ends = ()
        elif key in ("period", "load"):
            low, high = per(value, 2)
            value = low if low == high else value  # a range without width is one number
        for suffix, places, number in _numbers(value, ends):
            moved = partial(_replaced, task, (part, key, *places))
            yield Limit(task.key_of(f"{part}.{key}{suffix}"), number, quantity, moved)


def _numbers(value: Any, ends: Sequence[str]) -> Iterator[tuple[str, tuple, float]]:
    """Numbers in a number, (nested) tuple or Rates: suffix of the name, places, and value.

    A pair of numbers is a range if its ends have names.
    """
    if isinstance(value, Rates):
        items = [(f".{way}", way, getattr(value, way)) for way in ("contraction", "extension")]
    elif isinstance(value, tuple):
        is_range = ends and not any(isinstance(item, tuple) for item in value)
        names = [f".{ends[k]}" if is_range else f"[{k}]" for k in range(len(value))]
        items = [(name, k, item) for k, (name, item) in enumerate(zip(names, value, strict=True))]
    else:
        yield "", (), value
        return
    for name, place, item in items:
        for suffix, places, number in _numbers(item, ends):
            yield name + suffix, (place, *places), number


def _replaced(value: Any, places: Sequence[Any], number: float) -> Any:
    """The value with another number at nested fields and indices."""
    if not places:
        return float(number)
    at, *rest = places
    if isinstance(value, tuple):
        return (*value[:at], _replaced(value[at], rest, number), *value[at + 1 :])
    return structs.replace(value, **{at: _replaced(getattr(value, at), rest, number)})


# Part and field of a task, its quantity, and names of its ends if it is a range.
_ENDS = ("shortest", "longest")
_KEYS: tuple[tuple[str, str, str, Sequence[str]], ...] = (
    ("limits", "period", "time", _ENDS),
    ("limits", "length", "length", _ENDS),
    ("limits", "rate", "speed", ()),
    ("limits", "acceleration", "acceleration", ()),
    ("limits", "spike_load", "force", ()),
    ("limits", "actuator_force", "force", ()),
    ("limits", "sigma_margin", "force", ()),
    ("objective", "speed", "speed", ()),
    ("worm", "mass", "mass", ()),
    ("worm", "drag", "drag", ()),
    ("worm", "load", "force", ("smallest", "largest")),
    ("worm", "pull", "force", ()),
)
