"""LQR with feed-forward: linear feedback of the error, its gains from a Riccati equation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from wormopt.control.loop import Reference, TrackingError, at_zero, close, gait_reference, input_of
from wormopt.errors import ArgumentError
from wormopt.model.gait import Gait
from wormopt.model.model import Model, Output, Signal, lie, pack
from wormopt.model.values import numbers, signal_values


def lqr(
    plant: Model,
    reference: Reference,
    *,
    error_weight: ArrayLike,
    rate_weight: ArrayLike = 0.0,
    input_weight: ArrayLike = 1.0,
    p: Mapping[str, ArrayLike] | None = None,
    feedforward: Gait | None = None,
    output: str = "length",
    input: str = "input",  # noqa: A002
) -> Model:
    """Close the loop by linear-quadratic feedback of the error and its rate.

    Without contact the links of a chain follow M y'' + D y' + S y + f = u, where M^-1 = dy''/du
    is the high-frequency gain. With e = y - y_ref the controller is

    u = M y_ref'' + D y_ref' + S y_ref + f - K_0 e - K_1 e',

    where K = (K_0, K_1) minimises the integral of e^T Q_0 e + e'^T Q_1 e' + v^T R v for
    M e'' + D e' + S e = v [1]_. Without drag and load this feed-forward is
    c (y_ref - l0) + d y_ref' + M y_ref''.

    M, D, S, f and K are numbers, taken once from the assumed plant. They are parameters of the loop
    beside the plant's own, so the controller does not notice changes of the plant by
    ``simulate(loop, p=...)``.

    Accelerations of links by other states than y and y', such as the velocity of the whole worm
    under unequal drag, are left out, as if the mean of position and velocity were 0.
    Contact forces are left out too.

    Parameters
    ----------
    plant : Model
        With an input and an output of relative degree two, of as many entries, linear in states
        and input but for its contacts.
    reference : Reference
        Reference of the output; ``gait_reference(..., periodic=False)`` for one that ends.
    error_weight, rate_weight, input_weight : array_like, shape (), (n,) or (n, n)
        Q_0 and Q_1, positive semidefinite, and R, positive definite. A number, or one per
        link, is for the diagonal. Only their ratios matter.
    p : mapping of str to array_like, optional
        Parameters that the controller assumes, if they differ from those of the model.
        Time-varying values are taken at time 0.
    feedforward : Gait, optional
        Inputs over time, optimal ones for example, instead of the computed feed-forward: from time
        0 on, repeated if the reference is, otherwise with their last value after the end.
    output, input : str, optional
        Names of the plant's output or state that follows the reference, and of the input.

    Returns
    -------
    Model
        The plant's states. Parameters: the plant's, ``error_gain`` K_0 and ``rate_gain`` K_1,
        and without `feedforward` ``feedforward_inertia`` M, ``feedforward_damping`` D,
        ``feedforward_stiffness`` S (matrices row by row) and ``feedforward_force`` f. Outputs:
        the plant's, ``reference``, ``error``, ``error_norm``, the input under its name,
        ``feedforward``, and ``saturated`` where the input has bounds, which then hold.
        The schedule ``feedforward`` contains given inputs.

    Raises
    ------
    ArgumentError
        If the plant has no such output or input, sizes of plant, reference or feedforward differ,
        a weight is no such matrix, the plant is not linear or has delays, its inputs do not
        accelerate all links at once, or no optimal feedback is stable.

    References
    ----------
    .. [1] B. D. O. Anderson and J. B. Moore, "Optimal Control: Linear Quadratic Methods",
       Prentice-Hall (1990).

    Examples
    --------
    One link between equal masses 1 has M = 1/2. Without spring and damper the gains are those of
    a double integrator, sqrt(Q_0/R) and sqrt(2 M) (Q_0/R)^(1/4):

    >>> from wormopt.systems.chain.build import chain
    >>> worm = chain(1, mass=1.0, stiffness=0.0, damping=0.0, rest_length=2.0)
    >>> still = Gait(np.array([0.0, 1.0]), np.full((1, 1, 1), 2.5))
    >>> loop = lqr(worm, gait_reference(still, worm.t), error_weight=16.0)
    >>> {s.name: np.round(s.value, 12).tolist() for s in loop.p if s.name.endswith("gain")}
    {'error_gain': [4.0], 'rate_gain': [2.0]}
    """
    error = TrackingError.of(plant, reference, output)
    plant.refuse_delays("LQR")
    n = error.value.numel()
    links = _Links.of(plant, plant[output], input_of(plant, n, input), p)
    Q0, Q1 = _weight("error_weight", error_weight, n), _weight("rate_weight", rate_weight, n)
    Q = np.block([[Q0, np.zeros((n, n))], [np.zeros((n, n)), Q1]])
    gains = _riccati(*links.pair, Q, _weight("input_weight", input_weight, n))
    k0, error_gain = _matrix("error_gain", gains[:, :n], error.per("stiffness"))
    k1, rate_gain = _matrix("rate_gain", gains[:, n:], error.per("drag"))
    if feedforward is None:
        ahead, believed = links.force(reference, error)
        schedules = ()
    else:
        given = _given(feedforward, plant, reference)
        ahead, believed, schedules = given.value, (), given.schedules
    return close(
        plant,
        reference,
        error,
        ahead - k0 @ error.value - k1 @ error.rate,
        name="LQR",
        input=input,
        parameters=[error_gain, rate_gain, *believed],
        outputs=[Output("feedforward", ahead, error.per("force"))],
        schedules=schedules,
    )


@dataclass(frozen=True)
class _Links:
    """Links without contact, M y'' + D y' + S y + f = u."""

    inertia: np.ndarray
    damping: np.ndarray
    stiffness: np.ndarray
    rest: np.ndarray

    @classmethod
    def of(
        cls, plant: Model, y: ca.SX, driven: Signal, p: Mapping[str, ArrayLike] | None
    ) -> _Links:
        """Extract them from a plant, by Lie derivatives of its output y; `driven` is its input."""
        x, u, n = pack(plant.x), driven.symbol, driven.size
        rate = lie(plant, y)
        acceleration = lie(plant, rate)
        both = ca.vertcat(y, rate)
        if not ca.is_linear(ca.vertcat(both, acceleration), ca.vertcat(x, u)):
            raise ArgumentError(
                f"{plant.name} is not linear in its states and input, which lqr requires; use "
                "a tracker, which needs no model, or your own feedback"
            )
        if ca.depends_on(acceleration, pack(plant.z)):
            raise ArgumentError(f"{plant.name} has algebraic variables, which lqr does not support")
        scheduled, values = at_zero(plant.schedules)
        at = [plant.t, x, pack(plant.u), pack(plant.p), plant.forces, scheduled]
        wanted = [both, ca.jacobian(both, x), acceleration]
        wanted += [ca.jacobian(acceleration, w) for w in (x, u)]
        rest = signal_values(plant.u, {driven.name: 0.0}, "input", fill=0.0)
        believed = signal_values(plant.p, p, "parameter")
        found = ca.Function("links", at, wanted)(0, 0, rest, believed, 0, values)
        y0, C, a0, a, gain = (part.full() for part in found)
        if not np.linalg.cond(gain) < 1 / (n * np.finfo(float).eps):  # also infinite
            raise ArgumentError(f"inputs of {plant.name} do not accelerate links independently")
        # States of least norm with these y and y'.
        slopes, inertia = a @ np.linalg.pinv(C), np.linalg.inv(gain)
        stiffness, damping = np.hsplit(-inertia @ slopes, 2)
        return cls(inertia, damping, stiffness, -inertia @ (a0 - slopes @ y0))

    @property
    def pair(self) -> tuple[np.ndarray, np.ndarray]:
        """A (2n, 2n) and B (2n, n) of the error (e, e')."""
        n = len(self.inertia)
        gain = np.linalg.inv(self.inertia)
        below = -gain @ np.hstack([self.stiffness, self.damping])
        A = np.vstack([np.eye(n, 2 * n, n), below])
        return A, np.vstack([np.zeros((n, n)), gain])

    def force(self, reference: Reference, error: TrackingError) -> tuple[ca.SX, tuple[Signal, ...]]:
        """Force that keeps links on the reference, and its parameters."""
        M, inertia = _matrix("feedforward_inertia", self.inertia, error.per("mass"))
        D, damping = _matrix("feedforward_damping", self.damping, error.per("drag"))
        S, stiffness = _matrix("feedforward_stiffness", self.stiffness, error.per("stiffness"))
        f, rest = _matrix("feedforward_force", self.rest, error.per("force"))
        ahead = M @ reference.acceleration + D @ reference.rate + S @ reference.value + f
        return ahead, (inertia, damping, stiffness, rest)


def _matrix(name: str, values: np.ndarray, unit: str) -> tuple[ca.SX, Signal]:
    """Matrix of symbols and the parameter with their values, row by row."""
    matrix = ca.SX.sym(name, *values.shape)
    return matrix, Signal(name, ca.vec(matrix.T), unit, value=tuple(values.ravel().tolist()))


def _weight(name: str, given: ArrayLike, n: int) -> np.ndarray:
    """Weight of n scalars as a matrix."""
    weight = numbers(name, given)
    if weight.shape in ((), (n,)):
        weight = np.diag(np.broadcast_to(weight, n))
    if weight.shape != (n, n):
        raise ArgumentError(f"{name} must be one number, {n} or ({n}, {n}), not {weight.shape}")
    size = np.abs(weight).max()
    if not (size < np.inf and np.abs(weight - weight.T).max() <= 1e-12 * size):
        raise ArgumentError(f"{name} must be finite and symmetric")
    least = np.linalg.eigvalsh(weight)[0]
    if name == "input_weight" and not least > 0:
        raise ArgumentError(f"{name} must be positive definite")
    if not least >= -1e-12 * size:
        raise ArgumentError(f"{name} must be positive semidefinite")
    return (weight + weight.T) / 2


def _riccati(A: np.ndarray, B: np.ndarray, Q: np.ndarray, R: np.ndarray) -> np.ndarray:
    """Gain K (n, 2n) of the feedback -K (e, e')."""
    try:
        K = np.linalg.solve(R, B.T @ scipy.linalg.solve_continuous_are(A, B, Q, R))
        poles = np.linalg.eigvals(A - B @ K)
        stable = poles.real.max() < -1e-12 * np.abs(poles).max()
    except np.linalg.LinAlgError:
        K, stable = np.zeros(B.T.shape), False
    # A mode without cost may pass the solver unchanged.
    if not stable:
        raise ArgumentError(
            "no optimal feedback is stable; give links without stiffness or damping an error_weight"
        )
    return K


def _given(feedforward: Gait, plant: Model, reference: Reference) -> Reference:
    if not isinstance(feedforward, Gait):
        raise ArgumentError(f"feedforward must be a Gait, not {type(feedforward).__name__}")
    n = reference.value.numel()
    if feedforward.links != n:
        raise ArgumentError(f"the feedforward has {feedforward.links} rows, the reference {n}")
    repeats = any(schedule.periodic for schedule in reference.schedules)
    return gait_reference(feedforward, plant.t, periodic=repeats, name="feedforward")
