"""Kind "planar-path": a path through the plane, composed of strokes of gaits."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Annotated, Any, ClassVar, Literal

from msgspec import Meta, structs, to_builtins

from wormopt.errors import Fault, SceneError, SolveError
from wormopt.result import Check
from wormopt.study import (
    Given,
    Study,
    attributes,
    checks,
    entry,
    facts,
    number,
    on_use,
    parts,
    positive,
    scalar,
    signal,
    stage,
    value,
    whole,
)
from wormopt.study.types import Finite, Positive, per
from wormopt.systems.planar.path.task import Obstacles, PathTask, Route, Tolerance
from wormopt.systems.planar.tables import Body, DryGround

with on_use():
    import numpy as np

    from wormopt.systems.planar.kinematic import Constraints, KinematicMotion, Phase, loads
    from wormopt.systems.planar.path.plan import PlannedPath, plan_path
    from wormopt.systems.planar.path.simulate import Course, least_distance, simulate_path
    from wormopt.systems.planar.path.steps import Family, GaitStep, Library, gait_family
    from wormopt.systems.planar.path.task import wrapped
    from wormopt.systems.planar.poses import rotate

Mass = Annotated[int, Meta(ge=0, le=200, description="a mass, a whole number, 0 or above")]
Name = Annotated[str, Meta(min_length=1, max_length=40, description="a short name in quotes")]

# Accepted difference of plan and simulation, over the size of the path; the simulation of crawls
# is of order 2 where masses stop.
_AGREED, _CRAWLS_AGREED = 1e-7, 2e-5
_LOOKS = 25  # instants of a step that the result keeps
_WELL = 1e5  # accepted condition number of the constraints


# -- tables ----------------------------------------------------------------------------------------


class Held(Given):
    """Constraints of the body until a phase of the stroke."""

    until: float = positive("share", "phase at which they end; 1 for the last", default=1.0)
    pins: tuple[Mass, ...] = entry("masses that do not move", default=())
    skids: tuple[Mass, ...] = entry("masses that move only along their heading", default=())


class Gait(Given):
    """A gait: changes of the shape from the rest shape, and the constraints meanwhile."""

    name: Name = entry("name of the gait")
    mirrored: Name | None = entry(
        "name of the mirror image of the gait; none if left out", default=None
    )
    changes: tuple[tuple[Finite, ...], ...] = entry(
        "successive shapes less the rest shape, at amplitude 1; then back to rest"
    )
    held: tuple[Held, ...] = entry(
        "constraints, phase by phase; if left out, a slow crawl by friction alone", default=()
    )
    amplitudes: Annotated[
        tuple[Positive, ...],
        Meta(min_length=1, max_length=20, description="ascending numbers above 0"),
    ] = entry(
        "amplitudes used by the search; final amplitudes lie within their range",
        quantity="1",
        default=(0.5, 1.0),
    )

    def faults_of_keys(self) -> Iterator[Fault]:
        if any(b <= a for a, b in pairwise(self.amplitudes)):
            yield "amplitudes", "the amplitudes do not ascend; write the smallest first"
        ends = [0.0, *(held.until for held in self.held)]
        if self.held and (ends[-1] != 1.0 or any(b <= a for a, b in pairwise(ends))):
            yield "held", "the phases do not ascend to 1; write the last until = 1.0"

    def faults_in(self, key: str, body: Body) -> Iterator[Fault]:
        """Yield rows and masses that do not fit the body, by keys below `key`."""
        masses, variables = body.links + 1, body.n_s
        if not self.changes or any(len(row) != variables for row in self.changes):
            yield (
                f"{key}.changes",
                f"has rows of a wrong length; write {variables} numbers, one per shape variable",
            )
        for j, held in enumerate(self.held):
            who = (*held.pins, *held.skids)
            if who and max(who) >= masses:
                yield f"{key}.held[{j}]", f"there is no mass {max(who)}; the tail is {masses - 1}"
            elif len(set(who)) < len(who):
                yield f"{key}.held[{j}]", "a mass is listed twice; a pin needs no skid"
            elif 2 * len(held.pins) + len(held.skids) < 3:
                yield (
                    f"{key}.held[{j}]",
                    "the body is not fully constrained; write a pin and a skid",
                )

    def faults_from(self, key: str, rest: tuple[float, ...], body: Body) -> Iterator[Fault]:
        """Yield strokes from a rest shape in which a link vanishes or a joint folds over."""
        lengths = body.n_lengths
        if self.mirrored and any(rest[lengths:]):
            yield (
                f"{key}.mirrored",
                "the rest shape is bent; write the mirrored gait as a separate gait",
            )
        if len(rest) != body.n_s:
            return
        for row in self.changes:
            shape = [r + max(self.amplitudes) * d for r, d in zip(rest, row, strict=False)]
            if any(length <= 0 for length in shape[:lengths]):
                yield (
                    f"{key}.changes",
                    "a link vanishes at the largest amplitude; write smaller changes",
                )
                return
            if any(abs(angle) >= 3.14159 for angle in shape[lengths:]):
                yield f"{key}.changes", "a joint folds over at the largest amplitude; bend it less"
                return


class Search(Given):
    """Options of the search."""

    cost: Literal["steps", "work", "time"] = entry("quantity to minimise", default="time")
    capture: Tolerance = entry(
        "distance to the goal at which the library search ends",
        default=Tolerance(place=0.35, angle=0.35),
    )
    cell: Tolerance = entry(
        "cell of poses within which only the cheapest is kept",
        default=Tolerance(place=0.1, angle=0.1),
    )
    poses: int = whole(1, 10000000, "largest number of poses searched", default=100_000)


# -- results computed together ---------------------------------------------------------------------


@dataclass(frozen=True)
class Numbers:
    """Cost of the path, and where its simulation ends."""

    steps: int = value("count", "number of steps", headline=True)
    work: float = value("energy", "work dissipated by sliding along the path", headline=True)
    time: float = value("time", "duration at the highest rates allowed", headline=True)
    cost_searched: float = value(
        "1", "cost of the steps from the library, before amplitudes change"
    )
    room: float = value(
        "length",
        "least distance from obstacles and the corridor, less radius and clearance",
        headline=True,
    )
    condition: float = value("1", "largest condition number of the constraints")
    poses_looked: int = value("count", "number of poses searched")
    routes_polished: int = value("count", "number of routes whose amplitudes were optimised")


@dataclass(frozen=True)
class Simulated:
    """Where the simulation ends, and how near it comes to obstacles."""

    apart: float  # from the end of the plan
    room_simulated: float = value("length", "`room` by points along the links in the simulation")
    off_place: float = value("length", "distance of the simulated end from the goal", headline=True)
    off_angle: float = value("angle", "angle of the simulated end less the angle of the goal")


@dataclass(frozen=True)
class Signals:
    """The body along the path, and its steps."""

    instant: np.ndarray = signal("time", "instant", "time")
    x: np.ndarray = signal("length", "mass instant", "*x* of the mass")
    y: np.ndarray = signal("length", "mass instant", "*y* of the mass")
    pinned: np.ndarray = signal("1", "mass instant", "1 if the mass is pinned, or rests in a crawl")
    amplitude: np.ndarray | None = signal("1", "step", "amplitude of the step")
    step_work: np.ndarray | None = signal("energy", "step", "work of the step")
    step_time: np.ndarray | None = signal("time", "step", "duration of the step")
    pose_x: np.ndarray = signal("length", "stop", "*x* of the head between steps")
    pose_y: np.ndarray = signal("length", "stop", "*y* of the head between steps")
    pose_angle: np.ndarray = signal("angle", "stop", "heading between steps")


class PlanarPath(Study, kind="planar-path"):
    """Plan a path to a pose past obstacles from the steps of a few gaits.

    Pins and skids determine the motion of a worm by its shape. Without them, friction determines
    a slow crawl. Each stroke is a step with a displacement in the plane, work, time, and an area
    swept. A search finds the best steps of the library. Then the amplitudes are optimised until
    the path meets the pose at least cost. See [theory](../theory-planar.md#8-paths).
    """

    pictures: ClassVar = {
        "path": "the body between steps, the area it sweeps, path of the head, obstacles, and "
        "the goal",
        "animation": ("the moving body, as a GIF", "animation_of_path"),
    }

    body: Body = entry("the worm")
    radius: float = number("length", "half the thickness of the body", least=0, default=0.0)
    rest: tuple[Finite, ...] = entry(
        "rest shape, between steps: lengths, if they vary, then joint angles"
    )
    rates: Positive | tuple[Positive, ...] = entry(
        "largest rates of the shape variables, one for all or one for each", default=1.0
    )
    ground: DryGround = entry("friction of sliding masses")
    pin_load: float | None = positive("force", "largest load that a pin can hold", default=None)
    gaits: Annotated[
        tuple[Gait, ...], Meta(min_length=1, max_length=50, description="one gait or more")
    ] = entry("library of gaits")
    obstacles: Obstacles = entry("obstacles that the body may not touch", default=())
    route: Route = entry("start, goal and limits of the path")
    search: Search = entry("options of the search", default=Search)

    def faults_of_keys(self) -> Iterator[Fault]:
        body, variables = self.body, self.body.n_s
        if len(self.rest) != variables:
            yield "rest", f"has {len(self.rest)} numbers for {variables} shape variables"
        elif min(self.rest[: body.n_lengths], default=1.0) <= 0:
            yield "rest", "a link length is not above 0; write lengths above 0"
        if isinstance(self.rates, tuple) and len(self.rates) != variables:
            yield "rates", f"has {len(self.rates)} numbers for {variables} shape variables"
        names = [n for gait in self.gaits for n in (gait.name, gait.mirrored) if n]
        if len(set(names)) < len(names):
            yield "gaits", "two gaits have the same name; write different names"
        if self.ground.law != "elliptic" and not all(gait.held for gait in self.gaits):
            yield "ground.law", 'a gait without pins and skids needs least power; write "elliptic"'
        for j, gait in enumerate(self.gaits):
            yield from gait.faults_in(f"gaits[{j}]", body)
            yield from gait.faults_from(f"gaits[{j}]", self.rest, body)
        for j, each in enumerate(self.obstacles):
            if getattr(each, "friction", 0.0):
                yield f"obstacles[{j}].friction", "has no effect on a path; leave it out"

    # -- computing ---------------------------------------------------------------------------------

    def _family(self, gait: Gait, name: str, side: float) -> Family:
        sides = np.ones(self.body.n_s)
        sides[self.body.n_lengths :] = side
        phases = [Phase(held.until, Constraints(held.pins, held.skids)) for held in gait.held]
        return gait_family(
            name,
            self.body.shape(),
            sides * np.array(self.rest),
            sides * np.array(gait.changes),
            gait.amplitudes,
            ground=self.ground.friction(),
            held=phases or None,
            rates=tuple(per(self.rates, self.body.n_s)),
        )

    @stage
    def library(self) -> Library:
        """Steps of all gaits and of their mirror images."""
        families = []
        for gait in self.gaits:
            families.append(self._family(gait, gait.name, 1.0))
            if gait.mirrored:
                families.append(self._family(gait, gait.mirrored, -1.0))
        library = Library(tuple(families), self.radius)
        assert library.steps
        return library

    @property
    def task(self) -> PathTask:
        """Start, goal, obstacles and limits of the path."""
        return PathTask.of_checked(structs.asdict(self.route) | {"obstacles": self.obstacles})

    @stage
    def plan(self) -> PlannedPath:
        search, task, library = self.search, self.task, self.library
        try:
            return plan_path(
                task,
                library,
                search.capture,
                cost=search.cost,
                cell=(search.cell.place, search.cell.angle),
                most=search.poses,
                report=self.report,
            )
        except SolveError as error:
            if error.code != "too_far":
                raise
            message = f"{error.reason}; {error.suggestion} (search.poses)"
            raise SceneError(self.name, [("route.goal", message)]) from None

    @stage
    def simulation(self) -> Course:
        return simulate_path(self.plan, lengths=self.body.sizes, heading=self.body.heading)

    # -- results -----------------------------------------------------------------------------------

    @cached_property
    def held_motions(self) -> list[KinematicMotion]:
        """Motions of the steps that pins and skids determine."""
        motions = [step.motion for step in self.plan.steps]
        return [motion for motion in motions if isinstance(motion, KinematicMotion)]

    @parts(Numbers)
    def numbers(self) -> Numbers:
        plan, motions = self.plan, self.held_motions
        return Numbers(
            steps=len(plan.steps),
            work=plan.cost("work"),
            time=plan.cost("time"),
            cost_searched=plan.route.cost,
            room=plan.room,
            condition=max((motion.condition for motion in motions), default=1.0),
            poses_looked=plan.looked.poses,
            routes_polished=plan.tried,
        )

    @scalar("force", "largest load of a pin", name="pin_load")
    def largest_load(self) -> float:
        friction = self.ground.friction()
        return max((loads(one, friction).pin_load for one in self.held_motions), default=0.0)

    @parts(Simulated)
    def simulated(self) -> Simulated:
        return compared(self.plan, self.simulation)

    @parts(Signals)
    def signals(self) -> Signals:
        return signals_of(self.plan)

    @attributes
    def step_names(self) -> Mapping[str, Any]:
        return {"step_names": [step.name for step in self.plan.steps]}

    @attributes
    def drawn(self) -> Mapping[str, Any]:
        route = self.route
        return {
            "radius": self.radius,
            "start": route.start,
            "goal": route.goal,
            "tolerance": route.tolerance.place,
            "via": route.via,
            "corridor": route.corridor and [route.corridor.line, route.corridor.width],
            "obstacles": [to_builtins(each) for each in self.obstacles],
        }

    # -- the trust report --------------------------------------------------------------------------

    @checks
    def by_simulation(self) -> Iterator[Check]:
        plan, found, near = self.plan, self.simulated, self.route.tolerance
        place, angle = found.off_place, found.off_angle
        ends = "simulated in Cartesian coordinates, the path ends"
        advice = f"{ends} {place:.3g} away from the goal"
        yield Check("place by simulation", place, near.place, advice)
        yield Check("angle by simulation", angle, near.angle, f"{ends} {angle:.3g} off in angle")
        size = max(1.0, float(np.abs(plan.poses[:, :2]).max()))
        agreed = _AGREED if len(self.held_motions) == len(plan.steps) else _CRAWLS_AGREED
        advice = "plan and simulation differ"
        yield Check("plan and simulation", found.apart / size, agreed, advice)
        touch = "in the simulation the body touches an obstacle; write more route.clearance"
        room = found.room_simulated
        yield Check("room by simulation", room, 0.0, touch, room >= 0)

    @checks
    def of_constraints(self) -> Iterator[Check]:
        condition, load, limit = self.numbers.condition, self.largest_load, self.pin_load
        ill = f"the constraints are nearly singular: condition number {condition:.3g}"
        yield Check("condition of the constraints", condition, _WELL, ill)
        if limit is not None:
            over = f"a pin carries {load:.4g}; write pin_load = {load:.4g}, or weaker friction"
            yield Check("load of a pin", load, limit, over)

    @facts
    def searched(self) -> Mapping[str, Any]:
        cell, pruned = self.search.cell, self.plan.looked.pruned
        return {
            "search": f"best route of the library by {self.search.cost}, except routes through "
            f"poses within {cell.place:g} and {cell.angle:g} rad of a cheaper one ({pruned} left "
            "out); its amplitudes are a local optimum that meets the goal"
        }


def compared(plan: PlannedPath, course: Course) -> Simulated:
    """Compare a plan with its simulation in Cartesian coordinates."""
    task = plan.task
    off, gap = task.off(course.pose), course.pose - plan.poses[-1]
    room = least_distance(course.places, task.obstacles) - plan.library.radius - task.clearance
    if task.corridor is not None:
        room = min(room, float(task.corridor.room(course.places).min()))
    return Simulated(
        apart=float(max(np.hypot(gap[0], gap[1]), abs(wrapped(gap[2])))),
        room_simulated=room,
        off_place=float(np.hypot(off[0], off[1])),
        off_angle=float(off[2]),
    )


def signals_of(plan: PlannedPath) -> Signals:
    """Return the body along a path, and its steps."""
    places, pinned, instants = _along(plan)
    rows = [(step.amplitude, step.work, step.time) for step in plan.steps]
    steps = np.array(rows).T if rows else (None, None, None)
    return Signals(
        instant=instants,
        x=places[..., 0].T,
        y=places[..., 1].T,
        pinned=pinned.T.astype(float),
        amplitude=steps[0],
        step_work=steps[1],
        step_time=steps[2],
        pose_x=plan.poses[:, 0],
        pose_y=plan.poses[:, 1],
        pose_angle=plan.poses[:, 2],
    )


def _along(plan: PlannedPath) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return places (m, n, 2), pins (m, n) and instants (m,) of the whole path."""
    n, start = len(plan.library.rest), plan.task.start
    if not plan.steps:
        places = start[:2] + rotate(start[2], plan.library.rest)
        return places[None], np.zeros((1, n)), np.zeros(1)
    places, pinned, instants, begun = [], [], [], 0.0
    for pose, step in zip(plan.poses, plan.steps, strict=False):
        pick = np.unique(np.linspace(0, len(step.tau) - 1, _LOOKS).round().astype(int))
        places.append(step.placed(pose)[pick])
        pinned.append([_at_rest(step, tau, n) for tau in step.tau[pick]])
        instants.append(begun + step.clock[pick])
        begun += step.time
    return np.concatenate(places), np.concatenate(pinned), np.concatenate(instants)


def _at_rest(step: GaitStep, tau: float, n: int) -> np.ndarray:
    """Return which masses do not move just after a phase."""
    if isinstance(step.motion, KinematicMotion):
        return np.isin(np.arange(n), step.motion.held_at(tau).pins)
    phases = step.motion.phases
    return next(phase.rest for phase in phases if tau < phase.end or phase is phases[-1])
