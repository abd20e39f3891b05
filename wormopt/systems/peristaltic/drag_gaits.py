"""The best gaits of a worm on drag: small ones in closed form, and those of any amplitude.

With strains e_j of period T, to second order in them, the displacement of a worm per period is
(a L / N) times the integral of e^T K e'. For a given cost, the integral of e'^T M e', the best gait
is one harmonic: e = Re(v exp(2 pi i t / T)), with the eigenvector v of i K v = k M v for the
largest k (its conjugate if a < 0). The displacement is |a| L T k / (2 pi N) times the cost.

Gaits of any amplitude are found by collocation. The Euler-Lagrange equations are a second route. In
units of length L, period and c0: with the displacement's integrand A(l) u, the cost's u^T M(l) u,
multipliers mu of the cost and nu of the mean lengths, and p = 2 mu M u - A, they are l' = u,
p' = d(-A u + mu u^T M u + nu l)/dl. They conserve an energy, so one of the conditions of
periodicity is redundant; a number delta, which results as zero, replaces it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import casadi as ca
import numpy as np
from scipy.linalg import eigh

from wormopt.errors import ArgumentError
from wormopt.model.gait import Gait
from wormopt.model.model import Model
from wormopt.numerics.boundary_values import BoundaryProblem, solve_boundary
from wormopt.ocp.contact import FixedModes
from wormopt.ocp.mesh import Mesh
from wormopt.ocp.motion import Guess, Motion
from wormopt.ocp.nlp import Ipopt
from wormopt.ocp.optimise import Optimum, optimise_multistart, refine
from wormopt.ocp.problem import Constraint, Ends, Problem
from wormopt.progress import Report, silent
from wormopt.systems.peristaltic.drag import centres, drag_worm

Cost = Literal["strain_rate", "dissipation"]


def area_matrix(segments: int) -> np.ndarray:
    """Return the matrix K (N, N) of the displacement: (sgn(j-k) - (j-k)/N) / 2."""
    j = np.arange(segments)
    apart = j[:, None] - j
    return (np.sign(apart) - apart / segments) / 2


def cost_matrix(segments: int, cost: Cost) -> np.ndarray:
    """Return the matrix M (N, N) of a cost: squared strain rates, or dissipation over c0 L^2."""
    if cost == "strain_rate":
        return np.eye(segments)
    S = centres(segments)
    return S.T @ S + np.eye(segments) / 12


def mean_step(mode: np.ndarray) -> float:
    """Return the mean phase step of a harmonic (N,) between segments; weak ones count less."""
    return float(np.angle(np.sum(mode[1:] * mode[:-1].conj())))


@dataclass(frozen=True, eq=False)
class SmallGait:
    """A harmonic gait that is locally optimal."""

    gain: float  # k
    mode: np.ndarray  # (N,) complex amplitudes v of strains, of cost 1: v^H M v = 1

    @property
    def steps(self) -> np.ndarray:
        """Phase (N - 1,) of each segment less that of the segment before, in (-pi, pi]."""
        return np.angle(self.mode[1:] / self.mode[:-1])

    @property
    def step(self) -> float:
        """Mean of `steps`, by `mean_step`."""
        return mean_step(self.mode)

    @property
    def amplitudes(self) -> np.ndarray:
        """Amplitudes (N,) over the largest."""
        size = np.abs(self.mode)
        return size / size.max()

    def displacement(
        self, exponent: float, effort: float, length: float = 1, period: float = 1
    ) -> float:
        """Return the displacement per period at a cost: integral of e'^T M e'."""
        N = len(self.mode)
        return abs(exponent) * length * period * self.gain * effort / (2 * np.pi * N)

    def scaled(self, effort: float, period: float) -> np.ndarray:
        """Return complex amplitudes (N,) of the strains at a cost per period."""
        return self.mode * np.sqrt(2 * effort * period) / (2 * np.pi)

    def gait(self, effort: float, length: float = 1.0, period: float = 1.0) -> Gait:
        """Return the lengths over a period at a cost."""
        v = length * self.scaled(effort, period)
        return Gait(
            np.array([0.0, period]),
            np.full((1, len(v), 1), length),
            np.array([2 * np.pi / period]),
            v.real[None],
            -v.imag[None],
        )


def small_gaits(
    segments: int, exponent: float, cost: Cost = "strain_rate", *, fixed_total: bool = False
) -> list[SmallGait]:
    """Return the harmonic gaits that move forward, the best first; only the first is an optimum.

    Theory: docs/theory-peristaltic.md, section 4.

    Parameters
    ----------
    segments : int
        Number of segments N.
    exponent : float
        Exponent a of the drag law.
    cost : {"strain_rate", "dissipation"}, optional
        Kind of effort to minimise.
    fixed_total : bool, optional
        Whether the total length of the worm is constant.

    Returns
    -------
    list of SmallGait
        Each has ``gain``, ``displacement(exponent, effort)`` and ``gait(effort)``.

    Raises
    ------
    ArgumentError
        If no gait has a net displacement: exponent 0, or a single free segment.

    Examples
    --------
    >>> round(small_gaits(3, 1.0)[0].gain, 9)
    0.5
    """
    if exponent == 0 or segments < 2 + fixed_total:
        raise ArgumentError(
            "no gait has a net displacement: give an exponent other than 0, and more segments"
        )
    K, M = np.sign(exponent) * area_matrix(segments), cost_matrix(segments, cost)
    basis = np.eye(segments)
    if fixed_total:
        basis = np.linalg.qr(np.column_stack([np.ones(segments), basis[:, 1:]]))[0][:, 1:]
    gains, modes = eigh(1j * basis.T @ K @ basis, basis.T @ M @ basis)
    forward = np.flatnonzero(gains > 1e-9)[::-1]
    return [SmallGait(float(gains[k]), basis @ modes[:, k]) for k in forward]


_SOLVER = Ipopt(tolerance=1e-12)
_ROUNDS = 4
SHORTEST = 0.1
"""Default least length of a segment over L: the best gait may shorten it to 0."""
# Largest share of the room to a limit of the lengths that a guess uses.
_INSIDE = 0.9


@dataclass(frozen=True)
class DragAim:
    """A worm on drag, and the effort and limits of its gait.

    Parameters
    ----------
    segments : int
        Number of segments N.
    exponent : float
        Exponent a of the drag law c0 (l / L)^a.
    cost : {"strain_rate", "dissipation"}
        Kind of effort that is limited.
    effort : float
        Effort allowed per period: 1 / time for strain rates, an energy for dissipation.
    period, length, drag : float, optional
        Period, L and c0.
    mean : float, optional
        Mean length of each segment over the period; free if left out.
    keeps_length : bool, optional
        Whether the total length of the worm is constant.
    limits : (float, float), optional
        Least and largest length of a segment.

    Examples
    --------
    >>> aim = DragAim(3, 1.0, "strain_rate", 10.0, mean=1.0)
    >>> aim.model.name, round(aim.small[0].displacement(1.0, aim.effort), 6)
    ('worm of 3 segments on drag', 0.265258)
    """

    segments: int
    exponent: float
    cost: Cost
    effort: float
    period: float = 1.0
    length: float = 1.0
    drag: float = 1.0
    mean: float | None = None
    keeps_length: bool = False
    limits: tuple[float, float] = (SHORTEST, float("inf"))

    @property
    def model(self) -> Model:
        """Model of the worm."""
        least, most = self.limits
        return drag_worm(
            self.segments, self.exponent, length=self.length, drag=self.drag,
            total=self.segments * self.middle if self.keeps_length else None,
            least=least, most=most, time_nominal=self.period, strain=self.strain,
        )  # fmt: skip

    @property
    def middle(self) -> float:
        """Length about which an initial guess oscillates."""
        return sum(self.limits) / 2 if self.mean is None else self.mean

    @property
    def power(self) -> str:
        """Name of the output whose integral is the effort."""
        return "strain_power" if self.cost == "strain_rate" else "dissipation"

    @property
    def small(self) -> list[SmallGait]:
        """Optimal gaits for small effort."""
        return small_gaits(self.segments, self.exponent, self.cost, fixed_total=self.keeps_length)

    @property
    def strain(self) -> float:
        """Usual strain: the largest of the best small gait, 1 if lengths have no mean."""
        if self.mean is None:
            return 1.0
        small = self.small[0].scaled(self.strain_effort, self.period)
        return min(1.0, float(np.abs(small).max()))

    @property
    def small_displacement(self) -> float:
        """Displacement per period by the theory of small strains about the middle length."""
        return self.small[0].displacement(
            self.exponent, self.strain_effort, self.middle, self.period
        )

    @property
    def scaled(self) -> DragAim:
        """The aim in units of length L, period and c0."""
        L, small = self.length, self.period / self.length**2 / self.drag
        return replace(
            self,
            effort=self.effort * (self.period if self.cost == "strain_rate" else small),
            period=1.0,
            length=1.0,
            drag=1.0,
            mean=self.mean and self.mean / L,
            limits=(self.limits[0] / L, self.limits[1] / L),
        )

    @property
    def strain_effort(self) -> float:
        """The effort in strains about the middle length: integral of e'^T M e'."""
        size = (self.middle / self.length) ** 2
        if self.cost == "strain_rate":
            return self.effort / size
        stiff = self.drag * (self.middle / self.length) ** self.exponent
        return self.effort / (stiff * self.middle**2)


def gait_problem(aim: DragAim) -> Problem:
    """Return the problem: largest displacement per period within the effort."""
    model = aim.model
    rows = model["length"] if aim.mean is not None else ca.SX(0, 1)
    count = rows.numel()
    ends = Ends.of(model, count + 1)
    unit = aim.strain * aim.length * aim.period
    bounds = [
        Constraint("start", ends.start[-1], 0.0, 0.0, aim.small_displacement),
        Constraint("budget", ends.integrals[count], upper=aim.effort, nominal=aim.effort),
    ]
    if aim.mean is not None:
        mean = aim.mean * aim.period
        bounds.append(Constraint("mean length", ends.integrals[:count], mean, mean, unit))
    least, most = aim.limits
    return Problem(
        model,
        ends,
        -(ends.end[-1] - ends.start[-1]) / aim.small_displacement,
        (aim.period, aim.period),
        periodic=["length"],
        integrands=ca.vertcat(rows, model[aim.power]),
        path_constraints=[Constraint("last length", model["lengths"][-1], least, most, aim.length)]
        if aim.keeps_length
        else [],
        boundary_constraints=bounds,
    )


def first_gait(aim: DragAim, small: SmallGait) -> Gait:
    """Return a small gait at the given effort, or smaller near limits."""
    middle, (least, most) = aim.middle, aim.limits
    reach = middle * np.abs(small.scaled(aim.strain_effort, aim.period)).max()
    shrink = min(1.0, _INSIDE * min(middle - least, most - middle) / reach)
    return small.gait(aim.strain_effort * shrink**2, middle, aim.period)


def guess_of(aim: DragAim, small: SmallGait) -> Guess:
    """Return a small gait as a guess."""
    gait, free = first_gait(aim, small), aim.segments - aim.keeps_length
    return Guess(
        aim.period, lambda t: np.vstack([gait(t)[:free], 0 * t]), lambda t: gait(t, 1)[:free]
    )


def best_gait(
    aim: DragAim, mesh: Mesh, tolerance: float, *, starts: int = 1, report: Report = silent
) -> tuple[Optimum, tuple[float, ...]]:
    """Find the best gait from the `starts` best small ones, on a refined mesh.

    Theory: docs/theory-peristaltic.md, section 4.

    Parameters
    ----------
    aim : DragAim
        The worm, its effort and limits.
    mesh : Mesh
        Initial mesh.
    tolerance : float
        Largest local error, to which the mesh is refined.
    starts : int, optional
        Number of small gaits to start from.
    report : callable, optional
        Called with the current step and the share completed.

    Returns
    -------
    Optimum, tuple of float
        The best gait, whose objective is the negative displacement over L, and the objectives of
        all starts.

    Raises
    ------
    SolveError
        If no gait is found.

    Examples
    --------
    >>> from wormopt.numerics.collocation import Collocation
    >>> mesh = Mesh.even(1, 6, Collocation(6, "legendre"), 5)
    >>> aim = DragAim(2, 1.0, "strain_rate", 10.0, mean=1.0)
    >>> round(-best_gait(aim, mesh, 1e-5)[0].objective * aim.small_displacement, 6)
    0.209754
    """
    guesses = [guess_of(aim, small) for small in aim.small[:starts]]
    best, tried = optimise_multistart(
        gait_problem(aim), mesh, FixedModes(), guesses, solver=_SOLVER, report=report
    )
    return refine(best, tolerance, rounds=_ROUNDS, solver=_SOLVER, report=report), tried


def touches(motion: Motion, aim: DragAim, within: float = 1e-6) -> bool:
    """Return whether a segment reaches a limit of its length, to a share of the usual length."""
    lengths = motion.output("lengths", np.linspace(0, motion.duration, 2001))
    least, most = aim.limits
    near = within * aim.length
    return bool(lengths.min() < least + near or lengths.max() > most - near)


_DEGREE, _MOST = 32, 256
# Equal parts of the period by which multipliers are estimated.
_SAMPLES = 128


@dataclass(frozen=True)
class Stationary:
    """A gait that satisfies the Euler-Lagrange equations."""

    displacement: float  # per period
    price: float  # mu: derivative of the displacement by the effort
    residual: float  # largest residual of the equations, in scaled units
    drift: float  # delta, which vanishes


class _Lagrangian:
    """Displacement and cost, in scaled lengths q and rates u, with their derivatives."""

    def __init__(self, aim: DragAim) -> None:
        model = aim.model
        self.q, self.u = model["length"], model["rate"]
        exponent = model["exponent"]
        self.displacement, self.cost = (
            ca.substitute(model[name], exponent, aim.exponent) for name in ("speed", aim.power)
        )
        self.means = self.q if aim.mean is not None else ca.SX(0, 1)

    @cached_property
    def A(self) -> ca.SX:
        """Slopes (n, 1) of the displacement by the rates."""
        return ca.gradient(self.displacement, self.u)

    @cached_property
    def M(self) -> ca.SX:
        """Metric (n, n) of the cost."""
        return ca.hessian(self.cost, self.u)[0] / 2


def stationary(motion: Motion, aim: DragAim) -> Stationary:
    """Solve the equations near a gait away from the limits of the lengths."""
    scaled = aim.scaled
    found = _Lagrangian(scaled)
    lengths, rates = _samples(motion, aim, np.arange(_SAMPLES) / _SAMPLES)
    multipliers = _multipliers(found, lengths, rates)
    turned = int(np.argmax(np.abs(rates[:, 0])))
    problem = _equations(found, scaled, turned, lengths[turned, 0])
    tallied = ca.vertcat(found.means, found.cost, found.displacement)
    values = ca.Function("values", [found.q, found.u], [tallied, found.A, found.M @ found.u])

    def guess(s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        now, rate = _samples(motion, aim, s)
        tallies, A, Mu = (np.asarray(part) for part in values(now, rate))
        steps = np.diff(s, prepend=0.0) * (tallies + np.roll(tallies, 1, axis=1)) / 2
        p = 2 * multipliers[0] * Mu - A
        return np.vstack([now, p, np.cumsum(steps, axis=1)]), np.append(multipliers, 0.0)

    solution = solve_boundary(problem, guess, [[]], degree=_DEGREE, most=_MOST)
    end = solution.at(np.ones(1))[:, 0]
    return Stationary(
        float(end[-1]) * aim.length,
        float(solution.p[0]) * scaled.effort / aim.effort * aim.length,
        solution.residual,
        float(solution.p[-1]),
    )


def _samples(motion: Motion, aim: DragAim, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return scaled lengths and rates (n, m) of a motion at shares of its period."""
    t = s * aim.period
    return motion.state("length", t) / aim.length, motion.inputs(t) * aim.period / aim.length


def _multipliers(found: _Lagrangian, lengths: np.ndarray, rates: np.ndarray) -> np.ndarray:
    """Return price mu and multipliers nu that fit the equations best on equal parts."""
    symbols = [found.q, found.u]
    forces = (ca.gradient(found.displacement, found.q), ca.gradient(found.cost, found.q))
    parts = ca.Function("parts", symbols, [found.A, 2 * found.M @ found.u, *forces])
    A, Mu, by_displacement, by_cost = (np.asarray(part) for part in parts(lengths, rates))
    of_mu, right = (_slope(Mu) - by_cost).ravel(), (_slope(A) - by_displacement).ravel()
    of_nu = -np.kron(np.eye(len(A))[:, : found.means.numel()], np.ones((A.shape[1], 1)))
    return np.linalg.lstsq(np.column_stack([of_mu, of_nu]), right, rcond=None)[0]


def _slope(values: np.ndarray) -> np.ndarray:
    """Return derivatives (n, m) by the share of the period, from values on equal parts of it."""
    waves = 2j * np.pi * np.fft.rfftfreq(values.shape[1], 1 / values.shape[1])
    waves[-1] = 0.0
    return np.fft.irfft(waves * np.fft.rfft(values, axis=1), values.shape[1], axis=1)


def _equations(found: _Lagrangian, aim: DragAim, turned: int, begin: float) -> BoundaryProblem:
    """Return the boundary value problem; the length `turned` is `begin` at both ends."""
    n, means = found.q.numel(), found.means
    p, mu, delta = ca.SX.sym("p", n), ca.SX.sym("mu"), ca.SX.sym("delta")
    nu = ca.SX.sym("nu", means.numel())
    u = ca.solve(found.M, p + found.A) / (2 * mu)
    lagrangian = mu * found.cost - found.displacement + ca.dot(nu, means)
    rows = ca.vertcat(
        found.u,
        ca.gradient(lagrangian, found.q) + delta * found.u,
        means,
        found.cost,
        found.displacement,
    )
    tallies = means.numel() + 2
    start, end = (ca.SX.sym(name, 2 * n + tallies) for name in ("start", "end"))
    return BoundaryProblem(
        y=ca.vertcat(found.q, p, ca.SX.sym("tally", tallies)),
        p=ca.vertcat(mu, nu, delta),
        given=ca.SX(0, 1),
        ode=ca.substitute(rows, found.u, u),
        start=start,
        end=end,
        conditions=ca.vertcat(
            start[2 * n :],
            end[: 2 * n] - start[: 2 * n],
            start[turned] - begin,
            end[2 * n : -2] - (aim.mean or 0.0),
            end[-2] - aim.effort,
        ),
        names=tuple(f"y{k}" for k in range(2 * n + tallies)),
    )
