"""Tables of scenes of kind "track": links that follow a gait by an adaptive controller."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import field

from wormopt.errors import Fault
from wormopt.study.given import Given, entry, number, positive, says, whole, wrong_count
from wormopt.study.numerics import (
    Contacts,
    ExactContact,
    Horizon,
    Start,
    Tolerances,
    ToleranceTable,
)
from wormopt.study.types import (
    FinitePerLink,
    NonNegativePerLink,
    SceneTable,
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


class Reference(Given):
    """Reference of the link lengths."""

    gait: Shape = entry("the gait; `shape` selects the other keys")
    shift: float = number(
        "time", "time shift: the reference at time *t* is the gait at *t* + `shift`", default=0.0
    )


class ExponentLaw(Given, tag_field="law", tag="exponent"):
    """*k*′ = *γ* [|*e*| − *λ*]<sub>+</sub> |*e*|<sup>*r*−1</sup>."""

    exponent: float = number("1", "*r*", least=1, most=100)


class DecayLaw(Given, tag_field="law", tag="decay"):
    """Gain law with two exponents; the gain decays after the error has stayed in the tube.

    *k*′ = *γ* (|*e*| − *λ*)² if |*e*| ≥ *λ* + 1, and *γ* √(|*e*| − *λ*) if *λ* ≤ |*e*| < *λ* + 1.
    In the tube *k*′ = 0, and −*σ k* after the time `dwell`.
    """

    dwell: float = positive("time", "time in the tube before the gain decays")
    decay: float = number("rate", "*σ*, decay rate", least=0)


class QuadraticLaw(Given, tag_field="law", tag="quadratic"):
    """*k*′ = *γ* ([|*e*| − *λ*]<sub>+</sub>)², the gain law of Zimmermann et al. 2007."""


_OWN = "value in the controller's model of the links; default: the worm's value"


class FeedForwardTable(Given):
    """Feed-forward *c*(*y*<sub>ref</sub> − *l*<sub>0</sub>) + *d y*<sub>ref</sub>′.

    This force would hold links with these parameters on the reference. Parameters default to the
    worm's values; `feedforward = {}` uses all of them.
    """

    stiffness: NonNegativePerLink | None = entry(f"*c*, {_OWN}", quantity="stiffness", default=None)
    damping: NonNegativePerLink | None = entry(f"*d*, {_OWN}", quantity="drag", default=None)
    rest_length: NonNegativePerLink | None = entry(
        f"*l*<sub>0</sub>, {_OWN}", quantity="length", default=None
    )


# A stretch takes about a millisecond.
_MOST_STRETCHES = 1e5

Name = Annotated[str, says("", "name in pictures; default: by its kind")]
FeedForwardOrNone = Annotated[
    FeedForwardTable | None, says("", "feed-forward force; default: none")
]


Input = Annotated[
    Literal["force", "rest_length"],
    says(
        "",
        "meaning of the controller's *u*: the actuator's force, or the change of the link's rest "
        "length (eq. 11), with the force *c*<sub>j</sub>*u*<sub>j</sub>",
    ),
]


class LambdaTracker(Given, tag_field="feedback"):
    """Keys that both λ-trackers share."""

    name: Name = ""
    tube_radius: float = positive("length", "*λ*")
    gain_start: float = positive("", "*k*(0)", default=1.0)
    growth: float = positive("", "*γ*", default=1.0)
    adaptation: QuadraticLaw | ExponentLaw | DecayLaw = entry(
        'gain law; default: `{ law = "quadratic" }`', default=QuadraticLaw
    )
    input: Input = "force"
    feedforward: FeedForwardOrNone = None

    def faults(self, key: str, links: int) -> Iterator[Fault]:
        """Yield conflicts with a worm of this number of links; `key` is the path of this table."""
        yield from _faults_of_feedforward(key, self.feedforward, links)


class DerivativeTracker(LambdaTracker, tag="derivative"):
    """Tracker (13) of Zimmermann et al. 2007, which measures the rates of the links.

    It uses *e* = *y* − *y*<sub>ref</sub> and the Euclidean norm. Its parameters refer to the
    scene's units of time and length, since it adds *k e* and (*k e*)′.
    """


class FilterTracker(LambdaTracker, tag="filter"):
    """Tracker (14) of Zimmermann et al. 2007, which estimates the rates of the links by a filter.

    Its parameters refer to the scene's units of time and length, since it adds *k θ* and (*k θ*)′.
    """

    filter_start: FinitePerLink = entry("*θ*(0)", quantity="length", default=1.0)

    def faults(self, key: str, links: int) -> Iterator[Fault]:
        """Yield conflicts with a worm of this number of links; `key` is the path of this table."""
        yield from super().faults(key, links)
        yield from wrong_count(f"{key}.filter_start", self.filter_start, links, "links")


class DifferenceTracker(LambdaTracker, tag="difference"):
    """Tracker (13) with the difference (*e*(*t*) − *e*(*t* − *h*))/*h* in place of *e*′.

    It does not measure rates. Before the start, the error is constant. The loop is a delay
    equation, simulated by the method of steps. It is unstable at high gain: *k h* must be small
    compared with the masses.
    """

    lag: float = positive("time", "*h*; the simulation has a stretch for each lag")


class BacksteppingTracker(LambdaTracker, tag="backstepping"):
    """Backstepping tracker of Ye (1999), which filters the input.

    The form is that of Ilchmann, Ryan and Townsend (2007): *u* = −*k e* − (*k*² + |*e*|²) *k*⁴ (1 +
    |*ξ*|²)(*ξ* + *k e*), *ξ*′ = −*ξ* + *u*, *ξ*(0) = 0. It does not measure rates. Powers of the
    gain up to *k*⁷ make it stiff, so it needs a tube that small gains can keep.
    """


class SwitchingTracker(Given, tag_field="feedback", tag="switching"):
    """Switching tracker after Miller and Davison (1991): the gain jumps up after a failed trial.

    *θ*′ = *k*²(*e* − *θ*), *u* = −(*k*²*θ* + *k θ*′). It does not measure rates. Each trial has a
    settling time. A trial fails if |*e*| exceeds its bound: slightly more than its initial value
    before the settling time, the tube radius after it. `settling` is the sum of all settling times,
    `overshoot` the sum of all additions to the bounds. [theory-dynamics.md](../theory-dynamics.md)
    states which details are an interpretation.
    """

    name: Name = ""
    tube_radius: float = positive("length", "*λ*")
    settling: float = positive("time", "upper limit of the time outside the tube")
    overshoot: float = positive(
        "length", "amount by which |*e*| may exceed its initial value, or *λ*"
    )
    gain_start: float = positive("", "*k*(0)", default=1.0)
    factor: float = number(
        "1", "ratio of each gain to the previous gain", least=1.01, most=100, default=2.0
    )
    filter_start: FinitePerLink | None = entry(
        "*θ*(0); default: the initial error", quantity="length", default=None
    )
    input: Input = "force"
    feedforward: FeedForwardOrNone = None

    def faults(self, key: str, links: int) -> Iterator[Fault]:
        """Yield conflicts with a worm of this number of links; `key` is the path of this table."""
        yield from _faults_of_feedforward(key, self.feedforward, links)
        if self.filter_start is not None:
            yield from wrong_count(f"{key}.filter_start", self.filter_start, links, "links")


class FunnelTable(Given):
    """Bound `end` + (`start` − `end`) exp(−*t*/`time`) on a norm."""

    start: float = positive("", "width at time 0: a length, or a speed for `rate_funnel`")
    end: float = positive("", "final width")
    time: float = positive("time", "time constant of the decrease")


class FunnelTracker(Given, tag_field="feedback", tag="funnel"):
    """Funnel controller: the error and its rate stay within bounds that shrink in time.

    The error stays within `funnel`, and *e*<sub>1</sub> within `rate_funnel`. In the law
    `recursive` (Berger, Lê, Reis 2018), *e*<sub>1</sub> is *e*′ + *k*<sub>0</sub> *e*, and *u* =
    −`gain` *k*<sub>1</sub> *e*<sub>1</sub>. In the law `two gains` (Hackl, Hopfe, Ilchmann,
    Mueller, Trenn 2013), *e*<sub>1</sub> is *e*′, and *u* = −`gain` (*k*<sub>0</sub>² *e* +
    *k*<sub>1</sub> *e*′). Not allowed: a start outside a funnel; for `two gains` also a rate funnel
    below the rate at which the error funnel shrinks.
    """

    name: Name = ""
    funnel: FunnelTable = entry("bounds on the error")
    rate_funnel: FunnelTable = entry("bounds on *e*<sub>1</sub>")
    law: Literal["recursive", "two gains"] = entry(
        "`recursive` or `two gains`", default="recursive"
    )
    gain: float = positive("drag", "force per speed in the middle of the funnels", default=1.0)
    tube_radius: float | None = positive(
        "length",
        "tube radius for the evaluation, unknown to the controller; default: `funnel.end`",
        default=None,
    )
    input: Input = "force"
    feedforward: FeedForwardOrNone = None

    def faults(self, key: str, links: int) -> Iterator[Fault]:
        """Yield conflicts with a worm of this number of links; `key` is the path of this table."""
        yield from _faults_of_feedforward(key, self.feedforward, links)


Tracker = (
    FilterTracker
    | DerivativeTracker
    | DifferenceTracker
    | BacksteppingTracker
    | SwitchingTracker
    | FunnelTracker
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


def faults_of_lag(key: str, tracker: Tracker, end: float) -> Iterator[Fault]:
    """Yield a fault for a lag that is too short for a motion from 0 to `end`.

    `key` is the tracker's path.
    """
    if isinstance(tracker, DifferenceTracker) and end / tracker.lag > _MOST_STRETCHES:
        least = end / _MOST_STRETCHES
        yield (
            f"{key}.lag",
            f"cuts the time into {end / tracker.lag:.2g} stretches; write {least:g} or more, or "
            'feedback = "derivative", which is the limit of short lags',
        )


def _faults_of_feedforward(
    key: str, feedforward: FeedForwardTable | None, links: int
) -> Iterator[Fault]:
    if feedforward is not None:
        for name in feedforward.__struct_fields__:
            value = getattr(feedforward, name)
            yield from wrong_count(f"{key}.feedforward.{name}", value, links, "links")
