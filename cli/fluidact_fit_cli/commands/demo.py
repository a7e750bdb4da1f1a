"""``fluidact-fit demo``."""

from __future__ import annotations

from pathlib import Path

import click

from ..options import Command, debug_option

_HELP = """Fit the synthetic logs of every family and compare the results with the truth.

DIRECTORY receives parameter files and pictures (default: fluidact-demo)."""


def demo(directory: str) -> int:
    """Run the demonstration."""
    from fluidact_fit.demo import run_demo

    return run_demo(Path(directory), click.echo)


command = Command(
    "demo",
    params=[
        click.Argument(["directory"], metavar="[DIRECTORY]", default="fluidact-demo"),
        debug_option(),
    ],
    callback=demo,
    help=_HELP,
)
