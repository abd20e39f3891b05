"""Periodic motions of a driven Model by shooting, their Floquet multipliers and derivatives.

Returning states z satisfy P(z, p) = z, with the return map P over a period T. Its slopes P_z are
exact if motions can be differentiated; the orbit then changes with parameters and period by
dz = (1 - P_z)^-1 (P_p dp + z' dT), the implicit function theorem, unless a multiplier is 1.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wormopt.errors import ArgumentError, SolveError
from wormopt.model.model import Model
from wormopt.model.values import by_name, check_names, nominal_of, signal_values
from wormopt.numerics.newton import newton
from wormopt.progress import Report, silent
from wormopt.simulation.functions import System
from wormopt.simulation.options import Exact, Tolerance, Treatment
from wormopt.simulation.simulate import simulate
from wormopt.simulation.trajectory import Trajectory
from wormopt.simulation.variation import Sensitivities, has_derivatives

# Changes of the start, in nominal sizes, to differentiate the return map of motions without exact
# derivatives; negligible last steps.
_APART, _LAST_STEP = 1e-5, 1e-10
# Least over largest singular value of 1 - P_z below which the orbit is not isolated.
_SINGULAR = 1e-7


@dataclass(frozen=True, eq=False)
class PeriodicOrbit:
    """A motion that repeats after a period, except for advancing states, such as positions.

    Parameters
    ----------
    motion : Trajectory
        One period of the motion. Its derivatives are those of the orbit: the start changes with a
        direction, so the motion still repeats; advancing states keep their start.
    drift : float
        Largest change of a returning state over the period, in nominal sizes.
    multipliers : ndarray of complex, shape (n,)
        Floquet multipliers of the returning states, the largest first: a period multiplies small
        deviations by them.
    start : ndarray, shape (n_x,)
        Initial state.
    period_derivative : ndarray, shape (k,)
        Derivatives of the period along the directions of ``motion``.

    Examples
    --------
    x'' + x' / 5 + x = cos t has the periodic solution 5 sin t:

    >>> import casadi as ca
    >>> import wormopt as wo
    >>> t, x, v = (ca.SX.sym(name) for name in "txv")
    >>> ode = ca.vertcat(v, ca.cos(t) - v / 5 - x)
    >>> swing = wo.Model("swing", [wo.Signal("place", x), wo.Signal("rate", v)], ode, t=t)
    >>> orbit = wo.periodic_orbit(swing, 2 * np.pi)
    >>> orbit.start.round(6) + 0.0, orbit.stable
    (array([0., 5.]), True)
    """

    motion: Trajectory
    drift: float
    multipliers: NDArray[np.complex128]
    start: np.ndarray
    period_derivative: np.ndarray = field(default_factory=lambda: np.zeros(0))

    @property
    def stable(self) -> bool:
        """Whether nearby motions converge to the orbit."""
        return bool(abs(self.multipliers[0]) < 1)

    def mean_rate(self, name: str) -> np.ndarray:
        """Mean rate (size,) of a state over the period; for a position, the mean speed.

        Parameters
        ----------
        name : str
            Name of the state.
        """
        return self._named((self.motion.end - self.start) / self.motion.end_time, name)

    def mean_rate_derivative(self, name: str) -> np.ndarray:
        """Derivative (size, k) of the mean rate of a state along the directions of ``motion``.

        Parameters
        ----------
        name : str
            Name of the state.

        Raises
        ------
        ArgumentError
            If the orbit was sought without ``sensitivities``.
        """
        if not self.motion.directions:
            raise ArgumentError("periodic_orbit needs sensitivities=[...] for derivatives")
        motion, period = self.motion, self.motion.end_time
        # at the end of a period, which changes too
        ahead = motion.end_derivative + np.outer(rate_at_end(motion), self.period_derivative)
        moved = ahead - motion.state_derivatives[:, :, 0]
        mean = (motion.end - self.start) / period
        return self._named((moved - np.outer(mean, self.period_derivative)) / period, name)

    def _named(self, values: np.ndarray, name: str) -> np.ndarray:
        signals = self.motion.system.model.x
        check_names({name: 0}, [s.name for s in signals], "state")
        return by_name(signals, values)[name]


def rate_at_end(motion: Trajectory) -> np.ndarray:
    """Time derivative (n_x,) of the state right before the end of a motion."""
    system, end = motion.system, motion.end_time
    at = np.array([np.nextafter(end, -np.inf)])
    p = system.scheduled(motion.p, motion.schedules, at)[:, 0]
    x = np.append(motion.end, np.zeros(system.n_pushes))
    return np.array(system.rhs(end, x, p, motion.s_at(at)[:, 0])).ravel()[: len(motion.end)]


class _Returns:
    """Change of the returning states over a period, as equations for `newton`."""

    def __init__(self, model: Model, period: float, names: Sequence[str], **how: object) -> None:
        self.model, self.period, self._how = model, period, how
        rows = np.concatenate([np.full(s.size, s.name in names) for s in model.x])
        sizes = nominal_of(model.x)
        self.rows, self.nominal = rows, sizes[rows]
        self.names = [s.name for s in model.x if s.name in names]
        self.start = np.zeros(len(rows))
        self._exact = has_derivatives(System(model, how["contact"]))  # type: ignore[arg-type]
        self._last: tuple[np.ndarray, Trajectory] | None = None

    def begin(self, z: np.ndarray) -> np.ndarray:
        """State (n_x,) with returning states ``z``."""
        x0 = self.start.copy()
        x0[self.rows] = z
        return x0

    def motion(self, z: np.ndarray, **how: object) -> Trajectory:
        """Motion over a period from returning states ``z``."""
        named = by_name(self.model.x, self.begin(z))
        return simulate(self.model, self.period, x0=named, **self._how, **how)  # type: ignore[arg-type]

    def _end(self, z: np.ndarray) -> np.ndarray:
        return self.motion(z, times=[]).end

    def _returned(self, z: np.ndarray) -> Trajectory:
        """Motion over a period, differentiated by its start if possible; the last one is cached."""
        if self._last is None or not np.array_equal(self._last[0], z):
            how = {"sensitivities": self.names} if self._exact else {}
            self._last = z.copy(), self.motion(z, times=[], **how)
        return self._last[1]

    def __call__(self, x: np.ndarray, p: np.ndarray) -> np.ndarray:
        return np.array([self._returned(z).end[self.rows] - z for z in x])

    def slopes(self, x: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Jacobians of the change."""
        return np.array([self.monodromy(z) for z in x]) - np.eye(x.shape[1])

    def stands_beside_others(self, monodromy: np.ndarray) -> bool:
        """Whether a multiplier is 1 but for rounding."""
        change = (np.eye(len(monodromy)) - monodromy) * self.nominal / self.nominal[:, None]
        sizes = np.linalg.svd(change, compute_uv=False)
        return not sizes[-1] > _SINGULAR * max(sizes[0], 1.0)

    def monodromy(self, z: np.ndarray) -> np.ndarray:
        """Slopes (n, n) of the return map, by central differences if none are exact."""
        if self._exact:
            return self._returned(z).end_derivative[self.rows]
        columns = [
            (self._end(z + d) - self._end(z - d))[self.rows] / (2 * d.sum())
            for d in np.diag(_APART * self.nominal)
        ]
        return np.array(columns).T


def periodic_orbit(
    model: Model,
    period: float,
    *,
    returning: Sequence[str] | None = None,
    x0: Mapping[str, ArrayLike] | None = None,
    p: Mapping[str, ArrayLike] | None = None,
    contact: Treatment = Exact(),  # noqa: B008  frozen
    tolerance: Tolerance = Tolerance(),  # noqa: B008  frozen
    samples: int = 201,
    sensitivities: Sensitivities | None = None,
    period_derivative: Mapping[str, float] | None = None,
    report: Report = silent,
) -> PeriodicOrbit:
    """Find a motion that repeats after the period of the excitation of a model.

    Parameters
    ----------
    model : Model
        Model, driven with this period.
    period : float
        After which the motion repeats.
    returning : sequence of str, optional
        Names of the states that return; all if left out. Others, places say, only go on, and
        must not act on them.
    x0, p : mapping of str to array_like, optional
        First guess of states, and parameters, by name, where they are not the model's own.
    contact : Exact or Smooth, optional
        Treatment of contacts.
    tolerance : Tolerance, optional
        Tolerance of each simulation.
    samples : int, optional
        Equidistant instants of the motion to keep, both ends included.
    sensitivities : sequence of str, or mapping of str to mapping, optional
        Parameters, inputs and values of schedules by which the orbit is differentiated, as
        `simulate` takes them.
    period_derivative : mapping of str to float, optional
        Derivative of the period along directions, by their labels, where it changes with them: for
        the frequency w of the excitation, -2 pi / w^2.
    report : callable, optional
        Receives the progress, see `wormopt.progress`.

    Returns
    -------
    PeriodicOrbit

    Raises
    ------
    ArgumentError
        If the period is not positive, no state returns, or sensitivities do not fit the model or
        are asked for of contacts that have none.
    UnknownNameError
        If the model has no such state.
    SolveError
        If none is found near the guess ("no_periodic_motion"), a simulation gives up, or
        derivatives are asked for where a multiplier is 1 ("singular").

    Examples
    --------
    A damped swing x'' + x' / 5 + x = cos t answers with 5 sin t; what is added to it fades by
    exp(-pi / 5) in a period:

    >>> import casadi as ca
    >>> from wormopt.model.model import Signal
    >>> t, x, v = (ca.SX.sym(name) for name in "txv")
    >>> ode = ca.vertcat(v, ca.cos(t) - v / 5 - x)
    >>> swing = Model("swing", x=[Signal("place", x), Signal("rate", v)], ode=ode, t=t)
    >>> orbit = periodic_orbit(swing, 2 * np.pi)
    >>> bool(abs(orbit.motion["rate"][0, 0] - 5) < 1e-8), orbit.stable
    (True, True)
    >>> bool(abs(abs(orbit.multipliers[0]) - np.exp(-np.pi / 5)) < 1e-8)
    True
    """
    model.refuse_delays("the search for a periodic motion")
    names = [signal.name for signal in model.x] if returning is None else list(returning)
    check_names(dict.fromkeys(names, 0), [signal.name for signal in model.x], "state")
    if not (names and 0 < period < np.inf):
        raise ArgumentError("a periodic orbit needs a positive period and returning states")
    report("looking for a periodic motion", None)
    returns = _Returns(model, period, names, contact=contact, p=p, tolerance=tolerance)
    returns.start = signal_values(model.x, x0, "state", fill=0.0)
    guess = returns.start[returns.rows]
    (z,), (found,) = newton(returns, guess[None], np.zeros(0), last_step=_LAST_STEP)
    if not found:
        raise SolveError(
            "no motion that repeats was found near the guess",
            "a multiplier is 1: leave states that only advance out of `returning`"
            if returns.stands_beside_others(returns.monodromy(z))
            else "start from a converged motion, or write another period",
            code="no_periodic_motion",
        )
    times = np.linspace(0.0, period, samples)
    monodromy = returns.monodromy(z)
    multipliers = np.linalg.eigvals(monodromy).astype(complex)
    order = np.argsort(-np.abs(multipliers), kind="stable")
    motion, moved = returns.motion(z, times=times), np.zeros(0)
    if sensitivities is not None:
        motion, moved = _differentiated(
            returns, z, monodromy, times, sensitivities, period_derivative or {}
        )
    change = (motion.end[returns.rows] - z) / returns.nominal
    return PeriodicOrbit(
        motion, float(np.abs(change).max()), multipliers[order], returns.begin(z), moved
    )


def _differentiated(
    returns: _Returns,
    z: np.ndarray,
    monodromy: np.ndarray,
    times: np.ndarray,
    sensitivities: Sensitivities,
    period_derivative: Mapping[str, float],
) -> tuple[Trajectory, np.ndarray]:
    """The orbit with its derivatives, and those of the period."""
    by_start = returns.motion(z, times=times, sensitivities=returns.names)
    motion = returns.motion(z, times=times, sensitivities=sensitivities)
    check_names(period_derivative, motion.directions, "direction")
    if motion.along is not None and np.any(motion.along.x0[returns.rows]):
        raise ArgumentError(
            f"an orbit does not depend on initial values of {', '.join(returns.names)}; name "
            "parameters, inputs and schedules"
        )
    longer = np.array([float(period_derivative.get(name, 0.0)) for name in motion.directions])
    if returns.stands_beside_others(monodromy):
        raise SolveError(
            "the orbit has no derivatives: a multiplier is 1, so it is not isolated",
            "leave states that only advance out of `returning`",
            code="singular",
        )
    ends = motion.end_derivative + np.outer(rate_at_end(motion), longer)
    begins = np.linalg.solve(np.eye(len(z)) - monodromy, ends[returns.rows])
    event_rows = motion.event_rows.copy()
    event_rows[:, 4:] += by_start.event_rows[:, 4:] @ begins
    along = np.einsum("inm,nk->ikm", by_start.state_derivatives, begins)
    motion = replace(
        motion,
        event_rows=event_rows,
        state_derivatives=motion.state_derivatives + along,
        end_derivative=motion.end_derivative + by_start.end_derivative @ begins,
    )
    return motion, longer
