"""Running a batch: what is left to do, how far it is, what came of it."""

from __future__ import annotations

import hashlib
import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from ..errors import OutputError
from ..files import open_regular, shell_command
from ..version import __version__
from .jobs import Job
from .journal import NAME, Journal, open_journal, own_files
from .outcome import JobResult, Task, refused, write_record
from .pools import Execute, Pool
from .targets import RECORDS, SUMMARY, Asked, AskedBy, find_tasks, named_files

_DAMAGED = (
    "{number} of {lines} lines of {path} cannot be read and {were} left out: jobs that only they "
    "knew run again. A parameter file that no other line names is taken for somebody else's and "
    "kept: move it away if it is not, or give --force."
)
_CHANGED = "{files} not what this batch wrote (first {first}): {jobs} again."


def run_batch(
    jobs: Sequence[Job],
    base: Path,
    folder: Path,
    execute: Execute,
    pool: Pool,
    *,
    source: Path | None = None,
    asked_by: AskedBy = lambda job: Asked(),
    again: bool = False,
    progress: Callable[[str], None] = lambda text: None,
    warn: Callable[[str], None] = lambda text: None,
) -> list[JobResult]:
    """Run the jobs that are not finished, and return the outcomes of all, in their order.

    A finished job whose logs, options and version of the program are the same as before is not
    run again, unless a file of it is gone or is not the one that it wrote.

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
    source
        The list of jobs, where it is a file.
    asked_by
        What the options of a job say of files.
    again
        Run finished jobs too, and replace files that no earlier run wrote.
    progress
        Told how far it is.
    warn
        Told in words when lines of the journal cannot be read, or files have changed.

    Raises
    ------
    UsageError
        When a file that the batch writes is read by one of its jobs.
    OutputError
        When the folder cannot be written, or another batch is running there.
    """
    # unlike Path.resolve, a loop of links is left to be refused where it is written
    base, folder = Path(os.path.realpath(base)), Path(os.path.realpath(folder))
    progress("looking at what is done")
    own = own_files(folder)
    logs = [job.found_logs(base, own) for job in jobs]
    found = find_tasks(jobs, logs, base, folder, source, asked_by)
    _make_folder(folder)
    with open_journal(folder) as journal:
        if journal.damaged:
            were = "was" if journal.damaged == 1 else "were"
            warn(_DAMAGED.format(
                number=journal.damaged, lines=journal.lines, path=folder / NAME, were=were,
            ))  # fmt: skip
        tasks = [
            replace(task, key=_fingerprint(job, paths, base, asked_by(job)))
            for job, paths, task in zip(jobs, logs, found)
        ]
        work = _Work(folder, journal, {task.job: task for task in tasks}, again)
        left = [t for t in tasks if again or not work.is_finished(t)]
        if work.changed:
            warn(_CHANGED.format(
                files=f"{len(work.changed)} files are" if len(work.changed) > 1 else "1 file is",
                first=work.changed[0], jobs="their jobs run" if len(work.changed) > 1 else
                "its job runs",
            ))  # fmt: skip
        left = work.claim(left)
        clock = _Clock(len(left), len(jobs) - len(left))
        for outcome in pool.run(execute, left):
            work.add(outcome)
            progress(clock.after(outcome))
        return [journal.outcomes[task.job] for task in tasks]


class _Work:
    """The files of a batch and its journal, which know of each other."""

    def __init__(
        self, folder: Path, journal: Journal, tasks: Mapping[str, Task], again: bool
    ) -> None:
        self.folder, self.journal, self.tasks, self.again = folder, journal, tasks, again
        self.changed: list[str] = []

    def is_finished(self, task: Task) -> bool:
        """Return whether a job has ended for good, and its files are those that it wrote."""
        before = self.journal.outcomes.get(task.job)
        if before is None or before.key != task.key or not before.lasting:
            return False
        if before.exit:
            return True
        now = self._checksums(task.job)
        wrote = {name: before.files.get(name) for name in now}
        changed = [name for name, checksum in now.items() if checksum and checksum != wrote[name]]
        self.changed += changed
        return now == wrote

    def claim(self, left: Sequence[Task]) -> list[Task]:
        """Name the files of jobs as the batch's own; jobs that may not run have an outcome.

        A job whose parameter file is somebody else's runs, and its command refuses to replace it.
        """
        allowed: list[Task] = []
        files = [str(self.folder / name) for name in SUMMARY] if left else []
        for task in left:
            why, remedy = task.refusal, "Correct the options of the job."
            taken = [] if self.again or task.replace_any else self._taken(task)
            if not why and taken and taken != [task.output]:
                why = f"{taken[-1]} already exists; not overwritten."
                remedy = "Give batch --force to replace it, or move it away."
            if why:
                self._refuse(task, refused(task, why, remedy))
            else:
                allowed.append(replace(task, replace=not taken))
                files += (path for path in task.files if path not in taken)
        self.journal.claim(map(self._name, files))
        return allowed

    def add(self, outcome: JobResult) -> None:
        """Note what came of a job, and what it wrote."""
        found = self._checksums(outcome.job) if outcome.exit == 0 else {}
        files = {name: checksum for name, checksum in found.items() if checksum}
        files[self._name(self.tasks[outcome.job].record)] = ""  # its own, whatever stands in it
        self.journal.add(replace(outcome, files=files))

    def _taken(self, task: Task) -> list[str]:
        """Files that are there and are not the batch's own."""
        there = (path for path in task.files if os.path.lexists(path))
        return [path for path in there if self._name(path) not in self.journal.claimed]

    def _refuse(self, task: Task, outcome: JobResult) -> None:
        record = self._name(task.record)
        if not os.path.lexists(task.record) or record in self.journal.claimed:
            self.journal.claim([record])
            write_record(task, shell_command(["fluidact-fit", *task.words]), "", outcome)
        self.journal.add(outcome)

    def _checksums(self, job: str) -> dict[str, str]:
        """Checksums of the files of a job that was fitted, empty for one that is not there."""
        task = self.tasks[job]
        return {self._name(p): _content(p).hex() for p in (task.output, *task.pictures)}

    def _name(self, path: str) -> str:
        try:
            return os.path.relpath(path, self.folder).replace(os.sep, "/")
        except ValueError:  # on another drive
            return path


def _make_folder(folder: Path) -> None:
    try:
        (folder / RECORDS).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"cannot be made: {error.strerror}.", where=str(folder),
                          remedy="Give another folder with -o.") from error  # fmt: skip


def _fingerprint(job: Job, logs: Sequence[str], base: Path, asked: Asked) -> str:
    """Hash of all that decides the outcome: version, words, and the content of every file read."""
    whole = hashlib.sha256(__version__.encode())
    for word in (job.family, *logs, *job.options):
        whole.update(b"\0" + word.encode("utf-8", "surrogateescape"))
    for path in logs:
        for name in dict.fromkeys((path, *path.split("+"))):
            whole.update(_content(base / name))
    for name in named_files(job.options, asked, base):
        whole.update(_content(base / name))
    return whole.hexdigest()[:32]


def _content(path: str | Path) -> bytes:
    try:
        with open_regular(path) as file:
            return hashlib.file_digest(file, "sha256").digest()
    except (OSError, ValueError):
        return b""


class _Clock:
    """Progress of a batch, and when it will be done."""

    def __init__(self, left: int, before: int) -> None:
        self.left, self.done, self.before = left, 0, before
        self.failed = 0
        self.begun = time.monotonic()

    def after(self, outcome: JobResult) -> str:
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
