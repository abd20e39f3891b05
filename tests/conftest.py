"""Results that several files of tests look at."""

import gc
import os
import signal
from typing import Any

# Tests run in as many processes as there are cores: threads of their own would only get in each
# other's way. It must be said before numpy is loaded.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

# Collecting and rewriting so many tests leaves a large heap that lives to the end; going through it
# at the usual rate costs a quarter of the time of collection.
gc.set_threshold(100_000, 20, 20)

# What runs in the background is started with Ctrl-C ignored, which some tests press.
signal.signal(signal.SIGINT, signal.default_int_handler)

import pytest  # noqa: E402
from effort import FULL, examples  # noqa: E402
from hypothesis import HealthCheck, settings  # noqa: E402

import wormopt as wo  # noqa: E402
from wormopt.result import Result  # noqa: E402
from wormopt.simulation.native.build import compiler  # noqa: E402

COMPILED = ("native", "lanes")  # routes of simulations


def pytest_configure(config: pytest.Config) -> None:
    if not str(config.getoption("markexpr")).startswith("not slow"):
        os.environ[FULL] = "1"
    # Fast runs are the same every time: what chance finds is found by those with the slow tests,
    # and not in the way of a change that has nothing to do with it.
    fast = not os.environ.get(FULL)
    # How long an example takes is no reason to fail: it depends on the load. A test that suppresses
    # other health checks must name `too_slow` too.
    settings.register_profile(
        "effort",
        max_examples=examples(100),
        derandomize=fast,
        deadline=None,
        suppress_health_check=[HealthCheck.too_slow],
    )
    settings.load_profile("effort")


def pytest_collection_finish() -> None:
    gc.freeze()  # what was collected stays: nothing goes through it again


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Skip tests of compiled code where there is no C compiler."""
    if compiler():
        return
    for item in items:
        given = getattr(item, "callspec", None)
        values = given.params.values() if given else ()
        compiled = any(isinstance(value, str) and value in COMPILED for value in values)
        if compiled or item.get_closest_marker("compiled"):
            item.add_marker(pytest.mark.skip(reason="there is no C compiler"))


@pytest.fixture(scope="session")
def control() -> Any:
    return pytest.importorskip("control")


@pytest.fixture(scope="session")
def fig05() -> Result:
    return wo.run("fig05_lambda_trackers")
