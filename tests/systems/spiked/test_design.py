"""Designed gaits: benchmarks, the bounds they may not pass, and what happens when none exists."""

from dataclasses import replace
from itertools import combinations
from math import comb, gcd
from pathlib import Path

import numpy as np
import pytest
from g1_worm import G1, G1_LIMITS, G1_WORM
from judged import interrupt_after
from outcomes import failed_checks, told_by_a_run, value

import wormopt as wo
from wormopt.errors import Interrupted, SolveError
from wormopt.families.store import Store
from wormopt.systems.shared.sequences import sequences
from wormopt.systems.spiked.bimodal import integrate
from wormopt.systems.spiked.construct import gait_of_result
from wormopt.systems.spiked.crawl import crawl
from wormopt.systems.spiked.design.design import objective_of
from wormopt.systems.spiked.design.optimize import design, designed
from wormopt.systems.spiked.gait_problem import GaitProblem, Objective, Search, Worm
from wormopt.systems.spiked.search.orders import ceiling
from wormopt.systems.spiked.search.trial import Trier
from wormopt.systems.spiked.verify import violations


def run(*overrides: str):
    return wo.run(wo.load_scene("design_fast_gait", overrides))


@pytest.fixture(scope="module")
def fast_gait():
    return run()


def test_g1_is_exact_and_proven(fast_gait):
    assert fast_gait.status == "ok"
    assert value(fast_gait, "speed") == pytest.approx(G1, abs=1e-9)
    assert value(fast_gait, "worst_violation") <= 1e-9
    assert value(fast_gait, "recheck_speed_error") <= 1e-9
    assert value(fast_gait, "ceiling") == pytest.approx(1.0, abs=1e-9)
    assert value(fast_gait, "resting_min") == 1


def test_g1_gait_crawls_alike_by_a_second_route(fast_gait):
    again = integrate(gait_of_result(fast_gait), [1.0] * 3, 0.0, 5.0)
    assert again.speed == pytest.approx(G1, abs=1e-9)
    assert again.lambda_min >= -1e-9
    assert again.lambda_max == pytest.approx(value(fast_gait, "lambda_max"), abs=1e-9)
    assert again.resting_min == 1


def test_without_drag_net_work_per_distance_is_the_load_for_every_gait(fast_gait):
    """Spikes do no work: what is recovered or not ranks gaits, the net work does not."""
    motion = crawl(gait_of_result(fast_gait), [1.0] * 3, 0.0, 5.0)
    assert motion.net_work / motion.advance == pytest.approx(15.0, abs=1e-9)
    assert motion.energy >= motion.net_work


def test_spike_limit_binds():
    result = run("gait.spike_load=27.0", 'search.effort="quick"', "search.sequence=[[0],[2],[1]]")
    assert value(result, "speed") == pytest.approx(0.7666666666666667, abs=1e-7)
    assert value(result, "spike_load_max") == pytest.approx(27.0, abs=1e-7)
    assert value(result, "lambda_max") == pytest.approx(9.0, abs=1e-7)
    assert result.status == "ok"


def test_a_tight_spike_limit_is_met_by_letting_more_masses_share():
    """12 is below the 15 that one spike must bear at rest; two bear it, as with resting = 2."""
    result = run(
        "gait.spike_load=12.0", 'search.effort="quick"', "search.phases=4", "search.workers=1"
    )
    assert result.status == "ok"
    assert value(result, "speed") > 0.2
    assert value(result, "spike_load_max") <= 12.0 * (1 + 1e-9)
    assert value(result, "resting_min") >= 1


def test_the_order_of_rest_decides():
    """Head then tail alone reaches only about 0.805: local search cannot leave it."""
    result = run("search.sequence=[[0],[2]]", 'search.effort="quick"')
    assert 0.80 < value(result, "speed") < 0.806


@pytest.mark.slow
def test_drag_bends_the_arcs_and_they_are_resolved():
    result = run("worm.drag=0.5")
    assert value(result, "discretisation_error") < 1e-6
    assert value(result, "lambda_mean") == pytest.approx(0.5 * value(result, "speed") + 5, abs=1e-9)
    assert result.status == "ok"


@pytest.mark.slow
def test_halving_every_arc_confirms_the_discretisation_error():
    """What is left by the last halving, against halving once more with a higher degree."""
    own = Search(sequence=((0,), (1,), (2,)))
    found = design(G1_WORM.vary(drag=0.5), G1_LIMITS, search=own)
    trial = found.trial
    assert trial is not None
    finer = Trier(found.task).finer(trial, 1e-9, trial.program.degree + 1)
    assert finer.value == pytest.approx(trial.value, rel=1e-7)
    assert abs(found.error) < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("cost", ["energy_per_distance", "acceleration_effort"])
def test_a_smooth_cost_is_below_that_of_the_fastest_gait(cost, fast_gait):
    result = run(f'objective={{minimise="{cost}",speed=0.7}}', "search.sequence=[[0],[2],[1]]")
    fastest = crawl(gait_of_result(fast_gait), [1.0] * 3, 0.0, 5.0)
    assert result.status == "ok", result.reason
    assert value(result, "objective") < objective_of(fastest, cost)


# -- the search over sequences ---------------------------------------------------------------


def proper_necklaces(letters: int, beads: int) -> int:
    """Cyclic words without equal neighbours: Burnside over the chromatic polynomial of a ring."""

    def rings(k: int) -> int:
        return (letters - 1) ** k + (-1) ** k * (letters - 1) if k > 1 else 0

    turns = [rings(gcd(beads, k)) for k in range(beads)]
    return sum(turns) // beads


@pytest.mark.parametrize(("masses", "phases"), [(2, 2), (3, 2), (3, 3), (4, 3), (4, 4), (5, 4)])
def test_single_rest_sequences_are_all_there_once(masses, phases):
    found = sequences(masses, [(i,) for i in range(masses)], phases, mirror=False)
    assert len(found) == len(set(found)) == proper_necklaces(masses, phases)


def test_mirror_images_and_masses_that_rest_for_ever_are_left_out():
    pairs = list(combinations(range(4), 2))
    whole = sequences(4, pairs, 3, mirror=False)
    half = sequences(4, pairs, 3, mirror=True)
    assert len(whole) / 2 <= len(half) < len(whole)
    assert all(not set.intersection(*map(set, word)) for word in whole)
    assert comb(4, 2) == len({s for word in whole for s in word})


def test_a_sequence_is_never_faster_than_its_own_ceiling(fast_gait):
    for candidate in fast_gait.trust["search"]["best"]:
        bound = ceiling([1.0, 1.0], [1.0, 1.0], 1, candidate["sequence"])
        assert candidate["objective"] <= bound + 1e-9


# -- no gait, interruptions ------------------------------------------------------------------


@pytest.mark.parametrize(
    ("overrides", "named"),
    [
        (['objective={minimise="peak_spike_load",speed=1.5}'], ["objective.speed", "ceiling"]),
        (["gait.spike_load=7.0"], ["gait.spike_load larger by 0.501;"]),
        (["gait.actuator_force=2.0", "search.sequence=[[0],[1],[2]]"], ["gait.actuator_force"]),
    ],
)
def test_an_impossible_request_names_the_limits(overrides, named, tmp_path: Path, capsys):
    quick = ('search.effort="quick"', "search.phases=3")
    code, answer = told_by_a_run(capsys, "design_fast_gait", tmp_path, *overrides, *quick)
    assert (code, answer["status"]) == (3, "failed")
    assert all(name in answer["reason"] for name in named)
    assert (tmp_path / "summary.json").is_file()


def test_an_interrupted_search_leaves_the_best_gait_so_far(monkeypatch):
    interrupt_after(monkeypatch, 6)
    with pytest.raises(Interrupted) as stopped:
        run()
    partial = stopped.value.partial
    assert partial.status == "failed"
    assert "interrupted" in partial.reason
    assert 0.3 < value(partial, "speed") < 1.0


def spoil(monkeypatch, study, share: float) -> None:
    """What is designed runs through its gait in a share of its time: limits are exceeded."""
    original = study.designed

    def hurried(*args):
        found = original(*args)
        return replace(found, gait=found.gait.with_period(share * found.gait.period))

    monkeypatch.setattr(study, "designed", hurried)


def test_limits_that_are_exceeded_are_faults(monkeypatch):
    from wormopt.systems.spiked import gait_design

    spoil(monkeypatch, gait_design, 0.8)
    motor = "motor={lead=0.5, rate_max=2.0, acceleration_max=45.0}"
    result = run('search.effort="quick"', "search.sequence=[[0],[1],[2]]", motor)
    assert result.status == "failed"
    exceeded = {"gait.period", "gait.rate", "gait.acceleration", "gait.resting", "sigma"}
    assert set(failed_checks(result)) == {*exceeded, "speed over its ceiling", "motor.rate_max"}
    checks = {check.name: check for check in result.checks}
    assert checks["gait.rate"].value == result.trust["violations"]["gait.rate"]
    assert checks["gait.rate"].value == pytest.approx(0.25, rel=1e-6)
    assert checks["gait.length"].passed
    for name in failed_checks(result):
        assert checks[name].advice in result.reason
    assert "gait.rate is exceeded by 0.25 of its value" in result.reason
    assert "sensitivity" in result.trust


def test_a_second_route_that_finds_something_else_is_a_fault(monkeypatch):
    from wormopt.systems.spiked import gait
    from wormopt.systems.spiked.motion import cross_check as original

    def elsewhere(motion):
        again = original(motion)
        return replace(again, speed=1.01 * again.speed, lambda_max=2 * again.lambda_max)

    monkeypatch.setattr(gait, "cross_check", elsewhere)
    result = wo.run("fast_gait")
    assert result.status == "failed"
    assert set(failed_checks(result)) == {"speed, second route", "largest load, second route"}
    told = (
        "the second route finds a different speed; the second route finds a different largest load"
    )
    assert result.reason == told


# A short front of one link.
FRONT = [
    "worm.links=1", "pareto.points=3", 'search.effort="quick"', "search.sequence=[[0],[1]]"
]  # fmt: skip


@pytest.mark.slow
def test_a_front_without_an_accepted_gait_fails(monkeypatch, tmp_path: Path):
    from wormopt.systems.spiked import gait_pareto

    monkeypatch.setattr(gait_pareto, "checkpoints", lambda: Store(tmp_path))
    spoil(monkeypatch, gait_pareto, 0.8)
    result = wo.run(wo.load_scene("pareto_speed_load", FRONT))
    assert (result.status, result.reason) == ("failed", "no point of the front was accepted")
    assert {"gait.rate", "points that are not accepted"} <= set(failed_checks(result))
    assert value(result, "front_points") == 0


@pytest.mark.slow
def test_the_front_is_monotone_and_resumes(monkeypatch, tmp_path: Path):
    from wormopt.systems.spiked import gait_pareto

    monkeypatch.setattr(gait_pareto, "checkpoints", lambda: Store(tmp_path))
    scene = wo.load_scene("pareto_speed_load", FRONT)
    original, seen = gait_pareto.designed, []

    def stop_at_the_third(*args):
        seen.append(args)
        if len(seen) == 3:
            raise KeyboardInterrupt
        return original(*args)

    monkeypatch.setattr(gait_pareto, "designed", stop_at_the_third)
    with pytest.raises(Interrupted) as stopped:
        wo.run(scene)
    assert len(stopped.value.partial["front_speed"].values) == 2
    result = wo.run(scene)
    assert len(seen) == 4  # two points were read back
    order = np.argsort(result["front_speed"].values)
    assert np.all(np.diff(result["front_value"].values[order]) > -1e-9)
    assert result["front_value"].values.min() >= 10.0 - 1e-9  # mean lambda = Gamma, one spike
    assert not list(tmp_path.glob("*.nc"))


@pytest.mark.parametrize("fails_at", [1, 2])
def test_a_front_says_in_words_of_the_scene_why_there_is_no_gait(
    fails_at: int, monkeypatch, tmp_path: Path, capsys
):
    from wormopt.systems.spiked import gait_pareto

    monkeypatch.setattr(gait_pareto, "checkpoints", lambda: Store(tmp_path / "kept"))
    original, calls = gait_pareto.designed, []

    def refusing(*args):
        calls.append(args)
        if len(calls) == fails_at:
            key = args[0].key_of("limits.rate")
            raise SolveError(f"{key} is too small for the limits.", f"raise {key}")
        return original(*args)

    monkeypatch.setattr(gait_pareto, "designed", refusing)
    motor = "motor={lead=0.5, rate_max=2.0, acceleration_max=40.0}"
    folder = tmp_path / "o"
    code, told = told_by_a_run(capsys, "pareto_speed_load", folder, *FRONT, motor)
    said = told["reason"] if fails_at == 1 else " ".join(told["trust"]["warnings"])
    assert code == (3 if fails_at == 1 else 0)
    assert "gait.rate is too small for the limits.; raise gait.rate; gait.rate is here the " in said
    assert (folder / "summary.json").is_file()


@pytest.mark.slow
def test_impulses_reach_what_accelerations_cannot():
    """Rates may jump without an acceleration limit; momentum still falls no faster than by load."""
    limits = G1_LIMITS.vary(acceleration=None, impulses=True)
    own = Search(sequence=((0,), (2,), (1,)), workers=1)
    found = design(G1_WORM, limits, search=own)
    motion = crawl(found.gait, G1_WORM.masses, 0.0, 5.0)
    assert G1 < motion.speed <= 1.0 + 1e-9
    assert not motion.glides
    assert max(violations(motion, limits).values()) <= 1e-9
    assert integrate(found.gait, G1_WORM.masses, 0.0, 5.0).speed == pytest.approx(motion.speed)


def test_limits_survive_being_sent_to_another_process():
    import pickle

    task = GaitProblem(G1_WORM, G1_LIMITS)
    assert pickle.loads(pickle.dumps(task)) == task


def test_a_required_speed_above_the_ceiling_is_refused_before_any_search():
    task = GaitProblem(G1_WORM, G1_LIMITS, Objective("energy_per_distance", 1.1))
    with pytest.raises(SolveError, match=r"objective\.speed = 1\.1 is above the ceiling 1"):
        designed(task, Search(), lambda *_: pytest.fail("it searched"))


def test_a_required_speed_above_the_proven_bound_is_refused_after_the_first_orders():
    task = GaitProblem(Worm(3, load=5.0), G1_LIMITS, Objective("peak_spike_load", 1.4))
    stages = list[str]()
    with pytest.raises(
        SolveError, match=r"objective\.speed = 1\.4 is above 1\.35, the proven bound"
    ):
        designed(task, Search(workers=1), lambda stage, _: stages.append(stage))
    assert set(stages) == {"constructed orders"}


@pytest.mark.slow
def test_a_front_whose_first_gait_loses_a_phase_is_designed(tmp_path: Path, monkeypatch):
    from wormopt.systems.spiked import gait_pareto

    monkeypatch.setattr(gait_pareto, "checkpoints", lambda: Store(tmp_path))
    changes = ["pareto.points=3", 'search.effort="quick"']
    result = wo.run(wo.load_scene("pareto_speed_load", changes))
    assert result.status == "ok"
    assert np.all(np.diff(result["front_value"].values) >= -1e-9)  # more speed costs more load
