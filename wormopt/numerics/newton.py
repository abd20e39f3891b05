"""Damped Newton's method, from many starts at a time."""

from __future__ import annotations

from typing import Protocol

import numpy as np

_STEPS, _SHORTEST = 40, 2.0**-10  # and how far one is shortened
_ROUNDING = 1e3  # steps so many times the last one are rounding where none improves


class Equations(Protocol):
    """As many equations as unknowns, with parameters, for m sets of unknowns at a time."""

    nominal: np.ndarray  # (n,) usual sizes of the unknowns, and of the residuals

    def __call__(self, x: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Residuals, shape (m, n)."""
        ...

    def slopes(self, x: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Jacobians, shape (m, n, n)."""
        ...


def newton(
    equations: Equations, x: np.ndarray, p: np.ndarray, *, last_step: float = 1e-11
) -> tuple[np.ndarray, np.ndarray]:
    """Newton steps from starts `x` (m, n), each shortened until the residual decreases.

    Returns the last points (m, n) and whether the last step of each was negligible (m,), in
    nominal sizes. `p` is (n_p,) for all, or (m, n_p).
    """
    p = np.broadcast_to(p, (len(x), p.shape[-1]))
    x, found = x.copy(), np.zeros(len(x), bool)
    open_ = np.arange(len(x))
    for _ in range(_STEPS):
        if not open_.size:
            break
        rest = equations(x[open_], p[open_])
        step = -_solved(equations.slopes(x[open_], p[open_]), rest)
        length = np.abs(step / equations.nominal).max(axis=1)
        small = last_step * (1 + np.abs(x[open_] / equations.nominal).max(axis=1))
        done = length < small
        x[open_[done]] += step[done]
        found[open_[done]] = True
        go_on = ~done & np.isfinite(length)
        open_, step, rest = open_[go_on], step[go_on], rest[go_on]
        factor = _factor(equations, x[open_], p[open_], step, rest)
        lost = factor <= _SHORTEST
        found[open_[lost]] = length[go_on][lost] < _ROUNDING * small[go_on][lost]
        x[open_[~lost]] += factor[~lost, None] * step[~lost]
        open_ = open_[~lost]
    return x, found


def _factor(
    equations: Equations, x: np.ndarray, p: np.ndarray, step: np.ndarray, rest: np.ndarray
) -> np.ndarray:
    """Factors by which steps are shortened."""
    factor = np.ones(len(x))
    size = np.linalg.norm(rest / equations.nominal, axis=1)
    worse = np.arange(len(x))
    while worse.size:
        tried = equations(x[worse] + factor[worse, None] * step[worse], p[worse])
        left = np.linalg.norm(tried / equations.nominal, axis=1)
        smaller = left < (1 - factor[worse] / 4) * size[worse]
        worse = worse[~smaller & (factor[worse] > _SHORTEST)]
        factor[worse] /= 2
    return factor


def _solved(matrices: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solve each system; NaN where it is singular."""
    found = np.full_like(right, np.nan)
    usable = np.array(np.isfinite(matrices).all(axis=(1, 2)))
    try:
        found[usable] = np.linalg.solve(matrices[usable], right[usable, :, None])[:, :, 0]
    except np.linalg.LinAlgError:  # one singular matrix fails the whole call
        usable[usable] = np.linalg.slogdet(matrices[usable])[0] != 0  # det itself may overflow
        found[usable] = np.linalg.solve(matrices[usable], right[usable, :, None])[:, :, 0]
    return found
