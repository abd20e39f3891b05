"""What a step in Python is, and what takes one: `Explicit` of dop853.py, `Stiff` of radau.py."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import casadi as ca
import numpy as np

from wormopt.simulation.motion_task import Task

__all__ = ["Call", "GivenUp", "Step", "Stepper", "floor_of_step", "powers"]


class GivenUp(Exception):
    """A motion cannot be followed any further.

    Parameters
    ----------
    status : str
        Why, see `Outcome`.
    """

    def __init__(self, status: str) -> None:
        self.status = status
        super().__init__(status)


class Call:
    """A CasADi function called through its buffer, which costs a hundredth of an ordinary call.

    Parameters
    ----------
    function : casadi.Function
        With dense arguments and results.
    shared : sequence of (str, ndarray)
        Arguments that are not passed but read from these arrays, which the caller may rewrite.

    Examples
    --------
    >>> x, p = ca.SX.sym("x", 2), ca.SX.sym("p")
    >>> scale = np.ones(1)
    >>> call = Call(ca.Function("f", [x, p], [p * x], ["x", "p"], ["y"]), ("p", scale))
    >>> scale[:] = 3.0
    >>> call(np.array([1.0, 2.0]))[0]
    array([3., 6.])
    """

    def __init__(self, function: ca.Function, *shared: tuple[str, np.ndarray]) -> None:
        self._buffer, self._run = function.buffer()
        self._shared = arrays = dict(shared)  # kept alive: the buffer knows addresses only
        self._passed = []
        for i, name in enumerate(function.name_in()):
            array = arrays.get(name)
            if array is None:
                array = np.zeros(function.numel_in(i))
                self._passed.append(array)
            if array.size:
                self._buffer.set_arg(i, array.data)  # type: ignore[call-arg]
        self._results = [np.zeros(function.numel_out(i)) for i in range(function.n_out())]
        for i, result in enumerate(self._results):
            if result.size:
                self._buffer.set_res(i, result.data)  # type: ignore[call-arg]

    def __call__(self, *values: float | np.ndarray) -> list[np.ndarray]:
        """Evaluate; the results are overwritten by the next call, matrices flat by columns."""
        for place, value in zip(self._passed, values, strict=True):
            place[:] = value
        self._run()
        return self._results


def powers(s: float | np.ndarray) -> np.ndarray:
    """What the rows of a polynomial are multiplied by, see `Dense`.

    Parameters
    ----------
    s : float or ndarray, shape (m,)
        Fraction of the step.

    Returns
    -------
    ndarray, shape (8,) or (m, 8)

    Examples
    --------
    >>> powers(1.0)
    array([1., 1., 0., 0., 0., 0., 0., 0.])
    """
    r = 1 - s
    product = [np.ones_like(s)]
    for k in range(7):
        product.append(product[-1] * (r if k % 2 else s))
    return np.stack(product, axis=-1)


@dataclass(frozen=True, eq=False)
class Step:
    """An attempted step.

    Parameters
    ----------
    t, h, end : float
        Its start, length and end.
    x, x_new : ndarray, shape (n_x,)
        States there.
    dx, dx_new : ndarray, shape (n_x,)
        Their time derivatives.
    fit : callable
        Gives the rows of its polynomial.
    """

    t: float
    h: float
    end: float
    x: np.ndarray
    x_new: np.ndarray
    dx: np.ndarray
    dx_new: np.ndarray
    fit: Callable[[], np.ndarray]

    @cached_property
    def rows(self) -> np.ndarray:
        """Polynomial of the step, shape (8, n_x), see `Dense`."""
        return self.fit()

    def states(self, s: float | np.ndarray) -> np.ndarray:
        """States within the step.

        Parameters
        ----------
        s : float or ndarray, shape (m,)
            Fractions of it.

        Returns
        -------
        ndarray, shape (n_x,) or (m, n_x)
        """
        return powers(s) @ self.rows


def floor_of_step(task: Task, t: float) -> float:
    """Length below which a step is nothing but rounding.

    Parameters
    ----------
    task : Task
        What is integrated.
    t : float
        Time.

    Returns
    -------
    float
    """
    return 8 * float(np.finfo(float).eps) * max(abs(t), 1e-3 * (task.span[1] - task.span[0]))


class Stepper(Protocol):
    """What takes steps.

    ``h`` is the length that the next one shall have, at most.
    """

    h: float
    n_rejected: int
    n_evaluations: int

    def restart(self, t: float, x: np.ndarray) -> None:
        """Go on from another state, or with other parameters or modes.

        Parameters
        ----------
        t : float
            Time.
        x : ndarray, shape (n_x,)
            State.
        """
        ...

    def attempt(self, stop: float) -> Step | None:
        """Try a step.

        Parameters
        ----------
        stop : float
            Time that it must not pass.

        Returns
        -------
        Step or None
            None if it was too inexact; the next will be shorter.

        Raises
        ------
        GivenUp
            If it would have to be too short.
        """
        ...

    def redo(self, step: Step, length: float) -> Step:
        """Take the beginning of a step that was too long.

        Parameters
        ----------
        step : Step
            Just attempted.
        length : float
            How far to go.

        Returns
        -------
        Step
            It may end earlier if this is less exact than the whole.
        """
        ...

    def shorten(self, step: Step, factor: float) -> None:
        """Reject a step.

        Parameters
        ----------
        step : Step
            Just attempted.
        factor : float
            Length of the next one, relative to it.

        Raises
        ------
        GivenUp
            If that is too short.
        """
        ...

    def accept(self, step: Step) -> None:
        """Go on from the end of a step.

        Parameters
        ----------
        step : Step
            Just attempted.

        Raises
        ------
        GivenUp
            If the motion is too stiff to go on.
        """
        ...
