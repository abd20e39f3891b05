"""Planar bench and stress: references by theory, the second route, the judge, the rivals."""

import math
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.benchmarks.ladder import task_of
from tests.benchmarks.planar_crawl import THREE_LINKS, by_minimize, by_phases
from tests.benchmarks.planar_mujoco import by_mujoco
from tests.benchmarks.planar_rivals import by_scipy, by_smoothing, tripod_by_events
from tests.benchmarks.planar_tasks import TASKS, stop_under_load, triangle
from tests.oracles.planar_loop import LOOSE, force_of, held, nearest, planar_flow
from tests.oracles.planar_worm import Drive, PlanarWorm, block, flat, plane
from tests.stress import motions
from tests.stress.motions import judge
from tests.stress.planar_cells import planar_cells
from wormopt.model.model import pack
from wormopt.simulation.options import Tolerance
from wormopt.simulation.simulate import simulate

numbers = st.floats(0.2, 5.0)


def cell_named(name: str):
    (found,) = [cell for cell in planar_cells() if cell.name == name]
    return found


def worm_of(dice: np.random.Generator, n: int = 4) -> PlanarWorm:
    """A worm with everything a PlanarWorm can have."""
    joints = n - 2
    return PlanarWorm(
        dice.uniform(0.5, 2, n),
        np.array([[3.0, 0.0], [2.0, 0.3], [1.0, 0.1], [0.0, 0.4]]),
        dice.normal(size=(n, 2)),
        *dice.uniform(0.5, 2, (3, n)),
        pairs=[(0, 1), (1, 2), (2, 3), (0, 2)],
        stiffness=dice.uniform(1, 5, 4),
        damping=dice.uniform(0.1, 1, 4),
        length=dice.uniform(0.5, 1, 4),
        drive=Drive(dice.normal(size=(2, 4)), dice.normal(size=(2, 4)), 1.3),
        bending=dice.uniform(1, 2, joints),
        bending_damping=dice.uniform(1, 2, joints),
        angle=dice.normal(size=joints) * 0.3,
        torque=Drive(dice.normal(size=(2, joints)), dice.normal(size=(2, joints)), 1.3),
        load=dice.normal(size=(n, 2)),
        drag=(0.3, 0.7),
        ground="box",
    )


# -- references ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("friction", "time", "place"), [(2.0, 2 / 3, (1 / 12, 4 / 15)), (1.5, 1.2, (0.2, 0.375))]
)
def test_a_block_under_load_stops_where_theory_says(friction: float, time: float, place):
    found = stop_under_load(friction, 1.0, 1.0, math.pi / 2)
    assert found[0] == pytest.approx(time, abs=1e-14)
    assert found[1] == pytest.approx(place, abs=1e-14)


@given(st.floats(1.2, 4.0), st.floats(0.2, 2.5), st.floats(0.2, 2.0))
def test_its_time_is_that_of_the_momentum_along_the_load(friction, angle, speed):
    time, _ = stop_under_load(friction, 1.0, speed, angle)
    assert time == pytest.approx((friction + math.cos(angle)) * speed / (friction**2 - 1), rel=1e-9)


def test_the_second_route_finds_the_stops_of_blocks():
    worm = block([0.0, 1.0], [2.0] * 3, load=(1.0, 0.0))
    motion = planar_flow(worm, 1.0)
    (stop,) = motion.happenings
    assert (stop.kind, stop.time) == ("stick", pytest.approx(2 / 3, abs=1e-12))
    assert motion.end == pytest.approx([1 / 12, 4 / 15, 0, 0], abs=1e-12)
    aslant = planar_flow(block([1.0, 1.0], [1.0, 1.0, 2.0]), 1.5, [1.3], care=LOOSE)
    assert aslant.happenings[0].time == pytest.approx(1.21151159553, abs=1e-10)
    assert aslant.states[:2, 0] == pytest.approx([0.682087730931, 0.327797363691], abs=1e-11)


def test_quadrature_has_the_digits_of_theory():
    task = TASKS["elliptic"]
    known = [1.21151159553, 0.682087730931, 0.327797363691]
    assert [task.stop, *task.end] == pytest.approx(known, abs=2e-11)


def test_the_tripod_pivots_and_rests_where_theory_says():
    end, stop = tripod_by_events("DOP853", 1e-12)
    task = TASKS["tripod"]
    assert end == pytest.approx(task.end, abs=1e-11)
    assert stop == pytest.approx(task.stop, abs=1e-11)
    known = [0.79073130637, 0.17443620545, 0.82493561311, 1.65717084601]
    assert [*task.end, task.stop] == pytest.approx(known, abs=1e-11)


# -- the second route ----------------------------------------------------------------------------


def test_forces_by_hand_are_those_of_the_model():
    worm = worm_of(np.random.default_rng(0))
    model = worm.model()
    ode = ca.Function("ode", [model.t, pack(model.x), model.forces], [model.ode])
    rates = np.array(ode(0.7, worm.start, np.zeros(8))).ravel()
    pull = worm.pull(0.7, plane(worm.place).tolist(), plane(worm.velocity).tolist())
    assert rates[8:] == pytest.approx(flat(pull) / np.repeat(worm.mass, 2), abs=1e-13)


@given(numbers, numbers, numbers, st.floats(-3.1, 3.1), st.floats(1.01, 30.0))
def test_the_nearest_force_lies_on_the_ellipse_and_what_is_left_along_its_normal(
    ahead, back, beside, way, size
):
    resistance = [ahead, back, beside]
    unit = np.array([math.cos(way), math.sin(way)])
    needed = size * unit / held(unit, resistance)
    force = nearest(needed, resistance)
    assert held(force, resistance) == pytest.approx(1.0, abs=1e-9)
    left = force - needed
    slip = force_of(complex(*left), resistance)
    assert (slip.real, slip.imag) == pytest.approx(tuple(force), abs=1e-6 * np.hypot(*force))


def test_a_straight_chain_goes_as_on_a_line():
    cell = cell_named("planar-chain straight 1, links 2")
    motion = planar_flow(cell.worm, 0.15, care=LOOSE)
    assert np.abs(motion.end[1::2]).max() < 1e-13
    assert np.abs(motion.end[6::2]).max() > 1e-3  # it does move


# -- stress --------------------------------------------------------------------------------------


def test_there_are_200_planar_cells_the_same_every_time():
    once, again = planar_cells(), planar_cells()
    assert len(once) == len({cell.name for cell in once}) == 200
    assert all(cell.name.startswith("planar-") for cell in once)
    assert {cell.worm.n - 1 for cell in once} == {0, 1, 2, 3, 4}
    for one, other in zip(once, again, strict=True):
        assert np.array_equal(one.start, other.start)
    assert 10 < len(planar_cells(quick=True)) < 25


@pytest.mark.parametrize("name", ["planar-block elliptic 1", "planar-block box 2"])
def test_blocks_are_judged_right(name: str):
    verdict = judge(replace(cell_named(name), span=1.0))
    assert (verdict.verdict, verdict.known) == ("right", 1.0)


def test_a_wrong_planar_motion_is_seen(monkeypatch: pytest.MonkeyPatch):
    right = motions.simulate

    def wrong(*given, **options):
        motion = right(*given, **options)
        return replace(motion, states=motion.states * (1 + 1e-7))

    monkeypatch.setattr(motions, "simulate", wrong)
    assert judge(replace(cell_named("planar-block elliptic 1"), span=1.0)).verdict == "wrong"


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        *(f"planar-chain {kind} 1, links 2" for kind in ("elliptic", "isotropic", "straight")),
        *(f"planar-chain {kind} 2, links 3" for kind in ("box", "spike", "skid")),
    ],
)
def test_each_kind_of_chain_agrees_with_its_second_route(name: str):
    verdict = judge(cell_named(name))
    assert (verdict.verdict, verdict.known) == ("right", 1.0)
    assert verdict.off < 0.5


# -- bench ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["block", "elliptic"])
def test_scipy_by_hand_comes_to_the_stop(name: str):
    task = TASKS[name]
    end, stop = by_scipy(task, "DOP853")(1e-10)
    assert end == pytest.approx(task.end, abs=1e-10)
    assert stop == pytest.approx(task.stop, abs=1e-8)
    assert by_smoothing(task)(1e-6)[0] == pytest.approx(task.end, abs=1e-5)


@pytest.mark.parametrize("name", ["block", "elliptic", "tripod"])
def test_simulate_comes_to_the_stop(name: str):
    task = TASKS[name]
    model = task.build()
    motion = simulate(model, task.span, tolerance=Tolerance(1e-10, 1e-11), route="python")
    assert motion.end[: len(task.end)] == pytest.approx(task.end, abs=2e-11)
    assert motion.events[-1].time == pytest.approx(task.stop, abs=1e-8)


@pytest.mark.slow
def test_a_crawl_by_minimisation_is_of_second_order_and_ends_where_exact_breaks_do():
    run = by_minimize(THREE_LINKS, "BFGS")
    steps = [64, 128, 256]
    off = [abs(run(n)[0][0] - THREE_LINKS.end[0]) for n in steps]
    assert -np.polyfit(np.log(steps), np.log(off), 1)[0] == pytest.approx(2.0, abs=0.3)
    assert off[-1] < 4e-3
    end, stop = by_phases(THREE_LINKS)(128)
    assert end == pytest.approx(THREE_LINKS.end, abs=6e-9)
    assert stop == pytest.approx(THREE_LINKS.stop, abs=1e-10)


@pytest.mark.slow
def test_the_triangle_ends_where_two_routes_say():
    task = TASKS["triangle"]
    assert planar_flow(triangle(), task.span).end[:6] == pytest.approx(task.end, abs=2e-11)
    motion = simulate(task.build(), task.span, tolerance=Tolerance(1e-12, 1e-13))
    assert motion.end[:6] == pytest.approx(task.end, abs=2e-11)


@pytest.mark.parametrize("name", list(TASKS))
def test_mujoco_is_of_first_order(name: str):
    pytest.importorskip("mujoco")
    task = TASKS[name]
    run = by_mujoco(task)
    coarse, fine = (np.abs(run(step)[0] - task.end).max() for step in (1e-2, 1e-3))
    assert 5 < coarse / fine < 20
    assert fine < 1e-3


def test_a_planar_benchmark_asks_for_places_alone():
    task = task_of("planar_elliptic", quick=True)
    ways = {way.name: way for way in task.ways}
    assert task.error(ways["wormopt"].make()(1e-6)) < 1e-9
    assert task.error(ways["SciPy LSODA, events"].make()(1e-6)) < 1e-5
