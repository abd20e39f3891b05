"""Moving-horizon estimation: parameters that fit the recent motion best, on the same arcs.

Unknowns are the initial state of the window and the logarithms of chosen parameters. The sum of
squared errors of measured states is minimised by Gauss-Newton steps, together with a prior for the
parameters: arcs that leave the window are not lost but added to the prior, linearised at their
last values [1]_.

.. [1] C. V. Rao, J. B. Rawlings, D. Q. Mayne, "Constrained state estimation for nonlinear discrete-
   time systems", IEEE Trans. Automat. Control 48 (2003) 246-258.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wormopt.errors import ArgumentError
from wormopt.ocp.stages import Given, Linearised, Sensitivity, Stages

# Parameters stay within this factor of the first prior.
_MOST = 4.0


@dataclass(frozen=True)
class Estimation:
    """Options of an estimation.

    Parameters
    ----------
    names : tuple of str
        Parameters of the model, above 0.
    window : int
        Number of past arcs in the window.
    noise : float
        Standard deviation of a measured state, in nominal sizes.
    spread : float
        Standard deviation of a parameter's prior, as a share of the parameter.
    memory : float
        Number of arcs after which information outside the window has the weight 1/e.
    steps : int
        Gauss-Newton steps for each new state.

    Raises
    ------
    ArgumentError
        If a number is not positive or nothing is estimated.

    Examples
    --------
    >>> Estimation(("mass",), window=10).noise
    0.01
    """

    names: tuple[str, ...] = ("mass", "friction_forward", "friction_backward")
    window: int = 25
    noise: float = 1e-2
    spread: float = 0.2
    memory: float = np.inf
    steps: int = 1

    def __post_init__(self) -> None:
        sizes = (self.window, self.noise, self.spread, self.memory, self.steps)
        if not (self.names and min(sizes) > 0):
            raise ArgumentError("estimation needs names of parameters, and options above 0")


class Estimator:
    """Estimates parameters from states and inputs, arc by arc."""

    def __init__(self, stages: Stages, given: Given, estimation: Estimation) -> None:
        self.stages, self.given, self.estimation = stages, given, estimation
        self.chosen = places(stages, estimation.names)
        count = len(self.chosen)
        self.logarithms = np.zeros(count)  # relative to the given parameters
        self._own = np.eye(count) / estimation.spread**2
        self._information, self._weighted = self._own, np.zeros(count)
        self._rows = np.zeros((0, stages.arc.layout.size))
        self._measured = np.zeros((0, stages.n_x))
        self._seen = 0
        if not np.all(given.p[self.chosen] > 0):
            raise ArgumentError("initial values of estimated parameters must be above 0")

    @property
    def p(self) -> np.ndarray:
        """Parameters (n_p,) of the model with the estimates."""
        p = self.given.p.copy()
        p[self.chosen] *= np.exp(self.logarithms)
        return p

    def see(self, row: np.ndarray, before: np.ndarray, after: np.ndarray) -> np.ndarray:
        """Add the next arc: its predicted variables (n_y,), and the states (n_x,) at its ends.

        Returns the parameters (n_p,) that fit the window best.
        """
        row, sizes = row.copy(), self.stages.arc.x_nominal
        row[self.stages.start] = before / sizes
        self._rows = np.concatenate([self._rows, row[None]])
        self._measured = np.concatenate([self._measured[:-1], [before / sizes, after / sizes]])
        self._end = after / sizes
        self._seen += 1
        if len(self._rows) > self.estimation.window:
            self._forget()
        for _ in range(self.estimation.steps):
            self._improve()
        return self.p

    def _given(self, arcs: slice) -> Given:
        first = self._seen - len(self._rows)
        part = self.given.part(slice(first + arcs.start, first + arcs.stop))
        return Given(part.levels, part.schedules, self.p)

    def _forget(self) -> None:
        """Remove the oldest arc, and add its information about the parameters to the prior."""
        given, oldest, stages = self._given(slice(0, 1)), self._rows[:1], self.stages
        arc = stages.linearise(oldest, given)
        J = stages.sensitivity(oldest, given, self.chosen).end[0]
        off = self._measured[0] - oldest[0, stages.start]
        missed = self._measured[1] - arc.end[0] - arc.dynamics[0, :, : stages.n_x] @ off
        weight = 0.5 / self.estimation.noise**2  # it contains two measured states
        kept = np.exp(-1 / self.estimation.memory)
        self._information = self._own + kept * (self._information - self._own) + weight * J.T @ J
        self._weighted = kept * self._weighted + weight * J.T @ (J @ self.logarithms + missed)
        self._rows, self._measured = self._rows[1:], self._measured[1:]

    def _improve(self) -> None:
        """One Gauss-Newton step in the window's first state and the logarithms."""
        stages, rows = self.stages, self._rows
        given = self._given(slice(0, len(rows)))
        arcs, by = stages.linearise(rows, given), stages.sensitivity(rows, given, self.chosen)
        nodes = np.concatenate([rows[:, stages.start], self._end[None]])
        slopes, constants = _chained(arcs, by, nodes, stages.n_x)
        step = self._least_squares(slopes, self._measured - nodes - constants)
        moved = constants + slopes @ step
        start, logarithms = moved[:-1, :, None], step[stages.n_x :]
        inner = arcs.inner_by[:, :, : stages.n_x] @ start + (by.inner @ logarithms)[:, :, None]
        rows[:, stages.inner] += arcs.inner + inner[:, :, 0]
        rows[:, stages.start] += moved[:-1]
        self._end = self._end + moved[-1]
        most = np.log(_MOST)
        self.logarithms = np.clip(self.logarithms + logarithms, -most, most)

    def _least_squares(self, slopes: np.ndarray, missed: np.ndarray) -> np.ndarray:
        """Change (n_x + chosen,) that minimises the errors at nodes and of the prior."""
        n_x, count = self.stages.n_x, len(self.chosen)
        root = np.linalg.cholesky(self._information).T
        believed = np.linalg.solve(self._information, self._weighted)
        matrix = np.zeros((slopes.shape[0] * n_x + count, n_x + count))
        matrix[:-count] = slopes.reshape(-1, n_x + count) / self.estimation.noise
        matrix[-count:, n_x:] = root
        right = np.append(
            missed.ravel() / self.estimation.noise, root @ (believed - self.logarithms)
        )
        return np.linalg.lstsq(matrix, right, rcond=None)[0]


def _chained(
    arcs: Linearised, by: Sensitivity, nodes: np.ndarray, n_x: int
) -> tuple[np.ndarray, np.ndarray]:
    """Change of all nodes, constant (N + 1, n_x) and by first state and parameters."""
    n, count = len(arcs.end), by.end.shape[2]
    gaps = arcs.end - nodes[1:]
    slopes, constants = np.zeros((n + 1, n_x, n_x + count)), np.zeros((n + 1, n_x))
    slopes[0, :, :n_x] = np.eye(n_x)
    for k in range(n):
        A = arcs.dynamics[k, :, :n_x]
        constants[k + 1] = A @ constants[k] + gaps[k]
        slopes[k + 1] = A @ slopes[k]
        slopes[k + 1, :, n_x:] += by.end[k]
    return slopes, constants


def places(stages: Stages, names: tuple[str, ...]) -> np.ndarray:
    """Indices of named parameters among all of the model; ArgumentError if there is none."""
    first, found = 0, {}
    for signal in stages.program.problem.model.p:
        found[signal.name] = range(first, first + signal.size)
        first += signal.size
    for name in names:
        if name not in found:
            raise ArgumentError(f"there is no parameter {name!r}; there are {', '.join(found)}")
    return np.array([k for name in names for k in found[name]])
