"""``fluidact-fit check``."""

from __future__ import annotations

from contextlib import closing
from typing import TYPE_CHECKING, Any

import click

from .. import options
from ..messages import echo_notices
from ..progress import Progress
from ..show import echo, echo_json, echo_table, format_number, format_spread

if TYPE_CHECKING:
    from fluidact_fit.check import Check, Drift

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
    from fluidact_fit.simulation import variant_of

    document = options.read_params(params_file, logs)
    options.check_role_names(params, [role.name for role in variant_of(document).roles])
    with closing(Progress(params["quiet"], params["verbose"], stages=_STAGES)) as progress:
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
    from fluidact_fit.tables import percent_text

    head = ["log", "fit", "rmse", "limit", "unit", ""]
    rows = [
        [log.file, percent_text(log.fit_percent), f"{log.rmse:.4g}", f"{log.limit:.4g}", log.unit,
         "" if log.within else "TOO LARGE"]
        for log in found.logs
    ]  # fmt: skip
    echo_table([head, *rows], right=(1, 2, 3))
    if found.drifts:
        echo()
        head = ["parameter", "file", "now", "std error", "unit", "std errors", "moved by", ""]
        rows = [_drift_row(drift) for drift in found.drifts]
        echo_table([head, *rows], right=(1, 2, 5, 6), drop=(4, 3))
    if found.fits:
        echo("\nthe model still fits")


def _drift_row(drift: Drift) -> list[str]:
    from fluidact_fit.tables import percent_text

    return [
        drift.name,
        format_number(drift.before, drift.combined_error),
        format_number(drift.now, drift.combined_error),
        f"± {format_spread(drift.combined_error)}",
        drift.unit,
        f"{drift.sigmas:.1f}",
        "" if drift.percent is None else percent_text(drift.percent, "+.2f"),
        "MOVED" if drift.moved else "",
    ]
