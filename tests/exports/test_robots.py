"""Worms as robots of physics engines: the files against the scene, and the motion in MuJoCo."""

import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml
from exported import by_formula, gait_in, made
from places import SAVED

import wormopt as wo
from wormopt.cli import main
from wormopt.errors import ArgumentError
from wormopt.exports.export import Format
from wormopt.exports.play import Playback, play
from wormopt.result import Result
from wormopt.study.scene import load_scene
from wormopt.systems.chain import chain
from wormopt.systems.recorded.recordings import RecordingFile, runs_of

NO_MUJOCO = "MuJoCo is not installed (extra mujoco)"


@pytest.fixture(scope="session")
def bent() -> Result:
    """Three links that crawl by bending, slowly: friction 1 ahead and 3 sideways."""
    return Result.load(SAVED / "planar_three_link.nc")


@pytest.fixture(scope="session")
def turning() -> Result:
    """Two links that turn in place and exchange their lengths."""
    return Result.load(SAVED / "planar_turn_in_place.nc")


def numbers(element: ElementTree.Element | None, name: str) -> list[float]:
    assert element is not None
    return [float(word) for word in element.attrib[name].split()]


def parsed(result: Result, into: Format, folder: Path, **more) -> ElementTree.Element:
    return ElementTree.parse(wo.export(result, into, folder, **more)[0]).getroot()


def resistance(root: ElementTree.Element, i: int) -> tuple[float, float]:
    """Force that a mass needs to slide ahead, and back, on a line."""
    ground, push = root.find(f".//fixed[@name='ground_{i}']"), root.find(f".//*[@name='push_{i}']")
    loss = numbers(ground, "frictionloss")[0]
    force = numbers(push, "biasprm")[0]
    return loss - force, loss + force


# -- MJCF ------------------------------------------------------------------------------------------


def test_a_spiked_worm_has_the_masses_joints_and_loads_of_its_scene(fast: Result, tmp_path: Path):
    root = parsed(fast, "mjcf", tmp_path, step=0.01)
    bodies = [b for b in root.iter("body") if b.attrib["name"].startswith("mass_")]
    assert [numbers(b.find("inertial"), "mass") for b in bodies] == [[1.0]] * 3
    (message,) = wo.export(fast, "ros", tmp_path)
    named = yaml.safe_load(message.read_text("utf-8"))["joint_names"]
    assert [j.attrib["name"] for j in root.iter("joint") if "axis" in j.attrib] == ["x", *named]
    most = fast.scalars["spike_load_max"].value
    for i in range(3):
        ahead, back = resistance(root, i)
        assert ahead == pytest.approx(20.0)  # the load alone
        assert back > most - 20.0
        assert numbers(root.find(f".//fixed[@name='ground_{i}']"), "damping") == [1.0]


def test_keyframes_are_the_gait_and_repeat_after_its_cycle(walk: Result, tmp_path: Path):
    root = parsed(walk, "mjcf", tmp_path, step="10 ms")
    gait, keys = gait_in(walk), [*root.iter("key")]
    step = numbers(root.find("option"), "timestep")[0]
    assert step <= 0.01
    assert len(keys) * step == pytest.approx(gait.period, rel=1e-15)
    for k in (0, 1, 57, len(keys) - 1):
        control = numbers(keys[k], "ctrl")
        assert control[:2] == pytest.approx(by_formula(gait, k * step, 0), rel=1e-12)
        late = by_formula(gait, (k + 1) * step * (1 - 1e-15), 1)
        assert control[2:4] == pytest.approx(late, rel=1e-9, abs=1e-9)
    assert numbers(keys[0], "qpos") == pytest.approx([0.0, *by_formula(gait, 0.0, 0)])


def test_friction_that_differs_ahead_and_back_is_exact_on_a_line(tmp_path: Path):
    law = {"kind": "coulomb", "forward": 2.0, "backward": 9.0, "stick_backward": 11.0}
    scene = load_scene("spiked_chain", {"worm.friction": law, "worm.load": [0.5, 1.0, 0.0]})
    result = Result("walk", "simulate", scene_text=scene.text)
    root = parsed(result, "mjcf", tmp_path)
    expected = [(2.5, 8.5), (3.0, 8.0), (2.0, 9.0)]
    assert [resistance(root, i) for i in range(3)] == [pytest.approx(two) for two in expected]
    # links are the scene's springs, whose rest lengths are commanded
    assert [numbers(p, "kp") for p in root.iter("position")] == [[2000.0]] * 2
    links = [root.find(f".//joint[@name='link_{j}']") for j in range(2)]
    assert [numbers(link, "damping") for link in links] == [[40.0]] * 2
    assert "stiction" in (tmp_path / "walk.xml").read_text("utf-8")


def test_a_worm_on_dry_ground_has_the_friction_that_was_fitted(tmp_path: Path):
    root = parsed(Result.load(SAVED / "friction_gait.nc"), "mjcf", tmp_path)
    for i in range(3):  # 0.25 and 1.0 N in truth
        assert resistance(root, i) == pytest.approx((0.25, 1.0), rel=0.01)
    weights = [numbers(body.find("inertial"), "mass") for body in root.iter("body")]
    assert weights == [[0.2], [0.15], [0.2]]


def test_a_planar_worm_has_the_lengths_angles_and_friction_of_its_scene(
    bent: Result, turning: Result, tmp_path: Path
):
    root = parsed(bent, "mjcf", tmp_path)
    hinges = {"yaw", "joint_0", "joint_1", "heading_1", "heading_2"}
    assert {j.attrib["name"] for j in root.iter("joint") if j.get("type") == "hinge"} == hinges
    away = [numbers(root.find(f".//body[@name='mass_{i}']"), "pos") for i in range(4)]
    assert away == [[0, 0, 0], *[[-1.0, 0, 0]] * 3]
    for i, pair in enumerate(root.iter("pair")):
        foot = root.find(f".//joint[@name='foot_{i}']")
        (stiffness,), (at,) = (numbers(foot, name) for name in ("stiffness", "springref"))
        press = -stiffness * at
        assert np.array(numbers(pair, "friction")[:2]) * press == pytest.approx([1.0, 3.0])
    root = parsed(turning, "mjcf", tmp_path)
    names = [p.attrib["name"] for p in root.iter("position")]
    assert names == ["link_0", "link_1", "joint_0"]
    assert numbers(root.find(".//key"), "ctrl")[:3] == [1.0, 0.99, -1.2]


# -- URDF ------------------------------------------------------------------------------------------


def test_urdf_has_masses_joints_and_a_table_that_is_the_gait(walk: Result, tmp_path: Path):
    root = parsed(walk, "urdf", tmp_path, step=0.01)
    assert [float(m.attrib["value"]) for m in root.iter("mass")] == [1.0] * 3
    joints = {j.attrib["name"]: j for j in root.findall("joint")}
    assert [*joints] == ["link_0", "link_1"]
    gait = gait_in(walk)
    lengths = gait(np.linspace(0, gait.period, 5000))
    for joint, row in zip(joints.values(), lengths, strict=True):
        limit = joint.find("limit")
        assert numbers(limit, "lower")[0] < row.min() < row.max() < numbers(limit, "upper")[0]
    read = wo.load_gait(tmp_path / "fast_gait_joints.csv")
    assert read.period == gait.period
    assert np.abs(read(np.linspace(0, 2, 300)) - gait(np.linspace(0, 2, 300))).max() < 1e-4


def test_urdf_of_a_planar_worm_is_a_tree_of_its_masses(turning: Result, tmp_path: Path):
    root = parsed(turning, "urdf", tmp_path)
    edges = {
        j.attrib["name"]: (p.attrib["link"], c.attrib["link"])
        for j in root.findall("joint")
        for p, c in [(j.findall("parent")[0], j.findall("child")[0])]
    }
    assert edges == {
        "link_0": ("mass_0", "end_1"),
        "joint_0": ("end_1", "mass_1"),
        "link_1": ("mass_1", "mass_2"),
    }
    weights = {
        b.attrib["name"]: 9.80665 * float(b.findall(".//mass")[0].attrib["value"])
        for b in root.findall("link")
    }
    for gazebo, force in zip(root.findall("gazebo"), (1.0, 2.0, 1.0), strict=True):
        coefficient = float(gazebo.findtext("mu1", ""))
        assert coefficient * weights[gazebo.attrib["reference"]] == pytest.approx(force)


# -- refusals --------------------------------------------------------------------------------------


def test_results_without_such_a_robot_are_refused(tmp_path: Path):
    film = Result.load(SAVED / "film_basins.nc")
    constant = load_scene("spiked_chain", 'actuation={law="constant",force=1.0}')
    sliding = load_scene("planar_chain", 'ground={law="viscous",along=1.0,across=2.0}')
    for result, words in (
        (film, "holds no chain with targets of its joints"),
        (Result("walk", "simulate", scene_text=constant.text), "need commanded lengths"),
        (
            Result("walk", "planar-motion", scene_text=sliding.text),
            "do not support ground.law; use springs",
        ),
    ):
        for into in ("mjcf", "urdf"):
            with pytest.raises(ArgumentError, match=words):
                wo.export(result, into, tmp_path)
    assert not [*tmp_path.iterdir()]


def test_a_result_that_failed_early_is_written_all_the_same(bent: Result, tmp_path: Path):
    failed = Result("walk", bent.kind, status="failed", reason="torn", scene_text=bent.scene_text)
    (file,) = wo.export(failed, "mjcf", tmp_path)
    assert "DO NOT USE, the result failed: torn" in file.read_text("utf-8")
    whole = parsed(bent, "mjcf", tmp_path)
    kept = [key.attrib for key in ElementTree.parse(file).getroot().iter("key")]
    assert kept == [key.attrib for key in whole.iter("key")]


@pytest.mark.parametrize(("step", "words"), [(0.0, "positive"), (1e-9, "write a step of at least")])
def test_steps_are_checked(fast: Result, tmp_path: Path, step: float, words: str):
    with pytest.raises(ArgumentError, match=words):
        wo.export(fast, "mjcf", tmp_path, step=step)


def test_the_command_says_what_the_engine_lacks(
    fast: Result, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    fast.save(made(tmp_path / "r"))
    assert main(["export", str(tmp_path / "r"), "--mjcf", "--urdf", "-o", str(tmp_path)]) == 0
    out, err = capsys.readouterr()
    assert [Path(line).name for line in out.splitlines()] == [
        "fast_gait.xml",
        "fast_gait.urdf",
        "fast_gait_joints.csv",
    ]
    assert "fast_gait.xml: Differs from the scene: a spike holds" in err
    assert "fast_gait.urdf: Differs from the scene: drag and loads are missing." in err


# -- MuJoCo ----------------------------------------------------------------------------------------


def played(result: Result, steps: list[float], cycles: int = 2) -> list[Playback]:
    pytest.importorskip("mujoco", reason=NO_MUJOCO)
    return [play(result, step, cycles) for step in steps]


def test_play_says_how_to_install_mujoco(fast: Result, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(ArgumentError, match=r"pip install 'wormopt\[mujoco\]'"):
        play(fast)


@pytest.mark.parametrize("into", ["mjcf", "urdf"])
def test_mujoco_compiles_the_files_without_a_warning(
    into: Format, fast: Result, bent: Result, turning: Result, tmp_path: Path, monkeypatch, capfd
):
    mujoco = pytest.importorskip("mujoco", reason=NO_MUJOCO)
    monkeypatch.chdir(tmp_path)  # where MuJoCo writes its log
    for result, joints in ((fast, 2), (bent, 2), (turning, 3)):
        file = wo.export(result, into, tmp_path)[0]
        model = mujoco.MjModel.from_xml_path(str(file))
        names = {model.joint(j).name for j in range(model.njnt)}
        assert len({n for n in names if n.startswith(("link_", "joint_"))}) == joints
    assert not (tmp_path / "MUJOCO_LOG.TXT").exists()
    assert "".join(capfd.readouterr()) == ""


def test_a_spiked_worm_moves_in_mujoco_as_by_formula(fast: Result):
    """Gait (15) moves by 4 e l0 = 1.2 per cycle; the error is in proportion to the step."""
    errors = [abs(p.displacements[-1, 0] - 1.2) for p in played(fast, [0.01, 0.003, 0.001])]
    assert errors[0] < 0.1
    assert errors[1] < errors[0] / 2
    assert errors[2] < errors[1] / 2


@pytest.mark.slow
def test_an_elastic_chain_moves_in_mujoco_as_with_exact_contact():
    result = wo.run("spiked_chain")
    time, exact = result["time"].values, result["position"].values
    errors = []
    for motion in played(result, [0.01, 0.003, 0.001], cycles=5):
        here = motion.position[:, :, 0] - motion.position[0, 0, 0] + exact[0, 0]
        there = np.array([np.interp(motion.time, time, row) for row in exact]).T
        errors.append(np.abs(here - there).max())
    assert errors[0] < 0.15
    assert errors[1] < errors[0] / 2
    assert errors[2] < errors[1] / 2


@pytest.mark.slow
def test_planar_worms_move_in_mujoco_as_with_exact_contact(bent: Result, turning: Result):
    """Their bodies have a small mass in MuJoCo and none in the scene."""
    coarse, middle, fine = (motion.error for motion in played(bent, [0.01, 0.003, 0.001]))
    assert coarse < 0.02
    assert middle < coarse / 1.5
    assert fine < middle / 1.5
    coarse, fine = (motion.error for motion in played(turning, [0.01, 0.001]))
    assert fine < 0.05 < coarse


@pytest.mark.slow
def test_a_worm_of_springs_moves_in_mujoco_as_with_exact_contact():
    """Uphill, with friction 0.4 ahead and 1.2 back, which a controller sets in MuJoCo."""
    uphill = {"slope": 0.05, "gravity": 9.81}
    result = wo.run("planar_chain", {"worm": uphill, "time.end": 3.0})
    time, exact = result["time"].values, np.stack([result["x"].values, result["y"].values])
    errors = []
    for motion in played(result, [0.01, 0.003, 0.001], cycles=1):
        there = [[np.interp(motion.time, time, row) for row in rows] for rows in exact]
        errors.append(np.abs(motion.position - np.array(there).T).max())
    assert errors[0] < 0.05  # links have the length 1
    assert errors[1] < errors[0] / 2
    assert errors[2] < errors[1] / 2


def test_a_motion_in_mujoco_is_read_as_a_recording(fast: Result, tmp_path: Path):
    (motion,) = played(fast, [0.01])
    x = motion.position[:, :, 0]
    head = "time," + ",".join(f"position[{i}]" for i in range(3))
    np.savetxt(
        tmp_path / "run.csv",
        np.column_stack([motion.time, x]),
        delimiter=",",
        header=head,
        comments="",
    )
    worm = chain(2, mass=1.0, stiffness=1.0, damping=1.0, rest_length=2.0)
    (run,) = runs_of([RecordingFile(file="run.csv")], tmp_path, worm, "dimensionless", {}, "scene")
    assert np.array_equal(run.recording.readings["position"], x.T)


def test_joint_states_of_ros_are_read_as_a_recording(tmp_path: Path):
    """A bag as PlotJuggler writes it, with times since 1970."""
    names = [f"/joint_states/link_{j}/position" for j in range(2)]
    rows = ["1700000000.00,2.0,2.1", "1700000000.25,2.2,2.0", "1700000000.50,,1.9"]
    (tmp_path / "bag.csv").write_text("\n".join([",".join(["__time", *names]), *rows]), "utf-8")
    columns = {name: f"length[{j}]" for j, name in enumerate(names)}
    file = RecordingFile(file="bag.csv", time="__time", columns=columns)
    worm = chain(2, mass=1.0, stiffness=1.0, damping=1.0, rest_length=2.0)
    (run,) = runs_of([file], tmp_path, worm, "dimensionless", {}, "scene")
    found = run.recording.readings["length"]
    assert np.array_equal(found, [[2.0, 2.2, np.nan], [2.1, 2.0, 1.9]], equal_nan=True)
    assert np.diff(run.recording.times) == pytest.approx([0.25, 0.25])
