"""``fluidact-fit simulate``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import click

from ..loop import simulate_closed_loop
from ..messages import echo_notices
from ..options import (
    FORCE,
    READING,
    VERBOSITY,
    Command,
    Option,
    assignment,
    json_option,
    parsed,
    read_logs,
    read_params,
)
from ..outputs import check_targets, write_all
from ..parse import parse_seconds, parse_step
from ..progress import Progress
from ..show import echo, echo_result, tell

if TYPE_CHECKING:
    from fluidact_fit.errors import Notice
    from fluidact_fit.outcome import Simulation
    from fluidact_fit.parameters import ParameterDocument

_OF_STEPS = ("unit", "sample_time")  # what --input takes of the options that read a log
_LOOP = "Closed loop"
_OF_LOOPS = ("reference", "draws", "seed", "accept_not_identified", "plot", "as_json")


@click.command(
    "simulate",
    cls=Command,
    params=[
        click.Argument(["params_file"], metavar="PARAMS"),
        click.Argument(["logs"], metavar="[LOG...|PARAMS...]", nargs=-1),
        Option(["--output", "-o"], metavar="FILE.csv", group="Output",
               help="CSV file; without it, or with -, the table goes to standard output."),
        FORCE,
        assignment("--input", "ROLE=FROM:TO[@T]", "command=0:2@0.1", parse_step,
                   "An input that steps from FROM to TO (in its --unit, or SI, or with a unit: "
                   "0:2V) at T seconds.", "Instead of a log"),
        parsed("--duration", "SECONDS", "2", parse_seconds,
               "How long to simulate (with --sample-time, or --controller).", "Instead of a log"),
        Option(["--controller"], metavar="FILE", group=_LOOP,
               help="A controller file: the machine of all PARAMS in closed loop."),
        Option(["--reference"], metavar="KIND|FILE.csv", group=_LOOP,
               help="step, triangle, sine, ramp-insertion (sizes in the controller file), or a "
               "CSV with the columns time and reference."),
        Option(["--draws"], type=click.IntRange(0, 10_000), metavar="N", group=_LOOP,
               help="Simulate N machines drawn from the covariances as well."),
        Option(["--seed"], type=click.IntRange(min=0), metavar="N", group=_LOOP,
               help="Seed of the draws (default 0)."),
        Option(["--accept-not-identified"], is_flag=True, group=_LOOP,
               help="Use parameters that the data could not determine, at the values of the file."),
        Option(["--plot"], metavar="FILE", group=_LOOP,
               help="Picture of the response (png, pdf, svg)."),
        json_option("Metrics of the closed loop"),
        *READING,
        *VERBOSITY,
    ],
)  # fmt: skip
def command(
    params_file: str, logs: tuple[str, ...], output: str | None, force: bool, **params: Any
) -> None:
    """Simulate the model in PARAMS with the inputs recorded in LOGs, or with --input steps.

    Writes CSV with time, inputs, the measured output where the log has one, and the simulated
    output, in SI. The columns of the log are those the file was fitted with, unless options say
    otherwise. Offset and initial state are fitted to the measured output where there is one; else
    the model starts from rest, with the file's offset. A column `used` is 0 for samples that the
    model does not claim to describe, where there are any.

    With --controller, several PARAMS make one machine, for example a ball screw and a hydrostatic
    line, which follows a --reference in closed loop; metrics and margins are printed, and -o takes
    the trajectories. With --draws the machine varies within the uncertainty of its parameters; the
    controller does not.

    \b
    Examples:
      fluidact-fit simulate valve.yaml trial1.csv -o simulated.csv
      fluidact-fit simulate valve.yaml --input command=0:2@0.1 --duration 1 --sample-time 0.001
      fluidact-fit simulate screw.yaml line.yaml --controller pd.yaml --reference step --draws 100
    """
    if params["controller"] is not None:
        simulate_closed_loop([params_file, *logs], output, force, params)
        return
    output = None if output == "-" else output
    from fluidact_fit.simulation import to_csv, variant_of

    document = read_params(params_file, logs)
    variant = variant_of(document)
    inputs = [r.name for r in variant.roles if r.name != "time" and not r.output]
    _check_source(logs, params, inputs[0])
    if output is not None:
        check_targets({"-o": output}, [params_file, *logs], force)
    runs = _with_logs(document, logs, params) if logs else _with_steps(document, params)
    text = to_csv(document, runs)
    if output is None:
        echo_result(text)
    else:
        write_all({output: text}, force)
    if not params["quiet"]:
        _show(runs, document.fit.rmse.unit, output)


def _show(runs: Sequence[Simulation], unit: str, output: str | None) -> None:
    """Agreement with each log, on standard error: the table may stand on standard output."""
    from fluidact_fit.tables import percent_text

    for run in runs:
        if run.agreement.samples:
            left = f", {run.left_out} samples left out" if run.left_out else ""
            tell(
                f"{run.experiment.name}: rmse {run.rmse:.6g} {unit}, fit "
                f"{percent_text(run.agreement.fit_percent)}{left}"
            )
    if output is not None:
        echo(f"written to {output}")


def _check_source(logs: Sequence[str], params: Mapping[str, Any], role: str) -> None:
    """Either a log, or everything that replaces one; ``role`` is an input, for an example."""
    for name in _OF_LOOPS:
        if params[name]:
            option = "--json" if name == "as_json" else f"--{name.replace('_', '-')}"
            raise click.UsageError(f"{option} is about a closed loop: give --controller as well.")
    example = f"for example --input {role}=0:2@0.1 --duration 1 --sample-time 0.001"
    if logs and (params["input"] or params["duration"] is not None):
        raise click.UsageError(
            "--input and --duration replace a LOG; give one or the other. Give a role that the log "
            "lacks with --step."
        )
    if not logs and not params["input"]:
        instead = "; --step is for what a LOG lacks" if params["step"] else ""
        raise click.UsageError(
            f"there is nothing to simulate: give a LOG, or steps, {example}{instead}."
        )
    of_logs = [option for option in READING if option.name not in _OF_STEPS]
    needless = [option for option in of_logs if not logs and params[str(option.name)]]
    if needless:
        raise click.UsageError(
            f"{needless[0].opts[0]} is about reading a LOG, and there is none. Leave it out; the "
            "steps of --input are in the --unit of their role."
        )
    if not logs and (params["duration"] is None or params["sample_time"] is None):
        raise click.UsageError(f"--input needs --duration and --sample-time, {example}.")


def _with_logs(
    document: ParameterDocument, paths: Sequence[str], params: Mapping[str, Any]
) -> list[Simulation]:
    from fluidact_fit.recall import recall_logs
    from fluidact_fit.simulation import prepare_logs, simulate_runs

    with Progress(params["quiet"], params["verbose"]) as progress:
        progress("reading")
        runs, notices = prepare_logs(
            document, recall_logs(document, read_logs(paths, params, document))
        )
        progress("simulating")
        simulated = simulate_runs(document, runs)
    _echo(document, notices, params)
    return simulated


def _with_steps(document: ParameterDocument, params: Mapping[str, Any]) -> list[Simulation]:
    from fluidact_fit.logs import StepInput
    from fluidact_fit.simulation import beyond_validity, simulate_steps

    steps = {role: StepInput(*step) for role, step in params["input"].items()}
    runs = simulate_steps(
        document, steps, params["unit"], params["duration"], params["sample_time"]
    )
    _echo(document, beyond_validity(document, [run.experiment for run in runs]), params)
    return runs


def _echo(
    document: ParameterDocument, notices: Sequence[Notice], params: Mapping[str, Any]
) -> None:
    """Warn of the file and of the inputs, unless asked to be quiet."""
    from fluidact_fit.presentation import weak_file

    if not params["quiet"]:
        echo_notices([*weak_file(document), *notices])
