"""Scenes of kind "fit": numbers of a worm found from recordings of its motion."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta, field

from wormopt.errors import Fault, SceneError
from wormopt.files import is_there
from wormopt.scene.numerics import Contacts, ExactContact
from wormopt.scene.scene import packaged_folder
from wormopt.scene.types import Positive, SceneTable, Table, Title, says
from wormopt.systems.recorded.columns import Columns, read_columns
from wormopt.systems.recorded.scenes.tables import (
    FOUND,
    FiniteOrList,
    Level,
    SceneTables,
    SearchTable,
    Span,
    UnknownTable,
    named_twice,
    near,
    scene_of,
)
from wormopt.units import scale

_ENTRY = re.compile(r"([A-Za-z][A-Za-z0-9_]*?)(?:\[(\d+)\])?")
Draws = Annotated[int, Meta(ge=100, le=100_000, description="a whole number, 100 to 100000")]
Names = Annotated[
    str | tuple[str, ...],
    Meta(description="the name of a signal, or a list of them"),
]


class RecordingTable(Table, frozen=True, kw_only=True):
    """One run of the worm, as a file tells it: columns over time.

    Text files have a line with the names of columns, with units if wanted, `x0 [mm]`; what is
    above the line with the column of times is skipped. Separators, decimal commas and the encoding
    are recognised. Empty cells and `#N/A` are gaps. NetCDF-3 files, `result.nc` of a scene say,
    have a dimension `time`.
    """

    file: Annotated[
        str,
        says("", "CSV or NetCDF-3, relative to the scene's folder, or one that comes with wormopt"),
    ]
    name: Annotated[Title, says("", "what results call the run; its file's if left out")] = ""
    use: Annotated[
        Literal["fit", "predict"],
        says("", "`predict`: kept aside, and predicted by the fit to the others"),
    ] = "fit"
    time: Annotated[str, says("", "column of the times")] = "time"
    columns: Annotated[
        dict[str, str],
        says(
            "",
            'signals of columns, `{x0 = "position[0]"}`; columns called as signals need none, and '
            "others are left out. States and outputs are what is fitted; inputs and parameters "
            "move the model as they were recorded",
        ),
    ] = field(default_factory=dict)
    units: Annotated[
        dict[str, str],
        says(
            "",
            'units of columns, `{x0 = "mm"}`, where the line of names does not tell them, or how '
            'much a frame or a pixel is: `{frame = "20 ms", x0 = "-0.21 mm"}`, negative where an '
            "axis points back",
        ),
    ] = field(default_factory=dict)
    unwrap: Annotated[
        tuple[str, ...],
        says("", "columns, or signals, that are angles recorded modulo a turn: turns are added"),
    ] = ()
    window: Annotated[
        Span | None,
        says("", "the part that is used, [first, last], in the file's times; all if left out"),
    ] = None
    start: Annotated[
        dict[str, FiniteOrList],
        says("", "states at the first time, where known and not those of `[model]`"),
    ] = field(default_factory=dict)
    parameters: Annotated[
        dict[str, FiniteOrList],
        says("", "parameters and inputs of this run, where they are not those of `[model]`"),
    ] = field(default_factory=dict)
    between: Annotated[
        Literal["linear", "held"],
        says("", "recorded inputs between their readings: on a line, or held until the next"),
    ] = "linear"

    @property
    def label(self) -> str:
        """Name of the run."""
        return self.name or Path(self.file).stem

    def path(self, folder: Path) -> Path:
        """Where the file is: beside the scene, or among the packaged ones."""
        beside, packaged = folder / self.file, packaged_folder() / self.file
        return packaged if is_there(packaged) and not is_there(beside) else beside

    def faults(self, folder: Path, units: str, key: str) -> Iterator[Fault]:
        """Yield what is wrong with this table, at `key`, or with its file."""
        if self.window and not self.window[0] < self.window[1]:
            yield f"{key}.window", "is empty; write the earlier time first"
        for column, unit in self.units.items():
            yield from _faults_of_unit(f"{key}.units.{column}", unit, units)
        for column, signal in self.columns.items():
            if not _ENTRY.fullmatch(signal):
                yield f"{key}.columns.{column}", f'"{signal}" is no signal; "position[0]" say'
        found: list[Fault] = []
        columns = self.read(folder, found, key)
        yield from found
        if columns is not None:
            yield from self._faults_of_columns(columns, units, key)

    def read(self, folder: Path, faults: list[Fault], key: str) -> Columns | None:
        """Read the file if it is CSV; adds what is wrong to `faults`, and gives None then."""
        path = self.path(folder)
        if not is_there(path):
            beside = sorted(p.name for p in path.parent.glob(f"*{path.suffix}"))
            hint = near(path.name, beside) if beside else "write where it lies"
            faults.append((f"{key}.file", f'there is no file "{self.file}" in {folder}; {hint}'))
            return None
        if path.suffix.lower() == ".nc":
            return None
        return read_columns(path, self.time, faults, f"{key}.file")

    def _faults_of_columns(self, columns: Columns, units: str, key: str) -> Iterator[Fault]:
        for name in ("columns", "units"):
            for column in getattr(self, name):
                if column not in columns.values and column != self.time:
                    what = f"the file has no column {column}; {near(column, columns.values)}"
                    yield f"{key}.{name}.{column}", what
        signals = {*self.columns.values(), *columns.values}
        known = signals | {entry_of(signal)[0] for signal in signals}
        for name in self.unwrap:
            if name not in known:
                what = f"the file has no column {name}; {near(name, columns.values)}"
                yield f"{key}.unwrap", what
        for column in columns.texts & self.columns.keys():
            yield f"{key}.columns.{column}", "the column holds text, no numbers; leave it out"
        for column, unit in columns.units.items():
            named = column or self.time
            if named not in self.units and (column == "" or named in self.columns):
                where = f"{key}.file"
                for _, what in _faults_of_unit("", unit, units):
                    yield where, f"{Path(self.file).name}, column {named}: {what}"
        if self.window:
            first, last = self.window
            inside = sum(first <= t <= last for t in columns.time)
            if inside < 2:
                ends = f"from {columns.time[0]:g} to {columns.time[-1]:g}"
                yield f"{key}.window", f"holds {inside} of the file's instants, which are {ends}"


def _faults_of_unit(key: str, unit: str, units: str) -> Iterator[Fault]:
    if not unit or unit == "1":
        return
    if units != "SI":
        yield key, f'a unit, "{unit}", in a scene without; write units = "SI", or leave it out'
        return
    try:
        scale(unit)
    except ValueError as error:
        yield (
            key,
            f'"{unit}" {error}; write "mm", "m/s", "mN" or the like, or how much is 1: "20 ms"',
        )


class FitUnknown(UnknownTable, frozen=True, kw_only=True):
    """A number of the model that is to be found.

    It is a parameter, an input, or the start of a state, by its name in the Model: every entry of
    its own, or one, `stiffness[0]`.
    """

    targets: Annotated[
        Names | None,
        says("", "signals and entries that all are this one number; its name if left out"),
    ] = None
    per_run: Annotated[
        bool, says("", "whether every run has its own, as starts mostly do; one for all otherwise")
    ] = False


class PosteriorTable(Table, frozen=True, kw_only=True):
    """What numbers are possible, drawn from their posterior distribution by NUTS.

    Needs `pip install 'wormopt[bayes]'`; results get `NAME_posterior`, the interval of the draws.
    """

    draws: Annotated[Draws, says("count", "of each chain, once it has found its steps")] = 1000
    chains: Annotated[
        int, Meta(ge=2, le=16, description="a whole number from 2 to 16"), says("count", "of them")
    ] = 4


class FitScene(SceneTable, frozen=True, kw_only=True):
    """Numbers of a worm, found from recordings of its motion.

    A model out of a scene, `[model]`; one or more `[[recording]]`, a file each; and the numbers
    that are to be found, `[[unknown]]`. The fit is that of least weighted squares, with exact
    contact: guide in [fitting.md](../fitting.md).

    Results hold every number found as a scalar of its name, with its standard error and interval
    (`NAME_error`, `NAME_interval`); arrays over `unknown`, which attribute `unknowns` names; and
    recordings, fits and residuals over time, NaN where nothing was measured.

    The trust report: whether the search converged, and how every start ended (`starts`); what
    numbers cannot be told apart (`not_told_apart`, in words); whether residuals are white and as
    large as their noise (`residuals`); how far runs kept aside are from their prediction
    (`prediction`). Refused, with line and column: text where numbers stand, times that go back or
    are missing, lines of other lengths; and units that are not those of their signals.

    Exit code 3: the search did not converge.
    """

    headline: ClassVar = ()
    scalars: ClassVar = {
        "n_readings": ("count", "readings that were fitted"),
        "n_unknowns": ("count", "numbers that were sought"),
        "rank": ("count", "how many of them, or of their combinations, the recordings tell"),
        "cost": ("1", "half the sum of the squares of weighted residuals"),
        "chi2_per_reading": (
            "1",
            "mean square of the residuals over their noise: 1 where noise was estimated",
        ),
        "n_starts": ("count", "starts of the search"),
        "n_agreeing": ("count", "starts that ended at the same numbers"),
        "offset": ("1", "how far from the bottom the search ended, in standard errors"),
        "prediction_coverage": (
            "share",
            "readings of a run kept aside that lie in the 95 % band of its prediction, a list "
            "where there are several runs; 95 % on average over many fits; a single fit may give "
            "more or fewer",
        ),
        "prediction_chi2": (
            "1",
            "mean square of its readings about the prediction, over what it should be: about 1",
        ),
        "profile_threshold": ("1", "rise of χ² at the ends of the intervals"),
    }
    variables: ClassVar = FOUND | {
        "profile_value": ("count", ("unknown", "profile"), "value that a number is held at"),
        "profile_rise": ("count", ("unknown", "profile"), "twice the rise of the cost then"),
        "start_cost": ("count", ("start",), "cost at which each start of the search ended"),
        "start_estimate": ("count", ("start", "unknown"), "numbers at which it ended"),
    }

    kind: Literal["fit"]
    want: Annotated[
        tuple[
            Literal["recordings", "parameters", "correlation", "profiles", "prediction"],
            ...,
        ],
        says(
            "",
            "`recordings`: data, fit and residuals; `parameters`: numbers with their intervals; "
            "`correlation`, of their errors; `profiles`, where `profiles = true`; `prediction` of "
            "the runs kept aside",
        ),
    ] = ()
    model: SceneTables
    which: Annotated[
        str, says("", "which model, by its label, where the scene in `[model]` has several")
    ] = ""
    recording: Annotated[tuple[RecordingTable, ...], says("", "runs of the worm")]
    unknown: Annotated[tuple[FitUnknown, ...], says("", "numbers to be found")]
    noise: Annotated[
        dict[str, Positive],
        says(
            "",
            "standard deviations of readings by signal, `{position = 0.001}`, where they are "
            "known; estimated of the others",
        ),
    ] = field(default_factory=dict)
    loss: Annotated[
        Literal["linear", "soft_l1", "huber", "cauchy"],
        says("", "`linear`: least squares; the others bear with outliers"),
    ] = "linear"
    contact: Contacts = field(default_factory=ExactContact)
    search: Annotated[SearchTable, says("", "the search")] = field(default_factory=SearchTable)
    level: Annotated[Level, says("share", "confidence of the intervals")] = 0.95
    profiles: Annotated[
        bool,
        says("", "whether intervals are found by fits with each number held, not by curvature"),
    ] = False
    posterior: Annotated[PosteriorTable | None, says("", "a sample of the posterior")] = None

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows, and the files; `folder` is the scene's."""
        yield from super().faults(folder)
        for key in ("recording", "unknown"):
            if not getattr(self, key):
                yield key, f"there is none; write a table [[{key}]]"
        for k, unknown in enumerate(self.unknown):
            yield from unknown.faults(f"unknown[{k}]")
        yield from named_twice((unknown.name for unknown in self.unknown), "unknown")
        try:
            scene_of(self.model, folder, self.units)
        except SceneError as error:
            yield from error.faults
        for k, recording in enumerate(self.recording):
            yield from recording.faults(folder, self.units, f"recording[{k}]")
        yield from named_twice((one.label for one in self.recording), "recording")
        yield from self._faults_of_wants()

    def _faults_of_wants(self) -> Iterator[Fault]:
        uses = [recording.use for recording in self.recording]
        if uses and "fit" not in uses:
            yield "recording", 'all are kept aside; write use = "fit" for at least one'
        if "prediction" in self.want and "predict" not in uses:
            yield "want", '"prediction" shows runs kept aside; write use = "predict" for one'
        if "profiles" in self.want and not self.profiles:
            yield "want", '"profiles" shows what profiles = true computes; write that, too'


def entry_of(signal: str) -> tuple[str, int | None]:
    """Name and entry of a signal, "position[0]" say; None where all entries are meant."""
    found = _ENTRY.fullmatch(signal)
    if found is None:
        return signal, None
    return found[1], None if found[2] is None else int(found[2])


def plain_numbers(table: Mapping[str, FiniteOrList]) -> dict[str, list[float]]:
    """Lists of numbers for all values of a table."""
    return {k: list(v) if isinstance(v, tuple) else [v] for k, v in table.items()}
