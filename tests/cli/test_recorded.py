"""The command in a parameter file: run again it gives the same file, and it keeps a secret."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

Log = Callable[..., Path]
Run = Callable[..., Any]
pytestmark = pytest.mark.skipif(shutil.which("bash") is None, reason="needs a shell")


def _document(path: Path) -> dict[str, Any]:
    document = yaml.safe_load(path.read_text(encoding="utf-8"))
    document["provenance"].pop("created")
    return document


def _again(command: str, folder: Path) -> None:
    program = f"fluidact-fit() {{ '{sys.executable}' -m fluidact_fit_cli.main \"$@\"; }}\n"
    text = (program + command).encode("utf-8")
    done = subprocess.run(["bash"], input=text, cwd=folder, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr


NAMES = (
    "a log.csv", "it's.csv", 'say "x".csv', "$HOME.csv", "`id`.csv", "a;b&c.csv", "-lead.csv",
    "--scale=outlet=-3", "a\nb.csv", "tab\there.csv", "ünïcode.csv", "back\\slash.csv", "!x.csv",
    "*.csv", "a=b.csv", "~.csv", "-", b"raw\xff\xfe'.csv", "\u202egpj.csv", "x'\\''y.csv",
)  # fmt: skip


@pytest.mark.parametrize(
    ("name", "how"),
    [*((name, "absolute") for name in NAMES), *((n, "plain") for n in ("-lead.csv", "a\nb.csv"))],
)
def test_a_recorded_command_runs_again(
    name: str | bytes, how: str, inside: Path, valve: Log, apart: Run
) -> None:
    text = os.fsdecode(name)
    valve("plain.csv").rename(inside / text)
    log = text if how == "plain" else str(inside / text)
    before = ["--"] if text.startswith("-") and how == "plain" else []
    if text == "-":
        log, before = str(inside / "-"), []
    done = apart("valve", "-o", str(inside / "v.yaml"), *before, log, cwd=inside)
    assert done.status == 0, done.err
    first = _document(inside / "v.yaml")
    assert str(inside) not in str(first)
    (inside / "v.yaml").unlink()
    _again(first["provenance"]["command"], inside)
    assert _document(inside / "v.yaml") == first


@pytest.mark.parametrize(("words", "command"), [
    ("{here}/a.csv -o {here}/out/v.yaml", "a.csv -o v.yaml"),
    ("{here}/sub/b.csv --validate={here}/a.csv", "sub/b.csv --validate=a.csv"),
    ("{there}/a.csv", "a.csv"),
    ("{there}/u/c.csv {there}/w/c.csv", "u/c.csv w/c.csv"),
    ("{there}/p.csv+{there}/u/q.csv", "p.csv+u/q.csv"),
    ("{here}/p.csv+{here}/q.csv", "p.csv+q.csv"),
    ("../elsewhere/a.csv", "../elsewhere/a.csv"),
    ("/home/bob/x/a.csv ../../home/ann/b.csv", "a.csv b.csv"),
    ("/home/bob/x/a.csv /home/bob/y/a.csv", "x/a.csv y/a.csv"),
    ("a.csv --set /home/bob/a.csv:zero=3", "a.csv --set a.csv:zero=3"),
    ("a.csv --column outlet=/motor/speed", "a.csv --column outlet=/motor/speed"),
    ("a.csv -o/home/bob/-x.yaml", "a.csv -o./-x.yaml"),
    ("/Users/bob/a.csv --plot /Users/bob/p.png", "a.csv --plot p.png"),
    ("{home}/logs/a.csv", "a.csv"),
])  # fmt: skip
def test_folders_that_are_nobodys_business(
    words: str, command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from fluidact_fit_cli.commands.fit_family import make_command
    from fluidact_fit_cli.recorded import recorded_command

    here, there, home = tmp_path / "here", tmp_path / "there", tmp_path / "cosy"
    for folder in (here, there, home):
        folder.mkdir()
    monkeypatch.chdir(here)
    monkeypatch.setenv("HOME", str(home))
    args = words.format(here=here, there=there, home=home).split()
    params = make_command("valve").make_context("valve", list(args)).params
    found = recorded_command(["valve", *args], params)
    assert found == f"fluidact-fit valve {command}"
