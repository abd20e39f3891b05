"""What several files of this folder simulate without."""

from collections.abc import Iterator

import pytest

from wormopt.simulation.native import build, kernel, model_code


@pytest.fixture
def no_compiler(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Hide the compiler and forget what it has made."""
    caches = (kernel.driver, model_code._library, kernel.compiled)
    monkeypatch.setattr(build, "compiler", lambda: None)
    for cache in caches:
        cache.cache_clear()
    yield
    for cache in caches:
        cache.cache_clear()
