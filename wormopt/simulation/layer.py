"""The steep layer of smooth contact laws, which no error estimate of a step sees."""

from __future__ import annotations

import numpy as np

from wormopt.simulation.initial_value import InitialValueProblem
from wormopt.simulation.steps import Call, Step

_SAMPLES = np.linspace(0.0, 1.0, 17)
# The law is flat to 2e-7 from so many widths on.
_WIDTHS = 8.0


class Layer:
    """Speeds below which the smooth law of each contact is steep.

    The parameters `p` and the modes are rewritten by their owners.
    """

    def __init__(self, task: InitialValueProblem, p: np.ndarray, modes: np.ndarray) -> None:
        system = task.system
        self._states: list[int] = system.velocity_state.tolist()
        self._layers: list[float] = [] if system.exact else (_WIDTHS * task.v_layer).tolist()
        if self._layers:
            self._velocities = Call(system.velocities, ("p", p), ("s", modes))

    def is_passed_unseen(self, step: Step) -> bool:
        """Whether a velocity enters the steep layer of the smooth law and leaves it again.

        The steep part would act between the stages and no error estimate would know.
        """
        if not self._layers:
            return False
        suspects = self._may_dip(step)
        if not any(suspects):
            return False
        times, inner = step.t + _SAMPLES * step.h, step.states(_SAMPLES)
        pairs = zip(times, inner, strict=True)
        v = np.array([self._velocities(t, x)[0].copy() for t, x in pairs])
        v *= np.where(v[0] > 0, 1.0, -1.0)
        passes = (v[0] > self._layers) & (v[-1] > self._layers) & (v.min(axis=0) < self._layers)
        return bool(np.any(passes & suspects))

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
