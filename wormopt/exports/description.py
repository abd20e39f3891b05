"""The descriptions in an FMU, as CasADi writes them, made whole: units defined, no clutter."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path
from xml.etree import ElementTree

from wormopt.version import VERSION

# Exponents of the base units, and the factor, of those that our units are made of.
_BASES: dict[str, dict[str, float]] = {
    "N": {"kg": 1, "m": 1, "s": -2},
    "J": {"kg": 1, "m": 2, "s": -2},
    "W": {"kg": 1, "m": 2, "s": -3},
    "Pa": {"kg": 1, "m": -1, "s": -2},
    "T": {"kg": 1, "s": -2, "A": -1},
    "Oe": {"A": 1, "m": -1, "factor": 79.57747154594767},
    **{base: {base: 1} for base in ("kg", "m", "s", "A", "K", "mol", "cd", "rad")},
}


def mend_description(path: Path, name: str, text: str, timed: bool) -> None:
    """Complete ``modelDescription.xml``.

    `name` and `text` are the model's, `timed` says whether it depends on time itself.
    """
    root = ElementTree.parse(path).getroot()  # noqa: S314  CasADi has just written it
    root.set("modelName", name)
    root.set("description", text)
    root.set("generationTool", f"wormopt {VERSION}, {root.get('generationTool')}")
    variables, structure = root.find("ModelVariables"), root.find("ModelStructure")
    assert variables is not None
    assert structure is not None
    for variable in [*variables]:
        if variable.get("name", "").startswith("__assign__"):  # CasADi's own
            variables.remove(variable)
    for unknown in structure.iter("InitialUnknown"):  # parameters are missing there
        unknown.attrib.pop("dependencies", None)
    for unknown in (*structure.iter("Output"), *structure.iter("ContinuousStateDerivative")):
        if timed:
            unknown.set("dependencies", f"0 {unknown.get('dependencies', '')}".strip())
    units = {v.get("unit"): None for v in variables if v.get("unit")}
    places = [*root]
    after = places.index(root.find("ModelExchange")) + 1  # pyright: ignore[reportArgumentType]
    root.insert(after, ElementTree.Element("DefaultExperiment", startTime="0"))
    if units:
        defined = ElementTree.Element("UnitDefinitions")
        defined.extend(_unit(str(name)) for name in units)
        root.insert(after, defined)
    _write(root, path)


def only_sources(path: Path) -> None:
    """Take headers out of ``buildDescription.xml``: they are no units to compile."""
    root = ElementTree.parse(path).getroot()  # noqa: S314  CasADi has just written it
    for files in root.iter("SourceFileSet"):
        for file in [*files]:
            if file.get("name", "").endswith(".h"):
                files.remove(file)
    _write(root, path)


def _unit(name: str) -> ElementTree.Element:
    found = ElementTree.Element("Unit", name=name)
    powers, factor = Counter[str](), 1.0
    for word in name.split():
        match = re.fullmatch(r"([A-Za-z]+)(-?\d*)", word)
        if match is None or match[1] not in _BASES:
            return found  # a user's own: a name is all that is known
        power = int(match[2] or 1)
        for base, exponent in _BASES[match[1]].items():
            if base == "factor":
                factor *= exponent**power
            else:
                powers[base] += int(exponent) * power
    attributes = {base: str(power) for base, power in powers.items() if power}
    if factor != 1.0:
        attributes["factor"] = repr(factor)
    found.append(ElementTree.Element("BaseUnit", attributes))
    return found


def _write(root: ElementTree.Element, path: Path) -> None:
    ElementTree.indent(root, "    ")
    ElementTree.ElementTree(root).write(path, encoding="UTF-8", xml_declaration=True)
