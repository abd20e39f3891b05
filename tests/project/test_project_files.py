"""Files about the project: one version everywhere, citations and recipes that tools can read."""

import re
import tomllib
from typing import Any

import pytest
import yaml
from places import ROOT

from wormopt.version import VERSION

# keys of the Citation File Format 1.2.0
CITATION = set(
    "abstract authors cff-version commit contact date-released doi identifiers keywords license "
    "license-url message preferred-citation references repository repository-artifact "
    "repository-code title type url version".split()
)
REFERENCE = set(
    "abstract authors collection-title doi editors isbn notes publisher start title type year "
    "end".split()
)
PERSON = {"family-names", "given-names"}
ENTITY = {"name", "city", "country"}


def yaml_of(name: str) -> Any:
    return yaml.safe_load((ROOT / name).read_text(encoding="utf-8"))


def project() -> dict[str, Any]:
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def test_the_citation_is_valid():
    cited = yaml_of("CITATION.cff")
    assert set(cited) <= CITATION
    assert {"authors", "cff-version", "message", "title"} <= set(cited)
    assert (cited["cff-version"], cited["type"]) == ("1.2.0", "software")
    assert (cited["version"], cited["license"]) == (VERSION, project()["license"])
    assert set(cited["keywords"]) == set(project()["keywords"])
    (chapter,) = cited["references"]
    assert set(chapter) <= REFERENCE
    assert {"authors", "title", "type"} <= set(chapter)
    assert (chapter["year"], chapter["start"]) == (2007, "429")
    people = [*chapter["authors"], *chapter["editors"]]
    assert all(set(person) == PERSON for person in people)
    assert all(set(entity) <= ENTITY for entity in [*cited["authors"], chapter["publisher"]])


def test_the_recipe_has_the_version_and_the_dependencies_of_the_package():
    recipe = yaml_of(".ci/recipe.yaml")
    assert recipe["context"]["version"] == VERSION
    assert recipe["about"]["summary"] == project()["description"]
    needed = {re.sub(r"\s", "", line) for line in recipe["requirements"]["run"]}
    needed.remove(f"python{project()['requires-python']}")
    # conda has Matplotlib without GUI toolkits under another name
    own = {line.replace("matplotlib>", "matplotlib-base>") for line in project()["dependencies"]}
    assert needed == own


def test_tables_of_xarray_and_pandas_have_an_extra():
    extras = project()["optional-dependencies"]
    needed = {line for line in extras["test"] if line.startswith(("pandas", "xarray"))}
    assert set(extras["data"]) == needed


@pytest.mark.parametrize("name", ["bug", "wrong_number", "new_kind"])
def test_an_issue_template_has_a_name_and_says_what_it_is_about(name: str):
    text = (ROOT / f".github/ISSUE_TEMPLATE/{name}.md").read_text(encoding="utf-8")
    _, head, body = text.split("---\n", 2)
    assert set(yaml.safe_load(head)) == {"name", "about", "labels"}
    assert "**" in body
