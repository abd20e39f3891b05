"""The tables ``[predictive]``, ``[estimation]`` and ``[plants]`` of predictive control."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.scene.types import Positive, Seed, Table, says
from wormopt.systems.chain.scenes.chain import ChainTable
from wormopt.systems.chain.scenes.track_optimal import Share

Estimated = Literal["mass", "stiffness", "damping", "friction_forward", "friction_backward"]
ESTIMATED: tuple[Estimated, ...] = ("mass", "friction_forward", "friction_backward")


class PlantsTable(Table, frozen=True, kw_only=True):
    """Plants that are not as believed: every number drawn by itself, uniform around its own."""

    members: Annotated[
        int,
        Meta(ge=1, le=1000, description="a whole number from 1 to 1000"),
        says("count", "plants that are not as believed"),
    ]
    spread: Annotated[
        Share,
        says(
            "share",
            "every mass, stiffness, damping and friction force is drawn within ± this share",
        ),
    ]
    seed: Annotated[Seed, says("", "the same seed gives the same plants")] = 0


class PredictiveTable(Table, frozen=True, kw_only=True):
    """Predictive control of ∫(|*e*|² + *ρ*|*u*|²) d*t*, decided anew every `period`.

    The model that it believes has the smooth law of friction; beyond the horizon it counts what
    departing from the plan of the whole motion costs, to second order.
    """

    period: Annotated[
        Positive,
        says(
            "time",
            "longest time from one decision to the next; shorter where a corner of the reference "
            "lies between",
        ),
    ]
    horizon: Annotated[Positive, says("time", "how far a decision looks ahead")]
    input_weight: Annotated[Positive, says("", "*ρ*")]
    v_reg: Annotated[
        Positive, says("speed", "width of velocities over which the believed law is steep")
    ]
    steps: Annotated[
        int,
        Meta(ge=1, le=1000, description="a whole number from 1 to 1000"),
        says("count", "most steps of a decision with full convergence; in real time it is one"),
    ] = 20
    force: Annotated[
        Positive | None, says("force", "largest |*u*<sub>j</sub>|; no limit if left out")
    ] = None
    seconds: Annotated[
        Positive,
        says(
            "s",
            "how many seconds one unit of the scene's time lasts, against which decisions are "
            "timed; 1 with SI units",
        ),
    ] = 1.0

    def faults(self, end: float, units: str) -> Iterator[Fault]:
        """Yield what does not fit a motion from 0 to `end`."""
        if self.horizon < self.period:
            yield "predictive.horizon", f"is below predictive.period = {self.period:g}; write more"
        if self.period > end:
            yield "predictive.period", f"is above time.end = {end:g}; write less"
        if end / self.period > _MOST:
            least = end / _MOST
            yield "predictive.period", f"makes over {_MOST} decisions; write at least {least:.3g}"
        if units == "SI" and self.seconds != 1.0:
            yield "predictive.seconds", "is 1 with SI units; leave it out"


_MOST = 20_000


class EstimationTable(Table, frozen=True, kw_only=True):
    """Moving-horizon estimation: parameters that explain the last motion best.

    States are measured at every decision. Link after link, mass after mass is estimated; the sum
    of squares of what a window of measurements is missed by is minimised, and of what logarithms
    of parameters are off from what is believed. What leaves the window adds to that belief.
    """

    parameters: Annotated[
        tuple[Estimated, ...],
        says("", "which; others stay as they are believed"),
    ] = ESTIMATED
    window: Annotated[Positive, says("time", "how far the window reaches back")]
    noise: Annotated[
        Positive, says("share", "what a measured state may be missed by, in usual sizes")
    ] = 0.01
    spread: Annotated[
        Positive, says("share", "what a parameter is off beforehand: one standard deviation")
    ] = 0.2
    memory: Annotated[
        Positive | None,
        says("time", "after which what left the window counts 1/e; for ever if left out"),
    ] = None

    def faults(self, worm: ChainTable) -> Iterator[Fault]:
        """Yield what is wrong between the keys, or cannot be learnt of a worm."""
        if not self.parameters:
            yield "estimation.parameters", "names none; leave [estimation] out"
        if len(set(self.parameters)) < len(self.parameters):
            yield "estimation.parameters", "names one twice; write each once"
        for name in self.parameters:  # logarithms are estimated
            if not all(value > 0 for value in _values(worm, name)):
                yield "estimation.parameters", f"{name} is not above 0; leave it out"


def _values(worm: ChainTable, name: str) -> Iterator[float]:
    """Values of a parameter, one 0 where the worm has none."""
    side = name.removeprefix("friction_")
    given = [getattr(worm, name)] if side == name else [getattr(g, side, 0.0) for g in worm.ground]
    for each in given or [0.0]:
        yield from each if isinstance(each, tuple) else (each,)
