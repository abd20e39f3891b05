"""Scenes of predictive control: as good as the open loop, in time, better on unknown plants."""

from dataclasses import replace

import numpy as np
import pytest
from outcomes import refusals, value
from worms import worm

import wormopt as wo
from wormopt.control.drive import drive
from wormopt.control.loop import gait_reference, with_reference
from wormopt.control.predictive import MpcOptions, PredictiveController, run_mpc
from wormopt.model.friction import Coulomb
from wormopt.model.values import signal_values
from wormopt.ocp.contact import Complementarity
from wormopt.ocp.motion import Guess
from wormopt.ocp.nlp import Ipopt
from wormopt.ocp.optimise import optimise
from wormopt.result import Result
from wormopt.simulation.options import Smooth, Tolerance
from wormopt.simulation.simulate import simulate
from wormopt.study import load_scene
from wormopt.systems.chain.build import chain
from wormopt.systems.chain.controllers import Controller, Trial
from wormopt.systems.chain.measured import judged, judged_numbers
from wormopt.systems.chain.optimal_tracking import followed_by_lqr
from wormopt.systems.chain.predictive import PredictiveControl, inputs_of, plan_tracking
from wormopt.systems.chain.tables import Tube
from wormopt.systems.spiked.construct import fast_gait, travelling_sine

TABLE = PredictiveControl(period=0.02, horizon=0.2, input_weight=1e-4, v_reg=0.1)
END = 0.5


def test_the_worm_of_the_chapter_repeats_its_plan_step_by_step():
    """One decision, with everything from friction to corners of the reference in its horizon."""
    plant = worm(length_nominal=2.0)
    plan = plan_tracking(plant, gait_reference(fast_gait(1.0), plant.t), END, TABLE)
    assert plan.violation < 1e-10
    assert np.diff(plan.times).max() <= 0.02 * (1 + 1e-9)
    assert np.abs(plan.times - 1 / 3).min() < 1e-12  # a corner lies between arcs
    tolerance = Tolerance(1e-8, 1e-9)
    receded = run_mpc(plant, plan, TABLE.real_time, contact=Smooth(0.1), tolerance=tolerance)
    assert receded.unsolved == 0
    found = receded.inputs.polynomial[:, :, 0]
    # the simulation differs from the collocation in the third order of the arcs
    assert np.abs(found - plan.inputs).max() < 0.01 * np.abs(plan.inputs).max()


@pytest.mark.parametrize(
    ("links", "force"),
    [
        (2, 8.0),
        *(
            pytest.param(links, force, marks=pytest.mark.slow)
            for links in (1, 2, 3, 4)
            for force in (None, 8.0)
            if (links, force) != (2, 8.0)
        ),
    ],
)
def test_decisions_off_the_plan_are_the_optimum_that_an_interior_point_finds(
    links: int, force: float | None
):
    """Chains drawn by chance, moved from where their plan does not begin."""
    rng = np.random.default_rng(links)
    plant = chain(
        links,
        mass=rng.uniform(0.5, 2, links + 1),
        stiffness=rng.uniform(5, 15, links),
        damping=rng.uniform(1, 5, links),
        rest_length=2.0,
        law=Coulomb(1.0, 5.0),
        length_nominal=2.0,
    )
    weight = float(10 ** rng.uniform(-5, -2))
    table = PredictiveControl(period=0.02, horizon=0.2, input_weight=weight, v_reg=0.1, force=force)
    reference = gait_reference(travelling_sine(links, 1.0, 2.0, 0.3), plant.t)
    x = signal_values(plant.x, None, "state")
    x += 0.05 * rng.normal(size=len(x))
    control = PredictiveController(
        plan_tracking(plant, reference, 0.2, table), MpcOptions(1000, 200, 1e-9)
    )
    decided = control.decide(0, x)
    assert decided.size <= 1e-9
    parts = np.split(x, np.cumsum([s.size for s in plant.x])[:-1])
    moved = replace(plant, x=[replace(s, value=v) for s, v in zip(plant.x, parts, strict=True)])
    plan = plan_tracking(moved, reference, 0.2, table)
    program = plan.stages.program
    found = program.nlp.solve(program.pack(plan.motion.arcs, plan.bounds), plan.bounds, Ipopt())
    assert found.success
    assert plan.objective == pytest.approx(found.objective, rel=1e-6)
    assert decided.input == pytest.approx(program.unpack(found.w).inputs[:, 0, 0], abs=1e-3)


@pytest.mark.slow
def test_where_the_model_is_right_real_time_costs_no_more_than_the_open_loop():
    plant = worm(length_nominal=2.0)
    reference = gait_reference(fast_gait(1.0), plant.t)
    table = PredictiveControl(period=0.01, horizon=0.25, input_weight=1e-4, v_reg=0.05)
    plan = plan_tracking(plant, reference, 1.0, table)

    def cost(course: wo.Gait) -> float:
        model = judged(drive(with_reference(plant, reference), course), Tube(radius=0.2))
        numbers = judged_numbers(simulate(model, 1.0, contact=Smooth(0.05)), Tube(radius=0.2))
        return numbers["error_integral"] + 1e-4 * numbers["input_integral"]

    open_loop = cost(inputs_of(plan))
    assert open_loop == pytest.approx(plan.objective, rel=1e-3)
    for decisions in (table.real_time, MpcOptions(25, 20)):
        receded = run_mpc(plant, plan, decisions, contact=Smooth(0.05))
        assert cost(receded.inputs) <= open_loop * (1 + 1e-6)


@pytest.mark.slow
def test_the_plan_is_next_to_the_optimum_with_set_valued_friction():
    """Another treatment of contact, another solver, the same objective and arcs."""
    plant = worm(length_nominal=2.0)
    table = PredictiveControl(period=0.02, horizon=0.2, input_weight=1e-4, v_reg=0.03)
    plan = plan_tracking(plant, gait_reference(fast_gait(1.0), plant.t), END, table)
    program = plan.stages.program
    guess = Guess.of(followed_by_lqr(plant, gait_reference(fast_gait(1.0), plant.t), END, 1e4))
    exact = optimise(
        program.problem, program.mesh, Complementarity(1e-4), guess,
        solver=Ipopt(tolerance=1e-7, mu_init=1e-3),
    )  # fmt: skip
    assert plan.objective == pytest.approx(exact.objective, rel=0.02)


QUICK = ["time.end=0.7", "tube.capture=0.3", "time.samples=201", "plants.members=2"]


@pytest.fixture(scope="module")
def quick() -> Result:
    return wo.run(load_scene("track_predictive", QUICK))


@pytest.mark.slow
def test_predictive_control_keeps_what_it_promises(quick: Result):
    assert quick.status == "ok", quick.reason
    assert value(quick, "excess") <= 1e-6
    names = quick.attributes["controllers"]
    cost = dict(zip(names, value(quick, "cost"), strict=True))
    assert cost["predictive, real time"] <= cost["open-loop optimum"] * (1 + 1e-3)
    assert cost["predictive, real time"] < 0.8 * cost["LQR, feed-forward"]
    unsolved = dict(zip(names, value(quick, "decisions_unsolved"), strict=True))
    assert {k: v for k, v in unsolved.items() if v is not None} == {
        name: 0 for name in names if name.startswith("predictive")
    }
    spent = dict(zip(names, value(quick, "decision_processor"), strict=True))
    # of the processor, for this machine may be busy
    for name in ("predictive, real time", "predictive, real time, with estimation"):
        assert spent[name] < value(quick, "decision_period")


@pytest.mark.slow
def test_on_plants_that_nobody_knows_it_beats_the_open_loop(quick: Result):
    drawn = dict(zip(quick.attributes["controllers"], quick["drawn_cost"].values, strict=True))
    assert np.all(drawn["predictive, real time"] < drawn["open-loop optimum"])
    assert np.all(drawn["predictive, real time"] < drawn["LQR, feed-forward"])
    assert np.isnan(drawn["predictive, converged"]).all()
    errors = dict(zip(("mass", "stiffness", "damping"), value(quick, "parameter_error")))  # noqa: B905
    for before, after in errors.values():
        assert after < 0.7 * before


@pytest.mark.slow
def test_the_table_shows_all_controllers(quick: Result):
    for name in quick.attributes["controllers"]:
        assert name in quick.attributes["table"]
    assert "plant known" in quick.attributes["table"]


@pytest.mark.slow
def test_limits_of_the_force_hold_in_every_motion():
    change = ["predictive.force=15", "time.end=0.5", "tube.capture=0.2", "plants.members=1"]
    result = wo.run(load_scene("track_predictive", change))
    assert result.status == "ok", result.reason
    inputs = dict(zip(result.attributes["controllers"], result["input"].values, strict=True))
    for name, values in inputs.items():
        if not name.startswith("LQR"):
            assert np.abs(values).max() <= 15.0
    assert np.abs(inputs["open-loop optimum"]).max() == pytest.approx(15.0, rel=1e-6)


test_scenes_that_make_no_sense_are_refused = refusals(
    "track_predictive",
    """
    predictive.horizon=0.001 | predictive.horizon
    predictive.period=1e-5 | predictive.period
    predictive.period=2.5 & predictive.horizon=5 | predictive.period
    units='SI' & predictive.seconds=0.5 | predictive.seconds
    estimation.parameters=['mass','mass'] | estimation.parameters
    estimation.parameters=['length'] | estimation.parameters
    worm.damping=0 | estimation.parameters
    worm.friction.forward=[1.0, 0.0, 1.0] | estimation.parameters
    worm.friction={kind='viscous', drag=1.0} | worm.friction
    worm.random.stiffness={process='fixed',spread=1.0} | worm.random
    tube.capture=9 | tube.capture
    """,
)
test_comparisons_estimate_for_predictive_control_alone = refusals(
    "compare_tracking", "estimation={window=0.2} | estimation"
)


@pytest.mark.slow
def test_in_a_comparison_each_plant_has_inputs_of_its_own():
    change = [
        "time.end=0.3", "tube.capture=0.1", "draws.members=2", "draws.known=0",
        "predictive={period=0.02,horizon=0.1,input_weight=1e-4,v_reg=0.1}",
        "estimation={window=0.1}",
    ]  # fmt: skip
    study = wo.load("compare_tracking", change)
    gait = fast_gait(1.0)
    draws = study.drawn()
    assert study.decision_names == ("predictive", "predictive + estimation")
    trial = Trial(study.tube, study.time, study.tolerance, study.hardware, draws)
    for name in study.decision_names:
        decided = study.make_decisions((name, gait, draws))
        assert decided.nominal is not None
        assert float(decided.numbers["decision_median_s"]) > 0
        courses = [decided.nominal, *decided.others]
        inputs = [course.polynomial for course in courses if course is not None]
        assert len(inputs) == 3
        # alike until the first plant has been measured
        for other in inputs[1:]:
            assert np.array_equal(other[0], inputs[0][0])
            assert np.abs(other - inputs[0]).max() > 0.1
        controller = Controller(name, study.driven(gait, decided.nominal), decided.others)
        for k, scenario in trial.scenarios(controller):
            course = decided.others[k]
            assert course is not None
            one = simulate(controller.model, 0.3, p=scenario.p, schedules=scenario.schedules)
            same = simulate(study.driven(gait, course), 0.3, p=draws[k])
            assert one.end == pytest.approx(same.end, abs=1e-9)
