"""Worms on a slope: closed forms of the theory and of free fall along the ground."""

import math

import numpy as np
import pytest

import wormopt as wo
from wormopt.errors import SceneError

G = 9.80665
SI = {"units": "SI", "want": []}
FALL = {
    "schema": 1,
    "kind": "simulate",
    "units": "SI",
    "want": ["signals"],
    "worm": {
        "links": 1,
        "mass": [0.2, 0.5],
        "stiffness": 10.0,
        "damping": 0.1,
        "rest_length": 0.1,
        "slope": "30 deg",
    },
    "contact": {"treatment": "exact"},
    "time": {"end": 0.5, "samples": 11},
}


def test_a_slope_loads_the_spikes_as_the_theory_says():
    """The least and the mean spike load of gait (15), docs/theory-kinematic.md, with m = T = 1."""
    result = wo.run("fast_gait", SI | {"worm.slope": "10 deg", "worm.drag": 0})
    load = 20 + G * math.sin(math.radians(10))
    least = load - 6 * math.pi**2 * 0.15 * 2
    assert result.scalars["lambda_min"].value == pytest.approx(least, rel=1e-12)
    assert result.scalars["lambda_mean"].value == pytest.approx(load, rel=1e-12)
    told = result.trust["slope"]
    assert told["gravity"] == G
    assert "standard gravity" in told["assumed"]
    assert told["pull"] == pytest.approx([load - 20] * 3)


def test_a_worm_without_ground_falls_along_the_slope():
    result = wo.run(FALL)
    time = result["time"].values
    fallen = result["position"].values - np.array([[0.1], [0.0]])
    way = -G * math.sin(math.pi / 6) * time**2 / 2
    assert fallen == pytest.approx(np.stack([way, way]), abs=1e-9)
    assert result.trust["slope"]["pull"] == pytest.approx([0.1 * G, 0.25 * G])


def test_gravity_is_the_users_and_adds_to_the_load():
    moon = wo.load_scene(FALL, worm={"gravity": "1.625 m/s^2", "load": [0, 1], "slope": -0.1})
    pull = [0.2 * 1.625 * math.sin(-0.1), 0.5 * 1.625 * math.sin(-0.1) + 1]
    assert moon.table.worm.pull == pytest.approx(pull)
    assert "assumed" not in moon.table.facts["slope"]
    scene = wo.load_scene(
        "design_fast_gait", {"worm.gravity": 2, "worm.slope": 0.5, "worm.load": [1, 3]}
    )
    pull = 2 * math.sin(0.5)
    assert scene.table.worm.load_range == pytest.approx((1 + pull, 3 + pull))


def test_what_a_slope_is_worth_to_a_designed_gait():
    """By the formula for two masses in the docstring of `sensitivities`."""
    slope, load = math.radians(10), 5 + G * math.sin(math.radians(10))
    result = wo.run("design_fast_gait", SI | {"worm.links": 1, "worm.slope": slope, "want": []})
    found = result.scalars["sensitivity.slope"]
    assert found.value == pytest.approx(G * math.cos(slope) / (4 * load**2), rel=1e-4)
    assert found.unit == "m s-1 rad-1"


def test_level_ground_says_nothing():
    assert "slope" not in wo.run("fast_gait", {"want": []}).trust


@pytest.mark.parametrize(
    ("name", "change", "key", "said"),
    [
        ("fast_gait", {"worm.slope": 0.1}, "worm.gravity", "missing"),
        ("spiked_chain", {"worm.slope": "5 deg"}, "worm.gravity", "missing"),
        ("fast_gait", SI | {"worm.slope": 6}, "worm.slope", ', for example "6 deg"'),
        ("compare_tracking", SI | {"worm.slope": 0.1}, "worm.slope", "drawn masses"),
    ],
)
def test_what_a_slope_cannot_be(name: str, change: dict[str, object], key: str, said: str):
    with pytest.raises(SceneError) as caught:
        wo.load_scene(name, change)
    assert any(key == where and said in what for where, what in caught.value.faults)
