"""Tables of scenes of kind "simulate": a chain with given inputs, or a user-defined model."""

from __future__ import annotations

import ast
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from msgspec import Meta, field

from wormopt.errors import Fault
from wormopt.study.given import Given, entry, number, positive, wrong_count
from wormopt.study.numerics import (
    Contacts,
    ExactContact,
    Horizon,
    Start,
    Tolerances,
    ToleranceTable,
)
from wormopt.study.types import FinitePerLink, NonNegativePerLink, SceneTable
from wormopt.systems.chain.tables import ChainTable
from wormopt.systems.shared.declared import CHAIN, CHAIN_SIGNALS, EVENTS, TIME, over
from wormopt.systems.spiked import Shape, why_unreadable


class ConstantForce(Given, tag_field="law", tag="constant"):
    """Constant inputs *u*<sub>j</sub> = `force`."""

    force: FinitePerLink = entry(
        "actuator forces; a positive force pushes the masses of the link apart", quantity="force"
    )

    def faults(self, links: int, folder: Path) -> Iterator[Fault]:
        """Yield conflicts with a worm of this number of links; `folder` is the scene's."""
        yield from wrong_count("actuation.force", self.force, links, "links")


class HarmonicChange(Given, tag_field="law", tag="harmonic"):
    """Sinusoidal commanded change of the rest lengths (eq. 11 of Zimmermann et al. 2007).

    *u*<sub>j</sub> = *c*<sub>j</sub> `amplitude` sin(2π(*t*/`period` − (*j* + 1) `lag`)).
    """

    amplitude: NonNegativePerLink = entry("amplitude", quantity="length")
    period: float = positive("time", "period")
    lag: float = number(
        "share",
        "phase lag of each link behind the link ahead of it, as a fraction of a period; link "
        "0 also has this lag",
        default=0.0,
    )

    def faults(self, links: int, folder: Path) -> Iterator[Fault]:
        """Yield conflicts with a worm of this number of links; `folder` is the scene's."""
        yield from wrong_count("actuation.amplitude", self.amplitude, links, "links")


class CommandedGait(Given, tag_field="law", tag="gait"):
    """Rest lengths that are commanded to follow a gait (eq. 11 of Zimmermann et al. 2007).

    *u*<sub>j</sub> = *c*<sub>j</sub>(gait − `rest_length`).
    """

    gait: Shape = entry("the gait; `shape` selects the other keys")
    shift: float = number(
        "time", "time shift: the command at time *t* is the gait at *t* + `shift`", default=0.0
    )

    def faults(self, links: int, folder: Path) -> Iterator[Fault]:
        """Yield conflicts with a worm of this number of links; `folder` is the scene's."""
        yield from self.gait.faults(links, folder, "actuation.gait")


Actuation = ConstantForce | HarmonicChange | CommandedGait

_MODEL = r"^[^\x00-\x1f]+\.py:[A-Za-z_][A-Za-z0-9_]*$"


class SimulateScene(SceneTable):
    """A motion of a chain with given inputs, or of a user-defined model.

    A scene has `[worm]`, with optional `[start]` and `[actuation]`, or a `model`. Example of a
    user-defined model: `problems/own_model.toml` with `problems/my_worm.py`; instructions:
    [simulation.md](../simulation.md#a-model-of-your-own). Only `wormopt run` of that scene runs the
    file: `check` reads it without running it, and a saved result never runs it. Output that the
    file prints goes to stderr. The result contains every named state and output of the Model:
    `<name>` over time, or `<name>_entry` over entry and time, and the scalar `<name>_end`.

    Errors, with the line where there is one: a file that cannot be read, is not Python, fails, or
    lacks the function; parameters that the function does not take, or that are missing; a return
    value other than a Model; invalid names, and names that the result itself needs; symbols that
    the Model does not contain; misspelt quantities as units. If the function fails because of
    `[parameters]`, or a value is outside the bounds of the Model's parameter, the message names
    that key.

    At rest, `contact_force` is the force that holds the mass. `event_kind` counts from 0: reversal,
    stick, release, impact, switch. Rests are known for exact contact only. Attributes: `contacts`,
    their names, and `signals`, shown in the picture. `timings_s`: `build`, `simulate` and
    `recheck`. Trust report: [simulations](../scenes.md#the-trust-report-of-a-simulation).
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
    want: tuple[Literal["motion", "signals"], ...] = entry(
        "`signals`: signals over time; `motion`, of a chain: paths with time upward", default=()
    )
    worm: ChainTable | None = entry("the chain", default=None)
    start: Start | None = entry("initial state of the chain; default: at rest length", default=None)
    actuation: Actuation | None = entry(
        "inputs *u*<sub>j</sub> of the chain; default: 0", default=None
    )
    model: (
        Annotated[
            str, Meta(pattern=_MODEL, description='"file.py:function", "my_worm.py:build" say')
        ]
        | None
    ) = entry(
        "a Python file, relative to the scene's folder, and a function in it that returns a "
        "`Model`",
        default=None,
    )
    parameters: dict[str, Any] | None = entry(
        "arguments of that function by name: text, true, false, finite numbers, and lists and "
        "tables of these",
        default=None,
    )
    contact: Contacts = field(default_factory=ExactContact)
    time: Horizon
    tolerance: Tolerances = field(default_factory=ToleranceTable)

    @property
    def model_file(self) -> str:
        """Name of the file that defines the model."""
        return (self.model or "").rpartition(":")[0]

    @property
    def model_function(self) -> str:
        """Name of the function that returns the model."""
        return (self.model or "").rpartition(":")[2]

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows; `folder` is the scene's."""
        yield from super().faults(folder)
        if self.worm is not None and self.model is not None:
            yield "model", "both [worm] and model are given; leave one out"
        elif self.worm is not None:
            yield from self._faults_of_chain(self.worm, folder)
        elif self.model is not None:
            yield from self._faults_of_model(folder)
        else:
            yield "worm", 'missing; write [worm], or a model: model = "my_worm.py:build"'

    def _faults_of_chain(self, worm: ChainTable, folder: Path) -> Iterator[Fault]:
        yield from worm.faults(self.time.end, self.units)
        if self.parameters is not None:
            yield "parameters", "apply to a model only; write the worm's parameters in [worm]"
        if self.start is not None:
            yield from self.start.faults(worm.links)
        if self.actuation is not None:
            yield from self.actuation.faults(worm.links, folder)

    def _faults_of_model(self, folder: Path) -> Iterator[Fault]:
        for key in ("start", "actuation"):
            if getattr(self, key) is not None:
                yield (
                    key,
                    f"applies to [worm] only, since a model defines its own {key}; leave it out",
                )
        if "motion" in self.want:
            yield "want", '"motion" needs a chain; write "signals" for a model'
        for name, value in (self.parameters or {}).items():
            if not _is_plain(value):
                yield (
                    f"parameters.{name}",
                    "is not supported; write text, true, false, a finite number, or lists and "
                    "tables of these",
                )
        yield from _faults_of_file(folder / self.model_file, self.model_file)


def _faults_of_file(path: Path, shown: str) -> Iterator[Fault]:
    """Read the file without running it; only `wormopt run` runs it."""
    unreadable = why_unreadable(path)
    if unreadable:
        yield "model", f'"{shown}" cannot be read from {path.parent}: {unreadable}'
        return
    try:
        ast.parse(path.read_bytes(), shown)
    except SyntaxError as error:
        yield "model", f"{shown} line {error.lineno}: {error.msg}; write valid Python"
    except (ValueError, RecursionError, MemoryError) as error:
        yield "model", f"{shown} is not Python: {error}"


def _is_plain(value: object) -> bool:
    """Whether a value has the same meaning in TOML, JSON and Python."""
    if isinstance(value, list):
        return all(_is_plain(item) for item in value)
    if isinstance(value, dict):
        return all(_is_plain(item) for item in value.values())
    if isinstance(value, float):
        return math.isfinite(value)
    return isinstance(value, bool | int | str)
