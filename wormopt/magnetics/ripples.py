"""Growth and decay of ripples on a film of magnetic fluid in a uniform field.

SI units. A flat layer of thickness d lies on nonmagnetic ground, with air above; its permeability
is mu_r = 1 + M/H. A ripple a cos(k x) of its surface distorts the field; the potential problem of
first order has the closed solution below. In lubrication theory the ripple changes at the rate

    sigma = -d³ k² / (3 eta) [rho g + gamma k² - mu0 k (M_n² Lambda_n - M_t² Lambda_t) - pull_h],

with T = tanh(k d), D = 2 + (mu_r + 1 / mu_r) T, Lambda_n = (mu_r T + 1) / D for the magnetisation
across the layer, Lambda_t = (1 + T / mu_r) / D for that along x, and `pull_h` the contribution of
the coils' own gradient. In a deep layer the flat surface becomes unstable at the magnetisation of
Cowley and Rosensweig, mu0 M² = 2 (1 + 1 / mu_r) sqrt(rho g gamma).

Sources: M. D. Cowley, R. E. Rosensweig, J. Fluid Mech. 30, 1967; R. E. Rosensweig,
Ferrohydrodynamics, 1985, chapter 7.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
from scipy.optimize import minimize_scalar

from wormopt.magnetics.hydrostatics import Fluid, Linear, Magnetisation
from wormopt.magnetics.material import MU0

# Newton's steps: M/H decreases, so they approach from below and double their digits.
_STEPS = 7


def flat_field(law: Magnetisation, H: Sequence[Any], slope: Any) -> tuple[Any, Any, Any]:
    """Field inside a flat layer, by components along its slope, along y, and across it; A/m.

    `H`: field outside along x, y, z. Along the surface H is continuous, across it H + M is.
    """
    along, y, up = H
    root = (1 + slope * slope) ** 0.5
    tangent, normal = (along + slope * up) / root, (up - slope * along) / root
    if isinstance(law, Linear):
        return tangent, y, normal / (1 + law.chi)
    side = tangent * tangent + y * y
    found = _inside(law)(_row(normal), _row(side))
    if isinstance(found, ca.SX):
        return tangent, y, found.T
    return tangent, y, np.array(found).reshape(np.shape(normal))


def _row(values: Any) -> Any:
    return values.T if isinstance(values, ca.SX) else np.ravel(values)[None, :]


@lru_cache(maxsize=16)
def _inside(law: Magnetisation) -> ca.Function:
    """Root H of H (1 + M/H) = normal, M/H at H² + side, by Newton's method."""
    normal, side, square = (ca.SX.sym(name) for name in ("normal", "side", "square"))
    ratio = law.ratio(square)
    known = ca.Function("law", [square], [ratio, ca.gradient(ratio, square)])
    inside = normal / (1 + law.ratio(0.0))
    for _ in range(_STEPS):
        ratio, fall = known(inside**2 + side)
        inside -= (inside * (1 + ratio) - normal) / (1 + ratio + 2 * inside**2 * fall)
    return ca.Function("inside", [normal, side], [inside], {"cse": True})


def field_stiffness(
    fluid: Fluid, depth: Any, k: Any, across: Any, along: Any = 0.0, mu_r: Any = None
) -> Any:
    """Contribution of the distorted field to the pull on a ripple, over its height, in Pa/m.

    `across`, `along`: field inside, A/m; `mu_r`: 1 + M/H there if not that of the law.
    """
    ratio = fluid.magnetisation.ratio(across**2 + along**2) if mu_r is None else mu_r - 1
    mu, T = 1 + ratio, np.tanh(k * depth)
    shared = MU0 * ratio**2 * k / (2 + (mu + 1 / mu) * T)
    return shared * ((mu * T + 1) * across**2 - (1 + T / mu) * along**2)


def growth_rate(
    fluid: Fluid,
    viscosity: float,
    depth: float,
    k: Any,
    *,
    across: float = 0.0,
    along: float = 0.0,
    gradient: float = 0.0,
) -> Any:
    """Growth rate of a ripple with wave number `k` (1/m) in a thin layer, in 1/s.

    `across`, `along`: uniform field inside, A/m; `gradient`: of the coils' pull over the height,
    Pa/m.
    """
    stiffness = fluid.weight + fluid.surface_tension * k**2 - gradient
    stiffness = stiffness - field_stiffness(fluid, depth, k, across, along)
    return -(depth**3) * k**2 / (3 * viscosity) * stiffness


def normal_field_number(fluid: Fluid, depth: float, across: float) -> float:
    """Largest share of the restoring force of ripples that a field across a layer compensates.

    Weight and surface tension restore the flat surface, which is unstable above 1 (Rosensweig).
    `across`: field inside, A/m.
    """
    if across == 0:
        return 0.0

    def share(log: float) -> float:
        k = np.exp(log) / fluid.capillary_length
        restoring = fluid.weight + fluid.surface_tension * k**2
        return -float(field_stiffness(fluid, depth, k, across) / restoring)

    # The share increases with k and then decreases, with its maximum within a decade of the
    # capillary length.
    found: Any = minimize_scalar(share, bounds=(-4.0, 4.0), method="bounded")
    return -float(found.fun)
