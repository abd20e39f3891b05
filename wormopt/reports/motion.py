"""The motion in a result, from its variables, resampled to a few hundred frames."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from wormopt.quantities import GRAVITY
from wormopt.reports.asked import scene_of
from wormopt.result import Result

_CYCLES = 2  # shown cycles of a gait
_MOST_FRAMES, _FEWEST_FRAMES, _MOST_NUMBERS = 241, 61, 40_000
_MOST_LANES = 6
STEEPEST = float(np.radians(30))
"""Largest slope drawn: a steeper one leaves no room for the worm."""


@dataclass(frozen=True, eq=False)
class Lane:
    """A worm in motion.

    position: (mass, frame). rests: (mass, frame) or None if unknown.
    load: (mass, frame), force of the ground or load on the spike, or None.
    """

    label: str
    position: np.ndarray
    rests: np.ndarray | None = None
    load: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class Moving:
    """Worms side by side over the same time.

    time: (frame,), in equal steps. angle: of the slope, rad. pull: the load that pulls each mass
    back, 0 if it is the slope.
    """

    time: np.ndarray
    lanes: tuple[Lane, ...]
    unit: str
    time_unit: str
    load_name: str = ""
    load_unit: str = "1"
    angle: float = 0.0
    pull: float = 0.0


@dataclass(frozen=True, eq=False)
class Rod:
    """A rod between walls. x, y: (frame, node). half: from the middle of the channel to a wall."""

    time: np.ndarray
    x: np.ndarray
    y: np.ndarray
    half: float
    body: float
    unit: str
    time_unit: str


def moving(result: Result) -> Moving | None:
    """Masses on the ground over time, None if the result has no such motion."""
    if "position" not in result:
        return None
    position = result["position"]
    along = position.dims[-1]
    if along not in ("time", "instant") or along not in result or len(position.values.T) < 2:
        return None
    time = result[along].values
    masses = 1 if position.dims[-2:-1] != ("mass",) else position.values.shape[-2]
    courses = position.values.reshape(-1, masses, len(time))[:_MOST_LANES]
    whole = np.isfinite(courses).all(axis=(0, 1)) & np.isfinite(time)
    kept = len(time) if whole.all() else int(np.argmin(whole))
    if kept < 2 or time[kept - 1] <= time[0]:
        return None
    rests, load = _rests(result, courses.shape), _loads(result, courses.shape)
    if result.kind == "capsule" and "inner_position" in result:
        courses = np.concatenate([courses, courses + result["inner_position"].values], axis=1)
        rests, load = _alone(rests, False), _alone(load, 0.0)
    cycles = _CYCLES if "resting" in result else 1
    frames = _frames(courses.shape[0] * courses.shape[1])
    at = np.linspace(time[0], time[0] + cycles * (time[kept - 1] - time[0]), frames)
    lanes = tuple(
        _lane(label, time[:kept], at, course[:, :kept], *(_of(rests, k), _of(load, k)))
        for k, (label, course) in enumerate(zip(_labels(result, position.dims), courses))  # noqa: B905
    )
    name = "load on the spike" if "reaction" in result else "force of the ground"
    source = "reaction" if "reaction" in result else "contact_force"
    angle, pull = _slope(result)
    return Moving(
        at, lanes, position.unit, result[along].unit,
        name if load is not None else "", result[source].unit if load is not None else "1",
        angle, pull,
    )  # fmt: skip


def rod(result: Result) -> Rod | None:
    """The rod of kind rod-motion."""
    if not all(name in result for name in ("frame", "rod_x", "rod_y")):
        return None
    x, y, time = (result[name].values for name in ("rod_x", "rod_y", "frame"))
    half = result.attributes.get("channel", 2.2 * float(np.abs(y).max())) / 2
    body = result.attributes.get("body", 0.2 * half)
    return Rod(time, x, y, half, body, result["rod_x"].unit, result["frame"].unit)


def _frames(rows: int) -> int:
    return int(np.clip(_MOST_NUMBERS // rows, _FEWEST_FRAMES, _MOST_FRAMES))


def _lane(
    label: str,
    time: np.ndarray,
    at: np.ndarray,
    course: np.ndarray,
    rests: np.ndarray | None,
    load: np.ndarray | None,
) -> Lane:
    """Resample one worm; a motion shorter than the shown time is repeated."""
    period = time[-1] - time[0]
    turn = np.minimum((at - time[0]) // period, np.ceil((at[-1] - time[0]) / period - 1e-9) - 1)
    within = at - turn * period
    position = np.array([np.interp(within, time, row) for row in course])
    position += turn * (course[0, -1] - course[0, 0])
    index = np.clip(np.searchsorted(time, within, side="right") - 1, 0, len(time) - 1)
    held = [None if rows is None else rows[:, index] for rows in (rests, load)]
    return Lane(label, position, *held)


def _rests(result: Result, shape: tuple[int, ...]) -> np.ndarray | None:
    """Which mass rests when: from the result, else where its velocity is exactly zero."""
    if "resting" in result:
        return result["resting"].values.astype(bool).reshape(1, *shape[1:])
    if "velocity" not in result or result["velocity"].dims != result["position"].dims:
        return None
    speed = np.abs(result["velocity"].values.reshape(-1, *shape[1:]))
    rests = speed <= 1e-9 * np.nanmax(speed)
    return rests if rests.mean() > 0.01 else None


def _loads(result: Result, shape: tuple[int, ...]) -> np.ndarray | None:
    for name in ("reaction", "contact_force"):
        if name in result and result[name].values.size % (shape[1] * shape[2]) == 0:
            load = result[name].values.reshape(-1, *shape[1:])
            if np.isfinite(load).all() and np.any(load):
                return load
    return None


def _alone(rows: np.ndarray | None, fill: Any) -> np.ndarray | None:
    """Add a row for the inner mass, which never touches the ground."""
    if rows is None:
        return None
    return np.concatenate([rows, np.full_like(rows, fill)], axis=1)


def _of(rows: np.ndarray | None, lane: int) -> np.ndarray | None:
    return None if rows is None else rows[min(lane, len(rows) - 1)]


def _labels(result: Result, dims: tuple[str, ...]) -> list[str]:
    """Names of the worms of a result with several."""
    before = [dim for dim in dims[:-1] if dim != "mass"]
    names = [""]
    for dim in before:
        count = dict(zip(dims, result["position"].values.shape, strict=True))[dim]
        own = result.attributes.get(f"{dim}s") or [f"{dim} {k}" for k in range(count)]
        names = [f"{name}, {one}".lstrip(", ") for name in names for one in own]
    return [str(name) for name in names]


def _slope(result: Result) -> tuple[float, float]:
    """Angle of the ground, rad, and the load that pulls in addition.

    A load alone is a slope if possible: a weight in SI units determines an angle.
    """
    raw = scene_of(result)
    worm = raw.get("worm")
    slope, load, mass = (
        worm.get(name) if isinstance(worm, dict) else None for name in ("slope", "load", "mass")
    )
    load = float(load) if isinstance(load, int | float) else 0.0
    if isinstance(slope, int | float) and slope:
        return float(slope), load
    if load and raw.get("units") == "SI" and isinstance(mass, int | float):
        share = load / (mass * GRAVITY)
        if abs(share) <= np.sin(STEEPEST):
            return float(np.arcsin(share)), 0.0
    return 0.0, load
