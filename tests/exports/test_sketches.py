"""Gaits as sketches and C in single precision, compiled for AVR and run on this machine."""

import ctypes
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from exported import by_formula, gait_in, made, rough
from hints import Capture

import wormopt as wo
from wormopt.cli import main
from wormopt.result import Result

GCC, AVR = shutil.which("gcc"), shutil.which("avr-gcc")
STRICT = ("-Wall", "-Wextra", "-Wpedantic", "-Werror")

# As much of Arduino's interface as a sketch uses; the test turns the clock and reads the pulses.
ARDUINO = """
#pragma once
#include <stddef.h>
#include <stdint.h>
extern uint32_t now;
inline unsigned long micros() { return now; }
void setup();
void loop();
"""
SERVO = """
#pragma once
#include "Arduino.h"
extern int pulses[16];
class Servo {
  public:
    void attach(int pin) { at = pin - 2; }
    void writeMicroseconds(int pulse) { pulses[at] = pulse; }
  private:
    int at;
};
"""
PLAYED = """
#include "Arduino.h"
uint32_t now;
int pulses[16];
#include "{name}.ino"
extern "C" void begin(uint32_t time) {{ now = time; setup(); }}
extern "C" const int* pass(uint32_t time) {{ now += time; loop(); return pulses; }}
"""


def stubs(folder: Path, name: str) -> None:
    (folder / "Arduino.h").write_text(ARDUINO)
    (folder / "Servo.h").write_text(SERVO)
    (folder / "played.cpp").write_text(PLAYED.format(name=name))


def call(folder: Path, *words: str | None) -> str:
    done = subprocess.run(
        [*map(str, words)], cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def built(folder: Path, name: str) -> ctypes.CDLL:
    """The sketch as a library of this machine."""
    stubs(folder, name)
    call(folder, GCC, "-std=c99", *STRICT, "-fPIC", "-c", f"{name}.c")
    call(folder, "g++", "-std=c++11", *STRICT, "-I.", "-fPIC", "-shared", "played.cpp",
         f"{name}.o", "-o", "played.so")  # fmt: skip
    return ctypes.CDLL(str(folder / "played.so"))


def sizes(gait: wo.Gait) -> list[float]:
    """Sums of the sizes of all terms of lengths, rates, accelerations, jerks."""
    h = float(np.diff(gait.breaks).max())
    found = []
    for derivative in range(4):
        whole = np.abs(gait.polynomial)
        for _ in range(derivative):
            whole = whole[..., 1:] * np.arange(1, whole.shape[-1])
        size = whole @ h ** np.arange(whole.shape[-1])
        if gait.omega is not None and gait.cosine is not None and gait.sine is not None:
            swing = np.abs(gait.cosine) + np.abs(gait.sine)
            size = size + swing * gait.omega[:, None] ** derivative
        found.append(float(size.max()))
    return found


needs_gcc = pytest.mark.skipif(GCC is None or not shutil.which("g++"), reason="there is no g++")


@needs_gcc
@pytest.mark.parametrize("which", ["fast", "rough", "designed", "table"])
def test_single_precision_gives_the_lengths_of_the_formulas(
    fast: Result, designed: Result, walk: Result, which: str, tmp_path: Path
):
    if which == "table":
        (file,) = wo.export(walk, "csv", tmp_path / "links.csv", step="10 ms")
        gait = wo.load_gait(file)
        assert gait.pieces > 100
    else:
        gait = {"fast": gait_in(fast), "rough": rough(), "designed": gait_in(designed)}[which]
    wo.export(gait, "arduino", tmp_path / "walk.ino")
    library = built(tmp_path / "walk", "walk")
    found = np.empty((3, gait.links), np.float32)
    rows = [row.ctypes.data_as(ctypes.POINTER(ctypes.c_float)) for row in found]
    size, digit = sizes(gait), float(np.finfo(np.float32).eps)
    terms = 2 * gait.polynomial.shape[2] + 12
    for t in np.random.default_rng(1).uniform(0.0, gait.period, 300).astype(np.float32):
        if np.abs(gait.breaks - t).min() < 1e-5 * gait.period:
            continue  # the times of breaks are rounded, too
        library.walk_length(ctypes.c_float(t), *rows)
        for d in range(3):
            rounding = terms * size[d] + 2 * gait.period * size[d + 1]
            assert np.abs(found[d] - by_formula(gait, float(t), d)).max() <= digit * rounding


@needs_gcc
def test_the_sketch_plays_the_gait_on_its_servos(walk: Result, tmp_path: Path):
    gait = gait_in(walk)
    wo.export(walk, "arduino", tmp_path / "walk.ino")
    library = built(tmp_path / "walk", "walk")
    played = library["pass"]
    played.restype = ctypes.POINTER(ctypes.c_int)
    lengths = gait(np.linspace(0.0, gait.period, 20001))
    low, high = lengths.min(axis=1), lengths.max(axis=1)
    fastest = np.abs(gait(np.linspace(0.0, gait.period, 20001), 1)).max(axis=1)
    library.begin(ctypes.c_uint32(2**32 - 700_000))  # the clock begins anew during the motion
    time, shown, seen = 0, 0, set[tuple[int, ...]]()
    for step in np.random.default_rng(2).integers(1_000, 30_000, 300).tolist():
        time += step
        shown = time if time - shown >= 20_000 else shown  # a pulse every 20 ms
        pulses = np.array(played(step)[: gait.links])
        wanted = 1000 + 1000 * (gait(np.array([shown * 1e-6]))[:, 0] - low) / (high - low)
        # half a microsecond of the pulse, and half of one of the cycle in each round
        rounds = 1 + time * 1e-6 / gait.period
        assert np.all(
            np.abs(pulses - wanted) <= 0.51 + 1e3 * rounds * 1e-6 * fastest / (high - low)
        )
        seen.add(tuple(pulses.tolist()))
    assert time * 1e-6 > 3 * gait.period
    assert len(seen) > 100


@pytest.mark.skipif(AVR is None, reason="there is no avr-gcc")
def test_a_sketch_compiles_for_avr_with_its_tables_in_the_program(designed: Result, tmp_path: Path):
    wo.export(designed, "arduino", tmp_path)
    folder = tmp_path / "certified_gait"
    stubs(folder, folder.name)
    board = ("-mmcu=atmega328p", "-Os", *STRICT)
    call(folder, AVR, *board, "-std=c99", "-c", f"{folder.name}.c")
    call(folder, AVR, *board, "-std=c++11", "-I.", "-c", "played.cpp")
    (folder / "main.c").write_text(
        "void begin(long); void pass(long);\nint main(void) { begin(0); for (;;) pass(20000); }\n"
    )
    call(folder, AVR, *board, "main.c", "played.o", f"{folder.name}.o", "-lm", "-o", "sketch.elf")
    *_, line = call(folder, "avr-size", "sketch.elf").splitlines()
    program, data, zeros = map(int, line.split()[:3])
    tables = 4 * sum(array.size for array in gait_in(designed).arrays().values())
    assert tables < program < 32_256
    assert data + zeros < 200


def test_a_sketch_has_a_folder_of_its_own(fast: Result, tmp_path: Path, capsys: Capture):
    fast.save(made(tmp_path / "walk"))
    asked = ["export", str(tmp_path / "walk"), "--arduino", "--c", "-o", str(tmp_path / "out")]
    assert main(asked) == 0
    found = sorted(
        str(path.relative_to(tmp_path / "out")) for path in (tmp_path / "out").rglob("*.*")
    )
    assert found == ["fast_gait.c", "fast_gait.h", "fast_gait/fast_gait.c", "fast_gait/fast_gait.h",
                     "fast_gait/fast_gait.ino", "fast_gait_replay.c"]  # fmt: skip
    for named in ("2 legs/gait_2_legs.ino", "gait_2_legs/gait_2_legs.ino", "gait_2_legs.ino"):
        (tmp_path / named).parent.mkdir(exist_ok=True)
        wo.export(fast, "arduino", tmp_path / named, force=True)
        folder = (tmp_path / named).parent
        folder = folder if folder.name == "gait_2_legs" else folder / "gait_2_legs"
        assert {file.suffix for file in folder.iterdir()} == {".ino", ".h", ".c"}
    assert main([*asked, "--step", "0.1"]) == 2
    assert "step has no effect on arduino, c" in capsys.readouterr().err


def test_a_cycle_that_no_clock_counts_is_refused(tmp_path: Path):
    for period in (1e-7, 2200.0):
        slow = wo.Gait(np.array([0.0, period]), np.ones((1, 1, 1)))
        with pytest.raises(wo.ArgumentError, match="clock of a sketch"):
            wo.export(slow, "arduino", tmp_path)
    large = wo.Gait(np.array([0.0, 1.0]), np.full((1, 1, 1), 1e39))
    with pytest.raises(wo.ArgumentError, match="32-bit numbers; choose larger units"):
        wo.export(large, "arduino", tmp_path)
    assert not [*tmp_path.iterdir()]
