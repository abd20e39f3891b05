"""Hostile use: spoiled scenes end with an answer or a refusal, and so do runs in bad places."""

import gc
import json
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from effort import examples

import wormopt as wo
from tests.stress import fuzz
from wormopt.cli import main
from wormopt.errors import SceneError
from wormopt.numerics.workers import Engine, using
from wormopt.study import load_scene, packaged_scenes
from wormopt.study.scene import packaged_folder

unix = pytest.mark.skipif(sys.platform == "win32", reason="has no such limits and signals")


def refusal(name: str, *changes: str | dict) -> str:
    """What is told of a packaged scene with changes."""
    with pytest.raises(SceneError) as caught:
        load_scene(name, changes)
    return str(caught.value)


@pytest.mark.parametrize("part", [0, 1, *(pytest.param(n, marks=pytest.mark.slow) for n in (2, 3))])
def test_spoiled_scenes_are_read_or_refused(part: int, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(packaged_folder())
    names, verdicts = sorted(packaged_scenes()), {"accepted": 0, "refused": 0}
    count = examples(450)
    for number in range(part * count, (part + 1) * count):
        scene = fuzz.spoiled(names, 3, number)
        verdict, wrong = fuzz.checked(scene)
        assert not wrong, (number, scene.name, scene.told)
        verdicts[verdict] += 1
    assert min(verdicts.values()) > count / 20


def test_the_same_number_gives_the_same_scene():
    names = sorted(packaged_scenes())
    scene = fuzz.spoiled(names, 5, 17)
    fuzz.spoiled(names, 5, 18)
    assert fuzz.spoiled(names, 5, 17) == scene != fuzz.spoiled(names, 6, 17)


@pytest.mark.parametrize(
    ("name", "change", "told"),
    [
        # what the fuzzer found: tables in lists of bounded length, numbers that overflow,
        # names that no file can have, letters that terminals obey
        ("gait_shift", "gears.2.length=[0.8, nan]", "gears[2].length[1]: nan is not allowed"),
        ("planar_path", "gaits.2.amplitudes=[0.5, 'x']", 'gaits[2].amplitudes[1]: "x"'),
        ("gait_shift", "gears=[]", "gears: 0 entries are not allowed; write a list of 2 to 8"),
        ("planar_block", f"block.heading=1{'0' * 400}", "block.heading: 1000"),
        ("planar_path", "obstacles.0.corners.0=[1e300, 0]", "too large for computing"),
        ("fig21_rod_motion", "coils.pitch=5e-324", "coils.pitch: 4.94066e-324 is too small"),
        ("fig21_rod_motion", {"coils": {"\x1b[2J": 1}}, 'coils."?[2J": unknown key'),
        ("fit_pair", f"recording.0.file={'x' * 5000}", "there is no file"),
        ("fit_pair", {"recording": [{"file": "pair\x1b.csv"}]}, "pair?.csv"),
        ("gait_region", "loads.0=5e-324", "loads"),
        ("fast_gait", "gait.period=1e-31", "gait.period: 1e-31 is too small for computing"),
        ("design_fast_gait", "gait.period=1e31", "gait.period: 1e+31 is too large"),
    ],
)
def test_what_once_ended_in_a_traceback_is_refused(name: str, change: str | dict, told: str):
    assert told in refusal(name, change)


def test_an_angle_in_degrees_is_still_guessed():
    assert 'for example "45 deg"' in refusal("fast_gait", "worm.slope=45")


@pytest.mark.slow
@pytest.mark.parametrize("drag", [0.0, 0.1])
def test_a_worm_of_which_nothing_slows_the_moving_mass_is_told_so(drag: float):
    """All but one rest, so m v' >= -k v, which reaches 0 at no time; a load of 1e-3 is enough."""
    worm = wo.Worm(links=2, drag=drag)
    limits = wo.Limits(period=1.0, length=(0.7, 1.3), rate=1.0, acceleration=20.0, resting=2)
    with pytest.raises(wo.SolveError, match=r"no gait advances.*write worm.load above 0"):
        wo.design(worm, limits)
    assert wo.design(worm.vary(load=1e-3), limits).speed > 0


@pytest.mark.slow
def test_spoiled_scenes_that_are_accepted_run_to_an_end(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(packaged_folder())
    for number, scene in fuzz.accepted(40, seed=4, first=0):
        end, wrong = fuzz.ran(scene)
        assert not wrong, (number, scene.name, scene.told, end)


def command(folder: Path, name: str = "slide", *more: str) -> list[str]:
    """A run on the command line."""
    run = [sys.executable, "-m", "wormopt", "run", name, "--quiet", "--engine", "serial"]
    return [*run, "-o", str(folder), *more]


def full_disk() -> None:
    """Let no file grow beyond a kilobyte; who writes on gets an error, as on a full disk."""
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))


@unix
@pytest.mark.slow
@pytest.mark.parametrize("there", [False, True])
def test_a_full_disk_is_told_and_leaves_what_was_there(tmp_path: Path, there: bool):
    folder = tmp_path / "out"
    if there:
        subprocess.run(command(folder), check=True, capture_output=True)
    before = {path.name: path.read_bytes() for path in folder.glob("*")}
    told = subprocess.run(command(folder), capture_output=True, text=True, preexec_fn=full_disk)
    assert told.returncode == 2
    assert "Traceback" not in told.stderr
    assert "File too large" in told.stderr
    assert {path.name: path.read_bytes() for path in folder.glob("*")} == before
    assert {path.name for path in tmp_path.iterdir()} == ({"out"} if there else set())


@unix
@pytest.mark.slow
def test_output_to_a_full_device_is_told(tmp_path: Path):
    with Path("/dev/full").open("w") as full:
        told = subprocess.run(
            command(tmp_path / "out", "slide", "--json"), stdout=full, stderr=subprocess.PIPE,
            text=True,
        )  # fmt: skip
    assert told.returncode == 2
    assert "Traceback" not in told.stderr
    assert "No space left" in told.stderr
    assert wo.Result.load(tmp_path / "out").status == "ok"  # saved before it was told


@unix
@pytest.mark.slow
def test_a_killed_run_leaves_the_earlier_result_and_no_process(tmp_path: Path):
    folder = tmp_path / "out"
    earlier = subprocess.run(command(folder, "design_five_links", "--no-plots", "--set",
                                     "search.time_limit=1"), capture_output=True)  # fmt: skip
    assert earlier.returncode in (0, 3)
    before = {path.name: path.read_bytes() for path in folder.glob("*")}
    again = [c for c in command(folder, "design_five_links", "--no-plots") if c != "serial"]
    again = [c if c != "--engine" else "--engine=processes" for c in again]
    with subprocess.Popen([*again, "--workers", "2"], start_new_session=True) as run:
        time.sleep(6)
        assert run.poll() is None
        run.kill()
    begin = time.monotonic()
    while subprocess.run(["pgrep", "-s", str(run.pid)], capture_output=True).returncode == 0:
        assert time.monotonic() - begin < 10
        time.sleep(0.1)
    assert {path.name: path.read_bytes() for path in folder.glob("*")} == before


STATUS = Path("/proc/self/status")


def allocated() -> float:
    """Kilobytes that this process has written, in memory or swapped out.

    Pages of files are left out: when memory is short, they come and go.
    """
    sizes = dict(line.split(":", 1) for line in STATUS.read_text().splitlines())
    return sum(float(sizes[name].split()[0]) for name in ("RssAnon", "VmSwap"))


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.skipif(not STATUS.exists(), reason="Linux reports memory there")
def test_a_thousand_runs_in_one_process_keep_their_memory():
    """The first 400 fill caches; of the other 600 each leaves less than 6 kB behind."""
    names = ["slide", "fast_gait", "uphill_gait", "own_model", "capsule"]
    done, held = [], []
    with using(Engine("serial")):
        for number in range(1000):
            result = wo.run(names[number % len(names)])
            assert json.dumps(result.summary(), allow_nan=False)
            if number >= 399 and number % 25 == 24:
                gc.collect()
                done.append(number)
                held.append(allocated())
    growth, _ = np.polyfit(done, held, 1)
    assert growth < 6, held


def test_what_needs_more_memory_than_there_is_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    def run(*_: object) -> None:
        raise MemoryError

    monkeypatch.setattr("wormopt.systems.spiked.gait.crawl", run)
    assert main(["run", "fast_gait", "--quiet", "--json", "-o", str(tmp_path / "out")]) == 3
    out = capsys.readouterr()
    assert "Traceback" not in out.err
    assert "out of memory" in json.loads(out.out)["reason"]
