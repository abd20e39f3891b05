"""Rods at rest between walls: exact forces, the elastica, least energy, relaxed motions."""

import math
from dataclasses import replace
from functools import lru_cache
from typing import Any

import casadi as ca
import hypothesis.strategies as st
import numpy as np
import pytest
from effort import examples
from hypothesis import given, settings
from scipy.optimize import brentq

from tests.oracles.beams import bent_cantilever
from wormopt.analysis.resting import Loaded, Rest
from wormopt.errors import ArgumentError, SolveError
from wormopt.magnetics.blocks import BlockField, block_field
from wormopt.magnetics.coils import Coil, CoilRow
from wormopt.model.schedule import Schedule
from wormopt.simulation.moreau import MoreauJean
from wormopt.systems.channel.rod import Curve, Rod, RodLine, distances
from wormopt.systems.channel.rod_model import (
    block_energy,
    block_load,
    channel_rod,
    magnetic_strength,
)

CHANNEL, ROOM = 11e-3, 3.5e-3


def rubber(elements: int = 12, **changed: Any) -> Rod:
    numbers: dict[str, Any] = {"length": 48e-3, "diameter": 4e-3, "youngs_modulus": 5e4}
    return Rod(**(numbers | changed), density=2500.0, elements=elements)


def pushed(rod: Rod, channel: float = CHANNEL, spring: float = 0.0) -> Loaded:
    """Under dead forces on the nodes: those along, then those across; a spring holds the middle."""
    q, force = ca.MX.sym("q", 3 * rod.count), ca.MX.sym("force", 2 * rod.count)
    energy = spring / 2 * (q[rod.count // 2] - rod.length / 2) ** 2
    energy -= ca.dot(force, q[: 2 * rod.count])
    potential = ca.Function("potential", [q, force], [energy])
    pull = -ca.gradient(energy, q)[: 2 * rod.count]
    inputs = ca.Function("inputs", [q, force], [pull])
    size = rod.stiffness().bending / rod.length
    return Loaded(channel_rod(rod, channel, 0.5), potential, inputs, size=size)


def lying(rod: Rod, height: float = 0.0) -> np.ndarray:
    return np.concatenate([rod.nodes, np.full(rod.count, height), np.zeros(rod.count)])


def walls(rest: Rest) -> tuple[float, float]:
    """Resultant of the upper and of the lower wall."""
    return float(rest.pressed[::2].sum()), float(rest.pressed[1::2].sum())


def check(rest: Rest, rounding: float = 1e-9) -> None:
    assert rest.violation < 1e-15
    assert rest.complementarity < 1e-12
    assert rest.residual < rounding
    assert rest.imbalance < rounding
    assert np.all(rest.pressed >= 0)


# -- exact answers --------------------------------------------------------------------------------


@settings(max_examples=examples(8))
@given(load=st.floats(0.05, 5.0), side=st.sampled_from([1.0, -1.0]))
def test_an_even_load_presses_a_rod_flat_on_a_wall(load: float, side: float):
    """Every node is pressed by its own load; the rod is straight and has no elastic energy."""
    rod = rubber(6)
    force = side * load * rod.weights
    rest = pushed(rod).rest(lying(rod), np.concatenate([0 * force, force]))
    check(rest)
    on, off = (0, 1) if side > 0 else (1, 0)
    assert rest.pressed[on::2] == pytest.approx(load * rod.weights, rel=1e-9)
    assert np.all(rest.pressed[off::2] == 0)
    assert rest.places[rod.count : 2 * rod.count] == pytest.approx(side * ROOM, abs=1e-12)
    assert rest.energy == pytest.approx(-load * rod.length * ROOM, rel=1e-9)
    assert not rest.stable  # it slides along for nothing


@pytest.mark.parametrize(
    ("ratio", "deflection"),
    [
        (200.0, 0.2),
        (50.0, 0.6),
        *(pytest.param(*pair, marks=pytest.mark.slow) for pair in ((50.0, 0.2), (200.0, 0.6))),
    ],
)
def test_three_points_press_as_the_elastica_says(ratio: float, deflection: float):
    """The middle is pushed to the upper wall, both tips to the lower one.

    Either half is a cantilever whose tip is deflected by the room; its force is the elastica's.
    What is left of the load presses on the walls. A rod also stretches and shears, by squares of
    its thickness.
    """
    half, height = 0.1, deflection * 0.1
    rod = rubber(24, length=2 * half, diameter=2 * half / ratio)
    channel = height + rod.diameter
    angle: Any = brentq(lambda a: bent_cantilever(a)[2] - deflection, 1e-6, 1.5, xtol=1e-14)
    stiffness = rod.stiffness().bending
    spring = bent_cantilever(angle)[0] * stiffness / half**2
    force = np.zeros((2, rod.count))
    tips, middle = (0, rod.count - 1), rod.count // 2
    force[1, list(tips)] = -3 * spring
    force[1, middle] = 5 * spring
    loaded = pushed(rod, channel, spring=stiffness / half**3)
    rest = loaded.rest(lying(rod), force)
    check(rest, 1e-9 * ratio**2)  # the stiffness against stretching, times rounded strains
    assert rest.stable
    upper, lower = rest.pressed[::2], rest.pressed[1::2]
    touched = [np.flatnonzero(part).tolist() for part in (upper, lower)]
    assert touched == [[middle], list(tips)]
    slender = (2 / ratio) ** 2 + 1e-4
    assert upper[middle] == pytest.approx(3 * spring, rel=slender)
    assert lower[list(tips)] == pytest.approx(2 * spring, rel=slender)
    work = 5 * height / 2 + 2 * 3 * height / 2
    bent = rest.energy + spring * work  # the loads' own potential taken away
    assert bent == pytest.approx(_bent_energy(deflection) * stiffness / half, rel=slender)


def _bent_energy(deflection: float) -> float:
    """Of two cantilevers: the work of the tip's force as it grows, by Simpson's rule."""
    angles: list[Any] = [brentq(lambda a, d=d: bent_cantilever(a)[2] - d, 1e-9, 1.5, xtol=1e-15)
              for d in np.linspace(0, deflection, 41)[1:]]  # fmt: skip
    forces = np.array([0.0, *(bent_cantilever(a)[0] for a in angles)])
    weights = np.array([1, *([4, 2] * 20)[:-1], 1]) / 3
    return float(2 * weights @ forces * deflection / 40)


def test_without_loads_a_rod_rests_where_it_is():
    rod = rubber(4)
    rest = Loaded(channel_rod(rod, CHANNEL, 0.5), size=1e-5).rest(lying(rod, 1e-3))
    x, y, angle = rest.places.reshape(3, -1)
    assert np.hypot(np.diff(x), np.diff(y)) == pytest.approx(np.diff(rod.nodes), rel=1e-9)
    assert np.ptp(angle) < 1e-9
    assert rest.energy == pytest.approx(0, abs=1e-18)
    assert np.all(rest.pressed == 0)
    assert not rest.stable  # it may lie anywhere
    bent = lying(rod)
    bent[rod.count : 2 * rod.count] = 2e-3 * np.sin(np.pi * rod.nodes / rod.length)
    back = Loaded(channel_rod(rod, CHANNEL, 0.5), size=1e-5).rest(bent)
    assert back.energy == pytest.approx(0, abs=1e-15)


# -- in the field of coils ------------------------------------------------------------------------


@lru_cache
def field() -> BlockField:
    row = CoilRow(Coil(2e-3, 9e-3, 20e-3), 2, 10e-3, gap=13e-3, sides="alternating")
    return block_field(row, 1.05 * ROOM, on=3, every=7, tolerance=1e-3)


@lru_cache
def attracted(elements: int) -> tuple[Rod, Loaded]:
    rod = rubber(elements)
    model = channel_rod(rod, CHANNEL, 0.5)
    size = rod.stiffness().bending / 10e-3
    return rod, Loaded(model, block_energy(rod, field()), block_load(rod, [field()]), size=size)


def numbers(rod: Rod, ampere_turns: float = 4600.0) -> list[float]:
    return [0.0, 1.0, magnetic_strength(rod, 2.0, ampere_turns), 0.0]


def laid(rod: Rod) -> np.ndarray:
    """As a cosine from coil to coil, along the wall beyond."""
    x = np.linspace(-40e-3, 40e-3, 4001)
    y = np.where(np.abs(x) < 10e-3, -ROOM * np.cos(np.pi * x / 10e-3), ROOM)
    along = np.append(0, np.cumsum(np.hypot(np.diff(x), np.diff(y))))
    at = along[2000] + rod.nodes - rod.length / 2
    angle = np.arctan2(np.gradient(y), np.gradient(x))
    return np.concatenate([np.interp(at, along, part) for part in (x, y, angle)])


@lru_cache
def bent(elements: int) -> Rest:
    rod, loaded = attracted(elements)
    return loaded.rest(laid(rod), numbers(rod))


def segment(elements: int, rest: Rest | None = None) -> Curve:
    found = bent(elements) if rest is None else rest
    return RodLine(attracted(elements)[0], found.places).between(0.0, 10e-3)


def test_the_energy_has_the_forces_of_the_load_as_its_slopes():
    rod, loaded = attracted(5)
    assert loaded.potential is not None
    q = ca.MX.sym("q", 3 * rod.count)
    slope = ca.Function("slope", [q], [ca.gradient(loaded.potential(q, numbers(rod)), q)])
    found = np.array(slope(laid(rod))).ravel()
    wanted = np.array(block_load(rod, [field()])(laid(rod), numbers(rod))).ravel()
    scale = np.abs(wanted).max()
    assert found[: 2 * rod.count] == pytest.approx(-wanted, abs=1e-12 * scale)
    assert np.all(found[2 * rod.count :] == 0)


def test_a_rod_is_bent_from_wall_to_wall():
    rod, _ = attracted(12)
    rest = bent(12)
    check(rest)
    assert rest.stable
    upper, lower = walls(rest)
    load = np.array(block_load(rod, [field()])(rest.places, numbers(rod))).ravel()
    assert upper - lower == pytest.approx(load[rod.count :].sum(), rel=1e-9)
    assert upper > lower > 0.1
    assert load[: rod.count].sum() == pytest.approx(0, abs=1e-9)


@settings(max_examples=examples(60))
@given(seed=st.integers(0, 2**32 - 1), size=st.floats(1e-6, 1e-3))
def test_no_admissible_move_lowers_the_energy(seed: int, size: float):
    """Random moves, smooth and rough, brought back between the walls where they left them."""
    rod, loaded = attracted(12)
    rest, n = bent(12), rod.count
    random = np.random.default_rng(seed)
    waves = np.cos(np.multiply.outer(np.arange(6), np.pi * rod.nodes / rod.length))
    moves = random.normal(size=(3, 6)) @ waves + 0.1 * random.normal(size=(3, n))
    q = rest.places.reshape(3, n) + size * np.array([[rod.length], [ROOM], [1.0]]) * moves
    q[1] = np.clip(q[1], -ROOM, ROOM)
    assert energy(loaded, q, numbers(rod)) >= rest.energy - 1e-15


def energy(loaded: Loaded, q: np.ndarray, given: list[float]) -> float:
    assert loaded.potential is not None
    own = ca.Function("own", [*(s.symbol for s in (*loaded.model.x, *loaded.model.p))],
                      [loaded.model["strain_energy"]])  # fmt: skip
    n = loaded.n_q // 3
    p = [s.value for s in loaded.model.p]
    stored: Any = own(*q.reshape(3, n), *[0 * np.ones(n)] * 3, *p)
    return float(np.array(stored).item() + np.array(loaded.potential(q.ravel(), given)).item())


@pytest.mark.slow
def test_there_is_more_than_one_place_of_rest():
    """In a weak field a rod that lies along a wall stays there; bent, it has less energy."""
    rod, loaded = attracted(24)
    flat = np.concatenate([rod.nodes - rod.length / 2, np.full(rod.count, 0.999 * ROOM),
                           np.zeros(rod.count)])  # fmt: skip
    on_wall = flat
    for share in (0.1, 0.3, 0.6, 1.0):
        found = loaded.rest(on_wall, numbers(rod, 4600 * math.sqrt(share)))
        on_wall = found.places
    check(found)
    assert found.stable
    upper, lower = walls(found)
    assert lower == 0 < upper
    assert bent(24).energy < found.energy


@pytest.mark.slow
def test_the_shape_does_not_depend_on_the_mesh():
    lengths = [segment(k).length for k in (12, 24, 48)]
    assert lengths[2] == pytest.approx(13.47e-3, abs=0.01e-3)
    assert abs(lengths[1] - lengths[2]) < 2e-5
    assert distances(segment(24), segment(48))[0] < 4e-5


@pytest.mark.slow
def test_mirrored_fields_bend_mirrored_rods():
    rod, loaded = attracted(24)
    n, given = rod.count, numbers(rod)
    start = laid(rod)
    start[n:] *= -1
    other = loaded.rest(start, [0.0, -1.0, *given[2:]])
    assert other.energy == pytest.approx(bent(24).energy, rel=1e-9)
    assert other.places[n : 2 * n] == pytest.approx(-bent(24).places[n : 2 * n], abs=1e-9)
    # and coils further on hold it further on
    start = laid(rod)
    start[:n] += 0.37
    moved = loaded.rest(start, [0.37, *given[1:]])
    assert moved.places[:n] == pytest.approx(bent(24).places[:n] + 0.37, abs=1e-8)


@pytest.mark.slow
def test_a_damped_motion_ends_where_the_energy_is_least():
    """Neither IPOPT nor the energy: the same rod let go in its channel, until it is at rest."""
    rod, loaded = attracted(24)
    rest, n = bent(24), rod.count
    marcher = MoreauJean(loaded.model, inputs=loaded.inputs)
    coils, begin = ca.SX.sym("coils", 4), ca.SX.sym("begin")
    always = Schedule("coils", coils, begin, np.array([0.0, 1.0]), np.array([numbers(rod)]))
    p = {"friction": 1e-7, "damping_time": 1e-2, "density": 2500.0}
    x0 = np.concatenate([laid(rod), np.zeros(3 * n)])
    steps = marcher.march(0.5, x0, p=p, schedule=always)
    end = steps.states[: 3 * n, -1]
    assert np.abs(steps.states[3 * n : 5 * n, -1]).max() < 1e-6
    # what is left is by how much the last impacts enter the walls, which steps never take back
    assert end[: 2 * n] == pytest.approx(rest.places[: 2 * n], abs=1e-7)
    assert steps.pressed[:, -1] == pytest.approx(rest.pressed, abs=3e-5)
    relaxed = replace(rest, places=end)
    assert segment(24, relaxed).length == pytest.approx(segment(24).length, abs=1e-7)


# -- refusals -------------------------------------------------------------------------------------


def test_what_cannot_rest_is_refused():
    rod = rubber(4)
    loaded = pushed(rod)
    with pytest.raises(ArgumentError, match="start must have 27 finite entries"):
        loaded.rest(np.zeros(5))
    with pytest.raises(ArgumentError, match="must be 18 finite numbers"):
        loaded.rest(lying(rod), [math.nan] * 18)
    with pytest.raises(ArgumentError, match="belong together"):
        Loaded(loaded.model, potential=loaded.potential)
    with pytest.raises(ArgumentError, match="size must be positive"):
        Loaded(loaded.model, size=0.0)
    with pytest.raises(ArgumentError, match="no parameter 'colour'"):
        Loaded(loaded.model, p={"colour": 1.0})
    pulled = np.zeros(18)
    pulled[8] = 1.0  # along the channel, where nothing holds it
    with pytest.raises(SolveError) as caught:
        loaded.rest(lying(rod), pulled)
    assert caught.value.code in ("no_rest", "not_balanced")
    assert caught.value.suggestion


def test_places_along_a_rod():
    rod = rubber(4, length=1.0, diameter=0.1)
    line = RodLine(rod, np.concatenate([0.8 * rod.nodes, 0.6 * rod.nodes**2, 0 * rod.nodes]))
    (here,) = line.crossings(0.2)
    assert line.at(np.array([here]))[:2, 0] == pytest.approx([0.2, 0.6 * 0.25**2])
    assert line.crossings(0.9).size == 0
    assert line.crossings(0.4).tolist() == [2.0]  # at a node, once
    with pytest.raises(ArgumentError, match="does not reach"):
        line.between(0.1, 0.9)
    with pytest.raises(ArgumentError, match="27 finite"):
        RodLine(rod, np.zeros(3))


def test_a_quarter_circle_has_its_length_and_curvature():
    rod = rubber(32, length=math.pi / 2, diameter=0.1)
    turn = rod.nodes
    line = RodLine(rod, np.concatenate([np.sin(turn), 1 - np.cos(turn), turn]))
    piece = line.between(0.0, math.sin(1.2))
    assert piece.length == pytest.approx(1.2, rel=1e-5)
    share = np.linspace(0, 1, 9)
    exact = np.array([np.sin(1.2 * share), 1 - np.cos(1.2 * share), 1.2 * share])
    assert piece.points(share) == pytest.approx(exact, abs=2e-5)
    bend, largest = line.curvature(0.0, math.sin(1.2))
    assert (bend, largest) == pytest.approx((0.6, 1.0), rel=1e-4)
    back = RodLine(rod, np.concatenate([1 - np.sin(turn), 1 - np.cos(turn), np.pi - turn]))
    other = back.between(1 - math.sin(1.2), 1.0)
    assert other.length == pytest.approx(piece.length, rel=1e-12)
    assert other.points(share)[1] == pytest.approx(piece.points(1 - share)[1], abs=1e-9)
