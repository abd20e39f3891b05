"""A worm of the plane by steps of fixed length that know no events: a second route."""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError
from wormopt.model.friction import Viscous
from wormopt.model.model import Model, Signal
from wormopt.model.values import signal_values
from wormopt.progress import Report, silent
from wormopt.simulation.moreau import MoreauJean
from wormopt.simulation.trajectory import Trajectory

_FINER = 4  # the second step is so many times shorter
# Where an event lies within its step adds to the error at first order, and by chance: a mass that
# turns back slides to one side for the whole step. So several lengths tell the longer one's error.
_LENGTHS = (1.0, 0.93, 0.87, 0.81)
_SHARE = 0.005  # of the longest stable step
_PER_WAY = 1e-9  # of the usual size: a way that is none


@dataclass(frozen=True)
class Stepped:
    """Where steps of Moreau and Jean end, against the end found by events."""

    step: float  # the longer one of two; the other is a quarter of it
    # largest difference of a place over the longest way, by the longer one: root of the mean square
    # over lengths near it, told for its own
    coarse: float
    fine: float  # by the shorter one: about a quarter of it, at first order
    rounding: float  # what adding up so many short steps may cost, over the same way


def stepper_of(worm: Model) -> MoreauJean | None:
    """Steps of a planar chain without inputs; None where these do not treat its ground.

    They treat laws that fill an ellipse or a box and linear drag, with rods or without.
    """
    try:
        return MoreauJean(_with_clock(_drags_in_ode(worm)))
    except ArgumentError:
        return None


def step_again(
    stepper: MoreauJean, motion: Trajectory, step: float | None = None, report: Report = silent
) -> Stepped:
    """Follow the same worm by steps of one length, then of a quarter of it.

    Errors are of first order. `motion` is of the worm, from time 0, its places the first states.
    Raises SolveError or Interrupted as `MoreauJean.march`.
    """
    model = stepper.model
    if step is None:
        start = signal_values(model.x, None, "state", fill=0.0)
        numbers = signal_values(tuple(model.p), None, "parameter")
        step = min(_SHARE * stepper.safe_step(start, numbers), motion.end_time / 200)
    places = motion["position"]
    way = longest_way(places, motion.system.model.x[0].nominal)

    def error(length: float) -> float:
        found = stepper.march(motion.end_time, step=length, report=report)
        return float(np.abs(found.states[: len(places), -1] - places[:, -1]).max() / way)

    coarse = np.sqrt(np.mean([(error(share * step) / share) ** 2 for share in _LENGTHS]))
    steps = _FINER * motion.end_time / step
    rounding = steps * np.finfo(float).eps / 2 * float(np.abs(places).max()) / way
    return Stepped(step, float(coarse), error(step / _FINER), rounding)


def longest_way(places: np.ndarray, nominal: float) -> float:
    """Longest way of a coordinate (rows over time), a billionth of the usual size at least."""
    return float(max(np.abs(np.diff(places, axis=1)).sum(axis=1).max(), _PER_WAY * nominal))


def _with_clock(worm: Model) -> Model:
    """The same worm, time being a place that moves at the rate 1."""
    clock, tick = ca.SX.sym("clock"), ca.SX.sym("tick")
    (place, speed), half = worm.x, worm.n_x // 2
    ode = ca.vertcat(worm.ode[:half], tick, worm.ode[half:], 0)
    contacts = [
        replace(c, velocity=ca.substitute(c.velocity, worm.t, clock)) for c in worm.contacts
    ]
    return Model(
        worm.name,
        [place, Signal("clock", clock, "time", value=0.0),
         speed, Signal("tick", tick, "1", value=1.0)],
        ca.substitute(ode, worm.t, clock),
        u=worm.u,
        p=worm.p,
        contacts=contacts,
    )  # fmt: skip


def _drags_in_ode(worm: Model) -> Model:
    """The same worm, linear drag being a force like any other."""
    drags = [c for c in worm.contacts if isinstance(c.law, Viscous)]
    if not drags:
        return worm
    forces = [c.law.slip_force(c.velocity, 1) for c in drags]  # type: ignore[union-attr,call-arg]
    symbols = ca.vertcat(*(c.force for c in drags))
    ode = ca.substitute(worm.ode, symbols, ca.vertcat(*forces))
    kept = [c for c in worm.contacts if not isinstance(c.law, Viscous)]
    return replace(worm, ode=ode, contacts=kept, outputs=())
