"""Parallel work on many jobs, in several processes or on a Dask cluster.

Threads cannot do most of this work in parallel: programs are assembled and evaluated in Python,
and CasADi keeps Python's lock.
"""

from __future__ import annotations

import atexit
import os
import signal
import sys
import threading
import time
import warnings
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Future, ThreadPoolExecutor, as_completed
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from functools import partial
from multiprocessing import current_process, parent_process
from typing import Any, Literal, TypeVar, get_args

from wormopt.errors import ArgumentError, SolveError
from wormopt.progress import Report, silent

Job = TypeVar("Job")
Answer = TypeVar("Answer")
EngineName = Literal["processes", "serial", "dask"]

# Seconds after which idle processes end, and between checks of the parent process.
_IDLE, _LOOK = 30, 0.5
# How often processes are restarted after some have died.
_REVIVALS = 3
_here = threading.local()  # whether this thread is a worker
_executors: dict[tuple[int, int], Any] = {}  # by the process that owns them, and their size
# An executor alive at interpreter shutdown fails in its own destructor.
atexit.register(_executors.clear)


@dataclass(frozen=True)
class Engine:
    """Place where parallel work runs.

    Parameters
    ----------
    name : {"processes", "serial", "dask"}
        Processes of this machine, this process alone, or a Dask cluster.
    workers : int, optional
        Number of workers; one per processor if left out. An existing cluster uses its own workers.
    scheduler : str
        Address of a Dask cluster that is there, "tcp://node7:8786" say; without one a cluster
        of processes is made for the time being.

    Examples
    --------
    >>> with using(Engine("serial")):
    ...     Workers().count
    1
    """

    name: EngineName = "processes"
    workers: int | None = None
    scheduler: str = ""

    def __post_init__(self) -> None:
        if self.name not in get_args(EngineName):
            raise ArgumentError(f"engine must be one of {get_args(EngineName)}, not {self.name!r}")
        if self.workers is not None and self.workers < 1:
            raise ArgumentError(f"workers must be 1 or more, not {self.workers}")


_engine = Engine()
_cluster: Any = None  # executor of the Dask cluster in use


@contextmanager
def using(engine: Engine) -> Iterator[None]:
    """Send all work to an engine while the context lasts; ArgumentError if it cannot be had."""
    global _engine, _cluster
    before = _engine, _cluster
    with _cluster_of(engine) as cluster:
        _engine, _cluster = engine, cluster
        try:
            yield
        finally:
            _engine, _cluster = before


def _cluster_of(engine: Engine) -> AbstractContextManager[Any]:
    if engine.name != "dask":
        return nullcontext()
    try:
        from wormopt.numerics.dask_cluster import connected
    except ImportError as error:
        what = "engine dask: the package distributed is not installed"
        raise ArgumentError(f"{what}; pip install 'wormopt[sweep]'") from error
    return connected(engine.workers, engine.scheduler)


class Workers:
    """Processes that take jobs, started when first needed and shared by all callers in turn.

    Until they are ready, or once they die repeatedly, work is done here. A worker has no
    workers itself. `count`: that of the engine by default; with 1 all is done here.
    """

    def __init__(self, count: int | None = None) -> None:
        alone = getattr(_here, "is_worker", False) or current_process().daemon
        self._local = alone or _engine.name == "serial"
        if self._local:
            self.count = 1
        elif _cluster is not None:
            self.count = _cluster.count
        else:
            self.count = count or _engine.workers or os.cpu_count() or 1
            self._local = self.count == 1
        self._begun: list[Future] = []
        self._asked = deque[Future]()
        self._beside: list[Future] = []  # started
        self._died = 0

    def map(self, work: Callable[[Job], Answer], jobs: Sequence[Job]) -> Iterator[Answer]:
        """Do the same with every job; yields the answers in the order of the jobs."""
        todo = deque(jobs)
        while todo:
            try:
                while todo and (self._local or len(jobs) < 2 or not self._ready(work)):
                    yield work(todo.popleft())
                if not todo:
                    return
                self._submit(work, todo)
                while self._asked:
                    answer = self._answer(self._asked[0])
                    self._asked.popleft()
                    todo.popleft()
                    yield answer
            except BrokenExecutor:
                self._revive()

    def as_completed(
        self, work: Callable[[Job], Answer], jobs: Sequence[Job]
    ) -> Iterator[tuple[int, Answer]]:
        """Do the same with every job; yields number and answer of each as soon as it is done."""
        # For long jobs: all are submitted at once, and none is done here unless processes die.
        todo = dict(enumerate(jobs))
        while todo:
            try:
                if self._local or len(jobs) < 2:
                    for k in list(todo):
                        yield k, work(todo.pop(k))
                    return
                self._submit(work, todo.values())
                numbers = dict(zip(self._asked, list(todo), strict=True))
                for future in as_completed(numbers):
                    answer = self._answer(future)
                    del todo[numbers[future]]
                    yield numbers.pop(future), answer
            except BrokenExecutor:
                self._revive()

    def start(self, work: Callable[[Job], Answer], job: Job) -> Callable[[], Answer]:
        """Start a job beside what follows; returns a function that waits for its answer."""
        if self._local:
            return partial(work, job)
        self._submit(work, [job])
        self._beside.append(future := self._asked.popleft())

        def answer() -> Answer:
            try:
                return self._answer(future)
            except BrokenExecutor:
                self._revive()
                return work(job)

        return answer

    def _submit(self, work: Callable[[Job], Answer], jobs: Iterable[Job]) -> None:
        """Submit jobs; they are in `_asked` before anything can interrupt."""
        if _cluster is None:
            self._executor = _executor(self.count)
        with _interrupts_held():
            self._asked = deque(self._ask(work, job) for job in jobs)

    def _ask(self, work: Callable[[Job], Answer], job: Job) -> Future:
        if _cluster is not None:
            return _cluster.submit(partial(_as_worker, work), job)
        return self._executor.submit(work, job)

    def _answer(self, future: Future) -> Any:
        try:
            answer = future.result()
        except Exception as error:
            if _cluster is None or not isinstance(error, _cluster.lost):
                raise
            what = f"the Dask cluster lost a job ({type(error).__name__})"
            raise SolveError(what, "run it again; finished work is kept", code="lost") from error
        self._died = 0
        return answer

    def _revive(self) -> None:
        """Replace dead processes; after repeated failures do the work here."""
        _executors.pop((os.getpid(), self.count), None)
        self._begun, self._died = [], self._died + 1
        if self._died > _REVIVALS:
            self.count, self._local = 1, True

    def _ready(self, work: Callable) -> bool:
        if _cluster is not None:
            return True
        if not self._begun:
            self._submit(_load, [work] * self.count)
            self._begun, self._asked = list(self._asked), deque()  # they end by themselves
        return all(future.done() for future in self._begun)

    def close(self) -> None:
        """Drop jobs that are not done; processes working on them end."""
        working = [future for future in (*self._asked, *self._beside) if not future.done()]
        if working and _cluster is None:
            _executors.pop((os.getpid(), self.count), None)
            self._executor.shutdown(wait=False, kill_workers=True)
        for future in working if _cluster else ():
            future.cancel()
        self._asked.clear()
        self._beside.clear()

    def __enter__(self) -> Workers:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def each(
    work: Callable[[Job], Answer],
    jobs: Sequence[Job],
    report: Report = silent,
    text: str = "",
    count: int | None = None,
) -> Iterator[tuple[int, Answer]]:
    """Do the same with every job; yields number and answer of each as soon as it is done.

    For long jobs, like `Workers.as_completed`, with a report after each; `count` as for `Workers`.
    """
    with Workers(count) as workers:
        workers.count = min(workers.count, max(len(jobs), 1))
        for done, (k, answer) in enumerate(workers.as_completed(work, jobs), 1):
            yield k, answer
            report(f"{text}: {done} of {len(jobs)}", done / len(jobs))


def alone(work: Callable[[Job], Answer], job: Job) -> Answer:
    """Do a job in its own process, which has no workers; BrokenExecutor if it dies."""
    if current_process().daemon:  # daemons may not start processes
        return work(job)
    from loky import ProcessPoolExecutor

    with ProcessPoolExecutor(1, initializer=_begin, initargs=(os.getpid(),)) as process:
        return process.submit(work, job).result()


def thread_pool(count: int | None = None) -> ThreadPoolExecutor:
    """Threads, for work that releases Python's lock and cannot be sent to other processes.

    `count`: that of the engine by default, 1 without parallel work.
    """
    alone = getattr(_here, "is_worker", False) or _engine.name == "serial"
    return ThreadPoolExecutor(1 if alone else count or _engine.workers or os.cpu_count())


def _executor(count: int) -> Any:
    """Executor of this package only, not the one that users of loky share."""
    from loky import ProcessPoolExecutor

    # it warns of replaced workers, idle or grown; nothing is lost by that
    warnings.filterwarnings("ignore", "A worker (stopped|was restarted)", UserWarning)
    key = os.getpid(), count
    if key not in _executors:
        _executors[key] = ProcessPoolExecutor(
            count, timeout=_IDLE, initializer=_begin, initargs=(os.getpid(),)
        )
    return _executors[key]


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Block interrupts of processes started meanwhile; deliver one to this process afterwards."""
    if sys.platform == "win32":  # no signal mask: a process may be interrupted as it starts
        yield
        return
    from multiprocessing import resource_tracker

    from loky.backend import resource_tracker as of_loky

    for tracker in (resource_tracker, of_loky):  # starting one unblocks signals
        tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _load(work: Callable) -> None:
    """Import the modules of the work, as it was sent."""


def _begin(parent: int) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent process ends the work
    if sys.platform != "win32":
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGTERM})
    _here.is_worker = True
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _as_worker(work: Callable[[Job], Answer], job: Job) -> Answer:
    """Do a job in a thread without further parallel work."""
    _here.is_worker = True
    return work(job)


def _end_with(parent: int) -> None:
    """End this process when its parent has ended, even if killed."""
    if sys.platform == "win32":  # keeps the parent's process id after the parent has ended
        begun_by = parent_process()
        assert begun_by is not None
        begun_by.join()
    else:
        while os.getppid() == parent:
            time.sleep(_LOOK)
    os._exit(1)
