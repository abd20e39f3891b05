"""Natural vibrations of rods against beams in closed form and by scikit-fem."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np
import pytest
import scipy.linalg
from scipy.optimize import brentq

from tests.oracles.beams import thick_beam
from wormopt.analysis.vibration import VibrationModes, vibration_modes
from wormopt.errors import ArgumentError, SolveError, UnknownNameError
from wormopt.model.model import Model, Output, Signal
from wormopt.systems.channel.rod import Rod
from wormopt.systems.channel.rod_model import channel_rod

PINNED = {"across": [0, -1]}


def rubber(elements: int = 16, degree: int = 2, **changed: Any) -> Rod:
    numbers: dict[str, Any] = {"length": 48e-3, "diameter": 4e-3, "youngs_modulus": 5e4}
    numbers |= {"density": 1100.0, "elements": elements, "degree": degree} | changed
    return Rod(**numbers)


def slender(density: float, length: float = 48e-3, elements: int = 20, by: float = 8.0) -> Rod:
    """A rod of the same frequencies by the theory of thin beams, thinner and lighter."""
    return rubber(elements, length=length, diameter=4e-3 / by, density=density / by**2)


def bending(modes: VibrationModes) -> np.ndarray:
    """Frequencies of the vibrations across, without rigid motions."""
    along, across = (np.abs(modes.shapes[name]).max(axis=0) for name in ("along", "across"))
    return modes.frequencies[(modes.frequencies > 0) & (across > along)]


def found(rod: Rod, held: Mapping[str, Sequence[int]] | None = None, count: int = 12) -> np.ndarray:
    modes = vibration_modes(channel_rod(rod, 11e-3, 0.5), held, count=count)
    assert modes.residual < 1e-13
    return bending(modes)


def thin_beam(rod: Rod, wave_number: float) -> float:
    """Frequency by Euler and Bernoulli of k times the length."""
    speed = math.sqrt(rod.youngs_modulus / rod.density) * rod.diameter / 4
    return (wave_number / rod.length) ** 2 * speed / (2 * math.pi)


# free ends: cos(k l) cosh(k l) = 1
FREE_ENDS: Any = brentq(lambda k: math.cos(k) - 1 / math.cosh(k), 4.5, 5.0, xtol=1e-15)


@pytest.mark.parametrize(
    ("density", "free", "pinned"),
    [(1100.0, 10.42, 4.596), (1500.0, 8.92, 3.936), (2500.0, 6.91, 3.049)],
)
def test_slender_rods_vibrate_as_thin_beams(density: float, free: float, pinned: float):
    rod = slender(density)
    without, held = found(rod), found(rod, PINNED)
    assert without[0] == pytest.approx(free, rel=1e-3)
    assert held[0] == pytest.approx(pinned, rel=1e-3)
    assert without[0] == pytest.approx(thin_beam(rod, FREE_ENDS), rel=1e-3)
    for k in (1, 2, 3):
        assert held[k - 1] == pytest.approx(thin_beam(rod, k * math.pi), rel=3e-3)


@pytest.mark.parametrize(("density", "pitch"), [(1100.0, 105.9), (1500.0, 90.7), (2500.0, 70.2)])
def test_one_pitch_of_the_coils(density: float, pitch: float):
    """By the theory of thin beams; the rod itself is 2.5 diameters long there and much slower."""
    rod = slender(density, length=10e-3, by=40.0)
    assert found(rod, PINNED)[0] == pytest.approx(pitch, rel=1e-3)
    thick = rubber(16, length=10e-3, density=density)
    frequency = found(thick, PINNED)[0]
    assert frequency == pytest.approx(thick_beam(thick, 1), rel=2e-6)
    assert 0.7 < frequency / pitch < 0.85


def test_held_at_every_pitch_each_span_vibrates_like_one():
    """Spans between neighbours move against each other: as long as pinned ones, and as slow."""
    rod = rubber(20, 3, length=50e-3)
    at = [int(np.abs(rod.nodes - k * 10e-3).argmin()) for k in range(6)]
    assert rod.nodes[at] == pytest.approx(np.arange(6) * 10e-3)
    assert found(rod, {"across": at})[0] == pytest.approx(thick_beam(rod, 5), rel=3e-6)


@pytest.mark.parametrize(
    ("degree", "coarse", "ceiling"), [(1, 8, 2e-3), (2, 8, 2e-6), (3, 3, 3e-7)]
)
def test_frequencies_converge_at_twice_the_degree(degree: int, coarse: int, ceiling: float):
    errors = []
    for elements in (coarse, 2 * coarse, 4 * coarse):
        rod = rubber(elements, degree)
        errors.append([found(rod, PINNED)[k - 1] / thick_beam(rod, k) - 1 for k in (1, 2)])
    slopes = np.diff(np.log2(np.abs(errors)), axis=0)
    assert slopes == pytest.approx(-2.0 * degree, abs=0.15), errors
    assert np.abs(errors[-1]).max() < ceiling


def test_waves_along_the_rod_have_the_speed_of_sound():
    rod = rubber(16)
    modes = vibration_modes(channel_rod(rod, 11e-3, 0.5), count=16)
    along, across = (np.abs(modes.shapes[name]).max(axis=0) for name in ("along", "across"))
    stretching = modes.frequencies[(modes.frequencies > 0) & (along > across)]
    speed = math.sqrt(rod.youngs_modulus / rod.density)
    assert stretching[0] == pytest.approx(speed / (2 * rod.length), rel=1e-6)


def test_rigid_motions_are_exactly_zero():
    model = channel_rod(rubber(), 11e-3, 0.5)
    held = [None, {"across": [0]}, PINNED, {"along": [0], "across": [0], "angle": [0]}]
    assert [int(np.sum(vibration_modes(model, h).frequencies == 0)) for h in held] == [3, 2, 1, 0]


def test_shapes_are_orthonormal_in_the_mass():
    rod = rubber()
    modes = vibration_modes(channel_rod(rod, 11e-3, 0.5), PINNED, count=6)
    shapes = np.vstack([modes.shapes[name] for name in ("along", "across", "angle")])
    mass = np.concatenate([rod.inertia[0], rod.inertia[0], rod.inertia[1]])
    assert shapes.T @ (mass[:, None] * shapes) == pytest.approx(np.eye(6), abs=1e-10)
    assert np.all(modes.shapes["across"][[0, -1]] == 0)
    sine = modes.shapes["across"][:, 1] / np.abs(modes.shapes["across"][:, 1]).max()
    assert np.abs(sine) == pytest.approx(np.sin(math.pi * rod.nodes / rod.length), abs=1e-5)


# -- scikit-fem, another route ------------------------------------------------------------------


def line(elements: int) -> Any:
    return pytest.importorskip("skfem").MeshLine(np.linspace(0, 1, elements + 1))


def eigenfrequencies(K: Any, M: Any, free: np.ndarray | None = None) -> np.ndarray:
    dense = [matrix.toarray() for matrix in (K, M)]
    if free is not None:
        dense = [matrix[np.ix_(free, free)] for matrix in dense]
    values = scipy.linalg.eigh(*dense, eigvals_only=True)
    return np.sqrt(np.maximum(values, 0)) / (2 * math.pi)


def _bent(u: Any, v: Any, _: Any) -> Any:
    return u.hess[0, 0] * v.hess[0, 0]


def _moved(u: Any, v: Any, _: Any) -> Any:
    return u * v


def hermite(rod: Rod, pinned: bool) -> np.ndarray:
    """The thin beam on Hermite elements, in units of the length."""
    skfem = pytest.importorskip("skfem")
    basis = skfem.Basis(line(24), skfem.ElementLineHermite())
    K = skfem.BilinearForm(_bent).assemble(basis)
    M = skfem.BilinearForm(_moved).assemble(basis)
    free = basis.complement_dofs(basis.get_dofs().all("u")) if pinned else None
    scale = rod.stiffness().bending / (rod.density * rod.area * rod.length**4)
    return eigenfrequencies(K, M, free) * math.sqrt(scale)


def timoshenko(rod: Rod, pinned: bool) -> np.ndarray:
    """The thick beam: deflection and angle on elements of degree 2 with full quadrature."""
    skfem = pytest.importorskip("skfem")
    basis = skfem.Basis(line(80), skfem.ElementLineP2() * skfem.ElementLineP2())
    resist, length = rod.stiffness(), rod.length
    bend, shear = resist.bending / length**2, resist.shearing
    mass, turning = (rod.density * part for part in (rod.area * length**2, rod.second_moment))

    @skfem.BilinearForm
    def stiffness(w: Any, a: Any, w_: Any, a_: Any, _: Any) -> Any:
        sheared = (w.grad[0] - a) * (w_.grad[0] - a_)
        return shear * sheared + bend * a.grad[0] * a_.grad[0]

    @skfem.BilinearForm
    def inertia(w: Any, a: Any, w_: Any, a_: Any, _: Any) -> Any:
        return mass * w * w_ + turning * a * a_

    K, M = stiffness.assemble(basis), inertia.assemble(basis)
    free = basis.complement_dofs(basis.get_dofs().all("u^1")) if pinned else None
    return eigenfrequencies(K, M, free)


@pytest.mark.parametrize("pinned", [False, True])
@pytest.mark.parametrize(
    ("other", "build", "agree"),
    [
        # shear makes the third frequency at l/d = 300 slower by 2e-4
        (hermite, lambda: slender(1100.0, elements=40, by=25.0), 3e-4),
        (timoshenko, lambda: rubber(20, 3), 2e-6),
    ],
)
def test_another_code_finds_the_same_frequencies(
    other: Callable[[Rod, bool], np.ndarray], build: Callable[[], Rod], agree: float, pinned: bool
):
    rod = build()
    theirs = other(rod, pinned)
    theirs = theirs[theirs > 1e-3 * theirs[3]]
    mine = found(rod, PINNED if pinned else None)
    assert mine[:3] == pytest.approx(theirs[:3], rel=agree)


# -- refusals -----------------------------------------------------------------------------------


def moving(place: str, q: ca.SX, v: ca.SX, stored: ca.SX, kinetic: ca.SX) -> Model:
    """Places of mass 1 that a stored energy moves."""
    energies = [Output("strain_energy", stored), Output("kinetic_energy", kinetic)]
    states = [Signal(place, ca.vec(q), value=0.0), Signal("rate", ca.vec(v), value=0.0)]
    rates = ca.vertcat(ca.vec(v), -ca.vec(ca.gradient(stored, q)))
    return Model("moving", states, rates, outputs=energies)


def pendulum(sign: float = 1.0, mass: float = 1.0) -> Model:
    q, v = ca.SX.sym("q"), ca.SX.sym("v")
    return moving("angle", q, v, -sign * ca.cos(q), mass * v * v / 2)


def test_a_model_without_places_or_energies_is_refused():
    with pytest.raises(ArgumentError, match="coordinates, followed by their rates"):
        vibration_modes(Model("decay", [Signal("x", x := ca.SX.sym("x"))], -x))
    bare = pendulum()
    with pytest.raises(UnknownNameError):
        vibration_modes(Model("bare", bare.x, bare.ode))


def test_states_that_are_not_stable_are_refused():
    assert vibration_modes(pendulum()).frequencies == pytest.approx(1 / (2 * math.pi))
    for model, angle in ((pendulum(-1.0), 0.0), (pendulum(), 3.0)):
        with pytest.raises(ArgumentError, match="unstable"):
            vibration_modes(model, x0={"angle": angle})


@pytest.mark.parametrize(
    ("held", "said"), [({"angle": [1]}, "has 1 entries"), ({"angle": [0]}, "leave at least one")]
)
def test_what_cannot_be_held_is_refused(held: dict[str, list[int]], said: str):
    with pytest.raises(ArgumentError, match=said):
        vibration_modes(pendulum(), held)
    with pytest.raises(UnknownNameError):
        vibration_modes(pendulum(), {"rate": [0]})


def test_places_without_mass_and_no_frequencies_are_refused():
    with pytest.raises(ArgumentError, match="no mass"):
        vibration_modes(pendulum(mass=0.0))
    with pytest.raises(ArgumentError, match="count"):
        vibration_modes(pendulum(), count=0)


def test_vibrations_that_rounding_hides_are_not_told_as_rigid():
    """Held at both ends, a thread of 10,000 diameters has slow vibrations, no frequency of 0."""
    thread = rubber(10, 4, diameter=48e-7)
    model = channel_rod(thread, 11e-3, 0.5)
    held = {"along": list(range(thread.count)), **PINNED}
    modes = vibration_modes(model, held)
    assert modes.frequencies[0] == 0.0
    assert thin_beam(thread, math.pi) < modes.rounding
    with pytest.raises(SolveError, match=r"rounding hides .* less slender"):
        vibration_modes(model, held, rigid=0)
    stiff = rubber(10, 4)
    held["along"] = list(range(stiff.count))
    modes = vibration_modes(channel_rod(stiff, 11e-3, 0.5), held, rigid=0)
    assert 0 < modes.rounding < 1e-3 * modes.frequencies[0]


# -- many places ----------------------------------------------------------------------------------

MANY = 400


def chain(stretch: Callable[[ca.SX], ca.SX], spring: float = 1.0, mass: float = 1.0) -> Model:
    """Equal masses in a row; the last one's may differ, and all springs' stiffness."""
    q, v = ca.SX.sym("q", MANY), ca.SX.sym("v", MANY)
    masses = ca.vertcat(ca.DM.ones(MANY - 1), mass)
    stored = spring * ca.sumsqr(stretch(q)) / 2
    return moving("place", q, v, stored, ca.dot(masses, v * v) / 2)


def row(q: ca.SX) -> ca.SX:
    """The first mass is tied to a wall."""
    return q - ca.vertcat(0, q[:-1])


def ring(q: ca.SX) -> ca.SX:
    return q - ca.vertcat(q[-1], q[:-1])


def known_ring(count: int) -> np.ndarray:
    """All but one of a ring's vibrations come in pairs, of one frequency."""
    waves = (np.arange(count) + 1) // 2
    return 2 * np.sin(math.pi * waves / MANY) / (2 * math.pi)


def test_the_slow_vibrations_of_many_masses():
    odd = 2 * np.arange(6) + 1
    known = 2 * np.sin(math.pi * odd / (2 * (2 * MANY + 1))) / (2 * math.pi)
    modes = vibration_modes(chain(row), count=6, rigid=0)
    assert modes.frequencies == pytest.approx(known, rel=1e-9)
    assert modes.residual < 1e-14
    at = np.arange(1, MANY + 1)
    sine = np.sin(math.pi * odd[:, None] * at / (2 * MANY + 1))
    shapes = np.abs(sine @ modes.shapes["place"]) / np.linalg.norm(sine, axis=1)[:, None]
    assert shapes == pytest.approx(np.eye(6), abs=1e-8)


@pytest.mark.parametrize("count", [4, 5, 6, 11, 30])
def test_of_equal_frequencies_none_is_passed_by(count: int):
    model = chain(ring)
    modes = vibration_modes(model, count=count, rigid=1)
    assert modes.frequencies == pytest.approx(known_ring(count), rel=1e-9)
    shapes = modes.shapes["place"]
    assert shapes.T @ shapes == pytest.approx(np.eye(count), abs=1e-8)


def test_many_places_one_without_mass_or_springs_that_push():
    with pytest.raises(ArgumentError, match="no mass"):
        vibration_modes(chain(row, mass=0.0))
    with pytest.raises(ArgumentError, match="unstable"):
        vibration_modes(chain(row, spring=-1.0))


def test_a_model_may_be_asked_again_about_another_state():
    q, v = ca.SX.sym("q", 2), ca.SX.sym("v", 2)
    model = moving("angle", q, v, -ca.sum1(ca.cos(q)), v.T @ v / 2)
    for angle in (0.0, 1.0):
        found = vibration_modes(model, x0={"angle": [angle, 0.0]}).frequencies
        assert found == pytest.approx(np.sqrt([math.cos(angle), 1.0]) / (2 * math.pi))


def test_many_rigid_motions_leave_the_others_their_digits():
    """Loose chains of equal masses on springs: w = 2 sin(pi j / 2 n), of each chain for itself."""
    chains, n = 5, 50
    q, v = ca.SX.sym("q", n, chains), ca.SX.sym("v", n, chains)
    loose = moving("q", q, v, ca.sumsqr(q[1:, :] - q[:-1, :]) / 2, ca.sumsqr(v) / 2)
    found = vibration_modes(loose, count=8, rigid=chains)
    np.testing.assert_array_equal(found.frequencies[:chains], 0.0)
    right = 2 * math.sin(math.pi / (2 * n)) / (2 * math.pi)
    np.testing.assert_allclose(found.frequencies[chains:], right, rtol=1e-11)
    assert found.residual < 1e-13
