"""What several files of this folder begin with."""

import pytest
from small_kinds import CALLS, FAIL


@pytest.fixture
def fresh() -> None:
    CALLS.clear()
    FAIL.clear()
