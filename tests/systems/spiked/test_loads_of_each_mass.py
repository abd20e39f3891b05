"""Loads that differ from mass to mass: a cable at the tail, unequal weights on a slope."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from g1_worm import G1_LIMITS
from outcomes import told_by_a_run

from wormopt.systems.spiked.certify.certificate import verify
from wormopt.systems.spiked.certify.certified import certify
from wormopt.systems.spiked.construct import travelling_sine
from wormopt.systems.spiked.crawl import crawl
from wormopt.systems.spiked.design.optimize import design
from wormopt.systems.spiked.design.sensitivity import scaling_error, sensitivities
from wormopt.systems.spiked.gait_problem import Search, Worm

MASSES, LOADS = (1.0, 2.0, 1.5), (0.5, 4.0, 9.0)
OWN = Search(sequence=((0,), (1,), (2,)), effort="quick", workers=1)


def test_the_motion_depends_on_the_sum_of_the_loads_and_actuators_on_each():
    """Actuator j carries the loads of the masses behind it, less what spikes there carry."""
    gait = travelling_sine(2, 1.0, 1.0, 0.1, lag=0.3)
    even, uneven = (crawl(gait, MASSES, 0.2, load) for load in (sum(LOADS) / 3, LOADS))
    assert uneven.speed == even.speed
    assert uneven["reaction"] == pytest.approx(even["reaction"], abs=1e-12)
    beyond = np.array(LOADS) - sum(LOADS) / 3
    pulled = np.cumsum(beyond[::-1])[::-1][1:, None]
    assert uneven["actuator_force"] - even["actuator_force"] == pytest.approx(
        np.broadcast_to(pulled, even["actuator_force"].shape), abs=1e-11
    )
    lifted = sum(LOADS) * uneven.advance  # by each load as far
    assert uneven.net_work - lifted == pytest.approx(even.dissipation - lifted, rel=1e-9)


def test_numbers_alike_are_one_load():
    even, listed = Worm(2, MASSES, load=0.1), Worm(2, MASSES, load=(0.1, 0.1, 0.1))
    assert even.load_range == listed.load_range == (0.1, 0.1)
    assert listed.loads(0.1) == 0.1
    ranged = Worm(2, MASSES, load=(1.0, 2.0), pull=(0.5, 1.0, 0.0))
    assert ranged.load_range == (1.5, 2.5)
    assert ranged.loads(1.5) == (1.5, 2.0, 1.0)


@pytest.mark.slow
def test_designs_keep_the_limits_of_actuators_with_the_loads_where_they_are():
    """All loads at the tail, whose link carries them: 12 less the spikes' share."""
    limit = G1_LIMITS.vary(actuator_force=14.0)
    speeds = {}
    for load in ((12.0, 0.0, 0.0), 4.0, (0.0, 0.0, 12.0)):
        found = design(Worm(2, load=load), limit, search=OWN)
        assert max(found.violations.values()) < 1e-9
        speeds[load] = found.speed
    assert len(set(np.round(list(speeds.values()), 6))) == 3
    # turned round it is the same worm, with the same gait in the mirror
    turned = Search(sequence=((2,), (1,), (0,)), effort="quick", workers=1)
    other = design(Worm(2, load=(0.0, 0.0, 12.0)), limit, search=turned)
    assert other.speed == pytest.approx(speeds[12.0, 0.0, 0.0], rel=1e-6)


def test_certificates_take_each_load_where_it_is():
    limits = G1_LIMITS.vary(actuator_force=11.0)
    bounds = []
    for pull in ((9.0, 0.0), (0.0, 9.0)):
        order = Search(sequence=((0,), (1,)), effort="quick", workers=1)
        found = design(Worm(1, pull=pull), limits, search=order)
        proof = certify(found, gap=0.02)
        assert proof.bound >= found.speed
        assert proof.certificate is not None
        assert verify(proof.certificate).holds
        bounds.append(proof.bound)
    assert bounds[0] == pytest.approx(bounds[1], rel=1e-3)


@pytest.mark.parametrize(
    ("name", "load", "pull"),
    [
        ("worm.load[1]", (0.0, 1.001, 3.0), (0.3, 0.9, 0.6)),
        pytest.param("worm.pull[2]", (0.0, 1.0, 3.0), (0.3, 0.9, 0.601), marks=pytest.mark.slow),
    ],
)
def test_sensitivities_by_each_load_are_those_of_designs(
    name: str, load: tuple[float, ...], pull: tuple[float, ...]
):
    """Of a peak actuator force at a speed, in one order."""
    worm = Worm(2, (1.0, 1.5, 1.0), load=(0.0, 1.0, 3.0), pull=(0.3, 0.9, 0.6))
    found = design(worm, G1_LIMITS, "peak_actuator_force", 0.5, search=OWN)
    known = {s.name: s for s in sensitivities(found)}
    assert scaling_error(known.values(), found.task.objective) < 1e-3
    moved = Worm(2, worm.mass, load=load, pull=pull)
    dearer = design(moved, G1_LIMITS, "peak_actuator_force", 0.5, search=OWN).value
    slope = (dearer - found.value) / 1e-3
    assert not known[name].one_sided
    assert known[name].raised == pytest.approx(slope, rel=0.05, abs=2e-3)


def test_a_robot_as_it_is_built_is_designed_on_its_slope_with_its_cable(tmp_path: Path, capsys):
    changes = [
        'units="SI"',
        'worm={links=4, mass=[0.12, 0.08, 0.08, 0.08, 0.08], load=[0, 0, 0, 0, "0.3 N"],'
        ' slope="10 deg"}',
        'gait={period=["0.5 s", "4 s"], length=["30 mm", "60 mm"], rate="60 mm/s",'
        ' acceleration="1 m/s^2", actuator_force="3 N"}',
        'search={effort="quick", sequence=[[0], [4]]}',
    ]
    code, told = told_by_a_run(capsys, "design_fast_gait", tmp_path / "out", *changes)
    assert (code, told["status"]) == (0, "ok")
    mean = (0.3 + 0.44 * 9.80665 * np.sin(np.radians(10))) / 5
    assert told["scalars"]["lambda_mean"]["value"] == pytest.approx(mean, rel=1e-9)
    assert told["scalars"]["actuator_force_max"]["value"] <= 3.0 + 1e-9
