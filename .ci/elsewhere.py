"""Pytest plugin that runs the tests as another machine might, for `.ci/run --elsewhere`.

Numbers that the scene reader and a model's signals give are moved by one or two units in the last
place, equal ones alike; C is compiled at -O1 without fused multiplication; files of tests, and the
tests within each, are run in another order. Child processes keep the numbers as written.
"""

import random
import sys
from collections.abc import Callable
from itertools import groupby
from typing import Any

import numpy as np
import pytest

from wormopt.model import values
from wormopt.scene import read
from wormopt.simulation.native import build

SEED = 1


def moved(number: float) -> float:
    """Move a number by one or two units in the last place."""
    if number == 0 or not np.isfinite(number):
        return number
    steps = random.Random(f"{SEED} {number!r}").choice((-2, -1, 1, 2))  # noqa: S311
    return number * (1 + steps * sys.float_info.epsilon)


def pytest_configure() -> None:
    """Change what is read, and how C is compiled."""
    read_value, signal_values = read.read_value, values.signal_values

    def reading(*given: Any) -> Any:
        value = read_value(*given)
        return moved(value) if type(value) is float else value

    def stacking(*given: Any, **more: Any) -> np.ndarray:
        return np.array([moved(float(value)) for value in signal_values(*given, **more)])

    _put_in_place(read_value, reading)
    _put_in_place(signal_values, stacking)
    build._FLAGS = (*build._FLAGS, "-O1", "-ffp-contract=off")  # noqa: SLF001


def _put_in_place(old: Callable[..., Any], new: Callable[..., Any]) -> None:
    """Replace a function in every module that has imported it."""
    for module in [m for name, m in sys.modules.items() if name.startswith("wormopt")]:
        for name, thing in list(vars(module).items()):
            if thing is old:
                setattr(module, name, new)


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Shuffle files, and the tests of each."""
    chance = random.Random(SEED)  # noqa: S311
    files = [list(tests) for _, tests in groupby(items, key=lambda item: item.path)]
    chance.shuffle(files)
    for tests in files:
        chance.shuffle(tests)
    items[:] = [test for tests in files for test in tests]
