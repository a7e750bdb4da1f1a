"""Results as tables: units of the log, width of the terminal, colour."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import fluidact_fit as ff
from fluidact_fit.parameters.document import Derived, Deviation, Parameter
from fluidact_fit.tables import Shown, Table
from fluidact_fit_cli.parameter_table import echo_parameters
from fluidact_fit_cli.show import echo_table, show

COLOUR = re.compile("\x1b\\[[0-9]+m")


GOLDEN = Path(__file__).parents[1] / "golden" / ff.__version__


def document(verdict: str = "pass") -> Any:
    """A parameter file of a valve with numbers by hand, as if its log had been in ms and bar."""
    read = ff.read_document(GOLDEN / "valve.yaml")
    log, *_ = read.provenance.logs
    units = {"time": "ms", "command": "V", "outlet": "bar"}
    columns = {role: log.columns[role].model_copy(update={"unit": u}) for role, u in units.items()}
    logs = [log.model_copy(update={"columns": columns})]
    gain = Parameter(value=1.5e5, unit="Pa/V", std_error=300.0, ci95=[149400.0, 150600.0],
                     status="estimated")  # fmt: skip
    inertia = Parameter(value=1.17e-6, unit="kg m2", std_error=2e-5, ci95=[-4e-5, 4e-5],
                        status="estimated")  # fmt: skip
    lost = Parameter(value=0.0, unit="s", status="not_identified")
    fit = read.fit.model_copy(update={
        "verdict": verdict, "fit_percent": 99.5, "samples": 300, "logs": [],
        "rmse": Deviation(value=2.2e5, unit="Pa"),
    })  # fmt: skip
    return read.model_copy(update={
        "parameters": {"gain": gain, "dead_time": lost, "inertia": inertia},
        "derived": {"rise_time": Derived(value=0.0123, unit="s", std_error=1e-4)},
        "fit": fit, "validation": [],
        "provenance": read.provenance.model_copy(update={"logs": logs}),
    })  # fmt: skip


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> Callable[[int], None]:
    """Makes standard output a terminal of so many columns."""

    def widen(columns: int) -> None:
        monkeypatch.setattr("sys.stdout.isatty", lambda: True, raising=False)
        monkeypatch.setenv("COLUMNS", str(columns))
        monkeypatch.setenv("TERM", "xterm")
        monkeypatch.delenv("NO_COLOR", raising=False)

    return widen


def test_values_stand_in_units_of_the_log_beside_si(capsys: pytest.CaptureFixture[str]) -> None:
    echo_parameters(document())
    lines = capsys.readouterr().out.splitlines()
    assert [re.split("  +", line) for line in lines[:5]] == [
        ["parameter", "value", "std error", "unit", "error %", "95 % interval", "in SI", "status"],
        ["gain", "1.5000", "± 0.0030", "bar/V", "0.2", "[1.4940, 1.5060]", "150000 Pa/V"],
        ["dead_time", "0", "s", "not identified"],
        ["inertia", "12", "± 200", "g cm2", "> 1000", "[-400, 400]", "1.2e-06 kg m2"],
        ["rise_time", "12.30", "± 0.10", "ms", "0.81", "0.01230 s", "derived"],
    ]
    assert lines[-1] == "verdict PASS   fit 99.50 %   rmse 2.2 bar   300 samples"


def test_python_shows_the_table_of_the_command_line(capsys: pytest.CaptureFixture[str]) -> None:
    shown = ff.load(GOLDEN / "valve.yaml", accept_failed=True)
    shown.document = document()
    echo_parameters(shown.document)
    printed = capsys.readouterr().out
    assert repr(shown.table(derived=True)) in printed
    assert "rmse 2.2 bar" in shown.summary()


@pytest.mark.parametrize("columns", [45, 60, 80, 120])
def test_no_line_is_longer_than_the_terminal(
    columns: int, terminal: Callable[[int], None], capsys: pytest.CaptureFixture[str]
) -> None:
    terminal(columns)
    echo_parameters(document())
    text = COLOUR.sub("", capsys.readouterr().out)
    assert max(map(len, text.splitlines()[:-1])) < columns  # the verdict is one line
    assert "± 0.0030" in text
    assert ("[1.4940, 1.5060]" in text) == (columns >= 80)
    assert ("A wider terminal also shows" in text) == (columns < 120)


def test_what_fits_nowhere_becomes_blocks(
    terminal: Callable[[int], None], capsys: pytest.CaptureFixture[str]
) -> None:
    terminal(42)
    echo_table([["log", "finding"], ["a.csv", "one thing and another " * 3], ["b.csv", ""]])
    assert capsys.readouterr().out.splitlines() == [
        "a.csv",
        "  finding  one thing and another one",
        "           thing and another one thing",
        "           and another",
        "b.csv",
    ]


@pytest.mark.parametrize(
    ("setting", "value"), [("TERM", "xterm"), ("TERM", "dumb"), ("NO_COLOR", "1")]
)
def test_verdict_and_what_is_not_identified_have_a_colour(
    setting: str, value: str, terminal: Callable[[int], None], monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    terminal(120)
    monkeypatch.setenv(setting, value)
    echo_parameters(document("warn"))
    text = capsys.readouterr().out
    coloured = re.findall("\x1b\\[33m\x1b\\[1m(.*?)\x1b", text)
    assert coloured == (["not identified", "WARN"] if value == "xterm" else [])
    assert ("\x1b" in text) == (value == "xterm")


def test_a_pipe_has_every_column_and_no_colour(
    apart: Callable[..., Any], valve: Any, inside: Path
) -> None:
    done = apart("valve", valve(), cwd=inside)
    heading, *_ = done.out.splitlines()
    assert "95 % interval" in heading
    assert "\x1b" not in done.out + done.err
    assert "\r" not in done.err


def test_empty_parts_of_a_result_leave_no_lines(capsys: pytest.CaptureFixture[str]) -> None:
    """As in Python, where they are left out of the text."""

    class Result(Shown):
        def parts(self) -> list[Table | str]:
            return ["first", Table(("a", "b"), ()), "last", ""]

    show(Result())
    assert capsys.readouterr().out == "first\n\nlast\n" == f"{Result()}\n"
