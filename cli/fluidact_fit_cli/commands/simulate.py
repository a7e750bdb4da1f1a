"""``fluidact-fit simulate``."""

from __future__ import annotations

from typing import Any

import click

from ..options import (
    Command,
    Option,
    check_role_names,
    read_logs,
    reading_options,
    verbosity_options,
)
from ..outputs import Target, check_targets, write_all
from ..show import echo_warnings

_HELP = """Simulate the model in PARAMS with the inputs recorded in LOG.

Writes CSV with time, inputs, the measured output where the log has one, and the simulated output,
in SI. The columns of the log are those the file was fitted with, unless options say otherwise.
Offset and initial state are fitted to the measured output where there is one, else zero."""


def simulate(params_file: str, log: str, output: str | None, force: bool, **params: Any) -> None:
    """Simulate and write CSV."""
    from fluidact_fit.check import recall_columns, roles_of, simulate_log, to_csv
    from fluidact_fit.parameters import read_document

    if output is not None:
        target = Target("-o", output)
        check_targets([target], [params_file, log], force)
    document = read_document(params_file)
    check_role_names(params, roles_of(document))
    (read,) = read_logs([log], params)
    runs, notices = simulate_log(document, recall_columns(document, read))
    if not params["quiet"]:
        echo_warnings(notices)
    text = to_csv(document, runs)
    if output is None:
        click.echo(text, nl=False)
        return
    write_all({output: text}, force)
    if not params["quiet"]:
        click.echo(f"written to {output}")


command = Command(
    "simulate",
    params=[
        click.Argument(["params_file"], metavar="PARAMS"),
        click.Argument(["log"], metavar="LOG"),
        Option(["--output", "-o"], metavar="FILE.csv", group="Output",
               help="CSV file; without it the table goes to standard output."),
        Option(["--force", "-f"], is_flag=True, group="Output", help="Replace existing files."),
        *reading_options(),
        *verbosity_options(),
    ],
    callback=simulate,
    help=_HELP,
)  # fmt: skip
