"""``fluidact-fit fit``: the family and the columns that fit, then the fit."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import click

from fluidact_fit.errors import LogError, NotIdentifiedError, UsageError

from .. import options
from ..advice_lines import echo_advice
from ..errors import Invocation
from ..messages import tell_message
from ..outputs import check_targets
from ..progress import Progress
from ..recorded import recorded_command
from .fit_family import make_command, output_options, render_files, targets_of, write_result

if TYPE_CHECKING:
    from fluidact_fit.advice import Suggestion
    from fluidact_fit.logs import Log
    from fluidact_fit.result import FitResult


@click.command(
    "fit",
    cls=options.Command,
    params=[
        click.Argument(["logs"], metavar="LOG...", nargs=-1, required=True),
        *output_options("FAMILY"),
        *options.READING,
        *options.VERBOSITY,
    ],
)
@click.pass_context
def command(ctx: click.Context, /, logs: tuple[str, ...], **params: Any) -> None:
    """Find the family and the columns that fit LOGs, and fit it.

    The choice is printed, and saved in the file as the command that does the same. Where two
    families fit alike, or two columns could be exchanged, you are asked on a terminal; otherwise
    nothing is fitted, and the commands are listed. `inspect` shows the choice alone.
    """
    from fluidact_fit.advice import column_options, is_clear, suggest
    from fluidact_fit.files import shell_command

    invocation = ctx.find_object(Invocation) or Invocation(("fit", *logs))
    with Progress(params["quiet"], params["verbose"]) as progress:
        progress("reading")
        read = options.read_logs(logs, params)
        targets = targets_of("", params)
        if params["output"] is None:
            targets.pop("-o", None)  # named like the family
        check_targets(targets, logs, params["force"])
        typed = options.typed_words(invocation, "fit", {"--debug": False})
        found = suggest(read, logs, words=typed, progress=progress)
    chosen = found[0] if is_clear(found) else _ask(found, read[0])
    words = [w for w in invocation.args if w != "--debug"]
    words = [chosen.family, *words[words.index("fit") + 1 :], *column_options(chosen, read),
             *chosen.options]  # fmt: skip
    if not params["quiet"]:
        tell_message("note", shell_command(["fluidact-fit", *words]), "family-found")
    if chosen.result is not None and params["controller_sample_time"] is None:
        _finish(chosen.family, chosen.result, words, logs, params)
        return
    family = make_command(chosen.family)
    family.main(words[1:], prog_name=f"fluidact-fit {chosen.family}", standalone_mode=False,
                obj=Invocation(tuple(words), invocation.read, invocation.written))  # fmt: skip


def _finish(
    family: str,
    result: FitResult,
    words: Sequence[str],
    logs: Sequence[str],
    params: Mapping[str, Any],
) -> None:
    """Write and show the fit by which the family was chosen, as its own command would."""
    targets = targets_of(family, params)
    check_targets(targets, logs, params["force"])
    command = recorded_command(words, {**params, "logs": logs})
    origin = result.document.provenance.model_copy(update={"command": command})
    document = result.document.model_copy(update={"provenance": origin})
    result = replace(result, document=document)
    result = replace(result, document=result.document_to_write())
    write_result(result, render_files(result, targets), params)


def _ask(found: Sequence[Suggestion], log: Log) -> Suggestion:
    """The choice of a person.

    Raises
    ------
    UsageError
        Where nobody can be asked, or an option is missing.
    NotIdentifiedError, LogError
        Where nothing is possible: because no family can be determined, or for another reason.
    """
    from fluidact_fit.advice import unit_lines
    from fluidact_fit.logs.columns import left_out

    if found and found[0].asked and not (found[0].unsure or found[0].candidates):
        raise UsageError(
            f"{found[0].family} has a role for these columns, and needs a number that no log "
            "holds.",
            expected=f"  {found[0].command}",
            remedy="Replace the words in capitals and run it. fit takes no options of a family.",
        )
    able = [s for s in found if s.verdict in ("pass", "warn", "fail")]
    if not able:
        reasons = "\n".join(
            dict.fromkeys(
                f"  {s.family}: {s.reason}" if s.reason else f"  {s.basis}" for s in found
            )
        )
        refused = bool(found) and all(s.verdict == "refused" for s in found)
        lacking = any(s.asked for s in found)
        kind = UsageError if lacking else NotIdentifiedError if refused else LogError
        raise kind(
            "no family fits these logs as they are.",
            expected=f"What was tried:\n{reasons}" if found else
            "\n".join(["Expected columns whose units or names tell what they are.",
                       *unit_lines(log), *left_out(log)]),
            remedy="Run the family with --column, --unit and what it asks for; inspect shows the "
            "columns.",
        )  # fmt: skip
    if not (sys.stdin and sys.stdin.isatty() and sys.stderr and sys.stderr.isatty()):
        raise _open_question(able, log)
    echo_advice(able, log, choice=True)
    number = click.prompt("Which family, by number", type=click.IntRange(1, len(able)), default=1,
                          err=True)  # fmt: skip
    return able[number - 1]


def _open_question(able: Sequence[Suggestion], log: Log) -> UsageError:
    """What a person has to decide, with the commands to choose from."""
    from fluidact_fit.advice import unit_lines
    from fluidact_fit.logs.columns import time_candidate

    what, remedy = "these logs can be read in more than one way.", "Run the intended command."
    if able[0].options:
        what = able[0].reason
    elif able[0].basis:
        what = able[0].basis
    elif len(able) == 1 and not able[0].unsure:
        what = "the only family that can be tried describes these logs poorly."
        remedy = "Run it if it is meant."
        if time_candidate(log) is None and log.sample_time is None:
            remedy += " --sample-time SECONDS lets families in time be tried."
    unknown = "".join(f"\n{line}" for line in unit_lines(log, doubtful=True))
    commands = "\n".join(f"  {s.command}" for s in able)
    return UsageError(what, expected=commands, remedy=f"{remedy}{unknown}")
