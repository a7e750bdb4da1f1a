"""``fluidact-fit compare``."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from fluidact_fit.errors import UsageError
from fluidact_fit.families import family_names, get_family

from .. import options
from ..errors import Invocation
from ..show import echo, echo_json, echo_table, format_number

if TYPE_CHECKING:
    from fluidact_fit.comparison import Comparison, Recordings

_PARAMETERS = (".yaml", ".yml")


class _Compare(options.Command):
    """The command; with ``--structures`` it has the options of that family's fit as well."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Find the family first: it decides which options there are."""
        for word, after in zip(args, [*args[1:], ""]):
            option, equals, value = word.partition("=")
            if option == "--structures":
                ctx.meta[__name__] = value if equals else after
        return super().parse_args(ctx, args)

    def get_params(self, ctx: click.Context) -> list[click.Parameter]:
        """Options of the command, and of the family."""
        params, family = super().get_params(ctx), ctx.meta.get(__name__)
        if family not in family_names():
            return params
        from .compare_structures import family_params

        return [*params, *family_params(get_family(family))]


@click.command(
    "compare",
    cls=_Compare,
    params=[
        click.Argument(["files"], metavar="PARAMS...|LOGS...", nargs=-1, required=True),
        options.Option(["--structures"], type=click.Choice(family_names()), metavar="FAMILY",
                       group="Structures",
                       help="Fit the structures of a family to the LOGS and recommend one: first "
                       "or second order, with or without dead time, dead zone, Stribeck, ... Takes "
                       "the options of that fit, which --help lists after it."),
        options.json_option("The comparison"),
        *options.READING,
        *options.VERBOSITY,
    ],
)  # fmt: skip
@click.pass_context
def command(
    ctx: click.Context, /, files: tuple[str, ...], structures: str | None, as_json: bool,
    **params: Any,
) -> None:  # fmt: skip
    """Compare parameter files of one family, or logs, with the first of them; or structures.

    \b
    PARAMS (.yaml)  every parameter with its standard error, how many standard errors it differs
                    from that of the first file, and whether all of them together differ by more
                    than chance; files that were fitted to the same logs are named
    LOGS            columns, units, ranges and sampling, and where they differ
    --structures FAMILY LOGS
                    which terms of the family's equation the logs support, judged by logs that
                    were held out and by the Bayesian information criterion (BIC)

    A difference is a result: the exit status is 0. Whether a file still describes a machine is
    what `check PARAMS LOG` says.

    \b
    Examples:
      fluidact-fit compare before.yaml after.yaml
      fluidact-fit compare monday.csv tuesday.csv
      fluidact-fit compare --structures valve monday.csv tuesday.csv
    """
    if structures is not None:
        from .compare_structures import run

        run(structures, files, as_json, params, ctx.find_object(Invocation))
        return
    kinds = {Path(name).suffix.lower() in _PARAMETERS for name in files}
    if len(kinds) > 1:
        raise UsageError(
            "parameter files and logs cannot be compared with each other.",
            remedy="To see whether a file describes a log: fluidact-fit check PARAMS LOG.",
        )
    if kinds == {True}:
        _refuse_reading(params)
        documents = _documents(files)
        found, show = documents.to_dict(), partial(_show, documents)
    else:
        recordings = _recordings(files, params)
        found, show = recordings.to_dict(), partial(_show_recordings, recordings)
    if as_json:
        echo_json(found)
    elif not params["quiet"]:
        show()


def _refuse_reading(params: dict[str, Any]) -> None:
    """Options that say how logs are read mean nothing for parameter files."""
    for option in options.READING:
        if isinstance(option, click.Option) and params.get(option.name or "") not in (
            None, {}, (), 0, False, option.default,
        ):  # fmt: skip
            raise UsageError(
                f"{option.opts[0]} is about logs, and parameter files are compared.",
                remedy="Leave it out.",
            )


def _documents(files: tuple[str, ...]) -> Comparison:
    from fluidact_fit.comparison import compare_documents
    from fluidact_fit.families import get_family
    from fluidact_fit.parameters import read_document

    return compare_documents([(name, read_document(name, get_family)) for name in files])


def _recordings(files: tuple[str, ...], params: dict[str, Any]) -> Recordings:
    from fluidact_fit.comparison import compare_recordings

    return compare_recordings(list(zip(files, options.read_logs(files, params))))


def _show(found: Comparison) -> None:
    head = ["parameter", "unit"]
    for k, name in enumerate(found.files):
        head += [Path(name).stem, *(["differs by"] if k else [])]
    rows = []
    for p in found.parameters:
        row = [p.name, p.unit]
        for k, (value, error, status, z) in enumerate(
            zip(p.values, p.std_errors, p.statuses, p.deviations)
        ):
            row.append(_number(value, error, status))
            row += [("" if z is None else f"{z:+.1f} std errors")] if k else []
        rows.append(row)
    echo_table([head, *rows])
    echo()
    for t in found.together:
        echo(t.words)


def _number(value: float | None, error: float | None, status: str | None) -> str:
    if value is None:
        return "-"
    if status == "not_identified":
        return "not identified"
    text = format_number(value, error)
    return f"{text} ± {format_number(error, error)}" if error is not None else f"{text} {status}"


def _show_recordings(found: Recordings) -> None:
    from fluidact_fit.comparison import column_key

    head = ["", *(log["file"] for log in found.logs)]
    rows = [["rows", *(str(log["rows"]) for log in found.logs)]]
    steps = [(log["time"] or {}).get("sample_time") for log in found.logs]
    rows.append(["every", *("-" if not s else f"{s:g} s" for s in steps)])
    tables = [{column_key(c): c for c in log["columns"]} for log in found.logs]
    for key in dict.fromkeys(k for table in tables for k in table):
        rows.append([key, *(_range(table.get(key)) for table in tables)])
    echo_table([head, *rows])
    echo()
    for finding in found.findings or ["nothing differs in columns, units, ranges and sampling"]:
        echo(finding)


def _range(column: dict[str, Any] | None) -> str:
    if column is None:
        return "-"
    if column["low"] is None:
        return "no numbers"
    return f"{column['low']:.5g} … {column['high']:.5g} {column['unit'] or ''}".rstrip()
