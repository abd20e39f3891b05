"""Profiles z = h(x) over an interval that balance at every point, and fluid at rest at a coil.

A `Profile` is data; `Collocation` turns it into as many equations as unknowns: the balance at
the inner Chebyshev points, a condition at each wall, and the area. Derivatives by the values of
h are those of the balance, by CasADi, times differentiation matrices. `settle` continues a profile
under a load that grows from 0, and finds where it can no longer rest. `Rested` checks the balance
by independent formulas.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import casadi as ca
import numpy as np
from numpy.polynomial import chebyshev

from wormopt.analysis.continuation import Fold, Walk
from wormopt.errors import ArgumentError, UnknownNameError
from wormopt.magnetics.hydrostatics import Fluid, Placed, flat_layer_pull, pressure, pull
from wormopt.magnetics.material import MU0
from wormopt.numerics.newton import newton
from wormopt.numerics.roots import root
from wormopt.progress import Report, silent

Walls = Literal["upright", "pinned"]
Why = Literal["fold", "unstable", "floor", "ceiling", "lost"]
_LADDER = (64, 96, 128, 192, 256, 384, 512)
_FINE = 801  # number of points at which extremes are searched
_MOST_POINTS = 400
# Accepted difference of two degrees in the load at which a branch stops.
_AGREE = 1e-3
_HALVINGS = 24


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
    level: ca.SX  # constant that the area determines
    load: ca.SX  # grows from 0
    balance: ca.SX  # in the dimension of h; 0 at rest
    ends: tuple[float, float]  # interval, left end first
    mean: float  # of h, above 0
    walls: Walls = "upright"  # at both ends: "upright" h' = 0, "pinned" h = mean

    def __post_init__(self) -> None:
        if not self.ends[0] < self.ends[1] or not self.mean > 0:
            raise ArgumentError("a profile needs an interval, left end first, and a mean above 0")


@dataclass(frozen=True, eq=False)
class Nodes:
    """Chebyshev points of [-1, 1] with their ends, and matrices for values at them."""

    x: np.ndarray  # (n + 1,) points, ascending
    to_series: np.ndarray  # (n + 1, n + 1) values to Chebyshev coefficients
    first: np.ndarray  # (n + 1, n + 1) values to those of h'
    second: np.ndarray  # (n + 1, n + 1) values to those of h''
    weights: np.ndarray  # (n + 1,) Clenshaw-Curtis: values to the integral


def nodes_of(n: int) -> Nodes:
    """Return Chebyshev points of degree n."""
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
    Euclidean norm about 1 for any number of points.
    """

    def __init__(self, profile: Profile, n: int) -> None:
        if n < 4:
            raise ArgumentError(f"a degree of {n} is too low; give at least 4")
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
        """Return the unknowns of the profile without load, shape (n + 2,)."""
        return np.full(self.n + 2, self.profile.mean)

    def place(self, name: str) -> int:
        """Return the row of a parameter; "load" is the only one, others raise UnknownNameError."""
        if name != "load":
            raise UnknownNameError("a profile", "parameter", [name], ["load"])
        return 0

    def slope_by(self, name: str) -> Any:
        """Return the derivative by "load", as a function of (unknowns, [load]) to a column."""
        self.place(name)

        def by_load(y: np.ndarray, p: np.ndarray) -> np.ndarray:
            found = self._pieces(y, p[0])[5] / self.profile.mean
            return np.concatenate([[0.0], found[1:-1], [0.0, 0.0]])[:, None]

        return by_load

    def __call__(self, x: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Return residuals (m, n + 2) at unknowns `x` (m, n + 2) and load `p` (1,), over the mean.

        Columns: wall, balance at inner points, wall, area.
        """
        return np.array([self._residual(y, np.ravel(p)[0]) for y in x])

    def slopes(self, x: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Return Jacobians (m, n + 2, n + 2) at unknowns `x` (m, n + 2) and load `p` (1,)."""
        return np.array([self._jacobian(y, np.ravel(p)[0]) for y in x])

    def newton(self, y: np.ndarray, load: float) -> tuple[np.ndarray, bool]:
        """Return unknowns (n + 2,) at one load, and whether Newton's method converged."""
        (y,), (found,) = newton(self, y[None], np.array([load]))
        return y, bool(found)

    def at(self, y: np.ndarray, x: Any, order: int = 0) -> np.ndarray:
        """Return values (m,) of h, or of a derivative of it, anywhere in the interval."""
        series = chebyshev.chebder(self.nodes.to_series @ y[:-1], order) / self.half**order
        left, right = self.profile.ends
        return chebyshev.chebval((2 * np.asarray(x) - left - right) / (right - left), series)

    def tail(self, y: np.ndarray) -> float:
        """Return the largest of the last coefficients of h, over its mean: its resolution."""
        series = self.nodes.to_series @ y[:-1]
        return float(np.abs(series[-max(4, self.n // 16) :]).max() / self.profile.mean)

    def defect(self, y: np.ndarray, load: float) -> float:
        """Return the largest residual of the balance between the points, over the mean."""
        x = (self.x[:-1] + self.x[1:]) / 2
        h = [self.at(y, x, order) for order in range(3)]
        rest = self._evaluate(x, h, y[-1], load)[0]
        return float(np.abs(rest).max() / self.profile.mean)

    def rates_of_growth(self, y: np.ndarray, load: float) -> np.ndarray:
        """Return eigenvalues of area-preserving deviations if the balance drives the surface.

        Largest real part first; the profile is stable if this is below 0.
        """
        from scipy.linalg import eigvals, null_space

        slopes = self._jacobian(y, load)
        inner, level = slopes[1:-2, :-1], slopes[1:-2, -1:]
        # the walls and the area hold at any time; the level takes the value this needs
        ways, seen = null_space(np.delete(slopes, np.s_[1:-2], axis=0)[:, :-1]), null_space(level.T)
        found: Any = eigvals(seen.T @ inner @ ways, seen.T @ ways[1:-1])
        return found[np.argsort(-found.real)]

    def _pieces(self, y: np.ndarray, load: float) -> np.ndarray:
        # residual, Jacobian and derivative by the load are needed at the same point
        key = np.append(y, load).tobytes()
        if self._last is None or self._last[0] != key:
            h = y[:-1]
            values = (h, self._first @ h, self._second @ h)
            self._last = key, self._evaluate(self.x, values, y[-1], load)
        return self._last[1]

    def _evaluate(self, x: np.ndarray, h: Any, level: float, load: float) -> np.ndarray:
        """Return the balance and its derivatives by h, h', h'', level and load, shape (6, m)."""
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


@dataclass(frozen=True, eq=False)
class Stop:
    """Reason why a profile does not rest at the full load.

    `why`: "fold", no profile is near beyond it; "unstable", it moves sideways; "floor", "ceiling",
    it leaves its range; "lost", the steps became too short.
    """

    why: Why
    load: float  # share of the load at which it happens
    x: float  # position farthest from flat then, or out of range
    uncertainty: float  # change of `load` with the degree; NaN: single degree


@dataclass(frozen=True, eq=False)
class Settled:
    """A profile at rest, or the last one at rest."""

    equations: Collocation  # with the unknowns `y`
    y: np.ndarray  # (n + 2,) unknowns
    load: float  # share of the full load
    path: np.ndarray  # (m, 3) load, least and largest h along the branch
    stop: Stop | None  # why it stopped; None at the full load
    resolved: bool  # last coefficients are below the tolerance


def settle(
    profile: Profile,
    *,
    tolerance: float = 1e-8,
    degree: int = 256,
    floor: float = -np.inf,
    ceiling: float = np.inf,
    report: Report = silent,
) -> Settled:
    """Continue a profile from no load to the full one (1), with as many points as it needs.

    By arc length with the fewest points, then by Newton's method with more until the last
    coefficients over mean h are below `tolerance`. ArgumentError if `degree` is not in 64 to 512.
    """
    if not _LADDER[0] <= degree <= _LADDER[-1]:
        raise ArgumentError(f"a degree of {degree} is not within [{_LADDER[0]}, {_LADDER[-1]}]")
    found: Settled | None = None
    for n in (*(rung for rung in _LADDER if rung < degree), degree):
        equations = Collocation(profile, n)
        before, found = found, None
        if before is not None and before.stop is None:
            report(f"refining to degree {n}", None)
            found = _refined(equations, before, tolerance)
        if found is None:
            found = _Branch(equations, (floor, ceiling), report).follow(before, tolerance)
        agrees = found.stop is not None and found.stop.uncertainty <= _AGREE * found.stop.load
        if agrees or (found.stop is None and found.resolved):
            return found
    assert found is not None
    return found


def _refined(equations: Collocation, before: Settled, tolerance: float) -> Settled | None:
    start = np.append(before.equations.at(before.y, equations.x), before.y[-1])
    y, converged = equations.newton(start, 1.0)
    if not converged:
        return None
    return Settled(equations, y, 1.0, before.path, None, equations.tail(y) < tolerance)


class _Branch:
    """The branch of one collocation, from no load on."""

    def __init__(self, equations: Collocation, within: tuple[float, float], report: Report) -> None:
        self.equations, self.within, self.report = equations, within, report
        left, right = equations.profile.ends
        self.x = np.linspace(left, right, _FINE)
        self.walk = Walk(equations, "load", (0.0, 1.0), np.zeros(1), 1e3)
        self.points: list[np.ndarray] = []
        self.why: Why | None = None

    def follow(self, before: Settled | None, tolerance: float) -> Settled:
        """Walk until the full load, or a stop."""
        start = np.append(self.equations.flat(), 0.0)
        tangent = self.walk.tangent(start, None)
        self.points = [start]
        self.sign = self._sign(start)
        towards = tangent * np.sign(tangent[-1])
        points, folds, end = self.walk.go(start, towards, _MOST_POINTS, self._stops)
        y = points[-1]
        if end == "range":  # the last step up to the range is not reported
            self._stops(y, folds)
        elif self.why is None:
            self.why = "lost"
        stop = None
        if self.why is not None:
            y = self._located(folds) if self.why != "lost" else y
            stop = self._stop(y, before)
        path = np.array([(p[-1], *self._extremes(p)) for p in points])
        resolved = self.equations.tail(y[:-1]) < tolerance
        return Settled(self.equations, y[:-1], float(y[-1]), path, stop, resolved)

    def _stops(self, y: np.ndarray, folds: list[Fold]) -> bool:
        """Return whether the walk ends at this point, and set why."""
        self.report("raising the current", min(max(float(y[-1]), 0.0), 1.0))
        low, high = self._extremes(y)
        if low < self.within[0]:
            self.why = "floor"
        elif high > self.within[1]:
            self.why = "ceiling"
        elif folds:
            self.why = "fold"
        elif self._sign(y) != self.sign:
            self.why = "unstable"
        self.points.append(y)
        return self.why is not None

    def _located(self, folds: list[Fold]) -> np.ndarray:
        """Return where it stops, between the last two points."""
        if self.why == "fold":
            return np.append(folds[0].x, folds[0].parameter)
        tests: dict[Why | None, Callable[[np.ndarray], bool]] = {
            "floor": lambda y: self._extremes(y)[0] < self.within[0],
            "ceiling": lambda y: self._extremes(y)[1] > self.within[1],
            "unstable": lambda y: self._sign(y) != self.sign,
        }
        test, (before, after) = tests[self.why], self.points[-2:]
        tangent = self.walk.tangent(before, (after - before) / self.walk.size)
        low, high = 0.0, float(tangent @ ((after - before) / self.walk.size))
        found = after
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            y = self.walk.step(before, tangent, middle)
            if y is None or test(y):
                high, found = middle, found if y is None else y
            else:
                low = middle
        return found

    def _stop(self, y: np.ndarray, before: Settled | None) -> Stop:
        h = self.equations.at(y[:-1], self.x)
        mean = self.equations.profile.mean
        where = np.argmin(h) if self.why == "floor" else np.argmax(np.abs(h - mean))
        change = np.nan
        if before is not None and before.stop is not None and before.stop.why == self.why:
            change = abs(before.stop.load - float(y[-1]))
        assert self.why is not None
        return Stop(self.why, float(y[-1]), float(self.x[where]), change)

    def _extremes(self, y: np.ndarray) -> tuple[float, float]:
        h = self.equations.at(y[:-1], self.x)
        return float(h.min()), float(h.max())

    def _sign(self, y: np.ndarray) -> float:
        """Return the sign of the determinant, which changes where a single eigenvalue does."""
        matrix = self.equations.slopes(y[None, :-1], y[-1:])[0]
        return float(np.linalg.slogdet(matrix)[0])


_PANELS, _IN_PANEL, _UP = 24, 8, 14  # Gauss points along a panel of x, and over the height


@dataclass(frozen=True, eq=False)
class Rested:
    """A fluid at rest."""

    fluid: Fluid
    placed: Placed  # the coil and its place
    settled: Settled  # the surface
    current: float  # ampere-turns at which it rests, A

    @property
    def level(self) -> float:
        """Constant of the pressure over the weight per volume, in m."""
        return float(self.settled.y[-1])

    def surface(self, x: np.ndarray, order: int = 0) -> np.ndarray:
        """Return the height of the surface at positions (m,), in m, or a derivative of it."""
        return self.settled.equations.at(self.settled.y, x, order)

    def field(self, x: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return components Hx and Hz, in A/m, at places off the winding, in m."""
        Hx, Hz = self.placed.field(x, z)
        return self.current * Hx, self.current * Hz

    def magnetisation(self, Hx: np.ndarray, Hz: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return components Mx and Mz of M, which is along H; all in A/m."""
        ratio = np.asarray(self.fluid.magnetisation.ratio(Hx**2 + Hz**2))
        return ratio * Hx, ratio * Hz

    def pressure(self, x: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Return the pressure in the fluid, in Pa, at places in m."""
        Hx, Hz = self.field(x, z)
        return np.asarray(pressure(self.fluid, z, Hx**2 + Hz**2, self.level))

    @cached_property
    def quadrature(self) -> tuple[np.ndarray, np.ndarray]:
        """Gauss points in panels over the width, and weights."""
        nodes, weights = np.polynomial.legendre.leggauss(_IN_PANEL)
        left, right = self.settled.equations.profile.ends
        edges = np.linspace(left, right, _PANELS + 1)
        half = (right - left) / (2 * _PANELS)
        places = (edges[:-1] + half)[:, None] + half * nodes
        return places.ravel(), np.tile(half * weights, _PANELS)

    @cached_property
    def force(self) -> float:
        """Upward force of the field on the fluid, per depth of the trough, in N/m.

        It is the integral of mu0 (M grad) H_z over the fluid, by Gauss quadrature.
        """
        x, along = self.quadrature
        nodes, up = np.polynomial.legendre.leggauss(_UP)
        half = self.surface(x) / 2
        z = half[:, None] * (1 + nodes)
        density = self._pull_upwards(np.repeat(x, _UP), z.ravel()).reshape(z.shape)
        return float(along @ (half * (density @ up)))

    def _pull_upwards(self, x: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Return mu0 (M_x d/dx + M_z d/dz) H_z."""
        place = ca.SX.sym("place", 2)
        nearest = float(np.min(self.placed.clearance(x, z)))
        Hx, Hz = self.placed.field(place[0], place[1], self.placed.coil.nodes(nearest))
        steep = ca.Function("steep", [place], [ca.vertcat(Hx, Hz, ca.gradient(Hz, place))])
        Hx, Hz, by_x, by_z = self.current * np.array(steep(np.vstack([x, z])))
        Mx, Mz = self.magnetisation(Hx, Hz)
        return MU0 * (Mx * by_x + Mz * by_z)

    @cached_property
    def _at_surface(self) -> tuple[np.ndarray, np.ndarray, tuple[np.ndarray, np.ndarray]]:
        """Height, slope and field (A/m) at the points of the quadrature."""
        x, _ = self.quadrature
        h = self.surface(x)
        return h, self.surface(x, 1), self.field(x, h)

    @property
    def volume_error(self) -> float:
        """Relative difference of the volume by quadrature to that of the layer."""
        profile, (_, weights) = self.settled.equations.profile, self.quadrature
        volume = profile.mean * (profile.ends[1] - profile.ends[0])
        return float(abs(weights @ self._at_surface[0] / volume - 1))

    @property
    def force_imbalance(self) -> float:
        """Pressure on the bottom less all forces on it, over the weight.

        The jump of the stress is computed from M and the normal of the surface, not by `pull`: an
        error there would affect both the surface and its check.
        """
        fluid, (x, weights), (h, slope, field) = self.fluid, self.quadrature, self._at_surface
        bottom = weights @ self.pressure(x, np.zeros_like(x))
        weight = fluid.weight * float(weights @ h)
        Mx, Mz = self.magnetisation(*field)
        steep = np.arctan(slope)
        jump = MU0 / 2 * (Mz * np.cos(steep) - Mx * np.sin(steep)) ** 2
        at_walls = self.surface(np.array(self.settled.equations.profile.ends), 1)
        drawn = fluid.surface_tension * float(np.diff(at_walls / np.hypot(1, at_walls))[0])
        return float(abs(bottom - weight + self.force + weights @ jump + drawn) / weight)

    @property
    def field_error(self) -> float:
        """Error of the balance's field against one with more digits, over its largest value."""
        equations, (x, _), (h, slope, field) = (
            self.settled.equations, self.quadrature, self._at_surface,
        )  # fmt: skip
        profile, fluid = equations.profile, self.fluid
        given = [profile.x, profile.h, profile.slope, profile.bend, profile.level, profile.load]
        rest = ca.Function("rest", given, [profile.balance])
        bend = equations.at(self.settled.y, x, 2)
        places = (np.atleast_2d(values) for values in (x, h, slope, bend))
        wanted = np.array(rest(*places, self.level, self.settled.load)).ravel()
        curvature = -bend / (1 + slope**2) ** 1.5
        stress = pull(fluid, field, slope)
        exact = self.level - h + (stress - fluid.surface_tension * curvature) / fluid.weight
        size = max(float(np.max(np.abs(stress))) / fluid.weight, profile.mean)
        return float(np.max(np.abs(wanted - exact)) / size)

    @property
    def demagnetisation(self) -> float:
        """Relative change of the field's pull if the fluid weakens it as a flat layer does."""
        _, slope, field = self._at_surface
        neglecting = np.asarray(pull(self.fluid, field, slope))
        size = float(np.max(neglecting))
        if not size:
            return 0.0
        change = np.abs(np.asarray(flat_layer_pull(self.fluid, field, slope)) - neglecting)
        return float(np.max(change) / size)


def field_of_pressure(fluid: Fluid, pressure: float) -> float:
    """Return H, in A/m, at which mu0 times the integral of M over H is `pressure` > 0, in Pa."""

    def excess(size: float) -> float:
        return math.log(MU0 * float(fluid.magnetisation.energy(math.exp(2 * size))) / pressure)

    # the integral goes at least like H, at most like H²
    return math.exp(root(excess, -60.0, 120.0, xtol=1e-14))
