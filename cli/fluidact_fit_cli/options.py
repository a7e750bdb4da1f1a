"""Options that several commands share, and how they reach the log reader."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from fnmatch import filter as filter_names
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from fluidact_fit.errors import FluidactError, LogError, ParameterFileError, UsageError, closest

from .parse import (
    Parsed,
    assigned,
    collect,
    parse_count,
    parse_factor,
    parse_hold,
    parse_seconds,
    parse_sign,
    parse_step,
    parse_text,
    parse_turn,
    parse_window,
    split_rows,
    split_runs,
)

if TYPE_CHECKING:
    from fluidact_fit.logs import Log
    from fluidact_fit.parameters import ParameterDocument

_ROLE_OPTIONS = {
    "column": "columns",
    "unit": "units",
    "scale": "scales",
    "hold": "holds",
    "unwrap": "unwrap",
}


class Option(click.Option):
    """An option that stands under a heading of the help."""

    def __init__(self, *args: Any, group: str = "Options", **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.group = group


class Command(click.Command):
    """A command whose help lists the options under headings."""

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write one section per heading, in the order of the options."""
        groups: dict[str, list[tuple[str, str]]] = {}
        for param in self.get_params(ctx):
            if isinstance(param, click.Argument):
                continue
            record = param.get_help_record(ctx)
            if record is not None:
                groups.setdefault(getattr(param, "group", "Messages"), []).append(record)
        for title, records in groups.items():
            with formatter.section(title):
                formatter.write_dl(records)


def parsed(
    option: str, form: str, example: str, parse: Callable[[str], Any], help_text: str, group: str
) -> Option:
    """An option whose value is in a small language."""
    return Option([option], type=Parsed(form, f"{option} {example}", parse), help=help_text,
                  group=group)  # fmt: skip


def assignment(
    option: str, form: str, example: str, parse: Callable[[str], Any], help_text: str, group: str
) -> Option:
    """An option ``KEY=VALUE`` that may be repeated."""
    kind = Parsed(form, f"{option} {example}", assigned(parse))
    return Option([option], type=kind, multiple=True, callback=collect, help=help_text, group=group)


def flag(*names: str, group: str, help: str, **more: Any) -> Option:
    """An option without a value."""
    return Option(names, is_flag=True, group=group, help=help, **more)


def json_option(what: str) -> Option:
    """The result as JSON."""
    return flag("--json", "as_json", group="Output",
                help=f"{what} as JSON on standard output, and nothing else.")  # fmt: skip


FORCE = flag("--force", "-f", group="Output", help="Replace existing files.")

# Looked up on the raw command line (see ``errors``).
DEBUG = flag("--debug", group="Messages", help="Show a traceback on an error.", expose_value=False)

VERBOSITY: list[click.Parameter] = [
    flag("--quiet", "-q", group="Messages", help="Print nothing but errors."),
    flag(
        "--verbose",
        "-v",
        group="Messages",
        help="Print more: every stage as it begins, and at the end where the time went.",
    ),
    DEBUG,
]

_READING = "Reading the log"
# How columns become roles: what every command that reads logs has.
READING: list[click.Parameter] = [
    assignment("--column", "ROLE=HEADER", "force='F [N]' (or force=#3)", parse_text,
               "The column of a role, by header or as #N, counted from 1. Default: the column "
               "named like the role. Some of several logs may lack the column of an optional "
               "role. Repeatable.", _READING),
    assignment("--unit", "ROLE=UNIT", "position=mm", parse_text,
               "Unit of a role; overrides that of the header. Without either, SI.", _READING),
    assignment("--scale", "ROLE=FACTOR", "torque=-1", parse_factor,
               "Factor for the raw column: a sensor gain, or -1 to reverse the sign.", _READING),
    parsed("--sample-time", "SECONDS", "0.001", parse_seconds,
           "Time from one sample to the next, for logs without a time column.", _READING),
    assignment("--step", "[LOG:]ROLE=FROM:TO[@T]", "command=0:2.5@0.1", parse_step,
               "For an input that was not recorded: constant at FROM, then constant at TO (in "
               "its --unit, or SI) from T seconds on (default 0). Of all logs, or of those whose "
               "name matches LOG, which goes before: --step 'a*.csv:command=0:5'.", _READING),
    Option(["--window", "--fit-window", "window"], group=_READING,
           type=Parsed("START:END", "--window 0.5:3", parse_window),
           help="Part of the log to use, in seconds; either side may be empty."),
    assignment("--hold", "ROLE=zoh|foh|smooth|auto", "force=foh", parse_hold,
               "How an input behaves between its samples: zoh is held, foh follows straight "
               "lines, smooth a smooth curve through the samples; auto chooses foh or smooth "
               "(zoh for a signal of two levels), and the file says which.", _READING),
    assignment("--unwrap", "ROLE=TURN|none", "angle=360", parse_turn,
               "What the column of an angle or a position begins again after, in its own numbers, "
               "or none. Default: found where it is certain.", _READING),
    Option(["--exclude"], metavar="[LOG:]PART", multiple=True, group=_READING,
           help="Leave out runs (2 or 2,5), time=3:3.5 (seconds) or lines=120:130 of the file, of "
           "all logs or of those whose name matches LOG (* stands for anything). Repeatable."),
    Option(["--exclude-rows"], metavar="[LOG:]ROWS", multiple=True, group=_READING,
           help="Leave out rows of the data, counted from 1: 7, or 120:130, or both with a comma. "
           "Repeatable."),
    Option(["--invalid"], type=click.Choice(["drop", "refuse"]), group=_READING,
           help="What becomes of rows with a missing or non-numeric cell in a column that is used: "
           "drop leaves them out, each a gap in time. Default: refuse."),
    Option(["--set"], metavar="[LOG:]ROLE=VALUE", multiple=True, group=_READING,
           help="A role that was constant, with its unit: --set 'a*.csv:position=25 %'. "
           "Repeatable."),
    assignment("--from-name", "ROLE=TEXT{UNIT}", "'position=kinked{%}'", parse_text,
               "A constant that stands in the name of the file; --set is for files whose name "
               "does not hold it.", _READING),
    parsed("--decimal", "SIGN", ",", parse_sign,
           "Decimal sign, where the log does not show which it is.", _READING),
    parsed("--thousands", "SIGN", "' '", parse_sign,
           "Sign between thousands, in quotes if it is a blank.", _READING),
    parsed("--delimiter", "SIGN", "';'", parse_sign,
           "What separates the columns: a sign, tab, or blank.", _READING),
    parsed("--skip-rows", "N", "3", parse_count, "Lines at the top that are not looked at.",
           _READING),
    parsed("--header-row", "N", "4", parse_count, "Line of the header, counted from 1.",
           _READING),
]  # fmt: skip
_LOGS = ("logs", "log", "validate")  # arguments and options that name logs
_WRITING = ("decimal", "thousands", "delimiter", "skip_rows", "header_row")


def read_logs(paths: Iterable[str], params: Mapping[str, Any]) -> list[Log]:
    """Read logs with the options of the command line."""
    from fluidact_fit.logs import StepInput, read_log

    by_role = {keyword: params.get(option) or {} for option, keyword in _ROLE_OPTIONS.items()}
    given: dict[str, Any] = {n: params.get(n) for n in ("sample_time", "window", "invalid")}
    given |= {name: params[name] for name in _WRITING if params[name] is not None}
    given |= {"from_name": params["from_name"], **by_role}
    paths = list(paths)
    given_logs = [*paths, *(p for name in _LOGS for p in _listed(params.get(name)))]
    known = [_names(p) for p in dict.fromkeys(given_logs)]
    exclude = _by_log("--exclude", split_runs(params["exclude"]), known)
    exclude += _by_log("--exclude-rows", split_rows(params["exclude_rows"]), known)
    constants = _by_log("--set", params["set"], known)
    steps = [(_matching("--step", *_split_part(key)[:2], known), key, StepInput(*step))
             for key, step in params["step"].items()]  # fmt: skip
    steps.sort(key=lambda given: given[0] != "*")  # what is of some logs goes before
    logs = []
    for path in paths:
        names = _names(path)
        values = {role: value for p, role, value in constants if filter_names(names, p)}
        parts = [f"{kind}={what}" for p, kind, what in exclude if filter_names(names, p)]
        own = {_split_part(key)[1]: s for p, key, s in steps if filter_names(names, p)}
        try:
            logs.append(read_log(path, constants=values, exclude=parts, steps=own, **given))
        except LogError:
            _refuse_own_file(path)
            raise
    return logs


def _refuse_own_file(path: str) -> None:
    """Name a file of this program that was given as a log."""
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


def read_params(path: str, logs: Sequence[str]) -> ParameterDocument:
    """Read the parameter file that stands before logs; one that stands among them is named."""
    from fluidact_fit.control import read_document

    try:
        return read_document(path)
    except ParameterFileError:
        for log in logs:
            try:
                read_document(log)
            except FluidactError:
                continue
            raise UsageError(
                f"{path} is not a parameter file, and {log} is one.",
                expected="Expected the parameter file first, then the logs.",
                remedy=f"Give {log} before {path}.",
            ) from None
        raise


def _names(path: str) -> list[str]:
    """What a pattern may mean a log by: its name, and those of the files merged in it."""
    from fluidact_fit.logs.source import files_of

    files = [file.name for file in files_of(Path(path))]
    return files if len(files) == 1 else ["+".join(files), *files]


def _listed(given: str | Iterable[str] | None) -> list[str]:
    return [given] if isinstance(given, str) else list(given or ())


def _by_log(
    option: str, given: Iterable[str], logs: Sequence[Sequence[str]]
) -> list[tuple[str, str, str]]:
    """Read ``[LOG:]NAME=VALUE``: pattern of the logs, name and value; some log has to match."""
    out = []
    for text in given:
        pattern, name, value = _split_part(text)
        if not name or value is None:
            raise UsageError(
                f"{option} {text!r} is not understood.",
                expected=f"Expected {option} [LOG:]NAME=VALUE.",
                remedy="See --help for examples.",
            )
        out.append((_matching(option, pattern, name, logs), name, value))
    return out


def _matching(option: str, pattern: str | None, name: str, logs: Sequence[Sequence[str]]) -> str:
    """The pattern of the logs that an option is of, every one without; some log has to match."""
    if pattern is not None and not any(filter_names(n, pattern) for n in logs):
        raise UsageError(
            f"{option} '{pattern}:{name}=...' names a log that is not given.",
            expected=f"The logs are: {', '.join(names[0] for names in logs)}.",
            remedy="Give the name of one of them, with * for any part of it.",
        )
    return "*" if pattern is None else pattern


def _split_part(text: str) -> tuple[str | None, str, str | None]:
    """Pattern, name and value of ``[LOG:]NAME=VALUE``; ``None`` for what is not there."""
    before, equals, value = text.partition("=")
    pattern, colon, name = before.rpartition(":")
    return pattern if colon else None, name.strip(), value if equals else None


def check_role_names(params: Mapping[str, Any], known: Iterable[str]) -> None:
    """Refuse roles that a family does not have, before any log is read."""
    known = list(known)
    for option in _ROLE_OPTIONS:
        check_names(f"--{option}", "role", params[option], known)
    check_names("--step", "role", [_split_part(key)[1] for key in params["step"]], known)
    check_names("--from-name", "role", params["from_name"], known)
    check_names("--set", "role", [_split_part(text)[1] for text in params["set"]], known)


def check_names(option: str, noun: str, given: Iterable[str], known: Iterable[str]) -> None:
    """Refuse names that do not exist, with the closest that does (``UsageError``)."""
    names = list(dict.fromkeys(known))
    for name in given:
        if name in names:
            continue
        close = closest(name, names)
        raise UsageError(
            f"{option} names the {noun} '{name}', which does not exist here.",
            expected=f"There {'is' if len(names) == 1 else 'are'}: {', '.join(names)}."
            if names
            else f"There is no such {noun}.",
            remedy=f"Did you mean '{close}'?" if close else f"Give {option} with one of them.",
        )
