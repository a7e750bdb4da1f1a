"""One command line of a batch, run inside a process that runs many."""

from __future__ import annotations

import contextlib
import io
import json
import shlex
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from fluidact_fit.batch.outcome import Outcome, Task
from fluidact_fit.errors import FluidactError, OutputError, UsageError
from fluidact_fit.families import family_names

from ..errors import Invocation, explain, silenced
from ..show import echo_parameters
from .fit import make_command

# A thread of a worker with several waits: folder and standard streams are those of a process.
_ALONE = threading.Lock()
_OURS = ("-o", "--output", "--json", "-h", "--help")


def execute(task: Task) -> Outcome:
    """Run a fit as if it had been typed in the folder of the jobs; never raises.

    Standard error is kept in the record of the job.
    """
    began = time.process_time()
    said, shown = io.StringIO(), io.StringIO()
    with _ALONE, contextlib.redirect_stdout(shown), contextlib.redirect_stderr(said):
        error = _run(task)
    message, status = ("", 0) if error is None else explain(error)
    document = json.loads(shown.getvalue()) if error is None else {}
    outcome = Outcome(
        task.job, task.key, status,
        verdict=document.get("fit", {}).get("verdict", ""),
        message=message,
        reason=error.what if isinstance(error, FluidactError) else message,
        warnings=[w["code"] for w in document.get("warnings", ())],
        parameters={name: _number(entry) for name, entry in document.get("parameters", {}).items()},
        seconds=round(time.process_time() - began, 3),
        lasting=status != 2 and not isinstance(error, (OutputError, OSError, MemoryError)),
    )  # fmt: skip
    return _keep(task, outcome, said.getvalue() + _table(document))


def _run(task: Task) -> BaseException | None:
    family, *words = task.words
    words += ["-o", task.output]
    invocation = Invocation((family, *words))
    words += ["--json", *(["--force"] if task.replace else [])]
    try:
        _check(family, task.words)
        with contextlib.chdir(task.folder), silenced(invocation):
            make_command(family).main(
                words, prog_name=f"fluidact-fit {family}", standalone_mode=False, obj=invocation
            )
    except (Exception, SystemExit) as error:
        return error
    return None


def _check(family: str, words: Sequence[str]) -> None:
    if family not in family_names():
        raise UsageError(f"there is no family {family!r}.",
                         expected=f"Families: {', '.join(family_names())}.",
                         remedy="Correct the name in the list of jobs.")  # fmt: skip
    for word in words:
        if word.partition("=")[0] in _OURS or word.startswith("-o"):
            raise UsageError(f"{word} has no place among the options of a job.",
                             remedy="Leave it out: the batch names the files.")  # fmt: skip


def _number(entry: dict[str, Any]) -> dict[str, Any]:
    kept = ("value", "std_error", "unit", "status")
    return {key: entry[key] for key in kept if key in entry}


def _table(document: dict[str, Any]) -> str:
    """What the fit would have shown on standard output."""
    if not document:
        return ""
    shown = io.StringIO()
    with contextlib.redirect_stdout(shown):
        echo_parameters(document)
    return shown.getvalue()


def _keep(task: Task, outcome: Outcome, said: str) -> Outcome:
    """Write the record of a job; what cannot be written is told in the outcome."""
    command = shlex.join(["fluidact-fit", *task.words])
    parts = [f"$ {command}", said.strip(), outcome.message, f"exit status {outcome.exit}, "
             f"{outcome.status}"]  # fmt: skip
    try:
        Path(task.record).write_text("\n".join(p for p in parts if p) + "\n", encoding="utf-8")
    except OSError as error:
        message, status = explain(error)
        return Outcome(task.job, task.key, status, message=message, reason=message, lasting=False)
    return outcome
