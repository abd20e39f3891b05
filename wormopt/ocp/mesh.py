"""How finely phases are resolved, and motions on such meshes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from wormopt.numerics.collocation import Collocation, bernstein_matrix


@dataclass(frozen=True)
class Mesh:
    """How finely phases are resolved.

    Parameters
    ----------
    phases : int
        Number of phases.
    arcs : int or tuple of int
        Arcs per phase, alike for all or one number each.
    collocation : Collocation
        Scheme and degree of the state polynomials on each arc.
    input_degree : int, optional
        Degree of the input polynomials; 0 is piecewise constant. With ``collocation.degree - 2``
        a state two integrations behind the input is still represented exactly.
    shares : tuple of float, optional
        Part that each arc has of its phase's duration; without it durations of arcs are free.

    Raises
    ------
    ValueError
        If the numbers do not fit each other or shares are not positive.

    Examples
    --------
    >>> mesh = Mesh.even(2, 4, Collocation(3))
    >>> mesh.total, mesh.shares[:4]
    (8, (0.25, 0.25, 0.25, 0.25))
    """

    phases: int
    arcs: int | tuple[int, ...]
    collocation: Collocation
    input_degree: int = 0
    shares: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        if len(self.counts) != self.phases or min(self.counts) < 1:
            raise ValueError("a mesh needs at least one arc in each of its phases")
        if self.shares is None:
            return
        if len(self.shares) != self.total or not min(self.shares) > 0:
            raise ValueError(f"a mesh of {self.total} arcs needs as many positive shares")

    @classmethod
    def even(
        cls,
        phases: int,
        arcs: int | tuple[int, ...],
        collocation: Collocation,
        input_degree: int = 0,
    ) -> Mesh:
        """Make a mesh on which all arcs of a phase are equally long.

        Parameters
        ----------
        phases : int
            Number of phases.
        arcs : int or tuple of int
            Arcs per phase.
        collocation : Collocation
            Scheme and degree.
        input_degree : int, optional
            Degree of the inputs.

        Returns
        -------
        Mesh
        """
        counts = arcs if isinstance(arcs, tuple) else (arcs,) * phases
        shares = tuple(1 / n for n in counts for _ in range(n))
        return cls(phases, arcs, collocation, input_degree, shares)

    @classmethod
    def over(
        cls, breaks: ArrayLike, longest: float, collocation: Collocation, input_degree: int = 0
    ) -> Mesh:
        """Make a mesh of one phase whose arcs cross no break, for motions of known duration.

        Parameters
        ----------
        breaks : array_like, shape (m,)
            Times from the start of the motion to its end, ascending, `Model.breaks` say.
        longest : float
            No arc is longer; arcs between the same breaks are equally long.
        collocation : Collocation
            Scheme and degree.
        input_degree : int, optional
            Degree of the inputs.

        Returns
        -------
        Mesh

        Raises
        ------
        ValueError
            If the breaks do not ascend or ``longest`` is not positive.

        Examples
        --------
        >>> Mesh.over([0.0, 1.0, 4.0], 1.5, Collocation(2)).shares
        (0.25, 0.375, 0.375)
        """
        pieces = np.diff(np.asarray(breaks, dtype=float))
        if not (pieces.size and np.all(pieces > 0) and longest > 0):
            raise ValueError("breaks must ascend, and arcs must be longer than 0")
        counts = np.ceil(pieces / longest - 1e-9).astype(int)
        shares = np.repeat(pieces / counts / pieces.sum(), counts)
        return cls(1, len(shares), collocation, input_degree, tuple(shares.tolist()))

    @property
    def counts(self) -> tuple[int, ...]:
        """Arcs of each phase."""
        return self.arcs if isinstance(self.arcs, tuple) else (int(self.arcs),) * self.phases

    @property
    def total(self) -> int:
        """Number of arcs in all phases."""
        return sum(self.counts)

    @property
    def phase(self) -> np.ndarray:
        """Phase of each arc, shape (total,)."""
        return np.repeat(np.arange(self.phases), self.counts)

    @property
    def inputs_at_points(self) -> np.ndarray:
        """Matrix from an input's Bernstein coefficients to its values at collocation points."""
        return self.inputs_at(self.collocation.tau)

    def inputs_at(self, s: np.ndarray) -> np.ndarray:
        """Matrix from an input's Bernstein coefficients to its values at places on an arc.

        Parameters
        ----------
        s : ndarray, shape (m,)
            Places in [0, 1].

        Returns
        -------
        ndarray, shape (m, input_degree + 1)
        """
        nodes = self.input_nodes
        return interpolation(nodes, s) @ np.linalg.inv(bernstein_matrix(nodes))

    @property
    def input_nodes(self) -> np.ndarray:
        """Equidistant nodes that define the input polynomials."""
        return np.linspace(0, 1, self.input_degree + 1) if self.input_degree else np.array([0.5])


@dataclass(frozen=True)
class Arcs:
    """A motion as it left the optimiser, arc by arc, in the model's own units.

    N is the number of arcs; points are the collocation points of an arc in order.
    """

    duration: np.ndarray  # (N,) 0 allowed
    start: np.ndarray  # (n_x, N) states at the start, after its impulses
    points: np.ndarray  # (n_x, degree, N) states
    inputs: np.ndarray  # (n_u, input_degree + 1, N) Bernstein coefficients
    slacks: np.ndarray  # (n_s, degree, N)
    algebraic: np.ndarray  # (n_z, degree, N)
    unknowns: np.ndarray  # (n_unknowns, degree, N) of contacts, forces first
    jumps: np.ndarray  # (n_u + contacts, N) impulses in nominal size times time; may have no rows
    design: np.ndarray  # (n_p,) design constants

    @property
    def states(self) -> np.ndarray:
        """States at the nodes of the collocation, shape (n_x, degree + 1, N)."""
        return np.concatenate([self.start[:, None], self.points], axis=1)


def on_finer_mesh(arcs: Arcs, coarse: Mesh, mesh: Mesh) -> Arcs:
    """Represent a motion of one mesh on a finer one: more arcs of equal parts, higher degrees.

    `mesh` has as many phases, a multiple of the arcs, no lower degrees. Impulses stay at the
    start of the first part of their arc.
    """
    split = mesh.total // coarse.total
    with_start, states = coarse.collocation.nodes, arcs.states
    parts = [(np.arange(split) + offset) / split for offset in (0.0, 1.0)]

    def on(nodes: np.ndarray, values: np.ndarray, targets: np.ndarray) -> np.ndarray:
        """Values of the interpolant at targets within each part: (rows, targets, N split)."""
        at = parts[0][:, None] + (parts[1] - parts[0])[:, None] * targets
        matrix = interpolation(nodes, at.ravel())
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
        algebraic=on(old, arcs.algebraic, new),
        unknowns=on(old, arcs.unknowns, new),
        jumps=jumps,
        design=arcs.design,
    )


def interpolation(nodes: np.ndarray, targets: np.ndarray) -> np.ndarray:
    """Matrix (m, n) from values at nodes (n,) to the interpolating polynomial at targets (m,).

    Nodes are distinct; all places are in [0, 1].
    """
    degree = len(nodes) - 1
    basis = np.polynomial.legendre.legvander(2 * nodes - 1, degree)
    return np.linalg.solve(basis.T, np.polynomial.legendre.legvander(2 * targets - 1, degree).T).T
