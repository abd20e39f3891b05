"""Inertia of point masses and of uniform rods between them that stretch evenly."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as ca


@dataclass(frozen=True, eq=False)
class RodMasses:
    """Constant mass matrix of a chain: diagonal, with rods tridiagonal in each component.

    A rod of mass m whose ends move with v_a and v_b has the kinetic energy
    m (|v_a|² + v_a v_b + |v_b|²) / 6, also while it stretches evenly.
    """

    points: ca.SX  # (n + 1,) masses
    rods: ca.SX | None = None  # (n,)

    def solve(self, forces: ca.SX) -> ca.SX:
        """Accelerations from forces, both stacked by mass."""
        if self.rods is None:
            return forces / ca.vec(ca.repmat(self.points.T, 2, 1))
        F = ca.horzsplit(ca.reshape(forces, 2, self.points.numel()))
        pivots, shares = self._factors
        for i, share in enumerate(shares, start=1):
            F[i] = F[i] - share * F[i - 1]
        last = len(F) - 1
        a = [F[last] / pivots[last]]
        for i in range(last - 1, -1, -1):
            a.insert(0, F[i] / pivots[i] - shares[i] * a[0])
        return ca.vertcat(*a)

    @cached_property
    def _diagonal(self) -> list[ca.SX]:
        thirds = self.rods / 3
        return ca.vertsplit(self.points + ca.vertcat(thirds, 0) + ca.vertcat(0, thirds))

    @cached_property
    def _factors(self) -> tuple[list[ca.SX], list[ca.SX]]:
        """Pivots, and shares of the row above that are taken off."""
        beside = ca.vertsplit(self.rods / 6)
        pivots, shares = [self._diagonal[0]], []
        for own, off in zip(self._diagonal[1:], beside, strict=True):
            shares.append(off / pivots[-1])
            pivots.append(own - off * shares[-1])
        return pivots, shares

    def kinetic(self, v: ca.SX) -> ca.SX:
        """Kinetic energy."""
        columns = ca.reshape(v, 2, self.points.numel())
        energy = ca.dot(self.points, ca.sum1(columns**2).T) / 2
        if self.rods is None:
            return energy
        a, b = columns[:, :-1], columns[:, 1:]
        return energy + ca.dot(self.rods, ca.sum1(a**2 + a * b + b**2).T) / 6

    def center(self, stacked: ca.SX) -> ca.SX:
        """Mean (2) over all mass of what changes linearly along the rods."""
        shares = self.points
        if self.rods is not None:
            shares = shares + (ca.vertcat(self.rods, 0) + ca.vertcat(0, self.rods)) / 2
        columns = ca.reshape(stacked, 2, self.points.numel())
        return columns @ shares / ca.sum1(shares)
