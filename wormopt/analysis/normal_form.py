"""Byrnes-Isidori normal form of a Model, after its relative degree by Lie derivatives.

Where outputs have relative degree two, in the coordinates y, y' and eta, which inputs do not reach
at once, a model reads

    y'' = b(x) + Gamma(x) u,    eta' = q(x),

with the high-frequency gain Gamma; q with y held still is the zero dynamics [1]_. A tracker of
high gain rests on two things: Gamma has a definite sign, and the zero dynamics come to rest.

Everything is a CasADi expression that follows from the model's own by exact Lie derivatives.
Contact forces stay the symbols that they are in the model, so that what is shown of the form
holds for every friction law.

References
----------
.. [1] C. I. Byrnes and A. Isidori, "Asymptotic stabilization of minimum phase nonlinear systems",
   IEEE Transactions on Automatic Control 36 (1991) 1122-1137.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError
from wormopt.model.explicit import Explicit
from wormopt.model.given import check_kind, check_number, names_in
from wormopt.model.model import Model, Output, Signal, lie, pack
from wormopt.model.values import numbers_of, signal_values
from wormopt.numerics.expressions import identically_zero

Values = Mapping[str, ArrayLike]


def relative_degree(
    model: Model, *, output: str | Sequence[str], p: Values | None = None, v_reg: float = 1 / 40
) -> tuple[float, ...]:
    """Relative degree of a model's outputs, nonlinear and without any threshold.

    It is the order of the first time derivative (Lie derivative along the ode) of an output in
    which an input appears, in general: at special states the input's factor may vanish.

    Parameters
    ----------
    model : Model
        The model.
    output : str or sequence of str
        Names of outputs.
    p : mapping of str to array_like, optional
        Parameters by name, where they are not the model's own. They count as the exact numbers
        that doubles are: 0.1 + 0.2 is not 0.3.
    v_reg : float, optional
        Width of the smooth law, positive.

    Returns
    -------
    tuple of int or inf
        For each scalar output; inf where no input ever reaches it.

    Raises
    ------
    ArgumentError
        If names or sizes do not fit the model, or it has algebraic variables.
    ZeroDivisionError
        If the model divides by zero for these parameters.
    UnknownNameError
        If the model has no such output.

    Examples
    --------
    Actuators between masses move the centre of mass only by way of friction or unequal drag:

    >>> from wormopt.systems.chain.build import chain
    >>> worm = chain(1, mass=1.0, stiffness=10.0, damping=5.0, rest_length=2.0, drag=0.1)
    >>> relative_degree(worm, output=["length", "center_of_mass"])
    (2, inf)
    >>> relative_degree(worm, output="center_of_mass", p={"drag": [0.1, 0.2]})
    (3,)
    """
    explicit = Explicit(model, output)
    symbols = explicit.symbols
    known = ca.vertcat(symbols["p"], symbols["v_reg"])
    numbers = np.append(signal_values(model.p, p, "parameter"), v_reg)
    everything = ca.vertcat(known, *(symbols[key] for key in "txus"))
    values = {i: float(number) for i, number in enumerate(numbers)}

    def reached(expression: ca.SX) -> bool:
        factors = ca.jacobian(expression, symbols["u"])
        return factors.nnz() > 0 and not np.all(identically_zero(factors, everything, values))

    return tuple(
        _lie_degree(explicit, reached, explicit.observed[i])
        for i in range(explicit.observed.numel())
    )


def _lie_degree(explicit: Explicit, reached: Callable[[ca.SX], bool], y: ca.SX) -> float:
    x, t, n = explicit.symbols["x"], explicit.symbols["t"], len(explicit.names["states"])
    if not _connected(explicit, y):
        return math.inf
    for degree in range(n + 1):
        if reached(y):
            return degree
        rate = ca.jtimes(y, x, explicit.rates) + ca.jacobian(y, t)
        y = ca.cse(rate)
    return math.inf


def _connected(explicit: Explicit, y: ca.SX) -> bool:
    """Whether some chain of dependent states leads from an input to y."""
    x, u = explicit.symbols["x"], explicit.symbols["u"]
    if ca.depends_on(y, u):
        return True
    feeds = _pattern(explicit.rates, x)
    driven = _pattern(explicit.rates, u) @ np.ones(u.numel(), dtype=bool)
    for _ in range(x.numel()):
        driven = driven | (feeds @ driven)
    return bool(np.any(_pattern(y, x) @ driven))


def _pattern(expression: ca.SX, by: ca.SX) -> np.ndarray:
    sparsity = ca.jacobian_sparsity(expression, by)
    pattern = np.zeros(sparsity.shape, dtype=bool)
    pattern[sparsity.get_triplet()] = True
    return pattern


GainSign = Literal["positive definite", "negative definite", "semidefinite", "indefinite"]
"""Sign of the symmetric part of a gain matrix; semidefinite if rounding hides it."""


@dataclass(frozen=True, eq=False)
class NormalForm:
    """A Model in the coordinates y, y' and eta; see `normal_form`.

    Parameters
    ----------
    model : Model
        The model. All expressions contain its symbols only, contact forces included.
    value, rate : casadi.SX, shape (m, 1)
        Outputs y and their first derivatives y'.
    drift : casadi.SX, shape (m, 1)
        Second derivatives y'' without inputs, b.
    gain : casadi.SX, shape (m, m)
        High-frequency gain Gamma: y'' = b + Gamma u.
    internal : tuple of Output
        Coordinates eta with their names, of k scalars in all; empty if none were named.
    internal_rate : casadi.SX, shape (k, 1)
        Their derivatives eta', in which no input appears.

    Examples
    --------
    >>> import wormopt as wo
    >>> worm = wo.chain(2, mass=0.5, stiffness=9.0, damping=5.0, rest_length=2.0)
    >>> form = wo.normal_form(worm, output="length")
    >>> form.gain_at(), form.sign()
    (array([[ 4., -2.], [-2.,  4.]]), 'positive definite')
    """

    model: Model
    value: ca.SX
    rate: ca.SX
    drift: ca.SX
    gain: ca.SX
    internal: tuple[Output, ...]
    internal_rate: ca.SX

    @property
    def coordinates(self) -> ca.SX:
        """Column y, y', eta of the new coordinates."""
        return ca.vertcat(self.value, self.rate, *(eta.expression for eta in self.internal))

    def gain_at(
        self, *, x: Values | None = None, p: Values | None = None, t: float = 0.0
    ) -> np.ndarray:
        """High-frequency gain (m, m) at a state.

        Parameters
        ----------
        x : mapping of str to array_like, optional
            States by name; by default the start values of the model, or 0.
        p : mapping of str to array_like, optional
            Parameters by name, where they are not the model's own.
        t : float, optional
            Time, where the model depends on it.

        Raises
        ------
        ArgumentError
            If names or sizes do not fit the model.
        """
        check_number("t", t)
        explicit = Explicit(self.model, ())
        return explicit.function("gain", self.gain)(
            t,
            signal_values(self.model.x, x, "state", fill=0.0),
            signal_values(self.model.u, None, "input", fill=0.0),
            signal_values(self.model.p, p, "parameter"),
            1.0,
            explicit.scheduled(t),
        ).full()

    def sign(self, *, x: Values | None = None, p: Values | None = None, t: float = 0.0) -> GainSign:
        """Sign of the gain's symmetric part at a state.

        Parameters
        ----------
        x : mapping of str to array_like, optional
            States by name; by default the start values of the model, or 0.
        p : mapping of str to array_like, optional
            Parameters by name, where they are not the model's own.
        t : float, optional
            Time, where the model depends on it.

        Returns
        -------
        {"positive definite", "negative definite", "semidefinite", "indefinite"}

        Raises
        ------
        ArgumentError
            If names or sizes do not fit the model.
        """
        gain = self.gain_at(x=x, p=p, t=t)
        # equal diagonals remove the decades over which parameters of a worm may spread
        size = np.sqrt(np.abs(np.diag(gain)))
        size[size == 0] = 1.0
        even = gain / np.outer(size, size)
        values = np.linalg.eigvalsh((even + even.T) / 2)
        rounding = 4 * len(gain) * np.finfo(float).eps * np.abs(values).max()
        if values[0] > rounding:
            return "positive definite"
        if values[-1] < -rounding:
            return "negative definite"
        hidden = bool(np.all(values >= -rounding) or np.all(values <= rounding))
        return "semidefinite" if hidden else "indefinite"

    def zero_dynamics(self, held: ArrayLike | None = None) -> Model:
        """Model of the motion while the outputs are constant.

        Parameters
        ----------
        held : array_like, shape (m,), optional
            Where the outputs are held, a parameter of the new model; by default where the model
            starts, if it says so.

        Returns
        -------
        Model
            States: eta by their names. Parameters: the model's, and ``held``. Contacts are the
            model's, each with the velocity that it then has; what holds the outputs does not act
            on eta.

        Raises
        ------
        ArgumentError
            If there are not as many coordinates as states, they are not affine in the states, the
            model has switches or delays, or `held` is not of the size of the outputs.

        Examples
        --------
        With its length held, a worm on drag 0.1 and 0.3 slides as one mass 2 on drag 0.4:

        >>> from wormopt.simulation.simulate import simulate
        >>> from wormopt.systems.chain.build import chain
        >>> worm = chain(1, mass=1.0, stiffness=9.0, damping=5.0, rest_length=2.0, drag=[0.1, 0.3])
        >>> form = normal_form(worm, output="length", internal="center_velocity")
        >>> form.zero_dynamics()
        Traceback (most recent call last):
        ...
        wormopt.errors.ArgumentError: 3 coordinates y, y', eta for 4 states; name more in internal=
        >>> names = ["center_of_mass", "center_velocity"]
        >>> still = normal_form(worm, output="length", internal=names).zero_dynamics()
        >>> motion = simulate(still, 5.0, x0={"center_velocity": 1.0})
        >>> float(np.log(motion["center_velocity"][0, -1]).round(9))
        -1.0
        """
        self.model.refuse_delays("the form of zero dynamics")
        model, m, eta = self.model, self.value.numel(), ca.SX(0, 1)
        states = [
            Signal(e.name, ca.SX.sym(e.name, e.expression.numel()), e.unit) for e in self.internal
        ]
        eta = pack(states)
        if 2 * m + eta.numel() != model.n_x:
            count = 2 * m + eta.numel()
            raise ArgumentError(
                f"{count} coordinates y, y', eta for {model.n_x} states; name "
                f"{'more' if count < model.n_x else 'fewer'} in internal="
            )
        if model.switches:
            raise ArgumentError(f"{model.name} has switches, at which its states may jump")
        place = Signal("held", ca.SX.sym("held", m), value=self._held(held))
        x = self._states(ca.vertcat(place.symbol, ca.SX(m, 1), eta))
        gaps = [c.gap if c.gap is not None else ca.SX(0, 1) for c in model.contacts]
        wanted = [self.internal_rate, *(c.velocity for c in model.contacts), *gaps]
        rates, *seen = ca.substitute(wanted, [pack(model.x)], [x])
        touching = zip(model.contacts, seen[: len(gaps)], seen[len(gaps) :], strict=True)
        return Model(
            f"{model.name}, outputs held",
            x=states,
            ode=rates,
            p=[*model.p, place],
            t=model.t,
            contacts=[
                replace(c, velocity=v, gap=None if c.gap is None else gap) for c, v, gap in touching
            ],
            schedules=model.schedules,
        )

    def _states(self, coordinates: ca.SX) -> ca.SX:
        """States of the model as affine functions of the coordinates; else ArgumentError."""
        x, known = pack(self.model.x), self.coordinates
        matrix = ca.jacobian(known, x)
        if ca.depends_on(matrix, x):
            raise ArgumentError(
                f"y, y' and eta of {self.model.name} are not affine in its states, so the "
                "states have no closed form in them"
            )
        if ca.sprank(matrix) < x.numel():
            raise ArgumentError("y, y' and eta do not determine the states; change internal=")
        offset = ca.substitute(known, x, ca.SX.zeros(x.numel()))
        return ca.densify(ca.solve(matrix, coordinates - offset))

    def _held(self, held: ArrayLike | None) -> tuple[float, ...] | None:
        if held is not None:
            return numbers_of("held", held, self.value.numel())
        model = self.model
        if any(s.value is None for s in (*model.x, *model.p)) or model.schedules:
            return None
        known = [
            ca.DM(signal_values(signals, None, what))
            for signals, what in ((model.x, "state"), (model.p, "parameter"))
        ]
        start = ca.Function("start", [pack(model.x), pack(model.p), model.t], [self.value])
        return tuple(start(*known, 0.0).full().ravel().tolist())


def normal_form(
    model: Model, *, output: str | Sequence[str], internal: str | Sequence[str] = ()
) -> NormalForm:
    """Bring a model with outputs of relative degree two into Byrnes-Isidori normal form.

    Terms that must be zero (inputs in y, y', eta') are proven to be zero for all states,
    parameters and contact forces, in exact arithmetic.

    Parameters
    ----------
    model : Model
        Model with as many inputs as outputs, affine in the inputs.
    output : str or sequence of str
        Names of the outputs y, or of states.
    internal : str or sequence of str, optional
        Names of outputs or states that are the coordinates eta beside y and y'. Without them
        there is the upper half of the form alone.

    Returns
    -------
    NormalForm

    Raises
    ------
    ArgumentError
        If there are algebraic variables, not as many inputs as outputs, inputs or contact forces
        that act on y or y', none that acts on some y'', inputs that act on an eta', or if y'' is
        not affine in the inputs.
    UnknownNameError
        If the model has no such output or state.

    Examples
    --------
    A chain of any number of links, of which the centre of mass is what the lengths do not show:

    >>> from wormopt.model.friction import Coulomb
    >>> from wormopt.systems.chain.build import chain
    >>> worm = chain(
    ...     2, mass=0.5, stiffness=9.0, damping=5.0, rest_length=2.0, law=Coulomb(1.0, 10.0)
    ... )
    >>> form = normal_form(worm, output="length", internal=["center_of_mass", "center_velocity"])
    >>> form.gain_at(), form.sign()
    (array([[ 4., -2.],
           [-2.,  4.]]), 'positive definite')
    >>> form.internal_rate.shape, form.zero_dynamics().n_x
    ((2, 1), 2)
    """
    check_kind("model", model, Model)
    if len(model.z) > 0:
        raise ArgumentError(f"{model.name} has algebraic variables; solve for them first")
    u, empty = pack(model.u), ca.SX(0, 1)
    y = ca.vertcat(empty, *(model[name] for name in names_in("output", output)))
    if y.numel() != u.numel() or not y.numel():
        raise ArgumentError(
            f"{model.name}: {y.numel()} outputs for {u.numel()} inputs; name as many of both"
        )
    rate = lie(model, y)
    for what, column in (("y", y), ("y'", rate)):
        _free(model, column, ca.vertcat(u, model.forces), what)
    second = lie(model, rate)
    gain = ca.jacobian(second, u)
    if ca.depends_on(gain, u):
        raise ArgumentError(f"{model.name}: y'' is not affine in the inputs")
    reached = ca.DM((~identically_zero(gain, _symbols(model))).astype(float))
    if ca.sprank(ca.sparsify(reached)) < y.numel():
        raise ArgumentError(
            f"{model.name}: inputs do not act on all y'' independently; the relative degree is "
            "not two"
        )
    shown = _internal(model, internal)
    inner = ca.vertcat(empty, *(e.expression for e in shown))
    _free(model, inner, u, "eta")
    inner_rate = lie(model, inner)
    _free(model, inner_rate, u, "eta'")
    without = [ca.substitute(e, u, ca.SX.zeros(u.numel())) for e in (second, inner_rate)]
    return NormalForm(model, y, rate, without[0], gain, shown, without[1])


def _internal(model: Model, internal: str | Sequence[str]) -> tuple[Output, ...]:
    names = names_in("internal", internal)
    units = {s.name: s.unit for s in (*model.x, *model.outputs)}
    return tuple(Output(name, model[name], units.get(name, "1")) for name in names)


def _free(model: Model, column: ca.SX, acting: ca.SX, what: str) -> None:
    """Refuse a column with inputs or forces, for any values of states and parameters."""
    factors = ca.jacobian(column, acting)
    if factors.nnz() == 0:
        return
    if not np.all(identically_zero(factors, _symbols(model))):
        raise ArgumentError(f"{model.name}: inputs or contact forces act directly on {what}")


def _symbols(model: Model) -> ca.SX:
    """All symbols that a model's expressions may contain, in one column."""
    return ca.vertcat(
        model.t, pack(model.x), pack(model.p), pack(model.u), model.forces,
        *(ca.vertcat(s.begin, s.symbol) for s in model.schedules),
    )  # fmt: skip
