"""Suggested families as lines of text: what was tried, what is missing, what to run."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING

from .channel_lines import text_width
from .show import echo, echo_text, show_table

if TYPE_CHECKING:
    from fluidact_fit.advice import Suggestion
    from fluidact_fit.logs import Log

_BESIDE = 45  # characters of a table before its last column


def echo_advice(advice: Sequence[Suggestion], log: Log, *, choice: bool = False) -> None:
    """Print which families fit a log, what they do not determine, and what to run.

    ``choice`` says that a person is asked for one of all commands, by its number.
    """
    from fluidact_fit.advice import unit_lines

    echo()
    if not advice:
        echo_text(
            "No family has all that it needs among these columns, by their units and names. Say "
            "what they are with --column ROLE=#N and --unit ROLE=UNIT (FAMILY --help lists roles).",
            "",
        )
        for line in unit_lines(log):
            echo_text(line, "    ", "  ")
        return
    whole = [s for s in advice if not s.candidates]
    incomplete = [s for s in advice if s.candidates]
    if whole:
        _echo_assigned(whole, choice)
    if incomplete:
        _echo_incomplete(incomplete, other=bool(whole))


def _echo_assigned(advice: Sequence[Suggestion], choice: bool) -> None:
    """Print families that have a column for every role, and their commands."""
    _echo_families(advice)
    best = advice[0]
    lost: dict[str, list[str]] = {}
    for name, message in best.not_identified.items():
        lost.setdefault(message.removeprefix(name), []).append(name)
    for message, names in lost.items():
        echo_text(f"not determined: {', '.join(names)}{message}")
    for reason, families in _reasons(advice).items():
        echo_text(f"{families}: {reason}")
    if best.basis:
        echo_text(best.basis, "")
    for one, other in best.unsure:
        echo_text(f"{one} and {other} could be exchanged: check which column is which")
    for one, other in best.against:
        echo_text(f"{other} moves against {one}: if a sign is reversed, add --scale {one}=-1 "
                  f"or --scale {other}=-1")  # fmt: skip
    if best.asked:
        echo_text(f"fill in what stands in capitals: {', '.join(best.asked)}")
    shown = advice if best.basis or choice else advice[:1]
    if best.asked and not choice:  # what needs no number is another way
        shown = [*shown, *(s for s in advice[1:] if s.verdict in ("pass", "warn"))][:2]
    tried = "next, once that is resolved:" if best.verdict == "refused" else "next:"
    echo(tried if len(shown) == 1 else "next, one of:")
    for number, s in enumerate(shown, 1):
        echo(f"  {number}   {_command(s)}" if choice else f"  {_command(s)}")


def _reasons(advice: Sequence[Suggestion]) -> dict[str, str]:
    """Return why families were refused or not tried, with their names; the best one's in full."""
    out: dict[str, list[str]] = {}
    for s in advice:
        if s.reason:
            short = s.reason if s is advice[0] else s.reason.split(". ")[0].rstrip(".") + "."
            out.setdefault(short, []).append(s.family)
    return {reason: ", ".join(families) for reason, families in out.items()}


def _echo_families(advice: Sequence[Suggestion]) -> None:
    """Print a table of the families; their columns below them where the terminal is narrow."""
    from fluidact_fit.inspection import family_table

    table = family_table(advice)
    if max(len(row[3]) for row in table.rows) <= text_width() - _BESIDE:
        show_table(table)
        return
    for family, verdict, percent, columns in table.rows:
        echo(f"{family:<19} {verdict:<9} {percent:>9}")
        echo_text(columns, "    ", "    ")


def _echo_incomplete(advice: Sequence[Suggestion], *, other: bool) -> None:
    """Print families whose columns the user has to assign, and a command to complete.

    ``other`` says whether families with a column for every role stand above.
    """
    best = advice[0]
    echo_text("Families that could fit; the log does not say which column has which role:" if other
              else best.basis, "")  # fmt: skip
    rows: dict[str, list[str]] = {}
    for s in advice:
        rows.setdefault(s.family, []).append(_roles(s))
    width = max(map(len, rows))
    for family, variants in rows.items():
        echo_text(f"{family:<{width}}  {', or '.join(variants)}", " " * (width + 4), "  ")
    roles: dict[tuple[str, ...], dict[str, None]] = {}
    for s in advice:
        for role, columns in s.candidates.items():
            roles.setdefault(columns, {})[role] = None
    for columns, names in roles.items():
        every = "every role" if len(roles) == 1 else ", ".join(names)
        echo_text(f"candidates for {every}: {', '.join(columns)}")
    echo("next (name your family, and replace the words in capitals):")
    echo(f"  {_command(best)}")


def _roles(s: Suggestion) -> str:
    """Return the roles of a family, with the columns that are chosen: ``force=#2 + velocity``."""
    return " + ".join([*(f"{role}={at}" for role, at in s.columns.items()), *s.candidates])


def _command(s: Suggestion) -> str:
    """Return the command for the shell of this system."""
    return s.powershell if os.name == "nt" else s.command
