"""Pages of the kinds of scene and JSON Schemas say what the tables say."""

import json
import re
import tomllib
from collections.abc import Container, Iterator
from functools import cache
from typing import Any

import jsonschema
import msgspec
import pytest
from hints import Capture, Patch
from places import DOCS

from wormopt.cli import main
from wormopt.errors import SceneError
from wormopt.kinds import KINDS
from wormopt.quantities import unit_of
from wormopt.study import load_scene, packaged_scenes
from wormopt.study.given import Given, default_of, meaning
from wormopt.study.reference import page, schema, tables_below, taken
from wormopt.study.template import template

SCENES = DOCS / "scenes.md"


def keys_of(table: type[msgspec.Struct], path: str, refused: Container[str]) -> Iterator[str]:
    """Key paths that a kind takes, and those of tables with tags."""
    for key, _, parts in taken(table, path, refused):
        yield key
        for part in parts:
            tag = part.__struct_config__.tag
            yield from [f"{key}.{tag}"] if tag else []
            yield from keys_of(part, key, refused)


@pytest.mark.parametrize("kind", KINDS)
def test_the_page_of_a_kind_says_all(kind: str):
    table, rows = KINDS[kind].load(), set[str]()
    for line in page(kind).splitlines():
        rows |= {line.partition(" |")[0]} if line.startswith("| `") else set()
    known = {key for part in tables_below(table) for key in part.__struct_fields__}
    keys = known & {key.rpartition(".")[2] for key in keys_of(table, "", table.refuses)}
    unsaid = {"kind", "title", "units"}  # what holds for all scenes
    assert {f"| `{name}`" for name in (keys - unsaid)} - {"| `schema`"} <= rows
    assert {f"| `{name}`" for name in (*table.scalars, *table.variables)} <= rows


def test_the_page_of_a_kind_distinguishes_tables_and_lists_of_tables():
    rows = [line.split(" | ") for line in page("fit").splitlines() if line.startswith("| `")]
    values = {row[0]: (row[1], row[3]) for row in rows if len(row) == 5}
    assert values["| `recording`"] == ("a list of tables", "required")
    assert values["| `columns`"] == ("a table", "`{}`")


def test_every_kind_is_in_the_table_of_scenes():
    table = SCENES.read_text(encoding="utf-8")
    assert [kind for kind in KINDS if f"| [`{kind}`](scenes/{kind}.md) |" not in table] == []


@pytest.mark.parametrize("kind", KINDS)
def test_every_key_says_what_it_means(kind: str):
    for table in tables_below(KINDS[kind].load()):
        for field in msgspec.structs.fields(table):
            if field.name != "kind":
                quantity, what = meaning(field.type)
                assert what, f"{table.__name__}.{field.name}"
                assert not quantity or unit_of(quantity, "SI")


@pytest.mark.parametrize("kind", KINDS)
def test_every_quantity_of_a_result_has_a_unit_and_a_meaning(kind: str):
    table = KINDS[kind].load()
    declared = [*table.scalars.values(), *((q, what) for q, _, what in table.variables.values())]
    assert declared
    for quantity, what in declared:
        assert unit_of(quantity, "SI")
        assert what


@cache
def validator(kind: str) -> jsonschema.Draft202012Validator:
    found = schema(kind)
    jsonschema.Draft202012Validator.check_schema(found)
    return jsonschema.Draft202012Validator(found)


@pytest.mark.parametrize("name", packaged_scenes())
def test_packaged_scenes_keep_to_the_schema(name: str):
    raw = tomllib.loads(packaged_scenes()[name].read_text(encoding="utf-8"))
    (only,) = validator(raw["kind"]).iter_errors({**raw, "no_such_key": 1})
    assert "no_such_key" in only.message


@pytest.mark.parametrize("kind", KINDS)
def test_the_schema_has_the_defaults_of_the_kind(kind: str):
    """Editors show defaults of keys: those of a table in part are those of its key."""
    table, defined = KINDS[kind].load(), schema(kind)["$defs"]
    for field in msgspec.structs.fields(table):
        given = default_of(field)
        if not isinstance(given, Given) or given.__struct_config__.tag_field:
            continue
        node = defined[table.__name__]["properties"][field.encode_name]
        ref = node["$ref"].rpartition("/")[2] if "$ref" in node else ""
        shown = (defined[ref] if ref else node)["properties"]
        for key, value in json.loads(msgspec.json.encode(given)).items():
            if f"{field.encode_name}.{key}" in table.refuses:
                assert key not in shown
            elif "default" in shown[key]:
                assert json.loads(json.dumps(shown[key]["default"])) == value, (field.name, key)
            else:  # a class
                assert "$ref" in shown[key], (field.name, key)


FIXED = {"process": "fixed", "spread": 0.1}


@pytest.mark.parametrize(
    ("scene", "path", "value"),
    [
        ("optimal_crawl", "worm.random", {"stiffness": FIXED}),
        ("track_predictive", "worm.slope", 0.1),
        ("track_predictive", "worm.friction.viscous", {"kind": "viscous", "drag": 1.0}),
        ("track_predictive", "worm.friction.viscous", 3 * [{"kind": "viscous", "drag": 1.0}]),
        ("linear_chain", "tracker.feedforward", {}),
        ("friction_gait", "gait.impulses", True),
        ("fit_then_design", "gait.impulses", True),
        ("pareto_speed_load", "search.certify", {}),
    ],
)
def test_what_a_kind_refuses_is_offered_nowhere(scene: str, path: str, value: Any):
    """In no template, page or schema; and it is refused with only the reason of the kind."""
    raw = tomllib.loads(packaged_scenes()[scene].read_text(encoding="utf-8"))
    table, kind = KINDS[raw["kind"]].load(), raw["kind"]
    key = path.removesuffix(".viscous")
    *above, last = key.split(".")
    inside = raw
    for name in above:
        inside = inside.setdefault(name, {})
    inside[last] = value
    with pytest.raises(SceneError) as refused:
        load_scene(raw)
    assert {reason for _, reason in refused.value.faults} == {table.refuses[path]}
    assert not validator(kind).is_valid(raw)
    # each that is refused is a key, and the page and the template show others only
    assert {*table.refuses} <= {*keys_of(table, "", ())}
    for text in (page(kind), template(kind, "schema.json")):
        assert not re.search(rf"^#?\W*{re.escape(path)}\b", text, re.MULTILINE)
        assert path == key or '"viscous"' not in text
    assert f"#{last} = " not in template(kind, "schema.json")


def test_advice_names_no_key_that_the_kind_refuses():
    raw = tomllib.loads(packaged_scenes()["friction_gait"].read_text(encoding="utf-8"))
    del raw["gait"]["acceleration"]
    with pytest.raises(SceneError, match=r"gait\.acceleration: missing") as refused:
        load_scene(raw)
    assert "impulses" not in str(refused.value)


def test_nothing_of_what_a_kind_refuses_is_accepted():
    film = load_scene("fig27_float", "film.tension=0").table.film
    assert not film.tension
    with pytest.raises(SceneError, match="no effect on floats"):
        load_scene("fig27_float", "film.tension=0.1")


def test_the_command_prints_the_schema(capsys: Capture):
    assert main(["schema", "film-flow"]) == 0
    assert json.loads(capsys.readouterr().out) == json.loads(json.dumps(schema("film-flow")))


def test_help_shows_the_page_of_a_kind(capsys: Capture, monkeypatch: Patch):
    assert main(["help", "gait"]) == 0
    assert capsys.readouterr().out == page("gait")
    monkeypatch.setenv("COLUMNS", "100")
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    assert main(["help", "gait"]) == 0
    shown = re.sub(r"\x1b\[[\d;]*m", "", capsys.readouterr().out)
    for markup in ("](", "<sub>", "|---", "## "):
        assert markup not in shown
    for text in ("Scenes of kind gait", "[worm]", "_i", "docs/scenes.md"):  # "m" may end a line
        assert text in shown
    assert main(["help"]) == 0
    assert "COMMAND" in capsys.readouterr().out
