"""The compiled driver, called through ctypes with Python's lock released."""

from __future__ import annotations

import ctypes
from collections.abc import Iterable, Iterator
from ctypes import POINTER, Structure, c_double, c_longlong, c_void_p
from dataclasses import dataclass
from functools import cache, lru_cache
from itertools import islice, zip_longest
from typing import Any

import numpy as np

from wormopt.progress import Report
from wormopt.progress import Report as Progress
from wormopt.simulation.functions import System
from wormopt.simulation.initial_value import SLACK, InitialValueProblem, Outcome
from wormopt.simulation.native import model_code
from wormopt.simulation.native.build import library, parts
from wormopt.simulation.variation import Variation

_FUNCTIONS = ("rhs", "velocities", "probe", "aims", "bends", "project", "guards", "resets")
_STATUS = {
    1: "done",
    -1: "step_too_small",
    -2: "not_finite",
    -3: "too_many_steps",
    -4: "stiff",
    -5: "events_accumulate",
    -6: "no_contact_mode",
    -7: "no_memory",
    -8: "steep_derivatives",
    -9: "open_force",
}
_ALONG = (
    *("slopes", "contacts_along", "project_along", "guards_along", "resets_along"),
    *("contact_parts", "guard_parts"),
)
_CODE = (
    *("run.c", "variation.c", "stepper.c", "layer.c", "aiming.c", "doubts.c"),
    *("crossings.c", "contact.c", "driver.c", "lanes.c"),
)
_HEADERS = ("driver.h", "run.h", "tableau.h", "stages.h", "lanes.h")
# A call of the driver lasts some hundredths of a second, so that it can be interrupted.
_WORK_PER_CALL = 400_000


class _Schedule(Structure):
    _fields_ = (
        ("start", c_double),
        *((name, c_longlong) for name in ("pieces", "size", "offset", "periodic")),
        ("breaks", c_void_p),
        ("values", c_void_p),
        ("along", c_void_p),
    )


class _Entries(Structure):
    _fields_ = (("count", c_longlong), ("rows", c_void_p), ("columns", c_void_p))


class _Problem(Structure):
    """`Problem` of driver.h."""

    _fields_ = (
        *(
            (name, c_longlong)
            for name in (
                *("n_x", "n_all", "n_model", "n_p", "k"),
                *("n_contacts", "n_rows", "n_s", "n_switches", "n_schedules", "n_times"),
                *("n_iw", "n_w", "n_arg", "n_res"),
                *("exact", "coupled", "shares", "keep_dense", "max_steps", "stiff_steps"),
                "keep",
            )
        ),
        *((name, c_void_p) for name in (*_FUNCTIONS, *_ALONG, "own_stages")),
        ("in_x", _Entries),
        ("in_p", _Entries),
        *(
            (name, c_void_p)
            for name in (
                *("velocity_state", "planar", "row_contact", "row_state"),
                *("directions", "terminal", "crosses"),
                *(
                    "v_rest",
                    "v_drift",
                    "f_rest",
                    "v_stop",
                    "nominal_force",
                    "nominal_speed",
                    "reach",
                    "v_layer",
                ),
                *("absolute", "column_size"),
                *("schedules", "times"),
            )
        ),
        *((name, c_double) for name in ("relative", "max_step", "t_start", "t_end")),
        *((name, c_double) for name in ("small_rate", "small_value", "unit", "slack")),
    )


class _Table(Structure):
    _fields_ = (
        ("data", POINTER(c_double)),
        *((name, c_longlong) for name in ("rows", "width", "room")),
    )

    def view(self) -> np.ndarray:
        """Rows; valid as long as the run has its memory."""
        if self.rows == 0:
            return np.zeros((0, self.width))
        return np.ctypeslib.as_array(self.data, (self.rows, self.width))

    def array(self) -> np.ndarray:
        return self.view().copy()


class _Report(Structure):
    """`Report` of driver.h."""

    _fields_ = (
        ("t", c_double),
        ("h", c_double),
        *(
            (name, c_longlong)
            for name in ("status", "n_steps", "n_rejected", "n_evaluations", "n_sampled")
        ),
        *((name, POINTER(c_double)) for name in ("x", "p", "samples")),
        *((name, _Table) for name in ("events", "modes", "doubts", "dense", "kept")),
    )


@cache
def driver() -> ctypes.CDLL:
    """Load the driver; compile it if necessary."""
    # as one unit, so that calls between files can be inlined
    code = "\n".join(text for _, text in parts(*_CODE))
    found = library("driver", [*parts(*_HEADERS), ("unit.c", code)], "-O3")
    found.wormopt_start.restype = POINTER(_Report)
    found.wormopt_start.argtypes = [POINTER(_Problem), c_void_p, c_void_p]
    found.wormopt_advance.restype = c_longlong
    found.wormopt_advance.argtypes = [POINTER(_Report), c_longlong]
    found.wormopt_advance_lanes.restype = c_longlong
    found.wormopt_advance_lanes.argtypes = [c_void_p, c_longlong, c_void_p, c_longlong]
    found.wormopt_free.restype = None
    found.wormopt_free.argtypes = [POINTER(_Report)]
    return found


@dataclass(frozen=True, eq=False)
class Compiled:
    """Input of the driver that depends on the system only."""

    fields: dict[str, int]  # entries of the problem: numbers and addresses
    arrays: dict[str, np.ndarray]  # kept alive: fields are addresses only
    library: ctypes.CDLL  # kept loaded as long as the addresses are in use
    entries: tuple[np.ndarray, ...]  # positions of entries of Jacobians, see `Variation`


@lru_cache(maxsize=64)
def compiled(system: System, variation: Variation | None = None) -> Compiled:
    """Compile the functions of a system, with or without derivatives, or find them in the cache."""
    driver()
    functions = system.functions | (variation.functions if variation else {})
    found, n_w = model_code.compiled(list(functions.values()))
    fields = {
        "n_contacts": len(system.contacts),
        "n_rows": len(system.row_contact),
        "n_s": system.n_s,
        "n_switches": len(system.model.switches),
        "n_iw": max(f.sz_iw() for f in functions.values()),
        "n_w": max(n_w, *(f.sz_w() for f in functions.values())),
        "n_arg": max(f.sz_arg() for f in functions.values()),
        "n_res": max(f.sz_res() for f in functions.values()),
        "exact": system.exact,
        "coupled": system.exact and system.coupled,
        "shares": system.exact and system.shares,
    }
    for name in (*functions, "own_stages"):
        if hasattr(found, name):
            fields[name] = ctypes.cast(getattr(found, name), c_void_p).value or 0
    places = np.full(len(system.contacts), -1)
    places[system.planar] = np.arange(len(system.planar))
    ways = [(1,) if c.planar else c.law.directions for c in system.contacts]
    prescribed, geared = (system.prescribed, system.geared) if system.exact else ((), ())
    directions = [
        (1 in each) + 2 * (-1 in each) + 4 * (i in prescribed) + 8 * (i in geared)
        for i, each in enumerate(ways)
    ]
    arrays = {
        "velocity_state": system.velocity_state,
        "planar": places.astype(np.int64),
        "row_contact": system.row_contact.astype(np.int64),
        "row_state": system.row_state,
        "nominal_speed": np.array([c.nominal_speed for c in system.contacts], dtype=float),
        "nominal_force": np.array([c.nominal_force for c in system.contacts], dtype=float),
        "directions": np.array(directions, dtype=np.int64),
        "terminal": np.array([s.terminal for s in system.model.switches], dtype=np.int64),
        "crosses": np.array([s.crosses for s in system.model.switches], dtype=np.int64),
    }
    fields |= {name: array.ctypes.data for name, array in arrays.items()}
    entries = variation.entries if variation else ()
    return Compiled(fields, arrays, found, entries)


def _schedules(task: InitialValueProblem) -> tuple[ctypes.Array, list[np.ndarray]]:
    """Mirror schedules; the arrays must live as long as the mirror."""
    kept, rows, offset = [], [], task.system.n_fixed
    directions = task.directions.schedules if task.directions else ()
    for schedule, along in zip_longest(task.schedules, directions):
        breaks = np.ascontiguousarray(schedule.breaks, dtype=float)
        values = np.ascontiguousarray(schedule.values, dtype=float)
        size = values.shape[1]
        kept += [breaks, values]
        rows.append(
            _Schedule(
                schedule.start,
                len(values),
                size,
                offset,
                schedule.periodic,
                breaks.ctypes.data,
                values.ctypes.data,
                None if along is None else along.ctypes.data,
            )
        )
        offset += 1 + size
    return (_Schedule * len(rows))(*rows), kept


def _mirrored(entries: np.ndarray) -> _Entries:
    """Number, rows and columns of entries."""
    rows, columns = (entries[i].ctypes.data for i in range(2))
    return _Entries(entries.shape[1], rows, columns)


def integrate(
    task: InitialValueProblem, ready: Compiled, report: Progress, stiff_steps: int
) -> Outcome:
    """Integrate a task by the compiled driver; raises MemoryError if no memory is left.

    A smooth motion is given up where stability alone would need `stiff_steps` more steps.
    """
    run = Run(task, ready, stiff_steps)
    start, end = task.span
    try:
        report("simulating", 0.0)
        while driver().wormopt_advance(run.address, work_per_call(task)) == 0:
            report("simulating", (run.time - start) / (end - start))
        return run.outcome()
    except KeyboardInterrupt:
        return run.outcome("interrupted")
    finally:
        run.free()


def work_per_call(task: InitialValueProblem) -> int:
    """Number of steps for a call of the driver."""
    return max(_WORK_PER_CALL // len(task.start), 20)


class Run:
    """One running motion and its arrays; MemoryError if memory is exhausted."""

    def __init__(self, task: InitialValueProblem, ready: Compiled, stiff_steps: int) -> None:
        self.task = task
        problem, self._kept = _problem(task, ready, stiff_steps)
        x0, p = np.ascontiguousarray(task.start), np.ascontiguousarray(task.all_p)
        self.address = driver().wormopt_start(ctypes.byref(problem), x0.ctypes.data, p.ctypes.data)
        if not self.address:
            raise MemoryError("no memory for the requested samples")

    @property
    def time(self) -> float:
        """Time reached."""
        return float(self.address.contents.t)

    @property
    def ended(self) -> bool:
        """Whether it has ended."""
        return bool(self.address.contents.status)

    def outcome(self, status: str | None = None) -> Outcome:
        """Results so far, with its own status or another."""
        found = self.address.contents
        return _outcome(found, status or _STATUS[found.status], self.task)

    def free(self) -> None:
        """Free its memory."""
        driver().wormopt_free(self.address)


def _problem(
    task: InitialValueProblem, ready: Compiled, stiff_steps: int
) -> tuple[_Problem, list[Any]]:
    """Mirror a task; the second result must live as long as the mirror."""
    schedules, kept = _schedules(task)
    arrays = {
        "v_rest": task.v_rest,
        "v_drift": task.v_drift,
        "f_rest": task.f_rest,
        "v_stop": task.v_stop,
        "reach": np.ascontiguousarray(task.reach),
        "v_layer": task.v_layer,
        "absolute": task.absolute,
        "column_size": task.column_sizes,
        "times": np.ascontiguousarray(task.times, dtype=float),
    }
    problem = _Problem(
        n_x=len(task.x0),
        n_all=len(task.start),
        n_model=task.system.model.n_x,
        n_p=len(task.p),
        k=task.k,
        n_schedules=len(task.schedules),
        n_times=len(task.times),
        keep_dense=task.dense,
        keep=task.keep,
        max_steps=task.tolerance.max_steps,
        stiff_steps=2**62 if task.system.exact else stiff_steps,
        schedules=ctypes.cast(schedules, c_void_p),
        relative=task.tolerance.relative,
        max_step=task.max_step,
        t_start=task.span[0],
        t_end=task.span[1],
        small_rate=task.small_rate,
        small_value=task.small_value,
        unit=task.tolerance.absolute,
        slack=SLACK,
        **ready.fields,
        **dict(zip(("in_x", "in_p"), map(_mirrored, ready.entries), strict=False)),
        **{name: array.ctypes.data for name, array in arrays.items()},
    )
    return problem, [schedules, arrays, task, ready, *kept]


def _outcome(found: _Report, status: str, task: InitialValueProblem) -> Outcome:
    n_x, dense = len(task.start), found.dense.view()
    samples = np.ctypeslib.as_array(found.samples, (max(found.n_sampled, 1), n_x))
    return Outcome(
        status=status,
        route="native",
        t=found.t,
        x=np.ctypeslib.as_array(found.x, (n_x,)).copy(),
        samples=samples[: found.n_sampled].copy(),
        n_steps=found.n_steps,
        n_rejected=found.n_rejected,
        n_evaluations=found.n_evaluations,
        events=found.events.array(),
        modes=found.modes.array(),
        doubts=found.doubts.array(),
        kept=found.kept.array(),
        dense_time=np.concatenate([[task.span[0]], dense[:, 0]]) if task.dense else np.zeros(0),
        dense=dense[:, 1:].copy().reshape(len(dense), 8, n_x),
    )


def takes(system: System) -> bool:
    """Whether motions of a system can be integrated side by side; compiles the functions."""
    if (system.exact and system.shares) or system.model.alg.numel():
        return False
    return model_code.compiled_lanes(system) is not None and bool(compiled(system))


def integrate_side_by_side(
    tasks: Iterable[InitialValueProblem],
    report: Report,
    stiff_steps: int,
) -> Iterator[tuple[InitialValueProblem, Outcome]]:
    """Integrate tasks that differ in numbers only; yields each with its outcome when it ends.

    A lane whose run has ended takes the next task. Raises the errors of `integrate`.
    """
    waiting = iter(tasks)
    under_way: list[Run] = []
    stopped = False
    try:
        while True:
            free = model_code.LANES - len(under_way)
            under_way += (_begun(task, stiff_steps) for task in islice(waiting, free))
            if not under_way:
                return
            try:
                report("simulating", None)
            except KeyboardInterrupt:
                stopped = True
            if not stopped:
                _advance_lanes(under_way)
            for run in [*under_way]:
                if run.ended or stopped:
                    yield run.task, run.outcome(None if run.ended else "interrupted")
                    under_way.remove(run)
                    run.free()
    finally:
        for run in under_way:
            run.free()


def _begun(task: InitialValueProblem, stiff_steps: int) -> Run:
    return Run(task, compiled(task.system), stiff_steps)


def _advance_lanes(runs: list[Run]) -> None:
    library = model_code.compiled_lanes(runs[0].task.system)
    assert library is not None  # see `takes`
    rhs = ctypes.cast(library.rhs, c_void_p)
    addresses = (c_void_p * len(runs))(*(ctypes.cast(run.address, c_void_p) for run in runs))
    steps = work_per_call(runs[0].task) // len(runs)
    if driver().wormopt_advance_lanes(addresses, len(runs), rhs, steps):
        raise MemoryError("no memory for the ensemble")
