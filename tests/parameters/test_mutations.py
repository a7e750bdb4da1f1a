"""Whatever a parameter file holds: it is read, or refused in a few words, and nothing else.

``studies.soak`` spoils the files of released versions, a few of them here. What once failed stands
here by name.
"""

from __future__ import annotations

import copy
import itertools
import json
import random
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from studies.soak.parameters import drafted

import fluidact_fit as ff
from fluidact_fit.check import check_logs
from fluidact_fit.control import make_block
from fluidact_fit.demo import load_dataset
from fluidact_fit.errors import FluidactError, ParameterFileError, shortened
from fluidact_fit.excitation import design
from fluidact_fit.families import family_names, get_family
from fluidact_fit.parameters import ParameterDocument
from fluidact_fit.parameters.load import parse_document
from fluidact_fit.parameters.yaml_io import MAX_NODES
from fluidact_fit.simulation import simulate_logs

_GOLDEN = Path(__file__).parents[1] / "golden" / "0.1.0"
_LONGEST = 4000  # characters of a message
_CASES, _USED = 32, 3  # of each family: spoilt files, and those put to use
_ROWS = 120


def text_of(family: str) -> str:
    return (_GOLDEN / f"{family}.yaml").read_text(encoding="utf-8")


def spoilt(family: str, path: str, value: Any) -> str:
    document = yaml.safe_load(text_of(family))
    *way, last = (int(p) if p.isdecimal() else p for p in path.split("/"))
    part = document
    for key in way:
        part = part[key]
    part[last] = value
    return json.dumps(document, ensure_ascii=False)


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], list[Path]]:
    def shorten(family: str) -> list[Path]:
        path = tmp_path_factory.mktemp(family) / "log.csv"
        lines = load_dataset(family).logs[0].read_text(encoding="utf-8").splitlines(keepends=True)
        path.write_text("".join(lines[:_ROWS]), encoding="utf-8")
        return [path]

    return shorten


def outcome(case: str, action: Callable[[], Any]) -> Any:
    """What an action returns, or its error; one that is not for users fails the test."""
    found: Any
    try:
        with np.errstate(all="ignore"):
            found = action()
    except FluidactError as error:
        found = error
    except Exception as error:
        raise AssertionError(f"{case}: {error!r}") from error
    if isinstance(found, FluidactError):
        assert max(len(str(found)), len(found.text)) < _LONGEST, case
    return found


def use(document: ParameterDocument, logs: list[Path]) -> None:
    block = make_block(document, accept_failed=True)
    block.accept(True)
    repr(block)
    simulate_logs(document, [ff.read_log(p) for p in logs])


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("family", family_names())
def test_a_spoilt_file_is_read_or_refused(family: str, logs: Any, tmp_path: Path) -> None:
    path, recorded = tmp_path / "file.yaml", logs(family)
    read: list[tuple[str, ParameterDocument]] = []
    for number in range(_CASES):
        _, what, wrong, content = drafted(random.Random(f"{family} {number}"), family)
        path.write_bytes(content)
        found = outcome(what, partial(ff.read_document, path))
        assert isinstance(found, (ParameterDocument, ParameterFileError)), what
        if isinstance(found, ParameterDocument):
            assert not wrong, what
            read.append((what, found))
    assert len(read) < _CASES  # most of them are refused
    for case, parsed in read:
        outcome(case, partial(use, parsed, recorded))
    for case, parsed in itertools.islice(read, _USED):
        outcome(case, partial(check_logs, parsed, [ff.read_log(p) for p in recorded]))
        outcome(case, partial(design, parsed, duration=0.1))


@pytest.mark.parametrize(
    ("family", "path", "value", "words"),
    [
        ("valve", "parameters/gain/unit", "kg", "wrong dimension; expected 'Pa/V'"),
        ("valve", "parameters/gain/unit", "bar/V", "give SI, in 'Pa/V'"),
        ("valve", "parameters/gain/unit", "9^9^9^9", "not a known unit"),
        ("valve", "derived/frequency/unit", "9^9^9^9", "not a known unit"),
        ("valve", "validity/command/unit", "9^9^9^9", "not a known unit"),
        ("valve", "validity/command/unit", "A", "'Pa/V' has the wrong dimension; expected 'Pa/A'"),
        ("valve", "validity/command/high", [5.0], "a list is not a number"),
        ("spring-cylinder", "parameters/pressure_gain/unit", "N/A", "expected 'N/V'"),
        ("hydraulic-motor", "parameters/curvature/unit", "A", "expected '1/"),
        ("potentiometer", "parameters/reading_range/unit", "V", "expected '1'"),
        ("potentiometer", "parameters/reading_range/value", [991.0, 32.0], "do not increase"),
        ("force-map", "parameters/input_offset/unit", "V", "expected '1'"),
        ("force-map", "parameters/input_offset/value", [29.6], "has 1 entries"),
        ("force-map", "parameters/input_low/value", [0.0], "agree with the parameters"),
        ("force-map", "options/starts", 10**400, "not finite"),
        ("force-map", "options/hidden", "²", "auto, a number from 1 to 64"),
        ("cylinder-friction", "options/deadband", "text", "not a number"),
        ("valve", "options", "text", "not a mapping"),
        ("valve", "options", {"dead-tim": "none"}, "there is no option"),
        ("valve", "fit/rmse/value", -1.0, "-1.0 is too small; expected at least 0"),
        ("valve", "fit/details/output_resolution", "x", "not a number"),
        ("valve", "fit/details", {"comparisons": [1.0]}, "not a mapping"),
        ("valve", "model/output_offset", "x", "not a number"),
        ("valve", "model/output_offset", 1e9, "does not agree"),
        ("valve", "model/more", {"x": 1.0}, "unknown key"),
        ("valve", "provenance/options", {"fixed": {"gain": "x"}}, "not a number"),
        (
            "valve",
            "provenance/options",
            {"bounds": {"gain": [1.0]}},
            "has 1 entry; expected at least 2",
        ),
        ("valve", "provenance/options", {"more": {}}, "unknown key"),
        ("valve", "provenance/seed", -1, "-1 is too small; expected at least 0"),
        ("valve", "provenance/logs/0/columns/command/step", 1, "not a mapping"),
        ("valve", "provenance/logs/0/columns/command/header", ["x"], "not text"),
        ("valve", "provenance/logs/0/columns/COMMAND", {"header": "u"}, "not a role of the family"),
    ],
)
def test_what_was_read_once_is_refused(family: str, path: str, value: Any, words: str) -> None:
    with pytest.raises(ParameterFileError) as caught:
        parse_document(spoilt(family, path, value), get_family)
    assert words in str(caught.value)
    assert len(str(caught.value)) < _LONGEST


@pytest.mark.parametrize("header", ["#²", "#" + "9" * 5000, "#0", "#1.5"])
def test_a_header_that_is_no_column_is_not_followed(header: str, logs: Any) -> None:
    text = spoilt("valve", "provenance/logs/0/columns/command/header", header)
    document = parse_document(text, get_family)
    one = document.model_copy(
        update={
            "provenance": document.provenance.model_copy(
                update={"logs": document.provenance.logs[:1]}
            )
        }
    )
    with pytest.raises(FluidactError, match="command"):
        simulate_logs(one, [ff.read_log(p) for p in logs("valve")])


@pytest.mark.parametrize("details", [{}, {"force_noise": "x"}])
def test_a_file_without_noise_designs_no_strokes(details: dict[str, Any]) -> None:
    text = spoilt("cylinder-friction", "fit/details", details)
    with pytest.raises(FluidactError, match="does not say how much noise"):
        design(parse_document(text, get_family))


# ------------------------------------------------------------------------------ limits


def many(entry: str) -> dict[str, str]:
    """Texts with far too much in them, by what it is."""
    text = text_of("valve")
    row = f"[{','.join([entry] * 200)}]"
    document = copy.deepcopy(yaml.safe_load(text))
    document["covariance"]["matrix"] = "@@"
    return {
        "matrix": json.dumps(document).replace('"@@"', f"[{','.join([row] * 200)}]"),
        "keys": text + "".join(f"k{i}: {entry}\n" for i in range(5000)),
        "parameters": text.replace(
            "parameters:\n", "parameters:\n" + "".join(f"  k{i}: {entry}\n" for i in range(5000))
        ),
        "options": text.replace(
            "\noptions:\n", "\noptions:\n" + "".join(f"  k{i}: {entry}\n" for i in range(5000))
        ),
        "details": text.replace("  details:\n", f"  details:\n    more: {row}\n"),
        "anchors": text + "".join(f"k{i}: &a{i} {entry}\n" for i in range(500)),
        "tags": text + "".join(f"k{i}: !!python/object:x {entry}\n" for i in range(500)),
    }


@pytest.mark.parametrize("what", many(""))
@pytest.mark.parametrize("entry", [".nan", "x"])
def test_of_many_problems_ten_are_told(what: str, entry: str) -> None:
    if (what, entry) == ("details", "x"):
        pytest.skip("text among the details is no problem")
    with pytest.raises(ParameterFileError) as caught:
        parse_document(many(entry)[what], get_family)
    said = str(caught.value)
    assert "more than 100 problems" in said
    assert len(said.splitlines()) == 1 + ParameterFileError.SHOWN + 1  # with what to do
    assert len(said) < _LONGEST
    assert len(caught.value.problems) == ParameterFileError.MOST


def test_up_to_a_hundred_problems_are_counted() -> None:
    error = ParameterFileError("p.yaml", [(f"k{i}", "unknown key") for i in range(37)])
    assert error.text.startswith("p.yaml: not a valid parameter file (37 problems):")
    assert error.text.endswith("k9: unknown key\n  ... and 27 more")
    assert len(error.problems) == 37


@pytest.mark.parametrize(
    "text",
    [
        f"x: [{','.join(['1.0'] * MAX_NODES)}]",
        "".join(f"k{i}: 1\n" for i in range(MAX_NODES // 2 + 1)),
        "k: 1\n" * (MAX_NODES // 2 + 1),
    ],
)
def test_a_file_of_too_many_entries_is_refused_at_once(text: str) -> None:
    with pytest.raises(ParameterFileError, match="goes beyond 100000 keys") as caught:
        parse_document(text, get_family)
    assert len(caught.value.problems) == 1


@pytest.mark.parametrize(
    "text",
    [
        "a: &a [x, x]\nb: &b [*a, *a]\nc: [*b, *b]\n",
        "a: &a [*a]\n",
        "a: " + "[" * 50_000,
        "a: " + "{a: " * 50_000,
        "\n".join(" " * i + "a:" for i in range(500)),
        "a: !!python/object/apply:os.system ['true']\n",
        "<<: {a: 1}\n",
        "a: !<tag:yaml.org,2002:binary> aGVsbG8=\n",
        "a: 2001-01-01\n",
        "%TAG ! tag:x,2000:\n---\na: !b 1\n",
    ],
)
def test_what_yaml_can_do_beyond_data_is_refused(text: str) -> None:
    with pytest.raises(ParameterFileError) as caught:
        parse_document(text, get_family)
    assert len(str(caught.value)) < _LONGEST


def test_a_long_text_is_shortened_in_the_middle() -> None:
    assert shortened("x" * 300) == "x" * 300
    found = shortened("a" + "x" * 5000 + "b")
    assert len(found) == 300
    assert (found[0], found[-1]) == ("a", "b")
    assert " ... " in found


def test_a_tag_or_anchor_is_quoted() -> None:
    with pytest.raises(ParameterFileError) as caught:
        parse_document(text_of("valve") + "k: !<%1b[31mx> 1\n", get_family)
    assert "\x1b" not in str(caught.value)


@pytest.mark.parametrize("missing", ["area-1", "supply-pressure", "mass", "dead-volume-2"])
def test_a_file_without_what_its_simulation_needs(missing: str, tmp_path: Path) -> None:
    document = yaml.safe_load(text_of("hydraulic-cylinder"))
    del document["options"][missing]
    path = tmp_path / "file.yaml"
    path.write_text(json.dumps(document), encoding="utf-8")
    with pytest.raises(ParameterFileError, match="cannot be made from the parameters") as error:
        ff.load(path)
    assert missing.replace("-", "_") in str(error.value)
