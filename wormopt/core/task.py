"""What the design of a gait is asked for: worm, limits, objective, and how to search."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from numbers import Integral
from typing import Literal, get_args

from wormopt.core.given import Frozen, Numbers, faults_of_numbers, per, wrong_order
from wormopt.core.limits import Limits
from wormopt.errors import ArgumentError, Fault

__all__ = ["MOST_LINKS", "Certify", "Cost", "Effort", "Objective", "Search", "Task", "Worm"]

MOST_LINKS = 32
# Words of resting sets in a proof, before rotations and mirror images are counted as one.
_MOST_ORDERS = 1_000_000

Cost = Literal[
    "peak_spike_load", "peak_actuator_force", "energy_per_distance", "acceleration_effort"
]
Effort = Literal["quick", "normal", "thorough"]


@dataclass(frozen=True)
class Worm(Frozen):
    """A chain of point masses with spikes, whose link lengths are prescribed, (1)-(7).

    Parameters
    ----------
    links : int
        Number of links n, 1 to 32; the masses are n + 1.
    mass : float or sequence of float, optional
        Mass, alike for all or one per mass, head first.
    drag : float, optional
        Viscous drag coefficient of each mass.
    load : float or (float, float), optional
        Force against the direction of motion on each mass (slope, towed load); a pair is a
        range: what is designed must hold for every load in it.

    Examples
    --------
    >>> worm = Worm(links=2, load=(2.0, 5.0))
    >>> worm.masses, worm.load_range
    ((1.0, 1.0, 1.0), (2.0, 5.0))
    """

    links: int
    mass: Numbers = 1.0
    drag: float = 0.0
    load: float | tuple[float, float] = 0.0

    @property
    def masses(self) -> tuple[float, ...]:
        """Mass of each point mass, head first."""
        return per(self.mass, self.links + 1)

    @property
    def load_range(self) -> tuple[float, float]:
        """Smallest and largest load on each mass; equal where the load is known."""
        low, high = per(self.load, 2)
        return low, high

    def faults(self) -> Iterator[Fault]:
        """Yield field and message of whatever is wrong."""
        if not (isinstance(self.links, Integral) and 1 <= self.links <= MOST_LINKS):
            yield "links", f"not {self.links}; write a whole number from 1 to {MOST_LINKS}"
            return
        yield from faults_of_numbers("mass", self.mass, self.links + 1, "masses")
        yield from faults_of_numbers("drag", self.drag, 1, "worms", least=0.0)
        yield from faults_of_numbers("load", self.load, 2, "ends of a range", least=0.0)
        if len(per(self.load, 2)) == 2:
            yield from wrong_order("load", self.load_range)


@dataclass(frozen=True)
class Objective:
    """What makes a gait the best: the largest mean speed, or the least cost at a required speed.

    Parameters
    ----------
    minimise : str, optional
        Cost to be made small; the mean speed is made large if left out.
    speed : float, optional
        Mean speed required when a cost is minimised.

    Examples
    --------
    >>> Objective.of("speed"), Objective.of("peak_spike_load", 0.5).speed
    (Objective(minimise=None, speed=None), 0.5)
    """

    minimise: Cost | None = None
    speed: float | None = None

    @classmethod
    def of(cls, name: Literal["speed"] | Cost, speed: float | None = None) -> Objective:
        """Make an objective of its name.

        Parameters
        ----------
        name : str
            "speed", or the cost to be made small.
        speed : float, optional
            Mean speed required where a cost is made small.
        """
        return cls(None if name == "speed" else name, speed)

    @property
    def is_smooth(self) -> bool:
        """Whether it is neither linear nor a peak."""
        return self.minimise in ("energy_per_distance", "acceleration_effort")

    def faults(self) -> Iterator[Fault]:
        """Yield field and message of whatever is wrong."""
        if self.minimise is not None and self.minimise not in get_args(Cost):
            costs = ", ".join(get_args(Cost))
            yield "minimise", f"not {self.minimise!r}; write speed or one of {costs}"
        elif self.minimise is None and self.speed is not None:
            yield "speed", "a speed that is made large cannot be required; leave one out"
        elif self.minimise is not None and self.speed is None:
            yield "speed", "missing; minimise needs the speed to keep, a finite number above 0"
        elif self.speed is not None:
            yield from faults_of_numbers("speed", self.speed, 1, "gaits")


@dataclass(frozen=True)
class Certify:
    """Proof of how much better any gait could be.

    Parameters
    ----------
    phases : int, optional
        It speaks of all gaits with at most so many phases a cycle, 2 to 8.
    gap : float, optional
        How much better a gait might still be when it is enough, as a share.
    time_limit : float, optional
        Seconds after which it stops with the gap it has.
    """

    phases: int = 4
    gap: float = 1e-3
    time_limit: float = 300.0

    def faults(self, sets: int = 0) -> Iterator[Fault]:
        """Yield field and message of whatever is wrong.

        Parameters
        ----------
        sets : int, optional
            How many sets of masses may rest; of too many the orders cannot all be looked at.
        """
        possible = max((p for p in range(2, 9) if sets**p <= _MOST_ORDERS), default=0)
        if not possible:
            yield "", f"{sets} sets of resting masses are too many to look at"
        elif self.phases > possible:
            yield (
                "phases",
                f"{self.phases} phases of {sets} sets of resting masses have too many orders to "
                f"look at; write {possible} at most",
            )
        if not _is_whole(self.phases, 2, 8):
            yield "phases", f"not {self.phases!r}; write a whole number from 2 to 8"
        if not 1e-5 <= self.gap <= 0.5:
            yield "gap", f"not {self.gap!r}; write a number from 1e-5 to 0.5"
        yield from faults_of_numbers("time_limit", self.time_limit, 1, "proofs")


@dataclass(frozen=True)
class Search(Frozen):
    """How the order in which masses rest is sought.

    Parameters
    ----------
    seed : int, optional
        Seed of random starts.
    effort : {"quick", "normal", "thorough"}, optional
        How much is searched.
    phases : int, optional
        A cycle has at most so many phases, 2 to 64.
    sequence : sequence of sequences of int, optional
        The resting masses of each phase of a cycle in turn; nothing else is tried then.
    time_limit : float, optional
        Seconds after which the best gait found so far is taken; no limit if left out.
    workers : int, optional
        Number of threads.
    certify : Certify, optional
        The proof of how much better any gait could be; none if left out.
    """

    seed: int = 0
    effort: Effort = "normal"
    phases: int | None = None
    sequence: tuple[tuple[int, ...], ...] | None = None
    time_limit: float | None = None
    workers: int | None = None
    certify: Certify | None = None

    def faults(self, links: int, resting: int) -> Iterator[Fault]:
        """Yield field and message of what is wrong.

        Parameters
        ----------
        links : int
            Number of links.
        resting : int
            At least so many masses rest at any time.
        """
        if self.effort not in get_args(Effort):
            yield "effort", f"not {self.effort!r}; write one of {', '.join(get_args(Effort))}"
        if self.phases is not None and not _is_whole(self.phases, 2, 64):
            yield "phases", f"not {self.phases!r}; write a whole number from 2 to 64"
        if self.workers is not None and not _is_whole(self.workers, 1, 1024):
            yield "workers", f"not {self.workers!r}; write a whole number from 1 to 1024"
        yield from faults_of_numbers("time_limit", self.time_limit, 1, "searches")
        if self.certify is not None:
            yield from ((f"certify.{key}", said) for key, said in self.certify.faults())
        if self.sequence is not None:
            yield from self._faults_of_sequence(self.sequence, links, resting)

    def _faults_of_sequence(
        self, sequence: tuple[tuple[int, ...], ...], links: int, resting: int
    ) -> Iterator[Fault]:
        count = len(sequence)
        if count < 2:
            yield "sequence", "fewer than two phases; write at least two"
        if self.phases is not None and count > self.phases:
            yield "sequence", f"{count} phases, but search.phases allows {self.phases}"
        for index, masses in enumerate(sequence):
            key = f"sequence[{index}]"
            if len(set(masses)) != len(masses):
                yield key, "names a mass twice; name it once"
            if any(not 0 <= mass <= links for mass in masses):
                yield key, f"names a mass there is not; write indices 0 to {links}"
            if len(set(masses)) < resting:
                yield key, f"fewer resting masses than limits.resting = {resting}; name more"
            if count > 1 and set(masses) == set(sequence[index - 1]):
                yield key, "the same masses rest as in the phase before (round the period)"
        for mass in sorted(set.intersection(*map(set, sequence)) if sequence else ()):
            yield "sequence", f"mass {mass} rests in every phase; let it move in one"


def _is_whole(value: object, least: int, most: int) -> bool:
    return isinstance(value, Integral) and least <= int(value) <= most


@dataclass(frozen=True)
class Task:
    """A problem of gait design; it can be hashed and sent to other processes.

    Parameters
    ----------
    worm : Worm
        Masses, drag, load.
    limits : Limits
        What the gait must keep to.
    objective : Objective, optional
        What to seek; the speed if left out.

    Raises
    ------
    ArgumentError
        If something in it is wrong or does not fit together; the message names it.

    Examples
    --------
    >>> Task(Worm(links=2, mass=(1.0, 1.0)), Limits(1.0, (0.7, 1.3), rate=1.0, impulses=True))
    Traceback (most recent call last):
    wormopt.errors.ArgumentError: worm.mass: 2 entries for 3 masses; write one number for all ...
    """

    worm: Worm
    limits: Limits
    objective: Objective = Objective()

    def __post_init__(self) -> None:
        for key, message in self._faults():
            raise ArgumentError(f"{key}: {message}")

    @property
    def loads_matter(self) -> bool:
        """Whether a limit or the cost depends on how resting masses share the load."""
        limited = self.limits.spike_load is not None or self.limits.actuator_force is not None
        return limited or self.objective.minimise not in (None, "acceleration_effort")

    @property
    def speed_nominal(self) -> float:
        """Usual size of the speed: the largest rate of a link."""
        return max(map(max, self.limits.rate_bounds(self.worm.links)))

    def _faults(self) -> Iterator[Fault]:
        for prefix, found in (
            ("worm.", self.worm.faults()),
            ("limits.", self.limits.faults(self.worm.links)),
            ("objective.", self.objective.faults()),
        ):
            for key, message in found:
                yield f"{prefix}{key}".removesuffix("."), message.format(*[prefix] * 3)
