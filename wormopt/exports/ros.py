"""ROS: a gait as a message trajectory_msgs/JointTrajectory, written in YAML."""

from __future__ import annotations

from collections.abc import Iterable
from decimal import Decimal

import numpy as np

from wormopt.errors import ArgumentError
from wormopt.exports.common import ExportedGait, multiples
from wormopt.model.gait import Gait

_SECOND = 1_000_000_000
_LATEST = 2**31  # seconds have 32 bits
_AT_REST = float(np.finfo(np.float32).eps)  # tolerance of the receiver


ENDS_AT = "Ends at velocities"
"""Beginning of the remark that the trajectory does not end at rest."""


def make(
    exported: ExportedGait, stem: str, step: float = 0.01, cycles: int = 1, *, rest: bool = False
) -> dict[str, bytes]:
    """``STEM.yaml``: points a step apart, and one at the end of the last cycle.

    With `rest` it begins and ends at rest: in the first and the last half cycle the motion is
    slower, so that no rate grows.
    """
    if not isinstance(cycles, int) or cycles < 1:
        raise ArgumentError(f"cycles must be a whole number, 1 or above, not {cycles!r}")
    ramp = exported.gait.period / 2 if rest else 0.0
    end = exported.gait.period * cycles + ramp
    if end >= _LATEST:
        raise ArgumentError(f"{end:g} s exceeds the 32 bits of ROS for seconds; write fewer cycles")
    instants = multiples(step, 0.0, end)
    if step < 1e-9:
        raise ArgumentError(f"ROS counts whole nanoseconds; write a step above {step:g} s")
    at = [_nanoseconds(t) for t in instants]
    last = _nanoseconds(Decimal(exported.gait.period) * cycles + Decimal(ramp))
    at = [t for t in at if t < last] + [last]
    whole = Decimal(repr(exported.gait.period)) * _SECOND
    if not ramp and whole == int(whole):  # cycles of whole nanoseconds repeat exactly
        rows = [exported.gait(np.array(at) % int(whole) / _SECOND, k) for k in range(3)]
    else:
        rows = _rows(exported.gait, np.array(at) / _SECOND, end, ramp)
    rows[0] = exported.rounded(rows[0])
    lines = [*_head(exported, rows[1], rest=rest), "points:", *_points(at, rows)]
    return {f"{stem}.yaml": "".join(f"{line}\n" for line in lines).encode()}


def _nanoseconds(t: Decimal) -> int:
    return int((t * _SECOND).to_integral_value())


def _rows(gait: Gait, t: np.ndarray, end: float, ramp: float) -> list[np.ndarray]:
    """Lengths, rates and accelerations (n, m), with slower motion in ramps at both ends."""
    if not ramp:
        t = np.append(t[:-1], 0.0)  # the end of the last cycle, whole nanoseconds or not
        return [gait(t, derivative) for derivative in range(3)]
    left = np.minimum(t, end - t)  # to the nearer end
    x = np.clip(left / ramp, 0.0, 1.0)
    # the pace is 3 x² - 2 x³, so that neither it nor its slope jumps
    pace, slope = x * x * (3 - 2 * x), np.where(t < end / 2, 6.0, -6.0) * x * (1 - x) / ramp
    lost = ramp * x**3 * (1 - x / 2) + np.maximum(left - ramp, 0.0)
    at = np.where(t < end / 2, lost, end - ramp - lost)
    length, rate, acceleration = (gait(at, derivative) for derivative in range(3))
    return [length, rate * pace, acceleration * pace**2 + rate * slope]


def _head(exported: ExportedGait, rates: np.ndarray, *, rest: bool) -> Iterable[str]:
    yield "# trajectory_msgs/JointTrajectory, positions are lengths of links in m"
    yield from (f"# {line}" for line in (*exported.remarks, *exported.rounding))
    if exported.time_unit != "s":
        yield "# The scene has no units: its unit of time is taken for 1 s, of length for 1 m."
    fastest = float(np.abs(rates[:, -1]).max())
    if rest:
        yield "# Begins and ends at rest, time running slower in the first and last half cycle."
    elif fastest > _AT_REST:
        yield (
            f"# {ENDS_AT} up to {fastest:.3g} m/s. The joint_trajectory_controller of ros2_control "
            "refuses it unless allow_nonzero_velocity_at_trajectory_end is true; `--rest` (in "
            "Python rest=True) writes a trajectory that begins and ends at rest."
        )
    yield "# Begins and ends at the same lengths: sent again at its end, it repeats."
    yield "header:"
    yield "  stamp: {sec: 0, nanosec: 0}"
    yield "  frame_id: ''"
    yield f"joint_names: [{', '.join(f'link_{j}' for j in range(exported.gait.links))}]"


def _points(at: list[int], found: list[np.ndarray]) -> Iterable[str]:
    values = [rows.T.tolist() for rows in found]
    for instant, *rows in zip(at, *values, strict=True):
        seconds, rest = divmod(instant, _SECOND)
        length, rate, acceleration = (", ".join(map(_number, row)) for row in rows)
        yield f"- positions: [{length}]"
        yield f"  velocities: [{rate}]"
        yield f"  accelerations: [{acceleration}]"
        yield "  effort: []"
        yield f"  time_from_start: {{sec: {seconds}, nanosec: {rest}}}"


def _number(value: float) -> str:
    """Number that every reader of YAML recognises: 1.0e-05, where Python writes 1e-05."""
    text = repr(value)
    return text.replace("e", ".0e") if "e" in text and "." not in text else text
