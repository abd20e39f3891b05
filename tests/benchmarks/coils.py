"""Field of a coil with a thick winding, beside magpylib and loops by SciPy's elliptic integrals.

Windings are thick, which none of the closed forms is: all take thin parts and Gauss's weights.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from tests.benchmarks.ladder import Run, Task, Way
from tests.benchmarks.run import OWN
from tests.oracles.windings import loop_by_integrals
from wormopt.magnetics.coils import Coil, CoilRow, field_by_quadrature

_COIL, _HEIGHT = Coil(2e-3, 4.5e-3, 20e-3), 12e-3  # in m: the line is 2 mm over the winding
_POINTS, _EVERY = 2000, 100  # of the line; the field is known at one in so many
_ALONG = 4  # loops along the coil for each over the radius
_NODES = (2, 3, 4, 6, 8, 12, 16)

Field = Callable[[np.ndarray, int], np.ndarray]
"""Field (2, m) per ampere-turn, away from the axis and along it, at distances from the axis."""


def task(_name: str, quick: bool) -> Task:
    """Field on a line over a coil."""
    rho = np.linspace(1e-5, 10e-3, _POINTS)
    every = 5 * _EVERY if quick else _EVERY
    row, one = CoilRow(_COIL, 1, 10e-3, "vertical"), np.ones((1, _POINTS // every))
    known = field_by_quadrature(row, rho[::every], _HEIGHT, one)[[0, 2]]
    fields: dict[str, Callable[[], Field]] = {
        OWN: lambda: _own, "magpylib, nested cylinders": _magpylib, "SciPy, loops": lambda: _loops,
    }  # fmt: skip
    ways = [Way(name, partial(_at, rho, every, make), _NODES) for name, make in fields.items()]
    as_it_comes = Way(f"{OWN} as it comes", partial(_at, rho, every, lambda: _default), (14,))
    return Task(
        f"field of a thick coil at {_POINTS} points",
        "Biot and Savart's law by adaptive quadrature, no elliptic integral",
        "field, over the largest",
        f"nodes over the radius (loops: {_ALONG} times as many along the coil)",
        1e-8,
        known,
        [*ways, as_it_comes],
        float(np.abs(known).max()),
    )


def _at(rho: np.ndarray, every: int, make: Callable[[], Field]) -> Run:
    field = make()
    return lambda nodes: field(rho, int(nodes))[:, ::every]


def _own(rho: np.ndarray, nodes: int) -> np.ndarray:
    axial, radial = _COIL.expression(rho**2, np.full_like(rho, _HEIGHT), nodes)
    return np.array([radial * rho, axial])


def _default(rho: np.ndarray, _: int) -> np.ndarray:
    axial, radial = _COIL.field(rho**2, np.full_like(rho, _HEIGHT))
    return np.array([radial * rho, axial])


def _over_radius(nodes: int) -> tuple[np.ndarray, np.ndarray]:
    """Radii and their shares of the winding."""
    places, weights = np.polynomial.legendre.leggauss(nodes)
    return (_COIL.inner + _COIL.outer + places * (_COIL.outer - _COIL.inner)) / 2, weights / 2


def _magpylib() -> Field:
    import magpylib

    def field(rho: np.ndarray, nodes: int) -> np.ndarray:
        points, found = np.c_[rho, 0 * rho, np.full_like(rho, _HEIGHT)], np.zeros((len(rho), 3))
        for radius, weight in zip(*_over_radius(nodes), strict=True):
            # a magnet of this polarization has the field of one ampere-turn round it, times mu0
            magnet = magpylib.magnet.Cylinder(
                dimension=(2 * radius, _COIL.length), magnetization=(0, 0, 1 / _COIL.length)
            )
            found += weight * magnet.getH(points)
        return found[:, [0, 2]].T

    return field


def _loops(rho: np.ndarray, nodes: int) -> np.ndarray:
    places, weights = np.polynomial.legendre.leggauss(_ALONG * nodes)
    found = np.zeros((2, len(rho)))
    for a, share in zip(*_over_radius(nodes), strict=True):
        for place, weight in zip(places, weights / 2, strict=True):
            s = np.full_like(rho, _HEIGHT - place * _COIL.length / 2)
            axial, radial = loop_by_integrals(a, rho, s)
            found += share * weight * np.array([radial, axial])
    return found
