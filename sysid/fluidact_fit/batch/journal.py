"""The journal of a batch: one line a finished job, appended, so that a kill loses none of them.

It is the only memory of a batch. A line that a kill cut short is none; the job is run again.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from io import FileIO
from pathlib import Path
from typing import Any

from ..errors import OutputError
from ..parameters.atomic import locked
from .outcome import Outcome

NAME = "journal.jsonl"


class Journal:
    """Outcomes by job, the last of each; open and locked while a batch runs."""

    def __init__(self, file: FileIO, where: str) -> None:
        self._file, self._where = file, where
        content = file.read()
        self.outcomes: dict[str, Outcome] = {}
        for line in content.split(b"\n"):
            found = _outcome(line)
            if found is not None:
                self.outcomes[found.job] = found
        # The next line must not continue one that was cut short.
        self._ahead = b"" if not content or content.endswith(b"\n") else b"\n"

    def add(self, outcome: Outcome) -> None:
        """Append an outcome; it is on its way to the disk before this returns."""
        text = json.dumps(outcome.to_dict(), allow_nan=False)
        left = self._ahead + text.encode() + b"\n"
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
        self.outcomes[outcome.job] = outcome


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


def _outcome(line: bytes) -> Outcome | None:
    try:
        data: Any = json.loads(line)
        return Outcome(**data)
    except (ValueError, TypeError, RecursionError):
        return None
