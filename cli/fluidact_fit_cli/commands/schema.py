"""``fluidact-fit schema``."""

from __future__ import annotations

import click

from ..options import DEBUG, Command
from ..show import echo_json


@click.command("schema", cls=Command, params=[DEBUG])
def command() -> None:
    """Print the JSON Schema of the parameter file, as it is shipped."""
    from fluidact_fit.parameters import shipped_schema

    echo_json(shipped_schema())
