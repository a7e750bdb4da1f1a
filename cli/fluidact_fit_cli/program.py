"""A command group that loads nothing before it is needed."""

from __future__ import annotations

import os
from collections.abc import Sequence
from importlib import import_module
from typing import TYPE_CHECKING

import click

from fluidact_fit import __version__
from fluidact_fit.errors import UsageError, closest
from fluidact_fit.families import family_names, family_title

from .errors import Invocation, run_guarded
from .help_width import FittingHelp
from .options import DEBUG

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

# Commands beside the families by heading, each with its line; a module in ``commands`` each.
_GROUPS = {
    "Find out what a log is good for": {
        "inspect": "Show what is in a log, what is wrong with it, and which families fit it.",
        "fit": "Find the family and the columns that fit a log, and fit it.",
    },
    "Use parameter files": {
        "check": "Check whether a parameter file still describes the machine.",
        "compare": "Compare parameter files of one family, or logs.",
        "simulate": "Simulate a parameter file with the inputs of a log.",
        "design": "Design the next experiment from a parameter file.",
        "report": "Write a web page of a parameter file, or of several compared.",
        "export": "Export code or configuration for a controller.",
        "check-consumer": "Compare a parameter file with what a controller reads.",
    },
    "Many fits, and help": {
        "batch": "Run many fits: a parameter file each, a summary of all.",
        "demo": "Fit synthetic logs of every family, as an example.",
        "schema": "Print the JSON Schema of the parameter file.",
        "completion": "Print the script that lets a shell complete commands and options.",
    },
}
_COMMANDS = {name: line for group in _GROUPS.values() for name, line in group.items()}
_EPILOG = """\b
Examples:
  fluidact-fit line trial1.csv trial2.csv --unit inlet=bar --unit outlet=bar -o line.yaml
  fluidact-fit inspect trial1.csv
  fluidact-fit check line.yaml today.csv

Exit status: 0 done; 1 a bug in the program; 2 wrong usage; 3 the log or file cannot be
used; 4 the data cannot determine what was asked (or --strict); 5 check: the model no
longer fits, check-consumer: the controller reads something else."""


class Program(FittingHelp, click.Group):
    """The command group: one subcommand per model family, and some beside the fits."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names of all commands."""
        return [*family_names(), *_COMMANDS]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import and return a command."""
        if cmd_name in family_names():
            from .commands.fit_family import make_command

            return make_command(cmd_name)
        if cmd_name in _COMMANDS:
            module = import_module(f".commands.{cmd_name.replace('-', '_')}", __package__)
            command: click.Command = module.command
            return command
        return None

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command; an unknown one gets a suggestion."""
        name = args[0]
        if name in self.list_commands(ctx) or name.startswith("-"):
            return super().resolve_command(ctx, args)
        if os.path.exists(name):
            raise click.UsageError(
                f"{name} is a file, and a command comes first.\n"
                f"`fluidact-fit inspect {name}` shows its content, `fluidact-fit fit {name}` "
                "fits it.",
                ctx,
            )
        close = closest(name, self.list_commands(ctx))
        hint = f" Did you mean {close!r}?" if close else ""
        known = ", ".join(self.list_commands(ctx))
        raise click.UsageError(f"there is no command {name!r}.{hint}\nCommands: {known}.", ctx)

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem[str]]:
        """Complete the command name; imports none of them."""
        from click.shell_completion import CompletionItem

        titles = {name: family_title(name) for name in family_names()} | _COMMANDS
        found = [CompletionItem(name, help=title) for name, title in titles.items()]
        return [item for item in found if item.value.startswith(incomplete)]

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands from their one-line titles, importing none of them."""
        with formatter.section("Model families (fluidact-fit FAMILY LOG... -o FILE.yaml)"):
            formatter.write_dl([(name, family_title(name)) for name in family_names()])
        width = max(map(len, self.list_commands(ctx)))
        for title, commands in _GROUPS.items():
            with formatter.section(title):
                formatter.write_dl([(name.ljust(width), line) for name, line in commands.items()])


program = Program(
    "fluidact-fit",
    help="System identification for fluid-powered actuators: turn test-rig logs into "
    "controller-ready parameters.",
    epilog=_EPILOG,
    context_settings={
        "help_option_names": ["-h", "--help", "--help-all"],
        "max_content_width": 100,
    },
    params=[DEBUG],
)
click.version_option(__version__, prog_name="fluidact-fit", message="%(prog)s %(version)s")(program)


def run(args: Sequence[str]) -> int:
    """Run the program with the words after its name and return its exit status."""
    invocation = Invocation(tuple(args))
    if shell := os.environ.get("_FLUIDACT_FIT_COMPLETE"):
        return run_guarded(lambda: _complete(shell), invocation)
    return run_guarded(lambda: _run(args, invocation), invocation)


def _complete(shell: str) -> None:
    from .completion import complete

    complete(program, shell)


def _run(args: Sequence[str], invocation: Invocation) -> int | None:
    if any("\0" in word for word in args):  # from Python: the system passes none on
        raise UsageError("a word of the command holds a NUL.", remedy="Leave it out.")
    if not args:
        with click.Context(program, info_name="fluidact-fit") as ctx:
            click.echo(program.get_help(ctx), err=True)
        return 2
    status: int | None = program.main(
        list(args), prog_name="fluidact-fit", standalone_mode=False, obj=invocation
    )
    return status
