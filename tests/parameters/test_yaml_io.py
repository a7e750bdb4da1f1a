"""The strict reader and the careful writer."""

from __future__ import annotations

import contextlib
import math
import os
import re
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from fluidact_fit.errors import ParameterFileError
from fluidact_fit.parameters import dump_document, dump_yaml, make_document, read_yaml
from fluidact_fit.parameters.document import ParameterDocument
from fluidact_fit.parameters.load import parse_document
from fluidact_fit.parameters.yaml_io import MAX_BYTES, parse_yaml

LOADERS = [yaml.SafeLoader] + ([yaml.CSafeLoader] if hasattr(yaml, "CSafeLoader") else [])

finite = st.floats(allow_nan=False, allow_infinity=False)
scalars = st.one_of(
    finite,
    st.integers(-(2**53), 2**53),
    st.booleans(),
    st.text(st.characters(exclude_categories=["Cs"]), max_size=30),
    st.sampled_from(
        ["no", "1e-3", "1:30", "2026-11-20", "~", "=", "<<", "N", "0o17", "0x1F", ".5"]
    ),
    st.sampled_from(
        ["- a", "a: b", "a #b", "? x", "&a", "*a", "!t", "| x", "%", "@", "`", " a", "a "]
    ),
    st.from_regex(r"[-+]?[0-9_]*[.:eE]?[-+]?[0-9_]*", fullmatch=True),
)
keys = st.text(st.characters(exclude_categories=["Cs"]), max_size=20) | st.sampled_from(["y", "1"])
nested = st.recursive(
    scalars,
    lambda inner: st.lists(inner, max_size=6) | st.dictionaries(keys, inner, max_size=5),
    max_leaves=40,
)
trees = st.dictionaries(keys, nested, max_size=6)


def same(a: Any, b: Any) -> bool:
    """Equality that tells 1 from 1.0 and True, and 0.0 from -0.0."""
    if type(a) is not type(b):
        return False
    if isinstance(a, dict):
        return list(a) == list(b) and all(same(a[k], b[k]) for k in a)
    if isinstance(a, list):
        return len(a) == len(b) and all(map(same, a, b))
    return a == b and (not isinstance(a, float) or math.copysign(1, a) == math.copysign(1, b))


@settings(max_examples=50, deadline=None)
@given(trees)
@example({"a": {"b": [[]], "c": {}, "d": [{}, [], [[1.0], []]]}})
@example({"x": "\x7f\x85\u2028\ufeff\ufffe\U0010ffff\U0001f600é"})
def test_every_reader_gives_back_what_was_written(tree):
    text = dump_yaml(tree)
    if not tree:
        assert "{" not in text.replace("{}", "")
        return
    for loader in LOADERS:
        assert same(yaml.load(text, Loader=loader), tree)
    read = parse_yaml(text, "text")
    assert same(read.data, tree)
    assert not read.problems.found


@settings(max_examples=300, deadline=None)
@given(finite)
def test_floats_carry_a_point_and_a_signed_exponent(number):
    text = dump_yaml({"x": number}).splitlines()[-1].removeprefix("x: ")
    assert re.fullmatch(r"-?[0-9]+\.[0-9]+(e[-+][0-9]+)?", text)
    assert float(text) == number


@pytest.mark.parametrize(
    ("number", "text"),
    [
        (1e-7, "1.0e-07"),
        (54.0, "54.0"),
        (1e20, "1.0e+20"),
        (-2.5e-300, "-2.5e-300"),
        (0.1, "0.1"),
        (-0.0, "-0.0"),
        (np.float32(0.5), "0.5"),
        (np.int32(5), "5"),
        (1e16, "1.0e+16"),
        (5e-324, "5.0e-324"),
    ],
)
def test_float_format(number, text):
    assert dump_yaml({"x": number}).endswith(f"\nx: {text}\n")


@pytest.mark.parametrize(
    "text", ["no", "1e-3", "1:30", "Yes", "N", "y", "null", "~", "2026-11-20T22:00:00Z", "0x10", ""]
)
def test_doubtful_text_is_quoted(text):
    assert dump_yaml({"x": text}).endswith(f'\nx: "{text}"\n')
    assert dump_yaml({text: 1}).endswith(f'\n"{text}": 1\n')


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, None, {1}, 1j, object()])
def test_what_has_no_place_in_a_file_is_refused(value):
    with pytest.raises(ParameterFileError, match=r"a\.b\[0\]"):
        dump_yaml({"a": {"b": [value]}})


def test_names_that_are_no_utf8_are_made_so():
    assert yaml.safe_load(dump_yaml({"x": "a\udcff"}))["x"].startswith("a\ufffd")


def test_layout(document, lookup):
    document["parameters"]["control_points"] |= {
        "value": [i / 7 for i in range(40)],
        "std_error": None,
        "ci95": None,
    }
    lines = dump_document(make_document(document, lookup)).splitlines()
    assert lines[0].startswith("# ")
    assert lines[1] == "format: fluidact-parameters"
    (mass,) = [line for line in lines if line.strip().startswith("mass:")]
    assert "value: 53.71, unit: kg, std_error: 0.21" in mass
    assert max(map(len, lines)) < 200
    assert lines == [line.rstrip() for line in lines]
    order = [line.split(":")[0] for line in lines[1:] if not line.startswith(" ")]
    assert order == [name for name in ParameterDocument.model_fields if name in document]
    parse_document("\n".join(lines), lookup)


@settings(
    max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    value=st.floats(1e-12, 1e29),
    error=st.floats(0, 1e29),
    points=st.lists(st.floats(-1e30, 1e30), min_size=1, max_size=12),
    message=st.text(max_size=200),
    details=st.dictionaries(keys, nested, max_size=4),
)
def test_documents_round_trip(document, lookup, value, error, points, message, details):
    document["parameters"]["mass"] = {
        "value": value,
        "unit": "kg",
        "std_error": error,
        "ci95": [value - error, value + error],
        "status": "estimated",
    }
    document["parameters"]["control_points"] = {"value": points, "unit": "m", "status": "fixed"}
    document["covariance"] = {"order": ["mass"], "matrix": [[error**2]]}
    document["warnings"] = [{"code": "c", "message": message}]
    document["fit"]["details"] = details
    text = dump_document(make_document(document, lookup))
    read = parse_document(text, lookup)
    assert same(yaml.safe_load(text), read.to_dict())
    assert dump_document(read) == text


# ---------------------------------------------------------------------------- reading


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-3", 1e-3),
        ("1.0e-07", 1e-7),
        ("1E5", 1e5),
        (".5", 0.5),
        ("5.", 5.0),
        ("-12", -12),
        ("0", 0),
        ("true", True),
        ("no", "no"),
        ("on", "on"),
        ("Yes", "Yes"),
        ("010", "010"),
        ("0o17", "0o17"),
        ("1:30", "1:30"),
        ("1_000", "1_000"),
        ("2026-11-20", "2026-11-20"),
        ("'1'", "1"),
        ("~", None),
        ("=", "="),
        ("9" * 5000, math.inf),
        (".inf", math.inf),
        ("1e999", math.inf),
    ],
)
def test_scalars_are_those_of_yaml_1_2(text, value):
    assert same(parse_yaml(f"x: {text}\n", "text").data["x"], value)


def test_there_are_no_merge_keys():
    assert parse_yaml("a: {<<: {b: 1}}", "text").data == {"a": {"<<": {"b": 1}}}


BOMB = "a: &a [x, x]\nb: &b [*a, *a]\nc: [*b, *b]\n"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (BOMB, "line 2.*alias"),
        ("a: &x [*x]", "alias"),
        ("*a : 1", "alias"),
        ("a: " + "[" * 5000, "deeper"),
        ("a: " + "{a: " * 5000, "deeper"),
        ("a: 1\n---\nb: 2\n", "second document"),
        ("a: 1\n--- x\n", "second document"),
        ("", "empty"),
        ("# only a comment\n", "empty"),
        ("---\n", "not a mapping"),
        ("- 1\n", "not a mapping"),
        ("hello", "not a mapping"),
        ("? [1]\n: 2\n", "list or mapping as a key"),
        ("a: [1, 2", "not YAML"),
        ("a: b: c", "line 1.*not YAML"),
        ("a: 1\n\tb: 2", "line 2.*not YAML"),
        ("a: @x", "not YAML"),
        ("a: \x01", "not YAML"),
        ("a: !<", "not YAML"),
        ("%YAML 9.9\n---\na: 1", "not YAML"),
        ("time,force\n1,2\n3,4\n", "not a mapping"),
    ],
)
@pytest.mark.parametrize("pure", [False, True])
def test_texts_that_are_refused(text, words, pure, monkeypatch):
    if pure:
        monkeypatch.delattr(yaml, "CSafeLoader", raising=False)
    with pytest.raises(ParameterFileError, match=f"(?s){words}") as caught:
        parse_yaml(text, "p.yaml")
    assert "p.yaml" in caught.value.where
    assert caught.value.remedy


@pytest.mark.parametrize(
    ("text", "path", "words"),
    [
        ("a: {b: !!python/object/apply:os.system [ls]}", "a.b", "python/object"),
        ("a: !!float 1", "a", "tag"),
        ("a: ! 1", "a", "tag"),
        ("!!map {a: 1}", "", "tag"),
        ("a: &x 1", "a", "anchor"),
        ("&k a: 1", "a", "anchor"),
        ("a: 1\nb: 2\na: 3", "a", "lines 1 and 3"),
        ("a: [{b: 1, b: {c: 1}}]", "a[0].b", "duplicate"),
        ("1: a", "1", "quotes"),
        ("true: a", "true", "quotes"),
        ("? \n: a", "['']", "quotes"),
        ("'F [N]': !x 1", "['F [N]']", "tag"),
    ],
)
def test_texts_with_problems(text, path, words):
    (problem,) = parse_yaml(text, "p.yaml").problems.listed({})
    assert problem[0] == path
    assert words in problem[1]


@settings(max_examples=300, deadline=None)
@given(st.text(st.sampled_from("ab:-[]{}&*!|>'\"%@`#?,~ \n\t01.e\0"), max_size=60))
def test_no_text_brings_the_reader_down(text):
    with contextlib.suppress(ParameterFileError):
        assert isinstance(parse_yaml(text, "p.yaml").data, dict)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"a: \xff\xfe", "line 1: .*UTF-8"),
        ("a: 1".encode("utf-16"), "binary"),
        (b"a: \0", "binary"),
        (b"a: 1\n" + b"#" * MAX_BYTES, "10 MB"),
    ],
    ids=["latin", "utf16", "nul", "huge"],
)
def test_contents_that_are_refused(content, words, tmp_path):
    path = tmp_path / "p.yaml"
    path.write_bytes(content)
    with pytest.raises(ParameterFileError, match=f"(?s){words}"):
        read_yaml(path)


def test_files_that_cannot_be_read(tmp_path):
    for path, words in (
        (tmp_path, "directory"),
        (tmp_path / "absent.yaml", "does not exist"),
        (tmp_path / "a\0b", "cannot be read"),
        (tmp_path / ("x" * 300), "cannot be read"),
    ):
        with pytest.raises(ParameterFileError, match=words) as caught:
            read_yaml(path)
        assert caught.value.remedy


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may read all")
def test_a_file_without_permission(tmp_path):
    path = tmp_path / "p.yaml"
    path.write_text("a: 1")
    path.chmod(0)
    with pytest.raises(ParameterFileError, match="cannot be read"):
        read_yaml(path)


def test_a_byte_order_mark_and_dos_lines_are_taken(tmp_path):
    path = tmp_path / "p.yaml"
    path.write_bytes(b"\xef\xbb\xbfa: 1\r\nb: x\r\n")
    assert read_yaml(path).data == {"a": 1, "b": "x"}
