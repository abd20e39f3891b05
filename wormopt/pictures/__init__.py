# pyright: strict, reportUnknownVariableType=false, reportUnknownArgumentType=false, reportUnknownMemberType=false
"""Pictures of results, from the names of their variables and scalars only.

The registry of kinds lists them; each is loaded when it is drawn.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from io import BytesIO
from pathlib import Path
from typing import IO, Any

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.text import Text

from wormopt.errors import ArgumentError
from wormopt.files import MARK, MOVING, STILL, sealed
from wormopt.kinds import kind_of
from wormopt.pictures.page import FACTS, Animation
from wormopt.pictures.style import GREY, INCH, PAGE, RED, styled, visible, wrapped
from wormopt.result import Result

_DPI, _FILM_DPI = 200, 100
_FRAMES_PER_SECOND = 12
_EDGE = 0.05  # margin around a heading, in inches
_LETTER = 0.057  # width of a letter of a label, in inches
_METADATA: dict[str, dict[str, Any]] = {
    "png": {"Comment": MARK},
    "svg": {"Date": None, "Description": MARK},
    "pdf": {"CreationDate": None, "Subject": MARK},
}


def pictures_of(result: Result) -> Mapping[str, str]:
    """Pictures of results of this kind, with their functions, "module:function"."""
    kind = kind_of(result)
    return kind.pictures if kind else {}


def figure(
    result: Result,
    picture: str,
    *,
    width: float | None = None,
    height: float | None = None,
    title: bool = True,
) -> Figure:
    """Compose a picture; `save` writes it. Parameters and errors are those of `draw`.

    An animation gives its first frame. A failed result is always marked.
    """
    for name, size in (("width", width), ("height", height)):
        if size is not None and not 30 <= size <= 2000:
            raise ArgumentError(f"{name} is in mm, from 30 to 2000, not {size:g}")
    inches = (width or PAGE) / INCH
    with styled({"figure.figsize": (inches, 0.62 * inches)}):
        drawn = _composer(result, picture)(result)
        # those of nested grids would be moved off the sheet
        drawn.align_ylabels([axes for axes in drawn.axes if _is_outermost(axes)])
        _entitle(drawn, result, height and height / INCH, title)
        _fit(drawn)
    return drawn


def draw(
    result: Result,
    picture: str,
    path: str | Path,
    *,
    width: float | None = None,
    height: float | None = None,
    title: bool = True,
) -> None:
    """Write a picture to a file, which appears only when it is complete.

    Parameters
    ----------
    result : Result
        The result to draw.
    picture : str
        Its name, as in the key `want` of scenes of this kind.
    path : path
        A name in a folder that exists, with the suffix ``.png``, ``.pdf`` or ``.svg``; of an
        animation ``.gif`` too, or ``.mp4`` where ffmpeg is installed. An animation moves in
        ``.svg``, too.
    width : float, optional
        Width in mm: 180, the default, is a page; 85 is one of two columns. Text keeps its size.
    height : float, optional
        Height in mm; by default as much as the picture needs.
    title : bool
        Whether the title of the result and its main values are shown above.

    Raises
    ------
    ArgumentError
        If there is no such picture, or it cannot be written in such a file.
    UnknownNameError
        If the result lacks what the picture needs; a KeyError that names it.
    OSError
        If the file cannot be written.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> from wormopt.result import Variable
    >>> columns = {"front_speed": [0.5, 0.7], "front_value": [12.0, 20.0], "front_accepted": [1, 0]}
    >>> points = [Variable(name, "1", ("point",), column) for name, column in columns.items()]
    >>> with TemporaryDirectory() as folder:
    ...     path = Path(folder) / "front.pdf"
    ...     draw(Result("trade", "gait-pareto", variables=tuple(points)), "front", path, width=85)
    ...     path.read_bytes()[:4]
    b'%PDF'
    """
    path = Path(path)
    moves = _composer(result, picture)
    form = _form(path, moves=isinstance(moves, Animation))
    drawn = figure(result, picture, width=width, height=height, title=title)
    unfinished = path.with_name(f".unfinished-{path.name}")
    try:
        if isinstance(moves, Animation) and form in MOVING:
            _film(moves, drawn, unfinished)
        elif isinstance(moves, Animation) and form == "svg":
            unfinished.write_text(moving_svg(moves, drawn), encoding="utf-8", newline="\n")
        else:
            save(drawn, unfinished, form)
        unfinished.write_bytes(sealed(unfinished.read_bytes()))
        unfinished.replace(path)
    finally:
        unfinished.unlink(missing_ok=True)


def save(drawn: Figure, target: Path | IO[bytes], form: str) -> None:
    """Write a figure as "png", "pdf" or "svg" to a file, the same bytes each time."""
    with styled():
        _lay_out(drawn, _DPI)
        if form == "png":  # `savefig` would draw twice
            FigureCanvasAgg(drawn).print_png(target, metadata=_METADATA[form])
        else:
            drawn.savefig(target, format=form, dpi=_DPI, metadata=_METADATA[form])


def shortened(svg: str) -> str:
    """Round coordinates in SVG to a hundredth of a point, and leave comments and spaces out."""
    svg = re.sub(r"<!--.*?-->|(?<=>)\s+(?=<)", "", svg, flags=re.DOTALL)
    return re.sub(r' (?:d|x|y|points)="[^"]*"', _rounded, svg)


def _rounded(attribute: re.Match[str]) -> str:
    text = re.sub(r"-?\d+\.\d{3,}", lambda m: f"{round(float(m[0]), 2):g}", attribute[0])
    return re.sub(r"\s*([A-Za-z])\s+(?=-?\d)", r"\1", text).replace("\n", "")


def all_frames(moves: Animation, drawn: Figure, every: int = 1) -> str:
    """Write all frames, or some, into one SVG, with the classes ``frame``, and ``f0`` and so on."""
    moves.show_all(drawn, every)
    stream = BytesIO()
    save(drawn, stream, "svg")
    moves.show(drawn, 0)
    text = shortened(stream.getvalue().decode())
    return re.sub(r'<g id="frame-(\d+)-\d+">', r'<g class="frame f\1">', text)


def moving_svg(moves: Animation, drawn: Figure) -> str:
    """Write an animation as SVG that moves by itself, without scripts.

    A style sheet shows one frame after the other. Viewers without animations, and readers who want
    little motion, see the first.
    """
    text = all_frames(moves, drawn)
    share, duration = 100 / moves.frames, moves.frames / _FRAMES_PER_SECOND
    begin = (f".f{k}{{animation-delay:{k / _FRAMES_PER_SECOND:.5f}s}}" for k in range(moves.frames))
    style = (
        f"@keyframes shown{{0%{{visibility:visible}}{share:.6f}%{{visibility:hidden}}}}"
        f".frame{{visibility:hidden;animation:shown {duration:.5f}s step-end infinite}}"
        f".f0{{visibility:visible}}{''.join(begin)}"
        "@media(prefers-reduced-motion:reduce){.frame{animation:none}}"
    )
    return text.replace("<defs>", f"<style>{style}</style><defs>", 1)


def _lay_out(drawn: Figure, dpi: float) -> None:
    """Lay a figure out with rounded positions: the last digits of the solver vary."""
    drawn.set_dpi(dpi)
    engine = drawn.get_layout_engine()
    if engine:
        engine.execute(drawn)
    drawn.set_layout_engine("none")
    for axes in drawn.axes:
        place = axes.get_position(original=True).bounds
        axes.set_position([round(part, 6) for part in place], which="original")  # pyright: ignore[reportArgumentType]


def _composer(result: Result, picture: str) -> Callable[[Result], Figure]:
    """Load the function that composes a picture."""
    pictures = pictures_of(result)
    if picture not in pictures:
        raise ArgumentError(no_picture(result, picture))
    module, _, compose = pictures[picture].partition(":")
    return getattr(import_module(module), compose)


def no_picture(result: Result, picture: str) -> str:
    """Message that there is no such picture, with a list of those there are."""
    from difflib import get_close_matches

    pictures = pictures_of(result)
    close = get_close_matches(picture, pictures, 1)
    hint = f"; did you mean {close[0]}? There are:" if close else "; there are:"
    there = ", ".join(pictures) or "none"
    return f"no picture {picture!r} of kind {result.kind}{hint} {there}"


def _form(path: Path, *, moves: bool) -> str:
    """Format of a file, by its suffix."""
    form = path.suffix.lower().removeprefix(".")
    if form not in (*STILL, *(MOVING if moves else ())):
        those = ", ".join(f".{name}" for name in (*STILL, *(MOVING if moves else ())))
        why = "only an animation moves" if form in MOVING else f"no format {form or 'by no suffix'}"
        raise ArgumentError(f"{path.name}: {why}; write {those}")
    if form == "mp4" and not shutil.which("ffmpeg"):
        raise ArgumentError(f"{path.name}: MP4 needs ffmpeg, which is not on PATH; install it "
                            "(apt install ffmpeg, brew install ffmpeg), or write .gif")  # fmt: skip
    return form


def _entitle(drawn: Figure, result: Result, height: float | None, title: bool) -> None:
    """Put title and facts above a picture, whose height grows unless it is given."""
    canvas = FigureCanvasAgg(drawn)
    known = [text for text in drawn.texts if text.get_label() == FACTS]
    facts = "; ".join(text.get_text() for text in known)
    for text in known:
        text.remove()
    rows: list[tuple[Sequence[str], str, dict[str, Any]]] = []
    if title:
        words = (result.title or result.scene).split()
        rows.append((words, " ", {"size": 9.5, "weight": "bold", "parse_math": False}))
    if result.status == "failed":
        words = f"failed: {result.reason or 'no reason given'}".split()
        rows.append((words, " ", {"color": RED, "weight": "bold", "parse_math": False}))
        drawn.set_facecolor("#FDF0EC")
    if title and facts:
        rows.append((facts.split("; "), "; ", {"color": GREY, "size": 7.5}))
    whole = height or drawn.get_figheight()
    down, room, texts = _EDGE, 0.95 * drawn.get_figwidth() - _EDGE, []
    for parts, between, style in rows:
        text = drawn.text(0, 1, "", va="top", linespacing=1.15, **style)
        _break(text, parts, between, room * drawn.dpi)
        texts.append((text, down))
        down += text.get_window_extent(canvas.get_renderer()).height / drawn.dpi + _EDGE
    if height is None and rows:
        whole += down
    drawn.set_figheight(whole)
    for text, above in texts:
        text.set_position((_EDGE / drawn.get_figwidth(), 1 - above / whole))
    engine = drawn.get_layout_engine()
    if rows and isinstance(engine, ConstrainedLayoutEngine):
        engine.set(rect=(0, 0, 1, 1 - down / whole))


def _is_outermost(axes: Axes) -> bool:
    spec = axes.get_subplotspec()
    return spec is not None and spec is spec.get_topmost_subplotspec()


def _fit(drawn: Figure) -> None:
    """Break labels that are longer than their axes into lines."""
    inches = drawn.get_size_inches()
    named = [(axes, across, text) for axes in drawn.axes for across, text in
             enumerate((axes.yaxis.label, axes.xaxis.label)) if text.get_visible()]  # fmt: skip
    # to lay a picture out takes longer than all else: only for labels that may be too long
    if all(
        _LETTER * _longest(text) < 0.8 * (axes.get_position().size * inches)[1 - across]
        for axes, across, text in named
    ):
        return
    drawn.draw_without_rendering()
    for axes, across, text in named:
        length, most = text.get_window_extent().size[1 - across], axes.bbox.size[1 - across]
        if length > most > 0:
            text.set_text(wrapped(text.get_text(), max(8, _longest(text) * most / length)))


def _longest(text: Text) -> int:
    """Letters of the longest line of a text."""
    return max(map(visible, text.get_text().split("\n")))


def _break(text: Text, parts: Sequence[str], between: str, room: float) -> None:
    """Break words or facts into lines no longer than `room`, in pixels."""

    def fits(line: str) -> bool:
        text.set_text(line)
        return text.get_window_extent().width <= room

    lines = [""]
    for part in parts:
        # words of a fact that is longer than a line
        for k, piece in enumerate([part] if fits(part) else part.split(" ")):
            joint = (" " if k else between) if lines[-1] else ""
            if fits(lines[-1] + joint + piece):
                lines[-1] += joint + piece
            else:
                lines.append(piece)
    text.set_text("\n".join(lines).strip())


def _film(moves: Animation, drawn: Figure, path: Path) -> None:
    from matplotlib.animation import FFMpegWriter, PillowWriter  # slow to import

    film = FFMpegWriter if path.suffix == ".mp4" else PillowWriter
    writer = film(fps=_FRAMES_PER_SECOND)
    with styled(), writer.saving(drawn, path, dpi=_FILM_DPI):
        _lay_out(drawn, _FILM_DPI)  # once: nothing shifts from frame to frame
        for frame in range(moves.frames):
            moves.show(drawn, frame)
            writer.grab_frame()
