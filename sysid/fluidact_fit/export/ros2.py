"""ROS 2: a parameter file, its declaration for generate_parameter_library, and metadata.

A double without a decimal point ends a node at its start, arrays have to be of one type and
cannot be nested, and there is no empty value: numbers are written as the parameter file writes
them, matrices are flattened by rows with their shape beside.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..parameters import dump_yaml
from .flat import flatten, nested
from .target import Code, Entry, Job, Plain, plain_text


def write(job: Job) -> dict[str, bytes]:
    """Return ``NAME.ros2.yaml``, ``NAME.declaration.yaml`` and ``NAME.metadata.yaml``."""
    return _files(job, flatten(job.block), _metadata(job))


def write_code(code: Code) -> dict[str, bytes]:
    """Return the same three files of the numbers of a controller."""
    keys = {e.key: {"unit": e.unit, "description": e.description} for e in code.numbers}
    metadata = {"controller": code.title, "remarks": list(code.remarks), "parameters": keys}
    return _files(code, code.numbers, metadata)


def _files(
    named: Job | Code, entries: Sequence[Entry], metadata: Mapping[str, Any]
) -> dict[str, bytes]:
    values = nested((e.key, e.value) for e in entries)
    declared = nested((e.key, _declaration(e)) for e in entries)
    contents = {
        "ros2": {named.name: {"ros__parameters": values}},
        "declaration": {named.name: declared},
        "metadata": metadata,
    }
    origins = named.origin if isinstance(named, Code) else (named.origin,) if named.origin else ()
    said = [line for origin in origins for line in origin.lines()]
    remarks = "".join(f"# {line}\n" for line in (*said, *named.remarks))
    return {
        f"{named.file}.{part}.yaml": (remarks + dump_yaml(content)).encode()
        for part, content in contents.items()
    }


def _declaration(entry: Entry) -> dict[str, Any]:
    """Entry for generate_parameter_library, without a default, so that it must be given."""
    unit = f" [{plain_text(entry.unit)}]" if entry.unit else ""
    found = {
        "type": _type(entry),
        "description": plain_text(entry.description) + unit,
        "read_only": True,
    }
    validation = _validation(entry)
    return {**found, "validation": validation} if validation else found


def _type(entry: Entry) -> str:
    if isinstance(entry.value, list):
        fixed = entry.length is not None
        return f"double_array_fixed_{entry.length}" if fixed else "double_array"
    return {bool: "bool", int: "int", float: "double", str: "string"}[type(entry.value)]


def _validation(entry: Entry) -> dict[str, list[float | int]]:
    """Built-in validators: the closed range of the specification, and the length of a list."""
    array = isinstance(entry.value, list)
    low, high = entry.minimum, entry.maximum
    found: dict[str, list[float | int]] = {}
    if math.isfinite(low) and math.isfinite(high):
        found["element_bounds<>" if array else "bounds<>"] = [low, high]
    elif math.isfinite(low):
        found["lower_element_bounds<>" if array else "gt_eq<>"] = [low]
    elif math.isfinite(high):
        found["upper_element_bounds<>" if array else "lt_eq<>"] = [high]
    if isinstance(entry.value, list):
        found["fixed_size<>"] = [len(entry.value)]
    return found


def _metadata(job: Job) -> dict[str, Any]:
    """Everything of the document that a controller does not need but its engineer does."""
    document = job.block.document.to_dict()
    parameters = {
        name: {key: part for key, part in entry.items() if key != "value"} | _shape(entry["value"])
        for name, entry in document["parameters"].items()
    }
    kept = ("options", "derived", "covariance", "validity", "fit", "validation", "warnings",
            "provenance")  # fmt: skip
    return {
        "family": document["family"],
        "remarks": list(job.remarks),
        "parameters": parameters,
        **{key: document[key] for key in kept if key in document},
    }


def _shape(value: Plain) -> dict[str, list[int]]:
    return {"shape": [*np.shape(value)]} if isinstance(value, list) else {}
