"""``fluidact-fit check-consumer``."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from fluidact_fit.errors import MismatchError

from .. import options
from ..show import echo, echo_json, echo_table

if TYPE_CHECKING:
    from fluidact_fit.consumer import Comparison


@click.command(
    "check-consumer",
    cls=options.Command,
    params=[
        click.Argument(["params_file"], metavar="PARAMS"),
        click.Argument(["consumer"], metavar="CONSUMER"),
        options.json_option("The comparison"),
        *options.VERBOSITY,
    ],
)
def command(params_file: str, consumer: str, as_json: bool, quiet: bool, verbose: bool) -> None:
    """Compare the parameter file PARAMS with the keys that a controller reads.

    \b
    CONSUMER is
      - a declaration of generate_parameter_library (.yaml), with the units of its keys in square
        brackets in the descriptions,
      - a C or C++ header (.h, .hpp, .c): #define NAME value, constants, variables and members
        of structures, with /* unit */ behind them or above; that of `export --to c` as well, or
      - a list (.txt, .csv): `name [unit]` or `name,unit` a line.

    Names are compared without regard to case, to the name of the file or family before them, and
    to a unit behind them, as in TIME_CONSTANT_MS.
    Numbers of the code are held against those of the file to the last digit that they are written
    with. Parameters that the controller ignores, keys that the file lacks, other units, other
    numbers and an export of another file end the command with exit status 5. -v also lists what
    agrees.
    """
    from fluidact_fit.consumer import compare, hashes_in, read_consumer
    from fluidact_fit.control import load
    from fluidact_fit.export.target import sha256_of

    block = load(params_file, accept_failed=True, accept_not_identified=True)
    found = compare(
        block, read_consumer(consumer), params_file,
        sha256=sha256_of(params_file), exported_from=hashes_in(consumer),
    )  # fmt: skip
    if as_json:
        echo_json(found.to_dict())
    elif not quiet:
        _show(found, verbose)
    if not found.agrees:
        raise MismatchError(
            "the controller does not read what the file holds.",
            where=consumer,
            expected="\n".join(found.reasons),
            remedy="Export again, correct the list of the controller, or convert where it reads.",
        )


def _show(found: Comparison, verbose: bool) -> None:
    shown = [row for row in found.rows if verbose or row.finding != "agrees"]
    head = ["file", "unit", "controller", "its unit", "finding"]
    rows = [[r.parameter, r.unit, r.consumer, r.consumer_unit, r.finding] for r in shown]
    if rows:
        echo_table([head, *rows])
        echo()
    count = sum(row.finding == "agrees" for row in found.rows)
    echo(f"{count} of {len(found.rows)} keys agree")
