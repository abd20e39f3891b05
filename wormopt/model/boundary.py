"""A boundary value problem: equations along [0, 1] and conditions at both ends."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from wormopt.errors import ArgumentError


@dataclass(frozen=True, eq=False)
class BoundaryProblem:
    """States y(s) with dy/ds = ode(y, p, given), 0 <= s <= 1, and conditions at the ends.

    Raises ArgumentError unless there are n_y + n_p conditions.
    """

    y: ca.SX  # (n_y, 1) symbols of the states
    p: ca.SX  # (n_p, 1) symbols of unknown numbers
    given: ca.SX  # (n_given, 1) symbols of the parameters of continuation
    ode: ca.SX  # (n_y, 1) in y, p and given
    start: ca.SX  # (n_y, 1) symbols of the states at 0
    end: ca.SX  # (n_y, 1) symbols of the states at 1
    conditions: ca.SX  # (n_y + n_p, 1) in start, end, p and given; 0 for solutions
    names: tuple[str, ...]  # of the states

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
