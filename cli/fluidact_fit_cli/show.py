"""Output for people: lines, tables, numbers with their uncertainty, colour."""

from __future__ import annotations

import json
import os
import shutil
import sys
import textwrap
from collections.abc import Sequence
from contextlib import suppress
from typing import Any, TextIO

import click

from fluidact_fit.errors import OutputError, visible
from fluidact_fit.tables import Shown, Table
from fluidact_fit.tables import format_interval as format_interval
from fluidact_fit.tables import format_number as format_number
from fluidact_fit.tables import format_spread as format_spread

_NARROWEST = 40  # columns of a terminal
_INDENT = "  "
_COLOURS = {
    "PASS": "green", "WARN": "yellow", "FAIL": "red", "not identified": "yellow", "MOVED": "red",
    "TOO LARGE": "red", "note": "cyan", "warning": "yellow", "error": "red",
}  # fmt: skip


def echo(text: str = "") -> None:
    """Print a line for people on standard output, if there is one."""
    _print(visible(text) + "\n")


def echo_text(text: str, indent: str = "  ", first: str = "") -> None:
    """Print a paragraph for people, wrapped to the width of a terminal.

    ``first`` stands before its first line, ``indent`` before the others.
    """
    width = width_of(sys.stdout)
    if width is None:
        echo(first + text)
        return
    for line in visible(text).splitlines() or [""]:
        echo(textwrap.fill(line, width, initial_indent=first, subsequent_indent=indent,
                           break_long_words=False, break_on_hyphens=False))  # fmt: skip


def echo_result(text: str) -> None:
    """Print what was asked for, as it is, on standard output; ``OutputError`` without one."""
    if sys.stdout is None:
        raise OutputError(
            "standard output is closed, so the result cannot be shown.",
            remedy="Redirect it to a file or a program.",
        )
    _print(text)


def _print(text: str) -> None:
    try:
        click.echo(text, nl=False)
    except BrokenPipeError:
        raise
    except OSError as error:
        raise OutputError(
            f"standard output cannot be written: {error.strerror}.",
            remedy="Free some space, or redirect it elsewhere.",
        ) from error


def tell(text: str, *, before: str = "", after: str = "\n") -> None:
    """Print text for people on standard error, between control characters of this program.

    It is lost where standard error is closed or full: a result does not depend on it.
    """
    tell_painted(before + visible(text), after)


def tell_painted(text: str, after: str = "\n") -> None:
    """Print text on standard error that is fit to be seen, and may be coloured."""
    try:
        click.echo(text + after, nl=False, err=True)
    except OSError:
        drop(sys.stderr)


def drop(stream: TextIO | None) -> None:
    """Point a stream nowhere, so that the interpreter's last flush of it is silent."""
    with suppress(AttributeError, OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())  # type: ignore[union-attr]
        os.close(nowhere)


def is_terminal(stream: TextIO | None) -> bool:
    """Return whether people watch a stream that can move its cursor."""
    return stream is not None and stream.isatty() and os.environ.get("TERM") != "dumb"


def width_of(stream: TextIO | None) -> int | None:
    """Columns of a terminal; ``None`` where lines may be of any length."""
    if stream is None or not stream.isatty():
        return None
    return max(shutil.get_terminal_size().columns - 1, _NARROWEST)


def paint(text: str, stream: TextIO | None = None) -> str:
    """Return text that is fit to be seen, in its colour where it has one and there is a terminal.

    ``NO_COLOR`` and ``TERM=dumb`` are respected.
    """
    colour = _COLOURS.get(text.strip())
    if colour is None or os.environ.get("NO_COLOR") or not is_terminal(stream or sys.stdout):
        return text
    return click.style(text, fg=colour, bold=True)


def echo_painted(*parts: str) -> None:
    """Print parts of a line, each in the colour of its word."""
    _print("".join(paint(visible(part)) for part in parts) + "\n")


def show(found: Shown) -> None:
    """Print the parts of a result, blank lines between them."""
    for k, part in enumerate([part for part in found.parts() if part]):
        if k:
            echo()
        if isinstance(part, Table):
            show_table(part)
        else:
            echo_text(part)


def show_table(table: Table) -> None:
    """Print a table of the library as :func:`echo_table` does."""
    echo_table([table.head, *table.rows], table.right, table.drop)


def echo_table(
    rows: Sequence[Sequence[str]], right: Sequence[int] = (), drop: Sequence[int] = ()
) -> None:
    """Print a table with a heading, columns aligned; columns without an entry are left out.

    ``right`` lists right-aligned columns, ``drop`` those that a narrow terminal does without, the
    first one first; a line below says which were dropped. Where the others do not fit, the first
    column has lines of its own, or every row becomes a block of lines.
    """
    shown = [[visible(cell).replace("\n", "\\n") for cell in row] for row in rows]
    widths = [max(map(len, column)) for column in zip(*shown)]
    kept = [i for i in range(len(widths)) if i == 0 or any(row[i] for row in shown[1:])]
    limit, every = width_of(sys.stdout) or sys.maxsize, kept
    kept = _fitting(every, widths, limit, drop)
    stacked = [0, *_fitting(every[1:], widths, limit - len(_INDENT), drop)]
    if _width(kept, widths) <= limit:
        for row in shown:
            _echo_row(row, kept, widths, right)
    elif _width(stacked[1:], widths) + len(_INDENT) <= limit:
        kept = stacked
        for row in shown:
            echo(row[0])
            _echo_row(row, kept[1:], widths, right, _INDENT)
    else:
        for row in shown[1:]:
            _echo_block(shown[0], row, limit)
        return
    if dropped := [shown[0][i] for i in every if i not in kept]:
        echo_text(f"A wider terminal also shows: {', '.join(dropped)}.")


def _fitting(
    columns: Sequence[int], widths: Sequence[int], limit: int, drop: Sequence[int]
) -> list[int]:
    """Columns less as many of those to drop as have to go."""
    kept = list(columns)
    for column in drop:
        if column in kept and _width(kept, widths) > limit:
            kept.remove(column)
    return kept


def _width(kept: Sequence[int], widths: Sequence[int]) -> int:
    return sum(widths[i] for i in kept) + len(_INDENT) * (len(kept) - 1)


def _echo_row(
    row: Sequence[str], kept: Sequence[int], widths: Sequence[int], right: Sequence[int],
    indent: str = "",
) -> None:  # fmt: skip
    parts = [indent]
    for i in kept:
        parts += [row[i].rjust(widths[i]) if i in right else row[i].ljust(widths[i]), _INDENT]
    while parts and not parts[-1].strip():
        parts.pop()
    echo_painted(*parts[:-1], *(part.rstrip() for part in parts[-1:]))


def _echo_block(heading: Sequence[str], row: Sequence[str], width: int) -> None:
    """Print a row as lines of heading and cell."""
    echo(row[0])
    wide = max(map(len, heading[1:]), default=0)
    for name, cell in zip(heading[1:], row[1:]):
        first = f"{_INDENT}{name:{wide}}{_INDENT}"
        if cell and len(cell) + len(first) <= width:
            echo_painted(first, cell)
        elif cell:
            echo(textwrap.fill(cell, width, initial_indent=first,
                               subsequent_indent=" " * len(first)))  # fmt: skip


def echo_json(document: Any) -> None:
    """Print a document as JSON, nothing else."""
    echo_result(json_text(document))


def json_text(document: Any) -> str:
    """Return a document as JSON in ASCII, so that no encoding can spoil it."""
    return json.dumps(document, indent=2, allow_nan=False) + "\n"
