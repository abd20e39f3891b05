"""``--against``: an older version beside this one, by turns in one run.

Each version runs the benchmarks of this checkout in a process of its own, with the same interpreter
and the same libraries. CPU time counts, for the machine may be busy.
"""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
import tarfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any

from tests.benchmarks.run import Found, aligned, seconds
from wormopt.errors import ArgumentError
from wormopt.progress import Report

_HERE = Path(__file__).resolve().parents[2]
_ROUNDS, _QUICK_ROUNDS = 7, 3
_LONGEST = 5.0  # s of a run after which no finer setting is asked for


def against(
    older: str, cases: Sequence[str], *, quick: bool, report: Report
) -> Iterator[list[Found]]:
    """Run cases by this version and by an older one in turn; all rows so far.

    `older`: a version on PyPI, a commit of this checkout, a checkout, a wheel. Raises
    ArgumentError if there is none such.
    """
    rows: list[Found] = []
    with ExitStack() as stack:
        folder = Path(stack.enter_context(TemporaryDirectory()))
        report(f"installing {older}", 0.0)
        roots = {"now": _HERE, "then": installed(older, folder / "older")}
        workers = {name: stack.enter_context(_Worker(root, folder)) for name, root in roots.items()}
        for k, case in enumerate(cases):
            report(f"{case} by turns", (k + 1) / (len(cases) + 1))
            rows += _by_turns(case, workers, quick)
            yield rows


def installed(older: str, folder: Path) -> Path:
    """Folder that holds the package of an older version, without what it depends on."""
    path = Path(older)
    if (path / "wormopt" / "__init__.py").is_file():
        return path.resolve()
    if not path.exists() and (packed := _archived(older)) is not None:
        with tarfile.open(fileobj=io.BytesIO(packed)) as tar:
            tar.extractall(folder, filter="data")
        return folder
    wanted = str(path.resolve()) if path.is_file() else f"wormopt=={older}"
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-input",
           "--disable-pip-version-check", "--target", str(folder), wanted]  # fmt: skip
    done = subprocess.run(pip, capture_output=True, text=True, check=False)
    if done.returncode or not (folder / "wormopt").is_dir():
        said = done.stderr.strip().splitlines() or ["it holds no wormopt"]
        raise ArgumentError(
            f"--against {older}: neither a checkout, a wheel, a commit of this checkout nor a "
            f"version that pip can install ({said[-1]})"
        )
    return folder


def _archived(commit: str) -> bytes | None:
    """The package as it was at a commit of the checkout that this runs from."""
    if commit.startswith("-") or not (_HERE / ".git").exists():
        return None
    asked = ["git", "-C", str(_HERE), "archive", "--format=tar", commit, "wormopt"]
    try:
        done = subprocess.run(asked, capture_output=True, check=False)
    except OSError:
        return None
    return done.stdout if done.returncode == 0 else None


class _Worker:
    """A process that runs one version."""

    def __init__(self, root: Path, folder: Path) -> None:
        # -P and another folder: nothing of where the user is comes before the version
        command = [sys.executable, "-P", "-m", "tests.benchmarks.own_runs", str(root)]
        environment = os.environ | {"PYTHONPATH": str(_HERE)}
        self._process = subprocess.Popen(
            command, cwd=folder, env=environment, text=True, stdin=subprocess.PIPE,
            stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
        )  # fmt: skip

    def __enter__(self) -> _Worker:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.communicate()

    def ask(self, **what: Any) -> Found:
        """What the version answers; ``missing`` where it cannot."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        try:
            self._process.stdin.write(json.dumps(what) + "\n")
            self._process.stdin.flush()
            answer = self._process.stdout.readline()
        except OSError:
            answer = ""
        return json.loads(answer) if answer else {"missing": "its process ended"}


def _by_turns(case: str, workers: Mapping[str, _Worker], quick: bool) -> list[Found]:
    """Rows of one case, a setting each."""
    able = {name: worker.ask(case=case, quick=quick) for name, worker in workers.items()}
    for name, answer in able.items():
        if "missing" in answer:
            return [{"case": case, "missing": f"{name}: {answer['missing']}"}]
    rows: list[Found] = []
    for setting in able["now"]["settings"]:
        first = {name: worker.ask(setting=setting) for name, worker in workers.items()}
        times: dict[str, list[float]] = {name: [] for name in workers}
        slow = any(answer.get("seconds", 0.0) > _LONGEST for answer in first.values())
        for turn in range(0 if slow else _QUICK_ROUNDS if quick else _ROUNDS):
            # who is first changes from turn to turn
            for name in list(workers)[:: 1 if turn % 2 else -1]:
                again = workers[name].ask(setting=setting)
                times[name].append(again.get("seconds", 0.0))
        missing = [f"{n}: {a['missing']}" for n, a in first.items() if "missing" in a]
        if missing:
            rows.append({"case": case, "setting": setting, "missing": "; ".join(missing)})
            continue
        spent = {n: median(times[n] or [first[n]["seconds"]]) for n in workers}
        rows.append({
            "case": case, "setting": setting, "ratio": spent["now"] / max(spent["then"], 1e-9),
            **{f"{n}_s": spent[n] for n in workers},
            **{f"{n}_error": first[n]["error"] for n in workers},
        })  # fmt: skip
        if slow:
            break
    return rows


def table(older: str, rows: Sequence[Found]) -> str:
    """Lay the rows out."""
    head = ("case", "setting", "error now", "then", "time now", "then", "now/then")
    told = [
        (
            row["case"],
            f"{row['setting']:.4g}",
            *("not a number" if row[k] is None else f"{row[k]:.1e}"
              for k in ("now_error", "then_error")),
            *(seconds(row[k]) for k in ("now_s", "then_s")),
            f"{row['ratio']:.3g}",
        )
        for row in rows
        if "ratio" in row
    ]  # fmt: skip
    missing = [f"  {row['case']}: {row['missing']}" for row in rows if "missing" in row]
    return "\n".join([f"this version and {older} by turns, CPU time", *aligned(head, *told),
                      *missing])  # fmt: skip
