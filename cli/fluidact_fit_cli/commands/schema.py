"""``fluidact-fit schema``."""

from __future__ import annotations

from ..options import Command, debug_option
from ..show import echo_json


def print_schema() -> None:
    """Print the JSON Schema of the parameter file, as it is shipped."""
    from fluidact_fit.parameters import shipped_schema

    echo_json(shipped_schema())


command = Command(
    "schema", params=[debug_option()], callback=print_schema, help=print_schema.__doc__
)
