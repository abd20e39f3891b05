"""Tracker (13) with a delayed difference: against an oracle, the derivative, and linear theory."""

from typing import Any

import numpy as np
import pytest
from effort import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from on_gaits import LOOSE, following
from scipy.optimize import brentq
from worms import worm

from tests.oracles.by_steps import DelayedTracker, solve_smooth
from wormopt.control.lambda_tracker import Quadratic, lambda_tracker
from wormopt.control.loop import gait_reference
from wormopt.model.friction import Coulomb
from wormopt.model.gait import Gait
from wormopt.model.model import Model
from wormopt.simulation.options import Route, Smooth
from wormopt.simulation.simulate import simulate
from wormopt.systems.chain.build import chain


def difference(plant: Model, lag: float, **more: Any) -> Model:
    return lambda_tracker(plant, following(plant), feedback="difference", lag=lag, **more)


@pytest.mark.parametrize(
    ("lag", "stretches", "route"),
    [
        (0.2, 4, "native"),
        (0.1, 6, "native"),
        *(
            pytest.param(*case, route, marks=pytest.mark.slow)
            for case in ((0.05, 16), (0.1, 14), (0.25, 9))
            for route in ("native", "python")
        ),
    ],
)
def test_a_delayed_difference_on_dry_ground_against_all_stretches_at_once(
    lag: float, stretches: int, route: Route
):
    """Sticking masses included; the oracle neither interpolates nor shares any code."""
    plant, growth = worm(position=(4.15, 2.05, 0.0), law=Coulomb(1.0, 2.0)), Quadratic(100.0)
    # with crossings of the tube as events: there k' has a kink, over which the oracle steps
    loop = difference(plant, lag, tube_radius=0.05, adaptation=growth, watch=True)
    motion = simulate(loop, stretches * lag, route=route)
    by_hand = DelayedTracker(lag, 100.0, 0.05, (-1, 2))
    end, events = by_hand.run([4.15, 2.05, 0, 0, 0, 0, 1.0], stretches)
    assert motion.end == pytest.approx(end, abs=1e-8)
    assert sum(event.kind != "switch" for event in motion.events) == events
    assert {event.kind for event in motion.events} & {"stick", "release"}


def lagging_chain(numbers: dict[str, Any], lag: float, gamma: float, lam: float) -> Any:
    """y' of three masses with drag, links held at 2.2 and 1.8 by the delayed difference."""
    m, c, d, rub = (numbers[name] for name in ("mass", "stiffness", "damping", "drag"))
    aim = np.array([2.2, 1.8])

    def f(_t: float, y: np.ndarray, past: np.ndarray) -> np.ndarray:
        x, v, k = y[:3], y[3:6], y[6]
        e, before = x[:2] - x[1:] - aim, past[:2] - past[1:3] - aim
        growth = gamma * max(np.sqrt(e @ e) - lam, 0.0) ** 2
        u = -(k * e + growth * e + k * (e - before) / lag)
        mu = c * (e + aim - 2.0) + d * (v[:2] - v[1:]) - u
        net = np.array([-mu[0], mu[0] - mu[1], mu[1]]) - rub * v
        return np.array([*v, *(net / m), growth])

    return f


@settings(max_examples=examples(12))
@given(
    m=st.floats(0.5, 3),
    c=st.floats(0, 30),
    d=st.floats(0, 6),
    drag=st.floats(0.05, 2),
    lag=st.sampled_from([0.05, 0.13, 0.4]),
    x=st.tuples(st.floats(3.5, 5), st.floats(1.5, 2.5)),
)
def test_random_worms_with_drag_against_all_stretches_at_once(
    m: float, c: float, d: float, drag: float, lag: float, x: tuple[float, float]
):
    numbers: dict[str, Any] = {"mass": m, "stiffness": c, "damping": d, "drag": drag}
    plant = chain(2, rest_length=2.0, position=(*x, 0.0), **numbers)
    # outside of a tube that never comes into play: its edge is where the oracle has a kink
    still = Gait(np.array([0.0, 1.0]), np.array([[[2.2], [1.8]]]))
    loop = lambda_tracker(
        plant,
        gait_reference(still, plant.t),
        tube_radius=1e-9,
        feedback="difference",
        lag=lag,
        adaptation=Quadratic(0.5),
    )
    start = np.array([*x, 0.0, 0.0, 0.0, 0.0, 1.0])
    ends = solve_smooth(lagging_chain(numbers, lag, 0.5, 1e-9), start, lag, 5, lambda _: start)
    motion = simulate(loop, 5 * lag, times=lag * np.arange(6))
    assert pytest.approx(ends, abs=1e-8) == motion.states.T


@pytest.mark.slow
def test_a_difference_tends_to_the_derivative_as_the_lag_falls():
    """First order in the lag: halved it halves the distance."""
    plant = worm(position=(4.0, 2.0, 0.0))
    growth = Quadratic(100.0)
    derived = lambda_tracker(plant, following(plant), tube_radius=0.2, adaptation=growth)
    end = simulate(derived, 1.0, contact=Smooth(), tolerance=LOOSE).end
    lags = np.array([0.04, 0.02, 0.01])
    off = []
    for lag in lags:
        loop = difference(plant, lag, tube_radius=0.2, adaptation=growth)
        off.append(np.linalg.norm(simulate(loop, 1.0, contact=Smooth(), tolerance=LOOSE).end - end))
    slope = np.polyfit(np.log(lags), np.log(off), 1)[0]
    assert 0.85 < slope < 1.15
    assert off[-1] < 10 * lags[-1]


def critical_gain(h: float, m: float, c: float, d: float) -> float:
    """Least gain from which a mode of two links swings for ever, by its characteristic equation.

    Links that are pulled against each other move as e'' = (3/m)(u - c e - d e'), all others
    as e'' = (1/m)(u - c e - d e'). With s = i w the imaginary part gives k = -d w h / sin(w h),
    the real one what has to be 0.
    """

    def gain(w: float) -> float:
        return -d * w * h / np.sin(w * h)

    def real(w: float, share: float) -> float:
        k = gain(w)
        return c + k + k * (1 - np.cos(w * h)) / h - w**2 * m / share

    found = []
    for share in (1.0, 3.0):
        w = np.linspace(np.pi / h * 1.0001, 2 * np.pi / h * 0.9999, 4001)
        values = np.array([real(each, share) for each in w])
        for k in np.flatnonzero(np.diff(np.sign(values))):
            root = brentq(real, w[k], w[k + 1], args=(share,), xtol=1e-13)
            assert isinstance(root, float)
            found.append(gain(root))
    return min(found)


@pytest.mark.parametrize("lag", [0.1, 0.2])
def test_a_difference_does_not_bear_every_gain(lag: float):
    """At the gain where theory has the border, swings fade just below and grow just above."""
    border = critical_gain(lag, 1.0, 10.0, 2.0)
    plant = chain(2, mass=1.0, stiffness=10.0, damping=2.0, rest_length=2.0,
                  position=(4.2, 1.9, 0.0), drag=1e-12)  # fmt: skip
    still = gait_reference(Gait(np.array([0.0, 1.0]), np.full((1, 2, 1), 2.0)), plant.t)
    ends = []
    for share in (0.97, 1.03):
        loop = lambda_tracker(
            plant, still, tube_radius=1.0, feedback="difference", lag=lag, gain_start=share * border
        )
        t = np.linspace(0, 60 * lag, 1201)
        size = simulate(loop, t[-1], times=t, tolerance=LOOSE)["error_norm"][0]
        ends.append(size[-200:].max() / size[400:600].max())
    assert ends[0] < 0.9
    assert ends[1] > 1.1
