"""The files of a batch: what its jobs read and write, and which of them must not run."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ..errors import UsageError
from ..files import IRREGULAR, FileSet, is_irregular
from .jobs import Job
from .journal import NAME
from .outcome import Task

RECORDS = "logs"  # folder of what every job said
SUMMARY = ("summary.csv", "summary.parquet", "index.html")


@dataclass(frozen=True)
class Asked:
    """Files that the options of a job name.

    ``files`` are those to be written beside the parameter file, by option; ``replace`` says that
    files of anybody may be replaced.
    """

    files: Mapping[str, str] = field(default_factory=dict)
    replace: bool = False


AskedBy = Callable[[Job], Asked]


def find_tasks(
    jobs: Sequence[Job],
    logs: Sequence[Sequence[str]],
    base: Path,
    folder: Path,
    source: Path | None,
    asked_by: AskedBy,
) -> list[Task]:
    """Return the task of every job with the files that it writes, without its key.

    A job whose options name a file that is read, that another job writes or that is of the batch
    gets a refusal.

    Raises
    ------
    UsageError
        When a file that is named after the batch or after a job is read by any job.
    """
    asked = [asked_by(job) for job in jobs]
    read = _inputs(jobs, logs, asked, base, source)
    own = FileSet()
    for name in (NAME, *SUMMARY):
        _refuse(folder / name, read)
        own.add(folder / name, "this batch")
    places = [(folder / f"{job.name}.yaml", folder / RECORDS / f"{job.name}.txt") for job in jobs]
    for job, both in zip(jobs, places):
        for path in both:
            _refuse(path, read)
            own.add(path, f"job {job.name}")
    pictures = FileSet()
    shared: dict[str, str] = {}  # job to a reason
    for job, a in zip(jobs, asked):
        for option, name in a.files.items():
            path = base / name
            other = pictures.find(path)
            if other is not None and other != job.name:
                shared[job.name] = f"{option} {name} is written by job {other} as well."
                shared.setdefault(other, f"{option} {name} is written by job {job.name} as well.")
            pictures.add(path, job.name)
            if (whose := read.find(path) or own.find(path)) is not None:
                shared[job.name] = f"{option} {name} would overwrite a file of {whose}."
    return [
        Task(
            job.name,
            "",
            (job.family, *paths, *job.options),
            str(base),
            str(output),
            str(record),
            tuple(str(base / name) for name in a.files.values()),
            a.replace,
            shared.get(job.name, ""),
        )
        for job, paths, a, (output, record) in zip(jobs, logs, asked, places)
    ]


def _refuse(path: Path, read: FileSet) -> None:
    if is_irregular(path):
        raise UsageError(f"{path} is {IRREGULAR}.", remedy="Give another folder with -o.")
    if (whose := read.find(path)) is not None:
        raise UsageError(
            f"{path} would be overwritten, and it is read by {whose}.",
            remedy="Give another folder with -o, one that holds no logs.",
        )


def _inputs(
    jobs: Sequence[Job],
    logs: Sequence[Sequence[str]],
    asked: Sequence[Asked],
    base: Path,
    source: Path | None,
) -> FileSet:
    """Files that are read, each with who reads it."""
    read = FileSet()
    if source is not None:
        read.add(source, "this batch: it is the list of jobs")
    for job, paths, a in zip(jobs, logs, asked):
        for path in paths:
            parts = [path] if os.path.lexists(base / path) else path.split("+")
            for part in parts:
                read.add(base / part, f"job {job.name}")
        for name in named_files(job.options, a, base):
            read.add(base / name, f"job {job.name}")
    return read


def named_files(words: Sequence[str], asked: Asked, base: Path) -> Iterator[str]:
    """Files that options name to be read: ``FILE``, ``NAME=FILE``, ``FILE+FILE``."""
    written = {*asked.files.values()}
    for word in words:
        value = word.partition("=")[2]
        texts = (word, value, value.rpartition("=")[2])
        for name in dict.fromkeys(part for t in texts for part in (t, *t.split("+"))):
            if name and name not in written and _is_file(base / name):
                yield name


def _is_file(path: Path) -> bool:
    try:
        return os.path.isfile(path)
    except ValueError:
        return False
