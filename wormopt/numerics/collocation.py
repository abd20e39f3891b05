"""Collocation on one interval [0, 1]: nodes, integration matrices, and Bernstein coefficients."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import comb
from typing import Literal, get_args

import numpy as np
from numpy.polynomial import legendre

from wormopt.model.given import check_choice, whole

Scheme = Literal["legendre", "radau"]


@dataclass(frozen=True)
class Collocation:
    """Collocation with ``degree`` points on [0, 1], written as an implicit Runge-Kutta method.

    Parameters
    ----------
    degree : int
        Number of points and degree of the state polynomials, at least 1.
    scheme : {"legendre", "radau"}, optional
        Gauss-Legendre points (order 2 degree) or right Radau points (order 2 degree - 1).

    Raises
    ------
    ArgumentError
        If the degree is not a whole number above 0, or the scheme is unknown.

    Examples
    --------
    >>> Collocation(2).B
    array([0.5, 0.5])
    """

    degree: int
    scheme: Scheme = "legendre"

    def __post_init__(self) -> None:
        object.__setattr__(self, "degree", whole("degree", self.degree, 1))
        check_choice("scheme", self.scheme, get_args(Scheme))

    @cached_property
    def tau(self) -> np.ndarray:
        """Collocation points in (0, 1], shape (degree,)."""
        if self.scheme == "legendre":
            nodes, _ = legendre.leggauss(self.degree)
        else:  # right Radau: roots of P_d - P_{d-1}
            series = np.zeros(self.degree + 1)
            series[-2:] = -1.0, 1.0
            nodes = legendre.legroots(series).real
            nodes[-1] = 1.0
        return (nodes + 1) / 2

    @cached_property
    def nodes(self) -> np.ndarray:
        """Nodes of the state polynomials: 0 and the points, shape (degree + 1,)."""
        return np.concatenate([[0.0], self.tau])

    @cached_property
    def A(self) -> np.ndarray:
        """Integrals of the Lagrange polynomials from 0 to each point, shape (degree, degree)."""
        return self._integrals_to(self.tau)

    @cached_property
    def B(self) -> np.ndarray:
        """Quadrature weights on [0, 1], shape (degree,)."""
        return self._integrals_to(np.ones(1))[0]

    def _integrals_to(self, ends: np.ndarray) -> np.ndarray:
        # Legendre's basis is well conditioned at any useful degree
        primitives = legendre.legint(np.eye(self.degree), lbnd=-1) / 2
        to_end = legendre.legval(2 * ends - 1, primitives)
        return np.linalg.solve(legendre.legvander(2 * self.tau - 1, self.degree - 1).T, to_end).T


def bernstein_matrix(nodes: np.ndarray) -> np.ndarray:
    """Matrix from values at nodes to Bernstein coefficients of the interpolating polynomial.

    `nodes` (d + 1,) in [0, 1]. A polynomial stays between its smallest and largest
    coefficient, so bounds on them hold at every instant, not only at nodes.
    """
    d = len(nodes) - 1
    k = np.arange(d + 1)
    s = np.asarray(nodes)[:, None]
    binomial = np.array([comb(d, j) for j in k])
    return np.linalg.inv(binomial * s**k * (1 - s) ** (d - k))
