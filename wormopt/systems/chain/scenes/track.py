"""Scenes of kind "track": a chain whose links follow a gait by an adaptive controller."""

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
    Finite,
    FinitePerLink,
    NonNegative,
    NonNegativePerLink,
    Positive,
    SceneTable,
    Table,
    says,
    wrong_count,
)
from wormopt.systems.chain.scenes.chain import ChainTable
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
from wormopt.systems.spiked import Shape


class Reference(Table, frozen=True, kw_only=True):
    """What the links shall do."""

    gait: Annotated[Shape, says("", "a gait; `shape` decides which other keys there are")]
    shift: Annotated[
        Finite, says("time", "the reference at time *t* is the gait at *t* + `shift`")
    ] = 0.0


class ExponentLaw(Table, frozen=True, kw_only=True, tag_field="law", tag="exponent"):
    """*k*′ = *γ* [|*e*| − *λ*]<sub>+</sub> |*e*|<sup>*r*−1</sup>."""

    exponent: Annotated[
        float, Meta(ge=1, le=100, description="a number from 1 to 100"), says("1", "*r*")
    ]


class DecayLaw(Table, frozen=True, kw_only=True, tag_field="law", tag="decay"):
    """Growth with two exponents; the gain decays once the error has stayed in the tube.

    *k*′ = *γ* (|*e*| − *λ*)² from *λ* + 1 on, *γ* √(|*e*| − *λ*) from *λ* on; in the tube 0, after
    `dwell` there −*σ k*.
    """

    dwell: Annotated[Positive, says("time", "time in the tube before the gain decays")]
    decay: Annotated[NonNegative, says("rate", "*σ*, rate of decay")]


class QuadraticLaw(Table, frozen=True, kw_only=True, tag_field="law", tag="quadratic"):
    """*k*′ = *γ* ([|*e*| − *λ*]<sub>+</sub>)², the chapter's law."""


_OWN = "what the controller believes of the links; the worm's own if left out"


class FeedForwardTable(Table, frozen=True, kw_only=True):
    """Adds *c*(*y*<sub>ref</sub> − *l*<sub>0</sub>) + *d y*<sub>ref</sub>′ with these numbers.

    That is the force that would hold links of these numbers on the reference; numbers left out are
    the worm's own (`feedforward = {}`: all).
    """

    stiffness: Annotated[NonNegativePerLink | None, says("stiffness", f"*c*, {_OWN}")] = None
    damping: Annotated[NonNegativePerLink | None, says("drag", f"*d*, {_OWN}")] = None
    rest_length: Annotated[
        NonNegativePerLink | None, says("length", f"*l*<sub>0</sub>, {_OWN}")
    ] = None


# A stretch takes about a millisecond.
_MOST_STRETCHES = 1e5

Name = Annotated[str, says("", "what pictures call it; by its kind if left out")]
FeedForwardOrNone = Annotated[
    FeedForwardTable | None, says("", "force that is added; none if left out")
]


Input = Annotated[
    Literal["force", "rest_length"],
    says(
        "",
        "what *u* of the controller is: the actuator's force, or by (11) the change of the link's "
        "rest length, with the force *c*<sub>j</sub>*u*<sub>j</sub>",
    ),
]


class LambdaTracker(Table, frozen=True, kw_only=True, tag_field="feedback"):
    """What both lambda-trackers share."""

    name: Name = ""
    tube_radius: Annotated[Positive, says("length", "*λ*")]
    gain_start: Annotated[Positive, says("", "*k*(0)")] = 1.0
    growth: Annotated[Positive, says("", "*γ*")] = 1.0
    adaptation: Annotated[
        QuadraticLaw | ExponentLaw | DecayLaw,
        says("", 'how the gain grows; `{ law = "quadratic" }` if left out'),
    ] = field(default_factory=QuadraticLaw)
    input: Input = "force"
    feedforward: FeedForwardOrNone = None

    def faults(self, key: str, links: int) -> Iterator[Fault]:
        """Yield what does not fit a worm of so many links; `key` is the path of this table."""
        yield from _faults_of_feedforward(key, self.feedforward, links)


class DerivativeTracker(LambdaTracker, frozen=True, kw_only=True, tag="derivative"):
    """Tracker (13), which knows the rates of the links.

    With *e* = *y* − *y*<sub>ref</sub> and the Euclidean norm. Its numbers belong to the scene's
    units of time and length: (13) adds *k e* and (*k e*)′.
    """


class FilterTracker(LambdaTracker, frozen=True, kw_only=True, tag="filter"):
    """Tracker (14), which estimates the rates of the links by a filter.

    Its numbers belong to the scene's units of time and length: (14) adds *k θ* and (*k θ*)′.
    """

    filter_start: Annotated[FinitePerLink, says("length", "*θ*(0)")] = 1.0

    def faults(self, key: str, links: int) -> Iterator[Fault]:
        """Yield what does not fit a worm of so many links; `key` is the path of this table."""
        yield from super().faults(key, links)
        yield from wrong_count(f"{key}.filter_start", self.filter_start, links, "links")


class DifferenceTracker(LambdaTracker, frozen=True, kw_only=True, tag="difference"):
    """Tracker (13) with (*e*(*t*) − *e*(*t* − *h*))/*h* in place of *e*′: it measures no rates.

    The error before the start is that of the start. The loop is a delay equation, simulated by the
    method of steps. A difference does not bear every gain: *k h* must be small against the masses.
    """

    lag: Annotated[Positive, says("time", "*h*; each takes a stretch of its own to simulate")]


class BacksteppingTracker(LambdaTracker, frozen=True, kw_only=True, tag="backstepping"):
    """Ye's way (1999), in the form of Ilchmann, Ryan and Townsend (2007): it filters the input.

    *u* = −*k e* − (*k*² + |*e*|²) *k*⁴ (1 + |*ξ*|²)(*ξ* + *k e*), *ξ*′ = −*ξ* + *u*, *ξ*(0) = 0. It
    measures no rates. Powers of the gain up to *k*⁷ make it stiff, so that it wants a tube that
    small gains keep.
    """


class SwitchingTracker(Table, frozen=True, kw_only=True, tag_field="feedback", tag="switching"):
    """A gain that jumps up whenever a trial fails, in the manner of Miller and Davison (1991).

    *θ*′ = *k*²(*e* − *θ*), *u* = −(*k*²*θ* + *k θ*′): it measures no rates. A trial fails where
    |*e*| leaves its bound: the tube once the trial's time to settle has passed, before a little
    more than it began with. All these times together are `settling`, all that bounds add is
    `overshoot`. [theory-dynamics.md](../theory-dynamics.md) says what of it is a reading.
    """

    name: Name = ""
    tube_radius: Annotated[Positive, says("length", "*λ*")]
    settling: Annotated[Positive, says("time", "time outside of the tube, at most")]
    overshoot: Annotated[Positive, says("length", "by how much |*e*| may exceed its start, or *λ*")]
    gain_start: Annotated[Positive, says("", "*k*(0)")] = 1.0
    factor: Annotated[
        float,
        Meta(ge=1.01, le=100, description="a number from 1.01 to 100"),
        says("1", "each gain over the one before"),
    ] = 2.0
    filter_start: Annotated[
        FinitePerLink | None, says("length", "*θ*(0); the error then if left out")
    ] = None
    input: Input = "force"
    feedforward: FeedForwardOrNone = None

    def faults(self, key: str, links: int) -> Iterator[Fault]:
        """Yield what does not fit a worm of so many links; `key` is the path of this table."""
        yield from _faults_of_feedforward(key, self.feedforward, links)
        if self.filter_start is not None:
            yield from wrong_count(f"{key}.filter_start", self.filter_start, links, "links")


class FunnelTable(Table, frozen=True, kw_only=True):
    """Bound `end` + (`start` − `end`) exp(−*t*/`time`) on a norm."""

    start: Annotated[Positive, says("", "width at time 0: a length, of `rate_funnel` a speed")]
    end: Annotated[Positive, says("", "width after long time")]
    time: Annotated[Positive, says("time", "time in which it narrows")]


class FunnelTracker(Table, frozen=True, kw_only=True, tag_field="feedback", tag="funnel"):
    """Funnel controller: the error and its rate stay within bounds that shrink in time.

    The error stays within `funnel`, and *e*<sub>1</sub> within `rate_funnel`. By the law
    `recursive` (Berger, Lê, Reis 2018) *e*<sub>1</sub> is *e*′ + *k*<sub>0</sub> *e*, and *u* =
    −`gain` *k*<sub>1</sub> *e*<sub>1</sub>. By `two gains` (Hackl, Hopfe, Ilchmann, Mueller, Trenn
    2013) it is *e*′, and *u* = −`gain` (*k*<sub>0</sub>² *e* + *k*<sub>1</sub> *e*′). Refused: a
    start outside of a funnel, and for `two gains` a rate funnel narrower than the other shrinks.
    """

    name: Name = ""
    funnel: Annotated[FunnelTable, says("", "bounds on the error")]
    rate_funnel: Annotated[FunnelTable, says("", "bounds on *e*<sub>1</sub>")]
    law: Annotated[Literal["recursive", "two gains"], says("", "`recursive` or `two gains`")] = (
        "recursive"
    )
    gain: Annotated[Positive, says("drag", "force per speed in the middle of the funnels")] = 1.0
    tube_radius: Annotated[
        Positive | None,
        says(
            "length",
            "tube by which it is judged, `funnel.end` if left out; the controller does not know "
            "of it",
        ),
    ] = None
    input: Input = "force"
    feedforward: FeedForwardOrNone = None

    def faults(self, key: str, links: int) -> Iterator[Fault]:
        """Yield what does not fit a worm of so many links; `key` is the path of this table."""
        yield from _faults_of_feedforward(key, self.feedforward, links)


Tracker = (
    FilterTracker
    | DerivativeTracker
    | DifferenceTracker
    | BacksteppingTracker
    | SwitchingTracker
    | FunnelTracker
)


class EnsembleTable(Table, frozen=True, kw_only=True):
    """Many worms, each with random links of its own. Refused without `[worm.random]`."""

    members: Annotated[
        int,
        Meta(ge=2, le=100_000, description="a whole number from 2 to 100000"),
        says("count", "how many; the first is the worm that the scene has without this table"),
    ]


_BANDS = ("position", "length", "input", "error_norm", "gain")
_EACH = ("distance", "mean_speed", "time_outside_tube", "capture_time", "input_rms", "k_end")
_SCALARS: Scalars = {
    "x_end": CHAIN["x_end"],
    "v_end": CHAIN["v_end"],
    "k_end": (
        "count",
        "gain at the end; of a funnel controller its momentary one, `gain` · *k*<sub>1</sub>",
    ),
    "filter_end": ("length", "*θ* at the end; unknown without a filter"),
    "distance": CHAIN["distance"],
    "mean_speed": CHAIN["mean_speed"],
    **TRACKED,
    **CHAIN,
}


class TrackScene(SceneTable, frozen=True, kw_only=True):
    """A chain whose links follow a gait, by one tracker or by several side by side.

    Every controller has the worm for itself. With several trackers every scalar is a list with one
    entry per tracker, in their order in the scene; the attribute `trackers` holds their names.
    `timings_s`: `simulate` and `recheck`. What the trust report says:
    [simulations](../scenes.md#the-trust-report-of-a-simulation).

    With `[ensemble]` scalars are medians over the members (entry by entry; `capture_time` is
    unknown where most are never captured), `input_peak` is that of the samples, `recheck_error`
    the largest of the members rechecked (first, slowest, fastest). What of a member is unknown is
    not a number in its variables; the quantiles of bands are 0.05, 0.25, 0.5, 0.75, 0.95.

    `contact_force` at rest is what holds the mass; `funnel` is not a number for other trackers.
    `event_kind` counts from 0: reversal, stick, release, impact, switch (a crossing of the tube);
    rests are known for exact contact only.
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
        "distance_quantiles": ("length", "of 5, 25, 50, 75 and 95 % of the members (ensemble)"),
        "captured_share": ("share", "members that are in the tube at the end (ensemble)"),
        "members": ("count", "members that came to the end (ensemble)"),
    }
    variables: ClassVar = {
        **TIME,
        **REFERENCE,
        **over(LOOP_SIGNALS, "tracker"),
        **TRACKER_EVENTS,
        **GAIT,
        "quantile": ("share", ("quantile",), "share of members below"),
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
    want: Annotated[
        tuple[Literal["trackers", "motion", "bands"], ...],
        says(
            "",
            "`trackers`: outputs with the *λ*-strip, error, gain, inputs, motion (as the chapter's "
            "figures 5 to 8 are ordered); `motion`: paths, time upward, heavy where a mass rests; "
            "with `[ensemble]` `bands` instead",
        ),
    ] = ()
    worm: Annotated[ChainTable, says("", "the worm")]
    start: Annotated[Start, says("", "where it starts")] = field(default_factory=Start)
    reference: Annotated[Reference, says("", "what its links shall do")]
    tracker: Annotated[
        Tracker | tuple[Tracker, ...],
        says("", "the controller, or `[[tracker]]` once for each; `feedback` says which it is"),
    ]
    contact: Contacts = field(default_factory=ExactContact)
    time: Horizon
    tolerance: Tolerances = field(default_factory=ToleranceTable)
    ensemble: Annotated[EnsembleTable | None, says("", "many worms at a time; one if left out")] = (
        None
    )

    @property
    def trackers(self) -> tuple[Tracker, ...]:
        """The controllers as a list, also where there is one."""
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
            yield "tracker", "there is none; write at least one [[tracker]]"
        for index, tracker in enumerate(self.trackers):
            yield from tracker.faults(self.tracker_key(index), links)
            yield from faults_of_lag(self.tracker_key(index), tracker, self.time.end)
        yield from self._faults_of_ensemble()

    def _faults_of_ensemble(self) -> Iterator[Fault]:
        if self.ensemble is None:
            if "bands" in self.want:
                yield "want", '"bands" shows an ensemble; write [ensemble] members = 200'
            return
        if self.worm.random is None:
            yield "ensemble", "all members would be alike; write [worm.random]"
        for word in ("trackers", "motion"):
            if word in self.want:
                yield (
                    "want",
                    f'"{word}" shows a single worm; write "bands", or leave out [ensemble]',
                )


def faults_of_lag(key: str, tracker: Tracker, end: float) -> Iterator[Fault]:
    """Yield a lag that is too short for a motion from 0 to `end`; `key` is the tracker's path."""
    if isinstance(tracker, DifferenceTracker) and end / tracker.lag > _MOST_STRETCHES:
        least = end / _MOST_STRETCHES
        yield (
            f"{key}.lag",
            f"cuts the time into {end / tracker.lag:.2g} stretches; write {least:g} or more, or "
            'feedback = "derivative", to which short lags tend',
        )


def _faults_of_feedforward(
    key: str, feedforward: FeedForwardTable | None, links: int
) -> Iterator[Fault]:
    if feedforward is not None:
        for name in feedforward.__struct_fields__:
            value = getattr(feedforward, name)
            yield from wrong_count(f"{key}.feedforward.{name}", value, links, "links")
