"""Periodic motions of a driven Model by shooting, and their Floquet multipliers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wormopt.errors import ArgumentError, SolveError
from wormopt.model.model import Model
from wormopt.model.values import by_name, check_names, signal_values
from wormopt.numerics.newton import newton
from wormopt.progress import Report, silent
from wormopt.simulation.options import Exact, Tolerance, Treatment
from wormopt.simulation.simulate import simulate
from wormopt.simulation.trajectory import Trajectory

# Changes of the start by which the return map is differentiated, in nominal sizes, and last steps
# that are as good as none.
_APART, _LAST_STEP = 1e-5, 1e-10


@dataclass(frozen=True, eq=False)
class PeriodicOrbit:
    """A motion that repeats after a period, but for states that only go on, as places do.

    Parameters
    ----------
    motion : Trajectory
        One period of it.
    drift : float
        Largest change of a returning state over the period, in nominal sizes.
    multipliers : ndarray of complex, shape (n,)
        Of the returning states, that of the largest size first (Floquet): small deviations are
        multiplied by them in a period.
    """

    motion: Trajectory
    drift: float
    multipliers: NDArray[np.complex128]

    @property
    def stable(self) -> bool:
        """Whether all that is near it comes to it."""
        return bool(abs(self.multipliers[0]) < 1)


class _Returns:
    """Change of the returning states over a period, for `newton`."""

    def __init__(self, model: Model, period: float, names: Sequence[str], **how: object) -> None:
        self.model, self.period, self._how = model, period, how
        rows = np.concatenate([np.full(s.size, s.name in names) for s in model.x])
        sizes = np.concatenate([np.full(s.size, s.nominal) for s in model.x])
        self.rows, self.nominal = rows, sizes[rows]
        self.start = np.zeros(len(rows))

    def motion(self, z: np.ndarray, **how: object) -> Trajectory:
        """A period from returning states ``z``."""
        x0 = self.start.copy()
        x0[self.rows] = z
        named = by_name(self.model.x, x0)
        return simulate(self.model, self.period, x0=named, **self._how, **how)  # type: ignore[arg-type]

    def __call__(self, x: np.ndarray, p: np.ndarray) -> np.ndarray:
        return np.array([self.motion(z).end[self.rows] - z for z in x])

    def slopes(self, x: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Of the change, by central differences."""
        steps = np.diag(_APART * self.nominal)
        columns = [
            [(self(z[None] + d, p) - self(z[None] - d, p))[0] / (2 * d.sum()) for d in steps]
            for z in x
        ]
        return np.swapaxes(np.array(columns), 1, 2)


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
    report: Report = silent,
) -> PeriodicOrbit:
    """Find a motion that repeats after the period of what drives a model.

    Parameters
    ----------
    model : Model
        What moves; what drives it has the period.
    period : float
        After which the motion repeats.
    returning : sequence of str, optional
        Names of the states that return; all if left out. Others, places say, only go on, and
        must not act on them.
    x0, p : mapping of str to array_like, optional
        First guess of states, and parameters, by name, where they are not the model's own.
    contact : Exact or Smooth, optional
        How contacts are treated.
    tolerance : Tolerance, optional
        How exact each simulation is.
    samples : int, optional
        Equidistant instants of the motion to keep, both ends included.
    report : callable, optional
        Told how far it is, see `wormopt.progress`.

    Returns
    -------
    PeriodicOrbit

    Raises
    ------
    ArgumentError
        If the period is not positive, or no state returns.
    UnknownNameError
        If the model has no such state.
    SolveError
        If none is found near the guess ("no_periodic_motion"), or a simulation gives up.

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
        raise ArgumentError("a periodic orbit has a positive period and states that return")
    report("looking for a periodic motion", None)
    returns = _Returns(model, period, names, contact=contact, p=p, tolerance=tolerance)
    returns.start = signal_values(model.x, x0, "state", fill=0.0)
    guess = returns.start[returns.rows]
    (z,), (found,) = newton(returns, guess[None], np.zeros(0), last_step=_LAST_STEP)
    if not found:
        raise SolveError(
            "no motion that repeats was found near the guess",
            "start from a motion that has settled, or take another period",
            code="no_periodic_motion",
        )
    motion = returns.motion(z, times=np.linspace(0.0, period, samples))
    change = (motion.end[returns.rows] - z) / returns.nominal
    monodromy = returns.slopes(z[None], np.zeros(0))[0] + np.eye(len(z))
    multipliers = np.linalg.eigvals(monodromy).astype(complex)
    order = np.argsort(-np.abs(multipliers), kind="stable")
    return PeriodicOrbit(motion, float(np.abs(change).max()), multipliers[order])
