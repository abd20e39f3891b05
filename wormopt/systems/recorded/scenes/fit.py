"""Scenes of kind "fit": parameters of a worm estimated from recordings of its motion."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta, field

from wormopt.errors import Fault, SceneError
from wormopt.files import is_there
from wormopt.study.given import Given, entry, whole
from wormopt.study.numerics import Contacts, ExactContact
from wormopt.study.scene import packaged_folder
from wormopt.study.types import Positive, SceneTable, Title
from wormopt.systems.recorded.columns import Columns, read_columns
from wormopt.systems.recorded.tables import (
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
Draws = Annotated[int, Meta(ge=100, le=100_000, description="a whole number from 100 to 100000")]
Names = Annotated[
    str | tuple[str, ...],
    Meta(description="the name of a signal, or a list of them"),
]


class RecordingTable(Given):
    """A recording of one run of the worm: a file with columns over time.

    A text file has a line with the names of its columns, optionally with units, `x0 [mm]`. Lines
    above the line that contains the time column are skipped. Separators, decimal commas and the
    encoding are recognised. Empty cells and `#N/A` are gaps. A NetCDF-3 file, for example the
    `result.nc` of a scene, has a dimension `time`.
    """

    file: str = entry(
        "CSV or NetCDF-3 file, relative to the scene's folder, or one packaged with wormopt"
    )
    name: Title = entry("name of the run in results; default: name of the file", default="")
    use: Literal["fit", "predict"] = entry(
        "`fit`: used in the fit; `predict`: held out and predicted by the fit", default="fit"
    )
    time: str = entry("name of the time column", default="time")
    columns: dict[str, str] = entry(
        'signal of each column, `{x0 = "position[0]"}`. Columns named like a signal need no '
        "entry; other columns are ignored. States and outputs are fitted; recorded inputs and "
        "parameters drive the model",
        default=dict,
    )
    units: dict[str, str] = entry(
        'unit of each column, `{x0 = "mm"}`, if the header line gives none, or the size of a '
        'frame or pixel: `{frame = "20 ms", x0 = "-0.21 mm"}`, negative if an axis points '
        "backwards",
        default=dict,
    )
    unwrap: tuple[str, ...] = entry(
        "columns or signals with angles recorded modulo one turn; they are unwrapped", default=()
    )
    window: Span | None = entry(
        "time interval that is used, [first, last], in the file's times; default: all", default=None
    )
    start: dict[str, FiniteOrList] = entry(
        "known initial states that differ from those of `[model]`", default=dict
    )
    parameters: dict[str, FiniteOrList] = entry(
        "parameters and inputs of this run that differ from those of `[model]`", default=dict
    )
    between: Literal["linear", "held"] = entry(
        "recorded inputs between readings: linear, or held until the next reading", default="linear"
    )

    @property
    def label(self) -> str:
        """Name of the run."""
        return self.name or Path(self.file).stem

    def path(self, folder: Path) -> Path:
        """Path of the file, in the scene's folder or among the packaged recordings."""
        beside, packaged = folder / self.file, packaged_folder() / self.file
        return packaged if is_there(packaged) and not is_there(beside) else beside

    def faults(self, folder: Path, units: str, key: str) -> Iterator[Fault]:
        """Yield the faults of this table, at `key`, and of its file."""
        if self.window and not self.window[0] < self.window[1]:
            yield f"{key}.window", "the first time is not before the last; write [first, last]"
        for column, unit in self.units.items():
            yield from _faults_of_unit(f"{key}.units.{column}", unit, units)
        for column, signal in self.columns.items():
            if not _ENTRY.fullmatch(signal):
                yield (
                    f"{key}.columns.{column}",
                    f'"{signal}" is not the name of a signal; write for example "position[0]"',
                )
        found: list[Fault] = []
        columns = self.read(folder, found, key)
        yield from found
        if columns is not None:
            yield from self._faults_of_columns(columns, units, key)

    def read(self, folder: Path, faults: list[Fault], key: str) -> Columns | None:
        """Read a text file, or add its faults to `faults` and return None."""
        path = self.path(folder)
        if not is_there(path):
            beside = sorted(p.name for p in path.parent.glob(f"*{path.suffix}"))
            hint = near(path.name, beside) if beside else "write its path"
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
            yield f"{key}.columns.{column}", "the column contains text, not numbers; remove the key"
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
                yield (
                    f"{key}.window",
                    f"contains {inside} times of the file, but at least 2 are needed; its times "
                    f"are {ends}",
                )


def _faults_of_unit(key: str, unit: str, units: str) -> Iterator[Fault]:
    if not unit or unit == "1":
        return
    if units != "SI":
        yield key, f'"{unit}" is a unit in a scene without; write units = "SI", or remove it'
        return
    try:
        scale(unit)
    except ValueError as error:
        yield (
            key,
            f'"{unit}" {error}; write for example "mm", "m/s" or "mN", or the size of 1: "20 ms"',
        )


class FitUnknown(UnknownTable):
    """A parameter of the model to estimate.

    It is a parameter, an input or the initial value of a state, by its name in the Model. All
    entries are estimated, or a single one, for example `stiffness[0]`.
    """

    targets: Names | None = entry(
        "signals and entries that all equal this parameter; default: its name", default=None
    )
    per_run: bool = entry(
        "true: separate values for each run, as usual for initial states", default=False
    )


class PosteriorTable(Given):
    """Samples of the posterior distribution of the parameters, drawn by NUTS.

    Needs `pip install 'wormopt[bayes]'`. Results contain `NAME_posterior`, the interval of the
    samples.
    """

    draws: int = whole(100, 100000, "samples per chain after adaptation", default=1000)
    chains: int = whole(2, 16, "number of chains", default=4)


class FitScene(SceneTable):
    """Parameters of a worm, estimated from recordings of its motion.

    The scene contains a model from another scene, `[model]`; one or more `[[recording]]`, each a
    file; and the parameters to estimate, `[[unknown]]`. The fit is a weighted least-squares fit
    with exact contact. Guide: [fitting](../fitting.md).

    Results contain the estimate of every parameter as a scalar of its name, with its standard error
    and interval (`NAME_error`, `NAME_interval`). Arrays over `unknown` follow the names in the
    attribute `unknowns`. Recordings, fits and residuals over time are NaN where nothing was
    measured.

    The trust report states whether the search converged and how every start ended (`starts`); which
    parameters cannot be distinguished (`not_told_apart`, in words); whether the residuals are white
    and as large as the noise (`residuals`); and how far held-out runs are from their prediction
    (`prediction`).

    Refused, with line and column: text instead of numbers; times that decrease or are missing;
    lines of different lengths; units that do not fit their signals. Exit code 3: the search did not
    converge.
    """

    headline: ClassVar = ()
    scalars: ClassVar = {
        "n_readings": ("count", "number of fitted readings"),
        "n_unknowns": ("count", "number of estimated parameters"),
        "rank": ("count", "number of parameters, or combinations of them, that are identifiable"),
        "cost": ("1", "half the sum of the squared weighted residuals"),
        "chi2_per_reading": (
            "1",
            "mean square of the residuals relative to the noise: 1 if the noise is estimated",
        ),
        "n_starts": ("count", "number of starts of the search"),
        "n_agreeing": ("count", "number of starts that ended at the same estimates"),
        "offset": ("1", "distance of the end of the search from the minimum, in standard errors"),
        "prediction_coverage": (
            "share",
            "share of readings of a held-out run within the 95 % band of its prediction; a list "
            "if there are several runs. It is 95 % on average over many fits; a single fit may "
            "differ",
        ),
        "prediction_chi2": (
            "1",
            "mean square of readings about the prediction, relative to its expectation: about 1",
        ),
        "profile_threshold": ("1", "rise of χ² at the ends of the intervals"),
    }
    variables: ClassVar = FOUND | {
        "profile_value": ("count", ("unknown", "profile"), "value at which a parameter is held"),
        "profile_rise": ("count", ("unknown", "profile"), "twice the rise of the cost there"),
        "start_cost": ("count", ("start",), "cost at the end of each start of the search"),
        "start_estimate": ("count", ("start", "unknown"), "estimates at the end of each start"),
    }

    kind: Literal["fit"]
    want: tuple[
        Literal["recordings", "parameters", "correlation", "profiles", "prediction"],
        ...,
    ] = entry(
        "`recordings`: data, fit and residuals; `parameters`: estimates with intervals; "
        "`correlation`: of the errors; `profiles`: needs `profiles = true`; `prediction`: "
        "held-out runs",
        default=(),
    )
    model: SceneTables
    which: str = entry("label of the model, if the scene in `[model]` has several", default="")
    recording: tuple[RecordingTable, ...] = entry("recorded runs of the worm")
    unknown: tuple[FitUnknown, ...] = entry("parameters to estimate")
    noise: dict[str, Positive] = entry(
        "known standard deviation of readings of each signal, `{position = 0.001}`; the "
        "others are estimated",
        default=dict,
    )
    loss: Literal["linear", "soft_l1", "huber", "cauchy"] = entry(
        "`linear`: least squares; the others are robust to outliers", default="linear"
    )
    contact: Contacts = field(default_factory=ExactContact)
    search: SearchTable = entry("the search", default=SearchTable)
    level: Level = entry("confidence of the intervals", quantity="share", default=0.95)
    profiles: bool = entry(
        "compute intervals by refits with each parameter held, not from the curvature",
        default=False,
    )
    posterior: PosteriorTable | None = entry("sample the posterior", default=None)

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows, and the files; `folder` is the scene's."""
        yield from super().faults(folder)
        for key in ("recording", "unknown"):
            if not getattr(self, key):
                yield key, f"no entry is given; write a table [[{key}]]"
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
            yield "recording", 'all have use = "predict"; write use = "fit" for at least one'
        if "prediction" in self.want and "predict" not in uses:
            yield (
                "want",
                '"prediction" is given without a held-out run; write use = "predict" for one',
            )
        if "profiles" in self.want and not self.profiles:
            yield "want", '"profiles" is given without profiles = true; write profiles = true'


def entry_of(signal: str) -> tuple[str, int | None]:
    """Split a signal, for example "position[0]", into name and entry; None means all entries."""
    found = _ENTRY.fullmatch(signal)
    if found is None:
        return signal, None
    return found[1], None if found[2] is None else int(found[2])


def plain_numbers(table: Mapping[str, FiniteOrList]) -> dict[str, list[float]]:
    """Convert all values of a table to lists of numbers."""
    return {k: list(v) if isinstance(v, tuple) else [v] for k, v in table.items()}
