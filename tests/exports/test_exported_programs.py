"""Results as C, trajectories of ROS and FMUs, run by tools that are not ours."""

import ctypes
import re
import shutil
import subprocess
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import casadi as ca
import numpy as np
import pytest
import yaml
from exported import by_formula, gait_in, made, rough, swing
from hints import Capture, Patch
from scipy import special

import wormopt as wo
from wormopt.cli import main
from wormopt.exports.common import identifier
from wormopt.result import Result
from wormopt.study import load_scene

GCC = shutil.which("gcc")

needs_gcc = pytest.mark.skipif(GCC is None, reason="there is no gcc")


# -- C -------------------------------------------------------------------------------------------

STRICT = ("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror")


def compiled(folder: Path, sources: list[str], *flags: str) -> Path:
    built = folder / "built"
    call = [str(GCC), *STRICT, *flags, *sources, "-o", str(built), "-lm"]
    done = subprocess.run(call, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return built


@needs_gcc
@pytest.mark.parametrize("which", ["fast", "rough", "one link", "accordion"])
def test_c_gives_the_lengths_of_the_formulas(fast: Result, which: str, tmp_path: Path):
    constant = wo.Gait(np.array([0.0, 2.0]), np.array([[[1.5]]]))
    gaits = {"fast": gait_in(fast), "rough": rough(), "one link": rough(1), "accordion": constant}
    gait = gaits[which]
    wo.export(gait, "c", tmp_path / "walk.c")
    library = ctypes.CDLL(str(compiled(tmp_path, ["walk.c"], "-shared", "-fPIC")))
    assert ctypes.c_double.in_dll(library, "walk_cycle").value == gait.period
    at = np.random.default_rng(1).uniform(-3 * gait.period, 4 * gait.period, 500)
    found = np.empty((3, gait.links))
    pointers = [row.ctypes.data_as(ctypes.POINTER(ctypes.c_double)) for row in found]
    for t in [*at, *gait.breaks[:-1]]:
        library.walk_length(ctypes.c_double(t), *pointers)
        expected = np.array([by_formula(gait, t, d) for d in range(3)])
        assert np.abs(found - expected).max() <= 1e-12 * max(1.0, np.abs(expected).max())
    library.walk_length(ctypes.c_double(-1e-300), None, None, pointers[0])  # a null pointer is none
    assert np.allclose(found[0], by_formula(gait, 0.0, 2))
    library.walk_length(ctypes.c_double(np.nan), *pointers)
    assert np.all(np.isnan(found[0])) or gait is constant


@needs_gcc
def test_the_program_beside_it_tells_a_damaged_table(tmp_path: Path):
    wo.export(rough(), "c", tmp_path / "walk.c")
    program = compiled(tmp_path, ["walk.c", "walk_replay.c"])
    assert subprocess.run([program], capture_output=True, check=False).returncode == 0
    source = (tmp_path / "walk.c").read_text("utf-8")
    found = re.search(r"coefficient\[PIECES\]\[LINKS\]\[POWERS\] = \{\s+\{\s+\{\s+(\S+),", source)
    assert found is not None
    exact = float.fromhex(found[1])
    damaged = source.replace(found[1], (exact * (1 + 1e-9)).hex(), 1)
    (tmp_path / "walk.c").write_text(damaged, "utf-8")
    program = compiled(tmp_path, ["walk.c", "walk_replay.c"])
    assert subprocess.run([program], capture_output=True, check=False).returncode == 1


@needs_gcc
@pytest.mark.parametrize("name", ["2 λ-Würmer", "exp", "int", "a__b_", "my.gait", "*/ #error"])
def test_odd_names_and_titles_compile(fast: Result, name: str, tmp_path: Path):
    title = '*/ #error /* ??/ \\ "λ"\n\x07 %'
    odd = Result(name, "gait", title=title, variables=fast.variables).failed("no */ more")
    header, source, replay = wo.export(odd, "c", tmp_path)
    assert "failed: no * / more" in source.read_text("utf-8")
    program = compiled(tmp_path, [source.name, replay.name])
    assert subprocess.run([program], capture_output=True, check=False).returncode == 0
    if shutil.which("g++"):
        (tmp_path / "a.cpp").write_text(f'#include "{header.name}"\nint main() {{ return 0; }}\n')
        call = ["g++", "-std=c++11", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-c", "a.cpp"]
        assert subprocess.run(call, cwd=tmp_path, check=False).returncode == 0


def test_a_file_that_c_cannot_include_is_refused(tmp_path: Path):
    with pytest.raises(wo.ArgumentError, match="letters and digits"):
        wo.export(rough(), "c", tmp_path / 'a".c')


@pytest.mark.parametrize("name", ["walk", "2 walk", "λ", "__a__b__", "", "a-b c"])
def test_identifiers_are_such(name: str):
    assert re.fullmatch(r"[A-Za-z]([A-Za-z0-9]|_(?!_))*(?<!_)", identifier(name))


# -- ROS -----------------------------------------------------------------------------------------


KINDS = ("positions", "velocities", "accelerations")


@pytest.mark.parametrize(("step", "cycles"), [(0.01, 1), (0.1, 3), (1 / 3, 2)])
def test_ros_trajectory(step: float, cycles: int, tmp_path: Path):
    gait = rough()
    (file,) = wo.export(gait, "ros", tmp_path, step=step, cycles=cycles)
    message = yaml.safe_load(file.read_text("utf-8"))
    assert set(message) == {"header", "joint_names", "points"}
    assert message["header"] == {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
    assert message["joint_names"] == ["link_0", "link_1", "link_2"]
    times = [p["time_from_start"] for p in message["points"]]
    total = [t["sec"] * 10**9 + t["nanosec"] for t in times]
    assert total[-1] == round(gait.period * cycles * 1e9)
    assert total[:-1] == [round(k * step * 1e9) for k in range(len(total) - 1)]
    assert total[-1] - total[-2] <= step * 1e9
    assert all(0 <= t["nanosec"] < 10**9 for t in times)
    for point, nanoseconds in zip(message["points"][:-1], total[:-1], strict=True):
        assert set(point) == {*KINDS, "effort", "time_from_start"}
        for k, name in enumerate(KINDS):
            expected = by_formula(gait, nanoseconds / 1e9, k)
            assert np.allclose(point[name], expected, rtol=1e-9, atol=1e-9)


def points_of(file: Path) -> dict[str, np.ndarray]:
    points = yaml.load(file.read_text("utf-8"), yaml.CSafeLoader)["points"]
    times = [p["time_from_start"] for p in points]
    found = {name: np.array([p[name] for p in points]).T for name in points[0] if name[-1] == "s"}
    return found | {"t": np.array([t["sec"] + t["nanosec"] / 1e9 for t in times])}


@pytest.mark.parametrize("cycles", [1, 3])
def test_a_trajectory_that_begins_and_ends_at_rest(designed: Result, cycles: int, tmp_path: Path):
    (file,) = wo.export(designed, "ros", tmp_path, step=0.002, cycles=cycles, rest=True)
    gait, found = gait_in(designed), points_of(file)
    assert "# Begins and ends at rest" in file.read_text("utf-8")
    t, lengths, rates = found["t"], found["positions"], found["velocities"]
    assert t[-1] == pytest.approx(gait.period * (cycles + 0.5), abs=1e-9)
    for end in (0, -1):
        assert np.abs(rates[:, end]).max() < 1e-12
        assert lengths[:, end] == pytest.approx(gait(np.zeros(1))[:, 0], abs=1e-12)
    # no rate grows, and velocities are the slopes of the positions
    assert np.abs(rates).max() <= np.abs(gait(np.linspace(0, gait.period, 9999), 1)).max() + 1e-12
    way = np.cumsum((rates[:, 1:] + rates[:, :-1]) / 2 * np.diff(t), axis=1)
    accelerations = found["accelerations"]
    breaks = 13 * (cycles + 1)  # where accelerations jump
    most = breaks * np.abs(accelerations).max() * 0.002**2
    assert np.abs(lengths[:, 1:] - lengths[:, :1] - way).max() < most
    off = np.abs(np.gradient(rates, t, axis=1) - accelerations)
    assert np.quantile(off, 0.9) < 1e-2 * np.abs(accelerations).max()
    # between the ramps it is the gait
    middle = (t > gait.period / 2) & (t < t[-1] - gait.period / 2)
    assert np.abs(lengths[:, middle] - gait(t[middle] - gait.period / 4)).max() < 1e-9


def test_a_trajectory_that_does_not_end_at_rest_says_so(
    designed: Result, tmp_path: Path, capsys: Capture
):
    designed.save(made(tmp_path / "walk"))
    asked = ["export", str(tmp_path / "walk"), "--ros", "-o"]
    assert main([*asked, str(tmp_path / "a.yaml")]) == 0
    end = np.abs(gait_in(designed)(np.zeros(1), 1)).max()
    said = f"Ends at velocities up to {end:.3g} m/s"
    assert f"a.yaml: {said}" in capsys.readouterr().err
    text = (tmp_path / "a.yaml").read_text("utf-8")
    assert f"# {said}" in text
    assert "allow_nonzero_velocity_at_trajectory_end" in text
    assert main([*asked, str(tmp_path / "b.yaml"), "--rest", "--cycles", "2"]) == 0
    assert capsys.readouterr().err == ""


def test_a_trajectory_of_whole_ticks_repeats(walk: Result, tmp_path: Path):
    (file,) = wo.export(walk, "ros", tmp_path, step=0.01, cycles=2, whole_steps=True)
    found = points_of(file)
    assert found["t"] == pytest.approx(np.arange(249) / 100, abs=1e-12)
    assert found["positions"][:, :125] == pytest.approx(found["positions"][:, 124:], abs=1e-12)


def test_small_and_large_numbers_are_numbers_in_yaml(tmp_path: Path):
    gait = wo.Gait(np.array([0.0, 1.0]), np.array([[[1e-5, 2e22, -3e-17]]]))
    (file,) = wo.export(gait, "ros", tmp_path, step=1.0)
    first = yaml.safe_load(file.read_text("utf-8"))["points"][0]
    assert [first[kind][0] for kind in KINDS] == [1e-5, 2e22, -6e-17]


def test_ros_refuses_what_it_cannot_say(tmp_path: Path):
    slow = wo.Gait(np.array([0.0, 3e9]), np.ones((1, 1, 1)))
    for gait, step, cycles in ((rough(), 1e-10, 1), (rough(), 0.1, 0), (slow, 1e8, 1)):
        with pytest.raises(wo.ArgumentError):
            wo.export(gait, "ros", tmp_path, step=step, cycles=cycles)
    assert not [*tmp_path.iterdir()]


# -- FMI -----------------------------------------------------------------------------------------


def scalars(signals: Any) -> list[str]:
    return [s.name if s.size == 1 else f"{s.name}[{k}]" for s in signals for k in range(s.size)]


def replayed(fmu: Path, model: wo.Model, end: float, **given: Any) -> np.ndarray:
    """States at 11 instants, by FMPy with CVode, after a look at the FMU by its validator."""
    fmpy = pytest.importorskip("fmpy")
    assert pytest.importorskip("fmpy.validation").validate_fmu(str(fmu)) == []
    names = scalars(model.x)
    found = fmpy.simulate_fmu(
        str(fmu),
        fmi_type="ModelExchange",
        stop_time=end,
        output_interval=end / 4000,  # CVode takes 500 steps at most between two outputs
        relative_tolerance=1e-13,
        output=names,
        start_values=given,
    )
    return np.array([found[name][::400] for name in names])


def ours(model: wo.Model, end: float, v_reg: float = 1 / 40, **given: Any) -> np.ndarray:
    times, tolerance = np.linspace(0, end, 11), wo.Tolerance(1e-12, 1e-12)
    contact = wo.Smooth(v_reg)
    motion = wo.simulate(model, end, contact=contact, times=times, tolerance=tolerance, p=given)
    return motion.states


def worm() -> wo.Model:
    law = wo.Coulomb(1.0, 10.0)
    return wo.chain(2, mass=1.0, stiffness=10.0, damping=5.0, rest_length=2.0, law=law)


@pytest.mark.compiled
@pytest.mark.parametrize("version", ["fmu", "fmu2"])
def test_a_model_with_inputs_and_parameters(version: Literal["fmu", "fmu2"], tmp_path: Path):
    model = worm()
    (fmu,) = wo.export(model, version, tmp_path)
    assert fmu.name == "chain_of_2_links.fmu"
    given = {"input[0]": 3.0, "input[1]": -2.0, "mass[1]": 1.7, "v_reg": 0.1}
    found = replayed(fmu, model, 2.0, **given)
    expected = ours(model, 2.0, 0.1, input=[3.0, -2.0], mass=[1.0, 1.7, 1.0])
    assert np.abs(found - expected).max() < 1e-9
    assert np.abs(found[:3, -1] - found[:3, 0]).max() > 0.1  # it moves


@pytest.mark.slow
@pytest.mark.compiled
@pytest.mark.parametrize(("scene", "end"), [("fig05_lambda_trackers", 3.0), ("random_links", 2.0)])
def test_trackers_of_a_result(scene: str, end: float, tmp_path: Path):
    asked = load_scene(scene)
    result = Result(asked.name, "track", asked.title, scene_text=asked.text)
    fmus = wo.export(result, "fmu", tmp_path)
    models = asked.table.models()
    assert len(fmus) == len(models)
    for fmu, model in zip(fmus, models.values(), strict=True):
        v_reg = getattr(asked.table.contact, "v_reg", 1 / 40)
        found, expected = replayed(fmu, model, end), ours(model, end, v_reg)
        assert np.abs(found - expected).max() < 1e-9 * max(1.0, np.abs(expected).max())


@pytest.mark.compiled
@pytest.mark.parametrize(
    "scene", ["own_model", pytest.param("spiked_chain", marks=pytest.mark.slow)]
)
def test_a_simulated_model_that_time_moves(scene: str, tmp_path: Path):
    asked = load_scene(scene)
    result = Result(asked.name, "simulate", asked.title, scene_text=asked.text)
    (fmu,) = wo.export(result, "fmu", tmp_path)
    (model,) = asked.table.models().values()
    found = replayed(fmu, model, 1.0)
    assert np.abs(found - ours(model, 1.0)).max() < 1e-9


@pytest.mark.compiled
def test_time_alone_changes_what_an_fmu_gives(tmp_path: Path):
    """What CasADi's own wrapper forgets: time set alone, derivatives at a time, usual sizes."""
    fmpy = pytest.importorskip("fmpy")
    (fmu,) = wo.export(swing(), "fmu", tmp_path)
    description = fmpy.read_model_description(str(fmu))
    references = {v.name: v.valueReference for v in description.modelVariables}
    assert "'speed of it, _3bb_'" in references
    unit = {v.name: v.unit for v in description.modelVariables}
    assert (unit["place"], unit["pull"], unit["time"]) == ("m", "m s-2", "s-3")
    folder = fmpy.extract(str(fmu), unzipdir=str(tmp_path / "open"))
    names = {"modelIdentifier": description.modelExchange.modelIdentifier, "instanceName": "swing"}
    instance = pytest.importorskip("fmpy.fmi3").FMU3Model(
        guid=description.instantiationToken, unzipDirectory=folder, **names
    )
    instance.instantiate()
    instance.enterInitializationMode(startTime=3.0)
    pulled = instance.getFloat64([references["pull"], references["time_"]])
    assert pulled == [2.0 * 0.5 * 3.0, 3.0]
    instance.exitInitializationMode()
    instance.setTime(7.0)
    assert instance.getFloat64([references["pull"], references["time_"]]) == [7.0, 7.0]
    pull, place = references["pull"], references["place"]
    assert instance.getDirectionalDerivative([pull], [place], [1.0]) == [14.0]
    sizes = (ctypes.c_double * 2)()
    instance.getNominalsOfContinuousStates(sizes, 2)
    assert [*sizes] == [3.0, 1.0]
    instance.terminate()
    instance.freeInstance()


@pytest.mark.compiled
@pytest.mark.parametrize("version", ["fmu", "fmu2"])
def test_co_simulation_is_the_motion_whatever_the_steps(
    version: Literal["fmu", "fmu2"], tmp_path: Path
):
    fmpy = pytest.importorskip("fmpy")
    model = worm()
    (fmu,) = wo.export(model, version, tmp_path)
    given: dict[str, Any] = {"input[0]": 3.0, "input[1]": -2.0, "v_reg": 0.1}
    expected = ours(model, 2.0, 0.1, input=[3.0, -2.0])
    for interval, tolerance, limit in ((0.2, 1e-10, 1e-8), (0.02, 1e-10, 1e-8), (0.2, 1e-4, 1e-2)):
        names = scalars(model.x)
        found = fmpy.simulate_fmu(
            str(fmu),
            fmi_type="CoSimulation",
            stop_time=2.0,
            output_interval=interval,
            relative_tolerance=tolerance,
            output=names,
            start_values=given,
        )
        every = round(0.2 / interval)
        states = np.array([found[name][::every] for name in names])
        assert np.abs(states - expected).max() < limit


@pytest.mark.compiled
def test_co_simulation_stops_where_a_derivative_is_no_number(tmp_path: Path):
    """x' = sqrt(1 - t) ends at 1, whatever the states after it do."""
    fmpy = pytest.importorskip("fmpy")
    t, x, y = (ca.SX.sym(name) for name in "txy")
    states = [wo.Signal("x", x, value=0.0), wo.Signal("y", y, value=0.0)]
    model = wo.Model("ending", states, ca.vertcat(ca.sqrt(1 - t), 1), t=t)
    (fmu,) = wo.export(model, "fmu", tmp_path)
    with pytest.raises(pytest.importorskip("fmpy.fmi1").FMICallException, match="fmi3DoStep"):
        fmpy.simulate_fmu(str(fmu), fmi_type="CoSimulation", stop_time=2.0, output_interval=1.5)


@pytest.mark.compiled
def test_a_saved_state_of_an_fmu_is_restored(tmp_path: Path):
    """The swing's x'' = -2 t x from 0.5 at time 0, stepped twice over the same interval."""
    fmpy = pytest.importorskip("fmpy")
    (fmu,) = wo.export(swing(), "fmu", tmp_path)
    description = fmpy.read_model_description(str(fmu))
    place = next(v.valueReference for v in description.modelVariables if v.name == "place")
    instance = pytest.importorskip("fmpy.fmi3").FMU3Slave(
        guid=description.instantiationToken,
        unzipDirectory=fmpy.extract(str(fmu), unzipdir=str(tmp_path / "open")),
        modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName="swing",
    )
    instance.instantiate()
    instance.enterInitializationMode(tolerance=1e-9, startTime=0.0)
    instance.exitInitializationMode()
    instance.doStep(0.0, 1.0)
    saved = instance.getFMUState()
    places = []
    for _ in range(2):
        instance.doStep(1.0, 1.0)
        places += instance.getFloat64([place])
        instance.setFMUState(saved)
    instance.freeFMUState(saved)
    assert places[0] == places[1]
    airy = special.airy(-(2 ** (1 / 3)) * np.array([0.0, 2.0]))  # Ai, Ai', Bi, Bi'
    amplitudes = np.linalg.solve([[airy[0][0], airy[2][0]], [airy[1][0], airy[3][0]]], [0.5, 0.0])
    assert places[0] == pytest.approx(amplitudes @ [airy[0][1], airy[2][1]], abs=1e-7)
    instance.terminate()
    instance.freeInstance()


@pytest.mark.compiled
def test_all_functions_of_fmi_2_are_there(tmp_path: Path):
    """Derivatives and saved states of the swing x'' = -2 t x; FMPy looks for every function."""
    fmpy = pytest.importorskip("fmpy")
    (fmu,) = wo.export(swing(), "fmu2", tmp_path)
    description = fmpy.read_model_description(str(fmu))
    at = {v.name: v.valueReference for v in description.modelVariables}
    folder = fmpy.extract(str(fmu), unzipdir=str(tmp_path / "open"))
    instance = pytest.importorskip("fmpy.fmi2").FMU2Model(
        guid=description.guid, unzipDirectory=folder, instanceName="swing",
        modelIdentifier=description.modelExchange.modelIdentifier,
    )  # fmt: skip
    instance.instantiate()
    instance.setupExperiment(startTime=3.0)
    instance.enterInitializationMode()
    assert instance.getReal([at["pull"], at["time_"]]) == [2.0 * 0.5 * 3.0, 3.0]
    instance.exitInitializationMode()
    saved = instance.getFMUState()
    instance.setTime(7.0)
    assert instance.getReal([at["pull"], at["time_"]]) == [7.0, 7.0]
    assert instance.getDirectionalDerivative([at["pull"]], [at["place"]], [1.0]) == [14.0]
    assert [*instance.completedIntegratorStep()] == [0, 0]
    instance.setFMUState(saved)
    assert instance.getReal([at["time_"]]) == [3.0]
    instance.freeFMUState(saved)
    sizes = (ctypes.c_double * 2)()
    instance.getNominalsOfContinuousStates(sizes, 2)
    assert [*sizes] == [3.0, 1.0]
    for nothing in ("getInteger", "getBoolean", "getString"):
        assert [*getattr(instance, nothing)([])] == []
    instance.terminate()
    instance.freeInstance()


def test_both_versions_at_once_are_refused(tmp_path: Path):
    with pytest.raises(wo.ArgumentError, match="one after another"):
        wo.export(swing(), ["fmu", "fmu2"], tmp_path)


@pytest.mark.compiled
def test_the_sources_compile_with_the_headers_of_the_standard(tmp_path: Path):
    fmpy = pytest.importorskip("fmpy")
    (fmu,) = wo.export(swing(), "fmu", tmp_path)
    zipfile.ZipFile(fmu).extractall(tmp_path)
    assert not (tmp_path / "sources" / "fmi3Functions.h").exists()
    headers = Path(str(fmpy.__file__)).parent / "c-code"
    call = [str(GCC), "-std=c11", "-fPIC", "-shared", f"-I{headers}", "-o", "again.so"]
    sources = [str(path) for path in (tmp_path / "sources").glob("*.c")]
    assert len(sources) == 2
    assert subprocess.run([*call, *sources, "-lm"], cwd=tmp_path, check=False).returncode == 0


def test_models_that_no_fmu_can_be_are_refused(tmp_path: Path):
    scene = load_scene("fig05_lambda_trackers")
    (model, _) = scene.table.models().values()
    x = ca.vertcat(*(s.symbol for s in model.x))
    jumps = wo.Switch("turn", x[0] - 1, -x)
    with pytest.raises(wo.ArgumentError, match="'turn' changes states or ends"):
        wo.export(replace(model, switches=[jumps]), "fmu", tmp_path)
    z = wo.Signal("z", ca.SX.sym("z"))
    with pytest.raises(wo.ArgumentError, match="algebraic"):
        wo.export(replace(swing(), z=[z], alg=z.symbol - 1), "fmu", tmp_path)
    assert not [*tmp_path.iterdir()]


@pytest.mark.compiled
def test_one_state_and_nothing_else(tmp_path: Path):
    x = ca.SX.sym("x")
    seen = wo.Switch("half of it", 0.5 - x, x)  # tells, and moves nothing
    model = wo.Model("exp", x=[wo.Signal("x", x, value=1.0)], ode=-x, switches=[seen])
    (fmu,) = wo.export(model, "fmu", tmp_path)
    found = replayed(fmu, model, 1.0)
    assert np.abs(found - np.exp(-np.linspace(0, 1, 11))).max() < 1e-10


@pytest.mark.parametrize("text", ["", "[]", '{"kind": "gait"}', '{"kind": "simulate"}', "{"])
def test_a_result_that_does_not_say_its_scene_is_refused(text: str, tmp_path: Path):
    result = Result("walk", "simulate", scene_text=text)
    with pytest.raises(wo.SceneError, match=r"run it again|missing"):
        wo.export(result, "fmu", tmp_path)


def test_without_a_compiler_there_is_no_fmu(tmp_path: Path, monkeypatch: Patch):
    monkeypatch.setattr("wormopt.exports.fmu.compiler", lambda: None)
    with pytest.raises(wo.ArgumentError, match="needs a C compiler"):
        wo.export(swing(), "fmu", tmp_path)
