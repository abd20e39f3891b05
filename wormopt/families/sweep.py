# pyright: strict, reportUnknownVariableType=false, reportUnknownArgumentType=false, reportUnknownMemberType=false
"""The verb `sweep`: a scene computed at many values of some of its keys."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, get_args

import msgspec
import numpy as np

from wormopt.errors import ArgumentError, Fault, Interrupted, SceneError, SolveError
from wormopt.families.axes import Place, Plan, plan
from wormopt.families.gathered import gathered
from wormopt.families.points import Point, faults_of, followed
from wormopt.families.points import points as points_of
from wormopt.families.store import Keep, Store
from wormopt.numerics.workers import Engine, using
from wormopt.progress import Report, silent
from wormopt.result import Result
from wormopt.runner import attempt
from wormopt.study import Scene, Study, load_scene
from wormopt.study.given import read_value
from wormopt.study.swept import Swept
from wormopt.study.toml import Overrides


def sweep(
    source: Scene[Any] | str | Path | Mapping[str, Any],
    over: Mapping[str, Any] | None = None,
    *,
    method: str | None = None,
    points: int | None = None,
    seed: int | None = None,
    overrides: Overrides = (),
    store: str | Path | None = None,
    keep: Keep = "results",
    engine: Engine | None = None,
    report: Report = silent,
) -> Result:
    """Compute a scene at many values of some of its keys.

    Parameters
    ----------
    source : str, path, mapping or Scene
        The scene, as for `load_scene`.
    over : mapping of str to list or str, optional
        Dotted key -> values, or a range: "1:10:10" is ten values from 1 to 10, "1:100:5:log"
        five whose logarithms are equidistant, "1:10" one from which values are drawn. The scene's
        own table ``[sweep]`` if left out.
    method : {"grid", "zip", "latin-hypercube", "sobol"}, optional
        Every combination, first with first, or drawn.
    points, seed : int, optional
        Number of drawn points, and the seed of their generator.
    overrides : str, mapping, or iterable of them
        Changes of the scene for all points, as for `load_scene`.
    store : path, optional
        Folder that keeps the result of every point in a file named by a hash of everything it
        depends on. Sweeps on any machine reuse the stored points. By default nothing is stored.
    keep : {"results", "scalars"}
        Data to store for each point: everything, or scalars without arrays.
    engine : Engine, optional
        Where points are computed; processes of this machine if left out.
    report : callable
        Gets the progress of the sweep, see `wormopt.progress`.

    Returns
    -------
    Result
        Of kind "sweep": every number of the points over the swept keys, with `status`: 0 ok,
        1 failed (no solution, say; `attributes["reasons"]` says why), 2 refused as a scene, 3 not
        computed.

    Raises
    ------
    SceneError
        If the scene, the sweep or every point is wrong.
    Interrupted
        If the user stopped it; with the points so far.

    Examples
    --------
    >>> found = sweep("fast_gait", {"gait.period": [1, 2]}, engine=Engine("serial"))
    >>> found["gait_period"].values.tolist(), found["speed"].values.round(9).tolist()
    ([1.0, 2.0], [1.2, 0.6])
    """
    if keep not in get_args(Keep):
        raise ArgumentError(f"keep is results or scalars, not {keep!r}")
    base = load_scene(source, overrides)
    given = {"over": over, "method": method, "points": points, "seed": seed}
    given = {name: value for name, value in given.items() if value is not None}
    if over is not None or (given and base.sweep is not None):
        own = {} if over is not None else msgspec.to_builtins(base.sweep)
        base = replace(base, sweep=_read(base.name, own | given))
    if base.sweep is None:
        what = 'missing; write for example [sweep] over."worm.load" = "1:10:10", or --over'
        raise SceneError(base.name, [("sweep", what)])
    with _store(store) as folder, using(engine or Engine()):
        kept = Store(Path(folder), keep)
        kept.open()
        return _swept(base, plan(base.sweep), kept, report, in_files=store is not None)


def _swept(
    base: Scene[Any], asked: Plan, store: Store, report: Report, *, in_files: bool
) -> Result:
    studies = [*_studies(base, asked.points, report)]
    valid = [study for study in studies if isinstance(study, Study)]
    if not valid:
        load_scene(base, asked.points[0])  # raises the faults
    stop = None
    try:
        found = points_of(valid, _attempt, store, report)
    except (SolveError, Interrupted) as error:
        found, stop = error.partial, error
    computed = iter(found)
    points = [one if isinstance(one, Point) else next(computed) for one in studies]
    tables = [None if isinstance(one, Point) else one for one in studies]
    result = gathered(base, asked, tables, points, in_files)
    counts = Counter(point.status for point in points)
    if isinstance(stop, SolveError):
        return result.failed(str(stop))
    if stop is not None:
        done = len(points) - counts["not computed"]
        reason = f"interrupted after {done} of {len(points)} points; run it again"
        raise Interrupted(result.failed(reason))
    if not counts["ok"] and not counts["unchecked"]:
        return result.failed("no point has an accepted result")
    if counts["unchecked"]:
        return replace(result, status="unchecked", reason=_unchecked(points))
    return result


def _store(folder: str | Path | None) -> AbstractContextManager[str]:
    # terminated workers may still have a file open, which Windows does not remove
    if folder is None:
        return TemporaryDirectory(ignore_cleanup_errors=True)
    return nullcontext(os.fspath(folder))


def _read(name: str, raw: dict[str, Any]) -> Swept:
    if not isinstance(raw["over"], Mapping):
        raise ArgumentError('over must be a mapping, for example {"worm.load": [1, 2]}')
    raw["over"] = {str(key): _listed(values) for key, values in raw["over"].items()}
    faults: list[Fault] = []
    swept = read_value(raw, Swept, "sweep", "", faults)
    faults += [(f"sweep.{key}", what) for key, what in (swept.faults() if swept else ())]
    if faults:
        raise SceneError(name, faults)
    return swept


def _listed(values: Any) -> Any:
    """Convert arrays, ranges and tuples to lists."""
    if isinstance(values, np.ndarray):
        return values.tolist()
    return list(values) if isinstance(values, tuple | range) else values


def _studies(base: Scene[Any], places: Sequence[Place], report: Report) -> Iterator[Study | Point]:
    """Yield the study at each place, or a refused point."""
    for place in followed(places, report, "prepared"):
        try:
            yield load_scene(replace(base, sweep=None), place).table
        except SceneError as error:
            yield Point("refused", faults_of(error))


def _attempt(study: Study) -> Result:
    return attempt(study.scene)


def _unchecked(points: Sequence[Point]) -> str:
    """Number of unchecked points, and their most frequent reason."""
    reasons = Counter(point.reason for point in points if point.status == "unchecked")
    why, _ = reasons.most_common(1)[0]
    return f"{reasons.total()} of {len(points)} points are unchecked: {why}"
