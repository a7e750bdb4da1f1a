"""``fluidact-fit design``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from fluidact_fit.errors import UsageError
from fluidact_fit.families import family_names, get_family
from fluidact_fit.units.quantities import parse_quantity

from ..options import FORCE, VERBOSITY, Command, Option, json_option, parsed
from ..outputs import check_targets, write_all
from ..parse import parse_quantities, parse_seconds
from ..progress import Progress
from ..show import echo, echo_json, show

if TYPE_CHECKING:
    from fluidact_fit.excitation import Design

_LIMITS = "Limits (in SI, or with a unit: 0:50mm)"


@click.command(
    "design",
    cls=Command,
    params=[
        click.Argument(["family"], metavar="FAMILY|PARAMS"),
        Option(["--from", "params_file"], metavar="PARAMS", group="Input",
               help="The parameter file of the present fit, behind FAMILY."),
        parsed("--amplitude", "LOW:HIGH", "-12:12V", parse_quantities,
               "Range of the driving role (default: the file's validity).", _LIMITS),
        parsed("--rate", "NUMBER", "100", parse_quantity,
               "Largest slope of the driving role, per second (default: no limit).", _LIMITS),
        parsed("--stroke", "LOW:HIGH", "0:50mm", parse_quantities,
               "Range of the output (default: the file's validity).", _LIMITS),
        parsed("--duration", "SECONDS", "10", parse_seconds,
               "Duration (default: that of the longest log of the file).", _LIMITS),
        parsed("--sample-time", "SECONDS", "0.01", parse_seconds,
               "Time between samples (default: that of the same log).", _LIMITS),
        Option(["--criterion"], default="worst", metavar="worst|determinant|PARAMETER",
               group="Search", help="What to minimise: the worst relative standard error, the "
               "volume of the confidence region, or the standard error of one parameter."),
        Option(["--seed"], type=click.IntRange(min=0), default=0, group="Search",
               help="Seed of the random shapes."),
        Option(["--output", "-o"], metavar="FILE.csv", group="Output",
               help="CSV file with the experiment; without it nothing is written."),
        FORCE,
        json_option("The prediction"),
        *VERBOSITY,
    ],
)  # fmt: skip
def command(
    family: str, params_file: str | None, output: str | None, force: bool, as_json: bool,
    **params: Any,
) -> None:  # fmt: skip
    """Design the next experiment: the one that best determines the least certain parameter.

    Predicts the standard error of every parameter of the file for many excitations within the
    limits (Fisher information at the file's values and noise) and writes the best as a CSV that a
    controller can play. Limits that are not given are what the file's logs covered.

    \b
    Examples:
      fluidact-fit design valve.yaml -o next.csv
      fluidact-fit design ball-screw --from drive.yaml --amplitude -0.006:0.006 --stroke 0:200
    """
    from fluidact_fit.control import read_document
    from fluidact_fit.excitation import design as make_design

    if params_file is not None:
        get_family(family)
    elif family in family_names():
        raise UsageError(
            "the parameter file of the present fit is missing.",
            remedy=f"Give `design {family} --from FILE.yaml`, or `design FILE.yaml`.",
        )
    source = params_file or family
    if output is not None:
        check_targets({"-o": output}, [source], force)
    document = read_document(source)
    if params_file is not None and document.family != family:
        raise UsageError(
            f"{params_file} is of the family {document.family}, not {family}.",
            remedy=f"Give `design {document.family} --from {params_file}`, or another file.",
        )
    names = ("amplitude", "rate", "stroke", "duration", "sample_time", "criterion", "seed")
    with Progress(params["quiet"], params["verbose"]) as progress:
        found = make_design(document, progress=progress, **{n: params[n] for n in names})
    if output is not None:
        write_all({output: found.to_csv()}, force)
    if as_json:
        echo_json(found.to_dict())
    elif not params["quiet"]:
        _show(found, output, params["verbose"])


def _show(found: Design, output: str | None, verbose: bool) -> None:
    show(found)
    if verbose and found.candidates:
        echo("\nbest of each shape, with its worst relative standard error:")
        for c in found.candidates:
            worst = "" if c.worst_relative is None else f"{100.0 * c.worst_relative:.3g} %"
            echo(f"  {worst:>9}  {c.description}")
    echo(f"written to {output}" if output else "Not saved. Add -o next.csv to save it.")
