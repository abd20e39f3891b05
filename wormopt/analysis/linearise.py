"""Linear analysis of a Model at an operating point: zeros, relative degree, gain, response.

A system y = G(s) u with as many outputs as inputs can be tracked by high gain, as by the
lambda-trackers (13) and (14), if its high-frequency gain is positive definite and it is minimum
phase: with outputs held at zero, the remaining motion decays. For the chain (8)-(12) with link
lengths as outputs that is the common motion of all masses, whose zero is -sum k_i / sum m_i with
the slopes k_i of drag and friction.

The position of a worm changes neither rates nor outputs. This shift, a zero at 0, is ignored for
minimum phase; see `LinearModel.phase_kind`.

Invariant zeros are the points s where the pencil [[A - s I, B], [C, D]] (Rosenbrock) loses rank. As
a generalised eigenvalue problem it has infinite eigenvalues in blocks, which rounding turns into
large finite ones. They are removed first, by orthogonal transformations and rank decisions [1]_;
this works for any number of inputs and outputs, including redundant ones.

References
----------
.. [1] A. Emami-Naeini and P. Van Dooren, "Computation of zeros of linear multivariable systems",
   Automatica 18 (1982) 415-430.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import casadi as ca
import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray

from wormopt.errors import ArgumentError
from wormopt.model.explicit import Explicit, import_control
from wormopt.model.model import Model
from wormopt.model.values import signal_values
from wormopt.shown import Part, brief, html, lines

Matrices = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""A (n, n), B (n, m), C (p, n) and D (p, m)."""


# Tolerance of rank decisions, in rounding errors of whole matrices. It allows for entries with own
# rounding errors: 10 is too small for four states mixed by a matrix of condition 100, 1000 loses
# weak couplings of a chain.
_ROUNDINGS = 100.0


@dataclass(frozen=True)
class _Rank:
    """Singular values up to ``least`` are zero."""

    least: float

    @classmethod
    def of(cls, matrices: Matrices) -> _Rank:
        return cls(_ROUNDINGS * _rounding(matrices))

    def split(self, matrix: np.ndarray) -> tuple[int, np.ndarray, np.ndarray]:
        """Rank, left and right singular vectors; those of the null spaces are last."""
        rows, columns = matrix.shape
        if matrix.size == 0:
            return 0, np.eye(rows), np.eye(columns)
        left, values, right = scipy.linalg.svd(matrix)
        return int(np.sum(values > self.least)), left, right.T


def _rounding(matrices: Matrices) -> float:
    """Rounding error of a zero in matrices of this size."""
    a, b, c, d = matrices
    whole = np.block([[a, b], [c, d]])
    return max(*whole.shape, 1) * np.finfo(float).eps * float(np.linalg.norm(whole))


def balanced(matrices: Matrices) -> Matrices:
    """Scale states, inputs and outputs by powers of 2 to similar sizes; zeros stay."""
    a, b, c, d = matrices
    n, size = len(a), len(a) + max(b.shape[1], c.shape[0])
    square = np.zeros((size, size))
    square[:n, :n], square[:n, n : n + b.shape[1]] = a, b
    square[n : n + len(c), :n], square[n : n + len(c), n : n + b.shape[1]] = c, d
    if size == 0:
        return matrices
    even = np.asarray(scipy.linalg.matrix_balance(square, permute=False)[0])
    rows, columns = slice(n, n + len(c)), slice(n, n + b.shape[1])
    return even[:n, :n], even[:n, columns], even[rows, :n], even[rows, columns]


def without_shifts(matrices: Matrices) -> tuple[Matrices, int]:
    """Remove, and count, the shifts: directions of states changing neither rates nor outputs."""
    # A shift, such as a worm's position, is a pole and a zero at 0 that cancel. Their number is the
    # dimension of the common null space of A and C.
    a, b, c, d = matrices
    # stricter than for zeros: a weakly damped motion must not pass for a shift
    rank, _, right = _Rank(_rounding(matrices)).split(np.vstack([a, c]))
    keep = right[:, :rank]
    return (keep.T @ a @ keep, keep.T @ b, c @ keep, d), len(a) - rank


def _row_full(matrices: Matrices, rank: _Rank) -> Matrices:
    """Equivalent system whose D has full row rank: outputs of higher relative degree drop out."""
    # An output without feed-through must stay zero, which constrains states; its rate must be 0
    # too, and is an output of the reduced system. Each round removes one order of infinite zeros.
    a, b, c, d = matrices
    while True:
        through, left, _ = rank.split(d)
        d, c = (left.T @ d)[:through], left.T @ c
        c, silent = c[:through], c[through:]
        tied, _, right = rank.split(silent)
        if tied == 0:
            return a, b, c, d
        bound, free = right[:, :tied], right[:, tied:]
        d = np.vstack([bound.T @ b, d])
        c = np.vstack([bound.T @ a @ free, c @ free])
        a, b = free.T @ a @ free, free.T @ b


def _dual(matrices: Matrices) -> Matrices:
    a, b, c, d = matrices
    return a.T, c.T, b.T, d.T


def invariant_zeros(matrices: Matrices) -> tuple[NDArray[np.complex128], np.ndarray]:
    """Find the finite invariant zeros (k,), and bounds of their rounding errors (k,).

    They are the transmission zeros and the hidden modes (uncontrollable or unobservable).
    Sorted by real, then imaginary part; bounds are first-order. Apply `balanced` first.
    """
    rounding, rank = _rounding(matrices), _Rank.of(matrices)
    a, b, c, d = _dual(_row_full(_dual(_row_full(matrices, rank)), rank))
    n = len(a)
    if n == 0:
        return np.zeros(0, dtype=complex), np.zeros(0)
    # D is square and regular now: n numbers parametrise the null space of [C, D]
    kernel = np.linalg.qr(np.hstack([c, d]).T, mode="complete")[0][:, len(d) :]
    stiff, mass = np.hstack([a, b]) @ kernel, kernel[:n]
    found: Any = scipy.linalg.eig(stiff, mass, left=True, right=True)
    zeros, left, right = found
    weight = np.abs(np.sum(left.conj() * (mass @ right), axis=0))
    norms = np.linalg.norm(left, axis=0) * np.linalg.norm(right, axis=0)
    with np.errstate(divide="ignore"):
        uncertainty = norms / weight * (rounding + np.abs(zeros) * n * np.finfo(float).eps)
    order = np.lexsort((zeros.imag, zeros.real))
    return zeros[order].astype(complex), uncertainty[order]


Values = Mapping[str, ArrayLike]

PhaseKind = Literal["minimum phase", "marginal", "not minimum phase"]
"""Position of the zeros: all left of the imaginary axis, some on it, some right of it."""

_MOST_POLES = 20  # in the table of a notebook
_REGULAR = 1e12  # condition up to which a matrix is regular


@dataclass(frozen=True, eq=False)
class LinearModel:
    """Linear system x' = A x + B u, y = C x + D u of deviations from an operating point.

    Parameters
    ----------
    name : str
        Name of the system.
    A, B, C, D : ndarray, shapes (n, n), (n, m), (p, n), (p, m)
        Matrices.
    states, inputs, outputs : tuple of str
        Names of the n states, m inputs and p outputs.

    Raises
    ------
    ArgumentError
        If shapes and names do not fit, or an entry is not finite.

    Examples
    --------
    A mass 2 on a dashpot 1, force to position, has the transfer function 1 / (s (2 s + 1)):

    >>> a, b = np.array([[0.0, 1.0], [0.0, -0.5]]), np.array([[0.0], [0.5]])
    >>> c, d = np.eye(2)[:1], np.zeros((1, 1))
    >>> cart = LinearModel("cart", a, b, c, d, ("x", "v"), ("f",), ("y",))
    >>> cart.relative_degree, cart.high_frequency_gain, cart.poles.real
    ((2,), array([[0.5]]), array([-0.5,  0. ]))
    """

    name: str
    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]

    def __post_init__(self) -> None:
        n, m, p = len(self.states), len(self.inputs), len(self.outputs)
        shapes = ((n, n), (n, m), (p, n), (p, m))
        if tuple(matrix.shape for matrix in self._matrices) != shapes:
            raise ArgumentError(f"{self.name}: A, B, C, D must have the shapes {shapes}")
        if not all(np.all(np.isfinite(matrix)) for matrix in self._matrices):
            raise ArgumentError(f"{self.name}: the matrices have entries that are not finite")

    def __repr__(self) -> str:
        sizes = f"{len(self.states)} states, {len(self.inputs)} inputs, {len(self.outputs)} outputs"
        return lines(f"LinearModel {self.name}: {sizes}", f"outputs {', '.join(self.outputs)}")

    def _repr_html_(self) -> str:
        names = {"states": self.states, "inputs": self.inputs, "outputs": self.outputs}
        rows = [(what, brief(list(each))) for what, each in names.items()]
        poles = [(f"{p.real:.6g}", f"{p.imag:.6g}") for p in self.poles[:_MOST_POLES]]
        cut = len(self.poles) - len(poles)
        heading = f"Poles; {cut} more are left out" if cut else "Poles"
        parts = [Part("", rows), Part(heading, [("real", "imaginary"), *poles])]
        return html(f"LinearModel {self.name}", parts)

    @property
    def _matrices(self) -> Matrices:
        return self.A, self.B, self.C, self.D

    @cached_property
    def _reduced(self) -> tuple[Matrices, int]:
        """Balanced matrices without the shifts, and their number."""
        return without_shifts(balanced(self._matrices))

    @cached_property
    def _poles(self) -> tuple[NDArray[np.complex128], np.ndarray]:
        a = self._reduced[0][0]
        n = len(a)
        return invariant_zeros((a, np.zeros((n, 0)), np.zeros((0, n)), np.zeros((0, 0))))

    @cached_property
    def _zeros(self) -> tuple[NDArray[np.complex128], np.ndarray]:
        zeros = invariant_zeros(self._reduced[0])
        expected = self._zero_count
        if expected is not None and len(zeros[0]) + self.shifts != expected:
            raise ArgumentError(
                f"{self.name}: the entries of its matrices differ too much in size to separate "
                f"its {expected} zeros from those at infinity"
            )
        return zeros

    @property
    def _zero_count(self) -> int | None:
        """Number of finite zeros from another formula, n - sum of r, if the gain is regular."""
        gain = self.high_frequency_gain
        if gain.shape[0] != gain.shape[1] or math.inf in self.relative_degree:
            return None
        for axis in (1, 0, 1, 0) if gain.size else ():
            largest = np.abs(gain).max(axis=axis, keepdims=True)
            gain = gain / np.where(largest > 0, largest, 1.0)
        if gain.size and not np.linalg.cond(gain) < _REGULAR:
            return None
        return len(self.states) - int(sum(self.relative_degree))

    @property
    def shifts(self) -> int:
        """Number of independent shifts: directions of states that change no rate and no output."""
        return self._reduced[1]

    @property
    def poles(self) -> NDArray[np.complex128]:
        """Eigenvalues of A, sorted by real part; each shift adds an exact 0."""
        return _sorted(self._poles[0], self.shifts)

    @property
    def zeros(self) -> NDArray[np.complex128]:
        """Finite invariant zeros, sorted by real part; each shift adds an exact 0.

        They include hidden modes, which are uncontrollable or unobservable.

        Raises
        ------
        ArgumentError
            If the numbers spread over too many decades (about nine for a chain) to find them.
        """
        return _sorted(self._zeros[0], self.shifts)

    @property
    def phase_kind(self) -> PhaseKind:
        """Position of the zeros without those of the shifts.

        A zero is on the axis if rounding may have moved it off.
        """
        zeros, uncertainty = self._zeros
        if np.any(zeros.real > uncertainty):
            return "not minimum phase"
        return "marginal" if np.any(zeros.real >= -uncertainty) else "minimum phase"

    @property
    def minimum_phase(self) -> bool:
        """Whether all zeros but those of the shifts lie left of the imaginary axis."""
        return self.phase_kind == "minimum phase"

    def _markov(self) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """D, C B, C A B, ..., C A^(n-1) B, and for each entry whether it exceeds rounding."""
        yield self.D, self.D != 0
        power, size, scale = self.C, np.abs(self.C), np.ones((len(self.outputs), 1))
        for k in range(len(self.states)):
            markov = power @ self.B
            rounding = 4 * (k + 2) * len(self.states) * np.finfo(float).eps
            yield scale * markov, np.abs(markov) > rounding * (size @ np.abs(self.B))
            power, size = power @ self.A, size @ np.abs(self.A)
            # high powers of large or small numbers would leave the range of doubles
            largest = size.max(axis=1, keepdims=True)
            largest[largest == 0] = 1.0
            power, size, scale = power / largest, size / largest, scale * largest

    @cached_property
    def _leading(self) -> tuple[tuple[float, ...], np.ndarray]:
        """Relative degree and leading Markov parameter of each output."""
        degrees, gain = [math.inf] * len(self.outputs), np.zeros(self.D.shape)
        for degree, (markov, reached) in enumerate(self._markov()):
            for i in np.flatnonzero(reached.any(axis=1)):
                if degrees[i] == math.inf:
                    degrees[i], gain[i] = degree, markov[i]
            if math.inf not in degrees:
                break
        return tuple(degrees), gain

    @cached_property
    def _reached(self) -> np.ndarray:
        """Whether each input has any effect on each output, shape (p, m)."""
        reached = np.zeros(self.D.shape, dtype=bool)
        for _, more in self._markov():
            reached |= more
            if reached.all():
                break
        return reached

    @property
    def relative_degree(self) -> tuple[float, ...]:
        """For each output the order of its first derivative in which an input appears.

        0 is feed-through, inf an output that no input reaches. Together they are the vector
        relative degree where `high_frequency_gain` has full rank.
        """
        return self._leading[0]

    @property
    def high_frequency_gain(self) -> np.ndarray:
        """Factors of the inputs in these derivatives, rows C A^(r-1) B, shape (p, m)."""
        return self._leading[1]

    def frequency_response(self, omega: ArrayLike) -> np.ndarray:
        """Evaluate G(i omega) = C (i omega I - A)^-1 B + D.

        Parameters
        ----------
        omega : array_like, shape (k,)
            Angular frequencies, in 1 / time.

        Returns
        -------
        ndarray of complex, shape (p, m, k)
            Amplitude and phase of each output for each input; exactly 0 where the input has no
            effect.

        Raises
        ------
        ArgumentError
            If a frequency is a pole, be it one that no output shows.

        Examples
        --------
        >>> low_pass = LinearModel("low", -np.eye(1), np.eye(1), np.eye(1), np.zeros((1, 1)),
        ...                   ("x",), ("u",), ("y",))
        >>> low_pass.frequency_response([1.0])[0, 0].round(12)
        array([0.5-0.5j])
        """
        frequencies = np.asarray(omega, dtype=float).ravel()
        poles, uncertainty = self._poles
        singular = np.any(np.abs(1j * frequencies[:, None] - poles) <= uncertainty, axis=1)
        if singular.any():
            which = frequencies[singular][0]
            raise ArgumentError(f"the frequency {which:g} is a pole of the system; leave it out")
        a, b, c, _ = self._quotient
        unit = np.eye(len(a))
        columns = [c @ np.linalg.solve(1j * w * unit - a, b) for w in frequencies]
        response = np.array(columns, dtype=complex).reshape(len(frequencies), *self.D.shape)
        return np.moveaxis((response + self.D) * self._reached, 0, -1)

    @cached_property
    def _quotient(self) -> Matrices:
        """Matrices without the shifts, in the units of inputs and outputs."""
        return without_shifts(self._matrices)[0]

    def to_control(self) -> Any:
        """Make a control.StateSpace of it, with names, for python-control's own tools."""
        return import_control().ss(
            *self._matrices,
            name=self.name,
            states=list(self.states),
            inputs=list(self.inputs),
            outputs=list(self.outputs),
        )


def _sorted(values: NDArray[np.complex128], shifts: int) -> NDArray[np.complex128]:
    values = np.append(values, np.zeros(shifts, dtype=complex))
    return values[np.lexsort((values.imag, values.real))]


def linearise(
    model: Model,
    *,
    output: str | Sequence[str],
    x: Values | None = None,
    u: Values | None = None,
    p: Values | None = None,
    v_reg: float = 1 / 40,
    t: float = 0.0,
) -> LinearModel:
    """Linearise a model at an operating point, by exact derivatives.

    Contacts follow the smooth law: where a mass slides faster than a few v_reg, dry friction is a
    constant force and has no part in the result; at rest its slope is (F+ + F-) / (2 v_reg).
    Discrete events of the model have no part in it either, and where the operating point is no
    equilibrium the result describes small deviations from the motion through it, for a time in
    which that does not go far.

    Parameters
    ----------
    model : Model
        The model.
    output : str or sequence of str
        Names of its outputs, which are y.
    x : mapping of str to array_like, optional
        States of the operating point by name; by default the start values of the model.
    u : mapping of str to array_like, optional
        Inputs of the operating point by name; by default those of the model, or 0.
    p : mapping of str to array_like, optional
        Parameters by name, where they are not the model's own.
    v_reg : float, optional
        Width of the smooth law, positive.
    t : float, optional
        Time, where the model depends on it.

    Returns
    -------
    Linear

    Raises
    ------
    ArgumentError
        If names or sizes do not fit the model, it has algebraic variables, or ``v_reg`` is not
        positive.
    UnknownNameError
        If the model has no such output.

    Examples
    --------
    >>> from wormopt.systems.chain.build import chain
    >>> worm = chain(2, mass=0.5, stiffness=10.0, damping=5.0, rest_length=2.0, drag=0.1)
    >>> linear = linearise(worm, output="length")
    >>> linear.relative_degree, linear.phase_kind, linear.high_frequency_gain
    ((2, 2), 'minimum phase', array([[ 4., -2.], [-2., 4.]]))
    >>> linear.zeros.real.round(12), linear.outputs
    (array([-0.2,  0. ]), ('length[0]', 'length[1]'))
    """
    if not v_reg > 0:
        raise ArgumentError("v_reg must be positive: the set-valued law has no slope")
    explicit = Explicit(model, output)
    symbols = explicit.symbols
    matrices = explicit.function(
        "linear",
        *(ca.jacobian(f, symbols[w]) for f in (explicit.rates, explicit.observed) for w in "xu"),
    )(
        t,
        signal_values(model.x, x, "state", fill=0.0),
        signal_values(model.u, u, "input", fill=0.0),
        signal_values(model.p, p, "parameter"),
        v_reg,
        explicit.scheduled(t),
    )
    return LinearModel(model.name, *(matrix.full() for matrix in matrices), **explicit.names)
