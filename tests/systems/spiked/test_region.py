"""Where kinematics rules a gait, by period and load: gait (15) by hand, others by simulation."""

import numpy as np
import pytest

import wormopt as wo
from wormopt.errors import ArgumentError, SolveError
from wormopt.simulation.simulate import simulate
from wormopt.systems.spiked.bimodal import integrate
from wormopt.systems.spiked.construct import block_wave, fast_gait
from wormopt.systems.spiked.dynamics import driven_worm
from wormopt.systems.spiked.region import Region
from wormopt.systems.spiked.stretches import Drive

E_L0 = 0.3  # elongation times rest length of gait (15)


def region_of(gait: wo.Gait, mass: list[float], drag: float) -> Region:
    return Region(Drive(gait, np.array(mass), drag, 0.0, "equal"))


@pytest.mark.parametrize(("mass", "drag"), [(1.0, 1.0), (2.5, 0.0), (0.3, 40.0)])
def test_gait_15_by_hand(mass: float, drag: float):
    """W0 = (2 pi e l0/T) |sin(3 pi t/T)|, so sigma is a sine whose two ends are known."""
    region = region_of(fast_gait(1.0, 2.0, 0.15), [mass] * 3, drag)
    for period in (0.4, 1.0, 3.7):
        least = 6 * np.pi**2 * E_L0 * mass / period**2
        swing = 2 * np.pi * E_L0 / period * np.hypot(3 * np.pi * mass / period, drag)
        assert region.least_load(period) == pytest.approx(least, rel=1e-12)
        loads = np.array([0.0, 20.0])
        assert region.spike_loads(period, loads) == pytest.approx(3 * (loads + swing), rel=1e-12)
        assert region.most_load(period, 150.0) == pytest.approx(50 - swing, rel=1e-12, abs=1e-10)
    if drag == 0:  # both borders meet where 2 least = strength / 3
        meets = 6 * np.pi * np.sqrt(E_L0 * mass / 150.0)
        assert region.most_load(meets, 150.0) == pytest.approx(region.least_load(meets))


@pytest.mark.parametrize("drag", [0.0, 0.7])
def test_the_least_period_of_gait_15_by_hand(drag: float):
    """Sigma is least where W0 = 0: there drag does nothing, and a load of 0 holds nothing."""
    region = region_of(fast_gait(1.0, 2.0, 0.15), [2.5] * 3, drag)
    for load in (1e-3, 20.0, 1e6):
        by_hand = np.pi * np.sqrt(6 * E_L0 * 2.5 / load)
        assert region.least_period(load) == pytest.approx(by_hand, rel=1e-10)
    assert region.least_period(0.0) == np.inf
    for wrong in (-1e-300, -20.0, np.nan, np.inf):
        with pytest.raises(ArgumentError, match="load must be finite and at least 0"):
            region.least_period(wrong)


def test_corners_leave_no_region():
    worm = {"links": 2, "mass": 1.0, "load": 20.0}
    shape = {"shape": "block_wave", "period": 1.0, "length": [1.0, 1.3], "resting": 1}
    scene = {"schema": 1, "kind": "gait", "want": ["region"], "worm": worm}
    with pytest.raises(SolveError, match="corners"):
        wo.run(scene | {"gait": shape | {"profile": "trapezoid", "ramp": 0.0}})


GAITS = {
    "fast": (fast_gait(0.7, 2.0, 0.2), [1.0, 2.0, 0.5]),
    "one at rest": (block_wave(3, 1, 1.3, (1.0, 1.4), "cosine"), [1.0] * 4),
    "two at rest": (block_wave(3, 2, 1.3, (1.0, 1.4), "trapezoid", 0.3), [1.0, 3.0, 1.0, 2.0]),
}


@pytest.mark.parametrize("name", GAITS)
@pytest.mark.parametrize("drag", [0.0, 2.0])
def test_what_a_spike_carries_is_shared_by_those_at_rest(name: str, drag: float):
    """Sigma by its definition at many instants: the foremost rest, whatever their masses."""
    gait, mass = GAITS[name]
    region, t = region_of(gait, mass, drag), np.linspace(0, 1, 20_001)
    for period in (0.4, 1.7):
        quick = gait.with_period(period)
        first, second = (
            np.vstack([0 * t, np.cumsum(quick(period * t, d), axis=0)]) for d in (1, 2)
        )
        leader, instants = first.argmax(axis=0), np.arange(len(t))
        velocity = first[leader, instants] - first
        force = np.array(mass) @ (second[leader, instants] - second) + drag * velocity.sum(axis=0)
        resting = (velocity <= 1e-9 * velocity.max()).sum(axis=0)
        carried = force + len(mass) * 5.0
        most = float((carried / resting).max())
        assert region.spike_loads(period, np.array([5.0])) == pytest.approx(most, rel=1e-4)
        assert region.total_load(period, 5.0) == pytest.approx(carried.max(), rel=1e-4)
        spare = 1e3 * resting / len(mass) - force / len(mass)
        assert region.most_load(period, 1e3) == pytest.approx(spare.min(), rel=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("name", GAITS)
@pytest.mark.parametrize("drag", [0.0, 2.0])
def test_both_sides_of_the_borders_by_simulation(name: str, drag: float):
    """The gait is made anew for each period; the dynamics know no borders."""
    gait, mass = GAITS[name]
    region, numbers = region_of(gait, mass, drag), np.random.default_rng(5)
    for period in numbers.uniform(0.3, 3.0, 6):
        quick, border = gait.with_period(period), region.least_load(period)
        for side in (-1, 1):
            load = border * (1 + side * numbers.uniform(0.003, 0.2))
            worm = driven_worm(quick, mass, drag, load)
            motion = simulate(worm, 2 * period, dense=True)
            glides = motion["glide"].max() > 1e-7 * quick.period
            assert glides == (side < 0)
            assert bool(integrate(quick, mass, drag, load).glides) == glides
            if glides:
                continue
            total, share = motion.largest("spike_load"), 2 if name == "two at rest" else 1
            most = region.spike_loads(period, np.array([load]))[0]
            assert total / share == pytest.approx(most, rel=1e-7)
            # a spike that holds just this much breaks with more load, and not with less
            assert region.most_load(period, most) == pytest.approx(load, rel=1e-12)
