"""Runs of tests on a copy of the checkout, each up to the first failure.

Every run is forked from one process that has loaded what wormopt and the tests stand on, and none
of wormopt.
"""

from __future__ import annotations

import os
import signal
import sys
from collections import Counter
from contextlib import suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple

# As in tests/conftest.py: it must be said before numpy is loaded.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

_FORKS = get_context("forkserver")
_FORKS.set_forkserver_preload(
    "casadi control highspy hypothesis.strategies hypothesis.extra.numpy matplotlib.pyplot msgspec"
    " numpy numpy.testing pytest scipy.integrate scipy.io scipy.optimize scipy.signal".split()
)
# How tests end that notice a change: a test fails, conftest.py cannot import, the kernel crashes.
_CRASHES = (signal.SIGSEGV, signal.SIGFPE, signal.SIGABRT, signal.SIGBUS, signal.SIGILL)
_KILLED = {1, 4} | {-crash for crash in _CRASHES}
# A module that raises when it is imported counts as a failed test. Plugins are loaded before.
_HOW = (
    "-q -x -n 0 -p no:cacheprovider --continue-on-collection-errors"
    " -W ignore::pytest.PytestAssertRewriteWarning"
).split()


class Told(NamedTuple):
    """What came of a run."""

    outcome: str  # "survived" if all tests pass; killed, late, broken
    failed: str  # the test, if one failed
    seconds: dict[str, float]  # of every test that was run


def run(
    folder: Path, tests: list[str], ranks: dict[str, float], limit: float | None = None
) -> Told:
    """Run tests of a copy, those of low rank first, and see how they end.

    Late is what has not ended within `limit` seconds; broken what ended otherwise than by what
    _KILLED lists, as by an error of pytest itself.
    """
    there, here = _FORKS.Pipe(duplex=False)
    process = _FORKS.Process(target=_tests, args=(folder, tests, ranks, here))
    process.start()
    assert process.pid
    here.close()
    try:
        if not there.poll(limit):
            return Told("late", "", {})
        with suppress(EOFError):
            code, failed, seconds = there.recv()
            return Told(_outcome(code), failed, seconds)
        process.join(limit)
        return Told(_outcome(process.exitcode), "", {})
    finally:  # with whatever it has started
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.join()


def _outcome(code: int | None) -> str:
    return "survived" if code == 0 else "killed" if code in _KILLED else "broken"


def _tests(folder: Path, tests: list[str], ranks: dict[str, float], here: Connection) -> None:
    """Run tests in this process, and end it."""
    os.setsid()
    nothing = os.open(os.devnull, os.O_RDWR)
    for stream in range(3):
        os.dup2(nothing, stream)
    os.chdir(folder)
    sys.path.insert(0, str(folder))
    # Compiled code of mutants is not kept among the user's.
    os.environ |= {"PYTHONPATH": str(folder), "XDG_CACHE_HOME": str(folder / ".cache")}
    # No patches are made of examples, by packages whose warnings end pytest where they are errors.
    sys.modules["hypothesis.extra._patching"] = None  # pyright: ignore[reportArgumentType]
    import pytest

    assert "wormopt" not in sys.modules, "the code as it was before it was changed"
    trial = _trial(ranks)
    code = int(pytest.main([*_HOW, *tests], [trial]))
    here.send((code, trial.failed, dict(trial.seconds)))
    os._exit(code)


def _trial(ranks: dict[str, float]) -> Any:
    """Plugin of pytest that orders tests and keeps what came of them."""
    import pytest
    from hypothesis import Phase, settings

    class Trial:
        failed, seconds = "", Counter()

        @pytest.hookimpl(trylast=True)
        def pytest_configure(self) -> None:
            # Examples that fail are not made smaller, as nobody looks at them.
            phases = [Phase.explicit, Phase.generate]
            own = settings(settings.get_profile("effort"), phases=phases, database=None)
            settings.register_profile("quick", own)
            settings.load_profile("quick")

        @pytest.hookimpl(trylast=True)
        def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
            items.sort(key=lambda item: ranks.get(item.nodeid, 0.0))

        def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
            self.seconds[report.nodeid] += report.duration
            if report.failed:
                self.failed = report.nodeid

    return Trial()
