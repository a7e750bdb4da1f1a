"""What a new user meets first: units in numbers, mistakes named, notes told from warnings."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from fluidact_fit import read_document
from fluidact_fit.errors import Notice
from fluidact_fit_cli.messages import echo_notices
from fluidact_fit_cli.parse import parse_window

Run = Callable[..., Any]
Log = Callable[..., Path]


def test_numbers_may_have_units(here: Run, valve: Log, inside: Path) -> None:
    done = here(
        "valve", valve(), "--fix", "natural_frequency=1200 deg/s", "--start", "gain=1 kPa/V",
        "--bounds", "damping_ratio=5:200 %", "--controller-sample-time", "2 ms",
    )  # fmt: skip
    assert done.status == 0, done.err
    document = read_document(inside / "valve.yaml")
    assert document.parameters["natural_frequency"].value == pytest.approx(20.94395, rel=1e-6)
    assert document.model["discrete"]["sample_time"] == pytest.approx(0.002)


@pytest.mark.parametrize(("option", "value", "told"), [
    ("--set", "comand=2 V", "--set names the role 'comand', which does not exist here"),
    ("--step", "comand=0:2", "--step names the role 'comand', which does not exist here"),
    ("--fix", "natural_frequency=20 bar", "unit 'bar' is a pressure"),
    ("--fix", "natural_frequency=20 furlongs", "furlongs"),
    ("--bounds", "gain=2 kPa/V:1 kPa/V", "2 kPa/V is not below 1 kPa/V"),
    ("--sample-time", "2 bar", "unit 'bar' is a pressure"),
    ("--sample-time", "0 ms", "is not above zero"),
])  # fmt: skip
def test_a_unit_of_something_else_is_refused(
    here: Run, valve: Log, option: str, value: str, told: str
) -> None:
    done = here("valve", valve(), option, value)
    assert done.status == 2
    assert told in done.err


def test_an_option_of_a_family_takes_a_unit(here: Run, inside: Path) -> None:
    inside.joinpath("log.csv").write_text("a,b\n1,2\n")
    done = here("hydraulic-cylinder", "log.csv", "--area-1", "4.91 bar")
    assert done.status == 2
    assert "unit 'bar' is a pressure" in done.err
    done = here("hydraulic-cylinder", "log.csv", "--area-1", "4.91cm2")
    assert "no column is named 'time', 'command' and 'position'" in done.err
    assert "--column command=HEADER --column position=HEADER" in done.err


def test_a_parameter_file_is_yaml(here: Run, valve: Log, inside: Path) -> None:
    done = here("valve", valve(), "-o", "valve.json")
    assert done.status == 2
    assert "--json" in done.err
    assert "valve.yaml" in done.err
    assert not inside.joinpath("valve.json").exists()


@pytest.mark.parametrize("command", ["check", "simulate"])
@pytest.mark.usefixtures("inside")
def test_arguments_that_are_swapped_are_named(here: Run, valve: Log, command: str) -> None:
    log = valve()
    assert here("valve", log).status == 0
    done = here(command, log, "valve.yaml")
    assert done.status == 2
    assert "Give valve.yaml before" in done.err


def test_it_runs_as_a_module(valve: Log, inside: Path) -> None:
    log = valve()
    done = subprocess.run([sys.executable, "-m", "fluidact_fit", "valve", str(log)], cwd=inside,
                          capture_output=True, text=True, check=False, timeout=120)  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert read_document(inside / "valve.yaml").provenance.command.startswith("fluidact-fit valve")


def test_one_log_has_one_fit_percentage(here: Run, inside: Path) -> None:
    for name, level in (("a.csv", 10.0), ("b.csv", 30.0)):  # levels that friction has to explain
        rows = [f"{0.01 * k:g},{0.02 * level},{level + (-1) ** k * 0.5:g}" for k in range(200)]
        rows += [f"{0.01 * k:g},{-0.02 * level},{-level + (-1) ** k * 0.5:g}"
                 for k in range(200, 400)]  # fmt: skip
        (inside / name).write_text("time [s],velocity [m/s],force [N]\n" + "\n".join(rows) + "\n")
    assert here("cylinder-friction", "a.csv", "b.csv", "-o", "f.yaml").status == 0
    document = read_document(inside / "f.yaml")
    assert document.fit.level is not None
    checked = here("check", "f.yaml", "a.csv").out
    simulated = here("simulate", "f.yaml", "a.csv", "-o", "s.csv").err
    for text in (checked, simulated):
        assert f"{document.fit.logs[0].fit_percent:.2f} %" in text


def test_what_is_said_of_several_parameters_is_said_once(
    capsys: pytest.CaptureFixture[str],
) -> None:
    rest = "cannot be determined from these data."
    echo_notices([Notice("not-identified", f"breakaway_{side} {rest}") for side in ("up", "down")])
    assert capsys.readouterr().err == (
        f"warning (not-identified): breakaway_up, breakaway_down {rest}\n"
    )


def test_numbers_that_come_first_are_no_names(capsys: pytest.CaptureFixture[str]) -> None:
    echo_notices([Notice("log-unused", f"{n} logs have no sample.") for n in (3, 5)])
    echo_notices([Notice("log-unused", "Unused.")])
    assert capsys.readouterr().err.splitlines() == [
        "note (log-unused): 3 logs have no sample.",
        "note (log-unused): 5 logs have no sample.",
        "note (log-unused): Unused.",
    ]


def test_notes_are_no_warnings_and_said_once(capsys: pytest.CaptureFixture[str]) -> None:
    said = [Notice("unit-assumed", f"{name}.csv: no unit was found.") for name in "abcde"]
    echo_notices([*said, Notice("poor-fit", "the model misses 1.5 of 2. Look at it.\nGive more.")])
    assert capsys.readouterr().err.splitlines() == [
        "warning (poor-fit): the model misses 1.5 of 2.",
        "  Look at it.",
        "  Give more.",
        "note (unit-assumed): a.csv, b.csv, c.csv and 2 more: no unit was found.",
    ]


def test_a_terminal_has_them_wrapped(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stderr.isatty", lambda: True, raising=False)
    monkeypatch.setenv("COLUMNS", "60")
    for colour in (True, False):
        monkeypatch.setenv("NO_COLOR", "" if colour else "1")
        echo_notices([Notice("poor-fit", "the model misses the output. " * 5)])
        text = capsys.readouterr().err
        assert ("\x1b[33m" in text) is colour
        lines = re.sub("\x1b\\[[0-9]+m", "", text).splitlines()
        assert len(lines) > 2
        assert max(map(len, lines)) < 60
        assert all(line.startswith("  ") for line in lines[1:])


@pytest.mark.parametrize(
    ("text", "ends"),
    [("1:5", (1.0, 5.0)), ("1:5min", (60.0, 300.0)), ("100:500ms", (0.1, 0.5)),
     ("1s:2min", (1.0, 120.0)), (":500 ms", (None, 0.5)), ("0.5:", (0.5, None))],
)  # fmt: skip
def test_a_unit_behind_a_window_is_that_of_both_ends(
    text: str, ends: tuple[float | None, float | None]
) -> None:
    assert parse_window(text) == pytest.approx(ends)
