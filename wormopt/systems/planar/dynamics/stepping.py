"""Second route to a planar worm: time stepping with fixed steps and without events."""

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

_FINER = 4  # ratio of both steps
# The place of an event within its step changes the error at first order, randomly: a mass that
# reverses slides to one side for the whole step. So several steps estimate the longer one's error.
_LENGTHS = (1.0, 0.93, 0.87, 0.81)
_SHARE = 0.005  # of the longest stable step
_PER_WAY = 1e-9  # of the usual size: a displacement below counts as none


@dataclass(frozen=True)
class Stepped:
    """End by Moreau-Jean steps, compared with the end by events."""

    step: float  # the longer step; the shorter one is a quarter of it
    # error by the longer step, a root mean square over steps near it: largest difference of a
    # place over the longest displacement
    coarse: float
    fine: float  # error by the shorter step: about a quarter, at first order
    rounding: float  # possible round-off of the short steps, over the same displacement


def stepper_of(worm: Model) -> MoreauJean | None:
    """Return the time stepper of a planar chain without inputs; None if it cannot treat its ground.

    It treats laws with an elliptic or box set of forces and linear drag, with rods or without.
    """
    try:
        return MoreauJean(_with_clock(_drags_in_ode(worm)))
    except ArgumentError:
        return None


def step_again(
    stepper: MoreauJean, motion: Trajectory, step: float | None = None, report: Report = silent
) -> Stepped:
    """Simulate the same worm with steps of one length, then of a quarter of it.

    Errors are of first order. `motion` is that of the worm, from time 0, with places as first
    states. Raises SolveError or Interrupted like `MoreauJean.march`.
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
    """Return the longest displacement of a coordinate, at least a billionth of the usual size."""
    return float(max(np.abs(np.diff(places, axis=1)).sum(axis=1).max(), _PER_WAY * nominal))


def _with_clock(worm: Model) -> Model:
    """Return the same worm with time as a place that moves at rate 1."""
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
    """Return the same worm with linear drag as an ordinary force."""
    drags = [c for c in worm.contacts if isinstance(c.law, Viscous)]
    if not drags:
        return worm
    forces = [c.law.slip_force(c.velocity, 1) for c in drags]  # type: ignore[union-attr,call-arg]
    symbols = ca.vertcat(*(c.force for c in drags))
    ode = ca.substitute(worm.ode, symbols, ca.vertcat(*forces))
    kept = [c for c in worm.contacts if not isinstance(c.law, Viscous)]
    return replace(worm, ode=ode, contacts=kept, outputs=())
