"""Options that several commands share, and how they reach the log reader."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any

import click

from fluidact_fit.errors import UsageError

from .parse import (
    Assigned,
    Parsed,
    collect,
    parse_factor,
    parse_hold,
    parse_number,
    parse_positive,
    parse_range,
    parse_step,
    parse_text,
    parse_window,
)

if TYPE_CHECKING:
    from fluidact_fit.logs import Log

_ROLE_OPTIONS = {
    "column": "columns",
    "unit": "units",
    "scale": "scales",
    "step": "steps",
    "hold": "holds",
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


def _assignment(
    option: str, form: str, example: str, parse: Callable[[str], Any], help_text: str, group: str
) -> Option:
    kind = Assigned(form, f"{option} {example}", parse)
    return Option([option], type=kind, multiple=True, callback=collect, help=help_text, group=group)


def logs_argument() -> click.Argument:
    """One or several logs."""
    return click.Argument(["logs"], metavar="LOG...", nargs=-1, required=True)


def reading_options() -> list[click.Parameter]:
    """How columns become roles: what every command that reads logs has."""
    group = "Reading the log"
    seconds = Parsed("SECONDS", "--sample-time 0.001", parse_positive)
    return [
        _assignment("--column", "ROLE=HEADER", "force='F [N]' (or force=#3)", parse_text,
                    "The column of a role, by header or as #N, counted from 1. Default: the column "
                    "named like the role. Some of several logs may lack the column of an optional "
                    "role. Repeatable.", group),
        _assignment("--unit", "ROLE=UNIT", "position=mm", parse_text,
                    "Unit of a role; overrides that of the header. Without either, SI.", group),
        _assignment("--scale", "ROLE=FACTOR", "torque=-1", parse_factor,
                    "Factor for the raw column: a sensor gain, or -1 to reverse the sign.", group),
        Option(["--sample-time"], type=seconds, group=group,
               help="Time from one sample to the next, for logs without a time column."),
        _assignment("--step", "ROLE=FROM:TO[@T]", "command=0:2.5@0.1", parse_step,
                    "For an input that was not recorded: constant at FROM, then constant at TO (in "
                    "its --unit, or SI) from T seconds on (default 0).", group),
        Option(["--window"], type=Parsed("START:END", "--window 0.5:3", parse_window), group=group,
               help="Part of the log to use, in seconds; either side may be empty."),
        hold_option(group),
    ]  # fmt: skip


def hold_option(group: str) -> Option:
    """How inputs move between samples."""
    return _assignment(
        "--hold", "ROLE=zoh|foh|smooth|auto", "force=foh", parse_hold,
        "How an input behaves between its samples: zoh is held, foh follows straight lines, "
        "smooth a smooth curve through the samples; auto chooses foh or smooth (zoh for a signal "
        "of two levels), and the file says which.",
        group,
    )  # fmt: skip


def parameter_options() -> list[click.Parameter]:
    """What is known of the parameters beforehand."""
    group = "Parameters"
    return [
        _assignment("--fix", "NAME=VALUE", "dead_time=0", parse_number,
                    "Hold a parameter at a value (SI).", group),
        _assignment("--start", "NAME=VALUE", "mass=50", parse_number,
                    "Where the search begins (SI).", group),
        _assignment("--bounds", "NAME=LOW:HIGH", "damping_ratio=0.1:2", parse_range,
                    "Range of a parameter (SI).", group),
    ]  # fmt: skip


def verbosity_options() -> list[click.Parameter]:
    """How much is printed."""
    group = "Messages"
    return [
        Option(["--quiet", "-q"], is_flag=True, group=group, help="Print nothing but errors."),
        Option(["--verbose", "-v"], is_flag=True, group=group, help="Print more."),
        debug_option(),
    ]


def debug_option() -> click.Parameter:
    """Traceback on an error; looked up on the raw command line (see ``errors``)."""
    return Option(["--debug"], is_flag=True, expose_value=False, group="Messages",
                  help="Show a traceback on an error.")  # fmt: skip


def json_option(what: str) -> click.Parameter:
    """The result as JSON."""
    return Option(["--json", "as_json"], is_flag=True, group="Output",
                  help=f"{what} as JSON on standard output, and nothing else.")  # fmt: skip


def reading_arguments(params: Mapping[str, Any]) -> dict[str, Any]:
    """Return the keyword arguments of ``read_log`` that the options give."""
    from fluidact_fit.logs import StepInput

    found = {name: dict(params.get(key) or {}) for key, name in _ROLE_OPTIONS.items()}
    found["steps"] = {role: StepInput(*step) for role, step in found["steps"].items()}
    return {
        **found,
        "sample_time": params.get("sample_time"),
        "window": params.get("window"),
    }


def read_logs(paths: Iterable[str], params: Mapping[str, Any]) -> list[Log]:
    """Read logs with the options of the command line."""
    from fluidact_fit.logs import read_log

    arguments = reading_arguments(params)
    return [read_log(path, **arguments) for path in paths]


def check_role_names(params: Mapping[str, Any], known: Iterable[str]) -> None:
    """Refuse roles that a family does not have, before any log is read.

    Raises
    ------
    UsageError
        With the closest name and those there are.
    """
    for option in _ROLE_OPTIONS:
        check_names(f"--{option}", "role", params.get(option) or {}, known)


def check_names(option: str, noun: str, given: Iterable[str], known: Iterable[str]) -> None:
    """Refuse names that do not exist, with the closest that does.

    Raises
    ------
    UsageError
        With the closest name and those there are.
    """
    names = list(dict.fromkeys(known))
    for name in given:
        if name in names:
            continue
        close = get_close_matches(name, names, 1)
        raise UsageError(
            f"{option} names the {noun} '{name}', which does not exist here.",
            expected=f"There {'is' if len(names) == 1 else 'are'}: {', '.join(names)}."
            if names
            else f"There is no such {noun}.",
            remedy=f"Did you mean '{close[0]}'?" if close else f"Give {option} with one of them.",
        )
