"""The ``[search]`` table: how the order in which masses rest is sought."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.scenes.types import Positive, Seed, Table


class Certify(Table, frozen=True, kw_only=True):
    """Proof of how much better any gait could be.

    Parameters
    ----------
    phases : int
        It speaks of all gaits with at most so many phases a cycle, 2 to 8.
    gap : float
        How much better a gait might still be when it is enough, as a share.
    time_limit : float
        Seconds after which it stops with the gap it has.
    """

    phases: Annotated[int, Meta(ge=2, le=8, description="a whole number from 2 to 8")] = 4
    gap: Annotated[float, Meta(ge=1e-5, le=0.5, description="a number from 1e-5 to 0.5")] = 1e-3
    time_limit: Positive = 300.0


class Search(Table, frozen=True, kw_only=True):
    """How the order in which masses rest is sought.

    Parameters
    ----------
    seed : int
        Seed of random starts.
    effort : {"quick", "normal", "thorough"}
        How much is searched.
    phases : int, optional
        A period has at most so many phases, 2 to 12.
    sequence : tuple of tuple of int, optional
        The resting masses of each phase in turn; nothing else is tried then.
    workers : int, optional
        Number of processes of the search, and of threads of a certificate.
    certify : Certify, optional
        The proof of how much better any gait could be; none if left out.
    """

    seed: Seed = 0
    effort: Literal["quick", "normal", "thorough"] = "normal"
    phases: Annotated[int, Meta(ge=2, le=12, description="a whole number from 2 to 12")] | None = (
        None
    )
    sequence: (
        Annotated[
            tuple[tuple[Annotated[int, Meta(ge=0, le=8)], ...], ...],
            Meta(description="a list of lists of mass indices, [[0], [2], [1]] say"),
        ]
        | None
    ) = None
    workers: (
        Annotated[int, Meta(ge=1, le=1024, description="a whole number from 1 to 1024")] | None
    ) = None

    certify: Certify | None = None

    def faults(self, links: int, resting: int) -> Iterator[Fault]:
        """Yield what is wrong with the designer's own sequence.

        Parameters
        ----------
        links : int
            Number of links.
        resting : int
            At least so many masses rest at any time.
        """
        if self.sequence is None:
            return
        count = len(self.sequence)
        if count < 2:
            yield "search.sequence", "fewer than two phases; write at least two"
        if self.phases is not None and count > self.phases:
            yield "search.sequence", f"{count} phases, but search.phases allows {self.phases}"
        for index, masses in enumerate(self.sequence):
            key = f"search.sequence[{index}]"
            if len(set(masses)) != len(masses):
                yield key, "names a mass twice; name it once"
            if any(mass > links for mass in masses):
                yield key, f"names a mass there is not; write indices 0 to {links}"
            if len(set(masses)) < resting:
                yield key, f"fewer resting masses than gait.resting = {resting}; name more"
            if count > 1 and set(masses) == set(self.sequence[index - 1]):
                yield key, "the same masses rest as in the phase before (round the period)"
        for mass in sorted(set.intersection(*map(set, self.sequence)) if self.sequence else ()):
            yield "search.sequence", f"mass {mass} rests in every phase; let it move in one"
