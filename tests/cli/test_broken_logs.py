"""Torture: every broken log ends with a documented status, a place, a remedy, and no file.

Logs are made by code from one synthetic table per family (its required roles, all moving) and
then damaged. What counts as a good fit is tested elsewhere.
"""

from __future__ import annotations

import gzip
import os
import re
import zipfile
from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fluidact_fit.families import family_names, get_family

Damage = Callable[[list[str], list[list[str]]], "str | bytes"]
ROWS = 60
TELLS_WHAT_TO_DO = re.compile(
    r"\b(Give|Check|Record|Remove|Choose|Unpack|Export|Save|Name|Correct|Keep|Look|Did you mean|"
    r"Expected|Try|Create|Write|Copy|Free|Convert|Sample|Use|Fit|See|Move|Mend|Read|Transpose)\b|--[a-z]"
)


def base_table(family: str) -> tuple[list[str], list[list[str]]]:
    """Headers and cells of a table with the required roles of the family's first variant."""
    rng = np.random.default_rng(len(family))
    time = 0.01 * np.arange(ROWS)
    headers, columns = ["time [s]"], [time]
    for role in get_family(family).variants[0].roles:
        if role.required and role.name != "time":
            headers.append(f"{role.name} [{role.unit}]")
            columns.append(np.interp(time, np.linspace(0, 0.6, 9), rng.normal(size=9)))
    return headers, [[f"{v:.7g}" for v in row] for row in zip(*columns)]


def table(headers: list[str], rows: list[list[str]], separator: str = ",") -> str:
    """Return the text of a table."""
    return "\n".join(separator.join(cells) for cells in [headers, *rows]) + "\n"


def with_cells(text: str, column: int = -1, at: slice = slice(30, 31)) -> Damage:
    """Put a text into cells."""

    def damage(headers: list[str], rows: list[list[str]]) -> str:
        changed = [list(row) for row in rows]
        for row in changed[at]:
            row[column] = text
        return table(headers, changed)

    return damage


def with_columns(change: Callable[[np.ndarray], np.ndarray]) -> Damage:
    """Change all columns but time."""

    def damage(headers: list[str], rows: list[list[str]]) -> str:
        values = np.array(rows, dtype=float)
        values[:, 1:] = change(values[:, 1:])
        return table(headers, [[f"{v:.7g}" for v in row] for row in values])

    return damage


def zipped(headers: list[str], rows: list[list[str]]) -> bytes:
    """Return a zip archive with the log."""
    buffer = BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr("log.csv", table(headers, rows))
    return buffer.getvalue()


DAMAGES: dict[str, Damage] = {
    "empty": lambda h, r: "",
    "blank-lines": lambda h, r: "\n\n  \n\t\n" * 20,
    "bom-only": lambda h, r: b"\xef\xbb\xbf",
    "header-only": lambda h, r: table(h, []),
    "header-without-line-end": lambda h, r: ",".join(h),
    "single-row": lambda h, r: table(h, r[:1]),
    "two-rows": lambda h, r: table(h, r[:2]),
    "only-comments": lambda h, r: "# recorded by hand\n" * 30,
    "preamble-only": lambda h, r: "Recorder 3\nDate: 2020-01-02\n\nValues follow\n" * 5,
    "prose": lambda h, r: "The quick brown fox jumps over the lazy dog.\n" * 40,
    "one-column": lambda h, r: "\n".join(["force", *(row[-1] for row in r)]),
    "one-number": lambda h, r: "1.5\n",
    "binary": lambda h, r: bytes(range(256)) * 40,
    "random-bytes": lambda h, r: np.random.default_rng(0).bytes(4000),
    "nul-bytes": lambda h, r: table(h, r).encode().replace(b"\n", b"\n\0\0", 8),
    "nul-tail": lambda h, r: table(h, r).encode() + b"\0" * 4096,
    "gzip": lambda h, r: gzip.compress(table(h, r).encode())[:-9],
    "zip": zipped,
    "utf16-damaged": lambda h, r: b"\xff\xfe" + b"\x00\xd8" * 400,
    "html": lambda h, r: "<html><body><h1>404 Not Found</h1></body></html>\n" * 4,
    "json": lambda h, r: '{"time": [0, 1, 2], "force": [1, 2, 3]}\n',
    "text-in-the-middle": with_cells("10x7"),
    "nan": with_cells("nan"),
    "infinity": with_cells("inf"),
    "minus-infinity": with_cells("-Infinity", at=slice(10, 13)),
    "overflow": with_cells("1e999"),
    "empty-cells": with_cells("", at=slice(5, 9)),
    "words-in-time": with_cells("later", column=0, at=slice(20, 40)),
    "excel-error": with_cells("#VALUE!"),
    "boolean": with_cells("TRUE", at=slice(0, ROWS)),
    "text-column": with_cells("open", at=slice(0, ROWS)),
    "ragged": lambda h, r: table(h, [row[: 1 + i % len(row)] for i, row in enumerate(r)]),
    "extra-cells": lambda h, r: table(h, [row + ["1"] * (i % 4) for i, row in enumerate(r)]),
    "mixed-decimal-commas": lambda h, r: table(
        h, [[c.replace(".", ",") for c in row] if i % 2 else row for i, row in enumerate(r)]
    ),
    "wrong-delimiter": lambda h, r: table(h, r, "&"),
    "other-headers": lambda h, r: table([f"channel {i}" for i in range(len(h))], r),
    "no-header": lambda h, r: table(r[0], r[1:]),
    "duplicate-headers": lambda h, r: table([h[0], *[h[1]] * (len(h) - 1)], r),
    "only-time": lambda h, r: table(h[:1], [row[:1] for row in r]),
    "unknown-unit": lambda h, r: table([h[0], *(f"{c.split()[0]} [bananas]" for c in h[1:])], r),
    "wrong-unit": lambda h, r: table([h[0], *(f"{c.split()[0]} [kg]" for c in h[1:])], r),
    "units-row-of-garbage": lambda h, r: table(
        [c.split()[0] for c in h], [["??", *["@@"] * (len(h) - 1)], *r]
    ),
    "time-going-back-and-forth": lambda h, r: table(
        h, [r[i] for i in np.random.default_rng(3).permutation(16)]
    ),
    "time-constant": with_cells("0.5", column=0, at=slice(0, ROWS)),
    "all-zero": with_columns(lambda v: 0.0 * v),
    "constant": with_columns(lambda v: 0.0 * v + 3.5),
    "huge": with_columns(lambda v: 1e308 * np.sign(v)),
    "tiny": with_columns(lambda v: 1e-320 * np.sign(v)),
    "very-wide": lambda h, r: (
        ",".join(f"c{i}" for i in range(100_000)) + "\n" + ",".join(["1"] * 100_000) + "\n"
    ),
}
# Damage that leaves a family with data it can use; what it then says is tested elsewhere.
HARMLESS: dict[str, set[str]] = {
    # One steady stroke does show the friction of its direction.
    "cylinder-friction": {"constant"},
    # A map needs no time: a time column that cannot be used is left out, and said.
    "force-map": {"words-in-time", "time-constant"},
}

# Options that cannot be, or that do not fit the log; the log itself is sound.
OPTIONS: dict[str, list[str]] = {
    "no-such-option": ["--colum", "outlet=#3"],
    "column-without-equals": ["--column", "outlet"],
    "column-without-role": ["--column", "=#3"],
    "column-without-header": ["--column", "outlet="],
    "column-missing": ["--column", "outlet=pressure"],
    "column-number-0": ["--column", "outlet=#0"],
    "column-number-99": ["--column", "outlet=#99"],
    "column-twice": ["--column", "outlet=#3", "--column", "outlet=#2"],
    "role-unknown": ["--column", "outlett=#3"],
    "unit-unknown": ["--unit", "outlet=bananas"],
    "unit-wrong": ["--unit", "outlet=kg"],
    "unit-of-time-wrong": ["--unit", "time=V"],
    "unit-offset": ["--unit", "time=degC"],
    "unit-for-unknown-role": ["--unit", "force=N"],
    "scale-zero": ["--scale", "outlet=0"],
    "scale-nan": ["--scale", "outlet=nan"],
    "scale-comma": ["--scale", "outlet=1,5"],
    "scale-word": ["--scale", "outlet=half"],
    "sample-time-zero": ["--sample-time", "0"],
    "sample-time-negative": ["--sample-time", "-0.01"],
    "sample-time-infinite": ["--sample-time", "inf"],
    "sample-time-comma": ["--sample-time", "0,01"],
    "sample-time-word": ["--sample-time", "ten"],
    "window-without-colon": ["--window", "3"],
    "window-reversed": ["--window", "3:1"],
    "window-empty": ["--window", ":"],
    "window-outside": ["--window", "100:200"],
    "window-word": ["--window", "begin:end"],
    "step-incomplete": ["--step", "command=3"],
    "step-of-output": ["--step", "outlet=0:3"],
    "step-of-time": ["--step", "time=0:3"],
    "step-at-nothing": ["--step", "command=0:3@"],
    "step-infinite": ["--step", "command=0:1e999"],
    "step-and-column": ["--step", "command=0:3", "--column", "command=#2"],
    "hold-unknown": ["--hold", "command=spline"],
    "hold-of-output": ["--hold", "outlet=foh"],
    "fix-unknown": ["--fix", "mass=3"],
    "fix-word": ["--fix", "gain=large"],
    "fix-impossible": ["--fix", "damping_ratio=-1"],
    "start-unknown": ["--start", "gane=3"],
    "start-impossible": ["--start", "natural_frequency=-5"],
    "bounds-reversed": ["--bounds", "damping_ratio=2:1"],
    "bounds-single": ["--bounds", "damping_ratio=2"],
    "bounds-impossible": ["--bounds", "damping_ratio=-2:-1"],
    "seed-negative": ["--seed", "-1"],
    "seed-word": ["--seed", "today"],
    "choice-unknown": ["--dead-time", "guess"],
    "period-zero": ["--controller-sample-time", "0"],
    "validate-missing": ["--validate", "nowhere.csv"],
    "plot-suffix": ["--plot", "valve.bmp"],
    "plot-directory": ["--plot", "nowhere/valve.png"],
    "report-suffix": ["--report", "report.doc"],
    "strict": ["--strict", "--column", "time=#1", "--unit", "command=A", "--window", ":0.05"],
}


def assert_refused(
    done: Any, directory: Path, kept: dict[str, bytes], name: str = "log.csv"
) -> None:
    """Documented status, a place, a remedy, no traceback, and every file as it was."""
    text = f"status {done.status}\n{done.out}\n{done.err}"
    assert done.status in (2, 3, 4), text
    assert "Traceback" not in done.err, text
    assert "bug in fluidact-fit" not in done.err, text
    assert done.out == "", text
    message = done.err.strip()
    assert message, text
    assert len(message) < 4000, text
    assert TELLS_WHAT_TO_DO.search(message), text
    if done.status == 3 or (done.status == 4 and "--strict" not in message):
        assert name in message, text
    assert {p.name: p.read_bytes() for p in directory.iterdir() if p.is_file()} == kept


# Where a line or a column is to blame it has to be named.
LINES = {
    "text-in-the-middle": (r"line 32\b", "10x7"),
    "nan": (r"line 32\b", "nan"),
    "infinity": (r"line 32\b", "inf"),
    "minus-infinity": (r"line 12\b", "-Infinity"),
    "overflow": (r"line 32\b", "1e999"),
    "empty-cells": (r"line 7\b", "is empty"),
    "excel-error": (r"line 32\b", "#VALUE!"),
    "text-column": (r"line 2\b", "open"),
    "ragged": (r"line \d+", "field"),
    "extra-cells": (r"line \d+", r"fields?|cells"),
    "mixed-decimal-commas": (r"line \d+", "field"),
    "huge": (r"line 2\b", "too large"),
    "tiny": (r"line 2\b", "too small"),
    "wrong-unit": ("column '", "a mass"),
    "unknown-unit": ("column '", "not known"),
}

Refuse = Callable[..., Any]


@pytest.fixture
def refuse(here: Callable[..., Any], tmp_path: Path) -> Refuse:
    """Fit a broken log over an existing parameter file and check how it ends."""

    def check(family: str, content: str | bytes, *options: str) -> Any:
        log, output = tmp_path / "log.csv", tmp_path / "out.yaml"
        log.write_bytes(content if isinstance(content, bytes) else content.encode())
        output.write_text("precious: true\n")
        kept = {p.name: p.read_bytes() for p in tmp_path.iterdir() if p.is_file()}
        done = here(family, log, "-o", output, "-f", *options)
        assert_refused(done, tmp_path, kept)
        return done

    return check


def _cases() -> Iterator[tuple[str, str]]:
    assert not set(LINES) - set(DAMAGES)
    for family in family_names():
        for damage in DAMAGES:
            if damage not in HARMLESS.get(family, set()):
                yield family, damage


@pytest.mark.parametrize(("family", "damage"), list(_cases()))
def test_broken_log_is_refused_and_its_place_named(
    family: str, damage: str, refuse: Refuse
) -> None:
    message = refuse(family, DAMAGES[damage](*base_table(family))).err
    for pattern in LINES.get(damage, ()):
        assert re.search(pattern, message), message


@pytest.mark.parametrize("case", OPTIONS)
def test_wrong_option_is_refused(
    case: str, here: Callable[..., Any], valve: Callable[..., Path], tmp_path: Path
) -> None:
    log, output = valve("log.csv"), tmp_path / "out.yaml"
    output.write_text("precious: true\n")
    kept = {p.name: p.read_bytes() for p in tmp_path.iterdir()}
    done = here("valve", log, "-o", output, "-f", *OPTIONS[case])
    assert_refused(done, tmp_path, kept, name="nowhere" if "nowhere" in case else "")
    option = OPTIONS[case][0]
    if done.status == 2:
        value = OPTIONS[case][-1]
        assert option.strip("-") in done.err or value in done.err, done.err


@pytest.mark.parametrize("family", family_names())
def test_missing_log_and_directory(family: str, here: Callable[..., Any], tmp_path: Path) -> None:
    (tmp_path / "folder.csv").mkdir()
    for name in ("nowhere.csv", "folder.csv", "x" * 300 + ".csv", "a\udc80b.csv"):
        done = here(family, tmp_path / name, "-o", tmp_path / "out.yaml")
        assert_refused(done, tmp_path, {}, name=name.encode(errors="replace").decode()[:1])


@pytest.mark.parametrize("family", family_names())
def test_second_log_is_named(family: str, here: Callable[..., Any], tmp_path: Path) -> None:
    headers, rows = base_table(family)
    (tmp_path / "good.csv").write_text(table(headers, rows))
    (tmp_path / "bad.csv").write_text(with_cells("10x7")(headers, rows))
    kept = {p.name: p.read_bytes() for p in tmp_path.iterdir()}
    done = here(family, tmp_path / "good.csv", tmp_path / "bad.csv", "-o", tmp_path / "o.yaml")
    assert done.status == 3
    assert_refused(done, tmp_path, kept, name="bad.csv, line 32")
    done = here(
        family, tmp_path / "good.csv", "--validate", tmp_path / "bad.csv", "-o", tmp_path / "o.yaml"
    )
    # the sound log of a family with optional roles may lack what a fit of it needs
    sound = "good.csv" if "good.csv" in done.err and "bad.csv" not in done.err else "bad.csv"
    assert_refused(done, tmp_path, kept, name=sound if done.status == 3 else "")


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root reads all")
def test_unreadable_log(refuse: Refuse, tmp_path: Path) -> None:
    (tmp_path / "log.csv").touch(mode=0o000)
    refuse("valve", "")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes here")
def test_pipe_is_not_waited_for(here: Callable[..., Any], tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "log.csv")
    assert_refused(here("valve", tmp_path / "log.csv", "-o", tmp_path / "o.yaml"), tmp_path, {})


@pytest.mark.parametrize("damage", ["binary", "all-zero", "text-in-the-middle"])
def test_in_a_process_of_its_own(damage: str, apart: Callable[..., Any], tmp_path: Path) -> None:
    family = "hydrostatic"
    content = DAMAGES[damage](*base_table(family))
    log = tmp_path / "log.csv"
    log.write_bytes(content if isinstance(content, bytes) else content.encode())
    done = apart(family, "log.csv", cwd=tmp_path)
    assert_refused(done, tmp_path, {"log.csv": log.read_bytes()})


QUICK = {"force-map": ("--starts", "1", "--hidden", "1")}  # what the search for weights costs


def _odd_options(family: str) -> list[list[str]]:
    """Well-formed options that few logs go with; ``make soak`` draws them for every parameter."""
    variant = get_family(family).variants[0]
    odd = [["--window", "0:0.1"], ["--sample-time", "1e-14"], ["--sample-time", "1e200"]]
    for role in variant.roles:
        odd += [["--scale", f"{role.name}=1e300"], ["--step", f"{role.name}=0:1@0.1"]]
    odd += [["--hold", f"{role.name}=cubic"] for role in variant.roles[:2]]
    odd += [["--fix", f"{parameter.name}=1e30"] for parameter in variant.parameters[::3]]
    odd += [["--bounds", f"{variant.parameters[0].name}=1:1.001"]]
    return odd


@pytest.mark.parametrize("family", family_names())
def test_odd_options_never_end_in_a_fault(
    family: str, here: Callable[..., Any], tmp_path: Path
) -> None:
    log = tmp_path / "log.csv"
    log.write_text(table(*base_table(family)))
    for options in _odd_options(family):
        done = here(family, log, "-o", tmp_path / "out.yaml", *QUICK.get(family, ()), *options)
        text = f"{options}: {done}"
        assert done.status in (0, 2, 3, 4), text
        assert "Traceback" not in done.err, text
        assert (tmp_path / "out.yaml").exists() is (done.status == 0), text
        (tmp_path / "out.yaml").unlink(missing_ok=True)


def test_there_are_enough_cases() -> None:
    assert len(list(_cases())) + len(OPTIONS) > 200
