"""Cost to go of linear-quadratic stages, by Riccati's recursion backwards in time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class CostToGo:
    """Least cost from each node on as a function of the change dx, g dx + dx P dx / 2 + const."""

    gradient: np.ndarray  # (N + 1, n_x) g, 0 at the end
    hessian: np.ndarray  # (N + 1, n_x, n_x) P, 0 at the end
    feedback: np.ndarray  # (N, n_u, n_x) the best du = -feedback dx - ahead
    ahead: np.ndarray  # (N, n_u)


def cost_to_go(
    dynamics: np.ndarray, gradient: np.ndarray, hessian: np.ndarray, n_x: int
) -> CostToGo:
    """Compute it for stages dx_{k+1} = dynamics_k (dx_k, du_k).

    The cost of a stage is g v + v H v / 2 for v = (dx, du); shapes (N, n_x, n_v), (N, n_v) and
    (N, n_v, n_v). H is positive definite in du.
    """
    n, n_v = gradient.shape
    g, P = np.zeros((n + 1, n_x)), np.zeros((n + 1, n_x, n_x))
    feedback, ahead = np.zeros((n, n_v - n_x, n_x)), np.zeros((n, n_v - n_x))
    for k in range(n - 1, -1, -1):
        F = dynamics[k]
        M, m = hessian[k] + F.T @ P[k + 1] @ F, gradient[k] + F.T @ g[k + 1]
        found = np.linalg.solve(M[n_x:, n_x:], np.column_stack([M[n_x:, :n_x], m[n_x:]]))
        feedback[k], ahead[k] = found[:, :n_x], found[:, n_x]
        P[k] = M[:n_x, :n_x] - M[:n_x, n_x:] @ feedback[k]
        P[k] = (P[k] + P[k].T) / 2
        g[k] = m[:n_x] - M[:n_x, n_x:] @ ahead[k]
    return CostToGo(g, P, feedback, ahead)
