"""Kind "planar-design": the best gait of a body in the plane."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Literal

from wormopt.errors import Fault, SolveError
from wormopt.result import Check
from wormopt.study import (
    Given,
    Study,
    array,
    check,
    checks,
    entry,
    facts,
    on_use,
    parts,
    positive,
    scalar,
    signal,
    stage,
    value,
    warnings,
    whole,
)
from wormopt.study.given import wrong_count
from wormopt.study.types import Finite, Positive, Seed
from wormopt.systems.planar.tables import Body, Drags, DryGround, PlanarLimits
from wormopt.systems.shared.studies import refused_at

with on_use():
    import numpy as np

    from wormopt.model.planar_friction import Elliptic
    from wormopt.systems.planar.design.aim import Dry, Ground, PlanarAim, Viscous
    from wormopt.systems.planar.design.gaits import (
        CLOSED,
        PlanarDesign,
        crossings,
        design_stroke,
        widest,
    )
    from wormopt.systems.planar.design.polygons import Steps
    from wormopt.systems.planar.poses import circle_of
    from wormopt.systems.planar.shape import Shape

# Accepted difference of both motions, over the path of the shape, on dry and on viscous ground;
# accepted excess of the limits, and of the passage.
_DRY, _VISCOUS = 3e-4, 1e-7
_KEPT, _STILL = 1e-9, 1e-6
_PARTS = 24


class Aim(Given):
    """Objective of the gait."""

    purpose: Literal["speed", "turn", "work"] = entry(
        "`speed`: highest speed without net turn; `turn`: highest turn rate; `work`: least "
        "work to reach `pose`",
        default="speed",
    )
    pivot: int | Literal["any", "centre"] = entry(
        "for `turn`: the point that returns after a cycle; a mass, `centre`, or `any`",
        default="any",
    )
    pose: tuple[Finite, ...] | None = entry(
        "for `work`: [*x*, *y*, angle] of the head to reach, in its frame at the start",
        default=None,
    )
    cycles: int = whole(1, 1000, "number of cycles in which the pose is reached", default=1)
    closed: bool = entry("whether the shape must return to its start", default=True)
    start: tuple[Finite, ...] | None = entry("initial shape; free if left out", default=None)
    time: float = positive(
        "time",
        "duration of a cycle to `pose` on viscous ground, where work depends on it",
        default=1.0,
    )

    def faults_of_keys(self) -> Iterator[Fault]:
        if self.pose is not None and len(self.pose) != 3:
            yield "pose", "missing; write [x, y, angle]"


class Search(Given):
    """Starting points of the search."""

    starts: int = whole(1, 100, "number of random initial strokes", default=3)
    seed: Seed = entry("seed of the random numbers", quantity="count", default=0)
    corners: int = whole(3, 60, "number of corners of the stroke", default=8)


@dataclass(frozen=True)
class Signals:
    """The gait over a cycle."""

    time: np.ndarray = signal("time", "instant", "time")
    shape: np.ndarray = signal(
        "1", "shape_variable instant", "shape variables: lengths, then angles"
    )
    x: np.ndarray = signal("length", "mass instant", "*x* of each mass; the body starts facing +x")
    y: np.ndarray = signal("length", "mass instant", "*y* of each mass")
    rest: np.ndarray = signal("1", "mass instant", "1 where the mass rests, else 0")


@dataclass(frozen=True)
class Numbers:
    """Displacement and work of the gait, and their bounds."""

    displacement: list[float] = value(
        "length", "displacement of the head per cycle, [forward, to the left]"
    )
    turn: float = value("angle", "rotation per cycle, positive to the left")
    distance: float = value("length", "distance of the head per cycle")
    duration: float = value("time", "duration of a cycle at the highest rates allowed")
    speed: float = value("speed", "`distance` divided by `duration`")
    turn_rate: float = value("rate", "`turn` divided by `duration`")
    work: float = value("energy", "work dissipated by the ground per cycle")
    work_per_distance: float | None = value("force", "`work` divided by `distance`")
    work_bound: float | None = value(
        "energy",
        "lower bound of `work` for this displacement on dry ground; unknown on viscous ground",
    )
    work_over_bound: float | None = value("1", "`work` divided by `work_bound`")
    turn_bound: float | None = value(
        "rate", "bound of `turn_rate` for two links one of which always rests; else unknown"
    )
    turn_over_bound: float | None = value("1", "`turn_rate` divided by `turn_bound`")
    circle_radius: float | None = value(
        "length", "radius of the circle of repeated cycles; unknown without a turn"
    )
    half_width: float = value(
        "length", "half the width that the links need across the displacement"
    )
    starts_found: list[float] = value("1", "objective reached from each start")
    miss: float = value("1", "largest residual of the requirements on turn, pivot or pose")


class PlanarGaitDesign(Study, kind="planar-design"):
    """Design a planar gait: fastest, turning, or cheapest to a pose.

    The motion is slow, and the shape changes linearly from corner to corner. From random strokes,
    optimal control with increasingly steep friction finds the corners. A local search with the
    exact motion then refines them. All results come from the exact motion, and the optimum is
    local. See [theory](../theory-planar.md#9-design-of-gaits).
    """

    pictures: ClassVar = {
        "planar_gait": "the body at equal times of a cycle, resting masses, shape over time, "
        "and the stroke",
        "animation": ("the moving body, as a GIF", "animation_of_gait"),
    }
    headline: ClassVar = ("speed", "turn_rate", "work_per_distance", "duration")

    body: Body = entry("the body")
    ground: DryGround | None = entry("dry ground; this or `viscous`", default=None)
    grips: tuple[Positive, ...] | None = entry(
        "factor of each mass on the dry friction, head first; all 1 if left out",
        quantity="1",
        default=None,
    )
    viscous: Drags | None = entry("viscous ground; this or `ground`", default=None)
    objective: Aim = entry("objective of the gait", default=Aim)
    limits: PlanarLimits = entry("limits of the gait", default=PlanarLimits)
    search: Search = entry("starting points of the search", default=Search)

    def faults_of_keys(self) -> Iterator[Fault]:
        if (self.ground is None) == (self.viscous is None):
            yield "ground", "exactly one of ground and viscous is required"
        if self.ground is not None and self.ground.law != "elliptic":
            yield (
                "ground.law",
                'only elliptic friction has a motion of least power; write "elliptic"',
            )
        if self.viscous is not None and self.grips is not None:
            yield "grips", "applies to dry ground only; leave it out"
        yield from wrong_count("grips", self.grips, self.body.links + 1, "masses")
        if self.body.lengths is None and self.limits.length is None:
            yield "limits.length", "missing; lengths vary: write for example [0.5, 1.0]"

    # -- computing ---------------------------------------------------------------------------------

    @cached_property
    def task(self) -> PlanarAim:
        """The objective; raises SceneError if it is inconsistent."""
        aim, shape = self.objective, self.body.shape()
        x, y, turn = aim.pose or (0.0, 0.0, 0.0)
        with refused_at(self, "objective"):
            return PlanarAim(
                shape,
                self._ground_of(shape),
                self.limits,
                aim.purpose,
                pose=(x, y, turn) if aim.pose else None,
                cycles=aim.cycles,
                closed=aim.closed,
                start=aim.start,
                pivot=aim.pivot,
                corners=self.search.corners,
                time=aim.time,
            )

    def _ground_of(self, shape: Shape) -> Ground:
        if self.viscous is not None:
            return Viscous(self.viscous.swimmer(shape))
        assert self.ground is not None
        numbers, grips = self.ground.numbers, self.grips or (1.0,) * shape.n_points
        return Dry(tuple(Elliptic(*(grip * number for number in numbers)) for grip in grips))

    @stage
    def design(self) -> PlanarDesign:
        search = self.search
        try:
            with np.errstate(all="ignore"):  # values that are not finite are checked later
                return design_stroke(
                    self.task, starts=search.starts, seed=search.seed, report=self.report
                )
        except SolveError as error:  # the motion of a start is no gait
            raise SolveError(error.reason, error.suggestion, code=error.code) from None

    @stage
    def recheck(self) -> float:
        """Difference to the end at fixed instants, over the path of the shape."""
        aim, corners = self.task, self.design.corners
        with np.errstate(all="ignore"):
            steps = Steps(aim.shape, aim.ground, parts=_PARTS, points=6)
            total = steps.sides(corners, aim.closed).total
        whole = np.vstack([corners, corners[:1]]) if aim.closed else corners
        way = float(np.abs(np.diff(whole, axis=0)).sum())
        return float(np.abs(total - self.design.displacement).max()) / way

    # -- results -----------------------------------------------------------------------------------

    @parts(Numbers)
    def numbers(self) -> Numbers:
        design, turns = self.design, self.objective.purpose == "turn"
        turn, bound = float(design.displacement[2]), design.work_bound
        circle = circle_of(design.displacement) if self.objective.purpose != "speed" else None
        rate, turn_bound = turn / design.duration, design.turn_bound if turns else None
        return Numbers(
            displacement=design.displacement[:2].tolist(),
            turn=turn,
            distance=design.distance,
            duration=design.duration,
            speed=design.distance / design.duration,
            turn_rate=rate,
            work=design.work,
            work_per_distance=design.work / design.distance if design.distance else None,
            work_bound=bound,
            work_over_bound=design.work / bound if bound else None,
            turn_bound=turn_bound,
            turn_over_bound=rate / turn_bound if turn_bound else None,
            circle_radius=circle.radius if circle else None,
            half_width=widest(design),
            starts_found=list(design.tried),
            miss=float(np.abs(design.misses).max(initial=0.0)),
        )

    @scalar("1", "difference in displacement to smoothed friction at fixed instants")
    def recheck_error(self) -> float:
        return self.recheck

    @parts(Signals)
    def signals(self) -> Signals:
        time, shapes, _, places = self.design.places()
        ways = np.linalg.norm(np.diff(places, axis=0, append=places[-1:]), axis=-1)
        ways[-1] = ways[-2]  # until the next instant
        rests = ways < 1e-5 * np.maximum(ways.max(axis=1, keepdims=True), 1e-12)
        return Signals(time, shapes.T, places[..., 0].T, places[..., 1].T, rests.astype(float).T)

    @array(
        "1",
        "corner shape_variable",
        "corners of the stroke, as in `stroke.corners` of `planar-crawl` and `planar-swim`",
    )
    def corner(self) -> np.ndarray:
        return self.design.corners

    # -- the trust report --------------------------------------------------------------------------

    @property
    def accepted(self) -> float:
        """Accepted difference of both motions."""
        return _DRY if self.viscous is None else _VISCOUS

    @check(
        "accepted",
        "at fixed instants the motion ends {value:.2g} elsewhere",
        name="motion by another route",
    )
    def second_route(self) -> float:
        return self.recheck

    @checks
    def requirements(self) -> Iterator[Check]:
        design, limits, miss = self.design, self.limits, self.numbers.miss
        advice = f"the requirements are missed by {miss:.2g}"
        yield Check("requirements", miss, CLOSED, advice)
        low, high = self.task.ranges.T
        over = float(np.maximum(low - design.corners, design.corners - high).max())
        yield Check("limits of the shape", max(0.0, over), _KEPT, "the shape exceeds its limits")
        if limits.half_width is not None:
            over = self.numbers.half_width - limits.half_width
            advice = f"the body leaves the passage by {over:.2g}; write more search.corners"
            yield Check("passage", max(0.0, over), _STILL, advice)
        if design.work_bound is not None:
            over, limit = max(0.0, design.work_bound - design.work), _KEPT * design.work
            yield Check(
                "work above its bound",
                over,
                limit,
                "the work is below its lower bound: the result is wrong",
            )
        if limits.effort is not None:
            over = max(0.0, design.work - limits.effort)
            advice = f"the gait exceeds limits.effort by {over:.2g}"
            yield Check("effort", over, _DRY * limits.effort, advice)

    @facts
    def as_stroke(self) -> Mapping[str, Any]:
        """The gait as `--set` takes it for scenes that move a given stroke."""
        rows = ",".join(f"[{','.join(map(repr, row))}]" for row in self.design.corners.tolist())
        return {"stroke": f'stroke={{course="polygon",corners=[{rows}]}}'}

    @warnings
    def doubts(self) -> Iterator[str]:
        yield "a local optimum at this number of corners; write more search.starts to try others"
        for first, second in list(crossings(self.design.places()[3]))[:1]:
            yield f"links {first} and {second} cross; write a narrower limits.angle"
        bound = self.numbers.turn_bound
        if bound and self.design.value > bound * (1 + 1e-9):
            yield (
                "exceeds the bound of two links one of which always rests, because changes of "
                "length also turn the body"
            )
