# pyright: strict, reportUnknownVariableType=false, reportUnknownArgumentType=false, reportUnknownMemberType=false
"""Masses on the ground in motion: what results hold of it, and an animation of them."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from wormopt.errors import UnknownNameError
from wormopt.kinds import kind_of
from wormopt.pictures.page import Animation, Page, Panel
from wormopt.pictures.style import CENTRED, GREY, colours, narrow
from wormopt.quantities import GRAVITY
from wormopt.result import Result

_CYCLES = 2  # shown cycles of a gait
_MOST_FRAMES, _FEWEST_FRAMES, _MOST_NUMBERS = 241, 61, 40_000
_MOST_LANES = 6
STEEPEST = float(np.radians(30))
"""Largest slope drawn: a steeper one leaves no room for the worm."""
ANIMATION = "wormopt.pictures.worms:animation"
"""Picture of the kinds whose masses are animated here."""


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

    @cached_property
    def positions(self) -> np.ndarray:
        """Positions of the masses of all worms, (masses, frame)."""
        return np.concatenate([lane.position for lane in self.lanes])


def moving(result: Result) -> Moving | None:
    """Masses on the ground over time, None if the result has no such motion."""
    # Bodies that are more than masses, such as floats and segments, have an animation of their own.
    if "position" not in result:
        return None
    position = result["position"]
    kind = kind_of(result)
    own = kind.pictures.get("animation", ANIMATION) if kind else ANIMATION
    if "mass" not in position.dims and own != ANIMATION:
        return None
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
    """Rests of masses over time: from the result, else where the velocity is exactly zero."""
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
    """Angle of the ground, rad, and the load that pulls in addition."""
    # A load alone is a slope if possible: a weight in SI units determines an angle.
    raw = json.loads(result.scene_text or "{}")
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


def camera(motion: Moving) -> np.ndarray | None:
    """Middle of the worms in each frame if they go far, else None: all of the way is shown."""
    every = motion.positions
    far = 0 < 4 * np.ptp(every, axis=0).max() < np.ptp(every)
    return (every.max(axis=0) + every.min(axis=0)) / 2 if far else None


# -- an animation, in which masses at rest are filled and have their spikes out --------------------

_ROW, _GROUND, _BOTTOM = 1.9, -0.35, -0.75  # distance of worms, and of the ground below them


@lru_cache(maxsize=1)
def _motion(result: Result) -> Moving:
    found = moving(result)
    if found is None:
        raise UnknownNameError("the result", "motion of masses", ["position"], [])
    return found


def _stage(result: Result) -> Page:
    """Draw the ground of each worm, as far as it goes, or as is seen when the camera follows."""
    motion = _motion(result)
    count = len(motion.lanes)
    page = Page(result, 0.75 + 1.15 * count, 0.55 + 0.75 * count)
    panel = page.panel()
    low, high = _ends(motion)
    panel.axes.set(xlim=(low, high), ylim=(_BOTTOM - _ROW * (count - 1), 1.0))
    for row, lane in enumerate(motion.lanes):
        top = _GROUND - _ROW * row
        panel.axes.axhspan(top + _BOTTOM - _GROUND, top, color="#EFEBE4", linewidth=0)
        panel.level(top, ls="-", lw=1.2)
        panel.axes.text(0.01, top + 1.2, lane.label, transform=panel.axes.get_yaxis_transform(),
                        parse_math=False)  # fmt: skip
    panel.scenery(equal=False, heights=False)
    spikes = " on its spikes" if "reaction" in result else ""
    rests = any(lane.rests is not None for lane in motion.lanes)
    panel.named("x", "position", f"position $x$; filled: at rest{spikes}" if rests else "")
    if camera(motion) is None:
        panel.axes.grid(visible=True)
    else:
        panel.axes.set_xticks([])
    return page


def _ends(motion: Moving) -> tuple[float, float]:
    """Ends of the ground that is seen, relative to the camera if it follows."""
    middles, every = camera(motion), motion.positions
    every = every if middles is None else every - middles
    margin = (0.04 if middles is None else 0.4) * float(np.ptp(every))
    return float(every.min()) - (margin or 1.0), float(every.max()) + (margin or 1.0)


def _pose(panel: Panel, frame: int) -> None:
    """Draw the worms: masses at rest are filled and have their spikes out."""
    page = panel.page
    motion = _motion(page.result)
    middles = camera(motion)
    k = round(frame * (len(motion.time) - 1) / (animation.frames - 1))
    middle = 0.0 if middles is None else float(middles[k])
    for row, lane in enumerate(motion.lanes):
        rests = None if lane.rests is None else lane.rests[:, k]
        _draw_worm(panel, lane.position[:, k] - middle, -_ROW * row, rests)
    if middles is not None:
        _draw_marks(panel, middle)
    unit = "" if motion.time_unit == "1" else f" {motion.time_unit}"
    panel.above(f"$t$ = {motion.time[k]:.3g}{unit}")


def _draw_worm(panel: Panel, x: np.ndarray, y: float, rests: np.ndarray | None) -> None:
    axes, size = panel.axes, min(0.65 if narrow() else 0.8, 5 / len(x))
    spikes = "reaction" in panel.page
    for j, color in enumerate(colours("link", len(x) - 1)):
        axes.plot(x[j : j + 2], [y, y], color=color, linewidth=4 * size, alpha=0.8, zorder=2)
    for i, color in enumerate(colours("mass", len(x))):
        held = rests is not None and bool(rests[i])
        if held and spikes:
            axes.plot(x[i], y - 0.37, marker="v", markersize=11 * size, color=color, zorder=3)
        axes.plot(x[i], y, "o", markersize=19 * size, markeredgecolor=color,
                  markeredgewidth=2.5 * size, markerfacecolor=color if held else "white",
                  zorder=4)  # fmt: skip
        if size > 0.5:
            axes.text(x[i], y, str(i), color="white" if held else color, zorder=5, size=7,
                      **CENTRED)  # fmt: skip


def _draw_marks(panel: Panel, middle: float) -> None:
    """Draw marks at round places of the ground, which moves under the worms."""
    low, high = panel.axes.get_xlim()
    bottom = panel.axes.get_ylim()[0]
    step = round_step((high - low) / 6)
    first = np.ceil((low + middle) / step)
    for place in step * np.arange(first, np.floor((high + middle) / step) + 1):
        panel.axes.plot(2 * [place - middle], [bottom, bottom + 0.2], color=GREY, linewidth=1)
        panel.axes.text(place - middle, bottom + 0.25, f"{place + 0.0:.6g}", color=GREY, size=7,
                        ha="center", va="bottom")  # fmt: skip


def round_step(least: float) -> float:
    """Smallest of 1, 2, 5, 10 times a power of ten that is no less."""
    power = 10.0 ** np.floor(np.log10(least))
    return float(next(m * power for m in (1, 2, 5, 10) if m * power >= least * (1 - 1e-9)))


animation = Animation(120, _stage, _pose)
