"""A clamped rod that a force across bends far, beside scikit-fem, PyElastica and SciPy.

Stretching and shearing resist alike: then the strain by a force is the force over that resistance,
whatever the angle of the section, and the shape is the elastica's, moved by it. Lengths, and the
stiffness against bending, are 1.
"""

from __future__ import annotations

import math
from contextlib import redirect_stdout
from functools import partial
from io import StringIO
from typing import Any

import casadi as ca
import numpy as np
from scipy.integrate import solve_bvp
from scipy.sparse.linalg import spsolve

from tests.benchmarks.ladder import Run, Task, Way
from tests.benchmarks.run import OWN
from tests.oracles.beams import bent_cantilever
from wormopt.systems.channel.rod import Rod, Stiffness

_ANGLE, _HARD = 1.1, 50.0  # of the tip; resistance to stretching and shearing
# PyElastica's sections shrink as they are stretched: there its rod is to stretch little
_HARDER = 1e4
_INCREMENTS, _STEPS = 4, 40
_RADIUS, _DAMPING, _SPAN = 0.2, 6.0, 8.0  # of PyElastica's rod, which comes to rest


def task(_name: str, quick: bool) -> Task:
    """Place and angle of the tip."""
    force, along, across = bent_cantilever(_ANGLE)
    ways = [
        *(Way(OWN if d == 3 else f"{OWN}, degree {d}", partial(_own, d, force), meshes)
          for d, meshes in ((3, (2, 4, 8, 16, 32)), (2, (4, 8, 16, 32, 64)))),
        Way("scikit-fem, P2", partial(_skfem, force), (4, 8, 16, 32, 64, 128)),
        Way("SciPy solve_bvp", partial(_scipy, force), (10, 1e3, 1e5, 1e7, 1e9)),
        Way("PyElastica", partial(_pyelastica, force), (5, 10) if quick else (5, 10, 20, 40)),
    ]  # fmt: skip
    return Task(
        f"a rod that a force bends until its tip is turned by {_ANGLE:g}",
        "elliptic integrals (Bisshopp and Drucker 1945)",
        "place of the tip over the length, and its angle",
        "elements; of SciPy 1 / tolerance",
        1e-6,
        np.array([along, across, _ANGLE]),
        ways,
    )


def _own(degree: int, force: float) -> Run:
    """Newton's method on the energy of our rod, the force in a few increments."""

    def run(elements: float) -> np.ndarray:
        rod = Rod(1.0, 0.1, 1.0, 1.0, elements=int(elements), degree=degree)
        n, q, load = rod.count, ca.SX.sym("q", 3 * rod.count), ca.SX.sym("load")
        stored = rod.energy(rod.strains(*ca.vertsplit(q, n)), Stiffness(_HARD, _HARD, 1.0))
        held = [0, n, 2 * n]
        free = [k for k in range(3 * n) if k not in held]
        stiffness, slope = ca.hessian(stored - load * q[2 * n - 1], q)
        both = ca.Function("both", [q, load], [slope[free], stiffness[free, free]])
        found = np.concatenate([rod.nodes, np.zeros(2 * n)])
        for share in np.arange(1, _INCREMENTS + 1) / _INCREMENTS:
            for _ in range(_STEPS):
                left, matrix = both(found, share * force)
                step = -spsolve(matrix.sparse(), np.array(left).ravel())
                found[free] += step
                if np.abs(step).max() < (1e-9 if share == 1 else 1e-2):
                    break
            else:
                raise RuntimeError("Newton's method does not end")
        tip = found.reshape(3, n)[:, -1]
        return tip - [0.0, force / _HARD, 0.0]

    return run


def _skfem(force: float) -> Run:
    """The angle alone: theta'' + F cos theta = 0 in its weak form; the tip is an integral."""
    import skfem

    def run(elements: float) -> np.ndarray:
        mesh = skfem.MeshLine(np.linspace(0, 1, int(elements) + 1)).with_boundaries(
            {"left": lambda x: x[0] == 0, "right": lambda x: x[0] == 1}
        )
        basis = skfem.Basis(mesh, skfem.ElementLineP2(), intorder=6)

        @skfem.BilinearForm
        def matrix(u: Any, v: Any, w: Any) -> Any:
            return u.grad[0] * v.grad[0] + w.load * np.sin(w.theta) * u * v

        @skfem.LinearForm
        def rest(v: Any, w: Any) -> Any:
            return w.load * np.cos(w.theta) * v - w.theta.grad[0] * v.grad[0]

        theta, free = basis.zeros(), basis.complement_dofs(basis.get_dofs("left"))
        for share in np.arange(1, _INCREMENTS + 1) / _INCREMENTS:
            for _ in range(_STEPS):
                given = {"theta": basis.interpolate(theta), "load": share * force}
                K, b = matrix.assemble(basis, **given), rest.assemble(basis, **given)
                step = spsolve(K[free][:, free], b[free])
                theta[free] += step
                if np.abs(step).max() < (1e-10 if share == 1 else 1e-2):
                    break
        given = {"theta": basis.interpolate(theta)}
        along = skfem.Functional(lambda w: np.cos(w.theta)).assemble(basis, **given)
        across = skfem.Functional(lambda w: np.sin(w.theta)).assemble(basis, **given)
        return np.array([along, across, theta[basis.get_dofs("right").all()][0]])

    return run


def _scipy(force: float) -> Run:
    def ode(_: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.vstack([y[1], -force * np.cos(y[0]), np.cos(y[0]), np.sin(y[0])])

    def ends(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.array([a[0], a[2], a[3], b[1]])

    def run(precision: float) -> np.ndarray:
        s = np.linspace(0, 1, 9)
        start = np.vstack([s, 1 - s, s, 0 * s])
        found = solve_bvp(ode, ends, s, start, tol=1 / precision, max_nodes=100_000)
        if not found.success:
            raise RuntimeError(found.message)
        return found.y[[2, 3, 0], -1]

    return run


def _pyelastica(force: float) -> Run:
    """A rod in motion that damping brings to rest; it knows no statics."""
    import elastica as ea  # type: ignore[import-not-found]

    class System(ea.BaseSystemCollection, ea.Constraints, ea.Forcing, ea.Damping):  # pyright: ignore
        pass

    def run(elements: float) -> np.ndarray:
        count, system, axis = int(elements), System(), np.eye(3)
        density = 1 / (math.pi * _RADIUS**2)
        # to hold the first director is to clamp the rod in the middle of its first element
        size = 1 / (count - 0.5)
        rod = ea.CosseratRod.straight_rod(
            count,
            -size / 2 * axis[0],
            *axis[:2],
            count * size,
            _RADIUS,
            density,
            youngs_modulus=1.0,
        )
        rod.shear_matrix[...] = _HARDER * np.eye(3)[..., None]
        rod.bend_matrix[...] = np.eye(3)[..., None]
        dt = 0.2 / (count * math.sqrt(_HARDER))
        system.append(rod)
        system.constrain(rod).using(
            ea.OneEndFixedBC, constrained_position_idx=(0,), constrained_director_idx=(0,)
        )
        system.add_forcing_to(rod).using(
            ea.EndpointForces, np.zeros(3), force * axis[1], ramp_up_time=1.0
        )
        system.dampen(rod).using(
            ea.AnalyticalLinearDamper, uniform_damping_constant=_DAMPING, time_step=dt
        )
        system.finalize()
        steps = math.ceil(_SPAN / dt)
        with redirect_stdout(StringIO()):
            ea.integrate(ea.PositionVerlet(), system, steps * dt, steps, progress_bar=False)
        x, y = rod.position_collection[:2, -1]
        angles = [math.atan2(d[1], d[0]) for d in rod.director_collection[2].T[-2:]]
        # directors belong to the middles of elements: the moment is 0 at the tip
        return np.array([x, y - force / _HARDER, angles[1] + (angles[1] - angles[0]) / 8])

    return run
