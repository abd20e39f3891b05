"""Natural frequencies of a thick rod on pins, beside scikit-fem and differences by SciPy."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np
import scipy.sparse as sparse
from scipy.linalg import eigh
from scipy.sparse.linalg import eigsh

from tests.benchmarks.ladder import Run, Task, Way
from tests.benchmarks.run import OWN
from tests.oracles.beams import thick_beam
from wormopt.analysis.vibration import vibration_modes
from wormopt.systems.channel.rod import Rod
from wormopt.systems.channel.rod_model import channel_rod

_COUNT = 3  # frequencies
_PINNED = {"across": [0, -1]}


def task(_name: str, _quick: bool) -> Task:
    """The lowest frequencies across of a rubber rod of twelve diameters."""
    exact = np.array([thick_beam(_rod(1, 2), k + 1) for k in range(_COUNT)])
    ways = [
        *(Way(OWN if d == 3 else f"{OWN}, degree {d}", partial(_own, d, exact), meshes)
          for d, meshes in ((3, (4, 8, 16)), (2, (4, 8, 16, 32)))),
        Way("scikit-fem, P2, dense", partial(_skfem, True, exact), (4, 8, 16, 32, 64, 128)),
        Way("scikit-fem, P2, ARPACK", partial(_skfem, False, exact), (8, 16, 32, 64, 128, 256)),
        Way("SciPy, differences", partial(_differences, exact), (16, 64, 256, 1024, 4096)),
    ]  # fmt: skip
    return Task(
        f"the {_COUNT} lowest frequencies across of a thick rod on pins",
        "Timoshenko's beam in closed form",
        "frequencies, relative",
        "elements, or cells",
        1e-6,
        np.ones(_COUNT),
        ways,
    )


def _rod(elements: int, degree: int) -> Rod:
    return Rod(48e-3, 4e-3, 5e4, 1100.0, elements=elements, degree=degree)


def _own(degree: int, exact: np.ndarray) -> Run:
    def run(elements: float) -> np.ndarray:
        model = channel_rod(_rod(int(elements), degree), 11e-3, 0.5)
        modes = vibration_modes(model, _PINNED, count=12)
        along, across = (np.abs(modes.shapes[name]).max(axis=0) for name in ("along", "across"))
        bends = (modes.frequencies > 0) & (across > along)
        return modes.frequencies[bends][:_COUNT] / exact

    return run


def _lowest(K: Any, M: Any, dense: bool) -> np.ndarray:
    if dense:
        values = eigh(K.toarray(), M.toarray(), eigvals_only=True, subset_by_index=[0, _COUNT - 1])
    else:
        values = np.sort(eigsh(K, _COUNT, M, sigma=0.0, return_eigenvectors=False))
    return np.sqrt(values) / (2 * math.pi)


def _skfem(dense: bool, exact: np.ndarray) -> Run:
    """Deflection and angle on elements of degree 2; shear at two points, so that none locks."""
    import skfem

    rod = _rod(1, 2)
    resist, length = rod.stiffness(), rod.length
    bend, shear = resist.bending / length**2, resist.shearing
    mass, turning = (rod.density * part for part in (rod.area * length**2, rod.second_moment))

    @skfem.BilinearForm
    def stiffness(w: Any, a: Any, w_: Any, a_: Any, _: Any) -> Any:
        sheared = (w.grad[0] - a) * (w_.grad[0] - a_)
        return shear * sheared + bend * a.grad[0] * a_.grad[0]

    @skfem.BilinearForm
    def inertia(w: Any, a: Any, w_: Any, a_: Any, _: Any) -> Any:
        return mass * w * w_ + turning * a * a_

    def run(elements: float) -> np.ndarray:
        mesh = skfem.MeshLine(np.linspace(0, 1, int(elements) + 1))
        both = skfem.ElementLineP2() * skfem.ElementLineP2()
        few, many = (skfem.Basis(mesh, both, intorder=order) for order in (3, 5))
        free = few.complement_dofs(few.get_dofs().all("u^1"))
        K, M = stiffness.assemble(few), inertia.assemble(many)
        return _lowest(K[free][:, free], M[free][:, free], dense) / exact

    return run


def _differences(exact: np.ndarray) -> Run:
    """Deflections at the places between cells, angles in their middles: order two, banded."""
    rod = _rod(1, 2)
    resist = rod.stiffness()

    def run(cells: float) -> np.ndarray:
        n, h = int(cells), rod.length / int(cells)
        # slopes of w, which is 0 at both ends; curvatures between cells, none at the pins
        slope = sparse.eye(n, n - 1) / h - sparse.eye(n, n - 1, -1) / h
        bent = sparse.eye(n - 1, n, 1) / h - sparse.eye(n - 1, n) / h
        sheared = sparse.hstack([slope, -sparse.eye(n)])
        curved = sparse.hstack([sparse.csr_matrix((n - 1, n - 1)), bent])
        K = resist.shearing * sheared.T @ sheared + resist.bending * curved.T @ curved
        per_length = [rod.area] * (n - 1) + [rod.second_moment] * n
        M = sparse.diags(rod.density * np.array(per_length))
        return _lowest(K.tocsc(), M.tocsc(), False) / exact

    return run
