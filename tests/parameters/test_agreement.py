"""A parameter or a model changed by hand is noticed by every reader."""

from __future__ import annotations

import copy
from typing import Any

import pytest

from fluidact_fit.errors import ParameterFileError, UsageError
from fluidact_fit.family import Plant
from fluidact_fit.parameters import dump_document, make_document
from fluidact_fit.parameters.load import check_agreement, disagreements, parse_document

CONTINUOUS = "model.continuous"


@pytest.fixture
def lookup(lookup: Any) -> Any:
    """The dummy family, with a model that depends on parameters, options and sample time."""
    family = copy.copy(lookup("dummy"))

    def model(plant: Plant[Any], sample_time: float, hold: str) -> Any:
        if sample_time > 1.0:
            raise UsageError("the sample time is too long")
        return {
            "continuous": {"numerator": [1.0], "denominator": [plant.values["mass"], 0.0]},
            "discrete": {"sample_time": sample_time, "hold": hold},
            "norm": sum(map(abs, plant.values["weights"])),
            "units": plant.options.hidden,
        }

    family.model = model
    family.steady_offset = True
    return lambda name: family


@pytest.fixture
def document(document: dict[str, Any]) -> dict[str, Any]:
    document["model"] = {
        "continuous": {"numerator": [1.0], "denominator": [53.71, 0.0]},
        "discrete": {"sample_time": 0.01, "hold": "zoh"},
        "norm": sum(document["parameters"]["weights"]["value"]),
        "units": 4,
        "output_offset": -0.25,
    }
    document["parameters"]["mass"] |= {"std_error": None, "ci95": None}
    return document


def problems_of(document: dict[str, Any], lookup: Any) -> dict[str, str]:
    with pytest.raises(ParameterFileError) as caught:
        parse_document(dump_document(make_document(document, lookup)), lookup, "p.yaml")
    assert str(caught.value).startswith("p.yaml: ")
    assert caught.value.remedy
    return dict(caught.value.problems)


def test_what_agrees_is_read(document, lookup):
    text = dump_document(make_document(document, lookup))
    read = parse_document(text, lookup)
    assert dump_document(read) == text
    check_agreement(make_document(document, lookup), lookup("dummy"))


def test_a_value_rounded_to_six_digits_still_agrees(document, lookup):
    document["parameters"]["mass"]["value"] = 53.7101
    parse_document(dump_document(make_document(document, lookup)), lookup)


@pytest.mark.parametrize(
    ("change", "path", "words"),
    [
        (
            lambda d: d["parameters"]["mass"].update(value=107.42),
            f"{CONTINUOUS}.denominator",
            "agree",
        ),
        (
            lambda d: d["parameters"]["mass"].update(value=53.72),
            f"{CONTINUOUS}.denominator",
            "agree",
        ),
        (lambda d: d["parameters"]["weights"].update(value=[1.0, 3.0, 2e20]), "model.norm", "agr"),
        (lambda d: d["options"].update(hidden=5), "model.units", "agree"),
        (lambda d: d["model"].update(norm=10**59), "model.norm", "agree"),
        (lambda d: d["model"].pop("norm"), "model.norm", "missing"),
        (lambda d: d["model"]["continuous"].pop("numerator"), f"{CONTINUOUS}.numerator", "missing"),
        (
            lambda d: d["model"]["continuous"].update(numerator=[1.0, 0.0]),
            f"{CONTINUOUS}.numerator",
            "",
        ),
        (lambda d: d["model"].update(more=1.0), "model.more", "unknown key"),
        (lambda d: d["model"]["discrete"].update(more="x"), "model.discrete.more", "unknown key"),
        (lambda d: d["model"].update(output_offset="x"), "model.output_offset", "not a number"),
        (lambda d: d["model"].update(output_offset=[-0.25]), "model.output_offset", "not a num"),
        (lambda d: d["model"].update(output_offset=4.9), "model.output_offset", "-0.25 to -0.25"),
        (lambda d: d["model"].pop("output_offset"), "model.output_offset", "missing"),
        (lambda d: d["fit"]["logs"][0].pop("offset"), "model.output_offset", "unknown key"),
        (
            lambda d: d["parameters"]["mass"].update(std_error=0.02),
            "parameters.mass.std_error",
            "0.02 does not agree with the covariance, 0.21",
        ),
        (
            lambda d: d["parameters"]["control_points"].update(std_error=[0.001, 1.5e-3]),
            "parameters.control_points.std_error[1]",
            "covariance, 1.5e-07",
        ),
        (lambda d: d["model"].update(units=5), "model.units", "5 does not agree with the param"),
        (lambda d: d["model"].update(units=5), "model.units", "which give 4"),
        (lambda d: d["model"].update(continuous=[1.0]), CONTINUOUS, "agree"),
        (lambda d: d["model"].update(discrete=[1.0]), "model.discrete", "not a mapping"),
        (lambda d: d["model"]["discrete"].pop("sample_time"), "model.discrete.sample_time", "None"),
        (
            lambda d: d["model"]["discrete"].update(sample_time=0.0),
            "model.discrete.sample_time",
            "",
        ),
        (
            lambda d: d["model"]["discrete"].update(sample_time="1"),
            "model.discrete.sample_time",
            "",
        ),
        (lambda d: d["model"]["discrete"].update(sample_time=2.0), "model", "too long"),
        (lambda d: d["model"]["discrete"].update(hold="helld"), "model.discrete.hold", "helld"),
    ],
)
def test_what_was_changed_by_hand_is_refused(document, lookup, change, path, words):
    change(document)
    problems = problems_of(document, lookup)
    assert list(problems) == [path]
    assert words in problems[path]


@pytest.mark.parametrize(
    ("found", "due", "same"),
    [
        (1.0, 1.00005, True),
        (1.0, 1.0002, False),
        (0.0, 0.0, True),
        (1e-12, 0.0, False),
        (True, 1.0, False),
        ("zoh", "zoh", True),
        ("zoh", "foh", False),
        ([1.0, 1e-12], [1.0, 0.0], True),
        ([1.0, 1e-3], [1.0, 0.0], False),
        ([1.0], [1.0, 0.0], False),
        ([1.0, "x"], [1.0, 0.0], False),
        ([[1.0, 2.0], [3.0]], [[1.0, 2.0], [3.0]], True),
        ([[1.0, 2.0], [3.1]], [[1.0, 2.0], [3.0]], False),
        (["a", {"x": 1.0}], ["a", {"x": 1.0}], True),
        ({"a": 1.0, "more": 2.0}, {"a": 1.0}, False),
        ({}, {"a": 1.0}, False),
        (None, {"a": 1.0}, False),
        (None, 0.0, False),
    ],
)
def test_agreement(found, due, same):
    assert (not list(disagreements(found, due))) is same
