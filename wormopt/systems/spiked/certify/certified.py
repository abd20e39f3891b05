"""Designs with a proven bound on every gait, and their gap."""

from __future__ import annotations

from dataclasses import dataclass

from wormopt.errors import ArgumentError
from wormopt.model.given import check_kind
from wormopt.progress import Report, silent
from wormopt.shown import lines
from wormopt.systems.spiked.certify.bound import Bounded, bounded, gap_of
from wormopt.systems.spiked.certify.certificate import Certificate
from wormopt.systems.spiked.design.design import Design
from wormopt.systems.spiked.gait_problem import Certify

_USUAL = Certify()


@dataclass(frozen=True, eq=False)
class Certified:
    """A design with a proven bound on the objective of every gait.

    Parameters
    ----------
    design : Design
        The design.
    bounded : Bounded
        The bound and its proof.

    Examples
    --------
    >>> import wormopt as wo
    >>> limits = wo.Limits(period=1.0, length=(0.7, 1.3), rate=1.0, acceleration=20.0)
    >>> proven = wo.certify(wo.design(wo.Worm(links=1, load=5.0), limits))
    >>> round(proven.bound, 6), proven.gap <= 1e-3
    (0.425, True)
    """

    design: Design
    bounded: Bounded

    def __repr__(self) -> str:
        first = repr(self.design).partition("\n")[0]
        proven = f"bound {self.bound:.9g}, gap {self.gap:.3g} ({self.bounded.ending})"
        return lines(f"Certified {first[0].lower()}{first[1:]}", f"{proven}, {self.bounded.source}")

    @property
    def bound(self) -> float:
        """Proven bound: no gait with any phases, cycles and period in the limits is better."""
        return self.bounded.bound

    @property
    def certificate(self) -> Certificate | None:
        """The proof, to save and verify; None if rates and resting masses give the better bound."""
        return self.bounded.certificate

    @property
    def gap(self) -> float:
        """Largest possible improvement by any gait, as a share of the design's value."""
        cost = self.design.task.objective.minimise is not None
        return gap_of(self.design.value, self.bound, cost)


def certify(
    design: Design,
    gap: float = _USUAL.gap,
    time_limit: float = _USUAL.time_limit,
    report: Report = silent,
) -> Certified:
    """Prove by how much any gait could be better than a design.

    Parameters
    ----------
    design : Design
        A design for speed or a peak load.
    gap : float, optional
        End when no gait can be better by more than this share.
    time_limit : float, optional
        Time in seconds after which it ends with the gap reached.
    report : callable, optional
        Called with a text that contains the gap, and the share done.

    Returns
    -------
    Certified
        The design with its bound, gap and certificate.

    Raises
    ------
    ArgumentError
        If the design's cost has no bound, or if an argument is invalid.

    Examples
    --------
    >>> from wormopt.systems.spiked.gait_problem import Limits, Worm
    >>> from wormopt.systems.spiked.design.optimize import design
    >>> limits = Limits(period=1.0, length=(0.7, 1.3), rate=1.0, acceleration=20.0)
    >>> proof = certify(design(Worm(links=1, load=5.0), limits))
    >>> proof.gap <= 1e-3, proof.bound >= proof.design.speed
    (True, True)
    """
    check_kind("design", design, Design)
    if design.task.objective.is_smooth:
        raise ArgumentError(
            f"a proof is not available for {design.task.objective.minimise}; design for speed, "
            "peak_spike_load or peak_actuator_force"
        )
    wanted = Certify(gap, time_limit)
    known = design.survey.bounded
    return Certified(design, bounded(design.task, design.value, wanted, report, known))
