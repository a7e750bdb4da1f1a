"""``fluidact-fit compare``."""

from __future__ import annotations

from typing import Any

import click

from fluidact_fit.families import family_names, get_family

from .. import options
from ..errors import Invocation
from ..progress import Progress
from ..show import echo_json, show


class _Compare(options.Command):
    """The command; with ``--structures`` it has the options of that family's fit as well."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Find the family first: it decides which options there are."""
        for word, after in zip(args, [*args[1:], ""]):
            option, equals, value = word.partition("=")
            if option == "--structures":
                ctx.meta[__name__] = value if equals else after
        return super().parse_args(ctx, args)

    def get_params(self, ctx: click.Context) -> list[click.Parameter]:
        """Options of the command, and of the family."""
        params, family = super().get_params(ctx), ctx.meta.get(__name__)
        if family not in family_names():
            return params
        from .compare_structures import family_params

        return [*params, *family_params(get_family(family))]


@click.command(
    "compare",
    cls=_Compare,
    params=[
        click.Argument(["files"], metavar="PARAMS...|LOGS...", nargs=-1, required=True),
        options.Option(["--structures"], type=click.Choice(family_names()), metavar="FAMILY",
                       group="Structures",
                       help="Fit the structures of a family to the LOGS and recommend one: first "
                       "or second order, with or without dead time, dead zone, Stribeck, ... Takes "
                       "the options of that fit, which --help lists after it."),
        options.json_option("The comparison"),
        *options.READING,
        *options.VERBOSITY,
    ],
)  # fmt: skip
@click.pass_context
def command(
    ctx: click.Context, /, files: tuple[str, ...], structures: str | None, as_json: bool,
    **params: Any,
) -> None:  # fmt: skip
    """Compare parameter files of one family, or logs, with the first one; or structures.

    \b
    PARAMS (.yaml)  every parameter with its standard error, how many standard errors it differs
                    from that of the first file, and whether all of them together differ by more
                    than chance; files that were fitted to the same logs are named
    LOGS            columns, units, ranges and sampling, and where they differ
    --structures FAMILY LOGS
                    which terms of the family's equation the logs support, judged by logs that
                    were held out and by the Bayesian information criterion (BIC)

    A difference is a result: the exit status is 0. `check PARAMS LOG` tells whether a file still
    describes a machine.

    \b
    Examples:
      fluidact-fit compare before.yaml after.yaml
      fluidact-fit compare monday.csv tuesday.csv
      fluidact-fit compare --structures valve monday.csv tuesday.csv
    """
    if structures is not None:
        from .compare_structures import run

        run(structures, files, as_json, params, ctx.find_object(Invocation))
        return
    from fluidact_fit.comparison import compare

    with Progress(params["quiet"], params["verbose"]) as progress:
        progress("reading")
        found = compare(*files, **options.reading(params))
    if as_json:
        echo_json(found.to_dict())
    elif not params["quiet"]:
        show(found)
