"""A design and the proof of how much better any gait could be; the proof may better the design."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from wormopt.errors import ArgumentError
from wormopt.model.given import check_kind
from wormopt.progress import Report, silent
from wormopt.systems.spiked.certify.prove import Certificate, Progress, gap_of, prove
from wormopt.systems.spiked.design.design import Design
from wormopt.systems.spiked.design.sharpen import finished
from wormopt.systems.spiked.search.sequences import Sequence_
from wormopt.systems.spiked.search.trial import Trial, Trier
from wormopt.systems.spiked.task import Certify


@dataclass(frozen=True, eq=False)
class Certified:
    """A design with a proof.

    Parameters
    ----------
    design : Design
        The design, or a better one that was found on the way.
    certificate : Certificate
        What is proven, and how.
    """

    design: Design
    certificate: Certificate

    @property
    def bound(self) -> float:
        """No gait of which the certificate speaks is faster, or cheaper."""
        return self.certificate.progress.bound

    @property
    def gap(self) -> float:
        """By which share of its own value the design could be better at most."""
        return self.certificate.gap


def certify(
    design: Design,
    phases: int = Certify.phases,
    gap: float = Certify.gap,
    time_limit: float = Certify.time_limit,
    sequence: Sequence[Sequence[int]] | None = None,
    workers: int | None = None,
    report: Report = silent,
) -> Certified:
    """Prove how much better than a design any gait could be.

    Parameters
    ----------
    design : Design
        Of the speed or of a peak load.
    phases : int, optional
        The proof speaks of all gaits of at most so many phases a cycle, and any number of cycles.
    gap : float, optional
        How much better a gait might still be when it is enough, as a share.
    time_limit : float, optional
        Seconds after which it ends with the gap it has.
    sequence : sequence of sequences of int, optional
        Resting masses of each phase of a cycle in turn; the proof speaks of this order alone then.
    workers : int, optional
        Number of processes; one per processor if left out.
    report : callable, optional
        Told the gap.

    Returns
    -------
    Certified
        The design, or a better one found on the way, with its bound and gap.

    Raises
    ------
    ArgumentError
        If the design's cost has no proof, or an argument is wrong.

    Examples
    --------
    >>> from wormopt.systems.spiked.limits import Limits
    >>> from wormopt.systems.spiked.task import Worm
    >>> from wormopt.systems.spiked.design.optimize import design
    >>> limits = Limits(period=1.0, length=(0.7, 1.3), rate=1.0, acceleration=20.0)
    >>> proof = certify(design(Worm(links=1, load=5.0), limits))
    >>> proof.gap <= 1e-3, proof.bound >= proof.design.speed
    (True, True)
    """
    check_kind("design", design, Design)
    if design.task.objective.is_smooth:
        raise ArgumentError(
            f"there is no proof for {design.task.objective.minimise}; seek speed, "
            "peak_spike_load or peak_actuator_force"
        )
    task = design.task
    # lists and arrays are made tuples
    wanted = Certify(phases, gap, time_limit, sequence, workers)  # pyright: ignore[reportArgumentType]
    faults = chain(
        wanted.faults(task.worm.links, task.limits.resting), wanted.faults_of_orders(task)
    )
    for key, message in faults:
        raise ArgumentError(f"{key}: {message}" if key else message)
    return certified(design, wanted, report)


def certified(
    design: Design,
    wanted: Certify,
    report: Report,
    begun: Progress | None = None,
    save: Callable[[Progress], None] = lambda _: None,
) -> Certified:
    """Prove as `prove`; relaxed gaits are starts from which the design may become better."""
    task, trier = design.task, Trier(design.task)
    cost = task.objective.minimise is not None
    best: list[Trial] = []

    def improve(sequence: Sequence_, durations: tuple[float, ...]) -> float:
        record = best[-1].value if best else design.value
        free = trier.free(sequence, np.array(durations), enough=_NEAR * record)
        fitted = None if free is None or free.value < _NEAR * record else trier.fit(free)
        if fitted is None:
            return -np.inf
        finer = trier.finer(trier.finer(fitted))
        if finer.value > record:
            best.append(finer)
        return finer.value

    begun = begun or _begun(design)
    proof = prove(task, design.value, wanted, report, begun, save, improve)
    with suppress(KeyboardInterrupt):  # the design as it was
        better = finished(design, best[-1]) if best else design
        design = better if better.value > design.value else design
    gap = gap_of(design.value, proof.progress.bound, cost)
    return Certified(design, replace(proof, gap=gap))


def _begun(design: Design) -> Progress:
    """What is known before the proof: the ceiling of a speed, that a cost is not negative."""
    bound = design.ceiling if design.task.objective.minimise is None else 0.0
    return Progress(bound, history=((0.0, bound),))


# Relaxed gaits that end below this share of the best speed are not looked at any closer.
_NEAR = 0.95
