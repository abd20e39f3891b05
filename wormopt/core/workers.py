"""The same work for many jobs, in several processes.

Python's lock lets threads do little of this package's work side by side: programs are assembled
and looked through in Python, and CasADi does not let go of the lock.
"""

from __future__ import annotations

import os
import signal
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from typing import Any, TypeVar

__all__ = ["Workers"]

Job = TypeVar("Job")
Answer = TypeVar("Answer")

# Seconds after which processes that have nothing to do end.
_IDLE = 60
_is_worker = False


class Workers:
    """Processes that take jobs; they are started when first needed, and shared by all in turn.

    Until they are ready the work goes on here. A process that is a worker has none of its own.

    Parameters
    ----------
    count : int, optional
        Number of processes, one per processor if left out; with 1 all is done here.

    Examples
    --------
    >>> with Workers(1) as workers:
    ...     list(workers.map(abs, [-1, 2]))
    [1, 2]
    """

    def __init__(self, count: int | None = None) -> None:
        self.count = 1 if _is_worker else count or os.cpu_count() or 1
        self._executor: Any = None
        self._asked = deque[Future]()

    def map(self, work: Callable[[Job], Answer], jobs: Sequence[Job]) -> Iterator[Answer]:
        """Do the same with every job.

        Parameters
        ----------
        work : callable
            What is done; it is sent to the processes, as are the jobs.
        jobs : sequence
            With what.

        Yields
        ------
        object
            The answers, in the order of the jobs.
        """
        if self.count == 1 or len(jobs) < 2:
            yield from map(work, jobs)
            return
        todo = deque(jobs)
        while todo and not self._ready(work):
            yield work(todo.popleft())
        asked = self._asked = deque(self._executor.submit(work, job) for job in todo)
        while asked:
            yield asked.popleft().result()

    def _ready(self, work: Callable) -> bool:
        if self._executor is None:
            from loky import get_reusable_executor

            self._executor = get_reusable_executor(self.count, timeout=_IDLE, initializer=_begin)
            self._begun = [self._executor.submit(_load, work) for _ in range(self.count)]
        return all(future.done() for future in self._begun)

    def close(self) -> None:
        """Drop what is not done; processes that are at work on it end."""
        if any(not future.done() for future in self._asked):
            self._executor.shutdown(wait=False, kill_workers=True)
        self._asked.clear()

    def __enter__(self) -> Workers:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _load(work: Callable) -> None:
    """Import what the work needs, as it was sent."""


def _begin() -> None:
    global _is_worker
    _is_worker = True
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # whoever asked for the work is told, and ends it
