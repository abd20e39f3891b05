"""A Model as x' = f(t, x, u, p), y = h(t, x, u, p): contacts smooth, every scalar with a name."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from itertools import accumulate, pairwise
from typing import Any, Protocol

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError, UnknownNameError
from wormopt.model.given import check_number, names_in
from wormopt.model.values import signal_values

Values = Mapping[str, ArrayLike]


class Described(Protocol):
    """Part of `Model` used here; Model itself imports this module in `to_control`."""

    @property
    def name(self) -> str: ...
    @property
    def t(self) -> ca.SX: ...
    @property
    def x(self) -> Sequence[Any]: ...
    @property
    def u(self) -> Sequence[Any]: ...
    @property
    def z(self) -> Sequence[Any]: ...
    @property
    def p(self) -> Sequence[Any]: ...
    @property
    def ode(self) -> ca.SX: ...
    @property
    def outputs(self) -> Sequence[Any]: ...
    @property
    def contacts(self) -> Sequence[Any]: ...
    @property
    def switches(self) -> Sequence[Any]: ...
    @property
    def schedules(self) -> Sequence[Any]: ...
    def check_laws(self) -> None:
        """Refuse laws with symbols that no part of the model has."""
        ...


def import_control() -> Any:
    """Import python-control, which takes two seconds, only when needed."""
    return import_module("control")


def scalar_names(sizes: Mapping[str, int]) -> tuple[str, ...]:
    """Name every scalar of named vectors of these sizes, as python-control does."""
    return tuple(f"{name}[{i}]" for name, size in sizes.items() for i in range(size))


def _slices(sizes: Iterable[int]) -> list[slice]:
    """Places of pieces of these sizes in one column."""
    ends = list(accumulate(sizes, initial=0))
    return [slice(begin, end) for begin, end in pairwise(ends)]


@dataclass(frozen=True, eq=False)
class Explicit:
    """Rates of states and chosen outputs of a Model whose contacts follow the smooth law.

    Switches are left out: the equations apply between two of them. Raises
    UnknownNameError for an unknown output, ArgumentError if there are algebraic variables.
    """

    model: Described
    output: str | Sequence[str]  # names in the order wanted, duplicates dropped

    def __post_init__(self) -> None:
        if len(self.model.z) > 0:
            raise ArgumentError(f"{self.model.name} has algebraic variables; solve for them first")
        if getattr(self.model, "delays", ()):
            raise ArgumentError(f"{self.model.name} has delays: states do not determine its rates")
        self.model.check_laws()
        _ = self.outputs

    @cached_property
    def outputs(self) -> dict[str, ca.SX]:
        """Expressions of the outputs by name."""
        names = names_in("output", self.output)
        expressions = {o.name: o.expression for o in self.model.outputs}
        for name in names:
            if name not in expressions:
                raise UnknownNameError(self.model.name, "output", [name], expressions)
        return {name: expressions[name] for name in names}

    @cached_property
    def symbols(self) -> dict[str, ca.SX]:
        """Columns t, x, u, p, v_reg (width of the smooth law) and s (what schedules set)."""
        model, empty = self.model, ca.SX(0, 1)
        columns = {
            key: ca.vertcat(empty, *(signal.symbol for signal in signals))
            for key, signals in (("x", model.x), ("u", model.u), ("p", model.p))
        }
        s = ca.vertcat(empty, *(ca.vertcat(s.begin, s.symbol) for s in model.schedules))
        return {"t": model.t, **columns, "v_reg": ca.SX.sym("v_reg"), "s": s}

    @cached_property
    def _smooth(self) -> list[ca.SX]:
        contacts, v_reg = self.model.contacts, self.symbols["v_reg"]
        wanted = [self.model.ode, ca.vertcat(ca.SX(0, 1), *map(ca.vec, self.outputs.values()))]
        if not contacts:
            return wanted
        forces = ca.vertcat(*(c.force for c in contacts))
        laws = ca.vertcat(*(c.law.smooth(c.velocity, v_reg) for c in contacts))
        return ca.substitute(wanted, [forces], [laws])

    @property
    def rates(self) -> ca.SX:
        """Column x'."""
        return self._smooth[0]

    @property
    def observed(self) -> ca.SX:
        """Column y."""
        return self._smooth[1]

    def function(self, name: str, *wanted: ca.SX | str) -> ca.Function:
        """Make a CasADi function of `symbols`, in their order.

        `wanted`: expressions it gives, or "rates" or "observed".
        """
        results = [getattr(self, w) if isinstance(w, str) else w for w in wanted]
        return ca.Function(name, list(self.symbols.values()), [ca.densify(r) for r in results])

    def scheduled(self, t: float) -> np.ndarray:
        """Values of the scheduled symbols ``s`` at `t`; at a break those of the later piece."""
        columns = [np.zeros(0)]
        for schedule in self.model.schedules:
            begin, piece = schedule.locate(np.array([t]))
            columns += [begin, schedule.values[piece[0]]]
        return np.concatenate(columns)

    @property
    def names(self) -> dict[str, tuple[str, ...]]:
        """Names of all scalars: ``states``, ``inputs`` and ``outputs``."""
        return {
            "states": scalar_names({s.name: s.size for s in self.model.x}),
            "inputs": scalar_names({s.name: s.size for s in self.model.u}),
            "outputs": scalar_names({name: y.numel() for name, y in self.outputs.items()}),
        }

    def to_control(self, v_reg: float, p: Values) -> Any:
        """Make a control.NonlinearIOSystem; see `Model.to_control`."""
        model, control = self.model, import_control()
        if model.switches:
            events = [s.name for s in model.switches]
            raise ArgumentError(
                f"{model.name} has switches {events}, at which its states may jump; "
                "python-control does not support these: use simulate"
            )
        check_number("v_reg", v_reg, above=0.0)
        numbers = signal_values(model.p, p, "parameter")
        places = _slices(s.size for s in model.p)
        params = {s.name: numbers[at] for s, at in zip(model.p, places, strict=True)}

        return control.nlsys(
            self._evaluator(self.rates),
            self._evaluator(self.observed),
            name=model.name,
            params={**params, "v_reg": v_reg},
            **{key: list(names) for key, names in self.names.items()},
        )

    def _evaluator(self, wanted: ca.SX) -> Callable[[float, Any, Any, dict[str, Any]], np.ndarray]:
        """Make a function as python-control calls it; not thread-safe."""
        symbols = list(self.symbols.values())
        function = ca.Function("f", [ca.vertcat(*symbols)], [ca.densify(wanted)])
        given, result = np.zeros(function.nnz_in(0)), np.zeros(function.nnz_out(0))
        # far quicker than calling the function, and integrators call it often
        buffer, run = function.buffer()
        buffer.set_arg(0, given.data)  # pyright: ignore[reportCallIssue]
        buffer.set_res(0, result.data)  # pyright: ignore[reportCallIssue]
        t, x, u, p, v_reg, s = _slices(symbol.numel() for symbol in symbols)
        inner = _slices(signal.size for signal in self.model.p)
        places = [
            (signal.name, given[p][at]) for signal, at in zip(self.model.p, inner, strict=True)
        ]

        def evaluate(time: float, states: Any, inputs: Any, params: dict[str, Any]) -> np.ndarray:
            given[t], given[x], given[u], given[v_reg] = time, states, inputs, params["v_reg"]
            for name, place in places:
                place[:] = params[name]
            given[s] = self.scheduled(time)
            run()
            assert buffer.ret() == 0  # this also keeps the buffer alive as long as `run`
            return result.copy()

        return evaluate
