"""ROS: a gait as a message trajectory_msgs/JointTrajectory, written in YAML."""

from __future__ import annotations

from collections.abc import Iterable
from decimal import Decimal

import numpy as np

from wormopt.errors import ArgumentError
from wormopt.exports.about import Course
from wormopt.exports.instants import multiples

_SECOND = 1_000_000_000
_LATEST = 2**31  # seconds are kept in 32 bits


def make(course: Course, stem: str, step: float = 0.01, cycles: int = 1) -> dict[str, bytes]:
    """``STEM.yaml``: points a step apart, and one at the end of the last cycle.

    Raises ArgumentError if the step is below a nanosecond or gives too many points, or there is
    no cycle.
    """
    if not isinstance(cycles, int) or cycles < 1:
        raise ArgumentError(f"cycles must be a whole number from 1 on, not {cycles!r}")
    end = course.gait.period * cycles
    if end >= _LATEST:
        raise ArgumentError(f"ROS has 32 bits for seconds, too few for {end:g}; write fewer cycles")
    instants = multiples(step, 0.0, end)
    if step < 1e-9:
        raise ArgumentError(f"ROS counts whole nanoseconds; write a step above {step:g} s")
    at = [_nanoseconds(t) for t in instants]
    last = _nanoseconds(Decimal(course.gait.period) * cycles)
    at = [t for t in at if t < last] + [last]
    lines = [*_head(course), "points:", *_points(course, at)]
    return {f"{stem}.yaml": "".join(f"{line}\n" for line in lines).encode()}


def _nanoseconds(t: Decimal) -> int:
    return int((t * _SECOND).to_integral_value())


def _head(course: Course) -> Iterable[str]:
    yield "# trajectory_msgs/JointTrajectory, positions are lengths of links in m"
    yield from (f"# {line}" for line in course.remarks)
    if course.time_unit != "s":
        yield "# The scene has no units: its unit of time is taken for 1 s, of length for 1 m."
    yield "header:"
    yield "  stamp: {sec: 0, nanosec: 0}"
    yield "  frame_id: ''"
    yield f"joint_names: [{', '.join(f'link_{j}' for j in range(course.gait.links))}]"


def _points(course: Course, at: list[int]) -> Iterable[str]:
    t = np.array(at) / _SECOND
    values = [course.gait(t, derivative).T.tolist() for derivative in range(3)]
    for instant, *rows in zip(at, *values, strict=True):
        seconds, rest = divmod(instant, _SECOND)
        length, rate, acceleration = (", ".join(map(_number, row)) for row in rows)
        yield f"- positions: [{length}]"
        yield f"  velocities: [{rate}]"
        yield f"  accelerations: [{acceleration}]"
        yield "  effort: []"
        yield f"  time_from_start: {{sec: {seconds}, nanosec: {rest}}}"


def _number(value: float) -> str:
    """Number as every reader of YAML takes it for one: 1.0e-05, where Python writes 1e-05."""
    text = repr(value)
    return text.replace("e", ".0e") if "e" in text and "." not in text else text
