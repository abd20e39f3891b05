"""Pytest plugin that runs the tests as another machine might, for `.ci/run --elsewhere`.

Numbers of scenes that are run, and of a model's signals, are moved by one or two units in the last
place, equal ones alike, unless they are multiples of 1/8, as bounds of keys are. Files of tests,
and the tests within each, are run in another order. Child processes keep the numbers as they are
written.
"""

import random
import sys
from collections.abc import Callable
from functools import wraps
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
    signal_values = values.signal_values
    for name in ("computed", "_reported"):
        setattr(Study, name, _with_numbers_moved(getattr(Study, name)))

    def stacked(*given: Any, **more: Any) -> np.ndarray:
        return np.array([moved(float(value)) for value in signal_values(*given, **more)])

    _put_in_place(signal_values, stacked)


def _with_numbers_moved(compute: Callable[..., Any]) -> Callable[..., Any]:
    """Move the numbers of a study before anything is computed, once."""

    @wraps(compute)
    def computed(study: Study, *given: Any, **more: Any) -> Any:
        if not vars(study).get("_moved"):
            vars(study)["_moved"] = True
            for name in study.__struct_fields__:
                msgspec.structs.force_setattr(study, name, moved(getattr(study, name)))
        return compute(study, *given, **more)

    return computed


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
