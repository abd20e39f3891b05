"""Options of simulations: treatment of contact and accuracy."""

from __future__ import annotations

import math
from dataclasses import dataclass
from numbers import Real
from typing import Literal

from wormopt.errors import ArgumentError
from wormopt.model.given import is_number, make_plain, whole


@dataclass(frozen=True)
class Smooth:
    """Contact forces by the regularised law, steep over the width ``v_reg`` of velocities.

    Parameters
    ----------
    v_reg : float, optional
        Width, positive. The chapter's is 1/40.

    Raises
    ------
    ArgumentError
        If ``v_reg`` is not positive and finite.

    Examples
    --------
    >>> Smooth().v_reg
    0.025
    """

    v_reg: float = 1 / 40

    def __post_init__(self) -> None:
        make_plain(self, "v_reg")
        if not (is_number(self.v_reg, 0.0) and self.v_reg > 0):
            raise ArgumentError(
                f"v_reg must be positive and finite, not {self.v_reg!r:.60}; for the limit "
                "v_reg = 0 use Exact()"
            )


@dataclass(frozen=True)
class Exact:
    """Set-valued contact laws: reversals, sticking and release are located as events.

    Examples
    --------
    >>> Exact()
    Exact()
    """


Treatment = Smooth | Exact


@dataclass(frozen=True)
class Tolerance:
    """Accuracy of each step, and limits of the number of steps.

    Parameters
    ----------
    relative : float, optional
        Error of a step against the size of a state.
    absolute : float, optional
        Error of a step against the state's nominal size.
    max_steps : int, optional
        Largest number of steps.
    max_step : float, optional
        Longest step; a fiftieth of the time if left out.
    stop : float, optional
        In the plane, share of a contact's usual speed below which it stops if it can be held; ten
        times the errors of a step if left out. Slower slip is not resolved: a larger one helps
        where masses are pressed against something stiff and hardly move.

    Raises
    ------
    ArgumentError
        If a value is not a number, a tolerance is not positive, or ``relative`` is below double
        precision.

    Examples
    --------
    >>> Tolerance(relative=1e-8).absolute
    1e-12
    """

    relative: float = 1e-11
    absolute: float = 1e-12
    max_steps: int = 10_000_000
    max_step: float | None = None
    stop: float | None = None

    def __post_init__(self) -> None:
        make_plain(self, "relative", "absolute", "max_steps", "max_step", "stop")
        for name in ("relative", "absolute", "max_step", "stop"):
            value = getattr(self, name)
            left_out = value is None and name in ("max_step", "stop")
            if not left_out and not (isinstance(value, Real) and not isinstance(value, bool)):
                raise ArgumentError(f"{name} must be a number, not {value!r:.60}")
        object.__setattr__(self, "max_steps", whole("max_steps", self.max_steps, 1))
        if not (1e-14 <= self.relative < 1 and 0 < self.absolute < math.inf):
            raise ArgumentError("tolerances must be positive and finite, relative from 1e-14 to 1")
        if self.max_step is not None and not self.max_step > 0:
            raise ArgumentError("max_step must be positive")
        if self.stop is not None and not 0 < self.stop <= 1e-3:
            raise ArgumentError("stop must be positive and at most 1e-3")


Recheck = bool | Literal["independent"]
"""Whether another route finds a motion again; "independent": one with no rules of contact."""

Route = Literal["auto", "native", "python", "radau", "cvodes"]
"""How to integrate: compiled, the same steps in Python, implicit steps in Python, CasADi's implicit
integrators; "auto" picks the first that can."""
