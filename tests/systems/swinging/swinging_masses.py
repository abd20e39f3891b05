"""Masses and scenes that several files of this folder test."""

from functools import cache
from typing import Any

import numpy as np
from scipy.integrate import quad
from scipy.optimize import root_scalar

import wormopt as wo
from wormopt.model.friction import Coulomb, Law
from wormopt.result import Result
from wormopt.study import load_scene

SCENE = "three_masses_harmonic"

THIRDS = 2 * np.pi * np.arange(3) / 3

PERIOD = 2 * np.pi

COULOMB = Coulomb(0.003, 0.01)


def solved_anew(*changes: str) -> Result:
    return wo.run(load_scene(SCENE, changes))


solved = cache(solved_anew)


def mean_force(law: Law, V: float, cosines: Any, sines: Any) -> float:
    """Mean friction of one mass by adaptive quadrature between reversals."""
    order = np.arange(1, len(cosines) + 1)

    def v(t: float) -> float:
        return float(V + cosines @ np.cos(order * t) + sines @ np.sin(order * t))

    grid = np.linspace(0.0, PERIOD, 2001)
    values = [v(t) for t in grid]
    edges = [0.0, PERIOD]
    for k in np.flatnonzero(np.diff(np.sign(values))):
        bracket = (float(grid[k]), float(grid[k + 1]))
        edges.append(root_scalar(v, bracket=bracket, xtol=1e-300, rtol=1e-15).root)
    total = 0.0
    for a, b in zip(sorted(edges)[:-1], sorted(edges)[1:], strict=True):
        sign = 1 if v((a + b) / 2) > 0 else -1
        part = quad(
            lambda t, sign=sign: float(law.slip_force(v(t), sign)), a, b, epsabs=1e-16, limit=200
        )
        total += part[0]
    return total / PERIOD
