"""Gaits for a worm whose numbers were measured: limits hold wherever the numbers may lie.

Spike loads, actuator forces and sigma are linear in masses, drag and load while the worm does not
glide. So a gait's worst case over a confidence ellipsoid is closed form, at every time, and some
half width of the load does to every limit at least as much. Designed is for that range of loads;
how wide it must be is read off the gait, until both agree.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.special import fdtri

from wormopt.errors import ArgumentError, SolveError
from wormopt.progress import Report, silent
from wormopt.systems.spiked.crawl import Crawl, crawl
from wormopt.systems.spiked.design.design import Design
from wormopt.systems.spiked.design.optimize import designed
from wormopt.systems.spiked.limits import Limits
from wormopt.systems.spiked.stretches import Drive, Stretch
from wormopt.systems.spiked.task import GaitProblem, Objective, Search, Worm

Burden = Literal["total", "actuators"]
# Instants of a stretch that are looked at, by cosines; what lies between them is this much more.
_INSTANTS, _BETWEEN = 33, 1.01
# Designs that are made until the range is as wide as its gait asks; each is so much wider.
_ROUNDS, _WIDER = 8, 1.05


@dataclass(frozen=True, eq=False)
class Believed:
    """Numbers of a worm with their covariance, as a fit leaves them.

    The order of the covariance is the masses, head first, the drag, the load: (n+3, n+3). Rows of
    what is known are 0.
    """

    mass: tuple[float, ...]
    drag: float
    load: float
    covariance: np.ndarray
    freedom: float = math.inf  # readings less numbers found; inf where the noise was known

    def __post_init__(self) -> None:
        size = len(self.mass) + 2
        if self.covariance.shape != (size, size):
            raise ArgumentError(f"the covariance must be {size} by {size}")

    @property
    def numbers(self) -> np.ndarray:
        """The numbers in the covariance's order."""
        return np.array([*self.mass, self.drag, self.load])

    def reach(self, confidence: float) -> float:
        """Standard deviations by which no linear combination of the numbers is off, all at once.

        Scheffe's: with this confidence the true numbers lie in the ellipsoid of this radius.
        """
        found = int(np.count_nonzero(np.diag(self.covariance)))
        freedom = min(self.freedom, 1e9)
        return math.sqrt(found * float(fdtri(found, freedom, confidence))) if found else 0.0

    def distance(self, numbers: np.ndarray) -> float:
        """How far other numbers (n+3,) are, in standard errors: within `reach` they are covered."""
        found = np.diag(self.covariance) > 0
        off = (np.asarray(numbers) - self.numbers)[found]
        return math.sqrt(off @ np.linalg.solve(self.covariance[np.ix_(found, found)], off))

    def worm(self, width: float) -> Worm:
        """The worm with a range of loads, as wide to both sides; no load is below 0."""
        low, high = max(0.0, self.load - width), self.load + width
        return Worm(len(self.mass) - 1, self.mass, self.drag, (low, high) if width else self.load)


@dataclass(frozen=True, eq=False)
class Robust:
    """A gait that keeps its limits wherever the numbers may lie, and how it came about."""

    design: Design
    nominal: Design  # the best gait if the numbers were as believed
    width: float  # half the range of loads for which it is designed
    needed: float  # what its own worst case asks for
    reach: float  # standard deviations that are covered
    rounds: int  # designs that were made


def design_believed(
    believed: Believed,
    limits: Limits,
    objective: Objective = Objective(),  # noqa: B008  frozen
    confidence: float = 0.9999,
    search: Search = Search(),  # noqa: B008  frozen
    report: Report = silent,
) -> Robust:
    """Design the best gait that keeps its limits with this confidence.

    The order of rest is that of the best gait for the numbers believed. Raises ArgumentError where
    limits are not linear in the numbers, SolveError where no gait is found or the numbers are not
    known well enough.
    """
    _check(believed, limits, confidence)
    nominal = designed(GaitProblem(believed.worm(0.0), limits, objective), search, report)
    quick = replace(search, sequence=nominal.sequence, phases=None)
    reach = believed.reach(confidence)
    found, width = nominal, 0.0
    for made in range(1, _ROUNDS + 1):
        needed = needed_width(found.motion_under(believed.load), believed, reach, limits)
        if needed <= width:
            return Robust(found, nominal, width, needed, reach, made)
        width = _WIDER * needed
        if width > believed.load:
            raise SolveError(
                f"the load is known to {believed.load:.4g} +- {width:.2g} only, all numbers' "
                "errors counted in: the worm might be pulled forward",
                "record longer, with less noise, or a gait with larger accelerations",
            )
        task = GaitProblem(believed.worm(width), limits, objective)
        found = designed(task, quick, report)
    raise SolveError(
        f"the range of loads did not settle in {_ROUNDS} designs",
        "record longer or with less noise, so that less is uncertain",
    )


def needed_width(motion: Crawl, believed: Believed, reach: float, limits: Limits) -> float:
    """Half the range of loads that is as bad for a gait as any numbers within reach."""
    burdens: list[Burden] = ["total"]
    if limits.actuator_force is not None:
        burdens.append("actuators")
    worst = 0.0
    for stretch in motion.stretches:
        for burden in burdens:
            slopes = _slopes(motion.drive, stretch, burden)
            off = _errors(slopes, believed.covariance)
            by_load = np.abs(slopes[-1])
            if np.any((by_load < 1e-9) & (off > 0)):
                raise SolveError(
                    "an actuator between resting masses does not feel the load, so that no range "
                    "of loads covers its error",
                    "leave out limits.actuator_force, or resting above 1",
                )
            worst = max(worst, float((off / by_load).max()))
    return _BETWEEN * reach * worst


def _errors(slopes: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Standard errors (forces, m) of forces with these slopes."""
    variance = np.einsum("pqm,pr,rqm->qm", slopes, covariance, slopes)
    return np.sqrt(np.maximum(variance, 0.0))


def _instants(stretch: Stretch) -> np.ndarray:
    turn = np.cos(np.pi * np.arange(_INSTANTS) / (_INSTANTS - 1))
    return (stretch.start + stretch.stop - (stretch.stop - stretch.start) * turn) / 2


def _slopes(drive: Drive, stretch: Stretch, burden: Burden) -> np.ndarray:
    """Derivatives of forces by masses, drag and load, (n+3, forces, m), while masses rest."""
    masses = len(drive.mass)
    s = _instants(stretch)
    v, a = drive.kinematic(stretch.piece, stretch.leader, s)
    each = np.zeros((masses + 2, masses, len(s)))  # what each mass asks of what holds it
    each[np.arange(masses), np.arange(masses)] = a
    each[masses], each[masses + 1] = v, 1.0
    total = each.sum(axis=1, keepdims=True)
    if burden == "total":
        return total
    shares = np.zeros((masses, 1))
    shares[list(stretch.resting)] = 1 / len(stretch.resting)
    return np.cumsum(shares * total - each, axis=1)[:, :-1]


def _check(believed: Believed, limits: Limits, confidence: float) -> None:
    if not 0.5 <= confidence < 1:
        raise ArgumentError(f"confidence must be from 0.5 to below 1, not {confidence!r}")
    if limits.sharing != "equal":
        raise ArgumentError("the numbers' errors go into loads linearly only with equal sharing")
    if not np.all(np.isfinite(believed.covariance)):
        names = [*(f"mass[{i}]" for i in range(len(believed.mass))), "drag", "load"]
        unknown = np.flatnonzero(~np.isfinite(np.diag(believed.covariance)))
        told = ", ".join(names[k] for k in unknown)
        raise SolveError(
            f"the recordings do not tell {told}",
            "record a gait in which every mass rests and every mass moves, or give what is known",
        )


# -- beside the truth ------------------------------------------------------------------------------


def on_plant(design: Design, plant: Worm) -> Crawl:
    """How the worm with other numbers crawls with a design's gait."""
    limits = design.task.limits
    load = plant.load_range[1]
    loads = plant.loads(load)
    return crawl(design.gait, plant.masses, plant.drag, loads, limits.sharing, limits.spike_load)


def load_band(design: Design, believed: Believed, reach: float) -> tuple[np.ndarray, ...]:
    """Time (m,), the load of a resting spike, and by how much it may be off at worst."""
    motion = design.motion_under(believed.load)
    times, loads, errors = [], [], []
    for stretch in motion.stretches:
        s, slopes = _instants(stretch), _slopes(motion.drive, stretch, "total")
        shared = max(len(stretch.resting), 1)
        times.append(motion.gait.breaks[stretch.piece] + s)
        loads.append(np.tensordot(believed.numbers, slopes[:, 0], 1) / shared)
        errors.append(reach * _errors(slopes, believed.covariance)[0] / shared)
    return np.concatenate(times), np.concatenate(loads), np.concatenate(errors)
