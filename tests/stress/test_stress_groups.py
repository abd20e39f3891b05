"""Groups of the stress matrix that ask for one answer: cases are right, spoilt answers wrong."""

import pickle
import zlib
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tests.stress import (
    bodies,
    carried,
    fields,
    films,
    matrix,
    peristaltic_gaits,
    peristaltic_worms,
    rods,
    rows,
    segments,
    swimmers,
)
from tests.stress.means import refused
from wormopt.errors import ArgumentError

GROUPS = ("films", "bodies", "fields", "segments", "swimmers")
HEAVY = ("films", "fields")
LONG = {
    "vibrations of rods",
    "damping of rods",
    "membranes at rest",
    "strokes of crawls",
    "best strokes",
}


@pytest.mark.compiled
@pytest.mark.parametrize(
    "group", [pytest.param(one, marks=[pytest.mark.slow] * (one in HEAVY)) for one in GROUPS]
)
def test_some_cases_of_each_kind_are_right(group: str):
    first = {case.group: case for case in reversed(matrix.cases(group, quick=True))}
    for case in first.values():
        if case.group not in LONG:
            found = case.judge()
            assert found.verdict == "right", found


@pytest.mark.slow
@pytest.mark.parametrize("group", GROUPS)
def test_no_case_is_wrong(group: str):
    found = [case.judge() for case in matrix.cases(group, quick=False)]
    assert not [v for v in found if v.verdict in ("wrong", "undecided")]
    assert sum(v.verdict == "right" for v in found) >= 0.95 * len(found)
    assert all(len(v.reason.split()) > 5 for v in found if v.verdict == "refused")


def test_names_are_unique_and_cases_may_be_sent_to_workers():
    cases = [case for group in GROUPS for case in matrix.cases(group, quick=False)]
    assert len({zlib.crc32(case.name.encode()) for case in cases}) == len(cases) >= 500
    assert pickle.loads(pickle.dumps(cases[0])).name == cases[0].name


# Groups that the cases of modules which are not one belong to.
PARTS = {"peristaltic_gaits": "segments", "peristaltic_worms": "segments", "rods": "bodies",
         "carried": "films", "rows": "fields"}  # fmt: skip

SPOILT: list[tuple[Any, str, str]] = [
    (films, "waves of films", "CosineWave.constant"),
    (films, "floats on films", "float_drift"),
    (bodies, "segments of bodies", "ChannelWorm.arc_length"),
    (bodies, "elastica", "exact_elastica"),
    (fields, "loops", "loop_field"),
    (fields, "coils", "Coil.field"),
    (segments, "segments at rest", "Segment.stretch_at"),
    (peristaltic_gaits, "gaits on drag", "displacement"),
    (swimmers, "swimmers", "Swimmer.local"),
    (swimmers, "slow crawls", "crawl_velocity"),
    (carried, "forces on floats", "HeavyFloat.push"),
    (carried, "plates on the ground", "LyingBody.drag"),
    (rods, "rods between walls", "Loaded.rest"),
    (rows, "currents for a field", "fit_currents"),
    (peristaltic_worms, "worms on drag", "Segment.elastic_pull"),
    (peristaltic_worms, "worms on dry ground", "Segment.coil_pull"),
    (peristaltic_worms, "worms in tubes", "Bed.normal_force"),
]


def spoilt(answer: Any) -> Any:
    """An answer off by a share of 1e-5: of numbers, of what is in tuples and in fields."""
    if isinstance(answer, tuple):
        return tuple(spoilt(part) for part in answer)
    if hasattr(answer, "__dataclass_fields__"):
        for name in answer.__dataclass_fields__:
            value = getattr(answer, name)
            if isinstance(value, float | np.ndarray) and np.asarray(value).dtype == float:
                object.__setattr__(answer, name, value * (1 + 1e-5))
        return answer
    return answer * (1 + 1e-5)


@pytest.mark.parametrize(("module", "kind", "name"), SPOILT, ids=[k for _, k, _ in SPOILT])
def test_a_spoilt_answer_is_told_as_wrong(
    module: Any, kind: str, name: str, monkeypatch: pytest.MonkeyPatch
):
    holder, _, last = name.rpartition(".")
    target = getattr(module, holder) if holder else module
    own = getattr(target, last)

    def wrapped(call: Callable[..., Any]) -> Callable[..., Any]:
        return lambda *given, **named: spoilt(call(*given, **named))

    found_by = getattr(own, "fget", None)  # of a property
    changed = property(wrapped(found_by)) if found_by else wrapped(own)
    monkeypatch.setattr(target, last, changed)
    part = module.__name__.rpartition(".")[2]
    group = part if part in GROUPS else PARTS[part]
    case = next(case for case in matrix.cases(group, quick=True) if case.group.startswith(kind))
    found = case.judge()
    assert found.verdict == "wrong", found
    assert "times what is allowed" in found.reason


def test_a_refusal_must_name_what_to_change():
    def raises(text: str) -> Callable[[], None]:
        def call() -> None:
            raise ArgumentError(text)

        return call

    assert refused(raises("delta must be below 1"), "delta", "below 1") == 0
    assert refused(raises("it does not work"), "delta") == np.inf
    assert refused(lambda: 1.0, "delta") == np.inf
