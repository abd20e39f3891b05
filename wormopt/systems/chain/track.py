"""Kind "track": a chain whose links follow a gait by adaptive controllers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any, ClassVar

from msgspec import field

from wormopt.errors import Fault
from wormopt.result import Check
from wormopt.study import (
    Given,
    arrays,
    attributes,
    checks,
    entry,
    facts,
    on_use,
    scalar,
    scalars,
    stage,
    warnings,
    whole,
)
from wormopt.study.numerics import (
    Contacts,
    ExactContact,
    Tolerances,
    ToleranceTable,
)
from wormopt.systems.chain.tables import (
    Tracker,
    faults_of_lag,
)
from wormopt.systems.chain.tracking import Tracking
from wormopt.systems.shared.declared import (
    CHAIN,
    GAIT,
    LOOP_SIGNALS,
    REFERENCE,
    TIME,
    TRACKED,
    TRACKER_EVENTS,
    Scalars,
    Variables,
    gait_arrays,
    over,
)

with on_use():
    import numpy as np

    from wormopt.model.model import Model
    from wormopt.systems.chain.loops import (
        Links,
        draw_links,
        labels,
    )
    from wormopt.systems.chain.measured import chain_checks, chain_facts
    from wormopt.systems.chain.tracked import (
        Herd,
        Tracked,
        follow,
        follow_all,
        follow_in_turn,
        herd_signals,
        of_trackers,
        tracked_signals,
    )
    from wormopt.systems.shared.proof import CrossCheck, one_or_all, warnings_of_contact
    from wormopt.systems.shared.signals import fitted

_BANDS = ("position", "length", "input", "error_norm", "gain")
_EACH = ("distance", "mean_speed", "time_outside_tube", "capture_time", "input_rms", "k_end")
_NUMBERS: Scalars = {
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
    **{name: CHAIN[name] for name in ("input_rms", "input_peak", "n_events", "n_steps")},
}
_OF_MEMBERS: Scalars = {
    "distance_quantiles": (
        "length",
        "distances of the 5, 25, 50, 75 and 95 % quantiles of the members (ensemble)",
    ),
    "captured_share": ("share", "share of members in the tube at the end (ensemble)"),
    "members": ("count", "members simulated to the end (ensemble)"),
}
_SIGNALS: Variables = {
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
        f"member_{name}": (_NUMBERS[name][0], ("tracker", "member"), f"{name} of the member")
        for name in _EACH
    },
}


class Members(Given):
    """Many worms, each with its own random links. Requires `[worm.random]`."""

    members: int = whole(
        2, 100000, "number of worms; the first is the worm of the scene without this table"
    )


class Track(Tracking, kind="track"):
    """Track a gait with adaptive controllers on a chain with friction.

    Each controller acts on its own copy of the worm, or of `[model]`, a plant of your own. The
    results of a plant of your own contain its output as `length`, its input as `input`, and every
    named state and output of its Model; they lack what only chains have. With several trackers
    every scalar is a list with one entry per tracker, in the order of the scene; the attribute
    `trackers` holds their names. Trust report:
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

    pictures: ClassVar = {
        "trackers": "outputs with the *λ*-strip, error, gain, inputs, motion (in the order of "
        "figures 5 to 8 of Zimmermann et al. 2007)",
        "motion": "paths with time upward, thick where a mass rests",
        "bands": "outputs of `[ensemble]`, instead of the others",
        "animation": ("the moving worms, as a GIF", "wormopt.pictures.worms:animation"),
    }

    tracker: Tracker | tuple[Tracker, ...] = entry(
        "the controller, or one `[[tracker]]` for each controller; `feedback` selects its kind"
    )
    contact: Contacts = field(default_factory=ExactContact)
    tolerance: Tolerances = field(default_factory=ToleranceTable)
    ensemble: Members | None = entry("simulates many worms; default: one worm", default=None)

    @property
    def trackers(self) -> tuple[Tracker, ...]:
        """List of the controllers, also if there is only one."""
        return self.tracker if isinstance(self.tracker, tuple) else (self.tracker,)

    def tracker_key(self, index: int) -> str:
        """Key path of a tracker."""
        return f"tracker[{index}]" if isinstance(self.tracker, tuple) else "tracker"

    def faults_of_keys(self) -> Iterator[Fault]:
        yield from super().faults_of_keys()
        if not self.trackers:
            yield "tracker", "has no entries; write at least one [[tracker]]"
        for index, tracker in enumerate(self.trackers):
            yield from faults_of_lag(self.tracker_key(index), tracker, self.time.end)
        if self.ensemble is None and "bands" in self.want:
            yield "want", '"bands" needs an ensemble; write [ensemble] members = 200'
        if self.ensemble is not None and (self.worm is None or self.worm.random is None):
            yield "ensemble", "would have equal members; write [worm.random]"
        for word in ("trackers", "motion", "animation"):
            if self.ensemble is not None and word in self.want:
                message = f'"{word}" shows a single worm; write "bands", or leave out [ensemble]'
                yield "want", message

    def faults_of_sizes(self, links: int) -> Iterator[Fault]:
        yield from super().faults_of_sizes(links)
        for index, tracker in enumerate(self.trackers):
            yield from tracker.faults(self.tracker_key(index), links)

    # -- closed loops ------------------------------------------------------------------------------

    def loop(self, index: int, links: Links | None) -> Model:
        """Close the loop of a tracker; SceneError if it cannot start there."""
        plant = self.plant_for(self.gait, links)
        tracker, key = self.trackers[index], self.tracker_key(index)
        return self.closed(plant, self.target(plant), tracker, key)

    def models(self) -> dict[str, Model]:
        """Closed loop of every tracker, by label; links are those of the first draw."""
        links = draw_links(self.worm, self.time.end) if self.worm else None
        names = labels(self.trackers)
        return {name: self.loop(k, links) for k, name in enumerate(names)}

    # -- motions -----------------------------------------------------------------------------------

    @stage
    def motions(self) -> Sequence[Tracked]:
        """Motion of each tracker, with `[ensemble]` of all members."""
        pairs = zip(self.trackers, self.models().items(), strict=True)
        return follow_in_turn(
            partial(self._follow, label, tracker, loop) for tracker, (label, loop) in pairs
        )

    def _follow(self, label: str, tracker: Tracker, loop: Model) -> Tracked:
        end, samples = self.time.end, self.time.samples
        how = (self.contact.options, self.tolerance.options, self.report)
        if self.ensemble is None:
            several = len(self.trackers)
            return follow(label, tracker, loop, end, samples, *how, motions=several)
        assert self.worm is not None
        members = [draw_links(self.worm, end, k) for k in range(self.ensemble.members)]
        return follow_all(label, tracker, loop, members, np.linspace(0.0, end, samples), *how)

    @stage
    def recheck(self) -> Sequence[CrossCheck | None]:
        """Second route of each tracker; of an ensemble, the worst of three members."""
        again = self.tolerance.recheck
        return [each.recheck(self.tolerance.options, again, self.report) for each in self.motions]

    # -- results -----------------------------------------------------------------------------------

    @scalars(
        _NUMBERS | _OF_MEMBERS,
        headline=(
            "distance",
            "mean_speed",
            "capture_time",
            "time_outside_tube",
            "input_rms",
            "input_peak",
        ),
    )
    def numbers(self) -> dict[str, Any]:
        return of_trackers(self.motions)

    @scalar(*CHAIN["recheck_error"])
    def recheck_error(self) -> Any:
        return one_or_all([second and second.error for second in self.recheck])

    @arrays(_SIGNALS)
    def signals(self) -> Mapping[str, Any]:
        herds = [each for each in self.motions if isinstance(each, Herd)]
        found = herd_signals(herds, _BANDS, _EACH) if herds else tracked_signals(self.motions)
        if not found:
            return {}
        own = self.own_arrays([each.motion for each in self.motions], "tracker")
        return {**own, **fitted(found, _SIGNALS), **gait_arrays(self.gait)}

    @attributes
    def labels(self) -> dict[str, Any]:
        return {"trackers": [each.label for each in self.motions]}

    # -- trust -------------------------------------------------------------------------------------

    @checks
    def checks_of_trackers(self) -> Iterator[Check]:
        for each, second in zip(self.motions, self.recheck, strict=True):
            label = each.label if len(self.motions) > 1 or self.ensemble else ""
            yield from chain_checks(second, each.energies, self.tolerance.options, label)
            yield from each.own_checks(f"{label}: " if label else "")

    @warnings
    def doubts(self) -> Iterator[str]:
        yield from warnings_of_contact(self.contact.options, self.laws)
        for each, second in zip(self.motions, self.recheck, strict=True):
            yield from each.warnings(second, self.gait.period)

    @facts
    def simulations(self) -> dict[str, Any]:
        motions, energies = zip(*((o.motion, o.energies) for o in self.motions), strict=True)
        return chain_facts(motions, self.recheck, self.tolerance.options, energies)
