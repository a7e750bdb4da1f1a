"""Parameter files and file names made to do harm: refused, or exported without any."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import pytest
import yaml
from scipy.io import loadmat
from st_interpreter import Instance
from st_parser import Parser

import fluidact_fit as ff
from fluidact_fit.export import TARGETS, export
from fluidact_fit.export.target import file_stem, plain_text, safe_name

Edited = Callable[..., Path]

# Ends a text, a comment or a line in every language, and then does something.
EVIL = (
    "'); system('touch PWNED'); %'\"; */ int x; /* *) (* ]] ?>\n!touch PWNED\r\n#{x} ${x} `touch "
    "PWNED` \\\n??/\n$'\\ %s%n --> <x> {{ x }} {% x %} \u2028 ü \x1b[31m ../../PWNED"
)


def spread_evil(document: dict[str, Any]) -> None:
    """Put harmful text wherever a parameter file takes any."""
    document["warnings"].append({"code": EVIL, "message": EVIL})
    document["fit"]["details"][EVIL[:150]] = EVIL
    document["fit"]["method"] = EVIL
    document["fit"]["logs"][0]["file"] = EVIL
    document["provenance"]["command"] = EVIL
    document["provenance"]["tool"] = {"name": EVIL, "version": EVIL}
    for log in document["provenance"]["logs"]:
        log["file"] = EVIL
        for column in log["columns"].values():
            column["header"] = column["unit"] = EVIL
    for entry in document["parameters"].values():
        entry["method"] = EVIL


HARMLESS = re.compile(r"[\x20-\x7e]*")
CODE = re.compile(  # a line of a .m file: a comment, or an assignment of numbers and plain texts
    r"\s*(%[^%]*|function model = \w+\(\)|end|\.\.\..*|-?[0-9].*"
    r"|if ~?exist\('OCTAVE_VERSION', 'builtin'\)(  %.*)?|pkg\('load', 'control'\);"
    r"|model\.[\w.]+ = [^%]*(  %.*)?)"
)


def assert_only_here(folder: Path, before: set[Path]) -> None:
    """Nothing but exports appeared, and nothing that a text asked for."""
    assert not [p for p in folder.rglob("*") if "PWNED" in p.name and p not in before]


@pytest.mark.parametrize("to", TARGETS)
def test_texts_of_a_file_are_nothing_but_texts(to: str, edited: Edited, tmp_path: Path) -> None:
    path = edited("line", spread_evil)
    written = {p.suffixes[-1] if to != "ros2" else p.suffixes[0]: p
               for p in export([path], to, tmp_path / "out")}  # fmt: skip
    for file in written.values():
        if file.suffix not in (".mat", ".fmu"):
            text = file.read_text(encoding="utf-8")
            assert not re.search(r"[\x00-\x09\x0b-\x1f\x7f\u2028]", text)
    check = {
        "json": check_json, "ros2": check_ros2, "matlab": check_matlab, "c": check_c,
        "fmu": check_fmu,
        "st": check_st,
    }.get(to)  # fmt: skip
    assert check is not None, "a new target needs a check of its own"
    check(written)
    assert_only_here(tmp_path, set())


def check_json(written: dict[str, Path]) -> None:
    found = json.loads(written[".json"].read_text(encoding="ascii"))
    assert found["provenance"]["command"] == EVIL
    assert found["fit"]["details"][EVIL[:150]] == EVIL


def check_ros2(written: dict[str, Path]) -> None:
    """The node and its declaration hold no text of the file; the metadata hold it as a text."""
    for suffix in (".ros2", ".declaration"):
        text = written[suffix].read_text(encoding="ascii")
        assert "PWNED" not in text
        assert list(yaml.safe_load(text)) == ["edited"]
    found = yaml.safe_load(written[".metadata"].read_text(encoding="utf-8"))
    assert found["provenance"]["command"] == EVIL
    assert found["warnings"][0]["message"] == EVIL


def check_c(written: dict[str, Path]) -> None:
    """The compiler finds no fault, and the self-test holds."""
    for file in written.values():
        assert "PWNED" not in file.read_text(encoding="ascii")
    if shutil.which("gcc") is None:
        pytest.skip("gcc is not installed")
    folder = written[".h"].parent
    words = "-std=c99 -Wall -Wextra -Werror -pedantic edited.c edited_selftest.c -lm -o run"
    subprocess.run(["gcc", *words.split()], cwd=folder, check=True)
    subprocess.run([folder / "run"], check=True)


def check_fmu(written: dict[str, Path]) -> None:
    """The description is XML, and what was compiled holds no text of the file either."""
    with zipfile.ZipFile(written[".fmu"]) as unit:
        assert ET.fromstring(unit.read("modelDescription.xml")).get("modelName") == "edited"
        assert not any(b"PWNED" in unit.read(name) for name in unit.namelist())
        assert all(re.fullmatch(r"[\w./]+", name) for name in unit.namelist())


def check_st(written: dict[str, Path]) -> None:
    """It reads as constants and function blocks, and the self-test holds."""
    text = written[".st"].read_text(encoding="ascii")
    assert "PWNED" not in text
    assert Instance(Parser(text), "FB_edited_selftest")() == {"passed": True, "failures": 0}


def check_matlab(written: dict[str, Path]) -> None:
    text = written[".m"].read_text(encoding="ascii")
    assert "PWNED" not in text
    assert all(CODE.fullmatch(line) for line in text.splitlines())
    assert loadmat(written[".mat"])["edited"]["family"].item() == "line"
    assert b"PWNED" not in written[".mat"].read_bytes()


def test_octave_runs_the_export_of_a_hostile_file(edited: Edited, tmp_path: Path) -> None:
    if shutil.which("octave-cli") is None:
        pytest.skip("octave-cli is not installed")
    export([edited("force-map", spread_evil)], "matlab", tmp_path / "out")
    code = "m = edited(); s = load('edited.mat'); disp(m.family); disp(s.edited.family);"
    done = subprocess.run(
        ["octave-cli", "-q", "--norc", "--eval", code],
        cwd=tmp_path / "out", capture_output=True, text=True, check=False, timeout=120,
    )  # fmt: skip
    assert done.stdout == "force-map\nforce-map\n", done.stderr
    assert_only_here(tmp_path, set())


NAMES = [
    "a'); system('touch PWNED'); %.yaml", '"; rm -rf *.yaml', "a\nb = system('x').yaml", "-rf.yaml",
    "..yaml", "...yaml", ".yaml", "ü ö.yaml", "模型.yaml", "2021-03.yaml", "while.yaml", "Con.yaml",
    "tf.yaml", "end_try_catch.yaml", "x" * 200 + ".yaml", "a*/b.yaml".replace("/", "\u2215"),
    "$(touch PWNED).yaml", "a__b_.yaml", "END_IF.yaml", "lambda.YAML", "line.v2.yml", "model.yaml",
]  # fmt: skip


# a functional mock-up unit is compiled, and gets its name from the same place
@pytest.mark.parametrize(
    ("to", "name"), [(to, n) for to in TARGETS for n in (NAMES[:3] if to == "fmu" else NAMES)]
)
def test_names_of_files_become_identifiers(
    to: str, name: str, edited: Edited, tmp_path: Path
) -> None:
    path, folder = edited("valve", lambda d: None, name), tmp_path / "out"
    written = export([path], to, folder)
    stem = safe_name(name)
    assert re.fullmatch(r"[A-Za-z](_?[A-Za-z0-9])*", stem)
    assert len(stem) < 60
    file_name = stem if to == "matlab" else file_stem(name)
    assert re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_-]*", file_name)
    assert {p.parent for p in written} == {folder}
    names = {p.name.partition(".")[0].removesuffix("_selftest") for p in written}
    assert names == {file_name}
    assert sorted(folder.iterdir()) == sorted(written)
    for file in written:
        if file.suffix in (".yaml", ".json"):
            assert yaml.safe_load(file.read_text(encoding="utf-8"))
        elif file.suffix == ".st":
            Parser(file.read_text(encoding="ascii"))
        elif file.suffix in (".c", ".h"):
            assert (
                f'#include "{file_name}.h"' in file.read_text(encoding="ascii")
                or file.suffix == ".h"
            )
        elif file.suffix == ".m":
            text = file.read_text(encoding="ascii")
            assert text.startswith(f"function model = {stem}()\n% {stem.upper()}  ")
            assert all(CODE.fullmatch(line) for line in text.splitlines())
        elif file.suffix == ".fmu":
            with zipfile.ZipFile(file) as unit:
                assert {f"binaries/linux64/{stem}.so", f"sources/{stem}.c"} < {*unit.namelist()}
        else:
            assert stem in loadmat(file)


def test_identifiers_are_no_words_of_a_language() -> None:
    import keyword

    words = [
        *keyword.kwlist,
        "float",
        "volatile",
        "end_while",
        "var_global",
        "Function",
        "REAL",
        "nul",
    ]
    for word in words:
        assert safe_name(f"{word}.yaml").lower() != word.lower()


def test_plain_text_ends_no_comment_and_no_string() -> None:
    plain = plain_text(EVIL)
    assert HARMLESS.fullmatch(plain)
    for sign in ("'", '"', "\\", "*", "?", "%", "$", "`", "{", "}", "//", ";", "#", "&", "!"):
        assert sign not in plain
    assert plain_text("N s/m, 12 % of it (a-b)") == "N s/m, 12 _ of it (a-b)"


@pytest.mark.parametrize("to", ["json", "c"])  # all read the file in the same way
def test_a_million_entries_are_refused(to: str, edited: Edited, tmp_path: Path) -> None:
    path = edited("force-map", lambda d: None)
    text = path.read_text(encoding="utf-8")
    row = "- [" + ", ".join(["1.0"] * 1000) + "]\n"
    place = text.index("  weights_1:\n    value:\n") + len("  weights_1:\n    value:\n")
    path.write_text(text[:place] + ("    " + row) * 1000 + text[place:], encoding="utf-8")
    with pytest.raises(ff.ParameterFileError, match=r"too many|too large"):
        export([path], to, tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("to", TARGETS)
@pytest.mark.parametrize(
    ("family", "change"),
    [
        ("potentiometer", lambda d: d["parameters"]["weights"]["value"].pop()),
        ("force-map", lambda d: d["parameters"]["biases_1"]["value"].append(0.0)),
        ("force-map", lambda d: d["parameters"]["weights_1"]["value"][0].pop()),
        ("line", lambda d: d["model"]["discrete"]["numerator"].append(0.0)),
        ("line", lambda d: d["model"]["discrete"].update(numerator="x; system('x')")),
        ("line", lambda d: d["parameters"].update({EVIL[:99]: d["parameters"]["gain"]})),
        ("line", lambda d: d["parameters"]["gain"].update(unit=EVIL)),
        ("line", lambda d: d["validity"].update({"x = system('x')": d["validity"]["inlet"]})),
        ("line", lambda d: d["covariance"]["order"].__setitem__(0, "a'); system('x')")),
        ("line", lambda d: d["model"].update({"x'); system('x')": 1.0})),
        ("force-map", lambda d: d["options"].update(inputs="x'); system('x'), position")),
    ],
)
def test_a_file_that_is_wrong_is_refused(
    to: str, family: str, change: Any, edited: Edited, tmp_path: Path
) -> None:
    with pytest.raises(ff.ParameterFileError):
        export([edited(family, change)], to, tmp_path / "out")
    assert not (tmp_path / "out").exists()
