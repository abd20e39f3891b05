"""Animated worms on a page: the motion in a result, on a stage for the page's script."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from wormopt.pictures.worms import STEEPEST, Lane, Moving, camera, moving, round_step
from wormopt.reports.parts import controls, escaped, number, unit_text, value_text
from wormopt.reports.pictures import animation
from wormopt.result import Result


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


def rod(result: Result) -> Rod | None:
    """The rod of kind rod-motion."""
    if not all(name in result for name in ("frame", "rod_x", "rod_y")):
        return None
    x, y, time = (result[name].values for name in ("rod_x", "rod_y", "frame"))
    half = result.attributes.get("channel", 2.2 * float(np.abs(y).max())) / 2
    body = result.attributes.get("body", 0.2 * half)
    return Rod(time, x, y, half, body, result["rod_x"].unit, result["frame"].unit)


_WIDTH, _PAD = 720.0, 26.0
_SKY, _LANE = 34.0, 62.0  # masses below the top of a lane, its height without bars
_LONGEST_BAR = 40.0
_POSES = 9
_PULL = (
    f'<path class="pull" d="M{_WIDTH - 16:g} 14h-44m7 -5l-7 5l7 5"/>'
    f'<text x="{_WIDTH - 66:g}" y="18" text-anchor="end">load</text>'
)


def motion_of(result: Result, ident: str, room: float) -> str:
    """Figure of the motion in a result, drawn by the page or in frames; empty without any."""
    found = moving(result) or rod(result)
    return motion_html(found, ident) if found else animation(result, ident, room)


def motion_html(motion: Moving | Rod, ident: str) -> str:
    """A figure: poses to read without scripts, and a stage that the script shows instead."""
    if isinstance(motion, Rod):
        stage, data, poses, caption = _rod_parts(motion)
    else:
        stage, data, poses, caption = _worm_parts(motion)
    text = json.dumps(data, separators=(",", ":")).replace("<", "\\u003c")
    last = len(motion.time) - 1
    return (
        f'<figure class="moving" id="{ident}"><div class="still">{poses}</div>'
        f'<div class="stage" hidden=""><div class="card-plain">{stage}</div>{controls(last)}'
        f'</div><figcaption>{caption}</figcaption><script type="application/json">{text}'
        "</script></figure>"
    )


# Worms -------------------------------------------------------------------------------------------


def _worm_parts(moving: Moving) -> tuple[str, dict[str, Any], str, str]:
    middles, every = camera(moving), moving.positions
    low, high = every.min(), every.max()
    window = max(float(high - low), 1e-300)
    if middles is not None:
        window = 1.7 * float(np.ptp(every, axis=0).max())
    scale = (_WIDTH - 2 * _PAD) / window
    loads = [np.abs(lane.load).max() for lane in moving.lanes if lane.load is not None]
    most = float(max(loads, default=0.0))
    radius = _radius(moving.lanes, scale)
    data = {
        "time": [_short(moving.time[0], 6), _short(moving.time[-1], 6), len(moving.time)],
        "unit": unit_text(moving.time_unit),
        "scale": scale,
        "origin": float(low),
        "pad": _PAD,
        "bar": _LONGEST_BAR / most if most else 0,
        "follow": _shifts(middles, low, scale),
        "lanes": [_lane_data(lane, float(high - low), most) for lane in moving.lanes],
    }
    stage = _stage(moving, scale, low, high, radius)
    poses = "".join(
        _poses(lane, moving, scale, low, middles is not None) for lane in moving.lanes[:3]
    )
    return stage, data, poses, _worm_caption(moving, most)


def _worm_caption(moving: Moving, most: float) -> str:
    parts = ["Mass 0 is the head." if moving.lanes[0].position.shape[0] > 1 else ""]
    if any(lane.rests is not None for lane in moving.lanes):
        parts.append("Filled: a mass at rest.")
    if most:
        back = any(
            lane.load is not None and lane.load.min() < -1e-3 * most for lane in moving.lanes
        )
        caption = f"Bars: {moving.load_name}, the longest {value_text(most, moving.load_unit, 3)}"
        caption += "; hollow where it points backward." if back else "."
        parts.append(f'<span class="bars">{escaped(caption)}</span>')
    if moving.angle:
        degrees = number(float(np.degrees(moving.angle)), 3)
        drawn = "" if abs(moving.angle) <= STEEPEST else ", drawn less steep than it is"
        parts.append(f"The ground rises by {degrees}°{drawn}.")
    if moving.pull:
        pull = escaped(value_text(moving.pull, moving.load_unit))
        parts.append(f"A load of {pull} pulls every mass back.")
    return " ".join(filter(None, parts))


def _lane_data(lane: Lane, span: float, most: float) -> dict[str, Any]:
    """Data of a lane, rounded to visible precision."""
    places = int(np.clip(5 - np.floor(np.log10(span or 1.0)), 0, 15))
    found: dict[str, Any] = {"x": np.round(lane.position, places).tolist()}
    if lane.rests is not None:
        found["rests"] = ["".join("01"[int(r)] for r in row) for row in lane.rests]
    if lane.load is not None and most:
        found["load"] = [[_short(value, 3) for value in row] for row in lane.load]
    return found


def _shifts(middles: np.ndarray | None, low: float, scale: float) -> list[float]:
    """Shift of the ground to the left, frame by frame, if the worm leaves the picture."""
    if middles is None:
        return []
    return np.round((middles - low) * scale + _PAD - _WIDTH / 2, 1).tolist()


def _radius(lanes: Sequence[Lane], scale: float) -> float:
    gaps = [np.quantile(np.abs(np.diff(lane.position, axis=0)), 0.1) * scale for lane in lanes
            if lane.position.shape[0] > 1]  # fmt: skip
    return float(np.clip(0.42 * min(gaps, default=30.0), 3.5, 13.0))


def _stage(moving: Moving, scale: float, low: float, high: float, radius: float) -> str:
    step = _LANE + _LONGEST_BAR * any(lane.load is not None for lane in moving.lanes)
    last = len(moving.lanes) - 1
    angle = float(np.clip(moving.angle, -STEEPEST, STEEPEST))
    rise = (_WIDTH / 2) * abs(np.tan(angle))
    height = step * len(moving.lanes) + 2 * rise + 20
    foot = _SKY + radius + 5
    marks = _ticks(low, high, scale, foot)
    names = _tick_names(low, high, scale, step + 12)
    lanes = "".join(
        _stage_lane(lane, rise + step * k, radius, marks + (names if k == last else ""))
        for k, lane in enumerate(moving.lanes)
    )
    turn = ""
    if angle:
        degrees = -np.degrees(angle)
        turn = f' transform="rotate({degrees:.3f} {_WIDTH / 2:g} {height / 2:.1f})"'
    arrow = _PULL if moving.pull > 0 else ""
    return (
        f'<svg class="worm{" roomy" * (radius > 12)}" viewBox="0 0 {_WIDTH:g} {height:.0f}" '
        f'role="img" aria-label="The worm at the chosen time"><g{turn}>{lanes}</g>{arrow}</svg>'
    )


def _stage_lane(lane: Lane, top: float, radius: float, marks: str) -> str:
    """A worm on its ground; the script positions its masses."""
    foot, waist = _SKY + radius + 5, _SKY + 0.6 * radius
    wide, half = 0.6 * radius, min(radius, 5.0)
    links = f'<line class="link" y1="{_SKY:g}" y2="{_SKY:g}"/>' * (len(lane.position) - 1)
    masses = "".join(
        f'<g class="mass"><rect class="bar" x="{-half:.1f}" y="{foot:.1f}" width="{2 * half:.1f}" '
        f'height="0"/><path class="spike" d="M{-wide:.1f} {waist:.1f}L0 {foot:.1f}L{wide:.1f} '
        f'{waist:.1f}Z"/><circle cy="{_SKY:g}" r="{radius:.1f}"/>'
        + (f'<text y="{_SKY + 4.4:.1f}">{i}</text>' if radius >= 8 else "")
        + "</g>"
        for i in range(len(lane.position))
    )
    name = f'<text class="name" x="4" y="14">{escaped(lane.label)}</text>' if lane.label else ""
    return (
        f'<g class="lane" transform="translate(0 {top:.1f})">{name}<line class="ground" x1="-400" '
        f'x2="{_WIDTH + 400:g}" y1="{foot:.1f}" y2="{foot:.1f}"/><g class="world">{marks}{links}'
        f"{masses}</g></g>"
    )


def _marks(low: float, high: float, scale: float) -> list[tuple[float, float]]:
    """Marks on the ground at equal round distances, and their positions in the picture."""
    step = round_step(100 / scale)
    first = np.ceil((low - 0.5 * _PAD / scale) / step) * step
    places = np.arange(first, high + 0.5 * _PAD / scale, step)[:600]
    return [(round(float(place), 12), (place - low) * scale + _PAD) for place in places]


def _ticks(low: float, high: float, scale: float, foot: float) -> str:
    return "".join(
        f'<path class="tick" d="M{at:.2f} {foot:.1f}v5"/>' for _, at in _marks(low, high, scale)
    )


def _tick_names(low: float, high: float, scale: float, base: float) -> str:
    return "".join(
        f'<text class="tick" x="{at:.2f}" y="{base:.1f}">{number(place)}</text>'
        for place, at in _marks(low, high, scale)
    )


def _poses(lane: Lane, moving: Moving, scale: float, low: float, follow: bool) -> str:
    """A worm at a few times, one below the other, time going down."""
    shown = np.linspace(0, len(moving.time) - 1, _POSES).astype(int)
    position = lane.position
    left = 78.0
    if follow:
        low, scale = float(position.min()), (_WIDTH - 2 * _PAD) / float(np.ptp(position))
    scale *= (_WIDTH - _PAD - left) / (_WIDTH - 2 * _PAD)
    radius = min(_radius([lane], scale), 6.0)
    apart = 26.0
    rows = []
    for place, frame in enumerate(shown):
        y = 16 + apart * place
        at = [(x - low) * scale + left for x in position[:, frame]]
        when = escaped(f"t = {value_text(float(moving.time[frame]), moving.time_unit, 3)}")
        rows.append(f'<text class="when" x="0" y="{y + 4:.0f}">{when}</text>')
        rows.append(f'<path class="ground" d="M{left - 8:g} {y + radius + 3:.1f}H{_WIDTH:g}"/>')
        if len(at) > 1:
            rows.append(f'<path class="link" d="M{min(at):.1f} {y:g}H{max(at):.1f}"/>')
        for i, x in enumerate(at):
            rests = lane.rests is not None and bool(lane.rests[i, frame])
            rows.append(f'<circle class="{"rests" if rests else "moves"}" cx="{x:.1f}" cy="{y:g}" '
                        f'r="{radius:.1f}"/>')  # fmt: skip
    height = 16 + apart * (_POSES - 1) + 16
    name = f'<p class="name">{escaped(lane.label)}</p>' if lane.label else ""
    return (
        f'{name}<svg class="poses" viewBox="0 0 {_WIDTH:g} {height:.0f}" role="img" aria-label="'
        f'The worm at {_POSES} times, one below the other">{"".join(rows)}</svg>'
    )


def _short(value: Any, digits: int) -> float:
    return float(f"{float(value):.{digits}g}")


# Rods --------------------------------------------------------------------------------------------


def _rod_parts(rod: Rod) -> tuple[str, dict[str, Any], str, str]:
    low, high = float(rod.x.min()), float(rod.x.max())
    scale = (_WIDTH - 2 * _PAD) / (high - low)
    thick = max(rod.body * scale, 2.0)
    middle = rod.half * scale + 14
    height = 2 * middle + 22
    walls = "".join(
        f'<line class="wall" x1="0" x2="{_WIDTH:g}" y1="{y:.1f}" y2="{y:.1f}"/>'
        for y in (middle - rod.half * scale, middle + rod.half * scale)
    )
    marks = _ticks(low, high, scale, middle + rod.half * scale)
    body = f'<path class="rod" stroke-width="{thick:.1f}" d=""/>'
    stage = (f'<svg class="worm" viewBox="0 0 {_WIDTH:g} {height:.0f}" role="img" aria-label="The '
             f'rod at the chosen time">{walls}{marks}{body}</svg>')  # fmt: skip
    x = np.round((rod.x - low) * scale + _PAD, 1)
    y = np.round(middle - rod.y * scale, 1)
    data = {
        "time": [_short(rod.time[0], 6), _short(rod.time[-1], 6), len(rod.time)],
        "unit": unit_text(rod.time_unit),
        "rod": [np.stack([a, b], axis=1).ravel().tolist() for a, b in zip(x, y, strict=True)],
    }
    shown = np.linspace(0, len(rod.time) - 1, 5).astype(int)
    poses = "".join(
        f'<svg class="poses" viewBox="0 0 {_WIDTH:g} {height:.0f}" role="img" aria-label="The rod '
        f'at one time"><text class="when" x="0" y="{height - 4:.0f}">'
        f"{escaped('t = ' + value_text(float(rod.time[k]), rod.time_unit, 3))}</text>{walls}"
        f'<polyline class="rod" stroke-width="{thick:.1f}" points="'
        f'{" ".join(f"{a},{b}" for a, b in zip(x[k], y[k], strict=True))}"/></svg>'
        for k in shown
    )  # fmt: skip
    step = value_text(round_step(100 / scale), rod.unit, 3)
    return stage, data, poses, escaped(f"The rod between its walls; marks every {step}.")
