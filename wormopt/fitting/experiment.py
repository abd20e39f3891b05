"""The verb `plan_experiment`: what to run next, so that the wanted numbers are known best."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import minimize

from wormopt.errors import ArgumentError, SolveError
from wormopt.fitting.choices import Choice
from wormopt.fitting.information import Criterion, Knowledge
from wormopt.model.model import Model
from wormopt.model.values import numbers
from wormopt.progress import Report, silent
from wormopt.simulation.options import Exact, Route, Tolerance, Treatment
from wormopt.simulation.simulate import simulate
from wormopt.simulation.trajectory import Trajectory

# Chosen numbers, from -1 to 1, are moved by so much for the slope of the criterion: derivatives
# jump by a sample's share where an event passes a sample, so a smaller step would see less.
_STEP = 1e-4
# Limits along a motion are looked at so many times; the check of a plan looks oftener.
_LOOKS, _CLOSER = 200, 2000
_TOLERANCE = Tolerance(1e-9, 1e-10)
_FINER = Tolerance(1e-11, 1e-12)
# What a motion that cannot be followed, or that shows nothing of a wanted number, is worth.
_WORTHLESS = 50.0


@dataclass(frozen=True, eq=False)
class Experiment:
    """A run to be planned: what is unknown, what is measured, what may be chosen within limits.

    Parameters
    ----------
    model : Model
        With the best values known of what is unknown, and the worm's start.
    unknowns : mapping of str to (mapping of str to array_like)
        Name of each unknown, and by how much each signal changes with it: the derivative of a
        parameter, an input or a start, entry by entry.
    measured : mapping of str to float
        Standard deviation of the noise of each state or output that is measured; of all its
        entries, independent from sample to sample.
    times : array_like, shape (m,)
        When it is measured, ascending from 0 on.
    choices : sequence of Choice
        Courses and numbers to choose: `Ramps`, `Waves`, `Held`.
    limits : mapping of str to (float, float), optional
        Least and largest value of states or outputs along the motion, infinite for none.
    known : Knowledge, optional
        What is known of the unknowns before.
    contact : Exact or Smooth, optional
        How contacts are treated.

    Raises
    ------
    ArgumentError
        If names are unknown to the model, sizes do not fit, or numbers are not positive.
    """

    model: Model
    unknowns: Mapping[str, Mapping[str, ArrayLike]]
    measured: Mapping[str, float]
    times: ArrayLike
    choices: Sequence[Choice]
    limits: Mapping[str, tuple[float, float]] | None = None
    known: Knowledge | None = None
    contact: Treatment = Exact()  # noqa: RUF009  frozen

    def __post_init__(self) -> None:
        times = numbers("times", self.times)
        if times.ndim != 1 or len(times) < 2 or times[0] < 0 or np.any(np.diff(times) <= 0):
            raise ArgumentError("times must ascend from 0 on, at least two of them")
        object.__setattr__(self, "times", times)
        if not (self.unknowns and self.measured and self.choices):
            raise ArgumentError("an experiment needs something unknown, measured and to choose")
        for name, deviation in self.measured.items():
            if not 0 < deviation < np.inf:
                raise ArgumentError(f"noise of {name} must be positive, not {deviation!r}")
        signals = [choice.signal for choice in self.choices]
        if len(set(signals)) < len(signals):
            raise ArgumentError(f"each signal is chosen once, not {signals}")
        if self.prior.names != tuple(self.unknowns):
            raise ArgumentError(f"what is known is of {self.prior.names}, not of the unknowns")

    @property
    def prior(self) -> Knowledge:
        """What is known before."""
        return self.known or Knowledge.nothing(tuple(self.unknowns))

    @property
    def size(self) -> int:
        """How many numbers are chosen."""
        return sum(choice.size for choice in self.choices)

    @cached_property
    def driven(self) -> Model:
        """The model with all choices put in."""
        model = self.model
        for choice in self.choices:
            model = choice.put(model)
        return model

    def parts(self, chosen: np.ndarray) -> list[np.ndarray]:
        """Take the chosen numbers (size,) apart, choice by choice."""
        return np.split(chosen, np.cumsum([choice.size for choice in self.choices])[:-1])

    def excess(self, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """By how much courses exceed their own limits (m,), and derivatives (m, size)."""
        values, rows, at = [], [], 0
        for choice, part in zip(self.choices, self.parts(chosen), strict=True):
            value, slope = choice.excess(part)
            row = np.zeros((len(value), self.size))
            row[:, at : at + choice.size] = slope
            values.append(value)
            rows.append(row)
            at += choice.size
        return np.concatenate(values), np.vstack(rows)

    def shrunk(self, chosen: np.ndarray, share: float) -> np.ndarray:
        """Take a share of all courses' changes."""
        parts = zip(self.choices, self.parts(chosen), strict=True)
        return np.concatenate([choice.shrunk(part, share) for choice, part in parts])

    def run(
        self,
        chosen: np.ndarray,
        *,
        tolerance: Tolerance = _TOLERANCE,
        route: Route = "auto",
        looks: int = _LOOKS,
    ) -> Run:
        """Run it in the simulator; raises SolveError as `simulate`."""
        times = np.asarray(self.times)
        seen = np.union1d(times, np.linspace(0.0, times[-1], looks))
        arguments = {
            "span": times[-1],
            "contact": self.contact,
            "times": seen,
            "tolerance": tolerance,
            "route": route,
        }
        p, schedules = {}, {}
        for choice, part in zip(self.choices, self.parts(chosen), strict=True):
            one, other = choice.values(part)
            p, schedules = p | one, schedules | other
        motion, slopes = _derivatives(
            self.driven, self.unknowns, tuple(self.measured), p, schedules, arguments
        )
        sampled = np.searchsorted(seen, times)
        rows = [
            slopes[name][:, :, sampled].transpose(0, 2, 1).reshape(-1, len(self.unknowns))
            / deviation
            for name, deviation in self.measured.items()
        ]
        return Run(motion, np.vstack(rows), self._limited(motion))

    def _limited(self, motion: Trajectory) -> np.ndarray:
        """By how much limits along the motion are exceeded, as shares of their range."""
        found = [np.zeros(0)]
        for name, (low, high) in (self.limits or {}).items():
            width = high - low if high - low < np.inf else max(abs(b) for b in (low, high, 1e-30) if abs(b) < np.inf)
            found += [
                ((motion[name] - high) / width).ravel() if high < np.inf else np.zeros(0),
                ((low - motion[name]) / width).ravel() if low > -np.inf else np.zeros(0),
            ]
        return np.concatenate(found)


@dataclass(frozen=True, eq=False)
class Run:
    """A planned run in the simulator."""

    motion: Trajectory
    jacobian: np.ndarray  # (r, n) of what is measured over its deviation, by the unknowns
    excess: np.ndarray  # (m,) of limits along the motion, as shares of their ranges


def _derivatives(model, unknowns, names, p, schedules, arguments):
    """Differences, until the simulator gives derivatives."""
    own = {s.name: np.array(s.value, float) for s in (*model.p, *model.u)} | p
    starts = {s.name: np.broadcast_to(np.array(s.value, float), s.size) for s in model.x}
    motion = simulate(model, p=p, schedules=schedules, **arguments)
    columns = []
    for direction in unknowns.values():
        ends = []
        for sign in (1, -1):
            pp, xx = dict(p), {}
            for name, d in direction.items():
                h = sign * 1e-5
                if name in starts:
                    xx[name] = starts[name] + h * np.asarray(d)
                else:
                    pp[name] = own[name] + h * np.asarray(d)
            ends.append(simulate(model, p=pp, x0=xx, schedules=schedules, **{**arguments, "tolerance": Tolerance(1e-11, 1e-12)}))
        columns.append({n: (ends[0][n] - ends[1][n]) / 2e-5 for n in names})
    return motion, {n: np.stack([c[n] for c in columns], axis=1) for n in names}
