"""The journal of a batch: one line a finished job, appended, so that a kill loses none of them.

It is the only memory of a batch. Every line ends with a checksum, and one that a kill cut short or
that was changed is none; the job is run again. Before any job runs, the files that are the batch's
own are named: one that was written just before a kill is then known, and one of somebody else is
never replaced.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import cache
from io import FileIO
from pathlib import Path
from typing import Any

from ..errors import OutputError, UsageError
from ..files import IRREGULAR, FileSet, is_irregular, open_regular
from ..parameters.atomic import locked
from .outcome import JobResult

NAME = "journal.jsonl"
_OURS = (b'{"claimed": ', b'{"job": ')
_CHECK = b', "check": "'
_DIGITS = 16


class Journal:
    """Outcomes by job, the last of each; open and locked while a batch runs.

    ``damaged`` of its ``lines`` say nothing: what a kill cut short, or what was changed. The
    others count.
    """

    def __init__(self, file: FileIO, where: str) -> None:
        self._file, self._where = file, where
        content = file.read()
        lines = [line for line in content.split(b"\n") if line]
        entries = [_entry(line) for line in lines]
        self.outcomes: dict[str, JobResult] = {}
        self.claimed = _claimed(entries)
        self.lines, self.damaged = len(lines), entries.count(None)
        for found in entries:
            if isinstance(found, JobResult):
                self.outcomes[found.job] = found
        if lines and self.damaged == self.lines and not content.startswith(_OURS):
            raise UsageError(
                f"{where} is not the journal of a batch; it was kept.",
                remedy="Give another folder with -o, or move it away.",
            )
        # The next line must not continue one that was cut short.
        self._ahead = b"" if not content or content.endswith(b"\n") else b"\n"

    def claim(self, files: Iterable[str]) -> None:
        """Name files that this batch may write and replace, as seen from its folder."""
        more = sorted(set(files) - self.claimed)
        if more:
            self._append({"claimed": more})
        self.claimed.update(more)

    def add(self, outcome: JobResult) -> None:
        """Append an outcome; it has left this process when this returns."""
        self._append(outcome.to_dict())
        self.outcomes[outcome.job] = outcome

    def _append(self, entry: Mapping[str, Any]) -> None:
        left = self._ahead + _line(entry) + b"\n"
        try:
            while left:  # a disk that fills up takes a part first, and refuses the rest
                left = left[self._file.write(left) :]
                self._ahead = b"\n"
        except OSError as error:
            raise OutputError(
                f"cannot be written: {error.strerror}.", where=self._where,
                remedy="Free some space, and run the same command again: it goes on from here.",
            ) from error  # fmt: skip
        self._ahead = b""


@contextmanager
def open_journal(folder: Path) -> Iterator[Journal]:
    """Open the journal of a folder for one batch alone.

    Raises
    ------
    OutputError
        When it cannot be opened, or another batch is running there.
    """
    where = str(folder / NAME)
    if is_irregular(where):
        raise UsageError(f"{where} is {IRREGULAR}.", remedy="Give another folder with -o.")
    try:
        file = open(where, "a+b", buffering=0)  # noqa: SIM115 (closed below)
    except OSError as error:
        raise OutputError(f"cannot be written: {error.strerror}.", where=where,
                          remedy="Check the folder and its permissions.") from error  # fmt: skip
    with file:
        if locked(file.fileno()) is False:
            raise OutputError(
                "another batch is writing to this folder.", where=str(folder),
                remedy="Wait until it has ended, or give another folder with -o.",
            )  # fmt: skip
        file.seek(0)
        yield Journal(file, where)
        with suppress(OSError):
            os.fsync(file.fileno())


def own_files(folder: Path) -> FileSet:
    """Files that earlier runs of a batch wrote in its folder: no logs, whatever matches them."""
    try:
        with open_regular(folder / NAME) as file:
            entries = [_entry(line) for line in file.read().split(b"\n") if line]
    except (OSError, ValueError):
        return FileSet()
    names = {NAME, *_claimed(entries)} if any(entries) else set()
    return FileSet(folder / name for name in names)


def _claimed(entries: Iterable[JobResult | set[str] | None]) -> set[str]:
    claimed: set[str] = set()
    for found in entries:
        claimed |= found.files.keys() if isinstance(found, JobResult) else found or set()
    return claimed


def _line(entry: Mapping[str, Any]) -> bytes:
    body = json.dumps(entry, allow_nan=False).encode()[:-1]
    return body + _CHECK + _check(body).encode() + b'"}'


def _check(body: bytes) -> str:
    return hashlib.sha256(body).hexdigest()[:_DIGITS]


def _entry(line: bytes) -> JobResult | set[str] | None:
    """Parse a line; ``None`` for one that is damaged, or not of the types it should be."""
    body, found, check = line.rpartition(_CHECK)
    if not found or check != _check(body).encode() + b'"}':
        return None
    try:
        data: Any = json.loads(body + b"}")
        claimed, outcome = _types()
        if isinstance(data, dict) and "claimed" in data:
            return set(claimed.validate_python(data["claimed"]))
        return outcome.validate_json(body + b"}")
    except (ValueError, RecursionError):
        return None


@cache  # the import takes longer than the journal of a small batch
def _types() -> tuple[Any, Any]:
    from pydantic import ConfigDict, TypeAdapter

    return TypeAdapter(list[str], config=ConfigDict(strict=True)), TypeAdapter(JobResult)
