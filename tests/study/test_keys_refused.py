"""Every key of every kind refuses what its declaration does not allow, and says what to write."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cache
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin

import msgspec
import pytest

import wormopt as wo
from wormopt.errors import Fault
from wormopt.kinds import KINDS
from wormopt.study.given import Given, read_table, read_value
from wormopt.study.reference import tables_below

WRONG: list[Any] = [None, True, "no such text", {}, [[]], math.nan, object()]


@cache
def tables() -> list[type[Given]]:
    """Tables of all kinds, each once."""
    of_kinds = [part for kind in KINDS.values() for part in tables_below(kind.load())]
    return list(dict.fromkeys(part for part in of_kinds if issubclass(part, Given)))


def faults(field: msgspec.structs.FieldInfo, value: Any) -> list[Fault]:
    """What is said of a value of a key by itself."""
    found: list[Fault] = []
    read_value(value, field.type, field.name, "", found)
    return found


def metas(kind: Any) -> Iterator[tuple[type, dict[str, float]]]:
    """Yield the numbers that a type takes, and their bounds."""
    if kind in (int, float):
        yield kind, {}
    if get_origin(kind) in (Union, UnionType):
        for part in get_args(kind):
            yield from metas(part)
    if get_origin(kind) is Annotated:
        inner, *said = get_args(kind)
        bounds = {
            name: bound
            for meta in said
            if isinstance(meta, msgspec.Meta)
            for name in ("gt", "ge", "lt", "le")
            if (bound := getattr(meta, name)) is not None
        }
        for number, more in metas(inner):
            yield number, more | bounds


def next_to(number: type, bound: float, towards: float) -> float:
    return bound + math.copysign(1, towards) if number is int else math.nextafter(bound, towards)


FIELDS = [(table, field) for table in tables() for field in msgspec.structs.fields(table)]


def test_there_are_many_keys():
    assert len(FIELDS) > 1000


def test_values_of_a_wrong_type_are_refused():
    for table, field in FIELDS:
        refused = 0
        for value in WRONG:
            found = faults(field, value)
            refused += bool(found)
            for key, words in found:
                where = f"{table.__name__}.{key}: {words}"
                assert words.isprintable(), where
                assert any(s in words for s in ("; write ", "did you mean", "unknown key")), where
        assert refused >= 3, (table, field.name)
        assert faults(field, object()), (table, field.name)


def test_numbers_beyond_their_bounds_are_refused_and_others_are_not():
    looked = 0
    for table, field in FIELDS:
        allowed = [*metas(field.type)]
        if len(allowed) != 1:
            continue
        (number, bounds), name = allowed[0], field.name
        for way, bound in bounds.items():
            out, inside = (-math.inf, math.inf) if way in ("gt", "ge") else (math.inf, -math.inf)
            beyond = bound if way in ("gt", "lt") else next_to(number, bound, out)
            least = bound if way in ("ge", "le") else next_to(number, bound, inside)
            where = (table, name, way, bound)
            assert any("is not allowed; write" in w for _, w in faults(field, beyond)), where
            assert not faults(field, least), where
            looked += 1
        default = field.default
        if isinstance(default, int | float) and not isinstance(default, bool):
            assert not faults(field, default), (table, name, default)
    assert looked > 1000


def test_keys_without_a_default_are_missed():
    for table in tables():
        found: list[Fault] = []
        read_table({}, table, "", "", found)
        needed = {f.name for f in msgspec.structs.fields(table) if f.required}
        assert needed <= {key for key, words in found if words.startswith("missing; write ")}, table


def test_a_key_near_a_known_one_is_meant():
    for table, field in FIELDS:
        known = {*table.__struct_fields__, table.__struct_config__.tag_field}
        near, found = field.name + field.name[-1], list[Fault]()
        if near in known or len(field.name) < 3:
            continue
        assert read_table({near: 1}, table, "", "", found) is None
        said = dict(found)[near]
        assert said.rpartition("did you mean ")[2].rstrip("?") in known, (table, near, said)


@pytest.mark.parametrize(
    ("scene", "key", "now"),
    [
        ("coil_cargo", "course.switches", "time"),
        ("coil_cargo", "coils.inner", "inner_radius"),
        ("coil_cargo", "cargo.modulus", "youngs_modulus"),
        ("coil_cargo", "switching.rate", "frequency"),
        ("fig21_rod_motion", "time.duration", "end"),
        ("coil_cargo_design", "time.time", "end"),
        ("optimal_crawl", "aim.speed", "objective"),
        ("track_optimal", "grid.arcs", "mesh"),
        ("planar_path", "course.clearance", "route"),
        ("planar_turn_in_place", "pace.joint", "rate"),
        ("peristaltic_segment", "tube.radius", "pipe"),
        ("membrane", "points", "samples"),
        ("three_masses_harmonic", "course.velocity", "start"),
        ("fig22_frequency_response", "rates", "frequencies"),
    ],
)
def test_a_key_of_before_is_refused_with_its_name_of_today(scene: str, key: str, now: str):
    with pytest.raises(wo.SceneError, match=rf"unknown key; did you mean {now}\?"):
        wo.load_scene(scene, {key: 1})
