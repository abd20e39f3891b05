"""Gaits for a worm with measured parameters: limits hold for all parameters in an ellipsoid.

Without gliding, spike loads, actuator forces and sigma are linear in masses, drag and load. The
worst case over a confidence ellipsoid is therefore closed form at every time. A range of loads of
some half width affects every limit at least as much. The gait is designed for such a range; the
needed width follows from the gait, and both are iterated until they agree.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from msgspec import structs
from scipy.special import fdtri

from wormopt.errors import ArgumentError, SolveError
from wormopt.progress import Report, silent
from wormopt.systems.spiked.crawl import Crawl, crawl
from wormopt.systems.spiked.design.design import Design
from wormopt.systems.spiked.design.optimize import designed
from wormopt.systems.spiked.gait_problem import GaitProblem, Objective, Search, Worm
from wormopt.systems.spiked.limits import Limits
from wormopt.systems.spiked.stretches import Drive, Stretch

Burden = Literal["total", "actuators"]
# Sampling points of a stretch (cosines); factor for values in between.
_INSTANTS, _BETWEEN = 33, 1.01
# Largest number of designs until the range is wide enough; each range is wider by this factor.
_ROUNDS, _WIDER = 8, 1.05


@dataclass(frozen=True, eq=False)
class Believed:
    """Estimated parameters of a worm with their covariance.

    The order of the covariance (n+3, n+3) is masses, head first, drag, load. Rows of known
    parameters are 0.
    """

    mass: tuple[float, ...]
    drag: float
    load: float
    covariance: np.ndarray
    freedom: float = math.inf  # readings minus estimated parameters; inf if the noise is known

    def __post_init__(self) -> None:
        size = len(self.mass) + 2
        if self.covariance.shape != (size, size):
            raise ArgumentError(
                f"the covariance has shape {self.covariance.shape}, but must be {size} by {size}"
            )

    @property
    def numbers(self) -> np.ndarray:
        """Parameters in the order of the covariance."""
        return np.array([*self.mass, self.drag, self.load])

    def reach(self, confidence: float) -> float:
        """Radius of the confidence ellipsoid of all parameters, in standard deviations.

        By Scheffé's method: with this confidence, no linear combination is off by more.
        """
        found = int(np.count_nonzero(np.diag(self.covariance)))
        freedom = min(self.freedom, 1e9)
        return math.sqrt(found * float(fdtri(found, freedom, confidence))) if found else 0.0

    def distance(self, numbers: np.ndarray) -> float:
        """Distance of other parameters (n+3,) in standard errors; within `reach` if covered."""
        found = np.diag(self.covariance) > 0
        off = (np.asarray(numbers) - self.numbers)[found]
        return math.sqrt(off @ np.linalg.solve(self.covariance[np.ix_(found, found)], off))

    def worm(self, width: float) -> Worm:
        """Worm with a range of loads of this half width; no load is below 0."""
        low, high = max(0.0, self.load - width), self.load + width
        return Worm(len(self.mass) - 1, self.mass, self.drag, (low, high) if width else self.load)


@dataclass(frozen=True, eq=False)
class Robust:
    """A gait that meets its limits for all parameters in the ellipsoid, and its derivation."""

    design: Design
    nominal: Design  # the optimal gait if the estimates were exact
    width: float  # half the range of loads of the design
    needed: float  # half range that its own worst case needs
    reach: float  # radius of the ellipsoid in standard deviations
    rounds: int  # number of designs


def design_believed(
    believed: Believed,
    limits: Limits,
    objective: Objective = Objective(),  # noqa: B008  frozen
    confidence: float = 0.9999,
    search: Search = Search(),  # noqa: B008  frozen
    report: Report = silent,
) -> Robust:
    """Design the optimal gait that meets its limits with the given confidence.

    The resting sequence is that of the optimal gait for the estimates. Raises ArgumentError if
    limits are not linear in the parameters, SolveError if no gait is found or the parameters are
    not known well enough.
    """
    _check(believed, limits, confidence)
    nominal = designed(GaitProblem(believed.worm(0.0), limits, objective), search, report)
    quick = structs.replace(search, sequence=nominal.sequence, phases=None)
    reach = believed.reach(confidence)
    found, width = nominal, 0.0
    for made in range(1, _ROUNDS + 1):
        needed = needed_width(found.motion_under(believed.load), believed, reach, limits)
        if needed <= width:
            return Robust(found, nominal, width, needed, reach, made)
        width = _WIDER * needed
        if width > believed.load:
            raise SolveError(
                f"the load is known only to {believed.load:.4g} +- {width:.2g}, with the errors "
                "of all parameters: the worm might be pulled forward",
                "record longer, with less noise, or a gait with larger accelerations",
            )
        task = GaitProblem(believed.worm(width), limits, objective)
        found = designed(task, quick, report)
    raise SolveError(
        f"the range of loads did not converge in {_ROUNDS} designs",
        "record longer or with less noise to reduce the uncertainty",
    )


def needed_width(motion: Crawl, believed: Believed, reach: float, limits: Limits) -> float:
    """Half the range of loads that affects a gait as much as the worst parameters in reach."""
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
                    "the force of an actuator between resting masses does not depend on the load, "
                    "so no range of loads covers its error",
                    f"remove {limits.name}.actuator_force, or write resting = 1",
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
    each = np.zeros((masses + 2, masses, len(s)))  # force of each mass on what holds it
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
        raise ArgumentError(
            f'sharing is "{limits.sharing}", but errors propagate linearly only with "equal"; '
            'write "equal"'
        )
    if not np.all(np.isfinite(believed.covariance)):
        names = [*(f"mass[{i}]" for i in range(len(believed.mass))), "drag", "load"]
        unknown = np.flatnonzero(~np.isfinite(np.diag(believed.covariance)))
        listed = ", ".join(names[k] for k in unknown)
        raise SolveError(
            f"{listed} cannot be identified from the recordings",
            "record a gait in which every mass rests and moves, or give known values",
        )


# -- comparison with the real worm -----------------------------------------------------------------


def on_plant(design: Design, plant: Worm) -> Crawl:
    """Motion of a worm with other parameters under a design's gait."""
    limits = design.task.limits
    load = plant.load_range[1]
    loads = plant.loads(load)
    return crawl(design.gait, plant.masses, plant.drag, loads, limits.sharing, limits.spike_load)


def load_band(design: Design, believed: Believed, reach: float) -> tuple[np.ndarray, ...]:
    """Times (m,), load of a resting spike, and its worst-case error."""
    motion = design.motion_under(believed.load)
    times, loads, errors = [], [], []
    for stretch in motion.stretches:
        s, slopes = _instants(stretch), _slopes(motion.drive, stretch, "total")
        shared = max(len(stretch.resting), 1)
        times.append(motion.gait.breaks[stretch.piece] + s)
        loads.append(np.tensordot(believed.numbers, slopes[:, 0], 1) / shared)
        errors.append(reach * _errors(slopes, believed.covariance)[0] / shared)
    return np.concatenate(times), np.concatenate(loads), np.concatenate(errors)
