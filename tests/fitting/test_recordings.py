"""Recordings made by scipy alone agree with closed forms and with `simulate`."""

import math
from typing import Any

import numpy as np
import pytest

import wormopt as wo
from tests.oracles.by_recordings import (
    Course,
    Ground,
    block,
    chain,
    disturb,
    follow,
    irregular,
    pair,
    smooth_waves,
    square,
    with_lengths,
)
from wormopt.model.schedule import ParameterPath
from wormopt.systems.block.block import block as block_model
from wormopt.systems.pair import magnetic_pair

EXACT = wo.Tolerance(1e-11, 1e-11)
LAWS = [(1.0, 4.0, 1.3, 5.0), (0.7, 6.0, 0.7, 6.0), (0.9, 3.0, 1.6, 3.5)]
WORM: dict[str, Any] = {
    "mass": np.array([1.0, 1.2, 0.9]),
    "stiffness": np.array([20.0, 30.0]),
    "damping": np.array([2.0, 3.0]),
}


def ground(numbers) -> list[Ground]:
    return [Ground(*each) for each in numbers]


def stops(motion: wo.Trajectory) -> object:
    return pytest.approx([e.time for e in motion.events if e.kind != "release"], abs=1e-7)


def laws(numbers) -> list[wo.Coulomb]:
    return [wo.Coulomb(*each) for each in numbers]


def test_a_thrown_block_that_is_pulled_until_it_lets_go():
    """m v' = -s t - F until v = 0; the pull s t lets it go at Fs / s."""
    m, forward, stick, slope = 2.0, 3.0, 4.0, 1.5
    at_rest = Course(np.array([0.0, 10.0]), np.array([[[0.0, slope]]]), periodic=False)
    times = np.array([0.0, 1.0, 2.0, 4.0])
    seen = follow(block(m, Ground(forward, 5.0, stick), at_rest), times, [0.0], [0.5])
    stop = (forward - math.sqrt(forward**2 - 2 * slope * m * 0.5)) / slope
    assert [(kind, round(t, 9)) for t, _, kind in seen.events] == [
        ("stop", round(stop, 9)), ("release", round(stick / slope, 9)),
    ]  # fmt: skip
    let_go, end = stick / slope, times[-1]
    speed = (slope * (end**2 - let_go**2) / 2 - forward * (end - let_go)) / m
    assert seen.values["velocity"][0, -1] == pytest.approx(speed, abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("drives", ["force", "rest_length"])
def test_a_chain_is_seen_as_simulate_sees_it(drives: str):
    shift = np.array([0.0, 0.3])
    course = smooth_waves(1.3, [0.1, -0.1], [0.5, 0.4], shift)
    if drives == "force":
        course = square(1.3, [-6.0, -8.0], [9.0, 10.0], shift)
    times = irregular(6.0, 200, seed=1)
    worm = chain(**WORM, rest=1.5, ground=ground(LAWS), course=course, drives=drives, drag=0.1,
                 load=0.2)  # fmt: skip
    start = [3.0, 1.5, 0.0], [0.5, 0.0, -0.2]
    seen = with_lengths(follow(worm, times, *start))
    assert {kind for _, _, kind in seen.events} == {"stop", "release"}

    rest = 1.5
    if drives == "rest_length":
        tiled = np.concatenate([course.coefficients] * 5)
        tiled[:, :, 0] += rest
        breaks = np.append(0.0, np.cumsum(np.tile(np.diff(course.breaks), 5)))
        rest = ParameterPath(breaks, tiled)
    model = wo.chain(2, **WORM, rest_length=rest, law=laws(LAWS), drag=0.1, load=0.2)
    if drives == "force":
        model = wo.drive(model, wo.Gait(course.breaks, course.coefficients), periodic=True)
    x0 = {"position": start[0], "velocity": start[1]}
    motion = wo.simulate(model, 6.0, times=times, x0=x0, tolerance=EXACT)
    for name in ("position", "velocity", "length"):
        assert np.abs(motion[name] - seen.values[name]).max() < 1e-7, name
    assert stops(motion) == [t for t, _, kind in seen.events if kind == "stop"]


@pytest.mark.slow
def test_the_magnetic_pair_is_seen_as_simulate_sees_it():
    eps = 0.036
    law, nu = (0.5 * eps, eps, 0.6 * eps, eps), math.sqrt(2) + 0.5 * eps
    times = np.linspace(0.0, 60.0, 301)
    seen = follow(pair(eps, nu, ground([law] * 2)), times, [0.0, 0.0], [0.0, 0.0])
    model = magnetic_pair(law=laws([law])[0], push=eps, frequency=nu)
    motion = wo.simulate(model, 60.0, times=times, tolerance=EXACT)
    assert np.abs(motion["position"] - seen.values["position"]).max() < 1e-7
    assert stops(motion) == [t for t, _, kind in seen.events if kind == "stop"]


def test_a_block_is_seen_as_simulate_sees_it():
    course = square(1.7, [-4.0], [5.0], [0.0])
    times = np.linspace(0.0, 5.0, 51)
    seen = follow(block(1.3, Ground(1.0, 2.0, 1.5, 2.5), course), times, [0.0], [1.0])
    model = block_model(wo.Coulomb(1.0, 2.0, 1.5, 2.5), mass=1.3)
    driven = wo.drive(model, wo.Gait(course.breaks, course.coefficients), periodic=True)
    motion = wo.simulate(driven, 5.0, times=times, x0={"velocity": [1.0]}, tolerance=EXACT)
    assert np.abs(motion["position"] - seen.values["position"]).max() < 1e-7


def test_noise_gaps_and_outliers_are_as_said():
    course = square(1.7, [-4.0], [5.0], [0.0])
    seen = follow(block(1.3, Ground(1.0, 2.0), course), np.linspace(0.0, 5.0, 2001), [0.0], [1.0])
    plain = disturb(seen, {"position": 0.01}, seed=3)
    off = plain.values["position"] - seen.values["position"]
    assert set(plain.values) == {"position"}
    assert off.std() == pytest.approx(0.01, rel=0.1)
    rough = disturb(seen, {"position": 0.01}, seed=3, gaps=0.1, outliers=0.05)
    off = np.abs(rough.values["position"] - seen.values["position"])
    assert np.isnan(off).mean() == pytest.approx(0.1, abs=0.03)
    assert np.nanmean(off > 0.05) == pytest.approx(0.05 * 0.75 * 0.9, abs=0.02)
