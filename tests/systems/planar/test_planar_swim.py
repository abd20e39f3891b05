"""Swimmers on viscous ground: benchmark numbers, geometric mechanics, invariances, best strokes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from effort import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import ArrayLike
from outcomes import refusals

import wormopt as wo
from tests.oracles.by_rods import followed
from wormopt.errors import ArgumentError
from wormopt.numerics.collocation import Collocation
from wormopt.ocp.mesh import Mesh
from wormopt.systems.planar.poses import _uniform, compose, inverse
from wormopt.systems.planar.shape import Harmonics, Polygon, chain_shape
from wormopt.systems.planar.swimming.best import best_stroke, heights, in_frame, once
from wormopt.systems.planar.swimming.recheck import spectral_stroke, stepped
from wormopt.systems.planar.swimming.swimmer import Swimmer, swim


def purcell(r: float = 2.0) -> Swimmer:
    return Swimmer(chain_shape(3, lengths=(1.0, 1.0, 1.0)), rods=(1.0, r))


def square(a: float) -> Polygon:
    return Polygon(np.array([[a, a], [-a, a], [-a, -a], [a, -a]]))


CIRCLE = Harmonics(np.zeros(2), np.array([[1.0, 0.0]]), np.array([[0.0, 1.0]]))
PURCELL = purcell()
WORM = Swimmer(chain_shape(2), rods=(0.7, 2.0), masses=(0.3, 0.5))
SNAKE = Swimmer(chain_shape(4, lengths=(1.0, 0.6, 0.8, 1.2)), rods=(0.5, 1.5), masses=(0.1, 0.2))
SWIMMERS = (PURCELL, WORM, SNAKE)

# Two computations of others each, see docs/theory-planar.md.
KNOWN = [
    (square(np.pi / 3), 0.191247237630), (square(1.0), 0.180562563321),
    (square(0.5), 0.057396871434), (CIRCLE, 0.153842472927),
]  # fmt: skip


@st.composite
def swimmers_and_strokes(draw: st.DrawFn) -> tuple[Swimmer, Harmonics]:
    """A body and a harmonic stroke about a shape with lengths near 1 and angles near 0."""
    swimmer = draw(st.sampled_from(SWIMMERS))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    lengths = np.array([name.startswith("length") for name in swimmer.shape.names])
    size = np.where(lengths, 0.1, 0.35)
    mean = np.where(lengths, 1.0, rng.uniform(-0.5, 0.5, len(size)))
    cosine, sine = rng.uniform(-size, size, (2, 2, len(size)))
    return swimmer, Harmonics(mean, cosine, sine)


def mirrored(stroke: Harmonics, swimmer: Swimmer) -> Harmonics:
    """Angles with the other sign."""
    sign = np.array([1.0 if name.startswith("length") else -1.0 for name in swimmer.shape.names])
    return Harmonics(stroke.mean * sign, stroke.cosine * sign, stroke.sine * sign)


class Paced:
    """A stroke at another pace."""

    def __init__(self, stroke: Harmonics) -> None:
        self.stroke, self.n_s, self.breaks = stroke, stroke.n_s, stroke.breaks

    def at(self, tau: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        tau = np.asarray(tau, dtype=float)
        slowed = tau - 0.12 * np.sin(2 * np.pi * tau)
        s, ds = self.stroke.at(slowed)
        return s, ds * (1 - 0.24 * np.pi * np.cos(2 * np.pi * tau))[:, None]


@pytest.mark.parametrize(("stroke", "distance"), KNOWN)
def test_ways_of_squares_and_of_a_circle(stroke: Polygon | Harmonics, distance: float) -> None:
    done = swim(PURCELL, stroke)
    assert done.distance == pytest.approx(distance, abs=6e-13)
    assert abs(done.turn) < 1e-14


def test_the_best_square_is_stationary() -> None:
    ways = [swim(PURCELL, square(1.39061 + d)).distance for d in (-1e-3, 0.0, 1e-3)]
    assert ways[1] == pytest.approx(0.234782479, abs=6e-10)
    assert abs(ways[2] - ways[0]) / 2e-3 < 1e-5
    assert ways[0] + ways[2] < 2 * ways[1]


@pytest.mark.parametrize("r", [2.0, 5.0, 10.0])
def test_small_loops_and_the_metric_of_the_straight_swimmer(r: float) -> None:
    swimmer = purcell(r)
    _, G = swimmer.local([0.0, 0.0])
    for mode, value in (((1, 1), r / 6), ((1, -1), 5 * r / 162)):
        np.testing.assert_allclose(G @ mode, value * np.array(mode), rtol=1e-13)
    for frame in ("head", "middle", "calm"):
        curved = heights(swimmer, frame).at([[0.0, 0.0]])[0]
        np.testing.assert_allclose(curved, [5 * (r - 1) / 81, 0, 0], rtol=0, atol=1e-12)


def test_small_squares_approach_the_law_of_small_loops_at_second_order() -> None:
    sides = np.array([0.02, 0.04, 0.08])
    off = [abs(swim(PURCELL, square(a)).distance / (2 * a) ** 2 * 81 / 5 - 1) for a in sides]
    slope = np.polyfit(np.log(sides), np.log(off), 1)[0]
    assert 1.9 < slope < 2.1
    assert off[0] < 1e-3


@pytest.mark.parametrize("frame", ["head", "middle", "calm"])
def test_curvature_is_the_displacement_of_small_loops(frame: str) -> None:
    middle = np.array([0.7, -0.3])
    seen = in_frame(PURCELL, frame)  # type: ignore[arg-type]
    curved = heights(PURCELL, frame).at(middle[None])[0]  # type: ignore[arg-type]
    off = []
    for a in (0.02, 0.01):
        corners = middle + a * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        done = swim(seen, Polygon(corners))
        off.append(np.abs(done.displacement / (2 * a) ** 2 - curved).max())
    assert off[1] < 0.02
    assert 1.7 < off[0] / off[1] < 4.5


@settings(max_examples=examples(6))
@given(swimmers_and_strokes())
def test_reversal_inverts_and_reciprocal_strokes_go_nowhere(
    case: tuple[Swimmer, Harmonics],
) -> None:
    swimmer, stroke = case
    there_and_back = replace(stroke, sine=0 * stroke.sine)
    np.testing.assert_allclose(swim(swimmer, there_and_back).displacement, 0, rtol=0, atol=1e-12)
    there = swim(swimmer, stroke)
    back = swim(swimmer, Harmonics(stroke.mean, stroke.cosine, -stroke.sine))
    np.testing.assert_allclose(
        compose(there.displacement, back.displacement), 0, rtol=0, atol=1e-12
    )
    np.testing.assert_allclose(back.displacement, inverse(there.displacement), rtol=0, atol=1e-12)
    assert back.length == pytest.approx(there.length, rel=1e-12)


@settings(max_examples=examples(6))
@given(swimmers_and_strokes())
def test_pace_mirror_and_frame(case: tuple[Swimmer, Harmonics]) -> None:
    swimmer, stroke = case
    done = swim(swimmer, stroke)
    paced = swim(swimmer, Paced(stroke))
    np.testing.assert_allclose(paced.displacement, done.displacement, rtol=0, atol=1e-12)
    assert paced.length == pytest.approx(done.length, rel=1e-11)
    other = swim(swimmer, mirrored(stroke, swimmer))
    np.testing.assert_allclose(
        other.displacement, done.displacement * [1, -1, -1], rtol=0, atol=1e-12
    )
    seen = swim(in_frame(swimmer, "middle"), stroke)
    assert seen.turn == pytest.approx(done.turn, abs=1e-12)
    assert seen.length == pytest.approx(done.length, rel=1e-12)


@pytest.mark.parametrize("swimmer", SWIMMERS)
def test_displacement_and_work_by_steps_of_the_balance(swimmer: Swimmer) -> None:
    rng, n = np.random.default_rng(3), swimmer.shape.s.numel()
    mean = np.array([float(name.startswith("length")) for name in swimmer.shape.names])
    stroke = Harmonics(mean, 0.2 * rng.normal(size=(1, n)), 0.2 * rng.normal(size=(1, n)))
    found = swim(swimmer, stroke).displacement
    np.testing.assert_allclose(found, stepped(swimmer, stroke)[:3], rtol=0, atol=1e-9)


def test_quadrature_converges_beyond_any_order() -> None:
    """16 points of Gauss on two panels a side reach round-off."""
    stroke = square(1.39061)

    def twists(tau: np.ndarray) -> np.ndarray:
        s, ds = stroke.at(tau)
        return np.einsum("mij,mj->mi", PURCELL.local(s)[0], ds)

    exact = swim(PURCELL, stroke).displacement
    off = [np.abs(_uniform(twists, stroke.breaks, k).displacement - exact).max() for k in (1, 2)]
    assert off[0] < 1e-8
    assert off[1] < 1e-13


def test_efficiency_is_below_its_ceiling_and_work_least_at_constant_power() -> None:
    done = swim(PURCELL, CIRCLE)
    assert 0 < done.efficiency < PURCELL.ceiling == 1.0
    assert done.efficiency == pytest.approx(3 * done.distance**2 / done.action)
    assert done.work(2.0) == pytest.approx(done.action / 2)
    assert stepped(PURCELL, CIRCLE)[3] > done.action  # even phase is not constant power
    assert np.all(np.diff(done.time) > 0)


@pytest.mark.parametrize("rods", [(-1.0, 1.0), (0.0, 1.0), (float("nan"), 1.0), (1.0,)])
def test_ground_that_does_not_resist_is_refused(rods: tuple[float, ...]) -> None:
    with pytest.raises(ArgumentError):
        Swimmer(chain_shape(2), rods=rods)  # type: ignore[arg-type]


def test_strokes_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ArgumentError, match="angle 1, angle 2"):
        swim(PURCELL, Polygon(np.array([[1.0], [2.0]])))
    with pytest.raises(ArgumentError, match="not finite"):
        swim(WORM, Polygon(np.array([[0.0, 1.0, 0.0], [0.0, 1.0, 1.0]])))
    with pytest.raises(ArgumentError, match="limits"):
        best_stroke(PURCELL, -np.inf, np.inf)
    with pytest.raises(ArgumentError, match="two shape variables"):
        heights(WORM)


@pytest.mark.parametrize("orders", [20, pytest.param(4, marks=pytest.mark.slow)])
def test_spectral_route_from_a_cold_circle(orders: int) -> None:
    """From few harmonics more are added until they change nothing."""
    found = spectral_stroke(PURCELL, CIRCLE, 3.0, orders=orders)
    assert found.change < 1e-9
    assert found.efficiency == pytest.approx(0.01236415462, abs=1.1e-11)
    assert abs(found.turn) < 1e-12


test_scenes_that_cannot_be_are_refused_by_their_key = refusals(
    "planar_purcell",
    """
    limits.angle=[1.0] | limits.angle
    limits.angle=[-3.2,3.2] | limits.angle
    body.lengths=[1e-6,1.0,1.0] | body.lengths
    body.lengths=[1.0,1.0] | body.lengths
    body.links=4 | want
    ground.across=1.0 | ground.across
    stroke={course="polygon",corners=[[90.0,45.0],[0.0,0.0]]} | stroke.corners
    stroke={course="polygon",corners=[[4.0,4.0]]} | stroke.corners
    stroke={course="harmonic",mean=[0.0,0.0],cosine=[],sine=[]} | stroke.cosine
    """,
)


def test_limits_may_be_half_turns() -> None:
    half = 3.141592653589793
    scene = wo.load_scene("planar_purcell", [f"limits.angle=[-{half},{half}]"])
    assert tuple(scene.table.limits.angle) == (-half, half)


@pytest.mark.slow
@pytest.mark.parametrize(("maximise", "unit"), [("efficiency", 1.0), ("distance", 1e-3)])
def test_best_strokes_are_alike_in_all_units(maximise: Any, unit: float) -> None:
    """A body a thousandth as long in a fluid a thousandth as viscous."""
    mesh = Mesh.even(1, 8, Collocation(4, "legendre"), 3)
    small = Swimmer(chain_shape(3, lengths=(1e-3, 1e-3, 1e-3)), rods=(1e-3, 2e-3))
    found, known = (
        best_stroke(body, -1.0, 1.0, maximise=maximise, starts=1, mesh=mesh, tolerance=1.0)
        for body in (small, PURCELL)
    )
    assert found.value == pytest.approx(unit * known.value, rel=1e-6)


@pytest.mark.slow
def test_best_stroke_from_a_cold_start() -> None:
    found = best_stroke(PURCELL, -2.0, 2.0)
    assert found.value == pytest.approx(0.01236415462, abs=1.1e-11)
    done = swim(PURCELL, found.stroke)
    assert done.efficiency == pytest.approx(found.value, rel=1e-8)
    assert done.distance == pytest.approx(0.25209757, abs=1e-6)
    assert done.action == pytest.approx(15.4203469, abs=1e-4)


@pytest.mark.slow
def test_folded_strokes_are_better() -> None:
    """Raz and Avron (2007): large folded strokes beat those about the straight shape."""
    found = best_stroke(PURCELL, -2.9, 2.9)
    assert found.value == pytest.approx(0.0157211196, abs=1e-9)
    spectral = spectral_stroke(PURCELL, found.harmonics, 3.0, orders=24)
    assert spectral.efficiency == pytest.approx(found.value, rel=1e-7)


# -- what a search may not be deceived by ----------------------------------------------------------


@given(st.integers(0, 2**32 - 1), st.integers(2, 6))
def test_a_loop_that_is_repeated_is_found_in_its_repetition(seed: int, times: int) -> None:
    rng = np.random.default_rng(seed)
    cosine, sine = rng.uniform(-1, 1, (2, 6, 2)) / np.arange(1, 7)[:, None] ** 2
    mean = rng.uniform(-1, 1, 2)
    assert once(Harmonics(mean, cosine, sine)) is None
    spread = np.zeros((2, 6 * times, 2))
    spread[:, times - 1 :: times] = cosine, sine
    loop = once(Harmonics(mean, *spread))
    assert loop is not None
    tau = np.linspace(0, 1, 17)
    assert loop.at(tau)[0] == pytest.approx(Harmonics(mean, cosine, sine).at(tau)[0], abs=1e-12)


def _searched(across: float, starts: int) -> wo.Result:
    return wo.run("planar_purcell", {"ground.across": across, "search.starts": starts, "want": []})


@pytest.mark.slow
def test_a_loop_gone_round_twice_does_not_win() -> None:
    """The second start goes round the same loop twice: twice the way, the same efficiency."""
    result = _searched(3.0, 3)
    assert result.status == "ok", result.reason
    # the same loop by harmonics; its way and action by quadrature
    assert result["distance"].value == pytest.approx(0.42998840, abs=2e-7)
    assert result["action"].value == pytest.approx(20.0861790, abs=2e-5)
    own = followed(result["shape"].values, 3.0)
    assert result["distance"].value == pytest.approx(own.distance, abs=1e-7)


@pytest.mark.slow
def test_the_second_route_is_as_exact_as_what_it_checks() -> None:
    result = _searched(5.0, 1)
    assert result.status == "ok", result.reason
    assert result["efficiency"].value == pytest.approx(0.04907227187, abs=1e-11)
    assert result["efficiency_spectral"].value == pytest.approx(0.04907227187, abs=1e-11)


@pytest.mark.slow
@pytest.mark.parametrize(
    "seed", [pytest.param(k, marks=[pytest.mark.many] * (k > 3)) for k in range(20)]
)
def test_drawn_grounds_have_accepted_single_loops(seed: int) -> None:
    rng = np.random.default_rng(1000 + seed)
    across = float(np.exp(rng.uniform(np.log(1.2), np.log(20.0))))
    result = _searched(across, int(rng.integers(1, 4)))
    assert result.status == "ok", result.reason
    own = followed(result["shape"].values, across)
    assert abs(own.turn) < 1e-7
    assert result["distance"].value == pytest.approx(own.distance, abs=1e-7)
    assert result["action"].value == pytest.approx(own.action, rel=1e-7)
    loop = result["shape"].values
    angle = np.unwrap(np.angle([1, 1j] @ (loop - loop.mean(1)[:, None])))
    assert abs(angle[-1] - angle[0]) == pytest.approx(2 * np.pi)  # round its middle once
