"""A float on a film over coils: what it keeps, its limits, and the kind "coil-film" with it."""

from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from outcomes import refusals, refused
from scipy.integrate import solve_ivp

import wormopt as wo
from tests.oracles.by_riding import Ride
from wormopt.magnetics.hydrostatics import Fluid, Linear
from wormopt.model.model import Model
from wormopt.simulation.options import Tolerance
from wormopt.study.scene import load_scene
from wormopt.systems.coils.film import Ends, Float, Layer, floated_film

OIL = Fluid(1200.0, 0.03, Linear(0.35))
FOAM = Float(0.012, 3.6e-3, 1e-6, edge=4e-3)
PLACES = 0.0251 + 0.04 / 256 * np.array([0.0, 0.13, 0.31, 0.5, 0.77])


def bent(h: ca.SX, slope: ca.SX) -> Any:
    """Some pull, which depends on height, slope and place."""
    return 8 * ca.sin(ca.DM(np.arange(h.numel()))) + 3e3 * h + 2 * slope**2


def numbers_of(model: Model) -> ca.Function:
    """All of the model as a function of its states."""
    x = ca.vertcat(*(signal.symbol for signal in model.x))
    energy = model["energy"]
    rate = ca.jtimes(energy, x, model.ode)
    outputs = [model[name] for name in ("thickness", "flow", "shear", "push", "pressed")]
    return ca.Function("all", [x], [model.ode, rate, *outputs])


def state(layer: Layer, h: np.ndarray, X: float, V: float) -> np.ndarray:
    return np.concatenate([layer.volume(h * layer.depth / h.mean()), [X, V, 0.0, 0.0]])


@lru_cache
def waved(ends: Ends, stiffness: float) -> tuple[Layer, ca.Function]:
    layer = Layer(OIL, 0.05, 1e-3, 0.04, 24, ends=ends)
    plate = Float(0.012, 3.6e-3, stiffness, edge=4e-3)
    return layer, numbers_of(floated_film(layer, bent, plate))


@given(
    seed=st.integers(0, 2**32 - 1),
    ends=st.sampled_from(["walls", "periodic"]),
    stiffness=st.sampled_from([0.0, 1e-6, 1e-2]),
    at=st.floats(-0.01, 0.05),
)
def test_energy_falls_by_what_is_dissipated_to_round_off(
    seed: int, ends: Ends, stiffness: float, at: float
) -> None:
    layer, evaluate = waved(ends, stiffness)
    rng = np.random.default_rng(seed)
    x = state(layer, np.exp(rng.normal(0, 0.5, 24)), at, rng.normal(0, 0.02))
    ode, rate, *_ = (np.array(value).ravel() for value in evaluate(x))
    work, lost = ode[-2:]
    size = abs(work) + lost + np.abs(ode[-3] * 3.6e-3 * x[-3])
    assert lost >= 0
    assert rate[0] == pytest.approx(work - lost, abs=1e-9 * size)


def test_nothing_moves_a_float_on_a_flat_film() -> None:
    layer = Layer(OIL, 0.05, 1e-3, 0.04, 40)
    evaluate = numbers_of(floated_film(layer, lambda h, slope: 0 * h, FOAM))
    for X in (0.01, 0.0123, 0.02, 0.0287):
        _, _, _, _, _, push, _ = evaluate(state(layer, np.ones(40), X, 0.0))
        assert abs(float(push)) < 1e-15


def test_below_a_film_without_end_flow_is_that_of_couette() -> None:
    """All of the film covered: Q = h V / 2, and a shear of eta V / h."""
    layer = Layer(OIL, 0.05, 1e-3, 0.04, 40, ends="periodic")
    evaluate = numbers_of(floated_film(layer, lambda h, slope: 0 * h, Float(0.06, 1e-3, edge=1e-4)))
    _, _, _, flow, shear, *_ = evaluate(state(layer, np.ones(40), 0.02, 0.03))
    assert np.array(flow) == pytest.approx(1e-3 * 0.03 / 2, rel=1e-12)
    assert float(shear) == pytest.approx(-0.05 * 0.03 / 1e-3 * 0.04, rel=1e-12)


def test_a_mirror_shows_the_mirrored_motion() -> None:
    layer = Layer(OIL, 0.05, 1e-3, 0.04, 40)
    evaluate = numbers_of(floated_film(layer, lambda h, slope: 3e3 * h, FOAM))
    h = 1 + 0.3 * np.sin(np.linspace(0, 7, 40))
    one = np.array(evaluate(state(layer, h, 0.013, 0.02))[0]).ravel()
    other = np.array(evaluate(state(layer, h[::-1], 0.027, -0.02))[0]).ravel()
    assert one[:39] == pytest.approx(-other[:39][::-1], rel=1e-9)
    assert one[39:41] == pytest.approx(-other[39:41], rel=1e-9)


def test_the_film_bears_what_pushes_the_float_at_second_order() -> None:
    gaps = []
    for cells in (128, 256, 512):
        layer = Layer(OIL, 0.05, 1e-3, 0.04, cells)
        evaluate = numbers_of(floated_film(layer, lambda h, slope: 0 * h, FOAM))
        h = (
            1
            + 0.2 * np.cos(np.pi * layer.places / 0.04)
            + 0.1 * np.cos(3 * np.pi * layer.places / 0.04)
        )
        *_, push, pressed = evaluate(state(layer, h, 0.0251, 0.0))
        gaps.append(abs(float(push) - float(pressed)) / abs(float(push)))
    assert np.log2(np.array(gaps[:-1]) / gaps[1:]) == pytest.approx(2.0, abs=0.3)
    assert gaps[-1] < 1e-4


def settled(cargo: Float, fluid: Fluid, cells: int = 120) -> np.ndarray:
    """Thickness after so long that nothing moves, the float in the middle."""
    layer = Layer(fluid, 0.05, 1e-3, 0.06, cells)
    motion = wo.simulate(
        floated_film(layer, lambda h, slope: 0 * h, cargo), 2000.0, x0={"position": 0.03},
        times=np.array([0.0, 2000.0]), route="cvodes", tolerance=Tolerance(1e-8, 1e-8),
    )  # fmt: skip
    # cells of half a millimetre are not quite alike to it
    assert motion["position"][0, -1] == pytest.approx(0.03, abs=0.5e-3)
    return motion["thickness"][:, -1]


@pytest.mark.slow
@pytest.mark.parametrize("stiffness", [0.0, 1e-2])
def test_it_displaces_what_it_weighs(stiffness: float) -> None:
    """Archimedes, without surface tension; one that bends sinks by mass over density and length."""
    h = settled(Float(0.012, 3.6e-3, stiffness, edge=3e-3), Fluid(1200.0, 1e-7, Linear(0.35)))
    assert np.sum(h[0] - h) * 0.06 / 120 == pytest.approx(3.6e-3 / 1200, rel=1e-6)
    if not stiffness:
        assert h[0] - h[60] == pytest.approx(3.6e-3 / 1200 / 0.012, rel=2e-3)


@pytest.mark.slow
@pytest.mark.parametrize("edge", [6e-3, 3e-3, 1.5e-3])
def test_menisci_bear_a_part_of_a_stiff_float(edge: float) -> None:
    """Weight = rho g d l + 2 gamma tan(slope), the slopes being d over the capillary length.

    The float is as long as it is held straight: up to where its bending is surface tension's,
    B A u^9 = gamma (f u)^2 with A = 55.
    """
    stiffness, gamma = 1e-2, OIL.surface_tension
    h = settled(Float(0.012, 3.6e-3, stiffness, edge=edge), OIL, 240)
    bent = (gamma * edge**2 / (55 * stiffness)) ** (1 / 7)
    straight = 0.012 + edge * (1 - 2 * bent)
    known = 3.6e-3 * OIL.gravity / (OIL.weight * straight + 2 * (gamma * OIL.weight) ** 0.5)
    # the less exact, the longer the way over which it bends
    assert 0 < 1 - (h[0] - h[120]) / known < 5 * edge


def carried(length: float, cells: int, delta: float, end: float) -> tuple[float, float]:
    """Way of a light float on a cosine wave, and the change of the wave, in the film's units."""
    eps, weight, tension = 1e-4, 3.0, 1e-4
    fluid = Fluid(1.0, tension / eps**3, Linear(0.1), gravity=weight / eps**3)
    step = 2 * np.pi / cells
    layer = Layer(fluid, 1.0, eps, 2 * np.pi, cells, start=-step / 2, ends="periodic")
    t = ca.SX.sym("t")
    xi = t - ca.DM(layer.places)
    c, s = ca.cos(xi), ca.sin(xi)
    flow = 3 * delta * s * (2 + delta * c) / ((2 + delta**2) * (1 + delta * c) ** 2)
    given_ = (weight + tension) * delta * c - flow
    film = floated_film(
        layer, lambda h, slope: given_ / eps**2, Float(length, 1e-7, edge=length), t=t
    )
    start = 1 + delta * np.cos(layer.places)
    motion = wo.simulate(
        film, end, x0={"volume": layer.volume(eps * start / start.mean()), "position": 1.0},
        route="cvodes", tolerance=Tolerance(1e-8, 1e-8, max_steps=100_000),
    )  # fmt: skip
    wave = 1 + delta * np.cos(end - layer.places)
    change = np.abs(motion["thickness"][:, -1] / eps - wave).max()
    return float(motion["position"][0, -1]), float(change)


@pytest.mark.slow
def test_a_small_light_float_goes_with_the_surface() -> None:
    delta, end = 0.3, 2 * np.pi
    C = -2 * (1 - delta**2) / (2 + delta**2)
    known = solve_ivp(
        lambda t, x: 1.5 * (1 + C / (1 + delta * np.cos(t - x))), (0, end), [1.0],
        rtol=1e-12, atol=1e-12, method="DOP853",
    ).y[0, -1]  # fmt: skip
    (far, rough), (near, close) = (carried(length, 128, delta, end) for length in (0.8, 0.4))
    # its weight, a hundredth of the film's below it, leaves what length does not
    assert np.log2((known - far) / (known - near)) == pytest.approx(1.8, abs=0.5)
    assert (4 * near - far) / 3 == pytest.approx(known, abs=1e-2)
    assert close < rough < 0.02


def heaped(x: Any, t: Any, library: Any = np) -> Any:
    """Pull that comes along at 6 mm/s, in Pa."""
    xi = 2 * np.pi * (x - 0.015 - 0.006 * t) / 0.06
    return 25 * library.exp(3 * (library.cos(xi) - 1))


def passed(cells: int) -> float:
    """Place of a stiff float 3 s after a heap began to come up behind it and lift it."""
    layer, t = Layer(OIL, 0.05, 1e-3, 0.06, cells, ends="periodic"), ca.SX.sym("t")
    pull = heaped(ca.DM(layer.places), t, ca)
    plate = Float(0.012, 3.6e-3, 3e-4, edge=8e-3)
    motion = wo.simulate(
        floated_film(layer, lambda h, slope: pull, plate, t=t), 3.0, x0={"position": 0.03},
        route="cvodes", tolerance=Tolerance(1e-7, 1e-7, max_steps=100_000),
    )  # fmt: skip
    return float(motion["position"][0, -1])


@pytest.mark.slow
def test_a_stiff_float_goes_as_it_does_in_its_own_frame() -> None:
    """Order 2 in the cells, whose end no stiffness sticks to; 8 mm of way are right to 3e-6 m."""
    ride = Ride(heaped, 1200.0, 0.03, 0.05, 1e-3, 0.06, 0.012, 8e-3, 3.6e-3, 3e-4)
    known = ride.after(3.0, 0.03, 160, 1e-6)
    off = np.abs(np.array([passed(cells) for cells in (64, 128, 256)]) - known)
    assert np.log2(off[0] / off[1]) == pytest.approx(2.0, abs=0.4)
    assert off[2] < 3e-6


@pytest.mark.slow
@pytest.mark.parametrize("stiffness", [1e-6, 3e-4])
def test_the_stiffness_of_its_ends_is_felt_at_second_order(stiffness: float) -> None:
    """A stiff float pushes what its bent film bears, wherever between the cells it is."""
    gaps = []
    for cells in (256, 512):
        layer = Layer(OIL, 0.05, 1e-3, 0.04, cells)
        plate = Float(0.012, 3.6e-3, stiffness, edge=8e-3)
        evaluate = numbers_of(floated_film(layer, lambda h, slope: 0 * h, plate))
        wave = np.pi * layer.places / 0.04
        h = 1 + 0.2 * np.cos(wave) + 0.1 * np.cos(3 * wave)
        *_, push, pressed = zip(*(evaluate(state(layer, h, X, 0.0)) for X in PLACES), strict=True)
        apart = np.abs(np.array(push).ravel() - np.array(pressed).ravel())
        gaps.append(apart.max() / np.abs(push).max())
    assert np.log2(gaps[0] / gaps[1]) > 1.7
    assert gaps[1] < 1e-3


def test_stiffer_than_rigid_is_rigid() -> None:
    layer = Layer(OIL, 0.05, 1e-3, 0.06, 72)
    table = load_scene("coil_cargo", ["cargo.youngs_modulus=1e12"]).table.cargo
    plate = table.on(layer)
    # a beam of its length on two ends, under the weight and the surface of a heap of 1 mm
    load = 1e-3 * (OIL.weight + 0.03 / 0.012**2)
    assert 5 / 384 * load * 0.012**4 / plate.stiffness == pytest.approx(1e-5, rel=1e-12)
    soft = load_scene("coil_cargo", ["cargo.youngs_modulus=1e5"]).table.cargo
    assert soft.on(layer).stiffness == pytest.approx(1e5 * 0.5e-3**3 / 12, rel=1e-12)


@pytest.mark.slow
def test_a_float_that_is_all_ends_is_followed() -> None:
    short = ["time.switches=1", "coils.count=6", "cargo.start=0.02", "cargo.edge=12e-3"]
    result = wo.run(load_scene("coil_cargo", short))
    assert result.status == "ok"
    assert result.scalars["own_field_left_out"].value == 0.0
    assert np.copysign(1.0, result.scalars["own_field_left_out"].value) == 1.0


@pytest.mark.slow
@pytest.mark.parametrize("modulus", [1e5, 1e9])
def test_the_packaged_scene_carries_foam_and_plate(modulus: float) -> None:
    """Both keep up with the coils; weak ones leave the foam behind."""
    short = ["time.switches=8", "coils.count=12"]
    carried = wo.run(load_scene("coil_cargo", [*short, f"cargo.youngs_modulus={modulus}"]))
    assert carried.status == "ok", carried.reason
    assert carried.scalars["float_captured"].value == 1.0
    rigid = any("counts as rigid" in each for each in carried.trust["warnings"])
    assert rigid == (modulus == 1e9)


@pytest.mark.slow
def test_weak_coils_leave_the_foam_behind() -> None:
    short = ["time.switches=8", "coils.count=12"]
    weak = wo.run(load_scene("coil_cargo", [*short, "switching.ampere_turns=900.0"]))
    assert weak.status == "ok"
    assert weak.scalars["float_captured"].value < 0.5


@pytest.mark.slow
def test_a_float_that_is_too_heavy_is_told() -> None:
    """Its draught is more than the film's depth."""
    heavy = ["time.switches=8", "coils.count=8", "cargo.density=8000.0", "switching.frequency=2e-3"]
    result = wo.run(load_scene("coil_cargo", [*heavy, "switching.ampere_turns=1.0"]))
    assert result.scalars["draught"].value > result.scalars["float_clearance"].value
    assert result.status == "failed"
    assert "touches the ground" in result.reason


test_what_cannot_be_is_refused = refusals(
    "coil_cargo",
    """
    cargo.start=1.0 | cargo.start | not between the walls
    cargo.edge=1.0 | cargo.edge | exceeds the length of the float
    cargo.density=1e-30 | cargo.density | write at least 2.4e-06
    cargo.thickness=1.0 | cargo.thickness | write at most 0.0088
    """,
)


def test_the_picture_of_a_float_needs_one() -> None:
    refused("fig24_travelling_wave", 'want=["cargo"]', "want", "write a table [cargo]")


@pytest.mark.slow
def test_a_float_over_one_coil_is_drawn() -> None:
    from wormopt.systems.coils.pictures import cargo

    one = ["coils.count=1", "switching.on=1", "switching.every=1", "time.switches=1"]
    result = wo.run(load_scene("coil_cargo", [*one, "cargo.start=0.0", "grid.cells=6"]))
    picture = cargo(result)
    block = picture.axes[-1].collections[0].get_datalim(picture.axes[-1].transData)
    assert (block.x0, block.x1) == pytest.approx((-5.0, 5.0))  # a pitch wide, in mm
