"""Options that several commands share, and how they reach the log reader."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import click

from fluidact_fit.errors import FluidactError, ParameterFileError, UsageError
from fluidact_fit.families import family_names

from .errors import Invocation
from .help_width import FittingHelp
from .parse import (
    Parsed,
    assigned,
    collect,
    parse_count,
    parse_factor,
    parse_family,
    parse_hold,
    parse_seconds,
    parse_sign,
    parse_step,
    parse_text,
    parse_turn,
    parse_window,
)

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

    from fluidact_fit.logs import Log
    from fluidact_fit.parameters import ParameterDocument

_ROLE_OPTIONS = {
    "column": "columns",
    "unit": "units",
    "scale": "scales",
    "hold": "holds",
    "unwrap": "unwrap",
}


# Options of a fit and of reading a log that only --help-all shows: most logs need none of them.
_RARE = {
    "details", "as_json", "controller_sample_time", "scale", "sample_time", "step", "hold",
    "unwrap", "exclude", "exclude_rows", "invalid", "set", "from_name", "decimal", "thousands",
    "delimiter", "skip_rows", "header_row", "start", "bounds", "noise", "validate_window",
    "accept_failed", "seed", "debug",
}  # fmt: skip
_ALL = "fluidact_fit_cli.help_all"


class Option(click.Option):
    """An option that stands under a heading of the help."""

    def __init__(self, *args: Any, group: str = "Options", **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.group = group

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem[str]]:
        """Complete the value."""
        from .completion import values_of

        found = values_of(self.name or "", ctx, incomplete)
        return found or super().shell_complete(ctx, incomplete)


class Command(FittingHelp):
    """A command whose help lists the options under headings.

    One that reads logs shows the common ones with --help, and every one with --help-all.
    """

    def __init__(self, name: str | None, *, params: list[click.Parameter], **kwargs: Any) -> None:
        self.is_short = any(param.name == "column" for param in params)
        every = [*params, _help_all()] if self.is_short else params
        super().__init__(name, params=every, **kwargs)

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Refuse an option that is given twice and holds one value: which one is meant?"""
        if not ctx.resilient_parsing:
            _, _, given = self.make_parser(ctx).parse_args(list(args))
            for param in dict.fromkeys(given):
                single = isinstance(param, click.Option) and not (
                    param.multiple or param.is_flag or param.count
                )
                if single and given.count(param) > 1:
                    words = [word.partition("=")[0] for word in args]
                    said = next((w for w in words if w in param.opts), param.opts[0])
                    raise click.UsageError(f"{said} was given twice. Keep one of them.", ctx)
        return super().parse_args(ctx, args)

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write one section per heading, in the order of the options."""
        shown = [p for p in self.get_params(ctx) if not isinstance(p, click.Argument)]
        if self.is_short and not ctx.meta.get(_ALL):
            shown = [p for p in shown if p.name not in _RARE]
        groups: dict[str, list[tuple[str, str]]] = {}
        for param in shown:
            record = param.get_help_record(ctx)
            if record is not None:
                groups.setdefault(getattr(param, "group", "Messages"), []).append(record)
        for title, records in groups.items():
            with formatter.section(title):
                formatter.write_dl(records)

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Say where the other options are."""
        super().format_epilog(ctx, formatter)
        if self.is_short and not ctx.meta.get(_ALL):
            rare = [param.opts[0] for param in self.get_params(ctx) if param.name in _RARE]
            formatter.write_paragraph()
            text = f"More, see {ctx.command_path} --help-all: {', '.join(rare)}"
            lines = textwrap.wrap(text, formatter.width, break_on_hyphens=False)
            formatter.write("\n".join(lines) + "\n")


def _help_all() -> click.Option:
    def show(ctx: click.Context, param: click.Parameter, value: bool) -> None:
        if value and not ctx.resilient_parsing:
            ctx.meta[_ALL] = True
            click.echo(ctx.get_help(), color=ctx.color)
            ctx.exit()

    return Option(["--help-all"], is_flag=True, is_eager=True, expose_value=False, callback=show,
                  group="Messages", help="Show all options and exit.")  # fmt: skip


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


def family_option(help_text: str, group: str) -> Option:
    """A model family."""
    kind = Parsed("FAMILY", "--family valve", parse_family, f"one of {', '.join(family_names())}")
    return Option(["--family"], type=kind, help=help_text, group=group)


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
        help="Print more: every stage as it begins, every log, and how long each stage took.",
    ),
    DEBUG,
]

_READING = "Reading the log"
# How columns become roles: what every command that reads logs has.
READING: list[click.Parameter] = [
    assignment("--column", "ROLE=HEADER", "force='F [N]' (or force=#3)", parse_text,
               "Column of a role, by header or by number (#1 is the first). Default: the "
               "column named like the role. Repeatable. Of several logs, some may lack the column "
               "of an optional role.", _READING),
    assignment("--unit", "ROLE=UNIT", "position=mm", parse_text,
               "Unit of a role; overrides that of the header. Without either, SI.", _READING),
    assignment("--scale", "ROLE=FACTOR", "torque=-1", parse_factor,
               "Factor for the raw column: a sensor gain, or -1 to reverse the sign.", _READING),
    parsed("--sample-time", "SECONDS", "0.001", parse_seconds,
           "Time from one sample to the next, for logs without a time column.", _READING),
    assignment("--step", "[LOG:]ROLE=FROM:TO[@T]", "command=0:2.5@0.1", parse_step,
               "For an input that was not recorded: constant at FROM, then constant at TO (in "
               "its --unit, or SI, or with a unit: 0:2.5V) from T seconds on (default 0). LOG "
               "limits it to logs whose name matches: --step 'a*.csv:command=0:5'.", _READING),
    Option(["--window", "--fit-window", "window"], group=_READING,
           type=Parsed("START:END", "--window 0.5:3", parse_window),
           help="Part of the log to use, in seconds or with a unit (1:5min); either side may be "
           "empty."),
    assignment("--hold", "ROLE=zoh|foh|smooth|auto", "force=foh", parse_hold,
               "How an input moves between its samples: zoh (held), foh (straight lines) or "
               "smooth (a smooth curve); auto chooses foh or smooth (zoh for a signal with two "
               "levels), and the file says which.", _READING),
    assignment("--unwrap", "ROLE=TURN|none", "angle=360", parse_turn,
               "Where an angle or a position wraps around, in the numbers of its column, or "
               "none. Default: detected where it is certain.", _READING),
    Option(["--exclude"], metavar="[LOG:]PART", multiple=True, group=_READING,
           help="Leave out runs (2 or 2,5), seconds (time=3:3.5) or lines of the file "
           "(lines=120:130), in all logs or in those whose name matches LOG (* matches anything). "
           "Repeatable."),
    Option(["--exclude-rows"], metavar="[LOG:]ROWS", multiple=True, group=_READING,
           help="Leave out rows of the data, counted from 1: 7, 120:130, or several with commas. "
           "Repeatable."),
    Option(["--invalid"], type=click.Choice(["drop", "refuse"]), group=_READING,
           help="Rows with a missing or non-numeric cell in a column that is used: drop leaves "
           "them out, each a gap in time. Default: refuse the log."),
    Option(["--set"], metavar="[LOG:]ROLE=VALUE", multiple=True, group=_READING,
           help="A role that was constant, with its unit: --set 'a*.csv:position=25 %'. "
           "Repeatable."),
    assignment("--from-name", "ROLE=TEXT{UNIT}", "'position=kinked{%}'", parse_text,
               "A constant that is part of the file name; use --set where it is not.", _READING),
    parsed("--decimal", "SIGN", ",", parse_sign,
           "Decimal separator, where the log is ambiguous.", _READING),
    parsed("--thousands", "SIGN", "' '", parse_sign,
           "Thousands separator, in quotes if it is a space.", _READING),
    parsed("--delimiter", "SIGN", "';'", parse_sign,
           "Column separator: a character, tab, or blank.", _READING),
    parsed("--skip-rows", "N", "3", parse_count, "Lines to skip at the top.",
           _READING),
    parsed("--header-row", "N", "4", parse_count, "Line of the header, counted from 1.",
           _READING),
]  # fmt: skip
_LOGS = ("logs", "log", "validate")  # arguments and options that name logs
_WRITING = ("decimal", "thousands", "delimiter", "skip_rows", "header_row")


def read_logs(
    paths: Iterable[str], params: Mapping[str, Any], document: ParameterDocument | None = None
) -> list[Log]:
    """Read logs with the options of the command line, or else as those of a file were written."""
    from fluidact_fit.logs import open_logs

    paths = list(paths)
    others = dict.fromkeys(p for name in _LOGS for p in _listed(params.get(name)))
    beside = [path for path in others if path not in paths]
    if document is not None:
        from fluidact_fit.recall import open_as_fitted

        return open_as_fitted(document, paths, beside=beside, **reading(params))
    return open_logs(paths, beside=beside, **reading(params))


def typed_words(invocation: Invocation, command: str, dropped: Mapping[str, bool]) -> list[str]:
    """Words that were typed behind a command, without some of its options.

    ``dropped`` are those, and whether a value follows them.
    """
    given = list(invocation.args)
    given = given[given.index(command) + 1 :]
    kept = []
    while given:
        word = given.pop(0)
        option, equals, _ = word.partition("=")
        if option not in dropped:
            kept.append(word)
        elif dropped[option] and not equals:
            del given[:1]
    return kept


def reading(params: Mapping[str, Any]) -> dict[str, Any]:
    """The options that read logs, as keywords of the library (:class:`.logs.Reading`)."""
    from fluidact_fit.logs import StepInput

    by_role = {keyword: params.get(option) or {} for option, keyword in _ROLE_OPTIONS.items()}
    given: dict[str, Any] = {n: params.get(n) for n in ("sample_time", "window", "invalid")}
    given |= {name: params[name] for name in _WRITING if params[name] is not None}
    given |= {name: params[name] for name in ("exclude", "exclude_rows", "set")}
    given["steps"] = {role: StepInput(*step) for role, step in params["step"].items()}
    return {**given, "from_name": params["from_name"], **by_role}


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


def _listed(given: str | Iterable[str] | None) -> list[str]:
    return [given] if isinstance(given, str) else list(given or ())
