"""The verb `run`, from a scene to its Result; and saved results."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

from wormopt.errors import ArgumentError, Interrupted, SolveError, interruptible
from wormopt.files import RESULT_FILE
from wormopt.model.given import names_in
from wormopt.progress import Report, silent
from wormopt.study import Scene, Study, load_scene
from wormopt.study.toml import Overrides

if TYPE_CHECKING:
    from wormopt.result import Result


def run(
    scene: Scene[Any] | Study | str | Path | Mapping[str, Any],
    overrides: Overrides = (),
    report: Report = silent,
    *,
    only: str | Sequence[str] = (),
) -> Result:
    """Compute the results of a scene. Nothing is written.

    Parameters
    ----------
    scene : Scene, study, str, path or mapping
        The scene, or an argument of `load_scene`.
    overrides : str, mapping, or iterable of them
        Changes, as for `load_scene`.
    report : callable
        Called with a message and the fraction done, see `wormopt.progress`.
    only : str or sequence of str, optional
        Names of scalars, variables and checks to compute. Only these and the quantities that they
        depend on are computed.

    Returns
    -------
    Result
        Result with the status "failed" if a check fails, or "unchecked" if no second computation
        confirms it.

    Raises
    ------
    SceneError
        If the scene is wrong.
    ArgumentError
        If results of the scene have none of a name in `only`.
    SolveError
        If the solver did not reach an accepted result.
    Interrupted
        If the user stopped a study that has partial results.

    Examples
    --------
    >>> result = run("fast_gait", {"gait.period": 2})
    >>> round(result.scalars["advance"].value, 9)
    1.2
    """
    if overrides or not isinstance(scene, Scene):
        scene = load_scene(scene, overrides)
    study, start = scene.table, perf_counter()
    only = names_in("only", only)
    with interruptible():
        result = study.only(*only, report=report) if only else study.result(report)
    return dataclasses.replace(
        result, timings_s={**result.timings_s, "study": perf_counter() - start}
    )


def load(
    scene: Scene[Any] | str | Path | Mapping[str, Any], overrides: Overrides = (), **tables: Any
) -> Any:
    """Read a scene as a study, which computes each result when it is first read.

    Keys of the scene are attributes of the study. ``study["speed"]`` is a scalar or variable of
    its results, computed once, with only the results that it depends on. ``study.result()``
    computes all results, as `run` does, and ``study.vary`` returns the study with other keys.

    Parameters
    ----------
    scene : Scene, str, path or mapping
        The scene, or an argument of `load_scene`.
    overrides : str, mapping, or iterable of them
        Changes, as for `load_scene`.
    **tables
        Further changes, by the names of keys.

    Returns
    -------
    Study
        An instance of the class of the scene's kind.

    Raises
    ------
    SceneError
        If the scene is wrong.

    Examples
    --------
    >>> import wormopt as wo
    >>> study = wo.load("fast_gait")
    >>> study.worm.links, round(study["advance"], 9)
    (2, 1.2)
    """
    return load_scene(scene, overrides, **tables).table


_NO_MEMORY = "out of memory; use shorter times or fewer samples"


def attempt(scene: Scene[Any], report: Report = silent, only: Sequence[str] = ()) -> Result:
    """Run a scene; results before a failure are a Result too, with the reason."""
    try:
        return run(scene, report=report, only=only)
    except SolveError as error:
        return _failed(scene, error.partial, str(error))
    except MemoryError:
        return _failed(scene, None, _NO_MEMORY)
    except Interrupted as stop:
        raise Interrupted(_failed(scene, stop.partial)) from None


def _failed(scene: Scene[Any], partial: object, reason: str = "") -> Result:
    from wormopt.result import Result

    # an intermediate motion of a study is no Result of it
    found = partial if isinstance(partial, Result) else scene.table.unfinished(reason)
    known = found.reason if found.status == "failed" else ""
    return found.failed(reason or known or "interrupted")


def result_at(given: str | Path) -> Result:
    """Read a saved result; ArgumentError, with what to write instead, if there is none."""
    path = Path(given)
    why = _missing(path)
    if not why:
        from wormopt.result import Result

        try:
            return Result.load(path)
        except OSError as error:
            why = f"cannot be read: {error.strerror or error}; name another, or run its scene again"
        except ValueError:
            why = "is not a result of wormopt, or is damaged; name another, or run its scene again"
    raise ArgumentError(f"{given}: {why}")


def _missing(path: Path) -> str:
    """Reason why there can be no result; empty if there may be one."""
    try:
        if path.is_dir() and not (path / RESULT_FILE).exists():
            return f"holds no {RESULT_FILE}; name a folder that `wormopt run` wrote"
        if path.exists():
            return ""
    except (OSError, ValueError) as error:
        return f"cannot be read: {getattr(error, 'strerror', error)}; name another"
    usual = Path("results") / path
    if (usual / RESULT_FILE).exists():
        return f"there is no such folder or file; did you mean {usual}?"
    return f"there is no such folder or file; name a folder of results, or its {RESULT_FILE}"
