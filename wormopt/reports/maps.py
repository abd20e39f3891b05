"""A number of a sweep over two keys: a table with coloured, clickable cells."""

from __future__ import annotations

from wormopt.families.gathered import STATUS
from wormopt.quantities import Variable
from wormopt.reports.colours import gradient, ink_on, shade
from wormopt.reports.grid import Grid
from wormopt.reports.parts import scrolled
from wormopt.reports.words import escaped, number

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
