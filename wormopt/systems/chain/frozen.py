"""Chains with a constant gain of their λ-tracker: linear loops and nonlinear simulations."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import casadi as ca
import msgspec
import numpy as np

from wormopt.analysis.linearise import linearise
from wormopt.control.frozen import Plant, Task
from wormopt.control.loop import Reference
from wormopt.errors import ArgumentError
from wormopt.model.explicit import Explicit
from wormopt.model.friction import Law, Viscous
from wormopt.model.gait import Gait
from wormopt.model.model import Model, Signal, pack
from wormopt.model.values import signal_values
from wormopt.progress import Report, silent
from wormopt.simulation.options import Tolerance, Treatment
from wormopt.simulation.simulate import simulate
from wormopt.systems.chain.loops import close_loop
from wormopt.systems.chain.tables import ChainTable, DerivativeTracker, FilterTracker, QuadraticLaw

LambdaTracker = FilterTracker | DerivativeTracker

_SAMPLES = 4096  # of the reference, in a period
_JUDGED = 2001  # samples of the last period of a simulation
_WIDE = 2.0**40  # a tube that no error leaves; its square is exact, so that the gain stays
_WIDER, _HALVINGS = 1.5, 10  # of the search for the least gain
_RESTS = 1e-9  # relative rates of a state of rest
_DECAYED = 28.0  # time constants after which a start is forgotten


def without_dry_friction(plant: Model, laws: Sequence[Law]) -> Model:
    """The chain with viscous contacts only; other forces of the ground are inputs ``ground``."""
    dry = [c for c, law in zip(plant.contacts, laws, strict=True) if not isinstance(law, Viscous)]
    wet = [c for c, law in zip(plant.contacts, laws, strict=True) if isinstance(law, Viscous)]
    if not dry:
        return plant
    ground = Signal("ground", ca.vertcat(*(c.force for c in dry)), "force", value=0.0)
    return replace(plant, contacts=wet, u=[*plant.u, ground])


def task_of(plant: Model, laws: Sequence[Law], gait: Gait, shift: float, rest: np.ndarray) -> Task:
    """Reference and disturbance of the linear loops of a chain."""
    links = len(rest)
    # The ground acts on every mass by an input of its own; viscous contacts remain contacts.
    push = ca.SX.sym("push", links + 1)
    free = without_dry_friction(plant, laws)
    inputs = [s for s in free.u if s.name == "ground"]
    at_rest = ca.substitute(free.ode, ca.vertcat(ca.SX(0, 1), *(s.symbol for s in inputs)),
                            ca.SX.zeros(sum(s.size for s in inputs)))  # fmt: skip
    mass = plant["mass"]
    pushed = replace(
        free,
        ode=at_rest + ca.vertcat(ca.SX.zeros(links + 1), push / mass),
        u=[plant.u[0], Signal("push", push, "force", value=0.0)],
    )
    load = np.asarray(next(s.value for s in plant.p if s.name == "load"), dtype=float)
    offset = _over_period(gait, shift) - rest[:, None]
    ground = [_interval(law) for law in laws] or [(0.0, 0.0)] * (links + 1)
    linear = Plant.of(linearise(pushed, output="length"), links)
    return _task(linear, gait, offset, -np.broadcast_to(load, links + 1), ground)


def task_of_own(plant: Model, laws: Sequence[Law], gait: Gait, shift: float) -> Task:
    """Reference and disturbance of the linear loops of a plant of the user's own.

    Its lengths count from those at rest without input and dry friction.
    """
    free = without_dry_friction(plant, laws)
    x, y = pack(free.x), free["length"]
    if not ca.is_linear(ca.vertcat(free.ode, y), ca.vertcat(x, pack(free.u))):
        raise ArgumentError(
            f"{plant.name} is not linear, as linear theory needs; analyse it by wo.linearise at an "
            "operating point"
        )
    linear = linearise(free, output="length")
    rates, lengths = _at_zero(free)
    rest = np.linalg.lstsq(linear.A, -rates, rcond=None)[0]
    if np.abs(linear.A @ rest + rates).max() > _RESTS * max(np.abs(rates).max(), 1e-300):
        raise ArgumentError(
            f"{plant.name} has no state of rest without input, as linear theory needs"
        )
    offset = _over_period(gait, shift) - (linear.C @ rest + lengths)[:, None]
    ground = [_interval(law) for law in laws if not isinstance(law, Viscous)]
    return _task(Plant.of(linear, len(lengths)), gait, offset, np.zeros(len(ground)), ground)


def _task(
    plant: Plant,
    gait: Gait,
    offset: np.ndarray,
    load: np.ndarray,
    ground: Sequence[tuple[float, float]],
) -> Task:
    """Task for dry forces of the ground within intervals, or unknown ones if one is unbounded."""
    low, high = np.array(ground).reshape(-1, 2).T
    middle, half = np.zeros(len(low)), np.full(len(low), np.inf)
    if np.isfinite(ground).all():
        middle, half = (low + high) / 2, (high - low) / 2
    return Task(plant, gait.period, offset, load, middle, half)


def _at_zero(model: Model) -> list[np.ndarray]:
    """Rates of the states, and lengths, at time 0 for states and inputs of 0."""
    explicit = Explicit(model, "length")
    found = explicit.function("zero", explicit.rates, explicit.observed)(
        0.0,
        np.zeros(model.n_x),
        np.zeros(sum(u.size for u in model.u)),
        signal_values(model.p, None, "parameter"),
        1.0,
        explicit.scheduled(0.0),
    )
    return [part.full().ravel() for part in found]


def _over_period(gait: Gait, shift: float) -> np.ndarray:
    """Lengths at the samples of a period, (links, samples)."""
    times = gait.period * np.arange(_SAMPLES) / _SAMPLES + shift
    return gait(np.mod(times, gait.period))


def _interval(law: Law) -> tuple[float, float]:
    """Least and largest dry force of a contact, at rest or sliding."""
    if isinstance(law, Viscous):
        return 0.0, 0.0
    low, high = law.stick_interval
    return float(low), float(high)


@dataclass(frozen=True, eq=False)
class Frozen:
    """Loop of a chain with constant gain."""

    loop: Model
    period: float

    @classmethod
    def of(
        cls, plant: Model, reference: Reference, tracker: LambdaTracker, worm: ChainTable | None,
        period: float,
    ) -> Frozen:  # fmt: skip
        """Close the loop with a tracker whose tube no error leaves, so its gain is constant."""
        held = msgspec.structs.replace(
            tracker, tube_radius=_WIDE, growth=1.0, adaptation=QuadraticLaw()
        )
        return cls(close_loop(plant, reference, held, worm), period)

    def error(
        self, gain: float, end: float, contact: Treatment, tolerance: Tolerance,
        report: Report = silent,
    ) -> float:  # fmt: skip
        """Largest error over the last period of a simulation."""
        times = np.linspace(end - self.period, end, _JUDGED)
        motion = simulate(
            self.loop, end, contact=contact, x0={"gain": gain}, times=times,
            tolerance=tolerance, report=report,
        )  # fmt: skip
        return float(motion["error_norm"].max())


def settled(slowest: float, period: float) -> float:
    """Whole periods after which the start is forgotten; `slowest` is a pole's real part."""
    return period * float(np.ceil(_DECAYED / -slowest / period + 1))


def bisect(
    error: Callable[[float], float], least: float, most: float, wanted: float, guess: float
) -> tuple[float | None, list[tuple[float, float]]]:
    """Bisect for the least gain with an error of at most `wanted`; also return all tried pairs.

    The error is assumed to decrease with the gain. Gains far above the `guess`, which make loops
    stiff, are tried only where needed. The gain is None if the largest gain does not suffice. The
    pairs are (gain, error).
    """
    tried: list[tuple[float, float]] = []

    def enough(gain: float) -> bool:
        tried.append((gain, error(gain)))
        return tried[-1][1] <= wanted

    low = high = float(np.clip(guess, least, most))
    if enough(high):
        while high > least and enough(low := max(high / _WIDER, least)):
            high = low
        if high == least:
            return least, tried
    else:
        while high < most and not enough(high := min(low * _WIDER, most)):
            low = high
        if tried[-1][1] > wanted:
            return None, tried
    for _ in range(_HALVINGS):
        middle = float(np.sqrt(low * high))
        low, high = (low, middle) if enough(middle) else (middle, high)
    return high, tried
