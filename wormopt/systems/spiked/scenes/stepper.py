"""Scenes of kind "stepper": a gait as commands for stepping motors on threaded rods."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.scene.types import NonNegative, SceneTable, Table, extreme_numbers
from wormopt.systems.spiked.scenes.gait import Accordion, BlockWave, FastGait, GaitFile
from wormopt.systems.spiked.scenes.motor import MotorTable
from wormopt.systems.spiked.scenes.worm import WormTable


class BristleTable(Table, frozen=True, kw_only=True):
    """The bristles under the masses.

    Parameters
    ----------
    backslip : float
        How far a mass slips back before its bristles hold, in m.
    settle_time : float
        Time a link takes for a step, in s; 0 is at once.
    """

    backslip: NonNegative = 0.0
    settle_time: NonNegative = 0.0


class StepperScene(SceneTable, frozen=True, kw_only=True):
    """A gait as step commands, and the worm they move.

    Parameters
    ----------
    schema : int
        Version of the scene form, 1.
    kind : {"stepper"}
        The kind.
    title : str
        Title of pictures and reports.
    units : {"SI"}
        Numbers are in SI units.
    want : tuple of str
        Pictures to draw.
    worm : WormTable
        The worm.
    gait : FastGait, BlockWave, Accordion or GaitFile
        The gait.
    motor : MotorTable
        The motor of every link.
    bristles : BristleTable
        What holds the masses.
    tick : float
        Tick of the timer for which the C table is made, in s.
    """

    kind: Literal["stepper"]
    want: tuple[Literal["steps"], ...] = ()
    worm: WormTable
    gait: FastGait | BlockWave | Accordion | GaitFile
    motor: MotorTable
    bristles: BristleTable = BristleTable()
    tick: Annotated[
        float, Meta(ge=1e-9, le=1, description="a number of seconds from 1e-9 to 1")
    ] = 1e-6

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield the faults that no single key shows."""
        yield from super().faults(folder)
        yield from extreme_numbers(self)
        if self.units != "SI":
            yield "units", 'motors are commanded in s and m: write units = "SI"'
        yield from self.worm.faults()
        yield from self.gait.faults(self.worm.links, folder)
        yield from self.motor.faults()
        period = self.gait.period
        if period is not None and self.bristles.settle_time >= period:
            yield (
                "bristles.settle_time",
                f"{self.bristles.settle_time:g} s is not below the period of {period:g} s; "
                "write less",
            )
