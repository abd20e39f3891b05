"""Best strokes of a body on viscous ground, by collocation, and the curvature of its connection.

For g' = g A s' the displacement by a small loop from the first to the second of two shape variables
is its area times F = dA_2/ds_1 - dA_1/ds_2 + [A_1, A_2], a twist. Its first two entries depend on
the frame of the body; the third does not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import casadi as ca
import numpy as np
from numpy.polynomial import chebyshev, legendre
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError, SolveError
from wormopt.model.model import Model, Output, Signal
from wormopt.numerics.collocation import Collocation
from wormopt.ocp.contact import FixedModes
from wormopt.ocp.mesh import Mesh
from wormopt.ocp.motion import Guess, Motion
from wormopt.ocp.nlp import Ipopt
from wormopt.ocp.optimise import Optimum, optimise, refine
from wormopt.ocp.problem import Constraint, Ends, Problem
from wormopt.progress import Report, silent
from wormopt.systems.planar.shape import Harmonics, Shape
from wormopt.systems.planar.swimming.swimmer import Swim, Swimmer, swim

Frame = Literal["head", "middle", "calm"]
"""Frames: first link; middle link or midway between the two; that with the least motion."""

# Degree of the polynomials of the calm frame, and number of points of their fit.
_DEGREE, _NODES = 14, 24


@dataclass(frozen=True, eq=False)
class Heights:
    """Result of `heights`: curvature of a connection over two shape variables.

    Parameters
    ----------
    swimmer : Swimmer
        The body, in the frame.
    frame : {"head", "middle", "calm"}
        The frame.
    """

    swimmer: Swimmer
    frame: Frame

    def at(self, s: ArrayLike) -> np.ndarray:
        """Return displacement forward, to the left, and turn (m, 3), per area of a loop at `s`."""
        shapes = np.atleast_2d(np.asarray(s, dtype=float))
        return np.asarray(curvature(self.swimmer)(shapes.T)).T


def curvature(swimmer: Swimmer) -> ca.Function:
    """Return curvature (3 rows, a column for each pair i < j of shape variables) by ``s``."""
    s, A = swimmer.shape.s, swimmer.connection
    pairs = [(i, j) for i in range(s.numel()) for j in range(i + 1, s.numel())]
    columns = [ca.jtimes(A[:, j], s, _unit(s, i)) - ca.jtimes(A[:, i], s, _unit(s, j))
               + bracket(A[:, i], A[:, j]) for i, j in pairs]  # fmt: skip
    return ca.Function("curvature", [s], [ca.densify(ca.horzcat(*columns))], ["s"], ["F"])


def _unit(s: ca.SX, i: int) -> ca.DM:
    unit = ca.DM.zeros(s.numel())
    unit[i] = 1
    return unit


def bracket(a: ca.SX, b: ca.SX) -> ca.SX:
    """Return the Lie bracket of two twists."""
    return ca.vertcat(b[2] * a[1] - a[2] * b[1], a[2] * b[0] - b[2] * a[0], 0)


def heights(
    swimmer: Swimmer,
    frame: Frame = "calm",
    reach: float = 2.0,
    middle: tuple[float, float] = (0.0, 0.0),
) -> Heights:
    """Return the curvature (height) functions of a body with two shape variables.

    Theory: docs/theory-planar.md, section 5. Source: R. L. Hatton and H. Choset, Int. J. Robotics
    Res. 30 (2011) 988.

    Parameters
    ----------
    swimmer : Swimmer
        The body.
    frame : {"head", "middle", "calm"}, optional
        Frame of the displacement: at the head, along the first link; at the middle of the chain,
        along its middle link (or midway between both); or the frame that moves least in the mean
        over a square of shapes while the shape changes. In the calm frame the area under the
        curvature predicts the displacement of large loops best.
    reach : float, optional
        The calm frame counts shapes from middle - reach to middle + reach.
    middle : (float, float), optional
        Middle of these shapes.

    Returns
    -------
    Heights

    Raises
    ------
    ArgumentError
        If there are not two shape variables.

    Examples
    --------
    >>> from wormopt.systems.planar.shape import chain_shape
    >>> purcell = Swimmer(chain_shape(3, lengths=(1.0, 1.0, 1.0)), rods=(1.0, 2.0))
    >>> (heights(purcell, "middle").at([[0.0, 0.0]]) * 81 / 5).round(12).tolist()
    [[1.0, 0.0, 0.0]]
    """
    if swimmer.shape.s.numel() != 2:
        raise ArgumentError(f"height functions need two shape variables, not {swimmer.shape.names}")
    return Heights(in_frame(swimmer, frame, reach, middle), frame)


def in_frame(
    swimmer: Swimmer,
    frame: Frame,
    reach: float = 2.0,
    middle: tuple[float, float] = (0.0, 0.0),
) -> Swimmer:
    """Return the same body in another frame."""
    if frame == "head":
        return swimmer
    place, angle = middle_of(swimmer.shape)
    if frame == "middle":
        return swimmer.seen_from(place, angle)
    if frame != "calm":
        raise ArgumentError(f"frame must be head, middle or calm, not {frame!r}")
    return _calm(swimmer.seen_from(place, angle), reach, np.array(middle))


def middle_of(shape: Shape) -> tuple[ca.SX, ca.SX]:
    """Return place and angle of the middle link, or midway between the two at the middle mass."""
    n = shape.n_points - 1
    first = [shape.points[:, j] - shape.points[:, j + 1] for j in ((n - 1) // 2, n // 2)]
    if n % 2:
        d = first[0]
        place = (shape.points[:, n // 2] + shape.points[:, n // 2 + 1]) / 2
        return place, ca.atan2(d[1], d[0])
    a, b = first
    half = ca.atan2(a[0] * b[1] - a[1] * b[0], ca.dot(a, b)) / 2
    return shape.points[:, n // 2], ca.atan2(a[1], a[0]) + half


def _calm(swimmer: Swimmer, reach: float, middle: np.ndarray) -> Swimmer:
    """Return the body in the frame whose place p and angle b, polynomials of s, minimise A.

    In this frame the twist is w + grad b and R(-b)(V + w J p + grad p) for any shape rates. These
    are two least-squares problems at Gauss points, the second with the connection's own w.
    """
    x, weight = legendre.leggauss(_NODES)
    u, v = (grid.ravel() for grid in np.meshgrid(x, x, indexing="ij"))
    root = np.sqrt(np.outer(weight, weight).ravel())
    A, _ = swimmer.local(middle + reach * np.stack([u, v], axis=1))
    powers = [(i, j) for i in range(_DEGREE + 1) for j in range(_DEGREE + 1 - i)]
    basis, slopes = _basis(u, v, powers, reach)
    w = A[:, 2, :].T  # (2, m)
    turn = np.concatenate([root[:, None] * slopes[k] for k in (0, 1)])
    b = np.linalg.lstsq(turn[:, 1:], -np.concatenate([root * w[k] for k in (0, 1)]), rcond=None)[0]
    b = np.concatenate([[0.0], b])
    rows, right = [], []
    for k in (0, 1):
        whirl = root[:, None] * w[k][:, None] * basis
        slope = root[:, None] * slopes[k]
        rows += [np.hstack([slope, -whirl]), np.hstack([whirl, slope])]
        right += [-root * A[:, 0, k], -root * A[:, 1, k]]
    p = np.linalg.lstsq(np.vstack(rows), np.concatenate(right), rcond=1e-12)[0]
    straight = _basis(np.zeros(1), np.zeros(1), powers, reach)[0][0]
    b[0] -= straight @ b  # in the middle of the shapes its angle is that of the middle link
    symbols = [_terms((swimmer.shape.s[k] - middle[k]) / reach) for k in (0, 1)]
    terms = ca.vertcat(*(symbols[0][i] * symbols[1][j] for i, j in powers))
    count = len(powers)
    place = ca.vertcat(ca.dot(ca.DM(p[:count]), terms), ca.dot(ca.DM(p[count:]), terms))
    return swimmer.seen_from(place, ca.dot(ca.DM(b), terms))


def _basis(
    u: np.ndarray, v: np.ndarray, powers: list[tuple[int, int]], reach: float
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Products of Chebyshev's polynomials (m, terms), and their slopes by both variables."""

    def table(x: np.ndarray, order: int) -> np.ndarray:
        series = chebyshev.chebder(np.eye(_DEGREE + 1), order) if order else np.eye(_DEGREE + 1)
        return chebyshev.chebval(x, series).T / reach**order

    own, slope = [table(x, 0) for x in (u, v)], [table(x, 1) for x in (u, v)]
    i, j = np.array(powers).T
    return own[0][:, i] * own[1][:, j], [
        slope[0][:, i] * own[1][:, j],
        own[0][:, i] * slope[1][:, j],
    ]


def _terms(x: ca.SX) -> list[ca.SX]:
    """Chebyshev's polynomials of an expression."""
    found = [ca.SX(1), x]
    for _ in range(_DEGREE - 1):
        found.append(2 * x * found[-1] - found[-2])
    return found


def small_efficiency(swimmer: Swimmer, done: Swim) -> float:
    """Return the efficiency of the best small stroke with the same distance, to first order.

    The displacement of area S is |F| S, and the length around it in the metric is at least
    (4 pi S sqrt(det G))^1/2: action >= 4 pi sqrt(det G) X / |F|. F and G are those of the middle
    frame at the shape midway between the stroke's extremes. For large strokes this value is a
    reference, not a bound.
    """
    shape = (done.shapes.min(axis=0) + done.shapes.max(axis=0)) / 2
    seen = in_frame(swimmer, "middle")
    _, G = seen.local(shape)
    F = np.asarray(curvature(seen)(shape)).ravel()
    least = 4 * np.pi * np.sqrt(np.linalg.det(G)) / np.hypot(*F[:2])
    return float(done.drag * done.distance / least)


Aim = Literal["efficiency", "distance"]

_SOLVER = Ipopt(tolerance=1e-10, iterations=400)
_MESH = Mesh.even(1, 16, Collocation(6, "legendre"), 5)
_ROUNDS = 4
# Size of initial strokes around their centre, and distance of the centres, as shares of the room
# within the limits.
_AMPLITUDE, _OUT, _LARGEST = 0.5, 0.5, 1.0
# Largest number of repeated loops in a stroke; other harmonics are then below this share.
_MOST_LOOPS, _REPEATED, _TRIES = 8, 1e-2, 3


@dataclass(frozen=True, eq=False)
class StrokeAim:
    """A body on viscous ground, limits of its shape, and the objective of its stroke."""

    swimmer: Swimmer
    lower: np.ndarray  # (n_s,)
    upper: np.ndarray
    maximise: Aim  # towing work over work, or distance; without net turn

    def __post_init__(self) -> None:
        n_s = self.swimmer.shape.s.numel()
        for name in ("lower", "upper"):
            value = np.broadcast_to(np.asarray(getattr(self, name), dtype=float), n_s).copy()
            object.__setattr__(self, name, value)
        if n_s < 2 or not np.all(np.isfinite(self.upper - self.lower)):
            raise ArgumentError("a best stroke needs two or more shape variables, and their limits")
        if not np.all(self.lower < self.upper):
            raise ArgumentError("every lower limit of a shape variable must be below the upper one")
        if self.maximise not in ("efficiency", "distance"):
            raise ArgumentError(f"maximise must be efficiency or distance, not {self.maximise!r}")

    @cached_property
    def seen(self) -> Swimmer:
        """The body seen from its middle, which moves less."""
        return in_frame(self.swimmer, "middle")

    @cached_property
    def drag(self) -> float:
        """Drag of the straight body, with rods as short as limits allow."""
        return self.swimmer.towing_drag(self.lower)

    @cached_property
    def length(self) -> float:
        """Mean length of the rods in the middle of the limits: the unit of places."""
        middle = (self.lower + self.upper) / 2
        return float(np.mean(np.asarray(self.swimmer.lengths(middle))))

    @cached_property
    def model(self) -> Model:
        """The body, driven by the rates of its shape; places are over `length`."""
        swimmer = self.seen
        s, rates = swimmer.shape.s, swimmer.shape.rates
        x, y, angle = (ca.SX.sym(name) for name in ("x", "y", "theta"))
        twist = ca.mtimes(swimmer.connection, rates) / ca.vertcat(self.length, self.length, 1)
        c, sin = ca.cos(angle), ca.sin(angle)
        moves = ca.vertcat(c * twist[0] - sin * twist[1], sin * twist[0] + c * twist[1], twist[2])
        room = float((self.upper - self.lower).max()) / 2
        return Model(
            "body on viscous ground",
            x=[
                Signal("shape", s, nominal=room),
                Signal("pose", ca.vertcat(x, y, angle), value=0.0),
            ],
            ode=ca.vertcat(rates, moves),
            u=[Signal("rate", rates, "rate", 2 * np.pi * room, value=0.0)],
            outputs=[
                Output("power", ca.dot(rates, ca.mtimes(swimmer.metric, rates)), "power"),
                Output("connection", ca.vec(swimmer.connection)),
            ],
        )


def stroke_problem(aim: StrokeAim) -> Problem:
    """Return the problem: one closed loop in unit time without net turn; work is the integral."""
    model = aim.model
    ends = Ends.of(model, 1)
    n = aim.swimmer.shape.s.numel()
    way, work = ends.end[n : n + 2], ends.integrals[0]
    square = ca.sumsqr(way)
    pace = ca.SX.sym("pace")
    rates = model["rate"]
    design, along = [], []
    if aim.maximise == "efficiency":
        cost = -100 * square / work
    else:  # the displacement does not depend on the pace: use a uniform one
        cost = -square
        size = 2 * np.pi * float((aim.upper - aim.lower).max()) / 2
        design = [Signal("pace", pace, "rate", size, lower=0.0)]
        along = [Constraint("pace", (ca.sumsqr(rates) - pace**2) / size**2, 0.0, 0.0)]
    return Problem(
        model,
        ends,
        cost,
        (1.0, 1.0),
        periodic=["shape"],
        integrands=model["power"] / (aim.drag * aim.length**2),
        path_constraints=[Constraint("limits", model["shape"], aim.lower, aim.upper), *along],
        boundary_constraints=[
            Constraint("start", ends.start[n:], 0.0, 0.0),
            Constraint("no turn", ends.end[n + 2], 0.0, 0.0),
        ],
        design=design,
    )


def first_strokes(aim: StrokeAim, starts: int) -> list[Harmonics]:
    """Return initial ellipses: the best small one around the middle, larger ones, then others.

    Around a shape, the small stroke with the longest displacement per action lies in the plane of
    the largest singular value of the curvature in units of the metric: G^-1/2 F G^-1/2.
    """
    middle, room = (aim.lower + aim.upper) / 2, (aim.upper - aim.lower) / 2
    n = len(middle)
    centres = [(middle, _AMPLITUDE)]
    corners = [np.ones(n), np.where(np.arange(n) % 2, -1.0, 1.0), np.eye(n)[0]]
    for reach in (_AMPLITUDE, _LARGEST * 0.9):
        centres += [(middle + _OUT * room * corner, reach) for corner in corners]
        centres += [(middle, 0.9)] if reach == _AMPLITUDE else []
    return [_ellipse(aim, centre, share) for centre, share in centres[:starts]]


def _ellipse(aim: StrokeAim, centre: np.ndarray, share: float) -> Harmonics:
    n = len(centre)
    _, G = aim.seen.local(centre)
    F = np.asarray(curvature(aim.seen)(centre))
    values, vectors = np.linalg.eigh(G)
    root = vectors / np.sqrt(values) @ vectors.T
    pairs = [(i, j) for i in range(n) for j in range(i + 1, n)]
    best, plane = -1.0, None
    for row in F[:2]:
        form = np.zeros((n, n))
        for (i, j), value in zip(pairs, row, strict=True):
            form[i, j], form[j, i] = value, -value
        left, sizes, _ = np.linalg.svd(root @ form @ root)
        if sizes[0] > best:
            best, plane = sizes[0], root @ left[:, :2]
    assert plane is not None
    free = np.minimum(aim.upper - centre, centre - aim.lower)
    plane *= share * float((free / np.hypot(*plane.T)).min())
    return Harmonics(centre, plane[None, :, 0], plane[None, :, 1])


def _guess(aim: StrokeAim, stroke: Harmonics) -> Guess:
    """Return a stroke as a guess, with its displacement."""
    done = swim(aim.seen, stroke)

    def states(t: np.ndarray) -> np.ndarray:
        poses = np.stack([np.interp(t, done.phase, column) for column in done.poses.T])
        poses[:2] /= aim.length
        return np.vstack([stroke.at(t)[0].T, poses])

    return Guess(1.0, states, lambda t: stroke.at(t)[1].T)


@dataclass(frozen=True, eq=False)
class MotionStroke:
    """A stroke on a mesh: polynomials on every arc, in unit time."""

    motion: Motion

    @property
    def n_s(self) -> int:
        """Number of shape variables."""
        return len(self.motion.program.rows_of("shape"))

    @property
    def breaks(self) -> np.ndarray:
        """Phases at which arcs join."""
        found = self.motion.breaks / self.motion.duration
        return np.concatenate([found[:-1], [1.0]])

    def at(self, tau: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Return shapes (m, n_s) at phases, and rates: inputs are the derivatives, to round-off."""
        t = np.atleast_1d(np.asarray(tau, dtype=float)) * self.motion.duration
        return self.motion.state("shape", t).T, self.motion.inputs(t).T


@dataclass(frozen=True, eq=False)
class BestStroke:
    """Result of `best_stroke`: the best stroke from several starts, a local optimum.

    Parameters
    ----------
    optimum : Optimum
        The numerical solution.
    value : float
        Efficiency, or distance, by quadrature.
    tried : tuple of float
        The same from every start, NaN if none was found.
    stroke : MotionStroke
        The stroke over phases.
    harmonics : Harmonics
        The stroke as a sum of harmonics.
    """

    optimum: Optimum
    value: float
    tried: tuple[float, ...]
    stroke: MotionStroke = field(repr=False)
    harmonics: Harmonics = field(repr=False)

    @property
    def motion(self) -> Motion:
        """The stroke over unit time; places are over `StrokeAim.length`."""
        return self.optimum.motion


def best_stroke(
    swimmer: Swimmer,
    lower: float | Sequence[float] | np.ndarray,
    upper: float | Sequence[float] | np.ndarray,
    *,
    maximise: Aim = "efficiency",
    starts: int = 3,
    mesh: Mesh = _MESH,
    tolerance: float = 1e-6,
    report: Report = silent,
) -> BestStroke:
    """Find the best stroke that does not turn a body on viscous ground.

    Theory: docs/theory-planar.md, section 5.

    Parameters
    ----------
    swimmer : Swimmer
        The body, with two or more shape variables.
    lower, upper : float or array_like, shape (n_s,)
        Limits of the shape variables (lengths, angles in rad).
    maximise : {"efficiency", "distance"}, optional
        drag X^2 / (T W) at the optimal pace, or the distance X.
    starts : int, optional
        Number of initial ellipses: around the middle of the limits; with three starts also around
        a bent and a folded shape.
    mesh : Mesh, optional
        Initial mesh.
    tolerance : float, optional
        Largest local error, to which the mesh is refined.
    report : callable, optional
        Called with the current step and the share completed.

    Returns
    -------
    BestStroke
        A local optimum, the best of those found.

    Raises
    ------
    ArgumentError
        If limits are missing or empty.
    SolveError
        If no start leads to a stroke.

    Examples
    --------
    A coarse mesh gives a first result; the default mesh gives 0.01236415.

    >>> import wormopt as wo
    >>> purcell = Swimmer(wo.planar.chain_shape(3, lengths=(1.0, 1.0, 1.0)), rods=(1.0, 2.0))
    >>> coarse = Mesh.even(1, 8, Collocation(4, "legendre"))
    >>> best = best_stroke(purcell, -2.0, 2.0, starts=1, mesh=coarse, tolerance=1.0)
    >>> round(best.value, 4)
    0.011
    """
    aim = StrokeAim(swimmer, np.asarray(lower), np.asarray(upper), maximise)
    problem, found, tried = stroke_problem(aim), [], []
    refusal = SolveError("no start leads to a stroke", "write other limits or more starts")
    for k, first in enumerate(first_strokes(aim, starts)):
        try:
            optimum = _single_loop(aim, problem, mesh, first)
        except SolveError as error:
            refusal = error
            tried.append(float("nan"))
            continue
        tried.append(_value(aim, optimum.motion))
        found.append((tried[-1], optimum))
        report(f"start {k + 1}: {tried[-1]:.6g}", (k + 1) / (starts + 1))
    if not found:
        raise refusal
    best = max(found, key=lambda one: one[0])[1]
    if maximise == "efficiency":  # the best distance follows limits, with corners no mesh resolves
        best = refine(best, tolerance, rounds=_ROUNDS, solver=_SOLVER, report=report)
    motion = best.motion
    return BestStroke(
        best, _value(aim, motion), tuple(tried), MotionStroke(motion), harmonics_of(motion)
    )


def _single_loop(aim: StrokeAim, problem: Problem, mesh: Mesh, first: Harmonics) -> Optimum:
    """Return the best stroke from a first one; if it repeats a shorter loop, that from the loop.

    Repetition does not change the efficiency and multiplies the distance, so neither mesh errors
    nor the objective may choose it.
    """
    begin: Harmonics | None = first
    for _ in range(_TRIES):
        optimum = optimise(problem, mesh, FixedModes(), _guess(aim, begin), solver=_SOLVER)
        begin = once(harmonics_of(optimum.motion))
        if begin is None:
            return optimum
    raise SolveError("a start leads to a loop repeated more than once", "write other limits")


def once(stroke: Harmonics) -> Harmonics | None:
    """Return the loop that a stroke repeats, or None.

    A loop repeated m times has only every m-th harmonic.
    """
    sizes = np.hypot(stroke.cosine, stroke.sine).max(axis=1)
    for m in range(_MOST_LOOPS, 1, -1):
        others = np.arange(1, len(sizes) + 1) % m != 0
        if sizes[others].max() < _REPEATED * sizes.max():
            return Harmonics(stroke.mean, stroke.cosine[m - 1 :: m], stroke.sine[m - 1 :: m])
    return None


def _value(aim: StrokeAim, motion: Motion) -> float:
    """Return efficiency or distance of a stroke by quadrature: mesh values may be too high."""
    done = swim(aim.seen, MotionStroke(motion))
    if aim.maximise == "efficiency":
        return aim.drag * done.distance**2 / done.action
    return done.distance


def harmonics_of(motion: Motion, orders: int = 40, samples: int = 512) -> Harmonics:
    """Return a stroke over unit time as a sum of harmonics."""
    t = np.arange(samples) / samples
    found = np.fft.rfft(motion.state("shape", t), axis=1)[:, : orders + 1] / samples
    cosine, sine = 2 * found[:, 1:].real.T, -2 * found[:, 1:].imag.T
    return Harmonics(found[:, 0].real, cosine, sine)
