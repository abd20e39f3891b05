"""Resolution of phases, and motions on such meshes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError
from wormopt.model.given import check_kind, check_number, whole
from wormopt.model.values import numbers
from wormopt.numerics.collocation import Collocation, bernstein_matrix

# Tolerance of the sum of shares; most arcs of a mesh over breaks.
_ROUNDING, _MOST = 1e-9, 1_000_000


@dataclass(frozen=True)
class Mesh:
    """How finely phases are resolved.

    Parameters
    ----------
    phases : int
        Number of phases.
    arcs : int or sequence of int
        Arcs per phase, alike for all or one number each.
    collocation : Collocation
        Scheme and degree of the state polynomials on each arc.
    input_degree : int, optional
        Degree of the input polynomials; 0 is piecewise constant. With ``collocation.degree - 2``
        a state two integrations behind the input is still represented exactly.
    shares : sequence of float, optional
        Part that each arc has of its phase's duration; without it durations of arcs are free.
    spans : tuple of float, optional
        Shortest and longest duration of an arc, where durations are free.

    Raises
    ------
    ArgumentError
        If the numbers are not whole, do not fit each other, or the shares of a phase are not
        positive parts of 1.

    Examples
    --------
    >>> mesh = Mesh.even(2, 4, Collocation(3))
    >>> mesh.total, mesh.shares[:4]
    (8, (0.25, 0.25, 0.25, 0.25))
    """

    phases: int
    arcs: int | Sequence[int]
    collocation: Collocation
    input_degree: int = 0
    shares: Sequence[float] | None = None
    spans: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        check_kind("collocation", self.collocation, Collocation)
        for name, least in (("phases", 1), ("input_degree", 0)):
            object.__setattr__(self, name, whole(name, getattr(self, name), least))
        object.__setattr__(self, "arcs", _arcs(self.arcs, self.phases))
        if self.shares is None:
            return
        shares = numbers("shares", self.shares)
        fit = shares.shape == (self.total,) and np.all((shares > 0) & (shares < np.inf))
        if not fit or np.any(np.abs(np.bincount(self.phase, shares) - 1) > _ROUNDING):
            raise ArgumentError(
                f"shares must be positive numbers, one for each of {self.total} arcs, with sum 1 "
                f"in each phase, not {self.shares!r:.60}; Mesh.even makes equal ones"
            )
        object.__setattr__(self, "shares", tuple(shares.tolist()))

    @classmethod
    def even(
        cls,
        phases: int,
        arcs: int | Sequence[int],
        collocation: Collocation,
        input_degree: int = 0,
    ) -> Mesh:
        """Make a mesh on which all arcs of a phase are equally long.

        Parameters
        ----------
        phases : int
            Number of phases.
        arcs : int or sequence of int
            Arcs per phase.
        collocation : Collocation
            Scheme and degree.
        input_degree : int, optional
            Degree of the inputs.
        """
        plain = cls(phases, arcs, collocation, input_degree)
        return replace(plain, shares=tuple(1 / n for n in plain.counts for _ in range(n)))

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

        Raises
        ------
        ArgumentError
            If the breaks are not finite or do not ascend, ``longest`` is not positive, or there are
            more than a million arcs.

        Examples
        --------
        >>> Mesh.over([0.0, 1.0, 4.0], 1.5, Collocation(2)).shares
        (0.25, 0.375, 0.375)
        """
        times = numbers("breaks", breaks)
        pieces = np.diff(times)
        if times.ndim != 1 or not (pieces.size and np.all((pieces > 0) & (pieces < np.inf))):
            raise ArgumentError(f"breaks must ascend and be finite, not {breaks!r:.60}")
        check_number("longest", longest, above=0.0)
        if np.sum(pieces) / _MOST > longest:
            raise ArgumentError(
                f"longest is {longest:g} over a span of {np.sum(pieces):g}: more than {_MOST:,} "
                "arcs; write a larger number"
            )
        counts = np.ceil(pieces / longest - 1e-9).astype(int)
        shares = np.repeat(pieces / counts / pieces.sum(), counts)
        return cls(1, len(shares), collocation, input_degree, tuple(shares.tolist()))

    @property
    def counts(self) -> tuple[int, ...]:
        """Arcs of each phase."""
        return tuple(self.arcs) if isinstance(self.arcs, Sequence) else (self.arcs,) * self.phases

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


def _arcs(given: object, phases: int) -> int | tuple[int, ...]:
    """Arcs per phase, whole numbers from 1 on; raises ArgumentError if they are none."""
    if not isinstance(given, Sequence | np.ndarray) or not np.ndim(given):
        return whole("arcs", given, 1)
    if len(given) != phases:
        raise ArgumentError(
            f"arcs has {len(given)} entries for {phases} phases; write one number, or {phases}"
        )
    return tuple(whole("arcs", one, 1) for one in given)


@dataclass(frozen=True)
class Arcs:
    """A motion from the optimiser, arc by arc, in the model's own units.

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
    """Matrix (m, n) from values at nodes (n,) to the interpolating polynomial at targets (m,)."""
    # Nodes are distinct; all places are in [0, 1].
    degree = len(nodes) - 1
    basis = np.polynomial.legendre.legvander(2 * nodes - 1, degree)
    return np.linalg.solve(basis.T, np.polynomial.legendre.legvander(2 * targets - 1, degree).T).T
