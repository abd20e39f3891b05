"""The verb `sweep`: a scene computed at many values of some of its keys."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from wormopt.errors import Interrupted
from wormopt.numerics.workers import Engine, using
from wormopt.progress import Report, silent
from wormopt.result import Result
from wormopt.sweeps.axes import plan
from wormopt.sweeps.store import Keep

# Seconds between looks at points that another process has in hand.
_PATIENCE = 1.0


def sweep(
    source: str | Path,
    over: Mapping[str, Any] | None = None,
    *,
    method: str | None = None,
    points: int | None = None,
    seed: int | None = None,
    overrides: Iterable[str] = (),
    store: str | Path | None = None,
    keep: Keep = "results",
    engine: Engine | None = None,
    report: Report = silent,
) -> Result:
    """Compute a scene at many values of some of its keys.

    Parameters
    ----------
    source : str or path
        The scene, as for `load_scene`.
    over : mapping of str to list or str, optional
        Dotted key -> values, or a range: "1:10:10" is ten values from 1 to 10, "1:100:5:log"
        five whose logarithms are equidistant, "1:10" one from which values are drawn. The scene's
        own table ``[sweep]`` if left out.
    method : {"grid", "zip", "latin-hypercube", "sobol"}, optional
        Every combination, first with first, or drawn.
    points, seed : int, optional
        How many are drawn, and the seed of their generator.
    overrides : iterable of str
        Changes of the scene that all points share, as for `load_scene`.
    store : path, optional
        Folder where the result of every point is kept under a name made of what it hangs on: what
        is there is not computed again, by whatever sweep or machine. Without one nothing is kept.
    keep : {"results", "scalars"}
        What is kept of a point: all, or no arrays.
    engine : Engine, optional
        Where points are computed.
    report : callable
        Is told how far the sweep is, see `wormopt.progress`.

    Returns
    -------
    Result
        Of kind "sweep": every number of the points over the swept keys, with `status`: 0 done,
        1 failed (no solution, say; `attributes["reasons"]` tells), 2 refused as a scene, 3 not
        computed.

    Raises
    ------
    SceneError
        If the scene, or every point, is wrong.
    Interrupted
        If the user stopped it; with the points so far.

    Examples
    --------
    >>> found = sweep("fast_gait", {"worm.load": [1, 2, 3]}, engine=Engine("serial"))
    >>> found["worm_load"].values.tolist(), found["speed"].values.round(9).tolist()
    ([1.0, 2.0, 3.0], [1.2, 1.2, 1.2])
    """
    base, wanted = _asked(source, over, method, points, seed, list(overrides))
    with _folder(store) as folder, using(engine or Engine()):
        found = _Sweep(base, wanted, plan(base.sweep), folder, keep)  # pyright: ignore
        try:
            found.run(report)
        except KeyboardInterrupt:
            raise Interrupted(found.result(interrupted=True, kept=store is not None)) from None
        return found.result(kept=store is not None)
