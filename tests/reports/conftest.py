"""Results that several files of this folder report."""

from pathlib import Path

import pytest

import wormopt as wo
from tests.oracles.by_sweep import make_sweep
from wormopt.result import Result


@pytest.fixture(scope="session")
def gait() -> Result:
    return wo.run("fast_gait")


@pytest.fixture(scope="module")
def sweep(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_sweep(tmp_path_factory.mktemp("sweep"))


@pytest.fixture
def unpainted(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures take seconds: only tests that ask for `painted` have them."""
    if "painted" not in request.fixturenames:
        monkeypatch.setattr("wormopt.reports.report.pictures", lambda *_, **__: iter(()))
        for module in ("worm", "sweep"):
            monkeypatch.setattr(f"wormopt.reports.{module}.animation", lambda *_: "")
        monkeypatch.setattr("wormopt.reports.sweep.pictures", lambda *_, **__: iter(()))


@pytest.fixture
def painted() -> None:
    """Draw the pictures."""
