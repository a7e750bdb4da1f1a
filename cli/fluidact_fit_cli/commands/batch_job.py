"""One command line of a batch, run inside a process that runs many."""

from __future__ import annotations

import contextlib
import io
import json
import re
import threading
import time
from collections.abc import Sequence
from functools import lru_cache
from typing import Any, cast

from fluidact_fit.batch.jobs import Job
from fluidact_fit.batch.outcome import JobResult, Number, Task, write_record
from fluidact_fit.batch.targets import Asked
from fluidact_fit.errors import FluidactError, OutputError, UsageError
from fluidact_fit.families import get_family
from fluidact_fit.files import shell_command
from fluidact_fit.parameters import make_document

from ..errors import Invocation, explain, silenced
from ..parameter_table import echo_parameters
from .fit_family import make_command, targets_of

# A thread of a worker with several waits: folder and standard streams are those of a process.
_ALONE = threading.Lock()
_OURS = ("--output", "--json", "--help", "--help-all", "--")
_SHORT = re.compile("-[fqv]*[oh]")  # -o or -h, behind others as in -qo as well


def asked_by(job: Job) -> Asked:
    """Files that the options of a job name; none if they cannot be read."""
    return _asked(job.family, job.options)


@lru_cache(maxsize=1024)  # most jobs of a batch have the same
def _asked(family: str, words: tuple[str, ...]) -> Asked:
    try:
        _check(family, words)
        context = make_command(family).make_context(family, ["log", *words])
    except (Exception, SystemExit):  # the job itself will say what is wrong
        return Asked()
    return Asked(targets_of(family, {**context.params, "as_json": True}), context.params["force"])


def execute(task: Task) -> JobResult:
    """Run a fit as if it had been typed in the folder of the jobs; never raises.

    Standard error is kept in the record of the job.
    """
    began = time.process_time()
    said, shown = io.StringIO(), io.StringIO()
    with _ALONE, contextlib.redirect_stdout(shown), contextlib.redirect_stderr(said):
        error = _run(task)
    message, status = ("", 0) if error is None else explain(error)
    document = json.loads(shown.getvalue()) if error is None else {}
    outcome = JobResult(
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
    invocation = Invocation((family, *words), is_job=True)
    words += ["--json", *(["--force"] if task.replace else [])]
    try:
        _check(family, task.words)
        command, name = make_command(family), f"fluidact-fit {family}"
        with (
            contextlib.chdir(task.folder),
            silenced(invocation),
            command.make_context(name, words, obj=invocation) as context,
        ):
            if context.params["output"] != task.output:
                raise UsageError(
                    f"the last of the options, {task.words[-1]}, lacks its value.",
                    remedy="Complete the options of the job.",
                )
            command.invoke(context)
    except (Exception, SystemExit) as error:
        return error
    return None


def _check(family: str, words: Sequence[str]) -> None:
    get_family(family)
    for word in words:
        if word.partition("=")[0] in _OURS or _SHORT.match(word):
            raise UsageError(
                f"{word} is not allowed in a job.",
                remedy="Leave it out: the batch names logs and files.",
            )


def _number(entry: dict[str, Any]) -> Number:
    kept = ("value", "std_error", "unit", "status")
    return cast("Number", {key: entry[key] for key in kept if key in entry})


def _table(document: dict[str, Any]) -> str:
    """Table that the fit would have shown on standard output."""
    if not document:
        return ""
    shown = io.StringIO()
    with contextlib.redirect_stdout(shown):
        echo_parameters(make_document(document, get_family))
    return shown.getvalue()


def _keep(task: Task, outcome: JobResult, said: str) -> JobResult:
    """Write the record of a job; what cannot be written is told in the outcome."""
    try:
        write_record(task, shell_command(["fluidact-fit", *task.words]), said, outcome)
    except (OutputError, OSError) as error:
        message, status = explain(error)
        return JobResult(task.job, task.key, status, message=message, reason=message, lasting=False)
    return outcome
