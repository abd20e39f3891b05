"""Multiple shooting: runs cut into stretches with their own starts, which join in the end.

A short motion from states that readings determine depends on the unknowns almost linearly, so that
it converges from wrong values where a long motion does not. Jumps between stretches are residuals,
small relative to the usual size of the states; their weight increases, until each run is one
motion again.

Source: H. G. Bock, in: Numerical Treatment of Inverse Problems in Differential and Integral
Equations (1983), 95; jumps as residuals as in U. Parlitz et al., Phys. Rev. E 65 (2002) 026208.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wormopt.errors import ArgumentError
from wormopt.fitting.recording import Recording
from wormopt.fitting.task import FitTask, Shooting, robust
from wormopt.model.model import Model
from wormopt.model.values import by_name, nominal_of
from wormopt.simulation.simulate import simulate
from wormopt.simulation.trajectory import Trajectory

# Number of readings around an instant to estimate places and rates.
_AROUND = 15
# Least usual size of a state, in nominal ones.
_LEAST = 1e-2


@dataclass(frozen=True, eq=False)
class Stretch:
    """Part of a run between two nodes."""

    shooting: Shooting  # of the whole run
    begin: float
    end: float
    readings: slice  # of the run, from the beginning on; includes its end in the last stretch only
    state: slice | None  # of its start among the unknowns; None: that of the run
    after: slice | None  # of the start of the next one

    def motion(self, theta: np.ndarray, state: np.ndarray | None) -> Trajectory:
        """Simulate it, with derivatives by the run's coordinates and by its start."""
        shooting, model = self.shooting, self.shooting.model
        values = shooting.values(theta)
        along = dict(shooting.directions)
        if state is not None:
            values |= by_name(model.x, state)
            names = {s.name for s in model.x}
            along = {
                label: {s: np.zeros_like(d) if s in names else d for s, d in parts.items()}
                for label, parts in along.items()
            }
            along |= _units(model)
        return simulate(
            model,
            (self.begin, self.end),
            contact=shooting.contact,
            x0={s.name: values[s.name] for s in model.x},
            p={s.name: values[s.name] for s in (*model.p, *model.u)},
            schedules={s.name: values[s.name] for s in model.schedules},
            times=shooting.run.times[self.readings],
            tolerance=shooting.tolerance,
            route=shooting.route,
            sensitivities=along,
        )


@dataclass(frozen=True, eq=False)
class Lifted:
    """A task with the starts of stretches as additional unknowns."""

    task: FitTask
    stretches: tuple[Stretch, ...]
    usual: np.ndarray  # (n + starts,) sizes of the starts
    jump: float  # standard deviation of jumps, in usual sizes

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Least and largest unknowns; starts have none."""
        lower, upper = self.task.bounds
        free = np.full(len(self.usual) - len(lower), np.inf)
        return np.append(lower, -free), np.append(upper, free)

    def residuals(self, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Weighted residuals of readings, priors and jumps, and their Jacobian."""
        n = len(self.task.coordinates)
        theta, rows = w[:n], [self._priors(w)]
        for stretch in self.stretches:
            motion = stretch.motion(theta, None if stretch.state is None else w[stretch.state])
            columns = self._columns(stretch)
            slopes = np.ones(len(columns))
            active = stretch.shooting.active
            slopes[: len(active)] = self.task.slopes(theta)[active]
            rows.append(self._read(stretch, motion, columns, slopes))
            if stretch.after is not None:
                rows.append(self._jumps(stretch, motion, columns, slopes, w))
        return np.concatenate([r for r, _ in rows]), np.vstack([slopes for _, slopes in rows])

    def _columns(self, stretch: Stretch) -> np.ndarray:
        own = [] if stretch.state is None else range(stretch.state.start, stretch.state.stop)
        return np.append(stretch.shooting.active, np.array(own, dtype=int))

    def _priors(self, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        r, slopes = self.task.priors(w[: len(self.task.coordinates)])
        return r, np.pad(slopes, ((0, 0), (0, len(w) - slopes.shape[1])))

    def _read(
        self, stretch: Stretch, motion: Trajectory, columns: np.ndarray, slopes: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        found, jacobian = [np.zeros(0)], [np.zeros((0, len(self.usual)))]
        values, derivatives = (
            stretch.shooting.observed(motion),
            stretch.shooting.observed_along(motion),
        )
        for signal, rows in stretch.shooting.run.readings.items():
            part = rows[:, stretch.readings]
            there = np.isfinite(part)
            deviation = self.task.deviation(stretch.shooting.number, signal)
            r, steep = robust((values[signal] - part)[there] / deviation, self.task.loss)
            along = np.zeros((len(r), len(self.usual)))
            derivative = np.moveaxis(derivatives[signal], 1, 2)[there]
            along[:, columns] = steep[:, None] * derivative * slopes / deviation
            found.append(r)
            jacobian.append(along)
        return np.concatenate(found), np.vstack(jacobian)

    def _jumps(
        self,
        stretch: Stretch,
        motion: Trajectory,
        columns: np.ndarray,
        slopes: np.ndarray,
        w: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray]:
        assert stretch.after is not None
        size = self.jump * self.usual[stretch.after]
        jacobian = np.zeros((len(size), len(w)))
        jacobian[:, columns] = motion.end_derivative * slopes / size[:, None]
        jacobian[:, stretch.after] -= np.diag(1 / size)
        return (motion.end - w[stretch.after]) / size, jacobian


def continuity(task: FitTask, theta: np.ndarray, nodes: int) -> float:
    """Largest jump, in usual sizes, of stretches that start on the whole motion at nodes."""
    # It shows the growth of simulation errors from node to node.
    whole, w = lifted(task, theta, nodes)
    for stretch in whole.stretches:
        if stretch.state is not None:
            motion = stretch.shooting.motion(theta, np.array([stretch.begin]))
            w[stretch.state] = motion.states[:, 0]
    largest = 0.0
    for stretch in whole.stretches:
        if stretch.after is not None:
            motion = stretch.motion(theta, None if stretch.state is None else w[stretch.state])
            jump = np.abs(motion.end - w[stretch.after]) / whole.usual[stretch.after]
            largest = max(largest, float(jump.max()))
    return largest


def lifted(task: FitTask, theta: np.ndarray, nodes: int) -> tuple[Lifted, np.ndarray]:
    """Cut every run at this many nodes; also returns the initial unknowns and starts.

    States that are measured, and their rates, are estimated from readings near a node, others
    from the motion with `theta`.
    """
    at, stretches, starts, usual = len(theta), [], [theta], [task.nominal]
    for shooting in task.shootings:
        shooting.model.refuse_delays("multiple shooting")
        guess, cuts = _states(shooting, theta, nodes)
        n_x, times = shooting.model.n_x, shooting.run.times
        ends = [shooting.run.ends[0], *cuts.tolist(), shooting.run.ends[1]]
        rows = [0, *np.searchsorted(times, cuts).tolist(), len(times)]
        for k in range(len(ends) - 1):
            state = slice(at + (k - 1) * n_x, at + k * n_x) if k else None
            after = slice(at + k * n_x, at + (k + 1) * n_x) if k < len(cuts) else None
            readings = slice(rows[k], rows[k + 1])
            stretches.append(Stretch(shooting, ends[k], ends[k + 1], readings, state, after))
        at += len(cuts) * n_x
        if len(cuts):
            starts.append(guess.ravel())
            usual.append(np.tile(_usual(shooting.model, guess), len(cuts)))
    return Lifted(task, tuple(stretches), np.concatenate(usual), 1.0), np.concatenate(starts)


def _states(shooting: Shooting, theta: np.ndarray, nodes: int) -> tuple[np.ndarray, np.ndarray]:
    """Guess of the states at nodes (nodes, n_x), and times of the nodes."""
    times, (first, last) = shooting.run.times, shooting.run.ends
    inner = times[(first < times) & (times < last)]
    picked = np.linspace(0, len(inner) - 1, nodes + 2)[1:-1].round().astype(int)
    cuts = inner[np.unique(picked)] if len(inner) else inner
    guess = np.array([states_read(shooting.model, shooting.run, t) for t in cuts])
    guess = guess.reshape(len(cuts), shooting.model.n_x)
    if np.isnan(guess).any():
        simulated = shooting.motion(theta, cuts).states.T
        guess = np.where(np.isnan(guess), simulated, guess)
    return guess, cuts


def states_read(model: Model, run: Recording, t: float) -> np.ndarray:
    """States (n_x,) at an instant from readings around it, NaN if they do not determine them."""
    found = {s.name: np.full(s.size, np.nan) for s in model.x}
    rates = {s.name: np.full(s.size, np.nan) for s in model.x}
    for name in set(found) & set(run.readings):
        for k, row in enumerate(run.readings[name]):
            found[name][k], rates[name][k] = _around(run.times, row, t)
    x = np.concatenate([found[s.name] for s in model.x])
    try:
        model.places()
    except ArgumentError:  # its states are not places and their rates
        return x
    half = model.n_x // 2
    rate = np.concatenate([rates[s.name] for s in model.x])[:half]
    x[half:] = np.where(np.isnan(x[half:]), rate, x[half:])
    return x


def _around(times: np.ndarray, row: np.ndarray, t: float) -> tuple[float, float]:
    """Value and slope at t of the parabola through the readings nearest to it."""
    there = np.flatnonzero(np.isfinite(row))
    near = there[np.argsort(np.abs(times[there] - t), kind="stable")[:_AROUND]]
    if len(near) < 3:
        return np.nan, np.nan
    since = times[near] - t
    scale = float(np.abs(since).max())
    powers = np.vander(since / scale, 3, increasing=True)
    value, slope, _ = np.linalg.lstsq(powers, row[near], rcond=None)[0]
    return float(value), float(slope) / scale


def _usual(model: Model, guess: np.ndarray) -> np.ndarray:
    """Usual size of each state, (n_x,): its variation from node to node."""
    nominal = nominal_of(model.x)
    return np.maximum(guess.std(axis=0), _LEAST * nominal)


def _units(model: Model) -> dict[str, dict[str, np.ndarray]]:
    """Direction of each state's start."""
    return {
        f"start of {s.name}[{k}]": {s.name: np.eye(s.size)[k]}
        for s in model.x
        for k in range(s.size)
    }
