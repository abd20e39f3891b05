"""A planned run: its information about unknowns, its excess over limits, its predictions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError, SolveError, UnknownNameError
from wormopt.fitting.choices import Choice, Choices
from wormopt.fitting.information import Criterion, Knowledge
from wormopt.fitting.unknowns import Unknown, along
from wormopt.model.model import Model
from wormopt.model.values import numbers
from wormopt.simulation.options import Exact, Route, Tolerance, Treatment
from wormopt.simulation.simulate import simulate
from wormopt.simulation.trajectory import Trajectory

# Number of times at which limits along a motion are checked besides those of measurements.
_LOOKS = 200
_TOLERANCE = Tolerance(1e-9, 1e-10)

Directions = dict[str, dict[str, np.ndarray]]


@dataclass(frozen=True, eq=False)
class Experiment:
    """A run to be planned: unknowns, measurements, and choices within limits.

    Parameters
    ----------
    model : Model
        With the best known values of the unknowns, and the worm's start.
    unknowns : sequence of Unknown
        Parameters to estimate better, and other unknowns, such as initial values. Their values
        are those of the model; priors state what is known before.
    measured : mapping of str to float
        Standard deviation of the noise of each state or output that is measured: of all its
        entries, independent from sample to sample.
    times : array_like, shape (m,)
        Times of the measurements, ascending, not before 0, the start of the run.
    choices : sequence of Ramps, Waves and Constant
        Inputs over time and numbers that may be chosen.
    limits : mapping of str to (float, float), optional
        Least and largest value of states or outputs along the motion, infinite for none.
    known : array_like, shape (n, n), optional
        Covariance of the unknowns' coordinates that earlier runs left, as a Fit has it; infinite
        variances for unidentifiable ones.
    contact : Exact or Smooth, optional
        Treatment of contacts.

    Raises
    ------
    ArgumentError
        If names are unknown to the model, sizes do not fit, or numbers are not positive.

    Examples
    --------
    A worm of one link whose rest length is moved: which motion identifies its damping?

    >>> import wormopt as wo
    >>> worm = wo.chain(1, mass=1.0, stiffness=10.0, damping=1.0, rest_length=2.0, drag=0.5)
    >>> ramps = wo.Ramps("rest_length", (2.0,), duration=4.0, pieces=4, change=0.5)
    >>> todo = wo.Experiment(
    ...     worm,
    ...     [wo.Unknown("damping"), wo.Unknown("stiffness")],
    ...     {"length": 0.01},
    ...     np.linspace(0.0, 4.0, 41),
    ...     [ramps],
    ... )
    >>> todo.size, todo.knowledge(np.array([1.0, 1.0, -1.0, -1.0])).rank
    (4, 2)
    """

    model: Model
    unknowns: Sequence[Unknown]
    measured: Mapping[str, float]
    times: ArrayLike
    choices: Sequence[Choice]
    limits: Mapping[str, tuple[float, float]] | None = None
    known: ArrayLike | None = None
    contact: Treatment = Exact()  # noqa: RUF009  frozen

    def __post_init__(self) -> None:
        times = self.instants
        if times.ndim != 1 or len(times) < 2 or times[0] < 0 or not np.all(np.diff(times) > 0):
            raise ArgumentError("times must be two or more, ascending, 0 or above")
        if not (self.unknowns and self.measured and self.choices):
            raise ArgumentError("an experiment needs unknowns, measured signals and choices")
        for name, deviation in self.measured.items():
            if not 0 < deviation < np.inf:
                raise ArgumentError(f"noise of {name} must be positive, not {deviation!r}")
        self._check_names()
        self._check_limits()
        signals = [choice.signal for choice in self.choices]
        sought = {signal for each in self.directions.values() for signal in each}
        for name in signals:
            if signals.count(name) > 1 or name in sought:
                what = "chosen twice" if signals.count(name) > 1 else "both chosen and unknown"
                raise ArgumentError(f"{name} is {what}; leave one out")
        self.prior  # noqa: B018  checks priors and earlier runs

    def _check_names(self) -> None:
        known = {signal.name for signal in (*self.model.x, *self.model.outputs)}
        asked = [*self.measured, *(self.limits or {})]
        lost = [name for name in asked if name not in known]
        if lost:
            raise UnknownNameError(self.model.name, "state or output", lost, sorted(known))

    def _check_limits(self) -> None:
        for name, (low, high) in (self.limits or {}).items():
            if not low < high or (np.isinf(low) and np.isinf(high)):
                what = "must ascend, with at least one finite limit"
                raise ArgumentError(f"limits of {name}: [{low}, {high}] {what}")

    @cached_property
    def instants(self) -> np.ndarray:
        """Times of measurements (m,)."""
        return numbers("times", self.times)

    @property
    def end(self) -> float:
        """Time at which the run ends, with the last measurement."""
        return float(self.instants[-1])

    @cached_property
    def _numbers(self) -> tuple[tuple[str, dict[str, np.ndarray], float, Unknown], ...]:
        """Name, directions, value and Unknown of each entry."""
        signals = (*self.model.x, *self.model.p, *self.model.u)
        own = {s.name: np.asarray(s.value) for s in signals if s.value is not None}
        found = []
        for unknown in self.unknowns:
            for name, directions in unknown.directions(self.model):
                for signal in directions.keys() - own.keys():
                    what = f"{signal} has no value in the model; write one"
                    raise ArgumentError(f"{name}: {what}")
                value = along(directions, own)
                if unknown.log and not value > 0:
                    raise ArgumentError(f"{name} is {value:g}, which has no logarithm")
                found.append((name, directions, value, unknown))
        return tuple(found)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the n unknown entries."""
        return tuple(name for name, *_ in self._numbers)

    @property
    def unknowns_of(self) -> tuple[Unknown, ...]:
        """Unknown of each entry."""
        return tuple(unknown for *_, unknown in self._numbers)

    @property
    def values(self) -> np.ndarray:
        """Values of the unknown entries in the model, shape (n,)."""
        return np.array([value for _, _, value, _ in self._numbers])

    @property
    def sizes(self) -> np.ndarray:
        """Sizes of coordinates (n,) for relative errors; 1 for values 0."""
        return np.array([1.0 if u.log or not v else abs(v) for _, _, v, u in self._numbers])

    @cached_property
    def directions(self) -> Directions:
        """Change of each signal with the coordinate of each unknown."""
        return {
            name: {signal: (v if u.log else 1.0) * d for signal, d in directions.items()}
            for name, directions, v, u in self._numbers
        }

    @cached_property
    def prior(self) -> Knowledge:
        """Information before the run, from priors and earlier runs."""
        rows, at = [np.zeros((0, len(self.names)))], 0
        for unknown in self.unknowns:
            size = len(unknown.directions(self.model))
            if unknown.prior is not None:
                deviation = np.broadcast_to(np.ravel(unknown.prior[1]), size)
                rows.append(np.eye(len(self.names))[at : at + size] / deviation[:, None])
            at += size
        if self.known is None:
            before = Knowledge.nothing(self.names)
        else:
            before = Knowledge.from_covariance(self.names, self.known)
        return before.after(np.vstack(rows))

    @cached_property
    def chosen(self) -> Choices:
        """All choices, as one vector."""
        return Choices(self.choices)

    @property
    def size(self) -> int:
        """Number of chosen values, each from -1 to 1."""
        return self.chosen.size

    @cached_property
    def driven(self) -> Model:
        """The model with all choices."""
        model = self.model
        for choice in self.choices:
            model = choice.put(model)
        return model

    def run(
        self,
        chosen: np.ndarray,
        *,
        tolerance: Tolerance = _TOLERANCE,
        route: Route = "auto",
    ) -> Run:
        """Simulate the experiment with derivatives along the unknowns.

        Parameters
        ----------
        chosen : ndarray, shape (size,)
            Chosen values.
        tolerance : Tolerance, optional
            Tolerance of the simulation.
        route : {"auto", "native", "python", "cvodes"}, optional
            Integrator, see `simulate`.

        Raises
        ------
        SolveError
            If the motion cannot be simulated.
        """
        motion = self._simulated(
            chosen, self.instants, tolerance=tolerance, route=route, sensitivities=self.directions
        )
        rows = [
            np.moveaxis(motion.derivative(name), 1, 2).reshape(-1, len(self.names)) / deviation
            for name, deviation in self.measured.items()
        ]
        jacobian = np.vstack(rows)
        known = self.prior.after(jacobian)
        return Run(motion, jacobian, self.limited(chosen, _LOOKS), known)

    def motion(self, chosen: np.ndarray, times: np.ndarray) -> Trajectory:
        """Simulate the experiment without derivatives.

        Parameters
        ----------
        chosen : ndarray, shape (size,)
            Chosen values.
        times : ndarray, shape (m,)
            Sample times, from 0 to the end.

        Raises
        ------
        SolveError
            If the motion cannot be simulated.
        """
        return self._simulated(chosen, times, tolerance=_TOLERANCE)

    def _simulated(self, chosen: np.ndarray, times: np.ndarray, **how: Any) -> Trajectory:
        p, schedules = self.chosen.values(chosen)
        end, contact = float(times[-1]), self.contact
        return simulate(
            self.driven, end, contact=contact, p=p, schedules=schedules, times=times, **how
        )

    def seen(self, chosen: np.ndarray, shift: np.ndarray) -> np.ndarray:
        """Simulate measurements (r,), over their standard deviations, with shifted unknowns.

        Parameters
        ----------
        chosen : ndarray, shape (size,)
            Chosen values.
        shift : ndarray, shape (n,)
            By how much coordinates of the unknowns are moved.
        """
        p, schedules = self.chosen.values(chosen)
        model = self.driven
        moved = {s.name: np.asarray(s.value, float) for s in (*model.x, *model.p, *model.u)} | p
        for directions, by in zip(self.directions.values(), shift, strict=True):
            for name, direction in directions.items():
                moved[name] = moved[name] + by * direction
        motion = simulate(
            model,
            self.end,
            contact=self.contact,
            x0={s.name: moved.pop(s.name) for s in model.x},
            p=moved,
            schedules=schedules,
            times=self.instants,
            tolerance=_TOLERANCE,
        )
        return np.concatenate([motion[name].ravel() / sd for name, sd in self.measured.items()])

    def knowledge(self, chosen: np.ndarray) -> Knowledge:
        """Information after the run.

        Parameters
        ----------
        chosen : ndarray, shape (size,)
            Chosen values.
        """
        return self.run(chosen).known

    def criterion(self, kind: Literal["D", "A"], wanted: Sequence[str] | None = None) -> Criterion:
        """Criterion of small relative errors of wanted unknowns, with the others as nuisances.

        Parameters
        ----------
        kind : {"D", "A"}
            Volume of their confidence region, or the sum of their variances.
        wanted : sequence of str, optional
            Their names; all if left out.
        """
        return Criterion.of(kind, self.names, wanted or self.names, self.sizes)

    def limited(self, chosen: np.ndarray, looks: int) -> np.ndarray:
        """Excess (m,) over limits along the motion, as shares of their ranges.

        Parameters
        ----------
        chosen : ndarray, shape (size,)
            Chosen values.
        looks : int
            Number of times at which the motion is checked.
        """
        found = [np.zeros(0)]
        if not self.limits:
            return found[0]
        motion = self.motion(chosen, np.linspace(0.0, self.end, looks))
        for name, (low, high) in self.limits.items():
            finite = [end for end in (low, high) if np.isfinite(end)]
            size = high - low if len(finite) == 2 else max(abs(finite[0]), 1e-30)
            values = motion[name].ravel()
            found += [(values - high) / size] * (high in finite)
            found += [(low - values) / size] * (low in finite)
        return np.concatenate(found)


@dataclass(frozen=True, eq=False)
class Run:
    """A planned run in the simulator."""

    motion: Trajectory
    jacobian: np.ndarray  # (r, n) of what is measured over its deviation, by the unknowns
    excess: np.ndarray  # (m,) of limits along the motion, as shares of their ranges
    known: Knowledge  # information after it


_FAR = 2.0  # standard errors within which measurements must be linear


def largest_excess(experiment: Experiment, chosen: np.ndarray, looks: int) -> float:
    """Largest excess of any limit, as a share; infinite if the motion cannot be simulated."""
    found = [experiment.chosen.excess(chosen)[0], np.abs(chosen) - 1]
    try:
        found.append(experiment.limited(chosen, looks))
    except SolveError:
        return np.inf
    return float(np.max(np.concatenate(found)))


def departure(experiment: Experiment, chosen: np.ndarray) -> float:
    """Deviation of measurements from linearity in the unknowns over their expected errors.

    Infinite if a motion or value is missing.
    """
    # If masses begin or cease to stick within these errors, one-sided derivatives do not apply on
    # the other side, and expected errors are wrong. Evaluated along the principal axes of the
    # confidence ellipsoid, two standard errors to both sides; in standard errors for each of them.
    worst = 0.0
    try:
        run = experiment.run(chosen)
        here = experiment.seen(chosen, np.zeros(len(experiment.names)))
        for axis in run.known.axes.T:
            for step in (-_FAR * axis, _FAR * axis):
                departs = experiment.seen(chosen, step) - here - run.jacobian @ step
                worst = max(worst, float(np.linalg.norm(departs)) / _FAR)
    except (SolveError, ArgumentError):  # such as friction below 0
        return np.inf
    return worst


def mean_rate(
    experiment: Experiment,
    model: Model,
    output: str,
    span: tuple[float, float],
    *,
    entry: int = 0,
) -> Criterion:
    """Criterion of a small variance of the predicted mean rate of a state or output in a motion.

    Parameters
    ----------
    experiment : Experiment
        Experiment with the unknowns.
    model : Model
        Model of the motion, with the same unknowns, for example the same worm under another gait.
    output : str
        Name of a state or output; for the mean speed, that of the position.
    span : (float, float)
        First and last time.
    entry : int, optional
        Entry of the output.

    Returns
    -------
    Criterion

    Raises
    ------
    SolveError
        If the motion cannot be simulated.
    ArgumentError
        If the prediction depends on none of the unknowns.

    Examples
    --------
    The mean rate of x' = -r x from 1 over a unit time is exp(-r) - 1; its derivative at r = 1 is
    -exp(-1), by which the error of r counts:

    >>> import casadi as ca
    >>> import wormopt as wo
    >>> x, r, u = (ca.SX.sym(name) for name in "xru")
    >>> numbers = [wo.Signal("rate", r, value=1.0), wo.Signal("feed", u, value=0.0)]
    >>> decay = wo.Model("decay", [wo.Signal("x", x, value=1.0)], u - r * x, p=numbers)
    >>> feed = wo.Constant("feed", 0.0, 1.0)
    >>> todo = wo.Experiment(decay, [wo.Unknown("rate")], {"x": 0.02}, [0.5, 1.0], [feed])
    >>> mean_rate(todo, decay, "x", (0.0, 1.0)).rows.round(6)
    array([[-0.367879]])
    """
    first, last = span
    motion = simulate(
        model,
        last,
        contact=experiment.contact,
        times=[first, last],
        tolerance=_TOLERANCE,
        sensitivities=experiment.directions,
    )
    row = np.diff(motion.derivative(output)[entry])[:, 0] / (last - first)
    if not np.any(row):
        raise ArgumentError(f"the mean rate of {output} does not depend on the unknowns")
    return Criterion("A", row[None, :])
