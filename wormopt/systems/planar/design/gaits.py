"""Design of planar gaits: the best gait for an objective, by optimal control and exact motion.

The phase goes from 0 to 1. Inputs are the derivatives of the shape by the phase and, if time
matters, the pace: no rate exceeds its limit. The displacement does not depend on the pace. On dry
ground the twist is an algebraic variable at which the potential, smoothed over a width that is a
parameter, has no slope.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property

import casadi as ca
import numpy as np
from msgspec import structs

from wormopt.errors import SolveError
from wormopt.model.model import Model, Output, Signal
from wormopt.numerics.collocation import Collocation
from wormopt.ocp.contact import FixedModes
from wormopt.ocp.mesh import Mesh
from wormopt.ocp.nlp import Ipopt
from wormopt.ocp.optimise import Optimum, optimise
from wormopt.ocp.problem import Constraint, Ends, Problem
from wormopt.progress import Report, silent
from wormopt.systems.planar.crawling.crawl import crawl
from wormopt.systems.planar.design.aim import Dry, PlanarAim
from wormopt.systems.planar.design.polish import STEEP, Polish, polish, side_times
from wormopt.systems.planar.design.polygons import Steps, first_corners, guess_from
from wormopt.systems.planar.poses import rotate
from wormopt.systems.planar.shape import Polygon, Shape, kinematics_at
from wormopt.systems.planar.swimming.swimmer import swim


def planar_plant(aim: PlanarAim) -> Model:
    """Return the body whose shape is driven by its rates; the pose is that of the head."""
    shape, width = aim.shape, ca.SX.sym("width")
    position, heading = ca.SX.sym("position", 2), ca.SX.sym("heading")
    twist = shape.twist if isinstance(aim.ground, Dry) else _explicit(aim, shape)
    c, s = ca.cos(heading), ca.sin(heading)
    ode = ca.vertcat(
        shape.rates,
        c * twist[0] - s * twist[1],
        s * twist[0] + c * twist[1],
        twist[2],
    )
    power = ca.substitute(aim.ground.power(shape, width), shape.twist, twist)
    across = position[1] + (s * shape.points[0, :] + c * shape.points[1, :]).T
    along = position[0] + (c * shape.points[0, :] - s * shape.points[1, :]).T
    spans = aim.ranges
    sizes = np.abs(spans).max(axis=1)
    usual = 2 * (spans[:, 1] - spans[:, 0])
    states = [
        Signal(name, shape.s[i], nominal=sizes[i], lower=spans[i, 0], upper=spans[i, 1])
        for i, name in enumerate(shape.names)
    ]
    inputs = [
        Signal(f"{name} rate", shape.rates[i], nominal=usual[i])
        for i, name in enumerate(shape.names)
    ]
    if aim.timed:
        pace, clock = ca.SX.sym("pace"), ca.SX.sym("clock")
        inputs.append(Signal("pace", pace, "time", aim.duration_usual, lower=0.0))
        clocks = [Signal("clock", clock, "time", aim.duration_usual)]
        ode = ca.vertcat(ode, pace)
    else:
        clocks = []
    dry = isinstance(aim.ground, Dry)
    return Model(
        "planar worm",
        x=[
            *states,
            Signal("position", position, "length", aim.length),
            Signal("heading", heading),
            *clocks,
        ],
        ode=ode,
        u=inputs,
        z=_twists(aim, shape) if dry else [],
        alg=_stationary(aim, width) if dry else ca.SX(0, 1),
        p=[Signal("width", width, value=1.0)] if dry else [],
        outputs=[
            Output("power", power, "power"),
            Output("along", along, "length"),
            Output("across", across, "length"),
        ],
    )


def _twists(aim: PlanarAim, shape: Shape) -> list[Signal]:
    speed = 2 * float(aim.reaches.max())
    return [
        Signal("velocity", shape.twist[:2], "speed", speed),
        Signal("turning", shape.twist[2], "rate", speed / aim.length),
    ]


def _stationary(aim: PlanarAim, width: ca.SX) -> ca.SX:
    """Return the slope of the potential by the twist, over the largest resistance."""
    assert isinstance(aim.ground, Dry)
    potential = aim.ground.potential(aim.shape, width)
    sizes = ca.DM([1.0, 1.0, 1.0 / aim.length]) / (aim.ground.most * aim.shape.n_points)
    return ca.gradient(potential, aim.shape.twist) * sizes


def _explicit(aim: PlanarAim, shape: Shape) -> ca.SX:
    """Return the twist on linear drag, where the power is quadratic."""
    hessian, slope = ca.hessian(aim.ground.potential(shape, ca.SX(0)), shape.twist)
    at_rest = ca.substitute(slope, shape.twist, ca.SX.zeros(3))
    return -ca.inv_minor(hessian) @ at_rest


def gait_problem(aim: PlanarAim) -> Problem:
    """Return the optimal control problem of an objective."""
    plant = planar_plant(aim)
    ends = Ends.of(plant, 1)
    n_s = len(aim.shape.names)
    first, last = (part[n_s:] for part in (ends.start, ends.end))
    begin, work = ends.start[:n_s], ends.integrals[0] * aim.usual_work
    time = ends.end[-1] if aim.timed else ca.SX(1)
    held = [Constraint("start", first[0], 0.0, 0.0, aim.length)]
    free_side = aim.limits.half_width is not None
    straight = aim.purpose == "speed"
    if not (straight and free_side):
        held.append(Constraint("start", first[1], 0.0, 0.0, aim.length))
    if straight:
        held.append(Constraint("start", first[2], -np.pi, np.pi))
        held.append(Constraint("no way aside", last[1] - first[1], 0.0, 0.0, aim.length))
    elif aim.purpose == "turn":
        held.append(Constraint("start", first[2], 0.0, 0.0))
        held += _in_place(aim, begin, last)
    else:
        held.append(Constraint("start", first[2], 0.0, 0.0))
        held.append(Constraint("pose", last[:2], aim.step[:2], aim.step[:2], aim.length))
        held.append(Constraint("pose", last[2], aim.step[2], aim.step[2]))
    if aim.timed:
        held.append(Constraint("start", first[3], 0.0, 0.0, aim.duration_usual))
        held.append(Constraint("shortest", time, aim.shortest, nominal=aim.duration_usual))
    if aim.start is not None:
        held.append(Constraint("start shape", begin, aim.start, aim.start))
    if aim.limits.effort is not None:
        effort = aim.limits.effort
        held.append(Constraint("limits.effort", work, upper=effort, nominal=effort))
    objective = {
        "speed": lambda: -last[0] / time,
        "turn": lambda: -last[2] / time,
        "work": lambda: work,
    }[aim.purpose]()
    objective = objective / aim.usual
    along = []
    if aim.limits.half_width is not None:
        room = aim.limits.half_width - aim.limits.radius
        along.append(Constraint("limits.half_width", plant["across"], -room, room, room))
    if aim.timed:
        along += _within_rates(aim, plant)
    periodic = list(aim.shape.names) if aim.closed else []
    return Problem(
        plant,
        ends,
        objective,
        (1.0, 1.0),
        periodic=[*periodic, "heading"] if straight else periodic,
        integrands=plant["power"] * (aim.work_factor / aim.usual_work),
        path_constraints=along,
        boundary_constraints=held,
    )


def _in_place(aim: PlanarAim, begin: ca.SX, last: ca.SX) -> list[Constraint]:
    """Require that the pivot, in the frame at the start, returns."""
    if aim.pivot == "any":
        return []
    points = ca.substitute(aim.shape.points, aim.shape.s, begin)
    place = ca.sum2(points) / points.size2() if aim.pivot == "centre" else points[:, int(aim.pivot)]
    c, s = ca.cos(last[2]), ca.sin(last[2])
    moved = last[:2] + ca.vertcat(c * place[0] - s * place[1], s * place[0] + c * place[1])
    return [Constraint("in place", moved - place, 0.0, 0.0, aim.length)]


def _within_rates(aim: PlanarAim, plant: Model) -> list[Constraint]:
    """Require that no shape variable exceeds its rate."""
    pace, rates = plant["pace"], ca.SX(ca.DM(aim.rates))
    change = aim.shape.rates / rates
    usual = aim.duration_usual
    return [
        Constraint("limits of rates", pace - sign * change, 0.0, nominal=usual) for sign in (1, -1)
    ]


# -- solutions with increasingly steep friction ----------------------------------------------------

# Widths of the smoothed potential, in resistances times the widest range of shape.
_WIDTHS = (1.0, 0.3, 0.1, 0.03, 0.01)
_ITERATIONS = 200
_DEGREE = 4


@dataclass(frozen=True, eq=False)
class Relaxed:
    """Result of the programs of one start."""

    corners: np.ndarray  # (k, n_s)
    objective: float  # of the last solved program, NaN if none
    optimum: Optimum | None


def relaxed(aim: PlanarAim, problem: Problem, first: np.ndarray) -> Relaxed:
    """Return the best corners near `first` by smoothed friction, at the last solved width."""
    mesh = Mesh.even(1, aim.corners, Collocation(_DEGREE))
    guess, best = guess_from(aim, first), None
    dry = isinstance(aim.ground, Dry)
    size = float(aim.reaches.max())
    for width in _WIDTHS if dry else (1.0,):
        solver = Ipopt(
            tolerance=1e-8, iterations=_ITERATIONS, mu_init=0.1 if best is None else 1e-3
        )
        given = {"width": width * size * aim.ground.mean} if isinstance(aim.ground, Dry) else None
        try:
            best = optimise(problem, mesh, FixedModes(), guess, p=given, solver=solver)
        except SolveError as error:
            if error.code == "infeasible" and best is None:
                raise
            break
        guess = best.motion.guess
    if best is None:
        return Relaxed(first, float("nan"), None)
    edges = best.motion.breaks if aim.closed is False else best.motion.breaks[:-1]
    corners = best.motion.states(edges)[: len(aim.shape.names)].T
    return Relaxed(corners, best.objective, best)


CLOSED = 1e-9
"""Accepted residual of a turn, a place or a pose."""
# Corners nearer to the previous one than this share of the ranges are merged with it.
_SAME = 1e-7
# Values this close to a limit or each other, over the ranges, are set equal: the first that works.
_NEAR = (1e-6, 1e-5, 1e-4, 1e-3)
_CORRECTIONS, _NARROWINGS = 12, 5
# Iterations of the last search with almost set-valued friction: each is slow, few improve anything.
_LAST = 15
# Accepted loss of the exact motion against that at fixed instants.
_LOST = 0.05


@dataclass(frozen=True, eq=False)
class PlanarDesign:
    """Result of `design_stroke`: a gait or path by its exact motion, a local optimum.

    Parameters
    ----------
    aim : PlanarAim
        The objective.
    corners : ndarray, shape (k, n_s)
        Corners of the shape variables, joined by straight sides.
    displacement : ndarray, shape (3,)
        x, y and angle of the head after a cycle, in its frame before.
    work : float
        Work dissipated per cycle; on linear drag, in `duration` at constant power.
    tried : tuple of float
        Objective reached from every start, like `value`; NaN if none.
    """

    aim: PlanarAim
    corners: np.ndarray
    displacement: np.ndarray
    work: float
    tried: tuple[float, ...] = field(default=())

    @property
    def stroke(self) -> Polygon:
        """The gait as other solvers take it."""
        return Polygon(self.corners, self.aim.closed)

    @property
    def times(self) -> np.ndarray:
        """Durations of the sides at the highest rates allowed."""
        return side_times(self.aim, self.corners)[: None if self.aim.closed else -1]

    @property
    def duration(self) -> float:
        """Duration of a cycle at the highest rates allowed, or that of the aim on linear drag."""
        return float(self.times.sum()) if self.aim.timed else self.aim.time

    @property
    def distance(self) -> float:
        """Distance of the head per cycle."""
        return float(np.hypot(*self.displacement[:2]))

    @property
    def value(self) -> float:
        """Objective: speed, turn rate, or work."""
        if self.aim.purpose == "work":
            return self.work
        gain = self.displacement[2] if self.aim.purpose == "turn" else self.distance
        return float(gain) / self.duration

    @cached_property
    def misses(self) -> np.ndarray:
        """Residuals of the requirements: turn, drift of the pivot, difference to the pose."""
        return _task(self.aim, self.corners).conditions(self.displacement, self.corners)[0]

    @property
    def work_bound(self) -> float | None:
        """Lower bound of the work that moves every mass by its displacement on dry ground.

        Each mass moves straight to its end place against its least resistance.
        """
        if not isinstance(self.aim.ground, Dry):
            return None
        first, last = self.corners[0], self.corners[0 if self.aim.closed else -1]
        before, after = (np.asarray(self.aim.shape.kinematics(s)[0]).T for s in (first, last))
        moved = self.displacement[:2] + rotate(self.displacement[2], after) - before
        least = self.aim.ground.least_each(self.aim.shape)
        return float(np.hypot(*moved.T) @ least)

    @property
    def turn_bound(self) -> float | None:
        """Largest turn rate of two links if one always rests."""
        if self.aim.shape.names != ("length 1", "length 2", "angle 1"):
            return None
        return self.aim.limits.angle_rate / 2

    def places(self, per_side: int = 24) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return times (m,), shapes (m, n_s), poses (m, 3), places (m, masses, 2) of a cycle."""
        aim, corners = self.aim, self.corners
        whole = np.vstack([corners, corners[:1]]) if aim.closed else corners
        k = len(whole) - 1
        tau = np.tile(np.arange(per_side) / per_side, k)[:, None]
        begin, way = np.repeat(whole[:-1], per_side, axis=0), np.diff(whole, axis=0)
        shapes = np.vstack([begin + tau * np.repeat(way, per_side, axis=0), whole[-1:]])
        steps = Steps(aim.shape, aim.ground, parts=1, points=4).sides(shapes, closed=False)
        poses = np.array(list(steps.running))
        paces = self.times if aim.timed else np.full(k, aim.time / k)
        times = np.concatenate([[0.0], np.cumsum(np.repeat(paces / per_side, per_side))])
        points = kinematics_at(aim.shape, shapes).points
        return times, shapes, poses, poses[:, None, :2] + rotate(poses[:, None, 2], points)


def design_stroke(
    aim: PlanarAim, *, starts: int = 4, seed: int = 0, report: Report = silent
) -> PlanarDesign:
    """Find the best gait or path for an objective: a local optimum, the best of several.

    From random strokes, optimal control with increasingly steep friction finds polygons. Their
    corners are then refined with the set-valued motion itself and its derivatives.

    Theory: docs/theory-planar.md, section 9.

    Parameters
    ----------
    aim : PlanarAim
        The objective.
    starts : int, optional
        Number of initial strokes. On dry ground with varying lengths a wave of lengths comes first
        if forward displacement counts; the others are random.
    seed : int, optional
        Seed of the random numbers.
    report : callable, optional
        Called with the current step and the share completed.

    Returns
    -------
    PlanarDesign

    Raises
    ------
    SolveError
        If no start leads to a gait within the limits.

    Examples
    --------
    >>> from wormopt.systems.planar.shape import chain_shape
    >>> from wormopt.systems.planar.swimming.swimmer import Swimmer
    >>> from wormopt.systems.planar.tables import PlanarLimits
    >>> shape = chain_shape(3, lengths=(1.0, 1.0, 1.0))
    >>> swimmer = Swimmer(shape, rods=(1.0, 2.0))
    >>> aim = PlanarAim(shape, swimmer, PlanarLimits(angle=(-1.0, 1.0)), corners=4)
    >>> round(design_stroke(aim, starts=1).value, 6)
    0.02302
    """
    problem = gait_problem(aim)
    found: list[tuple[float, np.ndarray]] = []
    tried: list[float] = []
    refusal: SolveError | None = None
    for k in range(starts):
        try:
            first = relaxed(aim, problem, first_corners(aim, seed, k))
            near = polish(aim, first.corners, parts=2)
        except SolveError as error:
            refusal = error
            tried.append(float("nan"))
            if error.code == "infeasible":
                break
            continue
        good = near.miss < 1e-3
        tried.append(near.value if good else float("nan"))
        report(f"start {k + 1}: {tried[-1]:.6g}", 0.85 * (k + 1) / starts)
        if good:
            found.append((near.value, near.corners))
    sign = 1 if aim.purpose == "work" else -1
    for value, corners in sorted(found, key=lambda one: sign * one[0]):
        report("exact motion", 0.9)
        try:
            design = _exact(aim, corners, tuple(tried))
        except SolveError as error:
            refusal = error
            continue
        if sign * design.value <= sign * value * (1 + sign * _LOST):
            return design
        refusal = SolveError(
            f"the gait has the objective {value:.6g}, but {design.value:.6g} by its exact motion",
            "write more corners, or more starts",
        )
    raise refusal or SolveError(
        f"none of {starts} starts led to a gait within the limits",
        "write wider limits, more corners, or more starts",
    )


def _exact(aim: PlanarAim, corners: np.ndarray, tried: tuple[float, ...]) -> PlanarDesign:
    """Refine a gait once more and move it exactly; narrow it if it leaves a passage."""
    room, half = aim.limits.half_width, aim.limits.half_width
    for _ in range(_NARROWINGS if room is not None else 1):
        held = replace(aim, limits=structs.replace(aim.limits, half_width=room))
        best = _distinct(aim, _steep(held, corners))
        design = _made_exact(aim, best, tried)
        if room is None or half is None:
            return design
        over = widest(design) - half
        if over <= 0:
            return design
        room, corners = room - 1.05 * over, best
        if room <= aim.limits.radius:
            break
    raise SolveError(
        "the gait found leaves the passage between its corners", "write more corners, or more room"
    )


def _steep(aim: PlanarAim, corners: np.ndarray) -> np.ndarray:
    """Return the best corners nearby, with almost set-valued friction."""
    return polish(aim, corners, parts=4, iterations=_LAST, widths=STEEP).corners


def _made_exact(aim: PlanarAim, best: np.ndarray, tried: tuple[float, ...]) -> PlanarDesign:
    """Return the design by exact motion, with as few values set equal as needed."""
    refusal: SolveError | None = None
    for near in _NEAR:
        corners, ties = _tied(aim, best, near)
        try:
            return _closed(aim, corners, ties, tried)
        except SolveError as error:  # a crawl in which rest and motion hardly differ
            refusal = error
    assert refusal is not None
    raise refusal


def _closed(
    aim: PlanarAim, corners: np.ndarray, ties: np.ndarray, tried: tuple[float, ...]
) -> PlanarDesign:
    """Change corners by the least that satisfies the requirements in the exact motion."""
    task = _task(aim, corners)
    displacement, work = moved(aim, corners)
    for _ in range(_CORRECTIONS):
        miss = task.conditions(displacement, corners)[0]
        if not miss.size or np.abs(miss).max() < CLOSED / 10:
            break
        by = task.equal_by(task.pack(corners))[:, : corners.size]
        if not np.isfinite(by).all():
            raise SolveError("the motion is not unique in the gait found", "write more starts")
        step = -np.linalg.lstsq(by @ ties, miss / task.units, rcond=None)[0]
        change = (ties @ step).reshape(corners.shape) * task.sizes
        corners = np.clip(corners + change, *aim.ranges.T)
        displacement, work = moved(aim, corners)
    return PlanarDesign(aim, corners, displacement, work, tried)


def _tied(aim: PlanarAim, corners: np.ndarray, share: float) -> tuple[np.ndarray, np.ndarray]:
    """Set corners onto limits and sides that change one variable alone, where they nearly are.

    Also return the matrix from free changes to those of all values: values on a limit stay there,
    and values equal at both ends of a side stay equal.
    """
    corners, (low, high) = corners.copy(), aim.ranges.T
    near = share * (high - low)
    k, n_s = corners.shape
    label = np.arange(k * n_s).reshape(k, n_s)
    for i in range(1, k + 1 if aim.closed else k):
        alike = np.abs(corners[i % k] - corners[i - 1]) < near
        for j in np.flatnonzero(alike):
            old, new = label[i % k, j], label[i - 1, j]
            label[label == old] = new
            corners[label == new] = corners[i - 1, j]
    held = np.zeros((k, n_s), dtype=bool)
    for limit in (low, high):
        on = np.abs(corners - limit) < near
        corners = np.where(on, limit, corners)
        held |= on
    if aim.start is not None:
        corners[0], held[0] = aim.start, True
    kept = np.isin(label, label[held])
    free = np.unique(label[~kept])
    return corners, (label.reshape(-1, 1) == free).astype(float)


def _distinct(aim: PlanarAim, corners: np.ndarray) -> np.ndarray:
    """Return corners without those equal to the previous one."""
    size = np.ptp(aim.ranges, axis=1)
    kept = [corners[0]]
    for corner in corners[1:]:
        if np.abs((corner - kept[-1]) / size).max() > _SAME:
            kept.append(corner)
    if aim.closed and len(kept) > 2 and np.abs((kept[-1] - kept[0]) / size).max() <= _SAME:
        kept.pop()
    if len(kept) < 2:
        raise SolveError("the best gait found does not move", "write wider limits, or more starts")
    return np.array(kept)


def _task(aim: PlanarAim, corners: np.ndarray) -> Polish:
    return Polish(aim, Steps(aim.shape, aim.ground, parts=4, points=6), len(corners))


def moved(aim: PlanarAim, corners: np.ndarray) -> tuple[np.ndarray, float]:
    """Return displacement (3,) and work of a cycle by the exact motion: crawling, or swimming."""
    stroke = Polygon(corners, aim.closed)
    if isinstance(aim.ground, Dry):
        found = crawl(aim.shape, aim.ground.each_law(aim.shape), stroke)
        return found.displacement, found.work
    swum = swim(aim.ground.swimmer, stroke)
    time = side_times(aim, corners).sum() if aim.timed else aim.time
    return swum.displacement, swum.work(float(time))


def widest(design: PlanarDesign) -> float:
    """Return half the width of the links, across the displacement or the first heading."""
    aim, places = design.aim, design.places()[3]
    along = np.array([1.0, 0.0])
    if aim.purpose == "speed" and design.distance > 0:
        along = design.displacement[:2] / design.distance
    across = places[..., 1] * along[0] - places[..., 0] * along[1]
    if aim.purpose == "speed":  # the body may begin anywhere in the passage
        return float(np.ptp(across)) / 2 + aim.limits.radius
    return float(np.abs(across).max()) + aim.limits.radius


def crossings(places: np.ndarray) -> Iterator[tuple[int, int]]:
    """Yield links (i, j) that cross at some instant, from the places (m, masses, 2)."""
    links = places.shape[1] - 1
    for i in range(links):
        for j in range(i + 2, links):
            a, b, c, d = places[:, i], places[:, i + 1], places[:, j], places[:, j + 1]
            apart = _side(a, b, c) * _side(a, b, d) >= 0
            apart |= _side(c, d, a) * _side(c, d, b) >= 0
            if not apart.all():
                yield i, j


def _side(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    u, v = b - a, c - a
    return u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
