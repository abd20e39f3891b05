"""What to optimise: a Model, an objective over its ends and integrals, and bounds along the way."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError
from wormopt.model.model import Model, Signal


@dataclass(frozen=True, eq=False)
class Constraint:
    """Interval for an expression: ``lower <= expression <= upper``, row by row.

    Parameters
    ----------
    name : str
        What it limits, as a user would say it; infeasible problems are explained by it.
    expression : casadi.SX
        Scalar or column of the problem's symbols.
    lower, upper : array_like, optional
        The interval, alike for all rows or one per row; equal values make an equality.
    nominal : float, optional
        Usual size of the expression, by which it is scaled.

    Raises
    ------
    ArgumentError
        If a limit has neither one entry nor as many as the expression.
    """

    name: str
    expression: ca.SX
    lower: ArrayLike = -np.inf
    upper: ArrayLike = np.inf
    nominal: float = 1.0

    def __post_init__(self) -> None:
        for side, value in (("lower", self.lower), ("upper", self.upper)):
            if np.size(value) not in (1, self.expression.numel()):
                raise ArgumentError(
                    f"bound {self.name!r}: {side} has {np.size(value)} entries for an expression "
                    f"of {self.expression.numel()}"
                )

    @property
    def scaled(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper bound of every row, divided by ``nominal``."""
        shape = (self.expression.numel(),)
        low, high = (np.broadcast_to(np.asarray(v, float), shape) for v in (self.lower, self.upper))
        return low / self.nominal, high / self.nominal


@dataclass(frozen=True, eq=False)
class Ends:
    """Symbols for what a whole motion amounts to: its two ends, its duration, its integrals.

    Parameters
    ----------
    start, end : casadi.SX, shape (n_x, 1)
        States at both ends.
    duration : casadi.SX
        Duration of the motion, scalar.
    integrals : casadi.SX, shape (n_integrals, 1)
        Integrals of the problem's integrands over the motion.
    """

    start: ca.SX
    end: ca.SX
    duration: ca.SX
    integrals: ca.SX

    @classmethod
    def of(cls, model: Model, n_integrals: int = 0) -> Ends:
        """Make the symbols for a model and a number of integrals.

        Parameters
        ----------
        model : Model
            The system.
        n_integrals : int, optional
            Rows of the problem's ``integrands``.

        Returns
        -------
        Ends

        Examples
        --------
        >>> v = ca.SX.sym("v")
        >>> Ends.of(Model("cart", x=[Signal("position", ca.SX.sym("q"))], ode=v), 2).integrals.shape
        (2, 1)
        """
        return cls(
            ca.SX.sym("x_start", model.n_x),
            ca.SX.sym("x_end", model.n_x),
            ca.SX.sym("duration"),
            ca.SX.sym("integral", n_integrals),
        )


@dataclass(frozen=True, eq=False)
class Problem:
    """An optimal-control problem; it knows nothing of meshes, modes or solvers.

    Parameters
    ----------
    model : Model
        The system.
    ends : Ends
        Symbols used in ``minimise`` and ``boundary_constraints``.
    minimise : casadi.SX
        Scalar in the symbols of ``ends`` and the design parameters.
    duration : tuple of float
        Shortest and longest duration, positive.
    periodic : sequence of str, optional
        Names of the states that return to their start.
    displaced : sequence of str, optional
        Names of the states that return to their start but for one displacement, common to all
        entries of such a state: positions of masses, for instance.
    integrands : casadi.SX, optional
        Column of expressions along the way; their integrals are ``ends.integrals``.
    path_constraints : sequence of Constraint, optional
        Bounds at every instant, in states, inputs, slacks, contact forces, parameters.
    boundary_constraints : sequence of Constraint, optional
        Bounds in the symbols of ``ends``.
    slacks : sequence of Signal, optional
        Free functions of time without equations (epigraphs of max and absolute value).
    design : sequence of Signal, optional
        Constants to choose along with the motion; bounded by their Signal.
    sharing : callable, optional
        Maps the column of sticking flags (0 or 1 per contact) to a column, one row per contact,
        that vanishes where statically indeterminate contacts share as they should; used only
        for contacts whose force the motion leaves open.
    impulses : bool, optional
        Whether inputs and sticking contacts may act by impulses at the start of each arc.
    nominal : float, optional
        Usual size of what is minimised, positive; solvers scale by it.

    Raises
    ------
    ValueError
        If the range of durations is empty or not positive, or the nominal size is not positive.

    Examples
    --------
    Travel a unit way from rest to rest in the shortest time, with forces up to 1.

    >>> q, v, u = (ca.SX.sym(name) for name in "qvu")
    >>> x = [Signal("position", q), Signal("velocity", v)]
    >>> cart = Model("cart", x=x, ode=ca.vertcat(v, u), u=[Signal("force", u)])
    >>> ends = Ends.of(cart)
    >>> problem = Problem(
    ...     model=cart,
    ...     ends=ends,
    ...     minimise=ends.duration,
    ...     duration=(0.1, 10.0),
    ...     path_constraints=[Constraint("force", u, -1.0, 1.0)],
    ...     boundary_constraints=[
    ...         Constraint("start", ends.start, 0.0, 0.0),
    ...         Constraint("target", ends.end, [1.0, 0.0], [1.0, 0.0]),
    ...     ],
    ... )
    >>> [bound.name for bound in problem.boundary_constraints]
    ['start', 'target']
    """

    model: Model
    ends: Ends
    minimise: ca.SX
    duration: tuple[float, float]
    periodic: Sequence[str] = ()
    displaced: Sequence[str] = ()
    integrands: ca.SX = field(default_factory=lambda: ca.SX(0, 1))
    path_constraints: Sequence[Constraint] = ()
    boundary_constraints: Sequence[Constraint] = ()
    slacks: Sequence[Signal] = ()
    design: Sequence[Signal] = ()
    sharing: Callable[[ca.SX], ca.SX] | None = None
    impulses: bool = False
    nominal: float = 1.0

    def __post_init__(self) -> None:
        if not 0 < self.nominal < float("inf"):
            raise ValueError(f"nominal must be positive and finite, not {self.nominal}")
        shortest, longest = self.duration
        if not 0 < shortest <= longest:
            raise ValueError(f"duration must be a positive range, not {self.duration}")


def ramped(plant: Model, slope: float) -> Model:
    """Make the only scalar input of a plant its last state, and its rate (``_rate``) the input.

    The input's bounds become the state's; `slope`: largest size of the rate.
    Raises ArgumentError if the plant has another number of inputs.
    """
    if sum(signal.size for signal in plant.u) != 1:
        raise ArgumentError(f"{plant.name} has not one scalar input")
    (level,) = plant.u
    rate = ca.SX.sym(f"{level.name}_rate")
    steep = Signal(f"{level.name}_rate", rate, nominal=slope, lower=-slope, upper=slope, value=0.0)
    return replace(plant, x=[*plant.x, level], ode=ca.vertcat(plant.ode, rate), u=[steep])
