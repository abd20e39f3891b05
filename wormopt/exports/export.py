"""The verb `export`: writes results for other tools."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from wormopt.errors import ArgumentError
from wormopt.exports.common import identifier, target
from wormopt.files import write_files
from wormopt.quantities import has_unit, to_number

if TYPE_CHECKING:
    from wormopt.model.gait import Gait
    from wormopt.model.model import Model
    from wormopt.result import Result

Format = Literal[
    "csv", "parquet", "mat", "hdf5", "c", "arduino", "ros", "fmu", "fmu2", "mjcf", "urdf"
]
SUFFIXES: dict[str, str] = {
    "csv": ".csv",
    "parquet": ".parquet",
    "mat": ".mat",
    "hdf5": ".h5",
    "c": ".c",
    "arduino": ".ino",
    "ros": ".yaml",
    "fmu": ".fmu",
    "fmu2": ".fmu",
    "mjcf": ".xml",
    "urdf": ".urdf",
}
# Formats that an option changes.
_CHANGED_BY: dict[str, tuple[Format, ...]] = {
    "step": ("csv", "parquet", "ros", "mjcf", "urdf"),
    "columns": ("csv", "parquet"),
    "whole_steps": ("csv", "parquet", "c", "arduino", "ros"),
    "cycles": ("ros",),
    "rest": ("ros",),
}


def export(
    what: Result | Gait | Model,
    formats: Format | Sequence[Format],
    path: str | Path | None = None,
    *,
    step: float | str | None = None,
    cycles: int = 1,
    columns: Sequence[str] = (),
    whole_steps: bool = False,
    rest: bool = False,
    force: bool = False,
) -> tuple[Path, ...]:
    """Export a result, gait or model to other tools; all files are written, or none.

    Parameters
    ----------
    what : Result, Gait or Model
        A Result can be written in all formats for which it has the data; a Gait to "c", "arduino"
        and "ros", a Model to "fmu" and "fmu2".
    formats : {"csv", "parquet", "mat", "hdf5", "c", "arduino", "ros", "fmu", "fmu2", "mjcf", \
            "urdf"}, or several of them
        Tables as CSV or Parquet; the whole result for MATLAB or as HDF5; C99 source of the gait;
        an Arduino sketch that plays the gait on servos, in a folder of its name; the gait as a ROS
        message trajectory_msgs/JointTrajectory in YAML; a unit of the model for FMI 3.0 or 2.0,
        its friction smooth; the worm for physics engines, as MJCF with keyframes of the gait or as
        URDF with a table of its joints.
    path : str or path, optional
        A folder, or, for one format, a file with its suffix (.csv, .parquet, .mat, .h5, .c, .ino,
        .yaml, .fmu, .xml, .urdf). By default files are named by the scene, in the current folder.
    step : float or str, optional
        Time between rows of a table, by default those of the result, and between points of
        a ROS trajectory, by default 0.01; or "10 ms" where a result has units. Largest time step
        of MJCF, by default 0.001, and between rows of the table beside URDF, by default 0.01:
        both divide the cycle.
    cycles : int, optional
        Cycles of the gait in a ROS trajectory.
    columns : sequence of str, optional
        Signals in tables, for example "length" or "length_0", besides time; all by default.
    whole_steps : bool, optional
        Whether the gait is slowed down so that a cycle is a whole number of steps. A table
        then holds one closed cycle of the gait: lengths, rates and accelerations.
    rest : bool, optional
        Whether a ROS trajectory begins and ends at rest: time runs slower in the first and the
        last half cycle.
    force : bool, optional
        Whether earlier exports of wormopt with the same names are replaced; other files never are.

    Returns
    -------
    tuple of Path
        The files.

    Raises
    ------
    ArgumentError
        If a format does not support `what`, a value is not allowed, an option applies to none of
        the formats, a package is missing (extras ``parquet`` and ``hdf5``), or an FMU cannot be
        compiled.
    SceneError
        If the model of a result cannot be built again.
    OutputError
        If a file exists already or cannot be written.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> from wormopt.runner import run
    >>> result = run("fast_gait")
    >>> with TemporaryDirectory() as folder:
    ...     files = export(result, ["csv", "c"], folder)
    ...     [file.name for file in files]
    ['fast_gait.csv', 'fast_gait.h', 'fast_gait.c', 'fast_gait_replay.c']
    """
    wanted = [formats] if isinstance(formats, str) else [*dict.fromkeys(formats)]
    unknown = [name for name in wanted if name not in SUFFIXES]
    if unknown or not wanted:
        raise ArgumentError(f"formats are {', '.join(SUFFIXES)}, not {unknown or 'none'}")
    if {"fmu", "fmu2"} <= {*wanted}:
        raise ArgumentError("fmu and fmu2 write files of the same name; export one after another")
    name = getattr(what, "scene", None) or getattr(what, "name", None) or "gait"
    folder, stem = target(path, name, [SUFFIXES[each] for each in wanted])
    at = _number(step, what) if isinstance(step, str) else step
    if whole_steps and at is None:
        raise ArgumentError("whole_steps needs a step; write for example step=0.01 (--step 0.01)")
    given = {"columns": columns, "cycles": cycles != 1, "rest": rest, "whole_steps": whole_steps}
    given["step"] = at is not None and not whole_steps
    for option in (name for name, is_given in given.items() if is_given):
        if not {*_CHANGED_BY[option]} & {*wanted}:
            changed = ", ".join(_CHANGED_BY[option])
            raise ArgumentError(
                f"{option} has no effect on {', '.join(wanted)}, only on {changed}; leave it out"
            )
    asked = _Asked(at, cycles, tuple(columns), whole_steps, rest)
    files: dict[str, bytes] = {}
    for each in wanted:
        files |= _made(what, each, stem, asked)
    if wanted == ["arduino"] and folder.name == identifier(stem):
        folder = folder.parent  # the sketch's own folder was named
    placed = {folder / name: content for name, content in files.items()}
    write_files(placed, force=force)
    return tuple(placed)


@dataclass(frozen=True)
class _Asked:
    """Options of formats."""

    step: float | None
    cycles: int
    columns: tuple[str, ...]
    whole_steps: bool
    rest: bool


def _number(step: str, what: object) -> float:
    """A time as typed, in the units of a result."""
    units = json.loads(getattr(what, "scene_text", "") or "{}").get("units", "dimensionless")
    try:
        return to_number(step, "time", units) if has_unit(step) else float(step)
    except ValueError as error:
        why = error if has_unit(step) else "is not a time; write for example 0.01"
        raise ArgumentError(f"step: {step!r} {why}") from None


def _made(what: Result | Gait | Model, into: str, stem: str, asked: _Asked) -> dict[str, bytes]:
    """Contents of the files of one format; each imports only its own needs."""
    from wormopt.model.gait import Gait
    from wormopt.result import Result

    if into in ("fmu", "fmu2"):
        from wormopt.exports.fmu import make, plants_of

        return make(plants_of(what), stem, 3 if into == "fmu" else 2)
    if into in ("mjcf", "urdf"):
        from wormopt.exports import mjcf, urdf
        from wormopt.exports.robot import robot_of

        robot = robot_of(what)
        if into == "mjcf":
            return mjcf.make(robot, stem, 0.001 if asked.step is None else asked.step)
        return urdf.make(robot, stem, 0.01 if asked.step is None else asked.step)
    if into in ("c", "arduino", "ros"):
        from wormopt.exports import arduino, c_source, ros
        from wormopt.exports.common import ExportedGait

        if not isinstance(what, Result | Gait):
            raise ArgumentError(f"{into} takes a Result or a Gait, not {type(what).__name__}")
        exported = ExportedGait.of(what) if isinstance(what, Result) else ExportedGait(what)
        if asked.whole_steps and asked.step is not None:
            exported = exported.in_whole_steps(asked.step)
        if into != "ros":
            return (c_source if into == "c" else arduino).make(exported, stem)
        step = 0.01 if asked.step is None else asked.step
        return ros.make(exported, stem, step, asked.cycles, rest=asked.rest)
    if not isinstance(what, Result):
        raise ArgumentError(f"{into} takes a Result, not {type(what).__name__}")
    from wormopt.exports import csv_tables, hdf5, matlab, parquet

    if into in ("mat", "hdf5"):
        return (matlab if into == "mat" else hdf5).make(what, stem)
    make = (csv_tables if into == "csv" else parquet).make
    return make(what, stem, asked.step, asked.columns, whole_steps=asked.whole_steps)
