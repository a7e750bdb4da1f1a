"""Every command's help, and a run of most, on terminals of several widths and in a pipe."""

from __future__ import annotations

import errno
import os
import pty
import re
import struct
import subprocess
import sys
import termios
from collections.abc import Callable
from fcntl import ioctl
from pathlib import Path
from typing import Any

import click
import pytest

import fluidact_fit as ff
from fluidact_fit_cli.help_width import fit_line
from fluidact_fit_cli.program import program

Run = Callable[..., Any]
COMMANDS = program.list_commands(click.Context(program))
ESCAPE = re.compile("\x1b\\[[0-9;?]*[A-Za-z]")
DATA = Path(__file__).parents[2] / "datasets/valve"
GOLDEN = Path(__file__).parents[1] / "golden" / ff.__version__ / "valve.yaml"
COLUMNS = ["--column", "time=#1", "--column", "command=#2", "--column", "outlet=#3"]
RUNS = {
    "fit": ["valve", DATA / "trial1.csv", *COLUMNS, "-o", "fit.yaml", "-f"],
    "check": ["check", "known.yaml", DATA / "trial2.csv", *COLUMNS],
    "compare": ["compare", "known.yaml", "known.yaml"],
    "compare logs": ["compare", DATA / "trial1.csv", DATA / "trial2.csv"],
    "export": ["export", "known.yaml", "--to", "json", "-f"],
    "report": ["report", "known.yaml", "-f"],
    "wrong": ["vavle", "log.csv"],
}


def read(terminal: int) -> bytes:
    """What was written to a terminal next; empty when the last writer has left it."""
    try:
        return os.read(terminal, 65536)
    except OSError as error:
        if error.errno == errno.EIO:
            return b""
        raise


def on_terminal(words: list[Any], columns: int, cwd: Path, **extra: str) -> str:
    """Output and errors of a run whose streams are a terminal of so many columns."""
    master, slave = pty.openpty()
    ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 50, columns, 0, 0))
    environment = {k: v for k, v in os.environ.items() if k not in ("COLUMNS", "NO_COLOR")}
    command = [sys.executable, "-m", "fluidact_fit_cli.main", *map(str, words)]
    with subprocess.Popen(command, stdin=slave, stdout=slave, stderr=slave, cwd=cwd,
                          env={**environment, "TERM": "xterm", **extra}) as process:  # fmt: skip
        os.close(slave)
        text = b"".join(iter(lambda: read(master), b""))
        process.wait(timeout=60)
    os.close(master)
    return text.decode()


def widest(text: str) -> str:
    """The widest line that stays on a screen, but for commands to copy and single words."""
    lines = [
        ESCAPE.sub("", line).split("\r")[-1] for line in text.replace("\r\n", "\n").split("\n")
    ]
    kept = [x for x in lines if not x.lstrip().startswith("fluidact-fit ") and " " in x.strip()]
    return max(kept, key=len, default="")


@pytest.mark.parametrize("columns", [60, 80, 120])
@pytest.mark.parametrize("name", ["", *COMMANDS])
def test_help_is_no_wider_than_the_terminal(
    name: str, columns: int, here: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", str(columns))
    done = here(*filter(None, [name]), "--help-all")
    assert done.status == 0
    line = widest(done.out)
    assert len(line) <= columns, line
    assert "\x1b" not in done.out


@pytest.mark.parametrize("name", RUNS)
def test_a_run_is_no_wider_than_the_terminal_and_plain_without_colour(
    name: str, tmp_path: Path
) -> None:
    (tmp_path / "known.yaml").write_text(GOLDEN.read_text(encoding="utf-8"), encoding="utf-8")
    words = RUNS[name]
    for columns in (60, 120):
        line = widest(on_terminal(words, columns, tmp_path))
        assert len(line) <= columns, line
    plain = on_terminal(words, 80, tmp_path, NO_COLOR="1")
    assert "\x1b[3" not in plain
    piped = subprocess.run(
        [sys.executable, "-m", "fluidact_fit_cli.main", *map(str, words)], cwd=tmp_path,
        capture_output=True, check=False,
    )  # fmt: skip
    assert b"\x1b" not in piped.stdout + piped.stderr
    assert b"\r" not in piped.stdout + piped.stderr


def test_a_command_of_the_help_continues_behind_a_backslash() -> None:
    line = "  fluidact-fit line a.csv b.csv --unit inlet=bar --unit outlet=bar -o line.yaml"
    parts = fit_line(line, 40)
    assert len(parts) > 1
    assert all(len(part) <= 40 for part in parts)
    assert " ".join(part.removesuffix("\\").strip() for part in parts) == line.strip()


def test_an_option_of_a_command_stays_beside_its_value() -> None:
    line = (
        "    fluidact-fit design ball-screw --from drive.yaml --amplitude -0.006:0.006 --strict -v"
    )
    for width in range(40, 90):
        words = [part.removesuffix(" \\").split() for part in fit_line(line, width)]
        assert not any(part[-1] in ("--from", "--amplitude") for part in words)
        assert [word for part in words for word in part] == line.split()


def test_the_second_column_of_a_help_stays_a_column() -> None:
    first, second = fit_line("c       NAME.h, NAME.c: what a controller calls; and more", 40)
    assert first.startswith("c       NAME.h")
    assert second.startswith(" " * 8)
    assert second[8] != " "
