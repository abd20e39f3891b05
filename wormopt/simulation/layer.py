"""Steep layers and kinks of contact laws, which error estimates of steps may miss."""

from __future__ import annotations

import numpy as np

from wormopt.simulation.call import Call
from wormopt.simulation.initial_value import InitialValueProblem
from wormopt.simulation.steps import Step

_SAMPLES = np.linspace(0.0, 1.0, 17)
# From this number of widths on the law is flat to 2e-7.
_WIDTHS = 8.0
# Largest change of a velocity across the kink at velocity 0 along the heading in a step, as shares
# of the speed and of the nominal speed.
_BEND, _LEAST_BEND = 1e-6, 1e-9


class Layer:
    """Speeds below which the smooth law of each contact is steep.

    The owners of the parameters `p` and the modes rewrite them.
    """

    def __init__(self, task: InitialValueProblem, p: np.ndarray, modes: np.ndarray) -> None:
        system, self._n_x = task.system, len(task.x0)
        self._states: list[int] = system.velocity_state.tolist()
        self._layers: list[float] = [] if system.exact else (_WIDTHS * task.v_layer).tolist()
        self._bends = None
        if system.exact and len(system.planar):
            speeds = np.array([system.contacts[i].nominal_speed for i in system.planar])
            self._least, self._bends = (
                _LEAST_BEND * speeds,
                Call(system.bends, ("p", p), ("s", modes)),
            )
        if self._layers:
            self._velocities = Call(system.velocities, ("p", p), ("s", modes))

    def is_passed_unseen(self, step: Step) -> bool:
        """Whether a velocity enters and leaves the steep layer of the smooth law within a step.

        The layer would act between the stages, unseen by the error estimate. For exact laws in the
        plane: whether a long step passes a kink, which the estimate may miss.
        """
        if not self._layers:
            return self._bends is not None and self._goes_over_bend(step)
        suspects = self._may_dip(step)
        if not any(suspects):
            return False
        v, plain = self._along(step, step.states(_SAMPLES)), self._along(step, _cubics(step))
        sign = np.where(v[0] > 0, 1.0, -1.0)
        least = np.minimum(_least_between(sign * v), _least_between(sign * plain))
        outside = np.minimum(sign * v[0], sign * v[-1]) > self._layers
        return bool(np.any(outside & (least < self._layers) & suspects))

    def _along(self, step: Step, states: np.ndarray) -> np.ndarray:
        """Velocities of contacts (17, n) at the samples of a step, of given states."""
        pairs = zip(step.t + _SAMPLES * step.h, states, strict=True)
        return np.array([self._velocities(t, x[: self._n_x])[0].copy() for t, x in pairs])

    def _goes_over_bend(self, step: Step) -> bool:
        before, speed = self._bend(step.t, step.x)
        after, later = self._bend(step.end, step.x_new)
        allowed = _BEND * np.maximum(speed, later) + self._least
        return bool(np.any((before * after < 0) & (np.abs(after - before) > allowed)))

    def _bend(self, t: float, x: np.ndarray) -> np.ndarray:
        """Velocities along the headings, and speeds."""
        assert self._bends is not None
        (found,) = self._bends(t, x)
        return found.copy().reshape(len(self._least), 2).T

    def _may_dip(self, step: Step) -> list[bool]:
        """Which velocities may dip, judged by the cubic through both ends where they are states."""
        x, x_new = step.x.tolist(), step.x_new.tolist()
        dx, dx_new = step.dx.tolist(), step.dx_new.tolist()
        found = []
        for i, layer in zip(self._states, self._layers, strict=True):
            sign = 1.0 if x[i] > 0 else -1.0
            a, b = sign * x[i], sign * x_new[i]
            first, second = a + sign * step.h * dx[i] / 3, b - sign * step.h * dx_new[i] / 3
            low = min(first, second) <= max(layer, 0.3 * min(a, b))
            found.append(i < 0 or (a > layer and b > layer and low))
        return found


def _cubics(step: Step) -> np.ndarray:
    """States at the samples by the cubics through the ends of a step.

    Stages within a dip may distort the step's own polynomial.
    """
    s, rise = _SAMPLES[:, None], step.x_new - step.x
    first, last = step.h * step.dx, step.h * step.dx_new
    bend = 3 * rise - 2 * first - last + s * (first + last - 2 * rise)
    return step.x + s * (first + s * bend)


def _least_between(v: np.ndarray) -> np.ndarray:
    """Least velocities (n,) within a step, by parabolas through neighbouring samples (m, n).

    A dip may be far shorter than the time between two samples.
    """
    slope, bend = (v[2:] - v[:-2]) / 2, v[:-2] + v[2:] - 2 * v[1:-1]
    turns = np.abs(slope) < bend
    dip = np.where(turns, slope**2 / (2 * np.where(turns, bend, 1.0)), 0.0)
    return (v[1:-1] - dip).min(axis=0)
