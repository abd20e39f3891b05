"""The problem of gait design: worm, limits, objective, and how to search and to prove.

Each class is a table of scenes and an object of Python. Keys, units, meanings, bounds and defaults
are declared here only. `DesignTable` is the base of the kinds that design gaits.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

from msgspec import Meta, structs

from wormopt.errors import ArgumentError, Fault
from wormopt.model.given import check_choice, per, wrong_order
from wormopt.study import Given, Study, entry, number, positive, whole
from wormopt.study.given import wrong_count
from wormopt.study.types import Loads, NonNegativePerMass, PerMass, Seed
from wormopt.systems.shared.gravity import Gravity, Uphill, facts_of_slope, faults_of_slope, weights
from wormopt.systems.spiked.limits import MOST_LINKS, GaitLimits, Limits
from wormopt.systems.spiked.stepper.stepper import Motor

Cost = Literal[
    "peak_spike_load", "peak_actuator_force", "energy_per_distance", "acceleration_effort"
]
Effort = Literal["quick", "normal", "thorough"]
Links = Annotated[
    int, Meta(ge=1, le=MOST_LINKS, description=f"a whole number from 1 to {MOST_LINKS}")
]
Order = Annotated[
    tuple[tuple[Annotated[int, Meta(ge=0, le=MOST_LINKS)], ...], ...],
    Meta(description="a list of lists of mass indices, for example [[0], [2], [1]]"),
]
COST_WORDS = (
    "`peak_spike_load` (force): largest load on one spike over time and masses; "
    "`peak_actuator_force` (force): largest |*μ*<sub>j</sub>| over time and links; "
    "`energy_per_distance`: ∫ Σ<sub>j</sub> max(0, *P*<sub>j</sub>) d*t* over a period divided by "
    "the advance, without recovery; `acceleration_effort` (acceleration squared): mean over time "
    "of Σ<sub>j</sub> *l*<sub>j</sub>″²"
)
_NO_OBJECTIVE = 'no objective is given; write maximise = "speed", or minimise and speed'


_MASS = "point masses *m*<sub>i</sub>; mass 0 is the head"


class Worm(Given, kw_only=False):
    """A chain of *n* + 1 point masses on the ground, joined by *n* links.

    The link lengths are prescribed. Spikes on every mass let it slide forward but never backward.

    Examples
    --------
    >>> worm = Worm(links=2, load=(2.0, 5.0))
    >>> worm.masses, worm.load_range
    ((1.0, 1.0, 1.0), (2.0, 5.0))
    """

    links: Links = entry("number of links *n*", quantity="count")
    mass: PerMass = entry(_MASS, quantity="mass", default=1.0, per="masses")
    drag: float = number("drag", "*k*: each mass has viscous drag −*k v*", least=0, default=0.0)
    load: Loads = entry(
        "*Γ*: force against the direction of motion (towed load, slope); one number acts on "
        "each mass. A pair is a range, for one link too (`pull` takes its two masses), and is "
        "allowed in designs only: the designed gait meets its limits over the whole range. "
        "Three or more numbers are the loads of the individual masses, head first. Example: "
        "a cable at the tail of a worm with two links is [0, 0, 0.3]",
        quantity="force",
        default=0.0,
    )
    pull: NonNegativePerMass | None = entry(
        "force on each mass in addition to `load`, one number for all or one per mass, for "
        "example beside a range of loads",
        quantity="force",
        default=None,
        per="masses",
    )
    slope: Uphill = 0.0
    gravity: Gravity = None

    @property
    def counts(self) -> dict[str, int]:
        """Numbers of links and masses."""
        return {"links": self.links, "masses": self.links + 1}

    @property
    def masses(self) -> tuple[float, ...]:
        """Mass of each point mass, head first."""
        return per(self.mass, self.links + 1)

    @property
    def facts(self) -> dict[str, Any]:
        """Effect of the weight on a slope, for the trust report."""
        return facts_of_slope(self.slope, self.gravity, self.masses)

    @property
    def load_range(self) -> tuple[float, float]:
        """Smallest and largest load on each mass; their mean over the masses if these differ.

        Both are equal if the load is known. The motion depends on the mean alone.
        """
        fixed = _mean(self._known)
        low, high = per(self.load, 2) if self._may_vary else (0.0, 0.0)
        return low + fixed, high + fixed

    @property
    def _may_vary(self) -> bool:
        """Whether the load is one number for all masses, or a range."""
        return not isinstance(self.load, tuple) or len(self.load) == 2

    @property
    def _known(self) -> tuple[float, ...]:
        """Force on each mass in addition to a number or range for all, weight included."""
        masses = self.links + 1
        known = [per(self.pull or 0.0, masses)]
        known += [weights(self.slope, self.gravity, self.masses)] if self.slope else []
        known += [] if self._may_vary else [per(self.load, masses)]
        return tuple(map(sum, zip(*known, strict=True)))

    @property
    def beyond(self) -> tuple[float, ...]:
        """Load of each mass minus the mean over all masses; they sum to 0."""
        mean = _mean(self._known)
        return tuple(each - mean for each in self._known)

    def loads(self, mean: float) -> float | tuple[float, ...]:
        """Load on each mass (n+1,) for a given mean; one number if all are equal.

        Parameters
        ----------
        mean : float
            Mean load, within `load_range`.
        """
        beyond = self.beyond
        return tuple(mean + each for each in beyond) if any(beyond) else mean

    @property
    def on_level_ground(self) -> Worm:
        """The worm without slope, with its weight in `load`, or in `pull` if masses differ."""
        if not self.slope:
            return self
        weight, flat = weights(self.slope, self.gravity, self.masses), {"slope": 0.0}
        if len(set(weight)) == 1:
            heavier = tuple(one + weight[0] for one in per(self.load, 1))
            load = heavier if isinstance(self.load, tuple) else heavier[0]
            return structs.replace(self, load=load, **flat)
        pull = per(self.pull or 0.0, len(weight))
        pull = tuple(a + b for a, b in zip(pull, weight, strict=True))
        return structs.replace(self, pull=pull, **flat)

    def faults_of_keys(self) -> Iterator[Fault]:
        """Yield a load that is neither a range nor one per mass."""
        if self._may_vary:
            yield from wrong_order("load", per(self.load, 2))
        else:
            yield from wrong_count("load", self.load, self.links + 1, "masses")

    def faults_in_scene(self, units: str, *, ranges: bool = False) -> Iterator[Fault]:
        """Yield what is wrong in a scene in `units`; `ranges`: whether the load may be a range.

        Parameters
        ----------
        units : str
            Units of the scene.
        ranges : bool, optional
            Whether the load may be a range.
        """
        yield from faults_of_slope(self.slope, self.gravity, units)
        if isinstance(self.load, tuple) and self._may_vary and not ranges:
            yield (
                "worm.load",
                "a range of loads is allowed in gait designs only; write one number, or one load "
                "for each of three or more masses",
            )


def _mean(each: tuple[float, ...]) -> float:
    """Mean of numbers; exact if they are equal."""
    return each[0] if len(set(each)) == 1 else sum(each) / len(each)


class SceneWorm(Worm):
    """The worm of a scene; its masses are required."""

    mass: PerMass = entry(_MASS, quantity="mass", per="masses")


class Objective(Given, kw_only=False):
    """The objective: exactly one of `maximise` and `minimise`.

    Refused: no objective or two; `minimise` without `speed`; any cost with `impulses = true`, where
    costs are infinite; `energy_per_distance` and `acceleration_effort` with a range of loads,
    because they depend on the load.

    Examples
    --------
    Without arguments the mean speed is maximised:

    >>> Objective() == Objective.of("speed"), Objective.of("peak_spike_load", 0.5).speed
    (True, 0.5)
    """

    minimise: Cost | None = entry(
        f"minimise a cost at a required speed: {COST_WORDS}", default=None
    )
    speed: float | None = positive(
        "speed",
        "required mean speed, a lower bound; required with `minimise`, refused with `maximise`",
        default=None,
    )
    maximise: Literal["speed"] | None = entry("maximise the mean speed", default=None)

    @classmethod
    def of(cls, what: Literal["speed"] | Cost | Objective, speed: float | None = None) -> Objective:
        """Make an objective from its name.

        Parameters
        ----------
        what : str or Objective
            "speed", or the cost to minimise; an Objective is returned unchanged.
        speed : float, optional
            Required mean speed if a cost is minimised.

        Raises
        ------
        ArgumentError
            If `what` is not an objective, or `speed` is given for an objective that has none.
        """
        if isinstance(what, Objective):
            if speed is None:
                return what
            raise ArgumentError("speed is given, but the objective has its own; remove one of them")
        costs = get_args(Cost)
        check_choice("objective", what, ("speed", *costs))
        if what == "speed" and speed is not None:
            raise ArgumentError(
                "speed is given, but the mean speed is maximised; leave it out, or minimise a cost "
                f'at this speed, for example objective="{costs[0]}"'
            )
        return cls(None if what == "speed" else what, speed)

    @property
    def is_smooth(self) -> bool:
        """Whether it is energy or effort, for which there are no proofs and multipliers."""
        return _is_smooth(self.minimise)

    @property
    def quantity(self) -> str:
        """Physical quantity of the objective, a name for `unit_of`."""
        of_smooth = {
            "energy_per_distance": "energy_per_distance",
            "acceleration_effort": "acceleration_squared",
        }
        return "speed" if self.minimise is None else of_smooth.get(self.minimise, "force")

    def faults_of_keys(self) -> Iterator[Fault]:
        """Yield conflicts between the keys of this table."""
        if self.minimise is None and self.maximise is None:
            if self.speed is not None:
                yield "", _NO_OBJECTIVE
        elif self.minimise is not None and self.maximise is not None:
            yield "", "maximise and minimise are given; write only one of them"
        elif self.minimise is not None and self.speed is None:
            yield (
                "speed",
                "missing; minimise needs the required speed: write a finite number above 0",
            )
        elif self.maximise is not None and self.speed is not None:
            yield "speed", 'given with maximise = "speed"; remove one of them'

    def faults_in_scene(self) -> Iterator[Fault]:
        """Yield a fault of a scene that does not say its objective."""
        if self == Objective():
            yield "objective", _NO_OBJECTIVE


def _is_smooth(cost: Cost | None) -> bool:
    return cost in ("energy_per_distance", "acceleration_effort")


def faults_of_cost(key: str, cost: Cost | None, worm: Worm, limits: Limits) -> Iterator[Fault]:
    """Yield why the cost at `key` cannot be minimised for a worm within limits."""
    if cost is not None and limits.impulses:
        yield (
            key,
            f"{cost} has no finite value with {limits.name}.impulses; remove "
            f"{limits.name}.impulses and write {limits.name}.acceleration",
        )
    low, high = worm.load_range
    if _is_smooth(cost) and low < high:
        yield (
            key,
            f"{cost} depends on the load, and worm.load is a range; write one load, or choose "
            "speed or a peak",
        )


class Certify(Given, kw_only=False):
    """Settings of a tighter bound on the objective of any gait, for kind `gait-design` only.

    The bound applies to every gait within the limits, with any resting sequence, number of phases
    and cycles. All keys have defaults; `certify = {}` is enough. [Certificates](../certificates.md)
    explains what is proven.

    Refused: objectives `energy_per_distance` and `acceleration_effort`; `want = ["certificate"]`
    without this table; kind `gait-pareto`.
    """

    gap: float = number(
        "share",
        "end when no gait can be better by more than this share",
        least=1e-05,
        most=0.5,
        default=1e-2,
    )
    time_limit: float = positive(
        "s", "end after this time with the gap reached so far", default=60.0
    )


class Search(Given):
    """Search over the sequences in which masses rest.

    Without `phases`, plain sequences are listed up to 4 phases and varied up to 12 phases.
    Constructed sequences have as many phases as they need; a travelling wave of *n* links has up to
    *n* + 1. [Theory](../theory-kinematic.md#84-the-search-over-orders) explains the search.

    | effort | plain sequences, at most | sequences varied at a time, doubled after a round without gain | variations per round, at most | rounds without gain before the end | work, pivots times rows and columns | other starts (for a cost) | sequences sharpened |
    | --- | --- | --- | --- | --- | --- | --- | --- |
    | `quick` | 16 | 1 | 8 | 1 | 3e8 | 1 (1) | 1 |
    | `normal` | 160 | 4 | 240 | 2 | 7e8 | 1 (3) | 4 |
    | `thorough` | 1000 | 8 | 800 | 2 | 6e9 | 1 (8) | 8 |

    Half of the work is for plain sequences and their other starts. Besides the best sequence, only
    those within 0.2 % of it are sharpened.

    Refused in `sequence`: fewer than two phases, or more than `phases`; a mass that does not exist
    or appears twice in a phase; fewer than `gait.resting` masses in a phase; the same masses in two
    neighbouring phases (the last and the first are neighbours). No mass may rest in all phases,
    because the worm could not advance.

    Examples
    --------
    >>> import wormopt as wo
    >>> limits = wo.Limits(period=1.0, length=(0.7, 1.3), rate=1.0, acceleration=20.0)
    >>> search = Search(effort="quick", sequence=((0,), (1,), (2,)))
    >>> found = wo.design(wo.Worm(links=2, load=5.0), limits, search=search)
    >>> round(found.speed, 6)
    0.825667
    """  # noqa: E501

    seed: Seed = entry("seed of the random starts", default=0)
    effort: Effort = entry("extent of the search", default="normal")
    phases: int | None = whole(2, 64, "largest number of phases of a cycle", default=None)
    sequence: Order | None = entry(
        "resting masses of each phase of a cycle; only this sequence is used", default=None
    )
    time_limit: float | None = positive(
        "s",
        "the search ends after this time and returns the best gait so far, with a warning and "
        "exit code 0. The time is checked between linear programs. Sequences already begun "
        "are still fitted to the period, which can take longer than the limit itself if there "
        "are many links",
        default=None,
    )
    workers: int | None = whole(
        1,
        1024,
        "processes of the search; default: 1 up to two links, else one per processor. The "
        "result does not depend on it",
        default=None,
    )
    gap: float = number(
        "share",
        "a search for speed ends when no gait can be faster by more than this, as proven "
        "before it begins by linear programs that take tenths of a second",
        least=1e-05,
        most=0.5,
        default=1e-3,
    )
    certify: Certify | None = entry(
        "tighter bound on the objective of any gait, for peak loads too", default=None
    )

    def faults_for(self, links: int, limits: Limits) -> Iterator[Fault]:
        """Yield name and message of the faults of the given sequence.

        Parameters
        ----------
        links : int
            Number of links.
        limits : Limits
            Limits of the gait.
        """
        sequence = self.sequence
        if sequence is None:
            return
        if len(sequence) < 2:
            yield "sequence", "fewer than two phases; write at least two"
            return
        for index, masses in enumerate(sequence):
            key = f"sequence[{index}]"
            if len(set(masses)) != len(masses):
                yield key, "names a mass twice; name it once"
            if any(mass > links for mass in masses):
                yield key, f"names a mass that does not exist; write indices 0 to {links}"
            if len(set(masses)) < limits.resting:
                yield (
                    key,
                    f"fewer resting masses than {limits.name}.resting = {limits.resting}; name "
                    "more",
                )
            if set(masses) == set(sequence[index - 1]):
                yield (
                    key,
                    "the same masses rest as in the phase before (the last is before the first); "
                    "write other masses",
                )
        for mass in sorted(set(sequence[0]).intersection(*sequence)):
            yield "sequence", f"mass {mass} rests in every phase; let it move in one"
        if self.phases is not None and len(sequence) > self.phases:
            yield (
                "sequence",
                f"{len(sequence)} phases, but search.phases = {self.phases}; write fewer phases, "
                "or increase search.phases",
            )


class GaitProblem(Given, kw_only=False):
    """A problem of gait design; it can be hashed and sent to other processes.

    Raises
    ------
    ArgumentError
        If values do not fit together; the message names them.

    Examples
    --------
    >>> limits = Limits(1.0, (0.7, 1.3), rate=(1.0, 1.0), impulses=True)
    >>> GaitProblem(Worm(links=3), limits)
    Traceback (most recent call last):
    wormopt.study.given.RefusedError: GaitProblem: limits.rate: 2 entries for 3 links; write one ...
    """

    worm: Worm = entry("masses, drag, load")
    limits: Limits = entry("limits of the gait")
    objective: Objective = entry("the objective; the mean speed by default", default=Objective)

    @property
    def counts(self) -> dict[str, int]:
        """Numbers of links and masses."""
        return self.worm.counts

    @property
    def of_each(self) -> list[tuple[float, ...]]:
        """Mass of each mass, range and limits of each link and mass, head first; 0 if not given."""
        n, limits = self.worm.links, self.limits
        return [
            self.worm.masses,
            *limits.rate_bounds(n),
            tuple(longest - shortest for shortest, longest in limits.length_ranges(n)),
            per(limits.acceleration or 0.0, n),
            per(limits.actuator_force or 0.0, n),
            per(limits.spike_load or 0.0, n + 1),
        ]

    @property
    def loads_matter(self) -> bool:
        """Whether a limit or the cost depends on how resting masses share the load."""
        limited = self.limits.spike_load is not None or self.limits.actuator_force is not None
        return limited or self.objective.minimise not in (None, "acceleration_effort")

    @property
    def resting_sizes(self) -> range:
        """Numbers of resting masses worth trying; more than required help to share a load."""
        fewest = self.limits.resting
        return range(fewest, self.worm.links + 1 if self.loads_matter else fewest + 1)

    @property
    def speed_nominal(self) -> float:
        """Nominal speed: the largest rate of a link."""
        return max(map(max, self.limits.rate_bounds(self.worm.links)))

    def key_of(self, path: str) -> str:
        """Key of a field, "limits.rate", as its user writes it: "gait.rate" in scenes.

        Parameters
        ----------
        path : str
            Path of the field in the problem.
        """
        part, _, name = path.partition(".")
        return f"{self.limits.name}.{name}" if part == "limits" else path

    def faults_of_keys(self) -> Iterator[Fault]:
        """Yield what does not fit together."""
        for key, message in self.limits.faults_for(self.worm.links):
            yield f"limits.{key}".removesuffix("."), message
        cost = self.objective.minimise
        yield from faults_of_cost("objective.minimise", cost, self.worm, self.limits)


_MOTOR = entry(
    "a stepping motor with a threaded rod on each link; none by default. |*l*′| ≤ `lead` "
    "· `rate_max` and |*l*″| ≤ `lead` · `acceleration_max` hold in addition to the limits "
    "in `[gait]`, which then need no `rate` or `acceleration`. Other keys of this table "
    "have no effect on the design; the limits also hold below `start_rate`. Refused: "
    "`gait.impulses`",
    default=None,
)


class GaitStudy(Study):
    """Base of kinds that design gaits within `gait`, for links that may have a `motor`."""

    if TYPE_CHECKING:  # keys of each kind
        gait: GaitLimits
        search: Search
        motor: Motor | None

    @property
    def limits(self) -> Limits:
        """The limits, including those of the motors."""
        own, motor = self.gait, self.motor
        if motor is None:
            return own
        return own.within(motor.length_rate, motor.length_acceleration, self.counts["links"])

    def faults_of_limits(self) -> Iterator[Fault]:
        """Yield what is wrong between limits, motor and search."""
        links, has_motor = self.counts["links"], self.motor is not None
        if has_motor and self.gait.impulses:
            yield (
                "gait.impulses",
                "true, but motor.acceleration_max forbids jumps of velocity; remove the key",
            )
        for key, message in self.gait.faults_for(links, motor=has_motor):
            yield f"gait.{key}".removesuffix("."), message
        for key, message in self.search.faults_for(links, self.gait):
            yield f"search.{key}", message


class DesignTable(GaitStudy):
    """Tables shared by scenes that contain the worm for which they design gaits."""

    worm: SceneWorm = entry("the worm")
    gait: GaitLimits = entry("the limits")
    search: Search = entry("options of the search", default=Search)
    motor: Motor | None = _MOTOR

    @property
    def counts(self) -> Mapping[str, int]:
        """Numbers of links and masses."""
        return self.worm.counts

    def task(self, objective: Objective) -> GaitProblem:
        """The design problem for the given objective."""
        return GaitProblem(self.worm, self.limits, objective)

    def faults_of_design(self) -> Iterator[Fault]:
        """Yield what is wrong between worm, limits, motor and search."""
        yield from self.worm.faults_in_scene(self.units, ranges=True)
        yield from self.faults_of_limits()

    def faults_of_cost(self, key: str, cost: Cost | None) -> Iterator[Fault]:
        """Yield a fault if the cost at `key` cannot be minimised in this scene."""
        return faults_of_cost(key, cost, self.worm, self.gait)


class WormlessDesignTable(GaitStudy):
    """Tables shared by scenes that find the worm for which they design gaits."""

    gait: GaitLimits = entry("the limits")
    search: Search = entry("options of the search", default=Search)
    motor: Motor | None = _MOTOR
