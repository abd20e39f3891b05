"""Prediction of a run: signals at the times of its readings, and their derivatives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError
from wormopt.fitting.coordinates import Coordinate, known_values
from wormopt.fitting.recording import Recording
from wormopt.model.model import Model, pack
from wormopt.simulation.options import Route, Tolerance, Treatment
from wormopt.simulation.simulate import simulate
from wormopt.simulation.trajectory import Trajectory


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
        """For each signal its matrix by the states, None if there is none.

        A product takes a tenth of the time of evaluating expressions; link lengths are common.
        """
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
