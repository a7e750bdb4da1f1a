"""The JSON Schema: committed as built, and of one mind with the reader."""

from __future__ import annotations

import copy
import json
from importlib import resources

import jsonschema
import pytest
import yaml

from fluidact_fit.families import family_names, get_family
from fluidact_fit.parameters import build_schema, dump_document, make_document, shipped_schema
from fluidact_fit.parameters.schema import FILE_NAME, schema_text


@pytest.fixture
def registered():
    try:
        return [get_family(name) for name in family_names()]
    except ModuleNotFoundError as error:
        # A family that is announced but not written yet; any other fault is one.
        if not str(error.name).startswith("fluidact_fit.families."):
            raise
        pytest.skip(str(error))


@pytest.fixture
def validator(families):
    schema = build_schema(families)
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


def test_the_committed_schema_is_the_one_built(registered):
    built = schema_text(build_schema(registered))
    committed = resources.files("fluidact_fit.parameters").joinpath(FILE_NAME)
    assert committed.read_text(encoding="utf-8") == built, "run make schema"


def test_the_shipped_schema_is_a_schema_with_every_family(registered):
    schema = shipped_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    assert schema["properties"]["family"]["enum"] == [family.name for family in registered]
    assert len(schema["allOf"]) == len(registered)
    assert json.loads(schema_text(schema)) == schema


def test_what_is_written_is_accepted(document, lookup, validator):
    validator.validate(yaml.safe_load(dump_document(make_document(document, lookup))))


def _without(document, *keys):
    part = document
    for key in keys[:-1]:
        part = part[key]
    del part[keys[-1]]


@pytest.mark.parametrize(
    "spoil",
    [
        lambda d: d.update(format="x"),
        lambda d: d.update(format_version=2),
        lambda d: d.update(family="x"),
        lambda d: d.update(colour="red"),
        lambda d: d.update(variant="x"),
        lambda d: d.update(covariance=None),
        lambda d: _without(d, "parameters", "mass"),
        lambda d: _without(d, "parameters", "mass", "unit"),
        lambda d: _without(d, "fit"),
        lambda d: d["parameters"].update(other=d["parameters"]["mass"]),
        lambda d: d["parameters"]["mass"].update(unit="g"),
        lambda d: d["parameters"]["mass"].update(value=0.0),
        lambda d: d["parameters"]["mass"].update(value=[1.0]),
        lambda d: d["parameters"]["mass"].update(value="1"),
        lambda d: d["parameters"]["mass"].update(value=True),
        lambda d: d["parameters"]["mass"].update(status="guess"),
        lambda d: d["parameters"]["mass"].update(ci95=[1.0]),
        lambda d: d["parameters"]["weights"].update(value=[1.0, 2.0]),
        lambda d: d["parameters"]["weights"].update(value=[1.0, 2.0, 0.0]),
        lambda d: d["parameters"]["layer"].update(value=[1.0]),
        lambda d: d["options"].update(hiden=4),
        lambda d: d["options"].update(hidden=0),
        lambda d: d["options"].update(length=0.0),
        lambda d: d["options"].update(ends="loose"),
        lambda d: d["options"].update(monotone=1),
        lambda d: d["options"].update(rails=[0.0]),
        lambda d: d["options"].update({"spike-limit": -1.0}),
        lambda d: d["fit"]["rmse"].update(value=-1.0),
        lambda d: d["fit"]["logs"][0].update(left_out=-1),
        lambda d: d["provenance"]["logs"][0]["columns"]["force"].update(hold="auto"),
        lambda d: d["provenance"]["logs"][0]["columns"]["force"].update(scal=1.0),
        lambda d: d["validity"].update(other={"low": 0.0, "high": 1.0, "unit": "N"}),
    ],
)
def test_what_is_wrong_is_rejected(document, validator, spoil):
    spoiled = copy.deepcopy(document)
    spoil(spoiled)
    assert validator.is_valid(document)
    assert not validator.is_valid(spoiled)


def test_every_variant_has_its_own_parameters(document, validator):
    document |= {"family": "twin", "validity": {}, "options": {}}
    mass = {"value": 2.0, "unit": "kg", "status": "fixed"}
    document["parameters"] = {"mass": mass}
    assert validator.is_valid(document)
    assert validator.is_valid(document | {"variant": "linear"})
    assert not validator.is_valid(document | {"variant": "rotary"})
    document["parameters"] = {"inertia": mass}
    assert not validator.is_valid(document)
