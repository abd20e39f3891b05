"""Points of any study: read or computed once, and lost with a reason."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from wormopt.errors import Interrupted, SceneError, SolveError
from wormopt.families.points import points
from wormopt.families.store import Store
from wormopt.numerics.workers import Engine, using
from wormopt.progress import silent
from wormopt.quantities import Scalar
from wormopt.result import Result, Variable
from wormopt.study import Study, number


class Root(Study):
    """The square root of a number."""

    square: float = number("", "the square")


CALLS: list[float] = []


def root(study: Root) -> Result:
    CALLS.append(study.square)
    if study.square == -1:
        raise SolveError("there is no root")
    if study.square == -2:
        raise SceneError("root", [("square", "is negative")])
    if study.square == -3:
        raise KeyboardInterrupt
    if study.square == -4:
        raise ZeroDivisionError("oh")
    return Result("root", "", scalars={"root": Scalar(study.square**0.5)})


@pytest.fixture(autouse=True)
def serial() -> Iterator[None]:
    CALLS.clear()
    with using(Engine("serial")):
        yield


def roots(folder: Path, *squares: float) -> list[float | str]:
    """Root at each square, or its status and reason."""
    studies = [Root(square=square) for square in squares]
    found = points(studies, root, Store(folder), silent)
    return [
        f"{point.status}: {point.reason}" if point.is_poor else point.scalars["root"].value
        for point in found
    ]


def test_points_come_in_order_and_are_computed_once(tmp_path: Path):
    assert roots(tmp_path, 9.0, 4.0, 9.0) == [3, 2, 3]
    assert CALLS == [9, 4]
    assert roots(tmp_path, 4.0, 16.0) == [2, 4]
    assert CALLS == [9, 4, 16]


def test_a_point_without_a_solution_is_kept_with_its_reason(tmp_path: Path):
    for _ in range(2):
        lost = ["failed: there is no root", "refused: square: is negative", 1]
        assert roots(tmp_path, -1.0, -2.0, 1.0) == lost
    assert CALLS == [-1, -2, 1]


def test_a_defect_costs_its_point_only_and_is_tried_again(tmp_path: Path):
    for _ in range(2):
        said = "failed: ZeroDivisionError: oh; please report this"
        assert roots(tmp_path, -4.0, 1.0) == [said, 1]
    assert CALLS == [-4, 1, -4]


def test_an_interruption_hands_on_what_is_there(tmp_path: Path):
    with pytest.raises(Interrupted) as stop:
        roots(tmp_path, 4.0, -3.0, 9.0)
    assert [point.status for point in stop.value.partial] == ["ok", *["not computed"] * 2]
    assert roots(tmp_path, 4.0, 9.0) == [2, 3]
    assert CALLS == [4, -3, 9]


def test_a_single_result_is_kept_whole_until_it_is_forgotten(tmp_path: Path):
    store, calls = Store(tmp_path / "new"), []

    def work() -> Result:
        calls.append(1)
        return Result("a", "", variables=(Variable("x", "1", ("x",), np.array([1.0, 2.0])),))

    for _ in range(2):
        assert store.result("key", work)["x"].values.tolist() == [1, 2]
    assert len(calls) == 1
    store.forget(["key"])
    store.result("key", work)
    assert len(calls) == 2

    def fails() -> Result:
        raise SolveError("no")

    with pytest.raises(SolveError):
        store.result("other", fails)
    assert {path.suffix for path in store.folder.iterdir()} == {".nc", ".txt"}
