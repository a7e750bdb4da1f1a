"""``fluidact-fit compare``."""

from __future__ import annotations

from typing import Any

import click

from .. import options
from ..show import echo, echo_json, echo_table


@click.command(
    "compare",
    cls=options.Command,
    params=[
        click.Argument(["files"], metavar="PARAMS...|LOGS...", nargs=-1, required=True),
        options.json_option("The comparison"),
        *options.READING,
        *options.VERBOSITY,
    ],
)
def command(files: tuple[str, ...], as_json: bool, **params: Any) -> None:
    """Compare parameter files of one family, or logs, with the first of them.

    \b
    PARAMS (.yaml)  every parameter with its standard error, how many standard errors it differs
                    from that of the first file, and whether all of them together differ by more
                    than chance; files that were fitted to the same logs are named
    LOGS            columns, units, ranges and sampling, and where they differ

    A difference is a result: the exit status is 0. Whether a file still describes a machine is
    what `check PARAMS LOG` says.

    \b
    Examples:
      fluidact-fit compare before.yaml after.yaml
      fluidact-fit compare monday.csv tuesday.csv
    """
    from fluidact_fit.comparison import compare

    found = compare(*files, **options.reading(params))
    if as_json:
        echo_json(found.to_dict())
    elif not params["quiet"]:
        table = found.table()
        echo_table([table.head, *table.rows])
        echo()
        for line in found.conclusions:
            echo(line)
