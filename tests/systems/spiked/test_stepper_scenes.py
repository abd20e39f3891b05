"""Scenes of kind "stepper", and motors as limits of a design."""

import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from outcomes import refusals, value
from stepping import counted

import wormopt as wo
from wormopt.cli import main
from wormopt.errors import SceneError, SolveError
from wormopt.model.gait import Gait
from wormopt.result import Result
from wormopt.study import load_scene, packaged_scenes
from wormopt.systems.spiked.construct import fast_gait, gait_of_result
from wormopt.systems.spiked.stepper.stepper import Stepper
from wormopt.systems.spiked.stepper.steps import Steps, step_times

SCENE = "prototype_steps"


# -- scenes --------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def prototype() -> Result:
    return wo.run(SCENE)


def test_the_prototype_walks_as_formulas_say(prototype: Result):
    assert prototype.status == "ok", prototype.reason
    # advance 4 e l0 less three handovers of 1 mm, in 18 s
    assert value(prototype, "advance") == pytest.approx(0.06 - 3e-3, abs=1e-12)
    assert value(prototype, "speed_ideal") == pytest.approx(0.06 / 18, rel=1e-12)
    assert value(prototype, "speed_without_backslip") == pytest.approx(0.06 / 18, rel=1e-12)
    assert value(prototype, "step_count") == [12000, 12000]
    assert value(prototype, "period_min") == pytest.approx(
        18 * (3 * np.pi / 18 * 0.015 / 2e-3) / 5.0, rel=1e-12
    )
    assert value(prototype, "period_limited_by") == "motor.rate_max"
    rate = 3 * np.pi / 18 * 0.015 / 2e-3
    assert value(prototype, "step_rate_max") == pytest.approx([rate * 400] * 2, rel=1e-12)
    assert value(prototype, "quantisation_error") == pytest.approx(0.55 * 5e-6, rel=1e-6)
    assert prototype.scalars["acceleration_max"].unit == "s-2"
    assert prototype.trust["warnings"] == []


def test_the_files_hold_the_commands(tmp_path: Path, prototype: Result):
    out = tmp_path / "out"
    assert main(["run", SCENE, "-o", str(out), "--quiet", "--no-plots"]) == 0
    assert {p.name for p in out.iterdir()} == {"result.nc", "summary.json", "steps.csv", "steps.c"}
    text = (out / "steps.csv").read_text(encoding="utf-8")
    assert counted(text, fast_gait(18.0, 0.1)) <= 0.55 + 1e-6
    loaded = Result.load(out)
    again = tmp_path / "again"
    again.mkdir()
    loaded.save(again)
    for name in ("steps.csv", "steps.c"):
        assert (again / name).read_bytes() == (out / name).read_bytes()
    # a later run that fails takes the commands away: no motor is to run by them
    arguments = ["run", SCENE, "-o", str(out), "--quiet", "--no-plots", "--set", "gait.period=12"]
    assert main(arguments) == 3
    assert {p.name for p in out.iterdir()} == {"result.nc", "summary.json"}
    failed = Result.load(out)
    assert "motor.rate_max is 5; write gait.period = 14.14" in failed.reason
    assert value(failed, "period_min") == pytest.approx(value(prototype, "period_min"))


def test_a_table_of_somebody_else_is_not_replaced(tmp_path: Path):
    out = tmp_path / "out"
    assert main(["run", "fast_gait", "-o", str(out), "--quiet", "--no-plots"]) == 0
    (out / "steps.csv").write_text("mine")
    scene = tmp_path / "fast_gait.toml"
    shutil.copy(packaged_scenes()[SCENE], scene)
    assert main(["run", str(scene), "-o", str(out), "--quiet", "--no-plots"]) == 2
    assert (out / "steps.csv").read_text() == "mine"


def test_a_gait_from_a_file_is_commanded(tmp_path: Path):
    wo.run("fast_gait").save(tmp_path)
    text = packaged_scenes()[SCENE].read_text(encoding="utf-8")
    head, _, tail = text.partition("[gait]")
    table = '[gait]\nshape = "file"\nfile = "result.nc"\nperiod = 300.0\n\n'
    scene = tmp_path / "filed.toml"
    scene.write_text(head + table + tail[tail.index("[motor]") :])
    result = wo.run(load_scene(scene, ["motor.lead=0.02", "motor.microsteps=1"]))
    assert result.status == "ok", result.reason
    assert value(result, "speed_ideal") == pytest.approx(1.2 / 300, rel=1e-9)


def test_a_result_that_leaves_the_gait_fails(monkeypatch: pytest.MonkeyPatch):
    from wormopt.systems.spiked import stepper_commands

    def late(gait: Gait, motor_: Stepper) -> Steps:
        steps = step_times(gait, motor_)
        time = np.minimum(steps.time + 2e-3, steps.period)
        return Steps(steps.period, steps.travel, steps.start, time, steps.motor, steps.direction)

    monkeypatch.setattr(stepper_commands, "step_times", late)
    result = wo.run(SCENE)
    assert result.status == "failed"
    assert "the replayed steps differ from the gait by" in result.reason
    (fault,) = (check for check in result.checks if not check.passed)
    assert fault.name == "replayed steps"
    assert fault.value == result.trust["replay"]["error_in_steps"] > fault.limit


test_scenes_that_cannot_be_are_refused = refusals(
    SCENE,
    """
    motor.start_rate=6 | motor.start_rate | above motor.rate_max = 5
    units="dimensionless" | units | SI
    bristles.settle_time=18 | bristles.settle_time | not below the period
    worm.links=3 | gait.shape | 2 links
    tick=1e-3 | tick
    tick=1e-9 | tick
    motor.microsteps=2000 | motor.microsteps
    """,
)


def test_strokes_below_a_step_move_no_motor():
    with pytest.raises(SolveError, match="no motor steps") as caught:
        wo.run(load_scene(SCENE, ["motor.lead=60.0"]))
    assert caught.value.code == "no_steps"


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (["bristles.backslip=0"], "backslip is 0"),
        (["bristles.backslip=0.05"], "does not advance"),
        (["worm.load=0.00001", "worm.mass=30"], "glide"),
    ],
)
def test_doubts_are_named(changes: list[str], said: str):
    result = wo.run(load_scene(SCENE, ["motor.microsteps=1", *changes]))
    assert any(said in text for text in result.trust["warnings"])


def zigzag(*changes: str) -> Result:
    """Links that reverse at once, at 3.4 turns per second of the motors."""
    gait = (
        'gait={shape="accordion", period=0.15, length=[0.1, 0.1005028], profile="trapezoid", '
        "ramp=0}"
    )
    return wo.run(load_scene(SCENE, [gait, "bristles.backslip=1e-5", *changes]))


@pytest.mark.parametrize(
    ("changes", "warned"),
    [
        (["motor.start_rate=5"], True),
        (["motor.start_rate=5", "gait.period=2"], False),  # eight times as fast is still slow
        (["motor.start_rate=5", "motor.hysteresis=0.39"], False),  # no turn just past a level
    ],
)
def test_reversals_faster_than_the_motor_starts_are_told(changes: list[str], warned: bool):
    result = zigzag(*changes)
    assert result.status == "ok", result.reason
    told = [text for text in result.trust["warnings"] if "reverses with two pulses" in text]
    rate, interval = value(result, "step_rate_max"), value(result, "step_interval_min")
    assert bool(told) == warned, (interval * rate[0], told)
    if warned:
        assert len(told) == 2
        assert f"{1 / (interval * rate[0]):.3g} times as fast" in told[0]


# -- motors as limits of a design ----------------------------------------------------------------

WEAK = "motor={lead=0.1, rate_max=8, acceleration_max=100}"

QUICK = ['search.effort="quick"', "search.sequence=[[0], [2], [1]]"]


@pytest.mark.slow
def test_a_design_within_motors_is_one_within_their_limits():
    plain = wo.run(
        load_scene("design_fast_gait", [*QUICK, "gait.rate=0.8", "gait.acceleration=10"])
    )
    driven = wo.run(load_scene("design_fast_gait", [*QUICK, WEAK]))
    assert driven.status == "ok", driven.reason
    assert value(driven, "speed") == pytest.approx(value(plain, "speed"), rel=1e-9)
    assert value(driven, "rate_limit_from") == ["motor", "motor"]
    assert value(driven, "motor_rate_share") == pytest.approx(1, abs=1e-9)
    assert value(driven, "motor_acceleration_share") == pytest.approx(1, abs=1e-9)
    assert "motors" in driven.trust["assumptions"]
    strong = "motor={lead=0.1, rate_max=20, acceleration_max=300}"
    free = wo.run(load_scene("design_fast_gait", [*QUICK, strong]))
    bare = wo.run(load_scene("design_fast_gait", QUICK))
    assert value(free, "speed") == value(bare, "speed")
    assert value(free, "rate_limit_from") == ["gait", "gait"]
    assert not bare.scalars.keys() & {"rate_limit_from", "motor_rate_share"}
    assert "assumptions" not in bare.trust
    # and the motors do follow what was designed for them
    gait = gait_of_result(driven)
    stepper = Stepper(0.1, 200, 1, 8.0, 100.0)
    assert step_times(gait, stepper).counts.sum() > 0


def test_motors_alone_limit_a_design_and_are_named_in_a_conflict(tmp_path: Path):
    text = packaged_scenes()["design_fast_gait"].read_text(encoding="utf-8")
    text = re.sub(r"(?m)^(rate|acceleration) = .*$", "", text)
    scene = tmp_path / "driven.toml"
    scene.write_text(text)
    assert load_scene(scene, [WEAK]).table.limits.acceleration == (10.0, 10.0)
    with pytest.raises(SceneError, match=r"write gait\.rate or both"):
        load_scene(scene)
    with pytest.raises(SceneError, match=r"motor\.acceleration_max forbids jumps"):
        load_scene(scene, [WEAK, "gait.impulses=true"])
    with pytest.raises(SceneError, match=r"motor\.start_rate"):
        load_scene(scene, ["motor={lead=0.1, rate_max=8, acceleration_max=1, start_rate=9}"])
    dear = 'objective={minimise="peak_spike_load", speed=1.5}'
    with pytest.raises(SolveError, match=r"above the ceiling 0\.8") as caught:
        wo.run(load_scene(scene, [WEAK, dear]))
    assert (
        "gait.rate is here the limit of the motor, motor.lead * motor.rate_max"
        in caught.value.suggestion
    )
    assert caught.value.partial.status == "failed"
