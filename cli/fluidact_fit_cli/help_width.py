"""Wrap help texts to the terminal, preformatted parts included."""

from __future__ import annotations

import re
import textwrap

import click

_TWO_COLUMNS = re.compile(r" *\S+(?: \S+)* {2,}(?=\S)")
_COMMAND = "fluidact-fit "
_PAIR = re.compile(r"(?<= )(--?[a-z][a-z0-9-]*) (?!--|-[a-z])")  # an option before its value
_JOINED = "\0"


class FittingHelp(click.Command):
    """A command whose help has no line that is wider than the terminal."""

    def get_help(self, ctx: click.Context) -> str:
        """Return the help with its preformatted lines wrapped as well."""
        width = ctx.make_formatter().width
        lines = super().get_help(ctx).splitlines()
        return "\n".join(part for line in lines for part in fit_line(line, width))


def fit_line(line: str, width: int) -> list[str]:
    """Return a line as lines of at most ``width`` columns, where its words allow that.

    The second of two columns stays a column. A command continues behind a backslash, so that it
    can still be copied, and not between an option and its value.
    """
    if len(line) <= width:
        return [line]
    indent = len(line) - len(line.lstrip())
    is_command = line.lstrip().startswith(_COMMAND)
    columns = None if is_command else _TWO_COLUMNS.match(line)
    hanging = min(columns.end() if columns else indent + 2 * is_command, width // 2)
    parts = textwrap.wrap(
        _PAIR.sub(rf"\1{_JOINED}", line) if is_command else line, width - 2 * is_command,
        subsequent_indent=" " * hanging, drop_whitespace=True, break_long_words=False,
        break_on_hyphens=False,
    )  # fmt: skip
    parts = [part.replace(_JOINED, " ") for part in parts]
    return [f"{part} \\" for part in parts[:-1]] + parts[-1:] if is_command else parts
