"""Scenes of kind "simulate": a chain with given inputs, or a model of the user's own."""

from __future__ import annotations

import ast
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

from msgspec import Meta, field

from wormopt.errors import Fault
from wormopt.scene.numerics import ContactTable, ExactContact, Start, TimeSpan, ToleranceTable
from wormopt.scene.types import (
    Finite,
    FinitePerLink,
    NonNegativePerLink,
    Positive,
    SceneTable,
    Table,
    extreme_numbers,
    wrong_count,
)
from wormopt.systems.chain.scenes.chain import ChainTable
from wormopt.systems.spiked.scenes.shapes import Shape, why_unreadable


class ConstantForce(Table, frozen=True, kw_only=True, tag_field="law", tag="constant"):
    """Inputs u that do not change.

    Parameters
    ----------
    force : float or tuple of float
        Force, alike for all or one per link; positive forces push the masses of a link apart.
    """

    force: FinitePerLink

    def faults(self, links: int, folder: Path) -> Iterator[Fault]:
        """Yield what does not fit a worm of so many links; `folder` is the scene's."""
        yield from wrong_count("actuation.force", self.force, links, "links")


class HarmonicChange(Table, frozen=True, kw_only=True, tag_field="law", tag="harmonic"):
    """Commanded change of rest length A_j sin(2 pi (t/T - j lag)), (11).

    Parameters
    ----------
    amplitude : float or tuple of float
        Amplitudes A, alike for all or one per link.
    period : float
        Period T.
    lag : float
        By how much of a period each link is behind the one ahead of it; link 1 itself lags by
        as much.
    """

    amplitude: NonNegativePerLink
    period: Positive
    lag: Finite = 0.0

    def faults(self, links: int, folder: Path) -> Iterator[Fault]:
        """Yield what does not fit a worm of so many links; `folder` is the scene's."""
        yield from wrong_count("actuation.amplitude", self.amplitude, links, "links")


class CommandedGait(Table, frozen=True, kw_only=True, tag_field="law", tag="gait"):
    """Rest lengths that are commanded to follow a gait, u = c (gait - rest length), (11).

    Parameters
    ----------
    gait : FastShape, BlockWaveShape, AccordionShape, SineShape or FileShape
        The gait.
    shift : float
        The command at time t is the gait at t + shift.
    """

    gait: Shape
    shift: Finite = 0.0

    def faults(self, links: int, folder: Path) -> Iterator[Fault]:
        """Yield what does not fit a worm of so many links; `folder` is the scene's."""
        yield from self.gait.faults(links, folder, "actuation.gait")


Actuation = ConstantForce | HarmonicChange | CommandedGait

_MODEL = r"^[^\x00-\x1f]+\.py:[A-Za-z_][A-Za-z0-9_]*$"


class SimulateScene(SceneTable, frozen=True, kw_only=True):
    """A motion: of a chain with given inputs, or of a model of the user's own.

    Parameters
    ----------
    schema : int
        Version of the scene form, 1.
    kind : {"simulate"}
        The kind.
    title : str
        Title of pictures and reports.
    units : {"dimensionless", "SI"}
        Whether numbers are in SI units.
    want : tuple of str
        Pictures to draw.
    worm : ChainTable, optional
        A chain.
    start : Start, optional
        Where the chain starts.
    actuation : ConstantForce, HarmonicChange or CommandedGait, optional
        Inputs of the chain.
    model : str, optional
        "file.py:function": a Python file beside the scene, and the function in it that returns
        the Model.
    parameters : mapping, optional
        Arguments of that function by name.
    contact : SmoothContact or ExactContact
        How contact is treated.
    time : TimeSpan
        How long.
    tolerance : ToleranceTable
        How exact.
    """

    kind: Literal["simulate"]
    want: tuple[Literal["motion", "signals"], ...] = ()
    worm: ChainTable | None = None
    start: Start | None = None
    actuation: Actuation | None = None
    model: (
        Annotated[
            str, Meta(pattern=_MODEL, description='"file.py:function", "my_worm.py:build" say')
        ]
        | None
    ) = None
    parameters: dict[str, Any] | None = None
    contact: ContactTable = field(default_factory=ExactContact)
    time: TimeSpan
    tolerance: ToleranceTable = field(default_factory=ToleranceTable)

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
        yield from extreme_numbers(self)
        if self.worm is not None and self.model is not None:
            yield "model", "a scene has [worm] or a model, not both; leave one out"
        elif self.worm is not None:
            yield from self._faults_of_chain(self.worm, folder)
        elif self.model is not None:
            yield from self._faults_of_model(folder)
        else:
            yield "worm", 'missing; write [worm], or a model: model = "my_worm.py:build"'

    def _faults_of_chain(self, worm: ChainTable, folder: Path) -> Iterator[Fault]:
        yield from worm.faults(self.time.end)
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
