"""The JSON Schema of the parameter file, generated from the models and the registry.

``make schema`` rewrites the committed file.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from importlib import resources
from typing import Any

from ..options import Option, describe
from ..specification import Described, ParameterSpec, Variant

FILE_NAME = "fluidact-parameters-1.schema.json"


def build_schema(families: Iterable[Described]) -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of a parameter file: one branch for each family."""
    from .document import ParameterDocument

    schema = _tidied(ParameterDocument.model_json_schema())
    families = tuple(families)
    head = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": f"urn:fluidact-fit:{FILE_NAME}",
        "title": "Parameter file of fluidact-fit, version 1",
    }
    if families:
        schema["properties"]["family"]["enum"] = [family.name for family in families]
        schema["allOf"] = [_family_branch(family) for family in families]
    return {**head, **schema}


def shipped_schema() -> dict[str, Any]:
    """Return the JSON Schema that comes with the package."""
    text = resources.files(__package__).joinpath(FILE_NAME).read_text(encoding="utf-8")
    schema: dict[str, Any] = json.loads(text)
    return schema


def schema_text(schema: dict[str, Any]) -> str:
    """Return a schema as it is committed."""
    return json.dumps(schema, indent=2, allow_nan=False) + "\n"


def _tidied(node: Any) -> Any:
    """Return pydantic's schema without generated titles, nulls and empty defaults.

    A key that has no value is left out of a file, never written as null.
    """
    if isinstance(node, list):
        return [_tidied(item) for item in node]
    if not isinstance(node, dict):
        return node
    options = node.get("anyOf", [])
    kept = [option for option in options if option != {"type": "null"}]
    if len(kept) == 1 and len(options) == 2:
        rest = {key: item for key, item in node.items() if key not in ("anyOf", "default")}
        return _tidied({**rest, **kept[0]})
    return {
        key: {name: _tidied(item) for name, item in value.items()}
        if key in ("properties", "$defs")
        else _tidied(value)
        for key, value in node.items()
        if not (key == "title" and isinstance(value, str)) and key != "default"
    }


def _family_branch(family: Described) -> dict[str, Any]:
    options = describe(family.options_type, every=True)
    shape = {
        "properties": {option.name: _option_schema(option) for option in options},
        "additionalProperties": False,
    }
    variants = [_variant_schema(variant, shape) for variant in family.variants]
    return {
        "if": {"properties": {"family": {"const": family.name}}, "required": ["family"]},
        "then": variants[0] if len(variants) == 1 else {"anyOf": variants},
    }


def _variant_schema(variant: Variant, options: dict[str, Any]) -> dict[str, Any]:
    return {
        "properties": {
            "variant": {"const": variant.name},
            "options": options,
            "parameters": {
                "properties": {spec.name: _parameter_schema(spec) for spec in variant.parameters},
                "required": [spec.name for spec in variant.parameters if not spec.optional],
                "additionalProperties": False,
            },
            "validity": {"propertyNames": {"enum": [role.name for role in variant.roles]}},
        }
    }


def _option_schema(option: Option) -> dict[str, Any]:
    shapes: dict[str, dict[str, Any]] = {
        "choice": {"enum": list(option.choices)},
        "float": {"type": "number"},
        "int": {"type": "integer"},
        "flag": {"type": "boolean"},
        "text": {"type": ["string", "integer"]},
        "range": {"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 2},
    }
    limits = _finite(minimum=option.minimum, maximum=option.maximum, exclusiveMinimum=option.above)
    return {"description": option.help, **shapes[option.kind], **limits}


def _finite(**limits: float) -> dict[str, Any]:
    """Return the limits that are some."""
    return {key: float(limit) for key, limit in limits.items() if math.isfinite(limit)}


def _parameter_schema(spec: ParameterSpec) -> dict[str, Any]:
    value = {"type": "number", **_finite(minimum=spec.minimum, maximum=spec.maximum)}
    for level in range(spec.rank):
        value = {"type": "array", "items": value, "minItems": 1}
        if level == spec.rank - 1 and spec.length is not None:
            value |= {"minItems": spec.length, "maxItems": spec.length}
    return {
        "description": spec.description,
        "properties": {
            "value": value,
            "unit": {"type": "string"} if spec.ratio else {"const": spec.unit},
        },
    }
