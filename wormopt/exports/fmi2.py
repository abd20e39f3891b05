"""FMI 2.0: the description of an FMU by that of FMI 3.0, whose variables are scalar and real.

The functions are in `fmi2.c`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from xml.etree.ElementTree import Element, SubElement

_HEAD = (
    "modelName", "description", "generationTool", "generationDateAndTime",
    "variableNamingConvention",
)  # fmt: skip
_OF_VARIABLE = ("name", "valueReference", "description", "causality", "variability", "initial")
_OF_REAL = ("unit", "min", "max", "nominal", "start")
_STRUCTURE = {
    "Outputs": "Output",
    "Derivatives": "ContinuousStateDerivative",
    "InitialUnknowns": "InitialUnknown",
}


def description(three: Element, sources: Iterable[str]) -> Element:
    """``modelDescription.xml`` of FMI 2.0; `three` is that of FMI 3.0, `sources` are C files."""
    two = Element("fmiModelDescription", {"fmiVersion": "2.0"} | _some(three, _HEAD))
    two.set("guid", three.get("instantiationToken", ""))
    two.set("numberOfEventIndicators", "0")
    can = {"canGetAndSetFMUstate": "true", "providesDirectionalDerivative": "true"}
    for tag in ("ModelExchange", "CoSimulation"):
        interface = SubElement(two, tag, _some(three.find(tag), ("modelIdentifier",)) | can)
        files = SubElement(interface, "SourceFiles")
        for source in sources:
            SubElement(files, "File", name=source)
    interface.set("canHandleVariableCommunicationStepSize", "true")
    two.extend(part for part in three if part.tag in ("UnitDefinitions", "DefaultExperiment"))

    variables = [*three.iterfind("ModelVariables/*")]
    # FMI 2.0 counts variables from 1 where FMI 3.0 uses references
    places = {each.get("valueReference"): str(k) for k, each in enumerate(variables, start=1)}
    written = SubElement(two, "ModelVariables")
    for each in variables:
        real = SubElement(
            SubElement(written, "ScalarVariable", _some(each, _OF_VARIABLE)),
            "Real",
            _some(each, _OF_REAL),
        )
        if "derivative" in each.attrib:
            real.set("derivative", places[each.get("derivative")])
    structure = SubElement(two, "ModelStructure")
    for tag, old in _STRUCTURE.items():
        unknowns = [_unknown(each, places) for each in three.iterfind(f"ModelStructure/{old}")]
        if unknowns:
            SubElement(structure, tag).extend(unknowns)
    return two


def _some(element: Element | None, names: Iterable[str]) -> dict[str, str]:
    attributes = {} if element is None else element.attrib
    return {name: attributes[name] for name in names if name in attributes}


def _unknown(old: Element, places: Mapping[str | None, str]) -> Element:
    found = Element("Unknown", {"index": places[old.get("valueReference")]})
    known = old.get("dependencies")
    if known is not None:
        found.set("dependencies", " ".join(places[each] for each in known.split()))
    return found
