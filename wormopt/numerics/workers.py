"""The same work for many jobs, in several processes.

Python's lock lets threads do little of this package's work side by side: programs are assembled
and looked through in Python, and CasADi does not let go of the lock.
"""

from __future__ import annotations

import os
import signal
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import current_process
from typing import Any, TypeVar

Job = TypeVar("Job")
Answer = TypeVar("Answer")

# Seconds after which processes that have nothing to do end.
_IDLE = 30
_is_worker = False
_executors: dict[tuple[int, int], Any] = {}  # by the process that owns them, and their size


class Workers:
    """Processes that take jobs, started when first needed and shared by all in turn.

    Until they are ready, or once one is killed, work goes on here. A worker has none itself.
    `count`: one per processor if left out; with 1 all is done here.
    """

    def __init__(self, count: int | None = None) -> None:
        alone = _is_worker or current_process().daemon
        self.count = 1 if alone else count or os.cpu_count() or 1
        self._begun: list[Future] = []
        self._asked = deque[Future]()

    def map(self, work: Callable[[Job], Answer], jobs: Sequence[Job]) -> Iterator[Answer]:
        """Do the same with every job; yields the answers in the order of the jobs.

        `work` and the jobs are sent to the processes.
        """
        if self.count == 1 or len(jobs) < 2:
            yield from map(work, jobs)
            return
        todo = deque(jobs)
        try:
            while todo and not self._ready(work):
                yield work(todo.popleft())
            with _interrupts_held():
                asked = self._asked = deque(self._executor.submit(work, job) for job in todo)
            while asked:
                answer = asked[0].result()
                asked.popleft()
                todo.popleft()
                yield answer
        except BrokenProcessPool:
            self._go_on_here()
            yield from map(work, todo)

    def as_completed(
        self, work: Callable[[Job], Answer], jobs: Sequence[Job]
    ) -> Iterator[tuple[int, Answer]]:
        """Do the same with every job; yields number and answer of each as soon as it is done.

        For long jobs: all are asked for at once, and none is done here unless processes die.
        """
        if self.count == 1 or len(jobs) < 2:
            yield from enumerate(map(work, jobs))
            return
        todo = dict(enumerate(jobs))
        try:
            self._executor = _executor(self.count)
            with _interrupts_held():
                numbers = {self._executor.submit(work, job): k for k, job in todo.items()}
            self._asked = deque(numbers)
            for future in as_completed(numbers):
                answer = future.result()
                del todo[numbers[future]]
                yield numbers[future], answer
        except BrokenProcessPool:
            self._go_on_here()
            for k, job in todo.items():
                yield k, work(job)

    def _go_on_here(self) -> None:
        _executors.pop((os.getpid(), self.count), None)
        self.count = 1

    def _ready(self, work: Callable) -> bool:
        if not self._begun:
            self._executor = _executor(self.count)
            with _interrupts_held():
                self._begun = [self._executor.submit(_load, work) for _ in range(self.count)]
        return all(future.done() for future in self._begun)

    def close(self) -> None:
        """Drop what is not done; processes that are at work on it end."""
        if any(not future.done() for future in self._asked):
            _executors.pop((os.getpid(), self.count), None)
            self._executor.shutdown(wait=False, kill_workers=True)
        self._asked.clear()

    def __enter__(self) -> Workers:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _executor(count: int) -> Any:
    """Our own processes, not those that users of loky share."""
    from loky import ProcessPoolExecutor

    key = os.getpid(), count
    if key not in _executors:
        _executors[key] = ProcessPoolExecutor(count, timeout=_IDLE, initializer=_begin)
    return _executors[key]


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Processes started meanwhile are never interrupted; this one is afterwards, if it was."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    from multiprocessing import resource_tracker

    from loky.backend import resource_tracker as of_loky

    for tracker in (resource_tracker, of_loky):  # to start one lets signals in
        tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _load(work: Callable) -> None:
    """Import what the work needs, as it was sent."""


def _begin() -> None:
    global _is_worker
    _is_worker = True
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # whoever asked for the work is told, and ends it
