"""Results that several files of tests look at."""

import os
import signal

# Tests run in as many processes as there are cores: threads of their own would only get in each
# other's way. It must be said before numpy is loaded.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

# What runs in the background is started with Ctrl-C ignored, which some tests press.
signal.signal(signal.SIGINT, signal.default_int_handler)

import pytest  # noqa: E402

import wormopt as wo  # noqa: E402
from wormopt.result import Result  # noqa: E402


@pytest.fixture(scope="session")
def fig05() -> Result:
    return wo.run("fig05_lambda_trackers")
