"""Trajectory: what `simulate` returns, a motion from its first instant to its last."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import casadi as ca
import numpy as np

from wormopt.core.model import Model
from wormopt.simulation.options import Treatment

__all__ = ["Dense", "Event", "Trajectory"]


@dataclass(frozen=True)
class Event:
    """An instant at which a contact changes its mode or a switch of the model fires.

    Parameters
    ----------
    time : float
        When.
    name : str
        Name of the contact or of the switch.
    kind : {"reversal", "stick", "release", "impact", "switch"}
        A velocity zero is a "reversal" (the contact slides on, in either direction) or a "stick";
        a "release" ends a stick; an "impact" is a velocity that jumps to zero.
    mode : int
        Direction of the contact from then on: +1, -1, or 0 at rest; 0 for a switch.

    Examples
    --------
    >>> Event(1.3, "mass 0", "stick", 0).kind
    'stick'
    """

    time: float
    name: str
    kind: str
    mode: int


@dataclass(frozen=True, eq=False)
class Dense:
    """Polynomials of every step.

    Parameters
    ----------
    time : ndarray, shape (steps + 1,)
        Ends of the steps.
    coefficients : ndarray, shape (steps, 8, n_x)
        For step k with s = (t - time[k]) / (time[k+1] - time[k]), r = 1 - s, the state is
        c0 + s (c1 + r (c2 + s (c3 + r (c4 + s (c5 + r (c6 + s c7)))))).

    Examples
    --------
    >>> line = np.zeros((1, 8, 1))
    >>> line[0, :2, 0] = 3.0, 2.0
    >>> Dense(np.array([0.0, 4.0]), line)(np.array([1.0]))
    array([[3.5]])
    """

    time: np.ndarray
    coefficients: np.ndarray

    def __call__(self, t: np.ndarray) -> np.ndarray:
        """States at times ``t`` (m,) within the motion; shape (n_x, m)."""
        step = np.clip(np.searchsorted(self.time, t, side="right") - 1, 0, len(self.time) - 2)
        s = (t - self.time[step]) / (self.time[step + 1] - self.time[step])
        value = np.zeros((len(t), self.coefficients.shape[2]))
        for k in range(7, 0, -1):
            value = (value + self.coefficients[step, k]) * (s if k % 2 else 1 - s)[:, None]
        return (value + self.coefficients[step, 0]).T


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A simulated motion.

    Parameters
    ----------
    model : Model
        What moves.
    treatment : Smooth or Exact
        How contact was treated.
    route : str
        What integrated it: "native", "python", "cvodes" or "idas".
    p : ndarray, shape (n_p + n_u,)
        Parameters, then inputs.
    time : ndarray, shape (m,)
        Sample times asked for; without any, start and end.
    states : ndarray, shape (n_x, m)
        States then; after a jump where one happens at that time.
    events : tuple of Event
        In order of time.
    modes : ndarray, shape (1 + changes, 1 + contacts)
        Each row a time and the contacts' modes (+1, -1, 0) from then on. Empty where contact was
        treated as smooth.
    n_steps, n_rejected, n_evaluations : int
        Accepted and rejected steps, evaluations of the ode.
    dense : Dense, optional
        The whole motion, where it was asked for.
    """

    model: Model
    treatment: Treatment
    route: str
    p: np.ndarray
    time: np.ndarray
    states: np.ndarray
    events: tuple[Event, ...] = ()
    modes: np.ndarray = field(default_factory=lambda: np.zeros((0, 1)))
    n_steps: int = 0
    n_rejected: int = 0
    n_evaluations: int = 0
    dense: Dense | None = None

    @property
    def end(self) -> np.ndarray:
        """Last state, shape (n_x,)."""
        return self.states[:, -1]

    @cached_property
    def _rows(self) -> dict[str, slice]:
        ends = np.cumsum([0, *(s.size for s in self.model.x)]).tolist()
        return {s.name: slice(a, b) for s, a, b in zip(self.model.x, ends, ends[1:], strict=False)}

    def state(self, name: str) -> np.ndarray:
        """Samples of one state signal.

        Parameters
        ----------
        name : str
            Name of a signal of ``model.x``.

        Returns
        -------
        ndarray, shape (size, m)

        Raises
        ------
        KeyError
            If there is none of that name.
        """
        return self.states[self._rows[name]]
