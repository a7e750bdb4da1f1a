"""``fluidact-fit report``."""

from __future__ import annotations

from pathlib import Path

import click

from .. import options
from ..outputs import check_targets, note_written
from ..show import echo


@click.command(
    "report",
    cls=options.Command,
    params=[
        click.Argument(["params_file"], metavar="PARAMS"),
        click.Argument(["others"], metavar="[OTHER...]", nargs=-1),
        options.Option(["--output", "-o"], metavar="FILE.html", group="Output",
                       help="Where to write (default: PARAMS with the suffix .html)."),
        options.FORCE,
        *options.VERBOSITY,
    ],
)  # fmt: skip
def command(
    params_file: str,
    others: tuple[str, ...],
    output: str | None,
    force: bool,
    quiet: bool,
    verbose: bool,
) -> None:
    """Write the page of the parameter file PARAMS: values, warnings, ranges, model, provenance.

    With OTHER files of the same family, the page compares them: what differs by more than its
    uncertainty, as a table and a picture. The logs are not needed; the pictures of a fit are in the
    page that the fit itself writes with --report.

    \b
    Examples:
      fluidact-fit report valve.yaml
      fluidact-fit report before.yaml after.yaml -o changed.html
    """
    from fluidact_fit.comparison import compare_documents
    from fluidact_fit.families import get_family
    from fluidact_fit.parameters import read_document
    from fluidact_fit.report import write_document_html

    target = output or str(Path(params_file).with_suffix(".html"))
    files = [(name, read_document(name, get_family)) for name in (params_file, *others)]
    check_targets({"--output": target}, (params_file, *others), force)
    comparison = compare_documents(files) if others else None
    write_document_html(files[0][1], target, comparison=comparison, overwrite=force)
    note_written([target])
    if not quiet:
        echo(f"written to {target}")
