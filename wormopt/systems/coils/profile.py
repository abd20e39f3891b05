"""Profiles z = h(x) over an interval that balance at every point and hold a given area.

A `Profile` is data; `Collocation` turns it into as many equations as unknowns: the balance at
the inner Chebyshev points, a condition at each wall, and the area. Derivatives by the values of
h are those of the balance, by CasADi, times the matrices that differentiate polynomials.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import casadi as ca
import numpy as np
from numpy.polynomial import chebyshev

from wormopt.errors import ArgumentError, UnknownNameError

Walls = Literal["upright", "pinned"]


@dataclass(frozen=True, eq=False)
class Profile:
    """A profile h(x) with balance(x, h, h', h'', level, load) = 0 and a given mean.

    Without load h = level = mean. Raises ArgumentError if the interval is empty or the mean
    not above 0.
    """

    x: ca.SX  # symbol, as all up to `load`
    h: ca.SX
    slope: ca.SX  # h'
    bend: ca.SX  # h''
    level: ca.SX  # constant that the area fixes
    load: ca.SX  # grows from 0
    balance: ca.SX  # of the dimension of h; 0 where the profile rests
    ends: tuple[float, float]  # interval, left end first
    mean: float  # of h, above 0
    walls: Walls = "upright"  # at both ends: "upright" h' = 0, "pinned" h = mean

    def __post_init__(self) -> None:
        if not self.ends[0] < self.ends[1] or not self.mean > 0:
            raise ArgumentError("a profile has an interval, left end first, and a mean above 0")


@dataclass(frozen=True, eq=False)
class Nodes:
    """Chebyshev points of [-1, 1] with their ends, and matrices for values at them."""

    x: np.ndarray  # (n + 1,) points, ascending
    to_series: np.ndarray  # (n + 1, n + 1) values to Chebyshev coefficients
    first: np.ndarray  # (n + 1, n + 1) values to those of h'
    second: np.ndarray  # (n + 1, n + 1) values to those of h''
    weights: np.ndarray  # (n + 1,) Clenshaw-Curtis: values to the integral


def nodes_of(n: int) -> Nodes:
    """Chebyshev points of degree n."""
    k = np.arange(n + 1)
    x = np.sin(np.pi * (2 * k - n) / (2 * n))
    # L. N. Trefethen, Spectral Methods in MATLAB, 2000, chapter 6; the differences of points by
    # a product of sines and the diagonal by the sum of each row, both for the last digits
    sizes = np.where((k == 0) | (k == n), 2.0, 1.0) * (-1.0) ** k
    i, j = np.meshgrid(k, k, indexing="ij")
    apart = 2 * np.sin(np.pi * (i - j) / (2 * n)) * np.cos(np.pi * (i + j - n) / (2 * n))
    first = np.outer(sizes, 1 / sizes) / (apart + np.eye(n + 1))
    first -= np.diag(first.sum(axis=1))
    halves = np.where((k == 0) | (k == n), 0.5, 1.0)
    # T_i at the points, from angles: ascending points have the angle pi (n - k) / n
    cosines = np.cos(np.pi * np.outer(k, n - k) / n)
    to_series = 2 / n * halves[:, None] * cosines * halves[None, :]
    even = np.where(k % 2 == 0, 2.0 / (1.0 - k * k + (k == 1)), 0.0)
    return Nodes(x, to_series, first, first @ first, even @ to_series)


class Collocation:
    """Equations of a `Profile`, for `Walk` and for Newton's method; degree `n` at least 4.

    Unknowns (n + 2,) are h at the points and the level, scaled such that a flat profile has
    Euclidean norm about 1 whatever the number of points.
    """

    def __init__(self, profile: Profile, n: int) -> None:
        if n < 4:
            raise ArgumentError(f"a degree of {n} is too low; take at least 4")
        self.profile, self.n = profile, n
        self.nodes = nodes_of(n)
        left, right = profile.ends
        self.half = (right - left) / 2
        self.x = (left + right) / 2 + self.half * self.nodes.x
        self._first, self._second = self.nodes.first / self.half, self.nodes.second / self.half**2
        self.nominal = np.full(n + 2, profile.mean * np.sqrt(n + 2))
        local = ca.vertcat(profile.h, profile.slope, profile.bend, profile.level, profile.load)
        given = ca.vertcat(profile.x, local)
        slopes = ca.gradient(profile.balance, local)
        rows = ca.vertcat(profile.balance, slopes)
        self._local = ca.Function("local", [given], [rows], {"cse": True})
        self._last: tuple[bytes, np.ndarray] | None = None

    def flat(self) -> np.ndarray:
        """Unknowns of the profile without load, shape (n + 2,)."""
        return np.full(self.n + 2, self.profile.mean)

    def place(self, name: str) -> int:
        """Row of a parameter; "load" is the only one, others raise UnknownNameError."""
        if name != "load":
            raise UnknownNameError("a profile", "parameter", [name], ["load"])
        return 0

    def slope_by(self, name: str) -> Any:
        """Derivative of the equations by "load", as a function (unknowns, [load]) to a column."""
        self.place(name)

        def by_load(y: np.ndarray, p: np.ndarray) -> np.ndarray:
            found = self._pieces(y, p[0])[5] / self.profile.mean
            return np.concatenate([[0.0], found[1:-1], [0.0, 0.0]])[:, None]

        return by_load

    def __call__(self, x: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Residuals (m, n + 2) at unknowns `x` (m, n + 2) and load `p` (1,), over the mean.

        Columns: wall, balance at inner points, wall, area.
        """
        return np.array([self._residual(y, np.ravel(p)[0]) for y in x])

    def slopes(self, x: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Jacobians (m, n + 2, n + 2) at unknowns `x` (m, n + 2) and load `p` (1,)."""
        return np.array([self._jacobian(y, np.ravel(p)[0]) for y in x])

    def newton(
        self, y: np.ndarray, load: float, steps: int = 30, tolerance: float = 1e-10
    ) -> tuple[np.ndarray, bool]:
        """Newton's method at one load, each step shortened until the equations improve.

        Returns the unknowns (n + 2,) and whether the last step was below `tolerance`, over
        the mean.
        """
        rest = self._residual(y, load)
        for _ in range(steps):
            matrix = self._jacobian(y, load)
            if not np.isfinite(matrix).all() or not np.linalg.slogdet(matrix)[0]:
                return y, False
            step = np.linalg.solve(matrix, -rest)
            if np.abs(step).max() < tolerance * self.profile.mean:
                return y + step, True
            share = 1.0
            while share > 1e-3:
                ahead = self._residual(y + share * step, load)
                if np.linalg.norm(ahead) < (1 - share / 4) * np.linalg.norm(rest):
                    break
                share /= 2
            y, rest = y + share * step, self._residual(y + share * step, load)
        return y, False

    def at(self, y: np.ndarray, x: Any, order: int = 0) -> np.ndarray:
        """Values (m,) of h, or of a derivative of it, anywhere in the interval."""
        series = chebyshev.chebder(self.nodes.to_series @ y[:-1], order) / self.half**order
        left, right = self.profile.ends
        return chebyshev.chebval((2 * np.asarray(x) - left - right) / (right - left), series)

    def tail(self, y: np.ndarray) -> float:
        """Largest of the last coefficients of h, over its mean: how well it is resolved."""
        series = self.nodes.to_series @ y[:-1]
        return float(np.abs(series[-max(4, self.n // 16) :]).max() / self.profile.mean)

    def defect(self, y: np.ndarray, load: float) -> float:
        """Largest residual of the balance between the points, over the mean."""
        x = (self.x[:-1] + self.x[1:]) / 2
        h = [self.at(y, x, order) for order in range(3)]
        rest = self._evaluate(x, h, y[-1], load)[0]
        return float(np.abs(rest).max() / self.profile.mean)

    def rates_of_growth(self, y: np.ndarray, load: float) -> np.ndarray:
        """Eigenvalues of area-keeping deviations if the surface moved as the balance drives.

        Largest real part first; the profile is stable if this is below 0.
        """
        from scipy.linalg import eigvals

        moving = np.zeros(self.n + 2)
        moving[1:-2] = 1  # the walls and the area hold at any time
        found: Any = eigvals(self._jacobian(y, load), np.diag(moving))
        found = found[np.isfinite(found) & (np.abs(found) < 1e12)]
        return found[np.argsort(-found.real)]

    def _pieces(self, y: np.ndarray, load: float) -> np.ndarray:
        # residual, Jacobian and derivative by the load are asked for at the same place in turn
        key = np.append(y, load).tobytes()
        if self._last is None or self._last[0] != key:
            h = y[:-1]
            values = (h, self._first @ h, self._second @ h)
            self._last = key, self._evaluate(self.x, values, y[-1], load)
        return self._last[1]

    def _evaluate(self, x: np.ndarray, h: Any, level: float, load: float) -> np.ndarray:
        """Balance and its derivatives by h, h', h'', level and load, shape (6, m)."""
        rows = [x, *h, np.full(len(x), level), np.full(len(x), load)]
        return np.array(self._local(np.vstack(rows)))

    def _residual(self, y: np.ndarray, load: float) -> np.ndarray:
        wanted = self.profile.mean
        inner = self._pieces(y, load)[0, 1:-1]
        ends = np.array([y[0], y[-2]]) - wanted
        if self.profile.walls == "upright":
            ends = self.half * (self._first[[0, -1]] @ y[:-1])
        area = self.nodes.weights @ y[:-1] / 2 - wanted
        return np.concatenate([ends[:1], inner, ends[1:], [area]]) / wanted

    def _jacobian(self, y: np.ndarray, load: float) -> np.ndarray:
        pieces, n = self._pieces(y, load), self.n
        found = np.zeros((n + 2, n + 2))
        found[:-1, :-1] = pieces[2][:, None] * self._first + pieces[3][:, None] * self._second
        found[range(n + 1), range(n + 1)] += pieces[1]
        found[:-1, -1] = pieces[4]
        found[[0, n]] = 0.0
        if self.profile.walls == "upright":
            found[[0, n], :-1] = self.half * self._first[[0, n]]
        else:
            found[0, 0] = found[n, n] = 1.0
        found[-1, :-1] = self.nodes.weights / 2
        return found / self.profile.mean
