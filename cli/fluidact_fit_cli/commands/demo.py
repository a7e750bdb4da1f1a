"""``fluidact-fit demo``."""

from __future__ import annotations

from pathlib import Path

import click

from ..options import DEBUG, Command
from ..progress import Progress
from ..show import echo_text, show_table


@click.command(
    "demo",
    cls=Command,
    params=[
        click.Argument(["directory"], metavar="[DIRECTORY]", default="fluidact-demo"),
        DEBUG,
    ],
)
def command(directory: str) -> int:
    """Fit the synthetic logs of every family and compare the results with the truth.

    DIRECTORY receives parameter files and pictures (default: fluidact-demo).
    """
    from fluidact_fit.demo import run_demo

    with Progress(lines=True) as progress:

        def show(line: str) -> None:
            progress.close()  # nothing is fitted any more
            echo_text(line)

        return run_demo(Path(directory), show, progress=progress, table=show_table)
