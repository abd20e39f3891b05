"""The verb `sweep`: a scene computed at many values of some of its keys."""

from __future__ import annotations

import os
import secrets
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeVar, get_args

import msgspec
import numpy as np

from wormopt.errors import ArgumentError, Fault, Interrupted, SceneError, SolveError
from wormopt.numerics.workers import Engine, Workers, using
from wormopt.progress import Report, silent
from wormopt.result import Result
from wormopt.study import Scene, load_scene
from wormopt.study.given import read_value
from wormopt.study.swept import Swept
from wormopt.study.toml import Overrides
from wormopt.sweeps.axes import Plan, plan
from wormopt.sweeps.gathered import gathered
from wormopt.sweeps.store import (
    Job,
    Keep,
    Record,
    code_of,
    compute,
    faults_of,
    key_of,
    open_store,
    read,
)  # fmt: skip

# Seconds between checks of points that another process computes.
_PATIENCE = 1.0
# For fast steps, number of points between reports.
_SELDOM = 1000
T = TypeVar("T")


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
        How many are drawn, and the seed of their generator.
    overrides : str, mapping, or iterable of them
        Changes of the scene that all points share, as for `load_scene`.
    store : path, optional
        Folder where the result of every point is kept under a name made of what it hangs on: what
        is there is not computed again, by whatever sweep or machine. Without one nothing is kept.
    keep : {"results", "scalars"}
        What is kept of a point: all, or no arrays.
    engine : Engine, optional
        Where points are computed; processes of this machine if left out.
    report : callable
        Gets the progress of the sweep, see `wormopt.progress`.

    Returns
    -------
    Result
        Of kind "sweep": every number of the points over the swept keys, with `status`: 0 ok,
        1 failed (no solution, say; `attributes["reasons"]` tells), 2 refused as a scene, 3 not
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
        what = 'missing; write [sweep] over."worm.load" = "1:10:10", say, or --over'
        raise SceneError(base.name, [("sweep", what)])
    with _store(store) as kept_in, using(engine or Engine()):
        open_store(Path(kept_in))
        found = _Sweep(base, plan(base.sweep), Path(kept_in), keep, report)
        try:
            found.compute()
        except KeyboardInterrupt:
            raise Interrupted(found.result(store, interrupted=True)) from None
        except SolveError as error:  # the cluster is gone
            return found.result(store, interrupted=True).failed(str(error))
        return found.result(store)


def _store(folder: str | Path | None) -> AbstractContextManager[str]:
    # terminated workers may still have a file open, which Windows does not remove
    if folder is None:
        return TemporaryDirectory(ignore_cleanup_errors=True)
    return nullcontext(os.fspath(folder))


def _read(name: str, raw: dict[str, Any]) -> Swept:
    if not isinstance(raw["over"], Mapping):
        raise ArgumentError('over is a mapping, {"worm.load": [1, 2]} say')
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


class _Sweep:
    """Points of a sweep with results so far."""

    def __init__(
        self, base: Scene[Any], asked: Plan, store: Path, keep: Keep, report: Report
    ) -> None:
        self._base, self._plan, self._store, self._report = base, asked, store, report
        self._keep: Keep = keep
        self._records: dict[str, Record] = {}  # by key
        self._computed = self._poor = 0  # by this process; without an accepted result
        self._scenes: list[Scene[Any] | Record] = []
        self._keys: list[str] = []
        files: dict[str, bytes] = {}
        for point in self._followed(asked.points, "prepared"):
            scene = self._scene(point)
            self._scenes.append(scene)
            self._keys.append("" if isinstance(scene, Record) else key_of(scene, files))
        if not any(self._keys):
            load_scene(base, asked.points[0])  # raises the faults

    def _followed(self, items: Iterable[T], what: str) -> Iterator[T]:
        """Report progress after every so many points."""
        total = len(self._plan.points)
        for k, item in enumerate(items):
            if k % _SELDOM == 0:
                self._report(f"{k} of {total} points {what}", k / total)
            yield item

    def _scene(self, point: Mapping[str, Any]) -> Scene[Any] | Record:
        try:
            return load_scene(replace(self._base, sweep=None), point)
        except SceneError as error:
            return Record("refused", faults_of(error))

    def compute(self) -> None:
        """Compute missing points, in rounds: another process may be computing a point."""
        todo = self._todo()
        name, code = secrets.token_hex(8), code_of(self._base)
        with Workers() as workers:
            while todo:
                jobs = [Job(scene, self._file(k), self._keep, name, code) for k, scene in todo]
                self._tell()
                for k, record in workers.as_completed(compute, jobs):
                    if record is not None:
                        self._note(todo[k][0], record)
                        self._computed += 1
                    self._tell()
                todo = [(key, scene) for key, scene in todo if key not in self._records]
                if todo:
                    time.sleep(_PATIENCE)

    def _todo(self) -> list[tuple[str, Scene[Any]]]:
        """Points without results, without duplicates."""
        there = {file.name for file in self._store.glob("*.nc")} if self._store.is_dir() else set()
        todo = {}
        for key, scene in self._followed(zip(self._keys, self._scenes, strict=True), "looked up"):
            if isinstance(scene, Record) or key in self._records or key in todo:
                continue
            file = self._file(key)
            known = read(file, self._keep) if file.name in there else None
            if known is None:
                todo[key] = scene
            else:
                self._note(key, known)
        return list(todo.items())

    def _note(self, key: str, record: Record) -> None:
        self._records[key] = record
        self._poor += record.status not in ("ok", "unchecked")

    def _file(self, key: str) -> Path:
        return self._store / f"{key}.nc"

    def _tell(self) -> None:
        done, total = len(self._records), len(self._plan.points)
        poor = f", {self._poor} failed" if self._poor else ""
        self._report(f"{done} of {total} points{poor}", done / total)

    def result(self, store: str | Path | None, interrupted: bool = False) -> Result:
        """Collect all points, also those without results."""
        if interrupted:
            self._todo()  # workers may have stored results without returning them
        records = [
            scene if isinstance(scene, Record) else self._records.get(key, Record("not computed"))
            for key, scene in zip(self._keys, self._scenes, strict=True)
        ]
        files = [f"{key}.nc" if key and store is not None else None for key in self._keys]
        tables = [None if isinstance(scene, Record) else scene.table for scene in self._scenes]
        found = gathered(self._base, self._plan, tables, records, files, self._computed)
        counts = Counter(record.status for record in records)
        if interrupted:
            done = len(records) - counts["not computed"]
            return found.failed(f"interrupted after {done} of {len(records)} points; run it again")
        if not counts["ok"] and not counts["unchecked"]:
            return found.failed("no point has an accepted result")
        if counts["unchecked"]:
            return replace(found, status="unchecked", reason=_unchecked(records))
        return found


def _unchecked(records: Sequence[Record]) -> str:
    """Number of unchecked points, and their most frequent reason."""
    reasons = Counter(record.reason for record in records if record.status == "unchecked")
    why, _ = reasons.most_common(1)[0]
    return f"{reasons.total()} of {len(records)} points are unchecked: {why}"
