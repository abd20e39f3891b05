"""Work on the machines of a Dask cluster; loaded only where that is asked for."""

from __future__ import annotations

import ctypes
import logging
import os
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Future
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from dask.context import thread_state
from distributed import Client, LocalCluster, get_worker
from distributed.scheduler import KilledWorker

from wormopt.errors import ArgumentError

# Seconds to wait for a cluster, and between looks at whether a job is still wanted.
_PATIENCE, _LOOK = 10, 0.5


@dataclass(frozen=True)
class Cluster:
    """Takes jobs for the workers of a cluster, which tries them elsewhere when a worker is lost."""

    executor: Any
    count: int  # workers
    # raised for a job whose workers died, one after another, or whose cluster is gone
    lost: tuple[type[BaseException], ...] = (KilledWorker, CancelledError)

    def submit(self, work: Callable, job: Any) -> Future:
        """Ask for a job; once cancelled it ends within a second, even where it is at work."""
        return self.executor.submit(_done, work, job)


@contextmanager
def connected(workers: int | None, scheduler: str) -> Iterator[Cluster]:
    """Have a cluster: the one at an address, or one of processes here that ends with the context.

    Raises ArgumentError where it cannot be had.
    """
    # What the cluster has to say of its own end is for nobody here.
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    own = None if scheduler else _own(workers or os.cpu_count() or 1)
    try:
        try:
            client: Any = Client(own or scheduler, timeout=_PATIENCE, set_as_default=False)
        except Exception as error:  # whatever its network raises
            what = f"no Dask scheduler answers at {scheduler!r} ({error})"
            raise ArgumentError(f"{what}; write its address, tcp://host:8786 say") from error
        try:
            count = sum(client.nthreads().values())
            if not count:
                what = f"the Dask scheduler at {scheduler} has no workers"
                raise ArgumentError(f"{what}; start some: dask worker {scheduler} --nthreads 1")
            yield Cluster(client.get_executor(pure=False), count)
        finally:
            client.close(timeout=_PATIENCE)
    finally:
        if own is not None:
            own.close(timeout=_PATIENCE)


def _own(workers: int) -> LocalCluster:
    return LocalCluster(
        n_workers=workers,
        threads_per_worker=1,
        dashboard_address=None,  # pyright: ignore[reportArgumentType]  means none
        silence_logs=logging.CRITICAL,
    )


def _done(work: Callable, job: Any) -> Any:
    """Do a job on a worker, unless nobody wants it any more."""
    over = threading.Event()
    state, key = get_worker().state, thread_state.key
    watch = threading.Thread(target=_watch, args=(state, key, over, threading.get_ident()))
    watch.daemon = True
    watch.start()
    try:
        return work(job)
    except KeyboardInterrupt:  # its answer is wanted by nobody
        return None
    finally:
        over.set()


def _watch(state: Any, key: Any, over: threading.Event, thread: int) -> None:
    """Interrupt a thread when its job is cancelled."""
    while not over.wait(_LOOK):
        task = state.tasks.get(key)
        if task is None or task.state == "cancelled":
            interrupt = ctypes.py_object(KeyboardInterrupt)
            ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(thread), interrupt)
            return
