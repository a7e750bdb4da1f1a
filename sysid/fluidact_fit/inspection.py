"""Inspection of logs before a fit: what is in them, what is wrong, and which families fit them."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Unpack

from .advice import Suggestion, suggest
from .arguments import require_given
from .channels import describe_channels, relate
from .errors import Notice, UsageError, in_python
from .families import get_family
from .logs import (
    Log,
    LogLike,
    Reading,
    choose_variant,
    describe,
    experiments,
    open_logs,
    selected_part,
)
from .logs.opening import listed_logs
from .tables import Shown, Table, percent_text

_RELATED = 8  # columns of which each two are compared


@dataclass(frozen=True)
class Inspection(Shown):
    """Content of some logs of one machine, and the families that fit them.

    Attributes
    ----------
    logs
        Of each log its format, columns, time base, relations of the columns and notices, as
        ``fluidact-fit inspect --json`` writes them.
    suggestions
        Families that fit the logs, the best first. Each has ``family``, ``columns``, ``verdict``,
        ``command`` and, where the log does not tell which column is which, ``candidates``.
    """

    logs: tuple[Mapping[str, Any], ...]
    suggestions: tuple[Suggestion, ...]

    @property
    def notices(self) -> tuple[Notice, ...]:
        """Everything worth a warning in the logs."""
        return tuple(Notice(n["code"], n["message"]) for log in self.logs for n in log["notices"])

    def to_dict(self) -> dict[str, Any]:
        """Return plain mappings, lists, text and numbers, as ``inspect --json`` writes them."""
        listed = {"suggestions": [s.as_dict() for s in self.suggestions]}
        if len(self.logs) == 1:
            return {**self.logs[0], **listed}
        return {"logs": list(self.logs), **listed}

    def table(self) -> Table:
        """Return the columns of all logs, as a table that shows itself."""
        head = ("log", "column", "name", "unit", "lowest", "highest", "noise", "invalid")
        rows = (_cells(log["file"], column) for log in self.logs for column in log["columns"])
        return Table(head, tuple(rows), right=(4, 5, 6, 7))

    def family_table(self) -> Table:
        """Return the suggested families, as a table that shows itself."""
        return family_table(self.suggestions)

    def parts(self) -> list[Table | str]:
        """Return columns, notices, families and the command to run next."""
        parts: list[Table | str] = [self.table(), "\n".join(self._remarks())]
        if self.suggestions:
            parts += [self.family_table(), f"next: {self.suggestions[0].command}"]
        return parts

    def _remarks(self) -> list[str]:
        """Return notices of the logs, then what is open in the first suggestion."""
        remarks = [f"({n.code}) {in_python(n.message)}" for n in self.notices]
        first = self.suggestions[0] if self.suggestions else None
        if first is not None:
            remarks += [in_python(text) for text in (first.reason, first.basis) if text]
        return remarks


def _cells(file: str, column: Mapping[str, Any]) -> tuple[str, ...]:
    channel = column["channel"]
    ends = ("", "") if channel is None else (f"{channel['low']:.4g}", f"{channel['high']:.4g}")
    noise = f"{channel['noise']:.2g}" if channel and channel["noise"] else ""
    return (file, f"#{column['number']}", column["header"] or "", column["unit"] or "", *ends,
            noise, str(column["invalid_cells"] or ""))  # fmt: skip


def family_table(suggestions: Sequence[Suggestion]) -> Table:
    """Return families, the verdicts of their trials, and the columns that they would use."""
    rows = (
        (s.family, s.verdict.upper() or "not tried", percent_text(s.fit_percent), _roles(s))
        for s in suggestions
    )
    return Table(("family", "verdict", "fit", "columns"), tuple(rows), right=(2,))


def _roles(s: Suggestion) -> str:
    """Return columns by role: ``force=#2``, or ``force=#2|#3`` where nothing tells which."""
    known = [f"{role}={at}" for role, at in s.columns.items()]
    return " ".join([*known, *(f"{role}={'|'.join(at)}" for role, at in s.candidates.items())])


def inspect(
    logs: Sequence[LogLike] | LogLike,
    family: str | None = None,
    *,
    trial: bool = True,
    progress: Callable[[str], None] | None = None,
    **reading: Unpack[Reading],
) -> Inspection:
    """Inspect logs of one machine before a fit.

    Parameters
    ----------
    logs
        One or several: paths, `Log`, DataFrames or mappings of header to array.
    family
        Judge the logs for this family alone, and refuse logs that it cannot use.
    trial
        Fit the likeliest families to see what they determine; logs of up to 50,000 rows.
    progress
        Called with what is being done.
    **reading
        As for :func:`.fit`: ``columns``, ``units``, ``window`` and others (:class:`.logs.Reading`).

    Returns
    -------
    Inspection
        Columns, time base, notices and suggestions; a notebook shows it as tables.

    Raises
    ------
    LogError
        When a log cannot be read, or the ``family`` cannot use it.
    UsageError
        When an option is not possible.
    """
    require_given("text", family=family)
    each = listed_logs(logs)
    if not each:
        raise UsageError("no log was given.", expected="Expected one log or more.")
    opened = open_logs(each, **reading)
    described = tuple(describe_log(log, family) for log in opened)
    paths = [os.fspath(given) if isinstance(given, str | os.PathLike) else log.name
             for given, log in zip(each, opened)]  # fmt: skip
    found = suggest(opened, paths, family, trial=trial, progress=progress)
    return Inspection(described, tuple(found))


def describe_log(log: Log, family: str | None = None) -> dict[str, Any]:
    """Describe a log, its channels and their relations as plain data.

    Raises
    ------
    LogError, UsageError
        When no row is selected, or the ``family`` cannot use the log.
    """
    found = describe(log)
    if family is not None:
        found["family"] = _use_for(log, family, found["notices"])
    part = selected_part(log)
    channels = describe_channels(part)
    for entry in found["columns"]:
        channel = channels[entry["number"]]
        entry["channel"] = None if channel is None else asdict(channel)
    at = found["time"]["column"] if found["time"] else None
    signals = [c for c in part.columns if c.index != at and not c.part_of]
    found["relations"] = [asdict(r) for r in relate(signals[:_RELATED])]
    return found


def _use_for(log: Log, family: str, notices: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the runs that a family makes of a log; adds what is worth a warning."""
    variant = choose_variant(log, get_family(family).variants)
    runs, found = experiments(log, variant)
    known = {n["message"] for n in notices}
    notices += [asdict(n) for n in found if n.message not in known]
    return {
        "name": family,
        "variant": variant.name,
        "runs": [{"name": e.name, "samples": e.samples} for e in runs],
    }
