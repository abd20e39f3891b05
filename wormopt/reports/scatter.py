"""A number of a sweep with scattered points: clickable dots over the first two keys."""

from __future__ import annotations

import numpy as np

from wormopt.quantities import Variable
from wormopt.reports.colours import shade
from wormopt.reports.grid import Grid, words_of
from wormopt.reports.line import BOTTOM, HEIGHT, LEFT, TOP, WIDTH, along, dot, level, levels
from wormopt.reports.maps import legend_html
from wormopt.reports.words import escaped, number


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
