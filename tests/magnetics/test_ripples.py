"""Ripples in a uniform field: Maxwell's stress, the field inside a flat layer, Rosensweig."""

import numpy as np
import pytest

from wormopt.magnetics.hydrostatics import (
    Fluid,
    Langevin,
    Linear,
    field_stiffness,
    flat_field,
    flat_layer_pull,
    growth_rate,
    normal_field_number,
    pull,
)
from wormopt.magnetics.material import MU0

LINEAR = Fluid(1200.0, 0.03, Linear(1.7))
LANGEVIN = Fluid(1200.0, 0.03, Langevin(2.3, 3e4))
FLUIDS = pytest.mark.parametrize("fluid", [LINEAR, LANGEVIN], ids=["linear", "langevin"])


@FLUIDS
def test_maxwells_stress_is_normal_to_the_surface_and_is_the_pull(fluid: Fluid) -> None:
    """H along the surface and B across it go on; nothing of the stress pulls along the surface."""
    rng = np.random.default_rng(1)
    for Ht, Hn in rng.normal(0, 2e4, (20, 2)):
        law, square = fluid.magnetisation, Ht**2 + Hn**2
        B = MU0 * (1 + law.ratio(square)) * np.array([Ht, Hn])
        inside, outside, up = np.array([Ht, Hn]), np.array([Ht, B[1] / MU0]), np.array([0, 1])
        inner = B[1] * inside - MU0 * (law.energy(square) + square / 2) * up
        outer = MU0 * (outside[1] * outside - up * (outside @ outside) / 2)
        along, normal = outer - inner
        assert abs(along) <= 1e-14 * MU0 * square
        assert normal == pytest.approx(float(pull(fluid, (Ht, Hn), 0.0)), rel=1e-12)


@FLUIDS
def test_the_field_inside_a_flat_layer_by_newton_and_by_halving(fluid: Fluid) -> None:
    rng = np.random.default_rng(2)
    along, up = rng.normal(0, 10 ** rng.uniform(2, 6, (2, 200)))
    slope = rng.normal(0, 0.3, 200)
    tangent, _, across = flat_field(fluid.magnetisation, (along, 0 * along, up), slope)
    found = pull(fluid, (tangent, across), 0.0)
    assert found == pytest.approx(flat_layer_pull(fluid, (along, up), slope), rel=1e-11)


@pytest.mark.parametrize("kd", [0.01, 0.3, 2.0, 9.0])
def test_the_stiffness_by_the_field_is_that_of_the_potentials(kd: float) -> None:
    """Conditions at ground and surface as a linear system, solved by numbers."""
    depth, chi, H = 1e-3, 1.7, np.array([8e3, 5e3])
    k, mu, (across, along) = kd / depth, 1 + chi, H
    e, down = np.exp(kd), np.exp(-kd)
    # unknown: below C exp(kz), inside A exp(kz) + B exp(-kz), above D exp(-k(z - d))
    matrix = np.array(
        [[1, -1, -1, 0], [1, -mu, mu, 0], [0, -e, -down, 1], [0, -mu * e, mu * down, -1]]
    )
    normal = np.linalg.solve(matrix, [0, 0, -chi * across, 0])  # times cos kx
    tangent = np.linalg.solve(matrix, [0, 0, 0, chi * along])  # times sin kx
    up = k * (normal[1] * e - normal[2] * down)
    on = k * (tangent[1] * e + tangent[2] * down)
    wanted = MU0 * chi * (mu * across * up + along * on)
    assert field_stiffness(LINEAR, depth, k, across, along) == pytest.approx(wanted, rel=1e-10)


def test_a_deep_layer_breaks_up_at_cowley_and_rosensweigs_magnetisation() -> None:
    fluid, mu = LINEAR, 2.7
    M = np.sqrt(2 * (1 + 1 / mu) * np.sqrt(fluid.weight * fluid.surface_tension) / MU0)
    assert normal_field_number(fluid, 1.0, M / 1.7) == pytest.approx(1.0, rel=1e-8)
    k = 1 / fluid.capillary_length
    rates = [growth_rate(fluid, 0.1, 0.05, k, across=s * M / 1.7) for s in (0.999, 1.001)]
    assert rates[0] < 0 < rates[1]


def test_a_thin_layer_stands_more_and_none_bears_no_number() -> None:
    deep, thin = (normal_field_number(LINEAR, d, 5e3) for d in (1.0, 1e-4))
    assert 0 < thin < deep
    assert normal_field_number(LINEAR, 1e-3, 0.0) == 0.0
