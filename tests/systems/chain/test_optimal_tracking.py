"""Optimal tracking: meshes over breaks, the LQ optimum, the tube, exact replays, the comparison."""

import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from outcomes import refusals, value
from scipy.integrate import solve_ivp
from worms import free_worm, worm

import wormopt as wo
from wormopt.control.loop import gait_reference, with_reference
from wormopt.control.lqr import lqr
from wormopt.errors import SolveError
from wormopt.numerics.collocation import Collocation
from wormopt.ocp.mesh import Mesh
from wormopt.result import Result
from wormopt.simulation.simulate import simulate
from wormopt.study import load_scene
from wormopt.systems.chain.measured import judged, judged_numbers
from wormopt.systems.chain.optimal_tracking import optimal_input
from wormopt.systems.chain.tables import Grid, LeastError, Relaxation, Tube
from wormopt.systems.spiked.construct import fast_gait

# -- meshes over breaks ----------------------------------------------------------------------------


def test_no_arc_of_a_mesh_over_breaks_crosses_one():
    mesh = Mesh.over([0.0, 0.1, 1.0, 3.0], 0.25, Collocation(2), input_degree=1)
    edges = 3.0 * np.cumsum([0.0, *(mesh.shares or ())])
    assert mesh.phases == 1
    assert mesh.input_degree == 1
    assert np.diff(edges).max() <= 0.25 * (1 + 1e-12)
    for time in (0.1, 1.0, 3.0):
        assert np.abs(edges - time).min() < 1e-14
    # 0.1 needs one arc, 0.9 four, 2.0 eight
    assert mesh.total == 1 + 4 + 8


@pytest.mark.parametrize("breaks", [[0.0], [0.0, 0.0, 1.0], [0.0, 2.0, 1.0]])
def test_a_mesh_refuses_breaks_that_do_not_ascend(breaks: list[float]):
    with pytest.raises(ValueError, match="breaks must ascend"):
        Mesh.over(breaks, 0.1, Collocation(2))


def test_breaks_of_a_model_are_those_of_all_its_schedules():
    plant = free_worm()
    model = with_reference(plant, gait_reference(fast_gait(1.0), plant.t, shift=0.1))
    expected = [0.0, *(k / 3 - 0.1 for k in range(1, 7)), 2.0]
    assert model.breaks(2.0) == pytest.approx(expected, abs=1e-12)
    assert len(model.breaks(2.0)) == 8
    # an end that is a break stands once
    whole = with_reference(plant, gait_reference(fast_gait(1.0), plant.t))
    assert len(whole.breaks(10.0)) == 31


# -- optimal tracking ------------------------------------------------------------------------------

TUBE = Tube(radius=0.2, capture=1.0)


def test_without_friction_optimal_tracking_is_the_lq_optimum():
    """Against the tracking Riccati equation, integrated backward in links' coordinates.

    M y'' = u - D y' - S (y - 2) with M = m [[2, -1], [-1, 2]]^-1, so that without friction the
    links know nothing of where the worm is.
    """
    end, rho = 1.0, 1e-2
    plant, gait = free_worm(), fast_gait(1.0)
    found, coarse = (
        optimal_input(
            plant, gait_reference(gait, plant.t), end, LeastError(input_weight=rho), TUBE,
            Grid(arcs=arcs, degree=3), Relaxation(), period=1.0,
        )
        for arcs in (90, 45)
    )  # fmt: skip
    gain = np.array([[2.0, -1.0], [-1.0, 2.0]])
    zero, one = np.zeros((2, 2)), np.eye(2)
    A = np.block([[zero, one], [-10 * gain, -5 * gain]])
    B = np.vstack([zero, gain])
    offset = np.concatenate([np.zeros(2), gain @ np.full(2, 20.0)])
    C = np.hstack([one, zero])

    # value x'Px + 2 q'x + r of what is still to come, from its Hamilton-Jacobi equation
    def backward(s: float, value: np.ndarray) -> np.ndarray:
        P, q = value[:16].reshape(4, 4), value[16:20]
        wanted = gait(np.array([end - s]))[:, 0]
        BB = B @ B.T / rho
        dP = A.T @ P + P @ A + C.T @ C - P @ BB @ P
        dq = A.T @ q + P @ offset - P @ BB @ q - C.T @ wanted
        dr = 2 * q @ offset - q @ BB @ q + wanted @ wanted
        return np.concatenate([dP.ravel(), dq, [dr]])

    sharp = {"rtol": 1e-10, "atol": 1e-12, "max_step": 0.02}
    value = solve_ivp(backward, (0.0, end), np.zeros(21), **sharp).y[:, -1]
    x = np.array([2.0, 2.0, 0.0, 0.0])
    optimum = x @ value[:16].reshape(4, 4) @ x + 2 * value[16:20] @ x + value[20]
    # inputs that are constant on 90 arcs cost a little more, of second order in their length
    assert optimum <= found.objective <= optimum * (1 + 2e-5)
    ratio = (coarse.objective - optimum) / (found.objective - optimum)
    assert 3.5 < ratio < 4.5


@pytest.fixture(scope="module")
def in_the_tube() -> Result:
    return wo.run(load_scene("track_optimal", ["time.end=1.5", "tube.capture=1.0"]))


@pytest.mark.slow
def test_the_tube_holds_in_the_exact_simulation(in_the_tube: Result):
    assert in_the_tube.status == "ok", in_the_tube.reason
    # the optimiser keeps 2 % of the radius free; the grid uses up less than half of that
    assert value(in_the_tube, "time_outside_tube") == 0
    assert 0.98 * 0.2 * (1 - 1e-3) < value(in_the_tube, "error_peak") < 0.98 * 0.2 * 1.01
    assert value(in_the_tube, "capture_time") <= 1.0
    time, error = in_the_tube["time"].values, in_the_tube["error_norm"].values[0]
    assert error[time >= 1.0].max() <= 0.2
    assert in_the_tube.trust["complementarity_max"] <= 1.0001e-3


def test_the_objective_is_found_again_by_simulation(in_the_tube: Result):
    # inputs are the optimiser's own, so that their integral is the same
    assert value(in_the_tube, "objective") == pytest.approx(
        value(in_the_tube, "objective_found"), rel=1e-9
    )
    assert value(in_the_tube, "recheck_error") < 0.03
    assert in_the_tube.trust["recheck"]["error"] < 1e-7


@pytest.mark.slow
def test_least_error_is_found_again_and_beats_lqr():
    change = ["time.end=1.5", "tube.capture=1.0", 'objective={minimise="error",input_weight=1e-3}']
    result = wo.run(load_scene("track_optimal", change))
    assert result.status == "ok", result.reason
    found, exact = value(result, "objective_found"), value(result, "objective")
    assert exact == pytest.approx(found, rel=0.01)
    plant = worm()
    loop = lqr(plant, gait_reference(fast_gait(1.0), plant.t), error_weight=1e3)
    numbers = judged_numbers(simulate(judged(loop, TUBE), 1.5), TUBE)
    other = numbers["error_integral"] + 1e-3 * numbers["input_integral"]
    assert exact < 0.8 * other


def test_what_is_measured_agrees_with_quadrature():
    plant = worm()
    loop = lqr(plant, gait_reference(fast_gait(1.0), plant.t), error_weight=10.0)
    motion = simulate(judged(loop, TUBE), 3.0, dense=True)
    numbers = judged_numbers(motion, TUBE)
    t = np.linspace(0.0, 3.0, 30_001)
    fine = motion.at(t)
    error, power = fine["error"], fine["input"] * fine["rate"]
    assert numbers["error_integral"] == pytest.approx(
        np.trapezoid((error**2).sum(axis=0), t), rel=1e-5
    )
    spent = np.trapezoid(np.maximum(power, 0).sum(axis=0), t)
    assert numbers["work"] == pytest.approx(spent, rel=1e-4)
    assert numbers["net_work"] == pytest.approx(np.trapezoid(power.sum(axis=0), t), rel=1e-4)
    assert numbers["energy_per_mass_distance"] == pytest.approx(
        numbers["work"] / (3 * numbers["distance"])
    )
    late, size = t >= 1.0, np.linalg.norm(error, axis=0)
    assert numbers["time_outside_tube"] == pytest.approx(np.mean(size[late] > 0.2) * 2, abs=1e-4)
    assert numbers["error_peak"] == pytest.approx(size[late].max(), rel=1e-6)


def test_an_impossible_tube_is_refused_by_its_name():
    change = ["time.end=1.0", "tube.capture=0.0", "start.position=[4.5, 2.0, 0.0]"]
    with pytest.raises(SolveError, match="tube") as caught:
        wo.run(load_scene("track_optimal", change))
    assert caught.value.code == "infeasible"
    assert caught.value.partial.status == "failed"


def in_other_units(mass: float, length: float, least: str) -> list[str]:
    """One problem, written in units of mass and length that are 1/`mass` and 1/`length`."""
    force = mass * length
    weight = f", input_weight = {1e-6 / mass**2}" if least == "error" else ""
    return [
        f"worm.mass={mass}", f"worm.stiffness={1.5 * mass}", f"worm.damping={0.5 * mass}",
        f"worm.friction.forward={force}", f"worm.friction.backward={3 * force}",
        f"worm.rest_length={2 * length}", f"reference.gait.rest_length={2 * length}",
        f"start.position=[{4.6 * length},{2 * length},0.0]", f"tube.radius={0.2 * length}",
        "reference.gait.period=0.5", "time.end=1.0", "tube.capture=0.5", "mesh.arcs=20",
        f"objective={{minimise = '{least}'{weight}}}",
    ]  # fmt: skip


@cache
def in_units(mass: float, length: float, least: str) -> Result:
    changes = [*in_other_units(mass, length, least), "mesh.arcs=10"]
    return wo.run(load_scene("track_optimal", changes))


@pytest.mark.parametrize(
    ("mass", "length", "least"),
    [
        (1e3, 1.0, "input"),
        pytest.param(1e-6, 1e3, "error", marks=pytest.mark.slow),
        pytest.param(1e-3, 1.0, "error", marks=pytest.mark.slow),
    ],
)
def test_the_optimum_is_the_same_in_all_units(mass: float, length: float, least: str):
    other = in_units(mass, length, least)
    unit = length**2 if least == "error" else (mass * length) ** 2
    assert other.status == "ok", other.reason
    assert value(other, "objective_found") / unit == pytest.approx(
        value(in_units(1.0, 1.0, least), "objective_found"), rel=1e-5
    )


def test_what_an_impossible_tube_lacks_is_the_same_in_all_units():
    sizes = []
    for mass in (1.0, 1e6):
        change = [*in_other_units(mass, 1.0, "input"), "tube.capture=0.01", "time.end=0.1"]
        with pytest.raises(SolveError, match=r"allows one is tube by about 0\.\d\d;") as caught:
            wo.run(load_scene("track_optimal", change))
        sizes.append(float(str(caught.value).split("by about ")[1].split(";")[0]))
    # what is printed is known to its last digit; units of force change nothing else
    assert max(sizes) - min(sizes) < 0.011, sizes


def test_a_solve_that_is_late_is_told():
    scene = load_scene(
        "track_optimal", ["relaxation.time_limit=0.01", "time.end=1.5", "tube.capture=1.0"]
    )
    with pytest.raises(SolveError, match=r"within the time limit.* larger relaxation\.time_limit"):
        wo.run(scene)


def test_a_start_outside_a_tube_without_time_to_get_in_is_told():
    change = ["tube.capture=0", "start.position=[4.5, 2.0, 0.0]"]
    with pytest.raises(SolveError, match=r"the initial error [0-9.]+ is outside") as caught:
        wo.run(load_scene("track_optimal", change))
    assert caught.value.code == "infeasible"
    off = float(str(caught.value).split("initial error ")[1].split(" ")[0])
    gait = wo.fast_gait(1.0)
    assert off == pytest.approx(
        np.hypot(*(np.array([2.5, 2.0]) - gait(np.zeros(1)).ravel())), rel=1e-3
    )


def test_a_grid_of_too_many_arcs_is_refused():
    with pytest.raises(SolveError, match=r"1\.5e\+05 arcs until time\.end"):
        wo.run(load_scene("track_optimal", ["reference.gait.period=1e-3"]))


def test_a_worm_that_no_lqr_holds_is_told():
    with pytest.raises(SolveError, match=r"as first guess: .*; choose units"):
        wo.run(load_scene("track_optimal", ["worm.mass=1e-30"]))


LATE = "{feedback='difference',tube_radius=0.2,lag=0.1}"
PREDICTIVE = "{period=0.02,horizon=0.1,input_weight=1e-4,v_reg=0.1}"


test_plans_that_make_no_sense_are_refused = refusals(
    "track_optimal",
    """
    tube.capture=9 | tube.capture
    relaxation={first=1e-4,last=1e-2} | relaxation.last
    worm.random.stiffness={process='fixed',spread=1.0} | worm.random
    """,
)
test_comparisons_that_make_no_sense_are_refused = refusals(
    "compare_tracking",
    """
    tracker.0.tube_radius=0.3 | tracker[0].tube_radius
    draws.known=1000 | draws.known
    worm.friction={kind='viscous',drag=1.0} | worm.friction
    crawl.length=[2.6,1.4] | crawl.length
    """,
)
test_hardware_that_makes_no_sense_is_refused = refusals(
    "compare_over",
    f"""
    hardware.delay=1e-4 | hardware.delay
    hardware.noise_interval=1e-4 | hardware.noise_interval
    draws.known=1 | draws.known
    hardware.delay=0.1 & tracker=[{LATE}] | hardware.delay
    predictive={PREDICTIVE} | hardware
    """,
)


# -- the comparison --------------------------------------------------------------------------------

QUICK = [
    "time.end=3.0", "tube.capture=1.0", "time.samples=301", "mesh.arcs=15", "draws.members=6",
    "draws.known=1", "crawl.arcs=30",
]  # fmt: skip


@pytest.fixture(scope="module")
def compared() -> Result:
    return wo.run(load_scene("compare_tracking", QUICK))


@pytest.mark.slow
def test_all_rivals_are_compared_by_one_simulator(compared: Result):
    assert compared.status == "ok", compared.reason
    names = compared.attributes["rivals"]
    assert len(names) == 9
    assert value(compared, "recheck_error") < 1e-7
    assert np.array(value(compared, "distance")).shape == (2, 9)
    of = {name: k for k, name in enumerate(names)}
    error, spent = (np.array(value(compared, f"{of}_integral")) for of in ("error", "input"))
    cost = error + 1e-4 * spent
    # each plan is best at what it is for; a coarse grid costs a little
    for row, effort, speed in zip(
        cost, value(compared, "input_integral"), value(compared, "mean_speed"), strict=True
    ):
        assert row.argmin() in (of["optimal tracking"], of["optimal tracking + LQR"])
        assert effort[of["optimal tube"]] <= min(effort) * 1.02
        assert speed[of["fastest crawl"]] > 0.9 * max(speed)


@pytest.mark.slow
def test_plants_that_are_not_as_believed_are_all_counted(compared: Result):
    drawn = compared["drawn_distance"].values
    assert drawn.shape == (2, 9, 6)
    failed = np.array(value(compared, "draws_failed"))
    assert (np.isnan(drawn).sum(axis=2) == failed).all()
    outside = np.array(value(compared, "draws_outside"))
    late = compared["drawn_time_outside_tube"].values
    assert (outside == 6 - (late == 0).sum(axis=2)).all()


@pytest.mark.slow
def test_who_knows_the_plant_does_better_on_it(compared: Result):
    """The same plant under the plan made for it and under that for the worm as believed."""
    names, plans = compared.attributes["rivals"], compared.attributes["known"]
    k = names.index("optimal tracking")
    known = plans.index("optimal tracking")

    def cost(which: str, row: tuple[int, ...]) -> float:
        spent = compared[f"{which}_input_integral"].values[row]
        return compared[f"{which}_error_integral"].values[row] + 1e-4 * spent

    assert cost("known", (known, 0)) < cost("drawn", (0, k, 0))


def test_drawn_plants_are_the_same_whatever_their_number():
    few = wo.load("compare_tracking", ["draws.members=3", "draws.known=0"])
    many = wo.load("compare_tracking", ["draws.members=100"])
    gait = fast_gait(1.0)
    for a, b in zip(*(each.draws.of(each.plant(gait)) for each in (few, many)), strict=False):
        for name, values in a.items():
            np.testing.assert_array_equal(values, b[name])
            assert np.all(np.abs(values / np.mean(values) - 1) < 1)
    factors = np.array([each["friction_backward"] for each in many.draws.of(many.plant(gait))]) / 10
    assert 0.7 <= factors.min() < 0.72
    assert 1.28 < factors.max() <= 1.3


@pytest.mark.slow
def test_the_table_is_written_beside_the_result(compared: Result, tmp_path: Path):
    compared.save(tmp_path)
    table = (tmp_path / "table.md").read_text(encoding="utf-8")
    for name in (*compared.attributes["rivals"], "6 plants, ±30%", "plant known"):
        assert name in table
    for block in table.split("## ")[1:]:  # rows have as many cells as their head
        rows = [line for line in block.splitlines() if line[:1] == "|"]
        assert len({len(re.findall(r"(?<!\\)\|", line)) for line in rows}) == 1


OVER = [
    "time.end=1.2", "tube.capture=0.5", "time.samples=61", "draws.members=6",
    "reference=[{name='a',gait={shape='fast',period=1.0,rest_length=2.0,elongation=0.15}}]",
    "tracker=[{feedback='derivative',tube_radius=0.2,growth=1e4}]",
]  # fmt: skip


@pytest.mark.slow
def test_noise_of_nothing_is_no_noise_and_each_plant_has_its_own():
    none, little, much = (
        wo.run(load_scene("compare_over", [*OVER, f"hardware.noise={noise}"]))
        for noise in (0.0, 1e-9, 0.02)
    )
    for name in ("error_integral", "input_integral", "distance"):
        exact = none[f"drawn_{name}"].values
        # noise of 1e-9 acts by its rate too, some 1e-7
        np.testing.assert_allclose(little[f"drawn_{name}"].values, exact, rtol=1e-4, atol=1e-6)
    spent, more = (each["drawn_input_integral"].values[0] for each in (none, much))
    assert (more > spent).all()
    assert len(set(np.round((more - spent)[0], 9))) == 6
    # one route each, as wherever plants are drawn
    assert none.status == little.status == much.status == "unchecked"


@pytest.mark.slow
def test_a_worm_that_late_feedback_loses_is_counted_and_others_are_told():
    """Beyond k delay / mass = pi/2 no gain is stable: (14) grows its own until it loses."""
    late = [*OVER, "hardware={delay=0.06}", "tracker.0.feedback='filter'"]
    found = wo.run(load_scene("compare_over", late))
    assert found.attributes["rivals"] == ["tracker (14)", "LQR, feed-forward"]
    assert value(found, "draws_failed")[0] == [6, 0]
    assert value(found, "draws_outside")[0][0] == 6
    assert np.isnan(found["error_norm"].values[0, 0]).all()
    assert np.isfinite(found["error_norm"].values[0, 1]).all()
    assert any("counts as lost" in warning for warning in found.trust["warnings"])
    np.testing.assert_allclose(
        found["outside_share"].values[0, 0], [0.025 ** (1 / 6), 1.0], rtol=1e-9
    )
    assert found["less_error_integral"].values[0].tolist() == [[0, 0], [6, 0]]
