"""Scene fit_then_design: a gait on numbers that a crawl has told, tried on the worm as it is."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from outcomes import refusals, refused
from places import PROBLEMS

import wormopt as wo
from wormopt.errors import SceneError, SolveError

TRUE = {"mass": [1.1, 0.9, 1.3], "drag": 0.5, "load": 5.3}  # of tests/make_recordings.py


@pytest.mark.slow
def test_the_gait_keeps_its_limit_on_the_worm_as_it_is():
    result = wo.run("fit_then_design")
    assert result.status == "ok"
    number = {name: scalar.value for name, scalar in result.scalars.items()}
    for name, true in TRUE.items():
        off = np.subtract(number[f"{name}_found"], true) / number[f"{name}_error"]
        assert np.all(np.abs(off) < 4), name
    assert result.trust["fit"]["noise"]["actuator_force"] == pytest.approx(0.2, rel=0.06)
    assert number["plant_spike_load_max"] < 27.0 < number["plant_spike_load_bold"]
    assert 0.98 < number["plant_share"] < 1.0
    assert number["plant_distance"] < number["reach"]
    assert all(0.0 < width < 0.2 for width in number["load_width"])
    inside = np.abs(result["read_force"].values - result["fitted_force"].values) < 0.4
    assert inside.mean() == pytest.approx(0.954, abs=0.015)


@pytest.mark.slow
def test_a_plant_outside_what_was_fitted_fails_the_trial():
    """The load has grown since: the gait is right for what was recorded, not for what is."""
    result = wo.run("fit_then_design", {"plant.load": 5.9})
    assert result.status == "failed"
    assert "on the plant gait.spike_load is exceeded" in result.reason


@pytest.mark.slow
def test_numbers_that_no_recording_tells_are_said(tmp_path: Path):
    """A head that only rests or moves with its neighbour: too few instants to tell three masses."""
    scene = _copy(tmp_path)
    lines = (PROBLEMS / "recordings/crawl.csv").read_text().splitlines()
    (tmp_path / "recordings/crawl.csv").write_text("\n".join(lines[:4]) + "\n")
    with pytest.raises((SolveError, SceneError), match=r"identified|readings|unknowns"):
        wo.run(scene)


test_scenes_that_do_not_fit_together_are_refused = refusals(
    "fit_then_design",
    """
    worm.load=[4.0, 5.0] | worm.load | the fit finds one load
    worm.mass=[1, 2, 1] & worm.slope=0.1 & worm.gravity=9.81 | worm.slope | pulls unequal masses
    gait.sharing="least_actuation" | gait.sharing | nonlinear
    fit.numbers=[] | fit.numbers | the list is empty
    plant.mass=[1, 1] | plant.mass | 2 entries
    worm.links=3 & plant.mass=1.0 | recording[0].gait.shape | "fast" has 2 links
    fit.noise={actuator=0.2} | fit | no signal 'actuator'
    recording.0.columns={mu0="force[0]", mu1="force[1]"} | recording | no signal force
    """,
)


def test_a_recorded_gait_with_corners_is_refused():
    gait = {"shape": "accordion", "period": 2.0, "length": [0.7, 1.3], "profile": "trapezoid"}
    table = {"file": "recordings/crawl.csv", "columns": {"mu0": "actuator_force[0]"}}
    table["gait"] = gait | {"ramp": 0.0}
    refused("fit_then_design", {"recording": [table]}, "recording", "corners")


def _copy(folder: Path) -> Path:
    shutil.copytree(PROBLEMS / "recordings", folder / "recordings")
    return Path(shutil.copy(PROBLEMS / "fit_then_design.toml", folder))


@pytest.mark.parametrize(
    ("columns", "refused"),
    [
        ("time,x,v", {"x": "position[0]", "v": "velocity[2]"}),
        ("time,position_0,position_1", {}),
        ("time,mu,x", None),
        ("time,spike_load,position_0", None),
    ],
)
def test_recordings_without_a_force_are_refused(tmp_path: Path, columns: str, refused: dict | None):
    named = {"mu": "actuator_force[0]", "x": "position[0]"} if "mu" in columns else refused or {}
    rows = "\n".join(f"{0.1 * k},0,0" for k in range(20))
    (tmp_path / "run.csv").write_text(f"{columns}\n{rows}\n")
    gait = {"shape": "fast", "period": 2.0, "rest_length": 1.0}
    scene = tmp_path / "scene.toml"
    text = (PROBLEMS / "fit_then_design.toml").read_text()
    scene.write_text(text.replace("recordings/crawl.csv", "run.csv"))
    change = {"recording": [{"file": "run.csv", "columns": named, "gait": gait}]}
    if refused is None:
        assert wo.load_scene(scene, change).table.fit.numbers == ("mass", "drag", "load")
        return
    with pytest.raises(
        SceneError, match=r"recording: no column is a force.*record actuator forces"
    ):
        wo.load_scene(scene, change)
