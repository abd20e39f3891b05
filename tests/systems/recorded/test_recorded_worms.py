"""Scenes of kinds "fit" and "fit-numbers": what is read of files, refused of them, and found."""

import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import make_recordings
import numpy as np
import pytest
from outcomes import refusals, run_text
from scipy.stats import norm

import wormopt as wo
from wormopt.cli import main
from wormopt.errors import SceneError
from wormopt.fitting.posterior import Posterior
from wormopt.numerics.workers import Engine, using
from wormopt.quantities import Variable
from wormopt.result import Result
from wormopt.study import load_scene
from wormopt.study.scene import scene_within
from wormopt.systems.chain import chain
from wormopt.systems.recorded import fit as fit_kind
from wormopt.systems.recorded.recordings import RecordingFile, Run, read_columns, runs_of
from wormopt.systems.recorded.tables import Measured

LINK: dict[str, Any] = {"mass": 0.3, "stiffness": 40.0, "damping": 2.0, "rest_length": 0.06}
WORM = {
    "kind": "simulate",
    "worm": {"links": 1, **LINK, "friction": {"kind": "coulomb", "forward": 0.2, "backward": 0.8}},
}
TABLE = "time [ms],head [mm],tail [mm],u\n0,60,0,0\n100,61,,1\n200,65,1,1\n"
COLUMNS = {"head": "position[0]", "tail": "position[1]", "u": "input[0]"}


def fit_scene(folder: Path, **changes: Any) -> dict[str, Any]:
    scene: dict[str, Any] = {
        "schema": 1, "kind": "fit", "units": "SI", "model": WORM,
        "recording": [{"file": str(folder / "run.csv"), "columns": COLUMNS}],
        "unknown": [{"name": "stiffness"}],
    }  # fmt: skip
    return scene | changes


def written(folder: Path, text: str) -> Path:
    path = folder / "run.csv"
    path.write_text(text, encoding="utf-8")
    return path


# -- files -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "is empty"),
        ("# nothing but remarks\n\n", "is empty"),
        ("time,x\n", "no line of readings"),
        ("time,x\n0,1\n", "one line of readings"),
        ("0,1\n1,2\n", "line 1: names of columns are missing"),
        ("t,x\n0,1\n1,2\n", "line 1: there is no column time; .* one of t, x"),
        ("time,x,x\n0,1,1\n1,2,2\n", "line 1: two columns are called x"),
        ("time,\n0,1\n1,2\n", "line 1: column 2 has no name"),
        ("time,x\n0,1\n0.1,abc\n", 'line 3, column x: "abc" is not a number'),
        ("# run 7\ntime,x\n0,1\n0.1,1e400\n", "line 4, column x: 1e400 is infinite"),
        ("time,x\n0,1\n,2\n", "line 3, column time: the time is missing"),
        ("time,x\n0,1\n1,2\n1,3\n", "line 4: time 1 appears twice"),
        ("time,x\n0,1\n1,2\n0.5,3\n", "line 4: time decreases from 1 to 0.5"),
        ("time,x\n0,1\n1,2,3\n", "line 3: 3 cells for 2 columns"),
        ("time;x\n0;1,5\n1;2.5\n2;3,5\n", r'line 3, .* "2\.5" and, in line 2, "1,5" have diff'),
        ('time,x\n0,"1,500"\n1,"2,500"\n', r'line 2, column x: "1,500" may be 1500 or 1\.500'),
        ("time;x\n0;1.234,5\n1;2\n", r'"1\.234,5" has separators of thousands; write 1234\.5'),
        ("time;x\n12:03:01;1\n12:03:02;2\n", r'column time: "12:03:01" is a date or a time of'),
        ("time,x\n0,1_000\n1,2\n", '"1_000" has separators of thousands; write 1000'),
    ],
)
def test_what_is_wrong_in_a_file_is_told_by_its_place(tmp_path: Path, text: str, said: str):
    with pytest.raises(SceneError) as refused:
        read_columns(written(tmp_path, text), "time")
    faults = refused.value.faults
    assert faults[0][0] == "file"
    assert re.search(said, faults[0][1]), faults


def test_many_faults_are_counted_not_listed(tmp_path: Path):
    path = written(tmp_path, "time,x\n-1,0\n" + "".join(f"{k},?\n" for k in range(40)))
    with pytest.raises(SceneError) as refused:
        read_columns(path, "time")
    faults = refused.value.faults
    assert len(faults) == 6
    assert "35 more" in faults[-1][1]


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_columns_units_and_gaps_are_read(tmp_path: Path, separator: str):
    text = "\ufeff# by hand\ntime (s), x [mm] ,position[1]\n0,1,\n\n0.5,NaN,2e-3\n1,3,\n"
    found = read_columns(written(tmp_path, text.replace(",", separator)), "time")
    assert found.units == {"": "s", "x": "mm"}
    assert list(found.time) == [0.0, 0.5, 1.0]
    assert found.values["x"][::2] == (1.0, 3.0)
    assert math.isnan(found.values["x"][1])
    assert found.values["position[1]"][1] == 2e-3


def test_what_a_camera_writes_is_read_as_it_is(tmp_path: Path):
    """Lines above the names, remarks, frames for times, one lost, an axis that points back."""
    text = "Tracker 3.2\nworm 7; 50 fps\n\nframe;head [mm];back;quality\n"
    text += "1400;60;0;fair\n1402;61;-1;good\n1403;65;-2;\n"
    table = RecordingFile(
        file=str(written(tmp_path, text)),
        time="frame",
        columns={"head": "position[0]", "back": "position[1]"},
        units={"frame": "20 ms", "back": "-0.5 mm"},
        window=(1401.0, 1403.0),
    )
    model = chain(1, **LINK)
    assert list(table.faults_in(tmp_path, "SI", {})) == []
    (run,) = runs_of([table], tmp_path, model, "SI", {}, "scene")
    assert run.recording.time == pytest.approx([28.04, 28.06], rel=1e-15)
    assert run.recording.values["position"] == pytest.approx(
        np.array([[0.061, 0.065], [0.0005, 0.001]]), rel=1e-15
    )
    assert run.left_out == ("quality",)


def test_words_in_a_column_that_is_a_signal_are_refused(tmp_path: Path):
    text = "time,position[0],position[1]\n0,1,bad\n1,2,good\n"
    table = RecordingFile(file=str(written(tmp_path, text)))
    model = chain(1, **LINK)
    with pytest.raises(SceneError, match=r"column position\[1\] contains text"):
        runs_of([table], tmp_path, model, "SI", {}, "scene")


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"units": "dimensionless"}, '"ms" is a unit, but the scene has none'),
        ({"recording": []}, r"write a table \[\[recording\]\]"),
        ({"unknown": [{"name": "stiffness", "start": 1, "lower": 2}]}, "start: 1 is below lower"),
        ({"unknown": [{"name": "damping"}] * 2}, r'unknown\[1\].name: "damping" appears twice'),
        ({"model": {"kind": "simulate", "worm": {"links": 0}}}, r"model\.worm\.links"),
        ({"want": ["prediction"]}, 'write use = "predict"'),
        ({"want": ["profiles"]}, "write profiles = true"),
    ],
)
def test_scenes_that_cannot_be_fitted_are_refused(
    tmp_path: Path, changes: Mapping[str, Any], said: str
):
    written(tmp_path, TABLE)
    with pytest.raises(SceneError, match=said):
        load_scene(fit_scene(tmp_path, **changes))


@pytest.mark.parametrize(
    ("recording", "said"),
    [
        ({"file": "rn.csv"}, 'there is no file "rn.csv" .* did you mean run.csv'),
        ({"columns": {"hed": "position[0]"}}, "no column hed; did you mean head"),
        ({"units": {"head": "furlong"}}, r'units.head: "furlong"'),
        ({"window": [300.0, 400.0]}, "contains 0 times .*, .* its times are from 0 to 200"),
        ({"window": [1.0, 0.0]}, "the first time is not before the last"),
    ],
)
def test_recordings_that_do_not_fit_their_file_are_refused(
    tmp_path: Path, recording: Mapping[str, Any], said: str
):
    written(tmp_path, TABLE)
    table = {"file": "run.csv", "columns": COLUMNS, **recording}
    with pytest.raises(SceneError, match=said):
        scene_within(tmp_path, "x", fit_scene(tmp_path, recording=[table]))


# -- beside a model --------------------------------------------------------------------------------


def runs(folder: Path, text: str, units: str = "SI", **table: Any) -> list[Run]:
    written(folder, text)
    worm = chain(1, **LINK, law=wo.Coulomb(0.2, 0.8))
    tables = [RecordingFile(file="run.csv", **table)]
    return runs_of(tables, folder, worm, units, {"position": 1e-3}, "scene")


def test_readings_come_in_units_of_the_scene_and_inputs_move_the_model(tmp_path: Path):
    (run,) = runs(tmp_path, TABLE, columns=COLUMNS, start={"velocity": 0.0})
    recording = run.recording
    assert recording.times == pytest.approx([0.0, 0.1, 0.2])
    expected = [[0.060, 0.061, 0.065], [0.0, np.nan, 0.001]]
    assert recording.readings["position"] == pytest.approx(np.array(expected), nan_ok=True)
    assert run.drives == ("input",)
    model = recording.model
    assert model is not None
    assert not model.u
    motion = wo.simulate(model, 0.2, times=[0.0, 0.05, 0.1, 0.15], route="python")
    assert motion["input"][0] == pytest.approx([0.0, 0.5, 1.0, 1.0])


def test_held_inputs_stay_until_the_next_reading(tmp_path: Path):
    (run,) = runs(tmp_path, TABLE, columns=COLUMNS, between="held")
    assert run.recording.model is not None
    motion = wo.simulate(run.recording.model, 0.2, times=[0.05, 0.15], route="python")
    assert motion["input"][0] == pytest.approx([0.0, 1.0])


@pytest.mark.parametrize(
    ("text", "table", "said"),
    [
        ("time,head\n0,1\n1,2\n", {}, 'no column is a state or output .* {head = "'),
        ("time,x\n0,1\n1,2\n", {"columns": {"x": "postion[0]"}}, "did you mean position"),
        ("time,x\n0,1\n1,2\n", {"columns": {"x": "position"}}, r"write one of position\[0\]"),
        ("time,x\n0,1\n1,2\n", {"columns": {"x": "position[2]"}}, r"write at most position\[1\]"),
        (TABLE, {"start": {"position": [1.0]}}, "start.position: has 1 entry for 2; write one num"),
        ("time,position[0] [s]\n0,1\n1,2\n", {}, "is not a unit of length; write m, or a mul"),
        ("time,position[0],position_0\n0,1,1\n1,2,2\n", {}, r"two columns are named position\[0\]"),
        ("time,position[0]\n0,1\n1,1\n", {}, "all signals are constant"),
        ("time,input[0]\n0,1\n1,2\n", {}, "no column is a state or output"),
        ("time,position[0],friction_forward[0]\n0,1,1\n1,2,2\n", {}, "cannot vary in time"),
    ],
)
def test_columns_that_are_no_signals_are_refused(
    tmp_path: Path, text: str, table: Mapping[str, Any], said: str
):
    with pytest.raises(SceneError, match=said):
        runs(tmp_path, text, **table)


def test_our_own_results_are_recordings(tmp_path: Path):
    """NetCDF as `Result.save` writes it: entries over time, by their units."""
    position = np.array([[0.06, 0.07, 0.09], [0.0, 0.01, 0.01]])
    signals = (
        Variable("time", "s", ("time",), np.array([0.0, 0.1, 0.2])),
        Variable("position", "m", ("mass", "time"), position),
        Variable("energy", "mJ", ("time",), np.array([1.0, 2.0, 3.0])),
        Variable("spectrum", "m", ("frequency",), np.array([1.0, 2.0])),
    )
    Result("crawl", "simulate", variables=signals).save(tmp_path)
    worm = chain(1, **LINK)
    (run,) = runs_of([RecordingFile(file="result.nc")], tmp_path, worm, "SI", {}, "scene")
    assert run.recording.readings["position"] == pytest.approx(position, abs=0)
    assert run.recording.readings["energy"] == pytest.approx(np.array([[1e-3, 2e-3, 3e-3]]))
    assert run.left_out == ()


@pytest.mark.parametrize("text", ["no file of this kind", "CDF\x01 and not more"])
def test_files_that_are_no_netcdf_are_refused(tmp_path: Path, text: str):
    (tmp_path / "run.nc").write_text(text, encoding="utf-8")
    worm = chain(1, **LINK)
    with pytest.raises(SceneError, match="is not a NetCDF-3 file"):
        runs_of([RecordingFile(file="run.nc")], tmp_path, worm, "SI", {}, "scene")


# -- what is found ---------------------------------------------------------------------------------


def within(result: Result, label: str, truth: float) -> bool:
    """Whether a number found is within four of its standard errors, and these are small."""
    error = result[f"{label}_error"].value
    return abs(result[label].value - truth) < 4 * error < 0.2 * truth


@pytest.fixture(scope="module")
def fitted_chain() -> Result:
    return wo.run("fit_chain")


@pytest.mark.slow
def test_eight_numbers_of_a_chain_are_found_again(fitted_chain: Result):
    assert fitted_chain.status == "ok"
    for name, truth in make_recordings.CHAIN.items():
        assert within(fitted_chain, name.replace("[", "_").replace("]", ""), truth), name
    assert fitted_chain["rank"].value == 8
    assert fitted_chain["noise_position"].value == pytest.approx(
        make_recordings.CHAIN_NOISE, rel=0.1
    )


@pytest.mark.slow
def test_a_run_kept_aside_is_predicted(fitted_chain: Result):
    """As many readings lie in the band as its width lets expect.

    The band holds noise and what the fit does not know of its numbers. The latter is one draw for
    all readings of a run: over many fits 95 % lie inside, of one run more where the numbers are
    good and fewer where they are bad. Chances are those of numbers off by up to two errors.
    """
    noise = fitted_chain["noise_position"].value
    wide = fitted_chain["band_position"].values[1] / noise
    wide = wide[np.isfinite(fitted_chain["recorded_position"].values[1])]
    off = np.array([[0.0], [2.0]]) * np.sqrt(np.maximum(wide**2 - 1, 0))
    most, least = (norm.cdf(1.96 * wide - off) - norm.cdf(-1.96 * wide - off)).mean(axis=1)
    by_chance = 4 * math.sqrt(least * (1 - least) / len(wide))
    coverage = fitted_chain["prediction_coverage"].value
    assert 0.95 < most < 1.0
    assert least - by_chance < coverage < most + 4 * math.sqrt(most * (1 - most) / len(wide))
    assert fitted_chain["prediction_chi2"].value == pytest.approx(1.0, abs=0.2)
    left = fitted_chain["residual_position"].values
    assert np.nanstd(left[0]) == pytest.approx(1.0, abs=0.02)


@pytest.mark.slow
def test_damping_and_friction_of_the_pair_are_found_again():
    result = wo.run("fit_pair")
    assert result.status == "ok"
    for name, truth in make_recordings.PAIR.items():
        assert within(result, name, truth), name
        low, high = result[f"{name}_interval"].value
        assert low < truth < high
        half = 1.96 * result[f"{name}_error"].value
        assert (high - low) / 2 == pytest.approx(half, rel=0.1)


@pytest.mark.slow
def test_numbers_at_their_bounds_are_told(tmp_path: Path):
    change = ["profiles=false", "want=[]", "unknown.0.start=0.004", "unknown.0.upper=0.005"]
    result = wo.run(load_scene("fit_pair", change))
    assert result.trust["at_bound"] == ["damping"]
    assert "damping is at its bound" in result.trust["warnings"]
    assert result["damping"].value == pytest.approx(0.005)


@pytest.mark.slow
def test_a_best_start_that_is_alone_says_what_to_try():
    """The recording is of a weaker coupling than the model is told."""
    result = wo.run(load_scene("fit_pair", ["profiles=false", "want=[]", "model.pair.eps=0.36"]))
    assert result.status == "failed"
    assert re.search(r"only one of 6 starts found the best fit, .*; write other", result.reason)


@pytest.mark.slow
def test_draws_of_the_posterior_are_told(monkeypatch: pytest.MonkeyPatch):
    """Draws by hand in place of the sampler's: three quantiles, one chain that differs."""
    spread = np.linspace(0.0, 1.0, 41)[None, :, None] * np.ones((2, 1, 3))
    drawn = Posterior(("damping", "forward", "backward"), spread, 0, np.array([1.2, 1, 1]),
                      np.full(3, 500.0))  # fmt: skip
    monkeypatch.setattr(fit_kind, "posterior", lambda found, **given: drawn)
    change = ["profiles=false", "want=[]", "posterior={draws=100}", "level=0.9"]
    result = wo.run(load_scene("fit_pair", change))
    assert result["damping_posterior"].value == pytest.approx([0.05, 0.95])
    assert result.status == "failed"
    assert "chains differ in damping" in result.reason


def spike_load(load: float, drag: float, period: float) -> float:
    """Largest load of the spikes of gait (15), three masses of 1, links of 2 (1 ± 0.15)."""
    turn = math.pi / period
    return 3 * (load + 2 * turn * 0.15 * 2 * math.hypot(3 * turn, drag))


UNFINISHED = """
schema = 1
kind = "fit-numbers"
[model]
scene = "fast_gait"
[search]
steps = 1
[[unknown]]
name = "load"
key = "worm.load"
step = 1e-4
[[unknown]]
name = "drag"
key = "worm.drag"
lower = 0.0
step = 1e-4
"""


def test_a_search_that_has_not_converged_exits_with_3(tmp_path: Path):
    """Loads bend in the drag, which one step of Gauss and Newton does not know: far from the end.

    They are the numbers of a closed form, and known to 1e-3: what is left is not of rounding.
    """
    for period in (1.0, 2.0):
        measured = f"value = {spike_load(22.0, 6.0, period)}\ndeviation = 1e-3"
        change = f'changes = {{ "gait.period" = {period} }}'
        text = f'[[measured]]\nscalar = "spike_load_max"\n{measured}\n{change}\n'
        with (tmp_path / "fit.toml").open("a", encoding="utf-8") as file:
            file.write(text if period > 1.0 else UNFINISHED + text)
    path = tmp_path / "found"
    arguments = ["run", str(tmp_path / "fit.toml"), "--no-plots", "--quiet", "-o", str(path)]
    assert main(arguments) == 3
    found = Result.load(path)
    assert "search.steps" in found.reason
    (distance,) = [c for c in found.checks if c.name == "distance from the bottom"]
    assert distance.value is not None
    assert distance.value > 10 * distance.limit


@pytest.mark.slow
def test_keys_of_a_scene_are_found_from_single_numbers():
    """Load and drag from the largest spike load at two periods, by its closed form."""
    true = {"load": 22.0, "drag": 1.5}
    periods = {1.0: "fit", 2.0: "fit", 1.5: "predict"}
    measured = [
        {"scalar": "spike_load_max", "value": spike_load(**true, period=period),
         "deviation": 1e-3, "changes": {"gait.period": period}, "use": use}
        for period, use in periods.items()
    ]  # fmt: skip
    unknown = [{"name": "load", "key": "worm.load", "step": 1e-4},
               {"name": "drag", "key": "worm.drag", "lower": 0.0, "step": 1e-4}]  # fmt: skip
    scene = {"schema": 1, "kind": "fit-numbers", "model": {"scene": "fast_gait"},
             "measured": measured, "unknown": unknown}  # fmt: skip
    with using(Engine("serial")):
        result = wo.run(scene)
    assert result.status == "ok"
    # d(load of spikes) / d(load) = 3, d / d(drag) = 6 pi 0.15 2 drag / (T sqrt((3 pi/T)² + drag²))
    rows = np.array([[3.0, 6 * math.pi * 0.3 * 1.5 / (t * math.hypot(3 * math.pi / t, 1.5))]
                     for t in (1.0, 2.0)])  # fmt: skip
    errors = 1e-3 * np.sqrt(np.diag(np.linalg.inv(rows.T @ rows)))
    for (name, truth), error in zip(true.items(), errors, strict=True):
        assert result[name].value == pytest.approx(truth, abs=0.02 * error)
        assert result[f"{name}_error"].value == pytest.approx(error, rel=1e-3)
    assert result["fitted"].values[2] == pytest.approx(spike_load(**true, period=1.5), abs=1e-4)


test_numbers_that_no_scene_has_are_refused = refusals(
    "fit_channel_worm",
    """
    measured.0.scalar=velocity | measured | did you mean velocity_mean
    unknown.0.key=worm.densty | unknown | worm.densty is not a number of the scene
    unknown.0.start=-1.0 | unknown | has no logarithm
    measured.0.changes={"switching.rte"=1} | measured | switching.rte: unknown key
    """,
)


@pytest.mark.slow
def test_numbers_at_their_bounds_and_what_they_miss_are_reported(tmp_path: Path):
    """The rise of a body in a channel is the difference of their diameters."""
    text = """
schema = 1
kind = "fit-numbers"
units = "SI"
measured = [
  { scalar = "rise", value = 0.03, deviation = 1e-3 },
  { scalar = "rise", value = 0.02, deviation = 1e-3, changes = { "worm.length" = 0.1 } },
]
unknown = [{ name = "channel", key = "worm.channel", upper = 0.024 }]
model.kind = "channel-worm"
model.units = "SI"
model.worm = { pitch = 0.01, channel = 0.011, body = 0.004, length = 0.048 }
"""
    result = run_text(tmp_path, text)
    assert result.scalars["channel"].value == pytest.approx(0.024, rel=1e-9)
    warnings = result.trust["warnings"]
    assert "channel is at its bound" in warnings
    assert [text for text in warnings if text.startswith("rise is off by 10 standard deviations")]


def test_a_measurement_is_named_by_its_changes():
    one = Measured(scalar="rise", value=0.02, deviation=1e-3, changes={"worm.length": 0.1})
    assert one.name == "rise with worm.length = 0.1"


@pytest.mark.parametrize(("noise", "status"), [(0.1, "ok"), (0.005, "failed")])
def test_a_fit_that_does_not_describe_its_data_is_not_accepted(
    noise: float, status: str, tmp_path: Path
):
    """The readings swing by 0.1 about the decay that the model can do."""
    (tmp_path / "decay.py").write_text(
        "import casadi as ca, wormopt as wo\n"
        "def build():\n"
        "    x, rate = ca.SX.sym('x'), ca.SX.sym('rate')\n"
        "    return wo.Model('decay', [wo.Signal('x', x, value=1.0)], -rate * x,\n"
        "                    p=[wo.Signal('rate', rate, value=1.0)])\n"
    )
    time = np.linspace(0.0, 3.0, 40)
    rows = np.column_stack([time, np.exp(-time) + 0.1 * np.sin(2 * time)])
    np.savetxt(tmp_path / "run.csv", rows, delimiter=",", header="time,x", comments="")
    scene = {
        "schema": 1, "kind": "fit", "model": {"file": "decay.py:build"}, "noise": {"x": noise},
        "recording": [{"file": "run.csv"}], "unknown": [{"name": "rate"}], "search": {"seeds": 1},
    }  # fmt: skip
    result = wo.run(scene_within(tmp_path, "swinging", scene))
    assert result.status == status
    size = next(c.value for c in result.checks if c.name == "residuals over the noise given")
    assert size == pytest.approx(float(result["chi2_per_reading"].value) ** 0.5, rel=1e-6)


test_units_of_other_quantities_are_refused = refusals(
    "fit_chain",
    """
    recording.0.units={x0="20 ms"} | recording[0].units.x0 | is not a unit of length; write m
    recording.0.units={u0="mm"} | recording[0].units.u0 | is not a unit of force; write N
    recording.0.units={time="-0.21 mm"} | recording[0].units.time | not a unit of time; write s
    """,
)
