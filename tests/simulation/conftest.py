"""Routes, and compilers that are not there, with what they made forgotten."""

from collections.abc import Iterator

import pytest

from wormopt.simulation import routes
from wormopt.simulation.native import build, kernel, model_code
from wormopt.simulation.options import Route


@pytest.fixture(scope="module", params=["native", "python"])
def route(request: pytest.FixtureRequest) -> Route:
    """Compiled steps, and the same in Python."""
    return request.param


@pytest.fixture
def unaided(route: Route, monkeypatch: pytest.MonkeyPatch) -> None:
    """What compiled steps refuse would be done in Python, unseen: that is forbidden here."""
    if route == "native":
        monkeypatch.setattr(routes, "_in_python", None)


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
