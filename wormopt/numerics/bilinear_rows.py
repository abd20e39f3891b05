"""Rows and columns of a bilinear program under construction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from wormopt.numerics.linear_program import Columns, Term

# First and second factor, one per row or one for all, and the coefficient.
Product = tuple["np.ndarray | int", "np.ndarray | int", "np.ndarray | float"]


@dataclass
class BilinearRows(Columns):
    """Rows of a bilinear program under construction, added in blocks, and its columns."""

    count: int = 0  # rows so far
    _sides: list[tuple[int, Any, Any]] = field(default_factory=list)
    _linear: list[tuple[Any, ...]] = field(default_factory=list)
    _products: list[tuple[Any, ...]] = field(default_factory=list)

    def add(
        self,
        linear: Sequence[Term],
        products: Sequence[Product],
        lower: np.ndarray | float,
        upper: np.ndarray | float,
    ) -> np.ndarray:
        """Add the rows lower <= linear terms + products <= upper; returns their numbers.

        Terms (columns, coefficients) and products (columns, columns, coefficients) are
        broadcast; those with a column -1 are left out. Sides may be infinite.
        """
        terms = (*linear, *products)
        factors = (factor for term in terms for factor in term[:-1])
        size = max((f.size for f in factors if isinstance(f, np.ndarray)), default=1)
        rows = np.arange(self.count, self.count + size)
        self._linear += [(rows, *term) for term in linear]
        self._products += [(rows, *term) for term in products]
        self._sides.append((size, lower, upper))
        self.count += size
        return rows

    def terms(self) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """All linear terms and all products: rows, columns or both factors, coefficients."""
        return _stacked(self._linear, 3), _stacked(self._products, 4)

    def sides(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper sides of all rows."""
        lower, upper = (
            np.concatenate([np.full(side[0], side[k]) for side in self._sides]) for k in (1, 2)
        )
        return lower, upper


def _stacked(terms: list[tuple[Any, ...]], width: int) -> list[np.ndarray]:
    """Columns of a list of terms, numbers broadcast to the rows, without omitted ones."""
    edges = np.cumsum([0, *(len(term[0]) for term in terms)]).tolist()
    parts = [np.empty(edges[-1], int) for _ in range(width - 1)] + [np.empty(edges[-1])]
    for term, *ends in zip(terms, edges, edges[1:], strict=False):
        for part, value in zip(parts, term, strict=True):
            part[slice(*ends)] = value
    there = np.all([part >= 0 for part in parts[1:-1]], axis=0)
    return [part[there] for part in parts]
