"""The program itself, run within this process, and what its end says."""

from __future__ import annotations

import contextlib
import io
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from fluidact_fit.demo import find_datasets
from fluidact_fit.parameters import read_yaml

from .case import EXIT_1, LONGEST, TRACEBACK, WRONG, Result

_GOLDEN = Path(__file__).parents[2] / "tests" / "golden" / "0.1.0"
DOCUMENTED = (0, 2, 3, 4)
_FAULT = re.compile(r"This is a bug in fluidact-fit[^:]*: ([^\n]*?)\. Nothing was")
# What moves a terminal's cursor or changes its colours; line ends and tabs do not.
_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]")


@dataclass(frozen=True)
class Ended:
    """How a run ended."""

    status: int
    out: str
    err: str


def run(args: Sequence[str]) -> Ended:
    """Run the program here, with what follows its name."""
    from fluidact_fit_cli.main import run as run_program

    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = run_program(list(args))
    return Ended(status, out.getvalue(), err.getvalue())


def judge(ended: Ended, result: Result, allowed: Sequence[int] = DOCUMENTED) -> None:
    """Add what is wrong with the end of a run, whatever it was asked."""
    text = ended.out + ended.err
    if "Traceback (most recent" in text:
        result.fail(TRACEBACK, text[text.index("Traceback") :].strip().splitlines()[-1])
    if ended.status == 1:
        said = _FAULT.search(text)
        result.fail(EXIT_1, said[1] if said else (text.strip() or "nothing was said")[-300:])
    elif ended.status not in allowed:
        result.fail(WRONG, f"exit status {ended.status}")
    elif ended.status != 0 and not ended.err.strip():
        result.fail(WRONG, f"exit status {ended.status} without a word")
    if len(ended.err) > LONGEST:
        result.fail(WRONG, f"message of {len(ended.err)} characters")
    if found := _CONTROL.search(text):
        result.fail(WRONG, f"control character in what is printed: {found[0]!r}")


@cache
def arguments(family: str) -> tuple[str, ...]:
    """The options with which a log of a family's dataset is fitted."""
    return tuple(_facts(family)["arguments"])


@cache
def columns(family: str) -> dict[str, str]:
    """Headers of a family's dataset by role."""
    return dict(_facts(family)["columns"])


@cache
def _facts(family: str) -> dict[str, list[str]]:
    return read_yaml(find_datasets() / family / "truth.yaml").data


def write_log(family: str, path: Path, rows: int) -> None:
    """Write the first rows of the first log of a family's dataset."""
    lines = (find_datasets() / family / "trial1.csv").read_text(encoding="utf-8").splitlines()
    path.write_text("\n".join(lines[: rows + 1]) + "\n", encoding="utf-8")


@cache
def golden() -> dict[str, str]:
    """Text of a parameter file of every family, as version 0.1.0 wrote it."""
    return {path.stem: path.read_text(encoding="utf-8") for path in sorted(_GOLDEN.glob("*.yaml"))}
