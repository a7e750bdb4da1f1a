"""Every error that a user can meet, and the warnings that travel with a result.

Each error carries four things: where it happened, what was found, what was
expected and what to do about it. The command line turns them into a message and
an exit status; a notebook shows the same text.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Notice:
    """A warning that is written into the parameter file.

    ``code`` is a stable kebab-case word a program can test for, ``message`` says
    what was found, where, and what to do.
    """

    code: str
    message: str


class FluidactError(Exception):
    """Base of all user-facing errors.

    Parameters
    ----------
    what
        What was found, a whole sentence.
    where
        File and, when known, line or column, for example ``"pot.csv, line 214"``.
    expected
        What was expected instead.
    remedy
        What the user can do.
    """

    exit_status = 1

    def __init__(self, what: str, *, where: str = "", expected: str = "", remedy: str = "") -> None:
        self.what = what
        self.where = where
        self.expected = expected
        self.remedy = remedy
        head = f"{where}: {what}" if where else what
        super().__init__("\n".join(part for part in (head, expected, remedy) if part))


class UsageError(FluidactError):
    """The command or call itself is wrong (exit status 2)."""

    exit_status = 2


class LogError(FluidactError):
    """A log cannot be read or used (exit status 3)."""

    exit_status = 3


class UnitError(LogError):
    """A unit is unknown or has the wrong dimension (exit status 3)."""


class ParameterFileError(FluidactError):
    """A parameter file is not valid (exit status 3).

    ``problems`` lists every problem as ``(path, message)``, for example
    ``("parameters.mass.unit", "'m' is not a mass")``.
    """

    exit_status = 3

    def __init__(self, where: str, problems: list[tuple[str, str]], remedy: str = "") -> None:
        self.problems = problems
        lines = [f"{path}: {message}" if path else message for path, message in problems]
        count = "1 problem" if len(problems) == 1 else f"{len(problems)} problems"
        super().__init__(
            f"not a valid parameter file ({count}):\n  " + "\n  ".join(lines),
            where=where,
            remedy=remedy,
        )


class OutputError(FluidactError):
    """A result cannot be written where it was asked for (exit status 3)."""

    exit_status = 3


class NotIdentifiedError(FluidactError):
    """The data cannot determine what was asked (exit status 4)."""

    exit_status = 4


class StrictError(FluidactError):
    """A warning under ``--strict``, or a failed verdict (exit status 4)."""

    exit_status = 4


class MismatchError(FluidactError):
    """A parameter file no longer describes the machine (exit status 5)."""

    exit_status = 5
