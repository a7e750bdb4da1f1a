"""The journal of a batch: one line a finished job, appended, so that a kill loses none of them.

It is the only memory of a batch. A line that a kill cut short is none; the job is run again. Before
any job runs, those whose parameter files are the batch's own are named: a file that was written
just before a kill is then known, and one of somebody else is never replaced.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from io import FileIO
from pathlib import Path
from typing import Any

from ..errors import OutputError
from ..parameters.atomic import locked
from .outcome import Outcome

NAME = "journal.jsonl"


class Journal:
    """Outcomes by job, the last of each; open and locked while a batch runs.

    ``damaged`` of its ``lines`` say nothing: what a kill cut short, or what was changed. The
    others count.
    """

    def __init__(self, file: FileIO, where: str) -> None:
        self._file, self._where = file, where
        content = file.read()
        self.outcomes: dict[str, Outcome] = {}
        self.claimed: set[str] = set()
        lines = [line for line in content.split(b"\n") if line]
        self.lines, self.damaged = len(lines), 0
        for line in lines:
            found = _entry(line)
            if found is None:
                self.damaged += 1
            elif isinstance(found, Outcome):
                self.outcomes[found.job] = found
                self.claimed |= {found.job} if found.exit == 0 else set()
            else:
                self.claimed |= found
        # The next line must not continue one that was cut short.
        self._ahead = b"" if not content or content.endswith(b"\n") else b"\n"

    def claim(self, jobs: Iterable[str]) -> None:
        """Name jobs whose parameter files this batch may write and replace."""
        more = sorted(set(jobs) - self.claimed)
        if more:
            self._append({"claimed": more})
        self.claimed.update(more)

    def add(self, outcome: Outcome) -> None:
        """Append an outcome; it has left this process when this returns."""
        self._append(outcome.to_dict())
        self.outcomes[outcome.job] = outcome

    def _append(self, entry: Mapping[str, Any]) -> None:
        left = self._ahead + json.dumps(entry, allow_nan=False).encode() + b"\n"
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


def _entry(line: bytes) -> Outcome | set[str] | None:
    """What a line says; ``None`` for one that is damaged."""
    try:
        data: Any = json.loads(line)
        if "claimed" in data:
            return {str(name) for name in data["claimed"]}
        found = Outcome(**data)
    except (ValueError, TypeError, RecursionError):
        return None
    return found if isinstance(found.job, str) and isinstance(found.exit, int) else None
