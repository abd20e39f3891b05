"""Pytest plugin that runs the tests as another machine might, for `.ci/run --elsewhere`.

Numbers of scenes that are run, and of a model's signals, are moved by one or two units in the last
place, equal ones alike, unless they are multiples of 1/8, as bounds of keys are. Files of tests,
and the tests within each, are run in another order. Child processes keep the numbers as they are
written.
"""

import random
import sys
from collections.abc import Callable
from itertools import groupby
from typing import Any

import msgspec
import numpy as np
import pytest

from wormopt.model import values
from wormopt.study import Study

SEED = 1


def moved(value: Any) -> Any:
    """Move numbers by one or two units in the last place, but for eighths."""
    if isinstance(value, msgspec.Struct):
        inside = {name: moved(getattr(value, name)) for name in value.__struct_fields__}
        return msgspec.structs.replace(value, **inside)
    if isinstance(value, tuple):
        return tuple(map(moved, value))
    if not isinstance(value, float) or not np.isfinite(value) or (8 * value).is_integer():
        return value
    steps = random.Random(f"{SEED} {value!r}").choice((-2, -1, 1, 2))  # noqa: S311
    return value * (1 + steps * sys.float_info.epsilon)


def pytest_configure() -> None:
    """Change what is computed with."""
    result, signal_values = Study.result, values.signal_values

    def with_numbers_moved(study: Study, report: Any = None) -> Any:
        other = moved(study)
        other.placed(study.name, study.folder)
        return result(other, report)

    def stacked(*given: Any, **more: Any) -> np.ndarray:
        return np.array([moved(float(value)) for value in signal_values(*given, **more)])

    Study.result = with_numbers_moved
    _put_in_place(signal_values, stacked)


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
