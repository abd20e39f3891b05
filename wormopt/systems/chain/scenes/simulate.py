"""Scenes of kind "simulate": a chain with given inputs, or a model of the user's own."""

from __future__ import annotations

import ast
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from msgspec import Meta, field

from wormopt.errors import Fault
from wormopt.scene.numerics import (
    Contacts,
    ExactContact,
    Horizon,
    Start,
    Tolerances,
    ToleranceTable,
)
from wormopt.scene.types import (
    Finite,
    FinitePerLink,
    NonNegativePerLink,
    Positive,
    SceneTable,
    Table,
    says,
    wrong_count,
)
from wormopt.systems.chain.scenes.chain import ChainTable
from wormopt.systems.shared.declared import CHAIN, CHAIN_SIGNALS, EVENTS, TIME, over
from wormopt.systems.spiked import Shape, why_unreadable


class ConstantForce(Table, frozen=True, kw_only=True, tag_field="law", tag="constant"):
    """Inputs *u*<sub>j</sub> = `force` that do not change."""

    force: Annotated[
        FinitePerLink, says("force", "positive forces push the masses of the link apart")
    ]

    def faults(self, links: int, folder: Path) -> Iterator[Fault]:
        """Yield what does not fit a worm of so many links; `folder` is the scene's."""
        yield from wrong_count("actuation.force", self.force, links, "links")


class HarmonicChange(Table, frozen=True, kw_only=True, tag_field="law", tag="harmonic"):
    """Commanded change of rest length (11): a sine.

    *u*<sub>j</sub> = *c*<sub>j</sub> `amplitude` sin(2π(*t*/`period` − (*j* + 1) `lag`)).
    """

    amplitude: Annotated[NonNegativePerLink, says("length", "amplitude")]
    period: Annotated[Positive, says("time", "period")]
    lag: Annotated[
        Finite,
        says(
            "share",
            "by how much of a period each link is behind the one ahead of it; link 0 itself lags "
            "by as much",
        ),
    ] = 0.0

    def faults(self, links: int, folder: Path) -> Iterator[Fault]:
        """Yield what does not fit a worm of so many links; `folder` is the scene's."""
        yield from wrong_count("actuation.amplitude", self.amplitude, links, "links")


class CommandedGait(Table, frozen=True, kw_only=True, tag_field="law", tag="gait"):
    """Rest lengths are commanded to follow a gait (11).

    *u*<sub>j</sub> = *c*<sub>j</sub>(gait − `rest_length`).
    """

    gait: Annotated[Shape, says("", "a gait; `shape` decides which other keys there are")]
    shift: Annotated[
        Finite, says("time", "the command at time *t* is the gait at *t* + `shift`")
    ] = 0.0

    def faults(self, links: int, folder: Path) -> Iterator[Fault]:
        """Yield what does not fit a worm of so many links; `folder` is the scene's."""
        yield from self.gait.faults(links, folder, "actuation.gait")


Actuation = ConstantForce | HarmonicChange | CommandedGait

_MODEL = r"^[^\x00-\x1f]+\.py:[A-Za-z_][A-Za-z0-9_]*$"


class SimulateScene(SceneTable, frozen=True, kw_only=True):
    """A motion in time: of a chain with given inputs, or of a model of the user's own.

    Scenes have `[worm]`, and if wanted `[start]` and `[actuation]`, or a `model`. Example of a
    model of your own: `problems/own_model.toml` with `problems/my_worm.py`; how to write one:
    [simulation.md](../simulation.md#a-model-of-your-own). The file is run by `wormopt run` of that
    scene and by nothing else: `check` reads it without running it, and nothing is ever run from a
    saved result. What it prints goes to stderr. Everything named in the Model, states and outputs,
    is in the result: `<name>` over time, or over `<name>_entry` and time, and the scalar
    `<name>_end`.

    Refused, with the line where there is one: a file that cannot be read or is no Python, fails,
    or has no such function; parameters that the function does not take or lacks; anything but a
    Model; names that are no names, or that the result needs itself; symbols the Model does not
    know; units that are misspelt quantities. Where the function fails with what `[parameters]`
    gives, or a value is beyond the bounds of the Model's parameter, the message names that key.

    `contact_force` at rest is what holds the mass. `event_kind` counts from 0: reversal, stick,
    release, impact, switch; rests are known for exact contact only. Attributes: `contacts`, their
    names, and `signals`, what the picture shows. `timings_s`: `build`, `simulate` and `recheck`.
    What the trust report says: [simulations](../scenes.md#the-trust-report-of-a-simulation).
    """

    headline: ClassVar = ("distance", "mean_speed", "input_rms", "input_peak", "x_end", "v_end")
    scalars: ClassVar = CHAIN
    variables: ClassVar = (
        TIME
        | over(CHAIN_SIGNALS)
        | {"command": ("length", ("link", "time"), "commanded rest length")}
        | EVENTS
    )

    kind: Literal["simulate"]
    want: Annotated[
        tuple[Literal["motion", "signals"], ...],
        says("", "`signals`: signals below each other; `motion`, of a chain: paths, time upward"),
    ] = ()
    worm: Annotated[ChainTable | None, says("", "a chain")] = None
    start: Annotated[
        Start | None, says("", "where the chain starts; at rest length if left out")
    ] = None
    actuation: Annotated[
        Actuation | None, says("", "inputs *u*<sub>j</sub> of the chain; 0 if left out")
    ] = None
    model: Annotated[
        Annotated[
            str, Meta(pattern=_MODEL, description='"file.py:function", "my_worm.py:build" say')
        ]
        | None,
        says(
            "",
            "a Python file, relative to the scene's folder, and a function in it that returns a "
            "`Model`",
        ),
    ] = None
    parameters: Annotated[
        dict[str, Any] | None,
        says(
            "",
            "arguments of that function by name: text, true, false, finite numbers, lists and "
            "tables of these",
        ),
    ] = None
    contact: Contacts = field(default_factory=ExactContact)
    time: Horizon
    tolerance: Tolerances = field(default_factory=ToleranceTable)

    @property
    def model_file(self) -> str:
        """Name of the file that holds the model."""
        return (self.model or "").rpartition(":")[0]

    @property
    def model_function(self) -> str:
        """Name of the function that returns it."""
        return (self.model or "").rpartition(":")[2]

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows; `folder` is the scene's."""
        yield from super().faults(folder)
        if self.worm is not None and self.model is not None:
            yield "model", "a scene has [worm] or a model, not both; leave one out"
        elif self.worm is not None:
            yield from self._faults_of_chain(self.worm, folder)
        elif self.model is not None:
            yield from self._faults_of_model(folder)
        else:
            yield "worm", 'missing; write [worm], or a model: model = "my_worm.py:build"'

    def _faults_of_chain(self, worm: ChainTable, folder: Path) -> Iterator[Fault]:
        yield from worm.faults(self.time.end, self.units)
        if self.parameters is not None:
            yield "parameters", "are those of a model; a worm has its own keys in [worm]"
        if self.start is not None:
            yield from self.start.faults(worm.links)
        if self.actuation is not None:
            yield from self.actuation.faults(worm.links, folder)

    def _faults_of_model(self, folder: Path) -> Iterator[Fault]:
        for key in ("start", "actuation"):
            if getattr(self, key) is not None:
                yield key, f"belongs to [worm]; a model says by itself what its {key} is"
        if "motion" in self.want:
            yield "want", '"motion" shows a chain; write "signals" for a model'
        for name, value in (self.parameters or {}).items():
            if not _is_plain(value):
                yield f"parameters.{name}", "write text, true, false, a finite number, or lists"
        yield from _faults_of_file(folder / self.model_file, self.model_file)


def _faults_of_file(path: Path, shown: str) -> Iterator[Fault]:
    """Read the file, but do not run it: that is for `wormopt run` alone."""
    unreadable = why_unreadable(path)
    if unreadable:
        yield "model", f'"{shown}" cannot be read from {path.parent}: {unreadable}'
        return
    try:
        ast.parse(path.read_bytes(), shown)
    except SyntaxError as error:
        yield "model", f"{shown} line {error.lineno}: {error.msg}; write valid Python"
    except (ValueError, RecursionError, MemoryError) as error:
        yield "model", f"{shown} is no Python: {error}"


def _is_plain(value: object) -> bool:
    """Whether a value means the same in TOML, JSON and Python."""
    if isinstance(value, list):
        return all(_is_plain(item) for item in value)
    if isinstance(value, dict):
        return all(_is_plain(item) for item in value.values())
    if isinstance(value, float):
        return math.isfinite(value)
    return isinstance(value, bool | int | str)
