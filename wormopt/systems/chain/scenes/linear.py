"""Scenes of kind "linear": linear theory of a chain and of its trackers with the gain frozen."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

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
    FinitePerMass,
    Positive,
    SceneTable,
    Table,
    says,
    wrong_count,
)
from wormopt.systems.chain.scenes.chain import ChainTable
from wormopt.systems.chain.scenes.track import DerivativeTracker, FilterTracker, Reference

MOST_LINKS = 12
"""Margins take eigenvalues of large matrices many times."""


class PointTable(Table, frozen=True, kw_only=True):
    """Where the worm is linearised: all links at rest length, its contacts by the smooth law."""

    velocity: Annotated[
        FinitePerMass,
        says("speed", "of the masses; dry friction is a constant force where it is not 0"),
    ] = 0.0
    v_reg: Annotated[
        Positive, says("speed", "width of the smooth law, which has a slope at rest")
    ] = 1 / 40


class GainsTable(Table, frozen=True, kw_only=True):
    """Gains at which the frozen loop is looked at. Refused: `most` not above `least`."""

    least: Annotated[Positive, says("", "the smallest *k*")] = 1.0
    most: Annotated[Positive, says("", "the largest *k*")] = 1000.0
    count: Annotated[
        int,
        Meta(ge=2, le=500, description="a whole number from 2 to 500"),
        says("count", "how many, evenly in the logarithm"),
    ] = 31

    def faults(self) -> Iterator[Fault]:
        """Yield a fault if the range is empty."""
        if self.most <= self.least:
            yield "gains.most", f"is not above gains.least = {self.least:g}; write more"


class LinearScene(SceneTable, frozen=True, kw_only=True):
    """A chain near an operating point, and the loop of its tracker with the gain frozen.

    Poles, zeros and frequency response are those of the worm at `point`; margins and errors those
    of the loop whose gain is held, with dry friction as an outside force. The gain that suffices
    for the tube is found in three ways (`gain_linear`, `gain_sure`, `gain_simulated`), beside the
    gain that the tracker learns in a simulation. Refused: `worm.random`; a tracker with
    feed-forward; links without stiffness; more than 12 links; a motion shorter than two periods
    of the reference.

    Arrays over `gain` are not a number where there is nothing to tell: a gain margin beyond a
    factor of 10⁶, an error without bound.
    """

    headline: ClassVar = (
        "gain_learned",
        "gain_linear",
        "gain_simulated",
        "gain_sure",
        "phase_margin",
        "disk_margin",
    )
    scalars: ClassVar = {
        "gain_learned": ("count", "*k* at the end of the adaptive motion"),
        "gain_linear": (
            "count",
            "least *k* from which on the linear loop without dry friction stays in the tube after "
            "long time, from the harmonics of the reference; `gains.least` where that will do, "
            "unknown beyond `gains.most`",
        ),
        "gain_sure": (
            "count",
            "the same with the bound on what dry friction may do; enough for every course of "
            "friction, not necessary; unknown beyond `gains.most`, or if friction has no bound",
        ),
        "gain_simulated": (
            "count",
            "least *k* with which the worm itself, its gain frozen, is in the tube over the last "
            "period, by bisection over simulations; unknown beyond `gains.most`",
        ),
        "error_learned": (
            "length",
            "largest \\|*e*\\| over the last period with the gain frozen at `gain_learned`",
        ),
        "error_sure": ("length", "its bound by linear theory; unknown if friction has no bound"),
        "capture_time": (
            "time",
            "last entry of the adaptive motion into the tube; unknown if none",
        ),
        "tube_radius": ("length", "*λ*"),
        "common_zero": ("rate", "zero of the worm at `point`: minus slope of all friction by mass"),
        "minimum_phase": ("count", "1 if the worm at `point` is minimum phase, 0 if not"),
        "gain_definite": (
            "count",
            "least eigenvalue of the high-frequency gain's symmetric part, times the mean mass; "
            "positive: a tracker of high gain has the right sign",
        ),
        "pole_slowest": ("rate", "largest real part of a pole of the loop at `gain_learned`"),
        "gain_margin": (
            "count",
            "at `gain_learned`: factor common to all inputs up to which the loop is stable; "
            "unknown beyond 10⁶",
        ),
        "phase_margin": ("angle", "at `gain_learned`: lag common to all inputs that it bears"),
        "disk_margin": (
            "count",
            "at `gain_learned`: 1 / max \\|*S* − ½\\|, for gains and lags of the inputs apart; at "
            "most 2",
        ),
        "sensitivity_peak": ("count", "at `gain_learned`: max \\|*S*\\| over all frequencies"),
    }
    variables: ClassVar = {
        "omega": ("angular_frequency", ("omega",), "angular frequency"),
        "magnitude": ("compliance", ("link", "input", "omega"), "|G|, length of a link by force"),
        "phase": ("angle", ("link", "input", "omega"), "phase of G"),
        "zero_real": ("rate", ("zero",), "real parts of the zeros, the shift left out"),
        "zero_imag": ("rate", ("zero",), "imaginary parts of the zeros"),
        "pole_real": ("rate", ("pole",), "real parts of the worm's poles, the shift left out"),
        "pole_imag": ("rate", ("pole",), "imaginary parts of the worm's poles"),
        "learned_real": ("rate", ("loop_pole",), "real parts of the loop's poles, gain learned"),
        "learned_imag": ("rate", ("loop_pole",), "imaginary parts of the same"),
        "gain": ("count", ("gain",), "frozen gain"),
        "loop_real": ("rate", ("gain", "loop_pole"), "real parts of the loop's poles"),
        "loop_imag": ("rate", ("gain", "loop_pole"), "imaginary parts of the loop's poles"),
        "gain_margins": ("count", ("gain",), "gain margin"),
        "phase_margins": ("angle", ("gain",), "phase margin"),
        "disk_margins": ("count", ("gain",), "disk margin"),
        "sensitivity_peaks": ("count", ("gain",), "largest |S|"),
        "error_linear": ("length", ("gain",), "largest error without dry friction"),
        "error_bound": ("length", ("gain",), "bound of the error with dry friction"),
        "tried_gain": ("count", ("trial",), "frozen gain of a simulation"),
        "tried_error": ("length", ("trial",), "its largest error over the last period"),
    }

    kind: Literal["linear"]
    want: Annotated[
        tuple[Literal["bode", "poles", "margins"], ...],
        says(
            "",
            "`bode`: gain and phase of the worm; `poles`: poles, zeros, and where the loop's poles "
            "go as the gain grows; `margins`: margins and errors over the gain, with the gains "
            "that suffice and the one learned",
        ),
    ] = ()
    worm: Annotated[ChainTable, says("", "the worm, without `random`")]
    start: Annotated[Start, says("", "where it starts")] = field(default_factory=Start)
    reference: Annotated[Reference, says("", "what its links shall do")]
    tracker: Annotated[
        FilterTracker | DerivativeTracker, says("", "the tracker; `feedback` says which it is")
    ]
    point: Annotated[PointTable, says("", "where the worm is linearised")] = field(
        default_factory=PointTable
    )
    gains: Annotated[GainsTable, says("", "gains at which the loop is frozen")] = field(
        default_factory=GainsTable
    )
    contact: Contacts = field(default_factory=ExactContact)
    time: Horizon
    tolerance: Tolerances = field(default_factory=ToleranceTable)

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows; `folder` is the scene's."""
        yield from super().faults(folder)
        links = self.worm.links
        yield from self.worm.faults(self.time.end, self.units)
        yield from self.start.faults(links)
        yield from self.reference.gait.faults(links, folder, "reference.gait")
        yield from self.tracker.faults("tracker", links)
        yield from self.gains.faults()
        yield from wrong_count("point.velocity", self.point.velocity, links + 1, "masses")
        if links > MOST_LINKS:
            yield "worm.links", f"is above {MOST_LINKS}, the most that is analysed; write less"
        if self.worm.random is not None:
            yield "worm.random", "linear theory is of one worm; leave the table out"
        if self.tracker.feedforward is not None:
            yield "tracker.feedforward", "the frozen loop has none; leave the table out"
        stiffness = self.worm.stiffness
        if min(stiffness if isinstance(stiffness, tuple) else (stiffness,)) <= 0:
            yield "worm.stiffness", "a link without it keeps no length; write a positive number"
