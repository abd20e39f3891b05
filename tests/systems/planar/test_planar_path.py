"""Paths of gait steps: swept room, search against brute force, polish, the scene, refusals."""

import re
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from itertools import product
from typing import Any

import numpy as np
import pytest
from effort import examples
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from outcomes import refusals
from places import DOCS

import wormopt as wo
from wormopt.errors import ArgumentError, SolveError
from wormopt.model.planar_friction import Elliptic
from wormopt.study import load_scene
from wormopt.systems.planar.kinematic import Constraints, KinematicMotion, Phase
from wormopt.systems.planar.obstacles import Block, Capsule, Disc, Obstacle, between, inside
from wormopt.systems.planar.path.plan import (
    Fitted,
    Looked,
    Route,
    plan_path,
    polished,
    routes,
)
from wormopt.systems.planar.path.simulate import (
    least_distance,
    simulate_crawled,
    simulate_held,
    simulate_path,
)
from wormopt.systems.planar.path.steps import Family, GaitStep, Library, chained, gait_family
from wormopt.systems.planar.path.task import Corridor, Cost, PathTask, Tolerance, cost_of
from wormopt.systems.planar.pictures import path
from wormopt.systems.planar.poses import compose, divided, travel_along
from wormopt.systems.planar.shape import chain_shape

SEEDS = st.integers(0, 2**32 - 1)
WORM, REST = chain_shape(2), (0.6, 0.6, 0.0)
LAW = Elliptic(1.0, 1.0, 2.0)


def held(pin: int, skid: int) -> Constraints:
    return Constraints(pins=(pin,), skids=(skid,))


AHEAD = Phase(0.5, held(2, 0)), Phase(1.0, held(0, 2))
TURN = Phase(0.5, held(1, 0)), Phase(1.0, held(1, 2))
NEAR, FINE = Tolerance(0.3, 0.3), Tolerance(1e-8, 1e-8)


def between_poses(start: Any, goal: Any, tolerance: Tolerance, **more: Any) -> PathTask:
    """Return the task of a path; poses may be arrays, and obstacles a list."""
    return PathTask(start, goal, tolerance, **more)


def family(
    name: str, change: Sequence[float], phases: Sequence[Phase], amplitudes: Sequence[float]
) -> Family:
    return gait_family(name, WORM, REST, [change], amplitudes, ground=LAW, held=phases)


@cache
def library(radius: float = 0.05, amplitudes: tuple[float, ...] = (0.5, 1.0)) -> Library:
    families = (
        family("ahead", (0.4, 0.4, 0.0), AHEAD, amplitudes),
        family("left", (0.4, 0.4, 1.0), AHEAD, amplitudes),
        family("turn right", (0.0, 0.0, 1.0), TURN, amplitudes),
        family("turn left", (0.0, 0.0, -1.0), TURN, amplitudes),
    )
    return Library(families, radius)


@cache
def sides() -> Library:
    right = family("right", (0.4, 0.4, -1.0), AHEAD, (1.0,))
    return Library((right, *(replace(f, amplitudes=(1.0,)) for f in library().families)), 0.05)


@cache
def swapped() -> Library:
    return Library(tuple(sides().families[k] for k in (2, 1, 0, 4, 3)), 0.05)


STRETCH, LAW_BACK = [[0.4, 0.0], [0.4, 0.4], [0.0, 0.4]], Elliptic(1.0, 3.0, 2.0)


def crawled(name: str, bend: float, amplitudes: tuple[float, ...] = (0.6, 1.0)) -> Family:
    """Links that stretch one after the other while the joint bends; friction alone tells."""
    changes = np.column_stack([STRETCH, np.full(3, bend)])
    return gait_family(name, WORM, (0.6, 0.6, 0.4), changes, amplitudes, ground=LAW_BACK)


def random_obstacle(noise: np.random.Generator, kind: int) -> Obstacle:
    x, y = noise.uniform(-2, 2, 2)
    if kind == 0:
        return Disc((x, y), noise.uniform(0.1, 1.0))
    if kind == 1:
        return Capsule((x, y), tuple(noise.uniform(-2, 2, 2)), noise.uniform(0, 0.3))
    turns = np.sort(noise.uniform(0, 2 * np.pi, 7))
    far = noise.uniform(0.2, 1.2, 7)
    return Block(tuple(zip(x + far * np.cos(turns), y + far * np.sin(turns), strict=True)))


# -- distances -------------------------------------------------------------------------------------


@settings(max_examples=examples(25))
@given(SEEDS)
def test_distance_of_segments_is_that_of_dense_points(seed: int):
    p, q, a, b = np.random.default_rng(seed).uniform(-1, 1, (4, 2))
    t = np.linspace(0, 1, 201)[:, None]
    one, other = p + t * (q - p), a + t * (b - a)
    dense = np.linalg.norm(one[:, None] - other[None], axis=-1).min()
    found = float(between(p, q, a, b))
    spacing = (np.linalg.norm(q - p) + np.linalg.norm(b - a)) / 400
    assert found <= dense + 1e-14
    assert dense <= found + spacing


@settings(max_examples=examples(40))
@given(SEEDS, st.integers(0, 2))
def test_distance_to_obstacles_is_that_of_points_along_links(seed: int, kind: int):
    noise = np.random.default_rng(seed)
    obstacle, body = random_obstacle(noise, kind), noise.uniform(-2.5, 2.5, (3, 3, 2))
    found = obstacle.distance(body[:, :-1], body[:, 1:]).min()
    dense = least_distance(body, [obstacle], points=2001)
    if dense > 0:
        assert found <= dense + 1e-12
        assert dense - found < 3e-3
    else:
        assert found <= 0
    x, y, size = obstacle.disc
    least = np.hypot(*(body - [x, y]).reshape(-1, 2).T).min() - (size + 1e-12)
    corners = np.array(getattr(obstacle, "corners", [(0, 0)] * 3))
    assert obstacle.distance(body, body).min() >= least or inside(corners, body).any()


@settings(max_examples=examples(8))
@given(SEEDS, st.integers(0, 7))
def test_room_of_a_step_is_never_more_than_that_of_any_instant(seed: int, number: int):
    noise = np.random.default_rng(seed)
    step = library().steps[number]
    pose = np.array([*noise.uniform(-1, 1, 2), noise.uniform(-3, 3)])
    obstacles = [random_obstacle(noise, kind) for kind in range(3)]
    task = between_poses(pose, pose, NEAR, obstacles=obstacles)
    room = task.step_room(pose, step, 0.0)
    kept = float((task.room(step.placed(pose), 0.0) - step.margins).min())  # at all instants kept
    assert (room < 0) == (kept < 0)
    assert room <= kept + 1e-12 or kept < 0
    assert isinstance(step.motion, KinematicMotion)
    course = step.motion.course  # instants that the step does not keep
    places = step.motion.points(course.nodes, compose(pose, course.node_poses))
    dense = least_distance(places, obstacles, points=101)
    if dense > 0:
        assert room <= dense + 1e-12
    else:
        assert room <= 0
    # and the bound is not far from it, where it looked closely
    if 0 < dense < 0.2 and room < dense:
        assert dense - room < 2 * step.margins.max() + 0.3


def test_masses_stay_within_the_slack_of_the_instants_kept():
    for step in (library().steps[0], library().steps[-1], crawled("crawl", 0.6).make(1.0)):
        if isinstance(step.motion, KinematicMotion):
            motion = step.motion.stroke, step.motion.phases
            tau, places = simulate_held(step.points[0], *motion, looks=300, accuracy=1e-8)
        else:
            course = step.motion.course
            motion = course.stroke, course.crawler.ground
            tau, places = simulate_crawled(step.points[0], *motion, looks=64, steps=64)
        far = np.linalg.norm(places[:, None] - step.points[None], axis=-1).max(axis=-1)
        k = np.minimum(np.searchsorted(step.tau, tau, side="right") - 1, len(step.slack) - 1)
        nearest = np.minimum(far[np.arange(len(k)), k], far[np.arange(len(k)), k + 1])
        assert (nearest <= step.slack[k] + 1e-6).all()
        assert step.slack.max() < 0.02


@settings(max_examples=examples(30))
@given(SEEDS)
def test_bound_of_speeds_is_one_and_not_far_off(seed: int):
    noise = np.random.default_rng(seed)
    ends = np.array([0.0, 0.3, 1.0])
    wave = noise.uniform(-3, 3, (2, 3)) / np.diff(ends)[:, None]  # half a turn a panel, at most
    course = travel_along(ends, np.zeros((2, 16, 3)), 0.0)

    def at(tau: np.ndarray) -> np.ndarray:
        angle = tau[:, None] * wave[(tau > 0.3).astype(int)]
        return np.stack([1.3 + np.cos(angle), np.sin(2 * angle)], axis=-1)

    bound = course.fastest(at(course.nodes))
    for k in range(2):
        dense = np.linspace(ends[k] + 1e-9, ends[k + 1], 2000)
        fastest = np.linalg.norm(at(dense), axis=-1).max()
        assert fastest <= bound[k] <= 4 * fastest


# -- search ----------------------------------------------------------------------------------------


def by_brute_force(task: PathTask, lib: Library, near: Tolerance, cost: Cost) -> float:
    """Least cost of all sequences of up to four steps."""
    best = np.inf
    for length in range(5):
        for numbers in product(range(len(lib.steps)), repeat=length):
            steps = [lib.steps[k] for k in numbers]
            spent = sum(cost_of(step, cost) for step in steps)
            poses = chained(task.start, steps)
            if spent >= best or not near.met(task.off(poses[-1])):
                continue
            rooms = [task.step_room(p, s, lib.radius) for p, s in zip(poses, steps, strict=False)]
            if min(rooms, default=0.0) >= 0:
                best = spent
    return best


@settings(max_examples=examples(4))
@given(SEEDS, st.sampled_from(["steps", "work", "time"]))
def test_search_finds_what_brute_force_finds(seed: int, cost: Cost):
    noise = np.random.default_rng(seed)
    lib = library(amplitudes=(1.0,))
    numbers = noise.integers(0, 4, 3)
    goal = chained(np.zeros(3), [lib.steps[k] for k in numbers])[-1]
    goal = goal + noise.uniform(-0.1, 0.1, 3)
    obstacles = [Disc((x, y), 0.3) for x, y in noise.uniform(-2.5, 2.5, (2, 2))]
    near = Tolerance(0.2, 0.2)
    task = between_poses(np.zeros(3), goal, near, obstacles=obstacles)
    best = by_brute_force(task, lib, near, cost)
    # a path of more than four steps may be cheaper by work or time: look at those of its cost only
    found = next(routes(task, lib, near, Looked(), cost=cost, most=600), None)
    assume(np.isfinite(best))
    assert found is not None
    assert found.cost <= best * (1 + 1e-12)
    if len(found.steps) <= 4:
        assert found.cost == pytest.approx(best, rel=1e-12)


def test_routes_come_cheapest_first_and_end_near_the_goal():
    task = between_poses(np.zeros(3), np.array([1.5, 0.3, 0.4]), NEAR)
    looked = Looked()
    seen = []
    for route in routes(task, library(), NEAR, looked, cost="work", cell=(0.02, 0.02), most=400):
        seen.append(route.cost)
        end = chained(task.start, [library().steps[k] for k in route.steps])[-1]
        assert np.abs(end - route.end).max() < 1e-12
        assert NEAR.met(task.off(end))
    assert len(seen) > 2
    assert (np.diff(seen) > -1e-7).all()  # costs closer than that are as good as equal


def mirrored(pose: np.ndarray) -> np.ndarray:
    return np.asarray(pose) * [1.0, -1.0, -1.0]


@settings(max_examples=examples(6))
@given(SEEDS)
def test_turned_and_mirrored_tasks_have_the_same_routes(seed: int):
    noise = np.random.default_rng(seed)
    goal = np.array([*noise.uniform(-1.5, 1.5, 2), noise.uniform(-2, 2)])
    moved = np.array([*noise.uniform(-5, 5, 2), noise.uniform(-3, 3)])

    def first(start: np.ndarray, end: np.ndarray, lib: Library) -> Route | None:
        task, cell = between_poses(start, end, NEAR), (0.1, 0.1)
        found = routes(task, lib, NEAR, Looked(), cost="time", cell=cell, most=300)
        return next(found, None)

    one, turned = first(np.zeros(3), goal, sides()), first(moved, compose(moved, goal), sides())
    other = first(np.zeros(3), mirrored(goal), swapped())
    assume(one is not None)
    assert one is not None
    assert turned is not None
    assert other is not None
    assert turned.steps == one.steps == other.steps
    assert other.cost == pytest.approx(one.cost, rel=1e-12)


# -- steps that crawl ------------------------------------------------------------------------------


def test_panels_in_parts_lead_to_the_same_place():
    whole = crawled("crawl", 0.6).make(1.0).motion.travel
    parts = divided(whole, 0.01)
    assert np.diff(parts.ends).max() <= 0.01 + 1e-15
    assert np.abs(whole.displacement - parts.displacement).max() < 1e-13


@pytest.mark.slow
def test_smoothed_crawls_come_to_the_same_place_at_order_two_across_breaks():
    worm, changes = chain_shape(3, lengths=(1.0,) * 3), [(-1.0, 0.0), (-1.2, 1.0), (0.0, 1.1)]
    ground = Elliptic(1.0, 1.0, 3.0)
    family = gait_family("snake", worm, (0.7, -0.5), changes, (1.0,), ground=ground)
    snake = family.make(1.0)
    course, off = snake.motion.course, []
    assert len(snake.motion.phases) == 9
    steps = np.array([16, 32, 64, 128, 256])
    for n in steps:
        motion = snake.points[0], course.stroke, course.crawler.ground
        _, places = simulate_crawled(*motion, (1.0,) * 3, looks=1, steps=n)
        off.append(np.abs(places[-1] - snake.points[-1]).max())
    # how far breaks are from the ends of steps makes single errors larger or smaller
    assert 1.5 < -np.polyfit(np.log(steps), np.log(off), 1)[0] < 3.0
    assert off[-1] < 1e-5


@pytest.mark.slow
def test_a_path_of_crawls_and_held_steps_ends_in_its_pose_when_simulated():
    gaits = [crawled("ahead", 0.0), crawled("left", 0.6), crawled("right", -0.6)]
    turn = gait_family("turn", WORM, (0.6, 0.6, 0.4), [(0.0, 0.0, 0.8)], (0.5, 1.0),
                       ground=LAW_BACK, held=TURN)  # fmt: skip
    post = Disc((1.2, -0.7), 0.2)
    task = between_poses(np.zeros(3), np.array([2.6, 0.8, 0.3]), FINE, obstacles=[post])
    path = plan_path(task, Library((*gaits, turn), 0.05), Tolerance(0.2, 0.2),
                     cost="work", cell=(0.05, 0.05))  # fmt: skip
    assert np.abs(path.off).max() < 1e-9
    assert any(not isinstance(step.motion, KinematicMotion) for step in path.steps)
    course = simulate_path(path, looks=32)
    assert np.abs(task.off(course.pose)).max() < 1e-6
    assert least_distance(course.places, [post]) >= 0.05


# -- polish and the whole --------------------------------------------------------------------------


@pytest.mark.slow
def test_polish_ends_in_the_goal_and_costs_least_of_what_is_near():
    fits = [Fitted(f, "work") for f in library().families]
    route = [fits[0], fits[3], fits[0], fits[1], fits[0]]
    own = zip(route, (0.7, 0.6, 0.9, 0.8, 0.7), strict=True)
    goal = chained(np.zeros(3), [fit.family.make(a) for fit, a in own])[-1]
    task = between_poses(np.zeros(3), goal, FINE)
    first = np.full(5, 0.8)
    steps = polished(task, route, first, by_cost=True, accuracy=1e-12)
    assert steps is not None
    assert np.abs(task.off(chained(task.start, steps)[-1])).max() < 1e-12
    nearest = polished(task, route, first, by_cost=False, accuracy=1e-12)
    assert nearest is not None
    assert sum(s.work for s in steps) <= sum(s.work for s in nearest) + 1e-6
    far = np.linalg.norm([s.amplitude - 0.8 for s in nearest])
    assert far <= np.linalg.norm([s.amplitude - 0.8 for s in steps]) + 1e-6


@pytest.mark.slow
def test_a_path_past_a_disc_ends_in_its_pose_and_touches_nothing_when_simulated():
    obstacles = [Disc((1.2, 0.0), 0.35)]
    task = between_poses(
        np.zeros(3), np.array([3.0, 0.2, 0.0]), FINE, obstacles=obstacles, clearance=0.01
    )
    path = plan_path(task, library(), NEAR, cost="steps", cell=(0.1, 0.1))
    course = simulate_path(path, looks=16)
    assert FINE.met(task.off(course.pose))
    assert least_distance(course.places, obstacles) >= 0.05 + 0.01
    assert path.room >= 0


@pytest.mark.slow
def test_places_on_the_way_and_corridors_are_kept():
    goal = np.array([1.6, 0.0, 0.0])
    via = between_poses(np.zeros(3), goal, FINE, via=[(0.9, 0.35)], via_radius=0.1)
    path = plan_path(via, library(), NEAR, cost="steps", cell=(0.1, 0.1))
    assert np.hypot(*(path.poses[:, :2] - (0.9, 0.35)).T).min() <= 0.1
    line = Corridor(((-1.3, 0.0), (1.7, 0.0)), 0.05)
    straight = between_poses(np.zeros(3), goal, FINE, corridor=line)
    path = plan_path(straight, library(), NEAR, cost="steps", cell=(0.1, 0.1))
    places = simulate_path(path, looks=8).places
    assert np.abs(places[..., 1]).max() <= 0.05


def test_no_path_is_told_from_no_end_of_the_search():
    ring = [Capsule((x, y), (z, w), 0.1) for (x, y), (z, w) in (
        ((-2, -1), (1, -1)), ((1, -1), (1, 1)), ((1, 1), (-2, 1)), ((-2, 1), (-2, -1)),
    )]  # fmt: skip
    task = between_poses(np.zeros(3), np.array([4.0, 0.0, 0.0]), FINE, obstacles=ring)
    one = Library((family("ahead", (0.4, 0.4, 0.0), AHEAD, (1.0,)),), 0.05)
    with pytest.raises(SolveError, match="all 2 poses") as refused:
        plan_path(task, one, NEAR)
    assert refused.value.code == "no_path"
    with pytest.raises(SolveError, match="30 poses were searched, none near"):
        plan_path(task, library(), NEAR, most=30)


def test_ends_that_touch_are_refused_before_any_search():
    goal = between_poses(
        np.zeros(3), np.array([2.0, 0, 0]), FINE, obstacles=[Disc((2.0, 0.3), 0.4)]
    )
    with pytest.raises(SolveError, match=r"at the goal the body lacks 0\.15"):
        plan_path(goal, library(), NEAR)
    block = Block(((-3, -3), (3, -3), (3, 3), (-3, 3)))
    start = between_poses(np.zeros(3), np.array([9.0, 0, 0]), FINE, obstacles=[block])
    with pytest.raises(SolveError, match="at the start"):
        plan_path(start, library(), NEAR)


def test_steps_of_other_shapes_do_not_share_a_library():
    other = gait_family("other", WORM, (0.5, 0.6, 0.0), [(0.4, 0.4, 0.0)], (1.0,), held=AHEAD)
    with pytest.raises(ArgumentError, match="'other' does not begin and end in the shape"):
        Library((library().families[0], other))


@pytest.mark.parametrize(
    ("obstacle", "message"),
    [
        (lambda: Disc((0, 0), 0.0), "radius"),
        (lambda: Disc((0, np.nan), 1.0), "finite"),
        (lambda: Block(((0, 0), (1, 1))), "three places or more"),
        (lambda: Block(((0, 0), (1, 1), (2, 2))), "span no area"),
        (lambda: Capsule((0, 0), (1, 1), -1.0), "radius"),
    ],
)
def test_obstacles_that_are_none_are_refused(obstacle: object, message: str):
    with pytest.raises(ArgumentError, match=message):
        obstacle()  # type: ignore[operator]


# -- the scene -------------------------------------------------------------------------------------

QUICK = ["want=[]", "obstacles=[]", "route.goal=[1.5, 0.4, 0.6]"]


@pytest.mark.slow
def test_scene_of_a_short_path_agrees_with_its_simulation_and_a_weak_pin_fails_it():
    result = wo.run(load_scene("planar_path", [*QUICK, "pin_load=1.0"]))
    assert result.status == "failed"
    assert "a pin carries" in result.reason
    assert [check.name for check in result.checks if not check.passed] == ["load of a pin"]
    assert result["off_place"].value < 1e-9
    assert abs(result["off_angle"].value) < 1e-9
    end = [result[f"pose_{name}"].values[-1] for name in ("x", "y", "angle")]
    assert np.abs(np.array(end) - [1.5, 0.4, 0.6]).max() < 1e-9
    assert result["step_work"].values.sum() == pytest.approx(result["work"].value, rel=1e-12)


@pytest.mark.slow
def test_scene_of_crawls_says_who_rests():
    gaits = [
        f"{{name = 'bend {bend}', changes = {[[*row, bend] for row in STRETCH]}}}"
        for bend in (0.0, 0.6, -0.6)
    ]
    changes = [
        "want=[]", "obstacles=[]", "route.goal=[2.2, 0.2, 0.3]", "ground.backward=3.0",
        "rest=[0.6, 0.6, 0.4]", f"gaits=[{', '.join(gaits)}]",
        "route.tolerance.place=1e-5", "route.tolerance.angle=1e-5",
    ]  # fmt: skip
    result = wo.run(load_scene("planar_path", changes))
    assert result.status == "ok"
    assert result["off_place"].value < 1e-6
    assert 0 < result["pinned"].values.sum() < result["pinned"].values.size


def test_a_path_that_starts_at_the_goal_has_no_steps():
    result = wo.run("planar_path", ["obstacles=[]", "route.goal=[0.0, 0.0, 0.0]"])
    assert (result.status, result["steps"].value, "amplitude" in result) == ("ok", 0, False)
    assert path(result).axes


def test_unreachable_goals_tell_why():
    with pytest.raises(SolveError, match="100 poses were searched") as refused:
        wo.run(load_scene("planar_path", ["want=[]", "search.poses=100"]))
    assert refused.value.partial.status == "failed"


test_scenes_that_cannot_be_are_refused_by_key = refusals(
    "planar_path",
    """
    rest=[0.6, 0.6] | rest
    rest=[-0.6, 0.6, 0.0] | rest
    rates=[1.0, 1.0] | rates
    gaits.0.changes=[[0.4, 0.4]] | gaits[0].changes
    gaits.0.amplitudes=[1.0, 0.5] | gaits[0].amplitudes
    gaits.0.held=[{until=0.5, pins=[2], skids=[0]}] | gaits[0].held
    gaits.0.held=[{pins=[2]}] | gaits[0].held[0]
    gaits.0.held=[{pins=[7], skids=[0]}] | gaits[0].held[0]
    gaits.1.mirrored=ahead | gaits
    rest=[0.6, 0.6, 0.1] | gaits[1].mirrored
    ground.law=unit & gaits.0.held=[] | ground.law
    obstacles.0.corners=[[0, 0], [1, 1], [2, 2]] | obstacles[0]
    obstacles.0.shape=cube | obstacles[0]
    gaits=[] | gaits
    route.goal=[1.0, 2.0] | route.goal
    gaits.0.changes=[[-0.7, 0.0, 0.0]] | gaits[0].changes
    """,
)


def test_a_goal_beyond_all_poses_is_refused_at_once():
    """Two links that stretch by 0.4 each move no mass farther than 0.8 in a step."""
    task = between_poses(np.zeros(3), np.array([1e9, 0.0, 0.0]), FINE)
    with pytest.raises(SolveError, match=r"the goal is 1.25e\+09 or more steps away") as refused:
        plan_path(task, library(), (0.3, 0.1))
    assert refused.value.code == "too_far"


@pytest.mark.slow
def test_the_packaged_path_goes_through_the_gap_and_is_least_by_what_is_asked():
    found = {}
    for cost in ("time", "work", "steps"):
        result = wo.run(load_scene("planar_path", ["want=[]", f"search.cost={cost}"]))
        assert result.status == "ok"
        assert result["room_simulated"].value >= 0
        assert result["room"].value <= result["room_simulated"].value
        found[cost] = result
    for cost in ("time", "work", "steps"):  # up to the polish, and the cells of the search
        least = min(result[cost].value for result in found.values())
        assert found[cost][cost].value <= 1.03 * least


def test_gait_steps_say_what_they_take():
    straight = library().steps[1]
    assert isinstance(straight, GaitStep)
    assert straight.time == pytest.approx(0.8)
    # tail pinned: 0.4 and 0.8 ahead, then head pinned: again, against 1 each
    assert straight.work == pytest.approx(2.4)
    assert np.abs(straight.displacement - [0.8, 0, 0]).max() < 1e-14


@pytest.mark.slow
def test_the_example_of_the_page_runs(capsys: pytest.CaptureFixture[str]):
    page = DOCS / "theory-planar.md"
    blocks = re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    (code,) = (block for block in blocks if "plan_path" in block)
    found: dict[str, Any] = {}
    exec(code, found)
    assert capsys.readouterr().out
    assert np.abs(found["task"].off(found["again"].pose)).max() < 1e-6
    assert found["path"].room >= 0


@pytest.mark.parametrize(("goal", "steps"), [(0.6, 1), (1.3, 2)])
def test_few_steps_straight_ahead_suffice(goal: float, steps: int) -> None:
    """A step goes 0.8 of its amplitude in as much time, so the least time is the distance."""
    task = between_poses(np.zeros(3), np.array([goal, 0.0, 0.0]), NEAR)
    plan = plan_path(task, library(), NEAR, cost="time", cell=(0.05, 0.05))
    assert len(plan.steps) == steps
    assert sum(step.time for step in plan.steps) == pytest.approx(goal, rel=1e-9)
