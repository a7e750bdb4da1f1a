"""``fluidact-fit simulate``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import click

from ..options import (
    Command,
    Option,
    check_names,
    check_role_names,
    read_logs,
    reading_options,
    verbosity_options,
)
from ..outputs import Target, check_targets, write_all
from ..parse import Assigned, Parsed, collect, parse_positive, parse_step
from ..show import echo_warnings

if TYPE_CHECKING:
    from fluidact_fit.parameters import ParameterDocument
    from fluidact_fit.result import Simulation

_HELP = """Simulate the model in PARAMS with the inputs recorded in LOG, or with --input steps.

Writes CSV with time, inputs, the measured output where the log has one, and the simulated output,
in SI. The columns of the log are those the file was fitted with, unless options say otherwise.
Offset and initial state are fitted to the measured output where there is one, else zero.

\b
Examples:
  fluidact-fit simulate valve.yaml trial1.csv -o simulated.csv
  fluidact-fit simulate valve.yaml --input command=0:2@0.1 --duration 1 --sample-time 0.001"""


def simulate(
    params_file: str, log: str | None, output: str | None, force: bool, **params: Any
) -> None:
    """Simulate and write CSV."""
    from fluidact_fit.check import roles_of, to_csv
    from fluidact_fit.parameters import read_document

    _check_source(log, params)
    if output is not None:
        read = [params_file, *([log] if log else [])]
        check_targets([Target("-o", output)], read, force)
    document = read_document(params_file)
    roles = roles_of(document)
    check_role_names(params, roles)
    check_names("--input", "role", params["input"], roles)
    runs = _with_log(document, log, params) if log else _with_steps(document, params)
    text = to_csv(document, runs)
    if output is None:
        click.echo(text, nl=False)
        return
    write_all({output: text}, force)
    if not params["quiet"]:
        click.echo(f"written to {output}")


def _check_source(log: str | None, params: Mapping[str, Any]) -> None:
    """Either a log, or everything that stands for one."""
    example = "for example --input command=0:2@0.1 --duration 1 --sample-time 0.001"
    if log is not None and (params["input"] or params["duration"] is not None):
        raise click.UsageError(
            "--input and --duration stand for a LOG; give one or the other. A role that the log "
            "lacks is given with --step."
        )
    if log is None and not params["input"]:
        raise click.UsageError(f"there is nothing to simulate: give a LOG, or steps, {example}.")
    if log is None and (params["duration"] is None or params["sample_time"] is None):
        raise click.UsageError(f"--input needs --duration and --sample-time, {example}.")


def _with_log(
    document: ParameterDocument, path: str, params: Mapping[str, Any]
) -> list[Simulation]:
    from fluidact_fit.check import recall_columns, simulate_log

    (log,) = read_logs([path], params)
    runs, notices = simulate_log(document, recall_columns(document, log))
    if not params["quiet"]:
        echo_warnings(notices)
    return runs


def _with_steps(document: ParameterDocument, params: Mapping[str, Any]) -> list[Simulation]:
    from fluidact_fit.check import simulate_steps
    from fluidact_fit.logs import StepInput

    steps = {role: StepInput(*step) for role, step in params["input"].items()}
    return simulate_steps(
        document, steps, params["unit"], params["duration"], params["sample_time"]
    )


command = Command(
    "simulate",
    params=[
        click.Argument(["params_file"], metavar="PARAMS"),
        click.Argument(["log"], metavar="[LOG]", required=False),
        Option(["--output", "-o"], metavar="FILE.csv", group="Output",
               help="CSV file; without it the table goes to standard output."),
        Option(["--force", "-f"], is_flag=True, group="Output", help="Replace existing files."),
        Option(["--input"], type=Assigned("ROLE=FROM:TO[@T]", "--input command=0:2@0.1",
               parse_step), multiple=True, callback=collect, group="Instead of a log",
               help="An input that steps from FROM to TO (in its --unit, or SI) at T seconds."),
        Option(["--duration"], type=Parsed("SECONDS", "--duration 2", parse_positive),
               group="Instead of a log", help="How long to simulate (with --sample-time)."),
        *reading_options(),
        *verbosity_options(),
    ],
    callback=simulate,
    help=_HELP,
)  # fmt: skip
