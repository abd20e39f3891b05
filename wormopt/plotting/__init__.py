"""Pictures of results; all they know is the names of a Result's variables and scalars.

Which there are says the registry of kinds; each is loaded when it is drawn.
"""

from __future__ import annotations

import textwrap
import warnings
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

from matplotlib import rc_context
from matplotlib.animation import PillowWriter
from matplotlib.figure import Figure

from wormopt.kinds import kind_of
from wormopt.plotting.parts import RED, STYLE
from wormopt.result import Result

_DPI, _FILM_DPI = 150, 80
_FRAMES_PER_SECOND = 12


def figure(result: Result, picture: str) -> Figure:
    """Compose a picture, with the title of the result and a mark if the result failed.

    `picture` is one of the result's kind; an animation gives its first frame. ValueError if there
    is no such picture, UnknownNameError, a KeyError, for a variable that the result lacks.
    """
    with rc_context(STYLE):
        drawn = _composer(result, picture)(result)
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
        with rc_context(STYLE), warnings.catch_warnings():
            # a title may hold letters that the font lacks; the picture is good all the same
            warnings.filterwarnings("ignore", message="Glyph .* missing from font")
            compose = _composer(result, picture)
            if compose.__name__ == "first_frame":
                _film(result, compose.__module__, drawn, unfinished)
            else:
                drawn.savefig(unfinished, dpi=_DPI)
        unfinished.replace(path)
    finally:
        unfinished.unlink(missing_ok=True)


def _composer(result: Result, picture: str) -> Callable[[Result], Figure]:
    """Load the function that composes a picture."""
    kind = kind_of(result)
    pictures = kind.pictures if kind else {}
    if picture not in pictures:
        there = ", ".join(pictures) or "none"
        raise ValueError(f"no picture {picture!r} of kind {result.kind}; there are: {there}")
    module, _, compose = pictures[picture].partition(":")
    return getattr(import_module(module), compose)


def _entitle(drawn: Figure, result: Result) -> None:
    title = "\n".join(textwrap.wrap(result.title or result.scene, 66))
    drawn.suptitle(title, fontsize=12, weight="bold", parse_math=False)
    if result.status == "failed":
        reason = textwrap.wrap(f"failed: {result.reason or 'no reason given'}", 84)
        drawn.axes[0].set_title(
            "\n".join(reason), loc="left", color=RED, weight="bold", parse_math=False
        )
        drawn.set_facecolor("#FDF0EC")


def _film(result: Result, moves: str, drawn: Figure, path: Path) -> None:
    drawn.draw_without_rendering()
    drawn.set_layout_engine("none")  # laid out once: nothing shifts from frame to frame
    writer = PillowWriter(fps=_FRAMES_PER_SECOND)
    with writer.saving(drawn, path, dpi=_FILM_DPI):
        module = import_module(moves)
        for frame in range(module.FRAMES):
            module.pose(drawn, result, frame)
            writer.grab_frame()
