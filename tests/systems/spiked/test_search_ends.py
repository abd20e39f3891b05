"""Searches that end early, find no gait or are refused, and what a run says of them."""

import os
import signal
from itertools import count
from pathlib import Path
from threading import Timer
from time import monotonic
from typing import Any, get_args

import numpy as np
import pytest
from designs import kept
from g1_worm import G1_LIMITS, G1_WORM, OWN
from judged import check, interrupt_after
from outcomes import told_by_a_run

from wormopt.errors import ArgumentError, SolveError
from wormopt.progress import silent
from wormopt.systems.spiked.construct import load_gait
from wormopt.systems.spiked.crawl import crawl
from wormopt.systems.spiked.design import design as design_module
from wormopt.systems.spiked.design import optimize
from wormopt.systems.spiked.design.design import Design, objective_of
from wormopt.systems.spiked.design.optimize import design, designed
from wormopt.systems.spiked.gait_problem import Cost, GaitProblem, Objective, Search, Worm
from wormopt.systems.spiked.limits import Limits
from wormopt.systems.spiked.search import search as search_module
from wormopt.systems.spiked.search import trial
from wormopt.systems.spiked.search.search import Race, Survey

# -- ends before the end -------------------------------------------------------------------------


def test_a_search_ends_where_no_gait_can_be_better_by_more_than_is_wanted():
    limits = G1_LIMITS.vary(period=(0.1, 20.0))
    best = 0.869449  # by an independent search
    found = {gap: design(G1_WORM, limits, search=Search(gap=gap, effort="quick"))
             for gap in (1e-2, 1e-3)}  # fmt: skip
    coarse, fine = found.values()
    assert (coarse.ended, fine.ended) == ("proven", "searched")
    assert len(coarse.survey.tried) < len(fine.survey.tried)
    for design_ in (coarse, fine):
        assert best <= design_.bound < 1.01 * best
        check(design_)
    assert coarse.speed >= coarse.bound / 1.01
    assert fine.speed == pytest.approx(best, rel=1e-6)


def test_one_link_is_proven_the_best_at_once():
    """Its mean rate bounds its speed, and it reaches it: 4/9 for these limits."""
    found = design(Worm(links=1, load=5.0), G1_LIMITS.vary(period=(0.1, 20.0)))
    assert found.ended == "proven"
    assert found.speed == pytest.approx(4 / 9, rel=1e-9)
    assert found.bound == pytest.approx(4 / 9, rel=1e-6)
    assert found.bounded is found.survey.bounded  # computed once


LONG = (Worm(links=4, load=5.0), G1_LIMITS.vary(period=2.0))


def check_cut_short(found: Design, why: str) -> None:
    assert found.ended == why
    assert found.speed > 0.5
    check(found)


@pytest.mark.parametrize("checks", [1, 40, pytest.param(120, marks=pytest.mark.slow)])
def test_a_search_ends_when_its_time_is_over(monkeypatch: pytest.MonkeyPatch, checks: int):
    """By a clock that jumps when it was asked so often, in the middle of whatever is going on."""
    asked = count()
    for module in (search_module, trial):
        monkeypatch.setattr(module, "monotonic", lambda: 0.0 if next(asked) < checks else 1e9)
    found = design(*LONG, search=Search(time_limit=5.0, workers=1))
    check_cut_short(found, "time limit")
    assert len(found.survey.tried) < 100


def test_a_time_limit_is_kept_by_a_real_clock():
    begin = monotonic()
    found = design(*LONG, search=Search(effort="thorough", time_limit=0.5, workers=1))
    check_cut_short(found, "time limit")
    assert monotonic() - begin < 10.0  # the machine may be busy; without it takes minutes


@pytest.mark.parametrize("climbs", [5, 9, pytest.param(30, marks=pytest.mark.slow)])
def test_an_interrupted_design_is_the_best_so_far(monkeypatch, climbs: int):
    interrupt_after(monkeypatch, climbs)
    found = design(*LONG, search=Search(effort="quick", workers=1))
    check_cut_short(found, "interrupted")


def test_a_design_is_interrupted_while_processes_work(monkeypatch):
    """By the signal that Ctrl-C sends, a moment after the tenth gait was found."""
    keep, kept = Race.keep, count(1)

    def keep_and_stop(*args):
        keep(*args)
        if next(kept) == 10:
            Timer(0.3, os.kill, (os.getpid(), signal.SIGINT)).start()

    monkeypatch.setattr(Race, "keep", keep_and_stop)
    found = design(*LONG, search=Search(effort="thorough", workers=2))
    check_cut_short(found, "interrupted")
    assert len(found.survey.tried) < 300


def test_an_interrupted_sharpening_leaves_what_was_searched(monkeypatch):
    whole = kept(G1_WORM, G1_LIMITS, search=OWN)
    # two climbs of the first look, two of finer looks, the fifth is the first that sharpens
    interrupt_after(monkeypatch, 5)
    found = design(G1_WORM, G1_LIMITS, search=OWN)
    check_cut_short(found, "interrupted")
    assert found.speed >= whole.speed * (1 - 1e-2)


def test_an_interrupted_check_of_limits_leaves_what_was_searched(monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(design_module, "_keeps", interrupted)
    check_cut_short(design(G1_WORM, G1_LIMITS, search=OWN), "interrupted")


def test_a_design_stopped_before_any_gait_is_no_design(monkeypatch):
    interrupt_after(monkeypatch, 1)
    with pytest.raises(KeyboardInterrupt):
        design(G1_WORM, G1_LIMITS, search=OWN)


# -- no gait -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        # 7 of the 15 that two spikes at rest share: 1/2 is missing on either, and a little to move
        pytest.param({"spike_load": 7.0}, "spike_load larger by 0.501;", marks=pytest.mark.slow),
        ({"sigma_margin": 6.0}, "limits.sigma_margin smaller by 1.01;"),
    ],
)
def test_limits_in_conflict_are_named_and_what_is_said_is_enough(changed, said: str):
    limits, quick = G1_LIMITS.vary(**changed), Search(effort="quick", phases=3)
    with pytest.raises(SolveError, match=said):
        design(G1_WORM, limits, search=quick)
    ((name, value),), (_, way, _, by) = changed.items(), said.removesuffix(";").split()
    enough = value + float(by) * (1 if way == "larger" else -1)
    assert design(G1_WORM, limits.vary(**{name: enough}), search=quick).speed > 0


@pytest.mark.slow
def test_a_speed_that_no_gait_reaches_is_named():
    """0.9 is below the ceiling 1, and above G1."""
    with pytest.raises(SolveError, match=r"objective\.speed smaller by"):
        design(G1_WORM, G1_LIMITS, "peak_spike_load", 0.9, search=OWN)


@pytest.mark.parametrize("share", [0.99, 0.9999])
def test_a_cost_at_nearly_the_fastest_speed_begins_with_the_fastest_motion(share: float):
    """With drag velocities bend, and a climb from its durations alone ends below this speed."""
    worm = Worm(links=2, mass=(0.939, 1.0, 1.66), drag=83.5, load=85.3)
    limits = Limits(period=0.265, length=(0.73, 1.03), rate=1.45, acceleration=72.9)
    fast = design(worm, limits, search=Search(effort="quick", sequence=((0,), (1,), (2,))))
    task = GaitProblem(worm, limits, Objective("peak_spike_load", share * fast.speed))
    assert fast.trial is not None
    found = trial.Trier(task).with_the_motion(fast.trial)
    assert found is not None
    motion = crawl(found.gait, worm.masses, worm.drag, worm.load)
    assert motion.speed >= share * fast.speed * (1 - 1e-8)
    costs = [objective_of(each, "peak_spike_load") for each in (motion, fast.motion)]
    assert costs[0] <= costs[1]


@pytest.mark.parametrize(
    ("ended", "error"), [("interrupted", KeyboardInterrupt), ("time limit", SolveError)]
)
def test_a_search_from_the_fastest_gaits_that_ends_early_says_so(ended, error, monkeypatch):
    def nothing(task: GaitProblem, *_: Any) -> Survey:
        how = "searched" if task.objective.minimise else ended
        return Survey(task, (), frozenset(), 0, 0, how)

    monkeypatch.setattr(optimize, "search", nothing)
    task = GaitProblem(G1_WORM, G1_LIMITS, Objective("peak_spike_load", 0.8))
    with pytest.raises(error, match="time_limit" if error is SolveError else None):
        designed(task, Search(), silent)


# -- scenes --------------------------------------------------------------------------------------

FAST = "design_fast_gait"


def test_a_run_says_how_many_cycles_fill_the_period(tmp_path: Path, capsys):
    own = "search.sequence=[[0],[2],[1]]"
    code, told = told_by_a_run(capsys, FAST, tmp_path, "gait.period=4.0", own)
    scalars = {name: entry["value"] for name, entry in told["scalars"].items()}
    assert (code, told["status"]) == (0, "ok")
    assert scalars["cycles"] == 3
    assert scalars["period"] == pytest.approx(4 / 3)
    assert scalars["advance"] == pytest.approx(4 / 3 * scalars["speed"])
    assert told["trust"]["solver"]["cycles"] == 3
    assert sum(told["trust"]["solver"]["durations"]) == pytest.approx(4 / 3)
    pieces = load_gait(tmp_path).pieces
    assert sum(told["trust"]["solver"]["arcs_per_phase"]) == pieces


def test_a_run_with_a_time_limit_says_that_it_was_cut_short(tmp_path: Path, capsys):
    changes = ("worm.links=4", "search.time_limit=1e-6", "search.workers=1")
    code, told = told_by_a_run(capsys, FAST, tmp_path, *changes)
    assert (code, told["status"]) == (0, "ok")
    assert told["trust"]["search"]["ended"] == "time limit"
    assert "time limit" in " ".join(told["trust"]["warnings"])
    assert told["scalars"]["worst_violation"]["value"] <= 1e-9
    assert (tmp_path / "summary.json").is_file()


def test_a_gait_of_several_cycles_is_not_above_its_bound():
    import wormopt as wo

    changes = ["gait.period=4.0", "search.sequence=[[0],[1],[2]]", "search.certify.time_limit=0.2"]
    result = wo.run(wo.load_scene("certified_gait", changes))
    assert result.status == "ok", result.reason
    assert result.scalars["bound"].value >= result.scalars["speed"].value * (1 - 1e-12)


# -- tasks ---------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_design_does_not_depend_on_the_number_of_threads():
    task = GaitProblem(G1_WORM.vary(mass=(1.0, 2.0, 1.5)), G1_LIMITS)
    one, two = (designed(task, Search(effort="quick", workers=k), lambda *_: None)
                for k in (1, 2))  # fmt: skip
    assert one.sequence == two.sequence
    assert one.speed == pytest.approx(two.speed, rel=1e-12)


def test_numbers_of_numpy_are_numbers():
    links: Any = np.int64(2)
    mass: Any = np.ones(3, int)
    given: dict[str, Any] = {"length": np.array([1, 2]), "acceleration": np.float32(20)}
    task = GaitProblem(Worm(links, mass, load=5.0), Limits(period=1.0, rate=1, **given))
    assert (task.worm.masses, task.limits.length_ranges(2)) == ((1, 1, 1), ((1, 2), (1, 2)))


def test_numbers_without_a_list_are_kept_as_numbers():
    zero_d: Any = np.array(2.0)
    worm = Worm(2, mass=zero_d, drag=zero_d, load=zero_d)
    task = GaitProblem(worm, G1_LIMITS.vary(rate=zero_d), Objective("peak_spike_load", zero_d))
    assert worm == Worm(2, 2.0, 2.0, 2.0)
    assert hash(task) == hash(task.vary())


X = "{x} {0}"

JUMPS = {"acceleration": None, "impulses": True}


@pytest.mark.parametrize(
    ("part", "given", "said"),
    [
        ("worm", {"mass": [1, 1]}, "Worm: mass: 2 entries for 3 masses; write one number for all"),
        ("limits", {"resting": 3}, "GaitProblem: limits.resting: 3 resting masses leave a worm of"),
        ("limits", {"rate": [1.0, X]}, 'Limits: rate[1]: "{x} {0}" is not allowed; write a table'),
        ("limits", {"acceleration": None}, "GaitProblem: limits.acceleration: missing, so"),
        ("limits", JUMPS | {"spike_load": 20.0}, "GaitProblem: limits.impulses: true, but an"),
        ("search", {"sequence": [0, 1]}, "Search: sequence[0]: 0 is not allowed; write a list of"),
        ("search", {"sequence": []}, "search.sequence: fewer than two phases; write at least two"),
    ],
)  # fmt: skip
def test_what_cannot_be_used_is_refused_with_what_to_write(part: str, given: Any, said: str):
    right: dict[str, Any] = {"worm": G1_WORM, "limits": G1_LIMITS, "search": OWN}
    with pytest.raises(ArgumentError) as refused:
        design(**right | {part: right[part].vary(**given)})
    assert str(refused.value).startswith(said)


@pytest.mark.parametrize("cost", get_args(Cost))
def test_costs_that_impulses_make_infinite_are_refused(cost: Cost):
    limits = G1_LIMITS.vary(acceleration=None, impulses=True)
    with pytest.raises(
        ArgumentError, match=r"objective\.minimise: .* no finite value with limits\."
    ):
        design(G1_WORM, limits, cost, 0.5)


def test_an_objective_may_be_given_as_one():
    found = kept(G1_WORM, G1_LIMITS, Objective("peak_spike_load", 0.75), search=OWN)
    assert found.task.objective == Objective("peak_spike_load", 0.75)
    assert found.value == pytest.approx(585 / 23, abs=1e-9)
    assert Objective.of(Objective()) == Objective.of("speed")
    with pytest.raises(ArgumentError, match="remove one of them"):
        design(G1_WORM, G1_LIMITS, Objective("peak_spike_load", 0.75), 0.5)
    with pytest.raises(ArgumentError, match="speed is given, but the mean speed is maximised"):
        design(G1_WORM, G1_LIMITS, speed=0.5)
    with pytest.raises(ArgumentError, match="objective must be one of 'speed', 'peak_spike_load',"):
        Objective.of("spede")  # type: ignore[arg-type]
