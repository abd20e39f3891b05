"""A number of a sweep over one key: a line with clickable points. Also axes of other plots."""

from __future__ import annotations

import numpy as np

from wormopt.quantities import Variable
from wormopt.reports.grid import Grid, words_of
from wormopt.reports.words import escaped, number

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
