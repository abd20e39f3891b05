"""How finely phases are resolved, and motions on such meshes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wormopt.optimal.collocation import Collocation, bernstein_matrix

__all__ = ["Arcs", "Mesh", "on_finer_mesh"]


@dataclass(frozen=True)
class Mesh:
    """How finely phases are resolved.

    Parameters
    ----------
    phases : int
        Number of contact phases.
    arcs : int
        Arcs of free duration per phase.
    collocation : Collocation
        Scheme and degree of the state polynomials on each arc.
    input_degree : int
        Degree of the input polynomials; 0 is piecewise constant. With ``collocation.degree - 2``
        a state two integrations behind the input is still represented exactly.
    """

    phases: int
    arcs: int
    collocation: Collocation
    input_degree: int = 0

    @property
    def total(self) -> int:
        """Number of arcs in all phases."""
        return self.phases * self.arcs

    @property
    def inputs_at_points(self) -> np.ndarray:
        """Matrix from an input's Bernstein coefficients to its values at collocation points."""
        nodes = self.input_nodes
        powers = np.arange(self.input_degree + 1)
        to_values = self.collocation.tau[:, None] ** powers
        return (
            to_values
            @ np.linalg.inv(nodes[:, None] ** powers)
            @ np.linalg.inv(bernstein_matrix(nodes))
        )

    @property
    def input_nodes(self) -> np.ndarray:
        """Equidistant nodes that define the input polynomials."""
        return np.linspace(0, 1, self.input_degree + 1) if self.input_degree else np.array([0.5])


@dataclass(frozen=True)
class Arcs:
    """A motion as it left the optimiser, arc by arc, in the model's own units.

    Shapes are in the number of arcs N, of scalars in each group of signals and of the mesh's
    degrees. Columns of points are the collocation points of an arc in order.

    Parameters
    ----------
    duration : ndarray, shape (N,)
        Duration of each arc, 0 allowed.
    start : ndarray, shape (n_x, N)
        States at the start of each arc, after its impulses.
    points : ndarray, shape (n_x, degree, N)
        States at the collocation points.
    inputs : ndarray, shape (n_u, input_degree + 1, N)
        Bernstein coefficients of the inputs.
    slacks : ndarray, shape (n_s, degree, N)
        Slacks at the collocation points.
    forces : ndarray, shape (contacts, degree, N)
        Contact forces at the collocation points.
    jumps : ndarray, shape (n_u + contacts, N)
        Impulses of inputs and contacts at the start of each arc, in nominal sizes times nominal
        time; no rows where the problem allows none.
    design : ndarray, shape (n_p,)
        Design constants.
    phase : ndarray of int, shape (N,)
        Phase of each arc.
    """

    duration: np.ndarray
    start: np.ndarray
    points: np.ndarray
    inputs: np.ndarray
    slacks: np.ndarray
    forces: np.ndarray
    jumps: np.ndarray
    design: np.ndarray
    phase: np.ndarray


def on_finer_mesh(arcs: Arcs, coarse: Mesh, mesh: Mesh) -> Arcs:
    """Represent a motion of one mesh on a finer one: more arcs of equal parts, higher degrees.

    Parameters
    ----------
    arcs : Arcs
        Motion on the coarse mesh.
    coarse : Mesh
        Its mesh.
    mesh : Mesh
        As many phases, a multiple of the arcs, no lower degrees.

    Returns
    -------
    Arcs
        The same motion; impulses stay at the start of the first part of their arc.
    """
    split = mesh.arcs // coarse.arcs
    with_start = np.concatenate([[0.0], coarse.collocation.tau])
    states = np.concatenate([arcs.start[:, None], arcs.points], axis=1)
    parts = [(np.arange(split) + offset) / split for offset in (0.0, 1.0)]

    def on(nodes: np.ndarray, values: np.ndarray, targets: np.ndarray) -> np.ndarray:
        """Values of the interpolant at targets within each part: (rows, targets, N split)."""
        at = parts[0][:, None] + (parts[1] - parts[0])[:, None] * targets
        matrix = _interpolation(nodes, at.ravel())
        fine = np.einsum("tk,rkn->rnt", matrix, values)
        shape = (values.shape[0], values.shape[2] * split, len(targets))
        return np.swapaxes(fine.reshape(shape), 1, 2)

    old, new = coarse.collocation.tau, mesh.collocation.tau
    inputs = np.einsum(
        "tk,rkn->rtn", np.linalg.inv(bernstein_matrix(coarse.input_nodes)), arcs.inputs
    )
    fine_inputs = on(coarse.input_nodes, inputs, mesh.input_nodes)
    jumps = np.zeros((arcs.jumps.shape[0], mesh.total))
    jumps[:, ::split] = arcs.jumps
    return Arcs(
        duration=np.repeat(arcs.duration / split, split),
        start=on(with_start, states, np.zeros(1))[:, 0],
        points=on(with_start, states, new),
        inputs=np.einsum("tk,rkn->rtn", bernstein_matrix(mesh.input_nodes), fine_inputs),
        slacks=on(old, arcs.slacks, new),
        forces=on(old, arcs.forces, new),
        jumps=jumps,
        design=arcs.design,
        phase=np.repeat(np.arange(mesh.phases), mesh.arcs),
    )


def _interpolation(nodes: np.ndarray, targets: np.ndarray) -> np.ndarray:
    """Matrix from values at nodes to values of the interpolating polynomial at targets."""
    degree = len(nodes) - 1
    basis = np.polynomial.legendre.legvander(2 * nodes - 1, degree)
    return np.linalg.solve(basis.T, np.polynomial.legendre.legvander(2 * targets - 1, degree).T).T
