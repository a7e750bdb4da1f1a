"""``fluidact-fit FAMILY LOG...``: one subcommand per model family."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from fluidact_fit.errors import (
    FluidactError,
    LogError,
    MissingColumnError,
    NotIdentifiedError,
    UsageError,
)
from fluidact_fit.families import get_family
from fluidact_fit.files import shell_command
from fluidact_fit.units.quantities import parse_quantity

from ..errors import Invocation
from ..family_help import chosen_options, family_options, help_text
from ..messages import echo_notices
from ..options import (
    FORCE,
    READING,
    VERBOSITY,
    Command,
    Option,
    assignment,
    flag,
    parsed,
    read_logs,
    reading,
)
from ..outputs import check_places, refuse_existing, refuse_twice, write_all
from ..parameter_table import echo_parameters
from ..parse import parse_quantities, parse_seconds, parse_window
from ..progress import Progress
from ..recorded import recorded_command
from ..show import echo_json, echo_text, json_text

if TYPE_CHECKING:
    from fluidact_fit.family import Family, FamilyOptions
    from fluidact_fit.logs import Log
    from fluidact_fit.result import FitResult

_JUDGED = "Validation and verdict"
_JUDGING: list[click.Parameter] = [
    Option(["--validate"], metavar="LOG", multiple=True, group=_JUDGED,
           help="A log to validate the result with; it is not fitted. Repeatable."),
    parsed("--validate-window", "START:END", "20:", parse_window,
           "Validate with these seconds of the logs of --validate, or of the logs that are "
           "fitted (--window then has to leave them out).", _JUDGED),
    flag("--strict", group=_JUDGED,
         help="Any warning or note ends the run with exit status 4; nothing is written."),
    flag("--accept-failed", group=_JUDGED,
         help="Write the file even if the verdict is FAIL; the file says so."),
    Option(["--seed"], type=click.IntRange(0, 2**32 - 1), default=0, metavar="N", group=_JUDGED,
           help="Seed of the random numbers. The same logs, options and seed give the same "
           "result. Default: 0."),
]  # fmt: skip

_STAGES = ("reading", "fitting", "examining the fit", "validating", "writing")
# Suffixes of what a fit reads, or writes elsewhere.
_OTHERS = (
    ".json", ".csv", ".tsv", ".xlsx", ".parquet", ".mat", ".h5", ".hdf5", ".tdms", ".mf4", ".png",
    ".pdf", ".svg", ".html", ".htm",
)  # fmt: skip

# What is known of the parameters beforehand.
PARAMETERS: list[click.Parameter] = [
    assignment("--fix", "NAME=VALUE", "'dead_time=12 ms'", parse_quantity,
               "Hold a parameter at a value, in SI or with its unit.", "Parameters"),
    assignment("--start", "NAME=VALUE", "mass=50", parse_quantity,
               "Starting value of the search, in SI or with its unit.", "Parameters"),
    assignment("--bounds", "NAME=LOW:HIGH", "damping_ratio=0.1:2", parse_quantities,
               "Range of a parameter, in SI or with its unit.", "Parameters"),
    assignment("--noise", "ROLE=SD", "force=0.1", parse_quantity,
               "Standard deviation of white noise on a measured input, in SI or with its unit; "
               "0 for an exact one. Default: estimated from the log.", "Parameters"),
]  # fmt: skip


def make_command(name: str) -> click.Command:
    """Return the subcommand of a family."""
    family = get_family(name)

    @click.pass_context
    def fit_family(ctx: click.Context, /, **params: Any) -> None:
        run_fit(family, params, ctx.find_object(Invocation) or Invocation(()))

    return Command(
        name,
        params=[
            click.Argument(["logs"], metavar="LOG...", nargs=-1, required=True),
            *output_options(name),
            *READING,
            *family_options(family),
            *PARAMETERS,
            *_JUDGING,
            *VERBOSITY,
        ],
        callback=fit_family,
        help=help_text(family),
        short_help=family.title,
    )


def output_options(name: str) -> list[click.Parameter]:
    """Outputs of a fit, and their destinations."""
    group = "Output"
    return [
        Option(["--output", "-o"], metavar="FILE", group=group,
               help=f"Parameter file (default {name}.yaml). An existing file is kept unless -f."),
        FORCE,
        Option(["--plot"], metavar="FILE", group=group,
               help="Picture of measured and simulated output: png, pdf or svg."),
        Option(["--report"], metavar="FILE.html", group=group, help="Report as a web page."),
        Option(["--details"], metavar="FILE.json", group=group,
               help="All details of the fit and its examination as JSON; the parameter file "
               "keeps the one-line ones."),
        flag("--json", "as_json", group=group,
             help="The parameter document as JSON on standard output, and nothing else. A file "
             "is then written only if -o names one."),
        parsed("--controller-sample-time", "SECONDS", "0.002", parse_seconds,
               "Sample time of the discrete model in the file (default: the log's).", group),
    ]  # fmt: skip


def run_fit(
    family: Family[FamilyOptions], params: Mapping[str, Any], invocation: Invocation
) -> None:
    """Check what was asked, fit, judge, write, show: in this order."""
    targets = targets_of(family.name, params)
    _check_files(params, targets)
    _refuse_existing(family, params, targets)
    validated = params["validate"] or params["validate_window"] is not None
    stages = [stage for stage in _STAGES if stage != "validating" or validated]
    with Progress(params["quiet"], params["verbose"], stages=stages) as progress:
        result = _fit(family, params, invocation, progress)
        result = replace(result, document=result.document_to_write(params["accept_failed"]))
        progress("writing")
        contents = render_files(result, targets)
    write_result(result, contents, params)


def write_result(
    result: FitResult, contents: Mapping[str, bytes | str], params: Mapping[str, Any]
) -> None:
    """Write the files of a fit; print its numbers, the names of its files, and its warnings."""
    write_all(contents, params["force"])
    if params["as_json"]:
        echo_json(result.document.to_dict())
    elif not params["quiet"]:
        echo_parameters(result.document, params["verbose"])
        echo_text("written to " + ", ".join(contents))
    if not params["quiet"]:
        echo_notices(result.notices)


def targets_of(name: str, params: Mapping[str, Any]) -> dict[str, str]:
    """Return the files to write, by option; the parameter file is the last."""
    output = params["output"]
    if output is None and not params["as_json"]:
        output = f"{name}.yaml"
    asked = {f"--{name}": params[name] for name in ("plot", "report", "details")} | {"-o": output}
    return {option: path for option, path in asked.items() if path is not None}


def _check_files(params: Mapping[str, Any], targets: Mapping[str, str]) -> None:
    """Refuse logs and outputs that cannot be, before any log is read."""
    logs = (*params["logs"], *params["validate"])
    refuse_twice(logs, "Give each log once; a log for --validate must not be fitted as well.")
    check_places(targets, logs)
    _check_suffix(targets.get("-o", ""))


def _refuse_existing(
    family: Family[FamilyOptions], params: Mapping[str, Any], targets: Mapping[str, str]
) -> None:
    """Refuse to replace files; a mistake in a log comes first, and both are told at once."""
    try:
        refuse_existing(targets, params["force"])
    except UsageError as taken:
        try:
            _check_logs(family, params)
        except LogError as error:
            raise LogError(
                error.what, where=error.where, expected=error.expected,
                remedy="\n".join(filter(None, (error.remedy, f"Besides, {taken.text}"))),
            ) from error  # fmt: skip
        raise


def _check_logs(family: Family[FamilyOptions], params: Mapping[str, Any]) -> None:
    """Raise what is wrong with the logs, short of a fit."""
    from fluidact_fit.logs import choose_variant, experiments

    for log in read_logs((*params["logs"], *params["validate"]), params):
        experiments(log, choose_variant(log, family.variants))


def _check_suffix(path: str) -> None:
    """Refuse a name that promises another kind of file than the YAML that is written."""
    suffix = Path(path).suffix.lower()
    if suffix in _OTHERS:
        json = suffix == ".json"
        raise UsageError(
            f"-o {path}: a parameter file is YAML.",
            expected="Expected a name such as " + str(Path(path).with_suffix(".yaml")) + ".",
            remedy="For JSON, give --json and redirect standard output, or export --to json."
            if json else "--plot writes pictures, --report a page.",
        )  # fmt: skip


def _fit(
    family: Family[FamilyOptions],
    params: Mapping[str, Any],
    invocation: Invocation,
    progress: Progress,
) -> FitResult:
    from fluidact_fit.fitting import fit

    try:
        progress("reading")
        part = params["validate_window"] or (params["window"] if params["validate"] else None)
        return fit(
            family.name,
            list(params["logs"]),
            **reading(params),
            fixed=params["fix"],
            start=params["start"],
            bounds=params["bounds"],
            noise=params["noise"],
            validate=list(params["validate"]),
            validate_window=part,
            controller_sample_time=params["controller_sample_time"],
            strict=params["strict"],
            seed=params["seed"],
            command=recorded_command(invocation.args, params),
            progress=progress,
            **chosen_options(params),
        )
    except MissingColumnError as error:
        remedy = "\n".join(filter(None, (_propose_columns(family.name, error.log), error.remedy)))
        raise LogError(
            error.what, where=error.where, expected=error.expected, remedy=remedy
        ) from error
    except (LogError, NotIdentifiedError) as error:
        if error.where:
            raise
        names = ", ".join(os.path.basename(path) for path in params["logs"])
        raise type(error)(
            error.what, where=names, expected=error.expected, remedy=error.remedy
        ) from error


def _propose_columns(family: str, log: Log) -> str:
    """The options that say which columns the roles are, where units and names leave no doubt."""
    from fluidact_fit.advice import column_options, suggest

    try:
        found = suggest([log], [log.name], family, trial=False)
    except FluidactError:
        return ""  # that a column is missing is what has to be said
    if not found or found[0].unsure or found[0].basis:
        return ""
    words = column_options(found[0], [log])
    return f"Did you mean {shell_command(words)}?" if words else ""


def render_files(result: FitResult, targets: Mapping[str, str]) -> dict[str, bytes | str]:
    """Return the content of every file."""
    from fluidact_fit.parameters import dump_document
    from fluidact_fit.report import plot_result, render, result_page

    contents: dict[str, bytes | str] = {}
    for option, path in targets.items():
        if option == "--plot":
            contents[path] = render(plot_result(result), Path(path).suffix.lower()[1:])
        elif option == "--report":
            contents[path] = result_page(result)
        elif option == "--details":
            contents[path] = json_text(result.document.fit.details or {})
        else:
            contents[path] = dump_document(result.document)
    return contents
