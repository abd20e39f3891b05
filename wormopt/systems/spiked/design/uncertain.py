"""Gaits for a worm with measured parameters: limits hold for all parameters in an ellipsoid.

Without gliding, spike loads, actuator forces and sigma are linear in masses, drag and loads. The
worst case over a confidence ellipsoid is therefore closed form at every time. The gait is designed
for a range of loads. Where its worst case still exceeds a limit, the range is widened to have the
same effect there, and the gait is designed anew.

A worm on dry ground is such a worm too, as long as some mass rests and none moves backward: the
sliding friction forward is a load on every mass, resting or not, and a resting mass then carries at
most the sum of its friction forward and backward.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from msgspec import structs
from scipy.special import fdtri

from wormopt.errors import ArgumentError, SolveError
from wormopt.progress import Report, silent
from wormopt.systems.spiked.crawl import Crawl
from wormopt.systems.spiked.design.design import Design
from wormopt.systems.spiked.design.optimize import designed
from wormopt.systems.spiked.gait_problem import GaitProblem, Objective, Search, Worm
from wormopt.systems.spiked.limits import Limits
from wormopt.systems.spiked.stretches import Drive, Stretch

Burden = Literal["total", "actuators", "grip"]
# Sampling points of a stretch (cosines); factor for values in between.
_INSTANTS, _BETWEEN = 129, 1.01
# Largest number of designs until the range is wide enough; each range is wider by this factor.
_ROUNDS, _WIDER = 12, 1.05

Widths = tuple[float, float]
"""How far a range of loads reaches below and above the estimate."""


@dataclass(frozen=True, eq=False)
class Believed:
    """Estimated parameters of a worm with their covariance.

    `slopes` (parameters, k) are derivatives of `numbers` by the k coordinates of the fit, and
    `covariance` (k, k) is that of the coordinates.
    """

    mass: tuple[float, ...]
    drag: float
    load: tuple[float, ...]  # on each mass
    slopes: np.ndarray
    covariance: np.ndarray
    freedom: float = math.inf  # readings minus estimated parameters; inf if the noise is known
    grip: tuple[float, ...] = ()  # largest load of each resting mass, if it was fitted
    beside: np.ndarray | None = None  # slopes (any, k) of other parameters in the same ellipsoid

    def __post_init__(self) -> None:
        size, k = len(self.numbers), len(self.covariance)
        if self.slopes.shape != (size, k) or self.covariance.shape != (k, k):
            raise ArgumentError(
                f"slopes {self.slopes.shape} and covariance {self.covariance.shape} must have the "
                f"shapes ({size}, k) and (k, k)"
            )

    @classmethod
    def of_one_load(
        cls,
        mass: tuple[float, ...],
        drag: float,
        load: float,
        covariance: np.ndarray,
        freedom: float = math.inf,
    ) -> Believed:
        """Parameters of a worm with spikes and the same load on all masses.

        The order of the covariance (n+3, n+3) is masses, drag, load. Rows of known parameters are
        0.
        """
        masses = len(mass)
        if covariance.shape != (masses + 2, masses + 2):
            raise ArgumentError(
                f"the covariance has shape {covariance.shape}, but must be {masses + 2} by "
                f"{masses + 2}"
            )
        fitted = np.diag(covariance) != 0
        slopes = np.eye(masses + 2)[[*range(masses + 1), *[masses + 1] * masses]][:, fitted]
        known = covariance[np.ix_(fitted, fitted)]
        return cls(mass, drag, (load,) * masses, slopes, known, freedom)

    @property
    def numbers(self) -> np.ndarray:
        """Masses, head first, drag, the load on each mass, and the grips if they were fitted."""
        return np.array([*self.mass, self.drag, *self.load, *self.grip])

    @property
    def names(self) -> list[str]:
        """Names of `numbers`."""
        each = [(name, len(getattr(self, name))) for name in ("mass", "load", "grip")]
        mass, load, grip = ([f"{name}[{i}]" for i in range(size)] for name, size in each)
        return [*mass, "drag", *load, *grip]

    @property
    def mean_load(self) -> float:
        """Mean of the loads, on which the motion depends."""
        return float(np.mean(self.load))

    @property
    def _counts(self) -> np.ndarray:
        """Which coordinates the numbers depend on."""
        return np.any(self.slopes != 0, axis=0)

    @property
    def spread(self) -> np.ndarray:
        """Covariance of `numbers`."""
        known = self._counts
        slopes = self.slopes[:, known]
        return slopes @ self.covariance[np.ix_(known, known)] @ slopes.T

    def reach(self, confidence: float) -> float:
        """Radius of the confidence ellipsoid of all parameters, in standard deviations.

        By Scheffé's method: with this confidence, no linear combination is off by more.
        """
        beside = False if self.beside is None else np.any(self.beside != 0, axis=0)
        found = int(np.count_nonzero(self._counts | beside))
        freedom = min(self.freedom, 1e9)
        return math.sqrt(found * float(fdtri(found, freedom, confidence))) if found else 0.0

    def distance(self, numbers: np.ndarray) -> float:
        """Distance of other `numbers` in standard errors; within `reach` if covered."""
        known = self._counts
        off = np.linalg.lstsq(self.slopes[:, known], np.asarray(numbers) - self.numbers)[0]
        return math.sqrt(off @ np.linalg.solve(self.covariance[np.ix_(known, known)], off))

    def worm(self, widths: Widths = (0.0, 0.0)) -> Worm:
        """Worm with a range of loads of these widths; no load is below 0."""
        least = min(self.load)
        load = (max(0.0, least - widths[0]), least + widths[1]) if any(widths) else least
        beyond = tuple(each - least for each in self.load)
        return Worm(
            len(self.mass) - 1, self.mass, self.drag, load, pull=beyond if any(beyond) else None
        )


@dataclass(frozen=True, eq=False)
class Robust:
    """A gait that meets its limits for all parameters in the ellipsoid, and its derivation."""

    design: Design
    nominal: Design  # the optimal gait if the estimates were exact
    widths: Widths  # of the range of loads of the design
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
    if believed.grip:
        limits = structs.replace(limits, spike_load=believed.grip)
    nominal = designed(GaitProblem(believed.worm(), limits, objective), search, report)
    quick = structs.replace(search, sequence=nominal.sequence, phases=None)
    reach = believed.reach(confidence)
    found, widths = nominal, (0.0, 0.0)
    for made in range(1, _ROUNDS + 1):
        needed = needed_widths(found.motion_under(believed.mean_load), believed, reach, limits)
        if needed[0] <= widths[0] and needed[1] <= widths[1]:
            return Robust(found, nominal, widths, reach, made)
        wider = zip(widths, needed, strict=True)
        below, above = (_WIDER * need if need > width else width for width, need in wider)
        if below > min(believed.load):
            raise SolveError(
                f"the load is known only to {min(believed.load):.4g} -{below:.2g}, with the "
                "errors of all parameters: the worm might be pulled forward",
                "record longer, with less noise, or a gait with larger accelerations",
            )
        widths = below, above
        found = designed(GaitProblem(believed.worm(widths), limits, objective), quick, report)
    raise SolveError(
        f"the range of loads did not converge in {_ROUNDS} designs",
        "record longer or with less noise to reduce the uncertainty",
    )


def needed_widths(motion: Crawl, believed: Believed, reach: float, limits: Limits) -> Widths:
    """Widths of the range of loads that affects a gait like the worst parameters in reach.

    Only instants count at which these exceed a limit.
    """
    needed, masses = [0.0, 0.0], len(believed.mass)
    for stretch in motion.stretches:
        for burden, low, high in _limits_of(stretch, believed, limits):
            slopes = _slopes(motion.drive, stretch, burden)
            force = np.tensordot(believed.numbers[: len(slopes)], slopes, 1)
            off = _BETWEEN * reach * _errors(slopes, believed)
            by_load = slopes[masses + 1 : 2 * masses + 1].sum(axis=0)
            for sign, limit in ((-1, -low), (1, high)):
                over = (sign * force + off > limit) & (off > 0)
                if np.any(over & (np.abs(by_load) < 1e-9)):
                    raise SolveError(
                        "the force of an actuator between resting masses does not depend on the "
                        "load, so no range of loads covers its error",
                        f"remove {limits.name}.actuator_force, or write resting = 1",
                    )
                for side, way in enumerate((-1, 1)):
                    there = over & (way * sign * by_load > 0)
                    worst = float((off[there] / np.abs(by_load[there])).max(initial=0.0))
                    needed[side] = max(needed[side], worst)
    return needed[0], needed[1]


def _limits_of(
    stretch: Stretch, believed: Believed, limits: Limits
) -> Iterator[tuple[Burden, float | np.ndarray, float | np.ndarray]]:
    """Burdens with their limits, which broadcast to (forces, m)."""
    masses, most = len(believed.mass), np.inf
    if not believed.grip and limits.spike_load is not None:
        spikes = np.broadcast_to(limits.spike_load, masses)[list(stretch.resting)]
        most = len(spikes) * float(spikes.min())
    yield "total", masses * limits.sigma_margin, most
    if believed.grip:
        yield "grip", -np.inf, 0.0
    if limits.actuator_force is not None:
        force = np.broadcast_to(limits.actuator_force, masses - 1)[:, None]
        yield "actuators", -force, force


def _errors(slopes: np.ndarray, believed: Believed) -> np.ndarray:
    """Standard errors (forces, m) of forces with these slopes by `Believed.numbers`."""
    spread = believed.spread[: len(slopes), : len(slopes)]
    variance = np.einsum("pqm,pr,rqm->qm", slopes, spread, slopes)
    return np.sqrt(np.maximum(variance, 0.0))


def _instants(stretch: Stretch) -> np.ndarray:
    turn = np.cos(np.pi * np.arange(_INSTANTS) / (_INSTANTS - 1))
    return (stretch.start + stretch.stop - (stretch.stop - stretch.start) * turn) / 2


def _slopes(drive: Drive, stretch: Stretch, burden: Burden) -> np.ndarray:
    """Derivatives (parameters, forces, m) of forces by `Believed.numbers`, while masses rest."""
    masses, resting = len(drive.mass), list(stretch.resting)
    s = _instants(stretch)
    v, a = drive.kinematic(stretch.piece, stretch.leader, s)
    each = np.zeros((2 * masses + 1, masses, len(s)))  # force of each mass on what holds it
    one = np.arange(masses)
    each[one, one], each[masses], each[masses + 1 + one, one] = a, v, 1.0
    total = each.sum(axis=1, keepdims=True)
    if burden == "total":
        return total
    if burden == "grip":
        shared = np.repeat(total / len(resting), len(resting), axis=1)
        grips = np.zeros((masses, len(resting), len(s)))
        grips[resting, np.arange(len(resting))] = -1.0
        return np.concatenate([shared, grips])
    shares = np.zeros((masses, 1))
    shares[resting] = 1 / len(resting)
    return np.cumsum(shares * total - each, axis=1)[:, :-1]


def _check(believed: Believed, limits: Limits, confidence: float) -> None:
    if not 0.5 <= confidence < 1:
        raise ArgumentError(f"confidence must be from 0.5 to below 1, not {confidence!r}")
    if limits.sharing != "equal":
        raise ArgumentError(
            f'sharing is "{limits.sharing}", but errors propagate linearly only with "equal"; '
            'write "equal"'
        )
    unknown = np.any(believed.slopes[:, ~np.isfinite(np.diag(believed.covariance))] != 0, axis=1)
    if unknown.any():
        listed = ", ".join(name for name, lost in zip(believed.names, unknown, strict=True) if lost)
        raise SolveError(
            f"{listed} cannot be identified from the recordings",
            "record a gait in which every mass rests and moves, or give known values",
        )


# -- comparison with the real worm -----------------------------------------------------------------


def on_plant(design: Design, plant: Worm) -> Crawl:
    """Motion of a worm with other parameters under a design's gait."""
    return replace(design, task=structs.replace(design.task, worm=plant)).motion


def load_band(design: Design, believed: Believed, reach: float) -> tuple[np.ndarray, ...]:
    """Times (m,), mean load of the resting masses, and its worst-case error.

    Where grips were fitted, it is instead what the load leaves of the weakest grip.
    """
    motion = design.motion_under(believed.mean_load)
    times, loads, errors = [], [], []
    for stretch in motion.stretches:
        burden: Burden = "grip" if believed.grip else "total"
        s, slopes = _instants(stretch), _slopes(motion.drive, stretch, burden)
        held = np.tensordot(believed.numbers[: len(slopes)], slopes, 1)
        error = reach * _errors(slopes, believed)
        k = np.argmax(held + error, axis=0), np.arange(len(s))
        shared = 1 if believed.grip else max(len(stretch.resting), 1)
        times.append(motion.gait.breaks[stretch.piece] + s)
        loads.append((-held[k] if believed.grip else held[k]) / shared)
        errors.append(error[k] / shared)
    return np.concatenate(times), np.concatenate(loads), np.concatenate(errors)
