"""Steps in Python, of `Explicit` in dop853.py and `Stiff` in radau.py."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import numpy as np

from wormopt.simulation.initial_value import InitialValueProblem


class GivenUp(Exception):
    """A motion cannot be continued; for `status` see `Outcome`."""

    def __init__(self, status: str) -> None:
        self.status = status
        super().__init__(status)


@dataclass
class Kept:
    """Rows of time and state: every one, and once there are `most`, every 2nd, 4th, ..."""

    most: int
    rows: list[np.ndarray] = field(default_factory=list)
    _seen: int = 0
    _stride: int = 1

    def add(self, t: float, x: np.ndarray) -> None:
        """Keep or skip a row."""
        if self._seen % self._stride == 0:
            self.rows.append(np.append(t, x))
            if len(self.rows) == self.most:
                self.rows, self._stride = self.rows[::2], 2 * self._stride
        self._seen += 1


def powers(s: float | np.ndarray) -> np.ndarray:
    """Factors (8,) or (m, 8) of the rows of a polynomial, see `Dense`.

    `s` is the fraction of the step, a number or (m,).
    """
    r = 1 - s
    product = [np.ones_like(s)]
    for k in range(7):
        product.append(product[-1] * (r if k % 2 else s))
    return np.stack(product, axis=-1)


@dataclass(frozen=True, eq=False)
class Step:
    """An attempted step."""

    t: float  # start
    h: float  # length
    end: float
    x: np.ndarray  # (n_x,) state at `t`
    x_new: np.ndarray  # (n_x,) state at `end`
    dx: np.ndarray  # (n_x,) time derivative at `t`
    dx_new: np.ndarray  # (n_x,) time derivative at `end`
    fit: Callable[[], np.ndarray]  # returns the rows of its polynomial

    @cached_property
    def rows(self) -> np.ndarray:
        """Polynomial of the step, shape (8, n_x), see `Dense`."""
        return self.fit()

    def states(self, s: float | np.ndarray) -> np.ndarray:
        """States (n_x,) or (m, n_x) at fractions of the step, a number or (m,)."""
        return powers(s) @ self.rows


def floor_of_step(task: InitialValueProblem, t: float) -> float:
    """Length below which a step is rounding."""
    return 8 * float(np.finfo(float).eps) * max(abs(t), 1e-3 * (task.span[1] - task.span[0]))


class Stepper(Protocol):
    """Interface of integrators in steps.

    ``h`` is the largest length of the next step.
    """

    h: float
    n_rejected: int
    n_evaluations: int

    def restart(self, t: float, x: np.ndarray) -> None:
        """Continue from another state, or with other parameters or modes."""
        ...

    def attempt(self, stop: float) -> Step | None:
        """Try a step not beyond `stop`; None if too inexact, and the next will be shorter.

        Raises GivenUp if it would have to be too short.
        """
        ...

    def redo(self, step: Step, length: float) -> Step:
        """Keep only the first `length` of the step just attempted, which was too long.

        It may end earlier if it is less accurate than the whole.
        """
        ...

    def shorten(self, step: Step, factor: float) -> None:
        """Reject the step just attempted; the next is `factor` times as long.

        Raises GivenUp if that is too short.
        """
        ...

    def accept(self, step: Step) -> None:
        """Continue from the end of the step just attempted.

        Raises GivenUp if the motion is too stiff.
        """
        ...
