"""Many motions of one system, several side by side in one thread."""

from __future__ import annotations

import ctypes
from collections.abc import Iterable, Iterator
from ctypes import c_void_p
from itertools import islice

from wormopt.progress import Report
from wormopt.simulation.functions import System
from wormopt.simulation.initial_value import InitialValueProblem, Outcome
from wormopt.simulation.native import kernel, lanes


def takes(system: System) -> bool:
    """Whether motions of a system can be integrated side by side; compiles the functions.

    Raises CompilerError if there is no compiler or it fails.
    """
    if (system.exact and system.shares) or system.model.alg.numel():
        return False
    return lanes.compiled(system) is not None and bool(kernel.compiled(system))


def integrate(
    tasks: Iterable[InitialValueProblem],
    report: Report,
    stiff_steps: int,
) -> Iterator[tuple[InitialValueProblem, Outcome]]:
    """Integrate tasks that differ in numbers only; yields each with its outcome when it ends.

    A lane whose run has ended takes the next task. Raises the errors of `kernel.integrate`.
    """
    waiting = iter(tasks)
    under_way: list[kernel.Run] = []
    stopped = False
    try:
        while True:
            free = lanes.LANES - len(under_way)
            under_way += (_begun(task, stiff_steps) for task in islice(waiting, free))
            if not under_way:
                return
            try:
                report("simulating", None)
            except KeyboardInterrupt:
                stopped = True
            if not stopped:
                _advance(under_way)
            for run in [*under_way]:
                if run.ended or stopped:
                    yield run.task, run.outcome(None if run.ended else "interrupted")
                    under_way.remove(run)
                    run.free()
    finally:
        for run in under_way:
            run.free()


def _begun(task: InitialValueProblem, stiff_steps: int) -> kernel.Run:
    return kernel.Run(task, kernel.compiled(task.system), stiff_steps)


def _advance(runs: list[kernel.Run]) -> None:
    library = lanes.compiled(runs[0].task.system)
    assert library is not None  # see `takes`
    rhs = ctypes.cast(library.rhs, c_void_p)
    addresses = (c_void_p * len(runs))(*(ctypes.cast(run.address, c_void_p) for run in runs))
    steps = kernel.work_per_call(runs[0].task) // len(runs)
    if kernel.driver().wormopt_advance_lanes(addresses, len(runs), rhs, steps):
        raise MemoryError("no memory for the lanes")
