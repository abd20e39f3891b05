"""A film with a float as compiled equations of CVODES, from one function of a cell.

The flow through the right face of a cell and its parts of the force on the float, the work of the
field and the dissipated energy depend on a few neighbouring cells. They and their derivatives are
short expressions, which compiled code evaluates for eight cells at a time: the code of all cells
takes minutes to compile, and its interpreter ten times as long to evaluate.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib.resources import files
from typing import Any

import casadi as ca
import numpy as np

from wormopt.control.drive import drive
from wormopt.model.gait import Gait
from wormopt.model.model import Model
from wormopt.progress import Report
from wormopt.simulation.native.build import CompilerError, library, parts
from wormopt.simulation.native.model_code import HEADERS, LANES, in_vectors, number
from wormopt.simulation.options import Exact, Tolerance
from wormopt.simulation.routes import integrate
from wormopt.simulation.simulate import task_of, trajectory_of
from wormopt.simulation.trajectory import Trajectory
from wormopt.systems.coils.film import FilmSetup, Layer, RowField, dragged, sizes_of, surface_pull

_STEPS = 200_000
_NEAR = 2  # cells beyond a cell and the next one that matter, on either side
_CELLS = 2 * _NEAR + 2
_OWN = slice(_NEAR, _NEAR + 2)  # the cell and the next one among them
_ARGUMENTS = {
    "volume": "NEXT(volume[{}])",
    "middle": "NEXT(middle[{}])",
    "face": "NEXT(face[{}])",
    "inner": "NEXT(inner[{}])",
    "field": "NEXT(field[N * ({0} / 2) + {0} % 2])",
    "common": "ALL(common[{}])",
}
_JACOBIANS = ["jac:ode:x", "jac:alg:x", "jac:ode:z", "jac:alg:z"]
_FUNCTIONS = {
    "dae": ("t x z p u", "ode alg quad zero"),
    "daeF": ("t x z p u", "ode alg"),
    "jacF": ("t x z p u", " ".join(_JACOBIANS).replace(":", "_")),
}  # names that CasADi's integrators look for


@dataclass(frozen=True)
class Layout:
    """Which equations to compile: states, and inputs of the field's coefficients over time."""

    sums: int  # states that are sums over cells: velocity, or also work and dissipated energy
    powers: int  # of time in a coefficient
    p: int  # size
    u: int  # size
    given: str  # C expressions: the coefficients, ...
    since: str  # ... their time, ...
    pace: str  # ... and seconds per unit of time


def of_piece(count: int) -> Layout:
    """Equations over a piece of a pattern, from 0 to 1: p is its length, begin and growth."""
    return Layout(1, 2, 1 + 2 * count, 0, "arg[3] + 1", "t", "arg[3][0]")


def of_schedule(count: int, powers: int, p: int) -> Layout:
    """Equations of a driven Model: u holds the start of a piece, its coefficients, and a stop."""
    return Layout(3, powers, p, 2 + powers * count, "arg[4] + 1", "t - arg[4][0]", "1.0")


def compiled(setup: FilmSetup, layout: Layout) -> ca.Function | None:
    """Return the equations in states of nominal size as one compiled function with a Jacobian.

    None without a compiler or a float, in films that are periodic or of very few cells, and for
    fluids whose law has operations without vectors.
    """
    if setup.cargo is None or setup.layer.ends != "walls" or setup.layer.cells < LANES:
        return None
    text = _source(setup, layout)
    if text is None:
        return None
    try:
        built = library("film", [*parts(*HEADERS), ("film.c", text)])
        found = ca.external("dae", built._name)  # noqa: SLF001  where ctypes keeps the path
        found.factory("jacF", [*"txzpu"], _JACOBIANS)  # as CVODES asks for it
    except (CompilerError, RuntimeError):  # on Windows CasADi refuses some characters in the path
        return None
    return found


def simulate_film(
    setup: FilmSetup, currents: Gait, times: np.ndarray, tolerance: float, report: Report
) -> Trajectory:
    """Return the motion under periodic currents until the last of the times."""
    model = _driven(setup, currents)
    task = task_of(
        model, float(times[-1]), Exact(), x0={"position": setup.start} if setup.cargo else None,
        p=None, schedules=None, times=times, dense=False,
        tolerance=Tolerance(tolerance, tolerance, max_steps=_STEPS), sensitivities=None,
    )  # fmt: skip
    _, count, powers = currents.polynomial.shape
    layout = of_schedule(setup.field.terms(np.zeros(count)).size, powers, task.system.n_fixed)
    task = replace(task, equations=compiled(setup, layout))
    return trajectory_of(task, integrate(task, "cvodes", report))


@lru_cache(maxsize=4)  # shorter steps need no other model
def _driven(setup: FilmSetup, currents: Gait) -> Model:
    terms = np.moveaxis(setup.field.terms(np.moveaxis(currents.polynomial, 1, 0)), 0, 1)
    return drive(setup.model_by_terms(), Gait(currents.breaks, terms), periodic=True)


@dataclass(frozen=True)
class _Window(Layer):
    """Neighbouring cells of a layer, at symbolic places."""

    start: Any = 0.0
    middles: Any = None

    @property
    def places(self) -> Any:
        return self.middles


def _local(setup: FilmSetup, sums: int) -> tuple[ca.Function, ca.Function]:
    """Return the function of a cell, and the same with its derivatives, see film.c."""
    layer, cargo, field = setup.layer, setup.cargo, setup.field
    assert cargo
    area, length, speed, *spent = sizes_of(layer, cargo)
    volume, middles, face, inner, terms, common = given = [
        ca.SX.sym(name, size)
        for name, size in zip(
            _ARGUMENTS, (_CELLS + 1, _CELLS, 1, 1, 2 * _rows(setup), 3), strict=True
        )
    ]
    X, V, pace = ca.vertsplit(common * ca.DM([length, speed, 1.0]))
    window = _Window(
        layer.fluid, layer.viscosity, layer.depth, layer.step * _CELLS, _CELLS,
        face - (_NEAR + 1) * layer.step, middles=middles,
    )  # fmt: skip
    h = layer.depth + area * (volume[1:] - volume[:-1]) / layer.step
    # each cell has its own X: the derivative by that of the own cell is its part of the force
    thick, each = ca.SX.sym("h", _CELLS), ca.SX.sym("X", _CELLS)
    right = cargo.coverage(window, face + layer.step * (np.arange(_CELLS) - _NEAR), each)
    energy = window.energy(thick, right) + cargo.stored(window, thick, each)
    by_h, by_X = ca.substitute(
        [ca.gradient(energy, thick)[_OWN], ca.gradient(energy, each)[_NEAR]],
        [thick, each], [h, ca.repmat(X, _CELLS, 1)],
    )  # fmt: skip
    present = np.any(field.series, axis=(1, 2, 3))[:, None, None, None]
    pair = RowField(present * np.ones((3, field.series.shape[1], 2, 1)), field.top)
    slope = window.slope(h)[_OWN]
    pull = surface_pull(
        layer.fluid, pair.by_terms(h[_OWN], terms), slope, own_field=setup.own_field
    )
    P = by_h / layer.step - pull
    # without velocity and gradient on all other faces, each sum is the term of this face
    own = np.eye(_CELLS - 1)[_NEAR]
    flow, shear, lost = dragged(window, cargo, h, X, own * V, own * ((P[1] - P[0]) / layer.step))
    at = ca.SX.sym("X")
    (stop,) = ca.substitute([ca.gradient(cargo.stopped(layer, at), at)], [at], [X])
    totals = [
        (inner * shear - by_X - stop / layer.cells) / cargo.mass / speed,
        *(inner * one / spent[0] for one in (flow[_NEAR] * (pull[1] - pull[0]), lost)),
    ]
    ode = pace * ca.vertcat(-flow[_NEAR] / area, *totals[:sums])
    slopes = ca.densify(ca.jacobian(ode, ca.vertcat(volume, common[:2])))
    return (
        ca.Function("local", given, [ca.cse(ode)]),
        ca.Function("local_slopes", given, [ca.cse(ca.vertcat(ode, ca.vec(slopes.T)))]),
    )


def _rows(setup: FilmSetup) -> int:
    """Number of coefficients of the field in a cell."""
    return setup.field.terms(np.zeros(setup.row.count)).size // setup.layer.cells


def _source(setup: FilmSetup, layout: Layout) -> str | None:
    """Return the C code; None if a law has operations without vectors."""
    layer = setup.layer
    assert setup.cargo
    _, length, speed, *_ = sizes_of(layer, setup.cargo)
    arguments = ", ".join(f"const double *{name}" for name in _ARGUMENTS) + ", double *out"
    bodies = [f"typedef void Local({arguments});"]
    for function in _local(setup, layout.sums):
        lines = in_vectors(function, [*_ARGUMENTS.values()], "NEXT(out[{} * N]) = {}")
        if lines is None:
            return None
        bodies += [f"static void {function.name()}({arguments})", "{", *lines, "}"]
    macros = {
        "START": number(layer.start), "STEP": number(layer.step),
        "VELOCITY": number(speed / length), "PACE": layout.pace, "GIVEN": f"({layout.given})",
        "SINCE": f"({layout.since})",
    }  # fmt: skip
    sizes = {"N": layer.cells, "ROWS": _rows(setup), "NEAR": _NEAR}
    sizes |= {"SUMS": layout.sums, "POWERS": layout.powers}
    return "\n".join([
        '#include "vectors.h"',
        f"enum {{ {', '.join(f'{name} = {value}' for name, value in sizes.items())} }};",
        *(f"#define {name} {value}" for name, value in macros.items()),
        *bodies,
        *_described(_sparsities(layer.cells, layout)),
        (files("wormopt.systems.coils") / "film.c").read_text(encoding="utf-8"),
    ])  # fmt: skip


def _sparsities(cells: int, layout: Layout) -> dict[str, ca.Sparsity]:
    """Sparsities of all inputs and outputs."""
    m, n = cells - 1, cells + layout.sums
    faces, near = np.arange(m), range(-_NEAR - 1, _NEAR + 2)
    entries = [
        *((faces[max(k, 0) : m + min(k, 0)], faces[max(-k, 0) : m + min(-k, 0)]) for k in near),
        *((faces, np.full(m, column)) for column in (m, m + 1)),
        ([m], [m + 1]),
        *((np.full(m + 2, row), np.arange(m + 2)) for row in range(m + 1, n)),
    ]
    rows, columns = (np.concatenate(part).tolist() for part in zip(*entries, strict=True))
    none = ca.Sparsity(0, 1)
    return {
        "t": ca.Sparsity.dense(1, 1), "x": ca.Sparsity.dense(n, 1), "z": none,
        "p": ca.Sparsity.dense(layout.p, 1), "u": ca.Sparsity.dense(layout.u, 1),
        "ode": ca.Sparsity.dense(n, 1), "alg": none, "quad": none, "zero": none,
        "jac_ode_x": ca.Sparsity.triplet(n, n, rows, columns), "jac_alg_x": ca.Sparsity(0, n),
        "jac_ode_z": ca.Sparsity(n, 0), "jac_alg_z": ca.Sparsity(0, 0),
    }  # fmt: skip


def _described(sparsities: dict[str, ca.Sparsity]) -> list[str]:
    """Return C functions that describe names and sparsities of inputs and outputs to CasADi."""
    lines = []
    for function, sides in _FUNCTIONS.items():
        for side, text in zip(("in", "out"), sides, strict=True):
            names = text.split()
            shapes = [sparsities[name].compress() for name in names]
            lines += [
                f"long long {function}_n_{side}(void) {{ return {len(names)}; }}",
                f"const char *{function}_name_{side}(long long k)",
                "{ static const char *const all[] =",
                f"  {_listed(map(_quoted, names))}; return all[k]; }}",
                f"const long long *{function}_sparsity_{side}(long long k)",
                f"{{ static const long long all[][{max(map(len, shapes))}] =",
                f"  {_listed(_listed(map(str, shape)) for shape in shapes)}; return all[k]; }}",
            ]
    return lines


def _quoted(name: str) -> str:
    return f'"{name}"'


def _listed(values: Iterable[str]) -> str:
    return f"{{{', '.join(values)}}}"
