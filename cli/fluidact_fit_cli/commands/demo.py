"""``fluidact-fit demo``."""

from __future__ import annotations

from pathlib import Path

import click

from ..options import Command, debug_option

_HELP = """Make synthetic logs, fit them and show how near the truth the result is.

DIRECTORY receives logs and parameter files (default: fluidact-demo)."""


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
