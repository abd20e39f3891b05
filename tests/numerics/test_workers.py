"""Jobs in several processes: their order, interruptions, processes that die, pools in pools."""

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import pytest

from wormopt.numerics.workers import Workers, alone, each
from wormopt.result import Result


def square(x: int) -> int:
    return x * x


def own_process(_: int) -> int:
    time.sleep(0.02)
    return os.getpid()


def slept(seconds: float) -> float:
    time.sleep(seconds)
    return seconds


def die_elsewhere(parent: int) -> bool:
    """Ends the process as the system does when memory is short, but not the one that asked."""
    if os.getpid() != parent:
        os.kill(os.getpid(), signal.SIGKILL)
    return True


def fail(x: int) -> int:
    raise ValueError(f"no {x}")


def nested(count: int) -> tuple[int, list[int]]:
    with Workers(2) as workers:
        return workers.count, list(workers.map(square, range(count)))


def ready(workers: Workers) -> None:
    """Wait until jobs go elsewhere."""
    begin = time.monotonic()
    while os.getpid() in workers.map(own_process, range(4)):
        assert time.monotonic() - begin < 60


def designing(folder: Path) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "wormopt", "run", "design_five_links", "--no-plots", "--quiet"]
    kwargs = {"start_new_session": True, "stderr": subprocess.PIPE, "stdout": subprocess.DEVNULL}
    return subprocess.Popen([*command, "-o", str(folder)], text=True, **kwargs)


@pytest.fixture(scope="module")
def pool() -> Iterator[Workers]:
    """Two that are ready."""
    with Workers(2) as workers:
        ready(workers)
        yield workers


@pytest.mark.parametrize("count", [1, 2, 3])
def test_answers_come_in_the_order_of_the_jobs(count):
    with Workers(count) as workers:
        for _ in range(20):
            assert list(workers.map(square, range(50))) == [x * x for x in range(50)]


def test_work_is_done_elsewhere_once_processes_are_ready(pool: Workers):
    assert len(set(pool.map(own_process, range(40)))) == 2


def test_a_process_that_dies_costs_no_answer():
    with Workers(2) as workers:
        ready(workers)
        assert list(workers.map(die_elsewhere, [os.getpid()] * 5)) == [True] * 5
        assert list(workers.map(square, range(5))) == [0, 1, 4, 9, 16]
    with Workers(2) as workers:  # and others are started
        ready(workers)


def test_a_job_runs_beside_others_and_is_done_here_without_processes(pool: Workers):
    for workers, here in ((pool, False), (Workers(1), True)):
        beside = workers.start(own_process, 0)
        assert list(workers.map(square, range(5))) == [0, 1, 4, 9, 16]
        assert (beside() == os.getpid()) is here


def test_a_job_whose_process_dies_is_done_here():
    with Workers(2) as workers:
        assert workers.start(die_elsewhere, os.getpid())()


def test_answers_come_as_soon_as_they_are_done(pool: Workers):
    found = list(pool.as_completed(slept, [0.3, 0.01, 0.02]))
    assert found == [(1, 0.01), (2, 0.02), (0, 0.3)]
    assert os.getpid() not in dict(pool.as_completed(own_process, range(6))).values()
    with Workers(1) as alone:
        assert list(alone.as_completed(square, [3, 2])) == [(0, 9), (1, 4)]


def test_progress_is_told_after_each_job():
    told: list[tuple[str, float | None]] = []
    found = each(square, [3, 2], lambda *said: told.append(said), "runs", 1)
    assert list(found) == [(0, 9), (1, 4)]
    assert told == [("runs: 1 of 2", 0.5), ("runs: 2 of 2", 1.0)]


def test_a_process_that_dies_costs_no_answer_that_is_not_in_order():
    with Workers(2) as workers:
        found = dict(workers.as_completed(die_elsewhere, [os.getpid()] * 5))
        assert found == dict.fromkeys(range(5), True)


def test_what_is_not_done_is_dropped_with_its_processes():
    begin = time.monotonic()
    with Workers(2) as workers:
        ready(workers)
        for _ in workers.as_completed(slept, [0.01, 60.0, 60.0]):
            break
    with Workers(2) as workers:
        beside = workers.start(slept, 60.0)
    with Workers(2) as workers:  # the processes that slept are no longer there
        ready(workers)
    assert callable(beside)
    assert time.monotonic() - begin < 30


def test_an_error_of_the_work_is_told(pool: Workers):
    with pytest.raises(ValueError, match="no 3"):
        list(pool.map(fail, [3, 4]))


def test_workers_have_no_workers(pool: Workers):
    assert list(pool.map(nested, [3, 4])) == [(1, [0, 1, 4]), (1, [0, 1, 4, 9])]
    with multiprocessing.get_context("spawn").Pool(1) as spawned:
        assert spawned.map(nested, [3]) == [(1, [0, 1, 4])]
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=context) as others:
        assert list(others.map(nested, [3])) == [(2, [0, 1, 4])]


def test_executors_of_others_are_left_alone():
    from loky import get_reusable_executor

    own = get_reusable_executor(1, timeout=20)
    assert list(own.map(square, [2])) == [4]
    with Workers(2) as workers:
        ready(workers)
    assert list(own.map(square, [3])) == [9]


@pytest.mark.parametrize(
    "delay", [1.2, *(pytest.param(t, marks=pytest.mark.slow) for t in (1.6, 2.0, 2.6))]
)
def test_an_interrupt_at_any_time_leaves_no_traceback_of_processes(tmp_path: Path, delay: float):
    """As Ctrl-C sends it, to all processes of the terminal; also while they are starting."""
    with designing(tmp_path / "r") as run:
        time.sleep(delay)
        os.killpg(run.pid, signal.SIGINT)
        _, told = run.communicate(timeout=60)
    assert "Traceback" not in told
    assert run.returncode == 130


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="has no SIGTERM")
def test_whoever_is_asked_to_end_saves_what_there_is_and_leaves_no_process(tmp_path: Path):
    with designing(tmp_path / "r") as run:
        time.sleep(8)
        run.send_signal(signal.SIGTERM)
        _, told = run.communicate(timeout=60)
    assert run.returncode == 130
    assert "Traceback" not in told
    assert Result.load(tmp_path / "r").reason.startswith("interrupted")
    begin = time.monotonic()
    while subprocess.run(["pgrep", "-s", str(run.pid)], stdout=subprocess.DEVNULL).returncode == 0:
        assert time.monotonic() - begin < 10
        time.sleep(0.1)


def test_a_process_of_its_own_has_no_workers():
    assert alone(nested, 3) == (1, [0, 1, 4])
    assert alone(own_process, 0) != os.getpid()
