"""The task of gait design: worm, limits, objective, and search."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import comb
from typing import Any, Literal, get_args

from wormopt.errors import ArgumentError, Fault
from wormopt.model.given import (
    Frozen,
    Numbers,
    check_kind,
    faults_of_number,
    faults_of_numbers,
    faults_of_whole,
    is_number,
    is_whole,
    per,
    wrong_order,
)
from wormopt.systems.spiked.limits import Limits

MOST_LINKS = 32

Cost = Literal[
    "peak_spike_load", "peak_actuator_force", "energy_per_distance", "acceleration_effort"
]
Effort = Literal["quick", "normal", "thorough"]


@dataclass(frozen=True)
class Worm(Frozen):
    """A chain of point masses with spikes and prescribed link lengths.

    The model is that of eqs. 1 to 7 of Zimmermann et al. 2007. All quantities are in one
    consistent system of units.

    Parameters
    ----------
    links : int
        Number of links n, 1 to 32; there are n + 1 masses.
    mass : float or sequence of float, shape (n+1,), optional
        Mass, one number for all or one per mass, head first.
    drag : float, optional
        Viscous drag coefficient of each mass: force over velocity.
    load : float, (float, float) or sequence of float, shape (n+1,), optional
        Force against the direction of motion on each mass, for example a towed load or the weight
        m g sin(slope) on a slope. A pair is a range: a design meets its limits for every load in
        it. Three or more numbers are the loads of the individual masses, head first. Example: a
        cable at the tail of four masses is (0, 0, 0, 0.3).
    pull : float or sequence of float, shape (n+1,), optional
        Additional force on each mass, one number for all or one per mass: for example the weight
        of unequal masses on a slope, together with a range of loads.

    Examples
    --------
    >>> worm = Worm(links=2, load=(2.0, 5.0))
    >>> worm.masses, worm.load_range
    ((1.0, 1.0, 1.0), (2.0, 5.0))
    """

    links: int
    mass: Numbers = 1.0
    drag: float = 0.0
    load: float | tuple[float, ...] = 0.0
    pull: Numbers = 0.0

    @property
    def masses(self) -> tuple[float, ...]:
        """Mass of each point mass, head first."""
        return per(self.mass, self.links + 1)

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
        """Load of each mass in addition to a number or range for all."""
        pull = per(self.pull, self.links + 1)
        if self._may_vary:
            return pull
        return tuple(a + b for a, b in zip(pull, per(self.load, self.links + 1), strict=True))

    @property
    def beyond(self) -> tuple[float, ...]:
        """Load of each mass minus the mean over all masses; they sum to 0."""
        mean = _mean(self._known)
        return tuple(each - mean for each in self._known)

    def loads(self, mean: float) -> float | tuple[float, ...]:
        """Load on each mass for a given mean; one number if all are equal.

        Parameters
        ----------
        mean : float
            Mean load, within `load_range`.

        Returns
        -------
        float or tuple of float, shape (n+1,)
        """
        beyond = self.beyond
        return tuple(mean + each for each in beyond) if any(beyond) else mean

    def faults(self) -> Iterator[Fault]:
        """Yield name and message of every fault."""
        if not is_whole(self.links, 1, MOST_LINKS):
            yield from faults_of_whole("links", self.links, 1, MOST_LINKS)
            return
        yield from faults_of_numbers("mass", self.mass, self.links + 1, "masses")
        yield from faults_of_number("drag", self.drag, least=0.0)
        yield from faults_of_numbers("pull", self.pull, self.links + 1, "masses", least=0.0)
        if self._may_vary:
            yield from faults_of_numbers("load", self.load, 2, "ends of a range", least=0.0)
            if isinstance(self.load, tuple):
                yield from wrong_order("load", self.load)
            return
        yield from faults_of_numbers("load", self.load, self.links + 1, "masses", least=0.0)


def _mean(each: tuple[float, ...]) -> float:
    """Mean of numbers; exact if they are equal."""
    return each[0] if len(set(each)) == 1 else sum(each) / len(each)


@dataclass(frozen=True)
class Objective(Frozen):
    """The objective of a design: the largest mean speed, or the smallest cost at a required speed.

    Parameters
    ----------
    minimise : str, optional
        Cost to minimise: "peak_spike_load", "peak_actuator_force", "energy_per_distance" or
        "acceleration_effort". By default the mean speed is maximised.
    speed : float, optional
        Required mean speed if a cost is minimised.

    Examples
    --------
    >>> Objective.of("speed"), Objective.of("peak_spike_load", 0.5).speed
    (Objective(minimise=None, speed=None), 0.5)
    """

    minimise: Cost | None = None
    speed: float | None = None

    @classmethod
    def of(cls, what: Literal["speed"] | Cost | Objective, speed: float | None = None) -> Objective:
        """Make an objective from its name.

        Parameters
        ----------
        what : str or Objective
            "speed", or the cost to minimise; an Objective is returned unchanged.
        speed : float, optional
            Required mean speed if a cost is minimised.

        Returns
        -------
        Objective

        Raises
        ------
        ArgumentError
            If `what` is an Objective and `speed` is given too.
        """
        if not isinstance(what, Objective):
            return cls(None if what == "speed" else what, speed)
        if speed is not None:
            raise ArgumentError("speed is given, but the objective has its own; remove one of them")
        return what

    @property
    def is_smooth(self) -> bool:
        """Whether it is energy or effort, for which there are no proofs and multipliers."""
        return self.minimise in ("energy_per_distance", "acceleration_effort")

    @property
    def quantity(self) -> str:
        """Physical quantity of the objective, a name for `unit_of`."""
        match self.minimise:
            case None:
                return "speed"
            case "energy_per_distance":
                return "energy_per_distance"
            case "acceleration_effort":
                return "acceleration_squared"
            case _:
                return "force"

    def faults(self) -> Iterator[Fault]:
        """Yield name and message of every fault."""
        if self.minimise is not None and self.minimise not in get_args(Cost):
            costs = ", ".join(get_args(Cost))
            yield "minimise", f"{self.minimise!r} is not known; write speed or one of {costs}"
        elif self.minimise is None and self.speed is not None:
            yield "speed", "given, but the speed is maximised; remove it, or minimise a cost"
        elif self.minimise is not None and self.speed is None:
            yield "speed", "missing; minimise needs the required speed: write a number above 0"
        elif self.speed is not None:
            yield from faults_of_number("speed", self.speed)

    def faults_within(self, worm: Worm, limits: Limits) -> Iterator[str]:
        """Yield why the objective cannot be used for a worm within limits, each valid by itself.

        Parameters
        ----------
        worm : Worm
            Masses, drag, load.
        limits : Limits
            Limits of the gait.

        Yields
        ------
        str
        """
        if self.minimise is not None and limits.impulses:
            yield (
                f"{self.minimise} has no finite value with limits.impulses; remove limits.impulses "
                "and write limits.acceleration"
            )
        low, high = worm.load_range
        if self.is_smooth and low < high:
            yield (
                f"{self.minimise} depends on the load, and worm.load is a range; write one load, "
                "or choose speed or a peak"
            )


@dataclass(frozen=True)
class Certify(Frozen):
    """Settings of the proof that bounds the objective of any gait."""

    gap: float = 1e-2  # end when no gait can be better by more than this share
    time_limit: float = 60.0  # s; end after this time with the gap reached

    def faults(self) -> Iterator[Fault]:
        """Yield name and message of every fault."""
        yield from _faults_of_gap(self.gap)
        yield from faults_of_number("time_limit", self.time_limit)


@dataclass(frozen=True)
class Search(Frozen):
    """Settings of the search over the sequences in which masses rest.

    Parameters
    ----------
    seed : int, optional
        Seed of the random starts.
    effort : {"quick", "normal", "thorough"}, optional
        Extent of the search.
    phases : int, optional
        Largest number of phases of a cycle, 2 to 64.
    sequence : sequence of sequences of int, optional
        Resting masses of each phase of a cycle; only this sequence is used.
    time_limit : float, optional
        Time in seconds after which the best gait found so far is returned. There is no limit by
        default.
    workers : int, optional
        Number of processes.
    gap : float, optional
        The search for a speed ends when no gait can be faster by a larger share, as proven by
        small linear programs before it begins.

    Examples
    --------
    >>> import wormopt as wo
    >>> limits = wo.Limits(period=1.0, length=(0.7, 1.3), rate=1.0, acceleration=20.0)
    >>> found = wo.design(wo.Worm(links=2, load=5.0), limits, search=Search(effort="quick", seed=1))
    >>> round(found.speed, 6)
    0.825667
    """

    seed: int = 0
    effort: Effort = "normal"
    phases: int | None = None
    sequence: tuple[tuple[int, ...], ...] | None = None
    time_limit: float | None = None
    workers: int | None = None
    gap: float = 1e-3

    def faults(self, links: int, resting: int) -> Iterator[Fault]:
        """Yield name and message of every fault.

        Parameters
        ----------
        links : int
            Number of links.
        resting : int
            Smallest number of masses at rest at any time.

        Yields
        ------
        tuple of (str, str)
        """
        if self.effort not in get_args(Effort):
            yield "effort", f"not {self.effort!r}; write one of {', '.join(get_args(Effort))}"
        yield from faults_of_whole("seed", self.seed, 0, 2**32 - 1)
        if self.phases is not None:
            yield from faults_of_whole("phases", self.phases, 2, 64)
        if self.time_limit is not None:
            yield from faults_of_number("time_limit", self.time_limit)
        yield from _faults_of_workers(self.workers)
        yield from _faults_of_gap(self.gap)
        yield from _faults_of_sequence(self.sequence, links, resting)
        if self.phases is not None and (count := len(self.sequence or ())) > self.phases:
            yield (
                "sequence",
                f"{count} phases, but search.phases = {self.phases}; write fewer phases, or "
                "increase search.phases",
            )


def _faults_of_gap(gap: Any) -> Iterator[Fault]:
    if not is_number(gap, 1e-5, 0.5):
        yield "gap", f"not {gap!r}; write a number from 1e-5 to 0.5"


def _faults_of_workers(workers: int | None) -> Iterator[Fault]:
    if workers is not None:
        yield from faults_of_whole("workers", workers, 1, 1024)


def _faults_of_sequence(sequence: Any, links: int, resting: int) -> Iterator[Fault]:
    if sequence is None:
        return
    if not isinstance(sequence, tuple) or not all(isinstance(item, tuple) for item in sequence):
        yield (
            "sequence",
            f"not {sequence!r}; write a list of lists of masses, for example [[0], [2], [1]]",
        )
        return
    if len(sequence) < 2:
        yield "sequence", "fewer than two phases; write at least two"
        return
    for index, masses in enumerate(sequence):
        key = f"sequence[{index}]"
        if len(set(masses)) != len(masses):
            yield key, "names a mass twice; name it once"
        if not all(is_whole(mass, 0, links) for mass in masses):
            yield key, f"names a mass that does not exist; write indices 0 to {links}"
        if len(set(masses)) < resting:
            yield key, f"fewer resting masses than limits.resting = {resting}; name more"
        if set(masses) == set(sequence[index - 1]):
            yield (
                key,
                "the same masses rest as in the phase before (the last is before the first); write "
                "other masses",
            )
    for mass in sorted(set(sequence[0]).intersection(*sequence)):
        yield "sequence", f"mass {mass} rests in every phase; let it move in one"


@dataclass(frozen=True)
class GaitProblem:
    """A problem of gait design; it can be hashed and sent to other processes.

    Parameters
    ----------
    worm : Worm
        Masses, drag, load.
    limits : Limits
        Limits of the gait.
    objective : Objective, optional
        Objective; by default the mean speed is maximised.

    Raises
    ------
    ArgumentError
        If a value is invalid or values do not fit together; the message names the value.

    Examples
    --------
    >>> limits = Limits(1.0, (0.7, 1.3), rate=1.0, impulses=True)
    >>> GaitProblem(Worm(links=2, mass=(1.0, 1.0)), limits)
    Traceback (most recent call last):
    wormopt.errors.ArgumentError: worm.mass: 2 entries for 3 masses; write one number for all ...
    """

    worm: Worm
    limits: Limits
    objective: Objective = Objective()

    def __post_init__(self) -> None:
        for name, kind in (("worm", Worm), ("limits", Limits), ("objective", Objective)):
            check_kind(name, getattr(self, name), kind)
        for key, message in self._faults():
            raise ArgumentError(f"{key}: {message}")

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
    def count_of_sets(self) -> int:
        """Number of sets of masses that may rest."""
        return sum(comb(self.worm.links + 1, size) for size in self.resting_sizes)

    @property
    def speed_nominal(self) -> float:
        """Nominal speed: the largest rate of a link."""
        return max(map(max, self.limits.rate_bounds(self.worm.links)))

    def _faults(self) -> Iterator[Fault]:
        for prefix, found in (
            ("worm.", self.worm.faults()),
            ("limits.", self.limits.faults(self.worm.links, "limits.")),
            ("objective.", self.objective.faults()),
        ):
            for key, message in found:
                yield f"{prefix}{key}".removesuffix("."), message
        for message in self.objective.faults_within(self.worm, self.limits):
            yield "objective.minimise", message
