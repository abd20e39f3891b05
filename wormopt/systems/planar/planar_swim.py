"""Kind "planar-swim": a given or optimal stroke of a body on viscous ground."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Literal

from wormopt.errors import Fault, SolveError
from wormopt.result import Check
from wormopt.study import (
    Given,
    Study,
    check,
    checks,
    entry,
    facts,
    on_use,
    parts,
    scalar,
    signal,
    stage,
    warnings,
    whole,
)
from wormopt.study.numerics import MeshTable
from wormopt.systems.planar.tables import Body, Drags, Row, StrokeTable, wrong_rows

with on_use():
    import numpy as np

    from wormopt.numerics.collocation import Collocation
    from wormopt.ocp.mesh import Mesh
    from wormopt.systems.planar.poses import circle_of, rotate
    from wormopt.systems.planar.shape import Stroke, kinematics_at
    from wormopt.systems.planar.swimming.best import (
        BestStroke,
        Frame,
        best_stroke,
        heights,
        small_efficiency,
    )
    from wormopt.systems.planar.swimming.recheck import spectral_stroke, stepped
    from wormopt.systems.planar.swimming.swimmer import Swim, Swimmer, swim

_AGREED, _STRAIGHT = 1e-7, 1e-5
_UNEVEN = 1e4  # largest ratio of lengths; rotational drags grow with their cubes
_INSTANTS, _GRID = 401, 81


class ShapeLimits(Given):
    """Limits of the shape in the stroke."""

    angle: Row = entry(
        "[smallest, largest] angle of every joint, within ±π",
        quantity="angle",
        default=(-2.0, 2.0),
    )
    length: Row | None = entry(
        "[shortest, longest] link; required if lengths are shape variables",
        quantity="length",
        default=None,
    )


class StrokeSearch(Given):
    """Objective and starting points of the search."""

    maximise: Literal["efficiency", "distance"] = entry(
        "`efficiency` (at the optimal pace), or `distance` alone", default="efficiency"
    )
    starts: int = whole(
        1, 8, "initial ellipses, around the middle of the limits and other shapes", default=3
    )


@dataclass(frozen=True)
class Signals:
    """The body over a stroke."""

    instant: np.ndarray = signal(
        "share", "instant", "time over that of a stroke, at constant power"
    )
    shape: np.ndarray = signal(
        "1", "shape_variable instant", "shape variables: lengths, then angles"
    )
    x: np.ndarray = signal("length", "mass instant", "*x* of each mass; the body starts facing +x")
    y: np.ndarray = signal("length", "mass instant", "*y* of each mass")
    power: np.ndarray = signal("1", "instant", "power over its mean, at even phases")


@dataclass(frozen=True)
class Heights:
    """Height functions of two shape variables."""

    height_s1: np.ndarray = signal(
        "angle", "s1", "first angle, or length, of the height functions", when="two_variables"
    )
    height_s2: np.ndarray = signal("angle", "s2", "second", when="two_variables")
    height: np.ndarray = signal(
        "1",
        "twist s1 s2",
        "displacement forward, to the left, and turn of a small stroke, per area",
        when="two_variables",
    )


class PlanarSwim(Study, kind="planar-swim"):
    """Simulate or optimise a stroke on viscous ground: displacement and work.

    If `stroke` is given, this stroke is computed. Otherwise the best stroke that does not turn the
    body is searched from a cold start. See [theory](../theory-planar.md#5-viscous-crawling).
    """

    pictures: ClassVar = {
        "swim": "the body at equal times of a stroke, the path of its centre, and shape over time",
        "heights": "height functions over both shape variables, with the stroke",
        "animation": ("the moving body, as a GIF", "animation_of_stroke"),
    }
    headline: ClassVar = ("distance", "turn", "efficiency", "action")

    body: Body = entry("the body")
    ground: Drags = entry("the ground")
    stroke: StrokeTable | None = entry(
        "the stroke; if left out, the best stroke is searched", default=None
    )
    frame: Literal["head", "middle", "calm"] = entry(
        "frame of the height functions: at the `head`, at the `middle` of the chain, or the "
        "`calm` frame, which moves least while the shape changes",
        default="calm",
    )
    limits: ShapeLimits = entry("limits of the stroke that is searched", default=ShapeLimits)
    search: StrokeSearch = entry("options of the search", default=StrokeSearch)
    mesh: MeshTable = entry(
        "discretisation",
        default=MeshTable(arcs=16, degree=6, scheme="legendre", tolerance=1e-6),
    )

    def faults_of_keys(self) -> Iterator[Fault]:
        sizes, n_s = self.body.sizes or (1.0,), self.body.n_s
        if max(sizes) > _UNEVEN * min(sizes):
            yield "body.lengths", "the lengths differ too much; write lengths nearer to each other"
        if n_s == 0:
            yield "body.links", "a single link of fixed length has no shape to change; write 3"
        elif self.stroke is not None:
            yield from self._faults_of_stroke(self.stroke)
        else:
            yield from self._faults_of_search()
        if "heights" in self.want and n_s != 2:
            yield "want", f"height functions need two shape variables; the body has {n_s}"

    def _faults_of_stroke(self, stroke: StrokeTable) -> Iterator[Fault]:
        yield from wrong_rows(stroke, self.body.n_s)
        first = self.body.n_lengths
        for name, rows in stroke.rows.items():
            if any(abs(angle) > 2 * math.pi for row in rows for angle in row[first:]):
                yield f"stroke.{name}", "a joint angle exceeds 2π; write angles in radians"
            sizes = [size for row in rows for size in row[:first]]
            if name in ("mean", "corners") and min(sizes, default=1.0) <= 0:
                yield f"stroke.{name}", "a link length is not above 0; write lengths before angles"

    def _faults_of_search(self) -> Iterator[Fault]:
        if self.body.n_s < 2:
            yield (
                "body.links",
                "a body with one shape variable has no net displacement in any stroke; write 3",
            )
        ground, vary = self.ground, self.body.lengths is None
        alike = ground.along == ground.across and ground.mass_along == ground.mass_across
        if alike and not vary:
            yield (
                "ground.across",
                "on ground with equal resistance in all directions the centre of a body of fixed "
                "lengths rests in any stroke; write more than along",
            )
        for name in ("angle", "length"):
            pair = getattr(self.limits, name)
            if pair is None:
                if vary:
                    yield (
                        "limits.length",
                        "missing; lengths vary: write for example [0.5, 1.5]",
                    )
            elif len(pair) != 2 or not pair[0] < pair[1]:
                yield f"limits.{name}", "write [smallest, largest], the smaller number first"
            elif name == "length" and pair[0] <= 0:
                yield "limits.length", "the shortest length is not above 0; write one above 0"
            elif name == "angle" and max(map(abs, pair)) > math.pi:
                yield "limits.angle", "the links would cross; write angles within ±π (3.14159)"

    # -- computing ---------------------------------------------------------------------------------

    @cached_property
    def swimmer(self) -> Swimmer:
        """The body on its ground."""
        return self.ground.swimmer(self.body.shape())

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper limits of the shape variables."""
        pairs = [self.limits.length or (0.0, 0.0)] * self.body.n_lengths
        lower, upper = np.array([*pairs, *[self.limits.angle] * (self.body.links - 1)]).T
        return lower, upper

    @stage
    def best(self) -> BestStroke | None:
        if self.stroke:
            return None
        given, (lower, upper) = self.mesh, self.bounds
        rule = Collocation(given.degree, given.scheme)
        mesh = Mesh.even(1, given.arcs, rule, max(0, given.degree - 1))
        try:
            with np.errstate(all="ignore"):  # values that are not finite are checked later
                return best_stroke(
                    self.swimmer, lower, upper, maximise=self.search.maximise,
                    starts=self.search.starts, mesh=mesh, tolerance=given.tolerance,
                    report=self.report,
                )  # fmt: skip
        except SolveError as error:  # the motion of a start is no stroke
            raise SolveError(error.reason, error.suggestion, code=error.code) from None

    @cached_property
    def moves(self) -> Stroke:
        """The stroke that was given or found."""
        return self.stroke.stroke() if self.stroke else self.best.stroke  # type: ignore[union-attr]

    @stage
    def swum(self) -> Swim:
        return swim(self.swimmer, self.moves)

    @stage
    def by_harmonics(self) -> tuple[float | None, str]:
        """Efficiency by harmonics, and the method or why there is none."""
        if self.best is None or self.search.maximise != "efficiency":
            return None, "none: no efficiency was optimised"
        lower, upper = self.bounds
        shapes, near = self.swum.shapes, 1e-5 * (upper - lower)
        if np.any(shapes < lower + near) or np.any(shapes > upper - near):
            return None, "none: the stroke reaches a limit of its shape"
        try:
            with np.errstate(all="ignore"):
                found = spectral_stroke(self.swimmer, self.best.harmonics, self.swum.drag)
        except SolveError as error:
            return None, f"failed: {error.reason}"
        return found.efficiency, "harmonics at even phases, by sequential quadratic programming"

    @stage
    def recheck(self) -> np.ndarray:
        return stepped(self.swimmer, self.moves)

    # -- results -----------------------------------------------------------------------------------

    @scalar("length", "distance of the frame per stroke; frame-independent if `turn` is 0")
    def distance(self) -> float:
        return self.swum.distance

    @scalar("length", "[forward, to the left], in the frame at the start")
    def displacement(self) -> list[float]:
        return self.swum.displacement[:2].tolist()

    @scalar("angle", "rotation of the body per stroke")
    def turn(self) -> float:
        return self.swum.turn

    @scalar("length", "radius of the circle of repeated strokes; unknown without a turn")
    def circle_radius(self) -> float | None:
        circle = circle_of(self.swum.displacement)
        return circle.radius if circle and abs(self.turn) > _STRAIGHT else None

    @scalar("action", "least product of work and time, reached at constant power")
    def action(self) -> float:
        return self.swum.action

    @scalar("1", "drag of the straight body × `distance`² / `action`; unknown if the stroke turns")
    def efficiency(self) -> float:
        return self.swum.efficiency

    @scalar("1", "upper bound of the efficiency of any stroke")
    def efficiency_ceiling(self) -> float:
        return self.swimmer.ceiling

    @scalar(
        "1", "`efficiency` from harmonics; unknown if it was not optimised or limits are active"
    )
    def efficiency_spectral(self) -> float | None:
        return self.by_harmonics[0]

    @scalar(
        "1",
        "efficiency of the best small stroke with the same distance, to first order; only for "
        "two shape variables",
    )
    def efficiency_small(self) -> float | None:
        return small_efficiency(self.swimmer, self.swum) if self.two_variables else None

    @scalar("1", "objective reached from each start: efficiency, or distance")
    def starts_found(self) -> list[float] | None:
        return list(self.best.tried) if self.best else None

    @scalar("share", "difference in displacement to force balances stepped in time")
    def recheck_error(self) -> float:
        off = np.abs(self.recheck[:3] - self.swum.displacement).max()
        return float(off / (1 + self.swum.length))

    @parts(Signals)
    def signals(self) -> Signals:
        return over_stroke(self.swimmer, self.moves, self.swum)

    @property
    def two_variables(self) -> bool:
        """Whether there are two shape variables, and so height functions."""
        return self.body.n_s == 2

    @parts(Heights)
    def height_functions(self) -> Heights:
        return around(self.swimmer, self.frame, self.swum)

    # -- the trust report --------------------------------------------------------------------------

    @property
    def searched(self) -> bool:
        """Whether the stroke was searched."""
        return self.stroke is None

    @check(
        1e-8,
        "by stepped force balances in the plane the stroke ends {value:.2g} elsewhere",
        name="balance of forces, stepped",
    )
    def balance(self) -> float:
        return self.recheck_error

    @check(
        _STRAIGHT,
        "the stroke turns the body by {value:.2g}; write a smaller mesh.tolerance",
        when="searched",
    )
    def no_turn(self) -> float:
        return abs(self.turn)

    @check(0.0, "efficiency above its upper bound", when="searched")
    def efficiency_below_its_ceiling(self) -> float:
        done = self.swum
        return max(0.0, done.drag * done.distance**2 / done.action - self.efficiency_ceiling)

    @checks
    def second_route(self) -> Iterator[Check]:
        (efficiency, reason), done = self.by_harmonics, self.swum
        if efficiency is not None:
            apart = abs(efficiency * done.action / (done.drag * done.distance**2) - 1)
            reason = f"by harmonics the efficiency is {efficiency:.9g}; write more mesh.arcs"
            yield Check("efficiency by harmonics", apart, _AGREED, reason)
        elif reason.startswith("failed"):
            yield Check("efficiency by harmonics", None, _AGREED, reason)

    @facts
    def methods(self) -> Mapping[str, Any]:
        return {
            "second_route": self.by_harmonics[1],
            "quadrature_change": self.swum.error,
            "frame": self.frame,
        }

    @warnings
    def doubts(self) -> Iterator[str]:
        if self.best is None:
            if abs(self.turn) > _STRAIGHT:
                yield (
                    "the stroke turns the body: its displacement depends on frame and start, and "
                    "repeated strokes lie on a circle"
                )
            return
        yield "a local optimum; write more search.starts to begin near other shapes"
        if (reason := self.by_harmonics[1]).startswith("none"):
            yield f"no second route to this stroke: {reason.removeprefix('none: ')}"
        if self.search.maximise == "distance":
            yield (
                "where limits of the shape are active the stroke has corners, which the mesh "
                f"resolves to {self.best.optimum.defects.max():.1g} of the states' sizes; the "
                "distance may be larger by as much"
            )


def over_stroke(swimmer: Swimmer, stroke: Stroke, done: Swim) -> Signals:
    """Return the body at even times of a stroke."""
    instants = np.linspace(0.0, 1.0, _INSTANTS)
    phase = np.interp(instants, done.time, done.phase)
    shapes, rates = stroke.at(phase)
    poses = np.stack([np.interp(phase, done.phase, column) for column in done.poses.T], axis=-1)
    points = kinematics_at(swimmer.shape, shapes).points
    placed = poses[:, None, :2] + rotate(poses[:, None, 2], points)
    power = np.einsum("mi,mij,mj->m", rates, swimmer.local(shapes)[1], rates)
    size = power.mean() if power.mean() > 0 else 1.0
    return Signals(instants, shapes.T, placed[..., 0].T, placed[..., 1].T, power / size)


def around(swimmer: Swimmer, frame: Frame, done: Swim) -> Heights:
    """Return the curvature over a square of angles slightly larger than the stroke."""
    low, high = done.shapes.min(axis=0), done.shapes.max(axis=0)
    middle, reach = (low + high) / 2, 1.15 * max(float((high - low).max()) / 2, 0.1)
    reach = min(reach, max(float(np.pi - np.abs(middle).max()) - 1e-3, 0.1))
    axes = [np.linspace(m - reach, m + reach, _GRID) for m in middle]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    seen = heights(swimmer, frame, reach, middle=tuple(middle.tolist()))
    return Heights(axes[0], axes[1], seen.at(grid).T.reshape(3, _GRID, _GRID))
