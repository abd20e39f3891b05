"""Scenes of kind "gait-shift": what they refuse, keep and promise."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from block_waves import LIMITS, wave
from outcomes import refusals, refused

import wormopt as wo
from wormopt.errors import Interrupted, SceneError, SolveError
from wormopt.result import Result
from wormopt.study import load_scene, packaged_scenes

test_scenes_that_cannot_be_are_refused_by_key = refusals(
    "gait_shift",
    """
    supervisor.up=0.95 | supervisor.up
    way.goal=-1.0 | way.goal
    ground.place=[0.0, 120.0, 100.0, 210.0] | ground.place[2]
    ground.load=[1.0, 2.0] | ground.load
    worm.mass=[1.0, 1.0] | worm.mass
    worm.mass=[1.0, 2.0, 1.0, 1.0, 1.0] | ground.slope
    limits.resting=5 | limits.resting
    gears=[{shape="fast", period=1.0}] | gears
    """,
)


def test_gears_change_between_profiles_that_are_alike():
    slow: dict[str, Any] = {"shape": "accordion", "period": 7.2, "length": [0.8, 1.2]}
    fast = slow | {"shape": "block_wave", "period": 5.0, "profile": "quintic"}
    refused("gait_shift", {"gears": [slow, fast]}, "gears[0].profile", "")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("limits.rate=0.4", "limits.rate"),
        ("limits.length=[0.8, 1.2]", "limits.length"),
        ("limits.spike_load=8.0", "have no common load"),
    ],
)
def test_gears_that_do_not_fit_are_refused(change: str, message: str):
    with pytest.raises(SceneError, match=message):
        wo.run("gait_shift", change)


TEXT = packaged_scenes()["gait_shift"].read_text(encoding="utf-8").partition("[adaptive]")[0]


@pytest.mark.slow
def test_a_table_can_be_a_gear(tmp_path: Path):
    wave(4, 3, 7.0, profile="quintic").gait.to_csv(tmp_path / "slow.csv", 61)
    first, second, third = TEXT.split("[[gears]]")[1:]
    table = '\nshape = "file"\nfile = "slow.csv"\n' + third[third.index("[limits]") :]
    scene = tmp_path / "own.toml"
    parts = [TEXT.partition("[[gears]]")[0], first, second, table]
    scene.write_text("[[gears]]".join(parts), encoding="utf-8")
    slow = load_scene(scene).table.sorted_gears[0]
    exact = wave(4, 3, 7.0, profile="quintic")
    assert slow.speed == pytest.approx(exact.speed, rel=1e-2)
    spike, force = slow.bears(LIMITS)
    assert np.isfinite(spike + force)


@pytest.mark.slow
def test_a_hill_that_rises_too_fast_breaks_a_limit_and_the_result_says_so(tmp_path: Path):
    scene = tmp_path / "steep.toml"
    steep = TEXT.replace("place = [60.0, 120.0, 150.0, 210.0]", "place = [9.0, 12.0, 20.0, 60.0]")
    scene.write_text(steep.replace("goal = 270.0", "goal = 30.0"), encoding="utf-8")
    found = wo.run(load_scene(scene))
    assert found.status == "failed"
    assert "supervisor.down" in found.reason


@pytest.mark.slow
def test_what_is_done_is_kept_where_no_schedule_passes_or_the_user_stops(tmp_path: Path):
    scene = tmp_path / "high.toml"
    high = TEXT.replace("slope = [0.0, 0.26, 0.26, 0.0]", "slope = [0.0, 0.6, 0.6, 0.0]")
    scene.write_text(high.replace("goal = 270.0", "goal = 140.0"), encoding="utf-8")
    with pytest.raises(SolveError, match="no schedule") as refused:
        wo.run(load_scene(scene))
    assert refused.value.partial.scalars["shifts"].value == 2

    def stop(what: str, _: float | None) -> None:
        if what == "fixed":
            raise KeyboardInterrupt

    scene.write_text(TEXT.replace("goal = 270.0", "goal = 12.0"), encoding="utf-8")
    with pytest.raises(KeyboardInterrupt) as stopped:
        wo.run(load_scene(scene), report=stop)
    assert isinstance(stopped.value, Interrupted)
    assert stopped.value.partial.status == "failed"
    assert "stroke_gear" in stopped.value.partial


@pytest.mark.slow
def test_the_packaged_scene_keeps_what_it_promises():
    found: Result = wo.run(load_scene("gait_shift", []))
    number = {name: scalar.value for name, scalar in found.scalars.items()}
    assert found.status == "ok"
    assert number["efficiency"] >= 0.9
    assert number["spike_load_max"] <= 12.0
    assert number["actuator_force_max"] <= 20.0
    assert number["spike_total_min"] >= 0.0
    assert number["fixed_times"][1:] == [None, None]
    assert number["gear_speeds"][0] <= number["gear_speeds"][2] / 2
    assert number["ideal_time"] <= number["best_time"] <= number["time"] < number["fixed_time"]
    assert number["adaptive_shifts"] == number["shifts"] == 4
    assert number["adaptive_spike_load_max"] <= 12.0
    assert number["adaptive_time"] == pytest.approx(number["time"], rel=1e-3)
