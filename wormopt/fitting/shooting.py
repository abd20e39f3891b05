"""What a model says of a run: signals at the times of its readings, and their derivatives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from wormopt.errors import ArgumentError, SolveError
from wormopt.fitting.coordinates import Coordinate, known_values
from wormopt.fitting.recording import Recording
from wormopt.model.model import Model
from wormopt.simulation.options import Route, Tolerance, Treatment
from wormopt.simulation.simulate import simulate
from wormopt.simulation.trajectory import Trajectory

Derivatives = dict[str, np.ndarray]  # signal -> (size, k, m)


@dataclass(frozen=True, eq=False)
class Shooting:
    """One run, shot from its start with any values of the coordinates."""

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
        """Values of all signals, 0 where coordinates take their place."""
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
        """Values of all that may be sought."""
        found = {name: np.array(value) for name, value in self._known.items()}
        for k in self.active:
            number = self.coordinates[k].value(theta[k])
            for signal, direction in self.coordinates[k].directions.items():
                found[signal] += number * direction
        return found

    def motion(self, theta: np.ndarray, times: np.ndarray | None = None) -> Trajectory:
        """Simulate the run at the times of its readings, or at others."""
        values = self.values(theta)

        def of(signals: Sequence[object]) -> dict[str, np.ndarray]:
            return {s.name: values[s.name] for s in signals}  # type: ignore[attr-defined]

        return simulate(
            self.model,
            self.run.ends,
            contact=self.contact,
            x0=of(self.model.x),
            p=of((*self.model.p, *self.model.u)),
            schedules=of(self.model.schedules),
            times=self.run.times if times is None else times,
            tolerance=self.tolerance,
            route=self.route,
        )

    def predicted(self, theta: np.ndarray) -> dict[str, np.ndarray]:
        """Signals that were read, (size, m) each."""
        motion = self.motion(theta)
        return {name: motion[name] for name in self.run.readings}

    def derivatives(self, theta: np.ndarray) -> tuple[dict[str, np.ndarray], Derivatives]:
        """Signals that were read, and their derivatives along the active coordinates."""
        return self.predicted(theta), self._differences(theta)

    def _differences(self, theta: np.ndarray) -> Derivatives:
        """Central differences, which a kink between makes wrong."""
        names = list(self.run.readings)
        columns: Mapping[str, list[np.ndarray]] = {name: [] for name in names}
        for k in self.active:
            step = np.zeros(len(theta))
            step[k] = 1e-6 * self.coordinates[k].nominal
            above, below = self.predicted(theta + step), self.predicted(theta - step)
            for name in names:
                columns[name].append((above[name] - below[name]) / (2 * step[k]))
        return {name: np.stack(columns[name], axis=1) for name in names}


def failed(error: Exception) -> bool:
    """Whether a motion could not be followed, which is no defect of a fit."""
    return isinstance(error, SolveError | ArgumentError)
