"""From an error to a message and an exit status: the only place that decides either."""

from __future__ import annotations

import os
import sys
import traceback
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import click

from fluidact_fit.errors import FluidactError, bounded, closest
from fluidact_fit.families import family_names

from . import INTERRUPTED
from .messages import tell_message
from .show import drop, tell

PIPE_CLOSED = 141  # 128 + SIGPIPE


@dataclass(frozen=True)
class Invocation:
    """The command line as typed, for provenance and for ``--debug``, and what came of it.

    ``read`` are files that nothing may be written to, ``written`` those that were. ``is_job`` says
    whether a batch gave it.
    """

    args: tuple[str, ...]
    read: list[str] = field(default_factory=list)
    written: list[str] = field(default_factory=list)
    is_job: bool = False

    @property
    def debug(self) -> bool:
        """Return whether tracebacks are wanted; known even when the line cannot be parsed."""
        given = self.args[: self.args.index("--")] if "--" in self.args else self.args
        return "--debug" in given


def run_guarded(action: Callable[[], Any], invocation: Invocation) -> int:
    """Run an action and turn whatever it raises into a message and an exit status.

    The action returns the exit status, or anything else for 0.
    """
    try:
        with silenced(invocation):
            status = action()
        # A broken pipe has to show up here, where it is handled.
        if sys.stdout is not None:
            sys.stdout.flush()
        return status if isinstance(status, int) else 0
    except SystemExit as error:
        if not error.code:
            return 0
        # click ends a broken pipe itself, with status 1, and leaves wrappers about the streams
        # that cannot be flushed where one of them is closed.
        sys.stdout, sys.stderr = sys.__stdout__, sys.__stderr__
        drop(sys.stdout)
        return PIPE_CLOSED
    except BaseException as error:
        if invocation.debug:
            tell(traceback.format_exc(), after="")
        if isinstance(error, BrokenPipeError):
            drop(sys.stdout)
            return PIPE_CLOSED
        message, status = explain(error, invocation.written, invocation.args)
        if status == INTERRUPTED:
            tell(message)
        elif message:
            tell_message("error", message)
        _flush()
        return status


@contextmanager
def silenced(invocation: Invocation) -> Iterator[None]:
    """Keep back warnings of numpy, such as an overflow, that mean nothing to a user."""
    with warnings.catch_warnings():
        if not invocation.debug and not sys.warnoptions:
            warnings.simplefilter("ignore")
        yield


def _flush() -> None:
    """Print what is left, or forget it: the interpreter would complain of a full disk again."""
    try:
        if sys.stdout is not None:
            sys.stdout.flush()
    except OSError:
        drop(sys.stdout)


def explain(
    error: BaseException, written: Sequence[str] = (), words: Sequence[str] = ()
) -> tuple[str, int]:
    """Return the message and the exit status of an error.

    ``written`` are the files written before it, ``words`` those of the command line.
    """
    written = [path for path in written if os.path.exists(path)]
    text, status = _explain(error, words, "" if written else " Nothing was written.")
    return (f"{text}\nWritten before that: {', '.join(written)}." if written else text), status


def _explain(error: BaseException, words: Sequence[str], nothing: str) -> tuple[str, int]:
    if isinstance(error, FluidactError):
        return error.text, error.exit_status
    if isinstance(error, click.exceptions.Exit):
        return "", error.exit_code
    if isinstance(error, (click.Abort, KeyboardInterrupt)):
        return f"Interrupted.{nothing}", INTERRUPTED
    if isinstance(error, click.UsageError):
        return bounded(_explain_usage(error, words)), 2
    if isinstance(error, click.ClickException):
        return bounded(error.format_message()), 2
    if isinstance(error, MemoryError):
        return (
            "There is not enough memory for this. Fit fewer or shorter logs (--window START:END), "
            "or close other programs.",
            1,
        )
    if isinstance(error, OSError) and error.strerror:
        where = f"{error.filename}: " if error.filename else ""
        return f"{where}{error.strerror}.\nCheck the path, the permissions and the free space.", 3
    found = " ".join(f"{type(error).__name__}: {error}".split())
    return (
        f"This is a bug in fluidact-fit, not in your data, sorry: {found[:300]}.{nothing} "
        "Run the same command with --debug added and report what it shows, with the log "
        "if you can."
    ), 1


def _explain_option(error: click.NoSuchOption, words: Sequence[str]) -> str:
    """Name the option that does not exist, and the one or the file that was probably meant."""
    file = next((w for w in words if w.startswith("-") and os.path.isfile(w)), "")
    if file:
        return f"'{file}' was read as an option. Give './{file}' if the file is meant."
    homes = _families_with(error.option_name, error.ctx)
    own = "" if error.ctx is None else str(error.ctx.info_name)
    if homes and own in family_names():
        owners = ", ".join(homes)
        return f"{own} has no option '{error.option_name}': it belongs to the command of {owners}."
    if homes:
        some = " or ".join(homes) if len(homes) <= 3 else "the family"
        return (
            f"there is no option '{error.option_name}' here: it belongs to the command of {some}. "
            "`fluidact-fit inspect LOG...` shows the command that fits a log."
        )
    params = [] if error.ctx is None else error.ctx.command.get_params(error.ctx)
    close = closest(error.option_name, [o for p in params for o in (*p.opts, *p.secondary_opts)])
    hint = f" Did you mean '{close}'?" if close else ""
    return f"there is no option '{error.option_name}'.{hint}"


def _families_with(option: str, ctx: click.Context | None) -> list[str]:
    """Families whose command has an option."""
    root = None if ctx is None else ctx.find_root()
    if root is None or not isinstance(root.command, click.Group):
        return []
    commands = {name: root.command.get_command(root, name) for name in family_names()}
    return [n for n, c in commands.items() if c and any(option in p.opts for p in c.params)]


def _explain_usage(error: click.UsageError, words: Sequence[str]) -> str:
    text = error.format_message().replace("\n\t", " ")
    text = text.replace("is not a valid integer range", "is not a whole number")
    text = text.replace("is not a valid float range", "is not a number")
    if isinstance(error, click.NoSuchOption):
        text = _explain_option(error, words)
    if isinstance(error, click.MissingParameter) and error.param and error.param.name == "logs":
        text += " Give at least one CSV file."
    if error.ctx is not None:
        text += f"\nTry '{error.ctx.command_path} --help'."
    return text
