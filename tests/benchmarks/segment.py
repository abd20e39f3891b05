"""A segment from wall to wall as an elastica of free length, beside SciPy's solve_bvp."""

from __future__ import annotations

from functools import partial

import numpy as np
from scipy.integrate import solve_bvp

from tests.benchmarks.ladder import Run, Task, Way
from tests.benchmarks.run import OWN
from wormopt.numerics.boundary_values import solve_boundary
from wormopt.systems.channel.segments import elastica, exact_elastica, slender_guess

_RISE, _FIRST = 0.7, 0.2  # rise over the span, and that from which it is followed


def task(_name: str, _quick: bool) -> Task:
    """Length, force of the wall and tension of a segment; the same first guess for all."""
    exact = exact_elastica("sleeve", _RISE)
    return Task(
        f"elastica of free length, rise {_RISE:g} of the span",
        "elliptic integrals",
        "length, reaction and tension, scaled",
        "degree, or the tolerance of SciPy",
        1e-9,
        np.array([exact.length, exact.reaction, exact.tension]),
        [
            Way(OWN, _own, (6, 8, 12, 16, 24)),
            Way("SciPy solve_bvp", partial(_scipy, exact=False), (1e-3, 1e-5, 1e-7, 1e-9)),
            Way("SciPy, Jacobian by hand", partial(_scipy, exact=True), (1e-3, 1e-5, 1e-7, 1e-9)),
        ],
    )


def _own() -> Run:
    problem = elastica("sleeve")

    def run(degree: float) -> np.ndarray:
        guess, path = partial(slender_guess, "sleeve", _FIRST), [[_FIRST], [_RISE]]
        return solve_boundary(problem, guess, path, degree=int(degree), tolerance=np.inf).p

    return run


def _scipy(exact: bool) -> Run:
    """By collocation of order 4 on a mesh that refines itself."""

    def ode(_: np.ndarray, y: np.ndarray, p: np.ndarray) -> np.ndarray:
        theta, curvature = y[:2]
        cos, sin = np.cos(theta), np.sin(theta)
        return p[0] * np.vstack([curvature, -p[1] * cos + p[2] * sin, cos, sin])

    def slopes(_: np.ndarray, y: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        theta, curvature = y[:2]
        cos, sin, by_state = np.cos(theta), np.sin(theta), np.zeros((4, 4, len(theta)))
        by_state[0, 1] = 1.0
        by_state[1, 0] = p[1] * sin + p[2] * cos
        by_state[2, 0], by_state[3, 0] = -sin, cos
        by_number = np.zeros((4, 3, len(theta)))
        by_number[:, 0] = np.vstack([curvature, -p[1] * cos + p[2] * sin, cos, sin])
        by_number[1, 1], by_number[1, 2] = -p[0] * cos, p[0] * sin
        return p[0] * by_state, by_number

    def run(tolerance: float) -> np.ndarray:
        s = np.linspace(0, 1, 9)
        y, p = slender_guess("sleeve", _FIRST, s)
        y = y[:4]
        for rise in (_FIRST, _RISE):

            def ends(a: np.ndarray, b: np.ndarray, p: np.ndarray, rise: float = rise) -> np.ndarray:
                return np.array(
                    [a[0], a[2], a[3], b[0], b[2] - 1, b[3] - rise, p[2] + a[1] ** 2 / 2]
                )

            jacobian = slopes if exact else None
            found = solve_bvp(
                ode, ends, s, y, p, fun_jac=jacobian, tol=tolerance, max_nodes=100_000
            )
            if not found.success:
                raise RuntimeError(found.message)
            s, y, p = found.x, found.y, found.p
        return p

    return run
