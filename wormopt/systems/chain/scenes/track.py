"""Tables of scenes of kind "track": links that follow a gait by an adaptive controller."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar, Literal

from msgspec import field

from wormopt.errors import Fault
from wormopt.study.given import Given, entry, whole
from wormopt.study.numerics import (
    Contacts,
    ExactContact,
    Horizon,
    Start,
    Tolerances,
    ToleranceTable,
)
from wormopt.study.types import (
    SceneTable,
)
from wormopt.systems.chain.tables import ChainTable, Reference, Tracker, faults_of_lag
from wormopt.systems.shared.declared import (
    CHAIN,
    GAIT,
    LOOP_SIGNALS,
    REFERENCE,
    TIME,
    TRACKED,
    TRACKER_EVENTS,
    Scalars,
    over,
)


class EnsembleTable(Given):
    """Many worms, each with its own random links. Requires `[worm.random]`."""

    members: int = whole(
        2, 100000, "number of worms; the first is the worm of the scene without this table"
    )


_BANDS = ("position", "length", "input", "error_norm", "gain")
_EACH = ("distance", "mean_speed", "time_outside_tube", "capture_time", "input_rms", "k_end")
_SCALARS: Scalars = {
    "x_end": CHAIN["x_end"],
    "v_end": CHAIN["v_end"],
    "k_end": (
        "count",
        "gain at the end; for a funnel controller its current gain `gain` · *k*<sub>1</sub>",
    ),
    "filter_end": ("length", "*θ* at the end; unknown without a filter"),
    "distance": CHAIN["distance"],
    "mean_speed": CHAIN["mean_speed"],
    **TRACKED,
    **CHAIN,
}


class TrackScene(SceneTable):
    """A chain whose links follow a gait, with one or several trackers.

    Each controller acts on its own copy of the worm. With several trackers every scalar is a list
    with one entry per tracker, in the order of the scene; the attribute `trackers` holds their
    names. `timings_s`: `simulate` and `recheck`. Trust report:
    [simulations](../scenes.md#the-trust-report-of-a-simulation).

    With `[ensemble]`, scalars are medians over the members, entry by entry. `capture_time` is
    unknown if most members are never captured. `input_peak` is the largest over the samples.
    `recheck_error` is the largest of the rechecked members (first, slowest, fastest). Unknown
    values of a member are NaN in its variables. Bands have the quantiles 0.05, 0.25, 0.5, 0.75,
    0.95.

    At rest, `contact_force` is the force that holds the mass. `funnel` is NaN for other trackers.
    `event_kind` counts from 0: reversal, stick, release, impact, switch (a crossing of the tube).
    Rests are known for exact contact only.
    """

    headline: ClassVar = (
        "distance",
        "mean_speed",
        "capture_time",
        "time_outside_tube",
        "input_rms",
        "input_peak",
    )
    scalars: ClassVar = _SCALARS | {
        "distance_quantiles": (
            "length",
            "distances of the 5, 25, 50, 75 and 95 % quantiles of the members (ensemble)",
        ),
        "captured_share": ("share", "share of members in the tube at the end (ensemble)"),
        "members": ("count", "members simulated to the end (ensemble)"),
    }
    variables: ClassVar = {
        **TIME,
        **REFERENCE,
        **over(LOOP_SIGNALS, "tracker"),
        **TRACKER_EVENTS,
        **GAIT,
        "quantile": ("share", ("quantile",), "share of members below the quantile"),
        **{
            f"{name}_band": (
                quantity,
                ("tracker", "quantile", *own, "time"),
                f"quantiles over the members: {what}",
            )
            for name in _BANDS
            for quantity, own, what in [LOOP_SIGNALS[name]]
        },
        **{
            f"member_{name}": (_SCALARS[name][0], ("tracker", "member"), f"{name} of the member")
            for name in _EACH
        },
    }

    kind: Literal["track"]
    want: tuple[Literal["trackers", "motion", "bands"], ...] = entry(
        "`trackers`: outputs with the *λ*-strip, error, gain, inputs, motion (in the order of "
        "figures 5 to 8 of Zimmermann et al. 2007); `motion`: paths with time upward, thick "
        "where a mass rests; with `[ensemble]` `bands` instead",
        default=(),
    )
    worm: ChainTable = entry("the chain")
    start: Start = entry("initial state", default=Start)
    reference: Reference = entry("reference of the links")
    tracker: Tracker | tuple[Tracker, ...] = entry(
        "the controller, or one `[[tracker]]` for each controller; `feedback` selects its kind"
    )
    contact: Contacts = field(default_factory=ExactContact)
    time: Horizon
    tolerance: Tolerances = field(default_factory=ToleranceTable)
    ensemble: EnsembleTable | None = entry("simulates many worms; default: one worm", default=None)

    @property
    def trackers(self) -> tuple[Tracker, ...]:
        """List of the controllers, also if there is only one."""
        return self.tracker if isinstance(self.tracker, tuple) else (self.tracker,)

    def tracker_key(self, index: int) -> str:
        """Key path of a tracker."""
        return f"tracker[{index}]" if isinstance(self.tracker, tuple) else "tracker"

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows; `folder` is the scene's."""
        yield from super().faults(folder)
        links = self.worm.links
        yield from self.worm.faults(self.time.end, self.units)
        yield from self.start.faults(links)
        yield from self.reference.gait.faults(links, folder, "reference.gait")
        if not self.trackers:
            yield "tracker", "has no entries; write at least one [[tracker]]"
        for index, tracker in enumerate(self.trackers):
            yield from tracker.faults(self.tracker_key(index), links)
            yield from faults_of_lag(self.tracker_key(index), tracker, self.time.end)
        yield from self._faults_of_ensemble()

    def _faults_of_ensemble(self) -> Iterator[Fault]:
        if self.ensemble is None:
            if "bands" in self.want:
                yield "want", '"bands" needs an ensemble; write [ensemble] members = 200'
            return
        if self.worm.random is None:
            yield "ensemble", "would have equal members; write [worm.random]"
        for word in ("trackers", "motion"):
            if word in self.want:
                yield (
                    "want",
                    f'"{word}" shows a single worm; write "bands", or leave out [ensemble]',
                )
