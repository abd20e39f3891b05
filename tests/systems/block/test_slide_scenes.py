"""Scenes of the kinds "slide", "two-mass" and "capsule": exact answers, trust, failures."""

import dataclasses
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hints import Capture, Patch
from outcomes import failed_checks, refusals, value
from scipy.integrate import quad
from scipy.optimize import brentq

import wormopt as wo
from wormopt.cli import main
from wormopt.errors import SolveError
from wormopt.ocp.motion import Guess
from wormopt.result import Result
from wormopt.study import load_scene
from wormopt.systems.block import slide
from wormopt.systems.block.slide import Slide
from wormopt.systems.shared import optimum

SMOOTH = 'contact={treatment="smooth", v_reg=0.025}'


def solved(name: str, *changes: str) -> Result:
    return wo.run(load_scene(name, changes))


# -- exact answers -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "exact", "modes"),
    [
        # accelerate with 3 - 1, brake with 3 + 1
        ("slide", math.sqrt(2 * (1 / 2 + 1 / 4)), [[1], [1]]),
        # brake with 3 + 1 over 1/8, go back with 3 - 2, brake with 3 + 2
        ("slide_back", 1 / 4 + math.sqrt(2 / 8 * (1 + 1 / 5)), [[1], [-1], [-1]]),
    ],
)
def test_slides_are_exact_and_their_phases_found(name: str, exact: float, modes: list[list[int]]):
    result = solved(name)
    assert result.status == "ok"
    assert value(result, "time") == pytest.approx(exact, abs=1e-9)
    assert value(result, "objective") == pytest.approx(value(result, "time"), rel=1e-14)
    assert value(result, "mode_sequence") == modes
    assert value(result, "n_phases") == len(modes)
    assert value(result, "input_peak") == pytest.approx(3.0)
    assert value(result, "input_rms") == pytest.approx(3.0)
    assert value(result, "defect_max") < 1e-12
    assert value(result, "complementarity_max") < 1e-12
    assert value(result, "recheck_error") < 1e-12
    trust = result.trust
    assert trust["first_order_gain"] < 1e-12
    assert set(trust["solves"]) == {"relaxed", "phases"}
    for stage in trust["solves"].values():
        assert {"build_s", "solve_s", "iterations", "functions_s"} <= set(stage)
    assert trust["warnings"] == []


@pytest.mark.slow
def test_the_smooth_slide_is_that_of_the_smooth_law():
    result = solved("slide", SMOOTH)
    assert value(result, "time") == pytest.approx(1.2221708186, abs=1e-9)
    assert value(result, "defect_max") <= 1e-9
    assert value(result, "recheck_error") < 1e-9
    assert result.trust["treatment"] == "smooth, v_reg = 0.025"
    assert any("adds energy" in warning for warning in result.trust["warnings"])


@pytest.mark.slow
@pytest.mark.parametrize(("longest", "duration"), [(2.0, 2.0), (3.0, math.sqrt(6))])
def test_the_least_effort_has_a_straight_drive(longest: float, duration: float):
    # from rest to rest while it slides: u = 1 + 6/T^2 (1 - 2 t/T), effort T + 12/T^3, which is
    # least at T = sqrt(6): who has more time rests
    result = solved("slide", 'minimise="effort"', f"time={longest}")
    assert value(result, "objective") == pytest.approx(duration + 12 / duration**3, abs=1e-7)
    assert duration - 1e-6 <= value(result, "time") <= longest + 1e-12
    if longest > duration:
        return  # when it rests is all the same
    drive, t = result["force"].values, result["instant"].values
    straight = 1 + 6 / duration**2 * (1 - 2 * t / duration)
    assert drive == pytest.approx(straight, abs=1e-3)


def test_nothing_is_said_of_equations_that_fix_variables(capfd: Capture):
    # it brakes with 3 + 1 from 1 to 0: T = 1/4, way 1/8; all phases but one are left out
    result = solved("slide_back", "end.position=0.125")
    assert result.status == "ok"
    assert value(result, "time") == pytest.approx(0.25, abs=1e-9)
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("size", [1e-3, pytest.param(1e3, marks=pytest.mark.slow)])
def test_the_least_effort_is_as_exact_in_other_units(size: float):
    forces = {"block.mass": 1, "block.force": 3, "block.friction.forward": 1}
    forces |= {"block.friction.backward": 2}
    changes = [f"{key}={number * size}" for key, number in forces.items()]
    result = solved("slide", 'minimise="effort"', "time=2", *changes)
    assert value(result, "objective") / size**2 == pytest.approx(3.5, abs=1e-7)
    assert value(result, "solve_iterations") < 200


def test_the_pair_reaches_its_closed_form():
    result, k = solved("chernousko_pair"), 0.3 * 9.81 * 0.1
    assert value(result, "speed") == pytest.approx((math.sqrt(2) - 1) / 2 * math.sqrt(k), abs=1e-9)
    # the speed hardly changes there: rounding of 1e-13 of it decides the ratio to its root
    assert value(result, "mass_ratio") == pytest.approx(math.sqrt(2) - 1, abs=1e-6)
    assert value(result, "recheck_error") < 1e-12
    assert value(result, "mode_sequence") == [[0, 1], [0, 1]]
    assert result.scalars["speed"].unit == "m s-1"


@pytest.mark.parametrize("ratio", [0.1, 0.4, 0.8, 0.995, 0.999])
def test_a_pair_of_a_given_ratio_has_the_speed_of_theory(ratio: float):
    result = solved("chernousko_pair", f"pair.ratio={ratio}")
    speed = math.sqrt(0.3 * 9.81 * 0.1 * ratio * (1 - ratio) / (1 + ratio)) / 2
    assert value(result, "speed") == pytest.approx(speed, abs=1e-9)


@pytest.mark.parametrize(("share", "friction", "stroke"), [(0.3, 2.0, 0.5), (0.6, 0.7, 2.0)])
def test_the_capsule_reaches_its_closed_form(share: float, friction: float, stroke: float):
    numbers = {"share": share, "friction": friction, "stroke": stroke}
    result = solved("capsule", *(f"capsule.{key}={number}" for key, number in numbers.items()))
    speed = math.sqrt(share * friction * stroke) / 2
    inner = math.sqrt(friction * stroke / share)
    assert value(result, "speed") == pytest.approx(speed, abs=1e-9)
    assert value(result, "inner_speeds") == pytest.approx([inner, -inner], abs=1e-6)
    assert value(result, "input_rms") is None  # impulses have none
    assert value(result, "recheck_error") < 1e-12


# -- results -------------------------------------------------------------------------------------


def test_a_run_saves_signals_pictures_and_statistics(tmp_path: Path):
    folder = tmp_path / "out"
    assert main(["run", "slide_back", "-o", str(folder), "--quiet"]) == 0
    result = Result.load(folder)
    t, v = result["instant"].values, result["velocity"].values
    assert np.all(np.diff(t) >= 0)
    assert (t[0], v[0]) == (0.0, 1.0)
    assert t[-1] == pytest.approx(value(result, "time"))
    assert (v[t < 0.25] > 0).all()
    assert set(result["contact_force"].values.round(9)) == {-1.0, 2.0}
    assert (folder / "signals.png").stat().st_size > 10_000
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["trust"]["solves"]["phases"]["functions_s"]["nlp_jac_g"] > 0


def test_a_simulation_that_ends_elsewhere_makes_the_result_fail(tmp_path: Path, monkeypatch: Patch):
    def elsewhere(*given: Any, **options: Any) -> Any:
        motion = simulate(*given, **options)
        return dataclasses.replace(motion, end=motion.end + 1e-5)

    simulate = optimum.simulate
    monkeypatch.setattr(optimum, "simulate", elsewhere)
    assert main(["run", "slide", "-o", str(tmp_path / "out"), "--quiet", "--no-plots"]) == 3
    result = Result.load(tmp_path / "out")
    assert result.status == "failed"
    assert "ends in other states, by 1.2e-05" in result.reason
    assert failed_checks(result) == ["simulation of the inputs found"]


def test_a_defect_that_was_not_reached_is_told(monkeypatch: Patch):
    monkeypatch.setattr(slide, "_ROUNDS", 1)
    result = solved("slide", SMOOTH)
    (told,) = [w for w in result.trust["warnings"] if "still" in w]
    assert "the requested 1e-09" in told


# -- failures ------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "changes", "least"),
    [
        ("slide", ("time=1.0", 'minimise="effort"'), "time by about 0.2"),
        ("slide", ("time=1.0", SMOOTH), "time by about 0.2"),
        ("slide_back", ("time=0.7",), "force (block.force) by about 0.3"),
    ],
)
def test_slides_that_cannot_be_end_with_what_has_to_give_way(
    tmp_path: Path, capsys: Capture, name: str, changes: tuple[str, ...], least: str
):
    with pytest.raises(SolveError) as caught:
        solved(name, *changes)
    assert caught.value.code == "infeasible"
    assert f"allows one is {least}" in str(caught.value)
    settings = [text for change in changes for text in ("--set", change)]
    assert main(["run", name, *settings, "-o", str(tmp_path / "out"), "--quiet"]) == 3
    assert least in capsys.readouterr().err
    kept = Result.load(tmp_path / "out")
    assert kept.status == "failed"
    assert "velocity" in kept


def test_a_bad_guess_ends_in_the_right_exit_code(
    tmp_path: Path, capsys: Capture, monkeypatch: Patch
):
    def lost(_: Any) -> Guess:
        return Guess(1.0, lambda t: np.vstack([t * math.nan, t]))

    monkeypatch.setattr(Slide, "guess", property(lost))
    assert main(["run", "slide", "-o", str(tmp_path / "out"), "--quiet"]) == 3
    assert "no finite value at the first guess" in capsys.readouterr().err


def test_an_unbounded_problem_ends_in_the_right_exit_code(
    tmp_path: Path, capsys: Capture, monkeypatch: Patch
):
    def without_limits(study: Slide) -> Any:
        problem = limited.func(study)
        free = [dataclasses.replace(s, lower=-math.inf, upper=math.inf) for s in problem.model.u]
        return dataclasses.replace(
            problem,
            model=dataclasses.replace(problem.model, u=free),
            minimise=-problem.ends.end[0],
            duration=(1.0, 1.0),
            boundary_constraints=problem.boundary_constraints[:2],
        )

    limited = Slide.problem
    monkeypatch.setattr(Slide, "problem", property(without_limits))
    assert main(["run", "slide", "-o", str(tmp_path / "out"), "--quiet", "--no-plots"]) == 3
    assert "decreases without bound; limit the inputs" in capsys.readouterr().err


test_wrong_slides_are_told = refusals(
    "slide",
    """
    block.force=0.5 | block.force | 0.5 does not move the block forward
    block.friction.forward=[1, 2] | block.friction.forward | 2 entries
    end={position=0.0} | end | equals the start
    minimise="effort" | time | longest allowed duration
    """,
)
test_wrong_slides_back_are_told = refusals(
    "slide_back",
    """
    block.friction.backward=3 | block.force | write more than 3, or another
    block.friction={kind="spike"} | block.force | from start to end; write another end
    block.friction={kind="spike"} & start.velocity=0 & end.velocity=1 | block.force | block backward
    block.force=1 & block.friction.backward=0.5 & end={position=-1, velocity=1} | block.force | forw
    """,
)
test_wrong_pairs_are_told = refusals(
    "chernousko_pair",
    """
    pair.ratio=1.0 | pair.ratio | less than 1
    pair.ratio=[0.5, 0.2] | pair.ratio | empty
    """,
)


def test_a_block_that_need_not_start_from_rest_needs_no_drive_that_could():
    """From a speed of 1 it comes to rest by 1/8 of way, ahead of it."""
    strong = "block.friction.backward=2000"
    assert load_scene("slide_back", [strong, "end.position=0.125"])
    assert load_scene("slide_back", [strong, SMOOTH])  # which creeps under any force


# -- drives that hardly exceed friction ------------------------------------------------------------


def within(excess: float) -> float:
    """Part by which time may be off: the force that is left is a difference of rounded ones."""
    return max(1e-10, 8 * np.finfo(float).eps / excess)


VISCOUS = 'block.friction={kind="viscous", drag=1.0}'


@pytest.mark.parametrize("contact", ["contact={treatment='exact'}", SMOOTH])
@pytest.mark.parametrize("drive", [1.0, 0.1, 0.03])
def test_the_fastest_slide_under_drag_is_that_of_theory(drive: float, contact: str):
    """Momentum: drive (t1 - t2) = drag way; top speed: 1 - exp(-t1) = exp(t2) - 1."""
    exact = 1 / drive + 2 * math.log1p(math.sqrt(-math.expm1(-1 / drive)))
    known = load_scene("slide", [f"block.force={drive}", VISCOUS, contact]).table.phases
    assert known is not None
    assert known.guess.duration == pytest.approx(exact, rel=1e-7)
    assert known.active == ((1,), (-1,))


@pytest.mark.parametrize("drive", [1.01, 1.05, 1.1, 3.0])
def test_the_fastest_smooth_slide_is_that_of_theory(drive: float):
    """By quadratures of m v dv/(u + f(v)) up to the speed at which the drive turns."""

    def until(top: float, power: int) -> float:
        def part(v: float, side: int) -> float:
            return side * v**power / (side * drive + 0.5 - 1.5 * math.tanh(v / 0.025))

        return sum(quad(part, 0.0, top, side, points=[0.05], limit=200)[0] for side in (1, -1))

    exact = until(brentq(lambda top: until(top, 1) - 1.0, 0.06, 2.0, xtol=1e-14), 0)
    known = load_scene("slide", [f"block.force={drive}", SMOOTH]).table.phases
    assert known is not None
    assert known.guess.duration == pytest.approx(exact, rel=1e-7)


@pytest.mark.parametrize(
    "changes",
    [
        pytest.param((VISCOUS, "block.force=0.02"), marks=pytest.mark.slow),
        (SMOOTH, "block.force=1.02"),
    ],
)
def test_weak_drives_against_smooth_friction_are_solved(changes: tuple[str, ...]):
    result = solved("slide", "mesh.tolerance=1e-5", *changes)
    known = load_scene("slide", changes).table.phases
    assert result.status == "ok"
    assert known is not None
    assert value(result, "time") == pytest.approx(known.guess.duration, rel=1e-4)


def test_a_speed_beyond_that_of_the_drive_is_never_reached():
    scene = load_scene("slide", [VISCOUS, "block.force=0.03", "end.velocity=0.031"])
    assert scene.table.phases is None


@pytest.mark.parametrize("digits", [3, 9, pytest.param(6, marks=pytest.mark.slow)])
def test_a_drive_just_above_friction_slides_back(digits: int):
    # brake with drive + 1 from speed 1, go back with drive - 2, brake with drive + 2
    drive = 2 + 10.0**-digits
    net, brake = drive - 2, drive + 1
    exact = 1 / brake + math.sqrt(1 / brake * (1 / net + 1 / (drive + 2)))
    result = solved("slide_back", f"block.force={drive!r}")
    assert result.status == "ok"
    assert value(result, "time") == pytest.approx(exact, rel=within(net / 2))


def test_a_drive_just_above_friction_leaves_backwards():
    # from rest at 0 to the speed -1 at 0: forward first, as long as it takes to get it going back
    drive = 2.01
    a, b, c = drive - 1, drive + 1, drive - 2
    way = 1 / (2 * c)
    exact = math.sqrt(2 * way * (1 / a + 1 / b)) + 1 / c
    changes = ("start.velocity=0", "end.velocity=-1", f"block.force={drive}")
    result = solved("slide_back", *changes)
    assert result.status == "ok"
    assert value(result, "time") == pytest.approx(exact, rel=1e-9)


@pytest.mark.parametrize(
    "seed", [0, 2, 5, *(pytest.param(n, marks=pytest.mark.slow) for n in (1, 3, 4))]
)
def test_weak_drives_of_any_size_are_as_fast_as_theory(seed: int):
    random = np.random.default_rng(seed)
    mass, friction, way = 10 ** random.uniform(-3, 3, 3)
    share, stronger = 10 ** random.uniform(-9, -1.5), friction * random.uniform(0.5, 10)
    side = random.choice([-1, 1])
    held = friction if side > 0 else stronger
    drive = held * (1 + share)
    net = drive - held
    exact = math.sqrt(2 * way * mass * (1 / net + 1 / (drive + held)))
    keys = {"mass": mass, "force": drive}
    keys |= {"friction.forward": friction, "friction.backward": stronger}
    changes = [f"block.{key}={float(number)!r}" for key, number in keys.items()]
    result = solved("slide", *changes, f"end.position={float(side * way)!r}", 'units="SI"')
    assert result.status == "ok"
    assert value(result, "time") == pytest.approx(exact, rel=within(share))


@pytest.mark.parametrize(
    "net", [1e-4, *(pytest.param(net, marks=pytest.mark.slow) for net in (1e-2, 1e-3))]
)
def test_the_least_effort_of_a_weak_drive(net: float):
    # at its limit over t, then falling straight to 0 over s; then it rests
    drive = 1 + net
    ratio = (1 - drive / 2) / net  # t over s: speed gained is speed lost
    s = 1 / math.sqrt(net * ratio**2 / 2 + net * ratio + net / 2 - drive / 6)
    effort = drive**2 * s * (ratio + 1 / 3)
    changes = (f"block.force={drive!r}", 'minimise="effort"', f"time={1.5 * s * (1 + ratio)}")
    result = solved("slide", *changes)
    assert result.status == "ok"
    assert value(result, "objective") == pytest.approx(effort, rel=1e-6)


@pytest.mark.parametrize(
    ("change", "time"),
    [
        (["end.velocity=-1"], 2.5),
        pytest.param(["end.velocity=-0.5"], 1.799038105676658, marks=pytest.mark.slow),
        (["end.position=5", "end.velocity=-1"], 3.872281323269015),
    ],
)
def test_the_fastest_slide_may_end_backwards(change: list[str], time: float):
    """By hand: full drive ahead, full drive back to rest, and back at full drive to the speed."""
    assert value(wo.run(load_scene("slide", change)), "time") == pytest.approx(time, rel=1e-9)
