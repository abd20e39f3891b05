"""References for tracking: a gait as expressions of time, exact on every one of its pieces."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError
from wormopt.model.gait import Gait
from wormopt.model.schedule import Schedule


@dataclass(frozen=True, eq=False)
class Reference:
    """Reference of outputs, as expressions of time.

    Parameters
    ----------
    value, rate, acceleration : casadi.SX, shape (n, 1)
        Reference and its time derivatives.
    schedule : Schedule, optional
        Gives the symbols in them their values, piece by piece.

    Examples
    --------
    >>> import casadi as ca
    >>> import wormopt as wo
    >>> worm = wo.chain(1, mass=1.0, stiffness=10.0, damping=5.0, rest_length=2.0, drag=0.1)
    >>> swing = Reference(2 + ca.sin(worm.t), ca.cos(worm.t), -ca.sin(worm.t))
    >>> loop = wo.lambda_tracker(worm, swing, tube_radius=0.2)
    >>> [signal.name for signal in loop.x]
    ['position', 'velocity', 'gain']
    """

    value: ca.SX
    rate: ca.SX
    acceleration: ca.SX
    schedule: Schedule | None = None

    @property
    def schedules(self) -> tuple[Schedule, ...]:
        """The schedule, if there is one."""
        return () if self.schedule is None else (self.schedule,)


def gait_reference(
    gait: Gait,
    time: ca.SX,
    *,
    shift: float = 0.0,
    periodic: bool = True,
    name: str = "reference",
) -> Reference:
    """Make the reference whose value at time t is that of the gait at t + shift.

    Parameters
    ----------
    gait : Gait
        Link lengths; they may have corners and jumps at breaks.
    time : casadi.SX
        The model's symbol of time.
    shift : float, optional
        How far the gait is ahead.
    periodic : bool, optional
        Whether the gait repeats. Otherwise it runs once; its first value is held before, its last
        value after.
    name : str, optional
        Name of the schedule.

    Returns
    -------
    Reference
        With a schedule, by which solvers stop at every break. Gaits with as many pieces, links
        and powers share one compiled model.

    Raises
    ------
    ArgumentError
        If ``shift`` is not finite.

    Examples
    --------
    >>> import casadi as ca
    >>> gait = Gait(np.array([0.0, 1.0, 2.0]), np.array([[[1.0, 0.5]], [[1.5, -0.5]]]))
    >>> reference = gait_reference(gait, ca.SX.sym("t"), shift=0.25)
    >>> reference.schedule.values, reference.schedule.start
    (array([[ 1. ,  0.5],
           [ 1.5, -0.5]]), -0.25)
    """
    if not np.isfinite(shift):
        raise ArgumentError("shift must be finite")
    start = -float(np.mod(shift, gait.period)) if periodic else -shift - gait.period
    if not periodic:
        gait = _with_held_ends(gait)
    pieces, n, powers = gait.polynomial.shape
    parts = [gait.polynomial.transpose(0, 2, 1).reshape(pieces, -1)]
    if gait.omega is not None and gait.cosine is not None and gait.sine is not None:
        parts += [gait.omega[:, None], gait.cosine, gait.sine]
    values = np.hstack(parts)

    symbol, begin = ca.SX.sym(name, values.shape[1]), ca.SX.sym(f"{name}_begin")
    s = time - begin
    coefficients = ca.vertsplit(symbol[: n * powers], n)
    value = coefficients[-1]
    for coefficient in coefficients[-2::-1]:
        value = value * s + coefficient
    if gait.omega is not None:
        omega, cosine, sine = ca.vertsplit(symbol[n * powers :], [0, 1, 1 + n, 1 + 2 * n])
        value += cosine * ca.cos(omega * s) + sine * ca.sin(omega * s)
    rate = ca.jacobian(value, time)
    schedule = Schedule(name, symbol, begin, gait.breaks, values, periodic, start)
    return Reference(value, rate, ca.jacobian(rate, time), schedule)


def _with_held_ends(gait: Gait) -> Gait:
    """The gait between two pieces of its length that hold its first and its last value."""
    # A polynomial continued beyond its piece would grow.
    last = gait.period - gait.breaks[-2:-1]
    first, end = np.zeros((2, 1, *gait.polynomial.shape[1:]))
    first[0, :, :1], end[0, :, :1] = gait.on_piece(0, np.zeros(1)), gait.on_piece(-1, last)
    breaks = gait.period + np.concatenate([[-gait.period], gait.breaks, [2 * gait.period]])
    polynomial = np.concatenate([first, gait.polynomial, end])
    if gait.omega is None or gait.cosine is None or gait.sine is None:
        return Gait(breaks, polynomial)
    cosine, sine = (np.pad(part, ((1, 1), (0, 0))) for part in (gait.cosine, gait.sine))
    return Gait(breaks, polynomial, np.pad(gait.omega, 1), cosine, sine)
