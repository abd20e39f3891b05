"""Chains and driven bodies in the plane against formulas, other codes and their invariants."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np
import pytest
from effort import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.integrate import quad, solve_ivp
from shapes import rotated

import wormopt as wo
from wormopt.errors import ArgumentError, SolveError
from wormopt.model.friction import Coulomb, NoSlip, Spike, Viscous
from wormopt.model.model import Model, pack
from wormopt.model.planar_friction import Elliptic
from wormopt.simulation.moreau import MoreauJean
from wormopt.simulation.options import Smooth, Tolerance
from wormopt.simulation.simulate import simulate
from wormopt.simulation.walls import smooth_walls
from wormopt.study import load_scene
from wormopt.systems.chain.build import chain
from wormopt.systems.planar.dynamics.chain import Axes, chain_places, planar_chain
from wormopt.systems.planar.dynamics.driven import driven_shape, stop_of
from wormopt.systems.planar.dynamics.motion import energy_error, swing
from wormopt.systems.planar.obstacles import Disc, Wall
from wormopt.systems.planar.shape import Harmonics, chain_shape, rigid_shape
from wormopt.systems.shared.models import measure_works

NUMBERS: dict[str, Any] = {
    "mass": 1.0, "stiffness": 10.0, "damping": 1.0, "rest_length": 1.0,
    "bending_stiffness": 2.0, "bending_damping": 0.2,
}  # fmt: skip
DRAG = Axes(Viscous(0.5), Viscous(5.0))
SEEDS = st.integers(0, 10_000)


def b9(law: Any = DRAG, **changed: Any) -> Model:
    """The driven chain of three masses of benchmark B9, or one like it."""
    worm = planar_chain(2, **{**NUMBERS, "law": law, **changed})
    pushes = Harmonics([0, 0], [[0.0, 3 * np.sin(2)]], [[3.0, 3 * np.cos(2)]])  # type: ignore[arg-type]
    bends = Harmonics([0.0], [[1.5]], [[0.0]])  # type: ignore[arg-type]
    return swing(worm, np.pi, {"input": pushes, "torque": bends})


# -- the viscous chain -----------------------------------------------------------------------------


def test_the_driven_viscous_chain_is_that_of_the_literature() -> None:
    """Benchmark B9 of the theory, to its last digits."""
    found = simulate(b9(), 10.0, tolerance=Tolerance(1e-12, 1e-13)).end[:6].reshape(3, 2)
    known = [
        (1.892707706015, 0.827602291796),
        (0.963702246599, -0.134463713836),
        (-0.159119705005, -0.460838001518),
    ]
    assert_allclose(found, known, rtol=0, atol=2e-11)


def by_hand(n: int, numbers: dict[str, np.ndarray], u: Any, w: Any) -> Any:
    """Rates of a viscous chain, its forces written out: unit vectors and lever arms, no energy."""

    def rate(t: float, state: np.ndarray) -> np.ndarray:
        r, v = state.reshape(2, n + 1, 2)
        force = np.zeros((n + 1, 2))
        d = r[:-1] - r[1:]
        length = np.hypot(*d.T)
        e = d / length[:, None]
        left = np.stack([-e[:, 1], e[:, 0]], axis=1)
        dv = v[:-1] - v[1:]
        spin = np.sum(left * dv, axis=1) / length
        pull = numbers["c"] * (length - numbers["l0"]) + numbers["d"] * np.sum(e * dv, axis=1)
        pull -= u(t)
        force[:-1] -= pull[:, None] * e
        force[1:] += pull[:, None] * e
        psi = np.arctan2(d[:, 1], d[:, 0])
        phi = np.angle(np.exp(1j * (psi[:-1] - psi[1:])))
        bend = numbers["kappa"] * (phi - numbers["phi0"])
        bend += numbers["delta"] * (spin[:-1] - spin[1:]) - w(t)
        # a couple on a link is a pair of forces across it at its ends
        couple = np.append(-bend, 0.0) + np.append(0.0, bend)
        across = (couple / length)[:, None] * left
        force[:-1] += across
        force[1:] -= across
        look = np.concatenate([psi[:1], psi[1:] + phi / 2, psi[-1:]])
        ahead = np.stack([np.cos(look), np.sin(look)], axis=1)
        aside = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)
        force -= numbers["kt"] * np.sum(ahead * v, axis=1)[:, None] * ahead
        force -= numbers["kn"] * np.sum(aside * v, axis=1)[:, None] * aside
        return np.concatenate([v.ravel(), (force / numbers["m"][:, None]).ravel()])

    return rate


@settings(max_examples=examples(8))
@given(st.integers(1, 4), SEEDS)
def test_a_viscous_chain_moves_as_forces_written_by_hand_make_it(n: int, seed: int) -> None:
    """Random chains, other integrator, other formulas."""
    rng = np.random.default_rng(seed)
    draw = {
        name: rng.uniform(low, high, size)
        for name, low, high, size in (
            ("m", 0.5, 2, n + 1), ("c", 5, 15, n), ("d", 0, 2, n), ("l0", 0.8, 1.2, n),
            ("kappa", 1, 4, n - 1), ("delta", 0, 1, n - 1), ("phi0", -1, 1, n - 1),
        )
    }  # fmt: skip
    numbers: dict[str, Any] = {**draw, "kt": rng.uniform(0, 1), "kn": rng.uniform(0, 5)}
    places = chain_places(draw["l0"], rng.uniform(-1, 1, n - 1)) + rng.normal(size=2)
    speeds = rng.normal(size=(n + 1, 2))
    push, bend = rng.uniform(-1, 1, (3, n)), rng.uniform(-0.5, 0.5, (3, n - 1))

    def course(rows: np.ndarray) -> Any:
        return lambda t: rows[0] + rows[1] * np.cos(2 * t) + rows[2] * np.sin(2 * t)

    worm = planar_chain(
        n, mass=draw["m"], stiffness=draw["c"], damping=draw["d"], rest_length=draw["l0"],
        bending_stiffness=draw["kappa"], bending_damping=draw["delta"], rest_angle=draw["phi0"],
        law=Axes(Viscous(numbers["kt"]), Viscous(numbers["kn"])), position=places, velocity=speeds,
    )  # fmt: skip
    inputs = {"input": Harmonics(push[0], push[1:2], push[2:])}
    if n > 1:
        inputs["torque"] = Harmonics(bend[0], bend[1:2], bend[2:])
    motion = simulate(swing(worm, np.pi, inputs), 1.5, route="python")
    rate = by_hand(n, numbers, course(push), course(bend))
    start = np.concatenate([places.ravel(), speeds.ravel()])
    other = solve_ivp(rate, (0.0, 1.5), start, "DOP853", rtol=1e-11, atol=1e-12)
    assert_allclose(motion.end, other.y[:, -1], rtol=1e-8, atol=1e-8)


# -- held limits -----------------------------------------------------------------------------------


@settings(max_examples=examples(8))
@given(st.integers(1, 4), SEEDS)
def test_a_straight_chain_feels_what_the_chain_on_a_line_does(n: int, seed: int) -> None:
    """To round-off, at any state on the line, whatever its contacts do."""
    rng = np.random.default_rng(seed)
    numbers: dict[str, Any] = {
        name: rng.uniform(0.5, 2.0, n) for name in ("stiffness", "damping", "rest_length")
    }
    m = rng.uniform(0.5, 2.0, n + 1)
    x, v = np.cumsum(rng.uniform(0.5, 1.5, n + 1))[::-1], rng.normal(size=n + 1)
    u, F = rng.normal(size=n), rng.normal(size=n + 1)
    law = Coulomb(1.0, 2.0)
    line = chain(n, mass=m, **numbers, law=law)
    plane = planar_chain(n, mass=m, **numbers, bending_stiffness=1.0, law=Axes(law))

    def rates(model: Model, x0: np.ndarray) -> np.ndarray:
        symbols = [pack(model.x), pack(model.p), model["input"], model.forces]
        free = [*model.u][1:]
        function = ca.Function("f", [*symbols, pack(free)], [model.ode])
        p = np.concatenate([np.ravel(signal.value) for signal in model.p])  # type: ignore[arg-type]
        return np.array(function(x0, p, u, F, 0)).ravel()

    flat = np.zeros((2, n + 1, 2))
    flat[0, :, 0], flat[1, :, 0] = x, v
    found = rates(plane, flat.ravel()).reshape(2, n + 1, 2)
    assert np.all(found[:, :, 1] == 0.0)
    assert_allclose(found[:, :, 0].ravel(), rates(line, np.append(x, v)), rtol=1e-14, atol=1e-14)


ELLIPSE = pytest.param(Elliptic(0.5, 3.0, 1.5), "", marks=pytest.mark.slow)


@pytest.mark.parametrize(
    ("law", "suffix"),
    [*((Axes(Coulomb(0.5, 3.0), across), " along") for across in (None, NoSlip())), ELLIPSE],
)
def test_a_straight_worm_stops_and_starts_as_on_a_line(law: Any, suffix: str) -> None:
    """Dry friction: the same events, in the same order."""
    n, numbers = 2, {k: v for k, v in NUMBERS.items() if "bending" not in k}
    rows = np.array([[0.0, 6 * np.sin(2)], [6.0, 6 * np.cos(2)]])
    push = {"input": Harmonics(np.zeros(2), rows[:1], rows[1:])}
    flat = swing(planar_chain(n, **numbers, law=law), np.pi, push)
    line = swing(chain(n, **numbers, law=Coulomb(0.5, 3.0)), np.pi, push)
    a, b = (simulate(model, 6.0, route="python") for model in (flat, line))
    assert_allclose(a["position"][::2, -1], b["position"][:, -1], rtol=0, atol=1e-9)
    assert np.abs(a["position"][1::2]).max() < 1e-14
    told = [(e.name.removesuffix(suffix), e.kind, e.mode != 0) for e in a.events]
    assert told == [(e.name, e.kind, e.mode != 0) for e in b.events]
    assert len(told) > 10
    assert_allclose([e.time for e in a.events], [e.time for e in b.events], rtol=0, atol=1e-8)


LAWS = {
    "viscous": DRAG,
    "box": Axes(Coulomb(0.3, 0.6), Coulomb(1.5, 1.5)),
    "skid": Axes(Coulomb(0.3, 0.3), NoSlip()),
    "elliptic": Elliptic(0.3, 0.6, 1.5),
}


MOVES: dict[str, tuple[Callable[[np.ndarray], np.ndarray], float]] = {
    "turned and shifted": (lambda r: rotated(r, 0.9) + np.array([3.0, -2.0]), 1.0),
    "mirrored": (lambda r: r * [1.0, -1.0], -1.0),
}


@pytest.mark.slow
@pytest.mark.parametrize("how", MOVES)
@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_motions_move_with_their_start(law: Any, how: str) -> None:
    """Nothing in the plane knows where x points, and left and right are alike."""
    move, sign = MOVES[how]
    start = chain_places([1.0, 1.0], [0.4])
    worm = planar_chain(2, **NUMBERS, law=law, rest_angle=0.0)
    rows = np.array([[0.0, 3 * np.sin(2)], [3.0, 3 * np.cos(2)]])
    ends = []
    for places, s in ((start, 1.0), (move(start), sign)):
        inputs = {
            "input": Harmonics(np.zeros(2), rows[:1], rows[1:]),
            "torque": Harmonics(np.zeros(1), np.array([[1.5 * s]]), np.zeros((1, 1))),
        }
        x0 = {"position": places.ravel()}
        end = simulate(swing(worm, np.pi, inputs), 2.0, x0=x0, route="python").end
        ends.append(end[:6].reshape(3, 2))
    assert_allclose(move(ends[0]), ends[1], rtol=0, atol=1e-9)


@pytest.mark.parametrize("name", LAWS)
def test_energy_and_momentum_are_accounted_for(name: str) -> None:
    """Work of the actuators is dissipated or stored; the ground alone moves the centre."""
    model = measure_works(b9(LAWS[name], pull=(-0.1, 0.05), position=[[2, 0], [1, 0.3], [0, 0]]), 1)
    motion = simulate(model, 2.0, times=np.linspace(0, 2, 41), route="python")
    assert energy_error(motion, "energy") < 1e-9
    assert motion["ground_work"][0, -1] < 0
    symbols = motion.system.model
    mass = ca.repmat(ca.DM.ones(1, 3), 2, 1)
    v = ca.reshape(symbols["velocity"], 2, 3)
    gained = ca.jtimes(ca.sum2(mass * v), pack(symbols.x), symbols.ode)
    outer = ca.sum2(ca.reshape(symbols["ground_force"] + symbols["pull"], 2, 3))
    assert np.abs(motion.observe(gained - outer)).max() < 1e-12


# -- rods ------------------------------------------------------------------------------------------


@settings(max_examples=examples(10))
@given(SEEDS)
def test_rods_have_the_kinetic_energy_of_all_their_points(seed: int) -> None:
    """By quadrature along each rod, which stretches evenly."""
    rng = np.random.default_rng(seed)
    r, v = rng.normal(size=(2, 3, 2))
    m, rods = rng.uniform(0.1, 2, 3), rng.uniform(0.1, 2, 2)
    worm = planar_chain(2, **{**NUMBERS, "mass": m}, rod_mass=rods, position=r, velocity=v)
    motion = simulate(worm, 1e-9, route="python")
    known = np.sum(m[:, None] * v**2) / 2
    for j, rod in enumerate(rods):
        known += (
            rod / 2 * quad(lambda s, j=j: np.sum(((1 - s) * v[j] + s * v[j + 1]) ** 2), 0, 1)[0]
        )
    assert_allclose(motion["kinetic_energy"][0, 0], known, rtol=1e-12)


def test_rods_are_moved_by_the_inverse_of_their_mass_matrix() -> None:
    """The energy's Hessian by the rates, a dense solve, and the balance over time."""
    worm = planar_chain(3, **NUMBERS, rod_mass=[0.5, 1.0, 2.0], law=DRAG)
    v = worm["velocity"]
    M = ca.hessian(worm["kinetic_energy"], v)[0]
    push = ca.jacobian(worm.ode[8:], worm.forces)
    bare = planar_chain(3, **NUMBERS, law=DRAG)
    F = ca.jacobian(bare.ode[8:], bare.forces)  # the masses there are 1
    symbols = [pack(worm.x), pack(worm.p), pack(bare.x), pack(bare.p)]
    found = ca.Function("found", symbols, [M @ push, F])
    x = np.append(chain_places([1, 1, 1], [0.4, -0.3]).ravel(), np.zeros(8))
    values = [np.concatenate([np.ravel(s.value) for s in m.p]) for m in (worm, bare)]  # type: ignore[arg-type]
    a, b = found(x, values[0], x, values[1])
    assert_allclose(np.array(a), np.array(b), rtol=0, atol=1e-12)
    measured = measure_works(b9(rod_mass=0.7), 1.0)
    assert energy_error(simulate(measured, 3.0, route="python"), "energy") < 1e-10


# -- bodies of given shape -------------------------------------------------------------------------


def test_loads_of_a_driven_chain_vanish_behind_its_tail() -> None:
    """And what its actuators do is what the energy gains and the ground takes."""

    def course(t: ca.SX) -> ca.SX:
        lengths = ca.vertcat(1 + 0.2 * ca.sin(t), 1 + 0.3 * ca.sin(2 * t), 1.0)
        return ca.vertcat(lengths, 0.5 * ca.sin(t), 0.7 * ca.cos(3 * t))

    body = driven_shape(
        chain_shape(3), course, mass=[1, 2, 3, 4], inertia=0.3, law=DRAG, pull=(0.1, -0.2),
        velocity=(1.0, 0.3), turning=0.4,
    )  # fmt: skip
    measured = measure_works(body, 1.0)
    motion = simulate(measured, 4.0, times=np.linspace(0, 4, 81), route="python")
    assert np.abs(motion["left_over"]).max() < 1e-12
    assert np.abs(motion["torque"]).max() > 1
    assert energy_error(motion, "kinetic_energy") < 1e-10


@pytest.mark.slow
def test_a_driven_chain_does_what_a_free_one_does_with_its_loads() -> None:
    """Loads of the driven body, fed into the chain of masses, give the same motion."""
    lengths, bends = ([1.0, 1.1], [0.2, 0.1], [0.0, -0.3]), ([0.2], [0.3], [0.4])

    def course(t: ca.SX) -> ca.SX:
        parts = [np.append(a, b) for a, b in zip(lengths, bends, strict=True)]
        return ca.vertcat(
            *(a + b * ca.cos(2 * t) + c * ca.sin(2 * t) for a, b, c in zip(*parts, strict=True))
        )

    body = driven_shape(chain_shape(2), course, mass=[1.0, 2.0, 0.5], law=DRAG, velocity=(0.2, 0.1))
    motion = simulate(body, 1.0, times=np.linspace(0, 1, 3), dense=True, route="python")
    worm = planar_chain(
        2, mass=[1.0, 2.0, 0.5], stiffness=0.0, damping=0.0, rest_length=1.0, law=DRAG
    )
    f = ca.Function("f", [pack(worm.x), pack(worm.p), pack(worm.u)],
                    [ca.substitute(worm.ode, worm.forces, _viscous(worm))])  # fmt: skip
    p = np.concatenate([np.ravel(s.value) for s in worm.p])  # type: ignore[arg-type]

    def rate(t: float, x: np.ndarray) -> np.ndarray:
        at = motion.at(np.array([t]))
        return np.array(f(x, p, np.append(at["input"][:, 0], at["torque"][:, 0]))).ravel()

    start = np.append(motion["position"][:, 0], motion["velocity"][:, 0])
    other = solve_ivp(rate, (0.0, 1.0), start, rtol=1e-9, atol=1e-10)
    assert_allclose(other.y[:6, -1], motion["position"][:, -1], rtol=0, atol=1e-6)


def _viscous(worm: Model) -> ca.SX:
    return ca.vertcat(*(c.law.slip_force(c.velocity, 1) for c in worm.contacts))  # type: ignore[call-arg,union-attr]


def tripod(until: float, **changed: Any) -> Any:
    """The rigid tripod of benchmark B3."""
    angle = np.deg2rad([90, 210, 330])
    legs = rigid_shape(np.stack([np.cos(angle), np.sin(angle)], axis=1).tolist())
    numbers: dict[str, Any] = {"mass": 1.0, "law": Elliptic(1.0, 1.0, 1.0), "velocity": (1.0, 0.0)}
    return simulate(driven_shape(legs, **{**numbers, "turning": 1.0, **changed}), until)


@pytest.mark.slow
def test_a_tripod_comes_to_rest_about_one_of_its_legs() -> None:
    """Benchmark B3: the leg stops, the body turns about it, slowing by F / (sqrt(3) m R)."""
    motion = tripod(1.6)
    (stop,) = motion.events
    assert (stop.name, stop.kind) == ("mass 0", "stick")
    assert_allclose(stop.time, 1.370717870, rtol=0, atol=2e-9)
    left, slowing = motion["turning"][0, -1], 1 / np.sqrt(3)
    end = 1.6 + left / slowing
    assert_allclose(end, 1.65717084601, rtol=0, atol=1e-10)
    assert_allclose(left + slowing * (1.6 - stop.time), 0.165383703, rtol=0, atol=2e-9)
    turned = left**2 / (2 * slowing)
    assert_allclose(motion["angle"][0, -1] + turned, 0.82493561311, rtol=0, atol=1e-10)
    pivot = motion["position"][:2, -1]
    arm = rotated(motion["center"][:, -1] - pivot, turned)
    assert_allclose(pivot + arm, (0.79073130637, 0.17443620545), rtol=0, atol=1e-10)


@pytest.mark.slow
def test_rings_slide_on_turning_and_stop_at_once() -> None:
    """Benchmark B4, pi V / (2 mu g), is the limit of many points."""
    errors = []
    for points in (6, 12):
        angle = 2 * np.pi * np.arange(points) / points
        ring = rigid_shape(np.stack([np.cos(angle), np.sin(angle)], axis=1).tolist())
        friction = Elliptic(*(1 / points,) * 3)
        body = driven_shape(ring, mass=1 / points, law=friction, velocity=(1.0, 0.0), turning=1.0)
        stop = simulate(body, 1.7, route="python").events[-1]
        assert stop.kind == "stick"
        errors.append(abs(stop.time - np.pi / 2))
    assert errors[1] < 1e-3
    assert errors[1] < errors[0] / 4


@pytest.mark.parametrize(
    ("law", "velocity", "pull", "time", "place"),
    [
        (Elliptic(2.0, 2.0, 2.0), (0.0, 1.0), (1.0, 0.0), 2 / 3, (1 / 12, 4 / 15)),
        (Elliptic(1.5, 1.5, 1.5), (0.0, 1.0), (1.0, 0.0), 1.2, (0.2, 0.375)),
        (Elliptic(1.0, 1.0, 2.0), (1.0, 1.0), (0.0, 0.0), 1.21151159553,
         (0.682087730931, 0.327797363691)),
    ],
)  # fmt: skip
def test_blocks_stop_where_formula_and_quadrature_say(
    law: Elliptic, velocity: Any, pull: Any, time: float, place: Any
) -> None:
    """Benchmarks B1, under a load, and B2, on anisotropic ground."""
    found = stop_of(law, 1.0, velocity, pull)
    assert_allclose((found.time, *found.place), (time, *place), rtol=1e-11)
    point = rigid_shape([(0.0, 0.0)])
    block = driven_shape(point, mass=1.0, inertia=1.0, law=law, pull=pull, velocity=velocity)
    motion = simulate(block, 1.5 * time)
    (stop,) = motion.events
    assert_allclose(stop.time, time, rtol=0, atol=1e-9)
    assert_allclose(motion["center"][:, -1], place, rtol=0, atol=1e-10)
    assert np.all(motion["center_velocity"][:, -1] == 0)


@pytest.mark.parametrize("aside", [1e3, 1e6, 1e9])
def test_a_block_that_can_hardly_slide_aside_stops_where_the_formula_says(aside: float) -> None:
    """Without a pull both components of the velocity decay as exp(-F^2 T)."""
    found = stop_of(Elliptic(1.0, 1.0, aside), 1.0, (1.0, 1.0), (0.0, 0.0))
    corner = [k * np.log(aside) / aside**2 for k in (0.5, 1, 2, 4)]

    def integral(of: Callable[[float, float, float], float]) -> float:
        def integrand(T: float) -> float:
            ahead, across = np.exp(-T), np.exp(-(aside**2) * T)
            return of(ahead, across, np.hypot(ahead, aside * across))

        edges = [0.0, *corner, 1e-3, 1.0, 60.0]
        parts = pairwise(sorted(edges))
        return sum(quad(integrand, *part, epsabs=0, epsrel=1e-12, limit=200)[0] for part in parts)

    assert_allclose(found.time, integral(lambda _, __, psi: psi), rtol=1e-10)
    assert_allclose(found.place[0], integral(lambda ahead, _, psi: ahead * psi), rtol=1e-10)
    assert_allclose(found.place[1], integral(lambda _, across, psi: across * psi), rtol=1e-9)


@pytest.mark.parametrize("share", [0.5, 0.999999, 1 - 1e-9])
def test_a_pull_that_nearly_holds_stops_the_block_late(share: float) -> None:
    """Along a line: m v over what friction exceeds the pull by."""
    found = stop_of(Elliptic(1.0, 1.0, 2.0), 1.0, (1.0, 0.0), (share, 0.0))
    assert_allclose(found.time, 1 / (1 - share), rtol=1e-12)
    assert_allclose(found.place, (0.5 / (1 - share), 0.0), rtol=1e-12)


def test_a_scene_of_a_block_that_can_hardly_slide_aside_ends() -> None:
    result = wo.run(load_scene("planar_block", ["ground.sideways=1e9"]))
    assert result.status == "ok"
    # what it does aside is used up after v/F, the rest is a straight slide from speed 1
    assert_allclose(result.scalars["stop_time"].value, 1.0, rtol=0, atol=1e-8)
    assert_allclose(result.scalars["x_stop"].value, 0.5, rtol=0, atol=1e-8)


@settings(max_examples=examples(15))
@given(SEEDS)
def test_blocks_stop_where_a_time_without_end_says(seed: int) -> None:
    """Random ground, throw, heading and pull: events against a transformed time."""
    rng = np.random.default_rng(seed)
    law = Elliptic(*rng.uniform(0.5, 3.0, 3).tolist())
    angle, share = rng.uniform(0, 2 * np.pi), rng.uniform(0, 0.8)
    pull = 0.5 * share * np.array([np.cos(angle), np.sin(angle)])
    thrown = rng.normal(size=2)
    stop = stop_of(law, 1.3, tuple(thrown), tuple(pull))
    heading = rng.uniform(-3, 3)
    block = driven_shape(
        rigid_shape([(0.0, 0.0)]), mass=1.3, inertia=1.0, law=law, angle=heading,
        velocity=rotated(thrown, heading), pull=rotated(pull, heading),
    )  # fmt: skip
    motion = simulate(block, 1.2 * stop.time)
    assert_allclose(
        motion["center"][:, -1], rotated(np.array(stop.place), heading), rtol=0, atol=1e-8
    )
    assert_allclose(motion.events[-1].time, stop.time, rtol=1e-8)


# -- dry friction, other routes --------------------------------------------------------------------


@pytest.mark.slow
def test_the_smooth_law_comes_nearer_at_its_order() -> None:
    """4/5, that of a release under a growing load, as its width vanishes: see docs."""
    worm = b9(Elliptic(0.6, 1.2, 1.5))
    exact = simulate(worm, 4.0)
    assert len(exact.events) > 3
    errors = [
        np.abs(simulate(worm, 4.0, contact=Smooth(width)).end[:6] - exact.end[:6]).max()
        for width in (3e-4, 1e-4, 3e-5)
    ]
    slopes = np.diff(np.log(errors)) / np.diff(np.log([3e-4, 1e-4, 3e-5]))
    assert errors[-1] < 1e-3
    assert_allclose(slopes, 0.8, rtol=0, atol=0.1)


# -- obstacles -------------------------------------------------------------------------------------


def test_walls_and_discs_keep_masses_out() -> None:
    """A worm thrown at a wall and one at a disc, by walls that give way."""
    for obstacle in (Wall((2.5, 0.0), np.pi), Disc((3.2, 0.1), 0.7)):
        worm = planar_chain(
            1, **{k: v for k, v in NUMBERS.items() if "bending" not in k}, law=DRAG,
            obstacles=[obstacle], velocity=(2.0, 0.0), position=[[2.0, 0.0], [1.0, 0.0]],
        )  # fmt: skip
        soft = smooth_walls(worm, 1e4, smoothing=1e-5, relaxation=1e-2)
        motion = simulate(
            soft, 2.0, contact=Smooth(1e-3), times=np.linspace(0, 2, 201),
            tolerance=Tolerance(1e-6, 1e-8, max_steps=200_000),
        )  # fmt: skip
        places = motion["position"].T.reshape(-1, 2, 2)
        symbol = ca.SX.sym("r", 2)
        gap = ca.Function("gap", [symbol], [obstacle.gap(symbol)])
        gaps = np.array([[float(gap(r)) for r in row] for row in places])
        assert -0.02 < gaps.min() < 0.02  # it came, and did not pass
        assert np.isfinite(places).all()


def test_steps_of_moreau_and_jean_find_the_same_impact() -> None:
    """A single mass pair that hits a wall: places by both routes."""
    numbers = {k: v for k, v in NUMBERS.items() if "bending" not in k}
    start = {"velocity": (2.0, 0.0), "position": [[2.0, 0.0], [1.0, 0.0]]}
    worm = planar_chain(1, **numbers, obstacles=[Wall((2.5, 0.0), np.pi)], **start)
    by_steps = MoreauJean(worm).march(1.0, step=2e-4)
    soft = smooth_walls(worm, 1e5, smoothing=1e-6, relaxation=1e-2)
    motion = simulate(soft, 1.0, contact=Smooth(1e-3), tolerance=Tolerance(1e-6, 1e-8))
    assert_allclose(by_steps.states[:4, -1], motion.end[:4], rtol=0, atol=5e-3)


# -- what is refused -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"law": Coulomb(1.0, 1.0)}, "Elliptic"),
        ({"law": [DRAG]}, "one or 3"),
        ({"mass": [1.0, 2.0]}, "one number or 3"),
        ({"mass": -1.0}, "positive"),
        ({"bending_stiffness": -1.0}, "0 or above"),
        ({"position": [1.0, 2.0, 3.0]}, "position"),
        ({"velocity": [[np.nan, 0.0]] * 3}, "velocity"),
        ({"heading": "left"}, "heading"),
        ({"obstacles": [3]}, "obstacles"),
        ({"rod_mass": [1.0]}, "rod_mass"),
    ],
)
def test_wrong_numbers_are_refused(changed: dict[str, Any], words: str) -> None:
    with pytest.raises(ArgumentError, match=words):
        planar_chain(2, **{**NUMBERS, **changed})


def test_wrong_bodies_are_refused() -> None:
    """No inertia, no course, a course of other rows, laws that are none."""
    point = rigid_shape([(0.0, 0.0)])
    with pytest.raises(ArgumentError, match="inertia"):
        driven_shape(point, mass=1.0)
    with pytest.raises(ArgumentError, match="course"):
        driven_shape(chain_shape(2), mass=1.0)
    with pytest.raises(ArgumentError, match="rows"):
        driven_shape(chain_shape(2), lambda t: t, mass=1.0)
    with pytest.raises(ArgumentError, match="along"):
        Axes(along=3)  # type: ignore[arg-type]
    with pytest.raises(ArgumentError, match="radius"):
        Disc((0.0, 0.0), -1.0)
    with pytest.raises(ArgumentError, match="inputs"):
        swing(planar_chain(2, **NUMBERS), 1.0, {"input": Harmonics([0.0], [[0.0]], [[0.0]])})  # type: ignore[arg-type]
    with pytest.raises(SolveError):
        stop_of(Elliptic(1.0, 1.0, 1.0), 1.0, (1.0, 0.0), (2.0, 0.0))


def test_spikes_hold_back_and_pins_hold() -> None:
    """A worm of two spiked masses only goes ahead; a pinned tail stays where it is."""
    numbers = {k: v for k, v in NUMBERS.items() if "bending" not in k}
    push = {"input": Harmonics(np.zeros(1), np.zeros((1, 1)), np.array([[6.0]]))}
    spiked = swing(planar_chain(1, **numbers, law=Axes(Spike(), NoSlip())), np.pi, push)
    motion = simulate(spiked, 6.0, times=np.linspace(0, 6, 61), route="python")
    assert np.diff(motion["position"][::2], axis=1).min() > -1e-9
    assert motion["position"][2, -1] > 0.1
    pinned = planar_chain(2, **NUMBERS, law=[DRAG, DRAG, Axes(NoSlip(), NoSlip())], rest_angle=0.5)
    start = {"position": chain_places([1, 1], [-0.5]).ravel()}
    motion = simulate(pinned, 3.0, x0=start, route="python")
    assert_allclose(motion["position"][4:, -1], 0.0, rtol=0, atol=1e-12)
    assert abs(motion["angle"][0, -1] - 0.5) < 0.4
