"""Results that several files of this folder export."""

import pytest
from places import SAVED

import wormopt as wo
from wormopt.result import Result


@pytest.fixture(scope="session")
def fast() -> Result:
    return wo.run("fast_gait")


@pytest.fixture(scope="session")
def walk() -> Result:
    """A gait in SI units, whose cycle is no multiple of 10 ms."""
    scene = {"units": "SI", "gait": {"period": 37 / 30, "rest_length": 0.07, "elongation": 0.2}}
    return wo.run("fast_gait", scene)


@pytest.fixture(scope="session")
def designed() -> Result:
    """A gait of polynomials that runs as its cycle begins."""
    return Result.load(SAVED / "certified_gait.nc")
