"""When a contact or a switch has to be decided anew: zeros of event functions within a step.

An event function is positive while things stay as they are: for a sliding contact its velocity in
the direction of sliding, for a resting one the distance of its force from the nearer bound, for a
switch minus its guard. It counts as armed once it has been well above 0, so that a contact that
has just been let go, with no velocity and perhaps no acceleration, is not caught again by a
rounding error. Not armed, that of a contact must fall clearly below 0; that of a switch tells
nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from wormopt.simulation.steps import Call, Step, Stepper, floor_of_step, powers
from wormopt.simulation.task import Task

__all__ = ["Crossing", "Watch"]

_SAMPLES = np.array(
    [0.0, 1 / 64, 0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875, 63 / 64, 1.0]  # fmt: skip
)
_POWERS = powers(_SAMPLES)
_LAYER_SAMPLES = np.linspace(0.0, 1.0, 17)


@dataclass(frozen=True)
class Crossing:
    """Where an event function falls through its level.

    Parameters
    ----------
    which : int
        Event function; switches are counted on from the contacts.
    theta : float
        Fraction of the step.
    armed : bool
        Whether it was armed, so that the level is 0.
    """

    which: int
    theta: float
    armed: bool


class Watch:
    """The event functions of a motion.

    Parameters
    ----------
    task : Task
        What is integrated.
    p, modes : ndarray
        Parameters and modes, which their owners rewrite.
    """

    def __init__(self, task: Task, p: np.ndarray, modes: np.ndarray) -> None:
        system, shared = task.system, (("p", p), ("s", modes))
        self._task, self._modes = task, modes
        self.n_contacts = len(modes)
        self.n = len(modes) + len(system.model.switches)
        self.armed = np.zeros(self.n, dtype=bool)
        # a switch that has fired is armed again once its guard has fallen by more than this
        self._passed = np.zeros(len(system.model.switches))
        self._states = system.velocity_state if system.exact else np.zeros(0, dtype=np.int64)
        self._calls = {
            (name, m): Call(function if m == 1 else _repeated(function, m), *shared)
            for name, function in system.functions.items()
            if name in ("probe", "guards")
            for m in (1, len(_SAMPLES))
        }
        self._layers = task.v_layer if not system.exact else np.zeros(0)
        if len(self._layers):
            self._velocities = Call(system.velocities, *shared)

    # -- values ----------------------------------------------------------------------------

    def values(self, t: np.ndarray, states: np.ndarray) -> np.ndarray:
        """Values of the event functions.

        Parameters
        ----------
        t : ndarray, shape (m,)
            One time, or those of the samples of a step.
        states : ndarray, shape (m, n_x)
            States then.

        Returns
        -------
        ndarray, shape (m, n)
        """
        m, parts = len(t), []
        if self.n_contacts:
            parts.append(self._contact_values(t, states))
        if self.n > self.n_contacts:
            guards = self._calls["guards", m](t, states.ravel())[0]
            parts.append(-guards.reshape(m, -1))
        return np.hstack(parts) if parts else np.zeros((m, 0))

    def _contact_values(self, t: np.ndarray, states: np.ndarray) -> np.ndarray:
        slides = self._modes != 0
        if np.all(slides & (self._states >= 0)):
            return self._modes * states[:, self._states]
        probe = self._calls["probe", len(t)](t, states.ravel())[0]
        velocity, _, force, least, largest = (
            probe.reshape(len(t), 5, self.n_contacts).transpose(1, 0, 2)
        )
        margin = np.minimum(force - least, largest - force)
        return np.where(slides, self._modes * velocity, margin)

    def value(self, which: int, t: float, x: np.ndarray) -> float:
        """Value of one event function.

        Parameters
        ----------
        which : int
            Event function.
        t : float
            Time.
        x : ndarray, shape (n_x,)
            State.

        Returns
        -------
        float
        """
        return float(self.values(np.array([t]), x[None, :])[0, which])

    def _within(self, which: int, step: Step, theta: float) -> float:
        return self.value(which, step.t + theta * step.h, step.states(theta))

    def _small(self) -> np.ndarray:
        """Sizes below which the event functions are nothing but rounding."""
        rest = np.zeros(0)
        if self.n_contacts:
            rest = np.where(self._modes != 0, self._task.v_rest, self._task.f_rest)
        return np.concatenate([rest, self._passed])

    # -- arming ----------------------------------------------------------------------------

    def arm(self, t: float, x: np.ndarray, *, at_start: bool = False) -> None:
        """Arm what is well above 0.

        Parameters
        ----------
        t : float
            Time.
        x : ndarray, shape (n_x,)
            State.
        at_start : bool, optional
            Whether the motion starts here; switches are armed then unless their guards are
            above 0 already.
        """
        values = self.values(np.array([t]), x[None, :])[0]
        self.armed |= values > self._small()
        if at_start:
            self.armed[self.n_contacts :] |= values[self.n_contacts :] >= 0

    def disarm_switch(self, k: int, residual: float = 0.0) -> None:
        """Note that a switch has fired.

        Parameters
        ----------
        k : int
            Index of the switch.
        residual : float, optional
            How far from 0 its guard may have been, by rounding.
        """
        self.armed[self.n_contacts + k] = False
        self._passed[k] = residual

    def jumped_switch(self, t: float, x: np.ndarray) -> int | None:
        """First armed switch of which the guard has jumped above 0.

        Parameters
        ----------
        t : float
            Time.
        x : ndarray, shape (n_x,)
            State.

        Returns
        -------
        int or None
            Its index.
        """
        if self.n == self.n_contacts:
            return None
        values = self.values(np.array([t]), x[None, :])[0, self.n_contacts :]
        jumped = np.flatnonzero(self.armed[self.n_contacts :] & (values < 0))
        return int(jumped[0]) if len(jumped) else None

    # -- location --------------------------------------------------------------------------

    def find(self, step: Step) -> Crossing | None:
        """First event of a step; without any, arms what has been well above 0 in it.

        Parameters
        ----------
        step : Step
            An attempted step.

        Returns
        -------
        Crossing or None
        """
        values = self.values(step.t + _SAMPLES * step.h, _POWERS @ step.rows)
        a, b, c = values[:-2], values[1:-1], values[2:]
        dips = (b < a) & (b <= c) & (b < 4 * (np.maximum(a, c) - b))
        suspects = np.flatnonzero((values < 0).any(axis=0) | dips.any(axis=0))
        small = self._small()
        found = [self._first(int(j), step, values[:, j], small[j]) for j in suspects]
        crossings = [crossing for crossing in found if crossing]
        if crossings:
            return min(crossings, key=lambda crossing: crossing.theta)
        self.armed |= (values > small).any(axis=0)
        return None

    def _first(self, j: int, step: Step, value: np.ndarray, small: float) -> Crossing | None:
        """First crossing of one event function."""
        armed = bool(self.armed[j])
        unarmed_level = -small if j < self.n_contacts else -np.inf

        def above(theta: float) -> float:
            return self._within(j, step, theta) - level

        for k, here in enumerate(value):
            level = 0.0 if armed else unarmed_level
            if here < level:
                if k == 0 or value[k - 1] <= level:
                    return Crossing(j, float(_SAMPLES[max(k - 1, 0)]), armed)
                theta = brentq(above, _SAMPLES[k - 1], _SAMPLES[k], xtol=1e-15)
                return Crossing(j, float(theta), armed)
            if k >= 2 and self._dips(value[k - 2 : k + 1] - level):
                ends = _SAMPLES[k - 2], _SAMPLES[k]
                low = minimize_scalar(above, bounds=ends, method="bounded", options={"xatol": 1e-7})
                if low.fun < 0:
                    theta = brentq(above, ends[0], low.x, xtol=1e-15)
                    return Crossing(j, float(theta), armed)
            armed = armed or bool(here > small)
        return None

    @staticmethod
    def _dips(value: np.ndarray) -> bool:
        """Whether three samples leave room for a zero between them."""
        a, b, c = value
        return bool(b < a and b <= c and b < 4 * (max(a, c) - b))

    def _slope(self, step: Step, crossing: Crossing) -> float:
        """Time derivative of an event function about its crossing."""
        low, high = max(crossing.theta - 1e-4, 0.0), min(crossing.theta + 1e-4, 1.0)
        change = self._within(crossing.which, step, high) - self._within(crossing.which, step, low)
        return change / ((high - low) * step.h)

    def locate(self, step: Step, crossing: Crossing, stepper: Stepper) -> tuple[Step | None, float]:
        """Step to an event. The polynomial is of a lower order than the steps, so that the step
        itself is taken and corrected by Newton's method.

        Parameters
        ----------
        step : Step
            The attempted step with the event in it.
        crossing : Crossing
            From `find`.
        stepper : Stepper
            What took the step.

        Returns
        -------
        (Step or None, float)
            The step that ends at the event, None if the event is at its start or the stepper must
            stop earlier; and how far from 0 the event function may be by rounding.
        """
        slope, floor = self._slope(step, crossing), floor_of_step(self._task, step.t)
        length, best, least = crossing.theta * step.h, None, np.inf
        small = self._small()[crossing.which]
        if length <= floor:
            return None, self._residual(slope, floor, crossing, step.t, step.x)
        for _ in range(4):
            tried = stepper.redo(step, length)
            value = self.value(crossing.which, tried.end, tried.x_new)
            if best is None or abs(value) < least:
                best, least, worse = tried, abs(value), False
            else:
                worse = True
            if not crossing.armed or not slope < 0 or worse or least <= 1e-3 * small:
                break
            corrected = length - value / slope
            if not 0 < corrected <= step.h or corrected == length:
                break
            length = corrected
        assert best is not None
        return best, self._residual(slope, floor, crossing, best.end, best.x_new)

    def _residual(
        self, slope: float, floor: float, crossing: Crossing, t: float, x: np.ndarray
    ) -> float:
        return 2 * abs(self.value(crossing.which, t, x)) + abs(slope) * floor

    # -- the layer of the smooth law -------------------------------------------------------

    def dips_into_layer(self, step: Step) -> bool:
        """Whether a velocity enters the steep layer of the smooth law and leaves it again.

        The steep part would act between the stages and no error estimate would know.

        Parameters
        ----------
        step : Step
            An attempted step.

        Returns
        -------
        bool
        """
        if not len(self._layers):
            return False
        layer, states = 8 * self._layers, self._task.system.velocity_state
        suspects = np.array([self._may_dip(step, m, w) for m, w in zip(states, layer, strict=True)])
        if not suspects.any():
            return False
        times, inner = step.t + _LAYER_SAMPLES * step.h, step.states(_LAYER_SAMPLES)
        pairs = zip(times, inner, strict=True)
        v = np.array([self._velocities(t, x)[0].copy() for t, x in pairs])
        v *= np.where(v[0] > 0, 1.0, -1.0)
        passes = (v[0] > layer) & (v[-1] > layer) & (v.min(axis=0) < layer)
        return bool(np.any(passes & suspects))

    @staticmethod
    def _may_dip(step: Step, state: int, layer: float) -> bool:
        """Cheap refusal by the cubic through both ends, for velocities that are states."""
        if state < 0:
            return True
        a, b = step.x[state], step.x_new[state]
        sign = 1.0 if a > 0 else -1.0
        a, b = sign * a, sign * b
        if a <= layer or b <= layer:
            return False
        least = min(a + step.h * sign * step.dx[state] / 3, b - step.h * sign * step.dx_new[state] / 3)
        return bool(least <= max(layer, 0.3 * min(a, b)))
