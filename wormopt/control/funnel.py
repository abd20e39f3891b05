"""Funnel control: the error stays within bounds that decrease with time."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

import casadi as ca
import numpy as np

from wormopt.control.loop import (
    Actuator,
    FeedForward,
    Reference,
    TrackingError,
    actuated,
    check_sign,
    close,
)
from wormopt.errors import ArgumentError
from wormopt.model.given import check_choice, check_kind, check_number
from wormopt.model.lift import lift
from wormopt.model.model import TINY, Model, Output, Signal

Number = float | ca.SX

FunnelLaw = Literal["recursive", "two gains"]
"""Feedback of error and rate: by e' + k_0 e, or each by its own gain and funnel."""


@dataclass(frozen=True, eq=False)
class Funnel:
    """Bound end + (start - end) exp(-t/time) on a norm.

    Parameters
    ----------
    start, end : float or casadi.SX
        Width at time 0 and after long time, positive.
    time : float or casadi.SX
        Time in which it narrows, positive.

    Raises
    ------
    ArgumentError
        If a number is not positive and finite.

    Examples
    --------
    >>> import math
    >>> round(Funnel(2.0, 1.0, time=1.0).width(math.log(2.0)), 12)
    1.5
    """

    start: Number
    end: Number
    time: Number

    def __post_init__(self) -> None:
        for name in ("start", "end", "time"):
            value = getattr(self, name)
            if not isinstance(value, ca.SX):
                check_number(f"{name} of a funnel", value, above=0.0)

    def width(self, t: ca.SX) -> ca.SX:
        """Bound at a time.

        Parameters
        ----------
        t : casadi.SX
            Time.

        Examples
        --------
        >>> import casadi as ca
        >>> Funnel(start=3.0, end=0.5, time=2.0).width(ca.SX(0))
        SX(3)
        """
        return self.end + (self.start - self.end) * ca.exp(-t / self.time)


def funnel_tracker(
    plant: Model,
    reference: Reference,
    *,
    funnel: Funnel,
    rate_funnel: Funnel,
    law: FunnelLaw = "recursive",
    gain: float = 1.0,
    actuator: Actuator = "force",
    feedforward: FeedForward | None = None,
    output: str = "length",
    input: str = "input",  # noqa: A002
) -> Model:
    """Close the loop by a funnel controller for relative degree two.

    With e = y - y_ref, widths psi_0, psi_1 of both funnels and the Euclidean norm:

    - "recursive": k_0 = 1 / (1 - |e|^2/psi_0^2), e_1 = e' + k_0 e,
      k_1 = 1 / (1 - |e_1|^2/psi_1^2), u = -gain k_1 e_1, the controller of Berger, Le and Reis
      (Automatica 87, 345-357, 2018) at r = 2;
    - "two gains": k_0 = 1 / (1 - |e|/psi_0), e_1 = e', k_1 = 1 / (1 - |e'|/psi_1),
      u = -gain (k_0^2 e + k_1 e'), the controller of Hackl, Hopfe, Ilchmann, Mueller and Trenn
      (SIAM J. Control Optim. 51, 965-995, 2013) with gains scaled by their funnels, and with
      norms where there it has one output. Its rate funnel must leave e room to follow its own:
      psi_1 > -psi_0'.

    Both need no model and keep |e| < psi_0 and |e_1| < psi_1 for ever if they hold at the
    start. The factor ``gain`` is not in the papers; it scales the high-frequency gain, which may
    be any positive definite matrix. The gains have the units of the scene: k_0 is 1 per unit of
    time on the reference.

    The gains change sign outside the funnels, where the loop has no meaning. Solvers do not know
    this: check the outputs ``error_norm`` and ``rate_error_norm`` against the widths.

    Parameters
    ----------
    plant : Model
        With an input and an output of relative degree two, of as many entries.
    reference : Reference
        Reference of the output.
    funnel, rate_funnel : Funnel
        Bounds psi_0 on |e| and psi_1 on |e_1|.
    law : {"recursive", "two gains"}, optional
        Kind of controller.
    gain : float, optional
        Force per speed e_1 in the middle of the funnels, positive.
    actuator : {"force", "rest_length"}, optional
        Whether u above is the force itself, or by (11) moves the rest lengths: the force is then
        c_j times u_j, with the plant's own ``stiffness`` c.
    feedforward : FeedForward, optional
        Force added to the controller's.
    output, input : str, optional
        Names of the plant's output or state that follows the reference, and of the input.

    Returns
    -------
    Model
        The plant's states. Parameters: the plant's, ``gain``, ``funnel_start``, ``funnel_end``,
        ``funnel_time``, the same of ``rate_funnel``, and those of the feed-forward. Outputs: the
        plant's, ``reference``, ``error``, ``error_norm``, the input under its name,
        ``rate_error_norm`` |e_1|, ``funnel`` and ``rate_funnel`` (the widths), ``funnel_gain``
        (k_0 and k_1).

    Raises
    ------
    ArgumentError
        If a number is out of range, the plant has no such output or input, sizes of plant and
        reference differ, forces act on the output's rate at once, the input accelerates the output
        in the wrong direction, the plant starts outside a funnel, or the rate funnel is too narrow
        for the other.

    Examples
    --------
    >>> from wormopt.model.gait import Gait
    >>> from wormopt.control.loop import gait_reference
    >>> from wormopt.systems.chain.build import chain
    >>> worm = chain(2, mass=1.0, stiffness=10.0, damping=5.0, rest_length=2.0, drag=0.1)
    >>> still = Gait(np.array([0.0, 1.0]), np.full((1, 2, 1), 2.5))
    >>> wide, narrow = Funnel(2.0, 0.1, time=1.0), Funnel(4.0, 1.0, time=1.0)
    >>> loop = funnel_tracker(worm, gait_reference(still, worm.t), funnel=wide, rate_funnel=narrow)
    >>> [signal.name for signal in loop.x]
    ['position', 'velocity']
    """
    check_kind("funnel", funnel, Funnel)
    check_kind("rate_funnel", rate_funnel, Funnel)
    check_number("gain", gain, above=0.0)
    check_choice("law", law, get_args(FunnelLaw))
    error = TrackingError.of(plant, reference, output)
    check_sign(plant, output, input)
    if law == "two gains":
        _check_room(funnel, rate_funnel)
    _check_start(error.at_start(plant, reference), funnel, rate_funnel, law)
    strength = ca.SX.sym("gain")
    (outer,), numbers = lift([funnel], "funnel", _units(error.unit))
    (inner,), rate_numbers = lift([rate_funnel], "rate_funnel", _units(error.rate_unit))

    width, rate_width = outer.width(plant.t), inner.width(plant.t)
    if law == "recursive":
        k0 = 1 / (1 - error.square / width**2)
        rate_error = error.rate + k0 * error.value
        square = ca.dot(rate_error, rate_error)
        k1 = 1 / (1 - square / rate_width**2)
        fed = k1 * rate_error
    else:
        k0 = 1 / (1 - ca.sqrt(error.square) / width)
        square = ca.dot(error.rate, error.rate)
        k1 = 1 / (1 - ca.sqrt(square) / rate_width)
        fed = k0**2 * error.value + k1 * error.rate
    force, believed = actuated(plant, reference, -strength * fed, actuator, feedforward)
    return close(
        plant,
        reference,
        error,
        force,
        name="a funnel controller",
        input=input,
        parameters=[
            Signal("gain", strength, error.per("drag"), lower=TINY, value=gain),
            *numbers,
            *rate_numbers,
            *believed,
        ],
        outputs=[
            Output("rate_error_norm", ca.sqrt(square), error.rate_unit),
            Output("funnel", width, error.unit),
            Output("rate_funnel", rate_width, error.rate_unit),
            Output("funnel_gain", ca.vertcat(k0, k1)),
        ],
    )


def _units(start: str) -> dict[str, str]:
    return {"start": start, "end": start, "time": "time"}


def _check_room(funnel: Funnel, rate_funnel: Funnel) -> None:
    """Refuse a rate funnel too narrow for an error at the edge of its funnel to follow it."""
    numbers = [f for each in (funnel, rate_funnel) for f in (each.start, each.end, each.time)]
    if any(isinstance(number, ca.SX) for number in numbers):
        return
    start, end, time, rate_start, rate_end, rate_time = map(float, numbers)
    # least psi_1 + psi_0': at the start, where it has no slope, or at the end
    shrinks, narrows = (start - end) / time, (rate_start - rate_end) / rate_time
    times, apart = [0.0], 1 / time - 1 / rate_time
    if shrinks * narrows > 0 and apart != 0:
        times.append(max(math.log(shrinks / (time * narrows)) / apart, 0.0))
    for t in times:
        rate = shrinks * math.exp(-t / time)
        width = rate_end + (rate_start - rate_end) * math.exp(-t / rate_time)
        if not width > rate:
            raise ArgumentError(
                f"at t = {t:.3g} the funnel narrows at the rate {rate:.6g}, but the rate funnel "
                f"allows less than {width:.6g}; write a larger rate_funnel"
            )


def _check_start(
    start: tuple[np.ndarray, np.ndarray] | None,
    funnel: Funnel,
    rate_funnel: Funnel,
    law: FunnelLaw,
) -> None:
    if start is None or isinstance(funnel.start, ca.SX) or isinstance(rate_funnel.start, ca.SX):
        return
    error, rate = start
    size = float(np.linalg.norm(error))
    if not size < funnel.start:
        raise ArgumentError(
            f"the error starts at {size:.6g}, outside its funnel of {funnel.start:g}"
        )
    if law == "recursive":
        rate, what = rate + error / (1 - (size / funnel.start) ** 2), "e' + k_0 e"
    else:
        what = "e'"
    rate_size = float(np.linalg.norm(rate))
    if not rate_size < rate_funnel.start:
        raise ArgumentError(
            f"{what} starts at {rate_size:.6g}, outside its funnel of {rate_funnel.start:g}"
        )
