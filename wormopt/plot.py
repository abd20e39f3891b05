"""Pictures of results; all they know is the names of a Result's variables and scalars.

Values of time stand twice where something jumps, so lines draw jumps as they are. Limits are
scalars that a result may lack: ``length_limits`` ([low, high] or one such pair per link),
``rate_limit`` (a number, one per link, or [contraction, extension] with one list each),
``spike_load_limit`` (a number or one per mass) and ``actuator_force_limit`` (a number or one
per link).
"""

from __future__ import annotations

import textwrap
import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.animation import PillowWriter
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from wormopt.result import Result

__all__ = ["PICTURES", "Picture", "draw", "figure"]

# Colour-blind-safe: masses by Tol ("muted"), links by Okabe and Ito, dashed from the fifth on.
_MASSES = ("#332288", "#CC6677", "#117733", "#DDAA33", "#88CCEE",
           "#882255", "#44AA99", "#999933", "#AA4499")  # fmt: skip
_LINKS = ("#0072B2", "#E69F00", "#009E73", "#D55E00") * 2
_GREY, _RED, _GLIDE = "#666666", "#B22222", "#F3E3C3"
_STYLE = {
    "font.size": 10.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#E6E6E6",
    "grid.linewidth": 0.6,
    "axes.axisbelow": True,
    "axes.titlesize": 10,
    "axes.titlecolor": _GREY,
    "legend.frameon": False,
    "legend.fontsize": 9.5,
    "lines.solid_capstyle": "butt",
    "mathtext.fontset": "dejavusans",
}
_DPI = 150
_PERIODS = 2  # shown in "motion" and "animation"
_FRAMES_PER_PERIOD, _FRAMES_PER_SECOND = 48, 16
_OBJECTIVES = {
    "peak_spike_load": r"largest load on a spike, max $\lambda_i$",
    "peak_actuator_force": r"largest actuator force, max $|\mu_j|$",
    "energy_per_distance": "energy per distance",
    "acceleration_effort": r"acceleration effort, mean $\ddot l^{\,2}$",
}


@dataclass(frozen=True)
class Picture:
    """How to draw one kind of picture.

    Parameters
    ----------
    compose : callable
        Gives the Figure of a Result, still without its title.
    needs : tuple of str
        Variables the Result must have.
    """

    compose: Callable[[Result], Figure]
    needs: tuple[str, ...]


def figure(result: Result, picture: str) -> Figure:
    """Compose a picture, with the title of the result and a mark if the result failed.

    Parameters
    ----------
    result : Result
        What to show.
    picture : str
        A key of `PICTURES`; of an animation this is the first frame.

    Returns
    -------
    Figure
        Bound to no window.

    Raises
    ------
    ValueError
        If there is no such picture.
    KeyError
        Naming the variables that the picture needs and the result lacks.

    Examples
    --------
    >>> from wormopt.result import Variable
    >>> speed = Variable("front_speed", "m s-1", ("point",), [0.5, 0.7])
    >>> value = Variable("front_value", "N", ("point",), [12.0, 20.0])
    >>> good = Variable("front_accepted", "1", ("point",), [1, 1])
    >>> front = Result("trade", "gait-pareto", "Trade-off", variables=(speed, value, good))
    >>> figure(front, "front").axes[0].get_xlabel()
    'mean speed $v$ (m s$^{-1}$)'
    """
    if picture not in PICTURES:
        raise ValueError(f"no picture {picture!r}; there are {', '.join(PICTURES)}")
    missing = [name for name in PICTURES[picture].needs if name not in result]
    if missing:
        error = KeyError(", ".join(missing))
        error.add_note(f"the picture {picture!r} is drawn from these variables of the result")
        raise error
    with rc_context(_STYLE):
        drawn = PICTURES[picture].compose(result)
        _entitle(drawn, result)
    return drawn


def draw(result: Result, picture: str, path: str | Path) -> None:
    """Write a picture to a file, which appears only when it is complete.

    Parameters
    ----------
    result : Result
        What to show.
    picture : str
        A key of `PICTURES`.
    path : path
        A name in a folder that exists, with a suffix matplotlib knows; ``.gif`` for an animation.

    Raises
    ------
    ValueError
        If there is no such picture.
    KeyError
        Naming the variables that the picture needs and the result lacks.
    OSError
        If the file cannot be written.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> from wormopt.result import Variable
    >>> columns = {"front_speed": [0.5, 0.7], "front_value": [12.0, 20.0], "front_accepted": [1, 0]}
    >>> points = [Variable(name, "1", ("point",), column) for name, column in columns.items()]
    >>> with TemporaryDirectory() as folder:
    ...     path = Path(folder) / "front.png"
    ...     draw(Result("trade", "gait-pareto", variables=tuple(points)), "front", path)
    ...     path.stat().st_size > 10_000
    True
    """
    path = Path(path)
    unfinished = path.with_name(f".unfinished-{path.name}")
    drawn = figure(result, picture)
    try:
        with rc_context(_STYLE), warnings.catch_warnings():
            # a title may hold letters that the font lacks; the picture is good all the same
            warnings.filterwarnings("ignore", message="Glyph .* missing from font")
            if picture == "animation":
                _film(result, drawn, unfinished)
            else:
                drawn.savefig(unfinished, dpi=_DPI)
        unfinished.replace(path)
    finally:
        unfinished.unlink(missing_ok=True)


def _entitle(drawn: Figure, result: Result) -> None:
    lines = textwrap.wrap(result.title or result.scene, 68)
    colour = "black"
    if result.status == "failed":
        lines += textwrap.wrap(f"failed: {result.reason or 'no reason given'}", 68)
        colour = _RED
        drawn.set_facecolor("#FDF0EC")
    drawn.suptitle("\n".join(lines), color=colour, fontsize=12, weight="bold", parse_math=False)


def _gait(result: Result) -> Figure:
    masses = len(result["resting"].values)
    heights = (3.0, 2.0, 0.25 + 0.17 * masses)
    drawn = Figure(figsize=(8, 2.0 + sum(heights)), layout="constrained")
    lengths, rates, band = drawn.subplots(3, sharex=True, height_ratios=heights)
    links = len(result["length"].values)
    _draw_links(lengths, result, "length", "link length $l_j$")
    _draw_limits(lengths, _ranges(_scalar(result, "length_limits"), links))
    _legend(lengths, _link_handles(links))
    _draw_links(rates, result, "rate", r"rate $\dot l_j$")
    _draw_limits(rates, _rate_ranges(_scalar(result, "rate_limit"), links))
    _draw_band(band, result)
    band.set_xlabel(_label("time $t$", result["time"].unit))
    lengths.set_title(_facts(result, "speed", "advance", "period", "ceiling"), loc="left")
    drawn.align_ylabels()
    return drawn


def _motion(result: Result) -> Figure:
    time, position = result["time"].values, result["position"].values
    period, advance = time[-1], position[0, -1] - position[0, 0]
    drawn = Figure(figsize=(7.5, 7), layout="constrained")
    axes = drawn.subplots()
    resting = result["resting"].values
    for turn in range(_PERIODS):
        t, x = time + turn * period, position + turn * advance
        for start, end in _stretches(t, ~resting.any(axis=0)):
            axes.axhspan(start, end, color=_GLIDE, linewidth=0)
        for i, colour in enumerate(_MASSES[: len(x)]):
            axes.plot(x[i], t, color=colour, linewidth=1.3)
            axes.add_collection(_heavy(x[i], t, resting[i], colour))
    for i, colour in enumerate(_MASSES[: len(position)]):
        for x, t in ((position[i, 0], 0.0), (position[i, -1] + advance, _PERIODS * period)):
            axes.text(x, t, str(i), color="white", fontsize=9, ha="center", va="center", zorder=5,
                      bbox={"boxstyle": "circle,pad=0.25", "fc": colour, "ec": "white"})  # fmt: skip
    axes.margins(0.04, 0.05)
    axes.set_xlabel(_label("position $x_i$", result["position"].unit))
    axes.set_ylabel(_label("time $t$", result["time"].unit))
    axes.set_title(_facts(result, "advance", "speed"), loc="left")
    handles = [Line2D([], [], color=_GREY, linewidth=5, label="rests on its spikes"),
               Line2D([], [], color=_GREY, linewidth=1.3, label="moves")]  # fmt: skip
    if not resting.any(axis=0).all():
        handles.append(Line2D([], [], color=_GLIDE, linewidth=8, label="whole worm glides"))
    drawn.legend(handles=handles, loc="outside lower center", ncols=3)
    return drawn


def _heavy(x: np.ndarray, t: np.ndarray, rests: np.ndarray, colour: str) -> LineCollection:
    """Stretches of a path on which the mass rests, as heavy lines."""
    stretches = _stretches(t, rests.astype(bool))
    lines = [[(np.interp(at, t, x), at) for at in stretch] for stretch in stretches]
    return LineCollection(lines, colors=colour, linewidths=5, zorder=3, capstyle="butt")


def _spikes(result: Result) -> Figure:
    masses, links = len(result["reaction"].values), len(result["actuator_force"].values)
    time = result["time"].values
    drawn = Figure(figsize=(8, 8.5), layout="constrained")
    loads, mean, forces = drawn.subplots(3, sharex=True, height_ratios=(3, 2, 2.5))
    for i, (load, colour) in enumerate(zip(result["reaction"].values, _MASSES, strict=False)):
        loads.plot(time, load, color=colour, linewidth=1.8, zorder=3 + (masses - i) / masses)
        loads.fill_between(time, load, color=colour, alpha=0.12, linewidth=0)
    _draw_limits(loads, _ceilings(_scalar(result, "spike_load_limit"), masses), _MASSES)
    _legend(loads, _mass_handles(masses))
    loads.set_ylabel(_label("load on the\nspikes $\\lambda_i$", result["reaction"].unit))
    loads.set_title(_facts(result, "spike_load_max", "actuator_force_max"), loc="left")
    mean.plot(time, result["sigma"].values, color=_GREY, linewidth=3.5, alpha=0.4,
              label=r"$\sigma$, needed to hold")  # fmt: skip
    mean.plot(time, result["reaction_mean"].values, color="black", linewidth=1.3,
              label=r"$\lambda$, mean load")  # fmt: skip
    mean.axhline(0.0, color=_GREY, linewidth=0.8)
    _legend(mean)
    mean.set_ylabel(_label("mean over\nthe masses", result["sigma"].unit))
    _draw_links(forces, result, "actuator_force", "actuator\nforce $\\mu_j$")
    _draw_limits(forces, _symmetric(_scalar(result, "actuator_force_limit"), links))
    _legend(forces, _link_handles(links))
    forces.set_xlabel(_label("time $t$", result["time"].unit))
    drawn.align_ylabels()
    return drawn


def _front(result: Result) -> Figure:
    speed, value = result["front_speed"], result["front_value"]
    accepted = result["front_accepted"].values.astype(bool)
    drawn = Figure(figsize=(7.5, 5.5), layout="constrained")
    axes = drawn.subplots()
    order = np.argsort(speed.values)
    line = order[accepted[order]]
    x, y = speed.values, value.values
    axes.plot(x[line], y[line], "o-", color=_LINKS[0], linewidth=1.6, markersize=7, label="optimal")
    if not accepted.all():
        axes.plot(x[~accepted], y[~accepted], "o", color=_RED, markerfacecolor="none",
                  markeredgewidth=1.6, markersize=8, label="not accepted")  # fmt: skip
    ceiling = _scalar(result, "ceiling")
    if ceiling is not None:
        axes.axvline(ceiling, color=_GREY, linestyle="--", linewidth=1, label="ceiling on speed")
    objective = str(_scalar(result, "front_objective") or "")
    name = _OBJECTIVES.get(objective, objective.replace("_", " ") or "objective")
    axes.set_xlabel(_label("mean speed $v$", speed.unit))
    axes.set_ylabel(_label(name, value.unit))
    axes.margins(0.06)
    drawn.legend(loc="outside lower center", ncols=3)
    return drawn


def _first_frame(result: Result) -> Figure:
    drawn = Figure(figsize=(8, 2.6), layout="constrained")
    _stage(drawn.subplots(), result)
    _pose(drawn, result, 0)
    return drawn


def _stage(axes: Axes, result: Result) -> None:
    """Ground with ticks, wide enough for all periods shown."""
    position = result["position"].values
    reach = position[0].max() + (_PERIODS - 1) * (position[0, -1] - position[0, 0])
    margin = 0.04 * (reach - position.min())
    axes.set_xlim(position.min() - margin, reach + margin)
    axes.set_ylim(-0.75, 1.0)
    axes.axhspan(-0.75, -0.35, color="#EFEBE4", linewidth=0)
    axes.axhline(-0.35, color=_GREY, linewidth=1.2)
    axes.set_yticks([])
    axes.spines["left"].set_visible(False)
    axes.set_xlabel(_label("position $x$", result["position"].unit))


def _pose(drawn: Figure, result: Result, frame: int) -> None:
    """Put the worm where it is in a frame; what rests is filled and has its spikes out."""
    axes = drawn.axes[0]
    for old in [*axes.lines[1:], *axes.texts]:  # the first line is the ground
        old.remove()
    time, position = result["time"].values, result["position"].values
    turn, part = divmod(frame, _FRAMES_PER_PERIOD)
    t = time[-1] * part / _FRAMES_PER_PERIOD
    x = np.array([np.interp(t, time, row) for row in position])
    x += turn * (position[0, -1] - position[0, 0])
    rests = result["resting"].values[:, np.searchsorted(time, t, side="right") - 1].astype(bool)
    for j, colour in enumerate(_LINKS[: len(x) - 1]):
        axes.plot(x[j : j + 2], [0, 0], color=colour, linewidth=4, alpha=0.8, zorder=2)
    for i, colour in enumerate(_MASSES[: len(x)]):
        if rests[i]:
            axes.plot(x[i], -0.37, marker="v", markersize=11, color=colour, zorder=3)
        axes.plot(x[i], 0, "o", markersize=19, markeredgecolor=colour, markeredgewidth=2.5,
                  markerfacecolor=colour if rests[i] else "white", zorder=4)  # fmt: skip
        axes.text(x[i], -0.015, str(i), color="white" if rests[i] else colour, fontsize=9,
                  weight="bold", ha="center", va="center", zorder=5)  # fmt: skip
    axes.text(0.01, 0.9, f"t = {turn + part / _FRAMES_PER_PERIOD:.2f} T", color=_GREY,
              transform=axes.transAxes)  # fmt: skip


def _film(result: Result, drawn: Figure, path: Path) -> None:
    writer = PillowWriter(fps=_FRAMES_PER_SECOND)
    with writer.saving(drawn, path, dpi=80):
        for frame in range(_PERIODS * _FRAMES_PER_PERIOD):
            _pose(drawn, result, frame)
            writer.grab_frame()


def _draw_links(axes: Axes, result: Result, name: str, label: str) -> None:
    for handle, row in zip(
        _link_handles(len(result[name].values)), result[name].values, strict=True
    ):
        axes.plot(result["time"].values, row, color=handle.get_color(), linewidth=1.8,
                  linestyle=handle.get_linestyle())  # fmt: skip
    axes.margins(x=0)
    axes.set_ylabel(_label(label, result[name].unit))


def _draw_band(axes: Axes, result: Result) -> None:
    """One row per mass, filled while it rests, and the glides shaded through all rows."""
    time, resting = result["time"].values, result["resting"].values.astype(bool)
    for start, end in _stretches(time, ~resting.any(axis=0)):
        axes.axvspan(start, end, color=_GLIDE, linewidth=0)
    for i, (rests, colour) in enumerate(zip(resting, _MASSES, strict=False)):
        bars = [(start, end - start) for start, end in _stretches(time, rests)]
        axes.broken_barh(bars, (i - 0.38, 0.76), color=colour, linewidth=0)
    axes.set_yticks(range(len(resting)), [str(i) for i in range(len(resting))])
    axes.set_ylim(len(resting) - 0.5, -0.5)
    axes.grid(visible=False, axis="y")
    axes.set_ylabel("mass\nat rest")


def _draw_limits(
    axes: Axes, limits: Sequence[tuple[float, ...]], colours: Sequence[str] = _LINKS
) -> None:
    """Thin dashed lines: grey where all share them, in their own colours otherwise."""
    shared = len(set(limits)) == 1
    for values, colour in zip(limits[:1] if shared else limits, colours, strict=False):
        for value in values:
            axes.axhline(value, color=_GREY if shared else colour, linestyle=(0, (5, 3)),
                         linewidth=1, zorder=1.5)  # fmt: skip


def _ranges(limits: Any, count: int) -> list[tuple[float, ...]]:
    if limits is None:
        return []
    pairs = limits if isinstance(limits[0], list) else [limits] * count
    return [(low, high) for low, high in pairs]


def _rate_ranges(limit: Any, count: int) -> list[tuple[float, ...]]:
    if isinstance(limit, list) and isinstance(limit[0], list):
        return [(-contraction, extension) for contraction, extension in zip(*limit, strict=True)]
    return _symmetric(limit, count)


def _symmetric(limit: Any, count: int) -> list[tuple[float, ...]]:
    return [(-value, value) for (value,) in _ceilings(limit, count)]


def _ceilings(limit: Any, count: int) -> list[tuple[float, ...]]:
    if limit is None:
        return []
    return [(value,) for value in (limit if isinstance(limit, list) else [limit] * count)]


def _stretches(time: np.ndarray, holds: np.ndarray) -> Iterable[tuple[float, float]]:
    """Intervals of time throughout which something holds at all samples."""
    steps = (holds[:-1] & holds[1:]) | (np.diff(time) == 0) & (holds[:-1] & holds[1:])
    edges = np.flatnonzero(np.diff(np.concatenate([[False], steps, [False]]).astype(int)))
    return [(float(time[a]), float(time[b])) for a, b in edges.reshape(-1, 2) if time[b] > time[a]]


def _link_handles(count: int) -> list[Line2D]:
    return [
        Line2D([], [], color=_LINKS[j], linestyle="-" if j < 4 else (0, (2, 1)), linewidth=1.8,
               label=f"link {j + 1}")
        for j in range(count)
    ]  # fmt: skip


def _mass_handles(count: int) -> list[Line2D]:
    ends = {0: " (head)", count - 1: " (tail)"}
    return [
        Line2D([], [], color=_MASSES[i], linewidth=1.8, label=f"mass {i}{ends.get(i, '')}")
        for i in range(count)
    ]


def _legend(axes: Axes, handles: list[Line2D] | None = None) -> None:
    """Beside the axes, where it covers nothing."""
    if handles is None:
        handles = [line for line in axes.get_lines() if not line.get_label().startswith("_")]
    axes.legend(handles=handles, loc="center left", bbox_to_anchor=(1.01, 0.5))


def _label(text: str, unit: str) -> str:
    """Axis label; 'm s-1' appears as m s with a raised -1, and '1' not at all."""
    if unit == "1":
        return text
    parts = [part for part in unit.split() if part]
    raised = [
        f"{part.rstrip('-0123456789')}$^{{{part[len(part.rstrip('-0123456789')) :]}}}$"
        if part[-1].isdigit()
        else part
        for part in parts
    ]
    return f"{text} ({' '.join(raised)})"


def _scalar(result: Result, name: str) -> Any:
    if name in result.scalars:
        return result.scalars[name].value
    return result.attributes.get(name)


def _facts(result: Result, *names: str) -> str:
    """The scalars of those names that the result has, as one line."""
    found = [(name, result.scalars[name]) for name in names if name in result.scalars]
    return "   ".join(
        f"{name.replace('_', ' ')} {_label(f'{scalar.value:.6g}', scalar.unit)}"
        for name, scalar in found
        if isinstance(scalar.value, int | float)
    )


_CYCLE = ("time", "resting")
PICTURES: dict[str, Picture] = {
    "gait": Picture(_gait, (*_CYCLE, "length", "rate")),
    "motion": Picture(_motion, (*_CYCLE, "position")),
    "spikes": Picture(_spikes, (*_CYCLE, "reaction", "reaction_mean", "sigma", "actuator_force")),
    "front": Picture(_front, ("front_speed", "front_value", "front_accepted")),
    "animation": Picture(_first_frame, (*_CYCLE, "position")),
}
"""Every picture by its name, the word in a scene's ``want``."""
