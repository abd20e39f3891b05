"""Packaged scenes, spoiled at random: does every one end with an answer or a refusal?

`python -m tests.stress.fuzz check 50000` reads as many in this process, `python -m
tests.stress.fuzz run 300` computes those of cheap scenes that are accepted, each in a new process.
Both print faults: errors that no user can read, results that are not numbers, runs that do not
end. `--seed 7` draws others, `--first 120` leaves out those before; a number gives the same scene
whatever is drawn before it.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import resource
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from copy import deepcopy
from dataclasses import dataclass, field
from functools import cache, partial
from pathlib import Path
from typing import Any

from wormopt.errors import ArgumentError, SceneError
from wormopt.files import RESULT_FILE, SUMMARY_FILE
from wormopt.study import Scene, load_scene, packaged_scenes
from wormopt.study.scene import packaged_folder, times_of_scenes
from wormopt.study.toml import toml_text

NUMBERS = [
    0, -1, 1, 2, -0.0, 0.5, 1e-300, 5e-324, 1e-30, 1e-9, 1e9, 1e30, 1e300, 1.8e308, -1e300,
    float("inf"), float("-inf"), float("nan"), 2**31, 2**63, 10**400, -(2**64),
]  # fmt: skip
OTHERS = [
    "", "x", "nan", "1 m", "-3 m/s^2", "1e999 m", "λ", "../..", "a\x00b", "\u202e", "x" * 10_000,
    True, False, [], {}, [[]], [1.0], [1.0, 2.0], [0.0] * 1000, ["a", 1], {"kind": "spike"},
    [{"a": 1}], {"": 0},
]  # fmt: skip
FACTORS = [-1.0, 0.1, 0.5, 0.99, 1.01, 2.0, 10.0, 1e3, 1e6, 1e-3, 1e-6]

CHEAP = 3  # seconds that a scene takes which is computed here, as `times.json` says
# that a run may take: seconds of a processor that counts squares as below, beside the limits of
# time that its scene has; bytes
SECONDS, BYTES = 180, 6 * 2**30
A_MILLION_SQUARES = 0.07  # seconds
BUSY = 10  # so many times longer it may take by the clock, on a machine that does other things
SLOW_CHECK = 2.0  # seconds


@dataclass(frozen=True)
class Spoiled:
    """A scene with something wrong in it, or only odd."""

    name: str
    tables: dict[str, Any]
    overrides: list[str] = field(default_factory=list)
    told: str = ""

    def load(self) -> Scene[Any]:
        """Read it, as `wormopt check` and `run --set` do."""
        return load_scene(self.tables, self.overrides, name=self.name)


Place = tuple[Any, Any]  # a table or list, and the key or index in it


def places(tables: Any) -> Iterator[Place]:
    """Every key and list entry of nested tables."""
    keyed = tables.items() if isinstance(tables, dict) else enumerate(tables)
    for key, value in list(keyed):
        yield tables, key
        if isinstance(value, dict | list):
            yield from places(value)


def is_number(value: Any) -> bool:
    """Whether this is a number, which truth values are not."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def odd_number(tables: dict[str, Any], draw: random.Random) -> str:
    """Set a number to one that is hardly meant."""
    inside, key = draw.choice([p for p in places(tables) if is_number(p[0][p[1]])])
    before = inside[key]
    scaled = draw.random() < 0.5 and abs(before) < 1e300
    inside[key] = before * draw.choice(FACTORS) if scaled else draw.choice(NUMBERS)
    if isinstance(before, int) and isinstance(inside[key], float) and inside[key].is_integer():
        inside[key] = int(inside[key])
    return f"{key}: {before} -> {inside[key]}"


def other_type(tables: dict[str, Any], draw: random.Random) -> str:
    """Set a key to a value of another type."""
    inside, key = draw.choice(list(places(tables)))
    inside[key] = deepcopy(draw.choice(OTHERS))
    return f"{key} = {inside[key]!r:.60}"


def dropped(tables: dict[str, Any], draw: random.Random) -> str:
    """Leave out a key or an entry."""
    inside, key = draw.choice(list(places(tables)))
    del inside[key]
    return f"without {key}"


def renamed(tables: dict[str, Any], draw: random.Random) -> str:
    """Misspell a key."""
    inside, key = draw.choice([p for p in places(tables) if isinstance(p[0], dict)])
    letters = list(key)
    draw.shuffle(letters)
    name = draw.choice([key + "s", key[:-1], key.upper(), "".join(letters), "", "\x00", "é"])
    inside[name] = inside.pop(key)
    return f"{key} called {name!r}"


def doubled(tables: dict[str, Any], draw: random.Random) -> str:
    """Write an entry of a list twice, or a value as a list of itself."""
    inside, key = draw.choice(list(places(tables)))
    if isinstance(inside, list):
        inside.insert(key, deepcopy(inside[key]))
    else:
        inside[key] = [deepcopy(inside[key])] * draw.choice([1, 2, 3])
    return f"{key} twice"


def swapped(tables: dict[str, Any], draw: random.Random) -> str:
    """Exchange the values of two keys, wherever they are."""
    (one, a), (other, b) = draw.choices(list(places(tables)), k=2)
    first, second = deepcopy(one[a]), deepcopy(other[b])
    one[a], other[b] = second, first
    return f"{a} and {b} exchanged"


def grafted(tables: dict[str, Any], draw: random.Random) -> str:
    """Take a key from another scene."""
    name = draw.choice(sorted(packaged_scenes()))
    key, value = draw.choice(list(as_written(name).items()))
    tables[key] = deepcopy(value)
    return f"{key} of {name}"


HABITS: list[Callable[[dict[str, Any], random.Random], str]] = [
    odd_number, odd_number, odd_number, odd_number,
    other_type, dropped, renamed, doubled, swapped, grafted,
]  # fmt: skip


@cache
def as_written(name: str) -> dict[str, Any]:
    """Tables of a packaged scene, as its file gives them."""
    return tomllib.loads(packaged_scenes()[name].read_text(encoding="utf-8"))


@cache
def in_full(name: str) -> dict[str, Any]:
    """Tables of a packaged scene with the keys it leaves out."""
    return json.loads(load_scene(name).text)


def spoiled(names: list[str], seed: int, number: int, habits: list[Any] = HABITS) -> Spoiled:
    """Draw a scene by its number: a packaged one with one to three changes."""
    draw = random.Random(f"{seed} {number}")
    name = draw.choice(names)
    tables = deepcopy(draw.choice([as_written, in_full])(name))
    told = []
    for _ in range(draw.choice([1, 1, 1, 2, 3])):
        try:
            told.append(draw.choice(habits)(tables, draw))
        except IndexError:  # nothing of this sort is left in it
            continue
    overrides = [typed(name, draw) for _ in range(draw.choice([0, 0, 0, 1]) * (habits == HABITS))]
    return Spoiled(name, tables, overrides, "; ".join(told + overrides))


def typed(name: str, draw: random.Random) -> str:
    """What somebody may write behind `--set`."""
    paths = list(key_paths(in_full(name)))
    value = draw.choice([*NUMBERS, *OTHERS, "[", "{a=", '"', "'''", "1 2", "1979-05-27", "0x1f"])
    path = draw.choice([*paths] * 4 + ["", ".", "a..b", "kind", "kind.x", "worm[0].x", "[0]", "="])
    return draw.choice([f"{path}={value}", f"{path}={value}", path, f"{path}.0={value}"])


def key_paths(tables: dict[str, Any], before: str = "") -> Iterator[str]:
    """Key paths of all tables."""
    for key, value in tables.items():
        yield f"{before}{key}"
        if isinstance(value, dict):
            yield from key_paths(value, f"{before}{key}.")


def refuse(constant: str) -> None:
    """JSON knows neither NaN nor Infinity."""
    raise ValueError(f"{constant} is no JSON")


def strict(text: str) -> Any:
    """Read JSON as strict readers do."""
    return json.loads(text, parse_constant=refuse)


def checked(scene: Spoiled) -> tuple[str, str]:
    """Read a scene: "accepted" or "refused", and what is wrong with the answer, if anything is."""
    begin = time.perf_counter()
    verdict, wrong = "accepted", ""
    try:
        loaded = scene.load()
        strict(loaded.text)
        for warning in loaded.warnings:
            wrong = wrong or ("" if warning.strip() else "an empty warning")
    except SceneError as error:
        verdict, wrong = "refused", _unclear(error)
    except ArgumentError as error:
        wrong = f"of overrides that are texts: {error}"
    except Exception as error:  # whatever it is, the user would see a traceback
        verdict, wrong = "broken", f"{type(error).__name__}: {error}"
    if time.perf_counter() - begin > SLOW_CHECK:
        wrong = wrong or f"took {time.perf_counter() - begin:.1f} s"
    return verdict, wrong


def _unclear(error: SceneError) -> str:
    """What a message lacks: the file, a reason, text that can be printed."""
    for line in str(error).split("\n"):
        named, told = line.startswith(f"{error.file}: "), line[len(error.file) + 2 :]
        if not named or len(told) < len("missing") or not line.isprintable():
            return f"unclear: {line!r:.100}"
    return ""


def check_many(count: int, seed: int, first: int) -> int:
    """Read scenes; returns how many did not end as they should."""
    names, verdicts, bad = sorted(packaged_scenes()), Counter[str](), 0
    os.chdir(packaged_folder())  # files that scenes name lie there
    begin = time.perf_counter()
    for number in range(first, first + count):
        scene = spoiled(names, seed, number)
        verdict, wrong = checked(scene)
        verdicts[verdict] += 1
        if wrong:
            bad += 1
            print(f"{number} {scene.name} ({scene.told:.200}): {wrong:.300}", flush=True)
    took = time.perf_counter() - begin
    print(f"{count} checked, {dict(verdicts)}, {bad} wrong; {count / took * 60:.0f} a minute")
    return bad


def cheap() -> list[str]:
    """Scenes that take a few seconds at most."""
    times = times_of_scenes()
    return sorted(name for name in packaged_scenes() if times.get(name, 0) <= CHEAP)


def accepted(count: int, seed: int, first: int) -> Iterator[tuple[int, Spoiled]]:
    """Spoiled cheap scenes that `check` accepts: mostly by numbers."""
    names, habits = cheap(), [*[odd_number] * 8, dropped, doubled, swapped]
    number = first
    for _ in range(count):
        while True:
            scene = spoiled(names, seed, number, habits)
            number += 1
            if checked(scene)[0] == "accepted":
                yield number - 1, scene
                break


@cache
def slowness() -> float:
    """How many times as long as meant this processor takes, at least once."""
    begin, total = time.process_time(), 0
    for k in range(1_000_000):
        total += k * k
    return max((time.process_time() - begin) / A_MILLION_SQUARES, 1.0)


def allowed(tables: dict[str, Any]) -> int:
    """Seconds of a processor that a run may take: the scene's own limits of time come on top."""
    own = [inside[key] for inside, key in places(tables) if key == "time_limit"]
    return int(SECONDS * slowness() + min(sum(own), 3600))


def ran(scene: Spoiled, seconds: int | None = None) -> tuple[str, str]:
    """Run a scene on the command line: how it ended, and what is wrong with that."""
    seconds = seconds or allowed(scene.tables)
    with tempfile.TemporaryDirectory() as home:
        file, folder = Path(home) / f"{scene.name}.toml", Path(home) / "out"
        # files that it names lie with the packaged ones
        for beside in packaged_folder().iterdir():
            if beside.suffix != ".toml":
                (Path(home) / beside.name).symlink_to(beside)
        file.write_text(toml_text(scene.tables), encoding="utf-8")
        command = [sys.executable, "-m", "wormopt", "run", str(file), "--json", "--quiet"]
        command += ["--no-plots", "--engine", "serial", "-o", str(folder)]
        try:
            done = subprocess.run(
                command,
                capture_output=True,
                text=True,
                timeout=BUSY * seconds,
                preexec_fn=partial(_limited, seconds),
            )
        except subprocess.TimeoutExpired:
            return "slow", f"did not end in {BUSY * seconds} s by the clock"
        if done.returncode == -signal.SIGXCPU:
            return "slow", f"did not end in {seconds} s of a processor"
        return str(done.returncode), _wrong_end(done, file, folder)


def _limited(seconds: int) -> None:
    resource.setrlimit(resource.RLIMIT_AS, (BYTES, BYTES))
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 5))


def _wrong_end(done: subprocess.CompletedProcess[str], file: Path, folder: Path) -> str:
    """What is wrong with how a run ended: its code, its words, what it wrote."""
    told = [line for line in done.stderr.splitlines() if line]
    if "Traceback" in done.stderr or done.returncode not in (0, 2, 3):
        return f"code {done.returncode}: {' | '.join(told[-3:])}"
    if any("Warning" in line for line in told):
        return f"a warning of a library: {' | '.join(told)}"
    left = {path.name for path in file.parent.iterdir() if not path.is_symlink()}
    if left - {file.name, "out"}:
        return f"left behind {sorted(left)}"
    if done.returncode == 2:
        clear = any(line.startswith((str(file), file.stem)) for line in told)
        return "" if clear and not folder.exists() else f"unclear refusal: {' | '.join(told)}"
    try:
        strict((folder / SUMMARY_FILE).read_text(encoding="utf-8"))
        summary = strict(done.stdout)
    except (OSError, ValueError) as error:
        return f"no summary: {error}"
    if not (folder / RESULT_FILE).is_file():
        return "no result file"
    if (done.returncode == 0) != (summary["status"] in ("ok", "unchecked")):
        return f"code {done.returncode}, status {summary['status']}"
    return "" if done.returncode == 0 or summary["reason"] else "failed without a reason"


def run_many(count: int, seed: int, first: int) -> int:
    """Run scenes, two side by side; returns how many did not end as they should."""
    os.chdir(packaged_folder())
    ends, bad, begin = Counter[str](), 0, time.perf_counter()
    with ThreadPoolExecutor(os.cpu_count()) as side_by_side:
        drawn = list(accepted(count, seed, first))
        for (number, scene), (end, wrong) in zip(
            drawn, side_by_side.map(lambda pair: ran(pair[1]), drawn), strict=True
        ):
            ends[end] += 1
            print(f"\r{ends.total()} of {count}, {bad} wrong", end="", file=sys.stderr)
            if wrong:
                bad += 1
                print(f"{number} {scene.name} ({scene.told:.200}): {wrong:.500}", flush=True)
    took = time.perf_counter() - begin
    print(
        f"{count} run, ended with {dict(ends)}, {bad} wrong; {took:.0f} s; a run may take "
        f"{SECONDS * slowness():.0f} s of this processor"
    )
    return bad


def main() -> int:
    """Do what was asked; 1 if anything is wrong."""
    asked = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    asked.add_argument("what", choices=("check", "run"))
    asked.add_argument("count", type=int)
    asked.add_argument("--seed", type=int, default=0)
    asked.add_argument("--first", type=int, default=0)
    options = asked.parse_args()
    warnings.simplefilter("error")
    many = check_many if options.what == "check" else run_many
    return min(many(options.count, options.seed, options.first), 1)


if __name__ == "__main__":
    sys.exit(main())
