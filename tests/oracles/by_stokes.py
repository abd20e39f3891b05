"""Slow flow under a wave in two dimensions, by Taylor-Hood elements of scikit-fem.

The strip 0 < s < 2 pi, 0 < Z < 1 stands for the film seen from its wave, z = Z h(s). Unknown are
the velocity U along and, in place of the one upward, that across the lines Z = const,
W - Z h' U: it is 0 on the ground and on the surface, and no shear on the surface is natural.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sparse

TURN = 2 * np.pi


@dataclass(frozen=True)
class SlowFlow:
    """What a film of any thickness does."""

    mean_flow: float
    drift: float  # of a small float; 1 if held


def slow_flow(wave: Any, eps: float, along: int = 48, up: int = 8) -> SlowFlow:
    """`wave` tells its height by phase, and derivatives; elements along and up."""
    skfem = pytest.importorskip("skfem")
    mesh = skfem.MeshQuad.init_tensor(np.linspace(0, TURN, along + 1), np.linspace(0, 1, up + 1))
    mesh = mesh.with_boundaries({"ground": lambda x: x[1] == 0, "top": lambda x: x[1] == 1})
    velocity = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementQuad2()), intorder=6)
    pressure = velocity.with_element(skfem.ElementQuad1())

    def gradient(v: Any, w: Any) -> tuple[Any, Any, Any, Any]:
        """Derivatives by x and z of the velocities along and upward."""
        h, slope, bend = (wave.height(w.x[0], order) for order in range(3))
        Z, U = w.x[1], v[0]
        (U_s, U_Z), (across_s, across_Z) = v.grad[0], v.grad[1]
        W_s = Z * (bend * U + slope * U_s) + across_s
        W_Z = slope * (U + Z * U_Z) + across_Z
        tilt = Z * slope / h
        return U_s - tilt * U_Z, U_Z / h, W_s - tilt * W_Z, W_Z / h

    @skfem.BilinearForm
    def viscous(u: Any, v: Any, w: Any) -> Any:
        (u_x, u_z, w_x, w_z), (a_x, a_z, b_x, b_z) = gradient(u, w), gradient(v, w)
        stretch = 2 * eps**2 * (u_x * a_x + w_z * b_z)
        return wave.height(w.x[0]) * (stretch + (u_z + eps**2 * w_x) * (a_z + eps**2 * b_x))

    @skfem.BilinearForm
    def continuity(u: Any, q: Any, w: Any) -> Any:
        u_x, _, _, w_z = gradient(u, w)
        return -wave.height(w.x[0]) * q * (u_x + w_z)

    B = continuity.assemble(velocity, pressure)
    matrix = sparse.bmat([[viscous.assemble(velocity), B.T], [B, None]], format="csr")
    found = _solved(matrix, velocity, pressure)

    @skfem.Functional
    def flow(w: Any) -> Any:
        return wave.height(w.x[0]) * w["seen"][0]

    @skfem.Functional
    def turn(w: Any) -> Any:
        return -1 / w["seen"][0]

    top = velocity.boundary("top")
    mean_flow = 1 + flow.assemble(velocity, seen=velocity.interpolate(found)) / TURN
    surface = top.interpolate(found)
    held = found[_along(velocity, "top")].max() >= 0
    return SlowFlow(mean_flow, 1.0 if held else 1 - TURN / turn.assemble(top, seen=surface))


def _along(velocity: Any, boundary: str) -> np.ndarray:
    return np.intersect1d(velocity.get_dofs(boundary).all(), velocity.split_indices()[0])


def _solved(matrix: Any, velocity: Any, pressure: Any) -> np.ndarray:
    """Velocities that repeat after a wavelength, over a ground that runs backward."""
    count = matrix.shape[0]
    same = np.arange(count)
    first, second = velocity.split_indices()
    for unknowns, basis, before in (
        (first, velocity, 0),
        (second, velocity, 0),
        (np.arange(pressure.N), pressure, velocity.N),
    ):
        s = basis.doflocs[0, unknowns]
        left, right = (unknowns[np.abs(s - end) < 1e-9] for end in (0, TURN))
        left, right = (each[np.argsort(basis.doflocs[1, each])] for each in (left, right))
        same[right + before] = left + before
    repeat = sparse.csr_matrix((np.ones(count), (np.arange(count), same)), shape=(count, count))
    given = np.zeros(count)
    given[_along(velocity, "ground")] = -1.0
    fixed = [
        velocity.get_dofs("ground").all(),
        np.intersect1d(velocity.get_dofs("top").all(), second),
        np.flatnonzero(same != np.arange(count)),
        [velocity.N],  # a pressure
    ]
    given[fixed[2]] = 0.0
    skfem = pytest.importorskip("skfem")
    system = skfem.condense(
        repeat.T @ matrix @ repeat, np.zeros(count), x=given, D=np.unique(np.concatenate(fixed))
    )
    return (repeat @ skfem.solve(*system))[: velocity.N]
