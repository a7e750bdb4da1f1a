"""``modelDescription.xml`` of a unit."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from xml.etree import ElementTree as ET

from ...units import base_units
from ...version import __version__
from ..target import plain_text
from .model import Model, Result, Unit, start_of

_BASE = {
    "kilogram": "kg", "meter": "m", "second": "s", "ampere": "A", "kelvin": "K", "mole": "mol",
    "candela": "cd", "radian": "rad",
}  # fmt: skip
_Attributes = dict[str, str]


def describe(unit: Unit, guid: str) -> bytes:
    """Return the XML."""
    name, model = unit.name, unit.model
    root = ET.Element("fmiModelDescription", {
        "fmiVersion": "2.0", "modelName": name, "guid": guid,
        "description": "; ".join(map(plain_text, [unit.about, *unit.remarks])),
        "version": __version__, "generationTool": f"fluidact-fit {__version__}",
        "variableNamingConvention": "structured",
    })  # fmt: skip
    kind = ET.SubElement(root, "CoSimulation", {
        "modelIdentifier": name, "canHandleVariableCommunicationStepSize": "true",
        "canGetAndSetFMUstate": "true", "canSerializeFMUstate": "true",
    })  # fmt: skip
    ET.SubElement(ET.SubElement(kind, "SourceFiles"), "File", {"name": f"{name}.c"})
    listed = list(_variables(unit))
    _define_units(root, [values["unit"] for _, _, values in listed if "unit" in values])
    logs = ET.SubElement(root, "LogCategories")
    ET.SubElement(logs, "Category", {"name": "logStatusError", "description": "calls refused"})
    if unit.period > 0.0:
        ET.SubElement(root, "DefaultExperiment", {"stepSize": repr(unit.period)})
    variables = ET.SubElement(root, "ModelVariables")
    for of_type, attributes, values in listed:
        ET.SubElement(ET.SubElement(variables, "ScalarVariable", attributes), of_type, values)
    _structure(root, model, [attributes["name"] for _, attributes, _ in listed])
    ET.indent(root)
    return ET.tostring(root, encoding="UTF-8", xml_declaration=True) + b"\n"


def _variables(unit: Unit) -> Iterator[tuple[str, _Attributes, _Attributes]]:
    """Yield type, attributes of the variable, and attributes of its type."""
    model, reference = unit.model, 0
    for a in model.inputs:
        given = {"causality": "input", "variability": "continuous"}
        values = {"unit": plain_text(a.unit), "min": repr(a.low), "max": repr(a.high)}
        start = {"start": repr(start_of(a))}
        yield "Real", _named(a.name, reference, a.about) | given, values | start
        reference += 1
    for s in (*model.parameters, *unit.constants):
        fixed = s in model.parameters
        given = {"causality": "parameter" if fixed else "local",
                 "variability": "fixed" if fixed else "constant", "initial": "exact"}  # fmt: skip
        values = {"unit": plain_text(s.unit), "start": repr(s.value)}
        least = {} if s.minimum is None else {"min": repr(s.minimum)}
        yield "Real", _named(s.name, reference, s.about) | given, values | least
        reference += 1
    for r in model.outputs:
        given = {"causality": "output", "variability": "continuous", "initial": "calculated"}
        values = {"unit": plain_text(r.unit or "1")}
        yield "Real", _named(r.name, reference, r.about) | given, values
        reference += 1
    for k, r in enumerate(model.flags):
        given = {"causality": "output", "variability": "discrete", "initial": "calculated"}
        yield "Boolean", _named(r.name, k, r.about) | given, {}


def _named(name: str, reference: int, about: str) -> dict[str, str]:
    return {"name": name, "valueReference": str(reference), "description": plain_text(about)}


def _define_units(root: ET.Element, units: Sequence[str]) -> None:
    definitions = ET.SubElement(root, "UnitDefinitions")
    for name in dict.fromkeys(units):
        entry = ET.SubElement(definitions, "Unit", {"name": name})
        known = base_units(name)
        if known is not None and all(base in _BASE for base in known[1]):
            powers = {_BASE[base]: str(power) for base, power in known[1].items()}
            factor = {} if known[0] == 1.0 else {"factor": repr(known[0])}
            ET.SubElement(entry, "BaseUnit", powers | factor)


def _structure(root: ET.Element, model: Model, names: Sequence[str]) -> None:
    """Outputs with the inputs on which they depend at once."""
    structure = ET.SubElement(root, "ModelStructure")
    results: list[Result] = [*model.outputs, *model.flags]
    place = {name: k for k, name in enumerate(names, start=1)}
    outputs = ET.SubElement(structure, "Outputs")
    initial = ET.SubElement(structure, "InitialUnknowns")
    for r in results:
        index = {"index": str(place[r.name])}
        depends = " ".join(str(place[name]) for name in r.depends)
        ET.SubElement(outputs, "Unknown", index | {"dependencies": depends})
        ET.SubElement(initial, "Unknown", index)
