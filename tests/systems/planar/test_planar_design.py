"""Gaits in the plane by optimal control: derivatives, bounds, known optima, another optimiser."""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np
import pytest
from effort import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from outcomes import refusals
from places import DOCS
from scipy.optimize import differential_evolution

import wormopt as wo
from wormopt.errors import ArgumentError, SolveError
from wormopt.model.planar_friction import Elliptic
from wormopt.study import load_scene
from wormopt.systems.planar.crawling.crawl import crawl
from wormopt.systems.planar.design.aim import Dry, Ground, PlanarAim, Viscous, root
from wormopt.systems.planar.design.gaits import (
    PlanarDesign,
    crossings,
    design_stroke,
    moved,
    widest,
)
from wormopt.systems.planar.design.polish import Polish, side_times
from wormopt.systems.planar.design.polygons import Steps, first_corners
from wormopt.systems.planar.poses import compose
from wormopt.systems.planar.shape import Polygon, Shape, chain_shape
from wormopt.systems.planar.swimming.swimmer import Swimmer
from wormopt.systems.planar.tables import PlanarLimits

SEEDS = st.integers(0, 2**32 - 1)
THREE, TWO = chain_shape(3, lengths=(1.0, 1.0, 1.0)), chain_shape(2)
SNAKE, WORM = Dry((Elliptic(1.0, 1.0, 3.0),)), Dry((Elliptic(1.0, 2.0, 3.0),))
WATER = Viscous(Swimmer(THREE, rods=(1.0, 2.0)))
SYRUP = Viscous(Swimmer(TWO, masses=(1.0, 3.0)))
BODIES: list[tuple[Shape, Ground]] = [(THREE, SNAKE), (TWO, WORM), (THREE, WATER), (TWO, SYRUP)]


def corners_of(aim: PlanarAim, seed: int, count: int = 4) -> np.ndarray:
    """A stroke by chance, within the limits."""
    noise = np.random.default_rng(seed)
    low, high = aim.ranges.T
    return noise.uniform(0.9 * low + 0.1 * high, 0.1 * low + 0.9 * high, (count, len(low)))


def aim_of(shape: Shape, ground: Ground, **more) -> PlanarAim:
    return PlanarAim(
        shape, ground, PlanarLimits(angle=(-1.2, 1.2), **more.pop("limits", {})), **more
    )


@pytest.mark.parametrize("size", [math.pi / 3, 1.0, 0.5])
def test_squares_of_purcells_swimmer(size: float):
    known = {math.pi / 3: 0.191247237630, 1.0: 0.180562563321, 0.5: 0.057396871434}
    square = size * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    total = Steps(THREE, WATER).sides(square).total
    assert np.hypot(*total[:2]) == pytest.approx(known[size], abs=1e-12)
    assert abs(total[2]) < 1e-13


@pytest.mark.parametrize(("shape", "ground"), BODIES)
def test_derivatives_are_those_of_differences(shape: Shape, ground: Ground):
    aim = aim_of(shape, ground, limits={"half_width": 1.0, "effort": None})
    corners = corners_of(aim, 3)
    task = Polish(aim, Steps(shape, ground, parts=2, points=6), len(corners), split=2)
    w = task.pack(corners)
    way, h = np.random.default_rng(1).normal(size=w.shape), 1e-6

    def slope(function):
        return (function(w + h * way) - function(w - h * way)) / (2 * h)

    assert slope(lambda w: task.objective(w)[0]) == pytest.approx(
        task.objective(w)[1] @ way, abs=1e-6
    )
    assert slope(task.equal) == pytest.approx(task.equal_by(w) @ way, abs=1e-5)
    assert slope(task.within) == pytest.approx(task.within_by(w) @ way, abs=1e-5)


def test_given_instants_and_exact_breaks_agree():
    corners = np.array([[0.9, 0.6, 0.3], [0.8, 0.9, 1.0], [0.5, 0.7, -0.6]])
    exact = crawl(TWO, WORM.each_law(TWO), Polygon(corners))
    sides = Steps(TWO, WORM, parts=8, points=6).sides(corners)
    assert sides.total == pytest.approx(exact.displacement, abs=3e-4)
    assert sides.work.sum() == pytest.approx(exact.work, rel=3e-4)


@settings(max_examples=examples(8))
@given(SEEDS, st.sampled_from(BODIES))
def test_mirrors_and_paces(seed: int, body: tuple[Shape, Ground]):
    shape, ground = body
    aim = aim_of(shape, ground)
    corners = corners_of(aim, seed)
    angles = np.array([name.startswith("angle") for name in shape.names])
    steps = Steps(shape, ground, parts=1, points=6)
    total = steps.sides(corners).total
    mirrored = steps.sides(np.where(angles, -corners, corners)).total
    assert mirrored == pytest.approx(total * [1, -1, -1], abs=1e-7)
    if ground.symmetric:
        back = steps.sides(corners[::-1]).total
        there = steps.sides(np.roll(corners, 1, axis=0)).total  # of which `back` is the way back
        assert compose(there, back) == pytest.approx(np.zeros(3), abs=1e-6)


@settings(max_examples=examples(12))
@given(SEEDS, st.sampled_from(BODIES[:2]), st.booleans())
def test_no_course_takes_less_work_than_its_bound(seed: int, body: tuple[Shape, Dry], closed: bool):
    shape, ground = body
    aim = aim_of(shape, ground, purpose="work", pose=(0.1, 0.0, 0.0), closed=closed)
    corners = corners_of(aim, seed)
    sides = Steps(shape, ground, parts=2, points=6).sides(corners, closed)
    work = float(sides.work.sum())
    bound = PlanarDesign(aim, corners, sides.total, work).work_bound
    assert bound is not None
    assert bound <= work * (1 + 1e-3)  # of the rule at given instants


def test_the_bound_is_reached_by_a_shape_that_pulls_one_mass_the_easy_way():
    # one link: the hind mass follows ahead, for which the ground takes F+ times its way
    shape = chain_shape(1)
    ground = Dry((Elliptic(1.0, 3.0, 2.0),))
    aim = PlanarAim(shape, ground, PlanarLimits(), "work", pose=(0.5, 0.0, 0.0), closed=False)
    course = np.array([[1.0], [0.5], [1.0]])
    displacement, work = moved(aim, course)
    design = PlanarDesign(aim, course, displacement, work)
    assert displacement == pytest.approx([0.5, 0, 0], abs=1e-12)
    assert design.work_bound == pytest.approx(1.0)
    assert work == pytest.approx(1.0)


@settings(max_examples=examples(30))
@given(st.tuples(*[st.floats(-2, 2)] * 2, st.floats(-3, 3)), st.integers(1, 7))
def test_roots_of_poses_lead_there_when_repeated(pose: tuple[float, float, float], cycles: int):
    step, found = root(np.array(pose), cycles), np.zeros(3)
    for _ in range(cycles):
        found = compose(found, step)
    assert found == pytest.approx(np.array(pose), abs=1e-12)


def test_an_open_course_is_one_whose_shape_does_not_return():
    course = Polygon([[0.0], [1.0], [0.5]], closed=False)
    s, ds = course.at([0.0, 0.25, 0.75, 1.0])
    assert s.ravel() == pytest.approx([0.0, 0.5, 0.75, 0.5])
    assert ds.ravel() == pytest.approx([2.0, 2.0, -1.0, -1.0])


def test_the_first_start_of_a_way_ahead_is_an_inchworm_within_its_limits():
    ground = Dry(tuple(Elliptic(grip, grip, grip) for grip in (1.0, 1.5, 1.0)))
    aim = aim_of(TWO, ground, corners=8)
    corners = first_corners(aim, 0, 0)
    assert corners.shape == (8, 3)
    assert (aim.ranges[:, 0] <= corners).all()
    assert (corners <= aim.ranges[:, 1]).all()
    x, y, turn = Steps(TWO, ground, parts=2, points=6).sides(corners).total
    assert x > 0.3
    assert abs(y) + abs(turn) < 0.1
    assert not np.array_equal(first_corners(aim, 0, 1), first_corners(aim, 1, 1))


def test_crossing_links_are_seen():
    bent = np.asarray(THREE.kinematics([2.6, 2.6])[0]).T
    open_ = np.asarray(THREE.kinematics([1.0, 1.0])[0]).T
    assert list(crossings(np.stack([open_, bent]))) == [(0, 2)]
    assert not list(crossings(open_[None]))


@settings(max_examples=examples(6))
@given(SEEDS, st.floats(1.05, 3.0))
def test_a_mass_that_holds_what_all_others_pull_never_moves(seed: int, more: float):
    noise = np.random.default_rng(seed)
    ends = noise.uniform(0.5, 2.0, (2, 3))  # F+, F-, Fn of masses 0 and 2
    grip = more * ends.max(axis=1).sum()
    ground = Dry(tuple(Elliptic(*map(float, law)) for law in (ends[0], [grip] * 3, ends[1])))
    with pytest.raises(ArgumentError, match="mass 1 holds"):
        PlanarAim(TWO, ground, PlanarLimits())
    with pytest.raises(ArgumentError, match="mass 1 holds"):
        PlanarAim(TWO, ground, PlanarLimits(), "work", pose=(0.1, 0.0, 0.0))
    aim = aim_of(TWO, ground, purpose="turn")
    corners = corners_of(aim, seed)
    turned = Steps(TWO, ground, parts=4, points=6).sides(corners).total
    head = np.asarray(TWO.kinematics(corners[0])[0])[:, 1]
    assert compose(turned, np.append(head, 0.0))[:2] == pytest.approx(head, abs=1e-6)


def swimmer_aim(size: float = 1.0, drag: float = 1.0, pace: float = 1.0, **more) -> PlanarAim:
    shape = chain_shape(3, lengths=(size,) * 3)
    ground = Viscous(Swimmer(shape, rods=(drag, 2 * drag)))
    limits = PlanarLimits(angle=(-1.0, 1.0), angle_rate=pace)
    return PlanarAim(shape, ground, limits, corners=4, **more)


@pytest.mark.slow
def test_designs_scale_with_their_units():
    aims = swimmer_aim(), swimmer_aim(2.0, 4.0, 4.0)
    one, other = (design_stroke(aim, starts=1) for aim in aims)
    assert other.value == pytest.approx(8 * one.value, rel=1e-6)
    assert np.abs(one.misses).max() < 1e-9
    square = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])  # the best known before
    speed = np.hypot(*Steps(THREE, WATER).sides(square).total[:2]) / 8
    assert one.value >= speed
    rates = np.abs(np.roll(one.corners, -1, axis=0) - one.corners).max(axis=1)
    assert side_times(one.aim, one.corners) == pytest.approx(rates)


def test_what_makes_no_sense_is_refused():
    one = chain_shape(2, lengths=(1.0, 1.0))
    for message, change in {
        "needs a pose": {"purpose": "work"},
        "may end with another shape": {"closed": False},
        "start needs 2": {"start": (0.0,)},
        "no mass 7": {"purpose": "turn", "pivot": 7},
        "has no least time": {"limits": {"effort": 1.0}},
    }.items():
        with pytest.raises(ArgumentError, match=message):
            aim_of(THREE, WATER, **change)
    with pytest.raises(ArgumentError, match="to and fro"):
        PlanarAim(one, SNAKE, PlanarLimits())
    with pytest.raises(ArgumentError, match="not above the radius"):
        PlanarLimits(half_width=0.1, radius=0.2)


test_scenes_say_what_is_wrong = refusals(
    "planar_gait_design",
    """
    viscous={along=1.0,across=2.0} | ground
    grips=[1.0,2.0] | grips
    ground.law=unit | ground.law
    limits.angle=[1.0,-1.0] | limits.angle
    limits.half_width=0.1 & limits.radius=0.2 | limits.half_width
    objective.pivot=5 | objective
    objective.pose=[1.0,0.0] | objective.pose
    """,
)


@pytest.mark.slow
def test_a_pose_out_of_reach_is_refused():
    with pytest.raises(SolveError):
        design_stroke(swimmer_aim(purpose="work", pose=(5.0, 0.0, 0.0)), starts=1)


@pytest.mark.slow
@pytest.mark.parametrize(("corners", "cycles"), [(3, 1), (4, 2)])
def test_a_single_link_reaches_a_pose_at_its_least_work(corners: int, cycles: int):
    # it grows with its tail at rest and shrinks with its head at rest: each mass slides 0.4 forward
    limits, law = PlanarLimits(length=(0.5, 1.0)), Elliptic(1.0, 3.0, 3.0)
    pose = (0.4 * cycles, 0.0, 0.0)
    aim = PlanarAim(chain_shape(1), law, limits, "work", pose=pose, cycles=cycles, corners=corners)
    design = design_stroke(aim, starts=1)
    assert design.displacement == pytest.approx([0.4, 0.0, 0.0], abs=1e-9)
    assert design.work == pytest.approx(0.8, rel=1e-9)


def test_gaits_that_cannot_exist_are_refused():
    link = chain_shape(1), Elliptic(1.0, 3.0, 3.0), PlanarLimits()
    refused: list[dict[str, Any]] = [
        {"purpose": "turn"}, {"purpose": "work", "pose": (0.4, 0.1, 0.0)},
    ]  # fmt: skip
    for more in refused:
        with pytest.raises(ArgumentError, match="single link"):
            PlanarAim(*link, **more)
    alike, stretching = Swimmer(THREE, rods=(1.0, 1.0)), Swimmer(TWO, rods=(1.0, 1.0))
    with pytest.raises(ArgumentError, match="centre of drag"):
        PlanarAim(THREE, alike, PlanarLimits())
    square = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
    total = Steps(THREE, Viscous(alike)).sides(square).total
    assert total == pytest.approx(np.zeros(3), abs=1e-12)
    assert PlanarAim(TWO, stretching, PlanarLimits()).purpose == "speed"  # rods weigh by length


@pytest.mark.slow
def test_turns_in_place_within_one_per_cent_of_the_supremum():
    result = wo.run(load_scene("planar_gait_design", ["want=[]"]))
    assert result.status == "ok"
    assert 0.99 < result.scalars["turn_over_bound"].value < 1.0
    first = result["corner"].values[0, 0]  # from the head to mass 1, about which it turns
    assert result.scalars["circle_radius"].value == pytest.approx(first, abs=1e-9)
    again = load_scene("planar_gait_design", ["want=[]"]).table.task
    displacement, work = moved(again, result["corner"].values)
    assert displacement[2] == pytest.approx(result.scalars["turn"].value, abs=1e-12)
    assert work == pytest.approx(result.scalars["work"].value)


@pytest.mark.slow
@pytest.mark.parametrize("half_width", [None, 0.6])
def test_straight_gaits_on_dry_ground(half_width: float | None):
    limits = PlanarLimits(angle=(-1.5, 1.5), half_width=half_width)
    design = design_stroke(PlanarAim(THREE, SNAKE, limits, corners=8), starts=1)
    assert np.abs(design.misses).max() < 1e-9
    assert design.work >= (design.work_bound or math.inf)
    assert design.value > (0.31 if half_width is None else 0.30)
    if half_width is not None:
        assert widest(design) <= half_width


@pytest.mark.slow
def test_a_heavier_middle_crawls_on_ground_that_resists_alike_all_ways():
    # below the sum of the others' grips two masses can hold while the third moves
    ground = Dry(tuple(Elliptic(grip, grip, grip) for grip in (1.0, 1.5, 1.0)))
    aim = PlanarAim(TWO, ground, PlanarLimits(), corners=8)
    inchworm = np.array([[0.5, 0.5, 0.0], [1.0, 0.5, 0.0], [0.5, 1.0, 0.0]])
    straight, _ = moved(aim, inchworm)
    assert straight == pytest.approx([0.5, 0.0, 0.0], abs=1e-9)
    assert side_times(aim, inchworm).sum() == pytest.approx(1.5)
    design = design_stroke(aim, starts=1)
    assert np.abs(design.misses).max() < 1e-9
    assert design.value > 0.45 > 0.5 / 1.5  # bent it gets farther than straight


@pytest.mark.slow
def test_no_worse_than_differential_evolution():
    aim = PlanarAim(THREE, WATER, PlanarLimits(angle=(-1.0, 1.0)), corners=6)
    steps = Steps(THREE, WATER, parts=1, points=5)

    def cost(w: np.ndarray) -> float:
        corners = w.reshape(6, 2)
        x, y, turn = steps.sides(corners).total
        return (3 * abs(turn) - math.hypot(x, y)) / side_times(aim, corners).sum()

    other = differential_evolution(cost, [(-1, 1)] * 12, rng=1, maxiter=60, popsize=5, polish=False)
    assert design_stroke(aim, starts=4).value >= -other.fun


@pytest.mark.parametrize(
    ("call", "says"),
    [
        pytest.param("P.driven_shape(", "[1.3707, 1.6572, 1.6572]", marks=pytest.mark.slow),
        ("TurnInPlace(", "True -1.0 3.0"),
        ("serpenoid_speed(", "viscous 0.2139"),
        ("P.kinematic_motion(", "[0.98"),
        pytest.param("P.crawl_velocity(", "17.01447", marks=pytest.mark.slow),
        pytest.param("P.design_stroke(", "0.0276", marks=pytest.mark.slow),
        pytest.param("P.best_stroke(", "0.0123641546", marks=pytest.mark.slow),
    ],
)
def test_examples_of_the_page_run(call: str, says: str, capsys: pytest.CaptureFixture[str]):
    page = DOCS / "theory-planar.md"
    blocks = re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    (code,) = (block for block in blocks if call in block)
    exec(code, {})
    assert says in capsys.readouterr().out


def test_the_page_shows_all_that_the_door_declares():
    page = (DOCS / "theory-planar.md").read_text(encoding="utf-8")
    blocks = "".join(re.findall(r"```python\n(.*?)```", page, re.DOTALL))
    shown = set(re.findall(r"\b(?:P|wo\.planar)\.(\w+)", blocks))
    assert {name for name in dir(wo.planar) if name[0] != "_"} <= shown | {"Axes", "Block"}
