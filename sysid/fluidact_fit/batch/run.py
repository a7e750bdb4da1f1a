"""Running a batch: what is left to do, how far it is, what came of it."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from ..errors import OutputError
from ..version import __version__
from .jobs import Job
from .journal import NAME, Journal, open_journal
from .outcome import Outcome, Task
from .pools import Execute, Pool

RECORDS = "logs"  # folder of what every job said


_DAMAGED = (
    "{number} of {lines} lines of {path} cannot be read and {were} left out: jobs that only they "
    "knew run again. A parameter file that no other line names is taken for somebody else's and "
    "kept: move it away if it is not."
)


def run_batch(
    jobs: Sequence[Job],
    base: Path,
    folder: Path,
    execute: Execute,
    pool: Pool,
    *,
    again: bool = False,
    progress: Callable[[str], None] = lambda text: None,
    warn: Callable[[str], None] = lambda text: None,
) -> list[Outcome]:
    """Run the jobs that are not finished, and return the outcomes of all, in their order.

    A finished job whose logs, options and version of the program are the same as before is not
    run again, unless its parameter file is gone.

    Parameters
    ----------
    jobs
        See :func:`.read_jobs`.
    base
        Folder from which logs and options are seen.
    folder
        Receives parameter files, journal and records; made when it does not exist.
    execute
        Runs one command line.
    pool
        Where.
    again
        Run finished jobs too.
    warn
        Told in words when lines of the journal cannot be read.

    Raises
    ------
    OutputError
        When the folder cannot be written, or another batch is running there.
    """
    base, folder = base.resolve(), folder.resolve()
    try:
        (folder / RECORDS).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"cannot be made: {error.strerror}.", where=str(folder),
                          remedy="Give another folder with -o.") from error  # fmt: skip
    with open_journal(folder) as journal:
        if journal.damaged:
            were = "was" if journal.damaged == 1 else "were"
            warn(_DAMAGED.format(
                number=journal.damaged, lines=journal.lines, path=folder / NAME, were=were,
            ))  # fmt: skip
        progress("looking at what is done")
        tasks = [_task(job, base, folder) for job in jobs]
        left = [t for t in tasks if again or not _finished(t, journal)]
        journal.claim(t.job for t in left if again or not Path(t.output).exists())
        left = [replace(t, replace=t.job in journal.claimed) for t in left]
        clock = _Clock(len(left), len(jobs) - len(left))
        for outcome in pool.run(execute, left):
            journal.add(outcome)
            progress(clock.after(outcome))
        return [journal.outcomes[task.job] for task in tasks]


def _task(job: Job, base: Path, folder: Path) -> Task:
    logs = job.found_logs(base)
    output = folder / f"{job.name}.yaml"
    return Task(
        job.name, _fingerprint(job, logs, base), (job.family, *logs, *job.options), str(base),
        str(output), str(folder / RECORDS / f"{job.name}.txt"),
    )  # fmt: skip


def _finished(task: Task, journal: Journal) -> bool:
    before = journal.outcomes.get(task.job)
    if before is None or before.key != task.key or not before.lasting:
        return False
    return before.exit != 0 or Path(task.output).is_file()


def _fingerprint(job: Job, logs: Sequence[str], base: Path) -> str:
    """Hash of all that decides the outcome: version, words, and the content of every file named."""
    whole = hashlib.sha256(__version__.encode())
    for word in (job.family, *logs, *job.options):
        whole.update(b"\0" + word.encode("utf-8", "surrogateescape"))
        # a log may be two that are merged; an option may name a file, or be NAME=FILE
        for name in dict.fromkeys((word, *word.split("+"), word.rpartition("=")[2])):
            whole.update(_content(base / name))
    return whole.hexdigest()[:32]


def _content(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").digest()
    except (OSError, ValueError):
        return b""


class _Clock:
    """How far a batch is, and when it will be done."""

    def __init__(self, left: int, before: int) -> None:
        self.left, self.done, self.before = left, 0, before
        self.failed = 0
        self.begun = time.monotonic()

    def after(self, outcome: Outcome) -> str:
        """Text for people, after one more job has ended."""
        self.done += 1
        self.failed += outcome.exit != 0
        remaining = (time.monotonic() - self.begun) / self.done * (self.left - self.done)
        text = f"{self.before + self.done} of {self.before + self.left} jobs"
        if self.failed:
            text += f", {self.failed} not fitted"
        return f"{text}, {_duration(remaining)} left"


def _duration(seconds: float) -> str:
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    if seconds < 5400.0:
        return f"{seconds / 60.0:.0f} min"
    return f"{seconds / 3600.0:.1f} h"
