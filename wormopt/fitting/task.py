"""Fitting task: model, recordings, unknowns and noise, as weighted residuals."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, get_args

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError, UnknownNameError
from wormopt.fitting.recording import APART, Recording, scatter
from wormopt.fitting.unknowns import Coordinate, Unknown, coordinates_of, known_values
from wormopt.model.model import Model, pack
from wormopt.simulation.options import Exact, Route, Tolerance, Treatment
from wormopt.simulation.simulate import simulate
from wormopt.simulation.trajectory import Trajectory

Loss = Literal["linear", "soft_l1", "huber", "cauchy"]

# Residuals, in standard deviations, from which a loss differs from squares: the estimated mean of
# normal noise has 95 % of the efficiency of least squares.
SCALES: dict[Loss, float] = {"soft_l1": 1.287, "huber": 1.345, "cauchy": 2.385}
_TINY = 1e-30
_MISPLACED = 10.0  # scatters between a known start and its first reading


def robust(r: np.ndarray, loss: Loss) -> tuple[np.ndarray, np.ndarray]:
    """Residuals s with s² = loss(r²) and the sign of r, and ds/dr."""
    if loss == "linear":
        return r, np.ones_like(r)
    scale = SCALES[loss]
    z = np.maximum((r / scale) ** 2, _TINY)  # so small that it is the square to all digits
    if loss == "soft_l1":
        root = np.sqrt(1 + z)
        value, slope = 2 * z / (1 + root), 1 / root
    elif loss == "huber":
        far = z > 1
        root = np.sqrt(np.where(far, z, 1.0))
        value, slope = np.where(far, 2 * root - 1, z), 1 / root
    else:
        value, slope = np.log1p(z), 1 / (1 + z)
    size = np.sqrt(value)
    steep = slope * np.sqrt(z) / size
    return np.where(z > _TINY, np.copysign(scale * size, r), r), steep


def check_task(
    model: object,
    recordings: Sequence[Recording],
    unknowns: Sequence[Unknown],
    noise: Mapping[str, float] | None,
    loss: str,
) -> None:
    """Refuse arguments of wrong types, or that do not fit the model."""
    if not isinstance(model, Model):
        raise ArgumentError(f"model must be a Model, not {type(model).__name__}")
    for what, given, kind in (
        ("recordings", recordings, Recording),
        ("unknowns", unknowns, Unknown),
    ):
        if not isinstance(given, Sequence) or not given:
            raise ArgumentError(f"{what} must be a list of at least one {kind.__name__}")
        for each in given:
            if not isinstance(each, kind):
                raise ArgumentError(f"{what} must be {kind.__name__}s, not {each!r:.60}")
    if loss not in get_args(Loss):
        raise ArgumentError(f"loss must be one of {', '.join(get_args(Loss))}, not {loss!r}")
    for run in recordings:
        _check_run(model, run)
    readings = {signal for run in recordings for signal in run.readings}
    for name, sd in (noise or {}).items():
        if name not in readings:
            raise UnknownNameError("the recordings", "signal", [name], sorted(readings))
        if not 0 < sd < np.inf:
            raise ArgumentError(f"noise of {name} must be positive, not {sd!r}")


def _check_run(model: Model, run: Recording) -> None:
    model = run.model or model
    known = {state.name: state.size for state in model.x}
    known = {o.name: o.expression.numel() for o in model.outputs} | known
    for signal, rows in run.readings.items():
        if signal not in known:
            raise UnknownNameError(model.name, "state or output", [signal], list(known))
        if len(rows) != known[signal]:
            raise ArgumentError(
                f"{run.name}: {signal} has {known[signal]} entries, the readings have {len(rows)}; "
                "fill those that were not measured with NaN"
            )


@dataclass(frozen=True, eq=False)
class Shooting:
    """One run, simulated from its start with any values of the coordinates."""

    model: Model
    run: Recording
    coordinates: Sequence[Coordinate]  # of the whole fit
    number: int  # of the run
    contact: Treatment
    tolerance: Tolerance
    route: Route

    @cached_property
    def active(self) -> np.ndarray:
        """Indices of the coordinates that this run depends on."""
        runs = [c.run for c in self.coordinates]
        return np.flatnonzero([run is None or run == self.number for run in runs])

    @cached_property
    def _known(self) -> dict[str, np.ndarray]:
        """Values of all signals, 0 where coordinates replace them."""
        known = {
            name: np.array(value) for name, value in known_values(self.model, self.run).items()
        }
        for k in self.active:
            for signal, direction in self.coordinates[k].directions.items():
                if signal not in known or known[signal].shape != direction.shape:
                    what = f"{self.coordinates[k].name}: {signal}"
                    raise ArgumentError(f"{what} is not the same in the model of {self.run.name}")
                known[signal][direction != 0] = 0.0
        for name, value in known.items():
            if np.isnan(value).any() and any(
                s.name == name for s in (*self.model.p, *self.model.u)
            ):
                raise ArgumentError(f"{self.run.name}: {name} has no value; give one in p")
        return {name: np.nan_to_num(value) for name, value in known.items()}

    def values(self, theta: np.ndarray) -> dict[str, np.ndarray]:
        """Values of all possible unknowns."""
        found = {name: np.array(value) for name, value in self._known.items()}
        for k in self.active:
            number = self.coordinates[k].value(theta[k])
            for signal, direction in self.coordinates[k].directions.items():
                found[signal] += number * direction
        return found

    def motion(
        self, theta: np.ndarray, times: np.ndarray | None = None, *, derivatives: bool = False
    ) -> Trajectory:
        """Simulate the run at the times of its readings, or at others."""
        values, model = self.values(theta), self.model
        return simulate(
            model,
            self.run.ends,
            contact=self.contact,
            x0={s.name: values[s.name] for s in model.x},
            p={s.name: values[s.name] for s in (*model.p, *model.u)},
            schedules={s.name: values[s.name] for s in model.schedules},
            times=self.run.times if times is None else times,
            tolerance=self.tolerance,
            route=self.route,
            sensitivities=self.directions if derivatives else None,
        )

    @cached_property
    def directions(self) -> dict[str, dict[str, np.ndarray]]:
        """Directions of the active coordinates, by their names."""
        return {self.coordinates[k].name: self.coordinates[k].directions for k in self.active}

    def predicted(self, theta: np.ndarray) -> dict[str, np.ndarray]:
        """Measured signals, (size, m) each."""
        return self.observed(self.motion(theta))

    def observed(self, motion: Trajectory) -> dict[str, np.ndarray]:
        """Measured signals, (size, m) each, of a motion."""
        found = {}
        for name in self.run.readings:
            matrix = self._matrices[name]
            found[name] = motion[name] if matrix is None else matrix @ motion.states
        return found

    def observed_along(self, motion: Trajectory) -> dict[str, np.ndarray]:
        """Their derivatives (size, k, m) along the directions of the motion."""
        found = {}
        for name in self.run.readings:
            matrix = self._matrices[name]
            if matrix is None:
                found[name] = motion.derivative(name)
            else:
                found[name] = np.tensordot(matrix, motion.state_derivatives, 1)
        return found

    @cached_property
    def _matrices(self) -> dict[str, np.ndarray | None]:
        """For each signal its matrix by the states, None if there is none."""
        # A product takes a tenth of the time of evaluating expressions; link lengths are common.
        return {name: _matrix(self.model, name) for name in self.run.readings}

    def derivatives(self, theta: np.ndarray) -> tuple[Trajectory, dict[str, np.ndarray]]:
        """Motion, and derivatives (size, k, m) of measured signals by active coordinates."""
        motion = self.motion(theta, derivatives=True)
        slopes = np.array([self.coordinates[k].slope(theta[k]) for k in self.active])
        along = self.observed_along(motion)
        return motion, {name: columns * slopes[:, None] for name, columns in along.items()}


def _matrix(model: Model, name: str) -> np.ndarray | None:
    x, signal = pack(model.x), model[name]
    matrix = ca.jacobian(signal, x)
    rest = ca.simplify(ca.substitute(signal, x, ca.SX.zeros(x.numel())))
    if not matrix.is_constant() or not rest.is_zero():
        return None
    return np.array(ca.DM(matrix))


# Steps after which a motion is given up: wrong values make motions stiff.
_STEPS, _STEPS_A_READING = 10_000, 10
# Relative tolerance over relative noise, and its limits.
_LOST, _TOLERANCES = 1e-4, (1e-11, 1e-8)


@dataclass(frozen=True)
class Block:
    """Readings of one signal in one run, as rows of the residuals."""

    run: int
    signal: str
    there: np.ndarray  # (size, m), whether there is a reading
    rows: slice


@dataclass(frozen=True, eq=False)
class FitTask:
    """Recordings, the model to fit to them, and its unknowns.

    Residuals are (model - reading) / standard deviation, one row for each reading, passed through
    the loss; then (coordinate - mean) / deviation for each prior. Half their sum of squares is the
    cost. A coordinate is the value of an unknown, or its logarithm if the unknown has `log`.

    Parameters
    ----------
    model : Model
        The model to fit.
    recordings : sequence of Recording
        Its runs.
    unknowns : sequence of Unknown
        Unknown parameters and initial values.
    contact : Exact or Smooth, optional
        Treatment of contacts.
    noise : mapping of str to float, optional
        Standard deviations of readings by signal, if recordings have none; others are
        estimated.
    loss : {"linear", "soft_l1", "huber", "cauchy"}, optional
        Weight of large residuals; all but "linear" are robust to outliers.
    tolerance : Tolerance, optional
        Tolerance of simulations; derived from the noise if left out, with few `max_steps`.
    route : {"auto", "native", "python", "cvodes"}, optional
        Integrator, see `simulate`.

    Raises
    ------
    ArgumentError
        If names, shapes or starts do not fit the model, or there is nothing to fit.

    Examples
    --------
    Friction of a block that slides and stops:

    >>> import casadi as ca
    >>> from wormopt.model.friction import Coulomb
    >>> from wormopt.model.lift import lift
    >>> from wormopt.model.model import Contact, Signal
    >>> x, v, f = ca.SX.sym("x"), ca.SX.sym("v"), ca.SX.sym("f")
    >>> (law,), friction = lift([Coulomb(1.0, 1.0)])
    >>> states = [Signal("position", x, value=0.0), Signal("velocity", v, value=1.0)]
    >>> ground = Contact("block", v, f, law)
    >>> block = Model("block", states, ca.vertcat(v, f), p=friction, contacts=[ground])
    >>> run = Recording([0.0, 0.2, 0.6], {"position": [0.0, 0.16, 0.25]}, noise={"position": 0.01})
    >>> task = FitTask(block, [run], [Unknown("friction_forward")])
    >>> residuals, jacobian = task.residuals(np.array([2.0]))
    >>> task.names, residuals.round(6) + 0.0, jacobian.shape
    (('friction_forward',), array([0., 0., 0.]), (3, 1))
    """

    model: Model
    recordings: Sequence[Recording]
    unknowns: Sequence[Unknown]
    contact: Treatment = Exact()  # noqa: RUF009  frozen
    noise: Mapping[str, float] | None = None
    loss: Loss = "linear"
    tolerance: Tolerance | None = None
    route: Route = "auto"

    def __post_init__(self) -> None:
        check_task(self.model, self.recordings, self.unknowns, self.noise, self.loss)
        readings = sum(run.count for run in self.recordings)
        priors = sum(c.prior is not None for c in self.coordinates)
        if (missing := len(self.coordinates) - readings - priors) > 0:
            raise ArgumentError(
                f"{len(self.coordinates)} unknowns have only {readings} readings and {priors} "
                f"priors; add {missing} more readings or priors"
            )

    # -- coordinates -----------------------------------------------------------------------

    @cached_property
    def coordinates(self) -> tuple[Coordinate, ...]:
        """Moved parameters, one for each entry of ``theta``."""
        return coordinates_of(self.model, self.runs, self.unknowns)

    @cached_property
    def runs(self) -> tuple[Recording, ...]:
        """Recordings, numbered where they share a name."""
        names = [run.name for run in self.recordings]
        return tuple(
            replace(run, name=f"{run.name} {k}") if names.count(run.name) > 1 else run
            for k, run in enumerate(self.recordings)
        )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the entries of ``theta``."""
        return tuple(c.name for c in self.coordinates)

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Least and largest ``theta``, (n,) each, infinite where there is none."""
        pairs = [(c.lower, c.upper) for c in self.coordinates]
        lower, upper = np.array(pairs, dtype=float).reshape(-1, 2).T
        return lower, upper

    @property
    def start(self) -> np.ndarray:
        """Start of the search, (n,)."""
        return np.array([c.start for c in self.coordinates])

    @property
    def nominal(self) -> np.ndarray:
        """Nominal sizes of ``theta``, (n,), which scale it; 1 for a logarithm."""
        return np.array([c.nominal for c in self.coordinates])

    def values(self, theta: np.ndarray) -> np.ndarray:
        """Convert coordinates to values of the unknowns, (n,).

        Parameters
        ----------
        theta : ndarray, shape (n,)
            Coordinates.
        """
        return np.array([c.value(t) for c, t in zip(self.coordinates, theta, strict=True)])

    def slopes(self, theta: np.ndarray) -> np.ndarray:
        """Derivative of each value with respect to its coordinate, (n,).

        Parameters
        ----------
        theta : ndarray, shape (n,)
            Coordinates.
        """
        return np.array([c.slope(t) for c, t in zip(self.coordinates, theta, strict=True)])

    # -- noise -----------------------------------------------------------------------------

    @property
    def estimated(self) -> tuple[str, ...]:
        """Signals with unknown noise."""
        known = self.noise or {}
        found = [
            signal
            for run in self.recordings
            for signal in run.readings
            if signal not in known and signal not in (run.noise or {})
        ]
        return tuple(dict.fromkeys(found))

    def deviation(self, run: int, signal: str) -> float:
        """Standard deviation of the readings of a signal, the inverse weight.

        Parameters
        ----------
        run : int
            Number of the run.
        signal : str
            Its name.

        Returns
        -------
        float
            A rough estimate from the differences of neighbouring readings if it is not given.
        """
        own = self.recordings[run].noise or {}
        return float(own[signal]) if signal in own else self.level(signal)

    def level(self, signal: str) -> float:
        """Standard deviation of a signal in recordings that do not give it.

        Parameters
        ----------
        signal : str
            Its name.
        """
        shared = self.noise or {}
        return float(shared[signal]) if signal in shared else self._rough[signal]

    @cached_property
    def _rough(self) -> dict[str, float]:
        found: dict[str, list[float]] = {}
        for run in self.recordings:
            for signal in set(run.readings) & set(self.estimated):
                found.setdefault(signal, []).append(scatter(run.readings[signal]))
        return {signal: float(np.median(sizes)) for signal, sizes in found.items()}

    def with_noise(self, noise: Mapping[str, float]) -> FitTask:
        """Return the task with other standard deviations for recordings that give none.

        Parameters
        ----------
        noise : mapping of str to float
            Standard deviations by signal.
        """
        return replace(self, noise={**(self.noise or {}), **noise})

    @cached_property
    def precision(self) -> Tolerance:
        """Tolerance of simulations, with errors below the noise."""
        if self.tolerance is not None:
            return self.tolerance
        shares = [
            self.deviation(block.run, block.signal)
            / np.nanmax(np.abs(self.recordings[block.run].readings[block.signal]))
            for block in self.blocks
        ]
        relative = float(np.clip(_LOST * min(shares), *_TOLERANCES))
        steps = _STEPS + _STEPS_A_READING * max(len(run.times) for run in self.recordings)
        return Tolerance(relative, relative / 100, max_steps=steps)

    # -- residuals -------------------------------------------------------------------------

    @cached_property
    def shootings(self) -> tuple[Shooting, ...]:
        """All runs, ready to simulate."""
        how = self.contact, self.precision, self.route
        return tuple(
            Shooting(run.model or self.model, run, self.coordinates, number, *how)
            for number, run in enumerate(self.runs)
        )

    @cached_property
    def blocks(self) -> tuple[Block, ...]:
        """Readings of the rows of the residuals; rows of priors follow them."""
        found, at = [], 0
        for number, run in enumerate(self.recordings):
            for signal, rows in run.readings.items():
                there = np.isfinite(rows)
                found.append(Block(number, signal, there, slice(at, at + int(there.sum()))))
                at += int(there.sum())
        return tuple(found)

    @property
    def count(self) -> int:
        """Number of readings: of rows before those of the priors."""
        return self.blocks[-1].rows.stop

    @cached_property
    def groups(self) -> dict[str, np.ndarray]:
        """Rows of each signal, over all runs."""
        rows: dict[str, list[np.ndarray]] = {}
        for block in self.blocks:
            rows.setdefault(block.signal, []).append(np.arange(block.rows.start, block.rows.stop))
        return {signal: np.concatenate(parts) for signal, parts in rows.items()}

    @cached_property
    def deviations(self) -> np.ndarray:
        """Standard deviation of each reading, (count,)."""
        found = np.empty(self.count)
        for block in self.blocks:
            found[block.rows] = self.deviation(block.run, block.signal)
        return found

    def residuals(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Weighted residuals after the loss function, then priors, and their Jacobian.

        Parameters
        ----------
        theta : ndarray, shape (n,)
            Coordinates.

        Returns
        -------
        residuals : ndarray, shape (rows,)
            Half their sum of squares is the cost.
        jacobian : ndarray, shape (rows, n)
            Their exact derivative.

        Raises
        ------
        SolveError
            If a motion cannot be simulated.
        """
        plain, slopes = self.plain(theta)
        r, steep = robust(plain[: self.count], self.loss)
        steep = np.append(steep, np.ones(len(plain) - self.count))
        return np.append(r, plain[self.count :]), steep[:, None] * slopes

    def misfit(self, theta: np.ndarray) -> np.ndarray:
        """Return the residuals (rows,) without their Jacobian, which is cheaper.

        Parameters
        ----------
        theta : ndarray, shape (n,)
            Coordinates.
        """
        predicted = [shooting.predicted(theta) for shooting in self.shootings]
        r, _ = robust(self._weighed(predicted), self.loss)
        return np.append(r, self.priors(theta)[0])

    def plain(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Weighted residuals without the loss, then priors, and their Jacobian.

        Parameters
        ----------
        theta : ndarray, shape (n,)
            Coordinates.

        Returns
        -------
        residuals : ndarray, shape (rows,)
            In standard deviations.
        jacobian : ndarray, shape (rows, n)
            Their exact derivative.
        """
        theta = np.asarray(theta, dtype=float)
        found = [shooting.derivatives(theta) for shooting in self.shootings]
        jacobian = np.zeros((self.count, len(theta)))
        for block in self.blocks:
            derivative = np.moveaxis(found[block.run][1][block.signal], 1, 2)[block.there]
            jacobian[block.rows, self.shootings[block.run].active] = derivative
        jacobian /= self.deviations[:, None]
        priors, slopes = self.priors(theta)
        pairs = zip(self.shootings, found, strict=True)
        values = [shooting.observed(motion) for shooting, (motion, _) in pairs]
        r = np.append(self._weighed(values), priors)
        return r, np.vstack([jacobian, slopes])

    def _weighed(self, predicted: Sequence[Mapping[str, np.ndarray]]) -> np.ndarray:
        r = np.empty(self.count)
        for block in self.blocks:
            readings = self.recordings[block.run].readings[block.signal]
            r[block.rows] = (predicted[block.run][block.signal] - readings)[block.there]
        return r / self.deviations

    def priors(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residuals of the priors, and their Jacobian.

        Parameters
        ----------
        theta : ndarray, shape (n,)
            Coordinates.

        Returns
        -------
        residuals : ndarray, shape (priors,)
            In standard deviations.
        jacobian : ndarray, shape (priors, n)
            Their derivative.
        """
        known = [(k, c.prior) for k, c in enumerate(self.coordinates) if c.prior is not None]
        r, slopes = np.zeros(len(known)), np.zeros((len(known), len(theta)))
        for row, (k, (mean, deviation)) in enumerate(known):
            r[row], slopes[row, k] = (theta[k] - mean) / deviation, 1 / deviation
        return r, slopes

    def split(self, rows: np.ndarray) -> dict[str, dict[str, np.ndarray]]:
        """Arrange one value per row by run and signal.

        Parameters
        ----------
        rows : ndarray, shape (rows,)
            For example residuals; rows of priors are left out.

        Returns
        -------
        dict of str to dict of str to ndarray
            Run -> signal -> (size, m), NaN where there is no reading.
        """
        found: dict[str, dict[str, np.ndarray]] = {run.name: {} for run in self.runs}
        for block in self.blocks:
            whole = np.full(block.there.shape, np.nan)
            whole[block.there] = rows[block.rows]
            found[self.runs[block.run].name][block.signal] = whole
        return found

    def motions(self, theta: np.ndarray) -> tuple[Trajectory, ...]:
        """Simulate every run at the times of its readings.

        Parameters
        ----------
        theta : ndarray, shape (n,)
            Coordinates.
        """
        theta = np.asarray(theta, dtype=float)
        return tuple(shooting.motion(theta) for shooting in self.shootings)

    def _misplaced(self, index: int) -> Iterator[str]:
        """Yield a warning for each measured state whose known start contradicts its reading."""
        run, known = self.runs[index], known_values(self.model, self.runs[index])
        if run.ends[0] != run.times[0]:
            return
        sought = [name for c in self.coordinates if c.run in (None, index) for name in c.directions]
        for name in {state.name for state in self.model.x} & set(run.readings) - set(sought):
            first, start = run.readings[name][:, 0], known[name]
            apart = np.nan_to_num(np.abs(first - start)) / scatter(run.readings[name])
            k = int(np.argmax(apart))
            if apart[k] > _MISPLACED:
                yield (
                    f"{run.name}: {name}[{k}] starts at {start[k]:.6g}, but its first reading is "
                    f"{first[k]:.6g}, {apart[k]:.0f} times their scatter away; correct the start, "
                    f"or add {name} as an unknown with per_run = true"
                )

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """Likely errors in the recordings."""
        usual = {state.name: state.nominal for state in self.model.x}
        found = [line for run in self.runs for line in run.warnings]
        for index, run in enumerate(self.runs):
            found += self._misplaced(index)
            for signal in set(run.readings) & set(usual):
                times = float(np.nanmax(np.abs(run.readings[signal]))) / usual[signal]
                if times > APART or 0 < times < 1 / APART:
                    found.append(
                        f"{run.name}: readings of {signal} are {times:.2g} times the usual size "
                        "in the model; check their unit"
                    )
        return tuple(found)
