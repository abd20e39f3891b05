"""Tables of scenes of kind "linear": linear theory of a chain and its tracker."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar, Literal

from msgspec import field

from wormopt.errors import Fault
from wormopt.study.given import Given, entry, positive, whole, wrong_count
from wormopt.study.numerics import (
    Contacts,
    ExactContact,
    Horizon,
    Start,
    Tolerances,
    ToleranceTable,
)
from wormopt.study.types import FinitePerMass, SceneTable
from wormopt.systems.chain.tables import ChainTable, DerivativeTracker, FilterTracker, Reference

MOST_LINKS = 12
"""Margins need the eigenvalues of large matrices many times."""


class PointTable(Given):
    """Operating point of the linearisation: links at rest length, contacts with the smooth law."""

    velocity: FinitePerMass = entry(
        "velocity of the masses; dry friction is a constant force where it is not 0",
        quantity="speed",
        default=0.0,
    )
    v_reg: float = positive(
        "speed", "width of the smooth friction law, whose slope at rest is finite", default=1 / 40
    )


class GainsTable(Given):
    """Gains at which the loop with frozen gain is analysed. Not allowed: `most` ≤ `least`."""

    least: float = positive("", "smallest *k*", default=1.0)
    most: float = positive("", "largest *k*", default=1000.0)
    count: int = whole(2, 500, "number of gains, evenly spaced in the logarithm", default=31)

    def faults(self) -> Iterator[Fault]:
        """Yield a fault if the range is empty."""
        if self.most <= self.least:
            yield "gains.most", f"is not above gains.least = {self.least:g}; write more"


class LinearScene(SceneTable):
    """A chain near an operating point, and the loop of its tracker with frozen gain.

    Poles, zeros and the frequency response belong to the chain at `point`. Margins and errors
    belong to the loop with constant gain, where dry friction is an external force. Three scalars
    give the gain that suffices for the tube: `gain_linear`, `gain_sure` and `gain_simulated`.
    `gain_learned` is the gain that the tracker reaches in a simulation.

    Not allowed: `worm.random`; a tracker with feed-forward; links without stiffness; more than 12
    links; a motion shorter than two periods of the reference.

    Arrays over `gain` are NaN where no value exists: a gain margin above a factor of 10⁶, or an
    unbounded error.
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
            "least *k* from which the linear loop without dry friction stays in the tube after a "
            "long time, from the harmonics of the reference; `gains.least` if that suffices; "
            "unknown above `gains.most`",
        ),
        "gain_sure": (
            "count",
            "the same, with a bound on the effect of dry friction; sufficient for every friction "
            "force over time, not necessary; unknown above `gains.most`, or if friction has no "
            "bound",
        ),
        "gain_simulated": (
            "count",
            "least *k* at which the nonlinear chain with frozen gain stays in the tube over the "
            "last period, by bisection over simulations; unknown above `gains.most`",
        ),
        "error_learned": (
            "length",
            "largest \\|*e*\\| over the last period with the gain frozen at `gain_learned`",
        ),
        "error_sure": (
            "length",
            "bound of the same by linear theory; unknown if friction has no bound",
        ),
        "capture_time": (
            "time",
            "time of the last entry of the adaptive motion into the tube; unknown if there is none",
        ),
        "tube_radius": ("length", "*λ*"),
        "common_zero": (
            "rate",
            "zero of the chain at `point`: minus the slope of all friction over the mass",
        ),
        "minimum_phase": ("count", "1 if the chain at `point` is minimum phase, otherwise 0"),
        "gain_definite": (
            "count",
            "least eigenvalue of the symmetric part of the high-frequency gain, times the mean "
            "mass; if it is positive, a high-gain tracker has the right sign",
        ),
        "pole_slowest": ("rate", "largest real part of the poles of the loop at `gain_learned`"),
        "gain_margin": (
            "count",
            "gain margin at `gain_learned`: factor, common to all inputs, up to which the loop is "
            "stable; unknown above 10⁶",
        ),
        "phase_margin": (
            "angle",
            "phase margin at `gain_learned`: largest phase lag, common to all inputs, at which "
            "the loop is stable",
        ),
        "disk_margin": (
            "count",
            "disk margin at `gain_learned`: 1 / max \\|*S* − ½\\|, for independent gains and lags "
            "of the inputs; at most 2",
        ),
        "sensitivity_peak": ("count", "max \\|*S*\\| over all frequencies at `gain_learned`"),
    }
    variables: ClassVar = {
        "omega": ("angular_frequency", ("omega",), "angular frequency"),
        "magnitude": ("compliance", ("link", "input", "omega"), "|G|, link length over force"),
        "phase": ("angle", ("link", "input", "omega"), "phase of G"),
        "zero_real": (
            "rate",
            ("zero",),
            "real parts of the zeros, without the shift of the whole chain",
        ),
        "zero_imag": ("rate", ("zero",), "imaginary parts of the zeros"),
        "pole_real": (
            "rate",
            ("pole",),
            "real parts of the chain's poles, without the shift of the whole chain",
        ),
        "pole_imag": ("rate", ("pole",), "imaginary parts of the chain's poles"),
        "learned_real": (
            "rate",
            ("loop_pole",),
            "real parts of the loop's poles at the learned gain",
        ),
        "learned_imag": (
            "rate",
            ("loop_pole",),
            "imaginary parts of the loop's poles at the learned gain",
        ),
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
        "tried_error": (
            "length",
            ("trial",),
            "largest error of that simulation over the last period",
        ),
    }

    kind: Literal["linear"]
    want: tuple[Literal["bode", "poles", "margins"], ...] = entry(
        "`bode`: gain and phase of the chain; `poles`: poles, zeros, and the loop's poles "
        "over the gain; `margins`: margins and errors over the gain, with the sufficient "
        "gains and the learned gain",
        default=(),
    )
    worm: ChainTable = entry("the chain, without `random`")
    start: Start = entry("initial state", default=Start)
    reference: Reference = entry("reference of the links")
    tracker: FilterTracker | DerivativeTracker = entry("the tracker; `feedback` selects its kind")
    point: PointTable = entry("operating point of the linearisation", default=PointTable)
    gains: GainsTable = entry("gains of the frozen loop", default=GainsTable)
    contact: Contacts = field(default_factory=ExactContact)
    time: Horizon
    tolerance: Tolerances = field(default_factory=ToleranceTable)

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield what no single key shows; `folder` is the scene's."""
        yield from super().faults(folder)
        links = self.worm.links
        yield from self.worm.faults(self.time.end, self.units)
        yield from self.start.faults(links)
        yield from self.reference.gait.faults(links, folder, "reference.gait")
        yield from self.tracker.faults("tracker", links)
        yield from self.gains.faults()
        yield from wrong_count("point.velocity", self.point.velocity, links + 1, "masses")
        if links > MOST_LINKS:
            yield (
                "worm.links",
                f"is above {MOST_LINKS}, the largest number that is analysed; write less",
            )
        if self.worm.random is not None:
            yield (
                "worm.random",
                "is not allowed, since linear theory describes a single chain; leave the table out",
            )
        if self.tracker.feedforward is not None:
            yield (
                "tracker.feedforward",
                "is not allowed, since the frozen loop has no feed-forward; leave the table out",
            )
        stiffness = self.worm.stiffness
        if min(stiffness if isinstance(stiffness, tuple) else (stiffness,)) <= 0:
            yield (
                "worm.stiffness",
                "is 0, and a link without stiffness has no rest length; write positive numbers",
            )
