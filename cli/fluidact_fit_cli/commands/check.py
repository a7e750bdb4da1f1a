"""``fluidact-fit check``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from .. import options
from ..messages import echo_notices
from ..outputs import refuse_twice
from ..progress import Progress
from ..show import echo, echo_json, show_table

if TYPE_CHECKING:
    from fluidact_fit.check import Check

_STAGES = ("reading", "simulating", "fitting again")


@click.command(
    "check",
    cls=options.Command,
    params=[
        click.Argument(["params_file"], metavar="PARAMS"),
        click.Argument(["logs"], metavar="LOG...", nargs=-1, required=True),
        options.json_option("The comparison"),
        *options.READING,
        *options.VERBOSITY,
    ],
)
def command(params_file: str, logs: tuple[str, ...], as_json: bool, **params: Any) -> None:
    """Check whether the parameter file PARAMS still describes the machine that recorded LOG.

    The columns are those the file was fitted with, unless options say otherwise. Each log is
    simulated with the file's parameters, and the family is fitted again to compare the parameters.

    \b
    The model no longer fits (exit status 5) when
      - the rmse of a log is above twice the file's rmse plus one resolution step of the output, or
      - a parameter moved by more than 4 combined standard errors and by more than 2 %.
    """
    from fluidact_fit.check import check

    refuse_twice(logs)
    document = options.read_params(params_file, logs)
    with Progress(params["quiet"], params["verbose"], stages=_STAGES) as progress:
        progress("reading")
        found = check(document, list(logs), progress=progress, **options.reading(params))
    if not params["quiet"]:
        echo_notices(found.notices)
    if as_json:
        echo_json(found.to_dict())
    elif not params["quiet"]:
        _show(found)
    found.raise_for_mismatch(params_file)


def _show(found: Check) -> None:
    show_table(found.log_table())
    if found.drifts:
        echo()
        show_table(found.table())
    if found.fits:
        echo(f"\n{found.headline}")
