"""The rod: strains, statics against closed elasticas, forces and energy, also in its channel."""

import math
from collections.abc import Callable
from typing import Any

import casadi as ca
import hypothesis.strategies as st
import numpy as np
import pytest
from effort import examples
from hypothesis import given, settings
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq

from tests.oracles.beams import bent_cantilever
from wormopt.errors import ArgumentError
from wormopt.model.model import pack
from wormopt.systems.channel.rod import Rod, Stiffness
from wormopt.systems.channel.rod_model import channel_rod, straight

DEGREES = (1, 2, 3)


def rubber(elements: int = 6, degree: int = 2, **changed: Any) -> Rod:
    sizes: dict[str, Any] = {"length": 48e-3, "diameter": 4e-3}
    numbers = sizes | {"youngs_modulus": 5e4, "density": 1100.0}
    return Rod(**(numbers | changed), elements=elements, degree=degree)


def strains(rod: Rod, places: np.ndarray) -> np.ndarray:
    """Stretch, shear and curvature, one row each, of rows of x, y and angle."""
    return np.array(ca.horzcat(*rod.strains(*(ca.DM(row) for row in places)))).T


def potential(rod: Rod, resist: Stiffness) -> Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """Gradient and second derivatives of the energy at x, y and angle, one after the other."""
    q = ca.SX.sym("q", 3 * rod.count)
    stored = rod.energy(rod.strains(*ca.vertsplit(q, rod.count)), resist)
    second, first = ca.hessian(stored, q)
    both = ca.Function("both", [q], [ca.densify(first), ca.densify(second)])

    def of(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        gradient, hessian = both(values)
        return np.array(gradient).ravel(), np.array(hessian)

    return of


def cantilever(
    rod: Rod, resist: Stiffness, force: float = 0.0, moment: float = 0.0, increments: int = 12
) -> np.ndarray:
    """Rows of x, y and angle of a rod clamped at its first end and loaded at its last."""
    n, slopes = rod.count, potential(rod, resist)
    q = np.concatenate([rod.nodes, np.zeros(2 * n)])
    load = np.zeros(3 * n)
    load[2 * n - 1], load[3 * n - 1] = force, moment
    free = np.setdiff1d(np.arange(3 * n), [0, n, 2 * n])
    for share in np.arange(1, increments + 1) / increments:
        step = math.inf
        for _ in range(40):
            gradient, hessian = slopes(q)
            change = np.linalg.solve(hessian[np.ix_(free, free)], (share * load - gradient)[free])
            q[free] += change
            last, step = step, float(np.abs(change).max())
            if step < 1e-12 or (step < 1e-6 and step > last / 2):  # rounding, no more
                break
        else:
            raise AssertionError("Newton's iteration does not end")
    return q.reshape(3, n)


def orders(errors: list[float]) -> np.ndarray:
    """Orders of convergence between meshes of which each has twice as many elements."""
    return np.log2(np.array(errors[:-1]) / np.array(errors[1:]))


# -- strains ------------------------------------------------------------------------------------


@pytest.mark.parametrize("degree", DEGREES)
def test_weights_and_nodes_are_those_of_lobatto(degree: int):
    rod = rubber(elements=5, degree=degree)
    assert len(rod.nodes) == len(rod.weights) == rod.count == 5 * degree + 1
    for power in range(2 * degree):  # as far as the quadrature is exact
        exact = rod.length ** (power + 1) / (power + 1)
        assert rod.weights @ rod.nodes**power == pytest.approx(exact, rel=1e-13)
    mass, turning = rod.inertia
    volume = math.pi * 2e-3**2 * 48e-3
    assert mass.sum() == pytest.approx(1100 * volume, rel=1e-13)
    assert turning == pytest.approx(mass * 4e-3**2 / 16, rel=1e-13)


@pytest.mark.parametrize("degree", DEGREES)
@given(st.floats(-0.5, 3.0), st.just(0.0) | st.floats(-2.0, 2.0), st.floats(-3.2, 3.2))
@settings(max_examples=examples(25))
def test_constant_stretch_and_shear_are_exact(
    degree: int, stretch: float, shear: float, angle: float
):
    """A patch test: places linear in arc length, whatever the angle of the sections."""
    rod = rubber(elements=3, degree=degree)
    c, s = math.cos(angle), math.sin(angle)
    slope = np.array([c * (1 + stretch) - s * shear, s * (1 + stretch) + c * shear])
    places = np.vstack([np.outer(slope, rod.nodes), np.full(rod.count, angle)])
    found = strains(rod, places)
    expected = np.array([stretch, shear, 0.0])
    assert found == pytest.approx(expected[:, None] + 0 * found, abs=1e-10)
    gradient = potential(rod, Stiffness(2.0, 0.7, 1.0))(places.ravel())[0].reshape(3, -1)
    force = np.array([2.0 * c * stretch - 0.7 * s * shear, 2.0 * s * stretch + 0.7 * c * shear])
    assert gradient[:2, -1] == pytest.approx(force, abs=1e-10)
    assert np.abs(gradient[:2, 1:-1]).max(initial=0.0) < 1e-10
    if abs(shear) < 1e-9:  # the force runs along the rod: no moment inside either
        assert np.abs(gradient[2, 1:-1]).max(initial=0.0) < 1e-8


@pytest.mark.parametrize("degree", DEGREES)
def test_constant_curvature_is_exact_and_asks_for_moments_at_the_ends_only(degree: int):
    rod, curvature = rubber(elements=4, degree=degree), 40.0
    angle = curvature * rod.nodes
    places = np.vstack([np.sin(angle) / curvature, (1 - np.cos(angle)) / curvature, angle])
    assert strains(rod, places)[2] == pytest.approx(curvature, rel=1e-12)
    # no force anywhere, since neither stretching nor shearing resists
    gradient = potential(rod, Stiffness(0.0, 0.0, 1.0))(places.ravel())[0].reshape(3, -1)
    inner = np.abs(gradient[2, 1:-1]).max()
    assert inner < 1e-11 * curvature
    assert gradient[2, [0, -1]] == pytest.approx([-curvature, curvature], rel=1e-12)


# -- statics ------------------------------------------------------------------------------------


@pytest.mark.parametrize(("degree", "meshes", "ceiling"), [
    (1, (16, 32, 64), 2e-4), (2, (4, 8, 16), 1e-5), (3, (2, 4, 8), 1e-6),
])  # fmt: skip
def test_large_deflection_converges_to_the_elastica(
    degree: int, meshes: tuple[int, ...], ceiling: float
):
    """Order 2 degree at the tip, where stretching and shearing resist alike.

    Then the strain by a force is the force over that resistance whatever the section's angle: the
    exact shape is the elastica's, moved by it.
    """
    force, along, across = bent_cantilever(1.1)
    hard = 50.0
    errors = []
    for elements in meshes:
        rod = Rod(1.0, 0.1, 1.0, 1.0, elements=elements, degree=degree)
        tip = cantilever(rod, Stiffness(hard, hard, 1.0), force)[:, -1]
        errors.append(float(np.abs(tip - [along, across + force / hard, 1.1]).max()))
    assert orders(errors) == pytest.approx(2 * degree, abs=0.35), errors
    assert errors[-1] < ceiling


@pytest.mark.parametrize("degree", DEGREES)
def test_a_thick_rod_bends_as_the_equations_of_equilibrium_say(degree: int):
    """Rubber, whose section resists shear less than stretching: shot at the other end."""
    rod = Rod(1.0, 0.2, 1.0, 1.0, elements=12, degree=degree)
    resist, force = rod.stiffness(), 3.0 * rod.second_moment

    def slope(_: float, state: np.ndarray) -> list[float]:
        angle, moment = state[2:]
        c, s = math.cos(angle), math.sin(angle)
        a, b = 1 + force * s / resist.stretching, force * c / resist.shearing
        along = a * c - b * s
        return [along, a * s + b * c, moment / resist.bending, -force * along]

    def end(moment: float) -> np.ndarray:
        found = solve_ivp(slope, (0, 1), [0, 0, 0, moment], rtol=1e-12, atol=1e-14, method="DOP853")
        return found.y[:, -1]

    start: Any = brentq(lambda moment: end(moment)[3], 0.0, force, xtol=1e-15)
    tip = cantilever(rod, resist, force)[:, -1]
    assert np.abs(tip - end(start)[:3]).max() < {1: 2e-3, 2: 1e-6, 3: 1e-8}[degree]


@pytest.mark.parametrize(("degree", "meshes"), [(1, (8, 16, 32)), (2, (3, 6, 12)), (3, (2, 4, 8))])
def test_an_end_moment_bends_a_rod_into_a_circle(degree: int, meshes: tuple[int, ...]):
    curvature, errors = 1.5 * math.pi, []
    exact = np.array([math.sin(curvature), 1 - math.cos(curvature)]) / curvature
    for elements in meshes:
        rod = Rod(1.0, 0.1, 1.0, 1.0, elements=elements, degree=degree)
        places = cantilever(rod, Stiffness(1e4, 3e3, 1.0), moment=curvature)
        assert places[2] == pytest.approx(curvature * rod.nodes, abs=1e-9)
        assert np.abs(strains(rod, places)[:2]).max() < 1e-9  # no force, thus neither strain
        errors.append(float(np.abs(places[:2, -1] - exact).max()))
    assert orders(errors) == pytest.approx(2 * degree, abs=0.35), errors
    assert errors[-1] < {1: 2e-3, 2: 2e-5, 3: 1e-6}[degree]


@pytest.mark.parametrize("degree", DEGREES)
def test_slender_rods_do_not_lock(degree: int):
    force, along, across = bent_cantilever(1.1)
    errors = []
    for diameter in (1e-1, 1e-2, 1e-3, 1e-4):
        hard = 16 / diameter**2
        rod = Rod(1.0, diameter, 1.0, 1.0, elements=6, degree=degree)
        tip = cantilever(rod, Stiffness(hard, hard, 1.0), force)[:2, -1]
        errors.append(float(np.abs(tip - [along, across + force / hard]).max()))
    # what locks is too stiff by a factor (length / diameter)²
    assert max(errors) < {1: 3e-3, 2: 2e-5, 3: 5e-8}[degree], errors
    assert max(errors) < 1.001 * min(errors)


# -- the Model ----------------------------------------------------------------------------------


def forces_and_energy(rod: Rod) -> tuple[ca.Function, ca.Function]:
    """Forces on the places, and the energy, of a rod in a channel without contact or load."""
    model = channel_rod(rod, 11e-3, 0.5)
    x, p = pack(model.x), pack(model.p)
    still = [*(c.force for c in model.contacts), *(c.normal_force for c in model.contacts)]
    still = ca.vertcat(*(s for s in still if s is not None), pack(model.u))
    ode = ca.substitute(model.ode, still, ca.DM.zeros(still.numel()))
    mass, turning = rod.inertia
    inertia = np.concatenate([mass, mass, turning])
    forces = ca.DM(inertia) * ode[model.n_x // 2 :]
    energy = [model["strain_energy"], model["kinetic_energy"]]
    return ca.Function("forces", [x, p], [forces]), ca.Function("energy", [x, p], energy)


def random_state(rod: Rod, seed: int, moving: float = 0.0) -> np.ndarray:
    rng, n = np.random.default_rng(seed), rod.count
    q = np.concatenate([rod.nodes, np.zeros(2 * n)])
    q += rng.normal(0, np.repeat([1e-3, 1e-3, 0.3], n))
    return np.concatenate([q, moving * rng.normal(0, np.repeat([0.1, 0.1, 20.0], n))])


def test_stiffness_is_symmetric_and_knows_three_rigid_motions():
    for degree in DEGREES:
        rod = rubber(elements=3, degree=degree)
        hessian = potential(rod, rod.stiffness())(random_state(rod, 2)[: 3 * rod.count])[1]
        assert np.abs(hessian - hessian.T).max() < 1e-12 * np.abs(hessian).max()
        flat = potential(rod, Stiffness(1.0, 1.0, 1e-3))
        rest = np.concatenate([rod.nodes, np.zeros(2 * rod.count)])
        values = np.linalg.eigvalsh(flat(rest)[1])
        assert np.abs(values[:3]).max() < 1e-13 * values[-1]
        assert values[3] > 1e-6 * values[-1]  # nothing else, however few the Gauss points


def test_damping_takes_energy_and_nothing_else():
    """Power of the damping forces is the output, and no rigid motion feels them."""
    rod = rubber(elements=3, damping_time=1e-2)
    forces, _ = forces_and_energy(rod)
    model, half = channel_rod(rod, 11e-3, 0.5), 3 * rod.count
    power = ca.Function("power", [pack(model.x), pack(model.p)], [model["damping_power"]])
    x = random_state(rod, 3, moving=1.0)
    with_, without = [5e4, 1100.0, 1e-2, 0.5], [5e4, 1100.0, 0.0, 0.5]
    damping = np.array(forces(x, with_) - forces(x, without)).ravel()
    assert damping @ x[half:] == pytest.approx(float(power(x, with_)), rel=1e-12)
    assert damping @ x[half:] < 0
    q, n = x[:half], rod.count
    turning = np.concatenate([-q[n : 2 * n], q[:n], np.ones(n)])
    rigid = np.concatenate([q, 30 * turning + np.repeat([0.3, -0.2, 0.0], n)])
    assert np.array(forces(rigid, with_)).ravel() == pytest.approx(
        np.array(forces(rigid, without)).ravel(), rel=1e-9, abs=1e-12
    )


def test_discs_touch_and_rub_by_their_rims():
    """A disc that rolls on the upper wall does not slide; force and motion fit by virtual work."""
    rod = rubber(elements=1, degree=1)
    model = channel_rod(rod, 11e-3, 0.5)
    x = pack(model.x)
    gaps = ca.vertcat(*(c.gap for c in model.contacts if c.gap is not None))
    of = ca.Function("of", [x], [gaps, model.contact_velocities])
    state = dict(straight(rod), across=[1e-3, -2e-3])
    state |= {"along_rate": [0.2, 0.2], "angle_rate": [100.0, 100.0]}
    gap, speed = of(np.concatenate([state[s.name] for s in model.x]))
    assert np.array(gap).ravel() == pytest.approx([2.5e-3, 4.5e-3, 5.5e-3, 1.5e-3])
    assert np.array(speed).ravel() == pytest.approx([0.0, 0.4, 0.0, 0.4])
    moments = ca.jacobian(model.ode[-2:], model.forces)
    turning = rod.inertia[1]
    found = np.array(ca.evalf(ca.substitute(moments, pack(model.p), ca.DM([5e4, 1100, 0, 0.5]))))
    arm = 2e-3 / turning
    assert found == pytest.approx(
        np.array([[-arm[0], arm[0], 0, 0], [0, 0, -arm[1], arm[1]]]), rel=1e-12
    )


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"length": 0.0}, "length must be positive"),
        ({"damping_time": -1e-9}, "damping_time must be at least 0"),
        ({"poisson_ratio": 0.51}, "poisson_ratio must be above -1"),
        ({"elements": 0}, "elements must be"),
    ],
)
def test_rods_that_cannot_be_are_refused(changed: dict[str, Any], said: str):
    numbers: dict[str, Any] = dict.fromkeys(("length", "youngs_modulus", "density"), 1.0)
    with pytest.raises(ArgumentError, match=said):
        Rod(**numbers | {"diameter": 0.1} | changed)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("channel", "friction"), [(4e-3, 0.5), (math.inf, 0.5), (11e-3, 0.0), (11e-3, math.nan)]
)
def test_channels_that_do_not_fit_are_refused(channel: float, friction: float):
    with pytest.raises(ArgumentError):
        channel_rod(rubber(), channel, friction)


def test_a_filled_skin_resists_as_a_tube():
    """Area and second moment of the ring by quadrature; Cowper's shear of thin and full tubes."""
    rod = Rod(75e-3, 4e-3, 3e5, 1200.0, skin=0.3e-3)
    area = quad(lambda r: 2 * np.pi * r, 1.7e-3, 2e-3)[0]
    moment = quad(lambda r: np.pi * r**3, 1.7e-3, 2e-3)[0]
    assert rod.stiffness().stretching == pytest.approx(3e5 * area, rel=1e-12)
    assert rod.stiffness().bending == pytest.approx(3e5 * moment, rel=1e-12)
    assert rod.magnetised_area == pytest.approx(np.pi * 1.7e-3**2, rel=1e-12)
    thin = Rod(75e-3, 4e-3, 3e5, 1200.0, skin=1e-9)
    assert thin.shear_ratio == pytest.approx(2 * 1.5 / (4 + 3 * 0.5) / 3, rel=1e-6)
    solid, full = Rod(75e-3, 4e-3, 3e5, 1200.0), Rod(75e-3, 4e-3, 3e5, 1200.0, skin=2e-3)
    assert full.stiffness() == solid.stiffness()
    assert (solid.magnetised_area, full.magnetised_area) == (solid.area, 0.0)
    with pytest.raises(ArgumentError, match="above the radius; write at most"):
        Rod(75e-3, 4e-3, 3e5, 1200.0, skin=2.1e-3)
