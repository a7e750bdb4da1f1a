"""Every rejection, with its path."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from fluidact_fit.errors import Notice, ParameterFileError
from fluidact_fit.family import Quantity
from fluidact_fit.parameters import (
    ParameterDocument,
    dump_document,
    make_document,
    read_document,
)
from fluidact_fit.parameters.load import parse_document

DELETE = object()


def put(document: dict[str, Any], path: str, value: Any) -> None:
    *way, last = path.split("/")
    part: Any = document
    for key in way:
        part = part[int(key) if isinstance(part, list) else key]
    key: Any = int(last) if isinstance(part, list) else last
    if value is DELETE:
        del part[key]
    else:
        part[key] = value


def problems_of(document: dict[str, Any], lookup: Any) -> dict[str, str]:
    with pytest.raises(ParameterFileError) as caught:
        make_document(document, lookup)
    return dict(caught.value.problems)


def test_a_whole_document_is_accepted(document, lookup):
    read = make_document(document, lookup)
    assert read.family == "dummy"
    assert read.variant is None
    assert read.values()["mass"] == 53.71
    assert read.values()["layer"] == [[1.0, -2.0], [3.0, 4e-300]]
    assert read.quantities()["mass"] == Quantity(
        53.71, "kg", "estimated", 0.21, [53.3, 54.12], "wald"
    )
    plain = read.to_dict()
    assert {key: plain[key] for key in document} == document


COLUMNS, COLUMN = "provenance/logs/0/columns", "provenance.logs[0].columns."
REJECTIONS = [
    ("format", "x", "format", "expected 'fluidact-parameters'"),
    ("format", DELETE, "format", "missing"),
    ("format_version", 2, "format_version", "newer"),
    ("format_version", DELETE, "format_version", "missing"),
    ("format_version", "1", "format_version", "not a version"),
    ("format_version", True, "format_version", "not a version"),
    ("format_version", 1.0, "format_version", "not a version"),
    ("format_version", -1, "format_version", "not a version"),
    ("family", "dumy", "family", "Known: dummy, twin"),
    ("family", DELETE, "family", "missing"),
    ("family", 3, "family", "not text"),
    ("variant", "x", "variant", "known: plain"),
    ("parameters", DELETE, "parameters", "missing"),
    ("parameters", [], "parameters", "not a mapping"),
    ("parameters/mass", DELETE, "parameters.mass", "missing"),
    ("parameters/mass", 53.0, "parameters.mass", "not a mapping"),
    ("parameters/mas", {"value": 1.0, "unit": "kg", "status": "fixed"}, "parameters.mas", "'mass'"),
    ("parameters/mass/value", DELETE, "parameters.mass.value", "missing"),
    ("parameters/mass/unit", DELETE, "parameters.mass.unit", "missing"),
    ("parameters/mass/status", DELETE, "parameters.mass.status", "missing"),
    ("parameters/mass/status", "guessed", "parameters.mass.status", "not_identified"),
    ("parameters/mass/std_eror", 1.0, "parameters.mass.std_eror", "'std_error'"),
    ("parameters/mass/unit", "m", "parameters.mass.unit", "wrong dimension"),
    ("parameters/mass/unit", "g", "parameters.mass.unit", "'kg'"),
    ("parameters/mass/unit", "blorp", "parameters.mass.unit", "not a known unit"),
    ("parameters/mass/value", math.nan, "parameters.mass.value", "not finite"),
    ("parameters/mass/value", -math.inf, "parameters.mass.value", "not finite"),
    ("parameters/mass/value", True, "parameters.mass.value", "true is not a number"),
    ("parameters/mass/value", "53.7", "parameters.mass.value", "without quotes"),
    ("parameters/mass/value", "heavy", "parameters.mass.value", "not a number"),
    ("parameters/mass/value", 10**400, "parameters.mass.value", "not a number"),
    ("parameters/mass/value", -1.0, "parameters.mass.value", "at least 1e-12 kg"),
    ("parameters/mass/value", [53.7], "parameters.mass.value", "expected a number"),
    ("parameters/dead_zone_negative/value", 1.0, "parameters.dead_zone_negative.value", "at most"),
    ("parameters/weights/value", [1.0, 2.0], "parameters.weights.value", "expected 3"),
    ("parameters/weights/value/1", 0.0, "parameters.weights.value[1]", "at least"),
    ("parameters/weights/value/2", math.inf, "parameters.weights.value[2]", "not finite"),
    ("parameters/weights/value/2", "1", "parameters.weights.value[2]", "text"),
    ("parameters/weights/value", 1.0, "parameters.weights.value", "expected a list"),
    ("parameters/weights/value", [], "parameters.weights.value", "0 entries"),
    ("parameters/layer/value", [1.0], "parameters.layer.value", "expected a list of lists"),
    ("parameters/layer/value/1", [3.0], "parameters.layer.value", "differ in length"),
    ("parameters/layer/value/1/0", math.nan, "parameters.layer.value[1][0]", "not finite"),
    ("parameters/mass/std_error", -0.1, "parameters.mass.std_error", "negative"),
    ("parameters/mass/std_error", [0.1], "parameters.mass.std_error", "shape"),
    ("parameters/mass/std_error", True, "parameters.mass.std_error", "not a number"),
    (
        "parameters/control_points/std_error/1",
        -1.0,
        "parameters.control_points.std_error[1]",
        "negative",
    ),
    ("parameters/mass/ci95", [54.0, 55.0], "parameters.mass.ci95", "does not contain"),
    ("parameters/mass/ci95", [54.0, 53.0], "parameters.mass.ci95", "low is above high"),
    ("parameters/mass/ci95", [53.0], "parameters.mass.ci95", "has 1 entry; expected at least 2"),
    ("parameters/mass/ci95", 53.0, "parameters.mass.ci95", "not a list"),
    (
        "parameters/control_points/ci95/1",
        [0.2, 0.3],
        "parameters.control_points.ci95[1]",
        "does not contain",
    ),
    ("parameters/control_points/ci95", [0.0, 0.1], "parameters.control_points.ci95", "one [low,"),
    ("derived/time_constant/unit", "blorp", "derived.time_constant.unit", "not a known unit"),
    ("derived/time_constant/std_error", -1.0, "derived.time_constant.std_error", "negative"),
    ("covariance/order/0", "masss", "covariance.order[0]", "'mass'"),
    ("covariance/order/0", "control_points", "covariance.order[0]", "not a number among"),
    ("covariance/order/1", "control_points[2]", "covariance.order[1]", "not a number among"),
    ("covariance/order/1", "mass", "covariance.order[1]", "twice"),
    ("covariance/order", ["mass"], "covariance.matrix", "order has 1 names"),
    ("covariance/matrix", [[1.0, 2.0]], "covariance.matrix", "not square"),
    ("covariance/matrix/0", [0.0441], "covariance.matrix", "not square"),
    ("covariance/matrix/0/1", 1e-6, "covariance.matrix", "not symmetric"),
    ("covariance/matrix/2/2", -1.0, "covariance.matrix[2][2]", "negative variance"),
    ("covariance/matrix/0/0", math.nan, "covariance.matrix[0][0]", "not finite"),
    ("covariance/matrix", DELETE, "covariance.matrix", "missing"),
    ("model/discrete/sample_time", math.inf, "model.discrete.sample_time", "not finite"),
    ("model/continuous/numerator/0", math.nan, "model.continuous.numerator[0]", "not finite"),
    ("validity/force/unit", "kg", "validity.force.unit", "wrong dimension"),
    ("validity/force/unit", "kN", "validity.force.unit", "'N'"),
    ("validity/force/low", 13.0, "validity.force.low", "above high"),
    ("validity/forc", {"low": 0.0, "high": 1.0, "unit": "N"}, "validity.forc", "'force'"),
    ("fit", DELETE, "fit", "missing"),
    ("fit/verdict", "good", "fit.verdict", "'pass', 'warn' or 'fail'"),
    ("fit/samples", 3000.0, "fit.samples", "whole number"),
    ("parameters/mass/status", "fixed", "parameters.mass.std_error", "is fixed has none"),
    ("parameters/mass/status", "not_identified", "parameters.mass.ci95", "not_identified has none"),
    ("provenance/created", "yesterday", "provenance.created", "'yesterday' is not an instant"),
    ("fit/samples", 10**400, "fit.samples", "is too large; expected at most 9007199254740992"),
    ("fit/samples", 0, "fit.samples", "0 is too small; expected at least 1"),
    ("fit/samples", -1, "fit.samples", "-1 is too small; expected at least 1"),
    ("fit/rmse", 1e-5, "fit.rmse", "not a mapping"),
    ("fit/rmse/unit", "mm", "fit.rmse.unit", "'m'"),
    ("fit/rmse/unit", "kg", "fit.rmse.unit", "wrong dimension"),
    ("fit/logs/0/rmse/unit", "kg", "fit.logs[0].rmse.unit", "wrong dimension"),
    ("fit/details/filter/cut_off", math.nan, "fit.details.filter.cut_off", "not finite"),
    ("fit/details/filter/cut_off", {1, 2}, "fit.details.filter.cut_off", "a set cannot"),
    (
        "fit/residual_whiteness/p_value",
        1.5,
        "fit.residual_whiteness.p_value",
        "1.5 is too large; expected at most 1",
    ),
    ("validation/0/file", DELETE, "validation[0].file", "missing"),
    ("warnings/0/code", 5, "warnings[0].code", "not text"),
    ("provenance", DELETE, "provenance", "missing"),
    ("provenance/tool/version", 0.1, "provenance.tool.version", "not text"),
    ("provenance/logs/0/sha256", "abc", "provenance.logs[0].sha256", "does not look right"),
    ("provenance/seed", "0", "provenance.seed", "whole number"),
    ("options/hiden", 4, "options.hiden", "no option --hiden"),
    ("options/hidden", 0, "options.hidden", "out of range"),
    ("options/length", -5.0, "options.length", "above 0"),
    ("options/ends", "loose", "options.ends", "one of free, fixed"),
    ("options/rails", [5.0, 0.0], "options.rails", "not below"),
    ("fit/rmse/value", -1e-5, "fit.rmse.value", "is too small; expected at least 0"),
    ("fit/logs/0/rmse/value", -1e-5, "fit.logs[0].rmse.value", "is too small; expected at least 0"),
    ("fit/logs/0/left_out", -1, "fit.logs[0].left_out", "is too small; expected at least 0"),
    ("fit/logs/0/offset", 0.2, "fit.logs[0].offset", "not a mapping"),
    ("fit/logs/0/offset/unit", "kg", "fit.logs[0].offset.unit", "wrong dimension"),
    (f"{COLUMNS}/force/hold", "auto", f"{COLUMN}force.hold", "expected 'zoh', 'foh' or 'smooth'"),
    (f"{COLUMNS}/force/scal", 2.0, f"{COLUMN}force.scal", "'scale'"),
    (f"{COLUMNS}/force/unit", DELETE, f"{COLUMN}force.unit", "missing"),
    (f"{COLUMNS}/reading/step/at", "0.5 s", f"{COLUMN}reading.step.at", "not a number"),
    (f"{COLUMNS}/reading/step/from", DELETE, f"{COLUMN}reading.step.from", "missing"),
    ("colour", "red", "colour", "unknown key"),
    ("covarience", {}, "covarience", "'covariance'"),
    ("k" * 201, "red", "k" * 201, "longer"),
]


@pytest.mark.parametrize(
    ("where", "value", "path", "words"), REJECTIONS, ids=[f"{r[2][:40]}-{r[3]}" for r in REJECTIONS]
)
def test_each_problem_is_named_with_its_path(document, lookup, where, value, path, words):
    put(document, where, value)
    problems = problems_of(document, lookup)
    assert words in problems[path]
    # Nothing else is blamed, but for what really hangs on it.
    assert {p for p in problems if not p.startswith(path)} <= {
        "covariance.order[0]",
        "parameters.mass.std_error",
        "parameters.mass.ci95",
    }
    assert "Input should" not in problems[path]


@pytest.mark.parametrize("method", ["wald", "profile", "bracket"])
def test_an_edited_value_shows_beside_its_interval(document, lookup, method):
    document["parameters"]["mass"] |= {"value": 2 * 53.71, "method": method}
    assert "does not contain" in problems_of(document, lookup)["parameters.mass.ci95"]


def test_a_list_that_has_to_increase_does(document, lookup):
    entry = {"value": [4.9, 0.1], "unit": "1", "status": "estimated"}
    document["parameters"]["reading_range"] = entry
    problems = problems_of(document, lookup)
    assert problems == {"parameters.reading_range.value": "its entries do not increase"}


def test_the_document_checks_itself_when_it_is_made(document):
    document["covariance"]["matrix"][0][1] = 1.0
    document["parameters"]["mass"]["std_error"] = -1.0
    document["validity"]["force"]["low"] = 100.0
    with pytest.raises(ValidationError) as caught:
        ParameterDocument.model_validate(document)
    assert {item["msg"] for item in caught.value.errors()} == {
        "is not symmetric: [0][1] and [1][0] differ",
        "-1.0 is negative",
        "100.0 is above high, 12.1",
    }


def test_the_parts_are_typed(document, lookup):
    read = make_document(document, lookup)
    (log,) = read.fit.logs
    assert (log.left_out, log.offset.value, log.offset.unit) == (12, -0.25, "m")
    columns = read.provenance.logs[0].columns
    assert (columns["force"].header, columns["force"].scale) == ("F [N]", -1.0)
    assert columns["force"].hold == "smooth"
    assert columns["time"].assumed
    step = columns["reading"].step
    assert (step.start, step.end, step.at) == (0.0, 4.0, 0.5)


def test_a_document_says_in_one_line_what_it_is(document, lookup):
    read = make_document(document, lookup)
    assert repr(read) == "<ParameterDocument dummy: 5 parameters, pass>"
    assert str(read) == repr(read)


@pytest.mark.parametrize("version", [0, 2, -1, True, "1", None])
def test_a_version_that_is_not_this_one_is_refused(version, document, lookup):
    document["format_version"] = version
    assert "format_version" in problems_of(document, lookup)


def test_all_problems_are_named_at_once(document, lookup):
    put(document, "parameters/mass/unit", "m")
    put(document, "parameters/weights/value", [1.0, -1.0, math.nan])
    put(document, "parameters/viscosity", {"value": 1.0, "unit": "N s/m", "status": "fixed"})
    put(document, "covariance/matrix/0/1", 1.0)
    put(document, "fit/verdict", DELETE)
    assert set(problems_of(document, lookup)) == {
        "parameters.mass.unit",
        "parameters.weights.value[2]",
        "parameters.viscosity",
        "covariance.matrix",
        "fit.verdict",
    }


def test_an_indefinite_covariance_is_rejected_whatever_its_scale(document, lookup):
    # A correlation of 1.1 between variances of 1e-2 and 1e-30.
    document["covariance"] = {
        "order": ["mass", "control_points[1]"],
        "matrix": [[1e-2, 1.1e-16], [1.1e-16, 1e-30]],
    }
    problems = problems_of(document, lookup)
    assert "not positive semidefinite" in problems["covariance.matrix"]


def test_a_singular_covariance_is_accepted(document, lookup):
    document["covariance"] = {
        "order": ["mass", "control_points[1]", "control_points[0]"],
        "matrix": [[1e-2, 1e-16, 0.0], [1e-16, 1e-30, 0.0], [0.0, 0.0, 0.0]],
    }
    assert make_document(document, lookup).covariance is not None


@pytest.mark.parametrize(
    "matrix",
    [
        [[1.0, 0.5], [0.5, 0.0]],
        [[1.0, 1e-12], [1e-12, 0.0]],
        [[1e-300, 1e300], [1e300, 1e-300]],
    ],
)
def test_extreme_covariances_are_rejected_without_a_fault(document, lookup, matrix):
    document["covariance"] = {"order": ["mass", "control_points[1]"], "matrix": matrix}
    problems = problems_of(document, lookup)
    assert problems == {"covariance.matrix": "is not positive semidefinite"}


def test_three_correlations_that_contradict_each_other_are_rejected(document, lookup):
    document["covariance"]["matrix"] = [[1.0, 0.9, -0.9], [0.9, 1.0, 0.9], [-0.9, 0.9, 1.0]]
    assert set(problems_of(document, lookup)) == {"covariance.matrix"}


def test_without_covariance_and_optional_parts(document, lookup):
    for key in ("options", "derived", "covariance", "model", "validity", "validation", "warnings"):
        del document[key]
    plain = make_document(document, lookup).to_dict()
    assert "covariance" not in plain
    assert plain["warnings"] == []


def test_the_variant_is_inferred_from_the_parameters(document, lookup):
    document |= {"family": "twin", "options": {}, "covariance": None, "validity": {}}
    document["parameters"] = {"mass": {"value": 2.0, "unit": "kg", "status": "fixed"}}
    read = make_document(document, lookup)
    assert read.variant == "linear"
    assert read.to_dict()["variant"] == "linear"
    document["variant"] = "rotary"
    assert set(problems_of(document, lookup)) == {"parameters.inertia", "parameters.mass"}


def test_parameters_are_put_in_the_order_of_the_family(document, lookup):
    document["parameters"] = dict(reversed(document["parameters"].items()))
    names = list(make_document(document, lookup).to_dict()["parameters"])
    assert names[:2] == ["mass", "dead_zone_negative"]


def test_results_are_converted(document, lookup):
    document["parameters"]["mass"] = Quantity(np.float64(53.71), "kg", "estimated")
    document["parameters"]["weights"] = Quantity(np.array([1, 2, 3]), "1", "estimated")
    document["covariance"]["matrix"] = np.diag([1.0, 2.0, 3.0])
    document["warnings"] = (Notice("code", "message"),)
    document["fit"]["samples"] = np.int64(5)
    document["fit"]["details"] = {"none": None, "flag": np.bool_(True), "single": np.float32(0.5)}
    plain = make_document(document, lookup).to_dict()
    assert plain["parameters"]["mass"] == {"value": 53.71, "unit": "kg", "status": "estimated"}
    assert plain["parameters"]["weights"]["value"] == [1.0, 2.0, 3.0]
    assert plain["warnings"] == [{"code": "code", "message": "message"}]
    assert plain["fit"]["details"] == {"flag": True, "single": 0.5}


def test_a_file_that_is_right_is_read_without_the_units(document, lookup, monkeypatch):
    # pint takes a second to load; a controller should not wait for it.
    def refuse(*units: str) -> bool:
        raise AssertionError(units)

    document["derived"] = {}
    document["validity"].pop("reading")
    monkeypatch.setattr("fluidact_fit.units.same_dimension", refuse)
    monkeypatch.setattr("fluidact_fit.units.is_known_unit", refuse)
    make_document(document, lookup)


def test_problems_of_a_file_come_with_lines(document, lookup, tmp_path):
    text = dump_document(make_document(document, lookup)).replace("value: 53.71", 'value: "53.71"')
    path = tmp_path / "p.yaml"
    path.write_text(text.replace("unit: kg", "unit: m"), encoding="utf-8")
    with pytest.raises(ParameterFileError) as caught:
        read_document(path, lookup)
    line = 1 + text.splitlines().index(next(x for x in text.splitlines() if "mass:" in x))
    assert [p for p, _ in caught.value.problems] == [
        "parameters.mass.value",
        "parameters.mass.unit",
    ]
    assert all(m.endswith(f"(line {line})") for _, m in caught.value.problems)
    assert str(path) in str(caught.value)
    assert caught.value.remedy
    assert caught.value.exit_status == 3


def test_duplicate_keys_and_empty_values_are_named_with_the_rest(document, lookup):
    text = dump_document(make_document(document, lookup))
    text = text.replace("  seed: 0", "  seed: 0\n  seed: 1\n  command:\n  created: null")
    text = text.replace("status: estimated, method", "status: estimated, status: fixed, method")
    with pytest.raises(ParameterFileError) as caught:
        parse_document(text, lookup)
    problems = dict(caught.value.problems)
    assert "duplicate key" in problems["provenance.seed"]
    assert "duplicate key" in problems["provenance.command"]
    assert "duplicate key" in problems["parameters.mass.status"]
    lines = text.splitlines()
    first, second = lines.index("  seed: 0") + 1, lines.index("  seed: 1") + 1
    assert f"lines {first} and {second}" in problems["provenance.seed"]


def test_an_empty_value_is_a_problem(document, lookup):
    text = dump_document(make_document(document, lookup)).replace(
        "status: fixed}", "status: fixed, method: }"
    )
    with pytest.raises(ParameterFileError) as caught:
        parse_document(text, lookup)
    ((path, message),) = caught.value.problems
    assert path == "parameters.weights.method"
    assert "empty" in message


def test_a_newer_version_is_the_only_problem(document, lookup):
    document |= {"format_version": 7, "something_new": {}}
    assert set(problems_of(document, lookup)) == {"format_version"}


@pytest.mark.parametrize("status", ["fixed", "not_identified"])
def test_what_was_not_estimated_has_no_variance(document, lookup, status):
    document["parameters"]["mass"] = {"value": 54.0, "unit": "kg", "status": status}
    problems = problems_of(document, lookup)
    assert problems["covariance.order[0]"] == f"'mass' is {status}: it has no variance"


def test_whole_numbers_by_hand_are_numbers(document, lookup):
    document["parameters"]["mass"] = {"value": 54, "unit": "kg", "status": "estimated"}
    value = make_document(document, lookup).values()["mass"]
    assert value == 54.0
    assert type(value) is float


def test_what_the_reader_rejects_is_not_written(document, lookup):
    document["parameters"]["mass"]["value"] = math.nan
    with pytest.raises(ParameterFileError, match=r"parameters\.mass\.value"):
        dump_document(make_document(document, lookup))
