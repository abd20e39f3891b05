"""A boundary value problem: equations along [0, 1] and conditions at both ends."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from wormopt.errors import ArgumentError

__all__ = ["BoundaryProblem"]


@dataclass(frozen=True, eq=False)
class BoundaryProblem:
    """States y(s) with dy/ds = ode(y, p, given), 0 <= s <= 1, and conditions at the ends.

    Parameters
    ----------
    y : casadi.SX, shape (n_y, 1)
        Symbols of the states.
    p : casadi.SX, shape (n_p, 1)
        Symbols of numbers that are unknown too.
    given : casadi.SX, shape (n_given, 1)
        Symbols of numbers that are given, those by which solutions are followed.
    ode : casadi.SX, shape (n_y, 1)
        Expression of y, p and given.
    start, end : casadi.SX, shape (n_y, 1)
        Symbols of the states at 0 and at 1.
    conditions : casadi.SX, shape (n_y + n_p, 1)
        Expressions of start, end, p and given that are 0.
    names : tuple of str
        Of the states.

    Raises
    ------
    ArgumentError
        If there are not as many conditions as states and unknown numbers.

    Examples
    --------
    The least rate p > 0 of y'' = -p² y between zeros, y'(0) = 1:

    >>> y, start, end = (ca.SX.sym(name, 2) for name in ("y", "start", "end"))
    >>> p, given = ca.SX.sym("p"), ca.SX.sym("given", 0)
    >>> zeros = ca.vertcat(start[0], end[0], start[1] - 1)
    >>> ode = ca.vertcat(y[1], -(p**2) * y[0])
    >>> BoundaryProblem(y, p, given, ode, start, end, zeros, ("y", "slope")).names
    ('y', 'slope')
    """

    y: ca.SX
    p: ca.SX
    given: ca.SX
    ode: ca.SX
    start: ca.SX
    end: ca.SX
    conditions: ca.SX
    names: tuple[str, ...]

    def __post_init__(self) -> None:
        n_y, n_p = self.y.numel(), self.p.numel()
        if self.conditions.numel() != n_y + n_p:
            raise ArgumentError(
                f"{n_y} states and {n_p} unknown numbers need {n_y + n_p} conditions, "
                f"not {self.conditions.numel()}"
            )
        sizes = {self.ode.numel(), self.start.numel(), self.end.numel(), len(self.names), n_y}
        if sizes != {n_y}:
            raise ArgumentError("ode, start, end and names must have one entry for each state")
