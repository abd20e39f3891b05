"""The main jobs in processes from which what only POSIX has is taken away, without a compiler.

See `without_posix/sitecustomize.py`. What this proves: nothing of the package asks for what Windows
lacks, its branches for Windows run, it replaces no file that it has open, and what it writes and
prints needs no UTF-8 locale. What it does not: names of files, ends of lines and how processes are
started are those of this system, for the standard library and loky stay as they are. On Windows
itself nothing is taken away, and the tests are what they seem.
"""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from places import TESTS

import wormopt as wo

FASTEST = 14 * 1394**0.5 / 125 - 839 / 250


def python(folder: Path, *arguments: str) -> str:
    """What a process prints in that folder; what it starts in turn is like it."""
    shim, package = TESTS / "without_posix", Path(wo.__file__).parents[1]
    env = os.environ | {
        "PYTHONPATH": os.pathsep.join(map(str, (shim, package))),
        "CC": "no-such-compiler",
        "PYTHONIOENCODING": "cp1252",  # the terminal's, which has no λ
        "LC_ALL": "C",
        "PYTHONCOERCECLOCALE": "0",
        "PYTHONUTF8": "0",  # so that files are not read in UTF-8 unless it is asked for
    }
    command = [sys.executable, *arguments]
    done = subprocess.run(command, cwd=folder, env=env, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr.decode(errors="replace")
    assert b"Traceback" not in done.stderr, done.stderr.decode(errors="replace")
    return done.stdout.decode("cp1252")


def test_a_gait_is_designed_and_drawn(tmp_path: Path):
    told = python(tmp_path, "-m", "wormopt", "run", "design_fast_gait", "--set", "want=['gait']",
                  "--set", "search.sequence=[[0],[1],[2]]")  # fmt: skip
    assert "speed          0.825667" in told
    (folder,) = (tmp_path / "results").iterdir()
    assert wo.Result.load(folder).scalars["speed"].value == pytest.approx(FASTEST, rel=1e-9)
    assert (folder / "gait.png").read_bytes().startswith(b"\x89PNG")


SWEEPS = """
from wormopt.cli import main
sweep = "sweep fast_gait --no-plots --over".split()
assert main([*sweep, "gait.period=[1,2]", "--workers", "2"]) == 0
assert main([*sweep, "gait.period=[1,2,3]", "--engine", "serial"]) == 0
"""


def test_a_sweep_by_two_processes_is_gone_on_with_and_replaced(tmp_path: Path):
    python(tmp_path, "-c", SWEEPS)
    found = wo.Result.load(tmp_path / "results" / "fast_gait-sweep")
    assert found["speed"].values.tolist() == pytest.approx([1.2, 0.6, 0.4], rel=1e-9)
    assert found.scalars["computed_now"].value == 1


SLIDE = """
import casadi as ca
import wormopt as wo
x, v, f = (ca.SX.sym(name) for name in "xvf")
block = wo.Model(
    "λ-block", x=[wo.Signal("position", x), wo.Signal("velocity", v, value=3.0)],
    ode=ca.vertcat(v, f), contacts=[wo.Contact("sole", v, f, wo.Coulomb(2.0, 2.0))],
)
motion = wo.simulate(block, 2.0)
print(motion.route, motion.end.tolist(), [event.time for event in motion.events])
"""


def test_a_block_slides_to_rest_by_steps_in_python(tmp_path: Path):
    (tmp_path / "slide.py").write_text(SLIDE, encoding="utf-8")
    route, told = python(tmp_path, "slide.py").split(maxsplit=1)
    assert route == "python"
    end, events = told.strip()[1:-1].split("] [")
    assert [float(part) for part in end.split(",")] == pytest.approx([2.25, 0.0], abs=1e-9)
    assert [float(part) for part in events.split(",")] == pytest.approx([1.5], abs=1e-9)


INTERRUPT = """
import signal, sys, threading, time
from wormopt.errors import _send_again
threading.Thread(target=_send_again, args=(signal.SIGINT,)).start()
try:
    for _ in range(1000):
        time.sleep(0.01)
except KeyboardInterrupt:
    print("interrupted")
"""


def test_an_interrupt_that_is_sent_again_does_not_end_the_process(tmp_path: Path):
    assert python(tmp_path, "-c", INTERRUPT) == "interrupted\n"


SEEN = "[w.sys.platform, hasattr(w.os, 'getuid'), hasattr(w.signal, 'pthread_sigmask')]"
SEE = f"""
from wormopt.numerics import workers as w
print({SEEN}, w.alone(eval, "(w := __import__('wormopt').numerics.workers) and {SEEN}"))
"""


def test_processes_and_their_workers_lack_what_windows_lacks(tmp_path: Path):
    assert python(tmp_path, "-c", SEE) == "['win32', False, False] ['win32', False, False]\n"
