"""What shells offer behind a half-written command."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from fluidact_fit_cli.completion import SCRIPTS, VARIABLE

Run = Callable[..., Any]


@pytest.fixture
def offered(
    here: Run, inside: Path, monkeypatch: pytest.MonkeyPatch
) -> Callable[[str, str], list[str]]:
    """Values that a shell is offered at the end of a line."""
    inside.joinpath("a.csv").write_text("t [s],it's p (bar),q\n0,1,1\n1,2,2\n2,3,3\n")

    def ask(line: str, shell: str = "zsh") -> list[str]:
        monkeypatch.setenv("COMP_LINE", line)
        monkeypatch.setenv(VARIABLE, shell)
        done = here()
        assert (done.status, done.err) == (0, "")
        return [line.partition("\t")[0] for line in done.out.splitlines()]

    return ask


@pytest.mark.parametrize(("line", "values"), [
    ("fluidact-fit hydr", ["hydrostatic", "hydraulic-cylinder", "hydraulic-motor"]),
    ("fluidact-fit line --val", ["--validate", "--validate-window"]),
    ("fluidact-fit line a.csv --column in", ["inlet="]),
    ("fluidact-fit line a.csv --column inlet=q", ["inlet=q"]),
    ("fluidact-fit line a.csv --column=inlet=q", ["--column=inlet=q"]),
    ("fluidact-fit line a.csv --column 'inlet=it'\"'\"'s", ["inlet=it's p"]),
    ("fluidact-fit line a.csv --hold inlet=s", ["inlet=smooth"]),
    ("fluidact-fit line a.csv --fix dead", ["dead_time="]),
    ("fluidact-fit inspect a.csv --family back", ["backlash"]),
    ("fluidact-fit line no.csv --column inlet=", []),
    ("fluidact-fit line a", []),  # files are the shell's own business
])  # fmt: skip
def test_words(offered: Callable[..., list[str]], line: str, values: list[str]) -> None:
    assert sorted(offered(line)) == sorted(values)


@pytest.mark.parametrize(("shell", "line", "values"), [
    ("bash", "--column inlet=", ["t", "'it'\"'\"'s p'", "q"]),
    ("bash", "--column inlet='it", ["it's p"]),  # bash itself closes the quote
    ("bash", '--column inlet="it', ["it's p"]),
    ("bash", '--column "inlet=it', ["inlet=it's p"]),
    ("fish", "--column inlet=it", ["inlet=it's p"]),
    ("powershell", "--column inlet=", ["inlet=t", "'inlet=it''s p'", "inlet=q"]),
])  # fmt: skip
def test_values_are_quoted_as_the_shell_has_it(
    offered: Callable[..., list[str]], shell: str, line: str, values: list[str]
) -> None:
    assert offered(f"fluidact-fit line a.csv {line}", shell) == values


@pytest.mark.skipif(shutil.which("bash") is None, reason="bash")
def test_bash_takes_the_script(here: Run, inside: Path) -> None:
    script = here("completion", "bash").out
    program = inside / "fluidact-fit"
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m fluidact_fit_cli.main "$@"\n')
    program.chmod(0o755)
    asked = 'COMP_LINE="fluidact-fit bac extra"; COMP_POINT=16; _fluidact_fit ./fluidact-fit'
    done = subprocess.run(
        ["bash", "-c", f'{script}\n{asked}\nprintf "%s|" "${{COMPREPLY[@]}}"'], cwd=inside,
        capture_output=True, text=True, check=False, timeout=60,
        env={k: v for k, v in os.environ.items() if k != VARIABLE},
    )  # fmt: skip
    assert (done.stdout, done.stderr) == ("backlash|", "")


@pytest.mark.parametrize("shell", SCRIPTS)
def test_every_shell_has_a_script(here: Run, shell: str) -> None:
    done = here("completion", shell)
    assert (done.status, done.err) == (0, "")
    assert "fluidact-fit" in done.out
    assert VARIABLE in done.out
