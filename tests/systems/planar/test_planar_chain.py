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
from wormopt.model.planar_friction import AnisotropicCoulomb, Elliptic
from wormopt.simulation.options import Smooth, Tolerance
from wormopt.simulation.simulate import simulate
from wormopt.study import load_scene
from wormopt.systems.chain.build import chain
from wormopt.systems.planar.dynamics.chain import Axes, chain_places, planar_chain
from wormopt.systems.planar.dynamics.driven import driven_shape, stop_of
from wormopt.systems.planar.dynamics.motion import energy_error, swing
from wormopt.systems.planar.obstacles import Disc
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


# -- held limits -----------------------------------------------------------------------------------


BODIES = [
    pytest.param(law, "", marks=pytest.mark.slow)
    for law in (Elliptic(0.5, 3.0, 1.5), AnisotropicCoulomb(0.5, 3.0, 1.5))
]


@pytest.mark.parametrize(
    ("law", "suffix"),
    [*((Axes(Coulomb(0.5, 3.0), across), " along") for across in (None, NoSlip())), *BODIES],
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


# -- what is refused -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"law": Coulomb(1.0, 1.0)}, "Elliptic"),
        ({"law": [DRAG]}, "one or 3"),
        ({"mass": [1.0, 2.0]}, "one number or 3"),
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
