"""The cost of transport is energy by weight and distance: no unit, and SI scenes only."""

import pytest

import wormopt as wo

QUICK = ["worm.links=1", "search.sequence=[[0],[1]]"]


@pytest.mark.parametrize(
    ("name", "changes", "mass"), [("uphill_gait", [], 3.0), ("design_fast_gait", QUICK, 2.0)]
)
def test_energy_by_weight_and_distance(name: str, changes: list[str], mass: float):
    result = wo.run(wo.load_scene(name, [*changes, 'units="SI"']))
    told = result.scalars["cost_of_transport"]
    energy = result.scalars["energy_per_distance"]
    assert (told.unit, energy.unit) == ("1", "J m-1")
    assert told.value == pytest.approx(energy.value / (mass * 9.80665), rel=1e-12)
    assert "9.80665 m/s2" in result.trust["assumptions"]["gravity"]


@pytest.mark.parametrize(
    ("name", "changes"),
    [("uphill_gait", []), pytest.param("design_fast_gait", QUICK, marks=pytest.mark.slow)],
)
def test_without_gravity_there_is_no_weight(name: str, changes: list[str]):
    result = wo.run(wo.load_scene(name, changes))
    assert "cost_of_transport" not in result.scalars
    assert "assumptions" not in result.trust


def test_motors_are_assumed_beside_gravity():
    motor = "motor={lead=0.5, rate_max=2.0, acceleration_max=40.0}"
    result = wo.run(wo.load_scene("design_fast_gait", [*QUICK, motor, 'units="SI"']))
    assert set(result.trust["assumptions"]) == {"motors", "gravity"}
