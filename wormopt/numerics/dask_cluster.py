"""Work on the machines of a Dask cluster; imported only when requested."""

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

# Seconds to wait for a cluster, and between checks whether a job was cancelled.
_PATIENCE, _LOOK = 10, 0.5


@dataclass(frozen=True)
class Cluster:
    """Submits jobs to the workers of a cluster, which reruns them if a worker is lost."""

    executor: Any
    count: int  # workers
    # raised for a job whose workers died repeatedly, or whose cluster is gone
    lost: tuple[type[BaseException], ...] = (KilledWorker, CancelledError)

    def submit(self, work: Callable, job: Any) -> Future:
        """Submit a job; once cancelled it ends within a second, even if it runs."""
        return self.executor.submit(_done, work, job)


@contextmanager
def connected(workers: int | None, scheduler: str) -> Iterator[Cluster]:
    """Use the cluster at an address, or a local one that ends with the context."""
    # Messages of the cluster about its own end are of no use.
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    own = None if scheduler else _own(workers or os.cpu_count() or 1)
    try:
        try:
            client: Any = Client(own or scheduler, timeout=_PATIENCE, set_as_default=False)
        except Exception as error:  # any error of its network
            what = f"no Dask scheduler answers at {scheduler!r} ({error})"
            raise ArgumentError(f"{what}; write its address, such as tcp://host:8786") from error
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
    """Do a job on a worker, unless it was cancelled."""
    over = threading.Event()
    state, key = get_worker().state, thread_state.key
    watch = threading.Thread(target=_watch, args=(state, key, over, threading.get_ident()))
    watch.daemon = True
    watch.start()
    try:
        return work(job)
    except KeyboardInterrupt:  # cancelled: the answer is not needed
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
