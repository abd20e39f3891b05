"""Compilers that are not there, and what they made forgotten."""

from collections.abc import Iterator

import pytest

from wormopt.simulation.native import build, kernel, model_code


@pytest.fixture
def forgotten() -> Iterator[None]:
    """What was compiled before in this process does not count."""
    caches = (kernel.driver, model_code._library, kernel.compiled)
    for cache in caches:
        cache.cache_clear()
    yield
    for cache in caches:
        cache.cache_clear()


@pytest.fixture
def no_compiler(forgotten: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Hide the compiler and forget what it has made."""
    monkeypatch.setattr(build, "compiler", lambda: None)
