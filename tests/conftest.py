"""Results that several files of tests look at."""

import pytest

import wormopt as wo
from wormopt.result import Result


@pytest.fixture(scope="session")
def fig05() -> Result:
    return wo.run("fig05_lambda_trackers")
