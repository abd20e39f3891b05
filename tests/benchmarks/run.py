"""What all benchmarks share, how they are run, laid out and drawn.

A benchmark is a module here with four functions: ``measured(name, quick, report)`` yields what is
known so far, ready for JSON; ``lines(found)`` lays it out for readers, ``draw(found, path)`` draws
it to a PNG file, and ``ratios(found)`` says by whose times ours were divided, and what came out.
Those of one shape share `tests.benchmarks.ladder`.
"""

from __future__ import annotations

import math
import platform
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from time import perf_counter
from typing import Any, TypeVar

import numpy as np

from tests.benchmarks import LADDERS
from wormopt.progress import Report

_PACKAGES = (
    *("casadi", "numpy", "scipy", "numba", "diffrax", "scikit-sundae", "heyoka"),
    *("rockit-meco", "yapss", "mujoco", "magpylib", "scikit-fem", "pyelastica"),
)
_COLOURS = ("#D55E00", "#0072B2", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#332288", "#882255")
_MARKS = "os^Dv<>pP*Xh"

OWN = "wormopt"
"""The solver whose times are compared with those of the others."""

Found = dict[str, Any]
Answer = TypeVar("Answer")


def machine() -> dict[str, str]:
    """What the times depend on: processor, system, versions."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
        model = next(line.split(":")[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        model = platform.processor()
    found = {"processor": model, "system": platform.platform(), "python": platform.python_version()}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found


def bench(name: str, *, quick: bool, folder: Path, report: Report) -> Iterator[Found]:
    """Measure a case of `tests.benchmarks.CASES` and write its picture to `folder`.

    Yields what is known so far, ready for JSON; ``done`` is true once nothing is missing.
    `quick`: fewer tolerances and rounds, no solver that needs longer than half a second.
    """
    benchmark, found = _benchmark(name), Found()
    for known in benchmark.measured(name, quick, report):
        found = {"case": name, **known, "done": False}
        yield found
    picture = folder / f"{name}.png"
    benchmark.draw(found, picture)
    yield found | {"picture": str(picture), "done": True}


def table(found: Mapping[str, Any]) -> str:
    """Lay out for readers what is known of a case, as yielded by `bench`."""
    lines = _benchmark(found["case"]).lines(found)
    return "\n".join(lines if found["done"] else [*lines, "  (unfinished)"])


def ratios(found: Mapping[str, Any]) -> dict[str, float]:
    """Our times over those of others, by their names, of a case that is known."""
    answer: dict[str, float] = _benchmark(found["case"]).ratios(found)
    return answer


def _benchmark(name: str) -> Any:
    return import_module(f"tests.benchmarks.{'ladder' if name in LADDERS else name}")


# -- numbers -------------------------------------------------------------------------------------


def timed(work: Callable[..., Answer], *given: Any) -> tuple[float, Answer]:
    """Call `work` with what is given; seconds it takes, and its answer."""
    begin = perf_counter()
    answer = work(*given)
    return perf_counter() - begin, answer


def finite(value: float) -> float | None:
    """The number for JSON, which knows neither NaN nor infinity."""
    return value if math.isfinite(value) else None


def compared(times: Mapping[str, float | None]) -> dict[str, float]:
    """Our time over each of the others', where both are known."""
    ours = times.get(OWN)
    return {name: ours / t for name, t in times.items() if name != OWN and ours and t}


def exponent(x: Sequence[float], y: Sequence[float]) -> float | None:
    """Exponent p of y ~ x^p, fitted; None for fewer than two points."""
    return float(np.polyfit(np.log(x), np.log(y), 1)[0]) if len(x) > 1 else None


# -- text ----------------------------------------------------------------------------------------


def aligned(*rows: Iterable[str]) -> list[str]:
    """Lines of a table; the first row is its head."""
    cells = [tuple(row) for row in rows]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    return [
        "  " + "  ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)).rstrip()
        for row in cells
    ]


def seconds(value: float | None, missing: str = "") -> str:
    """A time with three digits in a unit that suits it."""
    if value is None:
        return missing
    for unit, size in (("s", 1.0), ("ms", 1e-3)):
        if value >= size:
            return f"{value / size:.3g} {unit}"
    return f"{value / 1e-6:.3g} us"


def why(error: Exception) -> str:
    """The kind of an error and its first line."""
    return f"{type(error).__name__}: {str(error).partition(chr(10))[0]}"


# -- pictures ------------------------------------------------------------------------------------


def axes(across: str, up: str) -> tuple[Any, Any]:
    """Figure and logarithmic axes with labels."""
    from matplotlib.figure import Figure  # once there is something to draw

    figure = Figure(figsize=(8, 4.5), layout="constrained")
    found = figure.add_subplot(xscale="log", yscale="log", xlabel=across, ylabel=up)
    found.grid(visible=True, color="#E6E6E6", linewidth=0.6)
    found.spines[["top", "right"]].set_visible(False)
    return figure, found


def colour(k: int) -> str:
    """Colour of the k-th curve."""
    return _COLOURS[k % len(_COLOURS)]


def curve(
    axes: Any, k: int, rows: Sequence[Mapping[str, Any]], x: str, y: str, **style: Any
) -> None:
    """Plot column `y` of the rows over column `x` in the style of the k-th curve."""
    chosen = {"color": colour(k), "marker": _MARKS[k % len(_MARKS)], "markersize": 4} | style
    axes.plot([row[x] for row in rows], [row[y] for row in rows], **chosen)


def save(figure: Any, path: Path, title: str = "", **legend: Any) -> None:
    """Write a figure to a PNG file, a legend in each of its axes."""
    for found in figure.axes:
        found.legend(**{"fontsize": 8, "frameon": False} | legend)
    if title:
        figure.axes[0].set_title(title, fontsize=9)
    figure.savefig(path, dpi=130)
