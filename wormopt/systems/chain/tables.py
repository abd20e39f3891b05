"""Tables of chains: masses on visco-elastic links, friction, random links, trackers."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Any, Literal

from wormopt.errors import Fault
from wormopt.study.given import Given, entry, number, positive, says, whole, wrong_count
from wormopt.study.types import (
    FinitePerLink,
    FinitePerMass,
    NonNegativePerLink,
    NonNegativePerMass,
    PerMass,
    Seed,
    per,
)
from wormopt.systems.shared.gravity import (
    Gravity,
    Inclined,
    facts_of_slope,
    faults_of_slope,
    weights,
)
from wormopt.systems.spiked import Shape

# Upper limit of the pieces of a random parameter's path; more would fill the memory.
_MOST_PIECES = 1_000_000


Forward = Annotated[
    NonNegativePerMass, says("force", "sliding force *F*<sub>+</sub> against forward motion")
]
Backward = Annotated[
    NonNegativePerMass, says("force", "sliding force *F*<sub>−</sub> against backward motion")
]


class CoulombFriction(Given, tag_field="kind", tag="coulomb"):
    """Dry friction with stiction, different in the two directions of motion.

    It is eq. 9 of Zimmermann et al. 2007. Forces are ≥ 0. In a table for all masses, each value is
    a number for all masses or a list with one number per mass. Sliding masses feel *F*<sub>+</sub>
    or *F*<sub>−</sub>; at rest the force is at most the stiction. Not allowed: stiction below the
    sliding force.
    """

    forward: Forward
    backward: Backward
    stick_forward: NonNegativePerMass | None = entry(
        "stiction *F*<sub>s+</sub>; default: the sliding force", quantity="force", default=None
    )
    stick_backward: NonNegativePerMass | None = entry(
        "stiction *F*<sub>s−</sub>; default: the sliding force", quantity="force", default=None
    )


class StribeckFriction(Given, tag_field="kind", tag="stribeck"):
    """Dry friction whose sliding force decreases with speed, starting from stiction.

    Not allowed: stiction below the sliding force.
    """

    forward: Forward
    backward: Backward
    stick_forward: NonNegativePerMass = entry("stiction *F*<sub>s+</sub>", quantity="force")
    stick_backward: NonNegativePerMass = entry("stiction *F*<sub>s−</sub>", quantity="force")
    v_stribeck: PerMass = entry("velocity over which the force decreases", quantity="speed")


class ViscousFriction(Given, tag_field="kind", tag="viscous"):
    """Linear drag −*k v*, without stiction."""

    drag: NonNegativePerMass = entry("*k*", quantity="drag")


class SpikeFriction(Given, tag_field="kind", tag="spike"):
    """Spikes that prevent backward motion (eq. 4 of Zimmermann et al. 2007).

    The force against forward motion is 0; the force against backward motion is unlimited.
    """

    scale: PerMass = entry(
        "scale of the *smooth* replacement only: load that it carries at *v* = −3/4 `v_reg`",
        quantity="force",
        default=1.0,
    )


Friction = CoulombFriction | StribeckFriction | ViscousFriction | SpikeFriction

# Spreads and deviations have the unit of their parameter.
_SPREAD = says("", "half width of the range, in units of the parameter")


class FixedDraw(Given, tag_field="process", tag="fixed"):
    """Value drawn once for each link, uniform within ± `spread` of the worm's value.

    Not allowed: a `spread` that is not below the mean.
    """

    spread: Annotated[NonNegativePerLink, _SPREAD]


class Steps(Given, tag_field="process", tag="steps"):
    """Value drawn anew after every interval, uniform within ± `spread` of the worm's value.

    Not allowed: a `spread` that is not below the mean; more than a million pieces.
    """

    spread: Annotated[NonNegativePerLink, _SPREAD]
    interval: float = positive("time", "time between two changes")


class Wandering(Given, tag_field="process", tag="ornstein_uhlenbeck"):
    """Value whose logarithm is a stationary Ornstein-Uhlenbeck process.

    The mean is the worm's value; `deviation` is the standard deviation. The path is exact at
    multiples of `step` and linear between them. Not allowed: a `deviation` around 0; more than a
    million pieces.
    """

    deviation: NonNegativePerLink = entry("standard deviation, in units of the parameter")
    correlation_time: float = positive("time", "time after which the correlation decays to 1/e")
    step: float = positive("time", "time step of the path")


Process = FixedDraw | Steps | Wandering
# Random deviation of a parameter from its mean, which is the worm's value.
Chance = Annotated[
    Process | None,
    says("", "random deviation from the mean, which is the worm's value; default: not random"),
]


class RandomLinks(Given):
    """Random parameters of the links. Parameters without a table are not random.

    Links are independent of each other. The same seed gives the same worm.
    """

    seed: Seed = entry("seed of the random parameters", default=0)
    stiffness: Chance = None
    damping: Chance = None
    rest_length: Chance = None

    @property
    def processes(self) -> dict[str, Process]:
        """Random processes by parameter."""
        found = {
            "stiffness": self.stiffness,
            "damping": self.damping,
            "rest_length": self.rest_length,
        }
        return {name: process for name, process in found.items() if process is not None}


class ChainTable(Given):
    """A chain of *n* + 1 point masses and *n* visco-elastic links with actuators.

    It is the worm of eqs. 8 to 12 of Zimmermann et al. 2007. The ground resists its motion. Theory:
    [theory-dynamics.md](../theory-dynamics.md). The same model in Python:
    [simulation.md](../simulation.md). Not allowed: a list of `friction` tables whose length is not
    the number of masses; a list of numbers in a table for one mass.
    """

    links: int = whole(1, 100, "number of links *n*; mass 0 is the head")
    mass: PerMass = entry("point masses *m*<sub>i</sub>", quantity="mass")
    stiffness: NonNegativePerLink = entry("spring constants *c*<sub>j</sub>", quantity="stiffness")
    damping: NonNegativePerLink = entry("dashpot constants *d*<sub>j</sub>", quantity="drag")
    rest_length: NonNegativePerLink = entry(
        "*l*<sub>0j</sub>, length of the link without force", quantity="length"
    )
    drag: NonNegativePerMass = entry("viscous drag *k*<sub>i</sub>", quantity="drag", default=0.0)
    load: FinitePerMass = entry(
        "*Γ*<sub>i</sub>, force against forward motion; negative downhill",
        quantity="force",
        default=0.0,
    )
    slope: Inclined = 0.0
    gravity: Gravity = None
    friction: Friction | tuple[Friction, ...] | None = entry(
        "friction law of the ground: a table for all masses, or a list with one table per "
        "mass; default: no friction",
        default=None,
    )
    random: RandomLinks | None = entry(
        "random parameters of the links; default: none", default=None
    )

    @property
    def ground(self) -> tuple[Friction, ...]:
        """Friction of every mass, head first; empty without friction."""
        if self.friction is None:
            return ()
        if isinstance(self.friction, tuple):
            return self.friction
        return (self.friction,) * (self.links + 1)

    @property
    def pull(self) -> float | tuple[float, ...]:
        """Load and weight of each mass along the ground, against forward motion."""
        if not self.slope:
            return self.load
        masses, loads = (per(given, self.links + 1) for given in (self.mass, self.load))
        pull = weights(self.slope, self.gravity, masses)
        return tuple(map(sum, zip(loads, pull, strict=True)))

    @property
    def resists_nothing(self) -> bool:
        """Whether neither ground, drag, load nor weight acts on a mass that moves forward."""
        own = (getattr(law, key, 0.0) for law in self.ground for key in ("forward", "drag"))
        given = (*own, self.drag, self.load, self.slope)
        return not any(any(each) if isinstance(each, tuple) else each for each in given)

    @property
    def facts(self) -> dict[str, Any]:
        """Facts on the weight along the slope."""
        return facts_of_slope(self.slope, self.gravity, per(self.mass, self.links + 1))

    def faults(self, horizon: float, units: str) -> Iterator[Fault]:
        """Yield conflicts between the keys of this table."""
        yield from faults_of_slope(self.slope, self.gravity, units)
        for name in ("mass", "drag", "load"):
            yield from wrong_count(f"worm.{name}", getattr(self, name), self.links + 1, "masses")
        for name in ("stiffness", "damping", "rest_length"):
            yield from wrong_count(f"worm.{name}", getattr(self, name), self.links, "links")
        yield from self._faults_of_friction()
        if self.random:
            yield from self._faults_of_chance(self.random, horizon)

    def _faults_of_friction(self) -> Iterator[Fault]:
        if not isinstance(self.friction, tuple):
            if self.friction:
                yield from faults_of_law("worm.friction", self.friction, self.links + 1)
            return
        yield from wrong_count("worm.friction", self.friction, self.links + 1, "masses", "table")
        for i, law in enumerate(self.friction):
            for name in law.__struct_fields__:
                if isinstance(getattr(law, name), tuple):
                    yield (
                        f"worm.friction[{i}].{name}",
                        "is a list in a table for one mass; write a number",
                    )
                    return
            yield from faults_of_law(f"worm.friction[{i}]", law, 1)

    def _faults_of_chance(self, random: RandomLinks, horizon: float) -> Iterator[Fault]:
        if not random.processes:
            yield "worm.random", "contains nothing random; write stiffness, damping or rest_length"
        for name, process in random.processes.items():
            key = f"worm.random.{name}"
            wanders = isinstance(process, Wandering)
            width = "deviation" if wanders else "spread"
            mean, spread = getattr(self, name), getattr(process, width)
            wrong = list(wrong_count(f"{key}.{width}", spread, self.links, "links"))
            yield from wrong
            if wrong or any(wrong_count(name, mean, self.links, "links")):
                continue
            pairs = list(zip(per(mean, self.links), per(spread, self.links), strict=True))
            if wanders and any(m <= 0 for m, _ in pairs):
                yield (
                    f"{key}.deviation",
                    f"needs a positive mean, but worm.{name} is 0; write a positive worm.{name}",
                )
            elif not wanders and any(s > 0 and s >= m for m, s in pairs):
                yield (
                    f"{key}.spread",
                    f"is not below worm.{name}, so {name} may not stay above 0; write less",
                )
            step = {Steps: "interval", Wandering: "step"}.get(type(process))
            if step and horizon / getattr(process, step) > _MOST_PIECES:
                yield f"{key}.{step}", f"makes more than {_MOST_PIECES} pieces; write a longer one"


def held_at_rest(law: Friction) -> tuple[float, float]:
    """Largest friction forces on a mass at rest that is pushed forward and backward."""
    if isinstance(law, SpikeFriction):
        return 0.0, math.inf
    if isinstance(law, ViscousFriction):
        return 0.0, 0.0
    forward = law.forward if law.stick_forward is None else law.stick_forward
    backward = law.backward if law.stick_backward is None else law.stick_backward
    return per(forward, 1)[0], per(backward, 1)[0]


def faults_of_law(key: str, law: Friction, masses: int) -> Iterator[Fault]:
    """Yield what is wrong between the parameters of a friction law.

    `key` is the key path of its table, `masses` the number of masses.
    """
    wrong = [
        fault
        for name in law.__struct_fields__
        for fault in wrong_count(f"{key}.{name}", getattr(law, name), masses, "masses")
    ]
    yield from wrong
    if wrong:
        return
    for side in ("forward", "backward"):
        stick = getattr(law, f"stick_{side}", None)
        if stick is None:
            continue
        slide = getattr(law, side)
        if any(s < f for f, s in zip(per(slide, masses), per(stick, masses), strict=True)):
            message = f"stiction is below the sliding force {side}; write at least that force"
            yield f"{key}.stick_{side}", message


# -- references and trackers -----------------------------------------------------------------------


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
    gain_start: float = positive(
        "", "*k*(0), force per length; in SI scenes choose for example *F*/(10 *λ*), see `growth`",
        default=1.0,
    )  # fmt: skip
    growth: float = positive(
        "",
        "*γ*, of the quadratic law force per length cubed and time; in SI scenes begin with "
        "*F*/(*λ*³ *T*), with a force *F* that the reference needs and its period *T*, see "
        "[theory-dynamics.md](../theory-dynamics.md)",
        default=1.0,
    )
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


def faults_of_lag(key: str, tracker: Tracker, end: float) -> Iterator[Fault]:
    """Yield a fault for a lag that is too short for a motion from 0 to `end`."""
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


# -- optimal tracking ------------------------------------------------------------------------------


class Tube(Given):
    """Tube around the reference, and the time from which the error must stay in it."""

    radius: float = positive("length", "*λ*")
    capture: float = number(
        "time",
        "time from which |*e*| ≤ *λ* is required or judged; before the end of the motion",
        least=0,
        default=0.0,
    )

    def faults_in(self, end: float) -> Iterator[Fault]:
        """Yield a capture that is not before the end of the motion."""
        if self.capture >= end:
            yield "tube.capture", f"is not before the end of the motion, {end:g}; write less"


class LeastError(Given, tag_field="minimise", tag="error"):
    """Minimises ∫(|*e*|² + *ρ*|*u*|²) d*t*; |·| is the Euclidean norm over the links."""

    input_weight: float = positive("", "*ρ*")


class LeastInput(Given, tag_field="minimise", tag="input"):
    """Minimises ∫|*u*|² d*t* with the error in the tube from `tube.capture` on."""

    margin: float = number(
        "share",
        "share of *λ* kept free for the error between grid points and for the relaxation of "
        "complementarity",
        least=0,
        below=1,
        default=0.02,
    )


class Grid(Given):
    """Grid of the optimiser, with a constant input on each arc."""

    arcs: int = whole(
        1,
        1000,
        "least number of arcs per period of the reference; breaks of the reference lie "
        "between arcs",
        default=30,
    )
    degree: int = whole(
        1, 5, "polynomial degree of the states on each arc (Radau collocation)", default=2
    )


class Relaxation(Given):
    """Largest product of speed and force, in usual sizes, that the relaxed complementarity allows.

    Each solve divides it by ten, from `first` down to `last`. Not allowed: `last` above `first`.
    """

    first: float = positive("1", "product in the first solve", default=0.1)
    last: float = positive("1", "product in the last solve", default=1e-3)
    time_limit: float = positive("s", "processor time limit of each of the solves", default=60.0)

    def faults_of_keys(self) -> Iterator[Fault]:
        if self.last > self.first:
            yield "last", f"is above relaxation.first = {self.first:g}; write less"


Strips = Literal["outputs", "norm", "both"]


class Criteria(Given):
    """Criteria by which a sentence of the text counts as supported."""

    strips: Strips = entry(
        "criterion of capture: `outputs`, every \\|*e*<sub>j</sub>\\| ≤ *λ*, as the strips of "
        "figure 5; `norm`, the Euclidean \\|*e*\\| ≤ *λ*, at which gains stop growing; "
        "`both`: either of the two supports a sentence",
        default="both",
    )
    quick: float = positive("time", "time within which tracker (13) captures the outputs")
    window: float = positive(
        "time",
        "length of the final interval: outputs that leave their strips in it are not "
        "captured; growth of gains and errors refer to it",
    )
    settled: float = number("share", "largest growth of a converged gain", least=0)
    growing: float = positive("share", "least growth of a gain that still increases")
