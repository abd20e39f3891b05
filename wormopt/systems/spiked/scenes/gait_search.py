"""The ``[search]`` table: how the order in which masses rest is sought."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Annotated, Any

from msgspec import Meta, structs

from wormopt.errors import Fault
from wormopt.scene.types import Positive, Seed, Table
from wormopt.systems.spiked.task import MOST_LINKS, Certify, Effort, Search


class CertifyTable(Table, frozen=True, kw_only=True):
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

    phases: Annotated[int, Meta(ge=2, le=8, description="a whole number from 2 to 8")] = (
        Certify.phases
    )
    gap: Annotated[float, Meta(ge=1e-5, le=0.5, description="a number from 1e-5 to 0.5")] = (
        Certify.gap
    )
    time_limit: Positive = Certify.time_limit


class SearchTable(Table, frozen=True, kw_only=True):
    """How the order in which masses rest is sought.

    Parameters
    ----------
    seed : int
        Seed of random starts.
    effort : {"quick", "normal", "thorough"}
        How much is searched.
    phases : int, optional
        A cycle has at most so many phases, 2 to 64.
    sequence : tuple of tuple of int, optional
        The resting masses of each phase of a cycle in turn; nothing else is tried then.
    time_limit : float, optional
        Seconds after which the best gait found so far is taken.
    workers : int, optional
        Number of processes.
    certify : CertifyTable, optional
        The proof of how much better any gait could be; none if left out.
    """

    seed: Seed = 0
    effort: Effort = "normal"
    phases: Annotated[int, Meta(ge=2, le=64, description="a whole number from 2 to 64")] | None = (
        None
    )
    sequence: (
        Annotated[
            tuple[tuple[Annotated[int, Meta(ge=0, le=MOST_LINKS)], ...], ...],
            Meta(description="a list of lists of mass indices, [[0], [2], [1]] say"),
        ]
        | None
    ) = None
    time_limit: Positive | None = None
    workers: (
        Annotated[int, Meta(ge=1, le=1024, description="a whole number from 1 to 1024")] | None
    ) = None
    certify: CertifyTable | None = None

    @property
    def search(self) -> Search:
        """The settings themselves."""
        given: dict[str, Any] = structs.asdict(self)
        del given["certify"]
        return Search(**given)

    @property
    def proof(self) -> Certify | None:
        """The proof that is wanted, of the designer's own sequence if there is one."""
        if self.certify is None:
            return None
        given = structs.asdict(self.certify)
        return Certify(**given, sequence=self.sequence, workers=self.workers)

    def faults(self, links: int, resting: int) -> Iterator[Fault]:
        """Yield what is wrong with the designer's own sequence.

        `resting`: at least so many masses rest at any time.
        """
        for key, message in self.search.faults(links, resting):
            yield f"search.{key}", in_scene(message)


def in_scene(told: str) -> str:
    """What an engine says of a task in the words of its scene, where limits stand in [gait].

    `told` is a name, "limits.rate" say, or a sentence with such names.
    """
    return re.sub(r"\blimits\.(?=[a-z])", "gait.", told)
