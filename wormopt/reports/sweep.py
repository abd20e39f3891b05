"""A sweep as a map of clickable points; for one key a line, for many a table or dots."""

from __future__ import annotations

from wormopt.families.gathered import STATUS
from wormopt.quantities import Variable
from wormopt.reports.grid import Grid, grid_of, words_of
from wormopt.reports.line import line_html
from wormopt.reports.maps import map_html
from wormopt.reports.motion import moving, rod
from wormopt.reports.parts import details, scrolled
from wormopt.reports.pictures import pictures
from wormopt.reports.scatter import scatter_html
from wormopt.reports.source import Source
from wormopt.reports.words import escaped, name_text, sentence, unit_text, value_text
from wormopt.reports.worm import motion_html

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
        found = moving(result) or rod(result)
        parts = [motion_html(found, f"{own}-motion")] if found else []
        if drawn < _MOST_DRAWN and len(grid.files) <= _MOST_DRAWN:
            shown = [p for p in pictures(result, own, room, most=1) if p.svg]
            parts += [picture.html() for picture in shown]
            drawn += len(shown)
        size = sum(map(len, parts))
        if not parts or size > room:
            continue
        room -= size
        row = f"{ident}-row{point}" if len(grid.states) <= _MOST_ROWS else ident
        told = f'<p class="told"><a href="#{row}">Its numbers</a></p>'
        blocks[point] = (
            f'<details class="point" data-point="{point}"><summary>{escaped(grid.place(point))}'
            f'</summary><div id="{own}">{told}{"".join(parts)}</div></details>'
        )
    return blocks


def _table(grid: Grid, ident: str, targets: list[str], opened: bool) -> str:
    if len(grid.states) > _MOST_ROWS:
        return f"<p>The numbers of all {len(grid.states)} points stand in the result.</p>"
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
