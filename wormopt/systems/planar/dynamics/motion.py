"""Harmonic inputs of a body in the plane, and its works over time."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np

from wormopt.control.loop import feed
from wormopt.errors import ArgumentError
from wormopt.model.model import Model, Output, Signal, Switch, pack
from wormopt.simulation.trajectory import Trajectory
from wormopt.systems.planar.body.strokes import Harmonics

_POWER = "_power"


def swing(plant: Model, period: float, courses: dict[str, Harmonics]) -> Model:
    """Replace inputs of a plant by harmonics of time; the phase is 0 at time 0.

    Parameters
    ----------
    plant : Model
        Model with inputs of these names.
    period : float
        Period, positive.
    courses : dict
        Harmonics of each input, by its name; other inputs stay.

    Returns
    -------
    Model
        Outputs have the names of the inputs; mean and coefficients are parameters
        ``<input>_mean``, ``<input>_cosine``, ``<input>_sine``, and the period is ``period``.

    Raises
    ------
    ArgumentError
        If an input does not exist, or has another size.

    Examples
    --------
    >>> from wormopt.systems.planar.dynamics.chain import planar_chain
    >>> worm = planar_chain(1, mass=1.0, stiffness=1.0, damping=0.0, rest_length=1.0)
    >>> push = Harmonics([0.0], cosine=[[0.0]], sine=[[1.0]])
    >>> [signal.name for signal in swing(worm, 2.0, {"input": push}).u]
    []
    """
    known = {signal.name: signal for signal in plant.u}
    T = Signal("period", ca.SX.sym("period"), "time", value=float(period))
    expressions, parameters, shown = [], [T], []
    for name, course in courses.items():
        if name not in known or known[name].size != course.n_s:
            sizes = ", ".join(f"{s.name} of {s.size}" for s in plant.u)
            raise ArgumentError(f"{name} of size {course.n_s} is none of the inputs: {sizes}")
        value, own = _course(name, known[name].unit, course, 2 * ca.pi * plant.t / T.symbol)
        expressions.append(value)
        parameters += own
        shown.append(Output(name, value, known[name].unit))
    fed = feed(plant, [known[name] for name in courses], ca.vertcat(ca.SX(0, 1), *expressions))
    return replace(fed, p=[*fed.p, *parameters], outputs=[*fed.outputs, *shown])


def _course(name: str, unit: str, course: Harmonics, phase: ca.SX) -> tuple[ca.SX, list[Signal]]:
    mean = Signal(f"{name}_mean", ca.SX.sym("mean", course.n_s), unit, value=tuple(course.mean))
    value, signals = mean.symbol, [mean]
    orders = range(1, len(course.cosine) + 1)
    for part, wave in (("cosine", ca.cos), ("sine", ca.sin)):
        table = getattr(course, part)
        symbol = ca.SX.sym(part, table.size)
        signals.append(Signal(f"{name}_{part}", symbol, unit, value=tuple(table.ravel())))
        rows = ca.vertsplit(symbol, course.n_s) if table.size else []
        for h, row in zip(orders, rows, strict=True):
            value = value + row * wave(h * phase)
    return value, [signal for signal in signals if signal.size]


def measure_works(model: Model, nominal: float) -> Model:
    """Add states ``<name>_work`` that integrate the outputs ``<name>_power``.

    Their usual size is `nominal`.
    """
    powers = [o for o in model.outputs if o.name.endswith(_POWER)]
    states = [
        Signal(o.name.removesuffix(_POWER) + "_work", ca.SX.sym("work"), "energy", nominal,
               value=0.0)
        for o in powers
    ]  # fmt: skip
    own = pack(states)
    return replace(
        model,
        x=[*model.x, *states],
        ode=ca.vertcat(model.ode, *(o.expression for o in powers)),
        switches=[
            Switch(s.name, s.guard, ca.vertcat(s.reset, own), s.terminal) for s in model.switches
        ],
    )


def watch_links(model: Model, least: float) -> Model:
    """End the motion of a chain if a link gets shorter than `least`.

    A link without length has no direction: its mass turns about the other ever faster. Links that
    are shorter at the start are ignored until they have been longer.
    """
    lengths = model["length"]
    closes = [
        Switch(f"link {j + 1} closes", least - lengths[j], pack(model.x), terminal=True)
        for j in range(lengths.numel())
    ]
    return replace(model, switches=[*model.switches, *closes])


def closed_link(motion: Trajectory) -> str:
    """Return the link that ended a motion of a model of `watch_links`, for example "link 1"."""
    last = motion.events[-1] if motion.events else None
    return last.name.removesuffix(" closes") if last and last.kind == "switch" else ""


def energy_error(motion: Trajectory, stored: str) -> float:
    """Return the largest difference of all works and the energy `stored`, over the largest.

    The motion is of a model of `measure_works`.
    """
    names = [s.name for s in motion.system.model.x if s.name.endswith("_work")]
    works, energy = np.array([motion[name][0] for name in names]), motion[stored][0]
    gap = np.abs(works.sum(axis=0) - (energy - energy[0])).max()
    size = max(np.abs(works).max(), np.abs(energy).max())
    return float(gap / size) if size else 0.0


def resting_masses(motion: Trajectory) -> np.ndarray:
    """Return which points rest at the samples, by all their contacts; shape (points, m).

    A point rests if its contacts hold it along its heading and across. Points with resistance in a
    single direction never count as resting, nor does anything with smooth contact.
    """
    model = motion.system.model
    points = model["heading"].numel()
    modes, names = motion.modes_at(motion.time), [c.name for c in motion.system.contacts]
    held = {name: row == 0 for name, row in zip(names, modes, strict=False)}
    never = np.zeros(len(motion.time), bool)
    rows = []
    for i in range(points):
        both = [held.get(f"mass {i} {word}", never) for word in ("along", "across")]
        rows.append(held.get(f"mass {i}", both[0] & both[1]))
    return np.array(rows)
