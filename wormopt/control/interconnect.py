"""Splits a closed loop into plant and controller, and joins them by python-control."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError
from wormopt.model.explicit import import_control
from wormopt.model.given import check_kind, names_in
from wormopt.model.model import Model, Output, Signal, pack
from wormopt.model.values import check_names

MEASURED = ("length", "rate")
"""Outputs of the plant that a tracker of a chain uses."""
_TRIES = 3  # random states at which the inputs of a controller are tested


def controller_of(
    loop: Model,
    plant: Model,
    *,
    measured: Sequence[str] = MEASURED,
    input: str = "input",  # noqa: A002
) -> Model:
    """Take the controller out of a closed loop, as a Model with the measured outputs as inputs.

    Parameters
    ----------
    loop : Model
        A loop that was closed around the plant, by `lambda_tracker` or `funnel_tracker` say.
    plant : Model
        The very Model that was handed to it.
    measured : sequence of str, optional
        Outputs of the plant, affine in its states, that the controller sees.
    input : str, optional
        Name of the plant's input that the controller sets.

    Returns
    -------
    Model
        States: those that the loop has beyond the plant's. Inputs: the measured outputs by their
        names. Outputs: the plant's input, and ``error``. The reference is in it, as a schedule.

    Raises
    ------
    ArgumentError
        If the loop is not around this plant or has switches or delays, the controller uses more
        than the measured outputs, or these are not affine in the plant's states.
    UnknownNameError
        If the plant has no such output.

    Examples
    --------
    >>> from wormopt.control.lambda_tracker import lambda_tracker
    >>> from wormopt.control.loop import gait_reference
    >>> from wormopt.model.gait import Gait
    >>> from wormopt.systems.chain.build import chain
    >>> worm = chain(2, mass=1.0, stiffness=10.0, damping=5.0, rest_length=2.0, drag=0.1)
    >>> still = Gait(np.array([0.0, 1.0]), np.full((1, 2, 1), 2.5))
    >>> loop = lambda_tracker(worm, gait_reference(still, worm.t), tube_radius=0.2)
    >>> tracker = controller_of(loop, worm)
    >>> [s.name for s in tracker.x], [s.name for s in tracker.u]
    (['gain'], ['length', 'rate'])
    """
    check_kind("loop", loop, Model)
    check_kind("plant", plant, Model)
    check_kind("input", input, str)
    loop.refuse_delays("a controller by itself")
    own = own_states(loop, plant)
    if loop.switches:
        names = [s.name for s in loop.switches]
        raise ArgumentError(f"{loop.name} has switches {names}, which are not supported here")
    units = {o.name: o.unit for o in (*plant.outputs, *loop.outputs)}
    seen = [
        Signal(name, ca.SX.sym(name, plant[name].numel()), units.get(name, "1"))
        for name in names_in("measured", measured)
    ]
    wanted = [loop.ode[plant.n_x :], loop[input], loop["error"]]
    states = _by_measured(plant, ca.vertcat(*(plant[s.name] for s in seen)), pack(seen))
    _check_seen(plant, ca.vertcat(*wanted), states, pack(seen), seen)
    rates, force, error = ca.substitute(wanted, [pack(plant.x)], [states])
    known = {s.name for s in plant.p}
    needed = ca.vertcat(rates, force, error)
    return Model(
        f"controller of {plant.name}",
        x=own,
        ode=rates,
        u=seen,
        p=[s for s in loop.p if s.name not in known or ca.depends_on(needed, s.symbol)],
        t=loop.t,
        outputs=[Output(input, force, units[input]), Output("error", error, units["error"])],
        schedules=[
            s
            for s in loop.schedules
            if s not in plant.schedules or ca.depends_on(needed, ca.vertcat(s.symbol, s.begin))
        ],
    )


def interconnect(
    loop: Model,
    plant: Model,
    *,
    measured: Sequence[str] = MEASURED,
    input: str = "input",  # noqa: A002
    v_reg: float = 1 / 40,
    p: Mapping[str, ArrayLike] | None = None,
) -> Any:
    """Make an interconnection of control systems of a closed loop: the plant and its controller.

    Both are control.NonlinearIOSystem objects, connected by the names of the measured outputs and
    the input, so python-control can exchange, open or analyse them.

    Parameters
    ----------
    loop, plant : Model
        The closed loop, and the plant from which it was made.
    measured : sequence of str, optional
        Outputs of the plant, affine in its states, that the controller sees.
    input : str, optional
        Name of the plant's input that the controller sets.
    v_reg : float, optional
        Width of the smooth friction law, positive.
    p : mapping of str to array_like, optional
        Parameters by name; the loop's own if left out.

    Returns
    -------
    control.InterconnectedSystem
        Subsystems ``plant`` and ``controller``; states in the order of the loop's; no inputs;
        outputs: what is measured, the input, and ``error``.

    Raises
    ------
    ArgumentError
        As `controller_of`, or if names or sizes of parameters do not fit.
    UnknownNameError
        If the plant has no such output.

    Examples
    --------
    The closed loop of a worm and a tracker, for python-control, whose import takes two seconds:

    >>> import wormopt as wo
    >>> worm = wo.chain(1, mass=1.0, stiffness=10.0, damping=5.0, rest_length=2.0, drag=0.1)
    >>> still = wo.Gait([0.0, 1.0], [[[2.5]]])
    >>> loop = wo.lambda_tracker(worm, wo.gait_reference(still, worm.t), tube_radius=0.2)
    >>> system = interconnect(loop, worm)  # doctest: +SKIP
    >>> system.nstates  # doctest: +SKIP
    5
    """
    given = {} if p is None else p
    check_kind("loop", loop, Model)
    check_names(given, [s.name for s in loop.p], "parameter")
    controller = controller_of(loop, plant, measured=measured, input=input)
    parts = []
    for name, model, outputs in (
        ("plant", plant, list(measured)),
        ("controller", controller, [input, "error"]),
    ):
        inner = {key: given[key] for key in given if key in {s.name for s in model.p}}
        part = model.to_control(output=outputs, v_reg=v_reg, p=inner)
        part.name = name
        parts.append(part)
    return import_control().interconnect(
        parts,
        inputs=[],
        outputs=[label for part in parts for label in part.output_labels],
        name=loop.name,
    )


def own_states(loop: Model, plant: Model) -> Sequence[Signal]:
    """States of a loop's controller; ArgumentError if the loop is not around this very plant."""
    shared = list(loop.x[: len(plant.x)])
    alike = len(shared) == len(plant.x) and all(
        ca.is_equal(a.symbol, b.symbol) for a, b in zip(shared, plant.x, strict=True)
    )
    if not alike:
        raise ArgumentError(
            f"{loop.name} is not a loop around this {plant.name}; pass the plant that it was "
            "made from"
        )
    return loop.x[len(plant.x) :]


def _by_measured(plant: Model, outputs: ca.SX, seen: ca.SX) -> ca.SX:
    """States of the plant in terms of the measured outputs `seen`; unobservable ones are 0."""
    x = pack(plant.x)
    matrix = ca.jacobian(outputs, x)
    if ca.symvar(matrix):
        raise ArgumentError(f"measured outputs of {plant.name} are not affine in its states")
    numbers = ca.DM(ca.evalf(matrix)).full()
    found: Any = scipy.linalg.qr(numbers, mode="r", pivoting=True)
    order = found[1]
    rank = int(np.linalg.matrix_rank(numbers))
    columns = np.sort(order[:rank])
    inverse = np.zeros((x.numel(), len(numbers)))
    inverse[columns] = np.linalg.pinv(numbers[:, columns])
    inverse[np.abs(inverse) < 1e-13] = 0.0
    offset = ca.substitute(outputs, x, ca.SX.zeros(x.numel()))
    return ca.densify(ca.mtimes(ca.sparsify(ca.DM(inverse)), seen - offset))


def _check_seen(
    plant: Model, wanted: ca.SX, states: ca.SX, seen: ca.SX, signals: Sequence[Signal]
) -> None:
    """Refuse a controller that uses more of the plant than its measured outputs."""
    # Its expressions must not change when the plant's states are replaced by others with the same
    # measured outputs, which is tested at random states.
    x = pack(plant.x)
    measured = ca.vertcat(*(plant[s.name] for s in signals))
    again = ca.substitute(wanted, x, ca.substitute(states, seen, measured))
    symbols = ca.vertcat(*ca.symvar(ca.vertcat(wanted, again)))
    both = ca.Function("both", [symbols], [wanted, again])
    random = np.random.default_rng(0)
    for _ in range(_TRIES):
        first, second = (np.array(v) for v in both(random.uniform(0.5, 1.5, symbols.numel())))
        size = 1 + np.nanmax(np.abs(first), initial=0.0)
        if not np.all(np.abs(first - second) <= 1e-9 * size):
            names = ", ".join(s.name for s in signals)
            raise ArgumentError(
                f"the controller uses more of {plant.name} than {names}; name all in measured="
            )
