"""What closed loops share: the tracking error, and a plant whose inputs are put in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from wormopt.core.model import Model, Output, Signal, Switch, pack
from wormopt.errors import ArgumentError
from wormopt.tracking.reference import Reference

__all__ = ["FeedForward", "TrackingError", "close"]


@dataclass(frozen=True, eq=False)
class FeedForward:
    """Force that would hold links of these numbers on the reference, c (y_ref - l0) + d y_ref'.

    The numbers are what the controller believes, which need not be the worm's own.

    Parameters
    ----------
    stiffness, rest_length : array_like, shape (n,)
        Spring constants c_j and rest lengths l0_j.
    damping : array_like, shape (n,), optional
        Dashpot constants d_j.
    """

    stiffness: ArrayLike
    rest_length: ArrayLike
    damping: ArrayLike = 0.0

    def force(self, reference: Reference) -> tuple[ca.SX, tuple[Signal, ...]]:
        """Expression of the force, and the parameters in it.

        Parameters
        ----------
        reference : Reference
            What the links shall do.

        Returns
        -------
        force : casadi.SX, shape (n, 1)
        parameters : tuple of Signal
            ``feedforward_stiffness``, ``feedforward_rest_length`` and ``feedforward_damping``.

        Examples
        --------
        >>> import casadi as ca
        >>> still = Reference(ca.SX([2.0]), ca.SX(1, 1), ca.SX(1, 1))
        >>> FeedForward(stiffness=10.0, rest_length=1.5).force(still)[1][0].value
        (10.0,)
        """
        size = reference.value.numel()
        c, rest, d = parameters = [
            Signal(
                f"feedforward_{item.name}",
                ca.SX.sym(f"feedforward_{item.name}", size),
                {"rest_length": "length", "damping": "drag"}.get(item.name, item.name),
                value=tuple(np.full(size, getattr(self, item.name), dtype=float).tolist()),
            )
            for item in fields(self)
        ]
        force = c.symbol * (reference.value - rest.symbol) + d.symbol * reference.rate
        return force, tuple(parameters)


@dataclass(frozen=True, eq=False)
class TrackingError:
    """Error e = y - y_ref of a plant's output and its rate.

    Parameters
    ----------
    value, rate : casadi.SX, shape (n, 1)
        The error e and e'.
    """

    value: ca.SX
    rate: ca.SX

    @classmethod
    def of(cls, plant: Model, reference: Reference) -> TrackingError:
        """Take the error of the plant's output ``length``; e' follows from the plant's ode.

        Parameters
        ----------
        plant : Model
            With the output ``length``.
        reference : Reference
            As many scalars as the output.

        Returns
        -------
        TrackingError

        Raises
        ------
        ArgumentError
            If the reference is something else, its size is not the output's, it is made with
            another time than the plant's, or the output's rate depends on inputs or contact
            forces at once (relative degree below two).
        """
        if not isinstance(reference, Reference):
            what = type(reference).__name__
            raise ArgumentError(f"reference must be follow(gait, plant.t), not {what}")
        own = ca.vertcat(plant.t, *(ca.vertcat(s.symbol, s.begin) for s in reference.schedules))
        known = {symbol.element_hash() for symbol in ca.symvar(own)}
        used = ca.symvar(ca.vertcat(reference.value, reference.rate))
        if not all(symbol.element_hash() in known for symbol in used):
            raise ArgumentError("the reference must be a function of the plant's own time, plant.t")
        y = plant.output("length")
        if y.shape != reference.value.shape:
            raise ArgumentError(
                f"the reference has {reference.value.numel()} links, the worm {y.numel()}"
            )
        rate = ca.jtimes(y, pack(plant.x), plant.ode) + ca.jacobian(y, plant.t)
        acting = ca.vertcat(pack(plant.u), plant.forces)
        if ca.depends_on(rate, acting):
            raise ArgumentError(f"forces act on the rates of {plant.name} at once, not by inertia")
        return cls(y - reference.value, rate - reference.rate)

    @property
    def square(self) -> ca.SX:
        """Square of the Euclidean norm, which is smooth everywhere."""
        return ca.dot(self.value, self.value)

    def at_start(self, plant: Model, reference: Reference) -> tuple[np.ndarray, np.ndarray] | None:
        """Error and its rate at time 0.

        Parameters
        ----------
        plant : Model
            Whose states and parameters have values.
        reference : Reference
            What the error is taken from.

        Returns
        -------
        tuple of ndarray or None
            None where the plant does not say where it starts.
        """
        known = [*plant.x, *plant.p]
        if any(signal.value is None for signal in known):
            return None
        symbols, numbers = [plant.t], [ca.DM(0)]
        for signal in known:
            symbols.append(signal.symbol)
            numbers.append(ca.DM(np.broadcast_to(np.asarray(signal.value, float), signal.size)))
        for schedule in (*plant.schedules, *reference.schedules):
            begin, piece = schedule.locate(np.zeros(1))
            symbols += [schedule.symbol, schedule.begin]
            numbers += [ca.DM(schedule.values[piece[0]]), ca.DM(begin)]
        value, rate = ca.Function("start", symbols, [self.value, self.rate])(*numbers)
        return np.array(value).ravel(), np.array(rate).ravel()


def close(
    plant: Model,
    reference: Reference,
    error: TrackingError,
    force: ca.SX,
    *,
    name: str,
    states: Sequence[Signal] = (),
    rates: Sequence[ca.SX] = (),
    parameters: Sequence[Signal] = (),
    outputs: Sequence[Output] = (),
    switches: Sequence[Switch] = (),
) -> Model:
    """Put a force for the plant's input and add the controller's states and parameters.

    Parameters
    ----------
    plant : Model
        With the input ``input``.
    reference : Reference
        What the plant's output follows.
    error : TrackingError
        Error of the output.
    force : casadi.SX, shape (n, 1)
        Takes the place of the input.
    name : str
        What the controller is.
    states, rates : sequence, optional
        The controller's states and their time derivatives.
    parameters : sequence of Signal, optional
        The controller's numbers.
    outputs : sequence of Output, optional
        More than plant, reference, error and input have.
    switches : sequence of Switch, optional
        Events of the controller; ``reset`` is the column of its own states alone.

    Returns
    -------
    Model
        The plant's states come first; its other inputs, its contacts and schedules stay.

    Raises
    ------
    ArgumentError
        If the plant has no input ``input`` of the force's size.
    """
    found = [signal for signal in plant.u if signal.name == "input"]
    if not found or found[0].symbol.shape != force.shape:
        raise ArgumentError(f"{plant.name} has no input 'input' of {force.numel()} scalars")
    x, own = pack(plant.x), pack(states)
    expressions = [plant.ode, plant.alg, *(o.expression for o in plant.outputs)]
    for switch in plant.switches:
        expressions += [switch.guard, switch.reset]
    # All at once, so that they go on sharing what they share.
    ode, alg, *rest = ca.substitute(expressions, [found[0].symbol], [force])
    shown, left = rest[: len(plant.outputs)], rest[len(plant.outputs) :]
    return Model(
        name=f"{plant.name} under {name}",
        x=[*plant.x, *states],
        ode=ca.vertcat(ode, *rates),
        u=[signal for signal in plant.u if signal is not found[0]],
        z=plant.z,
        p=[*plant.p, *parameters],
        alg=alg,
        t=plant.t,
        outputs=[
            *(replace(o, expression=e) for o, e in zip(plant.outputs, shown, strict=True)),
            Output("reference", reference.value, "length"),
            Output("error", error.value, "length"),
            Output("error_norm", ca.sqrt(error.square), "length"),
            Output("input", force, found[0].unit),
            *outputs,
        ],
        contacts=plant.contacts,
        switches=[
            *(
                Switch(s.name, guard, ca.vertcat(reset, own))
                for s, guard, reset in zip(plant.switches, left[::2], left[1::2], strict=True)
            ),
            *(replace(s, reset=ca.vertcat(x, s.reset)) for s in switches),
        ],
        schedules=[*plant.schedules, *reference.schedules],
    )
