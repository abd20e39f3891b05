"""The worm under a known gait as a Model: against the closed form, and against scipy alone."""

import numpy as np
import pytest

import wormopt as wo
from tests.oracles.by_crawling import Crawler, FastGait
from wormopt.errors import ArgumentError
from wormopt.systems.spiked import driven_worm

MASS = (1.1, 0.9, 1.3)
NUMBERS = {"mass": MASS, "drag": 0.5, "load": 5.3}


def test_without_gliding_it_is_the_closed_form():
    gait = wo.fast_gait(2.0, 1.0)
    known = wo.crawl(gait, **NUMBERS)
    assert not known.glides
    inside = ~np.isclose(known.time % (gait.period / 3), 0) & (np.diff(known.time, prepend=-1) > 0)
    inside &= ~np.isclose(known.time % (gait.period / 3), gait.period / 3)
    motion = wo.simulate(driven_worm(gait, **NUMBERS), gait.period, times=known.time[inside])
    for name in ("velocity", "actuator_force", "length"):
        assert np.abs(motion[name] - known[name][:, inside]).max() < 1e-11, name
    assert np.abs(motion["spike_load"] - known["reaction"].sum(axis=0)[inside]).max() < 1e-11
    assert motion.end[0] == pytest.approx(known.advance, abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(("period", "glides"), [(2.0, False), (1.0, True)])
def test_it_moves_as_scipy_sees_it(period: float, glides: bool):
    times = np.append(0.0, 0.003 + 0.01 * np.arange(300))
    seen = Crawler(FastGait(period), np.array(MASS), 0.5, 5.3).watch(times)
    model = driven_worm(wo.fast_gait(period, 1.0), **NUMBERS)
    motion = wo.simulate(model, times[-1], times=times, tolerance=wo.Tolerance(1e-11, 1e-12))
    assert bool(motion.events) == glides
    assert len(motion.events) == len(seen.events)
    assert np.abs(motion["position"] - seen.values["position"]).max() < 1e-9
    for name in ("actuator_force", "spike_load"):
        assert np.abs(motion[name] - seen.values[name]).max() < 1e-9, name


def test_a_gait_with_corners_is_refused():
    corners = np.array([[[1.0, 0.2], [1.0, 0.0]], [[1.2, -0.2], [1.0, 0.0]]])
    gait = wo.Gait(np.array([0.0, 1.0, 2.0]), corners)
    with pytest.raises(ArgumentError, match="corners"):
        driven_worm(gait, **NUMBERS)
