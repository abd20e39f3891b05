"""Optimal-control problems: a Model, an objective of ends and integrals, and path bounds."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError, UnknownNameError
from wormopt.model.given import (
    check_flag,
    check_kind,
    check_kinds,
    check_name,
    is_number,
    make_plain,
    names_in,
    whole,
)
from wormopt.model.model import TINY, Model, Signal, check_symbols
from wormopt.model.values import column


@dataclass(frozen=True, eq=False)
class Constraint:
    """Interval for an expression: ``lower <= expression <= upper``, row by row.

    Parameters
    ----------
    name : str
        Name of the limited quantity, used in messages about infeasible problems.
    expression : casadi.SX
        Scalar or column of the problem's symbols.
    lower, upper : array_like, optional
        The interval, alike for all rows or one per row; equal values make an equality.
    nominal : float, optional
        Usual size of the expression, by which it is scaled, positive.

    Raises
    ------
    ArgumentError
        If the expression is no casadi.SX, a limit has neither one entry nor as many as the
        expression, a lower limit is above the upper one, a limit is not a number, or the nominal
        size is not positive.

    Examples
    --------
    >>> Constraint("force", ca.SX.sym("u"), 1.0, -1.0)
    Traceback (most recent call last):
    wormopt.errors.ArgumentError: bound 'force': lower 1 is above upper -1; write the smaller ...
    """

    name: str
    expression: ca.SX
    lower: ArrayLike = -np.inf
    upper: ArrayLike = np.inf
    nominal: float = 1.0

    def __post_init__(self) -> None:
        check_name("constraint", self.name)
        whose = f"bound {self.name!r}"
        check_kind(f"{whose}: expression", self.expression, ca.SX)
        size = self.expression.numel()
        if not self.expression.is_column():
            raise ArgumentError(
                f"{whose}: expression must be a column, not of the shape {self.expression.shape}; "
                "use ca.vec"
            )
        make_plain(self, "nominal")
        for side in ("lower", "upper"):
            limits = column(f"{whose}: {side}", getattr(self, side), size)
            object.__setattr__(self, side, limits if limits.size > 1 else limits.item())
        if not is_number(self.nominal, TINY):
            raise ArgumentError(f"{whose}: nominal must be positive, not {self.nominal!r:.60}")
        for row, (low, high) in enumerate(zip(*self.scaled, strict=True)):
            if low <= high and low < np.inf and high > -np.inf:
                continue
            where = f" in row {row}" if size > 1 else ""
            low, high = low * self.nominal, high * self.nominal
            if low > high:
                raise ArgumentError(
                    f"{whose}: lower {low:.12g} is above upper {high:.12g}{where}; write the "
                    "smaller number as lower"
                )
            raise ArgumentError(
                f"{whose}: there is no number between {low:g} and {high:g}{where}; write "
                "numbers, and leave out lower or upper if there is no limit"
            )

    @property
    def scaled(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper bound of every row, divided by ``nominal``."""
        shape = (self.expression.numel(),)
        low, high = (np.broadcast_to(np.asarray(v, float), shape) for v in (self.lower, self.upper))
        return low / self.nominal, high / self.nominal


@dataclass(frozen=True, eq=False)
class Ends:
    """Symbols for ends, duration and integrals of a motion.

    Parameters
    ----------
    start, end : casadi.SX, shape (n_x, 1)
        States at both ends.
    duration : casadi.SX
        Duration of the motion, scalar.
    integrals : casadi.SX, shape (n_integrals, 1)
        Integrals of the problem's integrands over the motion.

    Examples
    --------
    The symbols of a problem whose model has one state, with one integral:

    >>> import casadi as ca
    >>> import wormopt as wo
    >>> v, u = ca.SX.sym("v"), ca.SX.sym("u")
    >>> cart = wo.Model("cart", [wo.Signal("velocity", v)], u, u=[wo.Signal("force", u)])
    >>> ends = wo.Ends.of(cart, 1)
    >>> ends.start.shape, ends.duration.shape, ends.integrals.shape
    ((1, 1), (1, 1), (1, 1))
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

        Examples
        --------
        >>> q = ca.SX.sym("q")
        >>> Ends.of(Model("cart", x=[Signal("position", q)], ode=-q), 2).integrals.shape
        (2, 1)
        """
        check_kind("model", model, Model)
        n_integrals = whole("n_integrals", n_integrals, 0)
        return cls(
            ca.SX.sym("x_start", model.n_x),
            ca.SX.sym("x_end", model.n_x),
            ca.SX.sym("duration"),
            ca.SX.sym("integral", n_integrals),
        )


@dataclass(frozen=True, eq=False)
class Problem:
    """An optimal-control problem, independent of meshes, modes and solvers.

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
        Bounds at every time, on states, inputs, slacks, contact forces, parameters.
    boundary_constraints : sequence of Constraint, optional
        Bounds in the symbols of ``ends``.
    slacks : sequence of Signal, optional
        Free functions of time without equations (epigraphs of max and absolute value).
    design : sequence of Signal, optional
        Constants optimised with the motion, bounded by their Signal. Those in the model's
        equations are also among its ``p``.
    sharing : callable, optional
        Maps the column of sticking flags (0 or 1 per contact) to a column, one row per contact,
        that vanishes where statically indeterminate contacts share as they should; used only
        for contacts whose force the motion leaves open.
    impulses : bool, optional
        Whether inputs and sticking contacts may act by impulses at the start of each arc.
    nominal : float, optional
        Nominal size of the objective, positive; solvers scale by it.

    Raises
    ------
    ArgumentError
        If the range of durations is empty or not positive, the nominal size is not positive, a
        state that returns is unknown, an expression holds a symbol that belongs to no part of the
        problem, or linear constraints of the ends contradict each other.

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
        check_kind("model", self.model, Model)
        for what in ("path_constraints", "boundary_constraints"):
            check_kinds(what, getattr(self, what), Constraint)
        for what in ("slacks", "design"):
            check_kinds(what, getattr(self, what), Signal)
        make_plain(self, "nominal", "impulses")
        if not is_number(self.nominal, TINY):
            raise ArgumentError(f"nominal must be positive and finite, not {self.nominal!r:.60}")
        check_flag("impulses", self.impulses)
        if not (self.sharing is None or callable(self.sharing)):
            raise ArgumentError(f"sharing must be a function, not {self.sharing!r:.60}")
        self._check_duration()
        states = [signal.name for signal in self.model.x]
        for what in ("periodic", "displaced"):
            names = names_in(what, getattr(self, what))
            object.__setattr__(self, what, tuple(names))
            if unknown := [name for name in names if name not in states]:
                raise UnknownNameError(self.model.name, "state", unknown, states)
        self._check_ends()
        chosen = [signal.symbol for signal in self.design]
        own = [*vars(self.ends).values(), *chosen, *(s.symbol for s in self.parameters)]
        check_symbols("problem", own, self._at_ends, _ENDS)
        along = [s.symbol for s in self.slacks]
        model = [column for column in self.model.symbols if not _within(column, chosen)]
        check_symbols("problem", [*model, *along, *chosen], self._along, _ALONG)
        _refuse_contradictions(self)

    @property
    def parameters(self) -> list[Signal]:
        """Parameters of the model that are not optimised."""
        chosen = [signal.symbol for signal in self.design]
        return [signal for signal in self.model.p if not _within(signal.symbol, chosen)]

    def _check_duration(self) -> None:
        given = self.duration
        pair = tuple(given) if isinstance(given, Sequence | np.ndarray) else ()
        if len(pair) != 2 or not all(is_number(end, TINY) for end in pair):
            raise ArgumentError(
                "duration must be a positive range (shortest, longest), "
                f"for example (0.1, 10.0), not {given!r:.60}"
            )
        if pair[0] > pair[1]:
            raise ArgumentError(
                f"duration must be a positive range, not {given!r:.60}; write the smaller number "
                "first"
            )

    def _check_ends(self) -> None:
        """Refuse ends of another model, and an objective or integrands that do not fit them."""
        check_kind("ends", self.ends, Ends)
        n_x, ends = self.model.n_x, self.ends
        if ends.start.numel() != n_x or ends.end.numel() != n_x:
            raise ArgumentError(
                f"ends have {ends.start.numel()} states, but {self.model.name} has {n_x}; write "
                "Ends.of(model, number of integrals)"
            )
        for what, example in (("minimise", "ends.duration"), ("integrands", "ca.vertcat(u**2)")):
            given = getattr(self, what)
            if not isinstance(given, ca.SX):
                raise ArgumentError(
                    f"{what} must be an expression of CasADi's SX symbols, such as {example}, not "
                    f"{given!r:.60}"
                )
        if not self.minimise.is_scalar() or not self.minimise.numel():
            raise ArgumentError(f"minimise must be a scalar, not of shape {self.minimise.shape}")
        rows, known = self.integrands.numel(), ends.integrals.numel()
        used = rows or any(ca.depends_on(one, ends.integrals) for _, one in self._at_ends())
        if used and rows != known:
            raise ArgumentError(
                f"{rows} integrands, but ends with {known} integrals; write Ends.of(model, {rows})"
            )

    def _at_ends(self) -> Iterator[tuple[str, ca.SX]]:
        yield "minimise", self.minimise
        for bound in self.boundary_constraints:
            yield f"boundary constraint {bound.name!r}", bound.expression

    def _along(self) -> Iterator[tuple[str, ca.SX]]:
        yield "integrands", self.integrands
        for bound in self.path_constraints:
            yield f"path constraint {bound.name!r}", bound.expression


_ENDS = "write them with ends.start, ends.end, ends.duration, ends.integrals, design or parameters"
_ALONG = (
    "add them to the Model (a reference with schedules=[*model.schedules, *reference.schedules]), "
    "or to slacks or design"
)


# Share of a bound, and of its nominal size, within which ends satisfy it.
_ROUNDING = 1e-6


def _within(column: ca.SX, columns: Sequence[ca.SX]) -> bool:
    """Whether a column of symbols is among others."""
    same = (other for other in columns if other.shape == column.shape)
    return any(ca.is_equal(column, other) for other in same)


def _refuse_contradictions(problem: Problem) -> None:
    """Raise ArgumentError if linear constraints of the ends contradict each other."""
    if not problem.boundary_constraints:
        return
    own = [*vars(problem.ends).values(), *(s.symbol for s in problem.design)]
    symbols = ca.vertcat(*own, *(s.symbol for s in problem.parameters))
    bounds = [*problem.boundary_constraints, *_returns(problem)]
    whole = ca.vertcat(*(ca.vec(b.expression) / b.nominal for b in bounds))
    straight = ~np.array(ca.which_depends(whole, symbols, 2, True), dtype=bool)
    function = ca.Function("rows", [symbols], [whole, ca.jacobian(whole, symbols)])
    constant, slopes = function(0.0)
    constant = np.asarray(constant).ravel()
    straight &= np.isfinite(constant)
    names = np.repeat([b.name for b in bounds], [b.expression.numel() for b in bounds])
    low, high = (np.concatenate([b.scaled[k] for b in bounds]) - constant for k in range(2))
    names, matrix, low, high = (
        names[straight],
        slopes.sparse().tocsr()[straight],
        low[straight],
        high[straight],
    )
    shortest, longest = problem.duration
    box = np.array([(-np.inf, np.inf)] * symbols.numel())
    box[problem.ends.start.numel() + problem.ends.end.numel()] = shortest, longest
    kept = np.ones(len(names), dtype=bool)
    if not _contradict(matrix, low, high, box):
        return
    for name in dict.fromkeys(names.tolist()):
        fewer = kept & (names != name)
        if _contradict(matrix[fewer], low[fewer], high[fewer], box):
            kept = fewer
    listed = [repr(name) for name in dict.fromkeys(names[kept].tolist())]
    if len(listed) > 1:  # a solve explains one that contradicts only the duration
        raise ArgumentError(
            f"the boundary constraints {' and '.join(listed)} contradict each other; change or "
            "leave out one of them"
        )


def _contradict(matrix: Any, low: np.ndarray, high: np.ndarray, box: np.ndarray) -> bool:
    """Whether no point of a box satisfies low <= matrix @ point <= high, up to rounding."""
    from scipy import optimize, sparse  # not imported unless needed

    below, above = np.isfinite(high), np.isfinite(low)
    bounds = np.concatenate([high[below], -low[above]])
    if not len(bounds):
        return False
    rows = sparse.vstack([matrix[below], -matrix[above]])
    slack = sparse.csr_matrix(-_ROUNDING * (1 + np.abs(bounds))[:, None])
    # the least multiple of the slack with which all rows are satisfied
    answer = optimize.linprog(
        np.append(np.zeros(matrix.shape[1]), 1.0),
        A_ub=sparse.hstack([rows, slack]),
        b_ub=bounds,
        bounds=[*box.tolist(), (0.0, None)],
        method="highs",
    )
    return answer.x is not None and answer.fun > 1.0


def _returns(problem: Problem) -> Iterator[Constraint]:
    """Constraints of periodic states."""
    change, at = problem.ends.end - problem.ends.start, 0
    for signal in problem.model.x:
        own = change[at : at + signal.size]
        at += signal.size
        if signal.name in problem.periodic:
            yield Constraint(f"periodic {signal.name}", own, 0.0, 0.0, signal.nominal)
        elif signal.name in problem.displaced and signal.size > 1:
            yield Constraint(f"displaced {signal.name}", own[1:] - own[0], 0.0, 0.0, signal.nominal)


def ramped(plant: Model, slope: float) -> Model:
    """Make the only scalar input of a plant its last state, and its rate (``_rate``) the input.

    The input's bounds become the state's; `slope`: largest size of the rate.
    """
    if sum(signal.size for signal in plant.u) != 1:
        raise ArgumentError(f"{plant.name} must have exactly one scalar input")
    (level,) = plant.u
    rate = ca.SX.sym(f"{level.name}_rate")
    steep = Signal(f"{level.name}_rate", rate, nominal=slope, lower=-slope, upper=slope, value=0.0)
    return replace(
        plant,
        x=[*plant.x, level],
        ode=ca.vertcat(plant.ode, rate),
        u=[steep],
        outputs=[output for output in plant.outputs if output.name != level.name],
    )
