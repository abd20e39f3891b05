"""A sweep as clickable points: a line for one key, a map for two, dots or a table for more."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from wormopt.digest import BETTER
from wormopt.families.gathered import NUMBERED, STATUS, as_typed
from wormopt.files import POINTS
from wormopt.quantities import Variable
from wormopt.reports.parts import (
    details,
    escaped,
    name_text,
    number,
    scrolled,
    sentence,
    unit_text,
    value_text,
)
from wormopt.reports.pictures import animation, pictures
from wormopt.reports.source import Source
from wormopt.reports.worm import motion_html, moving, rod
from wormopt.result import Result


@dataclass(frozen=True, eq=False)
class Axis:
    """A swept key, and its values as texts; also as numbers if they are."""

    key: str
    unit: str
    texts: tuple[str, ...]
    values: np.ndarray

    @property
    def name(self) -> str:
        """The key with its unit."""
        return f"{self.key} ({unit_text(self.unit)})" if self.unit != "1" else self.key

    def at(self, k: int) -> str:
        """Key and value."""
        return f"{self.key} = {self.texts[k]} {unit_text(self.unit)}".rstrip()


@dataclass(frozen=True, eq=False)
class Grid:
    """A sweep; its points are counted in C order, the last axis fastest.

    For scattered points, every axis has a value for each point.
    """

    axes: tuple[Axis, ...]
    lattice: bool
    numbers: tuple[Variable, ...]
    states: tuple[int, ...]
    reasons: tuple[str, ...]
    files: tuple[Path | None, ...]

    @property
    def shape(self) -> tuple[int, ...]:
        """Points along each axis."""
        return tuple(len(axis.texts) for axis in self.axes)

    def index(self, point: int) -> tuple[int, ...]:
        """Index of a point along each axis."""
        if not self.lattice:
            return (point,) * len(self.axes)
        return tuple(int(k) for k in np.unravel_index(point, self.shape))

    def place(self, point: int) -> str:
        """Describe the position of a point."""
        return ", ".join(a.at(k) for a, k in zip(self.axes, self.index(point), strict=True))

    def value(self, variable: Variable, point: int) -> float:
        """Number at a point."""
        return float(variable.values.ravel()[point])

    def good(self, variable: Variable, point: int) -> bool:
        """Whether a point has a valid number."""
        counts = self.states[point] in NUMBERED
        return counts and bool(np.isfinite(self.value(variable, point)))

    def span(self, variable: Variable) -> tuple[float, float, int | None]:
        """Least and largest valid number, and the best point if that is defined."""
        known = {k: self.value(variable, k) for k in range(len(self.states))
                 if self.good(variable, k)}  # fmt: skip
        if not known:
            return 0.0, 1.0, None
        low, high = min(known.values()), max(known.values())
        sense = BETTER.get(variable.name, 0)
        best = max(known, key=lambda k: sense * known[k]) if sense and low < high else None
        return low, high, best

    def says(self, variable: Variable, point: int, best: bool) -> str:
        """Describe a point by its position, and its number or the reason why it has none."""
        shown = number(self.value(variable, point), 4)
        if not self.good(variable, point):
            shown = STATUS[self.states[point]] if self.states[point] else "unknown"
        return f"{self.place(point)}: {shown}{', best' if best else ''}"

    def results(self, most: int) -> Iterator[tuple[int, Result]]:
        """Load saved results of at most this many points, spread evenly."""
        there = [k for k, file in enumerate(self.files) if file is not None]
        picked = there if len(there) <= most else [there[int(i * len(there) / most)]
                                                   for i in range(most)]  # fmt: skip
        for point in picked:
            file = self.files[point]
            try:
                yield point, Result.load(file)  # pyright: ignore[reportArgumentType]
            except (OSError, ValueError):
                continue


def grid_of(source: Source) -> Grid:
    """Read a result of kind sweep."""
    result = as_typed(source.result)
    given = result.attributes["axes"]
    axes = tuple(_axis(result, axis["key"], axis["dim"], axis.get("values")) for axis in given)
    names = {axis["dim"] for axis in given}
    dims = result["status"].dims
    numbers = [v for v in result.variables if v.dims == dims and v.name not in {"status", *names}]
    numbers.sort(key=lambda v: (v.name == "seconds", *_rank(v.name)))
    states = result["status"].values.ravel()
    count = len(states)
    reasons = result.attributes.get("reasons") or []
    # "points" in sweeps saved by earlier builds
    names_of_files = result.attributes.get("files") or result.attributes.get("points") or []
    files = [_file(source.folder, result.scene, name) for name in names_of_files]
    return Grid(
        axes,
        dims == tuple(axis["dim"] for axis in given),
        tuple(numbers),
        tuple(int(s) if 0 <= s < len(STATUS) else 1 for s in states),
        tuple(str(reasons[k] or "") if k < len(reasons) else "" for k in range(count)),
        tuple(files[k] if k < len(files) else None for k in range(count)),
    )


def _rank(name: str) -> tuple[int, int]:
    """Sort key: numbers of which one direction is better come first."""
    known = list(BETTER)
    return (0, known.index(name)) if name in BETTER else (1, 0)


def _axis(result: Result, key: str, dim: str, named: list[Any] | None) -> Axis:
    own = result[dim]
    texts = (value_text(value) for value in named or own.values.tolist())
    return Axis(key, own.unit, tuple(texts), own.values.astype(float))


def _file(folder: Path | None, scene: str, name: object) -> Path | None:
    """File of a point, only in the folder of the sweep or that of its scene."""
    if folder is None or not isinstance(name, str) or not name:
        return None
    folder = folder.resolve()
    usual = folder.parent / f"{Path(scene).name}-sweep"
    for place in (folder, folder / POINTS, usual / POINTS):
        file = (place / name).resolve()
        if file.is_relative_to(place) and file.is_file():
            return file
    return None


def words_of(variable: Variable) -> str:
    """Name of a number as words."""
    return name_text(variable.name)


# From light to dark in perceptually even steps, also for the colour-blind.
_RAMP = ("#f4f1e6", "#d3e4d0", "#a3d0c4", "#6ab6bb", "#3d96ae", "#2d749c", "#2b5285", "#243264")


def shade(value: float, low: float = 0.0, high: float = 1.0) -> str:
    """Colour of a number between two others; the middle one for NaN or an empty range."""
    share = (value - low) / (high - low) if high > low and isfinite(value) else 0.5
    at = min(max(share, 0.0), 1.0) * (len(_RAMP) - 1)
    k = min(int(at), len(_RAMP) - 2)
    mixed = (
        round(a + (at - k) * (b - a))
        for a, b in zip(_parts(_RAMP[k]), _parts(_RAMP[k + 1]), strict=True)
    )
    return "#" + "".join(f"{part:02x}" for part in mixed)


def ink_on(colour: str) -> str:
    """Black or white, whichever has more contrast."""
    return "#000" if (_luminance(colour) + 0.05) ** 2 > 0.05 * 1.05 else "#fff"


def gradient() -> str:
    """The whole colour map as a CSS gradient."""
    return f"linear-gradient(to right, {', '.join(_RAMP)})"


def _parts(colour: str) -> list[int]:
    return [int(colour[k : k + 2], 16) for k in (1, 3, 5)]


def _luminance(colour: str) -> float:
    shares = (part / 255 for part in _parts(colour))
    linear = [s / 12.92 if s <= 0.04045 else ((s + 0.055) / 1.055) ** 2.4 for s in shares]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


WIDTH, HEIGHT, LEFT, TOP, BOTTOM = 720.0, 300.0, 64.0, 14.0, 46.0
_MOST_NAMES = 12


def line_html(grid: Grid, variable: Variable, targets: list[str]) -> str:
    """Draw it; points without a number are crosses on the axis."""
    (axis,) = grid.axes
    low, high, best = grid.span(variable)
    margin = 0.08 * (high - low) or abs(high) * 0.1 or 1.0
    low, high = low - margin, high + margin
    base, per = HEIGHT - BOTTOM, (HEIGHT - BOTTOM - TOP) / (high - low)
    xs = along(axis.values, LEFT + 14, WIDTH - 20)
    found = [grid.value(variable, k) if grid.good(variable, k) else low for k in range(len(xs))]
    ys = [base - (value - low) * per for value in found]
    dots = "".join(
        dot(grid, variable, k, at, targets[k], k == best)
        for k, at in enumerate(zip(xs, ys, strict=True))
    )
    rules = "".join(level(at, base - (at - low) * per) for at in levels(low, high))
    return (
        f'<svg class="plot" viewBox="0 0 {WIDTH:g} {HEIGHT:g}" role="group" aria-label="'
        f'{escaped(words_of(variable))} over {escaped(axis.name)}">{rules}{_names(axis.texts, xs)}'
        f'<text class="axis" x="{(LEFT + WIDTH) / 2:g}" y="{HEIGHT - 4:g}" '
        f'text-anchor="middle">{escaped(axis.name)}</text>'
        f'<path class="course" d="{_course(grid, variable, xs, ys)}"/>{dots}</svg>'
    )


def level(at: float, y: float) -> str:
    """Draw a level with its number."""
    return (
        f'<path class="rule" d="M{LEFT:g} {y:.1f}H{WIDTH:g}"/><text x="{LEFT - 8:g}" '
        f'y="{y + 4:.1f}" text-anchor="end">{number(at, 4)}</text>'
    )


def _names(texts: tuple[str, ...], xs: list[float]) -> str:
    apart = max(1, -(-len(xs) // _MOST_NAMES))
    y = HEIGHT - BOTTOM + 20
    return "".join(
        f'<text x="{x:.1f}" y="{y:g}" text-anchor="middle">{escaped(text)}</text>'
        for text, x in list(zip(texts, xs, strict=True))[::apart]
    )


def _course(grid: Grid, variable: Variable, xs: list[float], ys: list[float]) -> str:
    """Path through the points that have a number, broken at the others."""
    path, pen = "", "M"
    for k, (x, y) in enumerate(zip(xs, ys, strict=True)):
        good = grid.good(variable, k)
        path += f"{pen}{x:.1f} {y:.1f}" if good else ""
        pen = "L" if good else "M"
    return path


def dot(
    grid: Grid,
    variable: Variable,
    point: int,
    at: tuple[float, float],
    target: str,
    best: bool,
    colour: str = "",
) -> str:
    """Draw a clickable point, as a cross if it has no number."""
    x, y = at
    label = escaped(grid.says(variable, point, best))
    shape = f'<path d="M{x - 5:.1f} {y - 5:.1f}l10 10m0 -10l-10 10"/>'
    if grid.good(variable, point):
        style = f' style="fill:{colour}"' if colour else ""
        shape = f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{8 if best else 5.5}"{style}/>'
    return (
        f'<a class="cell dot{" best" if best else ""}" data-point="{point}" href="{target}" '
        f'aria-label="{label}"><title>{label}</title><circle class="reach" cx="{x:.1f}" '
        f'cy="{y:.1f}" r="14"/>{shape}</a>'
    )


def along(values: np.ndarray, first: float, last: float) -> list[float]:
    """Positions of values along an axis, logarithmic if their spacing is."""
    if len(values) < 2 or not np.isfinite(values).all():
        return np.linspace(first, last, len(values)).tolist()
    if values.min() > 0 and values.max() / values.min() > 50:
        values = np.log(values)
    low, high = float(values.min()), float(values.max())
    span = high - low or 1.0
    return [first + (float(value) - low) / span * (last - first) for value in values]


def levels(low: float, high: float) -> list[float]:
    """Choose round numbers between two."""
    power = 10.0 ** np.floor(np.log10((high - low) / 6))
    step = next(m * power for m in (1, 2, 5, 10) if m * power >= (high - low) / 6)
    first = np.ceil(low / step) * step
    return [round(float(at), 12) for at in np.arange(first, high + 1e-9 * step, step)]


_SIGNS = {1: "×", 2: "○", 3: "·"}
_DENSE = 12  # number of columns from which cells have no room for numbers


def map_html(grid: Grid, variable: Variable, targets: list[str]) -> str:
    """A table whose rows are the first key, largest on top, and columns the second."""
    rows, columns = grid.axes
    low, high, best = grid.span(variable)
    dense = " dense" if len(columns.texts) > _DENSE else ""
    lines = []
    for i in reversed(range(len(rows.texts))):
        cells = "".join(
            _cell(
                grid,
                variable,
                i * len(columns.texts) + j,
                targets[i * len(columns.texts) + j],
                (low, high, best),
            )
            for j in range(len(columns.texts))
        )
        lines.append(f'<tr><th scope="row">{escaped(rows.texts[i])}</th>{cells}</tr>')
    head = "".join(f'<th scope="col">{escaped(text)}</th>' for text in columns.texts)
    name = f"<code>{escaped(columns.name)}</code> →"
    whole = (
        f'<table class="grid{dense}"><tbody>{"".join(lines)}</tbody><tfoot><tr><td></td>{head}</tr>'
        f'<tr><td></td><td class="key" colspan="{len(columns.texts)}">{name}</td></tr></tfoot>'
        "</table>"
    )
    rows_named = f'<p class="key"><code>{escaped(rows.name)}</code> ↑</p>'
    return rows_named + scrolled("Map", whole) + legend_html(grid, low, high, best)


def _cell(
    grid: Grid,
    variable: Variable,
    point: int,
    target: str,
    span: tuple[float, float, int | None],
) -> str:
    low, high, best = span
    label = escaped(grid.says(variable, point, point == best))
    shown, kind, style = number(grid.value(variable, point), 3), "cell", ""
    if grid.good(variable, point):
        colour = shade(grid.value(variable, point), low, high)
        style = f' style="background:{colour};color:{ink_on(colour)}"'
        kind += " best" if point == best else ""
    else:
        state = grid.states[point] or 3
        shown, kind = _SIGNS.get(state, "·"), f"cell state{state}"
    return (
        f'<td><a class="{kind}" data-point="{point}" href="{target}" title="{label}" '
        f'aria-label="{label}"{style}>{shown}</a></td>'
    )


def legend_html(grid: Grid, low: float, high: float, best: int | None) -> str:
    """Legend of colours and signs."""
    there = set(grid.states)
    keys = [
        f'<span class="key"><span class="cell state{k}" aria-hidden="true">{_SIGNS[k]}'
        f"</span> {STATUS[k]}</span>"
        for k in (1, 2, 3)
        if k in there
    ]
    keys += ['<span class="key"><span class="cell best" aria-hidden="true"></span> best</span>'
             ] if best is not None else []  # fmt: skip
    return (
        f'<p class="legend"><span class="key">{number(low, 3)} <span class="ramp" '
        f'aria-hidden="true" style="background:{gradient()}"></span> {number(high, 3)}</span> '
        f"{' '.join(keys)}</p>"
    )


def scatter_html(grid: Grid, variable: Variable, targets: list[str]) -> str:
    """Draw it; points without a number are crosses."""
    across, up = grid.axes[:2]
    low, high, best = grid.span(variable)
    base = HEIGHT - BOTTOM
    xs = along(across.values, LEFT + 14, WIDTH - 20)
    ys = along(up.values, base - 10, TOP + 10)
    dots = "".join(
        dot(grid, variable, k, (xs[k], ys[k]), targets[k], k == best,
            shade(grid.value(variable, k), low, high))
        for k in range(len(xs))
    )  # fmt: skip
    return (
        f'<svg class="plot" viewBox="0 0 {WIDTH:g} {HEIGHT:g}" role="group" aria-label="'
        f'{escaped(words_of(variable))} over {escaped(across.name)} and {escaped(up.name)}">'
        f"{_marks(up.values, ys, True)}{_marks(across.values, xs, False)}"
        f'<text class="axis" x="{(LEFT + WIDTH) / 2:g}" y="{HEIGHT - 4:g}" text-anchor="middle">'
        f'{escaped(across.name)}</text><text class="axis" x="0" y="11">{escaped(up.name)} ↑</text>'
        f"{dots}</svg>{legend_html(grid, low, high, best)}"
    )


def _marks(values: np.ndarray, places: list[float], upward: bool) -> str:
    """Ticks of an axis at values with even spacing, else at its ends."""
    low, high = float(values.min()), float(values.max())
    first, last = places[int(values.argmin())], places[int(values.argmax())]
    logarithmic = low > 0 and high / low > 50
    ticks = [low, high] if logarithmic or low == high else levels(low, high)
    span = high - low or 1.0
    at = [first + (value - low) / span * (last - first) for value in ticks]
    if upward:
        return "".join(level(value, y) for value, y in zip(ticks, at, strict=True))
    return "".join(
        f'<text x="{x:.1f}" y="{HEIGHT - BOTTOM + 20:g}" text-anchor="middle">{number(value, 4)}'
        "</text>"
        for value, x in zip(ticks, at, strict=True)
    )


_MOST_OPENED, _MOST_DRAWN = 64, 24  # most points with the worm moving, and with a picture
_MOST_MAPS, _MOST_CELLS = 10, 5000  # most numbers to choose from, and cells in all of their maps
_MOST_ROWS = 2500


def sweep_html(source: Source, ident: str, room: float) -> str:
    """Maps of the numbers of a sweep, one shown at a time, and its points."""
    grid = grid_of(source)
    blocks = _blocks(grid, ident, room)
    count = len(grid.states)
    targets = [
        f"#{ident}-p{k}" if k in blocks else f"#{ident}-row{k}" if count <= _MOST_ROWS else ""
        for k in range(count)
    ]
    numbers = grid.numbers[: max(1, min(_MOST_MAPS, _MOST_CELLS // max(count, 1)))]
    flat = grid.lattice and len(grid.axes) > 2
    shown = [] if flat else [_choice(grid, v, ident, targets, k) for k, v in enumerate(numbers)]
    options = "".join(
        f'<option value="{ident}-map{k}">{escaped(words_of(v))}</option>'
        for k, v in enumerate(numbers)
    )
    chooser = (
        f'<p class="choose" hidden=""><label for="{ident}-choose">Show</label> '
        f'<select id="{ident}-choose">{options}</select></p>'
        if len(shown) > 1
        else ""
    )
    panel = (
        '<div class="panel" hidden=""><h3 class="panel-title" aria-live="polite"></h3>'
        '<div class="panel-body"></div></div>'
    )
    points = "".join(blocks[k] for k in sorted(blocks))
    opened = f'<div class="points">{points}</div>' if points else ""
    return (
        f'<div class="sweep" id="{ident}-sweep"><p>{_states_text(grid)}</p>{chooser}'
        f"{''.join(shown)}{panel}{opened}{_table(grid, ident, targets, opened=flat)}</div>"
    )


def _states_text(grid: Grid) -> str:
    counts = [sum(state == k for state in grid.states) for k in range(len(STATUS))]
    counted = ", ".join(f"{n} {STATUS[k]}" for k, n in enumerate(counts) if n)
    keys = [f"<code>{escaped(axis.key)}</code>" for axis in grid.axes]
    over = " and ".join([", ".join(keys[:-1]), keys[-1]] if keys[1:] else keys)
    return f"{len(grid.states)} points over {over}: {counted}. Choose a point to see it."


def _choice(grid: Grid, variable: Variable, ident: str, targets: list[str], k: int) -> str:
    unit = unit_text(variable.unit)
    name = f"{words_of(variable)}{f' ({unit})' if unit else ''}"
    draw = line_html if len(grid.axes) == 1 else map_html if grid.lattice else scatter_html
    body = draw(grid, variable, targets)
    meaning = (
        sentence(variable.long_name) if name_text(variable.long_name) != words_of(variable) else ""
    )
    caption = f"<strong>{escaped(name)}</strong> {escaped(meaning)}"
    return (
        f'<figure class="map" id="{ident}-map{k}"><figcaption>{caption}</figcaption>{body}</figure>'
    )


# Points ------------------------------------------------------------------------------------------


def _blocks(grid: Grid, ident: str, room: float) -> dict[int, str]:
    """Details of the points with saved results: the motion, a picture."""
    blocks: dict[int, str] = {}
    drawn = 0
    for point, result in grid.results(_MOST_OPENED):
        own = f"{ident}-p{point}"
        few = drawn < _MOST_DRAWN and len(grid.files) <= _MOST_DRAWN
        found = moving(result) or rod(result)
        motion = motion_html(found, f"{own}-motion") if found else ""
        if few and not found:
            motion = animation(result, f"{own}-motion", room)
        parts = [motion] if motion else []
        if few:
            shown = [p for p in pictures(result, own, room, most=1) if p.svg]
            parts += [picture.html() for picture in shown]
            drawn += len(shown)
        size = sum(map(len, parts))
        if not parts or size > room:
            continue
        room -= size
        row = f"{ident}-row{point}" if len(grid.states) <= _MOST_ROWS else ident
        more = f'<p class="more"><a href="#{row}">Its numbers</a></p>'
        blocks[point] = (
            f'<details class="point" data-point="{point}"><summary>{escaped(grid.place(point))}'
            f'</summary><div id="{own}">{more}{"".join(parts)}</div></details>'
        )
    return blocks


def _table(grid: Grid, ident: str, targets: list[str], opened: bool) -> str:
    if len(grid.states) > _MOST_ROWS:
        return f"<p>The values of all {len(grid.states)} points are in the result.</p>"
    numbers = grid.numbers[: max(1, min(12, 30_000 // len(grid.states)))]
    heads = [f"{name} ({unit})" if unit else name for name, unit in [
        *((axis.name, "") for axis in grid.axes), ("status", ""),
        *((words_of(v), unit_text(v.unit)) for v in numbers),
    ]]  # fmt: skip
    head = "".join(f'<th scope="col">{escaped(name)}</th>' for name in heads)
    rows = "".join(_table_row(grid, k, ident, targets, numbers) for k in range(len(grid.states)))
    whole = f'<table class="rows"><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>'
    inner = scrolled("All points", whole, "wide tall")
    return details("All points as a table", inner, opened=opened)


def _table_row(
    grid: Grid, point: int, ident: str, targets: list[str], numbers: tuple[Variable, ...]
) -> str:
    places = [axis.texts[k] for axis, k in zip(grid.axes, grid.index(point), strict=True)]
    first = (
        f'<a class="cell row" data-point="{point}" href="{targets[point]}">{escaped(places[0])}</a>'
    )
    state, why = STATUS[grid.states[point]], grid.reasons[point]
    status = escaped(f"{state}: {why}" if why else state)
    cells = [first, *map(escaped, places[1:]), status]
    cells += [value_text(grid.value(v, point), "1", 6) for v in numbers]
    inner = "".join(f"<td>{cell}</td>" for cell in cells)
    return f'<tr id="{ident}-row{point}">{inner}</tr>'
