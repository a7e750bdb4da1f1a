"""Open logs: what is given for all of them, or for those whose name matches."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from fnmatch import filter as filter_names
from os import PathLike
from pathlib import Path
from typing import Any, TypedDict

from ..errors import LogError, UsageError, closest
from ..units.quantities import in_si
from .kinds import check_kinds
from .log import Invalid, Log, StepInput
from .reader import read_log
from .source import files_of

LogLike = Log | str | PathLike[str] | Any  # and the data themselves: see `read_log`
_RUNS = r"\d+(?:\s*,\s*\d+)*"
_FORMS = {
    "--exclude": "[LOG:]run=2, [LOG:]time=3:3.5 (seconds) or [LOG:]lines=120:130",
    "--exclude-rows": "[LOG:]7 or [LOG:]120:130",
    "--set": "[LOG:]ROLE=VALUE",
}
_ROWS = r"\d+(?::\d+)?(?:\s*,\s*\d+(?::\d+)?)*"


class Reading(TypedDict, total=False):
    """Options for reading logs: keywords of :func:`open_logs`.

    ``exclude``, ``exclude_rows``, ``set`` and ``steps`` concern one log of several where ``LOG:``
    stands before the part or the role: its name, with ``*`` for any part of it. For the others
    see :func:`.read_log`.

    Attributes
    ----------
    exclude
        What is left out: ``"run=2"`` or ``"2"``, ``"time=3:3.5"`` [s], ``"lines=120:130"``,
        ``"trial1.csv:run=2"``, or several.
    exclude_rows
        Rows of the data that are left out, counted from 1: ``"7"``, ``"120:130"``, or several.
    set
        Role to what it was all the time, with its unit: ``{"a*.csv:position": "25 %"}``.
    constants
        The same for all logs.
    """

    columns: Mapping[str, str] | None
    units: Mapping[str, str] | None
    scales: Mapping[str, float] | None
    sample_time: float | None
    window: tuple[float | None, float | None] | None
    exclude: Sequence[str] | str | None
    exclude_rows: Sequence[str] | str | None
    set: Mapping[str, str] | Sequence[str] | None
    steps: Mapping[str, StepInput] | None
    holds: Mapping[str, str] | None
    unwrap: Mapping[str, float | str] | None
    constants: Mapping[str, str] | None
    from_name: Mapping[str, str] | None
    invalid: Invalid | None
    decimal: str | None
    thousands: str | None
    delimiter: str | None
    skip_rows: int | None
    header_row: int | None


def open_logs(
    logs: Sequence[LogLike] | Iterator[LogLike] | LogLike,
    *,
    once: bool = False,
    beside: Iterable[LogLike] = (),
    **how: Any,
) -> list[Log]:
    """Read logs that are given as paths or as data; one need not stand in a list.

    Parameters
    ----------
    logs
        One or several.
    once
        Whether what is read here is used only once, and its columns may go then.
    beside
        Other logs of the same call: what speaks of one log may mean one of them.
    **how
        As in :class:`Reading`; ``None`` says nothing.

    Raises
    ------
    UsageError
        When ``how`` speaks of a log that is not given, or that has been read already.
    LogError
        When a log cannot be read.
    """
    each = logs if isinstance(logs, Iterator) else listed_logs(logs)
    texts = {name: _texts(how.pop(name, None)) for name in ("exclude", "exclude_rows", "set")}
    said = {name: value for name, value in how.items() if value is not None}
    if "sample_time" in said:
        said["sample_time"] = in_seconds("sample_time", said["sample_time"])
    if "window" in said:
        said["window"] = window_in_seconds(said["window"])
    check_keywords(said)
    check_kinds(said)
    steps: Mapping[str, StepInput] = said.get("steps", {})
    if not any(texts.values()) and not any(":" in key for key in steps):
        return [_opened(log, said, once) for log in each]
    each = list(each)
    known = [_names(log) for log in (*each, *beside)]
    exclude = _by_log("--exclude", _numbered(texts["exclude"], _RUNS, "run"), known)
    exclude += _by_log("--exclude-rows", _numbered(texts["exclude_rows"], _ROWS, "rows"), known)
    constants = _by_log("--set", texts["set"], known)
    constants.sort(key=lambda entry: entry[0] != "*")  # one for some logs overrides one for all
    parts_of_keys = ((key, *split_part(key)[:2], step) for key, step in steps.items())
    stepped = [(_matching("--step", key, p, known), r, s) for key, p, r, s in parts_of_keys]
    stepped.sort(key=lambda entry: entry[0] != "*")
    opened = []
    for log, names in zip(each, known):
        values = {role: value for p, role, value in constants if _matches(names, p)}
        parts = [f"{kind}={what}" for p, kind, what in exclude if _matches(names, p)]
        own = {**said, "exclude": parts} if parts else dict(said)
        if stepped:
            own["steps"] = {r: s for p, r, s in stepped if _matches(names, p)}
        if values:
            own["constants"] = {**said.get("constants", {}), **values}
        opened.append(_opened(log, own, once))
    return opened


def in_seconds(name: str, value: Any) -> Any:
    """A time in seconds: text as ``"10 ms"`` is converted, anything else comes back as it is.

    ``UsageError`` for other text.
    """
    try:
        return in_si(value, "s")
    except ValueError as error:
        raise UsageError(
            f"{name}: {error}.", remedy="Give a number in seconds, or as text with its unit."
        ) from None


def window_in_seconds(window: Any) -> Any:
    """Both ends of a window in seconds; anything but a pair comes back as it is."""
    if not isinstance(window, tuple | list):
        return window
    return tuple(in_seconds("window", end) for end in window)


def check_keywords(said: Mapping[str, Any]) -> None:
    """Refuse keywords that do not exist (``UsageError``)."""
    for name in said:
        if name not in Reading.__annotations__:
            close = closest(name, Reading.__annotations__)
            raise UsageError(
                f"there is no keyword {name}.",
                expected=f"Logs are read with {', '.join(Reading.__annotations__)}.",
                remedy=f"Did you mean {close}?" if close else "Leave it out.",
            )


def listed_logs(logs: Sequence[LogLike] | Iterator[LogLike] | LogLike) -> list[LogLike]:
    """Logs as a list; of an iterator, which is used up by it, none."""
    if isinstance(logs, Iterator):
        return []
    return list(logs) if isinstance(logs, list | tuple) else [logs]


def _opened(log: LogLike, said: Mapping[str, Any], once: bool) -> Log:
    if not isinstance(log, Log):
        try:
            return replace(read_log(log, **said), disposable=once)
        except LogError:
            _refuse_own_file(log)
            raise
    if said:
        raise UsageError(
            f"{next(iter(said))} is given for '{log.name}', which has been read already",
            remedy="Give it to read_log, or give the path or the data.",
        )
    return log


def _refuse_own_file(log: LogLike) -> None:
    """Name a file of this program that was given as a log."""
    if not isinstance(log, str | PathLike):
        return
    path = str(log)
    if Path(path).suffix.lower() not in (".yaml", ".yml"):
        return
    with suppress(OSError), open(path, "rb") as file:
        first = re.search(rb"^format: *fluidact-(\w+)", file.read(4096), re.MULTILINE)
        if first is not None:
            kind = {b"parameters": "parameter"}.get(first[1], first[1].decode("ascii", "replace"))
            raise LogError(
                f"is a {kind} file, not a log.",
                where=path,
                expected="Expected a table of recorded samples.",
                remedy=f"`fluidact-fit report {path}` shows what is in a parameter file; "
                f"`fluidact-fit check {path} LOG` compares it with a log.",
            )


def _texts(given: Mapping[str, str] | Sequence[str | int] | str | int | None) -> list[str]:
    """Return the given texts: entries of a mapping as ``KEY=VALUE``."""
    if isinstance(given, Mapping):
        return [f"{key}={value}" for key, value in given.items()]
    return [str(given)] if isinstance(given, str | int) else [str(part) for part in given or ()]


def _names(log: LogLike) -> list[str]:
    """Names that a pattern may mean a log by: its own, and those of the files merged in it."""
    if not isinstance(log, str | PathLike):
        return [log.name if isinstance(log, Log) else "data"]
    files = [file.name for file in files_of(Path(log))]
    return files if len(files) == 1 else ["+".join(files), *files]


def _matches(names: Sequence[str], pattern: str) -> bool:
    """Return whether a pattern means a log; a name may hold brackets, and is its own pattern."""
    return pattern in names or bool(filter_names(names, pattern))


def _numbered(given: Iterable[str], form: str, kind: str) -> list[str]:
    """``[LOG:]2,5`` as ``[LOG:]run=2`` and ``[LOG:]run=5``; what has a name stays as it is."""
    out = []
    for text in given:
        found = re.fullmatch(rf"(?:({form})|(.+?:)({form}))\s*", text)
        if found is None or "=" in text:
            out.append(text)
            continue
        parts = (found[1] or found[3]).split(",")
        out += [f"{found[2] or ''}{kind}={part.strip()}" for part in parts]
    return out


def _by_log(
    option: str, given: Iterable[str], logs: Sequence[Sequence[str]]
) -> list[tuple[str, str, str]]:
    """Read ``[LOG:]NAME=VALUE``: pattern of the logs, name and value; some log has to match."""
    out = []
    for text in given:
        pattern, name, value = split_part(text)
        if not name or value is None:
            raise UsageError(
                f"{option} {text!r} is not understood.",
                expected=f"Expected {_FORMS[option]}.",
                remedy="LOG is the name of one log of several, with * for any part of it.",
            )
        out.append((_matching(option, text, pattern, logs), name, value))
    return out


def _matching(option: str, text: str, pattern: str | None, logs: Sequence[Sequence[str]]) -> str:
    """Return the pattern of the logs that an option concerns, ``*`` for all; some has to match."""
    if pattern is not None and not any(_matches(n, pattern) for n in logs):
        raise UsageError(
            f"{option} {text!r} names a log that is not given.",
            expected=f"The logs are: {', '.join(names[0] for names in logs)}.",
            remedy="Give the name of one of them, with * for any part of it.",
        )
    return "*" if pattern is None else pattern


def split_part(text: str) -> tuple[str | None, str, str | None]:
    """Pattern, name and value of ``[LOG:]NAME=VALUE``; ``None`` for what is not there."""
    before, equals, value = text.partition("=")
    pattern, colon, name = before.rpartition(":")
    return pattern if colon else None, name.strip(), value if equals else None
