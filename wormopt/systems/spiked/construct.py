"""Gaits: constructed (fast gait of eq. 15, sines, block-rest waves, accordion) or from files."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import numpy as np

from wormopt.errors import ArgumentError, SceneError, UnknownNameError
from wormopt.model.gait import Gait
from wormopt.result import Result
from wormopt.study.scene import Scene
from wormopt.systems.shared.declared import GAIT
from wormopt.systems.shared.sequences import block_wave_sequence
from wormopt.systems.spiked.shapes import BlockWaveShape, FastShape, FileShape, Shape, SineShape
from wormopt.tables import SUFFIXES

Profile = Literal["cosine", "quintic", "trapezoid"]


def fast_gait(period: float, rest_length: float = 2.0, elongation: float = 0.15) -> Gait:
    """Make the fast gait for three masses, of which one rests at any time.

    This is eq. 15 of Zimmermann et al. 2007. The worm advances 4 e l0 per period.

    Parameters
    ----------
    period : float
        Period T.
    rest_length : float, optional
        Length l0.
    elongation : float, optional
        Relative amplitude e: lengths are between l0 (1 - 2 e) and l0 (1 + 2 e).

    Returns
    -------
    Gait
        Lengths of two links, once continuously differentiable.

    Examples
    --------
    >>> import numpy as np
    >>> fast_gait(1.0)(np.array([0.0, 1 / 3])).round(12)
    array([[2. , 2.6],
           [2. , 1.4]])
    """
    stroke = 2 * rest_length * elongation
    changes = stroke * np.array([[1.0, -1.0], [-1.0, 0.0], [0.0, 1.0]])
    shortest = rest_length + np.minimum([stroke, -stroke], 0.0)
    return _strokes(changes, period, shortest, "cosine")


def travelling_sine(
    links: int, period: float, rest_length: float = 2.0, amplitude: float = 0.6, lag: float = 1 / 3
) -> Gait:
    """Make a sine wave that runs from link to link, l_j = l0 + A sin(2 pi (t/T - (j + 1) lag)).

    Parameters
    ----------
    links : int
        Number of links n.
    period : float
        Period T.
    rest_length, amplitude : float, optional
        Mean length l0 and amplitude A of every link.
    lag : float, optional
        Lag of each link, also of link 0, behind the one ahead of it, as a share of the period.

    Returns
    -------
    Gait
        Lengths of n links, one smooth piece.

    Raises
    ------
    ArgumentError
        If `links` is less than 1.

    Examples
    --------
    >>> import numpy as np
    >>> travelling_sine(2, 1.0, 2.0, 0.5, lag=0.25)(np.array([0.0, 0.25, 0.5])).round(12)
    array([[1.5, 2. , 2.5],
           [2. , 1.5, 2. ]])
    """
    if links < 1:
        raise ArgumentError(f"links is {links}; write 1 or more")
    behind = 2 * np.pi * lag * np.arange(1, links + 1)
    return Gait(
        np.array([0.0, period]),
        np.full((1, links, 1), float(rest_length)),
        np.array([2 * np.pi / period]),
        -amplitude * np.sin(behind)[None, :],
        amplitude * np.cos(behind)[None, :],
    )


def block_wave(
    links: int,
    resting: int,
    period: float,
    length: tuple[float, float],
    profile: Profile = "cosine",
    ramp: float = 0.25,
) -> Gait:
    """Make a block-rest wave in n + 1 equal phases; links move between two lengths, a masses rest.

    Speed is (n + 1 - a) (difference of the lengths) / period, 1 ≤ a ≤ n. For "trapezoid",
    `ramp` is the share of a phase in which the rate rises, and falls: 0 (corners) to 0.5.
    """
    # A mass that moves in a phase gains one stroke relative to a resting mass.
    moves = np.array(
        [[i not in rest for i in range(links + 1)] for rest in block_wave_sequence(links, resting)]
    )
    changes = -np.diff(moves.astype(float), axis=1)  # l_j = x_j - x_{j+1}, in strokes per phase
    return _strokes(changes * (length[1] - length[0]), period, length[0], profile, ramp)


def accordion(
    links: int,
    period: float,
    length: tuple[float, float],
    profile: Profile = "cosine",
    ramp: float = 0.25,
) -> Gait:
    """Make the accordion: all links contract while the head rests, then extend as the tail rests.

    Each takes half a period; speed is n (difference of the lengths) / period.
    `length` is (short, long); `profile` and `ramp` are those of `block_wave`.
    """
    changes = np.array([[-1.0] * links, [1.0] * links]) * (length[1] - length[0])
    return _strokes(changes, period, length[0], profile, ramp)


def _strokes(
    changes: np.ndarray,
    period: float,
    shortest: float | np.ndarray,
    profile: Profile,
    ramp: float = 0.0,
) -> Gait:
    """Join equal phases in which link j changes its length by ``changes[phase, j]``."""
    phases, links = changes.shape
    width = period / phases
    after = np.cumsum(changes, axis=0)
    before = after - changes
    base = shortest - np.minimum(before.min(axis=0), after.min(axis=0))
    before = before + base
    if profile == "cosine":
        middle = before + changes / 2
        omega = np.full(phases, np.pi / width)
        edges = np.append(np.arange(phases) * width, period)
        return Gait(edges, middle[:, :, None], omega, -changes / 2, np.zeros((phases, links)))
    rows = _QUINTIC if profile == "quintic" else _trapezoid(ramp)
    breaks = [0.0]
    pieces = []
    for q in range(phases):
        for stop, shape in rows:
            powers = np.arange(len(shape))
            piece = changes[q][:, None] * shape * width ** -powers.astype(float)
            piece[:, 0] += before[q]
            pieces.append(piece)
            breaks.append((q + stop) * width)
    breaks[-1] = period
    return Gait(np.array(breaks), np.array(pieces))


Row = tuple[float, np.ndarray]

# Shape of a unit stroke in a unit time: rows (stop, coefficients in the time since the last stop).
_QUINTIC: list[Row] = [(1.0, np.array([0.0, 0.0, 0.0, 10.0, -15.0, 6.0]))]


def _trapezoid(ramp: float) -> list[Row]:
    """Rate profile that rises linearly, stays constant, falls linearly; ramp 0 gives corners."""
    if ramp == 0.0:
        return [(1.0, np.array([0.0, 1.0]))]
    top = 1.0 / (1.0 - ramp)
    bend, done = top / (2 * ramp), top * ramp / 2
    cruise = [(1 - ramp, np.array([done, top, 0.0]))] if ramp < 0.5 else []
    return [(ramp, np.array([0.0, 0.0, bend])), *cruise, (1.0, np.array([1 - done, top, -bend]))]


def gait_of_result(result: Result, point: int | None = None) -> Gait:
    """Read the gait of a Result, or of a point of a front; ArgumentError if there is none."""
    if point is not None:
        return _gait_of_point(result, point)
    if "gait_polynomial" not in result:
        raise ArgumentError(f"the result of scene {result.scene!r} contains no gait")
    known = {name: result[name].values for name in GAIT if name in result}
    return Gait(**{name.removeprefix("gait_"): values for name, values in known.items()})


def _gait_of_point(result: Result, point: int) -> Gait:
    if "front_gait_polynomial" not in result:
        raise ArgumentError(f"the result of scene {result.scene!r} contains no front; omit point")
    breaks, pieces = (result[f"front_gait_{name}"].values for name in ("breaks", "polynomial"))
    if point not in range(len(breaks)):
        where = f"the front of scene {result.scene!r}"
        raise UnknownNameError(where, "point", [point], map(str, range(len(breaks))))
    own = breaks[point][np.isfinite(breaks[point])]
    return Gait(own, pieces[point][: len(own) - 1])


def load_gait(
    path: str | Path, point: int | None = None, units: Literal["dimensionless", "SI"] | None = None
) -> Gait:
    """Load a gait from a table (t, l_0, l_1, ...) or from a saved Result.

    Parameters
    ----------
    path : str or Path
        A text file (``.csv``, ``.txt``, ``.tsv``, ``.dat``), a ``result.nc``, or a result's folder.
    point : int, optional
        Point of a front (kind ``gait-pareto``), numbered from 0, the slowest; by default its knee.
    units : {"dimensionless", "SI"}, optional
        Units of the returned gait: lengths in m and times in s, or no units. By default, a table
        is converted to SI, and a result keeps its units.

    Returns
    -------
    Gait
        Link lengths over one closed period.

    Raises
    ------
    OSError
        If the file cannot be read.
    ArgumentError
        If it contains no gait, has no such point, or has other units.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import wormopt as wo
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "gait.csv"
    ...     wo.fast_gait(1.0).to_csv(path)
    ...     gait = wo.load_gait(path, units="dimensionless")
    >>> gait.links, gait.period
    (2, 1.0)
    """
    path = Path(path)
    if path.suffix.lower() in SUFFIXES:
        if point is not None:
            raise ArgumentError("point is given, but a gait table contains one gait; omit point")
        return Gait.from_csv(path, units=units or "SI")
    result = Result.load(path)
    gait = gait_of_result(result, point)
    unit = result["gait_polynomial"].unit if "gait_polynomial" in result else "1"
    if units == "SI" and unit not in ("1", "m"):
        raise ArgumentError(f"the gait is in {unit}, not in m; name a result with link lengths")
    if units == "dimensionless" and unit != "1":
        what = f'the gait is in {unit}, but units are dimensionless; write units = "SI"'
        raise ArgumentError(f"{what}, or write a table without units")
    return gait


def gait_of_shape(
    shape: Shape, scene: Scene[Any], key: str = "gait", links: int | None = None
) -> Gait:
    """Make the gait that a scene names; `key` is the key path of the shape.

    Paths are relative to the scene's folder; `links` is their number where the scene has no worm.
    Raises SceneError if the gait's file cannot be used.
    """
    count: int = scene.table.worm.links if links is None else links
    if isinstance(shape, FastShape):
        return fast_gait(shape.period, shape.rest_length, shape.elongation)
    if isinstance(shape, FileShape):
        return _from_file(shape, scene, key, count)
    if isinstance(shape, SineShape):
        return travelling_sine(count, shape.period, shape.rest_length, shape.amplitude, shape.lag)
    length, ramp = (shape.length[0], shape.length[1]), shape.ramp or 0.0
    if isinstance(shape, BlockWaveShape):
        return block_wave(count, shape.resting, shape.period, length, shape.profile, ramp)
    return accordion(count, shape.period, length, shape.profile, ramp)


def _from_file(shape: FileShape, scene: Scene[Any], key: str, links: int) -> Gait:
    path = scene.folder / Path(shape.file)
    try:
        gait = load_gait(path, shape.point, scene.table.units)
    except UnknownNameError as error:
        raise SceneError(scene.name, [(f"{key}.point", f"{shape.file}: {error}")]) from None
    except (OSError, ValueError) as error:
        message = str(error)
        named = message if message.startswith(path.name) else f"{shape.file}: {message}"
        raise SceneError(scene.name, [(f"{key}.file", named)]) from None
    if gait.links != links:
        message = (
            f"the file has {gait.links} links, the worm {links}; set worm.links = {gait.links}"
        )
        if scene.table.worm is None:
            message = f"the file has {gait.links} links, the output {links} entries; name another"
        raise SceneError(scene.name, [(f"{key}.file", message)])
    return gait if shape.period is None else gait.with_period(shape.period)
