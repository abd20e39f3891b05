"""The best crawl of a chain: exact by phases, repeated by simulation, alike by other routes."""

import pickle
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from outcomes import refusals, value
from places import PROBLEMS
from random_crawlers import random_crawler
from worms import worm

import wormopt as wo
from tests.oracles.midpoint_crawls import Found, crawls
from wormopt.errors import ArgumentError, SceneError, SolveError
from wormopt.model.friction import Coulomb
from wormopt.model.gait import Gait
from wormopt.numerics.collocation import Collocation
from wormopt.ocp.contact import Regularised
from wormopt.ocp.mesh import Mesh
from wormopt.ocp.motion import Guess
from wormopt.ocp.optimise import optimise
from wormopt.result import Result
from wormopt.simulation.simulate import simulate
from wormopt.study import load_scene
from wormopt.systems.chain.build import chain
from wormopt.systems.chain.copies import scenario_model
from wormopt.systems.chain.crawl_limits import bound_of, excess_of
from wormopt.systems.chain.crawl_tables import Aim, CrawlLimits
from wormopt.systems.chain.dynamic import crawl_problem, sine_guess
from wormopt.systems.chain.optimal_crawl import OptimalCrawl

SCENE = PROBLEMS / "optimal_crawl.toml"


def crawl(*sets: str, **changes) -> Result:
    return wo.run(load_scene(SCENE, list(sets)).table.vary(**changes))


@pytest.fixture(scope="module")
def exact() -> Result:
    return crawl("search.starts=1", "mesh.arcs=20", want=())


def test_the_simulator_repeats_the_exact_crawl_and_the_period_closes(exact: Result):
    assert exact.status == "ok"
    assert value(exact, "recheck_error") < 1e-7
    # two periods on, so that an error of closing would show
    assert value(exact, "speed_simulated") == pytest.approx(value(exact, "speed"), abs=1e-7)
    assert value(exact, "defect_max") <= 1e-9
    assert exact.trust["first_order_gain"] < 1e-6


def test_head_and_tail_rest_about_a_quarter_of_the_time_each_and_the_middle_never(exact: Result):
    modes, times = np.array(value(exact, "mode_sequence")), np.array(value(exact, "phase_times"))
    resting = np.diff(times) @ (modes == 0)
    assert resting[0] == pytest.approx(0.25, abs=0.02)
    assert resting[2] == pytest.approx(resting[0], abs=1e-5)
    assert resting[1] == 0


def test_what_moves_the_worm_is_friction_alone(exact: Result):
    """Momentum: over a period the mean force of the ground is zero; work goes into losses."""
    t, force = exact["instant"].values, exact["contact_force"].values
    assert np.trapezoid(force.sum(axis=0), t) == pytest.approx(0.0, abs=1e-4)
    rate = np.diff(exact["velocity"].values, axis=0)
    power = (exact["input"].values * -rate).sum(axis=0)
    lost = 5.0 * (rate**2).sum(axis=0) - (force * exact["velocity"].values).sum(axis=0)
    assert np.trapezoid(power, t) == pytest.approx(np.trapezoid(lost, t), rel=1e-4)


@pytest.mark.slow
def test_relaxed_contact_converges_to_the_exact_crawl():
    """Smoothed friction with order one; grids faster, by how well their nodes meet switches."""
    result = crawl(want=("convergence",))
    assert 0.8 <= value(result, "order_smoothed") <= 1.3
    assert value(result, "order_complementarity") >= 0.8
    assert value(result, "same_modes") is True
    for name in ("smoothed", "complementarity"):
        error = abs(value(result, f"objective_{name}") - value(result, "objective"))
        assert error <= 1e-3
        assert error <= value(result, f"objective_{name}_error_bar")


@pytest.mark.slow
def test_with_stronger_actuators_lengths_touch_their_limits():
    result = crawl("limits.actuator_force=20", want=())
    # 2.2317 on 60 intervals with a smoothed law, by a script of another author
    assert -value(result, "objective") == pytest.approx(2.2317, abs=2e-3)
    lengths = result["length"].values
    assert lengths.min() == pytest.approx(1.4, abs=1e-6)
    assert lengths.max() <= 2.6 + 1e-6


@pytest.mark.slow
def test_a_saved_crawl_is_a_start_for_another(exact: Result, tmp_path: Path):
    exact.save(tmp_path)
    path = tmp_path / "crawl.toml"
    path.write_text(SCENE.read_text() + '\n[search]\nresult = "result.nc"\n')
    again = wo.run(load_scene(path).table.vary(want=()))
    assert value(again, "objective") == pytest.approx(value(exact, "objective"), abs=1e-7)


def test_a_start_that_is_no_crawl_is_refused(tmp_path: Path):
    path = tmp_path / "crawl.toml"
    (tmp_path / "other.nc").write_bytes(b"no result")
    path.write_text(SCENE.read_text() + '\n[search]\nresult = "other.nc"\n')
    with pytest.raises(SceneError, match=r"search.result.*does not contain the crawl"):
        wo.run(load_scene(path))


def test_copies_of_a_worm_move_like_the_worm_itself():
    stiff = {"stiffness": np.array([12.0, 9.0]), "friction_forward": 1.3}
    both = scenario_model(worm(), [{}, stiff])
    push = {"input": np.array([8.0, -6.0])}
    together = simulate(both, 1.0, p=push)
    for k, own in enumerate(({}, stiff)):
        alone = simulate(worm(), 1.0, p={**push, **own})
        for name in ("position", "velocity"):
            shared = together[f"{name} [{k}]"][:, -1]
            assert shared == pytest.approx(alone[name][:, -1], abs=1e-9)


def test_copies_need_a_draw():
    with pytest.raises(ArgumentError, match="at least one mapping"):
        scenario_model(worm(), [])


def test_one_input_for_two_worms_serves_the_slower_one_best_when_the_worst_counts():
    weak = {"friction_backward": 4.0}
    plant = scenario_model(worm(), [{}, weak])
    limits = CrawlLimits(period=1.0, actuator_force=12.0, length=(1.4, 2.6))
    mesh = Mesh.even(1, 24, Collocation(2, "radau"))
    w = 2 * np.pi

    def states(t: np.ndarray) -> np.ndarray:
        l1, l2 = 2 + 0.3 * np.cos(w * t), 2 + 0.3 * np.cos(w * t + 2.1)
        d1, d2 = -0.3 * w * np.sin(w * t), -0.3 * w * np.sin(w * t + 2.1)
        one = np.vstack([l1 + l2, l2, 0 * t, d1 + d2, d2, 0 * t])
        return np.vstack([one, one])

    def speeds(judge) -> np.ndarray:
        problem = crawl_problem(plant, limits, Aim(maximise="speed", effort=1e-3), judge)
        found = optimise(problem, mesh, Regularised(0.05, 1.0), Guess(1.0, states))
        ends = found.motion.states(np.array([0.0, 1.0]))
        return (ends[:, 1] - ends[:, 0])[[0, 6]]

    mean, worst = speeds("mean"), speeds("worst")
    assert worst.min() > mean.min() + 1e-3
    assert mean.mean() > worst.mean() - 2e-2


def objective_in(
    length: float, time: float, force: float, *, cost: bool, longest: float = 1.0
) -> float:
    """Least objective of the same worm, in its own units, where others are so large.

    Periods are from one unit of time to the `longest`.
    """
    speed = length / time
    plant = chain(
        2,
        mass=force * time / speed,
        stiffness=10 * force / length,
        damping=5 * force / speed,
        rest_length=2 * length,
        law=Coulomb(force, 10 * force),
        length_nominal=length,
        time_nominal=time,
    )
    if cost:
        aim = Aim(minimise="energy_per_mass_distance", speed=speed)
    else:
        aim = Aim(maximise="speed", effort=1e-3 * speed / force**2)
    period = (time, longest * time)
    limits = CrawlLimits(
        period=period, actuator_force=12 * force, length=(1.4 * length, 2.6 * length)
    )
    widths = Regularised(0.3 * speed, speed)
    mesh = Mesh.even(1, 12, Collocation(2, "radau"))
    problem = crawl_problem(plant, limits, aim)
    found = optimise(problem, mesh, widths, sine_guess(plant, time, 12 * force))
    return found.objective / (speed / time if cost else speed)


@cache
def usual_objective(cost: bool) -> float:
    return objective_in(1.0, 1.0, 1.0, cost=cost)


@pytest.mark.parametrize("cost", [False, True])
@pytest.mark.parametrize(
    "units",
    [
        (1e-3, 1.0, 1e-3),
        pytest.param((0.03, 0.8, 0.05), marks=pytest.mark.slow),
        (20.0, 100.0, 1e3),
    ],
)
def test_the_optimum_is_the_same_in_all_units(units: tuple[float, float, float], cost: bool):
    assert objective_in(*units, cost=cost) == pytest.approx(usual_objective(cost), rel=1e-6)


def test_how_long_a_period_may_be_changes_nothing_where_the_best_is_short():
    here = objective_in(1.0, 1.0, 1.0, cost=False, longest=3.0)
    there = objective_in(1.0, 1.0, 1.0, cost=False, longest=100.0)
    assert there == pytest.approx(here, rel=1e-6)


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ("[objective]\n", "objective"),
        ('[objective]\nminimise = "energy_per_mass_distance"\n', "objective.speed"),
        (
            '[objective]\nminimise = "energy_per_mass_distance"\nspeed = 1.0\n[robust]\n',
            "objective.minimise",
        ),
        ('[objective]\nmaximise = "speed"\n[robust]\n', "want"),
    ],
)
def test_aims_that_do_not_fit_are_refused_by_their_key(tmp_path: Path, change: str, key: str):
    text = SCENE.read_text()
    begin, end = text.index("[objective]"), text.index("[mesh]")
    scene = tmp_path / "crawl.toml"
    scene.write_text(text[:begin] + change + text[end:])
    with pytest.raises(SceneError, match=key):
        load_scene(scene)


# -- soft crawlers in SI units ---------------------------------------------------------------------

SOFT = """
schema = 1
kind = "optimal-crawl"
units = "SI"
[worm]
links = {links}
mass = {mass}
stiffness = "{stiffness} N/m"
damping = "{damping} N s/m"
rest_length = "{rest} mm"
slope = "{slope} deg"
load = {load}
friction = {{ kind = "coulomb", forward = "{forward} N", backward = "{backward} N" }}
[limits]
period = {period}
actuator_force = "{force} N"
length = ["{shortest} mm", "{longest} mm"]
[objective]
maximise = "speed"
effort = 1e-5
[mesh]
arcs = 30
"""
CRAWLER = {
    "links": 2, "mass": '["120 g", "80 g", "80 g"]', "stiffness": 600, "damping": 6, "rest": 57,
    "slope": 10, "load": '[0, 0, "0.3 N"]', "forward": 0.12, "backward": 3.1,
    "period": '["0.6 s", "2 s"]', "force": 20, "shortest": 45, "longest": 70,
}  # fmt: skip
CRAWLERS = [
    {},
    {"links": 4, "mass": '["120 g", "80 g", "80 g", "80 g", "80 g"]',
     "load": '[0, 0, 0, 0, "0.3 N"]'},
    {"links": 3, "mass": '["100 g", "60 g", "60 g", "100 g"]', "stiffness": 300, "damping": 8,
     "rest": 40, "slope": 0, "load": 0, "forward": 0.1, "backward": 1.5,
     "period": '["0.5 s", "1.5 s"]', "force": 5, "shortest": 30, "longest": 50},
    {"mass": '"300 g"', "slope": 30, "load": 0, "forward": 0.12, "backward": 0.4},
]  # fmt: skip


def soft(folder: Path, changes: dict):
    path = folder / "soft.toml"
    path.write_text(SOFT.format(**(CRAWLER | changes)))
    return load_scene(path)


@pytest.mark.slow
@pytest.mark.parametrize("changes", CRAWLERS)
def test_soft_crawlers_are_solved_or_told_in_words_of_the_scene(changes: dict, tmp_path: Path):
    result, told = None, ""
    try:
        result = wo.run(soft(tmp_path, changes))
    except SolveError as error:
        told = str(error)
    if result is None:
        assert re.search(r"limits\.(actuator_force|length|period)", told)
        assert "nominal" not in told
        return
    assert result.status == "ok", result.reason
    assert value(result, "speed_simulated") == pytest.approx(value(result, "speed"), rel=2e-2)
    table = result["length"].values
    shortest, longest = (1e-3 * (CRAWLER | changes)[k] for k in ("shortest", "longest"))
    assert table.min() >= shortest - 1e-6
    assert table.max() <= longest + 1e-6


@pytest.mark.parametrize("changes", CRAWLERS)
def test_sizes_are_those_of_the_scene(changes: dict, tmp_path: Path):
    study = soft(tmp_path, changes).table
    sized = study.sized(0.25)
    assert sized.x[1].nominal == 0.25
    friction = study.worm.friction
    for contact in sized.contacts:
        assert friction.forward <= contact.nominal_force <= friction.backward
        assert contact.nominal_speed == sized.x[1].nominal
    assert study.limits.actuator_force <= 20 * sized.u[0].nominal


# -- limits ----------------------------------------------------------------------------------------


test_limits_that_do_not_fit_are_refused = refusals(
    "optimal_crawl",
    """
    limits.rate=[1.0, 2.0, 3.0] | limits.rate | 3 entries for 2 links
    limits.actuator_force=[1.0, 2.0, 3.0] | limits.actuator_force
    limits.length=[[1.4, 2.6]] | limits.length | one range nor one per link
    limits.tick=0.3 | limits.period | no whole number of ticks
    worm.friction={kind="spike"} | worm.friction | resists no forward motion
    worm.slope=0.1 | worm.gravity | missing
    """,
)


@pytest.mark.parametrize("keys", [["load=0.1"], ["drag=0.1"], ["slope=0.1", "gravity=9.81"]])
def test_spikes_are_enough_where_something_resists(keys: list[str]):
    load_scene(SCENE, ['worm.friction={kind="spike"}', *(f"worm.{key}" for key in keys)])


@pytest.mark.parametrize("period", [(1.0, 1.0), (0.6, 2.0), (0.9, 1.2)])
def test_cycles_fill_an_allowed_period(period: tuple[float, float]):
    limits = CrawlLimits(period=period, actuator_force=1.0)
    for duration in np.geomspace(0.01, 3.0, 40):
        low, high = limits.durations_near(float(duration), 4.0)
        assert low <= high
        for one in np.linspace(low, high, 7):
            counts = np.arange(1, 500)
            filled = (counts * one >= period[0] * (1 - 1e-9)) & (
                counts * one <= period[1] * (1 + 1e-9)
            )
            assert filled.any()


@cache
def objective_within(**limits) -> float:
    given = {"period": 1.0, "actuator_force": 12.0, "length": (1.4, 2.6)} | limits
    problem = crawl_problem(worm(), CrawlLimits(**given), Aim(maximise="speed", effort=1e-3))
    mesh = Mesh.even(1, 12, Collocation(2, "radau"))
    return optimise(problem, mesh, Regularised(0.3, 1.0), sine_guess(worm(), 1.0, 12.0)).objective


@pytest.mark.parametrize(
    ("huge", "plain"),
    [
        ({"rate": 1e9}, {}),
        ({"acceleration": 1e30}, {}),
        ({"actuator_power": 1e15}, {}),
        ({"energy_per_cycle": 1e30}, {}),
        ({"actuator_force": (12.0, 1e15)}, {"actuator_force": (12.0, 1e3)}),
        ({"rate": (1e15, 0.5)}, {"rate": (20.0, 0.5)}),
    ],
)
def test_limits_too_large_to_bind_change_nothing(huge: dict, plain: dict):
    assert objective_within(**huge) == pytest.approx(objective_within(**plain), rel=1e-6)


def test_strong_actuators_do_not_change_sizes():
    def sizes(force: float) -> list[float]:
        limits = CrawlLimits(period=1.0, actuator_force=force, length=(1.4, 2.6))
        sized = study_of(limits=limits).sized(1.0)
        return [sized.u[0].nominal, *(contact.nominal_force for contact in sized.contacts)]

    usual = sizes(12.0)
    assert sizes(1e9) == sizes(1e30)
    assert sizes(1e9)[1:] == usual[1:]
    assert usual[0] <= sizes(1e9)[0] <= 100 * usual[0]


@pytest.mark.slow
def test_a_force_too_large_to_bind_is_no_limit():
    free = crawl("limits.actuator_force=1e9", "search.starts=1", "mesh.arcs=20", want=())
    assert free.status == "ok"
    assert value(free, "sensitivity.actuator_force") == 0.0
    assert value(free, "input_peak") < 1e3


def test_excess_of_a_limit_between_points_of_the_mesh_is_found():
    """Power from velocities and forces at many times, against 5 and 2 per link."""
    plant = worm()
    limits = CrawlLimits(period=1.0, actuator_force=12.0, rate=9.0, actuator_power=(5.0, 2.0))
    problem = crawl_problem(plant, limits, Aim(maximise="speed", effort=1e-3))
    mesh = Mesh.even(1, 6, Collocation(2, "radau"))
    motion = optimise(problem, mesh, Regularised(0.3, 1.0), sine_guess(plant, 1.0, 12.0)).motion
    t = np.linspace(0.0, 1.0, 20001)[:-1]
    v, u = motion.states(t)[3:], motion.inputs(t)
    rate = v[:-1] - v[1:]
    beyond = (u * rate - np.array([[5.0], [2.0]])).max() / 5.0
    assert beyond > 1e-3
    found = excess_of(motion)
    assert found["limits.actuator_power"] == pytest.approx(beyond, rel=0.02)
    assert np.abs(rate).max() < 9.0
    assert found["limits.rate"] == 0.0


def study_of(**changes) -> OptimalCrawl:
    return load_scene(SCENE).table.vary(**changes)


@pytest.mark.parametrize("effort", [0.0, 1e-3, 0.02, 0.3])
@pytest.mark.parametrize("rate", [None, 0.4])
@pytest.mark.parametrize("power", [None, 3.0])
def test_the_bound_is_the_best_balance_of_power(
    effort: float, rate: float | None, power: float | None
):
    """Two links of damping 5 and force 12, three masses of forward friction 1, by brute force."""
    limits = CrawlLimits(period=1.0, actuator_force=12.0, rate=rate, actuator_power=power)
    aim = Aim(maximise="speed", effort=effort)
    bound = bound_of(study_of(limits=limits, objective=aim))
    a, u = np.meshgrid(np.linspace(0, rate or 1.5, 1501), np.linspace(0, 12, 1201))
    gain = np.minimum(u * a, power or np.inf) - 5.0 * a**2
    best = 2 * np.max(gain / 3.0 - effort * u**2)
    assert bound is not None
    assert bound == pytest.approx(-best, rel=1e-3)
    assert -bound >= best * (1 - 1e-12)


@pytest.mark.parametrize("rate", [1e-6, 0.4])
def test_the_bound_downhill_is_where_drag_takes_all_power(rate: float):
    """Loads of -2 on three masses exceed their friction forward, 1: a rigid worm slides too."""
    study = load_scene(SCENE, ["worm.load=-2", "worm.drag=0.5", "objective.effort=0"]).table
    limits = CrawlLimits(period=1.0, actuator_force=12.0, rate=rate)
    bound = bound_of(study.vary(limits=limits))
    v = np.linspace(0.0, 20.0, 20_001)
    power = 2 * (12.0 * rate - 5.0 * rate**2)
    assert bound == pytest.approx(-v[1.5 * v**2 - 3.0 * v <= power].max(), abs=1e-3)


def test_the_energy_of_every_crawl_covers_friction_and_load():
    aim = Aim(minimise="energy_per_mass_distance", speed=1.0)
    assert bound_of(study_of(objective=aim)) == pytest.approx(3.0 / 3.0)


def test_studies_can_be_sent_to_other_processes():
    study = study_of()
    assert study.plant.n_x == 6
    again = pickle.loads(pickle.dumps(study))
    assert again == study
    assert "plant" not in vars(again)


@pytest.mark.slow
def test_sensitivities_are_the_slopes_of_the_optimum(free: Result):
    def best(**limits) -> float:
        given = {"period": 1.0, "actuator_force": 12.0, "length": (1.4, 2.6)} | limits
        return -value(crawl(want=(), limits=CrawlLimits(**given)), "objective")

    step = 0.01
    by_force = (best(actuator_force=12 + step) - best(actuator_force=12 - step)) / (2 * step)
    assert value(free, "sensitivity.actuator_force") == pytest.approx(by_force, rel=1e-3)
    by_period = (best(period=1 + step) - best(period=1 - step)) / (2 * step)
    assert value(free, "sensitivity.period") == pytest.approx(by_period, rel=1e-2)
    assert value(free, "sensitivity.length.shortest") == 0.0


@pytest.mark.slow
def test_a_cycle_is_a_whole_number_of_ticks():
    result = crawl("limits.period=[0.5, 2.0]", "limits.tick=0.03", want=())
    ticks = value(result, "time") / 0.03
    assert ticks == pytest.approx(round(ticks), abs=1e-9)
    assert result.status == "ok"


@pytest.fixture(scope="module")
def free() -> Result:
    return crawl(want=())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "most"),
    [
        ("rate", 1.8),
        ("actuator_power", 10.0),
        pytest.param("acceleration", 25.0, marks=pytest.mark.many),
        pytest.param("energy_per_cycle", 10.0, marks=pytest.mark.many),
    ],
)
def test_tighter_limits_hold_and_cost_speed(free: Result, name: str, most: float):
    tight = crawl(f"limits.{name}={most}", want=())
    assert tight.status == "ok"
    assert value(tight, "objective") > value(free, "objective") + 1e-4
    assert value(tight, f"sensitivity.{name}") > 0.0
    t, v = free["instant"].values, free["velocity"].values
    assert np.abs(np.diff(v, axis=0)).max() > 1.8  # so that the limit of rates binds
    assert t[-1] == pytest.approx(1.0)


# -- random robots against another program ---------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("seed", [
    pytest.param(k, marks=pytest.mark.xfail(reason="no exact motion: failed, with the reason"))
    if k == 2 else pytest.param(k, marks=[pytest.mark.many] * (k > 4)) for k in range(20)
])  # fmt: skip
def test_random_robots_crawl_no_slower_than_by_another_program(seed: int):
    tables = random_crawler(seed)
    study = load_scene(tables).table
    result = wo.run(study)
    assert result.status == "ok", result.reason
    limits, effort = tables["limits"], tables["objective"]["effort"]
    # what needs no other program
    length, u = result["length"].values, result["input"].values
    rate = -np.diff(result["velocity"].values, axis=0)
    assert limits["length"][0] * (1 - 1e-6) <= length.min()
    assert length.max() <= limits["length"][1] * (1 + 1e-6)
    assert np.abs(u).max() <= limits["actuator_force"] * (1 + 1e-6)
    assert np.abs(rate).max() <= limits.get("rate", np.inf) * (1 + 1e-3)
    # power is limited at the points of arcs; a warning says what it is between them
    if (u * rate).max() > limits.get("actuator_power", np.inf) * (1 + 1e-3):
        assert any("actuator_power is exceeded" in text for text in result.trust["warnings"])
    ours = value(result, "speed_simulated") - effort * value(result, "input_rms") ** 2
    rivals = [one for one in crawls(tables, 4, seed) if one.merit > ours]
    for found in [*rivals, *waves(tables, seed)]:
        speed, over = simulated(study, found)
        theirs = speed - effort * np.mean(np.sum(found.inputs**2, axis=0))
        assert ours >= theirs - 1e-3 * abs(theirs) or over > 1e-3


def waves(tables: dict, seed: int) -> Iterator[Found]:
    """Rivals that are always there: random waves of inputs, where their simulation shows all."""
    dice, limits = np.random.default_rng([2, seed]), tables["limits"]
    durations = np.max(limits["period"]) / np.array([1, 2, 4, 8])
    for duration in [] if "acceleration" in limits else durations:
        phase = dice.uniform(0, 2 * np.pi, (tables["worm"]["links"], 1))
        size = dice.uniform(0.1, 1.0) * limits["actuator_force"]
        yield Found(duration, size * np.cos(np.linspace(0, 2 * np.pi, 51)[:-1] + phase), np.nan)


def simulated(study: OptimalCrawl, found: Found) -> tuple[float, float]:
    """Speed with exact friction after many cycles, and how far lengths, rates, powers exceed."""
    steps = found.inputs.shape[1]
    breaks = np.linspace(0.0, found.duration, steps + 1)
    course = Gait(breaks, found.inputs.T[:, :, None])
    span, masses = 40 * found.duration, study.worm.links + 1
    run = simulate(wo.drive(study.plant, course, periodic=True), span, dense=True)
    assert run.dense is not None
    t = np.linspace(0.0, found.duration, 400)
    x = run.dense(span - found.duration + t)
    u = found.inputs[:, (t / t[-1] * steps).astype(int) % steps]
    ranges = study.limits.length_ranges(study.worm.links)
    assert ranges is not None
    low, high = ranges[0]
    length = x[: masses - 1] - x[1:masses]
    rate = x[masses : 2 * masses - 1] - x[masses + 1 : 2 * masses]
    limits = study.limits
    over = max(
        (low - length.min()) / (high - low),
        (length.max() - high) / (high - low),
        np.abs(rate).max() / (limits.rate or np.inf) - 1,
        (u * rate).max() / (limits.actuator_power or np.inf) - 1,
    )
    return (x[0, -1] - x[0, 0]) / found.duration, over
