"""Jobs of a fleet: from a table in a file, or from the names of logs."""

from __future__ import annotations

import csv
import io
import os
import re
import shlex
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from glob import has_magic
from pathlib import Path
from typing import Any

from ..errors import JobsFileError, ParameterFileError, UsageError, closest, shortened
from ..files import FileSet, open_regular
from ..parameters.problems import format_path
from ..parameters.yaml_io import parse_yaml_table
from .patterns import expand

_KEYS = ("job", "family", "logs", "options")
_NEEDED = _KEYS[:3]
_LARGEST = 500_000_000  # bytes: a million jobs have some 100 MB
_MOST_OPTIONS = 20_000  # characters; splitting takes time in proportion to their square
_NAME = re.compile(r"[^\x00-\x1f\x7f/\\:*?\"<>|]{1,180}")
# Windows keeps these names for devices, whatever follows a dot.
_DEVICE = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)(\..*)?", re.IGNORECASE)
_FORM = "Expected columns job, family, logs and, if any, options."


@dataclass(frozen=True)
class Job:
    """One fit of a batch: what would stand on one command line.

    ``logs`` are paths or patterns, ``options`` words of the command line; both as seen from
    the folder of the batch's jobs.
    """

    name: str
    family: str
    logs: tuple[str, ...]
    options: tuple[str, ...] = ()

    def found_logs(self, folder: Path, besides: FileSet | None = None) -> tuple[str, ...]:
        """Paths of the logs, patterns replaced by the files that match, in order of their names.

        Patterns match none of ``besides``. One that no file matches stays: the reader says that
        there is no such file. A name that a command line would take for an option, or for standard
        input, begins with ``./``.
        """
        paths: list[str] = []
        for text in self.logs:
            named = not has_magic(text) or os.path.lexists(folder / text)
            found = [text] if named else expand(text, folder) or [text]
            if not named and besides is not None:
                found = [path for path in found if besides.find(folder / path) is None]
            paths += found
        return tuple(dict.fromkeys(f"./{p}" if p.startswith("-") else p for p in paths))


def read_jobs(path: str | os.PathLike[str]) -> list[Job]:
    """Read a table of jobs.

    Parameters
    ----------
    path
        CSV (separated by commas, semicolons or tabs) or, with the suffix ``.yaml`` or ``.yml``,
        a YAML list of mappings (alone or under ``jobs``), with the keys ``job``, ``family``,
        ``logs`` and ``options``. In CSV several logs are separated by ``;``; in YAML ``logs``
        and ``options`` may also be lists.

    Raises
    ------
    JobsFileError
        When the file cannot be read, or a row of it not be understood.
    """
    where = os.fspath(path)
    text = _read_text(where)
    rows = (
        _from_yaml(text, where)
        if where.lower().endswith((".yaml", ".yml"))
        else _from_csv(text, where)
    )
    jobs = [_make_job(row, place) for place, row in rows]
    if not jobs:
        raise JobsFileError("holds no job.", where=where, expected=_FORM,
                            remedy="Give one row per job.")  # fmt: skip
    _check_names(jobs, where)
    return jobs


def group_logs(
    family: str,
    patterns: Sequence[str],
    group_by: str,
    options: str,
    folder: Path,
    besides: FileSet | None = None,
) -> list[Job]:
    """Make jobs from logs that are named alike.

    Parameters
    ----------
    family
        Of all jobs.
    patterns
        Of the logs, as seen from ``folder``.
    group_by
        ``file``: a job each log; ``folder``: a job the logs of each folder; or a pattern of file
        names with ``{job}`` where the name of the job stands, and ``*`` for anything.
    options
        Words of the command line, the same for all.
    folder
        Where they are.
    besides
        Files that are no logs, though a pattern may match them.

    Raises
    ------
    UsageError
        When no log matches, the pattern is none, or one of the logs does not match it.
    """
    every = Job("", family, tuple(patterns)).found_logs(folder, besides)
    paths = [p for p in every if (folder / p).is_file()]
    if not paths:
        raise UsageError(
            f"no file matches {', '.join(patterns)}.",
            remedy="Check the pattern, and put it in quotes: --logs 'fleet/*.csv'.",
        )
    groups: dict[str, list[str]] = {}
    for path in paths:
        groups.setdefault(_group(path, group_by), []).append(path)
    double = next((logs for logs in groups.values() if group_by == "file" and len(logs) > 1), None)
    if double:
        raise UsageError(
            f"{double[0]} and {double[1]} would be jobs of one name.",
            remedy="Rename one, or group them with --group-by folder.",
        )
    words = _words(options, "--options", UsageError)
    jobs = [Job(name, family, tuple(logs), words) for name, logs in groups.items()]
    _check_names(jobs, "--group-by")
    return jobs


def _group(path: str, group_by: str) -> str:
    folder, name = os.path.split(path.removeprefix("./"))
    if group_by == "file":
        return re.sub(r"[\\/]+", "_", os.path.splitext(os.path.join(folder, name))[0])
    if group_by == "folder":
        return re.sub(r"[\\/]+", "_", folder) or "here"
    ahead, found, after = group_by.partition("{job}")
    if not found:
        raise UsageError(
            f"--group-by {group_by!r} is not understood.",
            expected="Expected file, folder, or a pattern of file names that holds {job}.",
            remedy="Give for example --group-by 'unit{job}_*.csv'.",
        )
    parts = (".*".join(map(re.escape, part.split("*"))) for part in (ahead, after))
    match = re.fullmatch("(.+?)".join(parts), name)
    if match is None:
        raise UsageError(
            f"--group-by {group_by!r} does not match {name}.",
            remedy="Give a pattern that all logs match, or fewer logs.",
        )
    return match[1]


def _read_text(where: str) -> str:
    try:
        with open_regular(where) as file:
            content = file.read(_LARGEST + 1)
        if len(content) > _LARGEST:
            raise JobsFileError(f"is larger than {_LARGEST // 1_000_000} MB.", where=where,
                                remedy="Split it into several batches.")  # fmt: skip
        return content.decode("utf-8-sig").replace("\r\n", "\n").replace("\r", "\n")
    except OSError as error:
        raise JobsFileError(
            f"cannot be read: {error.strerror}.", where=where, remedy="Check the name of the file."
        ) from None
    except (UnicodeDecodeError, ValueError):
        raise JobsFileError("is not UTF-8 text.", where=where, expected=_FORM,
                            remedy="Save it as UTF-8.") from None  # fmt: skip


def _from_csv(text: str, where: str) -> Iterable[tuple[str, Mapping[str, Any]]]:
    head = text.lstrip("\r\n").partition("\n")[0]
    delimiter = max(",;\t", key=head.count)
    rows = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter, strict=True)
    names: list[str] | None = None
    try:
        for cells in rows:
            place = f"{where}, line {rows.line_num}"
            if not any(cell.strip() for cell in cells):
                continue
            if names is None:
                names = [cell.strip().lower() for cell in cells]
                _check_keys(names, place)
                continue
            if len(cells) != len(names):
                raise JobsFileError(
                    f"holds {len(cells)} cells, and the header {len(names)}.", where=place,
                    remedy="Put a cell that holds the separator in quotes.",
                )  # fmt: skip
            yield place, dict(zip(names, (cell.strip() for cell in cells)))
    except csv.Error as error:
        raise JobsFileError(f"is not CSV: {error}.", where=f"{where}, line {rows.line_num}",
                            remedy="Correct the quotes of this line.") from None  # fmt: skip


def _from_yaml(text: str, where: str) -> Iterable[tuple[str, Mapping[str, Any]]]:
    try:
        found = parse_yaml_table(text, where)
    except ParameterFileError as error:
        reason = "; ".join(words for _, words in error.problems).removeprefix("is not YAML: ")
        raise _not_yaml(reason, error.where) from None
    data = found.data
    for at, words in found.problems.found.items():
        raise _not_yaml(f"{format_path(at)} {words}", f"{where}, line {found.lines[at]}")
    if isinstance(data, dict) and list(data) == ["jobs"]:
        data = data["jobs"]
    if not isinstance(data, list):
        raise JobsFileError("is not a list of jobs.", where=where, expected=_FORM,
                            remedy="Give a list, one mapping a job.")  # fmt: skip
    for number, row in enumerate(data, 1):
        place = f"{where}, job {number}"
        if not isinstance(row, dict):
            raise JobsFileError("is not a mapping.", where=place, expected=_FORM,
                                remedy="Give its keys and values.")  # fmt: skip
        _check_keys([str(key) for key in row], place)
        yield place, row


def _not_yaml(reason: str, where: str) -> JobsFileError:
    what = f"is not YAML of plain lists, mappings and text: {shortened(reason)}."
    return JobsFileError(what, where=where, expected=_FORM, remedy="Correct the file.")


def _check_keys(names: Sequence[str], where: str) -> None:
    missing = [key for key in _NEEDED if key not in names]
    unknown = [name for name in names if name not in _KEYS]
    double = [name for name in _KEYS if names.count(name) > 1]
    if not (missing or unknown or double):
        return
    close = closest(unknown[0], _KEYS) if unknown else ""
    what = (
        f"has no {missing[0]!r}" if missing and not close
        else f"has an unknown {unknown[0]!r}" if unknown
        else f"has {double[0]!r} twice"
    )  # fmt: skip
    raise JobsFileError(
        f"{what}.", where=where, expected=_FORM,
        remedy=f"Did you mean {close!r}?" if close else "Correct the names.",
    )  # fmt: skip


def _make_job(row: Mapping[str, Any], place: str) -> Job:
    name, family = (_text(row[key], key, place) for key in ("job", "family"))
    if not _NAME.fullmatch(name) or name[0] in ". " or name[-1] in ". " or _DEVICE.fullmatch(name):
        raise JobsFileError(
            f"the name of the job, '{name[:60]}', cannot be that of a file.", where=place,
            expected="Expected up to 180 characters without slashes, colons, quotes, * or ?, not "
            "beginning or ending with a dot.",
            remedy="Give another name; the parameter file is called by it.",
        )  # fmt: skip
    logs = (
        _list(row["logs"], "logs", place)
        if isinstance(row["logs"], list)
        else [part.strip() for part in _text(row["logs"], "logs", place).split(";")]
    )
    logs = [part for part in logs if part]
    if not logs:
        raise JobsFileError("names no log.", where=place, remedy="Give its logs.")
    if "-" in logs:
        raise JobsFileError("a log is the name of no file.", where=place,
                            remedy="Give a path or a pattern.")  # fmt: skip
    given = row.get("options")
    words = (
        tuple(_list(given, "options", place)) if isinstance(given, list)
        else _words(_text(given, "options", place) if given else "", place, JobsFileError)
    )  # fmt: skip
    return Job(name, family, tuple(logs), words)


def _text(value: Any, key: str, place: str) -> str:
    text = "" if isinstance(value, bool | list | dict) or value is None else str(value)
    if text and "\0" not in text:
        return text
    found = "is empty" if value in (None, "") else "is no text"
    raise JobsFileError(f"{key!r} {found}.", where=place, remedy="Give it as text.")


def _list(values: Sequence[Any], key: str, place: str) -> list[str]:
    return [_text(value, key, place) for value in values]


def _words(text: str, place: str, kind: type[JobsFileError | UsageError]) -> tuple[str, ...]:
    if len(text) > _MOST_OPTIONS:
        raise kind(
            f"the options have {len(text)} characters, more than {_MOST_OPTIONS}.", where=place,
            remedy="Give the job fewer options.",
        )  # fmt: skip
    try:
        return tuple(shlex.split(text))
    except ValueError as error:
        raise kind(
            f"the options '{text[:80]}' are not understood: {error}.", where=place,
            remedy="Write them as on the command line.",
        ) from None  # fmt: skip


def _check_names(jobs: Sequence[Job], where: str) -> None:
    """Refuse two jobs whose files some systems cannot tell apart."""
    seen: dict[str, str] = {}
    for job in jobs:
        other = seen.get(job.name.casefold())
        seen[job.name.casefold()] = job.name
        if other is not None:
            also = "." if other == job.name else f" and '{other}', the same file on some systems."
            raise JobsFileError(f"two jobs are named '{job.name}'{also}", where=where,
                                remedy="Give every job a name of its own.")  # fmt: skip
