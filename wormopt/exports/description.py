"""Completes the descriptions in an FMU from CasADi: adds units, removes unused parts."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

from wormopt.units import parsed
from wormopt.version import VERSION


def mend_description(path: Path, name: str, text: str, timed: bool) -> None:
    """Complete ``modelDescription.xml``.

    `name` and `text` are the model's, `timed`: whether it depends on time itself.
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
    exchange = root.find("ModelExchange")
    assert exchange is not None
    exchange.set("canGetAndSetFMUState", "true")
    after = [*root].index(exchange) + 1
    stepped = {"canHandleVariableCommunicationStepSize": "true"}
    root.insert(after, ElementTree.Element("CoSimulation", {**exchange.attrib, **stepped}))
    after += 1
    root.insert(after, ElementTree.Element("DefaultExperiment", startTime="0"))
    if units:
        defined = ElementTree.Element("UnitDefinitions")
        defined.extend(_unit(str(name)) for name in units)
        root.insert(after, defined)
    _write(root, path)


def only_sources(path: Path) -> None:
    """Remove headers from ``buildDescription.xml``: they are no compilation units."""
    root = ElementTree.parse(path).getroot()  # noqa: S314  CasADi has just written it
    for files in root.iter("SourceFileSet"):
        for file in [*files]:
            if file.get("name", "").endswith(".h"):
                files.remove(file)
    _write(root, path)


def _unit(name: str) -> ElementTree.Element:
    found = ElementTree.Element("Unit", name=name)
    try:
        factor, powers = parsed(name)
    except ValueError:
        return found  # a user's unit: only its name is known
    attributes = {base: str(power) for base, power in powers.items()}
    if factor != 1:
        attributes["factor"] = repr(float(factor))
    found.append(ElementTree.Element("BaseUnit", attributes))
    return found


def _write(root: ElementTree.Element, path: Path) -> None:
    ElementTree.indent(root, "    ")
    ElementTree.ElementTree(root).write(path, encoding="UTF-8", xml_declaration=True)
